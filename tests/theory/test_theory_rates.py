"""Predicted rates: no run is slower than its bound, whatever the member, the problem and the start."""

import itertools

import numpy as np
import pytest
from known_answers import PAIR, affine, around

import icpmodel as icp
from icpmodel.theory.convergence.rates import Contraction, PeacemanRachford, Rate, predicted_rate


def dominant(rng, n):
    """A of any signs, ψ affine with slopes of any sign, often in units of all sizes, or two of them; and z*."""
    A = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.6) * 0.4
    np.fill_diagonal(A, 0.0)
    A += np.diag(np.abs(A).sum(axis=1) * rng.uniform(1.05, 3) + 0.1)
    G = rng.normal(size=(n, n)) * rng.choice([0.0, 0.02, 0.15]) / n
    columns = 10.0 ** rng.uniform(-2, 2, n) if rng.random() < 0.5 else np.ones(n)
    exact = rng.normal(size=n) / columns
    A, G = A * columns / columns[:, None], G * columns / columns[:, None]
    return around(rng, A, exact, affine(G), 1 / columns, 1 / columns, above=rng.choice([0.0, 0.4])), exact


def definite(rng, n):
    """A positive definite, far from H₊, symmetric or not, ψ constant with rows without obstacle; and z*."""
    B, K = rng.normal(size=(n, n)), rng.normal(size=(n, n)) * rng.choice([0.0, 0.5, 3.0])
    units = 10.0 ** rng.uniform(-1, 1, n) if rng.random() < 0.5 else np.ones(n)
    A = (B @ B.T / n + rng.choice([0.02, 0.3]) * np.eye(n) + K - K.T) * np.outer(units, units)
    exact = rng.normal(size=n)
    return around(rng, A, exact, free=0.3, above=rng.choice([0.0, 0.4])), exact


#: the kind of problem, and a member for its A and D
MEMBERS = {
    "mnmod": (dominant, lambda rng, A, D: icp.MNMOD(phi=rng.choice([0.0, 0.3]))),
    "mnmmod": (dominant, lambda rng, A, D: icp.MNMMOD(theta1=D.max() * rng.uniform(0.8, 2), phi=0.2)),
    "mnmaor": (
        dominant,
        lambda rng, A, D: icp.MNMAOR(
            theta1=rng.uniform(0.7, 1.1), theta2=rng.uniform(-0.3, 1.3), phi=rng.uniform(-0.2, 0.5, len(A))
        ),
    ),
    "mnmsor": (
        dominant,
        lambda rng, A, D: icp.MNMSOR(theta1=rng.uniform(0.7, 1.1), phi1=2.0, phi2=D * rng.uniform(1.5, 3)),
    ),
    "mnmj": (dominant, lambda rng, A, D: icp.MNMJ()),
    "nmms": (dominant, lambda rng, A, D: icp.NMMS(splitting=icp.AOR(1.0, rng.uniform(0, 1)), omega=D)),
    "modulus": (dominant, lambda rng, A, D: icp.Modulus(splitting=A * (np.abs(A) > 0.2) + np.diag(0.1 * D), phi2=D)),
    "upper": (dominant, lambda rng, A, D: icp.Modulus(splitting=np.triu(A), phi=rng.uniform(0, 0.2))),
    "projection": (dominant, lambda rng, A, D: icp.ProjectionFixedPoint(omega=rng.uniform(0.5, 1.1))),
    "psor": (dominant, lambda rng, A, D: icp.PSOR(omega=rng.uniform(0.5, 1.2))),
    "whole": (definite, lambda rng, A, D: icp.MNMOD()),
    "whole, small omega": (definite, lambda rng, A, D: icp.MNMMOD(theta1=0.1 * D.max())),
    "whole, large omega": (definite, lambda rng, A, D: icp.MNMMOD(theta1=5.0 * D.max())),
    "whole, diagonal": (definite, lambda rng, A, D: icp.Modulus(splitting="whole", phi2=D * rng.uniform(0.3, 3.0))),
}


def sizes(rate, problem, member, errors):
    """Of rows of errors, in the norm of the rate: ‖e‖_v, or ‖Ω^(−½)(A + Ω)e‖₂."""
    if isinstance(rate, Contraction):
        return (np.abs(errors) / rate.v).max(axis=-1)
    omega = np.broadcast_to(member.omega_of(problem), problem.n)
    return np.linalg.norm(errors @ (problem.A.toarray() + np.diag(omega)).T / np.sqrt(omega), axis=-1)


