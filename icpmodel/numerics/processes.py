"""Run work that cannot be interrupted, such as a foreign factorisation, in a process that can be ended."""

from __future__ import annotations

import faulthandler
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from multiprocessing import Pipe
from typing import Any, TypeVar

from ..errors import OutOfMemory, OutOfTime
from .work import seconds_left

_T = TypeVar("_T")
#: whether this process can be forked
CAN_FORK = hasattr(os, "fork")
#: the longest wait for a process, in seconds: the system counts milliseconds in an int
_LONGEST_WAIT = 2e6
#: the filters of warnings, which a fork changes, belong to all threads
_FORK_LOCK = threading.Lock()


def run_script(script: str, data: Any) -> Any:
    """Run a Python `script` in a new interpreter on `data`, and return what it writes.

    It reads one pickle from standard input, and writes one to standard output. It is ended when the time is over, and
    at Ctrl-C. A fork could wait for ever for a thread of BLAS.

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
    streams: Any = {"input": pickle.dumps(data), "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    try:
        process = subprocess.run(command, timeout=min(seconds_left(), _LONGEST_WAIT), **streams)
    except subprocess.TimeoutExpired:
        raise OutOfTime("a step takes longer than the time that is left") from None
    if process.returncode < 0:
        raise OutOfMemory(f"the system ended a process of {command[0]}")
    if process.returncode:
        raise ChildProcessError(f"{command[0]} ended with exit code {process.returncode}")
    try:
        return pickle.loads(process.stdout)
    except Exception as error:  # others may print as the interpreter begins
        raise ChildProcessError(f"{command[0]} printed what is no answer") from error


def in_a_process(items: Callable[[], Iterator[_T]], end: float) -> Iterator[_T]:
    """Run `items` in a fork of this process, and yield each item as soon as it arrives.

    An exception of `items` is raised here.

    Parameters
    ----------
    items
        Called in the other process. What it yields is pickled.
    end
        Time of `time.perf_counter()` at which the other process is ended.

    Raises
    ------
    OutOfTime
        At the `end`.
    ChildProcessError
        Where the other process died.
    """
    reader, writer = Pipe(duplex=False)
    with _FORK_LOCK, warnings.catch_warnings():
        # Python and JAX warn that threads may hold locks; those of this package are made anew in the other process
        warnings.simplefilter("ignore")
        child = os.fork()
    if not child:
        _send(items, writer)
    writer.close()
    try:
        while True:
            if not reader.poll(min(max(end - time.perf_counter(), 0.0), _LONGEST_WAIT)):
                raise OutOfTime("the time is over")
            try:
                ended, item = reader.recv()
            except (EOFError, OSError):
                _, status = os.waitpid(child, 0)
                child = 0
                died = f"its process died with exit code {os.waitstatus_to_exitcode(status)}"
                raise ChildProcessError(died) from None
            if ended and item is not None:
                raise item
            if ended:
                return
            yield item
    finally:
        reader.close()
        if child:
            with suppress(OSError):
                os.killpg(child, signal.SIGKILL)  # and what it began itself
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)


def _send(items: Callable[[], Iterator[Any]], writer: Any) -> None:
    """Send the `items` and exit, in a new process group, which Ctrl-C does not reach."""
    try:
        os.setsid()
        faulthandler.disable()  # the parent says what a crash means
        try:
            for item in items():
                writer.send((False, item))
            writer.send((True, None))
        except Exception as error:
            writer.send((True, error))
    finally:
        os._exit(1)
