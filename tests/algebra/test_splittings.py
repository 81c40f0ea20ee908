"""Splittings and operators: one equation behind all members."""

import numba
import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from known_answers import SEEDS, chain

import icpmodel as icp
from icpmodel.algebra.operators import AOROperator, FactorisedOperator, inverse_diagonal
from icpmodel.algebra.splittings import AOR, FullSplitting, UserSplitting
from icpmodel.algebra.steps import repeated_steps
from icpmodel.methods.contract import named


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


#: each splitting with several kinds of psi, each kind with several splittings
PAIRS = [
    ("aor", "zero"),
    ("aor", "compiled"),
    ("aor", "affine"),
    ("jacobi", "affine"),
    ("jacobi", "free rows"),
    ("jacobi", "callable"),
    ("whole", "constant"),
    ("whole", "elementwise"),
    ("lower", "compiled"),
    ("lower", "callable"),
    ("upper", "elementwise"),
    ("upper", "affine"),
    ("full", "constant"),
    ("full", "affine"),
]


def printed_step(problem, z, M1, phi, phi1, phi2):
    """Method 3.1 as the paper prints it, with dense matrices and the modulus."""
    A, q, psi = problem.A.toarray(), problem.q, problem.psi.value(z)
    P1, P2, Phi = np.diag(phi1), np.diag(phi2), np.diag(phi)
    N1 = M1 - A
    right = P1 @ (N1 + Phi) @ z + np.abs((P1 @ A - P2) @ z + P1 @ q + P2 @ psi) - P1 @ q + P2 @ psi
    return np.linalg.solve(P1 @ M1 + P1 @ Phi + P2, right)


@pytest.mark.parametrize(("splitting", "kind"), PAIRS)
@settings(max_examples=15)
@given(seed=SEEDS)
def test_collapse_identity_the_paper_s_modulus_step_is_one_preconditioned_step(kind, splitting, seed):
    problem, rng = random_problem(seed, kind)
    n, A = problem.n, problem.A
    phi, phi1, phi2 = rng.random(n), rng.random(n) + 0.5, rng.random(n) + 0.5
    choice = {
        "aor": AOR(1.3, 0.7),
        "jacobi": AOR(1.0, 0.0),
        "whole": FullSplitting(),
        "lower": UserSplitting(sp.tril(A) * 1.1),
        "upper": UserSplitting(sp.triu(A) * 1.1),
        "full": UserSplitting(A + sp.eye_array(n)),
    }[splitting]
    method = icp.Modulus(splitting=choice, phi=phi, phi1=phi1, phi2=phi2)
    z = rng.normal(size=n)
    path = method.iterates(problem, z)
    (_, residual), (following, _) = next(path), next(path)
    M1 = choice.matrix(A).toarray()
    if kind == "free rows":  # there the equation alone counts
        least = np.minimum(problem.p(z), phi2 / phi1 * problem.r(z))
        expected = z - 2 * np.linalg.solve(M1 + np.diag(phi + phi2 / phi1), least)
    else:
        expected = printed_step(problem, z, M1, phi, phi1, phi2)
    off = 1e-12 * max(1.0, np.abs(expected).max()) * np.linalg.cond(M1 + np.diag(phi + phi2 / phi1))
    assert np.abs(following - expected).max() <= off
    assert residual == pytest.approx(problem.residual(z), rel=1e-12)


def test_relaxation_does_not_factorise():
    A = random_problem(0, "zero")[0].A
    shift = np.ones(A.shape[0])
    assert isinstance(AOR(1.0, 1.0).operator(A, shift), AOROperator)
    assert isinstance(UserSplitting(np.eye(A.shape[0])).operator(A, shift), AOROperator)
    assert isinstance(UserSplitting(A).operator(A, shift), FactorisedOperator)


class TestSingularOperatorNamesTheRow:
    def test_a_diagonal_of_x_that_cancels_is_singular_and_its_row_is_named(self):
        problem = icp.ICP(np.diag([2.0, 3.0, 4.0]), np.zeros(3))
        with pytest.raises(icp.SingularOperator, match="row 1") as error:
            problem.solve("mnmj", phi=[0.0, -6.0, 0.0])
        assert error.value.row == 1

    def test_dependent_rows_are_named_wherever_they_stand(self):
        A = np.eye(5)
        A[3:, 3:] = [[0.1, 0.2], [0.3, 0.6]]
        with pytest.raises(icp.SingularOperator) as error:
            FactorisedOperator(sp.csr_array(A))
        assert error.value.row in (3, 4)

    def test_rows_and_columns_in_different_units_are_not_called_singular(self):
        n = 20_000
        D = sp.diags_array(np.where(np.arange(n) % 2, 1e-12, 1.0))
        T = chain(n, 2.5)
        X = sp.csr_array(D @ T @ D)
        assert X @ FactorisedOperator(X).solve(X @ np.ones(n)) == pytest.approx(X @ np.ones(n), rel=1e-6)


class TestEquilibration:
    def test_a_diagonal_that_cancels_to_rounding_is_singular(self):
        with pytest.raises(icp.SingularOperator):
            inverse_diagonal(np.array([1.0]), np.array([-1.0 + 2.0**-53]))

    @pytest.mark.filterwarnings("error")
    def test_subnormal_rows_do_not_overflow(self):
        X = FactorisedOperator(sp.csr_array([[2.0, 1.0], [0.0, 1e-310]]))
        assert X.solve(np.array([3.0, 1e-310])) == pytest.approx([1.0, 1.0])


def band(rng, n, below, above):
    """A random matrix whose entries reach so far, with a diagonal of either sign."""
    A = np.triu(np.tril(rng.normal(size=(n, n)), above), -below) * (rng.random((n, n)) < 0.7)
    np.fill_diagonal(A, rng.choice([-1.0, 1.0], n) * (1.0 + rng.random(n)))
    return A


@pytest.mark.parametrize(("method", "moves"), [("mnmgs", False), ("mnmgs", True), ("psor", True), ("psor", False)])
def test_sweeps_made_at_once_are_the_sweeps(method, moves):
    """Iterates and residuals, for every reach of the entries above the diagonal."""
    rng = np.random.default_rng(1)
    for n, below, above in ((1, 0, 0), (5, 4, 0), (5, 0, 4), (60, 3, 1), (60, 20, 9), (60, 59, 59)):
        A = np.abs(band(rng, n, below, above)) + 2.0 * n * np.eye(n)
        c = np.where(rng.random(n) < 0.2, -np.inf, rng.normal(size=n))
        psi = icp.Affine(band(rng, n, 1, min(n - 1, 12)) / n, c) if moves else c
        problem, z = icp.ICP(A, rng.normal(size=n), psi), rng.normal(size=n)
        step = named(method).step_of(problem)
        for count in (1, 2, 3, 4, np.inf):
            answers = repeated_steps(step, z, count)
            assert len(answers) == min(count, 4)
            for came, residual in answers:
                assert residual == pytest.approx(problem.residual(z), rel=1e-12)
                assert came == pytest.approx(step(z)[0], rel=1e-13, abs=1e-13)
                z = came


@pytest.mark.parametrize("q", [[1e200, -1e200], [1e-300, -1e-300], [5e-324, -1.0]])
def test_sweeps_in_one_call_take_numbers_whose_squares_are_none(q):
    assert icp.ICP(4 * np.eye(2), q).solve("psor").solved


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
