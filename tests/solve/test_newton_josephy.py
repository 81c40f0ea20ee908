"""Newton-Josephy: problems of the literature with their known answers, and honest ends."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
import scipy.sparse as sp
from known_answers import PAIR, attempt, definite

import icpmodel as icp
from icpmodel import ICP
from icpmodel.algebra.factor_costs import FactorCosts, factor_costs
from icpmodel.problem.differences import misfit_of_derivative
from icpmodel.scenes.grid import five_point
from icpmodel.solve.choice import Ladder


class Known(NamedTuple):
    """F, its starts, the solutions, in which NaN is any number, and the bounds."""

    F: Callable[[np.ndarray], Any]
    starts: list[Any]
    solutions: list[Any]
    psi: Any = 0.0
    upper: Any = None


def quadratics(of_c: tuple[float, float], of_d: tuple[float, float], last: float) -> Callable[[np.ndarray], Any]:
    """The four quadratics of Josephy (1979) and of Kojima and Shindo (1986)."""

    def F(z: np.ndarray) -> Any:
        a, b, c, d = z
        return [
            3 * a**2 + 2 * a * b + 2 * b**2 + c + 3 * d - 6,
            2 * a**2 + a + b**2 + of_c[0] * c + 2 * d - 2,
            3 * a**2 + a * b + 2 * b**2 + of_c[1] * c + of_d[1] * d - last,
            a**2 + 3 * b**2 + 2 * c + of_d[0] * d - 3,
        ]

    return F


def five_firms(x: np.ndarray) -> Any:
    """Nash-Cournot equilibrium (Murphy, Sherali and Soyster 1982)."""
    total = x.sum()
    price = (5000.0 / total) ** (1.0 / 1.1)
    cost = np.array([10.0, 8.0, 6.0, 4.0, 2.0]) + (x / 5.0) ** (1.0 / np.array([1.2, 1.1, 1.0, 0.9, 0.8]))
    return cost - price + x * price / (1.1 * total)


def mathiesen(x: np.ndarray) -> Any:
    """A Walrasian equilibrium (Mathiesen 1987): every (t, 0, 0, 0) with 0 ≤ t ≤ 3 is a solution."""
    a, b, c, d = x
    return [-b + c + d, a - (4.5 * c + 2.7 * d) / (b + 1), 5 - a - (0.5 * c + 0.3 * d) / (c + 1), 3 - a]


def markets(y: float, a: float, b: float, c: float) -> list[float]:
    """Mathiesen's activity and three goods, supply less demand; solved by y = 3 and prices as 6 : 1 : 5."""
    income = 5 * b + 3 * c
    return [b + c - a, y - 0.9 * income / a, 5 - y - 0.1 * income / b, 3 - y]


def numeraire(z: np.ndarray) -> Any:
    """Without the market of the second good, the price of which is 1."""
    y, a, c = z
    return np.delete(markets(y, a, 1.0, c), 2)


def sum_of_prices(z: np.ndarray) -> Any:
    """With prices of the sum 1, and its multiplier."""
    return np.append(markets(*z[:4]) + z[4] * np.array([0, 1, 1, 1]), z[1:4].sum() - 1)


def ten_firms(x: np.ndarray) -> Any:
    """Nash-Cournot equilibrium (Harker 1988); our digits, of which the published ones are the first four or five."""
    total = x.sum()
    price = (5000.0 / total) ** (1.0 / 1.2)
    powers = 1.0 / np.array([1.2, 1, 0.9, 0.6, 1.5, 1, 0.7, 1.1, 0.95, 0.75])
    return np.array([5, 3, 8, 5, 1, 3, 7, 4, 6, 3]) + (10 * x) ** powers - price * (1 - x / (1.2 * total))


def brands(p: np.ndarray) -> Any:
    """Prices under logit demand (Choi, DeSarbo and Harker 1990), with the costs that make (1, 2, 3) stationary."""

    def shares(p: np.ndarray) -> np.ndarray:
        wish = np.exp([1, 3, 4] - 2 * p)
        return wish / (1 + wish.sum())

    known = np.array([1.0, 2, 3])
    cost = known - 0.5 / (1 - shares(known))
    return shares(p) * (2 * (p - cost) * (1 - shares(p)) - 1)


def watson(x: np.ndarray) -> Any:
    """The gradient of exp Σ(x_i − i + 2)² (Watson 1979)."""
    shifted = x - np.arange(1, 6) + 2
    return 2 * np.exp((shifted**2).sum()) * shifted


