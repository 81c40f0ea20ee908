"""The loop: when it stops, what it returns, and that it never calls solved what is not."""

import signal
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

import icpmodel as icp
from icpmodel import Status
from icpmodel.methods import _REGISTRY, Method


@pytest.fixture
def slow():
    """A problem on which the sweeps need thousands of steps."""
    return icp.scenes.bai_symmetric(n=900, mu=0).problem


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Scripted(Method):
    """A method that yields what it is told to."""

    script: tuple = ()
    memoryless: ClassVar[bool] = True

    def iterates(self, problem, z) -> Iterator:
        yield z, None
        for z, hint in self.script:
            yield np.atleast_1d(np.asarray(z, dtype=float)), hint
        k = 0
        while True:
            k += 1
            yield np.array([100.0 + k]), None


ONE = icp.ICP([[1.0]], [-1.0])  # z* = 1, Res(z) = |z - 1| for z > 0, Res(0) = 1


def test_a_lying_hint_is_never_the_verdict():
    """Law 3: the residual that a method hands up is a hint when to look."""
    solution = ONE.solve(Scripted(script=((5.0, 0.0), (1.0, None))), raise_on_failure=False)
    assert solution.solved
    assert solution.z.tolist() == [1.0]
    assert solution.iterations == 2


def test_the_last_iterate_is_tested_and_max_iter_counts_steps():
    script = ((3.0, None), (2.0, None), (1.0, None))
    assert ONE.solve(Scripted(script=script), max_iter=3).solved
    solution = ONE.solve(Scripted(script=script), max_iter=2, raise_on_failure=False)
    assert solution.status is Status.ITERATION_LIMIT
    assert solution.iterations == 2


def test_a_start_that_solves_needs_no_step():
    assert ONE.solve("mnmgs", z0=[1.0], max_iter=0).iterations == 0


def test_the_best_iterate_is_returned_not_the_last():
    solution = ONE.solve(Scripted(script=((1.5, None), (9.0, None))), max_iter=10, raise_on_failure=False)
    assert solution.z.tolist() == [1.5]
    assert solution.residual == 0.5


def test_nan_and_overflow_are_divergence_not_success():
    for bad in (np.nan, np.inf):
        solution = ONE.solve(Scripted(script=((1.2, None), (bad, None))), raise_on_failure=False)
        assert solution.status is Status.DIVERGED
        assert solution.z.tolist() == [1.2]
    nan_hint = ONE.solve(Scripted(script=((1.2, np.nan), (1.0, np.nan))), raise_on_failure=False)
    assert nan_hint.solved


def test_a_method_that_runs_away_is_called_diverged():
    solution = icp.ICP([[1.0]], [-1.0]).solve("mnmgs", phi=-1.5, z0=[1.1], raise_on_failure=False)
    assert solution.status is Status.DIVERGED
    assert np.isfinite(solution.z).all()
    assert "Advice" in solution.message


def test_a_two_cycle_is_recognised():
    problem = icp.ICP([[0.1]], [1.0], icp.Affine([[-5.0]], 6.0))
    solution = problem.solve("mnmgs", phi2=0.1, z0=[56.0], raise_on_failure=False)
    assert solution.status is Status.CYCLED
    assert "period 2" in solution.message
    assert solution.iterations <= 20


def test_rounding_is_called_precision_limit_with_its_floor():
    problem = icp.scenes.manufactured_affine(n=100).problem
    solution = problem.solve("mnmgs", rtol=0.0, atol=0.0, raise_on_failure=False)
    assert solution.status is Status.PRECISION_LIMIT
    assert "rounding leaves" in solution.message
    assert solution.residual <= 2 * np.linalg.norm(problem.rounding(solution.z))


def test_a_problem_without_solution_is_not_solved():
    """p = −z − 1 ≥ 0 and z ≥ 0 exclude each other."""
    solution = icp.ICP([[-1.0]], [-1.0]).solve(raise_on_failure=False)
    assert not solution.solved
    assert solution.residual > 0.1


def test_time_limit_returns_the_best_iterate(slow):
    solution = slow.solve("mnmj", rtol=1e-14, time_limit=0.01, raise_on_failure=False)
    assert solution.status is Status.TIME_LIMIT
    assert 0 < solution.residual < slow.residual(np.zeros(900))


def test_ctrl_c_returns_the_best_iterate(slow):
    calls = []

    def press(state):
        calls.append(state.iteration)
        if state.iteration == 50:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(icp.NotSolved) as error:
        slow.solve("mnmgs", callback=press)
    solution = error.value.solution
    assert solution.status is Status.INTERRUPTED
    assert solution.iterations in (50, 51)
    assert solution.residual < slow.residual(np.zeros(900))
    resumed = slow.solve("mnmgs", z0=solution)
    assert resumed.solved


def test_ctrl_c_from_outside_is_clean(slow):
    threading.Timer(0.3, lambda: signal.raise_signal(signal.SIGINT)).start()
    begin = time.perf_counter()
    solution = slow.solve("mnmj", rtol=0.0, atol=1e-300, callback=lambda s: time.sleep(0.002), raise_on_failure=False)
    assert solution.status is Status.INTERRUPTED
    assert time.perf_counter() - begin < 10


def test_a_psi_that_fails_late_loses_nothing():
    calls = []

    def psi(z):
        calls.append(1)
        if len(calls) > 20:
            raise RuntimeError("sensor lost")
        return 0.5 * np.sin(z)

    solution = icp.ICP([[2.0, -1.9], [-1.9, 2.0]], [-1.0, 0.5], psi).solve("mnmgs", raise_on_failure=False)
    assert solution.status is Status.MAP_FAILED
    assert "sensor lost" in solution.message
    assert solution.iterations > 3
    assert np.isfinite(solution.z).all()


