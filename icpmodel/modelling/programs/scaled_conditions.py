"""The conditions of a program in units in which entries are about 1, and multipliers about as large as x.

Starts, regularisations and tolerances then mean the same in every row, whatever the units of the program are.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...icp import ICP
from ...numerics import work
from ...numerics.arrays import Vector, norm
from ...numerics.equilibration import Exponents, balanced, in_units, in_units_exactly, row_exponents, times_rows
from ...problem.data import ProblemData
from .program import Program, saddle_matrix, with_bounds

#: bounds and right-hand sides of at least this size usually mean infinity; they are used to estimate the size of x
#: only if there are no others
_INFINITE = 1e15


class ScaledConditions:
    """The conditions as an ICP in scaled units: row i is multiplied by 2^r_i, and z_i = 2^c_i ẑ_i.

    No number is rounded: r = c = 0 if scaling would round one.

    Parameters
    ----------
    program : Program
        The program.
    last : ScaledConditions or None
        Those of another program. If the matrices are equal, the scaled matrix and all that depends on it are reused.

    Raises
    ------
    OutOfTime
        If the estimated time exceeds the time that is left.
    """

    A: sp.csr_array
    is_scaled: bool
    balanced: NDArray[np.int64]
    shift: int
    rows: Exponents
    columns: Exponents
    problem: ICP

    @np.errstate(all="ignore")
    def __init__(self, program: Program, last: ScaledConditions | None) -> None:
        work.charge_matrices(program.H.nnz + 2 * program.C.nnz, 4)
        A = saddle_matrix(program.H, program.C)
        if last is None or not last.is_scaled or last.A.shape != A.shape or (last.A != A).nnz:
            last = None
        self.A = A if last is None else last.A
        if last is None:
            work.charge_matrices(A.nnz, 12)  # for scaling A and for making the problem
        self.is_x = np.arange(A.shape[0]) < program.g.size
        self.balanced = self._balanced(program) if last is None else last.balanced
        vectors = np.array(program.vectors)
        self._choose_units(program, vectors, last)
        scaled = self._in_units(vectors)
        matrix = in_units_exactly(A, self.rows, self.columns) if last is None else last.problem.A
        self.is_scaled = matrix is not None and np.array_equal(self._in_units(scaled, -1), vectors)
        if not self.is_scaled:
            self.rows = self.columns = np.zeros_like(self.rows)
            last = None
            matrix = A
            scaled = vectors
        q, self.low, self.high = scaled
        problem = ICP(matrix, q) if last is None else last.problem.with_q(q)
        self.problem = with_bounds(problem, self.low, self.high)

    def _choose_units(self, program: Program, vectors: NDArray[np.float64], last: ScaledConditions | None) -> None:
        """Choose r and c such that d and the bounds are about 1, and g is about 1 too; if H ≠ 0, at most about 1.

        If g is large and H small, the multipliers are larger than x; a small g does not make them smaller. If H ≠ 0,
        the shift of `last` is kept whatever g is, so that the matrix stays the same.
        """
        self.rows = self.balanced[0]
        self.columns = self.balanced[1]
        scaled = self._in_units(vectors)
        size_g = _mean_size(scaled[0, self.is_x])
        scaled[0, self.is_x] = 0.0
        size_d = _mean_size(scaled[np.abs(vectors) < _INFINITE]) or _mean_size(scaled[np.isfinite(vectors)])
        has_H = program.H.data.any()
        if last is not None and has_H:
            self.shift = last.shift
        else:
            self.shift = _exponent(np.divide(size_g, size_d))
            if has_H:
                self.shift = max(self.shift, 0)
        size = _exponent(size_d or size_g)
        self.rows = self.rows - self.shift * self.is_x - size
        self.columns = self.columns + self.shift * ~self.is_x + size

    def rows_alone(self, terms: Vector) -> tuple[ProblemData, Exponents]:
        """The rows Cx ≤ d alone as an ICP, each multiplied by 2^e so that its `terms` are about 1; and the exponents e.

        The other rows, and those with `terms` 0, are set to 0. So no row hides another one by larger terms.
        """
        alone = np.where(self.is_x, 0.0, np.sign(terms))
        units = -np.frexp(terms)[1].astype(np.int64)
        A = in_units(times_rows(alone, self.problem.A), units)
        columns = row_exponents(sp.csr_array(A.T))
        q = np.ldexp(alone * self.problem.q, units)
        low, high = (np.ldexp(side, -columns) for side in (self.low, self.high))
        return ProblemData(in_units(A, 0 * units, columns), q, low, high), units

    def as_returned(self, z: Vector) -> Vector:
        """`z` after conversion to the units of the program and back: numbers may leave the range of floats there."""
        return np.ldexp(np.ldexp(z, self.columns), -self.columns)

    def _in_units(self, vectors: NDArray[np.float64], sign: int = 1) -> NDArray[np.float64]:
        """Convert q and the obstacles to the units of the scaled conditions; back if `sign` is −1."""
        return np.ldexp(vectors, sign * np.array([self.rows, -self.columns, -self.columns]))

    def _balanced(self, program: Program) -> NDArray[np.int64]:
        """r and c that give the entries of H and of C the same geometric mean, and make those of each row about 1."""
        sizes = [np.abs(X.data[X.data != 0.0]) for X in (program.H, program.C)]
        mean_H, mean_C = (np.log2(size).mean() if size.size else 0.0 for size in sizes)
        alike = int(np.rint(mean_H - mean_C)) if all(size.size for size in sizes) else 0
        rows = -alike * self.is_x
        columns = alike * ~self.is_x
        M = in_units(self.A, rows, columns)
        units = row_exponents(M)
        weights = np.rint((units - np.log2(balanced(in_units(M, units)))) / 2)
        return np.array([rows, columns]) + weights.astype(np.int64)


def _mean_size(x: Vector) -> float:
    """The root mean square of the nonzero entries of `x`; 0 if there are none."""
    count = int(np.count_nonzero(x))
    return norm(x) / count**0.5 if count else 0.0


def _exponent(x: float) -> int:
    """The exponent of the power of two nearest to `x`; 0 if `x` is 0, infinite or NaN."""
    return int(np.rint(np.log2(x))) if 0.0 < x < np.inf else 0
