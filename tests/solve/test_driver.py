"""The loop: when it stops, what it returns, and that it never calls solved what is not."""

import signal
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import ClassVar

import numba
import numpy as np
import pytest
import scipy.sparse as sp
from benchmarks.families import drawn
from known_answers import PAIR, attempt
from runs import ended, run_on

import icpmodel as icp
from icpmodel import Status
from icpmodel.errors import MapError, SingularOperator
from icpmodel.methods.contract import Method
from icpmodel.solve.jobs import MethodSequence


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


ONE = icp.ICP([[1.0]], [-1.0])  # z* = 1, Res_D(z) = |z - 1| for z > 0, Res_D(0) = 1


def test_a_lying_hint_is_never_the_verdict():
    """Law 3: the residual that a method hands up is a hint when to look."""
    solution = attempt(ONE, Scripted(script=((5.0, 0.0), (1.0, None))))
    assert solution.solved
    assert solution.z.tolist() == [1.0]
    assert solution.iterations == 2


def test_the_last_iterate_is_tested_and_max_iter_counts_steps():
    script = ((3.0, None), (2.0, None), (1.0, None))
    assert ONE.solve(Scripted(script=script), max_iter=3).solved
    solution = attempt(ONE, Scripted(script=script), max_iter=2)
    assert solution.status is Status.ITERATION_LIMIT
    assert solution.iterations == 2


def test_a_start_that_solves_needs_no_step():
    assert ONE.solve("mnmgs", z0=[1.0], max_iter=0).iterations == 0


def test_the_best_iterate_is_returned_not_the_last():
    solution = attempt(ONE, Scripted(script=((1.5, None), (9.0, None))), max_iter=10)
    assert solution.z.tolist() == [1.5]
    assert solution.residual == 0.5


@pytest.mark.parametrize("options", [{"max_iter": 20}, {"rtol": 1e-2}])
def test_no_iterate_that_was_shown_is_better_than_the_answer(options):
    """Also where the methods run on a presolved problem, whose residual is another one."""
    A = [[5.0, -4.0, 0.0, 9.0], [16.0, -3.0, 0.0, 12.0], [0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]]
    problem = icp.ICP(A, [-8.0, -32.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0], upper=[4.0, 1.0, 0.0, 0.0])
    shown = []
    answer = attempt(problem, family="paper", callback=lambda state: shown.append(state.residual), **options)
    assert len(shown) > 10
    assert answer.residual <= min(shown)


def test_nan_and_overflow_are_divergence_not_success():
    for bad in (np.nan, np.inf):
        solution = attempt(ONE, Scripted(script=((1.2, None), (bad, None))))
        assert solution.status is Status.DIVERGED
        assert solution.z.tolist() == [1.2]
    nan_hint = attempt(ONE, Scripted(script=((1.2, np.nan), (1.0, np.nan))))
    assert nan_hint.solved


def test_a_method_that_runs_away_is_called_diverged():
    solution = attempt(icp.ICP([[1.0]], [-1.0]), "mnmgs", phi=-1.5, z0=[1.1])
    assert solution.status is Status.DIVERGED
    assert np.isfinite(solution.z).all()
    assert "Advice" in solution.message


def test_rounding_is_called_precision_limit_with_its_floor():
    problem = icp.scenes.manufactured_affine(n=100).problem
    solution = attempt(problem, "mnmgs", rtol=0.0, atol=0.0)
    assert solution.status is Status.PRECISION_LIMIT
    assert "rounding leaves" in solution.message
    assert solution.residual <= 2 * np.linalg.norm(np.maximum(*problem.rounding(solution.z)))


def test_the_time_limit_is_in_seconds_and_returns_the_best_iterate():
    solution = attempt(ONE, Endless(seconds=0.002), z0=[9.0], time_limit=0.02)
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


def test_a_psi_that_fails_late_loses_nothing():
    calls = []

    def psi(z):
        calls.append(1)
        if len(calls) > 20:
            raise RuntimeError("sensor lost")
        return 0.5 * np.sin(z)

    solution = attempt(icp.ICP([[2.0, -1.9], [-1.9, 2.0]], [-1.0, 0.5], psi), "mnmgs")
    assert solution.status is Status.MAP_FAILED
    assert "sensor lost" in solution.message
    assert solution.iterations > 3
    assert np.isfinite(solution.z).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_psi_that_is_not_finite_at_the_start_is_the_user_s_fault_and_said_so(bad):
    problem = icp.ICP(np.eye(2), [1.0, 1.0], lambda z: np.array([0.0, bad]))
    with pytest.raises(icp.MapError, match=r"psi\(z\)\[1\] is (nan|inf) at the start"):
        problem.solve()


