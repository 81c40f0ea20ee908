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
    def held(self) -> np.ndarray:
        """The rows with an obstacle, shape (n,), bool; p_i = 0 must hold in the others, which are free."""
        return ~np.isneginf(self.c)

    @cached_property
    def I_minus_G(self) -> sp.csr_array:
        """I − G, its free rows those of I, shape (n, n): p_i = 0 there, so any r_i gives the same pᵀr."""
        assert self.problem.psi.linear is not None
        G = self.problem.psi.linear[0]
        return sp.csr_array(sp.eye_array(self.problem.n) - sp.diags_array(np.where(self.held, 1.0, 0.0)) @ G)

    @cached_property
    def curvature(self) -> MatrixClasses:
        """S = Aᵀ(I − G) + (I − G)ᵀA, the Hessian of pᵀr, shape (n, n): whether it is positive (semi)definite."""
        half = self.problem.A.T @ self.I_minus_G
        return classify(half + half.T)

    @cached_property
    def at_zero(self) -> ErrorBound:
        """δ with |z*| ≤ δ from the certificate at z = 0, thus independent of the answer under test.

        Not sharpened: that would hand |z*| itself to a solver that is asked for it.
        """
        return error_bound(self.problem, np.zeros(self.problem.n), sharp=False)

    @cached_property
    def bounds(self) -> tuple[Vector, Vector, Vector] | None:
        """δ of `at_zero`, |q| + |A|δ and |I − G|δ + |c|, each of shape (n,) and a little larger, as these sums round.

        They bound |z*|, p* and r* (∞ in free rows). None where `at_zero` has no δ.
        """
        if self.at_zero.componentwise is None:
            return None
        larger = 1 + 1e-9
        z_max = self.at_zero.componentwise * larger
        p_max = (np.abs(self.problem.q) + self.problem.matrix.absolute @ z_max) * larger
        return z_max, p_max, (abs(self.I_minus_G) @ z_max + np.abs(self.c)) * larger

    @cached_property
    def unique(self) -> bool:
        """Whether at most one solution is proved to exist: by the certificate, or because S is positive definite.

        For two solutions (p − p′)ᵀ(r − r′) = −pᵀr′ − p′ᵀr ≤ 0, and it equals ½(z − z′)ᵀS(z − z′).
        """
        return self.at_zero.unique or self.curvature.definite.holds is True

    def why_not(self, form: str) -> str | None:
        """Why `form` ("energy", "gap" or "mpec") does not apply, in one sentence; None where it does."""
        A, constant = self.problem.A, self.problem.psi.is_constant
        if form == "mpec":
            return None
        if form == "energy" and not constant:
            return "psi is not constant"
        # up to one rounding of its entries
        if form == "energy" and abs(A - A.T).max() > 4 * UNIT_ROUNDOFF * np.abs(A.data).max():
            return "A is not symmetric"
        # rounding does not make a QP nonconvex for a solver
        convex = self.curvature.semidefinite_up_to_rounding
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
        lower, K = self.c[self.held], sp.csc_array(self.I_minus_G[self.held])
        return QP(sp.csc_array(self.curvature.A / 2), self.problem.q, K, lower, np.full(lower.size, np.inf))

    @cached_property
    def _gap(self) -> QP:
        A, q, held = self.problem.A, self.problem.q, self.held
        linear = self.I_minus_G.T @ q - A.T @ np.where(held, self.c, 0.0)
        K = sp.csc_array(sp.vstack([A, self.I_minus_G[held]]))
        upper = np.append(np.where(held, np.inf, -q), np.full(held.sum(), np.inf))
        return QP(sp.csc_array(self.curvature.A), linear, K, np.append(-q, self.c[held]), upper)


def in_handy_units(problem: ProblemData) -> tuple[ProblemData, float]:
    """The same problem with a typical |a_ii| and a typical size of z near 1, and the unit: z = unit · y.

    A becomes 2⁻ⁱA, q 2⁻ⁱ⁻ᵏq, ψ y ↦ 2⁻ᵏψ(2ᵏy), without rounding, so that absolute tolerances of solvers mean something.
    The size of z is taken from q_i/a_ii and from the positive obstacles at z = 0, never from an answer.
    Returns (problem in y, 2ᵏ); the problem as it is, and 1, where something would overflow.
    """
    diagonal = np.abs(problem.A.diagonal())
    size_A = _typical(diagonal) or _typical(np.abs(problem.A.data)) or 1.0
    with np.errstate(over="ignore", under="ignore"):
        try:
            obstacle = problem.psi.value(np.zeros(problem.n))
        except MapError:  # it only helps to choose a unit
            obstacle = np.zeros(0)
        from_q = np.abs(problem.q) / np.where(diagonal > 0, diagonal, size_A)
        i, k = math.frexp(size_A)[1], math.frexp(max(_typical(from_q), _typical(obstacle)) or 1.0)[1]
        A = in_units(problem.A, np.full(problem.n, -i), np.zeros(problem.n, dtype=int))
        q, unit = np.ldexp(problem.q, -i - k), float(np.ldexp(1.0, k))
    if not (np.isfinite(A.data).all() and np.isfinite(q).all() and 0.0 < unit < math.inf):
        return problem, 1.0
    return ProblemData(A, q, problem.psi.in_units(unit)), unit


def targets(problem: ProblemData, y: Vector) -> list[Target]:
    """What is to be solved: `problem`, in handy units, where ψ is constant or affine; else, and for affine ψ too, the
    problem frozen at the answer under test `y`, shape (n,), if ψ(y) is a finite obstacle.
    """
    found = [Target(problem)] if problem.psi.linear is not None else []
    if not problem.psi.is_constant and np.isfinite(y).all():
        c = problem.psi.value(y)
        if (np.isfinite(c) | np.isneginf(c)).all():
            found.append(Target(problem.with_psi(c), frozen=True))
    return found


def _typical(sizes: Vector) -> float:
    """The median of the positive finite `sizes`, 0 where there are none: one odd row must not set the unit."""
    positive = sizes[np.isfinite(sizes) & (sizes > 0)]
    return float(np.quantile(positive, 0.5, method="lower")) if positive.size else 0.0