@pytest.mark.parametrize("name", MEMBERS)
def test_no_run_is_slower_than_its_bound(name):
    """The error falls by σ in every step and is at most the `distance`; `error_after` and `steps` bound the run."""
    (made, choose), held = MEMBERS[name], 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        problem, exact = made(rng, int(rng.integers(1, 9)))
        member = choose(rng, problem.A.toarray(), problem.A.diagonal())
        rate = predicted_rate(problem, member)
        if not isinstance(rate, Rate):
            assert rate.holds is not True
            continue
        held += 1
        z0 = exact + rng.normal(size=exact.size) * np.abs(exact).max() * 10.0 ** rng.uniform(-2, 2)
        z = np.array([x for x, _ in itertools.islice(member.iterates(problem, z0), 30)])
        error = sizes(rate, problem, member, z - exact)
        rounding = 1e-11 * (error[0] + sizes(rate, problem, member, np.abs(exact)))
        assert (error[1:] <= rate.factor * error[:-1] + rounding).all(), seed
        distance = rate.distance(problem, z0)
        assert error[0] <= distance + rounding
        # never worse than one step of the method tells
        assert name == "psor" or distance * (1 - rate.factor) <= (1 + rate.factor) * error[0] * (1 + 1e-7) + rounding
        for k in (0, 7, 29):
            assert (np.abs(z[k] - exact) <= rate.error_after(k, distance) + rounding * rate.v).all(), (seed, k)
        accuracy = 1e-4 * np.abs(exact)
        steps = rate.steps(problem, z0, accuracy)
        last = next(itertools.islice(member.iterates(problem, z0), steps, None))[0] if steps < 2000 else exact
        assert (np.abs(last - exact) <= accuracy + rounding * rate.v).all(), seed
        if made is definite and isinstance(rate, PeacemanRachford):
            A, omega = problem.A.toarray(), np.broadcast_to(member.omega_of(problem), problem.n)
            scaled = A / np.sqrt(np.outer(omega, omega))
            one = np.eye(problem.n)
            assert rate.factor >= np.linalg.norm((scaled - one) @ np.linalg.inv(scaled + one), 2) - 1e-12
    assert held >= 5


def test_it_is_sharp_for_linear_equations():
    """σ is near the factor of the extreme eigenvector; the contraction factor of a maximum norm is attained."""
    A = np.array([[2.0, 1.5, 0.0], [1.5, 2.0, 1.5], [0.0, 1.5, 3.0]])
    values = np.linalg.eigvalsh(A)
    problem = icp.ICP(A, np.zeros(3), psi=-np.inf)
    rate = predicted_rate(problem, icp.MNMMOD(theta1=2.0))
    exact = max(abs(values - 2) / (values + 2))
    assert exact <= rate.factor <= exact + 0.01
    problem = icp.ICP(PAIR, [0.0, 0.0], psi=-np.inf)
    rate = predicted_rate(problem, icp.MNMJ())  # halves the error of (1, 1) in each step
    assert rate.factor == pytest.approx(0.5, abs=1e-12)
    assert [rate.steps(problem, [1.0, 1.0], 0.0625 * (1 + sign * 1e-9)) for sign in (1, -1)] == [4, 5]


@pytest.mark.parametrize(("member", "radius"), [(icp.MNMJ(), 1), (icp.PSOR(), 2)], ids=["jacobi", "gauss-seidel"])
def test_the_factor_is_that_of_theory_on_the_five_point_matrix(member, radius):
    """cos(π/(m + 1)) and its square; proved to 1 % of the distance to 1. The prediction holds for the run."""
    problem, exact = icp.scenes.membrane(n=900).problem, np.cos(np.pi / 31) ** radius
    rate = predicted_rate(problem, member)
    assert exact <= rate.factor <= 1 - 0.99 * (1 - exact)
    steps = rate.steps(problem, np.zeros(900), 1e-6)
    z = next(itertools.islice(member.iterates(problem, np.zeros(900)), steps, None))[0]
    assert np.abs(z - problem.solve(rtol=1e-12).z).max() <= 1e-6 + 2e-9


def test_it_serves_every_q_and_no_other_problem():
    problem = icp.ICP(PAIR, [-1.0, -1.0])
    rate = predicted_rate(problem, icp.MNMGS())
    assert rate.steps(problem.with_q([5.0, -7.0]), [0.0, 0.0], 1e-3) > 0
    assert rate.steps(problem, [1.0, 1.0], 1e-9) == 0
    assert rate.distance(problem, [1e308, -1e308]) >= 1e308
    with pytest.raises(icp.InputError, match="another A or psi"):
        rate.distance(problem.with_psi(1.0), [0.0, 0.0])
    with pytest.raises(icp.InputError, match="accuracy has the entry -1"):
        rate.steps(problem, [0.0, 0.0], [1.0, -1.0])


def test_a_wrong_distance_and_wrong_checks_are_refused():
    problem = icp.ICP(PAIR, [-1.0, -1.0])
    rate = predicted_rate(problem, icp.MNMGS())
    for wrong in (-1.0, np.nan, "x", None):
        with pytest.raises(icp.InputError, match="distance is "):
            rate.error_after(1, wrong)
    assert np.isposinf(rate.error_after(1, np.inf)).all()
    with pytest.raises(icp.InputError, match="checks is "):
        predicted_rate(problem, icp.MNMGS(), {"sharper": 1, "rowwise": 2, "definite": 3})
    with pytest.raises(icp.InputError, match="limit is 3"):
        icp.theory.check_all(problem, icp.MNMGS(), 3)
