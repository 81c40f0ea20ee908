"""The a-priori theorems as checks: true where they say yes, right by name on the counterexamples, rounding included."""

import itertools
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel.numerics.arrays import as_csr
from icpmodel.numerics.rational import curvature, rationals
from icpmodel.theory.convergence.conditions import StepMatrices, theorem_43
from icpmodel.theory.convergence.contraction import Comparison, MonotoneMap, absolute_inverse, radius
from icpmodel.theory.convergence.rates import Rate, predicted_rate
from icpmodel.theory.convergence.structural import contraction_factor
from icpmodel.theory.convergence.theorems import check, check_all, holding, theorems

BY_NORM = ("4.3", "4.4", "4.2", "4.1", "sharper")


def random_member(rng, A):
    """Any member of the family, with options of every sign that it takes."""
    n, d = A.shape[0], np.abs(np.diag(A))
    phi = rng.choice([0, 1, 1]) * rng.normal(size=n) * rng.choice([0.1, 1, 3]) * d
    phi = np.abs(phi) if rng.random() < 0.3 else phi
    phi1 = 10.0 ** rng.uniform(-1, 1, n)
    phi2 = phi1 * d * (1.0 if rng.random() < 0.3 else 10.0 ** rng.uniform(-0.5, 0.7, n))
    theta1 = rng.choice([1.0, rng.uniform(0.3, 1.6)])
    theta2 = rng.choice([theta1, rng.uniform(-1, 2.2), 1.0, 0.0])
    free = {"phi": phi, "phi1": phi1, "phi2": phi2}
    M1 = A * (rng.random((n, n)) < 0.6) + np.diag(rng.normal(size=n) * 0.2 + np.diag(A))
    makers = (
        lambda: icp.MNMOD(phi=phi),
        lambda: icp.MNMMOD(phi=phi, theta1=10.0 ** rng.uniform(-1, 1)),
        lambda: icp.MNMAOR(theta1=theta1, theta2=theta2, **free),
        lambda: icp.MNMAOR(theta1=theta1, theta2=theta2, phi=0.2 * np.abs(phi)),
        lambda: icp.MNMSOR(theta1=theta1, **free),
        lambda: icp.MNMGS(**free),
        lambda: icp.MNMJ(**free),
        lambda: icp.NMMS(splitting=icp.AOR(theta1, theta2), omega=phi2 / phi1),
        lambda: icp.Modulus(splitting=M1, **free),
        lambda: icp.Modulus(splitting="whole", **free),
        lambda: icp.ProjectionFixedPoint(omega=rng.uniform(0.3, 1.5)),
    )
    return makers[rng.integers(len(makers))]()


