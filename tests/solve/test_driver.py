"""The loop: when it stops, what it returns, and that it never calls solved what is not."""

import math
import re
import signal
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, fields
from fractions import Fraction
from itertools import chain
from typing import ClassVar

import numba
import numpy as np
import pytest
import scipy.sparse as sp
from benchmarks.families import drawn

import icpmodel as icp
from icpmodel import Status
from icpmodel.methods.contract import _REGISTRY, Method
from icpmodel.solve.candidate import Candidate
from icpmodel.solve.driver import carry_out, solution_of
from icpmodel.solve.goal import Goal, Limits
from icpmodel.solve.run import Best, Run
from icpmodel.solve.schedule import Stage, in_turn

LIMITS = Limits(rtol=1e-8, atol=0.0, max_iter=1000, time_limit=None)


@pytest.fixture(autouse=True)
def ctrl_c_raises():
    """Python's own handler: a shell may start the tests with SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def slow():
    """A problem on which the sweeps need thousands of steps."""
    return icp.scenes.bai_symmetric(n=900, mu=0).problem


def run_on(problem, **options):
    start = np.zeros(problem.n)
    at_0 = problem.residual(start)
    return Run(problem, start, at_0, Goal(0.0), aim=1e-14, scale=at_0, max_iter=10**5, **options)


CYCLIC = icp.scenes.hand_cyclic().problem


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


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Endless(Method):
    """A method whose iterates become better for ever, and take a while each."""

    seconds: float = 0.0

    def iterates(self, problem, z) -> Iterator:
        k = 0
        while True:
            yield z, None
            begin, k = time.perf_counter(), k + 1
            while time.perf_counter() - begin < self.seconds:
                pass
            z = np.array([1.0 + 1.0 / k])


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
    assert solution.residual <= 2 * np.linalg.norm(np.maximum(*problem.rounding(solution.z)))


def test_a_problem_without_solution_is_not_solved():
    """p = −z − 1 ≥ 0 and z ≥ 0 exclude each other."""
    solution = icp.ICP([[-1.0]], [-1.0]).solve(raise_on_failure=False)
    assert not solution.solved
    assert solution.residual > 0.1


def test_a_time_limit_of_no_time_leaves_the_start(slow):
    solution = slow.solve("mnmj", z0=np.ones(900), time_limit=0, raise_on_failure=False)
    assert solution.status is Status.TIME_LIMIT
    assert solution.iterations == 0
    assert (solution.z == 1.0).all()


def test_the_time_limit_is_in_seconds_and_returns_the_best_iterate():
    solution = ONE.solve(Endless(seconds=0.002), z0=[9.0], time_limit=0.02, raise_on_failure=False)
    assert solution.status is Status.TIME_LIMIT
    assert 0 < solution.iterations <= 10
    assert solution.z.tolist() == [1.0 + 1.0 / solution.iterations]


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


def test_ctrl_c_from_outside_is_clean():
    threading.Timer(0.1, lambda: signal.raise_signal(signal.SIGINT)).start()
    solution = ONE.solve(Endless(), rtol=0.0, max_iter=10**12, raise_on_failure=False)
    assert solution.status is Status.INTERRUPTED
    assert solution.iterations > 0


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


@pytest.mark.parametrize("d", [-3e-316, -1e-315, -7e-322])
def test_a_tolerance_that_underflows_is_not_rounded_up(d):
    """1e-8·Res(0) is less than the smallest float here, which a residual may then not be."""
    problem = icp.ICP([[0.0]], [-1.0], psi=2 * d, upper=d)
    most = Fraction(1e-8) * abs(Fraction(d))
    for solution in (problem.solve(raise_on_failure=False), problem.solve("newton", raise_on_failure=False)):
        assert Fraction(solution.tolerance) <= most
        assert not solution.solved or abs(Fraction(solution.z[0]) - Fraction(d)) <= most
    many = icp.solve_many([[0.0]], [[-1.0]], 2 * d, upper=d, raise_on_failure=False)
    assert Fraction(many.tolerances[0]) <= most


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


def test_history_spans_all_methods():
    """Where a method begins, its first iterate has the number of the last one of the method before."""
    run = run_on(CYCLIC, history=True)
    carry_out(run, in_turn(Candidate(icp.PSOR(), "first"), Candidate(icp.Newton(), "second")))
    solution = solution_of(run, LIMITS)
    assert "also tried: PSOR(): cycled" in solution.why
    assert set(np.diff(solution.history.iteration)) == {0, 1}
    assert solution.history.iteration[0] == 0
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


def test_the_card_tells_the_status_the_bound_and_the_advice(slow):
    card = str(slow.solve("mnmgs", max_iter=2, raise_on_failure=False))
    for words in ("iteration limit after 2 iterations", "MNMGS()", "|z - z*| <=", "Advice"):
        assert words in card
    html = slow.solve("mnmgs", max_iter=2, raise_on_failure=False)._repr_html_()
    assert html.strip().startswith("<table>")
    assert "&lt;=" in html


def test_advice_names_only_what_the_method_has():
    """An option in `to_try` is one of the method; Newton, which has none, is not told to change one."""
    known = {field.name for cls in _REGISTRY.values() for field in fields(cls)}
    for cls in _REGISTRY.values():
        assert set(re.findall(r"\w+", cls.to_try)) & known <= {field.name for field in fields(cls)}, cls
        assert bool(cls.to_try) == bool(fields(cls)), cls
    failed = icp.ICP([[-1.0]], [-1.0]).solve("newton", raise_on_failure=False)
    assert failed.message.endswith("try another method or another start z0; unless certified, there may be no solution")
    cycled = icp.scenes.hand_cyclic().problem.solve("mnmsor", theta1=1.0, raise_on_failure=False)
    assert "Advice: try a larger phi (it damps the step), another phi2, another theta1, another" in cycled.message


def test_page_status_and_message_name_the_same_methods():
    """The best iterate is Newton's, which stood still; the run ended with the divergence of another method."""
    run = run_on(icp.ICP([[-1.0]], [-1.0]))
    carry_out(run, in_turn(Candidate(icp.Newton(), "first"), Candidate(icp.MNMMOD(theta1=0.5), "second")))
    solution = solution_of(run, LIMITS)
    last = "MNMMOD(theta1=0.5)"
    assert (repr(solution.method), solution.status) == ("Newton()", Status.DIVERGED)
    assert repr(solution.last_method) == last
    card = solution.summary()
    assert card["status"].startswith("diverged")
    assert card["status"].endswith(f"; the last method was {last}")
    assert card["method"].startswith("Newton(), which found this z\n")
    assert solution.message.startswith(f"{last} diverged: ")
    assert f"best residual {solution.residual:.3g} by Newton() (" in solution.message
    assert "phi" not in solution.message.split("Advice")[1]  # several methods failed, whatever their options
    assert solution.about()["last_method"] == last
    assert last in str(solution)


