"""Predicted rates: no run is slower than its bound, whatever the member, the problem and the start."""

import itertools
from dataclasses import replace
from decimal import Decimal, localcontext

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel.theory.convergence.conditions import StepMatrices
from icpmodel.theory.convergence.rates import Contraction, PeacemanRachford, Rate, predicted_rate
from icpmodel.theory.convergence.theorems import check, check_all

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
        if not isinstance(rate, Contraction):
            assert isinstance(rate, PeacemanRachford) or rate.holds is not True
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
    for accuracy, words in (
        (0.0, "accuracy is 0"),
        (-1, "accuracy is -1; a finite number > 0"),
        ("x", "accuracy is 'x'"),
        (None, "accuracy is None"),
        ([1.0, -1.0], "accuracy has the entry -1; positive numbers"),
        ([1.0, 1.0, 1.0], r"accuracy has shape \(3,\)"),
    ):
        with pytest.raises(icp.InputError, match=words):
            rate.steps(problem, [0.0, 0.0], accuracy)
    for checks, found in (({}, "a dict"), ([], "a list"), ("sharper", "'sharper'")):
        with pytest.raises(icp.InputError, match=f"checks is {found}; what check_all"):
            predicted_rate(problem, icp.MNMGS(), checks)
    with pytest.raises(icp.InputError, match="z0 has shape"):
        rate.steps(problem, [0.0], 1.0)
    with pytest.raises(icp.InputError, match="k is -1"):
        rate.error_after(-1, 1.0)


def test_at_the_solution_no_step_is_needed_and_nowhere_none_can_be_told():
    problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, -1.0])
    rate = predicted_rate(problem, icp.MNMGS())
    assert rate.steps(problem, [1.0, 1.0], 1e-9) == 0
    for z0, words in (([np.nan, 1.0], "nan"), ([np.inf, 1.0], "inf")):
        with pytest.raises(icp.InputError, match=rf"z0\[0\] is {words}; a finite number"):
            rate.steps(problem, z0, 1e-9)
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


def definite_problem(rng, n, symmetric):
    """(problem, z*, A): A positive definite, far from H₊, ψ constant with rows without obstacle."""
    B, K = rng.normal(size=(n, n)), rng.normal(size=(n, n)) * (0 if symmetric else rng.choice([0.5, 3.0]))
    units = 10.0 ** rng.uniform(-1, 1, n) if rng.random() < 0.5 else np.ones(n)
    A = (B @ B.T / n + rng.choice([0.02, 0.3]) * np.eye(n) + K - K.T) * np.outer(units, units)
    z, active = rng.normal(size=n), rng.random(n) < 0.5
    p, c = np.where(active, rng.random(n), 0.0), z - np.where(active, 0.0, rng.random(n))
    c[~active & (rng.random(n) < 0.3)] = -np.inf
    return icp.ICP(A, p - A @ z, c), z, A


PEACEMAN_RACHFORD = {
    "mnmod": lambda rng, A: icp.MNMOD(),
    "mnmmod-small": lambda rng, A: icp.MNMMOD(theta1=0.1 * np.diag(A).max()),
    "mnmmod": lambda rng, A: icp.MNMMOD(theta1=float(np.sqrt(np.prod(np.linalg.eigvalsh(A + A.T)[[0, -1]])) / 2)),
    "mnmmod-large": lambda rng, A: icp.MNMMOD(theta1=5.0 * np.diag(A).max()),
    "diagonal": lambda rng, A: icp.Modulus(splitting="whole", phi2=np.diag(A) * 10.0 ** rng.uniform(-0.5, 0.5, len(A))),
}


@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("name", PEACEMAN_RACHFORD)
def test_no_run_is_slower_than_its_bound_on_definite_problems(name, symmetric):
    """‖w‖ = ‖Ω^(−½)(A + Ω)(z − z*)‖₂ falls by σ in every step; distance, error_after and steps bound the run."""
    held = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(2, 12))
        problem, exact, A = definite_problem(rng, n, symmetric)
        member = PEACEMAN_RACHFORD[name](rng, A)
        rate = predicted_rate(problem, member)
        assert isinstance(rate, Rate)
        if isinstance(rate, Contraction):
            continue
        held += 1
        omega = np.broadcast_to(member.omega_of(problem), n)
        z0 = exact + rng.normal(size=n) * 10.0 ** rng.uniform(-2, 2)
        z = np.array([x for x, _ in itertools.islice(member.iterates(problem, z0), 40)])
        w = np.linalg.norm(((z - exact) @ (A + np.diag(omega)).T) / np.sqrt(omega), axis=1)
        rounding = 1e-11 * (w[0] + np.linalg.norm((A + np.diag(omega)) @ exact / np.sqrt(omega)))
        assert (w[1:] <= rate.factor * w[:-1] + rounding).all(), seed
        distance = rate.distance(problem, z0)
        assert w[0] <= distance + rounding
        # never worse than one step of the method tells
        assert distance * (1 - rate.factor) <= (1 + rate.factor) * w[0] * (1 + 1e-9) + rounding
        for k in range(40):
            assert (np.abs(z[k] - exact) <= rate.error_after(k, distance) + rounding * rate.v).all(), (seed, k)
        accuracy = 1e-4 * np.abs(exact)
        steps = rate.steps(problem, z0, accuracy)
        last = next(itertools.islice(member.iterates(problem, z0), steps, None))[0] if steps < 3000 else exact
        assert (np.abs(last - exact) <= accuracy + rounding * rate.v).all(), seed
    assert held >= 15


