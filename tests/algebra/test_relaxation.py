"""theta1="auto": what is chosen, that it is as good as a tuned one, and that it loses nothing."""

import numpy as np
import pytest
import scipy.sparse as sp
from benchmarks.harness import relaxed

import icpmodel as icp
from icpmodel import scenes
from icpmodel.algebra.relaxation import AdaptedOmega, cautious_omega, scale_of


def tridiagonal(n, b):
    A = sp.diags_array([-b, 1.0, -b], offsets=[-1, 0, 1], shape=(n, n))
    return icp.ICP(A, -np.ones(n), -np.inf)


@pytest.mark.parametrize("b", [0.1, 0.45])
def test_the_cautious_omega_is_that_of_young_from_a_lower_bound_of_the_radius(b):
    """ω = 2/(1 + √(1 − ρ²)), ρ = 2b cos(π/(n + 1)) the Jacobi radius."""
    n = 60
    rho = 2 * b * np.cos(np.pi / (n + 1))
    assert cautious_omega(tridiagonal(n, b)) == pytest.approx(2 / (1 + np.sqrt(1 - rho**2)), rel=2e-2)
    assert cautious_omega(tridiagonal(n, b)) < 2 / (1 + np.sqrt(1 - rho**2))  # by a Rayleigh quotient
    assert cautious_omega(tridiagonal(n, 0.6)) == 1.0  # the radius is above 1, and the theory says nothing


def alone(problem, z, i):
    """The z_i that solves row i while the others stay, by bisection: min(p_i, r_i) rises with z_i."""

    def natural(x):
        y = z.copy()
        y[i] = x
        return min((problem.A @ y + problem.q)[i], y[i] - problem.psi.value(y)[i])

    low, high = -1e3, 1e3
    for _ in range(80):
        middle = (low + high) / 2
        low, high = (middle, high) if natural(middle) < 0 else (low, middle)
    return low


