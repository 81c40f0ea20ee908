"""Error bounds against exact rational solutions, and the certified active set."""

import math
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from exact import dot, exceeds, nearest_floats, rational, solutions
from hypothesis import given, settings
from hypothesis import strategies as st

import icpmodel as icp
from icpmodel.theory import comparison_matrix
from icpmodel.theory.certificates.bounds import proofs_of
from icpmodel.theory.certificates.proof import norm_up
from icpmodel.theory.matrices.comparison_matrix import layered

#: how far z lies from z*, relative to its size: from next to nothing to far away
DISTANCES = [0.0, 1e-16, 1e-15, 1e-12, 1e-8, 1e-4, 1.0, 1e3, 1e8]


def random_problem(rng, decades=2):
    """A small problem with data of full precision at any scale, mostly with a certificate; and its exact solution."""
    n = int(rng.integers(1, 4))
    off = rng.normal(size=(n, n))
    np.fill_diagonal(off, 0.0)
    columns = 10.0 ** rng.uniform(-decades, decades, n)
    A = off + np.diag(np.abs(off).sum(axis=1) * rng.uniform(0.9, 3.0) + 10.0 ** rng.uniform(-6, 0, n))
    A = 10.0 ** rng.uniform(-9, 9, (n, 1)) * A / columns
    G = rng.normal(size=(n, n)) * rng.choice([0.0, 0.1, 0.4]) / n * columns[:, None] / columns
    c = rng.normal(size=n) * columns
    if rng.random() < 0.2:
        c[0] = -np.inf
    problem = icp.ICP(A, rng.normal(size=n) * np.abs(A).max(axis=1) * columns.max(), icp.Affine(G, c))
    found = solutions(problem)
    return problem, found[0] if len(found) == 1 else None, columns


def exhaustive(*values):
    return pytest.param(*values, marks=pytest.mark.slow)


class TestNeverBelowTheTrueError:
    """The bound is a proof: in more than 10⁵ trials against solutions in rational arithmetic it never fails."""

    @pytest.mark.parametrize(
        ("problems", "starts", "decades", "options"),
        [
            (90, 18, 2, {"sharp": False}),
            (40, 18, 2, {"sharp": True}),
            (25, 9, 90, {}),
            exhaustive(2000, 60, 2, {"sharp": False}),
            exhaustive(220, 27, 2, {"sharp": True}),
            exhaustive(60, 9, 20, {}),
        ],
    )
    def test_it_holds_in_fractions(self, problems, starts, decades, options):
        rng, trials = np.random.default_rng(problems), 0
        for _ in range(problems):
            problem, exact, columns = random_problem(rng, decades)
            if exact is None:
                assert not icp.error_bound(problem, np.zeros(problem.n)).unique
                continue
            near = nearest_floats(exact)
            for k in range(starts):
                distance = DISTANCES[k % len(DISTANCES)]
                z = near + distance * rng.normal(size=near.size) * (np.abs(near) + columns * (distance > 1e-9))
                bound = icp.error_bound(problem, z, rigorous=True, **options)
                if bound.value is None:
                    continue
                trials += 1
                assert not exceeds(z, exact, bound.componentwise)
                assert bound.euclidean >= math.hypot(*(z - near)) * (1 - 1e-9)
        assert trials >= 0.7 * problems * starts

    @pytest.mark.parametrize("size", [1e-323, 1e-200, 1.0, 1e307])
    def test_a_norm_is_rounded_upwards(self, size):
        rng = np.random.default_rng(0)
        for n in (1, 2, 3, 50) * 10:
            x = rng.uniform(-size, size, n)
            assert Fraction(norm_up(x)) ** 2 >= sum(Fraction(float(t)) ** 2 for t in x)
            assert norm_up(x) <= np.abs(x).max() * math.sqrt(n) * (1 + 1e-12) + 1e-320

    def test_underflow_of_a_quotient_is_not_lost(self):
        """F/α = 1e-325 is 0 in floats, but v multiplies it by 1e13."""
        problem = icp.ICP([[1e10, -1e23], [0, 1e10]], [0, -1e-315], -np.inf)
        exact = solutions(problem)[0]
        proof = proofs_of(problem).h_plus
        z = np.zeros(2)
        delta, _ = proof.bound(problem, z, *problem.rounding(z))
        assert exceeds(z, exact, delta) == []

    @pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1.7e308, -1.7e308])
    @pytest.mark.parametrize("psi", [-np.inf, icp.Affine([[0, 0.3], [0.3, 0]], [-np.inf, 1]), icp.Affine([[0.5]], 1)])
    def test_a_z_beyond_reason_has_no_bound_or_a_wide_one_and_warns_of_nothing(self, value, psi):
        n = 1 if isinstance(psi, icp.Affine) and psi.G.shape == (1, 1) else 2
        problem = icp.ICP(2 * np.eye(n) - 0.5 * (1 - np.eye(n)), np.ones(n), psi)
        certificate = icp.certify(problem, np.full(n, value))
        assert certificate.unique
        assert certificate.error_bound is None or certificate.error_bound >= 1e308

    def test_a_jacobian_that_fails_costs_sharpness_only(self):
        psi = icp.Function(lambda z: 0.3 * z, jacobian=lambda z: np.full((1, 1), np.nan), lipschitz=0.3)
        bound = icp.error_bound(icp.ICP([[2.0]], [-2.0], psi), [1.5])
        assert bound.value >= 0.5


