"""Speed against accuracy: every competitor at every tolerance, timed in turn, judged by one measure of error."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from timeit import timeit
from typing import Any

import numpy as np

from ..errors import InputError, Interrupted, OutOfTime
from ..methods.contract import Method, named
from ..numerics.arrays import as_list, as_number
from ..numerics.rounding import public_entry
from ..present.display import Plottable
from ..present.rendering import render
from ..present.table import Table, Tabular, folded
from ..problem.data import ProblemLike, as_problem
from ..scenes import Scene
from ..scenes.registry import title as scene_title
from ..solve.driver import solve
from ..solve.goal import RTOL, Limits
from ..solve.progress import status_line, time_left
from ..solvers.foreign import Claim, ForeignSolver, chosen_solvers
from .cases import Case, uninterrupted
from .competitors import Competitor, Entry, ForeignCompetitor, OwnMethod, linear_solve_seconds, tuned_methods
from .timing import machine, run_interleaved

#: the tolerances that each competitor is asked for
DEFAULT_TOLERANCES = tuple(10.0**-k for k in range(2, 13))
#: the methods of this package that take part if none are named
DEFAULT_METHODS = ("mnmgs", "mnmaor, tuned", "psor, tuned", "newton", "multilevel")
#: a claim of success is loose where the residual, relative to Res_D(0), exceeds this multiple of the tolerance
_LOOSE_FACTOR = 10.0
#: a run that takes more seconds than this is timed once
_TIMED_ONCE_SECONDS = 1.0
#: z ↦ its error, None where it has none
_Error = Callable[[Any], float | None]
_Say = Callable[[str], None]


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Race(Plottable, Tabular):
    """The result of `race`: times, errors and claims of every competitor.

    Attributes
    ----------
    title : str
        The problem, the machine and the date.
    measure : str
        What "error" is, in words.
    entries : tuple of Entry
        One for each competitor and tolerance.
    limit : float or None
        The seconds of one linear solve with A, None where PyAMG could not do it.
    skipped : tuple of (str, str)
        The competitors that were left out, and why.
    command : str
        The command that repeats the race.

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
    limit: float | None = None
    skipped: tuple[tuple[str, str], ...] = ()
    command: str = ""

    def table(self) -> Table:
        """One row per competitor and tolerance, times in seconds.

        Returns
        -------
        Table
            The table.
        """
        heads = ("competitor", "kind", "tolerance", "time, s", "lowest", "highest", "build, s", "set-up, s")
        rows: list[tuple[Any, ...]] = []
        for one in self.entries:
            times = (one.median, min(one.seconds), max(one.seconds), one.build, one.setup)
            outcome = (one.error, one.residual, one.claim, one.note)
            rows.append((one.name, one.kind, one.tolerance, *times, *outcome))
        if self.limit is not None:
            rows.append(("PyAMG, one solve", "limit", RTOL, *[self.limit] * 3, *[None] * 4, "", ""))
        return Table(self.title, (*heads, self.measure, "Res_D(z) / Res_D(0)", "claim", "note"), tuple(rows))

    def left_out(self) -> list[str]:
        """The competitors that were left out, and why.

        Returns
        -------
        list of str
            One sentence each.
        """
        return [f"{name}: left out, {reason}" for name, reason in self.skipped]

    def __str__(self) -> str:
        return "\n".join([folded(self.winner), "", str(self.table()), *map(folded, self.left_out())])

    def _repr_html_(self) -> str:
        winner, left_out = (render("folded.html", text=text) for text in (self.winner, "\n".join(self.left_out())))
        return winner + self.table().to_html() + left_out

    @property
    def winner(self) -> str:
        """The competitor with the shortest time to Res_D(z) ≤ 1e-8·Res_D(0), in one sentence.

        If none reached that, the smallest tolerance that one reached replaces 1e-8. Competitors whose
        times overlap with those of the first are named as level with it.

        Examples
        --------
        >>> race = icp.race(ICP([[2.0]], [-3.0]), methods=[], solvers=[], repeats=1)
        >>> race.winner.split(", in")[0]
        'First to Res_D(z) <= 1e-08 Res_D(0): solve()'
        """
        return self.in_words("First to Res_D(z) <= {goal:g} Res_D(0)")

    def quickest(self, goal: float) -> dict[str, Entry]:
        """The fastest run of each competitor that reached a goal, in the order of their times.

        Parameters
        ----------
        goal : float
            Runs with Res_D(z) ≤ goal·Res_D(0) count.

        Returns
        -------
        dict
            Name → Entry.
        """
        best: dict[str, Entry] = {}
        for one in sorted(self.entries, key=lambda one: one.median):
            if one.residual is not None and one.residual <= goal:
                best.setdefault(one.name, one)
        return best

    def in_words(self, opening: str) -> str:
        """The winner in one sentence, as in `winner`.

        Parameters
        ----------
        opening : str
            The beginning of the sentence; {goal} in it is replaced by the goal.

        Returns
        -------
        str
            The sentence.
        """
        for goal in (RTOL, *sorted({one.tolerance for one in self.entries})):
            best = self.quickest(goal)
            if best:
                break
        else:
            return "No competitor reached any of the tolerances."
        first, *others = best.values()
        level = [one.name for one in others if min(one.seconds) <= max(first.seconds)]
        once = "" if first.seconds[1:] else ", timed once"
        sentence = f"{opening.format(goal=goal)}: {first.name}, in {first.median:.3g} s{once}"
        if level:
            return f"{sentence}; level with it, as the times overlap: {', '.join(level)}."
        after = others and f"; next {others[0].name}, {others[0].median / first.median:.3g} times as long"
        return f"{sentence}{after or ', and no other competitor'}."


