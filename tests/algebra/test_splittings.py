"""Splittings and operators: one equation behind all members."""

from itertools import islice

import numba
import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import icpmodel as icp
from icpmodel.algebra.operators import AOROperator, FactorisedOperator, TriangularOperator, inverse_diagonal
from icpmodel.algebra.relaxation import jacobi_step
from icpmodel.algebra.splittings import AOR, Given, Whole
from icpmodel.algebra.steps import compiled_step, in_a_row
from icpmodel.methods.contract import named
from icpmodel.numerics.threads import one_behind_the_other


@numba.njit
def sine(t):
    return 0.3 * np.sin(t)


def random_problem(seed, kind, n=12):
    rng = np.random.default_rng(seed)
    A = sp.random_array((n, n), density=0.3, rng=rng, data_sampler=rng.normal) + 4 * sp.eye_array(n)
    G = sp.random_array((n, n), density=0.2, rng=rng, data_sampler=rng.normal) * 0.3
    psi = {
        "zero": 0.0,
        "constant": rng.normal(size=n),
        "free rows": np.where(rng.random(n) < 0.5, -np.inf, rng.normal(size=n)),
        "affine": icp.Affine(G, rng.normal(size=n)),
        "elementwise": icp.Elementwise(lambda z: 0.3 * np.sin(z), c=1.0),
        "compiled": icp.Elementwise(sine, c=1.0),
        "callable": lambda z: 0.5 * z[::-1],
    }[kind]
    return icp.ICP(A, rng.normal(size=n), psi), rng


KINDS = ["zero", "constant", "affine", "elementwise", "compiled", "callable"]


def printed_step(problem, z, M1, phi, phi1, phi2):
    """Method 3.1 as the paper prints it, with dense matrices and the modulus."""
    A, q, psi = problem.A.toarray(), problem.q, problem.psi.value(z)
    P1, P2, Phi = np.diag(phi1), np.diag(phi2), np.diag(phi)
    N1 = M1 - A
    right = P1 @ (N1 + Phi) @ z + np.abs((P1 @ A - P2) @ z + P1 @ q + P2 @ psi) - P1 @ q + P2 @ psi
    return np.linalg.solve(P1 @ M1 + P1 @ Phi + P2, right)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("splitting", ["aor", "jacobi", "whole", "lower", "upper", "full"])
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_collapse_identity_the_paper_s_modulus_step_is_one_preconditioned_step(kind, splitting, seed):
    problem, rng = random_problem(seed, kind)
    n, A = problem.n, problem.A
    phi, phi1, phi2 = rng.random(n), rng.random(n) + 0.5, rng.random(n) + 0.5
    choice = {
        "aor": AOR(1.3, 0.7),
        "jacobi": AOR(1.0, 0.0),
        "whole": Whole(),
        "lower": Given(sp.tril(A) * 1.1),
        "upper": Given(sp.triu(A) * 1.1),
        "full": Given(A + sp.eye_array(n)),
    }[splitting]
    method = icp.Modulus(splitting=choice, phi=phi, phi1=phi1, phi2=phi2)
    z = rng.normal(size=n)
    path = method.iterates(problem, z)
    (_, residual), (following, _) = next(path), next(path)
    expected = printed_step(problem, z, choice.matrix(A).toarray(), phi, phi1, phi2)
    assert np.abs(following - expected).max() <= 1e-12 * max(1.0, np.abs(expected).max()) * np.linalg.cond(
        choice.matrix(A).toarray() + np.diag(phi + phi2 / phi1)
    )
    assert residual == pytest.approx(problem.residual(z), rel=1e-12)