def test_loud_by_default_and_the_error_carries_the_solution(slow):
    with pytest.raises(icp.NotSolved, match=r"iteration limit.*Advice: raise max_iter") as error:
        slow.solve("mnmgs", max_iter=3)
    assert error.value.solution.iterations == 3


def test_the_tolerance_is_relative_to_a_scale_that_no_start_changes():
    """Law 5: Res_D(0), or where 0 is a solution the smallest term of it; atol is judged by the Res of the paper."""
    membrane = icp.scenes.membrane(n=100).problem
    at_0 = icp.ICP(PAIR, [1.0, 2.0])
    for problem, scale in ((membrane, membrane.residual(np.zeros(100))), (at_0, 0.5)):
        for z0 in (None, np.full(problem.n, 1e6), 1e8 * (-1.0) ** np.arange(problem.n)):
            solution = problem.solve("mnmgs", z0=z0, rtol=1e-6)
            assert solution.tolerance == 1e-6 * scale
            assert problem.residual(solution.z) == solution.residual <= solution.tolerance
    rough = membrane.solve("mnmgs", atol=0.1)
    assert rough.solved
    assert membrane.paper_residual(rough.z) <= 0.1
    assert rough.residual > rough.tolerance


def test_where_nothing_is_large_a_residual_is_small_beside_z_and_its_start():
    """q = 0 and ψ(0) = 0, or ψ without a value at 0: Res_D(z) ≤ rtol·min(‖z‖, ‖z⁰‖); what runs away is no solution."""
    sine = icp.ICP([[1.0]], [0.0], icp.Elementwise(lambda z: np.sin(2 * z), lambda z: 2 * np.cos(2 * z)))
    away = icp.ICP([[1.0]], [0.0], lambda z: z + np.minimum(z * z, 1.0))
    inverse = icp.ICP([[1.0]], [0.0], icp.Elementwise(lambda z: 1 / np.where(z, z, np.nan), lambda z: -1 / z**2))
    assert sine.solve(z0=[1.0]).z == pytest.approx([0.94774713], abs=1e-8)
    assert inverse.solve(z0=[3.0]).z == pytest.approx([1.0], abs=1e-8)
    assert not attempt(away, "mnmj", z0=[1e8], max_iter=20).solved
    for z0 in (1e-6, 1.0, 1e6):
        solution = attempt(icp.ICP([[2.0]], [0.0]), "mnmmod", z0=[z0])
        assert solution.residual <= 1e-8 * abs(solution.z[0]) or not solution.solved


@pytest.mark.parametrize("d", [-3e-316, -1e-315, -7e-322])
def test_a_tolerance_that_underflows_is_not_rounded_up(d):
    """1e-8·Res_D(0) is less than the smallest float here, which a residual may then not be."""
    problem = icp.ICP([[0.0]], [-1.0], psi=2 * d, upper=d)
    most = Fraction(1e-8) * abs(Fraction(d))
    for solution in (attempt(problem), attempt(problem, "newton")):
        assert Fraction(solution.tolerance) <= most
        assert not solution.solved or abs(Fraction(solution.z[0]) - Fraction(d)) <= most
    many = icp.solve_many([[0.0]], [[-1.0]], 2 * d, upper=d, raise_on_failure=False)
    assert Fraction(many.tolerances[0]) <= most


def test_history_holds_every_tested_iterate():
    problem = icp.scenes.membrane(n=100).problem
    solution = problem.solve("mnmgs", history=True)
    past = solution.history
    assert past.iteration.tolist() == list(range(solution.iterations + 1))
    assert past.residual[-1] == solution.residual
    assert past.residual[0] == pytest.approx(problem.residual(np.zeros(100)))
    assert (np.diff(past.seconds) >= 0).all()


def test_callback_stops_the_run_and_sees_a_read_only_iterate():
    def callback(state):
        with pytest.raises(ValueError, match="read-only"):
            state.z[0] = 0.0
        return state.iteration == 2

    solution = attempt(icp.scenes.membrane(n=100).problem, "mnmgs", callback=callback)
    assert solution.status is Status.STOPPED
    assert solution.iterations == 2


