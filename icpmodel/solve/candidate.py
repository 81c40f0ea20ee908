"""A candidate: a method, why it is one, and when it gives way to the next."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from ..methods.contract import Method

#: the rate is that of the residuals of so many steps
_RATE = 2
#: sweeps are looked at after so many, and whenever their number has doubled; and once before, after so many, for a rate
#: by which so many times as many would be needed as that look lets pass: rates seldom become better
_LOOK, _EARLY, _FAR = 10, 3, 4.0


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


class Watched:
    """One run under a watch: the `residuals` of its iterates, held against the `aim`."""

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

    def verdict(self, expected: float) -> str | Candidate | None:
        """Why the run gives way, the candidate that rather goes on, or None where it stays."""
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
        if not steps <= self.watch.most:
            return f"{self.watch.name} were slow"
        if self.watch.rather and self.looks >= self.watch.rather[2] and steps > self.watch.rather[1]:
            return self.watch.rather[0]
        return None


def needed(earlier: float, last: float, aim: float, steps: int) -> float:
    """How many more steps it takes from the residual `last` to `aim` at the rate of the `steps` since `earlier`."""
    if not 0.0 < last < math.inf or not 0.0 < earlier < math.inf or not aim > 0.0:
        return math.inf
    speed = math.log(earlier / last) / steps
    return math.log(last / aim) / speed if speed > 0.0 else math.inf


class Upcoming:
    """The candidates that are still to come, each made only when somebody asks for it."""

    def __init__(self, candidates: Iterator[Candidate]) -> None:
        self.candidates = candidates
        self.seen: list[Candidate | None] = []

    def peek(self) -> Candidate | None:
        if not self.seen:
            self.seen = [next(self.candidates, None)]
        return self.seen[0]

    def take(self) -> Candidate | None:
        following = self.peek()
        self.seen = []
        return following
