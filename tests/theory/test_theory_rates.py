"""Predicted rates: no run is slower than its bound, whatever the member, the problem and the start."""

import itertools

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel.theory.rates import Rate, predicted_rate
from icpmodel.theory.theorems import check

MEMBERS = {
    "mnmod": lambda rng, A: icp.MNMOD(phi=rng.choice([0.0, 0.3])),
    "mnmmod": lambda rng, A: icp.MNMMOD(theta1=np.diag(A).max() * rng.uniform(0.8, 2), phi=rng.choice([0.0, 0.2])),
    "mnmaor": lambda rng, A: icp.MNMAOR(
        theta1=rng.uniform(0.7, 1.1), theta2=rng.uniform(-0.3, 1.3), phi=rng.uniform(-0.2, 0.5, len(A))
    ),
    "mnmsor": lambda rng, A: icp.MNMSOR(theta1=rng.uniform(0.7, 1.1), phi1=2.0, phi2=np.diag(A) * rng.uniform(1.5, 3)),
    "mnmgs": lambda rng, A: icp.MNMGS(phi=rng.uniform(-0.1, 0.3)),
    "mnmj": lambda rng, A: icp.MNMJ(),
    "nmms": lambda rng, A: icp.NMMS(
        splitting=icp.AOR(1.0, rng.uniform(0, 1)), omega=np.diag(A) * rng.uniform(0.8, 1.5)
    ),
    "modulus": lambda rng, A: icp.Modulus(splitting=A * (np.abs(A) > 0.2) + 0.1 * np.eye(len(A)), phi2=np.diag(A)),
    "modulus-upper": lambda rng, A: icp.Modulus(splitting=np.triu(A), phi=rng.uniform(0, 0.2)),
    "projection-fixed-point": lambda rng, A: icp.ProjectionFixedPoint(omega=rng.uniform(0.5, 1.1)),
}


def chosen_problem(rng, n):
    """(problem, z*, A): dominant A of any signs in units of all sizes, ψ affine with slopes of any sign."""
    A = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.6) * 0.4
    np.fill_diagonal(A, 0.0)
    A += np.diag(np.abs(A).sum(axis=1) * rng.uniform(1.05, 3) + 0.1)
    slope = rng.normal(size=(n, n)) * rng.choice([0.0, 0.02, 0.15]) / n
    columns = 10.0 ** rng.uniform(-2, 2, n) if rng.random() < 0.5 else np.ones(n)
    A, slope = A * columns / columns[:, None], slope * columns / columns[:, None]
    z, active = rng.normal(size=n) / columns, rng.random(n) < 0.5
    p = np.where(active, rng.random(n) / columns, 0.0)
    c = z - np.where(active, 0.0, rng.random(n) / columns) - slope @ z
    return icp.ICP(A, p - A @ z, icp.Affine(slope, c) if slope.any() else c), z, A


@pytest.mark.parametrize("name", MEMBERS)
def test_no_run_is_slower_than_its_bound(name):
    """‖zᵏ − z*‖_v ≤ σᵏ‖z⁰ − z*‖_v ≤ σᵏ·distance, and |zᵏ − z*| ≤ accuracy from step `steps` on."""
    held = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 8))
        problem, exact, A = chosen_problem(rng, n)
        member = MEMBERS[name](rng, A)
        rate = predicted_rate(problem, member)
        if not isinstance(rate, Rate):
            assert rate.holds is not True
            continue
        held += 1
        z0 = exact + rng.normal(size=n) * np.abs(exact).max() * 10.0 ** rng.uniform(-2, 2)
        z = np.array([x for x, _ in itertools.islice(member.iterates(problem, z0), 40)])
        error = (np.abs(z - exact) / rate.v).max(axis=1)
        rounding = 1e-12 * (error[0] + (np.abs(exact) / rate.v).max())
        assert (error <= rate.factor ** np.arange(40) * error[0] + rounding).all(), seed
        distance = rate.distance(problem, z0)
        assert error[0] <= distance * (1 + 1e-12) + rounding
        first = (np.abs(z[1] - z[0]) / rate.v).max() / (1 - rate.factor)
        assert distance == pytest.approx(first, rel=1e-7, abs=rounding / (1 - rate.factor))
        assert (np.abs(z[7] - exact) <= rate.error_after(7, distance) + rounding * rate.v).all()
        accuracy = 1e-4 * np.abs(exact)
        steps = rate.steps(problem, z0, accuracy)
        last = next(itertools.islice(member.iterates(problem, z0), steps, None))[0] if steps < 5000 else exact
        assert (np.abs(last - exact) <= accuracy + rounding * rate.v).all(), seed
    assert held >= 25


def test_it_is_sharp_for_a_linear_equation():
    """Jacobi on A = [2, −1; −1, 2] without obstacles: the error is halved in every step, no more, and that is said."""
    problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [0.0, 0.0], psi=-np.inf)
    rate = predicted_rate(problem, icp.MNMJ())
    assert rate.factor == pytest.approx(0.5, abs=1e-12)
    path = [z[0] for z, _ in itertools.islice(icp.MNMJ().iterates(problem, np.ones(2)), 5)]
    assert path == pytest.approx([1, 0.5, 0.25, 0.125, 0.0625])
    # the first step gives the distance exactly, so that the number of steps is the true one
    assert rate.distance(problem, [1.0, 1.0]) == pytest.approx(1.0, rel=1e-9)
    assert rate.steps(problem, [1.0, 1.0], 0.0625 * (1 + 1e-9)) == 4
    assert rate.steps(problem, [1.0, 1.0], 0.0625 * (1 - 1e-9)) == 5


