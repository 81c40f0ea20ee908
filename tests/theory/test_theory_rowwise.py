"""Projected SOR, whose modulus sees the newest values: the factor of one sweep over v holds and is attained."""

import itertools
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import icpmodel as icp
from icpmodel.theory import Answer, check, check_all, predicted_rate
from icpmodel.theory.certificates.bounds import proofs_of
from icpmodel.theory.certificates.h_plus import HPlusProof
from icpmodel.theory.convergence.conditions import StepMatrices
from icpmodel.theory.convergence.rates import RowwiseContraction
from icpmodel.theory.convergence.rowwise import SweepMap

SEEDS = st.integers(0, 2**32 - 1)


def maps(rng, G, c):
    """ψ with |ψ(x) − ψ(y)| ≤ |G||x − y| and what a sweep can make of it: the four ways in which ψ enters one."""
    slopes = np.diag(G).copy()
    curved = icp.Function(lambda z: np.sin(G @ z) + c, lipschitz=np.abs(G))
    own = icp.Elementwise(lambda z: np.sin(slopes * z), lipschitz=np.abs(slopes), c=c)
    return [icp.Constant(c), icp.Affine(G, c), own, curved][rng.integers(4)]


def drawn(seed, omega=None):
    """(problem, ω, v > 0): A and ψ of any signs and units, D > 0, often in reach of the theorem."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 7))
    A = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.6)
    np.fill_diagonal(A, np.abs(A).sum(axis=1) * rng.uniform(0.3, 2.5) + rng.uniform(0.05, 1, n))
    G = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.5) * rng.choice([0.0, 0.1, 0.4, 1.5]) / n
    units = 10.0 ** rng.uniform(-2, 2, n) if rng.random() < 0.5 else np.ones(n)
    A, G = A * units / units[:, None], G * units / units[:, None]
    omega = float(rng.uniform(0.05, 1.95) if omega is None else omega(rng))
    problem = icp.ICP(A, rng.normal(size=n) / units, maps(rng, G, rng.normal(size=n) / units))
    return problem, omega, rng.uniform(0.1, 1, n) * rng.choice([1.0, 1 / units.max()]) / units


def bound_of(problem, omega):
    return SweepMap(StepMatrices(problem, icp.PSOR(omega=omega)))


def swept(problem, omega, z):
    return icp.PSOR(omega=omega).step_of(problem)(z)[0]


def recursion(A, G, omega, v, psi_sees_newest=False, az_sees_newest=True):
    """T(v) in the numbers of its arguments; with the options the two wrong versions of it."""
    w = list(v)
    for i in range(len(v)):
        g = sum(abs(G[i][j]) * (w if psi_sees_newest else v)[j] for j in range(len(v)))
        others = sum(abs(A[i][j]) * (w if az_sees_newest else v)[j] for j in range(len(v)) if j != i)
        w[i] = max(g, abs(1 - omega) * v[i] + omega / A[i][i] * others)
    return w


def rationals(array):
    return [[Fraction(x) for x in row] for row in np.asarray(array).tolist()]


@settings(max_examples=60, deadline=None)
@given(SEEDS)
def test_two_sweeps_never_part_by_more_than_the_bound(seed):
    """|z − y| ≤ v gives |z⁺ − y⁺| ≤ T(v), whatever the kind of ψ and the ω."""
    problem, omega, v = drawn(seed)
    rng, w = np.random.default_rng(seed + 1), bound_of(problem, omega).upper(v)
    for share in (1.0, rng.random(v.size)):
        z = rng.normal(size=v.size) * 3 * v
        y = z + share * v * rng.choice([-1, 1], v.size)
        moved = np.abs(swept(problem, omega, z) - swept(problem, omega, y))
        size = np.abs(z) + v + np.abs(problem.q) / problem.A.diagonal() + np.abs(problem.psi.value(z))
        assert (moved <= w + 1e-12 * size.max()).all()


@settings(max_examples=60, deadline=None)
@given(SEEDS)
def test_both_roundings_enclose_the_exact_bound_closely(seed):
    problem, omega, v = drawn(seed)
    T, G = bound_of(problem, omega), problem.psi.lipschitz.toarray()
    exact = recursion(rationals(problem.A.toarray()), rationals(G), Fraction(omega), rationals([v])[0])
    for low, w, high in zip(T.lower(v).tolist(), exact, T.upper(v).tolist(), strict=True):
        assert Fraction(low) <= w <= Fraction(high)
        assert high - low <= 1e-12 * high


@settings(max_examples=40, deadline=None)
@given(SEEDS)
def test_the_bound_is_attained(seed):
    """For a Z-matrix, isotone affine ψ and ω ≤ 1 two iterates that differ by v end up T(v) apart, in every row."""
    problem, omega, v = drawn(seed, lambda rng: rng.uniform(0.05, 1))
    rng, n = np.random.default_rng(seed + 1), v.size
    A, G = -np.abs(problem.A.toarray()), problem.psi.lipschitz.toarray()
    np.fill_diagonal(A, problem.A.diagonal())
    w, z = np.array(recursion(A, G, omega, v)), rng.normal(size=n) * v
    # obstacles just above what the row would have without one where w is that of psi, just below it else
    gap, c, path = np.where(w <= (G @ v) * (1 + 1e-12), w, -w), np.zeros(n), z.copy()
    for i in range(n):
        free = path[i] - omega / A[i, i] * (A[i] @ path)
        c[i] = free + gap[i] - G[i] @ z
        path[i] = max(free, free + gap[i])
    problem = icp.ICP(A, np.zeros(n), icp.Affine(G, c))
    moved = swept(problem, omega, z + v) - swept(problem, omega, z)
    assert moved == pytest.approx(w, rel=1e-9, abs=1e-11 * (np.abs(path) + np.abs(c)).max())
    assert bound_of(problem, omega).upper(v) == pytest.approx(w, rel=1e-12)


def test_what_psi_sees_is_the_iterate_before():
    """(Gw)_i in place of (Gv)_i would promise that ψ₂ = 0.9 z₁ has forgotten z₁ after one sweep."""
    G = np.array([[0.0, 0.0], [0.9, 0.0]])
    problem = icp.ICP(np.eye(2), [5.0, 5.0], icp.Affine(G, [-9.0, 0.0]))
    assert recursion(np.eye(2), G, 1.0, [1.0, 1.0], psi_sees_newest=True) == [0.0, 0.0]
    moved = swept(problem, 1.0, np.array([1.0, 0.0])) - swept(problem, 1.0, np.zeros(2))
    assert moved == pytest.approx([0.0, 0.9])
    assert bound_of(problem, 1.0).upper(np.ones(2)) == pytest.approx([0.0, 0.9])


def test_the_newest_bounds_go_into_the_later_rows():
    """With v_j in place of w_j the bound is too small where a row before grows: A = [1, −2; −2, 1] from (0, 1)."""
    A, none = np.array([[1.0, -2.0], [-2.0, 1.0]]), np.zeros((2, 2))
    problem = icp.ICP(A, [0.0, 0.0], psi=-np.inf)
    moved = swept(problem, 1.0, np.array([0.0, 1.0])) - swept(problem, 1.0, np.zeros(2))
    assert moved == pytest.approx([2.0, 4.0])
    assert recursion(A, none, 1.0, [1.0, 1.0]) == [2.0, 4.0]
    assert recursion(A, none, 1.0, [1.0, 1.0], az_sees_newest=False) == [2.0, 2.0]


@settings(max_examples=25, deadline=None)
@given(SEEDS)
def test_no_run_is_slower_than_its_rate(seed):
    """‖zᵏ − z*‖_v ≤ σᵏ‖z⁰ − z*‖_v ≤ σᵏ·distance for an answer z* that is made beforehand, and `steps` are enough."""
    drawn_problem, omega, v = drawn(seed, lambda rng: rng.uniform(0.3, 1.4))
    rng, member, n = np.random.default_rng(seed + 1), icp.PSOR(omega=omega), v.size
    exact, active = rng.normal(size=n) * v, rng.random(n) < 0.5
    p = np.where(active, rng.random(n), 0.0) * drawn_problem.A.diagonal() * v
    G = drawn_problem.psi.lipschitz.toarray()
    c = exact - np.where(active, 0.0, rng.random(n)) * v - G @ exact
    problem = icp.ICP(drawn_problem.A, p - drawn_problem.A @ exact, icp.Affine(G, c))
    rate = predicted_rate(problem, member)
    if isinstance(rate, Answer):
        assert rate.holds is not True
        return
    assert isinstance(rate, RowwiseContraction)
    z0 = exact + rng.normal(size=n) * v * 10.0 ** rng.uniform(-2, 2)
    error = [(np.abs(z - exact) / rate.v).max() for z, _ in itertools.islice(member.iterates(problem, z0), 30)]
    rounding = 1e-11 * (error[0] + (np.abs(exact) / rate.v).max())
    assert (np.array(error) <= rate.factor ** np.arange(30) * error[0] + rounding).all()
    assert error[0] <= rate.distance(problem, z0) + rounding
    accuracy = 1e-4 * v
    steps = rate.steps(problem, z0, accuracy)
    if steps < 3000:
        last = next(itertools.islice(member.iterates(problem, z0), steps, None))[0]
        assert (np.abs(last - exact) <= accuracy + rounding * rate.v).all()


@settings(max_examples=25, deadline=None)
@given(SEEDS)
def test_for_omega_up_to_one_the_factor_is_below_one_exactly_where_the_certificate_exists(seed):
    """Theorem h-plus, with the factor that its proof gives in closed form; and rowwise with ω ≤ 1 implies it."""
    problem, omega, _ = drawn(seed, lambda rng: rng.uniform(0.05, 1))
    found, proof = check_all(problem, icp.PSOR(omega=omega)), proofs_of(problem).h_plus
    proved = isinstance(proof, HPlusProof)
    assert (found["h-plus"].holds is True) == proved
    assert (found["rowwise"].holds is True) == proved
    if proved:
        D, v = problem.A.diagonal(), found["h-plus"].vector
        shares = problem.psi.lipschitz @ v / v, 1 - omega * proof.alpha / (D * v)
        assert found["rowwise"].number <= found["h-plus"].number * (1 + 1e-12) <= np.max(shares) * (1 + 2e-12)


def test_the_factor_is_that_of_theory_on_the_five_point_matrix():
    """Gauss–Seidel on the Laplacian: the square of the Jacobi radius cos(π/(m + 1)); proved to 1 % of what is left."""
    problem, exact = icp.scenes.membrane(n=900).problem, np.cos(np.pi / 31) ** 2
    rate = predicted_rate(problem, icp.PSOR())
    assert exact <= rate.factor <= 1 - 0.99 * (1 - exact)
    assert predicted_rate(problem, icp.PSOR(omega=0.8)).factor > rate.factor
    assert check("rowwise", problem, icp.PSOR(omega=1.5)).holds is False


def test_on_scenes_the_prediction_holds_for_the_real_run():
    for scene in (icp.scenes.membrane(n=225), icp.scenes.manufactured_elementwise(n=900)):
        problem, z0 = scene.problem, np.zeros(scene.problem.n)
        steps = predicted_rate(problem, icp.PSOR()).steps(problem, z0, 1e-6)
        z = next(itertools.islice(icp.PSOR().iterates(problem, z0), steps, None))[0]
        exact = problem.solve("mnmgs", rtol=1e-12, max_iter=10_000).z if scene.z_exact is None else scene.z_exact
        assert np.abs(z - exact).max() <= 1e-6 + 2e-9


def test_at_the_solution_no_step_is_needed_and_the_distance_is_close():
    problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, -1.0])
    rate = predicted_rate(problem, icp.PSOR())
    assert rate.steps(problem, [1.0, 1.0], 1e-9) == 0
    z, free = np.ones(2), icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [0.0, 0.0], psi=-np.inf)
    for omega in (1.0, 0.5):
        rate = predicted_rate(free, icp.PSOR(omega=omega))
        first = (np.abs(swept(free, omega, z) - z) / rate.v).max() / (1 - rate.factor)
        assert rate.distance(free, z) == pytest.approx(first)


def test_a_theorem_is_about_one_of_the_two_degrees_of_implicitness():
    problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, -1.0])
    newest, before = check_all(problem, icp.PSOR()), check_all(problem, icp.MNMSOR())
    assert [name for name, found in newest.items() if found.holds] == ["rowwise", "h-plus", "monotone"]
    assert {"rowwise", "h-plus"}.isdisjoint(name for name, found in before.items() if found.holds)
    assert "here it sees the newest values" in newest["sharper"].reason
    assert "projected SOR" in before["rowwise"].reason
    for name in ("h-plus", "monotone"):
        assert check(name, problem, icp.PSOR(omega=1.1)).reason == "omega = 1.1 is above 1"


def test_where_nothing_is_proved_the_answer_says_so():
    assert "no Lipschitz matrix" in predicted_rate(icp.ICP([[1.0]], [0.0], np.sin), icp.PSOR()).reason
    assert predicted_rate(icp.scenes.hand_cyclic().problem, icp.PSOR()).holds is False
    assert check("rowwise", icp.ICP([[-1.0]], [0.0]), icp.PSOR()).holds is False
    huge = icp.ICP([[1e-300, 1e300], [1e300, 1e-300]], [1.0, 1.0])
    assert check("rowwise", huge, icp.PSOR()).holds is not True


def test_a_sweep_goes_down_from_a_supersolution_and_keeps_the_order():
    """Theorem monotone where the modulus sees the newest values: A a Z-matrix, ψ isotone, ω ≤ 1."""
    for seed in range(40):
        problem, omega, v = drawn(seed, lambda rng: rng.uniform(0.05, 1))
        rng, n = np.random.default_rng(seed), v.size
        A, G = -np.abs(problem.A.toarray()), problem.psi.lipschitz.toarray()
        np.fill_diagonal(A, problem.A.diagonal())
        s, margin = rng.normal(size=n) * v, rng.random(n) * v
        above = icp.ICP(A, margin * problem.A.diagonal() - A @ s, icp.Affine(G, s - margin - G @ s))
        assert check("monotone", above, icp.PSOR(omega=omega)).holds is True
        rounding = 1e-12 * (np.abs(s) + v).max() * (1 + np.abs(A / problem.A.diagonal()[:, None]).max())
        assert (swept(above, omega, s) <= s + rounding).all()
        lower = s - rng.random(n) * v
        assert (swept(above, omega, lower) <= swept(above, omega, s) + rounding).all()
