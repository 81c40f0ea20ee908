"""Problems of which nobody holds the whole: any range of their rows is assembled when it is asked for."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from ..errors import InputError
from ..numerics.arrays import Vector, as_number, as_vector, described, row_of


class LocalRows(NamedTuple):
    """The rows lo ≤ i < hi of a problem with n unknowns, in the order of the arguments of `ICP`.

    `A` CSR, shape (hi − lo, n): rows counted from lo, columns from 0, as in the whole; `q` shape (hi − lo,); `psi` the
    fixed obstacle, shape (hi − lo,), −inf for none; `upper` the one above, +inf for none, or None.

    >>> rows = icp.scenes.by_rows("membrane", n=10**9).local_rows(5 * 10**8, 5 * 10**8 + 2)
    >>> rows.A.shape, rows.A.nnz, rows.psi.shape
    ((2, 1000014129), 10, (2,))
    """

    A: sp.csr_array
    q: Vector
    psi: Vector
    upper: Vector | None = None


#: what assembles the rows lo ≤ i < hi
RowsOf = Callable[[int, int], LocalRows | tuple[Any, ...]]


@dataclass(frozen=True)
class ByRows:
    """A problem that is assembled a range of rows at a time: processes that share it make each its own rows.

    `rows(lo, hi)`, a function of yours, returns `LocalRows`, or a tuple of three or four in their order: A, dense or
    any sparse matrix of SciPy's, with all n columns, q, ψ and, where there is one, the obstacle above; numbers stand
    for vectors. It must give the same rows in whatever range they are asked for, and should take time and memory for
    hi − lo rows only. To be sent to another process it must be a function at the top of a module, or `partial` of one.
    `shape` is (n,), or the grid, such as (m, m), of which the unknowns are numbered with the last axis quickest.

    >>> def rows(lo, hi):
    ...     i = np.arange(hi - lo)
    ...     return sp.csr_array((np.full(hi - lo, 2.0), (i, lo + i)), shape=(hi - lo, 10**6)), -1.0, 0.0
    >>> made = icp.ByRows((10**6,), rows)
    >>> made.n, made.local_rows(500, 502).A.indices
    (1000000, array([500, 501], dtype=int32))
    """

    shape: tuple[int, ...]
    rows: RowsOf

    def __post_init__(self) -> None:
        if not isinstance(self.shape, tuple) or not self.shape:
            raise InputError(f"shape is {described(self.shape)}; a tuple of whole numbers was expected, such as (n,)")
        for m in self.shape:
            as_number(m, "a length in shape", least=1, whole=True)
        if not callable(self.rows):
            raise InputError(f"rows is {described(self.rows)}; a function of lo and hi was expected")

    @property
    def n(self) -> int:
        """The number of unknowns."""
        return math.prod(int(m) for m in self.shape)

    def local_rows(self, lo: int, hi: int) -> LocalRows:
        """The rows lo ≤ i < hi, of 0 ≤ lo ≤ hi ≤ n, checked; A has sorted columns and no duplicates.

        Raises InputError for another range, and where `rows` returns what does not fit or is not finite.

        >>> icp.ByRows((3,), lambda lo, hi: (np.eye(3)[lo:hi], 1.0)).local_rows(0, 3)
        Traceback (most recent call last):
        icpmodel.errors.InputError: rows(0, 3) is a tuple of 2; LocalRows, or A, q, psi and perhaps upper, were expected
        """
        n = self.n
        lo = int(as_number(lo, "lo", least=0, most=n, whole=True))
        hi = int(as_number(hi, "hi", least=lo, most=n, whole=True))
        found, called = self.rows(lo, hi), f"rows({lo}, {hi})"
        if not isinstance(found, tuple) or len(found) not in (3, 4):
            what = f"a tuple of {len(found)}" if isinstance(found, tuple) else described(found)
            raise InputError(f"{called} is {what}; LocalRows, or A, q, psi and perhaps upper, were expected")
        A, q, psi, upper = (*found, None)[:4]
        return LocalRows(
            _rows_of(A, f"A of {called}", lo, (hi - lo, n)),
            _entries(q, hi - lo, f"q of {called}", None),
            _entries(psi, hi - lo, f"psi of {called}", -np.inf),
            None if upper is None else _entries(upper, hi - lo, f"upper of {called}", np.inf),
        )


def _entries(value: Any, size: int, name: str, infinite: float | None) -> Vector:
    """`as_vector`, of no entries as well, and +inf allows no −inf."""
    if not size:
        return np.zeros(0)
    vector = as_vector(value, size, name, infinite=infinite)
    if infinite == np.inf and (vector == -np.inf).any():
        raise InputError(f"{name}[{int(vector.argmin())}] is -inf; a finite number or inf was expected")
    return vector


def _rows_of(A: Any, name: str, lo: int, shape: tuple[int, int]) -> sp.csr_array:
    """`A` as CSR with sorted columns and no duplicates, its indices as small as they fit. Raises InputError."""
    found: Any = A.shape if sp.issparse(A) else np.shape(A)
    if found != shape:
        raise InputError(f"{name} has shape {found}; shape {shape} was expected: all columns, whatever the rows")
    matrix = sp.csr_array(A, dtype=np.float64)
    least, most = int(matrix.indices.min(initial=0)), int(matrix.indices.max(initial=0))
    if least < 0 or most >= shape[1]:
        raise InputError(
            f"{name} has an entry in column {least if least < 0 else most}; columns 0 to {shape[1] - 1} exist"
        )
    if not matrix.has_canonical_format:
        matrix = matrix.copy()
        matrix.sum_duplicates()
    if not np.isfinite(matrix.data).all():
        k = int(np.isfinite(matrix.data).argmin())
        where = f"row {lo + int(row_of(matrix)[k])}, column {int(matrix.indices[k])}"
        raise InputError(f"{name} is {matrix.data[k]} in {where}; a finite number was expected")
    index = sp.get_index_dtype(maxval=max(shape[1], matrix.nnz))
    parts = matrix.data, matrix.indices.astype(index, copy=False), matrix.indptr.astype(index, copy=False)
    return sp.csr_array(parts, shape=shape)
