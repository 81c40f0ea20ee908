"""`solve()` against others to the same residual in one run: the harness, and the gallery against everyone."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from ..errors import Interrupted
from ..numerics.arrays import as_number
from ..present.table import Table
from ..scenes import names
from ..solve.goal import RTOL
from ..solve.progress import status_line
from ..solvers.foreign import Claim, chosen_solvers
from ..study.cases import VARIANTS, Case, as_scenes, as_sizes, built, cases
from ..study.competitors import Competitor, Foreign, Own, limits, own_methods
from ..study.timing import BRIEFLY, MORE, as_repeats, interleaved, machine

#: one that takes this many times the time of solve(), and more than that many seconds, is timed once
_FAR, _SHORT = 3.0, 0.25
#: a run of fewer seconds is timed with warm caches
_BRIEF = 0.01
#: own methods are given so many times the time of the quickest so far, and so many seconds at least
_HOPELESS, _LEAST_LIMIT = 10.0, 1.0
#: which share of solve()'s time a peer must need for "faster"; a tie is none
_TIE = 0.98


@dataclass(frozen=True)
class Record:
    """What was measured of one competitor on one case. `seconds` one time per round, empty where it was not run;
    `setup` seconds of the run that counts, at the tolerance `asked`; `residual` Res(z)/Res(0) of the best z; `reached`
    whether that is small enough; `ratios` to `solve()`, round by round; `note` what else there is to say.
    """

    scene: str
    n: int
    name: str = ""
    kind: str = ""
    seconds: tuple[float, ...] = ()
    setup: float | None = None
    asked: float = 0.0
    residual: float | None = None
    reached: bool = False
    ratios: tuple[float, ...] = ()
    note: str = ""

    @property
    def median(self) -> float:
        """The median of `seconds`."""
        return float(np.median(self.seconds))


_Summary = Callable[[list[Record]], Table]


def benchmark(
    scenes: Sequence[str] = (),
    sizes: Sequence[int] = (1_000, 10_000, 100_000),
    *,
    repeats: int = 3,
    time_limit: float = 30.0,
    entrants: Sequence[Competitor] | None = None,
    progress: bool = False,
) -> Table:
    """solve() against foreign solvers, every own method and one linear solve, to Res(z) ≤ 1e-8·Res(0).

    A peer is run at one tolerance after the other, 1e-3, …, 1e-12 (from one below the one that did at the size before),
    and the first run whose z is good enough counts, by its own time; the note tells where it claims success at a z that
    is not good enough. Then all that take no more than three times as long as `solve()`, or a quarter of a second, are
    timed in turn, in `repeats` rounds or, if they are short, more, and the ratio is the median over the rounds. Runs
    below 10 ms are timed on their second go. One that would take longer than `time_limit`, by its growth at the smaller
    sizes, is not asked; own methods are given ten times the time of the quickest so far, at least a second.

    Parameters: `scenes` as NAME or NAME,PARAMETER=NUMBER, none for all; `sizes` wanted numbers of unknowns; `repeats`
    rounds of timings at least, ≥ 3; `time_limit` seconds for one run; `entrants` by default `solve()`, the foreign
    solvers, the own methods and the linear solves; `progress` shows a line on what is going on.
    Returns a `Table` (seconds). Raises InputError, and Interrupted, whose `report` is the table so far.

    >>> icp.benchmarks.benchmark(["hand-lcp"], [2]).heads[:4]
    ('scene', 'n', 'method', 'kind')
    """
    if entrants is None:
        entrants = [Own(), *map(Foreign, chosen_solvers(None, "benchmark")), *own_methods(), *limits()]
    measurement = Measurement(entrants, repeats, time_limit)
    texts, wanted = as_scenes(scenes) or tuple(sorted([*names(), *VARIANTS])), tuple(sorted(as_sizes(sizes)))
    found = cases(product(texts, wanted), lambda text, n: built(text, n).problem)
    return measurement.over(found, progress, _comparison)


def faster_peers(table: Table) -> list[str]:
    """A line for each row of a `benchmark` in which a peer is faster than `solve()` at equal residual.

    Projected SOR, which this package has as well, counts as a peer. Parameters: `table` of a `benchmark`.

    >>> icp.benchmarks.faster_peers(icp.benchmarks.benchmark(["hand-lcp"], [2], entrants=[]))
    []
    """
    found = []
    for cells in table.records():
        ratio = cells["ratio to solve()"]
        is_peer = cells["kind"] == "peer" or cells["method"].startswith("psor")
        if is_peer and ratio is not None and ratio < _TIE:
            found.append(f"{cells['scene']}, n = {cells['n']}: {cells['method']} takes {ratio:.2f} of solve()'s time")
    return found


class Measurement:
    """Runs `entrants` on one case after the other, and remembers what each took on the smaller ones."""

    def __init__(self, entrants: Sequence[Competitor], repeats: int, time_limit: float) -> None:
        self.entrants, self.repeats = entrants, as_repeats(repeats)
        self.time_limit = as_number(time_limit, "time_limit", above=0.0)
        #: (scene, name) → (n, seconds, rung of the ladder) of each size so far
        self.past: defaultdict[tuple[str, str], list[tuple[int, float, int]]] = defaultdict(list)
        self.records: list[Record] = []

    def over(self, found: Iterator[tuple[str, int, Case | str]], progress: bool, summary: _Summary) -> Table:
        """The `summary` of all records, of (scene, n, the case or why there is none) each, also in Interrupted."""
        try:
            with status_line(progress) as say:
                for text, n, case in found:
                    if isinstance(case, str):
                        self.records.append(Record(text, n, note=case))
                    else:
                        self.add(case, say)
        except KeyboardInterrupt:
            raise Interrupted(summary(self.records)) from None
        return summary(self.records)

    def limit(self, kind: str, solve: float, quickest: float) -> float:
        """Seconds for one of this `kind`, `solve` being what `solve()` took and `quickest` the best own method so far;
        infinite where they have not reached the residual.
        """
        return max(_HOPELESS * quickest, _LEAST_LIMIT) if kind == "own" else np.inf

    def again(self, record: Record, solve: float, quickest: float) -> bool:
        """Whether one that took part is to be timed in rounds."""
        return record.seconds[0] <= max(_FAR * solve, _SHORT)

    def add(self, case: Case, say: Callable[[str], None]) -> None:
        """Add one record for each entrant, `solve()` being the first of them."""
        where, first, solve, quickest = f"{case.scene}, n = {case.problem.n}", len(self.records), np.inf, np.inf
        for k, one in enumerate(self.entrants):
            say(f"{where}: {one.name} ({k + 1} of {len(self.entrants)})")
            record = self._search(case, one, min(self.time_limit, self.limit(one.kind, solve, quickest)))
            self.records.append(record)
            if record.reached and one.kind in ("solve", "own"):
                quickest = min(quickest, record.seconds[0])
                solve = record.seconds[0] if k == 0 else solve
        found = self.records[first:]
        longest = found[0].seconds[0] if found else 0.0
        calls = {
            k: partial(self.entrants[k].run, case, record.asked, self.time_limit)
            for k, record in enumerate(found)
            if record.reached and self.again(record, longest, quickest)
        }
        brief = {k: found[k].seconds[0] < _BRIEF for k in calls}
        runs: dict[int, list[Claim]] = {k: [] for k in calls}
        told = lambda done: say(f"{where}: round {done}")  # noqa: E731
        for k, run in interleaved(calls, self.repeats, most=MORE * self.repeats, within=BRIEFLY, brief=brief, say=told):
            runs[k].append(run)
        for k, taken in runs.items():
            setups = [run.setup for run in taken if run.setup is not None]
            setup = float(np.median(setups)) if setups else None
            found[k] = replace(found[k], seconds=tuple(run.seconds for run in taken), setup=setup)
        if found and found[0].reached:
            base = np.array(found[0].seconds)
            for k, record in enumerate(found):  # round by round where both were timed in rounds, else to the median
                to = base if len(record.seconds) == base.size else np.median(base)
                found[k] = replace(record, ratios=tuple((np.array(record.seconds) / to).tolist()))
        self.records[first:] = found

    def _search(self, case: Case, one: Competitor, limit: float) -> Record:
        """The first run of `one` that is good enough, else the best one."""
        n, past = case.problem.n, self.past[case.scene, one.name]
        record, expected = Record(case.scene, n, one.name, one.kind), _expected(past, n)
        why_not = one.why_not(case)
        if why_not is None and expected > limit and one.kind != "solve":
            why_not = f"would take about {expected:.2g} s, the limit is {limit:.2g} s"
        if why_not is not None:
            return replace(record, note=why_not)
        if not past:
            one.run(case, one.ladder[0], limit)  # imports and compiles
        liar, tried = "", []
        for rung in range(max(past[-1][2] - 1, 0) if past else 0, len(one.ladder)):
            tolerance = one.ladder[rung]
            run = one.run(case, tolerance, limit)
            residual = case.judged(run.z)
            good = run.solved if one.kind == "limit" else residual is not None and residual <= RTOL
            rank = 0.0 if good else np.inf if residual is None else residual
            note = f"not reached in {run.seconds:.2g} s: {run.words}"
            if good:
                at = f"{run.words}, at {tolerance:.0e}"
                note = at if one.kind == "peer" else run.words.removeprefix("solved").strip()
            told = replace(record, seconds=(run.seconds,), setup=run.setup, asked=tolerance, residual=residual)
            tried.append((rank, replace(told, reached=good, note=note)))
            if good or run.seconds > limit:
                break
            if run.solved:
                liar = f'; says "{run.words}" at {tolerance:.0e}, Res(z)/Res(0) = {rank:.1e}'
        _, best = min(tried, key=lambda pair: pair[0])
        past.append((n, best.seconds[0], rung))
        return replace(best, note=best.note + liar)


def _expected(past: list[tuple[int, float, int]], n: int) -> float:
    """Seconds at size `n`: growth as between the last two sizes, at least linear; 0 where nothing is known."""
    if not past:
        return 0.0
    (m, seconds, _), power = past[-1], 1.0
    if len(past) > 1:
        k, before, _ = past[-2]
        power = max(power, float(np.log(seconds / before) / np.log(m / k)))
    return float(seconds * (n / m) ** power)


def _comparison(records: list[Record]) -> Table:
    times_of = ("time, s", "lowest", "highest", "set-up, s")
    heads = ("scene", "n", "method", "kind", *times_of, "Res(z) / Res(0)", "ratio to solve()", "note")
    rows = []
    for one in records:
        times = (one.median, min(one.seconds), max(one.seconds), one.setup) if one.reached else (None,) * 4
        ratio = float(np.median(one.ratios)) if one.ratios and one.reached else None
        rows.append((one.scene, one.n, one.name, one.kind, *times, one.residual, ratio, one.note))
    return Table(f"To Res(z) <= {RTOL:g} Res(0), set-up included ({machine()})", heads, tuple(rows))
