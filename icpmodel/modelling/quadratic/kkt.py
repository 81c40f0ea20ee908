"""The linear systems of a step: those of the KKT conditions, with a weight for every inequality.

    (P + W₀)dx + Eᵀdλ + Aᵀdν = f,     E dx − W⁻¹dλ = e,     A dx − δdν = a

with diagonal W₀ ≥ 0, W ≥ 0 (dλ_i = 0 where w_i = 0), and ρ on the diagonal of P, δ ≥ 0 small, so that there is always
one solution. Whichever is foreseen to cost less is factorised: P + ρ + W₀ + EᵀWE as a dense matrix, and A with it, or
the sparse whole, of which only the diagonal changes, in an order of its rows that is looked for once.
Reference: Vanderbei, SIAM J. Optim. 5 (1995), for quasidefinite matrices, which may be factorised in any order.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import OutOfMemory, OutOfTime
from ...numerics import work
from ...numerics.arrays import Vector, diagonal_positions, norm
from ...numerics.factorisation import SymmetricPattern, factorise
from ...numerics.fill import Look, ordered
from ...numerics.linear import by_refinement
from ...numerics.rounding import UNIT_ROUNDOFF
from .program import handy

#: ρ and δ beside entries of about 1
_SMALL = 1e-9
#: a smaller weight counts as none
_NONE = 1e-20
#: what is added to ρ and δ, and taken back by refinement, where pivots without exchanges of rows are no more than
#: rounding: its square has to be above that
_MORE = 1e-7
#: what refinement may leave of the right-hand side, after so many solves at the most
_LEFT, _REFINED = 1e-10, 30
#: bytes of an entry of a factor, and of as much again while it is made
_BYTES = 24

#: the search for an order of the rows ends where the cost is foreseen to be so many times that of dense factors: what
#: is foreseen before the end was 7 times too much for a transport problem, where rows and columns are of two kinds
_DOUBT = 100.0
#: nanoseconds beside which it pays to eliminate variables
_ELIMINATING = 10 * work.COSTS.call


class KktBlocks(NamedTuple):
    """P, E and A, each an array or CSR."""

    P: Any
    E: Any
    A: Any

    @property
    def n(self) -> int:
        return int(self.P.shape[0])

    @property
    def m(self) -> int:
        return int(self.E.shape[0])

    @property
    def k(self) -> int:
        return int(self.A.shape[0])

    def of(self, columns: NDArray[np.intp]) -> KktBlocks:
        """Those of these variables alone."""
        return KktBlocks(handy(self.P[columns][:, columns]), handy(self.E[:, columns]), handy(self.A[:, columns]))


Solve = Callable[[Vector, Vector, Vector], tuple[Vector, Vector, Vector]]


class DenseSystems:
    """By Cholesky's factors of H = P + ρ + W₀ + EᵀWE + AᵀA and of δ + AH⁻¹Aᵀ: with the equations added to the first
    rows, which changes no solution, H is regular wherever the whole is."""

    def __init__(self, blocks: KktBlocks) -> None:
        self.blocks, self.cost = blocks, dense_cost(blocks)
        self.P, self.E, self.A = (M.toarray() if sp.issparse(M) else M for M in (blocks.P, blocks.E, blocks.A))
        # what Cholesky's method may lose: with so much more on the diagonal it does not fail
        self.loss = 8.0 * (blocks.n + 1) * UNIT_ROUNDOFF
        self.base = self.P + self.A.T @ self.A if blocks.k else self.P

    def factorised(self, w: Vector, of_x: Vector) -> Solve | None:
        """The solver, None where rounding has made H indefinite."""
        from scipy.linalg.lapack import dpotrf, dpotrs

        work.spend(self.cost)
        E, A = self.E, self.A
        H = self.base + E.T @ (w[:, None] * E) if w.size else self.base.copy()
        diagonal = H.reshape(-1)[:: H.shape[0] + 1]
        diagonal += of_x + _SMALL
        diagonal *= 1.0 + self.loss
        H, failed = dpotrf(H, lower=1, overwrite_a=1)
        X = S = None
        if not failed and A.size:
            X, _ = dpotrs(H, A.T, lower=1)
            S = A @ X
            diagonal = S.reshape(-1)[:: S.shape[0] + 1]
            diagonal += _SMALL
            diagonal *= 1.0 + 8.0 * (self.blocks.k + 1) * UNIT_ROUNDOFF
            S, failed = dpotrf(S, lower=1, overwrite_a=1)
        if failed:
            return None

        def solve(f: Vector, e: Vector, a: Vector) -> tuple[Vector, Vector, Vector]:
            f, dnu = f + E.T @ (w * e), a
            if X is not None:
                f = f + A.T @ a
            dx, _ = dpotrs(H, f, lower=1)
            if X is not None:
                dnu, _ = dpotrs(S, A @ dx - a, lower=1)
                dx = dx - X @ dnu
            return dx, w * (E @ dx - e), dnu

        return solve


class SparseSystems:
    """By the factors of [[P + ρ + W₀, Eᵀ, Aᵀ], [E, −W⁻¹, 0], [A, 0, −δ]], pivots on the diagonal, or by those with more
    on the diagonal; by those with rows exchanged where refinement fails with either."""

    def __init__(self, blocks: KktBlocks, most: float) -> None:
        self.blocks, size = blocks, blocks.n + blocks.m + blocks.k
        P, E, A = (sp.csr_array(M) for M in (blocks.P, blocks.E, blocks.A))
        P = 0.5 * (P + P.T)  # it may be symmetric up to rounding
        K = sp.block_array([[P, E.T, A.T], [E, None, None], [A, None, None]]) + sp.eye_array(size)
        self.K = K = sp.csr_array(K)
        K.sort_indices()
        entries = work.free_memory() / _BYTES
        self.fill, _ = seen = ordered(K, entries, min(most, work.nanoseconds_left()), symmetric=True)
        if not self.fill.seen:
            if self.fill.entries > entries:
                raise OutOfMemory(f"the factors of the KKT matrix, {size} x {size} with {K.nnz} entries, would not fit")
            raise OutOfTime("the factors of the KKT matrix cost more time than is left")
        self.look, self.pattern, self.diagonal = Look(K, seen=seen), SymmetricPattern(K, seen), diagonal_positions(K)
        self.own = np.concatenate([P.diagonal() + _SMALL, np.zeros(blocks.m), np.full(blocks.k, -_SMALL)])
        self.more = np.zeros(K.nnz)
        self.more[self.diagonal] = np.where(np.arange(size) < blocks.n, _MORE, -_MORE)

    @property
    def cost(self) -> float:
        """Of a factorisation, in nanoseconds."""
        return work.refactor_cost(self.fill)

    def factorised(self, w: Vector, of_x: Vector) -> Solve | None:
        """The solver, None where a pivot is 0."""
        n, m, K = self.blocks.n, self.blocks.m, self.K.copy()
        diagonal = self.own.copy()
        diagonal[:n] += of_x
        diagonal[n : n + m] = -1.0 / np.maximum(w, _NONE)
        K.data[self.diagonal] = diagonal

        @cache
        def factors(way: int) -> Any:
            with suppress(OutOfMemory):
                return self.pattern.factors(K.data + way * self.more) if way < 2 else factorise(K, look=self.look)

        if all(factors(way) is None for way in range(3)):
            return None

        def solution(right: Vector) -> Vector:
            best, least, enough = np.zeros(right.size), np.inf, _LEFT * norm(right)
            for found in filter(None, map(factors, range(3))):
                x, left = by_refinement(found.solve, right, lambda x: right - K @ x, enough, _REFINED)
                if left < least:
                    best, least = x, left
                if least <= enough:
                    break
            return best

        def solve(f: Vector, e: Vector, a: Vector) -> tuple[Vector, Vector, Vector]:
            x = solution(np.concatenate([f, e, a]))
            return x[:n], np.where(w > 0, x[n : n + m], 0.0), x[n + m :]

        return solve


class SoftRows:
    """Systems of which a variable that occurs in one row alone, such as what a soft constraint is short of, or the
    hinge of a support vector, is eliminated with its w₀: from hx + eλ = f and … + ex − λ/w = g the row has the weight
    1/(1/w + e²/h) and the right-hand side g − ef/h. `inner` are the systems in the other variables."""

    def __init__(self, blocks: KktBlocks, soft: NDArray[np.intp], rows: NDArray[np.intp]) -> None:
        self.soft, self.rows = soft, rows
        self.others = np.setdiff1d(np.arange(blocks.n), soft)
        self.entries = np.asarray(blocks.E[rows, soft]).reshape(-1)
        self.own = blocks.P.diagonal()[soft] + _SMALL
        self.inner = systems_of(blocks.of(self.others), False)

    def factorised(self, w: Vector, of_x: Vector) -> Solve | None:
        """The solver, None where the inner one has none."""
        h, e, rows, w = self.own + of_x[self.soft], self.entries, self.rows, w.copy()
        w[rows] = w[rows] * h / (h + w[rows] * e * e)
        inner = self.inner.factorised(w, of_x[self.others])
        if inner is None:
            return None

        def solve(f: Vector, right: Vector, a: Vector) -> tuple[Vector, Vector, Vector]:
            right, of_soft, dx = right.copy(), f[self.soft], np.empty(f.size)
            right[rows] -= e * of_soft / h
            dx[self.others], d_multiplier, dnu = inner(f[self.others], right, a)
            dx[self.soft] = (of_soft - e * d_multiplier[rows]) / h
            return dx, d_multiplier, dnu

        return solve


def soft(blocks: KktBlocks) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The variables that occur in one row of E alone, one for a row, and with no other in P or A; and their rows."""
    counts = [(M != 0).sum(axis=0) for M in (blocks.P, blocks.E, blocks.A)]
    alone = (counts[0] == (blocks.P.diagonal() != 0)) & (counts[1] == 1) & (counts[2] == 0)
    columns = np.flatnonzero(alone)
    part = blocks.E[:, columns]
    rows = sp.csc_array(part != 0).indices if sp.issparse(part) else (part != 0).argmax(axis=0)
    rows, first = np.unique(rows, return_index=True)
    return columns[first], rows


