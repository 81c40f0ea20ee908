"""The values of a problem at a point z: p, r, the residuals, and bounds on their rounding errors."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import InputError, MapError
from ..numerics.arrays import Vector, as_array, as_float64, as_vector, norm, not_finite
from ..numerics.labels import check_labels
from ..numerics.rounding import SMALLEST, gamma
from ..present.display import Displayable
from .map import Map
from .matrix import Matrix
from .nonlinear_term import NonlinearTerm
from .two_sided import mid, sides_of


class PointValues(Displayable):
    """p(z), r(z), the residuals and bounds on their rounding errors; `ProblemData` documents the attributes."""

    __slots__ = ("f", "matrix", "n", "psi", "q")

    matrix: Matrix
    q: Vector
    psi: Map
    n: int
    f: NonlinearTerm | None

    @property
    def A(self) -> sp.csr_array:
        """A as a CSR array, shape (n, n), read-only; a small dense A is converted on first use.

        Examples
        --------
        >>> ICP([[2.0]], [1.0]).A.nnz
        1
        """
        return self.matrix.sparse

    @property
    def upper(self) -> Map | None:
        """ψ̄, the upper obstacle, or None.

        Examples
        --------
        >>> ICP([[2.0]], [1.0], upper=[3.0]).upper
        Constant(3)
        """
        return self.psi.upper

    def product(self, z: Vector) -> Vector:
        """Az, shape (n,), for z of that shape, without q and f.

        Examples
        --------
        >>> ICP([[2.0]], [1.0]).product(np.array([3.0]))
        array([6.])
        """
        return self.matrix.product(z)

    def vector(self, z: Any, name: str = "z", *, finite: bool = False) -> Vector:
        """Convert `z` to a float64 vector of shape (n,).

        Every method and function that takes a z converts it here.

        Parameters
        ----------
        z : array_like of shape (n,) or Solution
            The point; of a `Solution` its z.
        name : str, default "z"
            Name of the argument in messages.
        finite : bool, default False
            Whether NaN and infinities are rejected.

        Returns
        -------
        array of shape (n,)
            The vector.

        Raises
        ------
        InputError
            For anything else.

        Examples
        --------
        >>> ICP([[2.0]], [1.0]).vector([1, 2])
        Traceback (most recent call last):
        icpmodel.errors.InputError: z has shape (2,); shape (1,) was expected
        """
        check_labels({"A": self.matrix, name: z})
        array = as_array(getattr(z, "z", z), name)
        if not finite and array.dtype == np.float64 and array.shape == (self.n,):
            return array
        if array.shape != (self.n,):
            raise InputError(f"{name} has shape {array.shape}; shape ({self.n},) was expected")
        vector = as_float64(array, name)
        if finite and (fault := not_finite(vector, name)):
            raise InputError(f"{fault}; a finite number was expected")
        return vector

    @np.errstate(over="ignore", under="ignore")
    def p(self, z: Any) -> Vector:
        """p(z) = Az + q + f(z), shape (n,).

        Examples
        --------
        >>> ICP([[2.0]], [1.0]).p([3.0])
        array([7.])
        """
        z = self.vector(z)
        return self.product(z) + self.offset(z)

    def offset(self, z: Vector) -> Vector:
        """p(z) − Az = q + f(z), shape (n,); q itself where p is affine.

        Examples
        --------
        >>> ICP([[2.0]], [1.0], f=np.exp).offset(np.zeros(1))
        array([2.])
        """
        return self.q if self.f is None else self.q + self.f.value(z)

    @np.errstate(over="ignore", under="ignore")
    def r(self, z: Any) -> Vector:
        """r(z) = z − ψ(z), shape (n,); +inf where there is no obstacle.

        Examples
        --------
        >>> ICP([[2.0]], [1.0], psi=-1).r([3.0])
        array([4.])
        """
        z = self.vector(z)
        return z - self.psi.value(z)

    @np.errstate(over="ignore", under="ignore")
    def r_upper(self, z: Any) -> Vector | None:
        """z − ψ̄(z), shape (n,), −inf in rows without an upper obstacle; None if no row has one. Feasible where ≤ 0.

        Examples
        --------
        >>> ICP([[2.0]], [1.0], upper=4).r_upper([3.0])
        array([-1.])
        """
        if self.upper is None:
            return None
        z = self.vector(z)
        return z - self.upper.value(z)

    @np.errstate(over="ignore", invalid="ignore", under="ignore")
    def natural_map(self, z: Any, omega: Any = 1.0) -> Vector:
        """F_Ω(z) = min(Az + q, Ω(z − ψ(z))): zero exactly at the solutions, for every Ω > 0.

        With an upper obstacle it is mid(Ω(z − ψ̄(z)), Az + q, Ω(z − ψ(z))), the median of the
        three.

        Parameters
        ----------
        z : array_like of shape (n,)
            The point.
        omega : float or array_like of shape (n,), default 1
            The positive diagonal of Ω.

        Returns
        -------
        array of shape (n,)
            F_Ω(z).

        Raises
        ------
        InputError
            Where `omega` is not positive.

        Examples
        --------
        >>> ICP([[2.0]], [-1.0]).natural_map([3.0], omega=0.5)
        array([1.5])
        """
        omega = as_vector(omega, self.n, "omega")
        if not (omega > 0).all():
            raise InputError(f"omega has the entry {omega.min()}; positive numbers were expected")
        return mid(self.p(z), self.r(z), self.r_upper(z), omega)

    @np.errstate(over="ignore", invalid="ignore", under="ignore")
    def residual(self, z: Any) -> float:
        """Res_D(z) = ‖min(D⁻¹p(z), r(z))‖₂ with d_i = max_j |a_ij|.

        Parameters
        ----------
        z : array_like of shape (n,)
            The point.

        Returns
        -------
        float
            The residual, safe against overflow; NaN where z or ψ(z) is.

        Notes
        -----
        The residual is a number in the units of z. Multiplication of a row of (A, q) by a positive
        number does not change it. If z, ψ and q are multiplied by t, so is the residual. In
        diagonally dominant rows d_i = |a_ii|. With an f, A + f′ takes the place of A: d_i is the
        smaller of its values at z and near z = 1.

        With an upper obstacle it is ‖mid(z − ψ̄(z), D⁻¹p(z), r(z))‖₂. Where ψ_i(z) > ψ̄_i(z) no z_i
        is feasible. There the larger of |z_i − ψ_i| and |z_i − ψ̄_i| replaces the median.

        Examples
        --------
        >>> (
        ...     ICP([[3.0]], [-6.0]).residual([1.0]),
        ...     ICP([[2**-30 * 3.0]], [2**-30 * -6.0]).residual([1.0]),
        ... )
        (1.0, 1.0)
        """
        z = self.vector(z)
        psi = self.psi.value(z)
        r_upper = None if self.psi.upper is None else z - self.psi.upper.value(z)
        p = self.product(z) + self.offset(z)
        return self.residual_of(p, z - psi, r_upper, self.weights_at(z, p))

    def weights_at(self, z: Vector, p: Any = 0.0) -> Vector:
        """The diagonal of D⁻¹ in Res_D(z), shape (n,): those of `matrix`; with an f, larger where slopes are small.

        With `p` = p(z), a nonzero entry of p in a row of slope 0 counts as at least the size of z.

        Examples
        --------
        >>> ICP([[4.0]], [1.0]).weights_at(np.zeros(1))
        array([0.25])
        """
        if self.f is None:
            return self.matrix.row_weights
        with suppress(MapError):
            return self.f.weights_at(self.matrix, z, p)
        return self.matrix.row_weights

    def residual_of(self, p: Vector, r: Vector, r_upper: Vector | None = None, weights: Vector | None = None) -> float:
        """Res_D from `p`, `r` = z − ψ and `r_upper` = z − ψ̄, with the diagonal `weights` of D⁻¹.

        By default the weights are those of the `matrix`. With an f the result is then a lower bound of Res_D.

        Examples
        --------
        >>> ICP([[3.0]], [-6.0]).residual_of(np.array([-3.0]), np.array([1.0]), None)
        1.0
        """
        return norm(mid(self.weighted(p, self.matrix.row_weights if weights is None else weights), r, r_upper))

    def weighted(self, p: Vector, weights: Vector) -> Vector:
        """The `weights` times p, and 0 where p is 0, even if the weight is ∞."""
        return weights * p if self.f is None else np.where(p == 0.0, 0.0, weights * p)

    @np.errstate(all="ignore")
    def residual_at_0(self) -> float:
        """Res_D(0) = ‖min(D⁻¹p(0), −ψ(0))‖₂, without a product with A.

        With an f it uses the slopes near z = 1, or those at 0 if they give more, but at most 1.

        Examples
        --------
        >>> ICP([[3.0]], [-6.0]).residual_at_0()
        2.0
        """
        zero = np.zeros(self.n)
        p = self.offset(zero)
        r, *upper = (-psi.value(zero) for psi in sides_of(self.psi))
        r_upper = upper[0] if upper else None
        residual = self.residual_of(p, r, r_upper)
        if self.f is not None and residual < 1.0:
            residual = max(residual, min(self.residual_of(p, r, r_upper, self.weights_at(zero, p)), 1.0))
        return residual

    def residual_scale(self, at_0: float | None = None) -> float:
        """The reference of a relative tolerance: Res_D(0).

        If 0 is a solution, it is the smallest nonzero number of |p_i(0)|/d_i, |ψ_i(0)| and |ψ̄_i(0)|, without p_i in
        zero rows of A. Then `solve` takes ‖z0‖ where that is smaller and not 0.

        Parameters
        ----------
        at_0 : float, optional
            Res_D(0), if it is known.

        Returns
        -------
        float
            The scale; 0 where all of these numbers are 0, or ψ has no value at 0. Then `solve`
            uses ‖z‖.

        Notes
        -----
        As Res_D(0) ≤ ‖max(D⁻¹|A|, I + G)‖₂ ‖z*‖₂, a small share of it is small compared to the solution.

        Examples
        --------
        >>> problem = ICP([[2, -1], [-1, 2]], [-4, 3])
        >>> (
        ...     problem.residual_scale(),
        ...     problem.with_q([4, 3]).residual_scale(),
        ...     problem.with_q([0, 0]).residual_scale(),
        ... )
        (2.0, 1.5, 0.0)
        """
        with suppress(MapError):
            at_0 = self.residual_at_0() if at_0 is None else at_0
        if at_0 is None or not math.isfinite(at_0):
            return 0.0
        if at_0 > 0.0:
            return at_0
        zero = np.zeros(self.n)
        sides = [psi.value(zero) for psi in sides_of(self.psi)]
        with np.errstate(all="ignore"):
            scaled_p = np.where(self.matrix.empty_rows, 0.0, self.matrix.row_weights * self.offset(zero))
            return float(smallest_size(scaled_p, *sides))

    @np.errstate(over="ignore", invalid="ignore", under="ignore")
    def paper_residual(self, z: Any) -> float:
        """Res(z) = ‖min(p(z), r(z))‖₂, the residual of the paper, which `atol` limits; see `residual`.

        Examples
        --------
        >>> ICP([[3.0]], [-6.0]).paper_residual([1.0])
        3.0
        """
        return norm(mid(self.p(z), self.r(z), self.r_upper(z)))

    @np.errstate(over="ignore", invalid="ignore", under="ignore")
    def rounding(self, z: Any) -> tuple[Vector, Vector]:
        """Bounds on the rounding errors of p(z) and of r(z) as computed, entry by entry.

        Parameters
        ----------
        z : array_like of shape (n,)
            The point.

        Returns
        -------
        tuple of two arrays of shape (n,)
            The bounds for p and for r.

        Notes
        -----
        For p it is γ_k(|A||z| + |q|), 0 where |A||z| is 0. For r it is γ_k(|z| + G|z| + |ψ(z)|), 0
        where r is infinite. With an upper obstacle as well, it is the larger of the two. Here γ_k =
        ku/(1 − ku), u = 2⁻⁵³, k is two more than the entries of the row, and k·2⁻¹⁰⁷⁴ is added for
        underflow. The values of ψ and f are assumed to be exact to a few u. That holds for constant
        and affine maps.

        References
        ----------
        Higham, Accuracy and Stability of Numerical Algorithms (2002), section 3.5.

        Examples
        --------
        >>> rounding_p, rounding_r = ICP([[3.0]], [-6.0]).rounding([2.0])
        >>> bool(0 < rounding_p[0] < 1e-14), bool(0 < rounding_r[0] < 1e-14)
        (True, True)
        """
        z = self.vector(z)
        sizes = [np.abs(psi.value(z)) for psi in sides_of(self.psi)]
        size_of_psi = np.maximum.reduce([np.where(np.isinf(size), -1.0, size) for size in sizes])
        free = size_of_psi < 0.0
        size_of_psi[free] = 0.0
        terms = np.diff(self.A.indptr) + 2
        # in place: for large vectors allocation dominates the time
        rounding_p = self.matrix.magnitude(z)
        size_of_z = np.abs(z)
        exact = rounding_p == 0.0
        rounding_p += np.abs(self.q)
        rounding_p *= gamma(terms)
        rounding_p[exact] = 0.0
        if self.f is not None:
            rounding_p += self.f.rounding(self.f.value(z))
        rounding_p += terms * SMALLEST
        rounding_r = size_of_z + size_of_psi
        entries: Any = 3
        if self.psi.lipschitz is not None and self.psi.lipschitz.nnz:
            rounding_r += self.psi.lipschitz @ size_of_z
            entries = np.diff(self.psi.lipschitz.indptr) + 3
        rounding_r = gamma(entries) * rounding_r + entries * SMALLEST
        rounding_r[free] = 0.0
        return rounding_p, rounding_r

    def rounding_of_residual(self, z: Any) -> float:
        """A bound on the rounding error of Res_D(z).

        Examples
        --------
        >>> ICP([[3.0]], [-6.0]).rounding_of_residual([2.0]) < 1e-14
        True
        """
        rounding_p, rounding_r = self.rounding(z)
        return norm(np.maximum(self.weighted(rounding_p, self.weights_at(self.vector(z))), rounding_r))


def smallest_size(*arrays: Any) -> Any:
    """The smallest |entry| in each row of all `arrays` that is neither 0 nor infinite; 0 where there is none."""
    sizes = np.abs(np.concatenate(arrays, axis=-1))
    least = np.where(sizes > 0.0, sizes, np.inf).min(axis=-1, initial=np.inf)
    return np.where(least < np.inf, least, 0.0)
