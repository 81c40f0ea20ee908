"""Arguments of programs, in the words of qpsolvers, checked and read."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import InputError
from ...numerics.arrays import Vector, as_array, as_csr, as_number, as_rows, as_vector, axes
from ...theory.matrices.definiteness import definiteness, semidefinite_up_to_rounding
from .program import Program


def read(H: Any, g: Any, G: Any, h: Any, A: Any, b: Any, lb: Any, ub: Any, names: tuple[str, str]) -> Program:
    """The program with these data, None leaving constraints out; `names` those of H and g. Raises InputError."""
    H = as_csr(H, names[0])
    n = H.shape[0]
    rows = *_rows(G, h, n, ("G", "h")), *_rows(A, b, n, ("A", "b"))
    return Program(H, as_vector(g, n, names[1]), *rows, *bounds(lb, ub, n))


def check_limits(tolerance: Any, time_limit: Any) -> None:
    """Raise InputError unless both are numbers above 0, or there is no limit of time."""
    as_number(tolerance, "tolerance", above=0)
    if time_limit is not None:
        as_number(time_limit, "time_limit", above=0)


def bounds(lb: Any, ub: Any, n: int) -> tuple[Vector, Vector]:
    """Both bounds, infinite where there are none."""
    return _bound(lb, n, "lb", -np.inf), _bound(ub, n, "ub", np.inf)


def _bound(value: Any, n: int, name: str, none: float) -> Vector:
    bound = np.full(n, none) if value is None else as_vector(value, n, name, infinite=none)
    if (bound == -none).any():
        raise InputError(f"{name}[{np.argmax(bound == -none)}] is {-none}; a finite number or {none} was expected")
    return bound


def matrix(M: Any, name: str, n: int | None = None) -> sp.csr_array:
    """A CSR matrix with n columns, or any number of them, of finite numbers."""
    if axes(M, name) == 1:
        M = as_array(M, name)[None]
    if axes(M, name) != 2 or np.shape(M)[1] != (n or np.shape(M)[1]):
        raise InputError(f"{name} has shape {np.shape(M)}; shape (m, {n or 'n'}) was expected")
    M = as_rows(M, name)
    M.eliminate_zeros()
    return M


def _rows(M: Any, right: Any, n: int, names: tuple[str, str]) -> tuple[sp.csr_array, Vector]:
    """The matrix and the right-hand side of constraints, none where both are None."""
    if (M is None) != (right is None):
        stated, other = names[::-1] if M is None else names
        raise InputError(f"{stated} is given without {other}: give both, or leave both out")
    if M is None:
        return sp.csr_array((0, n)), np.zeros(0)
    M = matrix(M, names[0], n)
    if M.shape[0] == 0:
        return M, np.zeros(0)
    return M, as_vector(right, M.shape[0], names[1], infinite=np.inf if names[0] == "G" else None)


def check_convex(program: Program) -> None:
    """Raises InputError where P is not symmetric, or is proved not to be semidefinite."""
    P = program.H
    if not program.is_symmetric:
        skew = sp.coo_array(P - P.T)
        k = int(np.argmax(np.abs(skew.data)))
        i = int(skew.coords[0][k])
        j = int(skew.coords[1][k])
        raise InputError(
            f"P[{i}, {j}] = {P[i, j]:.6g}, but P[{j}, {i}] differs by {P[j, i] - P[i, j]:.3g}; a symmetric matrix "
            "was expected: (P + P.T)/2 has the same objective, and solve_avi takes matrices that are not symmetric"
        )
    if (2.0 * P.diagonal() >= abs(P).sum(axis=1)).all():
        return
    used = np.flatnonzero(np.diff(P.indptr))
    part = sp.csr_array(P[used][:, used])
    if semidefinite_up_to_rounding(part).holds:
        return
    answer = definiteness(P)[1]
    if answer.holds is False:
        raise InputError(f"P is not positive semidefinite, so that the program is not convex: {answer.reason}")
