"""The counterexamples and bounds of the theory, by name; the printed statements fail where the corrected ones hold."""

import gc
import weakref
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

import icpmodel as icp
from icpmodel.numerics.arrays import as_csr
from icpmodel.theory import check, classify
from icpmodel.theory.certificates.bounds import proofs_of
from icpmodel.theory.matrices import definiteness, eigenvalue


def iterate(method, problem, z, steps):
    path = method.iterates(problem, np.asarray(z, dtype=float))
    return [next(path)[0] for _ in range(steps + 1)]


def spectral_radius(M):
    return np.abs(np.linalg.eigvals(np.atleast_2d(M))).max()


class TestConventions:
    def test_sign_of_the_triangles(self):
        """A = D − L − U: Gauss–Seidel on A = [4, −1; −2, 4] goes to (1, 1); with L taken as the triangle itself it
        would go to (0.75, 0.5)."""
        A, q = np.array([[4.0, -1.0], [-2.0, 4.0]]), [-3.0, -2.0]
        assert icp.ICP(A, q).solve("mnmgs", rtol=1e-12).z == pytest.approx([1.0, 1.0])
        # M1 = D - L with L the triangle itself, N1 = (literally) U: then M1 - N1 is not A
        z = np.zeros(2)
        for _ in range(200):
            N1 = np.array([[0.0, -1.0], [0.0, 0.0]])
            X = np.array([[4.0, 0.0], [2.0, 4.0]]) + np.diag([4.0, 4.0])
            z = np.linalg.solve(X, N1 @ z + np.abs((A - np.diag([4.0, 4.0])) @ z + q) - q)
        assert np.abs(z - 1.0).max() > 0.2

    def test_mnmmod_corrected(self):
        """A = q = ψ = 1, θ₁ = 2: the literal display gives 0.25, only the "+" restored 0.5, the right scheme 1 = z*."""
        problem = icp.ICP([[1.0]], [1.0], psi=1.0)
        assert iterate(icp.MNMMOD(theta1=2.0), problem, [0.0], 60)[-1] == pytest.approx([1.0])
        literal = plus = 0.0
        for _ in range(200):
            literal = (abs((1 - 2) * literal + 1 * 1) - 1 + 1) / 3
            plus = (abs((1 - 2) * plus + 1 + 1) - 1 + 1) / 3
        assert literal == pytest.approx(0.25)
        assert plus == pytest.approx(0.5)

    @settings(max_examples=30, deadline=None)
    @given(seed=st.integers(0, 10**6))
    def test_mnmj_with_omega_D_is_projected_jacobi(self, seed):
        rng = np.random.default_rng(seed)
        A = rng.normal(size=(5, 5)) + 5 * np.eye(5)
        problem = icp.ICP(A, rng.normal(size=5), icp.Affine(rng.normal(size=(5, 5)) * 0.1, rng.normal(size=5)))
        z = rng.normal(size=5)
        expected = np.maximum(problem.psi.value(z), z - problem.p(z) / np.diag(A))
        assert iterate(icp.MNMJ(), problem, z, 1)[1] == pytest.approx(expected, rel=1e-12, abs=1e-13)

    @settings(max_examples=30, deadline=None)
    @given(seed=st.integers(0, 10**6), omega=st.floats(0.2, 1.8))
    def test_projection_fixed_point_is_a_member_of_the_family(self, seed, omega):
        rng = np.random.default_rng(seed)
        A = rng.normal(size=(5, 5)) + 5 * np.eye(5)
        problem, z = icp.ICP(A, rng.normal(size=5), rng.normal(size=5)), rng.normal(size=5)
        expected = np.maximum(problem.psi.value(z), z - omega * problem.p(z) / np.diag(A))
        step = iterate(icp.ProjectionFixedPoint(omega=omega), problem, z, 1)[1]
        assert step == pytest.approx(expected, rel=1e-12, abs=1e-13)


