"""Proofs of uniqueness beyond H₊-matrices, held against solutions known exactly: fractions, or dyadic data."""

from dataclasses import replace
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import icpmodel as icp
from icpmodel.theory.certificates import supersolution
from icpmodel.theory.certificates.bounds import proofs_of
from icpmodel.theory.certificates.proof import Proof
from icpmodel.theory.certificates.representatives import LIMIT
from icpmodel.theory.matrices.eigenvalue import largest_above, smallest_below

SEEDS = st.integers(0, 10**9)
#: how far z is from the solution
DISTANCES = st.sampled_from([0.0, 1e-15, 2.0**-30, 1e-3, 1.0, 1e6])


def solve_exactly(M, b):
    """The solution of Mx = b in fractions, None where M is singular."""
    n = len(b)
    rows = [[*row, value] for row, value in zip(M, b, strict=True)]
    for k in range(n):
        pivot = next((i for i in range(k, n) if rows[i][k]), None)
        if pivot is None:
            return None
        rows[k], rows[pivot] = rows[pivot], rows[k]
        for i in range(n):
            if i != k and rows[i][k]:
                factor = rows[i][k] / rows[k][k]
                rows[i] = [x - factor * y for x, y in zip(rows[i], rows[k], strict=True)]
    return [rows[k][n] / rows[k][k] for k in range(n)]


def fractions(x):
    return [fractions(y) for y in x] if np.ndim(x) else Fraction(float(x))


def all_solutions(A, q, obstacles):
    """Every isolated solution, in fractions. `obstacles[i]` lists (g, c): ψ_i(z) is the largest of the g·z + c."""
    A, q, n = fractions(A), fractions(q), len(q)

    def times(row, z):
        return sum((a * x for a, x in zip(row, z, strict=True)), Fraction(0))

    found = []
    for choice in product(*[range(-1, len(rows)) for rows in obstacles]):
        M, b = [], []
        for i, k in enumerate(choice):
            if k < 0:
                M.append(A[i])
                b.append(-q[i])
            else:
                g, c = obstacles[i][k]
                M.append([Fraction(int(i == j)) - x for j, x in enumerate(g)])
                b.append(c)
        z = solve_exactly(M, b)
        if z is None:
            continue
        p = [times(A[i], z) + q[i] for i in range(n)]
        r = [min((z[i] - times(g, z) - c for g, c in obstacles[i]), default=None) for i in range(n)]
        good = all(x >= 0 and (y is None or y >= 0) and (x == 0 or y == 0) for x, y in zip(p, r, strict=True))
        if good and z not in found:
            found.append(z)
    return found


def affine_obstacles(G, c):
    return [[(fractions(G[i]), Fraction(float(c[i])))] if np.isfinite(c[i]) else [] for i in range(len(c))]


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


def manufactured(A, G, rng, free=True):
    """(problem, z*, c): dyadic data of few bits around an exact solution; a row in eight has no obstacle."""
    n = A.shape[0]
    exact, active = rng.integers(-64, 65, size=n) / 16, rng.random(n) < 0.5
    p = np.where(active, rng.integers(0, 9, size=n) / 8, 0.0)
    r = np.where(active, 0.0, rng.integers(0, 9, size=n) / 8)
    c = exact - r - G @ exact
    if free:
        c[(rng.random(n) < 0.125) & (p == 0)] = -np.inf
    return icp.ICP(A, p - A @ exact, icp.Affine(G, c) if G.any() else c), exact, c


def definite_matrix(rng, n):
    """Positive definite, of small integers, with a skew part that takes it out of the H₊-matrices."""
    B, K = rng.integers(-2, 3, size=(n, n)), rng.integers(-4, 5, size=(n, n))
    return (B @ B.T + np.eye(n) + K - K.T).astype(float)


def definite_of(problem):
    return proofs_of(problem).definite


def representatives_of(problem):
    return proofs_of(problem).representatives


def in_units(problem, exact, c, e):
    """The problem with p = 2^−e p̃, z = 2^e z̃, e integers: positive definiteness keeps its form."""
    S = np.ldexp(1.0, e)
    A = S[:, None] * problem.A.toarray() * S
    G = problem.psi.jacobian(exact).toarray() * S / S[:, None]
    return icp.ICP(A, problem.q * S, icp.Affine(G, c / S) if G.any() else c / S), exact / S


def away(exact, distance, rng):
    return exact + distance * rng.integers(-8, 9, size=exact.size) / 8 * np.maximum(np.abs(exact), 1e-300)


