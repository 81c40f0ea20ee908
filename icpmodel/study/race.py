"""Speed against accuracy: every competitor at every tolerance, timed in turn, judged by one measure of error."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from ..errors import IcpError, InputError, Interrupted
from ..methods.contract import Method, named
from ..numerics.arrays import Vector, as_list, as_number
from ..numerics.rounding import public_entry
from ..present.rendering import render
from ..present.shown import Plotted
from ..present.table import Table, Tabular, folded
from ..problem.data import ProblemLike, as_problem
from ..scenes import Scene
from ..scenes.registry import title as called
from ..solve.driver import solve
from ..solve.goal import RTOL
from ..solve.progress import status_line, time_left
from ..solvers.foreign import ForeignSolver, chosen_solvers
from .cases import Case, fresh, unbroken
from .competitors import Competitor, Entry, Foreign, Limit, Own, own_methods
from .timing import clocked, interleaved, machine, timed

#: the tolerances that each competitor is asked for
TOLERANCES = tuple(10.0**-k for k in range(2, 13))
#: own methods of which a chart is made where none are named
METHODS = ("mnmgs", "mnmaor, tuned", "psor, tuned", "newton", "multilevel")
#: a claim of success is wrong where the residual, relative to Res_D(0), is so many times what was asked for
_WRONG = 10.0
#: a run that takes so many seconds is timed once
_ONCE = 1.0
#: how often what a competitor is given is made, for the median
_BUILDS = 3
#: after iterate k of a run the error is next computed at so many times k
_TRACED = 1.2

#: z ↦ its error, None where it has none
_Error = Callable[[Any], float | None]
_Say = Callable[[str], None]


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Race(Plotted, Tabular):
    """What a race found: `entries`, one per competitor and tolerance; `traces`, name → (seconds, errors) of one run
    of each own method; `measure` what "error" is, in words; `limit` the seconds of one linear solve with A, None where
    PyAMG could not do it; `skipped` pairs (name, reason); `command` what makes the race again.

    Examples
    --------
    >>> found = icp.race(ICP([[2.0]], [-3.0]), methods=["mnmgs"], solvers=[], repeats=1)
    >>> found.measure, found.table().heads[:4]
    ('certified bound on max |z - z*|', ('competitor', 'kind', 'tolerance', 'time, s'))
    >>> found.plot("no-such-folder/race.png")
    Traceback (most recent call last):
    icpmodel.errors.FileError: no-such-folder/race.png: the folder no-such-folder does not exist
    """

    title: str
    measure: str
    entries: tuple[Entry, ...]
    traces: dict[str, tuple[Vector, Vector]] = field(default_factory=dict)
    limit: float | None = None
    skipped: tuple[tuple[str, str], ...] = ()
    command: str = ""

    def table(self) -> Table:
        """One row per competitor and tolerance, times in seconds."""
        heads = ("competitor", "kind", "tolerance", "time, s", "lowest", "highest", "build, s", "set-up, s")
        rows: list[tuple[Any, ...]] = []
        for one in self.entries:
            times = (one.median, min(one.seconds), max(one.seconds), one.build, one.setup)
            said = (one.error, one.residual, one.claim, "wrong" if one.wrong else "")
            rows.append((one.name, one.kind, one.tolerance, *times, *said))
        if self.limit is not None:
            rows.append((Limit.name, Limit.kind, RTOL, *[self.limit] * 3, *[None] * 4, "", ""))
        return Table(self.title, (*heads, self.measure, "Res_D(z) / Res_D(0)", "claim", "is"), tuple(rows))

    def left_out(self) -> list[str]:
        """Who did not take part, and why."""
        return [f"{name}: left out, {reason}" for name, reason in self.skipped]

    def __str__(self) -> str:
        return "\n".join([folded(self.winner), "", str(self.table()), *map(folded, self.left_out())])

    def _repr_html_(self) -> str:
        winner, left_out = (render("folded.html", text=text) for text in (self.winner, "\n".join(self.left_out())))
        return winner + self.table().to_html() + left_out

    @property
    def winner(self) -> str:
        """Who came first to Res_D(z) ≤ 1e-8·Res_D(0), or where nobody did to the smallest tolerance that somebody
        reached, in one sentence; who is level with the first, as their times overlap, is named beside it.

        Examples
        --------
        >>> icp.race(ICP([[2.0]], [-3.0]), methods=[], solvers=[], repeats=1).winner.split(", in")[0]
        'First to Res_D(z) <= 1e-08 Res_D(0): solve()'
        """
        return self.in_words("First to Res_D(z) <= {goal:g} Res_D(0)")

    def quickest(self, goal: float) -> dict[str, Entry]:
        """For each competitor the quickest of its runs with Res_D(z) ≤ goal·Res_D(0), the quickest one first."""
        best: dict[str, Entry] = {}
        for one in sorted(self.entries, key=lambda one: one.median):
            if one.residual is not None and one.residual <= goal:
                best.setdefault(one.name, one)
        return best

    def in_words(self, opening: str) -> str:
        """The winner, after the `opening` with the {goal} in it."""
        for goal in (RTOL, *sorted({one.tolerance for one in self.entries})):
            best = self.quickest(goal)
            if best:
                break
        else:
            return "Nobody reached any of the tolerances."
        first, *others = best.values()
        level = [one.name for one in others if min(one.seconds) <= max(first.seconds)]
        once = "" if first.seconds[1:] else ", timed once"
        told = f"{opening.format(goal=goal)}: {first.name}, in {first.median:.3g} s{once}"
        if level:
            return f"{told}; level with it, as the times overlap: {', '.join(level)}."
        after = others and f"; next {others[0].name}, {others[0].median / first.median:.3g} times as long"
        return f"{told}{after or ', and nobody else'}."


@public_entry
def race(
    problem: ProblemLike,
    methods: Sequence[str | Method] | None = None,
    solvers: Sequence[str | ForeignSolver] | None = None,
    *,
    z_exact: Any = None,
    tolerances: Sequence[float] = TOLERANCES,
    repeats: int = 3,
    time_limit: float = 10.0,
    progress: bool = False,
    command: str = "",
) -> Race:
    """Own methods and foreign solvers at every tolerance, build and set-up included, in turn, `repeats` times.

    A competitor whose answer is already as good as a smaller tolerance asks for is not run at that one again.

    The error is max|z − z*| where `z_exact` is given; else |z − ẑ| + β, a certified bound, with a polished answer ẑ and
    its own error bound β; else, where there is no bound, Res_D(z)/Res_D(0). One measure holds for all of a race.
    Parameters: `methods` by name ("mnmaor, tuned" and "psor, tuned" have the ω of the estimated Jacobi radius) or as
    objects, beside `solve()` itself; `solvers`, any foreign solver by name or as an object, both by default what the
    problem admits; `z_exact` shape (n,), by default that of the scene where `problem` is one;
    `tolerances`, to each competitor in its own sense; `repeats` ≥ 1, one for runs of a second or more; `time_limit`
    seconds for a run, after which a competitor is not asked for more; `progress` shows a line on what is going on;
    `command` is noted.
    Returns a `Race`. Raises InputError, and Interrupted at Ctrl-C, whose `report` is the race as far as it was.

    Examples
    --------
    >>> found = icp.race(ICP([[2, -1], [-1, 2]], [-1, 3]), ["mnmgs"], ["osqp"], z_exact=[0.5, 0.0], repeats=1)
    >>> sorted({entry.name for entry in found.entries}), found.measure
    (['mnmgs', 'osqp', 'solve()'], 'max |z - z*|')
    """
    if isinstance(problem, Scene) and z_exact is None:
        z_exact = problem.z_exact
    problem = as_problem(problem)
    case = Case("this problem", problem)
    repeats = int(as_number(repeats, "repeats", least=1, whole=True))
    limit = as_number(time_limit, "time_limit", above=0.0)
    asked = {as_number(one, "tolerances", above=0.0, below=1.0) for one in as_list(tolerances, "tolerances")}
    if not asked:
        raise InputError("tolerances is empty; at least one number in (0, 1) was expected")
    named = Own(), *_own(methods), *map(Foreign, chosen_solvers(solvers, "race"))
    reasons = {one: one.why_not(case) for one in named}
    entered = [one for one, reason in reasons.items() if reason is None]
    skipped = tuple((one.name, reason) for one, reason in reasons.items() if reason is not None)
    found = Race(title=f"{called(problem)} ({machine()})", measure="", entries=(), skipped=skipped, command=command)
    entries: dict[tuple[str, float], Entry] = {}
    try:
        runs = len(entered) * len(asked) * repeats
        opening = f"{len(entered)} competitors, at most {runs} runs of up to {limit:g} s: {runs * limit:.3g} s at most"
        with status_line(progress, opening) as say:
            say("the measure of error")
            measure, error = _measure(case, z_exact)
            found = replace(found, measure=measure)
            say("one linear solve")
            linear = partial(Limit().run, case, RTOL, limit)
            if linear().solved:
                seconds = timed({"solve": lambda: linear().seconds}, repeats, warm=False)["solve"]
                found = replace(found, limit=float(np.median(seconds)))
            for entry in _run(case, entered, sorted(asked, reverse=True), repeats, limit, error, say):
                entries[entry.name, entry.tolerance] = entry
            for one in entered:
                if isinstance(one, Own):
                    say(f"{one.name}: its path")
                    with contextlib.suppress(IcpError):
                        found.traces[one.name] = _path(case, one, min(asked), limit, error)
    except KeyboardInterrupt:
        raise Interrupted(replace(found, entries=tuple(entries.values()))) from None
    return replace(found, entries=tuple(entries.values()))


def _own(methods: Sequence[str | Method] | None) -> list[Competitor]:
    """The own methods that take part; what was asked for by name must be known."""
    known = {one.name: one for one in own_methods()}
    return [
        Own(repr(one), one) if isinstance(one, Method) else known.get(one) or Own(one, named(one))
        for one in (METHODS if methods is None else as_list(methods, "methods"))
    ]


def _measure(case: Case, z_exact: Any) -> tuple[str, _Error]:
    """What "error" is in words, and the function of z that gives it."""
    problem = case.problem
    if z_exact is not None:
        exact = problem.vector(z_exact, "z_exact", finite=True)
        known = 0.0
        words = "max |z - z*|"
    else:
        best = unbroken(solve(problem, rtol=1e-12, raise_on_failure=False)).polish()
        if best.error_bound is None:
            return "Res_D(z) / Res_D(0)", case.judged
        exact = best.z
        known = best.error_bound
        words = "certified bound on max |z - z*|"

    def error(z: Any) -> float | None:
        distance = float(np.abs(np.asarray(z, dtype=np.float64) - exact).max()) + known
        return distance if np.isfinite(distance) else None

    return words, error


def _run(
    case: Case, entered: list[Competitor], asked: list[float], repeats: int, limit: float, error: _Error, say: _Say
) -> Iterator[Entry]:
    """In the first round it turns out who needs which tolerances and how long; the short runs are then repeated."""
    for one in entered:
        say(f"{one.name}: warming up")
        one.run(case, asked[0], limit)  # imports and compiles
    built = timed({one.name: clocked(partial(one.build, case)) for one in entered}, _BUILDS, warm=False)
    builds = {name: float(np.median(seconds)) for name, seconds in built.items()}
    enough = dict.fromkeys(builds, 1.0)  # tolerances from this one on need no run of their own, 0 for none at all
    again = {}
    entries = {}
    done = 0
    total = len(asked) * len(entered)
    begin = time.monotonic()
    for tolerance in asked:
        for one in (one for one in entered if tolerance < enough[one.name]):
            say(f"round 1 of {repeats}: {one.name} at {tolerance:.0e}{time_left(begin, done, total)}")
            done += 1
            run = one.run(case, tolerance, limit)
            build = builds[one.name]
            entry = Entry(one.name, one.kind, tolerance, (build + run.seconds,), build, run.setup, claim=run.words)
            if run.z is not None:
                entry = replace(entry, error=error(run.z), residual=case.judged(run.z))
            wrong = run.solved and (entry.residual is None or entry.residual > _WRONG * tolerance)
            entries[one.name, tolerance] = entry = replace(entry, wrong=wrong)
            yield entry
            if run.seconds > limit or run.z is None:
                enough[one.name] = 0.0
            elif entry.residual is not None:  # it has reached more than it was asked for
                enough[one.name] = entry.residual
            if entry.seconds[0] < _ONCE:
                again[one.name, tolerance] = partial(one.run, case, tolerance, limit)
    for key, run in interleaved(again, repeats - 1, say=lambda k: say(f"round {k + 1} of {repeats}")):
        entries[key] = replace(entries[key], seconds=(*entries[key].seconds, builds[key[0]] + run.seconds))
        yield entries[key]


def _path(case: Case, one: Own, tolerance: float, limit: float, error: _Error) -> tuple[Vector, Vector]:
    """(seconds, errors) along one run, at iterates in geometric progression; what the errors take is not counted."""
    seen: list[tuple[float, float | None]] = []
    following = 0
    lost = 0.0
    unseen = None

    def look(state: Any) -> None:
        nonlocal following, lost, unseen
        unseen = state if state.iteration < following else None
        if unseen is None:
            begin = time.perf_counter()
            seen.append((state.seconds - lost, error(state.z)))
            following = max(state.iteration + 1, int(_TRACED * state.iteration))
            lost += time.perf_counter() - begin

    problem = fresh(case.problem)
    options: dict[str, Any] = {"rtol": tolerance, "time_limit": limit, "raise_on_failure": False}
    unbroken(problem.solve(one.method(problem), callback=look, **options))
    if unseen is not None:  # the last iterate
        seen.append((unseen.seconds - lost, error(unseen.z)))
    seconds, errors = np.array([(t, e) for t, e in seen if e is not None]).reshape(-1, 2).T
    return seconds, errors