class TestSharpness:
    @pytest.mark.parametrize("name", [n for n in icp.scenes.names() if icp.scenes.scene(n).z_exact is not None])
    @pytest.mark.parametrize("size", [1e-8, 1.0])
    def test_bound_over_error_is_small_and_never_below_1_on_every_scene_with_an_exact_solution(self, name, size):
        n = 100 if "n" in icp.scenes.parameters(name) else None
        scene = icp.scenes.scene(name, n)
        rng = np.random.default_rng(0)
        ratios = []
        for _ in range(3):
            z = scene.z_exact + size * rng.uniform(-1, 1, scene.problem.n)
            bound = icp.error_bound(scene.problem, z)
            if bound.value is None:
                assert name in ("hard-empty-row", "hard-overflow", "hard-semidefinite")
                return
            ratios.append(bound.value / np.abs(z - scene.z_exact).max())
        assert np.median(ratios) <= 10 or name in ("hard-scaled", "hard-singular")  # rounding alone is larger there
        assert min(ratios) >= 1

    def test_a_users_function_has_no_rigorous_bound(self):
        problem = icp.ICP(
            [[2.0]], [-1.0], icp.Elementwise(lambda z: 0.5 * np.sin(z), lambda z: 0.5 * np.cos(z), lipschitz=0.5)
        )
        assert icp.error_bound(problem, [0.0]).unique
        bound = icp.error_bound(problem, [0.0], rigorous=True)
        assert bound.value is None
        assert "user's function" in bound.reason


@pytest.mark.parametrize("decades", [1, 90])
@pytest.mark.parametrize("slope", [0.0, 0.45])
def test_the_proof_for_h_plus_matrices_does_not_depend_on_the_units_of_p_and_z(decades, slope):
    rng, n = np.random.default_rng(decades), 30
    A = 4 * np.eye(n) - 1.9 * (np.eye(n, k=1) + np.eye(n, k=-1))
    G = slope * np.eye(n)[rng.permutation(n)]
    z, active = rng.normal(size=n), rng.random(n) < 0.5
    q, c = active * 1.0 - A @ z, z - G @ z - ~active
    row, column = (10.0 ** rng.uniform(-decades, decades, n) for _ in range(2))
    psi = icp.Affine(column[:, None] * G / column, column * c)
    problem = icp.ICP(row[:, None] * A / column, row * q, psi)
    bound = icp.error_bound(problem, column * (z + 0.1), rigorous=True)
    assert bound.proof.startswith("A is an H+-matrix")
    assert (bound.componentwise >= 0.1 * column * (1 - 1e-9)).all()
    assert (bound.componentwise <= 10 * column).all()
    assert "not proved to be an H+-matrix" in icp.error_bound(icp.ICP(-A + 5 * np.eye(n), q), z).reason


