"""The data of a proof of infeasibility: the rows that a combination may take, their signs, and bounds on z."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...numerics.arrays import Mask, Vector
from ...problem.data import ProblemData
from ...problem.two_sided import sides_of

#: an entry of a computed y below this share of the largest one counts as zero
ZERO = 1e-9
#: the largest misfit of a combination that is tried or proved, as a share of its largest entry
MAX_MISFIT = 1e-5
#: nanoseconds that the search for a combination in floats may take
MAX_COST = 2e9


@dataclass(frozen=True, eq=False)
class ProvedBounds:
    """Every solution has `low` ≤ z ≤ `high`, shape (n,), infinite where nothing is known; `proof` says why."""

    low: Vector
    high: Vector
    proof: str


@dataclass(frozen=True, eq=False)
class CombinationRows:
    """The rows of Mz + m whose sign is known at every solution, and an interval for each unknown.

    The first n rows are p = Az + q. If an obstacle depends on z, n rows z − ψ(z) follow, and for an upper obstacle n
    rows z − ψ̄(z). A fixed obstacle is an end of the interval `low` ≤ z ≤ `high`. Row i of Mz + m may be assumed ≥ 0
    where it is `nonnegative`, and ≤ 0 where it is `nonpositive`. `offset` is m. `slopes` is M without the identity in
    the rows of z − ψ and z − ψ̄.
    """

    slopes: sp.csr_array
    offset: Vector
    low: Vector
    high: Vector
    nonpositive: Mask
    nonnegative: Mask

    @classmethod
    def of(cls, problem: ProblemData, known: ProvedBounds | None = None) -> CombinationRows | None:
        """The rows of a problem with constant or affine obstacles; None for other obstacles."""
        n = problem.n
        sides = [side.linear for side in sides_of(problem.psi) if side.linear is not None]
        if len(sides) < len(sides_of(problem.psi)):
            return None
        low = sides[0][1]
        high = sides[1][1] if len(sides) > 1 else np.full(n, np.inf)
        slopes = problem.A
        offset = problem.q
        nonpositive = np.isneginf(low)
        nonnegative = np.isposinf(high)
        if not problem.psi.is_constant:
            never = np.zeros(n, dtype=bool)
            slopes = sp.csr_array(sp.vstack([slopes, *(-G for G, _ in sides)]))
            offset = np.concatenate([offset, *(np.where(np.isinf(c), 0.0, -c) for _, c in sides)])
            nonnegative, nonpositive = (
                np.concatenate([nonnegative, ~nonpositive, never])[: offset.size],
                np.concatenate([nonpositive, never, ~nonnegative])[: offset.size],
            )
            low = np.full(n, -np.inf)
            high = np.full(n, np.inf)
        if known is not None:
            low = np.where(np.isfinite(known.low), known.low, low)
            high = np.where(np.isfinite(known.high), known.high, high)
        return cls(slopes, offset, low, high, nonpositive, nonnegative)

    def name(self, i: int) -> str:
        """The name of row `i`."""
        kind, row = divmod(i, self.low.size)
        return f"row {row} of {('Az + q', 'z - psi(z)', 'z - upper(z)')[kind]}"

    @property
    def free(self) -> Mask:
        """The unknowns without a known bound."""
        return np.isneginf(self.low) & np.isposinf(self.high)

    def with_known_signs(self, y: Vector) -> Vector:
        """The weights `y` of the first rows, with those of a forbidden sign set to 0."""
        allowed = self.nonnegative[: y.size] & (y > 0.0) | self.nonpositive[: y.size] & (y < 0.0)
        return np.where(allowed, y, 0.0)

    @cached_property
    def matrix(self) -> sp.csr_array:
        """M, where 1 − g_ii is rounded."""
        n = self.low.size
        rows = np.arange(n, self.offset.size)
        if not rows.size:
            return self.slopes
        return sp.csr_array(self.slopes + sp.csr_array((np.ones(rows.size), (rows, rows % n)), self.slopes.shape))

    def exact_columns(self, index: NDArray[np.intp]) -> dict[int, dict[int, Fraction]]:
        """The rows `index` of M by columns, without rounding: j → k → the entry of row `index`_k."""
        n = self.low.size
        part = self.slopes[index].tocoo()
        columns: dict[int, dict[int, Fraction]] = {}
        for k, j, entry in zip(*part.coords, part.data, strict=True):
            columns.setdefault(int(j), {})[int(k)] = Fraction(float(entry))
        for k in np.flatnonzero(index >= n):
            column = columns.setdefault(int(index[k] % n), {})
            column[int(k)] = column.get(int(k), Fraction(0)) + 1
        return columns