def colville(z: np.ndarray) -> Any:
    """The conditions of Colville's first program (Hock and Schittkowski 1981, 86)."""
    x, multipliers = z[:5], z[5:]
    e = np.array([-15.0, -27, -36, -18, -12])
    d = np.array([4.0, 8, 10, 6, 2])
    b = np.array([-40, -2, -0.25, -4, -4, -1, -40, -60, 5, 1])
    C = np.array(
        [
            [30.0, -20, -10, 32, -10],
            [-20, 39, -6, -31, 32],
            [-10, -6, 10, -6, -10],
            [32, -31, -6, 39, -20],
            [-10, 32, -10, -20, 30],
        ]
    )
    A = np.array(
        [
            [-16, 2, 0, 1, 0],
            [0, -2, 0, 0.4, 2],
            [-3.5, 0, 2, 0, 0],
            [0, -2, 0, -4, -1],
            [0, -9, -2, 1, -2.8],
            [2, 0, -4, 0, 0],
            [-1, -1, -1, -1, -1],
            [-1, -2, -3, -2, -1],
            [1, 2, 3, 4, 5],
            [1, 1, 1, 1, 1],
        ]
    )
    return np.concatenate([e + 2 * C @ x + 3 * d * x**2 - A.T @ multipliers, A @ x - b])


def powell(x: np.ndarray) -> Any:
    """Powell's singular equations as conditions with bounds: F′ is singular at the solution 0."""
    a, b, c, d = x
    return [a + 10 * b, 5**0.5 * (c - d), (b - 2 * c) ** 2, 10**0.5 * (a - d) ** 2]


def pigou(x: np.ndarray) -> Any:
    """Two roads, one with the travel time h³, and the demand 2."""
    return [x[0] ** 3 - x[2], 1 - x[2], x[0] + x[1] - 2]


COLVILLE = [0.3, 0.33346761, 0.4, 0.42831010, 0.22396487]
HALF = [[1.5**0.5, 0, 0, 0.5]]
LITERATURE = {
    "josephy": Known(quadratics((3, 2), (3, 3), 1), [0, 1, 100, [1, 0, 1, 0], [0, 1, 1, 0], [1, 0, 0, 0]], HALF),
    "kojima-shindo": Known(
        quadratics((10, 2), (3, 9), 9), [0, 1, 100, [0, 1, 1, 0], [1, 0, 0, 1]], [*HALF, [1, 0, 3, 0]]
    ),
    "mathiesen": Known(mathiesen, [0, 1, [0.1, 1, 1, 1]], [[np.nan, 0, 0, 0]]),
    "mathinum": Known(numeraire, [1, 10, [3, 1, 1]], [[3, 6, 5]]),
    "mathisum": Known(
        sum_of_prices, [1, [1, 0.3, 0.3, 0.4, 0]], [[3, 1 / 2, 1 / 12, 5 / 12, 0]], psi=[0, 0, 0, 0, -np.inf]
    ),
    "brands": Known(brands, [1, [1, 1, 1], 3], [[1, 2, 3]]),
    "five firms": Known(
        five_firms, [1, 10, 100, [1, 2, 3, 4, 5]], [[36.93251, 41.81814, 43.70658, 42.65924, 39.17895]]
    ),
    "ten firms": Known(
        ten_firms,
        [1, 10],
        [[7.441547, 4.097810, 2.590644, 0.935386, 17.948952, 4.097810, 1.304726, 5.590083, 3.222179, 1.677094]],
    ),
    "billups": Known(lambda z: (z - 1) ** 2 - 1.01, [0, 3], [[1 + 1.01**0.5]]),
    "watson": Known(watson, [0, [1, 1, 1, 2, 2]], [[0, 0, 1, 2, 3]]),
    "colville": Known(colville, [0, 1], [COLVILLE]),
    "powell": Known(powell, [[3, -1, 0, 1]], [], psi=-10.0, upper=10.0),
    "pigou": Known(pigou, [0, 1], [[1, 1, 1]]),
    "exchange": Known(lambda p: 1 - 0.3 - 0.6 / p, [0.1, 1, 50], [[0.6 / 0.7]]),
    "square": Known(lambda z: z**2 + z[::-1] - 3, [1, 5], [[(13**0.5 - 1) / 2] * 2], psi=-np.inf),
}