@pytest.mark.parametrize("name", ["mnmaor", "mnmsor", "mnmmod"])
@pytest.mark.parametrize("seed", range(2))
def test_auto_begins_with_the_step_that_solves_every_row_on_its_own(name, seed):
    """ψ affine with g_ii of both signs and below 1; then come the steps of the member with numbers."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(6, 6)) + np.diag(rng.uniform(5, 10, 6))
    psi = icp.Affine(np.diag(rng.uniform(-2, 0.9, 6)) + 0.1 * (1 - np.eye(6)), rng.normal(size=6))
    problem, z = icp.ICP(A, rng.normal(size=6), psi), rng.normal(size=6)
    method = icp.methods.named(name, theta1="auto")
    first = method.opening(problem)(z)[0]
    assert first == pytest.approx([alone(problem, z, i) for i in range(6)], abs=1e-9)
    assert np.array_equal(method.step_of(problem)(first)[0], method.adapt(problem).step_of(problem)(first)[0])
    assert method.adapt(problem).opening(problem) is None
    iterates = method.iterates(problem, z)
    assert np.array_equal([next(iterates)[0] for _ in range(2)], [z, first])
    assert not method.memoryless  # a z that comes back may go on in another way
    assert method.adapt(problem).memoryless


@pytest.mark.parametrize("name", ["mnmaor", "mnmsor", "mnmmod"])
def test_auto_takes_problems_without_a_way_to_solve_a_row_alone(name):
    """g_ii ≥ 1 leaves Ω = D; a zero on the diagonal leaves MNMMOD without that step."""
    steep = icp.ICP([[2.0]], [-2.0], icp.Affine([[1.5]], -3.0))
    assert steep.solve(name, theta1="auto").z == pytest.approx([1.0])
    if name == "mnmmod":
        problem = icp.ICP([[0.0, 1.0], [-1.0, 1.0]], [-1.0, 1.0])
        assert problem.solve(name, theta1="auto").solved


def test_without_an_obstacle_the_relaxed_member_is_sor():
    problem, omega = tridiagonal(20, 0.4), 1.3
    A, z = problem.A.toarray(), np.linspace(-1, 1, 20)
    iterates = relaxed(problem, omega).iterates(problem, z)
    next(iterates)
    for _ in range(3):
        for i in range(20):
            z[i] -= omega * (A[i] @ z + problem.q[i]) / A[i, i]
        assert next(iterates)[0] == pytest.approx(z, rel=1e-12)
    member = icp.MNMAOR(theta1="auto").adapt(problem)
    same = relaxed(problem, cautious_omega(problem))
    assert (member.theta1, member.theta2) == pytest.approx((same.theta1, same.theta2))
    assert member.phi2 == pytest.approx(same.phi2)


@pytest.mark.parametrize(
    ("problem", "slack"),
    [
        (scenes.membrane(n=400).problem, 1.1),
        pytest.param(tridiagonal(50, 0.49), 1.6, marks=pytest.mark.slow),
        pytest.param(scenes.membrane(n=900, skew=0.5).problem, 1.6, marks=pytest.mark.slow),
    ],
)
def test_the_adapted_run_is_about_as_short_as_the_best_omega_allows(problem, slack):
    """Counts against a grid of 50 ω with Ω = (2 − ω)D, each by its own best; nothing is charged for that search."""
    best = 10_000
    for omega in np.arange(50, 100) / 50:
        run = problem.solve(relaxed(problem, omega), max_iter=best, raise_on_failure=False)
        best = min(best, run.iterations) if run.solved else best
    solution = problem.solve("mnmaor", theta1="auto")
    assert solution.iterations <= slack * best


@pytest.mark.parametrize(("residuals", "steps"), [(lambda k: 1.0, 4000), (lambda k: 1.02 ** (k % 40), 4000)])
def test_omega_goes_back_to_plain_sweeps_where_nothing_gets_better(residuals, steps):
    omega = AdaptedOmega(1.9, max_value=1.9)
    seen = [omega.value for k in range(steps) if omega.update(residuals(k))]
    assert omega.is_plain
    assert seen == sorted(seen, reverse=True)
    assert seen[-1] == 1.0
    assert not any(omega.update(1.0) for _ in range(1000))


def test_a_slow_steady_fall_is_no_reason_to_step_back():
    """What halves the residual every 70 000 steps may be all there is; what stands still for as long is given up."""
    omega = AdaptedOmega(1.9, max_value=1.9)
    assert not any(omega.update((1 - 1e-5) ** k) for k in range(100_000))
    assert any(omega.update(0.3) for _ in range(1000))


def test_growth_and_nan_are_a_reason_to_step_back_at_once():
    for bad in (1e4, np.nan, np.inf):
        omega = AdaptedOmega(1.9, max_value=1.9)
        assert not omega.update(1.0)
        assert omega.update(bad)
        assert omega.value == pytest.approx(1.45)


@pytest.mark.parametrize("name", ["mnmaor", "mnmsor"])
def test_no_problem_with_an_h_plus_matrix_is_lost(name):
    """θ₂ = 2θ₁ alone turns in circles on some of these; then the run ends as MNMGS, which is proved."""
    rng, plain, circles = np.random.default_rng(0), 0, 0
    for _ in range(100):
        n = int(rng.integers(2, 6))
        B = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.8)
        np.fill_diagonal(B, 0.0)
        radius = max(abs(np.linalg.eigvals(np.abs(B)))) or 1.0
        problem = icp.ICP(np.eye(n) + rng.uniform(0.5, 0.99) / radius * B, rng.normal(size=n))
        z0 = 3 * rng.normal(size=n)
        solution = problem.solve(name, theta1="auto", z0=z0)
        plain += repr(solution.adapted_method) == f"{name.upper()}()"
        circles += not problem.solve("mnmaor", theta2=2.0, z0=z0, max_iter=2000, raise_on_failure=False).solved
    assert circles > 0
    assert plain > 0 or name == "mnmsor"


def test_theta1_of_mnmmod_is_the_mean_of_both_scales():
    problem = scenes.membrane(n=100).problem
    inverse = np.linalg.inv(problem.A.toarray()).sum(axis=1).max()
    theta1 = np.sqrt(np.abs(problem.A.toarray()).sum(axis=1).max() / inverse)
    member = icp.MNMMOD(theta1="auto", phi=0.1).adapt(problem)
    assert member.theta1 == pytest.approx(theta1)
    assert member.phi == 0.1
    assert scale_of(icp.ICP([[0.0]], [1.0])) == 1.0
    assert scale_of(icp.ICP([[3.0, 3.0], [3.0, 3.0]], [1.0, 1.0])) == 6.0


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("mnmaor", {"theta1": "aut"}, "theta1 is 'aut'; a finite number > 0 was expected, or 'auto'"),
        ("mnmaor", {"theta1": "auto", "theta2": 0.5}, "theta2 is given, but theta1='auto' decides"),
        ("mnmsor", {"theta1": "auto", "phi2": [1.0, 2.0]}, "phi2 is given, but theta1='auto' decides"),
    ],
)
def test_a_wrong_theta1_and_what_it_decides_are_named(name, options, words):
    with pytest.raises(icp.InputError, match=words):
        icp.methods.named(name, **options)