@pytest.mark.parametrize("prove", [definite_of, representatives_of])
class TestBoth:
    @settings(max_examples=100, deadline=None)
    @given(seed=SEEDS, distance=st.sampled_from([0.0, 0.125]))
    def test_the_solution_of_every_problem_within_the_errors_of_p_and_r_is_covered(self, prove, seed, distance):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 4))
        true, exact, c = manufactured(definite_matrix(rng, n), rng.integers(-4, 5, size=(n, n)) / 64, rng)
        dq, dc = (rng.integers(0, 2) * rng.integers(-2, 3, size=n) / 8 for _ in range(2))
        problem = icp.ICP(true.A, true.q + dq, icp.Affine(true.psi.jacobian(exact), c + dc))
        z = exact + distance * rng.integers(-2, 3, size=n)
        proof, (for_p, for_r) = prove(problem), problem.rounding(z)
        if not isinstance(proof, str):
            delta, euclidean = proof.bound(
                problem, z, for_p + np.abs(dq), np.where(np.isfinite(c), for_r + np.abs(dc), 0.0)
            )
            assert (np.abs(z - exact) <= delta).all()
            assert np.linalg.norm(z - exact) <= euclidean * (1 + 1e-15)

    def test_errors_of_p_and_r_alone_make_a_bound(self, prove):
        """A = 1, ψ = 0 and z = q = 0 with p or r known to 1/8 only: z* may be 1/8."""
        problem, nothing, eighth = icp.ICP([[1.0]], [0.0]), np.zeros(1), np.full(1, 0.125)
        assert 0.125 <= prove(problem).bound(problem, nothing, eighth, nothing)[0][0] <= 0.3
        assert 0.125 <= prove(problem).bound(problem, nothing, nothing, eighth)[0][0] <= 0.3

    def test_an_error_of_r_counts_where_p_balances(self, prove):
        """A = [1, 10; −10, 1], q = (−1, 0), z = 0: with ψ₁ = 1 instead of 0 the solution is (1, 10)."""
        problem, z = icp.ICP([[1.0, 10.0], [-10.0, 1.0]], [-1.0, 0.0]), np.zeros(2)
        assert icp.ICP(problem.A, problem.q, [1.0, 0.0]).residual([1.0, 10.0]) == 0.0
        delta, _ = prove(problem).bound(problem, z, np.zeros(2), np.array([1.0, 0.0]))
        assert (delta >= [1.0, 10.0]).all()

    @pytest.mark.parametrize("size", [2.0**-600, 2.0**600])
    def test_it_grows_with_the_units_of_z_and_p(self, prove, size):
        A = np.array([[2.0, 3.0], [-3.0, 1.0]])
        problem, large = icp.ICP(A, [1.0, -1.0]), icp.ICP(A, [size, -size])
        z = np.array([0.25, 0.5])
        delta, euclidean = prove(problem).bound(problem, z, *problem.rounding(z))
        delta_large, euclidean_large = prove(large).bound(large, size * z, *large.rounding(size * z))
        assert delta_large == pytest.approx(size * delta, rel=1e-9, abs=0.0)
        assert euclidean_large == pytest.approx(size * euclidean, rel=1e-9, abs=0.0)

    def test_a_row_without_obstacle_may_have_any_slope(self, prove):
        problem = icp.ICP(np.eye(2), [1.0, 1.0], icp.Affine([[3.0, 9.0], [0.0, 0.5]], [-np.inf, 0.0]))
        z = np.array([0.0, 0.0])
        delta, _ = prove(problem).bound(problem, z, *problem.rounding(z))
        assert delta[0] >= 1.0  # z* = (-1, 0)


