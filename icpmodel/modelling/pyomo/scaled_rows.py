"""A, ψ, ψ̄ and f of the rows of a Pyomo model, in units in which z_i has a positive coefficient."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from ...numerics.arrays import Mask, Vector
from ...problem.affine import Affine
from ...problem.function import Function
from .condition_rows import ConditionRows
from .nonlinear import NonlinearRows, PyomoObstacle
from .ownership import Ownership


class Scaling(NamedTuple):
    """z_i is `signs`_i times its variable, p_i is multiplied by `flip`_i and r_i divided by `scale`_i.

    In `absent` rows r_i has no z_i, so that ψ_i gets one.
    """

    signs: Vector
    flip: Vector
    scale: Vector
    absent: Mask

    @classmethod
    def of(cls, owned: Ownership) -> Scaling:
        """That in which z_i has the coefficient 1 in r_i, or a positive one in p_i where r_i has none."""
        free = owned.free
        every = np.arange(owned.m)
        both = np.array([owned.own_coefficient(k) for k in (0, 1)])
        in_r = both[owned.which_r, every]
        in_p = both[1 - owned.which_r, every]
        plain = (in_r == 0) | free
        return cls(
            signs=np.where(free, 1.0, np.where(plain, np.where(in_p < 0, -1.0, 1.0), np.sign(in_r))),
            flip=np.where(free & (in_p < 0), -1.0, 1.0),
            scale=np.where(plain, 1.0, np.abs(in_r)),
            absent=plain & ~free,
        )


def matrices(owned: Ownership, scaling: Scaling) -> tuple[sp.csr_array, sp.csr_array]:
    """A and the affine part G of ψ."""
    of_p = list[tuple[Any, ...]]()
    of_psi = list[tuple[Any, ...]]()
    for k, side in enumerate(owned.sides):
        is_r = owned.which_r[side.row] == k
        column = owned.owner[side.col]
        data = side.data * scaling.signs[column]
        kept = is_r & (column != side.row) & ~owned.free[side.row]
        of_p.append((data * scaling.flip[side.row], side.row, column, ~is_r))
        of_psi.append((-data / scaling.scale[side.row], side.row, column, kept))
    absent = np.flatnonzero(scaling.absent)
    of_psi.append((np.ones(absent.size), absent, absent, np.full(absent.size, True)))
    return _assembled(of_p, owned.m), _assembled(of_psi, owned.m)


def obstacles(
    rows: ConditionRows, owned: Ownership, G: sp.csr_array, c: Vector, scaling: Scaling
) -> tuple[Any, Any, Any]:
    """ψ(z) = Gz + c with what is nonlinear, ψ̄, above it by what `rows.widths` say, and f; None where there is none."""
    m = owned.m

    def nonlinear(G: sp.csr_array, c: Vector, flat: dict[int, Any], scale: Vector) -> Function:
        obstacle = PyomoObstacle(G, c, NonlinearRows(flat, owned.row_of, (m, m)), scaling.signs, scale)
        return Function(obstacle, obstacle.jacobian)

    def made(G: sp.csr_array, c: Vector, flat: dict[int, Any]) -> Any:
        if flat:
            return nonlinear(G, c, flat, scaling.scale)
        return Affine(G, c) if G.nnz else c + 0.0

    of_p, flat = rows.nonlinear()
    f = nonlinear(0.0 * G, np.zeros(m), of_p, np.full(m, -1.0)) if of_p else None
    psi = made(G, c, flat)
    if not rows.widths:
        return psi, None, f
    H, above = _affine_upper(rows, owned, G, c, scaling)
    return psi, made(H, above, {row: one for row, one in flat.items() if row in rows.widths}), f


def _affine_upper(
    rows: ConditionRows, owned: Ownership, G: sp.csr_array, c: Vector, scaling: Scaling
) -> tuple[sp.csr_array, Vector]:
    """The affine part of ψ̄: that of ψ plus the widths, inf in rows without one."""
    above = np.full(owned.m, np.inf)
    entries = []
    for row, (constant, linear, _) in rows.widths.items():
        above[row] = c[row] + constant / scaling.scale[row]
        for key, value in linear.items():
            column = owned.row_of[key]
            entries.append((value * scaling.signs[column] / scaling.scale[row], row, column))
    H = sp.csr_array(sp.diags_array(owned.ranges.astype(np.float64)) @ G)
    H.eliminate_zeros()
    if entries:
        data, i, j = zip(*entries, strict=True)
        H = sp.csr_array(H + sp.coo_array((data, (i, j)), shape=H.shape))
    return H, above


def _assembled(parts: list[tuple[Any, ...]], m: int) -> sp.csr_array:
    """The m × m matrix of those (data, rows, columns) that are kept."""
    data, rows, columns = (np.concatenate([part[k][part[3]] for part in parts]) for k in range(3))
    return sp.csr_array(sp.coo_array((data, (rows, columns)), shape=(m, m)))
