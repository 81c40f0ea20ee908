"""What foreign solvers are given: the problem in handy units, as a convex QP or as it stands.

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

import numpy as np
import scipy.sparse as sp

from ..errors import MapError
from ..numerics.arrays import Vector
from ..numerics.equilibration import in_units
from ..numerics.rounding import UNIT_ROUNDOFF
from ..problem.data import ProblemData
from ..theory.certificates.bounds import ErrorBound, error_bound
from ..theory.matrices.classes import MatrixClasses, classify


@dataclass(frozen=True)
class QP:
    """min ½yᵀPy + qᵀy subject to lower ≤ Ky ≤ upper: `P` symmetric (n, n), `K` (m, n), both CSC; ±inf allowed.

    Each row is an equation, lower = upper, or has a lower bound only.

    >>> icp.solvers.Target(ICP([[2.0]], [-1.0])).qp("energy").P.toarray()
    array([[2.]])
    """

    P: sp.csc_array
    q: Vector
    K: sp.csc_array
    lower: Vector
    upper: Vector

    def conic(self) -> tuple[sp.csc_matrix, Vector, int]:
        """(M, b, e) of My + s = b with s = 0 in the first e rows, the equations, and s ≥ 0 in the others."""
        equal = self.lower == self.upper
        if not equal.any():
            return sp.csc_matrix(-self.K), -self.lower, 0
        order = np.argsort(~equal, kind="stable")
        return sp.csc_matrix(-self.K.tocsr()[order]), -self.lower[order], int(equal.sum())


@dataclass(frozen=True, eq=False)
class Target:
    """One problem for foreign solvers, with what they all need to know of it computed once.

    Parameters: `problem` the ICP to be solved, ψ constant or affine, in units that suit absolute tolerances; `frozen`
    whether its obstacle was frozen at the answer under test.

    >>> target = icp.solvers.Target(ICP([[2.0, 1.0], [0.0, 2.0]], [-1.0, 0.0]))
    >>> target.why_not("energy"), target.why_not("gap")
    ('A is not symmetric', None)
    """

    problem: ProblemData
    frozen: bool = False

    @cached_property
    def c(self) -> Vector:
        """c of ψ(z) = Gz + c, shape (n,); −inf in free rows."""
        assert self.problem.psi.linear is not None
        return self.problem.psi.linear[1]

    @cached_property
    def free(self) -> np.ndarray:
        """Where there is no obstacle, so that p_i = 0 must hold: shape (n,), bool."""
        return np.isneginf(self.c)

    @cached_property
    def I_minus_G(self) -> sp.csr_array:
        """I − G, its free rows those of I, shape (n, n): p_i = 0 there, so any r_i gives the same pᵀr."""
        assert self.problem.psi.linear is not None
        G = self.problem.psi.linear[0]
        return sp.csr_array(sp.eye_array(self.problem.n) - sp.diags_array(np.where(self.free, 0.0, 1.0)) @ G)

    @cached_property
    def curvature(self) -> sp.csr_array:
        """S = Aᵀ(I − G) + (I − G)ᵀA, the Hessian of pᵀr, shape (n, n); 2A where A is symmetric and ψ constant."""
        half = self.problem.A.T @ self.I_minus_G
        return sp.csr_array(half + half.T)

    @cached_property
    def convexity(self) -> MatrixClasses:
        """Whether S is positive (semi)definite."""
        return classify(self.curvature)

    @cached_property
    def at_zero(self) -> ErrorBound:
        """δ with |z*| ≤ δ from the certificate at z = 0, thus independent of the answer under test.

        Not sharpened: that would hand |z*| itself to a solver that is asked for it.
        """
        return error_bound(self.problem, np.zeros(self.problem.n), sharp=False)

    @cached_property
    def bounds(self) -> tuple[Vector, Vector, Vector] | None:
        """z̄, p̄ and r̄, each of shape (n,), with |z*| ≤ z̄, p* ≤ p̄ and r* ≤ r̄ (∞ in free rows); None without `at_zero`.

        δ of `at_zero`, |q| + |A|δ and |I − G|δ + |c|, each a little larger, as these sums round.
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
        """
        return self.at_zero.unique or self.convexity.definite.holds is True

    def why_not(self, form: str) -> str | None:
        """Why `form` ("energy", "gap" or "mpec") does not apply, in one sentence; None where it does."""
        if form == "mpec":
            return None
        constant = self.problem.psi.is_constant
        if form == "energy" and not constant:
            return "psi is not constant"
        if form == "energy" and not _is_symmetric(self.problem.A):
            return "A is not symmetric"
        # rounding does not make a QP nonconvex for a solver
        convex = self.convexity.semidefinite_up_to_rounding
        if convex.holds:
            return None
        matrix = "A + A'" if constant else "A'(I - G) + (I - G)'A"
        failed = "is not" if convex.holds is False else "could not be shown to be"
        return f"{matrix} {failed} positive semidefinite: {convex.reason}"

    def qp(self, form: str) -> QP:
        """The problem as "energy" or "gap", made once; call it only where `why_not` is None."""
        return self._energy if form == "energy" else self._gap

    @cached_property
    def _energy(self) -> QP:
        held = ~self.free
        lower = self.c[held]
        K = sp.csc_array(self.I_minus_G[held])
        return QP(sp.csc_array(self.curvature / 2), self.problem.q, K, lower, np.full(lower.size, np.inf))

    @cached_property
    def _gap(self) -> QP:
        A, q, held = self.problem.A, self.problem.q, ~self.free
        linear = self.I_minus_G.T @ q - A.T @ np.where(self.free, 0.0, self.c)
        K = sp.csc_array(sp.vstack([A, self.I_minus_G[held]]))
        upper = np.append(np.where(self.free, -q, np.inf), np.full(held.sum(), np.inf))
        return QP(sp.csc_array(self.curvature), linear, K, np.append(-q, self.c[held]), upper)


def in_handy_units(problem: ProblemData) -> tuple[ProblemData, float]:
    """The same problem with a typical |a_ii| and a typical size of z near 1, and the unit: z = unit · y.

    A becomes 2⁻ⁱA, q 2⁻ⁱ⁻ᵏq, ψ y ↦ 2⁻ᵏψ(2ᵏy), without rounding, so that absolute tolerances of solvers mean something
    for a problem in any units. The size of z is taken from q_i/a_ii and from the positive obstacles at z = 0, never
    from an answer. Returns (problem in y, 2ᵏ); the problem as it is, and 1, where something would overflow.
    """
    diagonal = np.abs(problem.A.diagonal())
    size_A = _typical(diagonal) or _typical(np.abs(problem.A.data)) or 1.0
    with np.errstate(over="ignore", under="ignore"):
        size_z = max(
            _typical(np.abs(problem.q) / np.where(diagonal > 0, diagonal, size_A)), _typical(_psi_at_zero(problem))
        )
        i, k = math.frexp(size_A)[1], math.frexp(size_z or 1.0)[1]
        A = in_units(problem.A, np.full(problem.n, -i), np.zeros(problem.n, dtype=int))
        q, unit = np.ldexp(problem.q, -i - k), float(np.ldexp(1.0, k))
    if not (np.isfinite(A.data).all() and np.isfinite(q).all() and 0.0 < unit < math.inf):
        return problem, 1.0
    return ProblemData(A, q, problem.psi.in_units(unit)), unit


def targets(problem: ProblemData, y: Vector) -> list[Target]:
    """What is to be solved: the problem where ψ is constant or affine; else, and for affine ψ too, the frozen one.

    Parameters: `problem` in handy units; `y` the answer under test in them, shape (n,). The frozen problem is missing
    where ψ(y) is not a finite obstacle.
    """
    found = [Target(problem)] if problem.psi.linear is not None else []
    if not problem.psi.is_constant and np.isfinite(y).all():
        c = problem.psi.value(y)
        if (np.isfinite(c) | np.isneginf(c)).all():
            found.append(Target(problem.with_psi(c), frozen=True))
    return found


def _is_symmetric(A: sp.csr_array) -> bool:
    """A = Aᵀ up to one rounding of its entries."""
    difference = abs(A - A.T)
    return bool(difference.max() <= 4 * UNIT_ROUNDOFF * np.abs(A.data).max())


def _typical(sizes: Vector) -> float:
    """The median of the positive finite `sizes`, 0 where there are none: one odd row must not set the unit."""
    positive = sizes[np.isfinite(sizes) & (sizes > 0)]
    return float(np.quantile(positive, 0.5, method="lower")) if positive.size else 0.0


def _psi_at_zero(problem: ProblemData) -> Vector:
    """ψ(0), or nothing where ψ fails there; it only helps to choose a unit."""
    try:
        return problem.psi.value(np.zeros(problem.n))
    except MapError:
        return np.zeros(0)
