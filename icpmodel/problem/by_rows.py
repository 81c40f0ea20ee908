"""Problems that no process stores whole: a range of rows is assembled on request."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from ..errors import InputError, check_arguments
from ..numerics.arrays import Vector, as_number, as_rows, as_vector, described
from ..present.display import Displayable


class _Four(NamedTuple):
    A: sp.csr_array
    q: Vector
    psi: Vector
    upper: Vector | None = None


@check_arguments
class LocalRows(Displayable, _Four):
    """The rows lo ≤ i < hi of a problem with n unknowns, in the order of the arguments of `ICP`.

    Parameters
    ----------
    A : CSR array of shape (hi − lo, n)
        Rows are counted from lo, columns from 0.
    q : array of shape (hi − lo,)
        The vector.
    psi : array of shape (hi − lo,)
        The fixed obstacle; −inf for none.
    upper : array of shape (hi − lo,), optional
        The upper obstacle; +inf for none.

    Examples
    --------
    >>> rows = icp.scenes.by_rows("membrane", n=10**9).local_rows(5 * 10**8, 5 * 10**8 + 2)
    >>> rows.A.shape, rows.A.nnz, rows.psi.shape
    ((2, 1000014129), 10, (2,))
    """

    __slots__ = ()

    def __repr__(self) -> str:
        return f"LocalRows(A with shape {self.A.shape}, {self.A.nnz} entries)"


@check_arguments
@dataclass(frozen=True, repr=False)
class ByRows(Displayable):
    """A problem that is assembled by ranges of rows: each process that shares it assembles its own rows.

    Parameters
    ----------
    shape : tuple of int
        (n,), or the shape of a grid, such as (m, m), whose unknowns are numbered with the last axis fastest.
    rows : callable
        Maps (lo, hi) to `LocalRows`, or to a tuple (A, q, psi) or (A, q, psi, upper). A has all n
        columns and is dense or sparse; a number stands for a constant vector.

    Notes
    -----
    `rows` must return the same rows for every range that contains them. Its time and memory should
    be those of hi − lo rows. Other processes can receive a function at the top level of a module, or
    a `partial` of one.

    Examples
    --------
    >>> made = icp.ByRows(
    ...     (10**6,), lambda lo, hi: (2.0 * sp.eye_array(hi - lo, 10**6, k=lo), -1.0, 0.0)
    ... )
    >>> made.n, made.local_rows(500, 502).A.indices
    (1000000, array([500, 501], dtype=int32))
    """

    shape: tuple[int, ...]
    rows: Callable[[int, int], LocalRows | tuple[Any, ...]]

    def __post_init__(self) -> None:
        if not isinstance(self.shape, tuple) or not self.shape:
            raise InputError(f"shape is {described(self.shape)}; a tuple such as (n,) was expected")
        for m in self.shape:
            as_number(m, "a length in shape", minimum=1, whole=True)

    @property
    def n(self) -> int:
        """The number of unknowns."""
        return math.prod(int(m) for m in self.shape)

    def local_rows(self, lo: int, hi: int) -> LocalRows:
        """The rows lo ≤ i < hi, checked; A has sorted columns and no duplicates.

        Parameters
        ----------
        lo, hi : int
            The range, 0 ≤ lo ≤ hi ≤ n.

        Returns
        -------
        LocalRows
            The rows.

        Raises
        ------
        InputError
            For an invalid range, and where `rows` returns wrong shapes or entries that are not
            finite.

        Examples
        --------
        >>> icp.ByRows((3,), lambda lo, hi: (np.eye(3)[lo:hi], 1.0)).local_rows(0, 3)
        Traceback (most recent call last):
        icpmodel.errors.InputError: rows(0, 3) is a tuple of 2; LocalRows, or A, q, psi and perhaps upper, were expected
        """
        lo = int(as_number(lo, "lo", minimum=0, maximum=self.n, whole=True))
        hi = int(as_number(hi, "hi", minimum=lo, maximum=self.n, whole=True))
        block = self.rows(lo, hi)
        place = f"of rows({lo}, {hi})"
        if not isinstance(block, tuple) or len(block) not in (3, 4):
            what = f"a tuple of {len(block)}" if isinstance(block, tuple) else described(block)
            raise InputError(f"{place[3:]} is {what}; LocalRows, or A, q, psi and perhaps upper, were expected")
        A = as_rows(block[0], f"A {place}")
        if A.shape != (hi - lo, self.n):
            raise InputError(f"A {place} has shape {A.shape}; {(hi - lo, self.n)} was expected")
        none = len(block) < 4 or block[3] is None
        if hi == lo:
            return LocalRows(A, np.zeros(0), np.zeros(0), None if none else np.zeros(0))
        q = as_vector(block[1], hi - lo, f"q {place}")
        psi = as_vector(block[2], hi - lo, f"psi {place}", infinite=-np.inf)
        below = None if none else as_vector(np.negative(block[3]), hi - lo, f"-upper {place}", infinite=-np.inf)
        return LocalRows(A, q, psi, None if below is None else -below)
