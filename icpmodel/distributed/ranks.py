"""PETSc and MPI at first use, reductions over ranks, and errors raised on all, so that none waits for a failed one."""

from __future__ import annotations

import atexit
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np

from ..errors import FileError, InputError, MapError, NotApplicable
from ..numerics import arrays
from ..numerics.arrays import Vector, described

_MISSING = (
    "icpmodel.distributed needs petsc4py and mpi4py, which pip install 'icpmodel[petsc]' builds from sources; "
    "docs/distributed.md has quicker ways"
)

#: errors that are the same on all ranks, first those of the package
_OWN_ERRORS = (InputError, FileError, MapError, NotApplicable)
_SENT_ERRORS = (*_OWN_ERRORS, OSError, MemoryError)


class FailedOnRank(RuntimeError):
    """An error of a user's code, not of the package, on the rank that the message names."""


def petsc() -> Any:
    """The module `petsc4py.PETSc`, ready for use. Raises NotApplicable where it is missing."""
    try:
        import mpi4py.MPI  # noqa: F401  MPI begins here, or has begun
        from petsc4py import PETSc
    except ImportError as error:
        raise NotApplicable(f"{_MISSING} ({error})") from error
    _abort_at_failing_exit()
    return PETSc


@cache
def _abort_at_failing_exit() -> None:
    """At exit, abort all ranks if the script on this one ended by an error: PETSc would wait for the others."""
    from mpi4py import MPI

    def leave() -> None:
        if getattr(sys, "last_type", None) is not None and not MPI.Is_finalized() and MPI.COMM_WORLD.size > 1:
            sys.stderr.flush()
            MPI.COMM_WORLD.Abort(1)

    atexit.register(leave)


def world(comm: Any = None) -> Any:
    """`comm` as an mpi4py communicator: all ranks where it is None. Raises InputError, NotApplicable."""
    PETSc = petsc()
    comm = PETSc.COMM_WORLD if comm is None else comm
    if isinstance(comm, PETSc.Comm):
        return comm.tompi4py()
    if not hasattr(comm, "Allgather"):
        raise InputError(f"comm is {described(comm)}; a communicator of mpi4py or petsc4py was expected")
    return comm


def release(*comms: Any) -> None:
    """Give back the memory of PETSc's objects that no rank holds any more. Collective.

    petsc4py destroys none by itself, as ranks must do so in the same order: without this no memory would be freed.
    """
    for comm in comms:
        petsc().garbage_cleanup(comm)


@contextmanager
def together(comm: Any) -> Iterator[None]:
    """A block of local work that all ranks leave together: an error of one is raised on all, also by `sys.exit()`.

    Nothing in the block may wait for other ranks. The message names the first rank that failed, unless it is rank 0.
    """
    fault: Exception | SystemExit | None = None
    try:
        yield
    except (Exception, SystemExit) as error:
        fault = error
    failed = np.flatnonzero(_of_all(comm, fault is not None))
    if not failed.size:
        return
    first = int(failed[0])
    kind, text = comm.bcast(_error_message(fault) if comm.rank == first else None, root=first)
    text = f"{text} (rank {first} of {comm.size})" if first else text
    raise (kind or FailedOnRank)(text) from fault


def _error_message(fault: BaseException | None) -> tuple[type[Exception] | None, str]:
    """(class, text) of an error, for the other ranks.

    The class is None unless all ranks have it and it takes one text. Where it is not one of the package's, the text
    begins with the name of the error.
    """
    kind = next((one for one in _SENT_ERRORS if isinstance(fault, one)), None)
    try:
        text = str(fault)
    except Exception as error:  # whatever the class of a user raises
        text = f"its text raised {type(error).__name__}"
    return kind, text if kind in _OWN_ERRORS else f"{type(fault).__name__}: {text}"


def _of_all(comm: Any, number: float) -> Vector:
    """The `number` of each rank, shape (ranks,), on all of them."""
    every = np.empty(comm.size)
    comm.Allgather(np.array([number], dtype=np.float64), every)
    return every


def count(comm: Any, mask: Any) -> int:
    """How many entries of the own `mask`, or bool, are true over all ranks."""
    return int(_of_all(comm, int(np.count_nonzero(mask))).sum())


def anywhere(comm: Any, mask: Any) -> bool:
    """Whether an entry of the own `mask`, or bool, is true on any rank."""
    return count(comm, mask) > 0


def largest(comm: Any, own: Any) -> float:
    """The largest of the `own` entries over all ranks, at least 0; NaN where one of them is."""
    return float(_of_all(comm, np.max(own, initial=0.0)).max())


def norm(comm: Any, own: Vector) -> float:
    """‖x‖₂, where each rank has its `own` entries of x; see `numerics.arrays.norm`."""
    return arrays.norm(_of_all(comm, arrays.norm(own) if own.size else 0.0))
