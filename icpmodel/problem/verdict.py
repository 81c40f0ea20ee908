"""The last word on a residual: what is computed counts only where rounding cannot have made it small."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..numerics.arrays import Vector
from ..numerics.rounding import UNIT_ROUNDOFF
from ..numerics.work import add
from .affine import zero
from .data import ProblemData
from .map import Map
from .matrix import Matrix

Rows = NDArray[np.float64]


def certain(problem: ProblemData, z: Vector, residual: float, tolerance: float) -> float:
    """Res(z) by which z is judged, `residual` being what float64 makes of it, see `certain_rows`."""
    if not residual <= tolerance:
        return residual
    add(problem.matrix.unit)
    psi = problem.psi
    c = psi.linear[1] if psi.linear is not None else psi.value(z)
    residuals, above = np.array([residual]), None
    if psi.upper is not None:
        above = (psi.upper.linear[1] if psi.upper.linear is not None else psi.upper.value(z))[None]
    certain_rows(problem.matrix, psi, problem.q[None], c[None], z[None], residuals, np.array([tolerance]), above)
    return float(residuals[0])


def certain_rows(
    matrix: Matrix,
    psi: Map,
    Q: Rows,
    C: Rows,
    Z: Rows,
    residuals: Vector,
    tolerances: Vector,
    above: Rows | None = None,
) -> None:
    """Where `residuals`[i] ≤ `tolerances`[i], but Res(Z[i]) without rounding might not be, it becomes a bound of that.

    Row i has `Q`[i], and ψ(z) = Gz + `C`[i] where `psi` is linear, else `C`[i] = ψ(Z[i]), taken as exact to an ulp; the
    same of what is `above`.
    """
    from ..numerics.kernels.products import raised  # loads numba

    if matrix.dense is None:
        of_A = matrix.sparse.indptr, matrix.sparse.indices, matrix.sparse.data
    else:
        of_A = *_full(matrix.n), matrix.dense.reshape(-1)
    upper = None if psi.upper is None or above is None else _side(psi.upper, above)
    raised(*of_A, _locked(Q), *_side(psi, C), _locked(Z), tolerances, residuals, upper)


def _side(psi: Map, C: Rows) -> tuple[Any, ...]:
    """One obstacle, Gz + C, as the compiled loop takes it."""
    G = zero(C.shape[1]) if psi.linear is None else psi.linear[0]
    return G.indptr, G.indices, G.data, _locked(C), 2.0 * UNIT_ROUNDOFF if psi.linear is None else 0.0


def _locked(X: Rows) -> Rows:
    """A read-only view, rows in a row: one kind of array for the compiled loop."""
    if X.flags.writeable or not X.flags.c_contiguous:
        X = np.ascontiguousarray(X).view()
        X.flags.writeable = False
    return X


@lru_cache(maxsize=4)
def _full(n: int) -> tuple[Any, Any]:
    """Where rows begin, and their columns, in an n × n matrix whose entries are all stored."""
    places = np.arange(0, n * n + 1, n, dtype=np.int32), np.tile(np.arange(n, dtype=np.int32), n)
    for array in places:
        array.flags.writeable = False
    return places