def random_case(seed):
    """(problem, z*, member, A, Γ), ψ(z) = Γz + c with Γ of any sign, n ≤ 4; many at the border of the theorems."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))
    off = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.7)
    np.fill_diagonal(off, 0.0)
    off = -np.abs(off) if rng.random() < 0.4 else off
    d = np.abs(off).sum(axis=1) * rng.uniform(0.8, 3) + rng.uniform(0.05, 1, n)
    d = d * rng.choice([-1, 1], n) if rng.random() < 0.08 else d
    A = off + np.diag(d)
    slope = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.6) * rng.choice([0, 0.1, 0.3, 0.6]) / n
    if rng.random() < 0.6:
        rows, columns = 10.0 ** rng.uniform(-2, 2, n), 10.0 ** rng.uniform(-2, 2, n)
        A, slope = rows[:, None] * A * columns, slope * columns / columns[:, None]
    z, active = rng.normal(size=n), rng.random(n) < 0.5
    p = np.where(active, rng.random(n) * np.abs(np.diag(A)), 0.0)
    c = z - np.where(active, 0.0, rng.random(n)) - slope @ z
    problem = icp.ICP(A, p - A @ z, icp.Affine(slope, c) if slope.any() else c)
    return problem, z, random_member(rng, A), A, slope


def matrices(problem, member):
    """(M̂, Ω, X), dense."""
    omega = member.omega_of(problem)
    M = member.splitting_of().matrix(problem.A).toarray() + np.diag(np.broadcast_to(member.phi, problem.n))
    return M, omega, M + np.diag(omega)


def worst_error_matrix(problem, member, A, slope, rng):
    """The largest ρ(I − 2X⁻¹(ΘA + (I − Θ)Ω(I − Γ))) over the corners Θ and some more, and some |Γ| ≤ G."""
    (_, omega, X), n = matrices(problem, member), problem.n
    inverse = np.linalg.inv(X)
    thetas = [np.array(corner, dtype=float) for corner in itertools.product([0, 1], repeat=n)]
    thetas += [rng.random(n) for _ in range(5)]
    stack = [
        np.eye(n) - 2 * inverse @ (t[:, None] * A + ((1 - t) * omega)[:, None] * (np.eye(n) - g))
        for t in thetas
        for g in (slope, -slope, np.abs(slope) * np.sign(rng.normal(size=(n, n))))
    ]
    return np.abs(np.linalg.eigvals(np.array(stack))).max()


def spectral_radius(M):
    return np.abs(np.linalg.eigvals(M)).max()


class TestEveryTheoremIsTrue:
    @pytest.mark.parametrize("block", range(5))
    def test_where_one_holds_every_error_matrix_contracts_and_the_iterates_obey_the_rate(self, block):
        counted = dict.fromkeys(theorems(), 0)
        del counted["rowwise"], counted["h-plus"]  # of the other degree of implicitness: test_theory_rowwise.py
        for seed in range(500 * block, 500 * (block + 1)):
            problem, exact, member, A, slope = random_case(seed)
            found = check_all(problem, member)
            for name in counted:
                counted[name] += found[name].holds is True
            # what the proofs say of one another
            for stronger, weaker in (("4.3", "4.2"), ("4.2", "4.1"), ("4.4", "4.1"), ("4.1", "sharper")):
                assert not found[stronger].holds or found[weaker].holds, (seed, stronger)
            if not any(found[name].holds for name in (*BY_NORM, "definite")):
                continue
            rng = np.random.default_rng(seed)
            assert worst_error_matrix(problem, member, A, slope, rng) < 1 + 1e-9, (seed, member)
            if not found["sharper"].holds:
                continue
            path = member.iterates(problem, exact + rng.normal(size=problem.n) * 10.0 ** rng.uniform(-2, 2))
            iterates = np.array([next(path)[0] for _ in range(25)])
            for name in BY_NORM:
                if found[name].holds:
                    v = found[name].vector
                    size = (np.abs(iterates - exact) / v).max(axis=1)
                    rounding = 1e-12 * (size[0] + ((1 + np.abs(exact)) / v).max())
                    assert (size[1:] <= size[:-1] + rounding).all(), (seed, name)
                    if name == "sharper":
                        assert (size[1:] <= found[name].number * size[:-1] + rounding).all(), seed
        assert min(counted.values()) >= 10, counted

    def test_those_that_hold_are_the_same_where_their_numbers_are_not_asked_for(self):
        of_the_paper = ("4.1", "4.2", "4.3", "4.4")
        for seed in range(7000, 7060):
            problem, _, member, *_ = random_case(seed)
            corrected = {name for name, found in check_all(problem, member).items() if found.holds}
            printed = {name for name in of_the_paper if check(name, problem, member, as_printed=True).holds}
            assert holding(problem, member, theorems(), of_the_paper) == (corrected, printed), seed

    def test_the_radius_is_right_on_both_sides(self):
        """ρ(L) of Theorem 4.1 from eigenvalues: the answer is never wrong, the number never below, and close."""
        decided = 0
        for seed in range(5000, 5600):
            problem, _, member, A, slope = random_case(seed)
            M, omega, X = matrices(problem, member)
            if not (omega > 0).all() or np.linalg.cond(X) > 1e10:
                continue
            F = np.abs(M - A) + np.abs(A - np.diag(omega)) + 2 * omega[:, None] * np.abs(slope)
            rho = spectral_radius(np.abs(np.linalg.inv(X)) @ F)
            found = check("4.1", problem, member)
            if abs(rho - 1) > 1e-6:
                assert found.holds is bool(rho < 1), (seed, rho)
                decided += 1
            assert found.number >= rho * (1 - 1e-9)
            assert found.number <= rho + 0.05 * max(abs(1 - rho), 0.2 * rho)
        assert decided >= 500

    def test_the_error_after_k_steps_is_bounded_by_the_first_step(self):
        """|zᵏ − z*| ≤ Lᵏ(I − L)⁻¹|z¹ − z⁰| wherever 4.1 is said to hold."""
        held = 0
        for seed in range(6000, 6300):
            problem, exact, member, A, slope = random_case(seed)
            if not check("4.1", problem, member).holds:
                continue
            held += 1
            M, omega, X = matrices(problem, member)
            F = np.abs(M - A) + np.abs(A - np.diag(omega)) + 2 * omega[:, None] * np.abs(slope)
            L = np.abs(np.linalg.inv(X)) @ F
            path = member.iterates(problem, exact + np.random.default_rng(seed).normal(size=problem.n))
            z = [next(path)[0] for _ in range(8)]
            bound = np.linalg.solve(np.eye(problem.n) - L, np.abs(z[1] - z[0]))
            for iterate in z:
                assert (np.abs(iterate - exact) <= bound * (1 + 1e-7) + 1e-11 * (1 + np.abs(exact).max())).all(), seed
                bound = L @ bound
        assert held >= 100


class TestCounterexamples:
    """By name: the printed statement says one thing, the corrected one another."""

    def test_41_the_componentwise_decrease(self):
        A = np.array([[2.0, -1.0], [-0.5, 2.0]])
        problem = icp.ICP(A, -A @ np.ones(2))
        printed, corrected = (check("4.1", problem, icp.MNMGS(), as_printed=flag) for flag in (True, False))
        assert printed.holds is corrected.holds is True
        assert corrected.number == pytest.approx(0.283, abs=5e-4)
        assert "decrease" in printed.false_as_printed
        assert "< |zᵏ − z*|" in printed.sentence
        assert "< |zᵏ − z*|" not in corrected.sentence
        path = icp.MNMGS().iterates(problem, np.array([1.0, 3.0]))
        errors = [np.abs(next(path)[0] - 1.0) for _ in range(2)]
        assert errors[1][0] > errors[0][0]
        # the decrease that is true
        v = corrected.vector
        assert (errors[1] / v).max() <= corrected.number * (errors[0] / v).max()

    @pytest.mark.parametrize(
        ("problem", "member", "words"),
        [
            (
                icp.ICP([[0.1]], [1.0], icp.Affine([[-5.0]], 6.0)),
                icp.MNMGS(phi1=1.0, phi2=0.1),
                "at least 1, and at most 5",
            ),
            (icp.ICP([[1.0]], [-1.0]), icp.MNMGS(phi=-1.5), "phi has the negative entry -1.5"),
            (
                icp.ICP([[1.0, -0.5], [-0.5, 1.0]], [-0.5, -0.5]),
                icp.MNMAOR(theta1=1.0, theta2=-4.0),
                "theta2 = -4 is negative",
            ),
        ],
        ids=["(a) the parenthesis", "(b) phi < 0", "(c) theta2 < 0"],
    )
    def test_43_as_printed_is_false(self, problem, member, words):
        printed, corrected = check("4.3", problem, member, as_printed=True), check("4.3", problem, member)
        assert printed.holds is True
        assert printed.false_as_printed
        assert corrected.holds is False
        assert words in corrected.reason
        assert check("sharper", problem, member).holds is not True  # the method does not converge

    def test_43_numbers_of_the_parenthesis(self):
        problem, member = icp.ICP([[0.1]], [1.0], icp.Affine([[-5.0]], 6.0)), icp.MNMGS(phi1=1.0, phi2=0.1)
        assert check("4.3", problem, member, as_printed=True).number == pytest.approx(0.5)
        assert check("4.3", problem, member).number == pytest.approx(5.0)

    def test_44_case_one_as_printed_is_false(self):
        problem = icp.ICP([[1.0]], [5.0], icp.Affine([[-0.9]], 1.9))
        member = icp.Modulus(splitting=[[0.1]], phi=0.5, phi1=0.1, phi2=0.1)
        printed, corrected = check("4.4", problem, member, as_printed=True), check("4.4", problem, member)
        assert printed.holds is True
        assert "case (1)" in printed.false_as_printed
        assert corrected.holds is False
        assert printed.number == pytest.approx(0.5 / 0.51)  # 1 - .01/.51
        assert corrected.number == pytest.approx(0.13 / 0.06)  # 1 + .07/.06
        assert check("sharper", problem, member).holds is False

    def test_44_case_two_as_printed(self):
        """φ₁ = I: then the printed case (2) is right, and says what the corrected theorem says."""
        A = [[4.0, -1.0], [1.0, 4.0]]
        member = icp.MNMGS(phi2=3.5)
        for flag in (True, False):
            assert check("4.4", icp.ICP(A, [0.0, 0.0]), member, as_printed=flag).holds
            assert not check("4.4", icp.ICP(A, [0.0, 0.0]), icp.MNMGS(phi2=0.9), as_printed=flag).holds
        mixed = check("4.4", icp.ICP(A, [0.0, 0.0]), icp.MNMGS(phi2=[3.5, 5.0]), as_printed=True)
        assert mixed.holds is False
        assert "neither" in mixed.reason
        assert check("4.4", icp.ICP(A, [0.0, 0.0]), icp.MNMGS(phi2=[3.5, 5.0])).holds

    def test_44_needs_a_positive_diagonal(self):
        """A = M₁ = −1, Ω = 1: (⟨M̂⟩ − |N̂| + min(Ω, D) − D)v = v > 0, yet X = 0."""
        found = check("4.4", icp.ICP([[-1.0]], [0.0]), icp.Modulus(splitting="whole", phi2=1.0))
        assert found.holds is False
        assert "A[0, 0] = -1 is not positive" in found.reason
        assert "singular" in check("4.1", icp.ICP([[-1.0]], [0.0]), icp.Modulus(splitting="whole", phi2=1.0)).reason

    def test_where_splittings_differ(self):
        scene = icp.scenes.hand_splittings()
        assert check("sharper", scene.problem, icp.MNMJ()).holds is True
        assert check("sharper", scene.problem, icp.MNMJ()).number == pytest.approx(0.9)
        for member in (icp.MNMJ(), icp.MNMGS(), icp.MNMOD()):
            assert check("4.1", scene.problem, member).holds is False
        assert check("4.3", scene.problem, icp.MNMJ()).number == pytest.approx(1.8)
        for member in (icp.MNMGS(), icp.MNMOD()):
            assert check("sharper", scene.problem, member).holds is False

    def test_monotone_on_the_dividend_scene(self):
        """φ ≥ |D − Ω|: Ω = .25D fails with φ = 0 and holds with φ = .75D; no other theorem can speak."""
        problem = icp.scenes.dividend(n=31).problem
        D = problem.A.diagonal()
        bare, shifted = icp.MNMJ(phi2=0.25 * D), icp.MNMJ(phi2=0.25 * D, phi=0.75 * D)
        assert check("monotone", problem, bare).holds is False
        assert "phi >= |D - Omega|" in check("monotone", problem, bare).reason
        assert check("monotone", problem, shifted).holds is True
        assert check("monotone", problem, icp.MNMJ(phi2=0.3 * D, phi=np.abs(D - 0.3 * D))).holds is True
        for name in BY_NORM:
            assert check(name, problem, shifted).holds is None

    @pytest.mark.parametrize("member", [icp.MNMGS(), icp.MNMJ(), icp.MNMSOR(theta1=0.5), icp.MNMMOD(theta1=2.0)])
    def test_on_the_cyclic_p_matrix_nothing_holds(self, member):
        problem = icp.scenes.hand_cyclic().problem
        assert not any(found.holds for found in check_all(problem, member).values())
        assert all(check(name, problem, member).holds is False for name in BY_NORM)

    @pytest.mark.parametrize(
        "member", [icp.MNMOD(), icp.MNMMOD(theta1=9.0), icp.MNMJ(), icp.MNMGS(), icp.MNMSOR(theta1=0.8)], ids=repr
    )
    def test_42_as_printed_holds_for_nonzero_g_almost_never(self, member):
        """The bounds on g_ij force G = 0; the useful form takes a small G of any pattern."""
        A = np.array([[1.0, -0.2, 0.1], [0.1, 1.0, 0.3], [-0.2, 0.1, 1.0]])
        for entry in itertools.product(range(3), repeat=2):
            G = np.zeros((3, 3))
            G[entry] = 1e-6
            problem = icp.ICP(A, np.zeros(3), icp.Affine(G))
            printed = check("4.2", problem, member, as_printed=True)
            assert printed.holds is False
            assert f"g[{entry[0]}, {entry[1]}] = 1e-06" in printed.reason
            assert printed.false_as_printed == ""
            if not isinstance(member, icp.MNMOD):  # there |N| + |A| counts A twice, and Ω is not D
                assert check("4.2", problem, member).holds is True
        assert check("4.2", icp.ICP(A, np.zeros(3)), member, as_printed=True).holds is True

    def test_42_as_printed_is_true(self):
        """Where the printed hypotheses hold so do the corrected ones (random cases, θ₂ > θ₁ lets G be nonzero)."""
        held = 0
        for seed in range(400):
            rng = np.random.default_rng(seed)
            A = rng.normal(size=(3, 3)) * 0.3
            A += np.diag(np.abs(A).sum(axis=1) + 0.5)
            G = np.tril(np.abs(rng.normal(size=(3, 3))) * 0.05, -1) * (seed % 2)
            problem = icp.ICP(A, np.zeros(3), icp.Affine(G) if G.any() else 0.0)
            member = icp.MNMAOR(theta1=rng.uniform(0.6, 1.1), theta2=rng.uniform(0.5, 1.5), phi=rng.normal() * 0.2)
            if check("4.2", problem, member, as_printed=True).holds:
                held += 1
                assert check("4.2", problem, member).holds
        assert held >= 40


class TestMonotone:
    def test_where_it_holds_the_step_is_isotone(self):
        held = dict.fromkeys(range(3), 0)
        for seed in range(600):
            rng = np.random.default_rng(seed)
            n, kind = 4, seed % 3
            A = -np.abs(rng.normal(size=(n, n))) * (rng.random((n, n)) < 0.6)
            np.fill_diagonal(A, rng.uniform(0.3, 4, n))
            jumps = sp.csr_array(rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.5))
            psi = (icp.Intervention(jumps, best="min"), icp.Affine(np.abs(rng.normal(size=(n, n)))), rng.normal(size=n))
            problem = icp.ICP(A, rng.normal(size=n), psi[kind])
            omega = np.diag(A) * 10.0 ** rng.uniform(-1, 1, n)
            phi = np.abs(np.diag(A) - omega) * rng.choice([0.8, 1.0, 1.5])
            member = rng.choice(
                [icp.MNMJ(phi2=omega, phi=phi), icp.ProjectionFixedPoint(omega=rng.uniform(0.5, 1.4)), icp.MNMGS()]
            )
            if not check("monotone", problem, member).holds:
                continue
            held[kind] += 1
            for _ in range(20):
                x = rng.normal(size=n) * 3
                y = x + rng.random(n) * (rng.random(n) < 0.5) * 3
                low, high = ([*itertools.islice(member.iterates(problem, s), 2)][1][0] for s in (x, y))
                assert (low <= high + 1e-12).all(), seed
        assert min(held.values()) >= 50

    def test_from_a_supersolution_the_iterates_go_down_to_the_solution(self):
        problem = icp.scenes.dividend(n=31).problem
        D = problem.A.diagonal()
        member = icp.MNMJ(phi2=0.25 * D, phi=0.75 * D)
        above = 6.0 + 2.0 * np.linspace(0, 1.5, 31)
        assert (problem.natural_map(above) >= 0).all()
        previous = above
        for z, _ in itertools.islice(member.iterates(problem, above), 3000):
            assert (z <= previous + 1e-12).all()
            previous = z

    @pytest.mark.parametrize(
        ("problem", "member", "holds"),
        [
            (icp.ICP([[1.0, 0.5], [0.0, 1.0]], [0.0, 0.0]), icp.MNMJ(), False),
            (icp.ICP([[1.0, 0.0], [-0.5, 1.0]], [0.0, 0.0]), icp.MNMGS(), False),
            (icp.ICP([[1.0]], [0.0], icp.Affine([[-0.1]])), icp.MNMJ(), False),
            (icp.ICP([[1.0]], [0.0], np.sin), icp.MNMJ(), None),
            (icp.ICP([[1.0]], [0.0]), icp.ProjectionFixedPoint(omega=1.2), False),
            (icp.ICP([[1.0]], [0.0]), icp.ProjectionFixedPoint(omega=0.8), True),
        ],
    )
    def test_each_hypothesis_is_asked_for(self, problem, member, holds):
        assert check("monotone", problem, member).holds is holds


def contraction_of(A, omega):
    """‖(A' − I)(A' + I)⁻¹‖₂, A' = Ω^(−½)AΩ^(−½), in floats."""
    root, identity = np.sqrt(omega), np.eye(len(A))
    scaled = A / root[:, None] / root
    return np.linalg.norm((scaled - identity) @ np.linalg.inv(scaled + identity), 2)


