"""Check and convert the arguments of programs, which are named as in qpsolvers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import InputError
from ...numerics import work
from ...numerics.arrays import Vector, as_array, as_csr, as_number, as_rows, as_vector, axes
from ...numerics.labels import along_rows, along_unknowns, check_labels
from ...numerics.threads import one_blas_thread
from ...theory.matrices.definiteness import definiteness, semidefinite_up_to_rounding
from .program import Program, Rows


def read(data: tuple[Any, ...], names: str, initvals: Any = None) -> Program:
    """The program of `data` H, g, G, h, A, b, lb, ub; None is no constraint. `names` are those of H and g in messages.

    Of `initvals` only the labels are checked. Raises InputError.
    """
    H, g, G, h, A, b, lb, ub = data
    vectors = {names[1]: g, "initvals": initvals, "lb": lb, "ub": ub}
    check_labels({names[0]: H, "G": along_unknowns(G), "A": along_unknowns(A), **vectors})
    H = as_csr(H, names[0])
    n = H.shape[0]
    g = as_vector(g, n, names[1])
    return Program.of_rows(H, g, _rows(A, b, n, "Ab"), _rows(G, h, n, "Gh"), *bounds(lb, ub, n))


@contextmanager
def program_limits(tolerance: Any, time_limit: Any, start_time: float) -> Iterator[None]:
    """Limit the time of the block from `start_time` on, and BLAS to one thread. Raises InputError for wrong limits."""
    as_number(tolerance, "tolerance", above=0, below=1)  # violations are relative to terms, so at most 1
    seconds = math.inf if time_limit is None else as_number(time_limit, "time_limit", above=0)
    with one_blas_thread(), work.work_limit(seconds, start_time=start_time):
        yield


def bounds(lb: Any, ub: Any, n: int) -> tuple[Vector, Vector]:
    """Both bounds, infinite where there are none. Raises InputError."""
    low = np.full(n, -np.inf) if lb is None else as_vector(lb, n, "lb", infinite=-np.inf)
    high = np.full(n, np.inf) if ub is None else as_vector(ub, n, "ub", infinite=np.inf)
    if np.isneginf(high).any():
        raise InputError(f"ub[{np.argmin(high)}] is -inf; a finite number or inf was expected")
    return low, high


def check_order(low: Vector, high: Vector) -> None:
    """Raise InputError if bounds cross."""
    if (low > high).any():
        i = np.argmax(low > high)
        raise InputError(f"lb[{i}] = {low[i]:g} is above ub[{i}] = {high[i]:g}; lb <= ub was expected")


def matrix(M: Any, name: str, n: int | None = None) -> sp.csr_array:
    """`M` as a CSR matrix without stored zeros; a 1-D `M` is one row. `n` is the expected number of columns, if any.

    Raises InputError, also for entries that are not finite.
    """
    if axes(M, name) == 1:
        M = (M if sp.issparse(M) else as_array(M, name)).reshape(1, -1)
    if axes(M, name) != 2 or np.shape(M)[1] != (n or np.shape(M)[1]):
        raise InputError(f"{name} has shape {np.shape(M)}; shape (m, {n or 'n'}) was expected")
    M = as_rows(M, name)
    M.eliminate_zeros()
    return M


def _rows(M: Any, right: Any, n: int, names: str) -> Rows:
    """The matrix and the right-hand side of constraints; no rows if both are None. Raises InputError."""
    if (M is None) != (right is None):
        raise InputError(f"{names[M is None]} is given without {names[right is None]}: give both, or leave both out")
    if M is None:
        return sp.csr_array((0, n)), np.zeros(0)
    check_labels({names[0]: along_rows(M), names[1]: right})
    M = matrix(M, names[0], n)
    if not M.shape[0] and not np.size(right):
        return M, np.zeros(0)
    return M, as_vector(right, M.shape[0], names[1], infinite=np.inf if names == "Gh" else None)


@np.errstate(all="ignore")  # sums and differences may overflow
def check_convex(program: Program) -> None:
    """Raise InputError if P is not symmetric or is proved not to be semidefinite. Raises OutOfTime."""
    P = program.H
    if not program.is_symmetric:
        i, j = divmod(int(abs(P - P.T).argmax()), P.shape[0])
        raise InputError(
            f"P[{i}, {j}] = {P[i, j]:.6g}, but P[{j}, {i}] differs by {P[j, i] - P[i, j]:.3g}; a symmetric matrix "
            "was expected: (P + P.T)/2 has the same objective, and solve_avi takes matrices that are not symmetric"
        )
    work.charge_matrices(P.nnz, 4)
    if (P.diagonal() >= abs(P).sum(axis=1) - P.diagonal()).all() or semidefinite_up_to_rounding(P).holds:
        return
    answer = definiteness(P)[1]
    if answer.holds is False:
        raise InputError(
            f"P is not positive semidefinite, so that the program is not convex: {answer.reason}; "
            "solve_avi(P, q, ...) looks for a point that meets the conditions of optimality"
        )