@pytest.mark.parametrize(
    "error",
    [MapError("mine"), SingularOperator("mine", 0), MemoryError("mine"), StopIteration("mine"), ValueError("mine")],
)
def test_what_a_callback_raises_reaches_the_caller(error):
    """It is not taken for an error of psi, of the method, or for want of memory, and no other method begins."""
    calls = []

    def callback(state):
        calls.append(state)
        raise error from KeyError("the cause")

    with pytest.raises(type(error), match="mine") as caught:
        icp.scenes.membrane(n=100).problem.solve(callback=callback, raise_on_failure=False)
    assert len(calls) == 1
    assert isinstance(caught.value.__cause__, KeyError)


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
        ({"z0": [float("nan")]}, r"z0\[0\] is nan"),
        ({"callback": 3}, "callback is 3; a function"),
    ],
)
def test_wrong_options_are_named(options, words):
    with pytest.raises(icp.InputError, match=words):
        ONE.solve("mnmgs", **options)


@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError])
def test_what_happens_while_the_next_method_is_chosen_loses_nothing(error):
    class Raises(MethodSequence):
        def next(self):
            if not self.jobs:
                raise error
            return super().next()

    run = run_on(CYCLIC)
    solution = ended(run, run.steps(Raises(icp.PSOR())))
    assert solution.status is (Status.INTERRUPTED if error is KeyboardInterrupt else Status.MEMORY_LIMIT)
    assert repr(solution.last_method) == "PSOR()"
    assert np.isfinite(solution.residual)


class Greedy(icp.MNMGS):
    """A method whose second step needs more memory than there is."""

    def iterates(self, problem, z):
        yield z, None
        raise MemoryError


def test_a_method_that_needs_too_much_memory_gives_way_to_the_next():
    run = run_on(CYCLIC)
    assert ended(run, run.steps(MethodSequence(Greedy(), icp.Newton()))).z == pytest.approx(np.full(3, 1 / 3))
    solution = attempt(CYCLIC, Greedy())
    assert solution.status is Status.MEMORY_LIMIT


def test_an_operator_that_is_singular_is_passed_over_or_raised():
    singular = icp.MNMJ(phi=[-2.0, 0.0, 0.0])
    run = run_on(CYCLIC)
    ended(run, run.steps(MethodSequence(singular, icp.Newton())))
    assert [repr(one.method) for one in run.tried] == ["Newton()"]
    with pytest.raises(icp.SingularOperator):
        CYCLIC.solve(singular)


def test_a_choice_without_an_iterate_says_which_operator_is_singular():
    problem = icp.ICP([[0.0, 1.0], [1.0, 0.0]], [-1.0, -1.0])
    solution = problem.solve(family="paper", raise_on_failure=False)
    assert (solution.status, solution.iterations) == (Status.STAGNATED, 0)
    with pytest.raises(icp.NotSolved, match="singular to working precision"):
        problem.solve(family="paper")


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
        assert 2 * len(asked) < solution.iterations
        shown = problem.solve(rtol=1e-10, history=True, callback=lambda at, seen=seen: seen.append((at.z, at.residual)))
        assert np.array_equal(shown.z, solution.z)  # who looks on changes nothing, and sees Res_D(z)
        assert [residual for _, residual in seen] == shown.history.residual.tolist()
        assert [residual for _, residual in seen] == pytest.approx([problem.residual(z) for z, _ in seen], rel=1e-6)


@pytest.mark.slow
def test_an_untrue_lipschitz_constant_leaves_what_sweeps_with_psi_itself_solve():
    rng, shapes, found = np.random.default_rng(0), (np.sin, lambda t: -np.arctan(t), lambda t: np.sqrt(1.0 + t * t)), 0
    for k in range(24):
        A, steep, scale = drawn("graph-expander", 20, rng).A, *rng.uniform(0.5, 2.0, 2)
        psi = icp.Elementwise(lambda t, f=shapes[k % 3], s=steep, w=scale: s * f(w * t), lipschitz=0.5)
        problem = icp.ICP(A, rng.normal(size=A.shape[0]), psi)
        if attempt(problem, "mnmgs").solved:
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


def test_a_psi_with_a_will_of_its_own_is_not_called_solved():
    calls = [0]

    def psi(z):
        calls[0] += 1
        return np.full(1, float(calls[0] % 7 == 0))

    for first in range(50):
        calls[0] = first
        solution = attempt(icp.ICP([[2.0]], [2.0], psi), "mnmgs", z0=[3.0])
        assert not solution.solved or solution.residual <= solution.tolerance


def test_a_compiled_psi_that_raises_is_the_map_s_error():
    pole = numba.njit(lambda s: 0.1 / (s - 1.0))
    problem = icp.ICP([[2.0]], [-2.0], icp.Elementwise(pole, c=-5.0))
    solution = attempt(problem, "mnmgs", z0=[3.0])
    assert solution.status is Status.MAP_FAILED
    assert "ZeroDivisionError" in solution.message