def test_the_factor_of_a_definite_problem_is_reached():
    """Without obstacles and for symmetric A an eigenvector of the extreme eigenvalue falls by σ itself."""
    A = np.array([[2.0, 1.5, 0.0], [1.5, 2.0, 1.5], [0.0, 1.5, 3.0]])
    problem = icp.ICP(A, np.zeros(3), psi=-np.inf)
    values, vectors = np.linalg.eigh(A)
    rate = predicted_rate(problem, icp.MNMMOD(theta1=2.0))
    assert isinstance(rate, PeacemanRachford)
    assert rate.factor == pytest.approx(max(abs(values - 2) / (values + 2)), rel=1e-9)
    z = [x for x, _ in itertools.islice(icp.MNMMOD(theta1=2.0).iterates(problem, vectors[:, 0]), 3)]
    assert np.linalg.norm(z[2]) == pytest.approx(rate.factor**2)


def test_error_bounds_help_where_a_step_tells_little():
    """σ near 1: ‖z¹ − z⁰‖/(1 − σ) is far above the distance, |A + Ω|δ is not."""
    rng = np.random.default_rng(0)
    problem, exact, A = definite_problem(rng, 12, False)
    member = icp.MNMMOD(theta1=100.0)
    rate = predicted_rate(problem, member)
    z0 = exact + np.ones(12)
    w = np.linalg.norm((A + 100 * np.eye(12)) @ (z0 - exact)) / 10
    assert isinstance(rate, PeacemanRachford)
    assert w <= rate.distance(problem, z0) <= 2 * w


def test_definite_problems_of_many_unknowns():
    """n = 20 000, neither dominant nor symmetric: σ by sparse factorisations; the prediction holds for the run."""
    grid = icp.scenes.bai_symmetric(n=19_600, mu=4).problem.A
    A = sp.csr_array(grid + 6.0 * sp.triu(grid, 1) - 6.0 * sp.tril(grid, -1))
    problem, member = icp.ICP(A, -np.ones(19_600)), icp.MNMMOD(theta1=8.0)
    rate = predicted_rate(problem, member)
    assert isinstance(rate, PeacemanRachford)
    z0 = np.zeros(19_600)
    steps = rate.steps(problem, z0, 1e-3)
    assert steps <= 2000
    z = next(itertools.islice(member.iterates(problem, z0), min(steps, 100), None))[0]
    reached = rate.error_after(min(steps, 100), rate.distance(problem, z0)).max()
    assert icp.error_bound(problem, z).value <= 10 * reached


@pytest.mark.parametrize("factor", [0.5, 1 - 1e-9, 1 - 2.0**-52])
def test_the_number_of_steps_is_enough_in_exact_arithmetic(factor):
    """factorᵏ·distance ≤ accuracy, where the logarithms of the two cancel but for their last digits."""

    class FarAway(Contraction):
        def distance(self, problem, z0):
            return far

    problem = icp.ICP([[1.0]], [0.0])
    rate = FarAway(factor, np.ones(1), "", StepMatrices(problem, icp.MNMJ()))
    for size in (1e-300, 1.0, 1e300):
        for ratio in (1 + 1e-12, 1.1, 1e3):
            far = size * ratio
            steps = Rate.steps(rate, problem, [0.0], size)
            with localcontext() as context:
                context.prec = 60
                reached = Decimal(size * ratio) * (Decimal(factor).ln() * steps).exp()
                assert reached <= Decimal(size), (size, ratio)
                assert factor > 0.9 or (reached * 4 > Decimal(size) * Decimal(factor))


def test_the_maximum_norm_needs_fewer_steps_where_v_is_uneven():
    """Both numbers are proved; the norm of v has the smaller factor, the maximum norm loses nothing at its ends."""
    problem, member = icp.scenes.bai_symmetric(n=900, mu=4).problem, icp.MNMGS()
    rate, start = predicted_rate(problem, member), np.zeros(900)
    steps = rate.steps(problem, start, 1e-6)
    assert steps < Rate.steps(rate, problem, start, 1e-6)
    iterates = member.iterates(problem, start)
    for _ in range(steps):
        next(iterates)
    assert icp.certify(problem, next(iterates)[0]).bound.value <= 1.01e-6


def test_what_check_all_found_is_not_computed_again():
    problem, member = icp.scenes.bai_symmetric(n=900, mu=4).problem, icp.MNMGS()
    checks = check_all(problem, member)
    alone = predicted_rate(problem, member)
    assert alone.factor == checks["sharper"].number < 0.4215
    other = checks | {"sharper": replace(checks["sharper"], number=0.75)}
    assert predicted_rate(problem, member, other).factor == 0.75