class TestDefinite:
    @settings(max_examples=200, deadline=None)
    @given(seed=SEEDS, distance=DISTANCES, decades=st.sampled_from([0, 8, 300]), steep=st.sampled_from([0, 1, 16]))
    def test_the_bound_is_never_below_the_true_error(self, seed, distance, decades, steep):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 6))
        G = rng.integers(-4, 5, size=(n, n)) / 64 * steep
        problem, exact, c = manufactured(definite_matrix(rng, n), G, rng)
        problem, exact = in_units(problem, exact, c, rng.integers(-decades, decades + 1, size=n))
        proof = proofs_of(problem).definite
        if not isinstance(proof, str):
            assert holds(proof, problem, away(exact, distance, rng), exact)
        elif steep == 0:
            assert decades == 300  # entries of too many sizes

    @settings(max_examples=100, deadline=None)
    @given(seed=SEEDS, distance=DISTANCES)
    def test_it_holds_for_a_psi_that_is_not_affine(self, seed, distance):
        """ψ(z) = G|z| + c, of which only the Lipschitz matrix |G| is known."""
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 5))
        A, G = definite_matrix(rng, n) + 8 * np.eye(n), rng.integers(-4, 5, size=(n, n)) / 64
        _, exact, _ = manufactured(A, 0 * A, rng)
        p, r = np.where(exact > 0, 0.5, 0.0), np.where(exact > 0, 0.0, 0.25)
        c = exact - r - G @ np.abs(exact)
        problem = icp.ICP(A, p - A @ exact, icp.Function(lambda z: G @ np.abs(z) + c, lipschitz=np.abs(G)))
        proof = proofs_of(problem).definite
        if not isinstance(proof, str):
            assert holds(proof, problem, away(exact, distance, rng), exact)

    def test_most_of_those_problems_are_proved(self):
        proved = 0
        for seed in range(100):
            rng = np.random.default_rng(seed)
            A, G = definite_matrix(rng, 4) + 8 * np.eye(4), rng.integers(-4, 5, size=(4, 4)) / 64
            problem = icp.ICP(A, np.ones(4), icp.Function(lambda z, G=G: G @ np.abs(z), lipschitz=np.abs(G)))
            proved += isinstance(proofs_of(problem).definite, Proof)
        assert proved >= 40

    @settings(max_examples=150, deadline=None)
    @given(seed=SEEDS)
    def test_uniqueness_is_claimed_only_where_there_is_one_solution(self, seed):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 4))
        A, G = rng.integers(-2, 5, size=(n, n)).astype(float), rng.integers(-4, 5, size=(n, n)) / 4
        q, c = rng.integers(-4, 5, size=n).astype(float), rng.integers(-4, 5, size=n).astype(float)
        problem = icp.ICP(A, q, icp.Affine(G, c))
        found = all_solutions(A, q, affine_obstacles(G, c))
        for prove in (definite_of, representatives_of):
            if not isinstance(prove(problem), str):
                assert len(found) == 1

    def test_a_semidefinite_matrix_is_not_enough(self):
        assert isinstance(proofs_of(icp.ICP([[1.0, 1.0], [1.0, 1.0]], [0.0, 0.0])).definite, str)
        assert isinstance(proofs_of(icp.ICP([[1.0]], [0.0], icp.Affine([[1.0]]))).definite, str)
        assert isinstance(proofs_of(icp.ICP([[1.0]], [0.0], icp.Function(np.sin, lipschitz=1.0))).definite, str)

    def test_it_is_sharp_for_one_unknown(self):
        problem = icp.ICP([[3.0]], [-3.0])
        delta, euclidean = proofs_of(problem).definite.bound(problem, np.array([1.5]), *problem.rounding([1.5]))
        assert 0.5 <= delta[0] <= 0.75
        assert 0.5 <= euclidean <= 0.75

    def test_it_is_attained_where_p_and_r_are_negative(self):
        """A = 1, q = −1, z = −1: p = −2, r = −1, z* = 1, and t² = 3t − 2 has the root 2."""
        problem, z = icp.ICP([[1.0]], [-1.0]), np.array([-1.0])
        assert 2.0 <= proofs_of(problem).definite.bound(problem, z, *problem.rounding(z))[0][0] <= 2.1

    def test_the_quadratic_by_hand_where_psi_is_not_affine(self):
        """A = 1, L = ½, z = −1, ψ(z) = −2 and p = −1: ½t² = (1 + ½)t."""
        problem = icp.ICP([[1.0]], [0.0], icp.Function(lambda z: 0.0 * z - 2.0, lipschitz=0.5))
        z = np.array([-1.0])
        delta, _ = proofs_of(problem).definite.bound(problem, z, *problem.rounding(z))
        assert delta[0] == pytest.approx(3.0, rel=0.03)

    def test_a_smooth_error_on_a_grid_is_not_divided_by_the_smallest_eigenvalue(self):
        """e the lowest mode of a string without contact: the bound is the error itself, not λ_max/λ_min times it."""
        n = 200
        x = np.linspace(0.0, 1.0, n + 2)[1:-1]
        A = sp.diags_array([np.full(n - 1, -1.0), np.full(n, 2.0), np.full(n - 1, -1.0)], offsets=[-1, 0, 1])
        problem = icp.ICP(A, -(A @ (1 + x)), psi=-5.0)
        error = np.sin(np.pi * x)
        for mode in (error, np.sin(9 * np.pi * x)):
            z = 1 + x + mode
            _, euclidean = proofs_of(problem).definite.bound(problem, z, *problem.rounding(z))
            assert np.linalg.norm(mode) <= euclidean <= 12 * np.linalg.norm(mode)

    @pytest.mark.parametrize("factor", [0.0, 0.5, -1.0, 100.0])
    def test_a_wrong_inverse_makes_no_wrong_bound(self, factor):
        problem, z = icp.ICP([[1.0, 3.0], [-3.0, 1.0]], [-4.0, 2.0]), np.array([0.5, 2.0])  # z* = (1, 1)
        proof = proofs_of(problem).definite
        wrong = replace(proof, solve=lambda g: factor * proof.solve(g))
        delta, _ = wrong.bound(problem, z, *problem.rounding(z))
        assert (delta >= [0.5, 1.0]).all()

    def test_it_is_sharper_than_the_bound_of_pang(self):
        """(1 + ‖A‖₂)/λ·‖F(z)‖₂; here by a factor of ten and more, as it does not contain ‖A‖."""
        rng = np.random.default_rng(0)
        B, K = rng.normal(size=(30, 30)), 3 * rng.normal(size=(30, 30))
        A = B @ B.T / 30 + 0.1 * np.eye(30) + K - K.T
        problem = icp.ICP(A, -A @ np.ones(30))
        z = 1 + 1e-3 * rng.normal(size=30)
        pang = (1 + np.linalg.norm(A, 2)) / np.linalg.eigvalsh(A + A.T)[0] * 2 * problem.residual(z)
        assert proofs_of(problem).definite.bound(problem, z, *problem.rounding(z))[1] <= pang / 10

    @pytest.mark.parametrize(
        ("problem", "words"),
        [
            (icp.ICP([[-1.0]], [0.0]), "A[0, 0] = -1 is not positive"),
            (icp.ICP([[1.0]], [0.0], np.sin), "no Lipschitz matrix of psi"),
            (icp.ICP([[1.0, 4.0], [0.0, 1.0]], [0.0, 0.0]), "not proved positive definite"),
            (icp.ICP([[1.0]], [0.0], icp.Function(np.sin, lipschitz=2.0)), "psi is too steep"),
            (icp.ICP(sp.eye_array(50_001), np.zeros(50_001)), "too large"),
            (icp.ICP([[1e300, 0.0], [1e-300, 1e300]], [0.0, 0.0]), "underflow"),
        ],
    )
    def test_without_a_proof_the_reason_is_given(self, problem, words):
        assert words in proofs_of(problem).definite

    def test_it_is_found_once_for_a_series(self):
        problem = icp.ICP([[1.0, 3.0], [-3.0, 1.0]], [0.0, 0.0])
        assert proofs_of(problem).definite is proofs_of(problem.with_q([1.0, 2.0])).definite

    def test_nothing_is_said_of_a_point_that_is_not_finite(self):
        problem = icp.ICP([[1.0, 3.0], [-3.0, 1.0]], [0.0, 0.0])
        for bad in (np.nan, np.inf, 1e308):
            z = np.array([bad, 0.0])
            with np.errstate(all="ignore"):
                rounding = problem.rounding(z)
            delta, _ = proofs_of(problem).definite.bound(problem, z, *rounding)
            assert not np.isfinite(delta).all() or (delta >= bad).all()


