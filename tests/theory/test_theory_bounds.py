"""Error bounds against exact rational solutions, and the certified active set."""

import math
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from exact import exceeds, nearest_floats, rational, solutions
from hypothesis import given, settings
from hypothesis import strategies as st

import icpmodel as icp
from icpmodel.theory import comparison_matrix
from icpmodel.theory.certificates.bounds import proofs_of
from icpmodel.theory.certificates.proof import norm_up
from icpmodel.theory.matrices.comparison_matrix import layered, scaling_vectors

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


def violations(seed, problems, starts, decades=2, **options):
    """(trials with a bound, violations) over random problems, each looked at from several z."""
    rng = np.random.default_rng(seed)
    trials, bad = 0, []
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
            if exceeds(z, exact, bound.componentwise) or not bound.euclidean >= math.hypot(*(z - near)) * (1 - 1e-9):
                bad.append((problem, z))
    return trials, bad


class TestNeverBelowTheTrueError:
    """The bound is a proof: in more than 10⁵ trials against solutions in rational arithmetic it never fails."""

    @pytest.mark.parametrize("seed", range(4))
    def test_plain(self, seed):
        trials, bad = violations(seed, problems=520, starts=60, sharp=False)
        assert trials >= 26_000
        assert bad == []

    def test_sharp(self):
        trials, bad = violations(99, problems=220, starts=27, sharp=True)
        assert trials >= 5_000
        assert bad == []

    @pytest.mark.parametrize("decades", [20, 90])
    def test_in_units_of_any_size(self, decades):
        trials, bad = violations(7, problems=60, starts=9, decades=decades)
        assert trials >= 400
        assert bad == []

    @pytest.mark.parametrize("size", [1e-323, 1e-310, 1e-200, 1.0, 1e200, 1e307])
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

    def test_a_psi_without_a_value_elsewhere_has_the_bound_of_z_itself(self):
        def near_zero(z):
            if np.abs(z).max() > 0.1:
                raise ValueError("far from 0")
            return (np.array([z[1] - 1, -np.inf]), np.array([1, -1]))

        problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 3.0], icp.Intervention(near_zero))
        assert "far from 0" in icp.error_bound(problem, np.zeros(2)).reason

    def test_a_jacobian_that_fails_costs_sharpness_only(self):
        psi = icp.Function(lambda z: 0.3 * z, jacobian=lambda z: np.full((1, 1), np.nan), lipschitz=0.3)
        bound = icp.error_bound(icp.ICP([[2.0]], [-2.0], psi), [1.5])
        assert bound.value >= 0.5


class TestSharpness:
    @pytest.mark.parametrize("name", [n for n in icp.scenes.names() if icp.scenes.scene(n).z_exact is not None])
    @pytest.mark.parametrize("size", [1e-8, 1e-3, 1.0])
    def test_bound_over_error_is_small_and_never_below_1_on_every_scene_with_an_exact_solution(self, name, size):
        n = 100 if "n" in icp.scenes.parameters(name) else None
        scene = icp.scenes.scene(name, n)
        rng = np.random.default_rng(0)
        ratios = []
        for _ in range(7):
            z = scene.z_exact + size * rng.uniform(-1, 1, scene.problem.n)
            bound = icp.error_bound(scene.problem, z)
            if bound.value is None:
                assert name in ("hard-empty-row", "hard-overflow", "hard-semidefinite")
                return
            ratios.append(bound.value / np.abs(z - scene.z_exact).max())
        assert np.median(ratios) <= 10 or name in ("hard-scaled", "hard-singular")  # rounding alone is larger there
        assert min(ratios) >= 1

    def test_sharpening_never_widens_and_helps_on_the_membrane(self):
        scene = icp.scenes.membrane(n=900)
        z = scene.problem.solve(rtol=1e-13).z
        off = z + 1e-3 * np.random.default_rng(0).uniform(-1, 1, z.size)
        plain, sharp = (icp.error_bound(scene.problem, off, sharp=flag) for flag in (False, True))
        assert sharp.value <= plain.value / 20
        assert sharp.value <= 1.01e-3

    def test_a_users_function_has_no_rigorous_bound(self):
        problem = icp.ICP(
            [[2.0]], [-1.0], icp.Elementwise(lambda z: 0.5 * np.sin(z), lambda z: 0.5 * np.cos(z), lipschitz=0.5)
        )
        assert icp.error_bound(problem, [0.0]).unique
        bound = icp.error_bound(problem, [0.0], rigorous=True)
        assert bound.value is None
        assert "user's function" in bound.reason

    def test_what_rests_on_a_users_word_says_so(self):
        psi = icp.Elementwise(lambda z: 0.5 * np.sin(z), lambda z: 0.5 * np.cos(z), lipschitz=0.5)
        mine, ours = (icp.ICP([[2.0]], [-1.0], f).solve() for f in (psi, 0.0))
        assert mine.certificate.bound.proof.endswith("given that psi is what the user says")
        assert "z* is the only solution, given that psi is what the user says" in " ".join(str(mine).split())
        assert "user" not in str(ours) + ours.certificate.bound.proof

    def test_a_reason_is_given_once(self):
        reason = icp.error_bound(icp.ICP([[2.0]], [-1.0], np.sin), [0.0]).reason
        assert reason.count("no Lipschitz matrix") == 1


@pytest.mark.parametrize("decades", [1, 10, 40, 90])
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