@pytest.mark.parametrize("theta", [(1.0, 1.0), (1.3, 0.7)])
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(65, 100))
def test_entries_side_by_side_are_summed_as_others_are(theta, seed, n):
    """Full rows, wide bands, blocks at either end, scattered ones, and some of them with a gap."""
    rng = np.random.default_rng(seed)
    i, j = np.indices((n, n))
    width, low = rng.integers(3, 40), rng.integers(0, 30, n)[:, None]
    kinds = np.array([j >= 0, np.abs(i - j) <= width, j >= low, j < n - low, rng.random((n, n)) < 0.2])
    pattern = kinds[rng.integers(len(kinds), size=n), np.arange(n)] & (rng.random((n, n)) < rng.choice([0.95, 1.0]))
    A = sp.csr_array(np.where(pattern, rng.normal(size=(n, n)), 0.0) + 2 * n * np.eye(n))
    G = sp.csr_array(np.where(pattern, rng.normal(size=(n, n)) / n, 0.0))
    problem, z = icp.ICP(A, rng.normal(size=n), icp.Affine(G, rng.normal(size=n))), rng.normal(size=n)
    p, r, D, ones = A @ z + problem.q, problem.r(z), A.diagonal(), np.ones(n)
    assert problem.product(z) == pytest.approx(A @ z, rel=1e-12, abs=1e-12 * n)
    assert problem.residual(z) == pytest.approx(np.linalg.norm(np.minimum(p, r)), rel=1e-12)
    splitting = AOR(*theta)
    step = icp.Modulus(splitting=splitting, phi2=D).step_of(problem)
    M1 = splitting.matrix(A).toarray()
    assert step(z)[0] == pytest.approx(printed_step(problem, z, M1, 0.0 * D, ones, D), rel=1e-11, abs=1e-11)
    new, psi = z.copy(), problem.psi.value(z)
    for k in range(n):
        new[k] = max(psi[k], new[k] - (A[[k]] @ new + problem.q[k])[0] / D[k])
    assert icp.PSOR().step_of(problem)(z)[0] == pytest.approx(new, rel=1e-11, abs=1e-11)


def test_rows_without_obstacle_move_by_the_equation_alone():
    problem, rng = random_problem(3, "free rows")
    z, omega = rng.normal(size=problem.n), rng.random(problem.n) + 0.5
    operator = AOR(1.2, 0.9).operator(problem.A, omega)
    following, _ = operator.step(problem, omega)(z)
    expected = z - 2 * operator.solve(np.minimum(problem.p(z), omega * problem.r(z)))
    assert np.isfinite(following).all()
    assert following == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("splitting", [AOR(1.2, 0.7), AOR(1.0, 0.0), Whole(), "lower", "upper"])
def test_operator_solve_is_the_inverse_of_X(splitting):
    problem, rng = random_problem(1, "zero")
    if isinstance(splitting, str):
        splitting = Given({"lower": sp.tril, "upper": sp.triu}[splitting](problem.A))
    shift, f = rng.random(problem.n), rng.normal(size=problem.n)
    X = splitting.matrix(problem.A).toarray() + np.diag(shift)
    assert splitting.operator(problem.A, shift).solve(f) == pytest.approx(np.linalg.solve(X, f), rel=1e-10)


def test_phi1_only_rescales():
    """(φ₁, φ₂) acts through Ω = φ₁⁻¹φ₂."""
    problem, rng = random_problem(5, "affine")
    z, scale = rng.normal(size=problem.n), rng.random(problem.n) + 0.5
    for a, b in ((1.0, 2.0), (scale, 2.0 * scale)):
        path = icp.MNMGS(phi1=a, phi2=b).iterates(problem, z)
        next(path)
        following = next(path)[0]
        if np.ndim(a) == 0:
            reference = following
    assert following == pytest.approx(reference, rel=1e-13)


def test_nmms_is_the_member_with_phi_zero_and_phi1_one():
    problem, rng = random_problem(6, "affine")
    z = rng.normal(size=problem.n)
    steps = []
    for method in (icp.NMMS(omega=3.0), icp.Modulus(phi=0.0, phi1=1.0, phi2=3.0)):
        path = method.iterates(problem, z)
        next(path)
        steps.append(next(path)[0])
    assert np.array_equal(*steps)


def test_mnmaor_with_phi_kappa_D_is_aor_with_smaller_theta():
    """MNMAOR(θ₁, θ₂, φ = κD) equals AOR with θ/(1 + κθ₁)."""
    problem, rng = random_problem(7, "constant")
    z, kappa, t1, t2 = rng.normal(size=problem.n), 0.7, 1.3, 0.8
    D = problem.A.diagonal()
    damped = icp.MNMAOR(theta1=t1, theta2=t2, phi=kappa * D, phi2=2.0)
    plain = icp.MNMAOR(theta1=t1 / (1 + kappa * t1), theta2=t2 / (1 + kappa * t1), phi2=2.0)
    steps = []
    for method in (damped, plain):
        path = method.iterates(problem, z)
        next(path)
        steps.append(next(path)[0])
    assert steps[0] == pytest.approx(steps[1], rel=1e-13)