class TestEigenvalues:
    @settings(max_examples=100, deadline=None)
    @given(seed=SEEDS, shift=st.sampled_from([2.0**-40, 2.0**-20, 1.0]))
    def test_the_lower_bound_is_never_above_the_smallest(self, seed, shift):
        """S − cI has positive pivots in fractions, c the bound; and c is no less than half of the eigenvalue."""
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 6))
        B, K = rng.integers(-2, 3, size=(n, n - 1 if n > 1 else 1)), rng.integers(-2, 3, size=(n, n))
        S = B @ B.T + shift * np.eye(n)
        c = smallest_below(sp.csr_array(S + K - K.T))
        assert c > 0.45 * np.linalg.eigvalsh(S)[0]
        T = [[x - (Fraction(c) if i == j else 0) for j, x in enumerate(row)] for i, row in enumerate(fractions(S))]
        for k in range(n):
            assert T[k][k] > 0
            for i in range(k + 1, n):
                factor = T[i][k] / T[k][k]
                T[i] = [x - factor * y for x, y in zip(T[i], T[k], strict=True)]

    @pytest.mark.parametrize("n", [1, 3, 64, 65, 1000])
    def test_it_is_near_the_known_eigenvalue_of_a_string(self, n):
        S = sp.diags_array([np.full(n - 1, -0.5), np.ones(n), np.full(n - 1, -0.5)], offsets=[-1, 0, 1])
        true = 1 - np.cos(np.pi / (n + 1))
        assert 0.98 * true <= smallest_below(sp.csr_array(S)) <= true
        assert 2 - true <= largest_above(sp.csr_array(abs(S))) <= 2.02

    @settings(max_examples=60, deadline=None)
    @given(seed=SEEDS, n=st.integers(2, 80))
    def test_a_singular_or_indefinite_matrix_has_no_positive_bound(self, seed, n):
        B = np.random.default_rng(seed).integers(-3, 4, size=(n, n - 1)).astype(float)
        assert smallest_below(sp.csr_array(B @ B.T / n)) <= 0
        assert smallest_below(sp.csr_array(B @ B.T / n - 0.5 * np.eye(n))) <= 0

    @pytest.mark.parametrize("estimate", [1e-3, 0.2, 1.0, 50.0])
    def test_a_wrong_estimate_makes_no_wrong_bound(self, estimate):
        S = np.array([[1.0, 0.9, 0.0], [0.9, 1.0, 0.1], [0.0, 0.1, 1.0]])
        assert smallest_below(sp.csr_array(S), estimate=estimate) <= np.linalg.eigvalsh(S)[0]

    def test_what_is_not_known_of_the_matrix_is_taken_off(self):
        assert 0.9 <= smallest_below(sp.csr_array([[2.0]]), slack=1.0) <= 1.0

    @settings(max_examples=60, deadline=None)
    @given(seed=SEEDS)
    def test_the_upper_bound_is_never_below_the_largest(self, seed):
        rng = np.random.default_rng(seed)
        N = rng.random((6, 6)) * (rng.random((6, 6)) < 0.4)
        largest = np.linalg.eigvalsh((N + N.T) / 2)[-1]
        assert largest <= largest_above(sp.csr_array(N)) * (1 + 1e-14)
        N += 0.1
        assert largest_above(sp.csr_array(N)) <= 1.001 * np.linalg.eigvalsh((N + N.T) / 2)[-1]


