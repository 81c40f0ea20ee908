"""Puts a trial's question, and counts what is false in the answer; the package's own judge is not asked."""

from __future__ import annotations

import math
import time
import traceback
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from ...errors import IcpError
from ...icp import ICP
from ...solve.solution import Status
from . import exactly
from .trial import Trial

#: the columns of the table
_FALSE = ("false solved", "false bound", "false unique", "false infeasible", "false crossing")
KINDS = (*_FALSE, "foreign exception", "late", "lost iterate", "crash", "hang")
#: what the computed tolerance may lose to rounding
_ROUNDING = Fraction(1, 10**9)
#: what rounding may add to a residual, as a share of the terms that it is summed of
_LOST = 1e-12
_EPS = Fraction(np.finfo(np.float64).eps)
#: the default of `solve`, and what is at least called wrong by the front ends, which have tolerances of their own
_RTOL, _FRONT = 1e-8, Fraction(1, 10**5)


class Lie(NamedTuple):
    """What `kind` of `KINDS`, and in words what was claimed and what is true."""

    kind: str
    told: str


def examined(trial: Trial) -> tuple[bool, list[Lie]]:
    """Whether the answer to `trial` is that it is solved, and what is false."""
    found: dict[str, Any] = {}
    code, seconds = compile(trial.question(), "question", "exec"), 0.0
    limit = trial.number("time_limit", math.inf) if not trial.asked else math.inf
    try:
        exec(compile(trial.setup(), "setup", "exec"), found)
        # to ask for the time of the process takes a third of a millisecond
        begin = _now() if limit < math.inf else None
        exec(code, found)
        seconds = 0.0 if begin is None else _since(begin)
    except IcpError:
        return False, []
    except Exception as error:
        return False, [_foreign(error)]
    lies = list(_false(trial, found))
    if seconds > 1.1 * limit + 0.2 and _late(trial, code, limit):
        lies.append(Lie("late", f"{seconds:.2g} s, time_limit = {limit:g}"))
    return _is_solved(trial, found["answer"]), lies


def _foreign(error: Exception) -> Lie:
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "icpmodel" in frame.filename]
    where = f" from {frames[-1].filename.rpartition('icpmodel/')[2]}, {frames[-1].name}" if frames else ""
    return Lie("foreign exception", f"{type(error).__name__}{where}: {error}")


def _late(trial: Trial, code: Any, limit: float) -> bool:
    """Whether it is late again, now that all loops are compiled and in memory, on a fresh problem."""
    for _ in range(2):
        again: dict[str, Any] = {}
        exec(compile(trial.setup(), "setup", "exec"), again)
        begin = _now()
        exec(code, again)
        if _since(begin) <= 1.1 * limit + 0.2:
            return False
    return True


def _now() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()


def _since(begin: tuple[float, float]) -> float:
    """Seconds by the clock, or of the processors where these are fewer, as they were at work for others."""
    return min(now - then for now, then in zip(_now(), begin, strict=True))


def _is_solved(trial: Trial, answer: Any) -> bool:
    if trial.front in ("cvxpy", "pyomo"):
        return str(answer.status if trial.front == "cvxpy" else answer.solver.termination_condition) == "optimal"
    return bool(not answer.messages if trial.front == "many" else answer.solved)


def _false(trial: Trial, found: dict[str, Any]) -> Iterator[Lie]:
    if trial.front == "cvxpy":
        yield from _of_program(trial, found)
    elif trial.front == "pyomo":
        yield from _of_model(trial, found)
    elif trial.front == "many":
        answer = found["answer"]
        for row, q in enumerate([found["q"], -found["q"], found["q"]]):
            problem = found["problem"].with_q(q)
            exact = exactly.ExactProblem(problem)
            yield from _of_status(trial, exact, problem, answer.statuses[row], answer.Z[row])
    else:
        yield from _of_solution(trial, found)


def _of_status(trial: Trial, exact: Any, problem: Any, status: Status, z: Any) -> Iterator[Lie]:
    """What is false of "solved", of "infeasible" and of "obstacles cross"."""
    if status is Status.SOLVED and "accuracy" not in dict(trial.options):
        residual, tolerance = exact.residual(z), _tolerance(trial, exact, problem)
        if residual is None or residual > (tolerance * (1 + _ROUNDING)) ** 2:
            true = "none" if residual is None else f"{_root(residual):.3g}"
            yield Lie("false solved", f"the exact residual is {true}, the tolerance {_near(tolerance):.3g}")
    if status is Status.CROSSED and not exact.crosses(z):
        yield Lie("false crossing", f"psi <= upper at z = {list(z)}")
    if status is Status.INFEASIBLE:
        known = trial.known if trial.front != "many" else None
        if known is not None and exact.residual(np.array(known)) == 0:
            yield Lie("false infeasible", f"z = {known} is a solution")
        elif (solutions := exact.solutions()) is not None and solutions[0]:
            yield Lie("false infeasible", f"z = {list(map(_near, solutions[0][0]))} is a solution")