@public_entry
def race(
    problem: ProblemLike,
    methods: Sequence[str | Method] | None = None,
    solvers: Sequence[str | ForeignSolver] | None = None,
    *,
    z_exact: Any = None,
    tolerances: Sequence[float] = DEFAULT_TOLERANCES,
    repeats: int = 3,
    time_limit: float = 10.0,
    progress: bool = False,
    command: str = "",
) -> Race:
    """Time this package's methods and foreign solvers at every tolerance, in turn, build and set-up included.

    Parameters
    ----------
    problem : ICP, Scene, or what else can be solved
        The problem.
    methods : sequence of str or Method, optional
        Methods of this package beside `solve()`, by default five; those that cannot solve the problem
        are left out. "mnmaor, tuned" and "psor, tuned" take ω from the estimated Jacobi radius.
    solvers : sequence of str or ForeignSolver, optional
        Independent solvers, by default all that can take the problem.
    z_exact : array_like of shape (n,), optional
        The solution where it is known; by default that of the scene.
    tolerances : sequence of float, default 1e-2, 1e-3, ... 1e-12
        The tolerances for each competitor, in its own measure.
    repeats : int, default 3
        Rounds of timings; a run of a second or more is timed once.
    time_limit : float, default 10
        Seconds for a run with its set-up. A competitor that exceeds them is not run at smaller
        tolerances; one that is stopped in its untimed first run is left out.
    progress : bool, default False
        Whether to show a status line.
    command : str, optional
        The command that repeats the race, stored in the result.

    Returns
    -------
    Race
        The times and errors.

    Raises
    ------
    InputError
        For wrong arguments, and where Res_D(0) is 0 or not finite, as residuals are divided by it.
    NotApplicable
        Where p is nonlinear.
    Interrupted
        At Ctrl-C; its `report` is the race so far.

    Notes
    -----
    The error is max|z − z*| where z* is known. Otherwise it is max|z − ẑ| + β, a certified bound,
    with a polished answer ẑ and its error bound β. Without β it is Res_D(z)/Res_D(0). All entries of
    a race have the same measure.

    A tolerance is skipped for a competitor whose answer at a larger one already meets it.

    While a foreign solver runs in this process, what other threads print or log is lost.

    Examples
    --------
    >>> problem = ICP([[2, -1], [-1, 2]], [-1, 3])
    >>> found = icp.race(problem, ["mnmgs"], ["osqp"], z_exact=[0.5, 0.0], repeats=1)
    >>> sorted({entry.name for entry in found.entries}), found.measure
    (['mnmgs', 'osqp', 'solve()'], 'max |z - z*|')
    """
    if isinstance(problem, Scene) and z_exact is None:
        z_exact = problem.z_exact
    problem = as_problem(problem)
    case = Case(problem)
    repeats = int(as_number(repeats, "repeats", minimum=1, whole=True))
    limit = as_number(time_limit, "time_limit", above=0.0)
    goals = _goals(tolerances)
    competitors = [OwnMethod(), *_own_competitors(methods), *map(ForeignCompetitor, chosen_solvers(solvers, "race"))]
    result = Race(title=f"{scene_title(problem)} ({machine()})", measure="", entries=(), command=command)
    entries: dict[tuple[str, float], Entry] = {}
    opening = f"{len(competitors)} competitors at up to {len(goals)} tolerances, a run of {limit:g} s at most"
    try:
        with status_line(progress, opening) as say:
            say("the measure of error, and one linear solve")
            measure, error = _measure(case, z_exact, limit)
            result = replace(result, measure=measure, limit=linear_solve_seconds(case, repeats, limit))
            admitted = []
            for one in competitors:
                say(f"{one.name}: warming up")
                if reason := one.first_run(case, goals[0], limit):
                    result = replace(result, skipped=(*result.skipped, (one.name, reason)))
                else:
                    admitted.append(one)
            for entry in _run(case, admitted, goals, repeats, limit, error, say):
                entries[entry.name, entry.tolerance] = entry
                result = replace(result, entries=tuple(entries.values()))
    except KeyboardInterrupt:
        raise Interrupted(result) from None
    return result