class TestRepresentatives:
    @settings(max_examples=300, deadline=None)
    @given(seed=SEEDS, distance=DISTANCES, decades=st.sampled_from([0, 8, 300]), affine=st.booleans())
    def test_the_bound_is_never_below_the_true_error(self, seed, distance, decades, affine):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 5))
        A, G = rng.integers(-3, 4, size=(n, n)) + 4.0 * np.eye(n), rng.integers(-6, 7, size=(n, n)) / 8 * affine
        problem, exact, c = manufactured(A, G, rng)
        problem, exact = in_units(problem, exact, c, rng.integers(-decades, decades + 1, size=n))
        rows = np.ldexp(1.0, rng.integers(-decades // 8, decades // 8 + 1, size=n))
        problem = icp.ICP(rows[:, None] * problem.A.toarray(), rows * problem.q, problem.psi)
        proof = proofs_of(problem).representatives
        if not isinstance(proof, str):
            assert holds(proof, problem, away(exact, distance, rng), exact)

    @settings(max_examples=100, deadline=None)
    @given(seed=SEEDS, decades=st.sampled_from([0, 8, 200]))
    def test_a_is_a_p_matrix_exactly_where_it_says_so_in_any_units(self, seed, decades):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 5))
        A = rng.integers(-3, 4, size=(n, n)) + 2 * np.eye(n)
        minors = [
            np.linalg.det(A[np.ix_(a, a)]) for k in range(1, 2**n) for a in [np.flatnonzero(k >> np.arange(n) & 1)]
        ]
        rows, columns = (np.ldexp(1.0, rng.integers(-decades, decades + 1, size=n)) for _ in range(2))
        proof = proofs_of(icp.ICP(rows[:, None] * A * columns, np.zeros(n))).representatives
        assert isinstance(proof, Proof) == (min(minors) > 1e-9)

    def test_rows_without_obstacle_are_rows_of_a_linear_system(self):
        """A = [1, 2; 2, 1] has a negative minor, but with both rows free z is the solution of Az = −q."""
        problem = icp.ICP([[1.0, 2.0], [2.0, 1.0]], [-3.0, -3.0], -np.inf)
        bound = icp.error_bound(problem, [1.5, 1.0], sharp=False)
        assert 0.5 <= bound.value <= 1.0
        assert not icp.error_bound(problem.with_psi([-np.inf, 0.0]), [1.5, 1.0]).unique
        apart = icp.ICP(np.eye(2), [-1.0, -1.0], -np.inf)
        delta, _ = proofs_of(apart).representatives.bound(apart, np.zeros(2), *apart.rounding(np.zeros(2)))
        assert delta == pytest.approx([1.0, 1.0])

    def test_the_inverses_are_never_below_the_exact_ones(self):
        """K_ij and H_ij in their units, for matrices that are singular to all but a few digits."""
        rng = np.random.default_rng(0)
        proved = 0
        for exponent in rng.uniform(2, 13, 60):
            n = 2
            A = np.outer(rng.uniform(1, 2, n), rng.uniform(1, 2, n)) + 10.0**-exponent * np.eye(n)
            problem = icp.ICP(A, np.zeros(n))
            proof = proofs_of(problem).representatives
            if isinstance(proof, str):
                continue
            proved += 1
            unit = [fractions(row) for row in np.eye(n)]
            for from_B in product((False, True), repeat=n):
                V = [unit[i] if from_B[i] else fractions(A)[i] for i in range(n)]
                for j in range(n):
                    column = solve_exactly(V, unit[j])
                    size, row = (proof.H, proof.row_r) if from_B[j] else (proof.K, proof.row_p)
                    for i in range(n):
                        scale = Fraction(2) ** int(row[j] + proof.column[i])
                        assert abs(column[i]) <= Fraction(size[i, j]) * scale
        assert proved >= 30

    def test_a_determinant_that_rounding_made_is_no_proof(self):
        """[a, b; c, bc/a]: the determinant is some 1e-17 of either sign, or zero."""
        rng = np.random.default_rng(0)
        for _ in range(200):
            a, b, c = rng.uniform(1, 2, 3)
            d = b * c / a
            proof = proofs_of(icp.ICP([[a, b], [c, d]], [0.0, 0.0])).representatives
            exact = Fraction(a) * Fraction(d) - Fraction(b) * Fraction(c)
            assert isinstance(proof, str) or exact > 0
            if isinstance(proof, str) and "opposite signs" in proof:
                assert exact < 0

    def test_the_cyclic_matrix_is_covered(self):
        """Neither an H₊-matrix nor positive definite; z* = (1, 1, 1)/3."""
        problem = icp.scenes.hand_cyclic().problem
        assert isinstance(proofs_of(problem).definite, str)
        proof = proofs_of(problem).representatives
        exact = [Fraction(1, 3)] * 3
        for distance in (0.0, 1e-15, 1e-3, 1e6):
            for sign in product((-1, 1), repeat=3):
                assert holds(proof, problem, 1 / 3 + distance * np.array(sign), exact)

    def test_it_is_attained_where_one_representative_decides(self):
        """A = 4, ψ = z/2: F = min(4e, e/2) is the error itself in the units of its row."""
        for z in (-1.0, 1.0):
            problem = icp.ICP([[4.0]], [0.0], icp.Affine([[0.5]]))
            delta, _ = proofs_of(problem).representatives.bound(problem, np.array([z]), *problem.rounding([z]))
            assert 1.0 <= delta[0] <= 1.0 + 1e-12

    def test_the_largest_size_is_bounded_as_well(self):
        rng = np.random.default_rng(0)
        n = LIMIT
        problem = icp.ICP(rng.normal(size=(n, n)) / 4 + 2 * np.eye(n), np.zeros(n))
        proof = proofs_of(problem).representatives
        z = rng.normal(size=n)
        delta, _ = proof.bound(problem, z, *problem.rounding(z))
        assert problem.n == n
        assert (np.abs(z - problem.solve(rtol=1e-12).z) <= delta + 1e-9).all()

    @pytest.mark.parametrize(
        ("problem", "words"),
        [
            (icp.ICP(np.eye(13), np.zeros(13)), "too large"),
            (icp.ICP([[1.0]], [0.0], np.sin), "neither constant nor affine"),
            (icp.ICP([[1.0, 2.0], [2.0, 1.0]], [0.0, 0.0]), "A is not a P-matrix"),
            (icp.ICP([[-1.0]], [0.0]), "opposite signs"),
            (icp.ICP([[1.0, 1.0], [1.0, 1.0]], [0.0, 0.0]), "singular to working precision"),
            (icp.ICP([[2.0]], [0.0], icp.Affine([[3.0]])), "do not have the row W-property"),
            (icp.ICP([[0.0]], [0.0]), "a row is zero"),
        ],
    )
    def test_without_a_proof_the_reason_is_given(self, problem, words):
        assert words in proofs_of(problem).representatives