def test_triangular_members_do_not_factorise():
    A = random_problem(0, "zero")[0].A
    shift = np.ones(A.shape[0])
    assert isinstance(AOR(1.0, 1.0).operator(A, shift), AOROperator)
    assert isinstance(Given(sp.tril(A)).operator(A, shift), TriangularOperator)
    assert isinstance(Given(sp.triu(A)).operator(A, shift), TriangularOperator)
    assert isinstance(Given(A).operator(A, shift), FactorisedOperator)


class TestSingularOperatorNamesTheRow:
    def test_diagonal_that_cancels(self):
        problem = icp.ICP(np.diag([2.0, 3.0, 4.0]), np.zeros(3))
        with pytest.raises(icp.SingularOperator, match="row 1") as error:
            problem.solve("mnmj", phi=[0.0, -6.0, 0.0])
        assert error.value.row == 1

    def test_zero_row_of_a_factorised_member(self):
        problem = icp.ICP(np.diag([1.0, 1.0, -1.0]), np.zeros(3))
        with pytest.raises(icp.SingularOperator, match="row 2 is zero"):
            problem.solve("mnmod")

    def test_dependent_rows_up_to_rounding(self):
        A = np.array([[0.1, 0.2, 0.0], [0.3, 0.6, 0.0], [0.0, 0.0, 1.0]]) - np.eye(3)
        with pytest.raises(icp.SingularOperator, match="linear combination") as error:
            icp.ICP(A, np.ones(3)).solve("mnmod")
        assert error.value.row in (0, 1)

    def test_dependent_rows_are_named_wherever_they_stand(self):
        A = np.eye(5)
        A[3:, 3:] = [[0.1, 0.2], [0.3, 0.6]]
        with pytest.raises(icp.SingularOperator) as error:
            FactorisedOperator(sp.csr_array(A))
        assert error.value.row in (3, 4)

    def test_different_units_do_not_look_like_singularity(self):
        n = 20_000
        D = sp.diags_array(np.where(np.arange(n) % 2, 1e-12, 1.0))
        T = sp.diags_array([-np.ones(n - 1), np.full(n, 2.5), -np.ones(n - 1)], offsets=[-1, 0, 1])
        X = sp.csr_array(D @ T @ D)
        assert X @ FactorisedOperator(X).solve(X @ np.ones(n)) == pytest.approx(X @ np.ones(n), rel=1e-6)

    def test_a_badly_scaled_but_regular_operator_is_not_called_singular(self):
        problem = icp.ICP(np.diag([1e-150, 1.0, 1e150]), [-1e-150, -1.0, -1e150])
        assert problem.solve("modulus", splitting="whole").z == pytest.approx(np.ones(3))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"splitting": "gauss"}, "one of jacobi"),
        ({"splitting": np.ones((2, 3))}, r"shape \(2, 3\)"),
        ({"phi1": 0.0}, "phi1"),
        ({"phi2": [1.0, -1.0]}, "phi2"),
        ({"phi": float("nan")}, "phi"),
        ({"phi": 1j}, "complex"),
    ],
)
def test_wrong_options_are_named(options, words):
    with pytest.raises(icp.InputError, match=words):
        icp.Modulus(**options)


def test_wrong_length_of_an_option_is_named():
    with pytest.raises(icp.InputError, match=r"phi has shape \(3,\); shape \(2,\)"):
        icp.ICP(np.eye(2), np.ones(2)).solve("mnmgs", phi=[1.0, 2.0, 3.0])
    with pytest.raises(icp.InputError, match=r"M1\) has shape \(3, 3\)"):
        icp.ICP(np.eye(2), np.ones(2)).solve("modulus", splitting=np.eye(3))


@pytest.mark.parametrize("theta", [0.0, float("nan"), float("inf"), "1"])
def test_theta1_must_be_a_nonzero_number(theta):
    with pytest.raises(icp.InputError, match="theta1"):
        icp.MNMSOR(theta1=theta)