class TestTheorem41:
    def test_the_componentwise_decrease_of_the_proof_is_false(self):
        """A = [2, −1; −.5, 2], GS, Ω = D, z⁰ = (1, 3): ρ(L) = .283, |e⁰| = (0, 2), |e¹| = (1, .125)."""
        A = np.array([[2.0, -1.0], [-0.5, 2.0]])
        problem = icp.ICP(A, -A @ np.ones(2))
        X = np.array([[2.0, 0.0], [-0.5, 2.0]]) + 2 * np.eye(2)
        N = X - 2 * np.eye(2) - A
        L = np.abs(np.linalg.inv(X)) @ (np.abs(N) + np.abs(A - 2 * np.eye(2)))
        assert spectral_radius(L) == pytest.approx(0.283, abs=5e-4)
        z = iterate(icp.MNMGS(), problem, [1.0, 3.0], 1)[1]
        assert np.abs(z - 1.0) == pytest.approx([1.0, 0.125])
        assert problem.solve("mnmgs", z0=[1.0, 3.0]).z == pytest.approx(np.ones(2))

    @settings(max_examples=40, deadline=None)
    @given(seed=st.integers(0, 10**6))
    def test_the_error_after_k_steps_is_bounded_by_the_first_step(self, seed):
        """|zᵏ − z*| ≤ Lᵏ(I − L)⁻¹|z¹ − z⁰| componentwise where ρ(L) < 1, from any start, for any sign of z⁰."""
        rng = np.random.default_rng(seed)
        n = 5
        A = rng.normal(size=(n, n))
        A += np.diag(np.abs(A).sum(axis=1) * 1.3 - np.diag(A) + 0.5)
        G = rng.normal(size=(n, n)) * 0.03
        exact, active = rng.normal(size=n), rng.random(n) < 0.5
        p, r = np.where(active, rng.random(n), 0.0), np.where(active, 0.0, rng.random(n))
        problem = icp.ICP(A, p - A @ exact, icp.Affine(G, exact - r - G @ exact))
        method = icp.MNMAOR(theta1=1.05, theta2=0.9)
        Omega = np.diag(np.diag(A))
        M = method.splitting_of().matrix(problem.A).toarray()
        inverse = np.abs(np.linalg.inv(M + Omega))
        L = inverse @ (np.abs(M - A) + np.abs(A - Omega) + 2 * Omega @ np.abs(G))
        if spectral_radius(L) >= 1:
            return
        z = iterate(method, problem, 10 * rng.normal(size=n), 8)
        first = np.linalg.solve(np.eye(n) - L, np.abs(z[1] - z[0]))
        for k in range(1, 9):
            bound = np.linalg.matrix_power(L, k) @ first
            assert (np.abs(z[k] - exact) <= bound * (1 + 1e-9) + 1e-12).all()


class TestPositiveDefinite:
    @settings(max_examples=40, deadline=None)
    @given(seed=st.integers(0, 10**6), exponent=st.floats(-1, 1))
    def test_the_whole_matrix_converges_for_every_omega(self, seed, exponent):
        """A positive definite, symmetric or not, ψ = 0, M₁ = A, φ = 0, Ω = ωI: a Peaceman–Rachford splitting."""
        rng = np.random.default_rng(seed)
        B, K = rng.normal(size=(4, 4)), rng.normal(size=(4, 4))
        A = B @ B.T + 0.5 * np.eye(4) + (K - K.T)
        problem = icp.ICP(A, rng.normal(size=4))
        assert problem.solve(icp.MNMMOD(theta1=10.0**exponent), rtol=1e-6).solved


class TestMonotoneFamily:
    @pytest.mark.parametrize("share", [0.25, 0.5])
    def test_jacobi_with_a_small_omega_and_no_phi_fails_on_the_dividend_scene(self, share):
        """φ ≥ |D − Ω| is needed: Ω = .25D or .5D with φ = 0 fails, with φ = |D − Ω| it is solved."""
        scene = icp.scenes.dividend(n=31)
        D = scene.problem.A.diagonal()
        failed = scene.problem.solve("mnmj", phi2=share * D, raise_on_failure=False, max_iter=20_000)
        assert not failed.solved
        assert failed.residual > 1.0
        assert scene.problem.solve("mnmj", phi2=share * D, phi=(1 - share) * D, rtol=1e-6, max_iter=50_000).solved


