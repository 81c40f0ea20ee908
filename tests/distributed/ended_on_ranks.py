"""A scene that ends badly: `mpiexec -n RANKS python ended_on_ranks.py WAY` runs the command on it; or
a script that does."""

import os
import signal
import sys

from mpi4py import MPI

import icpmodel as icp
from icpmodel.cli import main
from icpmodel.scenes.registry import assembles, register

RANK, LAST = MPI.COMM_WORLD.rank, MPI.COMM_WORLD.size - 1


def interrupt():
    """What a terminal does at Ctrl-C, to mpiexec, once; a rank that is at work in Python hears of it."""
    if RANK == LAST:
        os.kill(os.getppid(), signal.SIGINT)
    signal.pause()


def interrupt_all():
    os.kill(os.getpid(), signal.SIGINT)


def fail():
    if RANK == LAST:
        raise ZeroDivisionError("broken")


def die():
    if RANK == LAST:
        os._exit(3)


WAYS = {"ctrl-c": interrupt, "ctrl-c of all": interrupt_all, "raises": fail, "dies": die, "nan": lambda: None}


@register
def bad(n=100):
    """It ends badly."""


@assembles("bad")
def _bad(n):
    whole, way = icp.scenes.by_rows("membrane", n=n), sys.argv[1]

    def rows(lo, hi):
        WAYS[way]()
        A, q, psi, _ = whole.local_rows(lo, hi)
        if way == "nan" and RANK == LAST:
            psi[0] = float("nan")
        return A, q, psi

    return icp.ByRows(whole.shape, rows)


if sys.argv[1] != "script":
    main(["distributed", "bad"])
problem = icp.distributed.by_rows(icp.scenes.by_rows("membrane", n=100))
if RANK == LAST:
    raise KeyError("of the script")
icp.distributed.solve(problem)