class TestEquilibration:
    def test_columns_in_other_units_are_not_singular(self):
        X = sp.csr_array([[1.0, 1e-20], [1.0, 2e-20]])
        assert FactorisedOperator(X).solve(np.array([2.0, 3.0])) == pytest.approx([1.0, 1e20])

    def test_a_diagonal_that_cancels_to_rounding_is_singular(self):
        with pytest.raises(icp.SingularOperator):
            inverse_diagonal(np.array([1.0]), np.array([-1.0 + 2.0**-53]))

    def test_the_dependent_row_is_named_and_not_the_column(self):
        X = sp.csr_array([[1.0, 2.0, 0.0], [1.0, 2.0, 0.0], [3.0, 1.0, 0.0]])  # rows 0, 1 equal; column 2 zero
        with pytest.raises(icp.SingularOperator) as error:
            FactorisedOperator(X)
        assert error.value.row in (0, 1)

    @pytest.mark.filterwarnings("error")
    def test_subnormal_rows_do_not_overflow(self):
        X = FactorisedOperator(sp.csr_array([[2.0, 1.0], [0.0, 1e-310]]))
        assert X.solve(np.array([3.0, 1e-310])) == pytest.approx([1.0, 1.0])
        with pytest.raises(icp.SingularOperator):
            FactorisedOperator(sp.csr_array([[2.0, 1e-309], [1.0, 0.0]]))


def band(rng, n, below, above):
    """A random matrix whose entries reach so far, with a diagonal of either sign."""
    A = np.triu(np.tril(rng.normal(size=(n, n)), above), -below) * (rng.random((n, n)) < 0.7)
    np.fill_diagonal(A, rng.choice([-1.0, 1.0], n) * (1.0 + rng.random(n)))
    return A


@pytest.mark.parametrize("index", [np.int32, np.int64])
def test_the_rows_are_looked_at_right(index):
    """Diagonal entries and where they stand, the weight of the others, and how far they reach."""
    rng = np.random.default_rng(0)
    for n, below, above in ((1, 0, 0), (2, 1, 0), (9, 0, 3), (40, 7, 2), (40, 39, 39)):
        A = band(rng, n, below, above)
        problem = icp.ICP(A, np.zeros(n))
        problem.A.indices, problem.A.indptr = problem.A.indices.astype(index), problem.A.indptr.astype(index)
        rows = problem.matrix.rows
        assert (problem.A.data[rows.diag] == A.diagonal()).all()
        assert (rows.diagonal == A.diagonal()).all()
        assert rows.rest == pytest.approx(np.abs(A).sum(axis=1) - np.abs(A.diagonal()))
        i, j = np.nonzero(A)
        assert (rows.below, rows.above) == ((i - j).max(), (j - i).max())
        assert rows.lower == pytest.approx(np.abs(np.tril(A, -1)).sum())
        assert rows.upper == pytest.approx(np.abs(np.triu(A, 1)).sum())


def in_order(problem, name, **options):
    """The sweep of a method from the first row to the last, made as is asked for."""
    A, rows = problem.A, problem.matrix.rows
    own = {"psor": (1.0,), "mnmgs": (rows.diagonal, 0.5 / rows.diagonal, 1.0)}[name]
    matrix = (A.indptr, A.indices, A.data, rows.diag, problem.q)
    return compiled_step(problem, "in_order", matrix, (own, True), rows.above, **options)


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("few", [0, 20_000])
@pytest.mark.parametrize("method", ["mnmgs", "psor"])
def test_sweeps_made_at_once_are_the_sweeps(method, few, moves):
    """Iterates and residuals, for every reach of the entries above the diagonal: two in one pass, some in one call."""
    rng = np.random.default_rng(1)
    for n, below, above in ((1, 0, 0), (5, 4, 0), (5, 0, 4), (60, 3, 1), (60, 20, 9), (60, 59, 59)):
        A = np.abs(band(rng, n, below, above)) + 2.0 * n * np.eye(n)
        c = np.where(rng.random(n) < 0.2, -np.inf, rng.normal(size=n))
        psi = icp.Affine(band(rng, n, 1, min(n - 1, 12)) / n, c) if moves else c
        problem, z = icp.ICP(A, rng.normal(size=n), psi), rng.normal(size=n)
        step, alone = in_order(problem, method, few=few), named(method).step_of(problem)
        for count in (1, 2, 3, 4, np.inf):
            answers = in_a_row(step, z, count)
            assert len(answers) <= min(count, 4)
            assert count == 1 or len(answers) > 1
            for came, residual in answers:
                assert residual == pytest.approx(problem.residual(z), rel=1e-12)
                assert came == pytest.approx(alone(z)[0], rel=1e-13, abs=1e-13)
                z = came