def test_alpha_and_beta_are_never_above_what_they_stand_for():
    """α ≤ ⟨A⟩v and β ≤ (I − G)v in fractions."""
    rng, proved = np.random.default_rng(0), 0
    for _ in range(150):
        problem, _, _ = random_problem(rng)
        proof = proofs_of(problem).h_plus
        if isinstance(proof, str):
            continue
        proved += 1
        slopes = np.eye(problem.n) - np.abs(problem.psi.G.toarray()) * (1 - np.eye(problem.n))
        v = rational(proof.v)[0]
        for matrix, bound in ((comparison_matrix(problem.A).toarray(), proof.alpha), (slopes, proof.beta)):
            own = np.abs(problem.psi.G.diagonal()) if matrix is slopes else np.zeros(problem.n)
            for i, row in enumerate(rational(matrix)):
                exact = sum(a * x for a, x in zip(row, v, strict=True)) - Fraction(float(own[i])) * v[i]
                assert Fraction(float(bound[i])) <= exact
    assert proved >= 80


class TestScalingVectors:
    @settings(max_examples=60, deadline=None)
    @given(seed=st.integers(0, 10**9))
    def test_layers_dominate_wherever_they_are_given(self, seed):
        """⟨A⟩f(layer) ≥ D1 for random weakly dominant matrices, symmetric or not."""
        rng = np.random.default_rng(seed)
        n = 12
        B = rng.random((n, n)) * (rng.random((n, n)) < 0.25)
        np.fill_diagonal(B, 0.0)
        extra = np.where(rng.random(n) < 0.3, rng.random(n), 0.0)
        scale = 10.0 ** rng.uniform(-3, 3, n)
        C = np.diag(scale) @ (np.diag(B.sum(axis=1) + extra + 1e-3 * (B.sum(axis=1) == 0)) - B)
        C = sp.csr_array(C)
        v = layered(C)
        if v is not None:
            assert (v > 0).all()
            assert (C @ v >= C.diagonal() * (1 - 1e-9)).all()

    @given(st.integers(0, 2**32 - 1), st.integers(1, 4))
    def test_a_comparison_matrix_is_what_its_formula_says(self, seed, n):
        """Where it is A itself, where diagonal entries are 0 or negative, and where they are not stored."""
        A = np.random.default_rng(seed).integers(-2, 2, (n, n)).astype(float)
        A[np.diag_indices(n)] *= -1
        expected = -np.abs(A) + 2 * np.diag(np.abs(A.diagonal()))
        for given_ in (A, sp.csr_array(A)):
            assert np.array_equal(comparison_matrix(given_).toarray(), expected)

    @pytest.mark.parametrize("skew", [0.0, 0.5])
    def test_large_matrices_get_a_vector_without_a_factorisation(self, skew):
        """One would leave ⟨A⟩v = D1 to rounding; a few steps of Krylov's, or the layers, leave far more."""
        problem = icp.scenes.membrane(n=30_000, skew=skew).problem
        proof = proofs_of(problem).h_plus
        assert np.abs(comparison_matrix(problem.A) @ proof.v / problem.A.diagonal() - 1).max() > 1e-4

    @settings(max_examples=100, deadline=None)
    @given(seed=st.integers(0, 10**9))
    def test_a_vector_for_a_and_psi_is_found_exactly_where_there_is_one(self, seed):
        """v with ⟨A⟩v > 0 and Gv < v exists iff every choice of rows of D⁻¹|B| and G has spectral radius < 1."""
        rng = np.random.default_rng(seed)
        n = 4
        B = rng.random((n, n)) * (rng.random((n, n)) < 0.6)
        np.fill_diagonal(B, 0.0)
        G = rng.random((n, n)) * (rng.random((n, n)) < 0.6) * rng.choice([0.3, 0.6, 1.0])
        radius = max(
            np.abs(np.linalg.eigvals(np.where(np.array(rows)[:, None], G, B))).max()
            for rows in np.ndindex(*(2,) * n)
            for rows in [np.array(rows, dtype=bool)]
        )
        if abs(radius - 1) > 1e-6:
            found = proofs_of(icp.ICP(np.eye(n) - B, np.zeros(n), icp.Affine(G))).h_plus
            assert isinstance(found, str) == (radius >= 1)


