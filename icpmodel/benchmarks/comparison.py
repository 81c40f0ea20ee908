"""`solve()` against its peers, its own methods and a linear solve, to the same residual, in one run."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import Interrupted
from ..numerics.arrays import as_number
from ..present.table import Table
from ..solve.driver import RTOL
from ..study.competitors import (
    WORST,
    Case,
    Competitor,
    Solve,
    Timed,
    as_scenes,
    as_sizes,
    cases,
    competitors,
    gallery,
    own_methods,
)
from ..study.timing import as_repeats, machine, spread

#: one that takes this many times the time of solve(), and more than that many seconds, is timed once
_FAR, _SHORT = 3.0, 0.25
#: short runs are timed in more rounds: up to so many times as many, while all of them take less than so many seconds
_MORE, _ALL = 7, 2.0
#: a run of fewer seconds is timed with warm caches
_BRIEF = 0.01
#: own methods are given so many times the time of solve(), and so many seconds at least
_HOPELESS, _LEAST_LIMIT = 10.0, 1.0
#: which share of solve()'s time a peer must need for "faster"; a tie is none
_TIE = 0.98


@dataclass(frozen=True)
class Record:
    """What was measured of one competitor on one case. `seconds` one time per round, empty where it was not run;
    `setup` seconds of the run that counts; `residual` Res(z)/Res(0) of the best z; `reached` whether that is small
    enough; `ratios` to `solve()`, round by round; `note` what else there is to say.
    """

    scene: str
    n: int
    name: str
    kind: str
    seconds: tuple[float, ...] = ()
    setup: float | None = None
    residual: float | None = None
    reached: bool = False
    ratios: tuple[float, ...] = ()
    note: str = ""

    @property
    def median(self) -> float | None:
        """The median of `seconds`, None where there are none."""
        return float(np.median(self.seconds)) if self.seconds else None

    @property
    def ratio(self) -> float | None:
        """The median of `ratios`, None where there are none or the residual was not reached."""
        return float(np.median(self.ratios)) if self.ratios and self.reached else None


@dataclass(frozen=True)
class _Past:
    """What is known of a competitor from smaller sizes of the scene: `runs` are (n, seconds), `rung` the tolerance."""

    runs: tuple[tuple[int, float], ...] = ()
    rung: int = 0

    def expected(self, n: int) -> float:
        """Seconds at size `n`: growth as between the last two sizes, at least linear."""
        if not self.runs:
            return 0.0
        (m, seconds), power = self.runs[-1], 1.0
        if len(self.runs) > 1:
            k, before = self.runs[-2]
            power = max(power, float(np.log(seconds / before) / np.log(m / k)))
        return float(seconds * (n / m) ** power)


def benchmark(
    scenes: Sequence[str] = (),
    sizes: Sequence[int] = (1_000, 10_000, 100_000),
    *,
    repeats: int = 3,
    time_limit: float = 30.0,
    say: Callable[[str], None] = lambda text: None,
) -> Table:
    """Times of `solve()`, peers, own methods and linear solves, to Res(z) ≤ 1e-8·Res(0), recomputed by one judge.

    A peer is run at one tolerance after the other, 1e-3, …, 1e-12 (from one below the one that did at the size before),
    and the first run whose z is good enough counts, by its own time. What a peer itself says of its answer is not
    believed: the note tells where it claims success at a z that is not good enough. Then all that take no more
    than three times as long as `solve()`, or a quarter of a second, are timed in turn, in `repeats` rounds or, if they
    are short, more, and the ratio is the median over the rounds; the others are timed once. Each round begins with
    another one, and runs below 10 ms are timed on their second go.
    One that would take longer than `time_limit`, by its growth at the smaller sizes, is not asked; own methods are
    given ten times the time of `solve()`, at least a second.

    Parameters: `scenes` as NAME or NAME,PARAMETER=NUMBER, none for all; `sizes` the wanted numbers of unknowns;
    `repeats` ≥ 3; `time_limit` seconds for a run; `say` is told what is going on.
    Returns a `Table` (seconds). Raises InputError, and Interrupted, whose `report` is the table so far.

    >>> benchmark(["hand-lcp"], [2]).heads[:4]
    ('scene', 'n', 'method', 'kind')
    """
    return _table(_Measurement(repeats, time_limit, say), scenes, sizes, competitors(), _comparison)


def dispatch(
    scenes: Sequence[str] = (),
    sizes: Sequence[int] = (100, 1_000, 10_000, 100_000),
    *,
    repeats: int = 5,
    time_limit: float = 30.0,
    say: Callable[[str], None] = lambda text: None,
) -> Table:
    """`solve()` against the quickest of all own methods, on every scene at every size.

    Parameters: as in `benchmark`. Returns a `Table` (seconds); the note flags a ratio above 1.5.
    Raises InputError, and Interrupted, whose `report` is the table so far.

    >>> dispatch(["hand-lcp"], [2]).rows[0][:2]
    ('hand-lcp', 2)
    """
    return _table(_Measurement(repeats, time_limit, say), scenes, sizes, [Solve(), *own_methods()], _choice)


def faster_peers(table: Table) -> list[str]:
    """A line for each row of a `benchmark` in which a peer is faster than `solve()` at equal residual.

    Projected SOR, which this package has as well, counts as a peer.

    >>> row = ("membrane", 900, "osqp", "peer", 0.5)
    >>> faster_peers(Table("", ("scene", "n", "method", "kind", "ratio to solve()"), (row,)))
    ["membrane, n = 900: osqp takes 0.50 of solve()'s time"]
    """
    found = []
    for row in table.rows:
        cells = dict(zip(table.heads, row, strict=True))
        ratio = cells["ratio to solve()"]
        is_peer = cells["kind"] == "peer" or cells["method"].startswith("psor")
        if is_peer and ratio is not None and ratio < _TIE:
            found.append(f"{cells['scene']}, n = {cells['n']}: {cells['method']} takes {ratio:.2f} of solve()'s time")
    return found


def _table(
    measurement: _Measurement,
    scenes: Sequence[str],
    sizes: Sequence[int],
    field: list[Competitor],
    summary: Callable[[list[Record]], Table],
) -> Table:
    texts, wanted = as_scenes(scenes) or gallery(), as_sizes(sizes)
    records: list[Record] = []
    try:
        for text, n, case in cases(texts, tuple(sorted(wanted))):
            if isinstance(case, str):
                records.append(Record(text, n, "", "", note=case))
            else:
                records += measurement.of(case, field)
    except KeyboardInterrupt:
        raise Interrupted(summary(records + [record for record, _ in measurement.found])) from None
    return summary(records)


class _Measurement:
    """Runs competitors on one case after the other, and remembers what each took on the smaller ones."""

    def __init__(self, repeats: int, time_limit: float, say: Callable[[str], None]) -> None:
        self.repeats, self.time_limit = as_repeats(repeats), as_number(time_limit, "time_limit", above=0.0)
        self.say = say
        self.past: dict[tuple[str, str], _Past] = {}
        #: what is known of the case at work, with the tolerances that did
        self.found: list[tuple[Record, float]] = []

    def of(self, case: Case, field: list[Competitor]) -> list[Record]:
        """One record for each of `field`, `solve()` being the first of them."""
        found = self.found
        own_limit = self.time_limit
        for k, one in enumerate(field):
            self.say(f"{case.scene}, n = {case.problem.n}: {one.name} ({k + 1} of {len(field)})")
            found.append(self._search(case, one, own_limit if one.kind == "own" else self.time_limit))
            if k == 0:
                seconds = found[0][0].seconds[0]
                own_limit = min(self.time_limit, max(_HOPELESS * seconds, _LEAST_LIMIT))
        longest = max(_FAR * found[0][0].seconds[0], _SHORT)
        rounds = [k for k, (record, _) in enumerate(found) if record.reached and record.seconds[0] <= longest]
        runs: dict[int, list[Timed]] = {k: [] for k in rounds}
        begin, done = time.perf_counter(), 0
        while done < self.repeats or (done < _MORE * self.repeats and time.perf_counter() - begin < _ALL):
            done += 1
            self.say(f"{case.scene}, n = {case.problem.n}: round {done}")
            turn = done % max(len(rounds), 1)
            for k in rounds[turn:] + rounds[:turn]:
                # a brief run is slower after another code than after itself: it is timed after itself
                for _ in range(2 if found[k][0].seconds[0] < _BRIEF else 1):
                    run = field[k].run(case, found[k][1], self.time_limit)
                runs[k].append(run)
        records = [_timed(record, runs.get(k, [])) for k, (record, _) in enumerate(found)]
        if records[0].reached:
            records = [replace(one, ratios=_ratios(one.seconds, records[0].seconds)) for one in records]
        self.found = []
        return records

    def _search(self, case: Case, one: Competitor, limit: float) -> tuple[Record, float]:
        """The first run of `one` that is good enough, else the best one."""
        n, key = case.problem.n, (case.scene, one.name)
        past = self.past.get(key, _Past())
        record = Record(case.scene, n, one.name, one.kind)
        why_not = one.why_not(case)
        expected = past.expected(n)
        if why_not is None and expected > limit and one.kind != "solve":
            why_not = f"would take about {expected:.2g} s, the limit is {limit:.2g} s"
        if why_not is not None:
            return replace(record, note=why_not), 0.0
        if key not in self.past:
            one.run(case, one.ladder[0], limit)  # imports and compiles
        liar = ""
        best: tuple[float, float, Timed | None] = np.inf, 0.0, None
        for rung in range(max(past.rung - 1, 0), len(one.ladder)):
            tolerance = one.ladder[rung]
            run = one.run(case, tolerance, limit)
            residual = case.judged(run.z)
            good = run.claims_solved if one.kind == "limit" else residual is not None and residual <= RTOL
            rank = 0.0 if good else np.inf if residual is None else residual
            if rank < best[0] or best[2] is None:
                best = rank, tolerance, run
            if good or run.seconds > limit:
                break
            if run.claims_solved:
                liar = f'says "{run.claim}" at {tolerance:.0e}, Res(z)/Res(0) = {rank:.1e}'
        _, tolerance, chosen = best
        assert chosen is not None
        self.past[key] = _Past((*past.runs, (n, chosen.seconds)), rung)
        note = f"not reached in {chosen.seconds:.2g} s: {chosen.claim}"
        if good:
            claim = chosen.claim
            note = f"{claim}, at {tolerance:.0e}" if one.kind == "peer" else claim.removeprefix("solved").strip()
        note = f"{note}; {liar}" if liar else note
        record = replace(record, seconds=(chosen.seconds,), setup=chosen.setup, reached=good, note=note)
        return replace(record, residual=case.judged(chosen.z)), tolerance


def _timed(record: Record, runs: list[Timed]) -> Record:
    """The record with the times of its rounds, where it had any."""
    if not runs:
        return record
    setups = [run.setup for run in runs if run.setup is not None]
    setup = float(np.median(setups)) if setups else None
    return replace(record, seconds=tuple(run.seconds for run in runs), setup=setup)


def _ratios(ours: tuple[float, ...], solve: tuple[float, ...]) -> tuple[float, ...]:
    """Round by round where both were timed in rounds, else to the median."""
    if len(ours) == len(solve):
        return tuple(float(a / b) for a, b in zip(ours, solve, strict=True))
    return tuple(float(a / np.median(solve)) for a in ours)


def _comparison(records: list[Record]) -> Table:
    times_of = ("time, s", "lowest", "highest", "set-up, s")
    heads = ("scene", "n", "method", "kind", *times_of, "Res(z) / Res(0)", "ratio to solve()", "note")
    rows = []
    for one in records:
        times: tuple[float | None, ...] = (None,) * 4
        if one.reached:
            times = (one.median, min(one.seconds), max(one.seconds), one.setup)
        rows.append((one.scene, one.n, one.name, one.kind, *times, one.residual, one.ratio, one.note))
    return Table(f"To Res(z) <= {RTOL:g} Res(0), set-up included ({machine()})", heads, tuple(rows))


def _choice(records: list[Record]) -> Table:
    """One row for each scene and size: what `solve()` took, and the quickest single method."""
    heads = ("scene", "n", "solve() by", "solve(), s", "best method", "its time, s")
    heads_of_ratio = ("ratio", "lowest", "highest", "note")
    rows: list[tuple[Any, ...]] = []
    for scene, n in dict.fromkeys((one.scene, one.n) for one in records):
        here = [one for one in records if (one.scene, one.n) == (scene, n)]
        solve, singles = here[0], [one for one in here[1:] if one.reached and one.median is not None]
        best = min(singles, key=lambda one: one.median or 0.0, default=None)
        by = solve.note.removeprefix("by ")
        if not solve.reached or best is None:
            told = ("", None) if best is None else (best.name, best.median)
            note = f"solve(): {solve.note}" if solve.kind else solve.note
            rows.append((scene, n, "", None, *told, None, None, None, note))
            continue
        ratios = 1.0 / np.array(best.ratios)
        flag = f"above {WORST:g}" if np.median(ratios) > WORST else ""
        rows.append((scene, n, by, solve.median, best.name, best.median, *spread(ratios), flag))
    title = f"solve() against the quickest single method, to Res(z) <= {RTOL:g} Res(0) ({machine()})"
    return Table(title, (*heads, *heads_of_ratio), tuple(rows))