def sizes(known: Known) -> int:
    """n."""
    first = known.starts[0]
    return next((len(s) for s in (*known.solutions, *known.starts) if np.ndim(s)), len(np.atleast_1d(first)))


@pytest.mark.parametrize("name", LITERATURE)
def test_known_answers_are_found_from_every_start(name):
    known = LITERATURE[name]
    n = 15 if name == "colville" else sizes(known)
    problem = ICP.nonlinear(lambda z: np.asarray(known.F(z)), psi=known.psi, upper=known.upper, n=n)
    for start in known.starts:
        with np.errstate(all="ignore"):
            z = problem.solve(z0=np.broadcast_to(np.asarray(start, dtype=float), n), time_limit=300.0).z
        assert np.abs(problem.natural_map(z)).max() < 1e-5
        if known.solutions:
            k = len(known.solutions[0])
            assert min(np.nanmax(np.abs(z[:k] - one)) for one in known.solutions) < 1e-5


GRID = 40
STIFF = np.diag(np.full(GRID, 2.0)) - np.diag(np.ones(GRID - 1), 1) - np.diag(np.ones(GRID - 1), -1)


def radiating(**options: Any) -> ICP:
    """A string over an obstacle that loses u³: monotone, with rows in contact and free ones."""
    x = np.linspace(0, 1, GRID)
    return ICP(STIFF, 0.001 * np.sin(3 * x), 0.2 - 2 * (x - 0.4) ** 2, f=lambda z: 0.01 * z**3, **options)


#: monotone f and f′, convex or flat far from 0
MONOTONE = {
    "cube": (lambda z: z**3, lambda z: 3 * z**2),
    "exp": (np.exp, np.exp),
    "rational": (lambda z: z / (1 + np.abs(z)), lambda z: 1 / (1 + np.abs(z)) ** 2),
}


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", MONOTONE)
def test_an_obstacle_adds_at_most_three_linear_problems_to_those_of_newtons_method(name, seed):
    """A on a grid or at random, not symmetric; f of any size and p of up to 100 times the size of A."""
    f, slope = MONOTONE[name]
    rng = np.random.default_rng(seed)
    B = rng.normal(size=(8, 8))
    touching = 0
    for A, q in ((STIFF, np.cos(9 * np.linspace(0, 1, GRID))), (definite(rng, 8, 0.1) + B - B.T, rng.normal(size=8))):
        for size, strength in ((1.0, 1000.0), (100.0, 0.01), (100.0, 1.0)):
            force = icp.Function(lambda z, c=strength: c * f(z), lambda z, c=strength: np.diag(c * slope(z)))
            problem = ICP(A, size * q, -0.3 * rng.random(q.size), f=force)
            with np.errstate(all="ignore"):
                free = problem.with_psi(-np.inf).solve().iterations
                solution = problem.solve(history=True)
            assert solution.iterations <= free + 3
            assert solution.history.residual.size == solution.iterations + 1
            touching += np.count_nonzero(solution.r < 1e-9)
    assert touching > 10


@pytest.mark.parametrize(("top", "steps", "status"), [(10.0, 4, "SOLVED"), (30.0, 500, "PRECISION_LIMIT")])
def test_an_equation_that_bends_costs_no_short_steps(top, steps, status):
    """z free, s = e^z − 1 ≥ 0 ⟂ Kz − h: the solution is that of Kz − h ⟂ z ≥ 0, from which s alone is far at first.

    Of e³⁰ rounding leaves more than the tolerance, and the search ends there, before its patience of 1000 steps does.
    """
    K = STIFF[:30, :30]
    h = np.cos(9 * np.linspace(0, 1, 30))
    h *= top / ICP(K, -h).solve().z.max()
    pairs = ICP.nonlinear(
        lambda x: np.append(x[30:] - np.expm1(x[:30]), K @ x[:30] - h), psi=np.repeat([-np.inf, 0.0], 30)
    )
    solution = pairs.solve(raise_on_failure=False)
    assert solution.z[:30] == pytest.approx(ICP(K, -h).solve().z, abs=1e-8)
    assert solution.status.name == status
    assert solution.iterations <= steps


