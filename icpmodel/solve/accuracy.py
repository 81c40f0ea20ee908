"""Solve to a given accuracy: solve, bound the error, tighten the tolerance, and repeat."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ..errors import MapError, NotApplicable, OutOfTime
from ..numerics.arrays import Vector
from ..numerics.rounding import rounded_up
from ..problem.data import ProblemData
from ..theory.certificates.bounds import error_bound
from .run import Run
from .solution import Status
from .stopping import StopReason

#: the error bound falls about as the residual does: the next tolerance is the last residual times this number times
#: min(accuracy/bound, 1); and the least factor of the last residual, which also applies without a bound
_MAX_FACTOR = 0.5
_MIN_FACTOR = 1e-3


def solve_to_accuracy(run: Run, accuracy: float, run_methods: Callable[[], None]) -> None:
    """Repeat `run` with smaller tolerances until max|z − z*| ≤ `accuracy` is certified, and set its `stop_reason`.

    It gives up after a run that is not SOLVED, or does not reduce the residual.

    Raises
    ------
    NotApplicable
        Where nothing bounds the error of the problem.
    """
    problem = run.problem
    residual = run.start_residual
    first = None
    with suppress(OutOfTime, MemoryError):  # then nothing is known before the first run
        first = error_bound(problem, run.start)
    # only a small bound can decide whether moving obstacles cross
    if first is not None and not first.unique and (problem.upper is None or problem.psi.is_constant):
        raise NotApplicable(f"accuracy: nothing bounds the error of this problem: {first.reason}; give rtol instead")
    bound = None if first is None else first.value
    z = run.start
    while bound is None or bound > accuracy or run.iteration < 0:
        share = _MIN_FACTOR if bound is None else max(_MAX_FACTOR * min(accuracy / bound, 1.0), _MIN_FACTOR)
        run.goal = replace(run.goal, tolerance=share * residual if bound is None or bound > accuracy else np.inf)
        run.is_over = False
        run_methods()
        if run.best is None:
            return
        z = run.best.z
        before = residual
        residual = run.best.residual
        try:
            bound = certified_error(problem, z)
        except KeyboardInterrupt:
            bound = None
            run.stop_reason = StopReason(Status.INTERRUPTED, "by Ctrl-C")
        if run.stop_reason.status is not Status.SOLVED or not residual < before:
            break
    if bound is not None and bound <= accuracy:
        run.stop_reason = StopReason(Status.SOLVED, "")
    else:
        known = "nothing is certain of its error" if bound is None else f"its error is at most {rounded_up(bound)}"
        status = Status.PRECISION_LIMIT if run.stop_reason.status is Status.SOLVED else run.stop_reason.status
        run.stop_reason = StopReason(
            status, f"{run.stop_reason.note}; {known}; {accuracy:.3g} was wanted".removeprefix("; ")
        )


def certified_error(problem: ProblemData, z: Vector) -> float | None:
    """The bound on max|z − z*|, None where there is none within the limits."""
    with suppress(MapError, OutOfTime, MemoryError):
        return error_bound(problem, z).value
    return None