def test_where_one_method_ran_or_the_answer_is_solved_there_is_no_other_to_name(slow):
    for solution in (
        slow.solve("mnmgs", max_iter=2, raise_on_failure=False),
        icp.scenes.hand_splittings().problem.solve(),
    ):
        assert solution.last_method is solution.method
        assert "last method" not in str(solution)


def test_a_text_is_no_truth_value():
    for name in ("history", "progress", "raise_on_failure"):
        with pytest.raises(icp.InputError, match=f"{name} is 'no'; True or False was expected"):
            ONE.solve("mnmgs", **{name: "no"})


def test_every_status_but_solved_has_advice():
    assert [status for status in Status if not status.advice] == [Status.SOLVED]


def test_scripted_methods_stay_out_of_the_registry():
    assert Scripted not in _REGISTRY.values()


def test_a_lying_hint_cannot_hide_the_best_or_the_last_iterate():
    script = ((1.5, 0.5), (50.0, 1e-3), (1.0, 7.0))
    solution = ONE.solve(Scripted(script=script[:2]), max_iter=2, raise_on_failure=False)
    assert solution.residual == ONE.residual(solution.z)
    assert ONE.solve(Scripted(script=script), max_iter=3, raise_on_failure=False).solved


def test_a_psi_without_a_value_at_zero_is_no_trap_for_the_fallback_methods():
    A = [[1.0, 0.0, 2.0], [2.0, 1.0, 0.0], [0.0, 2.0, 1.0]]

    def psi(z):
        if not z.any():
            raise ValueError("no value at 0")
        return np.zeros(3)

    solution = icp.ICP(A, [-1.0, -1.0, -1.0], psi).solve(z0=[1.0, 0.5, 0.2], raise_on_failure=False)
    assert solution.status in Status
    assert solution.residual == pytest.approx(icp.ICP(A, [-1.0, -1.0, -1.0]).residual(solution.z))


@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError])
def test_what_happens_while_the_next_method_is_chosen_loses_nothing(error):
    def chosen():
        raise error

    run = run_on(CYCLIC)
    carry_out(run, chain(in_turn(Candidate(icp.PSOR(), "first")), [Stage(math.inf, chosen)]))
    solution = solution_of(run, LIMITS)
    assert solution.status is (Status.INTERRUPTED if error is KeyboardInterrupt else Status.MEMORY_LIMIT)
    assert repr(solution.last_method) == "PSOR()"
    assert np.isfinite(solution.residual)


