"""Certified residuals: a small computed residual counts only where rounding cannot have made it small."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..numerics.arrays import Vector, locked, read_only
from ..numerics.rounding import UNIT_ROUNDOFF
from ..numerics.work import count
from .affine import zero
from .data import ProblemData
from .map import Map
from .matrix import Matrix
from .two_sided import sides_of

Rows = NDArray[np.float64]


def certified_residual(
    problem: ProblemData, z: Vector, residual: float, tolerance: float, weights: Vector | None = None
) -> float:
    """The Res_D(z) by which z is judged: its float64 value `residual`, or a bound on it; see `certify_rows`."""
    if not residual <= tolerance:
        return residual
    count(problem.matrix.product_cost)
    weights = problem.weights_at(z) if weights is None else weights
    if not np.isfinite(weights).all():  # where they are infinite r decides, or p is 0
        return residual
    residuals = np.array([residual])
    q, left = _constant_part(problem, z)
    offsets = [(psi.value(z) if psi.linear is None else psi.linear[1])[None] for psi in sides_of(problem.psi)]
    rows = q[None], z[None], residuals, np.array([tolerance])
    certify_rows(problem.psi, entries_of(problem.matrix), weights[None], *rows, *offsets, left=left)
    return float(residuals[0])


def satisfies_paper(problem: ProblemData, z: Vector, atol: float) -> bool:
    """Whether the exact Res(z) of the paper is at most `atol`."""
    return certified_residual(problem, z, problem.paper_residual(z), atol, np.ones(problem.n)) <= atol


@np.errstate(over="ignore", invalid="ignore")
def _constant_part(problem: ProblemData, z: Vector) -> tuple[Vector, Rows | None]:
    """q + f(z), and the rounding error of this sum as a matrix of one row; None where there is no f."""
    if problem.f is None:
        return problem.q, None
    value = problem.f.value(z)
    total = problem.q + value
    part = total - problem.q
    return total, ((problem.q - (total - part)) + (value - part))[None]


def certify_rows(
    psi: Map,
    entries: tuple[Any, Any, Rows],
    weights: Rows,
    Q: Rows,
    Z: Rows,
    residuals: Vector,
    tolerances: Vector,
    *offsets: Rows,
    left: Rows | None = None,
) -> None:
    """Replace `residuals`[i] ≤ `tolerances`[i] by a bound on the exact Res_D(Z[i]), if the bound exceeds the tolerance.

    Row i has `Q`[i], and ψ(z) = Gz + c where ψ is affine, else c = ψ(Z[i]), assumed to be exact to an ulp. `offsets`
    are the c, row by row, of the lower obstacle, and of the upper one if there is one. `entries` are those of A, see
    `entries_of`. `weights` are the diagonal of D⁻¹; ones give Res of the paper. Both have one row for each row of `Q`,
    or one for all. `left`[i], the rounding error of `Q`[i], is added to it.
    """
    from .kernels.residual import raise_to_bounds  # loads numba

    lower, *upper = (_side(one, C) for one, C in zip(sides_of(psi), offsets, strict=True))
    A = read_only((*entries, weights, Q))
    raise_to_bounds(*A, *lower, read_only(Z), tolerances, residuals, upper[0] if upper else None, left)


def entries_of(matrix: Matrix) -> tuple[Any, Any, Rows]:
    """A as `certify_rows` takes it: the CSR arrays indptr and indices, and the entries as the only row."""
    if matrix.dense is None:
        return matrix.sparse.indptr, matrix.sparse.indices, matrix.sparse.data[None]
    return *_full(matrix.n), matrix.dense.reshape(1, -1)


def _side(psi: Map, C: Rows) -> tuple[Any, ...]:
    """One obstacle, Gz + C, as arguments of the compiled loop."""
    G = zero(C.shape[1]) if psi.linear is None else psi.linear[0]
    return G.indptr, G.indices, G.data, read_only(C), 2.0 * UNIT_ROUNDOFF if psi.linear is None else 0.0


@lru_cache(maxsize=4)
def _full(n: int) -> tuple[Any, Any]:
    """The CSR arrays indptr and indices of a full n × n matrix."""
    return locked((np.arange(0, n * n + 1, n, dtype=np.int32), np.tile(np.arange(n, dtype=np.int32), n)))
