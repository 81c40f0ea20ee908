"""Interleaved timings: all calls are run in turn, round by round, so that a slow phase of the machine affects all."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Hashable, Iterator, Mapping
from datetime import date
from typing import TypeVar

Name = TypeVar("Name", bound=Hashable)
Run = TypeVar("Run")


def run_interleaved(
    calls: Mapping[Name, Callable[[], Run]], rounds: int, say: Callable[[int], None] = lambda done: None
) -> Iterator[tuple[Name, Run]]:
    """Make all `calls` in each of the `rounds`, and yield (name, result). Each round begins with another call.

    `say` is called with the number of the round, from 1. A call that is removed from `calls` is not made again.
    """
    names = list(calls)
    for done in range(rounds if names else 0):
        first = done % len(names)
        say(done + 1)
        for name in names[first:] + names[:first]:
            if name in calls:
                yield name, calls[name]()


def machine() -> str:
    """The machine, Python and today's date, for the title of a table with times."""
    return f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, {date.today()}"
