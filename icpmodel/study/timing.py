"""The harness of all timings: calls are run in turn, round by round, so that what slows the machine slows them all."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import dataclass
from datetime import date
from typing import Any, Generic, TypeVar

import numpy as np

from ..numerics.arrays import Vector

Name = TypeVar("Name", bound=Hashable)
Run = TypeVar("Run")


def clocked(call: Callable[..., Any], given: Callable[[], Any] | None = None) -> Callable[[], float]:
    """What tells the seconds of `call`, with what `given` makes before the clock starts, if anything.

    What it returns is freed at once: kept, it would make the next run pay for fresh memory.
    """

    def run() -> float:
        arguments = () if given is None else (given(),)
        begin = time.perf_counter()
        call(*arguments)
        return time.perf_counter() - begin

    return run


def middle(call: Callable[[], Any], times: int = 5, seconds: float = 0.2) -> Callable[[], float]:
    """What tells the median of the seconds of a short `call`, so often and so long in a row that its caches are warm.

    The threads of another library spin for some ten milliseconds after their last work.
    """

    def run() -> float:
        marks = [time.perf_counter()]
        while len(marks) <= times or marks[-1] - marks[0] < seconds:
            call()
            marks.append(time.perf_counter())
        return float(np.median(np.diff(marks)))

    return run


def interleaved(
    calls: Mapping[Name, Callable[[], Run]],
    rounds: int,
    *,
    most: int = 0,
    within: float = 0.0,
    say: Callable[[int], None] = lambda done: None,
) -> Iterator[tuple[Name, Run]]:
    """(name, run) of all `calls`, `rounds` times in turn, each round beginning with another one.

    While all of them took less than `within` seconds, there are up to `most` rounds. `say` is told the round, from 1.
    """
    names, begin, done = list(calls), time.perf_counter(), 0
    while names and (done < rounds or (done < most and time.perf_counter() - begin < within)):
        first, done = done % len(names), done + 1
        say(done)
        for name in names[first:] + names[:first]:
            yield name, calls[name]()


@dataclass(frozen=True)
class Timings(Generic[Name]):
    """`seconds` of named calls, one for each round."""

    seconds: dict[Name, Vector]

    def median(self, name: Name, unit: float = 1.0) -> float:
        """The median of the seconds, in units of `unit` seconds."""
        return float(np.median(self.seconds[name])) / unit

    def ratio(self, name: Name, to: Name, per: float = 1.0) -> tuple[float, float, float]:
        """The median, the lowest and the highest ratio of two calls, pair by pair, divided by `per`."""
        return spread(self.seconds[name] / self.seconds[to] / per)


def timed(
    calls: Mapping[Name, Callable[[], float]], rounds: int, *, warm: bool = True, most: int = 0, within: float = 0.0
) -> Timings[Name]:
    """The `calls`, which tell seconds, in turn; if `warm` after a first run, which compiles and takes fresh memory;
    `most` and `within` as in `interleaved`."""
    if warm:
        for call in calls.values():
            call()
    runs = list(interleaved(calls, rounds, most=most, within=within))
    return Timings({name: np.array([seconds for one, seconds in runs if one == name]) for name in calls})


def spread(ratios: Vector) -> tuple[float, float, float]:
    """The median, the lowest and the highest of `ratios`, as tables show them."""
    return float(np.median(ratios)), float(ratios.min()), float(ratios.max())


def machine() -> str:
    """The machine, Python and today's date, for the title of a table with times."""
    return f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, {date.today()}"
