"""The global search that `solve()` makes on a small problem before it reports that all methods failed."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator

from ..methods.enumeration import Enumerate
from ..methods.interior import Interior
from ..methods.milp import MAX_UNKNOWNS, MixedInteger
from ..methods.newton import Newton
from ..methods.proximal import Proximal
from ..methods.restarts import Restarts
from ..numerics import work
from .jobs import MethodSequence
from .newton_josephy import NewtonJosephy
from .run import Run
from .solution import Status
from .stopping import WORTH_ANOTHER_METHOD, StopReason

_LOG = logging.getLogger("icpmodel")
#: random starts where p is nonlinear
_RESTARTS = 20
#: seconds for the whole search where no time limit was given
DEFAULT_SECONDS = 10.0


def search(run: Run, run_methods: Callable[[Run, Iterator[None]], None]) -> None:
    """Try further methods on a problem of up to `MAX_UNKNOWNS` unknowns where all methods of `run` have failed.

    First comes `Enumerate`, the fastest one if there are few active sets. Methods that did not begin at z⁰, or did not
    end, begin again from z⁰. Then come `Restarts`, `Newton`, `Proximal`, `Interior` and `MixedInteger`; where p is
    nonlinear `NewtonJosephy` with random starts. None runs twice from z⁰. Where nothing is found `run` has its former
    status, with a note on what was tried.
    """
    before = run.stop_reason
    if run.best is None or before.status not in WORTH_ANOTHER_METHOD or run.problem.n > MAX_UNKNOWNS:
        return
    job = run.job
    limited = run.limits.time_limit is not None
    seconds = work.seconds_left() if limited else DEFAULT_SECONDS
    limit = f"a search of at most {seconds:.3g} s" + ("" if limited else " (no time_limit was given)")
    why = f"the methods before it {before.status.value}; {limit}"
    done = {repr(job.method) for job in run.tried if job.is_fresh and job.outcome}
    again = (job.method for job in run.tried)
    listed = (
        Enumerate(),
        *again,
        Restarts(),
        Newton(),
        Proximal(),
        Interior(),
        MixedInteger(),
        NewtonJosephy(restarts=_RESTARTS),
    )
    by_name = {repr(one): one for one in listed}
    methods = [one for name, one in by_name.items() if name not in done and one.why_not(run.problem) is None]
    _LOG.info("n = %d: %s begins: %s", run.problem.n, limit, ", ".join(map(repr, methods)))
    run.restart = run.start
    with work.work_limit(seconds):
        run_methods(run, run.steps(MethodSequence(*methods, why=why)))
    if run.stop_reason.status in WORTH_ANOTHER_METHOD or (run.stop_reason.status is Status.TIME_LIMIT and not limited):
        tried = ", ".join(one.name for one in methods)
        note = f"{before.note}; {limit} found no solution ({tried})".removeprefix("; ")
        run.stop_reason = StopReason(before.status, note)
        run.job = job
        run.search_notes = (f"then {limit} found nothing",)