def test_what_one_linear_problem_taught_serves_for_the_next():
    """The symbolic analysis of A is that of A + D; what solved one begins, and gives way where it takes too long."""
    problem = ICP(five_point(30), np.cos(np.arange(900.0)), -1.0)
    D = np.linspace(0.0, 9.0, 900)
    shifted = problem.matrix.plus_diagonal(D).plus_diagonal(D)
    assert factor_costs(shifted) is factor_costs(problem.matrix)
    assert FactorCosts(shifted).fill == factor_costs(shifted).fill
    ladder = Ladder(problem, 1e-6, first=icp.Multilevel())
    job = ladder.next()
    assert job.method.name == "multilevel"
    assert not job.step(1e12, 1.0, 1e-6)  # its set-up predicts nothing
    assert job.step(1e12, 1.0, 1e-6)
    assert ladder.next().method.name == "psor"


@pytest.mark.parametrize("family", [None, "modulus", "paper"])
def test_each_family_solves_the_linear_ones(family):
    assert radiating().solve(family=family).z == pytest.approx(radiating().solve().z, abs=1e-7)


#: increasing f with slopes from 0, from a hundredth and from −1 on, steep and flat, and one of finite slope
RISING = {
    "cube": icp.Elementwise(lambda z: 0.01 * z**3, slope_range=(0, np.inf)),
    "steep": icp.Elementwise(lambda z: 0.01 * np.exp(5 * z), slope_range=(0, np.inf)),
    "flat": icp.Elementwise(lambda z: np.arctan(20 * z), slope_range=(0, 20)),
    "falls": icp.Elementwise(lambda z: z**3 - 0.5 * z, slope_range=(-0.5, np.inf)),
}
SWEEPS = (
    icp.PSOR(),
    icp.MNMGS(),
    icp.MNMJ(),
    icp.MNMSOR(theta1=0.9),
    icp.MNMAOR(theta1=1.1, theta2=0.8, phi=0.1),
    icp.Accelerated(of="psor"),
    icp.MNMOD(),
)


@pytest.mark.parametrize("name", RISING)
def test_sweeps_solve_what_rises_row_by_row_and_newton_needs_few_problems(name):
    """A + diag(m) is an H+-matrix; p at 0 is up to 1000 times the size of the solution."""
    f = RISING[name]
    for size in (1.0, 1000.0):
        q = size * np.cos(9 * np.linspace(0, 1, GRID))
        problem = ICP(STIFF + 0.8 * np.eye(GRID), q, icp.Affine(0.1 * np.eye(GRID, k=1), -2.0), 9.0, f=f)
        with np.errstate(all="ignore"):
            solution = problem.solve(rtol=1e-9)
            assert solution.method.name == "newton-josephy"
            assert solution.iterations <= 12
            for method in SWEEPS:
                if (why_not := method.why_not(problem)) is not None:
                    assert "finite M" in why_not
                    continue
                found = problem.solve(method, rtol=1e-10)
                assert found.z == pytest.approx(solution.z, abs=1e-6)


def test_jacobi_solves_each_row_and_contracts_as_the_affine_problem_does():
    """Law 2 of `algebra.secants` in the limit of exact slopes: one unknown, one step."""
    problem = ICP([[2.0]], [-30.0], f=icp.Elementwise(lambda z: z, slope_range=(1, 1)))
    assert problem.solve("mnmj").iterations == 1


def test_limits_and_callback_are_those_of_the_run():
    problem = ICP.nonlinear(LITERATURE["kojima-shindo"].F, n=4)
    limited = attempt(problem, z0=np.full(4, 100.0), max_iter=2)
    assert (limited.status.name, limited.iterations) == ("ITERATION_LIMIT", 2)
    late = attempt(problem, z0=np.full(4, 100.0), time_limit=0.0)
    assert late.status.name == "TIME_LIMIT"
    stopped = attempt(problem, z0=np.full(4, 100.0), callback=lambda progress: progress.iteration == 1)
    assert (stopped.status.name, stopped.iterations) == ("STOPPED", 1)


def test_a_slow_function_does_not_stretch_the_time_limit():
    """There is no solution, and each step is halved twenty times."""
    calls = []

    def slow(z):
        calls.append(z)
        time.sleep(0.02)
        return -1.0 - z**2

    late = attempt(ICP.nonlinear(slow, lambda z: np.diag(-2.0 * z), n=2), time_limit=0.2)
    assert late.status.name == "TIME_LIMIT"
    assert len(calls) <= 13