def _goals(tolerances: Sequence[float]) -> list[float]:
    """The checked tolerances, each once, the largest first. Raises InputError."""
    goals = {as_number(one, "tolerances", above=0.0, below=1.0) for one in as_list(tolerances, "tolerances")}
    if not goals:
        raise InputError("tolerances is empty; at least one number in (0, 1) was expected")
    return sorted(goals, reverse=True)


def _own_competitors(methods: Sequence[str | Method] | None) -> list[Competitor]:
    """The competitors for the named `methods`, by default `DEFAULT_METHODS`. Raises InputError for an unknown name."""
    tuned = {one.name: one for one in tuned_methods()}
    return [
        OwnMethod(repr(one), one) if isinstance(one, Method) else tuned.get(str(one)) or OwnMethod(one, named(one))
        for one in (DEFAULT_METHODS if methods is None else as_list(methods, "methods"))
    ]


def _measure(case: Case, z_exact: Any, limit: float) -> tuple[str, _Error]:
    """The measure of error in words, and the function z ↦ error. Raises InputError for a Res_D(0) of 0 or infinity."""
    _ = case.scale  # raises InputError where it is 0 or not finite
    problem = case.problem
    known = 0.0
    words = "max |z - z*|"
    if z_exact is None:
        with suppress(OutOfTime), Limits(rtol=RTOL, atol=0.0, max_iter=0, time_limit=limit).enforced():
            best = uninterrupted(solve(problem, rtol=1e-12, raise_on_failure=False)).polish()
            z_exact = None if best.error_bound is None else best.z
            known = best.error_bound or 0.0
            words = "certified bound on max |z - z*|"
    if z_exact is None:
        return "Res_D(z) / Res_D(0)", case.relative_residual
    exact = problem.vector(z_exact, "z_exact", finite=True)

    def error(z: Any) -> float | None:
        distance = float(np.abs(np.asarray(z, dtype=np.float64) - exact).max()) + known
        return distance if np.isfinite(distance) else None

    return words, error


def _run(
    case: Case, competitors: list[Competitor], goals: list[float], repeats: int, limit: float, error: _Error, say: _Say
) -> Iterator[Entry]:
    """Run every competitor at every tolerance, then repeat the short runs; yield each entry when new or extended."""
    builds = {one.name: timeit(partial(one.build, case), number=1) for one in competitors}
    reached = dict.fromkeys(builds, 1.0)  # 0 for a competitor that is not run again
    repeated = {}
    entries = {}
    start_time = time.monotonic()
    for done, (tolerance, one) in enumerate(product(goals, competitors)):
        if tolerance >= reached[one.name]:
            continue
        left = time_left(start_time, done, len(goals) * len(competitors))
        say(f"round 1 of {repeats}: {one.name} at {tolerance:.0e}{left}")
        key = one.name, tolerance
        run = one.timed_run(case, tolerance, limit)
        entries[key] = entry = _entry(case, one, tolerance, builds[one.name], run, error)
        yield entry
        if run.seconds > limit or run.z is None:
            reached[one.name] = 0.0
        elif entry.residual is not None:
            reached[one.name] = entry.residual
        if run.z is not None and run.seconds <= limit and entry.seconds[0] < _TIMED_ONCE_SECONDS:
            repeated[key] = partial(one.timed_run, case, tolerance, limit)
    for key, run in run_interleaved(repeated, repeats - 1, say=lambda k: say(f"round {k + 1} of {repeats}")):
        if run.seconds > limit or run.z is None:
            del repeated[key]
            reason = run.words if run.z is None else f"longer than time_limit = {limit:g} s"
            entries[key] = replace(entries[key], claim=f"{entries[key].claim}; a later round: {reason}")
        else:
            entries[key] = replace(entries[key], seconds=(*entries[key].seconds, builds[key[0]] + run.seconds))
        yield entries[key]


def _entry(case: Case, one: Competitor, tolerance: float, build: float, run: Claim, error: _Error) -> Entry:
    residual = None if run.z is None else case.relative_residual(run.z)
    return Entry(
        one.name,
        one.kind,
        tolerance,
        seconds=(build + run.seconds,),
        build=build,
        setup=run.setup,
        error=None if residual is None else error(run.z),
        residual=residual,
        claim=run.words,
        loose=run.solved and (residual is None or residual > _LOOSE_FACTOR * tolerance),
    )