class TestTheorem43:
    def test_the_printed_parenthesis_is_false(self):
        """A = .1, q = 1, ψ = 6 − 5z, φ₁ = 1, φ₂ = .1: printed .5 < 1, true 5; the iterates end in {−10, 56}."""
        problem = icp.ICP([[0.1]], [1.0], icp.Affine([[-5.0]], 6.0))
        printed, true = 0.0 / 0.1 + 0.1 * 5, (0.0 + 0.1 * 5) / 0.1
        assert (printed, true) == pytest.approx((0.5, 5.0))
        assert problem.residual([1.0]) < 1e-14
        with pytest.raises(icp.NotSolved) as error:
            problem.solve("mnmgs", phi1=1.0, phi2=0.1, z0=[56.0])
        assert error.value.solution.status is icp.Status.CYCLED
        orbit = iterate(icp.MNMGS(phi2=0.1), problem, [2.0], 400)[-2:]
        assert sorted(float(z[0]) for z in orbit) == pytest.approx([-10.0, 56.0])

    def test_phi_must_not_be_negative(self):
        """A = 1, q = −1, ψ = 0, φ = −1.5: error factor −3."""
        problem = icp.ICP([[1.0]], [-1.0])
        first, second = iterate(icp.MNMGS(phi=-1.5), problem, [1.1], 1)
        assert (second - 1.0) / (first - 1.0) == pytest.approx([-3.0])

    def test_theta2_must_not_be_negative(self):
        """A = [1, −.5; −.5, 1], θ = (1, −4): condition .5 < 1, error matrix has ρ = 1.151."""
        A = np.array([[1.0, -0.5], [-0.5, 1.0]])
        problem, method = icp.ICP(A, -A @ np.ones(2)), icp.MNMAOR(theta1=1.0, theta2=-4.0)
        near = np.ones(2)  # z* > 0 and p* = 0: the step is linear near it, F = A(z - 1) where that is the smaller side
        columns = [(iterate(method, problem, near + 1e-6 * e, 1)[1] - 1.0) / 1e-6 for e in np.eye(2)]
        assert spectral_radius(np.array(columns).T) == pytest.approx(1.151, abs=1e-3)


class TestTheorem44:
    def test_case_one_as_printed_is_false(self):
        """A = 1, M₁ = .1, φ = .5, φ₁ = φ₂ = .1, G = .9, ψ = 1.9 − .9z, q = 5: true −.07, error factor −1.375."""
        problem = icp.ICP([[1.0]], [5.0], icp.Affine([[-0.9]], 1.9))
        method = icp.Modulus(splitting=[[0.1]], phi=0.5, phi1=0.1, phi2=0.1)
        first, second = iterate(method, problem, [1.001], 1)
        assert problem.residual([1.0]) < 1e-14
        assert (second - 1.0) / (first - 1.0) == pytest.approx([-1.375])


class TestWhereSplittingsDiffer:
    """A = [1, −.9; −.9, 1], ψ(z) = 1 − .9(z₂, z₁), q = (−1, 3), z⁰ = (5, −7)."""

    problem = icp.ICP([[1.0, -0.9], [-0.9, 1.0]], [-1.0, 3.0], icp.Affine([[0.0, -0.9], [-0.9, 0.0]], 1.0))

    def test_mnmj_converges(self):
        z = self.problem.solve("mnmj", z0=[5.0, -7.0]).z
        assert z == pytest.approx([1.0497, 0.05525], abs=5e-5)

    @pytest.mark.parametrize("method", ["mnmgs", "mnmod"])
    def test_mnmgs_and_mnmod_do_not(self, method):
        with pytest.raises(icp.NotSolved):
            self.problem.solve(method, z0=[5.0, -7.0], max_iter=5000)

    def test_the_automatic_choice_solves_it_where_psi_is_any_function_too(self):
        G, c = self.problem.psi.G, self.problem.psi.c
        for problem in (self.problem, self.problem.with_psi(lambda z: G @ z + c)):
            assert problem.solve(z0=[5.0, -7.0]).solved


class TestCyclicPMatrix:
    """A = [1, 0, 2; 2, 1, 0; 0, 2, 1], q = −(1, 1, 1): a P-matrix that is not H₊."""

    problem = icp.ICP([[1.0, 0.0, 2.0], [2.0, 1.0, 0.0], [0.0, 2.0, 1.0]], [-1.0, -1.0, -1.0])

    def test_active_set_newton_cycles_with_period_three(self):
        A, q, z, seen = self.problem.A.toarray(), self.problem.q, np.array([1.0, 0.0, 0.0]), []
        for _ in range(9):
            rows = self.problem.p(z) < z
            z = np.linalg.solve(np.where(rows[:, None], A, np.eye(3)), np.where(rows, -q, 0.0))
            seen.append((z.copy(), self.problem.residual(z)))
        assert np.array_equal(seen[-1][0], seen[-4][0])
        assert seen[-1][1] == pytest.approx(np.sqrt(10))

    def test_mnmmod_converges(self):
        solution = self.problem.solve("mnmmod", theta1=2.0)
        assert solution.iterations <= 15
        assert solution.z == pytest.approx(np.full(3, 1 / 3))

    @pytest.mark.parametrize("theta", [0.1, 0.5, 0.9, 1.0])
    def test_gauss_seidel_sweeps_fail_and_say_so(self, theta):
        solution = self.problem.solve("mnmsor", theta1=theta, z0=[1.0, 0.0, 0.0], raise_on_failure=False)
        assert not solution.solved
        assert solution.status.advice

    def test_it_is_not_h_plus_but_its_principal_minors_are_a_certificate(self):
        assert "not proved to be an H+-matrix" in proofs_of(self.problem).h_plus
        bound = icp.error_bound(self.problem, np.full(3, 1 / 3))
        assert bound.value < 1e-14
        assert "P-matrix" in bound.proof