def test_a_psi_that_returns_nan_late_is_never_solved():
    def psi(z):
        return np.where(z > 0.6, np.nan, 0.0)

    solution = icp.ICP([[1.0]], [-1.0], psi).solve("mnmgs", phi=3.0, raise_on_failure=False)
    assert solution.status is Status.MAP_FAILED
    assert "psi(z)[0] is nan at iteration" in solution.message
    assert np.isfinite(solution.residual)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_psi_that_is_not_finite_at_the_start_is_the_user_s_fault_and_said_so(bad):
    problem = icp.ICP(np.eye(2), [1.0, 1.0], lambda z: np.array([0.0, bad]))
    with pytest.raises(icp.MapError, match=r"psi\(z\)\[1\] is (nan|inf) at the start"):
        problem.solve()


def test_loud_by_default_and_the_error_carries_the_solution(slow):
    with pytest.raises(icp.NotSolved, match=r"iteration limit.*Advice: raise max_iter") as error:
        slow.solve("mnmgs", max_iter=3)
    assert error.value.solution.iterations == 3


def test_the_tolerance_is_relative_to_the_residual_at_zero_whatever_the_start():
    problem = icp.scenes.membrane(n=100).problem
    at_zero = problem.residual(np.zeros(100))
    for z0 in (None, np.full(100, 1e6)):
        assert problem.solve("mnmgs", z0=z0, rtol=1e-6).tolerance == 1e-6 * at_zero
    assert problem.solve("mnmgs", rtol=1e-6, atol=0.1).tolerance == 0.1


def test_tiny_and_huge_problems_are_not_solved_at_once():
    """Without a scale of its own the default tolerance means the same at any scale."""
    A = np.array([[2.0, -1.0], [-1.0, 2.0]])
    for scale in (1e-150, 1e150):
        solution = icp.ICP(A, scale * np.array([-1.0, 0.25])).solve("mnmgs")
        assert solution.z / scale == pytest.approx([7 / 12, 1 / 6], rel=1e-6)
        assert icp.ICP(A * scale, scale * np.array([-1.0, 0.25])).solve("mnmgs").z == pytest.approx(
            [7 / 12, 1 / 6], rel=1e-6
        )


def test_history_holds_every_tested_iterate():
    problem = icp.scenes.membrane(n=100).problem
    solution = problem.solve("mnmgs", history=True)
    past = solution.history
    assert past.iteration.tolist() == list(range(solution.iterations + 1))
    assert past.residual[-1] == solution.residual
    assert past.residual[0] == pytest.approx(problem.residual(np.zeros(100)))
    assert (np.diff(past.seconds) >= 0).all()
    assert problem.solve("mnmgs").history is None


def test_history_of_the_automatic_choice_spans_all_methods():
    solution = icp.scenes.hand_splittings().problem.solve(history=True)
    assert "before it" in solution.why
    assert (np.diff(solution.history.iteration) >= 0).all()
    assert solution.history.iteration[-1] == solution.iterations


def test_callback_stops_the_run_and_sees_a_read_only_iterate():
    def callback(state):
        with pytest.raises(ValueError, match="read-only"):
            state.z[0] = 0.0
        return state.iteration == 2

    solution = icp.scenes.membrane(n=100).problem.solve("mnmgs", callback=callback, raise_on_failure=False)
    assert solution.status is Status.STOPPED
    assert solution.iterations == 2


def test_a_warm_start_from_a_solution_needs_fewer_steps(slow):
    cold = slow.solve("mnmgs")
    warm = slow.with_q(slow.q * 1.001).solve("mnmgs", z0=cold)
    assert warm.iterations < cold.iterations


def test_the_start_is_not_changed():
    z0 = np.zeros(2)
    icp.scenes.hand_lcp().problem.solve("mnmgs", z0=z0)
    assert z0.tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"rtol": -1.0}, "rtol is -1.0"),
        ({"atol": float("nan")}, "atol is nan"),
        ({"max_iter": 1.5}, "max_iter is 1.5; a whole number"),
        ({"max_iter": -1}, "max_iter is -1"),
        ({"time_limit": "1"}, "time_limit is '1'"),
        ({"z0": [1.0, 2.0]}, r"z0 has shape \(2,\)"),
        ({"z0": [float("nan")]}, r"z0\[0\] is nan"),
        ({"callback": 3}, "callback is a int; a function"),
    ],
)
def test_wrong_options_are_named(options, words):
    with pytest.raises(icp.InputError, match=words):
        ONE.solve("mnmgs", **options)


def test_progress_writes_nothing_into_a_pipe(capfd):
    icp.scenes.membrane(n=100).problem.solve("mnmgs", progress=True)
    out, err = capfd.readouterr()
    assert out == err == ""


def test_progress_shows_a_bar_on_a_terminal(monkeypatch):
    import io

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    icp.scenes.bai_symmetric(n=900, mu=0).problem.solve("mnmj", progress=True, callback=lambda s: time.sleep(1e-4))
    assert "iteration" in terminal.getvalue()


def test_the_card_tells_the_status_the_bound_and_the_advice(slow):
    card = str(slow.solve("mnmgs", max_iter=2, raise_on_failure=False))
    for words in ("iteration limit after 2 iterations", "MNMGS()", "|z - z*| <=", "Advice"):
        assert words in card
    html = slow.solve("mnmgs", max_iter=2, raise_on_failure=False)._repr_html_()
    assert html.startswith("<table>")
    assert "&lt;=" in html


def test_every_status_but_solved_has_advice():
    assert [status for status in Status if not status.advice] == [Status.SOLVED]


def test_scripted_methods_stay_out_of_the_registry():
    assert Scripted not in _REGISTRY.values()