def test_steps_beside_a_solution_lead_there_where_the_tangent_has_others():
    """The tangent at z has three solutions, and Lemke's pivots end at one that is far away."""
    problem = ICP(
        [[2.4, 0.2], [0.1, 0.65]],
        [-0.35, -0.235],
        [-0.5, -1.85],
        upper=[1.25, -0.43],
        f=icp.Function(lambda z: -np.arctan(z), lambda z: np.diag(-1.0 / (1.0 + z * z))),
    )
    solution = problem.solve(z0=[0.306, -0.43])
    assert solution.z == pytest.approx([0.30502533, -0.43])
    assert solution.iterations <= 5


ROWS = [[-0.058, -0.292, -0.596], [1.819, 1.481, -0.676], [0.173, -1.164, 0.954]]


def test_a_linearisation_that_rounds_to_a_solution_ends_the_steps():
    b = np.array([-1.0, -2.0])
    cube = icp.Elementwise(lambda z: 1e12 * (z - b) ** 3, slope_range=(0, np.inf))
    problem = ICP(np.eye(2), np.zeros(2), [-np.inf, 0.0], f=cube)
    assert problem.solve(accuracy=1e-3, raise_on_failure=False).z == pytest.approx([-1.0, 0.0], abs=1e-3)


@pytest.mark.parametrize(
    ("A", "q", "a", "low", "high"),
    [
        (ROWS, [0.253, -1.586, 1.561], [-0.584, -0.936, 0.129], 0.0, [3.0, 1.0, 2.0]),
        ([[-1.98842979]], [-0.46684505], [-0.25579], 0.0, np.inf),
        (ROWS, [1.0, 2.0, 3.0], [-1.0, 1.0, -1.0], -5.3, 0.1),
    ],
)
def test_no_step_crosses_a_fixed_obstacle(A, q, a, low, high):
    """Neither in descents nor from other starts, nor by rounding: f has no values there. (3, 0, 0) solves the first."""
    points = []

    def f(z):
        points.append(z)
        return a * z * z

    problem = ICP(A, q, low, high, f=icp.Function(f, lambda z: np.diag(2.0 * np.array(a) * z)))
    assert attempt(problem, max_iter=320).solved == (high is not np.inf)
    assert all((low <= z).all() and (z <= high).all() for z in points)


def test_a_row_on_its_obstacle_is_solved_where_its_slope_underflows():
    """p = e^(−z²) + 1 > 0 at z = 27, and p < 0 at the upper obstacle."""
    assert ICP([[0.0]], [1.0], 27.0, f=lambda z: np.exp(-(z**2))).solve().z == [27.0]
    flat = icp.Elementwise(lambda z: 4 / (1 + np.exp(-z)), derivative=lambda z: 4 * np.exp(-z) / (1 + np.exp(-z)) ** 2)
    assert ICP([[0.0]], [-5.0], 0.0, upper=720.0, f=flat).solve().z == [720.0]
    assert ICP([[1e-320]], [0.0], f=lambda z: 1e-320 * z**3).solve().z == [0.0]
    falling = ICP.nonlinear(lambda z: np.exp(-z) - np.exp(-740.0), lambda z: np.diag(-np.exp(-z)), psi=[740.0])
    assert falling.solve().residual == 0.0


def test_a_problem_without_a_solution_is_never_called_solved():
    """p = z² + 1 and p = e^z have no real root, and e^z underflows; p = 1 − 1/z cannot start at 0.

    The slopes of −1/(1 + z²) and of −e^(−z) underflow to 0 before p does.
    """
    for f in (lambda z: z**2 + 1.0, np.exp):
        solution = attempt(ICP.nonlinear(f, psi=[-np.inf]))
        assert solution.status.name in ("STAGNATED", "DIVERGED", "CYCLED")
        assert "no longer move" not in solution.message
        assert solution.message.count("another start") == 1
    problem = ICP.nonlinear(lambda z: -(z**2) - 1.0, n=2)
    solution = attempt(problem)
    assert "a search of at most 10 s (no time_limit was given) found no solution" in solution.message
    assert "NewtonJosephy(restarts=20)" in solution.why
    assert "nor has it from 2 other starts" in attempt(problem, method="newton-josephy", restarts=2).message
    hyperbola = icp.Elementwise(lambda z: -1.0 / (1.0 + z * z), lambda z: 2.0 * z / (1.0 + z * z) ** 2)
    for f, start in ((hyperbola, 1e110), (lambda z: -np.exp(-z), 740.0)):
        with np.errstate(over="ignore"):
            problem = ICP([[0.0]], [0.0], f=f)
            assert not attempt(problem, z0=[start]).solved
            assert icp.certify(problem, [start], bound=False).residual_max >= start
    with (
        np.errstate(all="ignore"),
        pytest.raises(icp.MapError, match="at the start; a finite number was expected: give another z0"),
    ):
        ICP.nonlinear(lambda z: 1.0 - 1.0 / z, n=1).solve()