def dense_cost(blocks: KktBlocks) -> float:
    """What one dense factorisation costs, in nanoseconds."""
    n, m, k = blocks.n, blocks.m, blocks.k
    flops = n * n * m + n**3 / 3 + n * n * k + n * k * k + k**3 / 3
    return work.COSTS.call + work.COSTS.dense_flop * flops


def is_dense(blocks: KktBlocks) -> bool:
    """Whether a dense factorisation fits into memory and costs less than a sparse one without any fill."""
    n, rows = blocks.n, blocks.m + blocks.k
    nnz = sum(M.nnz if sp.issparse(M) else M.size for M in (blocks.P, blocks.E, blocks.A))
    return _fits(blocks) and dense_cost(blocks) <= work.least_factor_cost(n + rows, 2 * nnz, symmetric=False)


def _fits(blocks: KktBlocks) -> bool:
    return work.fits(8.0 * (blocks.n + blocks.m + blocks.k) * (blocks.n + blocks.k))


Systems = DenseSystems | SparseSystems | SoftRows


def systems_of(blocks: KktBlocks, may_be_soft: bool = True) -> Systems:
    """Those that are foreseen to cost less. Raises OutOfTime and OutOfMemory where neither can be afforded."""
    if may_be_soft and blocks.m and dense_cost(blocks) > _ELIMINATING:
        eliminated, rows = soft(blocks)
        if eliminated.size:
            return SoftRows(blocks, eliminated, rows)
    if is_dense(blocks):
        return DenseSystems(blocks)
    fits, cost = _fits(blocks), dense_cost(blocks)
    try:
        found = SparseSystems(blocks, _DOUBT * cost if fits else np.inf)
    except (OutOfTime, OutOfMemory):
        if not fits:
            raise
        return DenseSystems(blocks)
    return DenseSystems(blocks) if fits and cost < found.cost else found