def h_plus_problem(seed, n=8):
    """A random H₊-matrix that is not diagonally dominant, ψ of small slope, and an exact complementary solution."""
    rng = np.random.default_rng(seed)
    off = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.5)
    np.fill_diagonal(off, 0.0)
    scale = 10.0 ** rng.uniform(-1, 1, n)
    A = np.diag(np.abs(off).sum(axis=1) * rng.uniform(1.1, 2.0) + 0.1) + off
    A = np.diag(10.0 ** rng.uniform(-1, 1, n)) @ A @ np.diag(1 / scale)
    G = np.diag(scale) @ (rng.normal(size=(n, n)) * 0.5 / n) @ np.diag(1 / scale)
    G *= 0.6 / max(1e-9, (np.abs(G) @ scale / scale).max())
    z, active = rng.normal(size=n) * scale, rng.random(n) < 0.5
    p, r = np.where(active, rng.random(n), 0.0), np.where(active, 0.0, rng.random(n))
    return icp.ICP(A, p - A @ z, icp.Affine(G, z - r - G @ z)), z


class TestErrorBound:
    @settings(max_examples=300, deadline=None)
    @given(seed=st.integers(0, 10**9), distance=st.sampled_from([0.0, 1e-15, 1e-9, 1e-3, 1.0, 1e6]))
    def test_it_is_never_below_the_true_error(self, seed, distance):
        problem, exact = h_plus_problem(seed)
        z = exact + distance * np.random.default_rng(seed + 1).normal(size=exact.size)
        bound = icp.error_bound(problem, z)
        if bound.value is not None:
            # z* itself is exact to a few roundings of its own size only
            slack = 1e-13 * np.abs(exact).max() + 1e-12 * bound.value
            assert (np.abs(z - exact) <= bound.componentwise + slack).all()
            assert bound.value == bound.componentwise.max()

    @pytest.mark.parametrize(
        ("problem", "z", "exact"),
        [(icp.ICP([[1e-300]], [0.0], psi=-np.inf), 1e-30, 0.0), (icp.ICP([[5e-324]], [0.0], psi=-np.inf), 0.4, 0.0)],
    )
    def test_underflow_does_not_make_it_zero(self, problem, z, exact):
        bound = icp.error_bound(problem, [z])
        assert bound.value is None or bound.value >= abs(z - exact)

    @settings(max_examples=30, deadline=None)
    @given(seed=st.integers(0, 10**9), scale=st.sampled_from([1e-200, 1e-12, 1e12, 1e200]))
    def test_it_does_not_depend_on_the_units_of_p(self, seed, scale):
        problem, exact = h_plus_problem(seed)
        scaled = icp.ICP(problem.A * scale, problem.q * scale, problem.psi)
        before, after = icp.error_bound(problem, exact + 1e-3), icp.error_bound(scaled, exact + 1e-3)
        if before.proof == after.proof == "A is an H+-matrix (v = 1)":
            assert after.value == pytest.approx(before.value, rel=1e-6)

    @settings(max_examples=300, deadline=None)
    @given(seed=st.integers(0, 10**9), distance=st.sampled_from([0.0, 2.0**-50, 2.0**-20, 1.0]))
    def test_it_is_never_below_the_true_error_where_that_is_known_exactly(self, seed, distance):
        """All data are dyadic numbers of few bits, so that z* is exact and no slack is needed, at any row scale."""
        rng = np.random.default_rng(seed)
        n = int(rng.choice([1, 2, 4]))
        off = rng.integers(-8, 9, size=(n, n)) / 8
        np.fill_diagonal(off, 0.0)
        rows, columns = 2.0 ** rng.integers(-40, 40, size=n), 2.0 ** rng.integers(-6, 7, size=n)
        dominant = np.diag(np.abs(off).sum(axis=1) + rng.integers(1, 9, size=n) / 8)
        A = rows[:, None] * (off + dominant) * columns
        G = rng.integers(-4, 5, size=(n, n)) / 64 * columns / columns[:, None]
        exact, active = rng.integers(-64, 65, size=n) / 16 / columns, rng.random(n) < 0.5
        p = np.where(active, rng.integers(0, 9, size=n) / 8 * rows, 0.0)
        r = np.where(active, 0.0, rng.integers(0, 9, size=n) / 8 / columns)
        problem = icp.ICP(A, p - A @ exact, icp.Affine(G, exact - r - G @ exact))
        z = exact + distance * rng.integers(-8, 9, size=n) / 8 / columns
        bound = icp.error_bound(problem, z)
        assume(bound.unique)  # v = 1 and v = <A>^-1 1 do not serve every scaling of the columns
        assert (np.abs(z - exact) <= bound.componentwise).all()

    def test_a_slope_of_one_to_rounding_gets_no_h_plus_proof(self):
        G = sp.csr_array(np.full((1, 1), 1.0 - 2.0**-53))
        assert "psi moves too much" in proofs_of(icp.ICP([[1.0]], [1.0], icp.Affine(G, 0.0))).h_plus

    def test_a_free_row_is_measured_by_alpha_alone(self):
        bound = icp.error_bound(icp.ICP([[2.0]], [-2.0], psi=-np.inf), [1.5])
        assert bound.value == pytest.approx(0.5, rel=1e-12)

    def test_it_holds_for_most_of_these_problems(self):
        assert sum(icp.error_bound(h_plus_problem(seed)[0], np.zeros(8)).unique for seed in range(100)) >= 60

    def test_v_one_serves_dominant_rows_and_one_solve_the_others(self):
        dominant = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [0.0, 0.0])
        assert icp.error_bound(dominant, [0.0, 0.0]).proof == "A is an H+-matrix (v = 1)"
        laplace = icp.scenes.membrane(n=25).problem
        assert icp.error_bound(laplace, np.zeros(25)).proof == "A is an H+-matrix (v = <A>^-1 D1)"

    @pytest.mark.parametrize(
        ("problem", "words"),
        [
            (icp.ICP([[-1.0]], [0.0]), r"A\[0, 0\] = -1 is not positive"),
            (icp.ICP([[1.0]], [0.0], np.sin), "no Lipschitz matrix"),
            (icp.ICP([[1.0]], [0.0], icp.Affine([[1.0]])), "psi moves too much"),
            (icp.ICP([[1.0, 2.0], [2.0, 1.0]], [0.0, 0.0]), "not proved to be an H"),
            (icp.ICP([[1.0, -1.0], [-1.0, 1.0]], [0.0, 0.0]), "not proved to be an H"),
        ],
    )
    def test_without_a_certificate_the_reason_is_given(self, problem, words):
        bound = icp.error_bound(problem, np.zeros(problem.n))
        assert bound.value is None
        import re

        assert re.search(words, bound.reason)

    def test_the_scaling_is_found_once_for_a_series(self):
        problem = icp.scenes.membrane(n=25).problem
        assert proofs_of(problem).h_plus is proofs_of(problem.with_q(np.ones(25))).h_plus
        assert proofs_of(problem).h_plus is not proofs_of(problem.with_psi(0.0)).h_plus
        assert proofs_of(problem).classes is proofs_of(problem.with_psi(0.0)).classes

    def test_a_proof_keeps_no_problem_alive(self):
        jumps = sp.csr_array(([-1.0], ([0], [1])), shape=(2, 2))
        problem = icp.ICP(np.eye(2), [-1.0, -1.0], icp.Intervention(jumps))
        assert icp.certify(problem, [0.0, 0.0]).unique
        gone = weakref.ref(problem), weakref.ref(problem.facts), weakref.ref(problem.matrix)
        del problem
        gc.collect()
        assert [one() for one in gone] == [None, None, None]


