"""The fuzz: what is said of problems drawn afresh, and the smallest problem for each lie."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from ...errors import Interrupted
from ...numerics.arrays import as_number
from ...present.table import Table
from ...solve.progress import status_line
from .examiner import KINDS, Lie
from .lottery import drawn_trial
from .shrinking import shrunk
from .trial import Trial
from .workers import Worker

#: lies of one sort, by kind, front end, method and exception, that are reproduced; further ones are only counted
_SHOWN = 2
#: trials that are spent on one reproduction
_TRIES = 200


@dataclass(frozen=True)
class Audit(Table):
    """The counts as a table, and `reproductions`, a text that runs for each sort of lie."""

    reproductions: tuple[str, ...] = ()


def honesty(
    minutes: float = 1.0, seed: int = 0, problems: int | None = None, processes: int = 1, progress: bool = False
) -> Audit:
    """How often the package says what is false, of problems drawn afresh: every kind of A, q, ψ, scale, option, method
    and front end.

    "solved" is false where ‖min(r, p)‖₂, with an obstacle above that of the median, in exact arithmetic is above the
    tolerance; a bound, uniqueness or infeasibility where all solutions, found in fractions by all active sets for n ≤
    4, or the one the data were made for, say otherwise; a crossing where the obstacles do not cross. A foreign
    exception is one that the package does not raise on purpose; late is what comes after 1.1 × the time limit and .2 s,
    three times in a row; an iterate is lost where a better one was seen by the callback. Every trial runs in another
    process, so that a crash and a hang, of two minutes and twice, are counted too. Of each sort of lie the smallest
    problem is looked for that shows it.
    Parameters: `minutes` after which no trial is begun; `seed` of the draw; `problems`, how many, instead of minutes:
    the same number and seed are the same trials; `processes` at work.
    Returns an `Audit`, a `Table` with `reproductions`. Raises Interrupted, whose `report` is the audit so far.

    >>> icp.benchmarks.honesty(problems=0).rows[-1][:2]
    ('all', 0)
    """
    minutes = as_number(minutes, "minutes", least=0)
    seed = int(as_number(seed, "seed", least=0, whole=True))
    last = math.inf if problems is None else as_number(problems, "problems", least=0, whole=True)
    end = math.inf if problems is not None else time.monotonic() + 60.0 * minutes
    workers = [Worker() for _ in range(int(as_number(processes, "processes", least=1, whole=True)))]
    counts = Counts(Worker())
    try:
        with status_line(progress) as say:
            counts.add(partial(drawn_trial, seed), last, end, workers, say)
    except KeyboardInterrupt:
        raise Interrupted(counts.audit(seed)) from None
    return counts.audit(seed)


class Counts:
    """What was asked so far, and what came of it."""

    def __init__(self, second: Worker) -> None:
        self.counts: dict[str, Counter[str]] = {}
        self.shown: Counter[tuple[str, ...]] = Counter()
        self.reproductions: list[str] = []
        self.second = second  # for reproductions

    def add(
        self,
        draw: Callable[[int], Trial],
        last: float,
        end: float,
        workers: Sequence[Worker],
        say: Callable[[str], None] = lambda _: None,
    ) -> None:
        """The trials number 0, 1, … up to `last`, none begun after `end`, in turn to the `workers`."""
        number = 0
        try:
            while number < last and time.monotonic() < end:
                batch = [draw(k) for k in range(number, int(min(number + len(workers), last)))]
                for one, trial in zip(workers, batch, strict=False):
                    one.begin(trial)
                for k, (one, trial) in enumerate(zip(workers, batch, strict=False)):
                    found = one.end()
                    if any(lie.kind == "hang" for lie in found[1]):  # on a busy machine compilation may take as long
                        found = one.ask(trial)
                    self._count(number + k, trial, *found)
                number += len(batch)
                say(f"{number} problems, {sum(self.shown.values())} lies")
        finally:
            for one in [*workers, self.second]:
                one.close()

    def _count(self, number: int, trial: Trial, solved: bool, lies: list[Lie]) -> None:
        count = self.counts.setdefault(trial.label, Counter())
        count.update(["problems", *{lie.kind for lie in lies}, *["solved"] * solved])
        for lie in lies:
            sort = trial.label, *_sort(lie)
            self.shown[sort] += 1
            if self.shown[sort] <= _SHOWN:
                self._reproduce(number, trial, lie)

    def _reproduce(self, number: int, trial: Trial, lie: Lie) -> None:
        """Once more in a process of its own, then smaller and smaller."""
        told = {trial: lie}

        def shows(one: Trial) -> bool:
            same = [found for found in self.second.ask(one)[1] if _sort(found) == _sort(lie)]
            if same:
                told[one] = same[0]
            return bool(same)

        tries = _TRIES if lie.kind not in ("late", "hang") else 0
        smallest = shrunk(trial, shows, tries)
        text = f"# {lie.kind} (number {number}): {told[smallest].told}\n{smallest.code()}"
        if text.partition("\n")[2] not in {one.partition("\n")[2] for one in self.reproductions}:
            self.reproductions.append(text)

    def audit(self, seed: int) -> Audit:
        """The table so far."""
        heads = ("problems", "solved", *KINDS)
        rows = [(label, *(self.counts[label][head] for head in heads)) for label in sorted(self.counts)]
        rows.append(("all", *(sum(count[head] for count in self.counts.values()) for head in heads)))
        title = f"What is false of what is said of problems drawn afresh, seed {seed}"
        return Audit(title, ("asked by", *heads), tuple(rows), tuple(self.reproductions))


def _sort(lie: Lie) -> tuple[str, str]:
    return lie.kind, lie.told.partition(" ")[0] if lie.kind == "foreign exception" else ""
