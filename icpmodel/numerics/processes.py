"""Work that nothing can stop, such as a foreign factorisation, in a process that can be ended."""

from __future__ import annotations

import faulthandler
import os
import pickle
import select
import signal
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, TypeVar

from ..errors import OutOfTime
from .threads import run_with_deadline
from .work import seconds_left

_T = TypeVar("_T")
#: whether a process can be begun that has all that this one has
CAN_FORK = hasattr(os, "fork")
#: the bytes before an item, which say how long it is
_LENGTH_BYTES = 8
#: no process is waited for longer, in milliseconds, as the system counts no more of them
_LONGEST_WAIT = 2.0**31 - 1.0


def run_apart(step: Callable[[], _T], estimate: float) -> _T:
    """Run a `step` in one piece that holds the interpreter's lock; raises as `run_with_deadline`, which has the rest.

    A process runs it, which ends with the time, and at Ctrl-C. Where there can be none, a thread does.
    """
    if CAN_FORK:
        with suppress(OSError):
            return next(in_a_process(lambda: iter([step()]), time.perf_counter() + seconds_left()))
    return run_with_deadline(step, estimate)


def in_a_process(items: Callable[[], Iterator[_T]], end: float) -> Iterator[_T]:
    """What `items` yields in a fork of this process, each as soon as it is there.

    Parameters
    ----------
    items
        Called in the other process. What it yields is pickled.
    end
        When the other process is ended, as `time.perf_counter` says it.

    Raises
    ------
    OutOfTime
        At the `end`.
    ChildProcessError
        Where the other process died.
    """
    reader, writer = os.pipe()
    with warnings.catch_warnings():
        # of threads, by Python and JAX: they may hold locks; those of this package are made anew in the other process
        warnings.simplefilter("ignore")
        try:
            child = os.fork()
        except OSError:
            os.close(reader)
            os.close(writer)
            raise
    if not child:
        _send(items, writer)
    os.close(writer)
    answer = select.poll()  # knows files of any number
    answer.register(reader, select.POLLIN)
    try:
        while True:
            milliseconds = 1e3 * max(end - time.perf_counter(), 0.0)
            if not answer.poll(min(milliseconds, _LONGEST_WAIT)):
                raise OutOfTime("the time is over")
            data = _read(reader, int.from_bytes(_read(reader, _LENGTH_BYTES), "big"))
            if not data:
                _, status = os.waitpid(child, 0)
                child = 0
                raise ChildProcessError(f"its process died with exit code {os.waitstatus_to_exitcode(status)}")
            ended, item = pickle.loads(data)
            if ended and item is not None:
                raise item
            if ended:
                return
            yield item
    finally:
        os.close(reader)
        if child:
            with suppress(OSError):
                os.killpg(child, signal.SIGKILL)  # and what it began itself
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)


def _send(items: Callable[[], Iterator[Any]], writer: int) -> None:
    """Send the `items` and exit, in a new process group, which Ctrl-C does not reach."""
    try:
        os.setsid()
        faulthandler.disable()  # the parent says what a crash means
        try:
            for item in items():
                _write(writer, (False, item))
            _write(writer, (True, None))
        except Exception as error:
            _write(writer, (True, error))
    finally:
        os._exit(1)


def _write(writer: int, item: Any) -> None:
    data = pickle.dumps(item)
    left = memoryview(len(data).to_bytes(_LENGTH_BYTES, "big") + data)
    while left:
        left = left[os.write(writer, left) :]


def _read(reader: int, count: int) -> bytearray:
    """Read `count` bytes; none if the other end is closed before."""
    data = bytearray()
    while len(data) < count:
        more = os.read(reader, count - len(data))
        if not more:
            return bytearray()
        data += more
    return data
