"""Proofs of uniqueness beyond H₊-matrices, held against solutions known exactly: fractions, or dyadic data."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest
import scipy.sparse as sp
from exact import dot, solutions, solve_rational
from hypothesis import given, settings
from hypothesis import strategies as st
from known_answers import GENERATORS, chain

import icpmodel as icp
from icpmodel.algebra.linear_rows import has_linear_pieces
from icpmodel.theory.certificates import definite, enumerated, supersolution
from icpmodel.theory.certificates.bounds import supersolution_proof
from icpmodel.theory.certificates.proof import Proof

#: how far z is from the solution
DISTANCES = st.sampled_from([0.0, 1e-15, 2.0**-30, 1e-3, 1.0, 1e6])


def fractions(x):
    return [fractions(y) for y in x] if np.ndim(x) else Fraction(float(x))


def holds(proof, problem, z, exact):
    """Whether |z − z*| ≤ δ and ‖z − z*‖ ≤ ε for certain; true where the proof says nothing about this z."""
    with np.errstate(over="ignore"):
        delta, euclidean = proof.bound(problem, z, *problem.rounding(z))
    if not np.isfinite(delta).all():
        return True
    errors = [abs(Fraction(float(x)) - Fraction(y)) for x, y in zip(z, exact, strict=True)]
    small = all(e <= Fraction(float(d)) for e, d in zip(errors, delta, strict=True))
    if np.isinf(euclidean):
        return small
    return small and sum(e * e for e in errors) <= Fraction(float(euclidean)) ** 2


def manufactured(A, G, rng, bent=False):
    """(problem, z*): dyadic data of few bits around an exact solution; a row in eight has no obstacle. ψ = G|z| + c
    where it is `bent`."""
    n = A.shape[0]
    exact, active = rng.integers(-64, 65, size=n) / 16, rng.random(n) < 0.5
    p = np.where(active, rng.integers(0, 9, size=n) / 8, 0.0)
    r = np.where(active, 0.0, rng.integers(0, 9, size=n) / 8)
    c = exact - r - G @ (np.abs(exact) if bent else exact)
    c[(rng.random(n) < 0.125) & (p == 0)] = -np.inf
    psi = icp.Affine(G, c) if G.any() else c
    if bent:
        psi = icp.Function(lambda z: G @ np.abs(z) + c, lipschitz=np.abs(G))
    return icp.ICP(A, p - A @ exact, psi), exact


def definite_matrix(rng, n):
    """Positive definite, of small integers, with a skew part that takes it out of the H₊-matrices."""
    B, K = rng.integers(-2, 3, size=(n, n)), rng.integers(-4, 5, size=(n, n))
    return (B @ B.T + np.eye(n) + K - K.T).astype(float)


def definite_of(problem):
    return definite.prove(problem.matrix, problem.psi)


def enumerated_of(problem):
    return enumerated.prove(problem) if has_linear_pieces(problem) else "an obstacle is not affine"


both = pytest.mark.parametrize("prove", [definite_of, enumerated_of])


@both
@given(rng=GENERATORS, distance=DISTANCES, steep=st.sampled_from([0, 1, 16, "bent"]))
def test_the_bound_is_never_below_the_true_error(prove, rng, distance, steep):
    """In units of all sizes: `test_theory_scales.py`. From 65 rows on the matrices are sparse."""
    n = int(rng.integers(1, 6))
    A = definite_matrix(rng, n) if rng.random() < 0.7 else rng.integers(-3, 4, size=(n, n)) + 4.0 * np.eye(n)
    G = rng.integers(-4, 5, size=(n, n)) / 64 * (1 if steep == "bent" else steep)
    bent = steep == "bent"
    if prove is definite_of and rng.random() < 0.3:
        A, G = (sp.block_diag([M, one * sp.eye_array(70)]).toarray() for M, one in ((A, 1.0), (G, 0.0)))
        n += 70
    problem, exact = manufactured(A + 8 * bent * np.eye(n), G, rng, bent)
    z = exact + distance * rng.integers(-8, 9, size=n) / 8 * np.maximum(np.abs(exact), 1e-300)
    proof = prove(problem)
    assert isinstance(proof, str) or holds(proof, problem, z, exact)


@settings(max_examples=40)
@given(rng=GENERATORS)
def test_uniqueness_is_claimed_only_where_there_is_one_solution(rng):
    n = int(rng.integers(1, 4))
    A, G = rng.integers(-2, 5, size=(n, n)).astype(float), rng.integers(-4, 5, size=(n, n)) / 4
    problem = icp.ICP(A, rng.integers(-4, 5, size=n), icp.Affine(G, rng.integers(-4, 5, size=n)))
    for prove in (definite_of, enumerated_of):
        assert isinstance(prove(problem), str) or len(solutions(problem)) == 1


def test_a_determinant_that_rounding_made_is_no_proof():
    """[a, b; c, bc/a]: the determinant is some 1e-17 of either sign, or zero; z = (1, 1) is one solution or more."""
    rng = np.random.default_rng(0)
    for a, b, c in rng.uniform(1, 2, (50, 3)):
        A = np.array([[a, b], [c, b * c / a]])
        problem = icp.ICP(A, -A.sum(axis=1))
        assert isinstance(enumerated_of(problem), str) or len(solutions(problem)) == 1


@settings(max_examples=40)
@given(rng=GENERATORS)
def test_a_few_unknowns_are_proved_unique_exactly_where_they_are(rng):
    n = int(rng.integers(1, 5))
    problem = icp.ICP(rng.integers(-3, 4, size=(n, n)), rng.integers(-4, 5, size=n), rng.integers(-2, 3, size=n))
    proof = enumerated_of(problem)
    found = solutions(problem)
    assert isinstance(proof, str) or len(found) == 1
    whole = icp.all_solutions(problem)
    assert isinstance(proof, Proof) == (len(whole) == 1 and not whole.faces)


def test_active_sets_whose_equations_contradict_each_other_need_no_proof_of_their_own():
    """Σz = −q_i for two rows or more: 1013 singular systems of 1024. The solution is (1, 0, …, 0)."""
    proof = enumerated_of(icp.ICP(np.ones((10, 10)), np.arange(-1.0, 9.0)))
    assert isinstance(proof, Proof)
    assert proof.solution.tolist() == [1.0] + [0.0] * 9


@settings(max_examples=40)
@given(rng=GENERATORS, decades=st.sampled_from([0, 8]))
def test_definite_matrices_are_proved_so_in_any_units(rng, decades):
    n = int(rng.integers(1, 5))
    rows = np.ldexp(1.0, rng.integers(-decades, decades + 1, size=n))
    problem = icp.ICP(rows[:, None] * definite_matrix(rng, n) * rows, np.zeros(n))
    assert isinstance(definite_of(problem), Proof)


def test_errors_of_p_and_of_r_count_where_the_other_balances_too():
    """A = [1, 10; −10, 1], q = (−1, 0), z = 0: with ψ₁ = 1 instead of 0 the solution is (1, 10)."""
    problem, z = icp.ICP([[1.0, 10.0], [-10.0, 1.0]], [-1.0, 0.0]), np.zeros(2)
    assert icp.ICP(problem.A, problem.q, [1.0, 0.0]).residual([1.0, 10.0]) == 0.0
    delta, _ = definite_of(problem).bound(problem, z, np.zeros(2), np.array([1.0, 0.0]))
    assert (delta >= [1.0, 10.0]).all()
    problem, nothing, eighth = icp.ICP([[1.0]], [0.0]), np.zeros(1), np.full(1, 0.125)
    for errors in ((eighth, nothing), (nothing, eighth)):
        assert 0.125 <= definite_of(problem).bound(problem, nothing, *errors)[0][0] <= 0.3


@both
def test_a_row_without_obstacle_may_have_any_slope(prove):
    problem = icp.ICP(np.eye(2), [1.0, 1.0], icp.Affine([[3.0, 9.0], [0.0, 0.5]], [-np.inf, 0.0]))
    delta, _ = prove(problem).bound(problem, np.zeros(2), *problem.rounding(np.zeros(2)))
    assert delta[0] >= 1.0  # z* = (-1, 0)


def test_a_smooth_error_on_a_grid_is_not_divided_by_the_smallest_eigenvalue():
    """e the lowest mode of a string without contact: the bound is the error itself, not λ_max/λ_min times it."""
    n = 200
    x = np.linspace(0.0, 1.0, n + 2)[1:-1]
    A = chain(n)
    problem = icp.ICP(A, -(A @ (1 + x)), psi=-5.0)
    for mode in (np.sin(np.pi * x), np.sin(9 * np.pi * x)):
        z = 1 + x + mode
        _, euclidean = definite_of(problem).bound(problem, z, *problem.rounding(z))
        assert np.linalg.norm(mode) <= euclidean <= 12 * np.linalg.norm(mode)


def test_rows_without_obstacle_are_rows_of_a_linear_system():
    """A = [1, 2; 2, 1] has a negative minor, but with both rows free z is the solution of Az = −q."""
    problem = icp.ICP([[1.0, 2.0], [2.0, 1.0]], [-3.0, -3.0], -np.inf)
    assert 0.5 <= icp.error_bound(problem, [1.5, 1.0], sharp=False).value <= 1.0
    assert not icp.error_bound(problem.with_psi([-np.inf, 0.0]), [1.5, 1.0]).unique


def impulse_problem(rng):
    """(A, q, jumps): dyadic, n ≤ 4, A with row sums ≥ 0, jumps at a cost, not all of them positive."""
    n = int(rng.integers(1, 5))
    A = -(rng.integers(0, 3, size=(n, n)) * (rng.random((n, n)) < 0.6)).astype(float)
    np.fill_diagonal(A, 0.0)
    np.fill_diagonal(A, -A.sum(axis=1) + rng.integers(0, 3, size=n) / 4)
    i, j = np.nonzero((rng.random((n, n)) < 0.5) & ~np.eye(n, dtype=bool))
    return A, rng.integers(-16, 9, size=n) / 4, sp.csr_array((-rng.integers(-1, 9, i.size) / 4, (i, j)), shape=(n, n))


def sides(A, q, jumps, z):
    """p, and of each row the z_i − z_j − gain of its jumps, in fractions."""
    p = [dot(row, z) + b for row, b in zip(fractions(A), fractions(q), strict=True)]
    start, to, gains = jumps.indptr, jumps.indices, fractions(jumps.data)
    return p, [[z[i] - z[to[k]] - gains[k] for k in range(start[i], start[i + 1])] for i in range(len(z))]


def impulse_solutions(A, q, jumps):
    """Every isolated solution, in fractions, by all choices of p or a jump in each row."""
    n, unit, rows, found = len(q), fractions(np.eye(len(q))), fractions(A), []
    choices = [[None, *range(jumps.indptr[i], jumps.indptr[i + 1])] for i in range(n)]
    for choice in product(*choices):
        M, b = [], []
        for i, k in enumerate(choice):
            if k is None:
                M.append(rows[i])
                b.append(-Fraction(q[i]))
            else:
                M.append([x - y for x, y in zip(unit[i], unit[jumps.indices[k]], strict=True)])
                b.append(Fraction(jumps.data[k]))
        z = solve_rational(M, b)
        if z is None or z in found:
            continue
        p, r = sides(A, q, jumps, z)
        if all(min([x, *row]) == 0 for x, row in zip(p, r, strict=True)):
            found.append(z)
    return found


def jumping(gains, where, A=((1.0, 0.0), (0.0, 1.0)), q=(-1.0, -1.0), best="max"):
    return icp.ICP(A, q, icp.Intervention(sp.csr_array((gains, where), shape=(2, 2)), best))


ONE, CIRCLE = ([0], [1]), ([0, 1], [1, 0])


class TestSupersolution:
    @settings(max_examples=40)
    @given(rng=GENERATORS, distance=st.sampled_from([0.0, 1e-15, 1e-6, 1e-2, 1.0, 1e6]), rows=st.sampled_from([0, 300]))
    def test_the_bound_is_never_below_the_true_error_and_one_solution_exists(self, rng, distance, rows):
        """And each s has p(s) ≥ m·weight and r(s) ≥ m."""
        A, q, jumps = impulse_problem(rng)
        units = np.ldexp(1.0, rng.integers(-rows, rows + 1, size=q.size))
        problem = icp.ICP(units[:, None] * A, units * q, icp.Intervention(jumps))
        proof = supersolution.prove(problem)
        if isinstance(proof, str):
            return
        m = Fraction(proof.margin)
        p, r = sides(problem.A.toarray(), problem.q, jumps, fractions(proof.s))
        assert all(x >= m * a > 0 for x, a in zip(p, fractions(proof.weight), strict=True))
        assert all(x >= m for row in r for x in row)
        (exact,) = impulse_solutions(A, q, jumps)
        z = np.array([float(x) for x in exact]) + distance * rng.integers(-8, 9, size=q.size) / 8
        assert holds(proof, problem, z, exact)

    @pytest.mark.parametrize("side", [-1.0, 1.0])
    def test_the_rounding_of_p_counts_on_either_side(self, side):
        """Without couplings and jumps the bound is attained: what rounding hides from p is missing at once."""
        rng = np.random.default_rng(0)
        for _ in range(40):
            a, q = rng.uniform(2, 4, 2), -1e8 * rng.random(2)
            problem = jumping([-1e12], ONE, np.diag(a), q)
            exact = [-Fraction(y) / Fraction(x) for x, y in zip(a, q, strict=True)]
            z = np.array([float(x) for x in exact]) + side * 1e-2 * rng.random(2)
            assert holds(supersolution.prove(problem), problem, z, exact)

    def test_where_z_reaches_the_margin_nothing_is_said(self):
        """Jumps 1 ⇄ 2 at the cost 1: every z = (t, t) has r = 1, so F(z) ≤ 1 bounds nothing."""
        problem, far = jumping([-1.0, -1.0], CIRCLE), np.array([1e9, 1e9])
        proof = supersolution.prove(problem)
        assert proof.margin < 1.0
        assert np.isinf(proof.bound(problem, far, *problem.rounding(far))[0]).all()

    @pytest.mark.parametrize(("n", "most"), [(31, 30.0), (241, 60.0)])
    def test_dividends_get_a_bound_within_two_digits(self, n, most):
        """Smooth errors of 1e−8 … 1e−2 of the dividend scene, whose ρ(G) ≥ 1 shuts out every Lipschitz certificate."""
        problem = icp.scenes.dividend(n=n).problem
        exact = problem.solve(rtol=1e-12, raise_on_failure=False).z
        for size in (1e-8, 1e-4, 1e-2):
            z = exact + size * np.sin(2 * np.linspace(0.0, 1.5, problem.n))
            delta = icp.error_bound(problem, z).componentwise
            assert (np.abs(z - exact) <= delta + 1e-10).all()
            assert delta.max() <= most * size

    def test_it_belongs_to_one_q(self):
        problem = jumping([-1.0], ONE)
        other = problem.with_q([-100.0, 50.0])
        assert supersolution_proof(problem) is supersolution_proof(problem)
        assert supersolution_proof(other) is not supersolution_proof(problem)
        assert holds(supersolution_proof(other), other, np.zeros(2), [100, -50])

    @pytest.mark.parametrize(
        ("problem", "words"),
        [
            (jumping([-1.0], ONE, best="min"), 'best="max"'),
            (jumping([-1.0], ONE, [[1.0, -1.0 - 2.0**-52], [0.0, 1.0]]), "A1 >= 0 is needed"),
            (jumping([-1.0], ONE, [[1.0, -1.0], [-1.0, 1.0]]), "not proved to be a nonsingular M-matrix"),
            (jumping([0.0, 0.0], CIRCLE), "no strict supersolution"),  # what costs nothing lets every level of z stand
        ],
    )
    def test_without_a_proof_the_reason_is_given(self, problem, words):
        assert words in supersolution.prove(problem)
        assert isinstance(supersolution.prove(jumping([-1.0], ONE, [[1.0, -1.0], [0.0, 1.0]])), Proof)


@pytest.mark.parametrize(
    "psi", [icp.Elementwise(np.sin, np.cos, lipschitz=1.0), icp.Affine(np.eye(4)), icp.Affine(-np.eye(4))]
)
def test_a_lipschitz_constant_of_1_leaves_singular_choices_of_rows_and_no_foreign_exception(psi):
    """I − G is zero there, so that policy iteration and Newton's steps meet empty rows, which SuperLU must not see."""
    A = chain(4)
    problem = icp.ICP(A, -np.ones(4), psi)
    solution = problem.solve(raise_on_failure=False)
    assert solution.solved
    bound = icp.error_bound(problem, solution.z, sharp=True)
    assert bound.value is None or bound.value < 1e-6
    assert solution.polish().residual <= solution.residual
