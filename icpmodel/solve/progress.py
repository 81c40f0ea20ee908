"""What a callback sees of a run, and a progress bar on a terminal, nothing in a pipe."""

from __future__ import annotations

import contextlib
import math
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ..numerics.arrays import Vector


@dataclass(frozen=True)
class Progress:
    """What a callback sees: `iteration`, `z` (read-only, shape (n,)), `residual` and `seconds` since the start.

    >>> seen = []
    >>> _ = ICP([[2.0]], [-2.0]).solve("mnmgs", callback=lambda state: seen.append(state.iteration))
    >>> seen
    [0, 1]
    """

    iteration: int
    z: Vector
    residual: float
    seconds: float


class Bar:
    """A bar that shows nothing; `update` is cheap enough to be called at every iteration."""

    def update(self, iteration: int, residual: float, tolerance: float) -> None:
        """Tell the bar how far the run is: `iteration`, Res(z) and the residual at which it may stop."""


class _TerminalBar(Bar):
    """The share of the way, on a logarithmic scale, from the first residual to the tolerance."""

    def __init__(self, progress: object, task: object) -> None:
        self.progress, self.task = progress, task
        self.first, self.shown = 0.0, 0.0

    def update(self, iteration: int, residual: float, tolerance: float) -> None:
        """Draws ten times a second at the most."""
        self.first = self.first or residual
        now = time.monotonic()
        if now - self.shown < 0.1:
            return
        self.shown = now
        share = 0.0
        if 0 < tolerance < self.first and residual > 0:
            share = math.log(self.first / residual) / math.log(self.first / tolerance)
        text = f"iteration {iteration}, residual {residual:.2e} -> {tolerance:.2e}"
        self.progress.update(self.task, completed=min(max(share, 0.0), 1.0), text=text)  # type: ignore[attr-defined]


def progress_bar(wanted: bool, title: str) -> contextlib.AbstractContextManager[Bar]:
    """A `Bar` for one run: a visible one if `wanted` and standard error is a terminal."""
    return _terminal_bar(title) if wanted and sys.stderr.isatty() else contextlib.nullcontext(Bar())


@contextlib.contextmanager
def _terminal_bar(title: str) -> Iterator[Bar]:
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn(escape(title)), BarColumn(), TextColumn("{task.fields[text]}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        yield _TerminalBar(progress, progress.add_task(title, total=1.0, text=""))


@contextlib.contextmanager
def status_line(wanted: bool) -> Iterator[Callable[[str], None]]:
    """A function that shows a sentence on what is going on: if `wanted` and standard error is a terminal."""
    if not wanted or not sys.stderr.isatty():
        yield lambda text: None
        return
    from rich.console import Console
    from rich.markup import escape

    with Console(stderr=True).status("") as status:
        yield lambda text: status.update(escape(text))
