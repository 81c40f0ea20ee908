"""Threads: for compiled loops over rows on several cores, and for long steps that cannot be interrupted.

Both release the interpreter's lock.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from threading import TIMEOUT_MAX, Lock, Thread
from typing import Any, TypeVar

from ..errors import OutOfTime
from .work import nanoseconds_left, seconds_left

#: the least number of entries of a loop for which threads pay
THREADS_FROM = 1_000_000
#: a function of low and high that computes the rows low <= i < high
RowTask = Callable[[int, int], Any]
_T = TypeVar("_T")
#: sparse symmetric factors and half-solves in space take up to this multiple of their predicted cost: 11 was measured
#: for n = 27 000, whose factors leave the cache
LARGEST_RATIO = 20.0
#: the name of the threads of such steps, which may go on when the time is over
ABANDONED_THREAD = "icpmodel: out of time"
#: a lock, the blocks that limit BLAS to one thread, and the limiter that restores its threads
_BLAS_LOCK = Lock()
_BLAS_USERS = set[object]()
_blas_limiter: Any = None


def _reset_after_fork() -> None:
    """In a fork, make a new lock and restore the threads of BLAS: the blocks that limited them do not run there."""
    global _BLAS_LOCK
    _BLAS_LOCK = Lock()
    if _BLAS_USERS:
        _BLAS_USERS.clear()
        _restore_blas()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_reset_after_fork)


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_in_threads(size: int, parts: int, work: RowTask) -> list[Any]:
    """Run `work(low, high)` on `parts` pieces of range(`size`), the first one here, the others in threads."""
    cuts = [size * i // parts for i in range(parts + 1)]
    if parts == 1:
        return [work(0, size)]
    with ThreadPoolExecutor(parts - 1) as others:
        later = others.map(work, cuts[1:], cuts[2:])  # begins at once
        return [work(0, cuts[1]), *later]


def run_with_deadline(step: Callable[[], _T], estimate: float) -> _T:
    """Run a `step` that cannot be interrupted; raise OutOfTime where it has not ended when the time is over.

    By the table of costs it takes at most `estimate` nanoseconds. Where that may be too long it runs
    in a thread, which goes on if the step is late. Python waits for this thread at its exit, as
    SuperLU must not be ended with the interpreter; commands do not.
    """
    if estimate <= nanoseconds_left():
        return step()
    result: Future[_T] = Future()

    def run() -> None:
        try:
            result.set_result(step())
        except BaseException as error:
            result.set_exception(error)

    Thread(target=run, name=ABANDONED_THREAD).start()
    try:
        return result.result(min(seconds_left(), TIMEOUT_MAX))
    except TimeoutError:
        raise OutOfTime("a step takes longer than estimated, and than the time that is left") from None


def threads_for(nnz: int) -> int:
    """The number of threads that a loop over `nnz` entries should use."""
    return cores() if nnz >= THREADS_FROM else 1


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread in a block, so that results do not depend on the number of threads.

    On a busy machine a second thread made LU factorisations with n = 200 … 2000 two to a hundred
    times slower, as BLAS spins while it waits. Setting the limit takes 12 μs. It holds for the
    process: the first of several threads that ask sets it, the last one lifts it.
    """
    global _blas_limiter
    user = object()
    with _BLAS_LOCK:
        if not _BLAS_USERS:
            _release_blas()
            _blas_limiter = pools("blas").limit(limits=1)
        _BLAS_USERS.add(user)
    try:
        yield
    finally:
        with _BLAS_LOCK:
            _BLAS_USERS.discard(user)
            if not _BLAS_USERS:
                _restore_blas()


def _restore_blas() -> None:
    _release_blas()
    _blas_limiter.restore_original_limits()
    _release_blas()  # so that others may set their limits


def _release_blas() -> None:
    """Let any thread set limits: threadpoolctl 3.8 ignores all but the first one, as long as that lives."""
    for library in pools("blas").lib_controllers:
        if hasattr(library, "clear_controlling_thread"):  # OpenBLAS
            library.clear_controlling_thread(force=True)


@cache
def pools(user_api: str) -> Any:
    """The controller of the threads of "blas", or of "openmp", of the libraries loaded at the first call."""
    import scipy.linalg  # noqa: F401  has a BLAS of its own, which is found only if loaded
    import threadpoolctl

    return threadpoolctl.ThreadpoolController().select(user_api=user_api)