def proves_contraction(A, omega, sigma):
    """Whether ‖(A' − I)(A' + I)⁻¹‖₂ ≤ σ, in fractions."""
    M, W, n, tau = rationals(A), [Fraction(float(w)) for w in omega], len(A), (1 - sigma**2) / 4
    X = [[M[i][j] + (W[i] if i == j else 0) for j in range(n)] for i in range(n)]
    S = [
        [(M[i][j] + M[j][i]) / 2 - tau * sum(X[k][i] * X[k][j] / W[k] for k in range(n)) for j in range(n)]
        for i in range(n)
    ]
    return curvature(S)[0]


class TestDefinite:
    def test_the_number_is_a_rate_for_every_positive_diagonal_omega(self):
        """‖y⁺‖₂ ≤ σ‖y‖₂ for y = (A' − I)Ω^½(z − z*), A' = Ω^(−½)AΩ^(−½); A symmetric or not, free rows included."""
        for seed in range(300):
            rng = np.random.default_rng(seed)
            n = int(rng.integers(1, 6))
            B, K = rng.normal(size=(n, n)), rng.normal(size=(n, n)) * rng.choice([0, 1, 3])
            A = B @ B.T + rng.choice([0.01, 0.5]) * np.eye(n) + K - K.T
            omega = np.full(n, 10.0 ** rng.uniform(-1, 1)) if seed % 2 else 10.0 ** rng.uniform(-1, 1, n)
            z, active = rng.normal(size=n), rng.random(n) < 0.5
            p, c = np.where(active, rng.random(n), 0.0), z - np.where(active, 0.0, rng.random(n))
            c[~active & (rng.random(n) < 0.3)] = -np.inf
            problem, member = icp.ICP(A, p - A @ z, c), icp.Modulus(splitting="whole", phi2=omega)
            found = check("definite", problem, member)
            assert found.holds is True
            root = np.sqrt(omega)
            scaled = A / root[:, None] / root
            sigma = np.linalg.norm((scaled - np.eye(n)) @ np.linalg.inv(scaled + np.eye(n)), 2)
            assert sigma - 1e-15 <= found.number <= sigma + 1e-9
            path = member.iterates(problem, z + rng.normal(size=n))
            y = [(scaled - np.eye(n)) @ (root * (next(path)[0] - z)) for _ in range(10)]
            sizes = np.linalg.norm(y, axis=1)
            assert (sizes[1:] <= found.number * sizes[:-1] + 1e-12 * (1 + sizes[0])).all()

    @pytest.mark.parametrize("kind", ["symmetric", "nearly skew", "small", "near the largest", "random"])
    def test_sigma_is_proved_and_sharp_in_rational_arithmetic(self, kind):
        """σ² ≥ 1 − 4τ is Ω^½(H − τKᵀK)Ω^½ = (A + Aᵀ)/2 − τ(A + Ω)ᵀΩ⁻¹(A + Ω) ≥ 0, free of roots."""
        for seed in range(40):
            rng = np.random.default_rng(seed)
            n = int(rng.integers(1, 6))
            B, K = rng.normal(size=(n, n)), rng.normal(size=(n, n))
            omega = 10.0 ** rng.uniform(-0.5, 0.5, n)
            A = {
                "symmetric": B @ B.T + 1e-3 * np.eye(n),
                "nearly skew": 10.0 ** rng.uniform(-9, -3) * np.eye(n) + K - K.T,
                "small": 1e-6 * (B @ B.T + np.eye(n) + K - K.T),
                "near the largest": np.diag(omega) * (1 + 1e-9 * rng.normal(size=n)),
                "random": B @ B.T + 10.0 ** rng.uniform(-6, 0) * np.eye(n) + 10.0 ** rng.uniform(-2, 4) * (K - K.T),
            }[kind]
            found = check("definite", icp.ICP(A, np.zeros(n)), icp.Modulus(splitting="whole", phi2=omega))
            assert found.holds is True, seed
            if found.number is None:  # σ is 1 to all digits
                assert kind == "random"
                continue
            true = contraction_of(A, omega)
            if 1 - true > 1e-9:
                assert 1 - found.number >= (1 - 1e-3) * (1 - true) - 1e-15, (seed, found.number, true)
            assert found.number < 1
            assert proves_contraction(A, omega, Fraction(found.number)), (seed, found.number, true)
            if true > 0.1 and 1 - true > 1e-9:
                assert not proves_contraction(A, omega, Fraction(found.number - 1e-3 * (1 - found.number) - 1e-14))

    @pytest.mark.parametrize("way", ["quotient", "eigenvalues"])
    @pytest.mark.parametrize("symmetric", [True, False])
    def test_both_ways_to_sigma_by_sparse_factorisations(self, way, symmetric):
        """Sharp but for the eigenvalues of a nonsymmetric A, which give a bound; 60 rows ωI more change nothing."""
        work = 10**9 if way == "quotient" else 0

        def sigma(A, omega):
            A = sp.block_diag([A, omega * np.eye(60)])
            return contraction_factor(StepMatrices(icp.ICP(A, np.zeros(A.shape[0])), icp.MNMMOD(theta1=omega)), work)

        for seed in range(20):
            rng = np.random.default_rng(seed)
            n, omega = int(rng.integers(5, 20)), 10.0 ** rng.uniform(-0.5, 0.5)
            B = -rng.random((n, n)) * (rng.random((n, n)) < 0.3)
            A = -B - B.T if symmetric else B * rng.choice([-1.0, 1.0], size=(n, n)) * 2
            A += (10.0 ** rng.uniform(-3, 0) - np.linalg.eigvalsh((A + A.T) / 2)[0]) * np.eye(n)
            found, true = sigma(A, omega), contraction_of(A, np.full(n, omega))
            assert true - 1e-15 <= found < 1
            assert proves_contraction(A, np.full(n, omega), Fraction(found))
            if way == "quotient":
                assert 1 - found >= (1 - 2e-3) * (1 - true), seed
            elif symmetric:
                assert 1 - found >= 0.95 * (1 - true), seed
        turn = np.eye(5) + 1e-3 * (np.eye(5, k=1) - np.eye(5, k=-1))
        assert sigma(turn, 1.0) < 0.2

    @pytest.mark.parametrize(
        ("A", "psi", "member", "holds"),
        [
            ([[1.0, 3.0], [0.0, 1.0]], 0.0, icp.MNMOD(), False),
            ([[1.0, 1.0], [-1.0, 1.0]], 0.0, icp.MNMOD(), True),
            ([[1.0, 1.0], [1.0, 1.0]], 0.0, icp.MNMOD(), False),
            ([[2.0, 1.0], [1.0, 2.0]], icp.Affine([[0.0, 0.1], [0.0, 0.0]]), icp.MNMOD(), False),
            ([[2.0, 1.0], [1.0, 2.0]], 0.0, icp.MNMOD(phi=0.1), False),
            ([[2.0, 1.0], [1.0, 2.0]], 0.0, icp.MNMGS(), False),
        ],
    )
    def test_each_hypothesis_is_asked_for(self, A, psi, member, holds):
        assert check("definite", icp.ICP(A, [0.0, 0.0], psi), member).holds is holds