def impulse_problem(rng):
    """(A, q, jumps, obstacles): dyadic, n ≤ 4, A with row sums ≥ 0, jumps at a cost, not all of them positive."""
    n = int(rng.integers(1, 5))
    A = -(rng.integers(0, 3, size=(n, n)) * (rng.random((n, n)) < 0.6)).astype(float)
    np.fill_diagonal(A, 0.0)
    np.fill_diagonal(A, -A.sum(axis=1) + rng.integers(0, 3, size=n) / 4)
    q = rng.integers(-16, 9, size=n) / 4
    there = (rng.random((n, n)) < 0.5) & ~np.eye(n, dtype=bool)
    gains = np.where(there, -rng.integers(-1, 9, size=(n, n)) / 4, 0.0)
    i, j = np.nonzero(there)
    jumps = sp.csr_array((gains[i, j], (i, j)), shape=(n, n))
    unit = fractions(np.eye(n))
    return A, q, jumps, [[(unit[k], Fraction(gains[i, k])) for k in np.flatnonzero(there[i])] for i in range(n)]


class TestSupersolution:
    @settings(max_examples=200, deadline=None)
    @given(seed=SEEDS, distance=st.sampled_from([0.0, 1e-15, 1e-6, 1e-2, 1.0, 1e6]), rows=st.sampled_from([0, 300]))
    def test_the_bound_is_never_below_the_true_error_and_one_solution_exists(self, seed, distance, rows):
        rng = np.random.default_rng(seed)
        A, q, jumps, obstacles = impulse_problem(rng)
        units = np.ldexp(1.0, rng.integers(-rows, rows + 1, size=q.size))
        problem = icp.ICP(units[:, None] * A, units * q, icp.Intervention(jumps))
        proof = supersolution.prove(problem)
        if isinstance(proof, str):
            return
        for m, s in proof.pairs:
            p = [sum(a * x for a, x in zip(row, fractions(s), strict=True)) for row in fractions(problem.A.toarray())]
            assert all(
                x + y >= Fraction(m) * a > 0
                for x, y, a in zip(p, *map(fractions, (problem.q, proof.weight)), strict=True)
            )
            r = [
                fractions(s[i]) - sum(g[j] * Fraction(s[j]) for j in range(len(s))) - c
                for i in range(len(s))
                for g, c in obstacles[i]
            ]
            assert all(x >= Fraction(m) for x in r)
        (exact,) = all_solutions(A, q, obstacles)
        z = np.array([float(x) for x in exact]) + distance * rng.integers(-8, 9, size=q.size) / 8
        assert holds(proof, problem, z, exact)

    @settings(max_examples=60, deadline=None)
    @given(seed=SEEDS)
    def test_the_margin_of_any_s_is_never_above_the_true_one(self, seed):
        rng = np.random.default_rng(seed)
        A, q, jumps, obstacles = impulse_problem(rng)
        n = q.size
        s, weight = rng.normal(size=n), rng.random(n) + 0.1
        m = Fraction(supersolution._margin(icp.ICP(A, q, icp.Intervention(jumps)), weight, s))
        x, rows = fractions(s), fractions(A)
        for i in range(n):
            p = sum(a * y for a, y in zip(rows[i], x, strict=True)) + Fraction(q[i])
            assert p >= m * Fraction(weight[i])
            assert all(x[i] - x[g.index(1)] - c >= m for g, c in obstacles[i])

    def test_the_margin_counts_the_rounding_of_a_jump(self):
        """s of 1e8 against jumps at the cost of 0.1: the difference is computed to 1e-8."""
        rng = np.random.default_rng(0)
        for _ in range(40):
            s, cost = 1e8 * rng.random(2), rng.random()
            s[0] = s[1] + 2 * rng.random()
            psi = icp.Intervention(sp.csr_array(([-cost], ([0], [1])), shape=(2, 2)))
            m = supersolution._margin(icp.ICP(np.eye(2), [1e9, 1e9], psi), np.ones(2), s)
            assert Fraction(m) <= Fraction(s[0]) - Fraction(s[1]) + Fraction(cost)

    @pytest.mark.parametrize("side", [-1.0, 1.0])
    def test_the_rounding_of_p_counts_on_either_side(self, side):
        """Without couplings and jumps the bound is attained: what rounding hides from p is missing at once."""
        rng = np.random.default_rng(0)
        psi = icp.Intervention(sp.csr_array(([-1e12], ([0], [1])), shape=(2, 2)))
        for _ in range(40):
            a, q = rng.uniform(2, 4, 2), -1e8 * rng.random(2)
            problem = icp.ICP(np.diag(a), q, psi)
            proof = supersolution.prove(problem)
            exact = [-Fraction(y) / Fraction(x) for x, y in zip(a, q, strict=True)]
            z = np.array([float(x) for x in exact]) + side * 1e-2 * rng.random(2)
            assert holds(proof, problem, z, exact)

    def test_row_sums_of_exactly_zero_are_told_from_negative_ones(self):
        jumps = sp.csr_array(([-1.0], ([0], [1])), shape=(2, 2))
        for entry, proved in ((-1.0, True), (-1.0 - 2.0**-20, False), (-1.0 - 2.0**-52, False)):
            found = supersolution.prove(icp.ICP([[1.0, entry], [0.0, 1.0]], [-1.0, 1.0], icp.Intervention(jumps)))
            assert isinstance(found, str) != proved
            assert proved or "A1 >= 0 is needed" in found

    @pytest.mark.parametrize("size", [2.0**-300, 2.0**300])
    def test_it_grows_with_the_units_of_z(self, size):
        A, z = np.array([[2.0, -1.0], [0.0, 1.0]]), np.array([3.0, 0.5])
        bounds = []
        for unit in (1.0, size):
            jumps = sp.csr_array(([-unit], ([0], [1])), shape=(2, 2))
            problem = icp.ICP(A, [unit, unit], icp.Intervention(jumps))
            bounds.append(supersolution.prove(problem).bound(problem, unit * z, *problem.rounding(unit * z))[0])
        assert bounds[1] == pytest.approx(size * bounds[0], rel=1e-9, abs=0.0)

    @pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e308])
    def test_nothing_is_said_of_a_point_that_is_not_finite(self, bad):
        jumps = sp.csr_array(([-1.0], ([0], [1])), shape=(2, 2))
        problem, z = icp.ICP([[2.0, -1.0], [0.0, 1.0]], [1.0, 1.0], icp.Intervention(jumps)), np.array([bad, 0.0])
        with np.errstate(all="ignore"):
            rounding = problem.rounding(z)
        delta, _ = supersolution.prove(problem).bound(problem, z, *rounding)
        assert not np.isfinite(delta).all() or delta[0] >= bad

    def test_most_problems_with_a_regular_matrix_and_costly_jumps_are_proved(self):
        found = regular = 0
        for seed in range(200):
            A, q, jumps, _ = impulse_problem(np.random.default_rng(seed))
            if jumps.nnz and jumps.data.max() < 0 and abs(np.linalg.det(A)) > 1e-9:
                regular += 1
                found += isinstance(supersolution.prove(icp.ICP(A, q, icp.Intervention(jumps))), Proof)
        assert found >= 0.95 * regular > 20

    def test_above_the_margin_the_upper_bound_does_not_hold(self):
        """A = I, q = 0, ψ₁ = z₂ − 10: s = (1, 1) has F(s) ≥ m = 1, z* = 0; z = (190, 100) has F(z) = u = 100, and
        (u/m)(s − z*) = (100, 100) is not above z."""
        problem = icp.ICP(np.eye(2), [0.0, 0.0], icp.Intervention(sp.csr_array(([-10.0], ([0], [1])), shape=(2, 2))))
        assert (problem.natural_map([1.0, 1.0]) >= 1.0).all()
        assert problem.natural_map([190.0, 100.0]) == pytest.approx([100.0, 100.0])
        assert problem.residual([0.0, 0.0]) == 0.0

    def test_where_z_reaches_every_margin_nothing_is_said(self):
        """Jumps 1 ⇄ 2 at the cost 1: every z = (t, t) has r = 1, so F(z) ≤ 1 bounds nothing."""
        jumps = sp.csr_array(([-1.0, -1.0], ([0, 1], [1, 0])), shape=(2, 2))
        problem = icp.ICP(np.eye(2), [-1.0, -1.0], icp.Intervention(jumps))
        proof = supersolution.prove(problem)
        assert all(m < 1.0 for m, _ in proof.pairs)
        far = np.array([1e9, 1e9])
        assert np.isinf(proof.bound(problem, far, *problem.rounding(far))[0]).all()

    @pytest.mark.parametrize(("n", "most"), [(31, 30.0), (241, 60.0), (961, 60.0)])
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
        jumps = sp.csr_array(([-1.0], ([0], [1])), shape=(2, 2))
        problem = icp.ICP(np.eye(2), [-1.0, -1.0], icp.Intervention(jumps))
        other = problem.with_q([-100.0, 50.0])
        known = proofs_of(problem)
        assert known.supersolution(problem) is proofs_of(problem).supersolution(problem)
        assert known.supersolution(other) is not known.supersolution(problem)
        assert holds(known.supersolution(other), other, np.zeros(2), [100, -50])

    @pytest.mark.parametrize(
        ("A", "jump", "best", "words"),
        [
            ([[1.0, 0.0], [0.0, 1.0]], -1.0, "min", 'best="max"'),
            ([[1.0, 0.5], [0.0, 1.0]], -1.0, "max", "no Z-matrix: A[0, 1] = 0.5"),
            ([[1.0, -1.5], [0.0, 1.0]], -1.0, "max", "row 0 of A has the sum -0.5"),
            ([[1.0, -1.0], [-1.0, 1.0]], -1.0, "max", "not proved to be a nonsingular M-matrix"),
            ([[0.0, 0.0], [0.0, 1.0]], -1.0, "max", "A[0, 0] = 0 is not positive"),
        ],
    )
    def test_without_a_proof_the_reason_is_given(self, A, jump, best, words):
        jumps = sp.csr_array(([jump, -1.0], ([0, 1], [1, 0])), shape=(2, 2))
        assert words in supersolution.prove(icp.ICP(A, [0.0, 0.0], icp.Intervention(jumps, best)))

    @settings(max_examples=100, deadline=None)
    @given(seed=SEEDS)
    def test_a_singular_matrix_is_not_proved_regular(self, seed):
        rng = np.random.default_rng(seed)
        A = -rng.integers(1, 10, size=(4, 4)).astype(float)
        np.fill_diagonal(A, A.diagonal() - A.sum(axis=1))
        jumps = sp.csr_array(([-1.0], ([0], [1])), shape=(4, 4))
        assert "nonsingular" in supersolution.prove(icp.ICP(A, np.zeros(4), icp.Intervention(jumps)))

    def test_a_free_ride_has_no_strict_supersolution(self):
        """A cycle of jumps that costs nothing lets every level of z stand."""
        jumps = sp.csr_array((np.zeros(2), ([0, 1], [1, 0])), shape=(2, 2))
        found = supersolution.prove(icp.ICP(np.eye(2), [-1.0, 0.0], icp.Intervention(jumps)))
        assert found == "no strict supersolution was found by policy iteration"


@pytest.mark.parametrize(
    "psi", [icp.Elementwise(np.sin, np.cos, lipschitz=1.0), icp.Affine(np.eye(4)), icp.Affine(-np.eye(4))]
)
def test_a_lipschitz_constant_of_1_leaves_singular_choices_of_rows_and_no_foreign_exception(psi):
    """I − G is zero there, so that policy iteration and Newton's steps meet empty rows, which SuperLU must not see."""
    A = sp.diags_array([-np.ones(3), 2 * np.ones(4), -np.ones(3)], offsets=[-1, 0, 1])
    problem = icp.ICP(A, -np.ones(4), psi)
    solution = problem.solve(raise_on_failure=False)
    assert solution.solved
    bound = icp.error_bound(problem, solution.z, sharp=True)
    assert bound.value is None or bound.value < 1e-6
    assert icp.certify(problem, np.zeros(4)).bound.unique == bound.unique
    assert "status" in str(solution)
    assert "solution" in str(problem.explain())
    assert problem.crosscheck(solution, ["osqp"]).rows
    assert solution.polish().residual <= solution.residual
