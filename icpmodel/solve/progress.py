"""Progress of a run: the argument of callbacks, a bar on a terminal or in a notebook, lines in a log."""

from __future__ import annotations

import contextlib
import logging
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

from ..numerics.arrays import Vector, as_truth
from ..numerics.plugins import in_notebook
from ..present.display import Displayable
from ..present.rendering import render

#: the seconds between two updates of a bar; what takes less seems immediate to a reader
NOTICED_SECONDS = 0.1
#: the largest interval of the lines of a log, in seconds, after 1, 2, 4, …
_MAX_LOG_INTERVAL = 60.0
_LOG = logging.getLogger("icpmodel")
#: the function of the open status line
_open_line: ContextVar[Callable[[str], None] | None] = ContextVar("status line", default=None)


class CallbackFailure(BaseException):
    """Carries the `error` of a callback through the run, which would take it for an error of a method."""

    def __init__(self, error: Exception) -> None:
        super().__init__(error)
        self.error = error


@dataclass(frozen=True, eq=False, repr=False)
class Progress(Displayable):
    """The state of a run that a callback receives.

    Attributes
    ----------
    iteration : int
        The number of the iterate.
    z : array of shape (n,)
        The iterate, read-only.
    residual : float
        Res_D(z).
    seconds : float
        The time since the start.

    Examples
    --------
    >>> seen = []
    >>> _ = ICP([[2.0]], [-2.0]).solve("mnmgs", callback=lambda state: seen.append(state))
    >>> seen[1]
    Progress(iteration=1, z=array([1.]), residual=0, seconds=...)
    """

    iteration: int
    z: Vector
    residual: float
    seconds: float


#: a function of a title, the share done (None if unknown), and a text
_Display = Callable[[str, float | None, str], None]


class Bar:
    """A bar that shows nothing; `update` is cheap enough to be called at every iteration."""

    def begin(self, title: str) -> None:
        """Show the name of the method that runs."""

    def update(self, iteration: int, residual: float, tolerance: float) -> None:
        """Show the progress: `iteration`, Res_D(z), and the residual at which the run may stop."""


class _VisibleBar(Bar):
    """A bar that shows how far the residual is, in logarithms, from the first one of a method to the tolerance."""

    def __init__(self, show: _Display, clock: Callable[[], float]) -> None:
        self.show = show
        self.clock = clock
        self.next = -math.inf
        self.title = ""
        self.first = 0.0

    def begin(self, title: str) -> None:
        self.title = title
        self.first = 0.0

    def update(self, iteration: int, residual: float, tolerance: float) -> None:
        self.first = self.first or residual
        if (now := self.clock()) >= self.next:
            self.next = now + NOTICED_SECONDS
            share = 0.0
            if 0 < tolerance < self.first and residual > 0:
                share = math.log(self.first / residual) / math.log(self.first / tolerance)
            text = f"iteration {iteration}, residual {residual:.2e} -> {tolerance:.2e}"
            self.show(self.title, min(max(share, 0.0), 1.0), text)


@contextlib.contextmanager
def progress_bar(enabled: bool, clock: Callable[[], float] = time.monotonic) -> Iterator[Bar]:
    """A `Bar` for one run, which shows nothing unless `enabled`.

    It appears on standard error if that is a terminal, or in the cell of a notebook. Otherwise lines are written to
    standard error, the first one after a second.
    """
    if not enabled or sys.stderr is None:
        yield Bar()
        return
    with _display(True, clock) as show:
        yield _VisibleBar(show, clock)


@contextlib.contextmanager
def status_line(enabled: bool, opening: str = "") -> Iterator[Callable[[str], None]]:
    """Yield a function that shows a sentence about the work in progress.

    If `enabled`, a terminal or a notebook shows the latest sentence; else standard error gets one after 1, 2, 4, …
    seconds. If not `enabled`, the logger "icpmodel" gets these lines, at INFO. Every log begins with the `opening`, a
    sentence about the task. Within another status line, the function of that one is yielded.
    """
    if (outer := _open_line.get()) is not None:
        if opening:
            outer(opening)
        yield outer
        return
    with _display(as_truth(enabled, "progress") and sys.stderr is not None, time.monotonic, opening) as show:

        def say(text: str) -> None:
            show(text, None, "")

        token = _open_line.set(say)
        try:
            yield say
        finally:
            _open_line.reset(token)


@contextlib.contextmanager
def _display(enabled: bool, clock: Callable[[], float], opening: str = "") -> Iterator[_Display]:
    """Yield a function that writes to a notebook cell, a terminal or, after 1, 2, 4, … seconds, a log.

    A terminal and a log show the `opening` first.
    """
    if enabled and in_notebook():
        from IPython.display import HTML, display

        handle: Any = display(HTML(""), display_id=True)
        try:
            yield lambda title, share, text: handle.update(
                HTML(render("progress.html", title=title, share=share, text=text))
            )
        finally:
            handle.update(HTML(""))
    elif enabled and sys.stderr.isatty():
        from rich.console import Console
        from rich.markup import escape
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[text]}"))
        with Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True), transient=True) as progress:
            task = progress.add_task(escape(opening), total=None, text="")
            yield lambda title, share, text: progress.update(
                task, description=escape(title), total=None if share is None else 1.0, completed=share, text=text
            )
    else:
        write = _write if enabled else _LOG.info
        wait = 1.0
        following = clock() + wait
        if opening:
            write(opening)

        def show(title: str, share: float | None, text: str) -> None:
            nonlocal wait, following
            if clock() >= following:
                following = clock() + wait
                wait = min(2.0 * wait, _MAX_LOG_INTERVAL)
                write(f"{title}: {text}" if text else title)

        yield show


def _write(text: str) -> None:
    with contextlib.suppress(OSError, ValueError):  # a log that is full or closed does not end a run
        print(f"icpmodel ... {text}", file=sys.stderr, flush=True)


def time_left(start_time: float, done: int, total: int) -> str:
    """The estimated remaining time in words, `done` of `total` pieces after `start_time`; empty before the first."""
    if not done:
        return ""
    seconds = (time.monotonic() - start_time) / done * (total - done)
    return f", about {seconds:.2g} s more"