@pytest.mark.parametrize("method", ["mnmgs", "mnmsor", "psor"])
def test_a_path_is_the_same_whatever_a_run_says_of_the_iterates_to_come(method):
    rng = np.random.default_rng(5)
    problem = icp.ICP(band(rng, 40, 3, 3) + 9.0 * np.eye(40), rng.normal(size=40), rng.normal(size=40))
    plain = list(islice(named(method).iterates(problem, np.zeros(40)), 30))
    for told in ([0.5], [np.inf], [3.0, 1.0, 7.5], [1.0, 1.0, 9.0, 2.0]):
        path = named(method).iterates(problem, np.zeros(40))
        came = [next(path), *(path.send(told[k % len(told)]) for k in range(29))]
        for (z, hint), (same, residual) in zip(came, plain, strict=True):
            assert np.abs(z - same).max() <= 1e-13
            assert hint is None or hint == pytest.approx(residual, rel=1e-9, abs=1e-13)


@pytest.mark.parametrize("q", [[1e200, -1e200], [1e-300, -1e-300], [5e-324, -1.0]])
def test_sweeps_in_one_call_take_numbers_whose_squares_are_none(q):
    assert icp.ICP(4 * np.eye(2), q).solve("psor").solved


def test_the_numbers_of_a_method_stay_what_was_checked():
    method = icp.NMMS(omega=np.array([1.0, 2.0]))
    with pytest.raises(ValueError, match="read-only"):
        method.omega_of(icp.ICP(np.eye(2), [1.0, 1.0]))[0] = -5.0
    problem = icp.ICP([[2.0]], [-2.0])
    assert jacobi_step(problem, 2)(np.zeros(1))[0] == jacobi_step(problem, np.array([2.0]))(np.zeros(1))[0]


@pytest.mark.parametrize("wanted", [1, 2, 3, 4])
@pytest.mark.parametrize("method", ["mnmgs", "psor"])
@pytest.mark.parametrize("chunk", [7, 20, 59, 60, 500])
def test_two_threads_make_the_sweeps_of_one(method, wanted, chunk):
    """The second follows behind what the first has done, so that every number is the same, however many are wanted."""
    rng = np.random.default_rng(4)
    problem = icp.ICP(band(rng, 60, 5, 3) + 99.0 * np.eye(60), rng.normal(size=60), rng.normal(size=60))
    z = rng.normal(size=60)
    alone, together = (in_order(problem, method, few=0, threads=k, chunk=chunk) for k in (1, 2))
    for _ in range(5):
        answers = in_a_row(together, z, wanted)
        assert len(answers) == (1, 2, 2, 4)[wanted - 1]  # as with one thread, so that as much work is counted
        for came, residual in answers:
            one, other = alone(z)
            assert (one == came).all()
            assert residual == pytest.approx(other, rel=1e-14)
            z = came


def test_what_interrupts_the_first_thread_ends_the_second():
    """And what the second one raises comes out."""
    seen = []

    def first(low, high):
        if low == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        one_behind_the_other(9, 2, first, lambda low, high: seen.append((low, high)), 1, chunk=2)
    assert seen == [(0, 1), (1, 3)]
    with pytest.raises(ZeroDivisionError):
        one_behind_the_other(9, 2, lambda low, high: None, lambda low, high: 1 / (4 - high), 0, chunk=2)


def test_a_sweep_that_raises_leaves_nothing_behind():
    """The step before it, asked for once more, is what it was."""

    @numba.njit
    def f(t):
        if t > 50.0:
            raise ValueError("too large")
        return 0.3 * np.sin(t)

    rng = np.random.default_rng(3)
    problem = icp.ICP(band(rng, 9, 3, 3) + 99.0 * np.eye(9), rng.normal(size=9), icp.Elementwise(f))
    omega = problem.A.diagonal()
    step = AOR(1.0, 1.0).operator(problem.A, omega).step(problem, omega)
    one, _ = step(rng.normal(size=9))
    two, _ = AOR(1.0, 1.0).operator(problem.A, omega).step(problem, omega)(one)
    with pytest.raises(icp.MapError):
        step(np.append(rng.normal(size=8), 99.0))
    assert step(one)[0] == pytest.approx(two, rel=1e-13, abs=1e-13)