def test_ctrl_c_during_a_fallback_names_the_fallback():
    class Pressed(icp.MNMGS):
        def iterates(self, problem, z):
            yield z, None
            raise KeyboardInterrupt

    run = run_on(CYCLIC)
    carry_out(run, in_turn(Candidate(icp.PSOR(), "first"), Candidate(Pressed(), "second")))
    solution = solution_of(run, LIMITS)
    assert solution.message.startswith("Pressed() interrupted: by Ctrl-C")
    assert [one.outcome for one in run.tried] == ["cycled", "interrupted"]


class Greedy(icp.MNMGS):
    """A method whose second step needs more memory than there is."""

    def iterates(self, problem, z):
        yield z, None
        raise MemoryError


def test_a_method_that_needs_too_much_memory_gives_way_to_the_next():
    run = run_on(CYCLIC)
    carry_out(run, in_turn(Candidate(Greedy(), "first"), Candidate(icp.Newton(), "second")))
    assert solution_of(run, LIMITS).z == pytest.approx(np.full(3, 1 / 3))
    solution = CYCLIC.solve(Greedy(), raise_on_failure=False)
    assert solution.status is Status.MEMORY_LIMIT


def test_an_operator_that_is_singular_is_passed_over_or_raised():
    singular = icp.MNMJ(phi=[-2.0, 0.0, 0.0])
    run = run_on(CYCLIC)
    carry_out(run, in_turn(Candidate(singular, "first"), Candidate(icp.Newton(), "second")))
    assert [repr(one.candidate.method) for one in run.tried] == ["Newton()"]
    with pytest.raises(icp.SingularOperator):
        CYCLIC.solve(singular)


def test_the_method_that_is_named_is_the_one_that_found_z():
    """Of several methods that failed, `method` is the one whose iterate is returned, `why` lists the others."""
    rng = np.random.default_rng(5)
    for _ in range(30):
        problem = icp.ICP(rng.normal(size=(3, 3)) + np.eye(3), rng.normal(size=3))
        solution = problem.solve(raise_on_failure=False, max_iter=3000, history=True)
        if not solution.solved and "also tried" in solution.why:
            assert repr(solution.method) not in solution.why
            assert solution.residual == pytest.approx(solution.history.residual.min(), rel=1e-9)
            return
    pytest.fail("none of these problems failed with several methods")


def test_a_run_away_is_stopped_long_before_it_overflows():
    solution = icp.ICP([[1.0]], [-1.0]).solve("mnmgs", phi=-1.5, z0=[1.1], raise_on_failure=False)
    assert 400 < solution.iterations < 450  # 3^k > 1e200 at k = 420, overflow at 646


def test_a_hint_whose_squares_over_or_underflow_is_not_used():
    for size in (1e-170, 1e170):
        problem = icp.ICP([[1.0]], [-size])
        solution = problem.solve(Scripted(script=((0.5 * size, 0.0), (1.2 * size, np.inf), (size, 0.0))), max_iter=3)
        assert solution.z[0] == size
        assert problem.solve("mnmgs", history=True).history.residual[0] == size


def test_a_python_psi_is_called_once_per_sweep():
    calls = []

    def psi(z):
        calls.append(1)
        return 0.1 * np.sin(z)

    problem = icp.scenes.bai_symmetric(n=100, mu=0).problem.with_psi(psi)
    for method in (icp.MNMGS(), icp.MNMJ(), icp.PSOR(), icp.MNMOD()):
        path = method.iterates(problem, np.zeros(100))
        next(path)
        calls.clear()
        for _ in range(10):
            next(path)
        assert len(calls) == 10


def test_a_psi_that_moves_with_its_own_unknown_alone_is_asked_for_the_obstacle_and_by_the_judge():
    """Not in every sweep, nor in every step of Newton's: it is a fixed obstacle."""
    for family, n in (("grid-2d-constant", 900), ("plate", 300)):
        fixed, asked = drawn(family, n, np.random.default_rng(2)), []

        def f(z, asked=asked):
            asked.append(z)
            return 0.5 * np.sin(z)

        psi = icp.Elementwise(f, lambda z: 0.5 * np.cos(z), lipschitz=0.5, c=fixed.psi.c)
        problem, seen = fixed.with_psi(psi), []
        solution = problem.solve(rtol=1e-10)
        assert solution.solved
        assert len(asked) < 20 < solution.iterations
        shown = problem.solve(rtol=1e-10, history=True, callback=lambda at, seen=seen: seen.append((at.z, at.residual)))
        assert np.array_equal(shown.z, solution.z)  # who looks on changes nothing, and sees Res(z)
        assert [residual for _, residual in seen] == shown.history.residual.tolist()
        assert [residual for _, residual in seen] == pytest.approx([problem.residual(z) for z, _ in seen], rel=1e-6)


