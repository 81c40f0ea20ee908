"""Law 12, limits hold: what does not fit into the time or the memory that is left is not begun."""

import time

import numpy as np
import pytest
from benchmarks.families import drawn, expander
from known_answers import attempt

import icpmodel as icp
from icpmodel.methods import named, names
from icpmodel.numerics import work
from icpmodel.solve.solution import Status


@pytest.mark.parametrize("method", [None, *names()])
def test_without_time_every_method_ends_with_its_best_iterate(method):
    problem = icp.scenes.membrane(n=900).problem
    if method is not None and named(method).why_not(problem) is not None:
        pytest.skip("not for this problem")
    solution = attempt(problem, method, time_limit=0)
    assert solution.status is Status.TIME_LIMIT
    assert solution.residual == problem.residual(solution.z) <= problem.residual_at_0()
    assert "time_limit = 0 s" in solution.message


@pytest.mark.parametrize("method", ["mnmmod", "mnmod", "lemke", "josephy"])
def test_what_is_foreseen_to_take_longer_than_the_limit_is_not_begun(method):
    """The bound is that of a watchdog: the factors take half a minute, the pivots minutes."""
    solution = attempt(expander(12_000), method, time_limit=0.3)
    assert solution.status is Status.TIME_LIMIT
    assert " left" in solution.message
    assert solution.seconds < 20.0


def test_another_method_takes_over_from_one_that_does_not_fit():
    problem = expander(900)
    for method in ("newton", "mnmmod", "mnmod"):
        with pytest.raises(icp.NotSolved, match="memory_limit") as failure:
            problem.solve(method, memory_limit=1e5)
        assert failure.value.solution.status is Status.MEMORY_LIMIT
    assert problem.solve(memory_limit=1e5).solved
    with pytest.raises(icp.NotApplicable, match="fits into the memory"):
        problem.solve(memory_limit=1e3)


@pytest.mark.parametrize("max_iter", range(17, 23))
def test_a_method_that_goes_on_after_another_keeps_to_max_iter(max_iter):
    """Found by the fuzz: Interior diverges in the last iteration, and the paused Proximal was given one more."""
    A = np.zeros((10, 10))
    A[[0, 2, 1, 1], [1, 1, 0, 1]] = -1e-12, -1e-12, 4.0, -4e-12
    A[[1, 2, 2, 3, 3, 4, 4], [2, 2, 3, 3, 4, 3, 4]] = 1e150, 2e150, 3.0, -2.0, -3e300, 2.0, 3e300
    A[[5, 6, 8], [9, 7, 9]] = -1.0, 2.0, -2.0
    problem = icp.ICP(A, np.zeros(10), [0, 1, 0, -np.inf, 4, 0, 0, 0, 0, 0])
    assert attempt(problem, max_iter=max_iter).iterations <= max_iter


@pytest.mark.parametrize("skew", [0.0, 0.5, None])
def test_a_printed_solution_costs_no_more_than_the_solve_did(skew):
    """By counted work: of dense matrices that are definite, symmetric or not, and of a membrane (None)."""
    problem = icp.scenes.membrane(n=10_000).problem
    if skew is not None:
        B, C = np.random.default_rng(0).standard_normal((2, 800, 800)) / 800**0.5
        problem = icp.ICP(B @ B.T + 0.1 * np.eye(800) + skew * (C - C.T), B[0])
    begun = work.counter()
    solution = problem.solve()
    solved = work.counter()
    assert "\nmethod" in str(solution)
    assert work.counter() - solved <= solved - begun


@pytest.mark.parametrize("wrong", [-1.0, np.nan, "much"])
def test_a_memory_limit_is_a_number_of_bytes(wrong):
    with pytest.raises(icp.InputError, match="memory_limit"):
        icp.ICP([[2.0]], [1.0]).solve(memory_limit=wrong)


@pytest.fixture
def definite():
    """Positive definite, no H-matrix, and dense."""
    return drawn("dense-definite", 1000, np.random.default_rng(1))


@pytest.mark.parametrize(("name", "limit"), [("time_limit", 0.0), ("memory_limit", 1e3)])
def test_the_limits_of_a_run_hold_for_its_certificate_and_its_polish(definite, name, limit):
    solution = attempt(definite, "mnmgs", max_iter=1, **{name: limit})
    assert f"not decided within {name} = {limit:g}" in solution.certificate.bound.reason
    assert "not decided" in str(solution.summary())
    polished = solution.polish()
    assert polished.residual == solution.residual
    assert "not polished" in polished.why


@pytest.mark.parametrize("name", ["time_limit", "memory_limit"])
def test_a_bound_keeps_to_limits_of_its_own(definite, name):
    bound = icp.error_bound(definite, np.zeros(1000), **{name: 0})
    assert bound.value is None
    assert f"not decided within {name} = 0" in bound.reason
    with pytest.raises(icp.InputError, match=name):
        icp.error_bound(definite, np.zeros(1000), **{name: -1})


def test_a_polish_that_would_take_for_ever_is_not_begun():
    """Nobody limits it, but its factors are foreseen to take more than a minute."""
    solution = attempt(expander(40_000), "mnmgs", z0=np.full(40_000, 10.0), max_iter=0)
    assert "not polished" in solution.polish().why


def test_a_run_inside_another_one_keeps_to_the_limit_of_that():
    def slow_psi(z):
        time.sleep(0.01)
        return 0.3 * np.sin(z)

    slow = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 3.0], slow_psi)
    inner = []

    def callback(state):
        inner.append(attempt(slow, "mnmgs", rtol=1e-300, max_iter=400))
        return True

    icp.scenes.membrane(n=100).problem.solve(callback=callback, time_limit=0.05, raise_on_failure=False)
    assert inner[0].status is Status.TIME_LIMIT
    assert "encloses" in inner[0].message


@pytest.mark.parametrize(("argument", "limit"), [("psi", 0.0), ("psi", 0.25), ("f", 0.0), ("f", 0.75)])
def test_a_jacobian_by_differences_ends_with_the_time(argument, limit):
    """Not the one in the residual of the start, which every answer has."""
    n, pause = 100, 0.005
    calls = []

    def slow(z):
        calls.append(1)
        time.sleep(pause)
        return 0.5 * np.sin(z[::-1])

    slow_map = icp.Function(slow, sparsity=np.ones((n, n)))
    problem = icp.ICP(2.0 * np.eye(n), -np.ones(n), **{argument: slow_map})
    calls.clear()
    solution = attempt(problem, "newton" if argument == "psi" else None, time_limit=limit)
    in_start = n * pause if argument == "f" else 0.0
    assert len(calls) * pause < max(limit, in_start) + 0.2
    assert solution.status is Status.TIME_LIMIT
    assert solution.residual == problem.residual(solution.z)
