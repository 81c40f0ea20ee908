"""Restarts, enumeration and the mixed-integer form: what they find and what they prove."""

import numpy as np
import pytest
from known_answers import attempt

import icpmodel as icp

METHODS = ["restarts", "enumerate", "milp"]


def planted(seed, n):
    """A problem that is neither monotone nor a P-matrix, with a solution."""
    rng = np.random.default_rng(seed)
    A = rng.integers(-5, 6, (n, n)) if seed % 2 else rng.normal(size=(n, n))
    positive = rng.random(n) < 0.5
    z, w = np.where(positive, rng.uniform(1, 5, n), 0.0), np.where(positive, 0.0, rng.uniform(1, 5, n))
    return icp.ICP(A, w - A @ z)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("n", [4, 8, 12])
def test_solve_finds_a_planted_solution(n, seed):
    assert planted(seed, n).solve().residual <= 1e-6


@pytest.mark.parametrize("seed", [1, 16, 33])
def test_an_active_set_whose_equations_depend_on_each_other_has_a_solution(seed):
    rng = np.random.default_rng(seed)
    A = np.tile(rng.integers(-1, 2, (8, 8))[:4].astype(float), (2, 1))
    z = np.where(rng.random(8) < 0.3, 0.0, rng.integers(1, 5, 8))
    p = np.where(z > 0, 0, rng.integers(0, 3, 8))
    assert icp.ICP(A, p - A @ z).solve("milp").solved


@pytest.mark.parametrize("method", [None, *METHODS])
def test_a_problem_on_which_newton_diverges_is_solved(method):
    problem = icp.ICP([[3, -5, -4, -3], [-4, 3, 4, 1], [-5, -4, -2, -1], [1, 0, -3, -4]], [4, 2, 20, -1])
    assert problem.solve(method).residual <= 1e-9


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("psi", "upper"),
    [
        (icp.Affine([[0, 0.5], [0.5, 0]], -1), None),
        (0, 2),
        ([-np.inf, 0], [3, np.inf]),
        (icp.Elementwise(np.cos, lambda z: -np.sin(z)), None),
    ],
    ids=["affine", "two obstacles", "equations", "elementwise"],
)
def test_each_takes_every_kind_of_obstacle(method, psi, upper):
    problem = icp.ICP([[1, 3], [2, -1]], [-3, 1], psi, upper=upper)
    assert problem.solve(method).solved


@pytest.mark.parametrize("method", [None, "enumerate"])
def test_that_no_choice_of_rows_holds_a_solution_is_a_proof(method):
    """z = (1/2, 0, 0) has p = (1/2, 0, 0), so that no combination of rows proves it; but pᵀz = 0 fails everywhere."""
    problem = icp.ICP([[-1, -3, 0], [-2, 2, 0], [2, -3, -2]], [1, 1, -1])
    solution = attempt(problem, method)
    assert solution.status is icp.Status.INFEASIBLE
    assert solution.infeasible.holds


@pytest.mark.parametrize(
    "problem",
    [
        icp.ICP([[-1, 1], [-1, 1]], [-1, 0]),  # has no solution
        icp.ICP([[2.0, -1e-10], [1.0, 0.0]], [-1.0, -1.0], -np.inf),  # z = (1, 1e10)
        icp.ICP([[-1e-319, -1e-318], [-1.0, -2.0]], [2e150, -1.0]),  # no floats in units of its rows
    ],
)
def test_what_highs_does_not_find_proves_nothing(problem):
    assert attempt(problem, "milp").status is not icp.Status.INFEASIBLE


@pytest.mark.parametrize(
    "draw", [lambda rng, shape: rng.uniform(1.0, 2.0, shape), lambda rng, shape: rng.integers(1, 9, shape)]
)
@pytest.mark.parametrize("seed", range(3))
def test_a_game_of_two_players_has_an_equilibrium(seed, draw):
    """Lemke and Howson (1964), also with ties; from y = 0 every covering vector ends in a ray."""
    A, B = draw(np.random.default_rng(seed), (2, 100, 100))
    zero = np.zeros((100, 100))
    game = icp.ICP(np.block([[zero, A], [B.T, zero]]), -np.ones(200))
    solution = attempt(game)
    assert solution.solved
    assert np.minimum(solution.z, game.p(solution.z)) == pytest.approx(0.0, abs=1e-8)


def test_restarts_end_where_the_inverse_of_exchanged_rows_overflows():
    problem = icp.ICP(1e-320 * np.eye(3), [-1.0, 0.0, 0.0], 0.0, upper=[np.inf, 0.0, 0.0])
    assert not attempt(problem).solved


def test_restarts_end_on_equations_without_a_solution():
    """No row can change places where none has an obstacle."""
    assert not attempt(icp.ICP([[1.0, 1.0], [1.0, 1.0]], [-1.0, 0.0], -np.inf), "restarts").solved


def test_tries_that_would_start_nothing_are_refused():
    psi = icp.Function(lambda z: 0.1 * z[::-1] ** 2, jacobian=lambda z: np.diag(0.2 * z)[::-1])
    problem = icp.ICP([[2.0, 1.0], [1.0, 2.0]], [-1.0, -1.0], psi)
    assert attempt(problem, "restarts", tries=20).solved
    with pytest.raises(icp.NotApplicable, match="tries = 19; Newton's method starts after 20"):
        problem.solve("restarts", tries=19)


def test_the_same_seed_gives_the_same_answer():
    problem = planted(3, 12)
    one, other = (attempt(problem, "restarts", seed=7, tries=20) for _ in range(2))
    assert np.array_equal(one.z, other.z)
    assert one.iterations == other.iterations


def test_a_failure_carries_the_best_iterate():
    """Of a problem too large to be searched, and of one whose search finds nothing."""
    solution = attempt(planted(2, 60), time_limit=0.3)
    assert solution.residual <= planted(2, 60).residual(np.zeros(60))


def exponential(A, q, G, c):
    """The problem with ψ(z) = exp(Gz) − c, which soon overflows."""
    G = np.array(G, dtype=float)
    return icp.ICP(A, q, icp.Function(lambda z: np.exp(G @ z) - c, lambda z: np.exp(G @ z)[:, None] * G))


@pytest.mark.filterwarnings("ignore:overflow")
def test_the_search_begins_also_where_psi_overflowed():
    problem = exponential(
        [[-1, 0, 2], [-1, 3, 4], [-3, -3, -2]], [-1, 1, -2], [[3, -4, 3], [-3, 0, 4], [1, 3, 3]], [2, 42, 32]
    )
    assert problem.solve().solved


@pytest.mark.filterwarnings("ignore:overflow")
def test_a_failure_is_that_of_the_method_with_the_best_iterate():
    """No z is above ψ(z) = exp(8z) + 1."""
    solution = attempt(exponential([[-1, 2], [2, -1]], [-1, -1], 8 * np.eye(2), -1.0))
    assert solution.message.startswith(f"{solution.method!r} stagnated: ")
    assert "there may be no solution" in solution.message


def test_crosscheck_asks_the_mixed_integer_form_of_an_indefinite_problem():
    (row,) = icp.crosscheck(planted(4, 8), solvers=["highs-milp"]).rows
    assert row.verdict.value in ("agrees", "other solution")