class TestRounding:
    def test_the_absolute_inverse_encloses_the_exact_one(self):
        """Integer matrices in exact rational arithmetic; units may be anything."""
        kinds = set()
        for seed in range(400):
            rng = np.random.default_rng(seed)
            n = int(rng.integers(1, 4))
            X = rng.integers(-4, 5, size=(n, n)).astype(float)
            if seed % 4 == 0:
                X = np.tril(X)
            if seed % 4 == 1:
                X = -np.abs(X)
            X[np.diag_indices(n)] = rng.choice([-1, 1] if seed % 4 != 1 else [1], n) * rng.integers(1, 12, size=n)
            rows = 2.0 ** rng.integers(-300, 300, size=n) if seed % 3 == 0 else np.ones(n)
            X = rows[:, None] * X
            exact = exact_inverse(X)
            if exact is None:
                continue
            w = rng.integers(1, 5, size=n) * rows
            inverse = absolute_inverse(as_csr(X, "X", keep_diagonal=True))
            above, below = inverse.upper(w), inverse.lower(w)
            true = [sum(abs(entry) * Fraction(value) for entry, value in zip(row, w, strict=True)) for row in exact]
            for low, value, high in zip(below, true, above, strict=True):
                assert Fraction(low) <= value
                assert not np.isfinite(high) or value <= Fraction(high)
                if inverse.exact and np.isfinite(high):
                    assert float(value) * (1 - 1e-9) <= low
                    assert high <= float(value) * (1 + 1e-9)
            kinds.add((type(inverse).__name__, inverse.exact))
        assert {("Comparison", True), ("Dense", True)} <= kinds

    @pytest.mark.parametrize("kind", ["any signs", "M"])
    def test_nearly_singular_floats_are_enclosed(self, kind):
        """Condition numbers up to 1e9, where a computed inverse without its error bound is wrong."""
        enclosed = 0
        for seed in range(60):
            rng = np.random.default_rng(seed)
            X = rng.normal(size=(3, 3))
            X[2] = X[0] + X[1] + 10.0 ** rng.uniform(-9, -1) * rng.normal(size=3)
            if kind == "M":
                X = -np.abs(X)
                X[np.diag_indices(3)] = 0.0
                X[np.diag_indices(3)] = -X.sum(axis=1) + 10.0 ** rng.uniform(-9, -1, 3)
            exact, w = exact_inverse(X), rng.random(3)
            inverse = absolute_inverse(sp.csr_array(X))
            above, below = inverse.upper(w), inverse.lower(w)
            for low, row, high in zip(below, exact, above, strict=True):
                value = sum(abs(entry) * Fraction(x) for entry, x in zip(row, w, strict=True))
                assert Fraction(low) <= value
                assert not np.isfinite(high) or value <= Fraction(high)
            enclosed += np.isfinite(above).all()
        assert enclosed >= 50

    def test_a_lower_bound_survives_zeros_of_w(self):
        X = sp.csr_array(np.array([[1349.5, 0.0, 0.0], [-440.6, 3.2, 0.0], [0.0, 0.0, 2.65]]))
        inverse = absolute_inverse(X)
        assert inverse.lower(np.array([0.0, 3.2, 0.0])) == pytest.approx([0.0, 1.0, 0.0], rel=1e-9)

    @pytest.mark.parametrize("n", [2, 5, 400])
    def test_a_radius_of_exactly_one_is_never_called_less(self, n):
        """The periodic chain 2z_i − z_{i−1} − z_{i+1}: ρ(D⁻¹|B|) = 1."""
        ring = 2 * np.eye(n) - np.roll(np.eye(n), 1, 0) - np.roll(np.eye(n), -1, 0) if n > 2 else [[1.0, -1.0]] * 2
        ring = ring if n > 2 else [[1.0, -1.0], [-1.0, 1.0]]
        for member in (icp.MNMJ(), icp.MNMGS()):
            assert not any(
                found.holds
                for name, found in check_all(icp.ICP(ring, np.zeros(n)), member).items()
                if name != "monotone"
            )

    @pytest.mark.parametrize("gap", [2.0**-30, -(2.0**-30)])
    def test_either_side_of_one_is_told_apart(self, gap):
        A = [[1.0, -1.0], [-1.0, 1.0 + gap]]
        assert check("4.3", icp.ICP(A, [0.0, 0.0]), icp.MNMGS()).holds is (gap > 0)

    def test_the_answers_do_not_depend_on_the_units(self):
        """Rows times 10^±100, columns times 10^±100: the triangular members keep every answer."""
        for seed in range(40):
            problem, _, _, A, slope = random_case(seed)
            n, rng = problem.n, np.random.default_rng(seed)
            if not (np.diag(A) > 0).all():
                continue
            rows, columns = 10.0 ** rng.uniform(-100, 100, n), 10.0 ** rng.uniform(-100, 100, n)
            scaled = icp.ICP(
                rows[:, None] * A * columns, np.zeros(n), icp.Affine(slope * columns / columns[:, None], np.zeros(n))
            )
            plain = icp.ICP(A, np.zeros(n), icp.Affine(slope, np.zeros(n)))
            for member in (icp.MNMJ(), icp.MNMGS(), icp.MNMAOR(theta1=0.9, theta2=1.1)):
                before, after = check_all(plain, member), check_all(scaled, member)
                for name in BY_NORM:
                    assert before[name].holds is after[name].holds, (seed, name)

    def test_a_radius_of_blocks_is_that_of_the_largest(self):
        """Reducible maps, whose Perron vectors have zeros: both sides of 1."""
        F = sp.csr_array([[0.5, 1.0, 0.0], [0.0, 0.25, 0.0], [0.0, 0.0, 0.125]])
        one = absolute_inverse(sp.csr_array(np.eye(3)))
        below = radius(MonotoneMap(one, (F,), F), [np.ones(3)])
        assert below.holds is True
        assert 0.5 <= below.upper < 0.56
        above = radius(MonotoneMap(one, (sp.csr_array(3 * F),), sp.csr_array(3 * F)), [np.ones(3)])
        assert above.holds is False

    def test_too_slow_to_be_decided_is_unknown_and_never_no(self):
        """ρ = cos(π/(n + 1)), n = 30000, from v = 1 alone: the quotient stays 1."""
        chain = sp.diags_array([np.full(29_999, -1.0), np.full(30_000, 2.0), np.full(29_999, -1.0)], offsets=(-1, 0, 1))
        T = theorem_43(StepMatrices(icp.ICP(chain, np.zeros(30_000)), icp.MNMJ()))
        assert radius(T, [np.ones(30_000)]).holds is None
        assert check("4.3", icp.ICP(chain, np.zeros(30_000)), icp.MNMJ()).holds is True  # the certificate's v serves

    @pytest.mark.parametrize("exponent", [10, 30, 40, 46, 50, 52])
    def test_ill_conditioned_m_matrices_are_enclosed_or_given_up(self, exponent):
        X = np.array([[1.0, -1.0], [-1.0, 1.0 + 2.0**-exponent]])
        inverse = Comparison(sp.csr_array(X), sp.csr_array(np.abs(X)))
        above, below = inverse.upper(np.ones(2)), inverse.lower(np.ones(2))
        for low, row, high in zip(below, exact_inverse(X), above, strict=True):
            assert Fraction(low) <= sum(row)
            assert not np.isfinite(high) or sum(row) <= Fraction(high)
        assert np.isfinite(above).all() == (exponent <= 40)

    def test_the_maximum_of_two_maps_is_not_their_sum(self):
        """T(v) = max(v₂, v₁)/2 row by row from two linear maps of radius 0: ρ(T) = 1/2."""
        F1, F2 = sp.csr_array([[0.0, 0.5], [0.0, 0.0]]), sp.csr_array([[0.0, 0.0], [0.5, 0.0]])
        T = MonotoneMap(absolute_inverse(sp.csr_array(np.eye(2))), (F1, F2), sp.csr_array(F1 + F2))
        assert radius(T, [np.array([1.0, 3.0])]).upper == pytest.approx(0.5, rel=1e-3)


