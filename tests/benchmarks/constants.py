"""Prices of the choice: in the table, and measured on this machine."""

from functools import partial
from itertools import islice

import numpy as np
import pyamg
import scipy.sparse as sp
from scipy.optimize import nnls

import icpmodel as icp
from icpmodel.numerics.work import COSTS

from .harness import timer

#: the number of sweeps timed together, as a method may make some of them in one pass
TOGETHER = 8


def table(sizes=(100, 1_000, 10_000, 100_000), repeats=9):
    """What `solve()` counts an entry, a row, a multiplication for, and what they cost here, in nanoseconds.

    Fitted to the times of products, sweeps, vector operations, sparse products and sums, and hierarchies, with the
    least relative errors; a time is the least of all repeats. The other prices of the table belong to steps inside
    the package, which no public call makes alone.

    Parameters
    ----------
    sizes : unknowns (the nearest squares)
    repeats : of a task
    """
    yield "constant", "in the table, ns", "measured now, ns", "ratio"
    timed = [(units, least(call, repeats)) for n in sizes for units, call in tasks(n)]
    names = sorted({name for units, _ in timed for name in units})
    shares = np.array([[units.get(name, 0.0) / seconds for name in names] for units, seconds in timed])
    size = shares.max(axis=0)
    found, _ = nnls(shares / size, np.ones(len(timed)))
    for name, value in zip(names, 1e9 * found / size, strict=True):
        known = getattr(COSTS, name)
        yield name, known, float(value), float(value / known)


def least(call, repeats):
    call()  # compiles
    return min(timer(call)() for _ in range(repeats))


def tasks(n):
    """(how many units of each constant, the call), on a square grid and its square."""
    grid = icp.scenes.membrane(n=n, mu=0.01).problem.A
    for A in (grid, sp.csr_array(grid @ grid)):
        n, z = A.shape[0], np.ones(A.shape[0])
        path = icp.PSOR(omega=1.0).iterates(icp.ICP(A, -z), z)
        yield {"call": 1, "row": n, "entry": A.nnz}, partial(A.__matmul__, z)
        units = {"call": TOGETHER, "sweep_row": TOGETHER * n, "sweep_entry": TOGETHER * A.nnz}
        yield units, lambda path=path: [z for z, _ in islice(path, TOGETHER)][-1]
        yield {"vector": n}, partial(np.minimum, z, z, out=np.empty(n))
        yield {"assembly": 1, "assembly_entry": A.nnz}, partial(A.__add__, A)
    yield {"hierarchy": 1, "hierarchy_entry": grid.nnz}, partial(pyamg.ruge_stuben_solver, sp.csr_matrix(grid))
