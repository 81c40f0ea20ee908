"""Newton's method on the modulus equation: it ends after a few steps, and never goes round."""

import itertools

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from known_answers import attempt, dominant

import icpmodel as icp
from icpmodel import Status, scenes
from icpmodel.methods.newton import NewtonPoint


def newton_path(problem, z):
    """The iterates until the method ends, at most 1000."""
    path = icp.Newton().iterates(problem, np.asarray(z, dtype=float))
    return (z for z, _ in itertools.islice(path, 1000))


# --- it solves


def test_one_step_from_the_right_active_set_is_the_solution():
    """A linear system on the rows where z is free: finite termination, to rounding."""
    scene = scenes.scene("bai-symmetric", 400)
    near = scene.z_exact + 1e-3
    steps = list(newton_path(scene.problem, near))
    assert np.abs(steps[1] - scene.z_exact).max() <= 1e-13


@pytest.mark.parametrize(
    ("name", "n", "steps"), [("membrane", 10_000, 30), ("bearing", 10_000, 100), ("dividend", 3_000, 60)]
)
def test_few_steps_are_needed_at_fine_grids(name, n, steps):
    """Layer by layer the bearing would need a thousand."""
    assert scenes.scene(name, n).problem.solve("newton").iterations <= steps


@pytest.mark.parametrize("n", [300, 500])
def test_layers_that_come_back_are_not_set_free_again(n):
    """Where every row is a neighbour of every other one, all would be free, and all come back: 70 steps were made."""
    size = 1.0 / np.arange(1, n) ** 2.5
    A = scipy.linalg.toeplitz(np.append(2.0 * size.sum() + 1.0 / n**1.5, -size))  # a fractional Laplacian
    problem = icp.ICP(A, np.zeros(n), 0.5 - 2.0 * np.linspace(-1.0, 1.0, n) ** 2)
    assert problem.solve("newton").iterations <= 15


# --- it ends, and says how


def test_no_end_is_declared_at_an_active_set_that_stays_while_z_is_no_solution():
    """ψ moves smoothly with z, so that the second step has the same active set as the first, and is still needed."""
    psi = icp.Elementwise(lambda z: 0.5 * np.cos(z), lambda z: -0.5 * np.sin(z), 0.5)
    problem = icp.ICP([[1.0]], [5.0], psi)
    steps = list(newton_path(problem, [1.0]))
    assert len(steps) > 3
    assert steps[-1][0] == pytest.approx(0.5 * np.cos(steps[-1][0]), abs=1e-15)


def test_at_a_fine_grid_rounding_moves_the_active_set_and_the_residual_ends_the_run():
    problem = scenes.membrane(n=10_000).problem
    solution = attempt(problem, "newton", rtol=0.0, atol=0.0)
    assert solution.status is Status.PRECISION_LIMIT
    assert solution.residual <= np.linalg.norm(np.maximum(*problem.rounding(solution.z)))
    assert solution.iterations <= 100


def decisions(rng, states, discount=0.99999):
    """The values of states in each of which one of two actions is taken, each of which leads to states nearby."""

    def chain():
        rows = np.repeat(np.arange(states), 4)
        to = np.clip(rows + rng.integers(-3, 4, rows.size), 0, states - 1)
        return sp.csr_array((rng.dirichlet(np.ones(4), states).ravel(), (rows, to)), shape=(states, states))

    A, other = sp.eye_array(states) - discount * chain(), icp.Affine(discount * chain(), rng.random(states))
    return icp.ICP(A, -rng.random(states), other)


@pytest.mark.parametrize(("states", "seed"), [(200, 1), (500, 5)])
def test_policies_are_improved_until_none_is_better_however_long_the_residual_is_larger(states, seed):
    """Values rise in every step, from 0 by up to 1e5, and so does θ, at first; four of these were given up."""
    problem = decisions(np.random.default_rng(seed), states)
    path = list(newton_path(problem, np.zeros(states)))
    assert problem.residual(path[-1]) <= 1e-10 * problem.residual_at_0()
    moves = [after - before for before, after in itertools.pairwise(path[1:-1])]
    rounding = 1e-11 * np.abs(path[-1]).max()  # 4e-12 of it was seen, on a processor with AVX-512
    assert all(move.min() >= -1e-6 * np.abs(move).max() - rounding for move in moves if np.abs(move).max() > 1e-5)


def test_steps_in_one_direction_end_as_well():
    """z − ψ(z) = sin(2πz)/2π − 1 < 0 has no zero, and every step is 1."""
    psi = icp.Function(
        lambda z: z + 1.0 - np.sin(2.0 * np.pi * z) / (2.0 * np.pi),
        lambda z: sp.csr_array(np.diag(1.0 - np.cos(2.0 * np.pi * z))),
    )
    assert len(list(newton_path(icp.ICP(np.eye(2), [1.0, 1.0], psi), [0.0, 0.0]))) < 100


@pytest.mark.parametrize("A", [np.zeros((3, 3)), np.ones((3, 3)) - 3 * np.eye(3)])
def test_without_a_solution_it_stands_still_and_what_contradicts_itself_is_proved(A):
    solution = attempt(icp.ICP(A, [-1.0, -1.0, -1.0]), "newton")
    assert solution.status is Status.INFEASIBLE
    assert solution.residual >= 0.1
    assert solution.iterations <= 500


# --- the merit function


def points(rng, n=6):
    psi = icp.Affine(0.1 * rng.normal(size=(n, n)), rng.normal(size=n))
    problem = icp.ICP(dominant(rng, n, 0.4), rng.normal(size=n), psi)
    return problem, NewtonPoint(problem, problem.matrix.weights, rng.normal(size=n))


def test_phi_is_fischer_and_burmeister_s_function_of_p_and_r():
    problem, point = points(np.random.default_rng(6))
    a, b = point.p / problem.A.diagonal(), point.r
    assert point.phi == pytest.approx(a + b - np.hypot(a, b), abs=1e-13)


@pytest.mark.parametrize("two", [False, True])
def test_the_derivative_of_phi_is_what_differences_say(two):
    rng, h = np.random.default_rng(8), 1e-6
    for _ in range(10):
        problem, point = points(rng)
        if two:  # Billups: −φ(−a, ψ̄ − z) in place of a
            problem = problem.with_upper(icp.Affine(0.1 * rng.normal(size=(6, 6)), 1.0 + problem.psi.linear[1]))
            point = NewtonPoint(problem, problem.matrix.weights, point.z)
        omega, direction = problem.matrix.weights, rng.normal(size=problem.n)
        there, back = (NewtonPoint(problem, omega, point.z + s * h * direction).phi for s in (1, -1))
        assert point.generalised_derivative()[0] @ direction == pytest.approx((there - back) / (2 * h), abs=1e-6)


# --- whatever the data


def test_squares_beyond_the_floats_stop_no_line_search():
    problem = icp.ICP([[1e-300, -1, 0], [0, 1, -1], [-1, 0, 1]], [-1, -1, -1])
    solution = attempt(problem, "newton")
    assert solution.status in icp.Status
    assert solution.residual <= problem.residual(np.zeros(3))