def test_the_answer_shares_no_memory_with_what_a_callback_saw():
    kept = []
    solution = icp.ICP([[2.0]], [-2.0]).solve("mnmgs", callback=lambda state: kept.append(state.z.base))
    for base in kept:
        if base is not None:
            base[:] = 7.0
    assert solution.z[0] == 1.0


def test_a_solved_answer_survives_ctrl_c_while_it_is_judged_again():
    calls, stop = [], [0]

    def psi(z):
        calls.append(1)
        if len(calls) == stop[0]:
            raise KeyboardInterrupt
        return 0.1 * np.sin(z)

    problem = icp.ICP(PAIR, [-1.0, 0.5], psi)
    problem.solve("mnmgs")
    for call in range(4, len(calls) + 1):
        calls.clear()
        stop[0] = call
        assert np.isfinite(attempt(problem, "mnmgs").residual)


def test_what_psi_raised_during_the_run_is_the_cause_of_not_solved():
    def psi(z):
        return 0.1 * z if (z <= 0.01).all() else 1 / 0 * z

    with pytest.raises(icp.NotSolved, match="ZeroDivisionError") as failed:
        icp.ICP(4 * np.eye(3) - np.eye(3, k=1), -np.ones(3), psi).solve()
    assert isinstance(failed.value.__cause__, icp.MapError)
    assert isinstance(failed.value.__cause__.__cause__, ZeroDivisionError)


def test_obstacles_further_apart_than_floats_reach_cause_no_warning():
    with np.errstate(all="raise"):
        solution = icp.ICP([[0.0]], [1.0], psi=-1e308, upper=1e308).solve(max_iter=1, raise_on_failure=False)
    assert solution.status is icp.Status.ITERATION_LIMIT


def test_a_contradiction_up_to_rounding_is_in_the_message():
    """A = I − yyᵀ has Ay = 0 but for rounding, and yᵀq < 0: a frame beyond its limit load."""
    stalled = 0
    for seed in range(12):
        y = np.random.default_rng(seed).random(3) + 0.1
        y /= np.linalg.norm(y)
        solution = icp.ICP(np.eye(3) - np.outer(y, y), -np.ones(3)).solve("lemke", raise_on_failure=False)
        if solution.status is not icp.Status.INFEASIBLE:
            stalled += 1
            assert "up to rounding there is no solution" in solution.message
    assert stalled


def test_no_contradiction_is_claimed_where_a_method_fails_by_itself():
    problem = icp.ICP([[1, 0, 2], [2, 1, 0], [0, 2, 1]], [-1, -1, -1])
    assert "up to rounding" not in problem.solve("mnmgs", raise_on_failure=False).message


def test_ctrl_c_in_the_check_of_a_stalled_run_keeps_the_iterate():
    """The sweeps need no derivative: only the message asks for it."""

    def interrupted(z):
        raise KeyboardInterrupt

    psi = icp.Function(np.zeros_like, interrupted, lipschitz=0.0)
    solution = icp.ICP([[1, 0, 2], [2, 1, 0], [0, 2, 1]], [-1, -1, -1], psi).solve("mnmgs", raise_on_failure=False)
    assert solution.status is icp.Status.INTERRUPTED
    assert np.isfinite(solution.z).all()


def test_rows_that_overflow_raise_no_warning_where_a_run_fails():
    A = [[1.0, 0.0, -1.0], [0.0, 1e307, -1e300], [0.0, -1.0, 1e-150]]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solution = icp.ICP(A, np.zeros(3), [0.0, 1.0, 0.0]).solve("accelerated", max_iter=100, raise_on_failure=False)
    assert not solution.solved


@pytest.mark.parametrize("method", ["psor", "mnmj"])
@pytest.mark.parametrize(
    "problem",
    [
        icp.ICP([[1, -1], [-1, 1]], [-1, -1]),
        icp.ICP([[1, -1], [-1, 1]], [1, 1], -np.inf),
        icp.ICP(np.eye(2), [1, 1], icp.Affine([[0, 1], [1, 0]], [1, 1])),
    ],
)
def test_iterates_that_move_on_for_ever_are_no_solution(method, problem):
    """There is no solution: z grows or falls by the same step for ever."""
    solution = problem.solve(method, raise_on_failure=False)
    assert solution.status is icp.Status.INFEASIBLE