def test_an_untrue_lipschitz_constant_leaves_what_sweeps_with_psi_itself_solve():
    rng, shapes, found = np.random.default_rng(0), (np.sin, lambda t: -np.arctan(t), lambda t: np.sqrt(1.0 + t * t)), 0
    for k in range(24):
        A, steep, scale = drawn("graph-expander", 20, rng).A, *rng.uniform(0.5, 2.0, 2)
        psi = icp.Elementwise(lambda t, f=shapes[k % 3], s=steep, w=scale: s * f(w * t), lipschitz=0.5)
        problem = icp.ICP(A, rng.normal(size=A.shape[0]), psi)
        if problem.solve("mnmgs", raise_on_failure=False).solved:
            found += 1
            assert problem.solve().solved
    assert found > 8


@pytest.mark.parametrize("method", ["mnmgs", "mnmj", "psor", None])
def test_a_signal_that_must_cross_all_rows_is_no_stagnation(method):
    """One-way coupling: the residual stays the same for n steps, and then the answer is exact."""
    n = 1500
    A = sp.eye_array(n, format="csr") - sp.eye_array(n, k=1, format="csr")
    q = np.zeros(n)
    q[-1] = -1.0
    solution = icp.ICP(A, q).solve(method)
    assert solution.z.tolist() == [1.0] * n


def test_a_transient_that_grows_by_1e150_is_no_divergence():
    n = 500
    A = sp.eye_array(n, format="csr") + 2 * sp.eye_array(n, k=1, format="csr")
    q = -A @ np.ones(n)
    assert icp.ICP(A, q, -np.inf).solve("mnmgs").z == pytest.approx(np.ones(n))


def test_a_fallback_is_judged_by_its_own_progress_not_by_an_earlier_method_s():
    """A warm start next to the solution must not make the answer worse."""
    n = 60
    T = sp.diags_array([-np.ones(n - 1), np.full(n, 2.0), -np.ones(n - 1)], offsets=[-1, 0, 1])
    C = np.array([[1.0, 0.0, -0.9], [-0.9, 1.0, 0.0], [0.0, -0.9, 1.0]])
    A = sp.csr_array(sp.block_diag([T, C]))
    z = 1.0 + np.random.default_rng(0).random(n + 3)
    problem = icp.ICP(A, -(A @ z))
    assert problem.solve(z0=z * (1 + 1e-7)).z == pytest.approx(z, abs=1e-4)


def test_a_problem_that_zero_solves_has_a_scale_all_the_same():
    problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [0.0, 0.0], psi=-1.0)
    assert problem.solve("mnmgs", z0=[0.5, 0.5]).residual <= 1e-8


def test_a_psi_with_a_will_of_its_own_is_not_called_solved():
    calls = [0]

    def psi(z):
        calls[0] += 1
        return np.full(1, float(calls[0] % 7 == 0))

    for first in range(50):
        calls[0] = first
        solution = icp.ICP([[2.0]], [2.0], psi).solve("mnmgs", z0=[3.0], raise_on_failure=False)
        assert not solution.solved or solution.residual <= solution.tolerance


def test_a_psi_that_fails_at_the_first_step_keeps_the_start():
    def psi(z):
        if (z < -0.5).any():
            raise ValueError("outside")
        return np.full(1, -3.0)

    solution = icp.ICP([[2.0]], [4.0], psi).solve("mnmgs", z0=[1.0], raise_on_failure=False)
    assert solution.status is Status.MAP_FAILED
    assert solution.z.tolist() == [1.0]


def test_a_compiled_psi_that_raises_is_the_map_s_error():
    pole = numba.njit(lambda s: 0.1 / (s - 1.0))
    problem = icp.ICP([[2.0]], [-2.0], icp.Elementwise(pole, c=-5.0))
    solution = problem.solve("mnmgs", z0=[3.0], raise_on_failure=False)
    assert solution.status is Status.MAP_FAILED
    assert "ZeroDivisionError" in solution.message


def test_mms_needs_no_value_of_psi_at_zero():
    def psi(z):
        if (z <= 0).any():
            raise ValueError("log of a negative number")
        return 0.1 * np.log(z)

    assert icp.ICP([[2.0]], [-2.0], psi).solve("mms", z0=[1.5]).z == pytest.approx([1.0])


