"""Speed against accuracy: every competitor at every tolerance, timed in turn, judged by one measure of error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import IcpError, InputError, Interrupted
from ..icp import ICP
from ..methods.contract import Method, named
from ..numerics.arrays import Vector, as_list, as_number
from ..present.table import Table
from ..problem.data import as_problem
from ..solve.driver import RTOL
from ..solve.progress import status_line
from ..solvers.contract import ForeignSolver, chosen_solvers
from .competitors import Case, Competitor, Foreign, Own, Solve, limits, own_methods
from .timing import machine

#: the tolerances that each competitor is asked for
TOLERANCES = tuple(10.0**-k for k in range(2, 13))
#: own methods of which a chart is made where none are named
METHODS = ("mnmgs", "mnmaor, tuned", "psor, tuned", "newton", "multilevel")
#: a claim of success is wrong where the residual, relative to Res(0), is so many times the tolerance that was asked for
_WRONG = 10.0
#: a run that takes so many seconds is timed once
_ONCE = 1.0
#: how often what a competitor is given is made, for the median
_BUILDS = 3
#: iterates of a run of which the error is computed, in geometric progression
_TRACED = 60


@dataclass(frozen=True)
class Entry:
    """One competitor at one `tolerance`: `seconds` of each round, and among them `build` seconds to make the ICP or the
    QP and `setup` seconds of the solver (None: not known apart); `error` in the race's measure, `residual`
    Res(z)/Res(0), its `claim`, and whether that is `wrong`: success, at a residual of ten times the tolerance or more.
    """

    name: str
    kind: str
    tolerance: float
    seconds: tuple[float, ...] = ()
    build: float = 0.0
    setup: float | None = None
    error: float | None = None
    residual: float | None = None
    claim: str = ""
    wrong: bool = False

    @property
    def median(self) -> float:
        """The median of `seconds`."""
        return float(np.median(self.seconds))


@dataclass(frozen=True, eq=False, kw_only=True)
class Race:
    """What a race found: `entries`, one per competitor and tolerance; `traces`, name → (seconds, errors) of one run
    of each own method; `measure` what "error" is, in words; `limit` the seconds of one linear solve with A, None where
    PyAMG could not do it; `skipped` pairs (name, reason); `command` what makes the race again.

    >>> race(ICP([[2.0]], [-3.0]), methods=["mnmgs"], solvers=[], repeats=1).measure
    'certified bound on max |z - z*|'
    """

    title: str
    measure: str
    entries: tuple[Entry, ...]
    traces: dict[str, tuple[Vector, Vector]] = field(default_factory=dict)
    limit: float | None = None
    skipped: tuple[tuple[str, str], ...] = ()
    command: str = ""

    def table(self) -> Table:
        """One row per competitor and tolerance, times in seconds.

        >>> race(ICP([[2.0]], [-3.0]), methods=["mnmgs"], solvers=[], repeats=1).table().heads[:4]
        ('competitor', 'kind', 'tolerance', 'time, s')
        """
        heads = ("competitor", "kind", "tolerance", "time, s", "lowest", "highest", "build, s", "set-up, s")
        rows: list[tuple[Any, ...]] = []
        for one in self.entries:
            times = (one.median, min(one.seconds), max(one.seconds), one.build, one.setup)
            rows.append(
                (
                    one.name,
                    one.kind,
                    one.tolerance,
                    *times,
                    one.error,
                    one.residual,
                    one.claim,
                    "wrong" if one.wrong else "",
                )
            )
        if self.limit is not None:
            rows.append(("PyAMG, one solve", "limit", RTOL, *[self.limit] * 3, *[None] * 6))
        return Table(self.title, (*heads, self.measure, "Res(z) / Res(0)", "claim", "is"), tuple(rows))

    def plot(self, path: Any) -> list[Path]:
        """Write the chart, PNG and SVG, and the table as CSV; see `figures.save`. Returns the paths.

        >>> race(ICP([[2.0]], [-3.0]), methods=["mnmgs"], solvers=[], repeats=1).plot("no-such-folder/race.png")
        Traceback (most recent call last):
        icpmodel.errors.FileError: no-such-folder/race.png: the folder no-such-folder does not exist
        """
        from .charts.figures import save
        from .charts.race_chart import race_figure

        return save(race_figure(self), path, self.table(), self.command)

    def __str__(self) -> str:
        lines = [str(self.table()), *(f"{name}: left out, {reason}" for name, reason in self.skipped)]
        return "\n".join(lines)


def race(
    problem: ICP,
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
    """Own methods and independent solvers at every tolerance, build and set-up included, in turn, `repeats` times.

    A competitor whose answer is already as good as a smaller tolerance asks for is not run at that one again.

    The error is max|z − z*| where `z_exact` is given; else |z − ẑ| + β, a certified bound, with a polished answer ẑ and
    its own error bound β; else, where there is no bound, Res(z)/Res(0). One measure holds for all of a race.
    Parameters: `methods` by name ("mnmaor, tuned" and "psor, tuned" have the ω of the estimated Jacobi radius) or as
    objects, beside `solve()` itself; `solvers` by name, both by default what the problem admits; `z_exact` shape (n,);
    `tolerances`, to each competitor in its own sense; `repeats` ≥ 1, one for runs of a second or more; `time_limit`
    seconds for a run, after which a competitor is not asked for more; `progress` shows a line where standard error is
    a terminal; `command` is noted.
    Returns a `Race`. Raises InputError, and Interrupted at Ctrl-C, whose `report` is the race as far as it was.

    >>> found = race(ICP([[2, -1], [-1, 2]], [-1, 3]), ["mnmgs"], ["osqp"], z_exact=[0.5, 0.0], repeats=1)
    >>> sorted({entry.name for entry in found.entries}), found.measure
    (['mnmgs', 'osqp', 'solve()'], 'max |z - z*|')
    """
    case = Case("this problem", as_problem(problem))
    repeats = int(as_number(repeats, "repeats", least=1, whole=True))
    limit = as_number(time_limit, "time_limit", above=0.0)
    asked = sorted(
        {as_number(one, "tolerances", above=0.0, below=1.0) for one in as_list(tolerances, "tolerances")}, reverse=True
    )
    if not asked:
        raise InputError("tolerances is empty; at least one number in (0, 1) was expected")
    field_, skipped = _field(case, methods, solvers)
    found = Race(title=f"{problem!r} ({machine()})", measure="", entries=(), skipped=tuple(skipped), command=command)
    entries: dict[tuple[str, float], Entry] = {}
    measure, error = _measure(case, z_exact)
    try:
        with status_line(progress) as say:
            say("one linear solve")
            found = replace(found, measure=measure, limit=_linear(case, repeats, limit))
            _time(case, field_, asked, repeats, limit, error, entries, say)
            found = replace(found, traces=_traces(case, field_, asked[-1], limit, error, say))
    except KeyboardInterrupt:
        raise Interrupted(replace(found, measure=measure, entries=tuple(entries.values()))) from None
    return replace(found, entries=tuple(entries.values()))


def _field(
    case: Case, methods: Sequence[str | Method] | None, solvers: Sequence[str | ForeignSolver] | None
) -> tuple[list[Competitor], list[tuple[str, str]]]:
    """Who takes part, and who does not and why; what was asked for by name must be known."""
    own = {one.name: one for one in own_methods()}
    wanted: list[Competitor] = [Solve()]
    for name in METHODS if methods is None else as_list(methods, "methods"):
        if isinstance(name, Method):
            wanted.append(Own(repr(name), partial(_always, name)))
        else:
            wanted.append(own.get(name) or Own(name, partial(_always, named(name))))
    wanted += map(Foreign, chosen_solvers(solvers, "race"))
    reasons = [(one, one.why_not(case)) for one in wanted]
    return [one for one, no in reasons if no is None], [(one.name, no) for one, no in reasons if no is not None]


def _always(method: Method, problem: ICP) -> Method:
    return method


def _measure(case: Case, z_exact: Any) -> tuple[str, Callable[[Any], float | None]]:
    """What "error" is in words, and the function of z that gives it."""
    problem = case.problem
    if z_exact is not None:
        exact, known, words = problem.vector(z_exact, "z_exact", finite=True), 0.0, "max |z - z*|"
    else:
        best = problem.solve(rtol=1e-12, raise_on_failure=False).polish()
        if best.error_bound is None:
            return "Res(z) / Res(0)", case.judged
        exact, known, words = best.z, best.error_bound, "certified bound on max |z - z*|"

    def error(z: Any) -> float | None:
        distance = float(np.abs(np.asarray(z, dtype=np.float64) - exact).max()) + known
        return distance if np.isfinite(distance) else None

    return words, error


def _linear(case: Case, repeats: int, limit: float) -> float | None:
    solve = limits()[-1]
    runs = [solve.run(case, RTOL, limit) for _ in range(repeats + 1)][1:]  # the first one imports
    return float(np.median([run.seconds for run in runs])) if runs[0].claims_solved else None


def _time(
    case: Case,
    competitors: list[Competitor],
    tolerances: list[float],
    repeats: int,
    limit: float,
    error: Callable[[Any], float | None],
    entries: dict[tuple[str, float], Entry],
    say: Callable[[str], None],
) -> None:
    """Fill `entries`: in each round every competitor runs at every tolerance, the next one beginning."""
    builds = {}
    for one in competitors:
        say(f"{one.name}: warming up")
        one.run(case, tolerances[0], limit)  # imports and compiles
        builds[one.name] = float(np.median([one.build(case) for _ in range(_BUILDS)]))
    enough: dict[str, float] = {}  # name → tolerances from this one on need no run of their own, 0 for none at all
    for k in range(repeats):
        order = competitors[k % len(competitors) :] + competitors[: k % len(competitors)]
        for tolerance in tolerances:
            for one in order:
                key = one.name, tolerance
                wanted = tolerance < enough.get(one.name, 1.0) if k == 0 else _again(entries.get(key))
                if not wanted:
                    continue
                say(f"round {k + 1} of {repeats}: {one.name} at {tolerance:.0e}")
                run = one.run(case, tolerance, limit)
                seconds = builds[one.name] + run.seconds
                if k > 0:
                    entries[key] = replace(entries[key], seconds=(*entries[key].seconds, seconds))
                    continue
                residual = None if run.z is None else case.judged(run.z)
                wrong = run.claims_solved and (residual is None or residual > _WRONG * tolerance)
                entries[key] = Entry(
                    one.name,
                    one.kind,
                    tolerance,
                    seconds=(seconds,),
                    build=builds[one.name],
                    setup=run.setup,
                    error=None if run.z is None else error(run.z),
                    residual=residual,
                    claim=run.claim,
                    wrong=wrong,
                )
                if run.seconds > limit or run.z is None:
                    enough[one.name] = 0.0
                elif residual is not None:  # it has reached more than it was asked for
                    enough[one.name] = residual


def _again(entry: Entry | None) -> bool:
    return entry is not None and entry.seconds[0] < _ONCE


def _traces(
    case: Case,
    competitors: list[Competitor],
    tolerance: float,
    limit: float,
    error: Callable[[Any], float | None],
    say: Callable[[str], None],
) -> dict[str, tuple[Vector, Vector]]:
    """name → (seconds, errors) along one run of each own method; times are of a run in which no error is computed."""
    found = {}
    for one in competitors:
        if not isinstance(one, Own):
            continue
        say(f"{one.name}: its path")
        try:
            method = one.make(case.fresh())
            timed = (
                case.fresh()
                .solve(method, rtol=tolerance, time_limit=limit, history=True, raise_on_failure=False)
                .history
            )
            assert timed is not None
            looked = set(np.unique(np.geomspace(1, timed.iteration.size, _TRACED).astype(int) - 1).tolist())
            seen: list[tuple[int, float | None]] = []

            def look(state: Any, looked: set[int] = looked, seen: list[tuple[int, float | None]] = seen) -> None:
                if state.iteration in looked:
                    seen.append((state.iteration, error(state.z)))

            case.fresh().solve(
                method, rtol=tolerance, max_iter=timed.iteration.size, callback=look, raise_on_failure=False
            )
        except IcpError:
            continue
        pairs = [(timed.seconds[k], e) for k, e in seen if e is not None and k < timed.seconds.size]
        if pairs:
            found[one.name] = (np.array([t for t, _ in pairs]), np.array([e for _, e in pairs], dtype=np.float64))
    return found