class TestActiveSet:
    @settings(max_examples=60, deadline=None)
    @given(seed=st.integers(0, 10**9), distance=st.sampled_from([0.0, 1e-9, 1e-3, 0.3, 10.0]))
    def test_what_is_decided_is_right(self, seed, distance):
        scene = icp.scenes.manufactured_affine(n=16, seed=seed % 1000)
        problem, exact = scene.problem, scene.z_exact
        z = exact + distance * np.random.default_rng(seed).normal(size=exact.size)
        known = icp.theory.active_set(problem, z, icp.error_bound(problem, z, sharp=False))
        p, r = problem.p(exact), problem.r(exact)
        assert (p[known.active] > 0.1).all()
        assert (r[known.inactive] > 0.1).all()
        if distance <= 1e-3:
            assert not known.undecided.any()

    def test_a_sign_that_rounding_made_decides_nothing(self):
        """p of some 1e-17 is computed with either sign; δ = 0 says that z = z* itself."""
        rng, n, wrong = np.random.default_rng(0), 4, 0
        for _ in range(40):
            A, z = rng.normal(size=(n, n)), rng.normal(size=n)
            problem = icp.ICP(A, [-math.fsum(A[i] * z) for i in range(n)], -np.inf)
            known = icp.theory.active_set(problem, z, icp.ErrorBound(0.0, np.zeros(n), 0.0, "z is exact", ""))
            p = [dot(row, rational(z)[0]) + Fraction(b) for row, b in zip(rational(A), problem.q, strict=True)]
            wrong += sum(a > 0 >= b for a, b in zip(problem.p(z), p, strict=True))
            assert all(b > 0 or not active for b, active in zip(p, known.active, strict=True))
        assert wrong >= 10

    def test_psi_may_move_by_what_z_is_wrong(self):
        """z* = 0 touches with p* = 0.1; at z = (2, 2) |z − z*| ≤ 2 < r = 3.8, but ψ changes by 1.8 as well."""
        problem = icp.ICP([[1.0, -0.5], [-0.5, 1.0]], [0.1, 0.1], icp.Affine(-0.9 * np.eye(2)))
        z, delta = np.full(2, 2.0), np.full(2, 2.0)
        known = icp.theory.active_set(problem, z, icp.ErrorBound(2.0, delta, 3.0, "z* = 0", ""))
        assert known.undecided.all()


def test_a_z_that_is_not_finite_is_named():
    problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [1.0, -2.0])
    for z, words in (([np.nan, 2.0], "z[0] is nan"), ([1.0, np.inf], "z[1] is inf")):
        for bound in (icp.error_bound(problem, z), icp.certify(problem, z).bound):
            assert (bound.value, bound.reason, bound.unique) == (None, words, True)


@pytest.mark.parametrize(
    ("psi", "upper", "name"),
    [
        (icp.Elementwise(lambda z: 0.9 * z + 3.0, lipschitz=0.1), None, "psi"),
        (icp.Function(lambda z: 0.9 * z[::-1] - 3.0, lipschitz=[[0.0, 0.2], [0.2, 0.0]]), None, "psi"),
        (-3.0, icp.Elementwise(lambda z: 0.4 + 0.3 * np.sin(z), lipschitz=0.1), "upper"),
    ],
)
def test_a_lipschitz_constant_that_is_seen_to_be_too_small_proves_nothing(psi, upper, name):
    problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, -2.0], psi, upper=upper)
    bound = icp.error_bound(problem, problem.solve().z)
    assert not bound.unique
    assert bound.value is None
    assert bound.reason.startswith(f"{name}.lipschitz is too small: {name}_0 differs by ")


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_lipschitz_constant_that_holds_is_believed_however_tight(seed):
    rng = np.random.default_rng(seed)
    slope, at, z = rng.uniform(0.0, 0.99), rng.normal(size=2) * 10.0 ** rng.uniform(-9, 9), rng.normal(size=2)
    psi = icp.Elementwise(lambda z: slope * z + at, lipschitz=slope)
    assert icp.error_bound(icp.ICP(np.eye(2), [-1.0, 1.0], psi), z * 10.0 ** rng.uniform(-9, 9)).unique