def test_a_cycle_of_the_second_method_is_found_at_once():
    problem = icp.ICP([[0.1]], [1.0], icp.Affine([[-5.0]], 6.0))  # MNMGS(phi2=0.1) ends in a 2-cycle
    still = Scripted(script=((0.0, None),) * 1100)
    run = run_on(problem)
    carry_out(run, in_turn(Candidate(still, ""), Candidate(icp.MNMGS(phi2=0.1), "")))
    solution = solution_of(run, LIMITS)
    assert solution.status is Status.CYCLED
    assert solution.iterations < 1100
    assert [one.outcome for one in run.tried] == ["stagnated", "cycled"]


def test_where_0_solves_the_scale_is_taken_from_z0():
    problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [1.0, 1.0])
    assert problem.solve("mnmgs", z0=[5.0, 3.0]).tolerance == 1e-8 * problem.residual([5.0, 3.0])


def test_no_restart_from_0_where_psi_has_no_value():
    def psi(z):
        return -5 + np.where(z.any(), 0, np.nan) * np.ones(3)

    problem = icp.ICP([[1, 0, 2], [2, 1, 0], [0, 2, 1]], [-1, -1, -1], psi=psi)
    solution = problem.solve(z0=[1.0, 0, 0], raise_on_failure=False)
    assert solution.solved or "psi(z)" not in solution.message


def test_the_answer_shares_no_memory_with_what_a_callback_saw():
    kept = []
    solution = icp.ICP([[2.0]], [-2.0]).solve("mnmgs", callback=lambda state: kept.append(state.z.base))
    for base in kept:
        if base is not None:
            base[:] = 7.0
    assert solution.z[0] == 1.0


def test_ten_times_the_rounding_is_not_the_floor():
    problem, z = icp.ICP([[3.0]], [-1.0]), np.array([1 / 3])
    run, floor = run_on(problem), float(np.linalg.norm(np.maximum(*problem.rounding(z))))
    for times, at_floor in ((1.0, True), (10.0, False)):
        run.best = Best(z, times * floor, Candidate(icp.MNMGS(), ""), icp.MNMGS())
        assert (run.at_floor() is not None) is at_floor


def test_a_solved_answer_survives_ctrl_c_while_it_is_judged_again():
    calls, stop = [], [0]

    def psi(z):
        calls.append(1)
        if len(calls) == stop[0]:
            raise KeyboardInterrupt
        return 0.1 * np.sin(z)

    problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 0.5], psi)
    problem.solve("mnmgs")
    for call in range(4, len(calls) + 1):
        calls.clear()
        stop[0] = call
        assert np.isfinite(problem.solve("mnmgs", raise_on_failure=False).residual)


def test_a_psi_that_changes_its_mind_at_the_same_z_is_found_out():
    """What a user's function says is asked for once more before a run counts as solved."""

    def run(changes_at):
        calls = []

        def psi(z):
            calls.append(1)
            return np.full(1, 5.0 if len(calls) >= changes_at else 0.0)

        solution = icp.ICP([[2.0]], [-2.0], psi).solve("mnmgs", raise_on_failure=False)
        return solution, len(calls)

    solution, calls = run(np.inf)
    assert solution.solved
    assert "different values at the same z" in run(calls)[0].message


def test_what_psi_raised_during_the_run_is_the_cause_of_not_solved():
    def psi(z):
        return 0.1 * z if (z <= 0.01).all() else 1 / 0 * z

    with pytest.raises(icp.NotSolved, match="ZeroDivisionError") as failed:
        icp.ICP(4 * np.eye(3) - np.eye(3, k=1), -np.ones(3), psi).solve()
    assert isinstance(failed.value.__cause__, icp.MapError)
    assert isinstance(failed.value.__cause__.__cause__, ZeroDivisionError)


def test_the_logger_tells_who_begins_and_how_he_ends_and_at_debug_whose_turn_it_is(caplog):
    problem = icp.scenes.membrane(n=900).problem
    with caplog.at_level("INFO", logger="icpmodel"):
        solution = problem.solve()
    told = [record.getMessage() for record in caplog.records]
    assert any("begins: a modulus method" in one for one in told)
    assert any(f"{solution.method!r} ends, solved" in one for one in told)
    assert not any("turn" in one for one in told)
    with caplog.at_level("DEBUG", logger="icpmodel"):
        problem.solve("mnmgs", rtol=1e-2)
    assert "the turn is with MNMGS()" in caplog.text
    assert "it was named" in caplog.text
