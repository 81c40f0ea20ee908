"""The intervention operator of impulse control: the map ψ of the best jump."""

from __future__ import annotations

from copy import copy
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import InputError, MapError, check_arguments
from ..numerics.arrays import Mask, Vector, as_csr, described, freeze, row_of, with_entries
from ..numerics.rounding import UNIT_ROUNDOFF
from .map import Map
from .user_code import call, vector_of


class Intervention(Map):
    """The intervention operator of impulse control: ψ_i(z) = max (or min) over the jumps i → j of z_j + k_ij.

    Parameters
    ----------
    jumps : sparse matrix of shape (n, n) or callable
        The *stored* entries of a SciPy sparse matrix are the possible jumps. Their values are the
        gains k_ij; a stored 0 is a jump without gain or cost. A function maps z to (value, target), both of shape
        (n,), with target_i the best j, and −1 where row i has no jump.
    best : {"max", "min"}, default "max"
        Whether the best jump is the one with the largest or the smallest z_j + k_ij.

    Notes
    -----
    A row without a jump has no obstacle: ψ_i = −inf; in an upper obstacle +inf. For a matrix, G has a 1
    wherever a jump is possible.

    References
    ----------
    Bensoussan and Lions, Impulse Control and Quasi-Variational Inequalities (1984).

    Examples
    --------
    >>> jumps = sp.csr_array(
    ...     (np.array([-1.0, -3.0]), (np.array([1, 1]), np.array([0, 2]))), shape=(3, 3)
    ... )
    >>> psi = Intervention(jumps).bind(3)
    >>> psi.value(np.array([5.0, 0.0, 6.0]))
    array([-inf,   4., -inf])
    >>> psi.jacobian(np.array([5.0, 0.0, 6.0])).toarray()[1]
    array([1., 0., 0.])
    """

    has_policies = True
    #: the value of rows without a jump
    none = -np.inf

    @check_arguments
    def __init__(self, jumps: Any, best: str = "max") -> None:
        if best not in ("max", "min"):
            raise InputError(f'best is {best!r}; "max" or "min" was expected')
        self.best = best
        self.fun = jumps if callable(jumps) else None
        self.jumps = None if callable(jumps) else _check_jumps(jumps)
        self.calls_user_code = self.jumps is None
        if self.jumps is not None:
            self.lipschitz = self.links = freeze(with_entries(self.jumps, np.ones(self.jumps.nnz)))

    def bind(self, n: int) -> Intervention:
        if self.jumps is not None and self.jumps.shape[0] != n:
            raise InputError(f"jumps has shape {self.jumps.shape}; shape ({n}, {n}) was expected")
        return self

    def value(self, z: Vector) -> Vector:
        return self.best_jump(z)[0]

    def jacobian(self, z: Vector) -> sp.csr_array:
        target = self.best_jump(z)[1]
        rows = np.flatnonzero(target >= 0)
        return sp.csr_array((np.ones(rows.size), (rows, target[rows])), shape=(z.size, z.size))

    def change(self, delta: Vector) -> Vector:
        if self.jumps is None:
            return np.full(delta.size, delta.max())
        return _largest(self.jumps, delta[self.jumps.indices], 0.0)

    def isotone(self) -> bool:
        return True

    def restricted(self, rows: NDArray[np.intp], z: Vector) -> Map:
        if self.jumps is None or (jumps := self.jumps[rows]).nnz > (inner := jumps[:, rows]).nnz:
            return super().restricted(rows, z)  # a jump leads out of the `rows`
        left = Intervention(inner, self.best)
        return left if self.none < 0 else left.as_upper()

    def as_upper(self) -> Map:
        above = copy(self)
        vars(above)["none"] = np.inf
        return above

    def data_change(self, z: Vector, change: Any, name: str) -> tuple[sp.csr_array | None, Vector]:
        if self.jumps is None or not sp.issparse(change):
            return super().data_change(z, change, name)
        rows = np.arange(z.size)
        target = self.best_jump(z)[1]
        changes = self._of_gains(change, name)[rows, np.maximum(target, 0)]
        return None, np.where(target < 0, 0.0, np.asarray(changes).reshape(-1))

    def data_gradient(self, z: Vector, weight: Vector) -> Any:
        jumps = self.jumps
        if jumps is None:
            return weight
        rows = row_of(jumps)
        best = np.where(jumps.indices == self.best_jump(z)[1][rows], weight[rows], 0.0)
        return with_entries(jumps, best)

    def nonsmooth_rows(self, z: Vector, delta: Vector) -> Mask:
        if self.jumps is None:  # a function does not say which jump is second best
            return self.best_jump(z)[1] >= 0
        return np.bincount(row_of(self.jumps)[self._tied_jumps(z, delta)], minlength=z.size) > 1

    def directional_derivative(self, z: Vector, delta: Vector, change: Any, name: str) -> Map | None:
        jumps = self.jumps
        if jumps is None or not self.nonsmooth_rows(z, delta).any():
            return None
        tied = self._tied_jumps(z, delta)
        rows = row_of(jumps)[tied]
        columns = jumps.indices[tied]
        if sp.issparse(change):
            gains = np.asarray(self._of_gains(change, name)[rows, columns]).reshape(-1)
        else:
            gains = super().data_change(z, change, name)[1][rows]
        return Intervention(sp.csr_array((gains, (rows, columns)), shape=jumps.shape), self.best)

    def _tied_jumps(self, z: Vector, delta: Vector) -> Mask:
        """The jumps that may be the best one at an x with |x − z| ≤ `delta`."""
        jumps = self.jumps
        assert jumps is not None
        ends = z[jumps.indices]
        gains = self._sign * (ends + jumps.data)
        off = delta[jumps.indices] + 4.0 * UNIT_ROUNDOFF * (np.abs(ends) + np.abs(jumps.data))
        return gains + off >= _largest(jumps, gains - off, -np.inf)[row_of(jumps)]

    @property
    def _sign(self) -> float:
        """1 or −1: the best jump has the largest `_sign` times (z_j + k_ij)."""
        return 1.0 if self.best == "max" else -1.0

    def _of_gains(self, change: Any, name: str) -> sp.csr_array:
        """`change` as a CSR matrix. Raises InputError where it has an entry without a jump."""
        assert self.jumps is not None
        changed = as_csr(change, name, self.jumps.shape[0])
        possible = self.lipschitz
        beyond = sp.coo_array(abs(changed) - abs(changed).multiply(possible))
        beyond.eliminate_zeros()
        if beyond.nnz:
            i = beyond.row[0]
            j = beyond.col[0]
            raise InputError(f"{name}[{i}, {j}] is not 0 where there is no jump; changes of gains were expected")
        return changed

    def describe(self) -> str:
        return f"{self!r}: isotone; where jumps form a cycle rho(G) >= 1, and no proof by contraction can exist"

    def best_jump(self, z: Vector) -> tuple[Vector, np.ndarray]:
        """The obstacle and the jump that attains it, row by row.

        Parameters
        ----------
        z : array of shape (n,)
            The point.

        Returns
        -------
        psi : array of shape (n,)
            ψ(z).
        target : array of int of shape (n,)
            The column of the best jump, −1 where there is none.

        Examples
        --------
        >>> costs = sp.csr_array(np.array([[0.0, 1.0], [0.0, 0.0]]))
        >>> Intervention(costs).best_jump(np.array([0.0, 2.0]))
        (array([  3., -inf]), array([ 1, -1]))
        """
        jumps = self.jumps
        if jumps is None:
            return self._call_best_jump(z)
        gains = self._sign * (z[jumps.indices] + jumps.data)
        value = _largest(jumps, gains, -np.inf)
        rows = row_of(jumps)
        hits = np.flatnonzero(gains == value[rows])[::-1]
        target = np.full(z.size, -1)
        target[rows[hits]] = jumps.indices[hits]  # among equal jumps the first one is written last
        return np.where(np.diff(jumps.indptr) > 0, self._sign * value, self.none), target

    def _call_best_jump(self, z: Vector) -> tuple[Vector, np.ndarray]:
        assert self.fun is not None
        pair = call(self.fun, z, "psi")
        if not isinstance(pair, tuple) or len(pair) != 2:
            raise MapError(f"psi(z) returned {described(pair)}; a tuple (value, target) was expected")
        target = vector_of(pair[1], z.shape, "psi(z): target", "iu")
        if ((target < -1) | (target >= z.size)).any():
            raise MapError(f"psi(z): target has an entry outside -1 ... {z.size - 1}")
        value = vector_of(pair[0], z.shape, "psi(z)").astype(np.float64)
        if (invalid := (target < 0) & (value != self.none) & ~np.isnan(value)).any():
            i = int(np.argmax(invalid))
            actual = f"psi(z): row {i} has the value {value[i]:g} and the target -1, which stands for no jump"
            raise MapError(f"{actual}; the value {self.none}, or a target from 0 to {z.size - 1}, was expected")
        return value, target

    def __repr__(self) -> str:
        source = "a function" if self.jumps is None else f"{self.jumps.nnz} jumps"
        return f"Intervention({source}, {self.best})"


def _largest(jumps: sp.csr_array, of_jump: Vector, least: float) -> Vector:
    """The largest of the values `of_jump` in each row of `jumps`; `least` in rows without a jump."""
    largest = np.full(jumps.shape[0], least)
    rows = np.flatnonzero(np.diff(jumps.indptr))
    if rows.size:
        largest[rows] = np.maximum.reduceat(of_jump, jumps.indptr[rows])
    return largest


def _check_jumps(jumps: Any) -> sp.csr_array:
    if not sp.issparse(jumps):
        raise InputError(
            f"jumps is {described(jumps)}; a SciPy sparse matrix (its stored entries are the possible jumps) or "
            "a function z -> (value, target) was expected"
        )
    matrix = as_csr(jumps, "jumps")
    if matrix.nnz < jumps.nnz:  # as_csr adds up what is stored twice, which has no meaning here
        raise InputError("jumps stores the same jump twice; each i -> j once, with its best gain, was expected")
    return matrix