def test_the_units_of_z_may_show_in_psi_alone():
    rng, n = np.random.default_rng(0), 30
    column = 10.0 ** rng.uniform(-40, 40, n)
    G = 0.45 * np.eye(n)[rng.permutation(n)] + 0.45 * np.eye(n)[rng.permutation(n)]
    problem = icp.ICP(np.eye(n), np.ones(n), icp.Affine(column[:, None] * G / column))
    assert proofs_of(problem).h_plus.sentence.endswith("in natural units)")


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

    def test_layers_are_found_on_a_grid_and_refused_against_the_wind(self):
        still, wind = (comparison_matrix(icp.scenes.membrane(n=900, skew=s).problem.A) for s in (0.0, 0.5))
        v = layered(still)
        assert v is not None
        best = list(scaling_vectors(still))[-1][1]
        assert v.max() <= 2 * best.max()
        assert layered(wind) is None

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

    def test_a_degenerate_row_stays_undecided(self):
        solution = icp.scenes.hand_degenerate().problem.solve(rtol=1e-14)
        assert solution.active_set.undecided.tolist() == [False, True]

    def test_psi_may_move_by_what_z_is_wrong(self):
        """z* = 0 touches with p* = 0.1; at z = (2, 2) |z − z*| ≤ 2 < r = 3.8, but ψ changes by 1.8 as well."""
        problem = icp.ICP([[1.0, -0.5], [-0.5, 1.0]], [0.1, 0.1], icp.Affine(-0.9 * np.eye(2)))
        z, delta = np.full(2, 2.0), np.full(2, 2.0)
        known = icp.theory.active_set(problem, z, icp.ErrorBound(2.0, delta, 3.0, "z* = 0", ""))
        assert known.undecided.all()

    def test_a_bound_that_lies_decides_no_row_twice(self):
        """z = 10 with δ = 0 would prove p* > 0 and r* > 0."""
        known = icp.theory.active_set(
            icp.ICP([[1.0]], [0.0]), np.array([10.0]), icp.ErrorBound(0, np.zeros(1), 0, "", "")
        )
        assert known.undecided.all()

    def test_a_sign_that_rounding_made_decides_nothing(self):
        """p and r of some 1e-17 are computed with either sign; δ = 0 says that z = z* itself."""
        rng, n, wrong = np.random.default_rng(0), 4, 0
        for _ in range(40):
            A, G, z = rng.normal(size=(n, n)), rng.normal(size=(n, n)), rng.normal(size=n)
            q = np.array([-math.fsum(A[i] * z) for i in range(n)])
            c = np.array([z[i] - math.fsum(G[i] * z) for i in range(n)])
            problem = icp.ICP(A, q, icp.Affine(G, c))
            known = icp.theory.active_set(problem, z, icp.ErrorBound(0.0, np.zeros(n), 0.0, "z is exact", ""))
            A, G, q, c, z = (rational(x) for x in (A, G, q, c, z))
            for i in range(n):
                p = sum(a * x for a, x in zip(A[i], z[0], strict=True)) + q[0][i]
                r = z[0][i] - sum(g * x for g, x in zip(G[i], z[0], strict=True)) - c[0][i]
                wrong += (problem.p(nearest_floats(z[0]))[i] > 0 >= p) + (problem.r(nearest_floats(z[0]))[i] > 0 >= r)
                assert p > 0 or not known.active[i]
                assert r > 0 or not known.inactive[i]
        assert wrong >= 10

    def test_without_a_bound_nothing_is_decided(self):
        assert icp.ICP([[1.0]], [-1.0], np.sin).solve().active_set.undecided.all()

    def test_interventions_bound_the_change_of_psi_by_the_largest_change(self):
        jumps = sp.csr_array((np.zeros(3), (np.array([0, 0, 1]), np.array([1, 2, 2]))), shape=(3, 3))
        psi = icp.Intervention(jumps).bind(3)
        assert psi.change(np.array([5.0, 1.0, 2.0])).tolist() == [2.0, 2.0, 0.0]


def test_a_z_that_is_not_finite_is_named():
    problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [1.0, -2.0])
    for z, words in (([np.nan, 2.0], "z[0] is nan"), ([1.0, np.inf], "z[1] is inf")):
        for bound in (icp.error_bound(problem, z), icp.certify(problem, z).bound):
            assert (bound.value, bound.reason, bound.unique) == (None, words, True)


def test_a_solution_is_taken_for_its_z():
    problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [1.0, -2.0])
    solution = problem.solve(rtol=0.1)
    assert icp.certify(problem, solution).error_bound == icp.certify(problem, solution.z).error_bound
    bound = icp.error_bound(problem, solution)
    assert bound.value == icp.error_bound(problem, solution.z).value
    of_solution, of_z = (icp.theory.active_set(problem, z, bound) for z in (solution, solution.z.tolist()))
    assert of_solution.active.tolist() == of_z.active.tolist()
    assert problem.residual(solution) == problem.residual(solution.z)


@pytest.mark.parametrize("name", ["sharp", "rigorous", "bound"])
def test_a_text_is_no_truth_value(name):
    with pytest.raises(icp.InputError, match=f"{name} is 'no'; True or False was expected"):
        icp.certify(icp.ICP([[2.0]], [1.0]), [0.0], **{name: "no"})


def test_the_active_set_wants_the_bound_of_this_problem():
    problem = icp.ICP([[2.0]], [1.0])
    for bound, words in ((None, "bound is None; error_bound"), (1e-6, "bound is 1e-06; error_bound")):
        with pytest.raises(icp.InputError, match=words):
            icp.theory.active_set(problem, [0.0], bound)
    other = icp.error_bound(icp.ICP(np.eye(2), [1.0, 1.0]), [0.0, 0.0])
    with pytest.raises(icp.InputError, match="bound is that of 2 unknowns; 1 were expected"):
        icp.theory.active_set(problem, [0.0], other)


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