def _of_solution(trial: Trial, found: dict[str, Any]) -> Iterator[Lie]:
    answer, problem = found["answer"], found["problem"]
    exact = exactly.ExactProblem(problem)
    yield from _of_status(trial, exact, problem, answer.status, answer.z)
    if "path" in found and trial.asked != "polish":  # which may prefer a smaller error
        yield from _of_path(exact, problem, answer.z, found["path"])
    elif not np.isfinite(answer.z).all():
        yield Lie("lost iterate", f"z is {answer.z}")
    asks_accuracy = answer.solved and "accuracy" in dict(trial.options)
    bound, z = found.get("bound"), found.get("z", answer.z)
    if "page" in found:
        bound = replace(found["page"].bound, value=None)
    if bound is None and (trial.asked == "print" or asks_accuracy):
        bound = answer.certificate.bound
    if bound is None or not bound.unique:
        return
    solutions = exact.solutions()
    isolated, complete = solutions if solutions is not None else (exact.nearby(answer.z), False)
    if len(isolated) > 1 or (complete and not isolated):
        yield Lie("false unique", f"there are {len(isolated)} solutions; {bound.proof}")
    elif isolated and bound.value is not None:
        limit = trial.number("accuracy", math.inf) if answer.solved and z is answer.z else math.inf
        yield from _of_bound(z, bound, isolated[0], limit)


def _of_bound(z: Any, bound: Any, solution: Any, limit: float) -> Iterator[Lie]:
    """`limit`: the accuracy that was asked for and is said to be reached."""
    for x, true, claimed in zip(exactly.fractions(z), solution, bound.componentwise.tolist(), strict=True):
        least = min(claimed, limit)
        if least < math.inf and abs(x - true) > Fraction(least):
            yield Lie("false bound", f"{_near(abs(x - true)):.17g} is bounded by {least:.17g}; {bound.proof}")
            return


def _of_path(exact: Any, problem: Any, z: Any, path: list[Any]) -> Iterator[Lie]:
    """The answer is as good as the best iterate that was shown."""
    seen = [(residual, x) for x in path if (residual := exact.residual(x)) is not None]
    last = exact.residual(z)
    if not seen:
        return
    least, best = min(seen, key=lambda pair: pair[0])
    with np.errstate(all="ignore"):
        size = sum(float(np.max(abs(problem.A) @ abs(x) + abs(problem.q) + abs(x), initial=0.0)) for x in (z, best))
    if last is None or _root(last) > 1.000001 * _root(least) + _LOST * math.sqrt(exact.n) * size:
        true = "none" if last is None else f"{_root(last):.3g}"
        yield Lie("lost iterate", f"the residual is {true}, an iterate with {_root(least):.3g} was shown")


def _tolerance(trial: Trial, exact: Any, problem: Any) -> Fraction:
    """max(atol, rtol·Res(0)), Res(z0) where ψ has no value at 0 or 0 is a solution."""
    start = exact.residual(np.zeros(exact.n))
    z0 = dict(trial.options).get("z0")
    if not start and z0 is not None:
        start = exact.residual(eval(z0, {"np": np, "problem": problem}))
    relative = Fraction(trial.number("rtol", _RTOL)) * _up(start or Fraction(0))
    return max(Fraction(trial.number("atol", 0.0)), relative)


def _of_program(trial: Trial, found: dict[str, Any]) -> Iterator[Lie]:
    program = found["answer"]
    least = exactly.optimum(trial.A, trial.q, trial.G, trial.c, trial.equal)
    if program.status in ("infeasible", "unbounded") and least is not None:
        yield Lie("false infeasible", f'"{program.status}", and the optimum is {_near(least):.6g}')
    if program.status != "optimal":
        return
    x = exactly.fractions(found["x"].value)
    for i, (row, right) in enumerate(zip(trial.G, trial.c, strict=True)):
        terms = [Fraction(a) * b for a, b in zip(row, x, strict=True)]
        size = abs(Fraction(right)) + sum(map(abs, terms)) + sum(map(abs, exactly.fractions(row)))
        gap = sum(terms, Fraction(0)) - Fraction(right)
        if (abs(gap) if i < trial.equal else gap) > _FRONT * size:
            yield Lie("false solved", f'"optimal", and row {i} is violated by {_near(gap):.3g}')
            return
    if least is not None:
        P, q = [exactly.fractions(row) for row in trial.A], exactly.fractions(trial.q)
        value, size = exactly.objective(P, q, x), sum(abs(a * b) for a, b in zip(q, x, strict=True))
        # the quadratic form of an x with its entries rounded, which need not vanish where that of x does
        rounded = exactly.objective([[abs(a) for a in row] for row in P], [Fraction(0)] * len(x), [abs(a) for a in x])
        allowed = 10 * _FRONT * (abs(least) + size) + _FRONT / 100 * max(map(abs, q)) + _EPS * rounded
        if value - least > allowed:
            yield Lie("false solved", f'"optimal" at {_near(value):.6g}, the optimum is {_near(least):.6g}')


def _of_model(trial: Trial, found: dict[str, Any]) -> Iterator[Lie]:
    """A Pyomo model, in the user's own rows."""
    exact = exactly.ExactProblem(ICP(trial.A, trial.q, np.array(trial.c)))
    if _is_solved(trial, found["answer"]):
        found["model"].solutions.load_from(found["answer"])
        residual = exact.residual(np.array([found["model"].x[i].value for i in range(exact.n)]))
        start = exact.residual(np.zeros(exact.n)) or Fraction(0)
        if residual is None or residual > _FRONT**2 * (start + 1):
            yield Lie("false solved", f'"optimal", and the residual is {_root(residual or Fraction(-1)):.3g}')


def _root(square: Fraction) -> float:
    """√square to a few digits, whatever its size."""
    return _near(_up(square))


def _up(square: Fraction) -> Fraction:
    """√square, to a dozen digits, as a fraction."""
    if square <= 0:
        return Fraction(0)
    shift = (square.numerator.bit_length() - square.denominator.bit_length()) // 2
    return Fraction(math.sqrt(square / Fraction(4) ** shift)) * Fraction(2) ** shift


def _near(x: Fraction) -> float:
    try:
        return float(x)
    except OverflowError:
        return math.inf