def curvature_of(padded, S):
    """(definite, semidefinite, semidefinite up to rounding), each a truth value."""
    S = as_csr(padded(S), "S", keep_diagonal=True)
    return *(answer.holds for answer in definiteness.definiteness(S)), classify(S).semidefinite_up_to_rounding.holds


def form(S, x):
    """xᵀSx in fractions."""
    S, x = np.asarray(S), [Fraction(entry) for entry in x]
    return sum(x[i] * x[j] * Fraction(float(S[i, j])) for i, j in zip(*np.nonzero(S), strict=True))


@pytest.fixture(params=[0, 40, 100], ids=["fractions", "dense", "sparse"])
def padded(request):
    """S with so many rows of the identity: up to 30 are decided by fractions, from 65 on sparse ones by SuperLU."""
    return lambda S: sp.block_diag([S, sp.eye_array(request.param)]).toarray()


class TestDefiniteness:
    """Decided by a factorisation alone, as for large n, and by what rational arithmetic adds for small n."""

    @settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(seed=st.integers(0, 10**9), shift=st.floats(-2, 6))
    def test_it_agrees_with_the_eigenvalues(self, padded, seed, shift):
        rng = np.random.default_rng(seed)
        S = rng.normal(size=(7, 7)) * (rng.random((7, 7)) < 0.5)
        S = S + S.T + shift * np.eye(7)
        smallest = np.linalg.eigvalsh(S)[0]
        if smallest > 1e-9:
            assert curvature_of(padded, S) == (True, True, True)
        elif smallest < -1e-9:
            assert curvature_of(padded, S)[:2] == (False, False)
            x = definiteness.definiteness(as_csr(padded(S), "S", keep_diagonal=True))[1].witness
            assert form(padded(S), x) < 0

    @settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(seed=st.integers(0, 10**9), n=st.integers(2, 12))
    def test_a_singular_matrix_is_never_called_definite(self, padded, seed, n):
        """A pivot is no eigenvalue: the last pivot of a graph Laplacian is far larger than its zero eigenvalue."""
        B = np.random.default_rng(seed).integers(-3, 4, size=(n, n - 1)).astype(float)
        definite, semidefinite, nearly = curvature_of(padded, B @ B.T)
        assert definite is not True
        assert semidefinite is not False
        assert nearly is True
        ring = 2 * np.eye(n) - np.roll(np.eye(n), 1, 0) - np.roll(np.eye(n), -1, 0)
        assert curvature_of(padded, ring) == (False, True, True)

    @settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(seed=st.integers(0, 10**9), decades=st.sampled_from([0, 30]))
    def test_a_gram_matrix_of_low_rank_is_semidefinite_up_to_rounding(self, padded, seed, decades):
        """What rounding makes of BᵀB may be definite: fractions see that."""
        rng = np.random.default_rng(seed)
        B = rng.normal(size=(3, 7)) * 10.0 ** rng.uniform(-decades, decades, 7)
        assert curvature_of(padded, B.T @ B)[2] is True
        assert len(padded(B)) <= 30 or curvature_of(padded, B.T @ B)[0] is not True

    def test_what_is_more_than_rounding_is_not_called_rounding(self, padded):
        for size in (1e-6, 1e-8):
            S = np.ones((3, 3)) - size * np.eye(3)
            assert curvature_of(padded, S)[0] is False
            assert curvature_of(padded, S)[2] is False

    @settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(seed=st.integers(0, 10**9), decades=st.sampled_from([0, 6, 30]))
    def test_the_sign_does_not_depend_on_the_units(self, padded, seed, decades):
        """Sylvester: DSD has the signs of S for every positive diagonal D."""
        rng = np.random.default_rng(seed)
        B = rng.integers(-2, 3, size=(5, 5)).astype(float)
        S = B + B.T
        d = 10.0 ** rng.uniform(-decades, decades, 5)
        scaled = S * np.outer(d, d)
        smallest = np.linalg.eigvalsh(S)[0]
        definite, semidefinite, nearly = curvature_of(padded, scaled)
        if smallest > 1e-9:
            assert definite is True
        elif smallest < -1e-9:
            assert semidefinite is False
            assert nearly is False
            assert (
                form(
                    padded(scaled),
                    definiteness.definiteness(as_csr(padded(scaled), "S", keep_diagonal=True))[1].witness,
                )
                < 0
            )
        else:
            assert nearly is True

    def test_large_rows_do_not_hide_a_small_indefinite_block(self, padded):
        S = sp.block_diag([[[1e20, 0.9e20], [0.9e20, 1e20]], [[1.0, 2.0], [2.0, 1.0]]])
        assert curvature_of(padded, S) == (False, False, False)

    @pytest.mark.parametrize("small", [0.0, 5e-324, 1e-308, 1e-200])
    def test_a_diagonal_that_is_next_to_nothing_is_no_excuse(self, padded, small):
        for S in ([[small, 1.0], [1.0, small]], [[small, 2.0], [2.0, 5.0]], [[5.0, 2.0], [2.0, small]]):
            assert curvature_of(padded, S)[1:] == (False, False)

    def test_beside_a_zero_on_the_diagonal_nothing_is_rounding(self, padded):
        S = np.eye(3) - np.diag([0.0, 0.0, 1.0])
        for size in (1e-13, 1e-30, 1e-100):
            S[0, 2] = S[2, 0] = size
            assert curvature_of(padded, S) == (False, False, False)

    def test_entries_that_overflow_in_the_units_of_the_diagonal(self, padded):
        """±1e200 beside a diagonal of 1e-300 cancel in the symmetric part; the indefinite block is elsewhere."""
        S = sp.block_diag([[[1e-300, 1e200], [-1e200, 1e-300]], [[1.0, 0.9, 0.9], [0.9, 1.0, -0.9], [0.9, -0.9, 1.0]]])
        assert curvature_of(padded, S) == (False, False, False)

    @pytest.mark.parametrize("sign", [1.0, -1.0])
    def test_an_eigenvalue_of_either_sign_in_units_of_all_sizes(self, padded, sign):
        """1 + 2c, 1 − c, 1 − c with c = ∓.9 or ±.4, scaled by 10^±100, among 40 other rows."""
        c = 0.4 if sign > 0 else 0.9
        B = np.eye(43)
        B[:3, :3] = [[1, c, c], [c, 1, -c], [c, -c, 1]]
        for seed in range(5):
            d = 10.0 ** np.random.default_rng(seed).uniform(-100, 100, 43)
            S = np.outer(d, d) * B
            assert curvature_of(padded, S)[0] is (sign > 0)
            if sign < 0:
                assert (
                    form(padded(S), definiteness.definiteness(as_csr(padded(S), "S", keep_diagonal=True))[1].witness)
                    < 0
                )

    def test_a_normal_diagonal_beside_one_next_to_nothing(self, padded):
        S = np.array([[2.3e-308, 1.1, 0.0], [1.1, 2.3e-308, 0.7], [0.0, 0.7, 1.0]])
        assert curvature_of(padded, S) == (False, False, False)

    def test_an_inexact_sum_is_not_used(self, padded):
        """A + Aᵀ has the entry −2 − 2⁻⁶⁰ beside a diagonal of 2: indefinite, which its rounding to −2 is not."""
        assert curvature_of(padded, [[1.0, -2.0], [-(2.0**-60), 1.0]])[1] is not True

    def test_a_hidden_negative_direction_is_found(self, padded):
        S = np.array([[1.0, 0.9, 0.9], [0.9, 1.0, -0.9], [0.9, -0.9, 1.0]])
        assert curvature_of(padded, S) == (False, False, False)

    def test_one_unit_in_the_last_place_is_left_open_or_decided_right(self, padded):
        """[1, 1; 1, 1 + 2u] is definite, [1, 1; 1, 1 − u] is not: floats cannot tell, fractions do."""
        above, below = np.array([[1.0, 1.0], [1.0, 1 + 2.0**-52]]), np.array([[1.0, 1.0], [1.0, 1 - 2.0**-53]])
        for S, true in ((above, True), (below, False)):
            assert curvature_of(padded, S)[0] in ({true} if len(padded(S)) <= 30 else {true, None})
            assert curvature_of(padded, S)[2] is True

    def test_a_skew_part_does_not_matter(self, padded):
        K = np.array([[0.0, 50.0, -3.0], [-50.0, 0.0, 7.0], [3.0, -7.0, 0.0]])
        S = np.array([[2.0, 1.9, 0.0], [1.9, 2.0, 0.5], [0.0, 0.5, 3.0]])
        assert curvature_of(padded, S + K) == (True, True, True)
        assert curvature_of(padded, S - 0.2 * np.eye(3) + K) == (False, False, False)


