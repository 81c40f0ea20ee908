"""What the independent solvers are given: the problem in handy units, as a convex QP or as it stands.

With p = Az + q, r = z − Gz − c (G = 0 for a constant ψ) and i "free" where c_i = −∞ (no obstacle: p_i = 0):

    energy   min ½zᵀAz + qᵀz       subject to r_i ≥ 0 (i not free)                   ψ constant, A symmetric, A ≥ 0
    gap      min p(z)ᵀr(z)         subject to p ≥ 0, r ≥ 0, p_i = 0 (i free)         Aᵀ(I − G) + (I − G)ᵀA ≥ 0
    mpec     p ≥ 0 ⟂ r ≥ 0         and p_i = 0 (i free)                              always

z itself has no sign. The affine ψ stays in the constraints: A(I − G)⁻¹ would be dense. A problem whose ψ is not
constant is also posed with its *obstacle frozen* at c = ψ(z), z the answer under test: z solves ICP(q, A, ψ) if and
only if it solves that LCP. Reference: Cottle, Pang and Stone, The Linear Complementarity Problem (2009), 1.4 and 3.1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import MapError
from ..numerics.arrays import Vector
from ..numerics.rounding import UNIT_ROUNDOFF
from ..problem.affine import Affine, Constant
from ..problem.data import ProblemData
from ..problem.function import Function
from ..problem.map import Map
from ..theory.certificates.bounds import ErrorBound, error_bound
from ..theory.matrices.classes import MatrixClasses, classify


@dataclass(frozen=True)
class QP:
    """min ½yᵀPy + qᵀy subject to lower ≤ Ky ≤ upper: `P` symmetric (n, n), `K` (m, n), both CSC; ±inf allowed.

    >>> Target(ICP([[2.0]], [-1.0])).qp("energy").P.toarray()
    array([[2.]])
    """

    P: sp.csc_array
    q: Vector
    K: sp.csc_array
    lower: Vector
    upper: Vector


@dataclass(frozen=True, eq=False)
class Target:
    """One problem for the independent solvers, with what they all need to know of it computed once.

    `problem` the ICP to be solved, ψ constant or affine, in handy units (see `in_handy_units`); `frozen` whether its
    obstacle was frozen at the answer under test.

    >>> target = Target(ICP([[2.0, 1.0], [0.0, 2.0]], [-1.0, 0.0]))
    >>> target.why_not("energy"), target.why_not("gap")
    ('A is not symmetric', None)
    """

    problem: ProblemData
    frozen: bool = False

    @cached_property
    def c(self) -> Vector:
        """c of ψ(z) = Gz + c, shape (n,); −inf in free rows.

        >>> Target(ICP([[2.0]], [-1.0], psi=3)).c
        array([3.])
        """
        assert isinstance(self.problem.psi, Constant | Affine)
        return self.problem.psi.c

    @cached_property
    def free(self) -> np.ndarray:
        """Where there is no obstacle, so that p_i = 0 must hold: shape (n,), bool.

        >>> Target(ICP([[2.0]], [-1.0], psi=[-np.inf])).free
        array([ True])
        """
        return np.isneginf(self.c)

    @cached_property
    def I_minus_G(self) -> sp.csr_array:
        """I − G, its free rows those of I, shape (n, n): p_i = 0 there, so any r_i gives the same pᵀr.

        >>> Target(ICP([[2.0]], [-1.0])).I_minus_G.toarray()
        array([[1.]])
        """
        n = self.problem.n
        if isinstance(self.problem.psi, Affine):
            return sp.csr_array(sp.eye_array(n) - sp.diags_array(np.where(self.free, 0.0, 1.0)) @ self.problem.psi.G)
        return sp.csr_array(sp.eye_array(n))

    @cached_property
    def curvature(self) -> sp.csr_array:
        """S = Aᵀ(I − G) + (I − G)ᵀA, the Hessian of pᵀr, shape (n, n).

        >>> Target(ICP([[2.0]], [-1.0])).curvature.toarray()
        array([[4.]])
        """
        half = self.problem.A.T @ self.I_minus_G
        return sp.csr_array(half + half.T)

    @cached_property
    def convexity(self) -> MatrixClasses:
        """Whether S is positive (semi)definite; S = 2A where A is symmetric and ψ constant.

        >>> Target(ICP([[2.0]], [-1.0])).convexity.definite.holds
        True
        """
        return classify(self.curvature)

    @cached_property
    def at_zero(self) -> ErrorBound:
        """δ with |z*| ≤ δ from the certificate at z = 0, thus independent of the answer under test.

        Not sharpened: that would hand |z*| itself to a solver that is asked for it.

        >>> Target(ICP([[2.0]], [-1.0])).at_zero.value >= 0.5
        True
        """
        return error_bound(self.problem, np.zeros(self.problem.n), sharp=False)

    @cached_property
    def bounds(self) -> tuple[Vector, Vector, Vector] | None:
        """z̄, p̄ and r̄, each of shape (n,), with |z*| ≤ z̄, p* ≤ p̄ and r* ≤ r̄ (∞ in free rows); None without `at_zero`.

        δ of `at_zero`, |q| + |A|δ and |I − G|δ + |c|, each a little larger, as these sums round.

        >>> Target(ICP([[2.0]], [-1.0])).bounds[1].round(6)
        array([2.])
        """
        if self.at_zero.componentwise is None:
            return None
        z_max = self.at_zero.componentwise * (1 + 1e-9)
        p_max = (np.abs(self.problem.q) + self.problem.matrix.absolute @ z_max) * (1 + 1e-9)
        r_max = (abs(self.I_minus_G) @ z_max + np.abs(self.c)) * (1 + 1e-9)
        return z_max, p_max, r_max

    @cached_property
    def unique(self) -> bool:
        """Whether at most one solution is proved to exist: by the certificate, or because S is positive definite.

        For two solutions (p − p′)ᵀ(r − r′) = −pᵀr′ − p′ᵀr ≤ 0, and it equals ½(z − z′)ᵀS(z − z′).

        >>> Target(ICP([[1.0, 2.0], [2.0, 1.0]], [-1.0, -1.0])).unique
        False
        """
        return self.at_zero.unique or self.convexity.definite.holds is True

    def why_not(self, form: str) -> str | None:
        """Why `form` ("energy", "gap" or "mpec") does not apply, in one sentence; None where it does.

        >>> Target(ICP([[1.0, 2.0], [2.0, 1.0]], [-1.0, -1.0])).why_not("gap")[:40]
        "A + A' is not positive semidefinite: ind"
        """
        if form == "mpec":
            return None
        constant = isinstance(self.problem.psi, Constant)
        matrix = "A + A'" if constant else "A'(I - G) + (I - G)'A"
        if form == "energy":
            if not constant:
                return "psi is not constant"
            if not _is_symmetric(self.problem.A):
                return "A is not symmetric"
        # rounding does not make a QP nonconvex for a solver
        convex = self.convexity.semidefinite_up_to_rounding
        if convex.holds:
            return None
        failed = "is not" if convex.holds is False else "could not be shown to be"
        return f"{matrix} {failed} positive semidefinite: {convex.reason}"

    def qp(self, form: str) -> QP:
        """The problem as "energy" or "gap"; call it only where `why_not` is None.

        >>> Target(ICP([[2.0]], [-1.0])).qp("gap").K.toarray().ravel()
        array([2., 1.])
        """
        A, q, held = self.problem.A, self.problem.q, ~self.free
        r_rows, r_lower = self.I_minus_G[held], self.c[held]
        r_upper = np.full(r_lower.size, np.inf)
        if form == "energy":
            return QP(sp.csc_array(self.curvature / 2), q, sp.csc_array(r_rows), r_lower, r_upper)
        linear = self.I_minus_G.T @ q - A.T @ np.where(self.free, 0.0, self.c)
        K = sp.csc_array(sp.vstack([A, r_rows]))
        p_upper = np.where(self.free, -q, np.inf)
        return QP(
            sp.csc_array(self.curvature), linear, K, np.concatenate([-q, r_lower]), np.concatenate([p_upper, r_upper])
        )


def in_handy_units(problem: ProblemData) -> tuple[ProblemData, float]:
    """The same problem with a typical |a_ii| and a typical size of z near 1, and the unit: z = unit · y.

    A becomes 2⁻ⁱA, q 2⁻ⁱ⁻ᵏq, ψ y ↦ 2⁻ᵏψ(2ᵏy), without rounding, so that absolute tolerances of solvers mean something
    for a problem in any units. The size of z is taken from q_i/a_ii and from the positive obstacles at z = 0, never
    from an answer. Returns (problem in y, 2ᵏ).
    """
    diagonal = np.abs(problem.A.diagonal())
    size_A = _typical(diagonal) or _typical(np.abs(problem.A.data)) or 1.0
    with np.errstate(over="ignore"):
        sizes = (
            _typical(np.abs(problem.q) / np.where(diagonal > 0, diagonal, size_A)),
            _typical(_at_zero(problem.psi, problem.n)),
        )
    i, k = math.frexp(size_A)[1], math.frexp(max(sizes) or 1.0)[1]
    with np.errstate(over="ignore", under="ignore"):
        data, q = np.ldexp(problem.A.data, -i), np.ldexp(problem.q, -i - k)
        finite = np.isfinite(data).all() and np.isfinite(q).all()
    if not finite or not 0.0 < math.ldexp(1.0, k) < math.inf:
        return problem, 1.0
    A = sp.csr_array((data, problem.A.indices, problem.A.indptr), shape=problem.A.shape)
    return ProblemData(A, q, _in_units(problem.psi, math.ldexp(1.0, k))), math.ldexp(1.0, k)


def targets(problem: ProblemData, y: Vector) -> list[Target]:
    """What is to be solved: the problem where ψ is constant or affine; else, and for affine ψ too, the frozen one.

    Parameters: `problem` in handy units; `y` the answer under test in them, shape (n,). The frozen problem is missing
    where ψ(y) is not a finite obstacle.
    """
    found = [Target(problem)] if isinstance(problem.psi, Constant | Affine) else []
    if not isinstance(problem.psi, Constant) and np.isfinite(y).all():
        c = problem.psi.value(y)
        if (np.isfinite(c) | np.isneginf(c)).all():
            found.append(Target(problem.with_psi(c), frozen=True))
    return found


def _is_symmetric(A: sp.csr_array) -> bool:
    """A = Aᵀ up to one rounding of its entries."""
    difference = abs(A - A.T)
    return bool(difference.nnz == 0 or difference.max() <= 4 * UNIT_ROUNDOFF * np.abs(A.data).max())


def _typical(sizes: Vector) -> float:
    """The median of the positive finite `sizes`, 0 where there are none: one odd row must not set the unit."""
    positive = sizes[np.isfinite(sizes) & (sizes > 0)]
    return float(np.quantile(positive, 0.5, method="lower")) if positive.size else 0.0


def _at_zero(psi: Map, n: int) -> Vector:
    """ψ(0), or nothing where ψ fails there; it only helps to choose a unit."""
    try:
        return psi.value(np.zeros(n))
    except MapError:
        return np.zeros(0)


def _in_units(psi: Map, unit: float) -> Any:
    if isinstance(psi, Constant):
        return psi.c / unit
    if isinstance(psi, Affine):
        return Affine(psi.G, psi.c / unit)
    return Function(lambda y: psi.value(y * unit) / unit, lipschitz=psi.lipschitz)