def test_on_scenes_the_prediction_holds_for_the_real_run():
    for scene, member in (
        (icp.scenes.membrane(n=225), icp.MNMGS()),
        (icp.scenes.membrane(n=225), icp.MNMJ()),
        (icp.scenes.bai_symmetric(n=900, mu=4), icp.MNMGS()),
        (icp.scenes.manufactured_affine(n=900), icp.MNMJ()),
        (icp.scenes.manufactured_elementwise(n=900), icp.MNMGS()),
    ):
        problem, z0 = scene.problem, np.zeros(scene.problem.n)
        steps = predicted_rate(problem, member).steps(problem, z0, 1e-6)
        z = next(itertools.islice(member.iterates(problem, z0), steps, None))[0]
        exact = problem.solve("mnmgs", rtol=1e-12, max_iter=10_000).z if scene.z_exact is None else scene.z_exact
        assert np.abs(z - exact).max() <= 1e-6 + 2e-9


def test_the_factor_is_that_of_theory_on_the_five_point_matrix():
    """MNMJ with Ω = D on the Laplacian: cos(π/(m + 1)), the Jacobi radius; proved to 1 % of the distance to 1."""
    rate = predicted_rate(icp.scenes.membrane(n=900).problem, icp.MNMJ())
    assert 1 - rate.factor == pytest.approx(1 - np.cos(np.pi / 31), rel=0.01)
    assert rate.factor >= np.cos(np.pi / 31)


def test_the_rate_is_no_larger_than_that_of_41():
    for seed in range(60):
        rng = np.random.default_rng(seed)
        problem, _, A = chosen_problem(rng, 5)
        member = MEMBERS["mnmaor"](rng, A)
        found, rate = check("4.1", problem, member), predicted_rate(problem, member)
        if found.holds:
            assert rate.factor <= found.number * (1 + 1e-9) + 0.02 * (1 - found.number)


def test_it_serves_every_q_and_no_other_problem():
    problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 1.0])
    rate = predicted_rate(problem, icp.MNMGS())
    assert rate.steps(problem.with_q([5.0, -7.0]), [0.0, 0.0], 1e-3) > 0
    with pytest.raises(icp.InputError, match="another A or psi"):
        rate.distance(problem.with_psi(1.0), [0.0, 0.0])
    with pytest.raises(icp.InputError, match="accuracy"):
        rate.steps(problem, [0.0, 0.0], 0.0)
    with pytest.raises(icp.InputError, match="z0 has shape"):
        rate.steps(problem, [0.0], 1.0)
    with pytest.raises(icp.InputError, match="k is -1"):
        rate.error_after(-1, 1.0)


def test_at_the_solution_no_step_is_needed_and_nowhere_none_can_be_told():
    problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, -1.0])
    rate = predicted_rate(problem, icp.MNMGS())
    assert rate.steps(problem, [1.0, 1.0], 1e-9) == 0
    assert rate.steps(problem, [np.nan, 1.0], 1e-9) is None
    assert rate.steps(problem, [np.inf, 1.0], 1e-9) is None
    assert rate.distance(problem, [1e308, -1e308]) >= 1e308


def test_where_no_theorem_holds_the_answer_says_so():
    unknown = predicted_rate(icp.ICP([[1.0]], [0.0], np.sin), icp.MNMGS())
    assert unknown.holds is None
    assert "no Lipschitz matrix" in unknown.reason
    assert predicted_rate(icp.scenes.hand_cyclic().problem, icp.MNMGS()).holds is False


def test_free_rows_and_units():
    """Rows without obstacle, p in units of 1e200 and z of 1e−90: the same factor and number of steps."""
    A = np.array([[4.0, -1.0, 0.5], [1.0, 5.0, 1.0], [0.0, -1.0, 3.0]])
    c = np.array([0.0, -np.inf, 1.0])
    q = np.array([-1.0, 2.0, 0.5])
    plain, scaled = icp.ICP(A, q, c), icp.ICP(A * 1e290, q * 1e200, c * 1e-90)
    rates = [predicted_rate(problem, icp.MNMGS()) for problem in (plain, scaled)]
    assert rates[0].factor == pytest.approx(rates[1].factor, rel=1e-9)
    assert rates[0].steps(plain, np.ones(3), 1e-6) == rates[1].steps(scaled, np.full(3, 1e-90), 1e-96)


def test_many_unknowns():
    """n = 250000: no dense matrix, no factorisation for a dominant A; the run obeys."""
    scene = icp.scenes.bai_nonsymmetric(n=250_000, mu=4)
    rate = predicted_rate(scene.problem, icp.MNMGS())
    steps = rate.steps(scene.problem, scene.z0, 1e-6)
    z = next(itertools.islice(icp.MNMGS().iterates(scene.problem, scene.z0), steps, None))[0]
    assert np.abs(z - scene.z_exact).max() <= 1e-6
    assert steps <= 40


def test_a_dense_x_of_any_signs():
    """M₁ = A not an M-matrix, n ≤ 300: |X⁻¹| itself is used, and the factor is below that of ⟨X⟩⁻¹."""
    rng = np.random.default_rng(0)
    A = rng.normal(size=(60, 60)) / 25 + 2 * np.eye(60)
    rate = predicted_rate(icp.ICP(A, np.zeros(60)), icp.MNMMOD(theta1=2.0))
    X = A + 2 * np.eye(60)
    largest = np.maximum(np.abs(X - 2 * A) @ rate.v, np.abs(X - 4 * np.eye(60)) @ rate.v)
    assert rate.factor == pytest.approx((np.abs(np.linalg.inv(X)) @ largest / rate.v).max(), rel=1e-9)
    comparison = icp.comparison_matrix(sp.csr_array(X)).toarray()
    assert rate.factor < 0.9 * (np.linalg.solve(comparison, largest) / rate.v).max()
