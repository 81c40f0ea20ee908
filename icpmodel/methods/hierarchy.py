"""Algebraic multigrid for a matrix of which some rows and columns are left out: PyAMG's levels, truncated by masks."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..arrays import Vector, as_csr, diagonal_positions
from ..operators import ruge_stuben

Mask = NDArray[np.bool_]

#: a level of at most so many rows is solved by a dense inverse
_COARSEST = 64


class NoHierarchy(Exception):
    """The diagonal of A, or of a coarser level, is not positive.

    >>> Hierarchy(sp.csr_array([[-2.0]]))
    Traceback (most recent call last):
    icpmodel.methods.hierarchy.NoHierarchy
    """


class Level:
    """A of one level, CSR, shape (m, m), with its diagonal; and which rows are `free`.

    Where there is a coarser level, `P`, CSR, shape (m, m_coarse), interpolates from it, and `kept`, shape (m_coarse,),
    are the points that are on it as well: P leaves their values alone.

    >>> Level(sp.csr_array([[2.0]])).diagonal
    array([2.])
    """

    def __init__(self, A: sp.csr_array) -> None:
        self.A, self.diag, self.diagonal = A, diagonal_positions(A), A.diagonal()
        if not (self.diagonal > 0).all():
            raise NoHierarchy
        self.inverse = 1.0 / self.diagonal
        self.free: Mask = np.ones(A.shape[0], dtype=np.bool_)
        self.P: Any = None
        self.kept: Any = None


class Hierarchy:
    """The levels of A, and a V-cycle for A_FF x = f_F where F, the free rows, changes often and A does not.

    On every level the points whose own row is not free keep the value 0. That is how the interpolation is truncated
    without another Galerkin product; what it leaves out is next to the border of F.
    Parameters: `A` CSR, shape (n, n), with every diagonal entry stored. Raises NoHierarchy where the diagonal of A or
    of a coarser level is not positive.
    Reference: Ruge and Stüben, Algebraic multigrid (1987); Kornhuber, Numer. Math. 69 (1994), for the truncation.

    >>> hierarchy = Hierarchy(sp.csr_array([[2.0, -1.0], [-1.0, 2.0]]))
    >>> hierarchy.restrict(np.array([True, False]))
    >>> hierarchy.cycle(np.array([1.0, 5.0]))
    array([0.5, 0. ])
    """

    def __init__(self, A: sp.csr_array) -> None:
        self.levels = [Level(A)]
        # direct interpolation costs least and is made for M-matrices
        made = ruge_stuben(A, interpolation="direct", max_coarse=_COARSEST, keep=True).levels
        for fine, coarse in pairwise(made):
            self.levels[-1].P, self.levels[-1].kept = sp.csr_array(fine.P), np.flatnonzero(fine.splitting)
            self.levels.append(Level(as_csr(coarse.A, "A of a coarser level", keep_diagonal=True)))
        self._dense = self.levels[-1].A.toarray()
        self.restrict(self.levels[0].free)

    def restrict(self, free: Mask, top: int = 0) -> None:
        """Let only the rows where `free`, shape (m,), of level `top` take part in the cycles that follow.

        >>> hierarchy = Hierarchy(sp.csr_array([[2.0]]))
        >>> hierarchy.restrict(np.array([False]))
        >>> hierarchy.cycle(np.array([1.0]))
        array([0.])
        """
        for level in self.levels[top:]:
            level.free = free
            free = free if level.P is None else free[level.kept]
        self._rows = np.flatnonzero(free)
        self._inverse = np.linalg.pinv(self._dense[np.ix_(self._rows, self._rows)])

    def cycle(self, f: Vector, top: int = 0) -> Vector:
        """About the x with (Ax)_i = f_i in the free rows and x_i = 0 in the others, by one V(1, 1)-cycle.

        Parameters: `f` of shape (m,), m the rows of level `top`. Returns a new array of that shape.

        >>> Hierarchy(sp.csr_array([[2.0]])).cycle(np.array([1.0]))
        array([0.5])
        """
        from ..kernels.multigrid import ascend, descend

        level, x = self.levels[top], np.zeros(f.size)
        if level.P is None:
            x[self._rows] = self._inverse @ f[self._rows]
            return x
        A, P = level.A, level.P
        transfer, coarse = (P.indptr, P.indices, P.data), np.empty(P.shape[1])
        descend(A.indptr, A.indices, A.data, level.diag, level.inverse, level.free, f, *transfer, x, coarse)
        coarse = self.cycle(coarse, top + 1)
        ascend(A.indptr, A.indices, A.data, level.inverse, level.free, f, *transfer, coarse, x)
        return x
