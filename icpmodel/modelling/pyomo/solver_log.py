"""What `tee` shows of a solve while it runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any, TextIO

from ...problem.data import ProblemData
from ...solve.progress import Progress
from ...solve.solution import Solution

#: a line is due when the residual has fallen by this factor since the last one, or after so many seconds
_DIGIT, _SECONDS = 10.0, 1.0


class SolverLog:
    """Lines for every stream: iteration, residual, seconds and method, one per digit gained, and one a second."""

    def __init__(self, streams: Iterable[TextIO]) -> None:
        self._streams = tuple(streams)
        self._next, self._late, self._method = math.inf, 0.0, ""

    def say(self, text: str) -> None:
        for stream in self._streams:
            print(text, file=stream, flush=True)

    def head(self, problem: ProblemData) -> None:
        self.say(f"{problem!r}\n{'iteration':>10}{'residual':>13}{'seconds':>11}  method")

    def tail(self, solution: Solution, message: str) -> None:
        if self._streams:  # what is certain of a solution is computed when it is asked for
            self.say(str(solution) if message == solution.message else f"{solution}\n{message}")

    def followed_by(self, callback: Callable[[Progress], Any] | None) -> Callable[[Progress], Any] | None:
        """A callback that shows the iterate first; `callback` itself where nobody listens."""
        if not self._streams:
            return callback

        def both(state: Progress) -> Any:
            self._show(state)
            return callback is not None and callback(state)

        return both

    def _show(self, state: Progress) -> None:
        due = state.residual <= self._next or state.seconds >= self._late or state.method != self._method
        if due:
            self._next, self._late = state.residual / _DIGIT, state.seconds + _SECONDS
            self._method = state.method
            self.say(f"{state.iteration:10d}{state.residual:13.3e}{state.seconds:11.2f}  {state.method}")