class TestFactorisations:
    def test_pivots_off_the_diagonal_prove_nothing(self, padded):
        """[0, 1; 1, 0] = P·I: the pivots are 1, the eigenvalues ±1."""
        assert eigenvalue.above(sp.csr_array(padded([[0.0, 1.0], [1.0, 0.0]])), 0.0) == -np.inf

    def test_a_factor_with_nan_proves_nothing(self):
        """LAPACK runs on where a pivot is NaN, which entries that overflow may become."""
        assert not eigenvalue.above(sp.csr_array(np.diag([1.0, np.nan])), 0.0) > -np.inf
        assert eigenvalue.smallest_below(sp.csr_array(np.diag([1.0, np.inf]))) == -np.inf

    def test_products_that_overflow_prove_nothing(self):
        problem = icp.ICP([[1.0, 1e200], [1e200, 1.0]], [0.0, 0.0], icp.Affine([[0.0, 1e200], [1e200, 0.0]]))
        assert isinstance(proofs_of(problem).definite, str)

    def test_the_form_of_a_null_vector_is_not_called_negative(self):
        """Its floats are of either sign."""
        negative = 0
        for seed in range(200):
            B = np.random.default_rng(seed).integers(-9, 10, size=(5, 4)) / 8.0
            S, x = B @ B.T, np.linalg.svd(B.T)[2][-1]
            negative += x @ (S @ x) < 0
            assert not definiteness.proves_negative(sp.csr_array(S), x)
        assert negative > 10

    def test_a_shift_below_rounding_is_raised(self):
        """n = 400, dense, λ_min = 1e-7: the backward error, about 1e-11, is above the first shift."""
        rng = np.random.default_rng(0)
        Q, _ = np.linalg.qr(rng.normal(size=(400, 400)))
        S = (Q * np.r_[1e-7, rng.uniform(0.5, 1.5, 399)]) @ Q.T
        assert definiteness.definiteness(as_csr(S, "S"))[0].holds is True

    def test_only_a_bound_of_the_size_of_rounding_is_called_rounding(self):
        S = as_csr(np.ones((3, 3)), "S")
        assert definiteness.semidefinite_up_to_rounding(S).holds is True
        assert definiteness.semidefinite_up_to_rounding(S, most=1e-17).holds is None


