"""Trials in another process, so that one that dies or hangs is an answer as well."""

from __future__ import annotations

import contextlib
import faulthandler
import multiprocessing
import signal
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any

from .examiner import Lie, examined
from .trial import Trial

Outcome = tuple[bool, list[Lie]]

#: seconds after which a trial hangs; none has a limit beyond one second, and compilation takes half a minute
_HANGS = 120.0
#: seconds that a process has to end by itself
_ENDS = 1.0


def _serve(connection: Connection, examine: Callable[[Trial], Outcome]) -> None:
    """Answers one trial after the other until the parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent
    faulthandler.enable()  # a crash may come once in a million trials, and says then where it was
    warnings.simplefilter("ignore")
    with contextlib.suppress(EOFError, ConnectionError):
        while True:
            connection.send(examine(connection.recv()))


@dataclass(eq=False)
class Worker:
    """A process that examines trials by `examine`, begun anew after a trial that it does not survive."""

    examine: Callable[[Trial], Outcome] = examined
    hangs: float = _HANGS
    process: Any = field(default=None, init=False)
    connection: Any = field(default=None, init=False)

    def begin(self, trial: Trial) -> None:
        """Hands `trial` over."""
        if self.process is None:
            context = multiprocessing.get_context("spawn")
            self.connection, there = context.Pipe()
            self.process = context.Process(target=_serve, args=(there, self.examine), daemon=True)
            self.process.start()
            there.close()
        self.connection.send(trial)

    def end(self) -> Outcome:
        """What came of it."""
        try:
            if self.connection.poll(self.hangs):
                found: Outcome = self.connection.recv()
                return found
            lie = Lie("hang", f"no end after {self.hangs:g} s")
        except (EOFError, ConnectionError):
            self.process.join()
            lie = Lie("crash", f"the process ended with code {self.process.exitcode}")
        self.close()
        return False, [lie]

    def ask(self, trial: Trial) -> Outcome:
        """`begin` and `end`."""
        self.begin(trial)
        return self.end()

    def close(self) -> None:
        """Ends the process, which sees that nobody asks any more, or else is killed."""
        if self.process is not None:
            self.connection.close()
            self.process.join(_ENDS)
            self.process.kill()
            self.process.join()
            self.process = None
