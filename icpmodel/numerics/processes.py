"""Work that nothing can stop, such as a foreign factorisation, in a process that can be ended."""

from __future__ import annotations

import faulthandler
import os
import pickle
import select
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, TypeVar

from ..errors import OutOfMemory, OutOfTime
from .work import seconds_left

_T = TypeVar("_T")
#: whether a process can be begun that has all that this one has
CAN_FORK = hasattr(os, "fork")
#: the bytes before an item, which say how long it is
_LENGTH_BYTES = 8
#: no process is waited for longer, in milliseconds, as the system counts no more of them
_LONGEST_WAIT = 2.0**31 - 1.0
#: filters of warnings belong to all threads
_FORK_LOCK = threading.Lock()


def run_script(script: str, data: Any) -> Any:
    """What a `script` returns for `data`: it reads one pickle, and writes another one.

    A new interpreter runs it, which ends with the time, and at Ctrl-C. A fork could wait for ever for a thread of BLAS.

    Raises
    ------
    OutOfTime
        When the time is over.
    OutOfMemory
        Where the system ended the interpreter.
    OSError
        Where there is no interpreter, or the script failed.
    """
    if not sys.executable or getattr(sys, "frozen", False):
        raise FileNotFoundError("sys.executable is no Python interpreter")
    command = [sys.executable, "-c", script]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        try:
            answer, _ = process.communicate(pickle.dumps(data), min(seconds_left(), 1e-3 * _LONGEST_WAIT))
        except subprocess.TimeoutExpired:
            raise OutOfTime("a step takes longer than the time that is left") from None
        finally:
            process.kill()
    if process.returncode < 0:
        raise OutOfMemory(f"the system ended a process of {command[0]}")
    if process.returncode:
        raise ChildProcessError(f"{command[0]} ended with exit code {process.returncode}")
    try:
        return pickle.loads(answer)
    except Exception as error:  # others may print as the interpreter begins
        raise ChildProcessError(f"{command[0]} printed what is no answer") from error


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
    with _FORK_LOCK, warnings.catch_warnings():
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