@pytest.mark.parametrize("rate", [1.0, 2.0])
@pytest.mark.parametrize(("q", "start"), [(-1e6, None), (-1e6, 300.0), (-1e3, 300.0), (-2.0, 300.0)])
def test_full_steps_lead_back_to_the_root_of_an_exponential_from_far_above_it(rate, q, start):
    """They are 1/rate long, while the residual is z."""
    solution = ICP([[1.0]], [q], f=lambda z: np.exp(rate * z)).solve(z0=None if start is None else [start])
    assert solution.z + np.exp(rate * solution.z) == pytest.approx(-q)


@pytest.mark.parametrize(
    ("problem", "where"),
    [
        (ICP.nonlinear(lambda z: z**3 - 2.0, n=2, jacobian=lambda z: np.zeros((2, 2))), "f[0]"),
        (ICP(PAIR, [1.0, 1.0], icp.Function(lambda z: 1.0 - 3.0 * z, lambda z: 3.0 * np.eye(2))), "psi[0]"),
        (ICP(PAIR, [1.0, 1.0], icp.Function(lambda z: 1.0 - z[::-1] - z, lambda z: np.ones((2, 2)))), "psi[0]"),
    ],
)
def test_a_failure_says_which_derivative_does_not_fit_its_map(problem, where):
    solution = attempt(problem, None if problem.f is not None else "newton")
    assert not solution.solved
    assert f"at this z {where} does not change as its derivative says" in solution.message


def test_no_derivative_is_blamed_for_what_is_beyond_the_floats():
    z = np.array([np.finfo(float).max, 1.0])
    with np.errstate(all="raise"):
        assert misfit_of_derivative(lambda z: 2.0 * z, sp.csr_array(2.0 * np.eye(2)), z) is None


@pytest.mark.parametrize("unit", [1.0, 1e-10, 1e-200])
def test_derivatives_are_held_against_changes_in_the_units_of_z(unit):
    """A step of √ε·1 would go far beyond all that z can be."""
    z = np.array([1.0, 2.0]) * unit
    J = sp.csr_array(np.diag(np.cos(z / unit)))
    assert misfit_of_derivative(lambda z: unit * np.sin(z / unit), J, z) is None
    assert misfit_of_derivative(lambda z: unit * np.sin(z / unit), 1.1 * J, z) == 0


def test_the_derivative_and_the_polish_have_the_slopes_of_f():
    problem = radiating()
    solution = problem.solve(rtol=1e-12)
    dq = np.cos(np.arange(GRID))
    moved = [problem.with_q(problem.q + t * 1e-6 * dq).solve(rtol=1e-12).z for t in (1.0, -1.0)]
    assert solution.derivative().forward(dq=dq) == pytest.approx((moved[0] - moved[1]) / 2e-6, abs=1e-4)
    rough = problem.solve(rtol=1e-3)
    assert rough.polish().residual < 0.01 * rough.residual


def test_an_obstacle_above_and_one_that_moves():
    f = icp.Elementwise(np.exp, np.exp)
    problem = ICP(PAIR, [-9.0, -1.0], icp.Affine([[0, 0.5], [0.5, 0]], -1.0), [1.0, 9.0], f=f)
    z = problem.solve(rtol=1e-12).z
    assert problem.natural_map(z) == pytest.approx([0.0, 0.0], abs=1e-9)
    assert z[0] == pytest.approx(1.0, rel=1e-15)


def test_files_keep_the_answer(tmp_path):
    problem = radiating()
    solution = problem.solve()
    icp.save_solution(solution, tmp_path / "s.npz")
    assert (icp.load_solution(tmp_path / "s.npz", problem).z == solution.z).all()
    with pytest.raises(icp.FileError, match="f was Python code"):
        icp.load_solution(tmp_path / "s.npz")


def test_solvers_of_linear_problems_check_the_answer_by_its_tangent():
    problem = radiating()
    assert problem.crosscheck(solvers=["osqp"]).agrees
    wrong = problem.solve().z + 1e-3
    assert not problem.crosscheck(wrong, solvers=["osqp"]).agrees
    # a bound of the tangent is none of the problem, whose f has unknown slopes
    assert problem.crosscheck(solvers=["osqp"]).error_bound is None