class TestDefinitenessOfLargeMatrices:
    @pytest.mark.parametrize("sign", [1.0, -1.0])
    def test_a_grid_that_is_not_dominant(self, sign):
        """(L − λ₁I)² ± 1e-3 I, L the five-point matrix: both answers by one sparse factorisation or two."""
        L = icp.scenes.membrane(n=1600).problem.A
        smallest = 8 * np.sin(np.pi / 82) ** 2 * (L.diagonal()[0] / 4)
        M = L - smallest * sp.eye_array(1600)
        found = classify(M @ M + sign * 1e-3 * sp.eye_array(1600))
        assert found.definite.holds is (sign > 0)
        assert found.semidefinite.holds is (sign > 0)
        if sign < 0:
            x = found.semidefinite.witness
            assert x @ (found.A @ x) < 0

    def test_dominance_needs_no_factorisation(self):
        A = icp.scenes.bai_nonsymmetric(n=90_000, mu=0).problem.A
        found = classify(A).definite
        assert found.holds is True
        assert "diagonally dominant" in found.reason

    def test_beyond_the_limit_the_answer_is_unknown_and_says_so(self):
        """Neighbours at random: no order of the rows makes a narrow band of them."""
        n = 20_000
        rows, columns = np.random.default_rng(0).integers(0, n, size=(2, 4 * n))
        S = sp.csr_array((np.full(4 * n, 0.5), (rows, columns)), shape=(n, n))
        S = sp.csr_array(S + S.T + 3 * sp.eye_array(n))
        found = classify(S)
        assert [found.definite.holds, found.semidefinite.holds, found.semidefinite_up_to_rounding.holds] == [None] * 3
        assert "too large" in found.definite.reason
        assert "too large" in proofs_of(icp.ICP(S, np.zeros(n))).definite
        assert check("definite", icp.ICP(S, np.zeros(n)), icp.MNMOD()).number is None

    def test_a_narrow_band_is_factorised_at_any_size(self):
        """Pentadiagonal, not dominant, its rows in disorder."""
        n = 30_000
        band = sp.diags_array([-np.ones(n - 2), -np.ones(n - 1), 3.0 + 3e-6 * np.ones(n)], offsets=[-2, -1, 0])
        order = np.random.default_rng(0).permutation(n)
        A = sp.csr_array(sp.csr_array(band @ band.T)[order][:, order])
        assert classify(A).definite.holds is True
