"""Runs of competitors within a time limit, which is enforced from outside."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from ..errors import OutOfTime
from ..solve.goal import RTOL
from ..solvers.foreign import Claim
from ..solvers.time_limited import time_limited
from .cases import Case
from .competitors import Competitor, LinearSolve


def first_run(case: Case, one: Competitor, tolerance: float, limit: float) -> str | None:
    """Why `one` does not take part, or None. Its first run imports and compiles what it needs.

    What nothing can interrupt runs in a process first, which is killed at the `limit` in seconds.
    """

    def first() -> None:
        one.build(case)
        one.run(case, tolerance, limit)

    try:
        if not one.keeps_time_limit:
            _run_limited(lambda: one.why_not(case), case, limit)
        if reason := one.why_not(case):
            return reason
        if one.keeps_time_limit:
            one.run(case, tolerance, limit)
        else:
            _run_limited(first, case, limit)
    except OutOfTime:
        return f"its set-up and first run take longer than time_limit = {limit:g} s"
    except ChildProcessError as error:
        return str(error)
    return None


def _run_limited(call: Callable[[], Any], case: Case, limit: float) -> Any:
    """The result of `call`, in a process that is killed at the limit if it may take longer. Raises OutOfTime."""
    return next(time_limited(lambda: iter([call()]), case.problem, 1, time.perf_counter() + limit))


def timed_run(case: Case, one: Competitor, tolerance: float, limit: float) -> Claim:
    """A run of `one`, ended at the `limit` in seconds."""
    if one.keeps_time_limit:
        return one.run(case, tolerance, limit)
    try:
        claim: Claim = _run_limited(lambda: one.run(case, tolerance, limit), case, limit)
    except (OutOfTime, ChildProcessError) as error:
        return Claim(None, str(error), False, limit)
    return claim


def linear_solve(case: Case, repeats: int, limit: float) -> float | None:
    """The median time of `LinearSolve`, None where it fails or takes too long."""
    one = LinearSolve()
    if first_run(case, one, RTOL, limit) is not None or not one.run(case, RTOL, limit).solved:
        return None
    return float(np.median([one.run(case, RTOL, limit).seconds for _ in range(repeats)]))
