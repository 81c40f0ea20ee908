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

from ..numerics.arrays import Vector
from ..numerics.plugins import in_notebook
from ..present.display import Displayable
from ..present.rendering import render

#: how often a bar is drawn, in seconds; and how far the lines of a log, which come after 1, 2, 4, … seconds, are apart
#: at the most
_DRAW_INTERVAL = 0.1
_MAX_LOG_INTERVAL = 60.0
_LOG = logging.getLogger("icpmodel")
#: what the status line shows that is open
_OPEN: ContextVar[Callable[[str], None] | None] = ContextVar("status line", default=None)


@dataclass(frozen=True, repr=False)
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


class Bar:
    """A bar that shows nothing; `update` is cheap enough to be called at every iteration."""

    def begin(self, title: str) -> None:
        """Show the name of the method that runs."""

    def update(self, iteration: int, residual: float, tolerance: float) -> None:
        """Show the progress: `iteration`, Res_D(z), and the residual at which the run may stop."""


class _Pace:
    """The times of updates, by a `clock`: every tenth of a second, or at the intervals of a log."""

    def __init__(self, clock: Callable[[], float], log: bool) -> None:
        self.clock, self.wait, self.longer = clock, 1.0 if log else _DRAW_INTERVAL, 2.0 if log else 1.0
        self.next = clock() + (self.wait if log else 0.0)

    def is_due(self) -> bool:
        """Whether it is time; if so, the next time is later."""
        now = self.clock()
        if now < self.next:
            return False
        self.next, self.wait = now + self.wait, min(self.longer * self.wait, _MAX_LOG_INTERVAL)
        return True


class _VisibleBar(Bar):
    """The share of the way, on a logarithmic scale, from the first residual of a turn to the tolerance; `show` draws
    (title, share, text)."""

    def __init__(self, show: Callable[[str, float, str], None], pace: _Pace) -> None:
        self.show, self.pace, self.title, self.first = show, pace, "", 0.0

    def begin(self, title: str) -> None:
        self.title, self.first = title, 0.0

    def update(self, iteration: int, residual: float, tolerance: float) -> None:
        self.first = self.first or residual
        if self.pace.is_due():
            share = 0.0
            if 0 < tolerance < self.first and residual > 0:
                share = math.log(self.first / residual) / math.log(self.first / tolerance)
            text = f"iteration {iteration}, residual {residual:.2e} -> {tolerance:.2e}"
            self.show(self.title, min(max(share, 0.0), 1.0), text)


def progress_bar(enabled: bool, clock: Callable[[], float] = time.monotonic) -> contextlib.AbstractContextManager[Bar]:
    """A `Bar` for one run, which shows nothing unless `enabled`.

    It appears on standard error if that is a terminal, or in the cell of a notebook. Otherwise lines are written to
    standard error, the first one after a second.
    """
    if not enabled or sys.stderr is None:
        return contextlib.nullcontext(Bar())
    if in_notebook():
        return _notebook_bar(_Pace(clock, log=False))
    if sys.stderr.isatty():
        return _terminal_bar(_Pace(clock, log=False))
    pace = _Pace(clock, log=True)
    return contextlib.nullcontext(_VisibleBar(lambda title, _, text: _write(f"{title}: {text}"), pace))


@contextlib.contextmanager
def _terminal_bar(pace: _Pace) -> Iterator[Bar]:
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[text]}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("", total=1.0, text="")

        def show(title: str, share: float, text: str) -> None:
            progress.update(task, description=escape(title), completed=share, text=text)

        yield _VisibleBar(show, pace)


@contextlib.contextmanager
def _notebook_bar(pace: _Pace) -> Iterator[Bar]:
    with _cell() as show:
        yield _VisibleBar(lambda title, share, text: show(title=title, share=share, text=text), pace)


@contextlib.contextmanager
def _cell() -> Iterator[Callable[..., None]]:
    """A function that shows `progress.html` in the output of a notebook cell and updates it; removed at the end."""
    from IPython.display import HTML, display

    handle: Any = display(HTML(""), display_id=True)
    try:
        yield lambda **values: handle.update(HTML(render("progress.html", **values)))
    finally:
        handle.update(HTML(""))


def _write(text: str) -> None:
    with contextlib.suppress(OSError, ValueError):  # a log that is full or closed does not end a run
        print(f"icpmodel ... {text}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def status_line(
    enabled: bool, opening: str = "", clock: Callable[[], float] = time.monotonic
) -> Iterator[Callable[[str], None]]:
    """A function that shows a sentence on what is going on.

    If `enabled`, a terminal or a notebook shows the latest sentence, and a log on standard error one now and then. If
    not, the logger "icpmodel" gets one now and then, at INFO. Every log gets the `opening`, which says how long it may
    take. Within another status line the function of that one is returned.
    """
    if (outer := _OPEN.get()) is not None:
        if opening:
            outer(opening)
        yield outer
        return
    with _status(enabled and sys.stderr is not None, opening, clock) as say:
        token = _OPEN.set(say)
        try:
            yield say
        finally:
            _OPEN.reset(token)


@contextlib.contextmanager
def _status(enabled: bool, opening: str, clock: Callable[[], float]) -> Iterator[Callable[[str], None]]:
    if enabled and in_notebook():
        with _cell() as show:
            yield lambda text: show(title=text, share=None, text="")
    elif enabled and sys.stderr.isatty():
        from rich.console import Console
        from rich.markup import escape

        with Console(stderr=True).status(escape(opening)) as status:
            yield lambda text: status.update(escape(text))
    else:
        write = _write if enabled else _LOG.info
        pace = _Pace(clock, log=True)
        if opening:
            write(opening)
        yield lambda text: write(text) if pace.is_due() else None


def time_left(begin: float, done: int, total: int) -> str:
    """The estimated remaining time in words, with `done` of `total` pieces finished since `begin`."""
    if not done:
        return ""
    seconds = (time.monotonic() - begin) / done * (total - done)
    return f", about {seconds:.2g} s more"
