"""A candidate: a method, why it is one, and what ends it: it gives way, stands still, or goes round."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..methods.contract import Method
from ..numerics.arrays import Vector
from .solution import Status

#: the rate is that of the residuals of so many steps
_RATE = 2
#: sweeps are looked at after so many, and whenever their number has doubled; and once before, after so many, for a rate
#: by which so many times as many would be needed as that look lets pass: rates seldom become better
_LOOK, _EARLY, _FAR = 10, 3, 4.0
#: after so many steps that do not bring the residual down by a thousandth, it is asked whether rounding is the reason
_PRECISION_CHECK = 50
_NOTHING: Vector = np.zeros(0)


@dataclass(frozen=True)
class Candidate:
    """A method to try, and the sentence on why.

    `patience`: so many steps without a better iterate end it, None for as many as the run allows. `watch`: when it
    gives way to the next one. `goes_on`: it begins where a candidate that gave way has come to, else where that began.
    """

    method: Method
    why: str
    patience: int | None = None
    watch: Watch | None = None
    goes_on: bool = False


@dataclass(frozen=True)
class Watch:
    """Gives way where the observed rate says that more than `most` further steps are needed.

    The rate is looked at after `look` steps, and whenever their number has doubled; `name` is what the steps are called
    in the sentence that says so. `rather`: a candidate that goes on, where more than so many steps are needed, from the
    look of that number on.
    """

    most: float
    name: str
    look: int = _LOOK
    rather: tuple[Candidate, float, int] | None = None


class Ended(NamedTuple):
    """Why a candidate ended; `gave_way`: the next one takes over, which may go on from where this one came to."""

    status: Status
    note: str
    gave_way: bool = False


class Upcoming:
    """The candidates that are still to come, each made only when somebody asks for it."""

    def __init__(self, candidates: Iterator[Candidate]) -> None:
        self._candidates, self._seen = candidates, deque[Candidate]()

    def any(self) -> bool:
        """Whether there is one."""
        if not self._seen and (candidate := next(self._candidates, None)) is not None:
            self._seen.append(candidate)
        return bool(self._seen)

    def put_first(self, candidate: Candidate) -> None:
        """Make `candidate` the next one."""
        self._seen.appendleft(candidate)

    def take(self, note: str = "") -> Candidate | None:
        """The next one, with the `note` why it is its turn; None where there is none."""
        if not self.any():
            return None
        candidate = self._seen.popleft()
        return replace(candidate, why=f"{candidate.why} ({note})") if note else candidate


class Watched:
    """One run under a watch: the residuals of its iterates, held against the `aim`."""

    def __init__(self, watch: Watch | None, aim: float) -> None:
        self.watch, self.aim = watch, aim
        self.residuals: list[float] = []
        self.look, self.looks = (watch.look if watch else 0), 0

    def expected(self, residual: float) -> float:
        """How many more steps lead to the aim at the rate of the last ones, inf where that is not known."""
        self.residuals.append(residual)
        if len(self.residuals) <= _RATE or residual <= self.aim:
            return math.inf
        return needed(self.residuals[-1 - _RATE], residual, self.aim, _RATE)

    def gives_way(self, expected: float, upcoming: Upcoming) -> Ended | None:
        """Whether the run ends for one that is `upcoming`, as too many steps are needed."""
        if self.watch is None or not self.look:
            return None
        count = len(self.residuals)
        early = (
            count == _EARLY + 1 and self.look == _LOOK and _FAR * (self.look + self.watch.most) < expected < math.inf
        )
        if not early and count <= self.look:
            return None
        half, last = self.residuals[count // 2], self.residuals[-1]
        if last <= self.aim:
            self.look = 0
            return None
        steps = needed(half, last, self.aim, count - 1 - count // 2)
        self.look, self.looks = 2 * self.look, self.looks + 1
        if steps > self.watch.most:
            if upcoming.any():
                return Ended(Status.STAGNATED, f"{self.watch.name} were slow", True)
            self.look = 0
        elif self.watch.rather and self.looks >= self.watch.rather[2] and steps > self.watch.rather[1]:
            candidate, most, _ = self.watch.rather
            upcoming.put_first(candidate)
            return Ended(Status.STAGNATED, f"more than {most:g} more {self.watch.name} would be needed", True)
        return None


def needed(earlier: float, last: float, aim: float, steps: int) -> float:
    """How many more steps it takes from the residual `last` to `aim` at the rate of the `steps` since `earlier`."""
    if not 0.0 < last < math.inf or not 0.0 < earlier < math.inf or not aim > 0.0:
        return math.inf
    speed = math.log(earlier / last) / steps
    return math.log(last / aim) / speed if speed > 0.0 else math.inf


class Stalled:
    """Whether iterates come back, lead no further, or are as good as rounding lets them be.

    Cycles of a method without memory are found by Brent's search: an iterate is compared with one that is kept while
    their number doubles. Reference: Brent, BIT 20 (1980).
    Parameters: `memoryless` of the method; `patience`, so many steps without a better iterate are the last; `at_floor`,
    which says whether rounding explains that the residual does not fall.
    """

    def __init__(self, memoryless: bool, patience: int, at_floor: Callable[[], Ended | None]) -> None:
        self.memoryless, self.patience, self.at_floor = memoryless, patience, at_floor
        self.step = self.milestone = 0
        self.milestone_residual, self.milestone_z = np.nan, _NOTHING
        self.progress_at, self.progress_residual = 0, np.inf
        self.better_at, self.better_residual = 0, np.inf

    def look(self, z: Vector, residual: float) -> Ended | None:
        """Whether the next iterate, `z`, is the last."""
        k, self.step = self.step, self.step + 1
        if residual < self.better_residual:
            self.better_at, self.better_residual = k, residual
        if self.memoryless and residual == self.milestone_residual and np.array_equal(z, self.milestone_z):
            return self.recurred(k - self.milestone)
        if k >= 2 * self.milestone:
            self.milestone, self.milestone_residual, self.milestone_z = k, residual, z
        if residual < 0.999 * self.progress_residual:
            self.progress_at, self.progress_residual = k, residual
        elif (k - self.progress_at) % _PRECISION_CHECK == _PRECISION_CHECK - 1 and (ended := self.at_floor()):
            return ended
        if k - self.better_at >= self.patience:
            return Ended(Status.STAGNATED, f"no better iterate in {self.patience} iterations")
        return None

    def recurred(self, period: int = 1) -> Ended:
        """The end where an iterate came back after so many steps, or where no new one comes."""
        still = "the iterates stand still, but z is not a solution"
        cycled = Ended(Status.CYCLED, f"the iterates repeat with period {period}")
        return self.at_floor() or (Ended(Status.STAGNATED, still) if period == 1 else cycled)