@pytest.mark.parametrize("m", [2, 3, 4])
def test_a_multiple_root_is_the_limit_of_steps_that_shrink_by_a_constant_factor(m):
    at_0 = ICP.nonlinear(lambda z: z**m, lambda z: np.diag(m * z ** (m - 1)), n=1)
    assert at_0.solve(z0=[1.0], max_iter=20).z[0] < 1e-8
    beside = ICP.nonlinear(lambda z: [(z[0] - 1) ** m, z[0] + z[1] - 3], psi=[0.0, -np.inf])
    assert beside.solve(z0=[2.0, 7.0], max_iter=20).z == pytest.approx([1.0, 2.0], abs=1e-7)


def test_the_active_set_at_hand_spares_the_last_tangents_a_method(caplog):
    """Entropy of 100 shares with given means: the rows without a diagonal rule sweeps out."""
    random = np.random.default_rng(0)
    n = 100
    B = random.random((20, n))
    A = np.block([[np.zeros((n, n)), -B.T], [B, np.zeros((20, 20))]])
    q = np.append(random.normal(size=n), -B @ random.uniform(0.2, 1.0, n))

    def f(z):
        return np.append(np.log(np.maximum(z[:n], 1e-12)), np.zeros(20))

    def slope(z):
        return np.diag(np.append(1.0 / np.maximum(z[:n], 1e-12), np.zeros(20)))

    problem = ICP(A, q, psi=np.repeat([1e-9, 0.0], [n, 20]), f=icp.Function(f, slope))
    with caplog.at_level("INFO", "icpmodel"):
        solution = problem.solve(z0=np.repeat([0.5, 0.0], [n, 20]))
    tangents = [record for record in caplog.records if "begins" in record.getMessage()][1:]
    assert len(tangents) < solution.iterations


def test_a_start_beyond_an_obstacle():
    """A plane net of springs that begins within the ball it lies on: in the plane no spring has a vertical force."""
    side = np.linspace(-1, 1, 8)
    x, y = (one.ravel() for one in np.meshgrid(side, side))
    i = np.arange(64).reshape(8, 8)
    pairs = (i[:-1], i[1:]), (i[:, :-1], i[:, 1:]), (i[:-1, :-1], i[1:, 1:]), (i[1:, :-1], i[:-1, 1:])
    ends = np.hstack([[one.ravel(), other.ravel()] for one, other in pairs])
    D = sp.csr_array(
        sp.kron(sp.eye_array(64, format="csr")[ends[0]] - sp.eye_array(64, format="csr")[ends[1]], np.eye(3))
    )
    plane = np.stack([x, y, np.full(64, -0.1)], axis=1).ravel()
    rest = np.linalg.norm((D @ plane).reshape(-1, 3), axis=1)
    ball = np.full(192, -np.inf)
    ball[2::3] = np.sqrt(np.maximum(0.49 - x**2 - y**2, 0.0)) - 0.7

    def tension(z):
        d = (D @ z).reshape(-1, 3)
        length = np.linalg.norm(d, axis=1)
        return d / length[:, None], 200.0 * (1.0 - rest / length), length

    def force(z):
        u, t, length = tension(z)
        return D.T @ ((t * length)[:, None] * u).ravel() + 3.3 * (z - plane)

    def stiffness(z):
        u, t, _ = tension(z)
        along = u[:, :, None] * u[:, None, :]
        blocks = t[:, None, None] * np.eye(3) + (200.0 - t)[:, None, None] * along
        k = np.arange(len(blocks) + 1)
        return D.T @ sp.bsr_array((blocks, k[:-1], k)) @ D + 3.3 * sp.eye_array(192)

    problem = icp.ICP.nonlinear(force, stiffness, ball)
    solution = problem.solve(z0=plane)
    assert np.abs(problem.natural_map(solution.z)).max() < 1e-5


def test_a_start_beyond_an_obstacle_on_which_p_has_no_value():
    def force(z):
        if not z.all():
            raise ValueError("a pole")
        return -1.0 / z - 2.0

    problem = icp.ICP.nonlinear(force, lambda z: sp.diags_array(z**-2.0), [-5.0, -5.0], upper=[0.0, 0.0])
    assert problem.solve(z0=[1.0, -1.0]).z == pytest.approx([-0.5, -0.5])