class TestAnswers:
    def test_without_a_lipschitz_matrix_the_answer_is_unknown(self):
        found = check("4.1", icp.ICP([[1.0]], [0.0], np.sin), icp.MNMGS())
        assert found.holds is None
        assert "no Lipschitz matrix" in found.reason

    def test_a_negative_omega_is_refused_by_every_theorem(self):
        assert all(found.holds is False for found in check_all(icp.ICP([[-1.0]], [0.0]), icp.MNMGS()).values())

    def test_names_and_sentences(self):
        assert set(theorems()) == {*BY_NORM, "rowwise", "h-plus", "monotone", "definite"}
        with pytest.raises(icp.InputError, match=r"theorem is '4\.5'"):
            check("4.5", icp.ICP([[1.0]], [0.0]), icp.MNMGS())
        with pytest.raises(icp.InputError, match="does not print"):
            check("sharper", icp.ICP([[1.0]], [0.0]), icp.MNMGS(), as_printed=True)
        with pytest.raises(icp.InputError, match="theorem is a list; one of"):
            check(["4.3"], icp.ICP([[1.0]], [0.0]), icp.MNMGS())
        for member, words in (("mnmgs", "member is 'mnmgs'"), (icp.MNMGS, "member is the class MNMGS")):
            with pytest.raises(icp.InputError, match=f"{words}; a Method object was expected, such as MNMGS()"):
                check("4.3", icp.ICP([[1.0]], [0.0]), member)
        with pytest.raises(icp.InputError, match=r"member is MMS\("):
            check_all(icp.ICP([[1.0]], [0.0]), icp.MMS())
        for name in ("4.1", "4.3", "4.4"):
            assert check(name, icp.ICP([[1.0]], [0.0]), icp.MNMGS()).false_as_printed

    @pytest.mark.parametrize("name", ["4.1", "4.2", "4.3", "4.4"])
    def test_what_a_false_statement_promises_is_marked_where_it_is_printed(self, name):
        problem = icp.ICP([[1.0]], [0.0])
        promise = check(name, problem, icp.MNMGS(), as_printed=True)
        assert promise.holds
        assert str(promise).endswith("(but the theorem as printed is false)") == (name != "4.2")
        assert "as printed" not in str(check(name, problem, icp.MNMGS()))
        refusal = check(name, problem, icp.MNMGS(phi2=0.1, phi=-3), as_printed=True)
        assert refusal.holds is False
        assert "as printed is false" not in str(refusal)

    def test_43_is_about_aor_splittings(self):
        assert "AOR" in check("4.3", icp.ICP([[1.0]], [0.0]), icp.MNMOD()).reason

    def test_a_row_without_couplings_and_n_one(self):
        assert check("sharper", icp.ICP([[3.0]], [1.0]), icp.MNMJ()).number < 1e-12
        assert check("4.3", icp.ICP(np.diag([1.0, 1e-200]), [1.0, 1.0]), icp.MNMGS()).holds

    def test_many_unknowns_without_any_dense_matrix(self):
        """Both answers at n = 90000: 4.1 holds on the LCP, not with G = .9/4 times the adjacency."""
        lcp, coupled = icp.scenes.bai_symmetric(n=90_000, mu=4), icp.scenes.manufactured_affine(n=90_000)
        assert check("4.1", lcp.problem, icp.MNMGS()).number == pytest.approx(3 / 7, abs=1e-3)
        assert check("4.1", coupled.problem, icp.MNMGS()).holds is False
        assert check("sharper", coupled.problem, icp.MNMJ()).number == pytest.approx(0.9, abs=1e-3)
        assert isinstance(predicted_rate(coupled.problem, icp.MNMJ()), Rate)

    def test_a_large_x_that_is_no_m_matrix_leaves_no_unknown_where_it_dominates(self):
        A = sp.diags_array([np.full(999, 1.0), np.full(1000, 4.0), np.full(999, -1.0)], offsets=(-1, 0, 1))
        found = check("4.1", icp.ICP(A, np.zeros(1000)), icp.MNMGS())
        assert found.holds is True
        assert not absolute_inverse(StepMatrices(icp.ICP(A, np.zeros(1000)), icp.MNMGS()).X).exact


def exact_inverse(X):
    """X⁻¹ in fractions, by Gauss and Jordan; None where X is singular."""
    n = len(X)
    rows = [[Fraction(float(x)) for x in row] + [Fraction(int(i == j)) for j in range(n)] for i, row in enumerate(X)]
    for k in range(n):
        pivot = next((i for i in range(k, n) if rows[i][k]), None)
        if pivot is None:
            return None
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [x / rows[k][k] for x in rows[k]]
        for i in range(n):
            if i != k and rows[i][k]:
                rows[i] = [x - rows[i][k] * y for x, y in zip(rows[i], rows[k], strict=True)]
    return [row[n:] for row in rows]
