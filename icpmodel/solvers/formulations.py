"""The forms in which foreign solvers get a problem: scaled, as a convex QP or as it stands.

With p = Az + q, r = z − Gz − c (G = 0 for a constant ψ) and i "free" where c_i = −∞ (no obstacle:
p_i = 0):

    energy   min ½zᵀAz + qᵀz       subject to r_i ≥ 0 (i not free)                   ψ constant, A symmetric, A ≥ 0.
    gap      min p(z)ᵀr(z)         subject to p ≥ 0, r ≥ 0, p_i = 0 (i free)         Aᵀ(I − G) + (I − G)ᵀA ≥ 0.
    mpec     p ≥ 0 ⟂ r ≥ 0         and p_i = 0 (i free)                              always.
    nlp      the same with p(z) = Az + q + f(z)                                      p nonlinear.

An upper obstacle, s = ψ̄(z) − z = d + Hz − z ≥ 0, adds its side to energy. In mpec, with p = u −
v, it makes two conditions: 0 ≤ u ⟂ r ≥ 0 and 0 ≤ v ⟂ s ≥ 0.

The gap is then uᵀr + vᵀs = pᵀr + vᵀ(d − c) with u = p + v. The unknowns v ≥ 0 stand in the rows
with two obstacles. There the two have to move alike, H = G: else vᵀ(H − G)z is not convex. In a row
with an upper obstacle alone r stands for −s, and both p and r are ≤ 0.

z itself has no sign. The affine ψ stays in the constraints: A(I − G)⁻¹ would be dense. For a ψ that
is not constant there is another problem, with its *frozen obstacle* c = ψ(z), z the answer under
test. z solves ICP(q, A, ψ) if and only if it solves that LCP.

References
----------
Cottle, Pang and Stone, The Linear Complementarity Problem (2009), sections 1.4 and 3.1.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..errors import InputError, check_arguments
from ..numerics.arrays import Vector
from ..numerics.rounding import UNIT_ROUNDOFF
from ..present.display import Displayable
from ..problem.data import ProblemData
from ..theory.certificates.bounds import ErrorBound, error_bound
from ..theory.matrices.classes import MatrixClasses, classify


@dataclass(frozen=True, repr=False)
class QP(Displayable):
    """A convex quadratic program: min ½yᵀPy + qᵀy subject to lower ≤ Ky ≤ upper.

    y is z, followed by v where the form "gap" has one. Where lower = upper a row is an equation.

    Attributes
    ----------
    P : csc_array of shape (n, n)
        Symmetric.
    q : array of shape (n,)
        The linear term.
    K : csc_array of shape (m, n)
        The rows.
    lower, upper : array of shape (m,)
        Their bounds; ±inf for none.

    Examples
    --------
    >>> icp.solvers.Target(ICP([[2.0]], [-1.0])).qp("energy").P.toarray()
    array([[2.]])
    """

    P: sp.csc_array
    q: Vector
    K: sp.csc_array
    lower: Vector
    upper: Vector

    def conic(self) -> tuple[sp.csc_matrix, Vector, int]:
        """The constraints as My + s = b with s = 0 in the first e rows and s ≥ 0 in the others.

        Returns
        -------
        M : csc_matrix
            The rows, the equations first.
        b : array
            The right-hand side.
        e : int
            Number of equations.
        """
        equal = self.lower == self.upper
        below, above = (np.isfinite(side) & ~equal for side in (self.lower, self.upper))
        if below.all() and not above.any():
            return sp.csc_matrix(-self.K), -self.lower, 0
        K = self.K.tocsr()
        M = sp.vstack([-K[equal], -K[below], K[above]])
        b = np.concatenate([-self.lower[equal], -self.lower[below], self.upper[above]])
        return sp.csc_matrix(M), b, int(equal.sum())


@check_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Target(Displayable):
    """One problem for foreign solvers, with the data that they share computed once.

    Parameters
    ----------
    problem : ProblemData
        The ICP, with constant or affine obstacles, in units that suit absolute tolerances.
    frozen : bool
        Whether the obstacles were frozen at the answer under test.
    tangent : bool
        Whether p is the tangent at the answer under test of a nonlinear one.

    Examples
    --------
    >>> target = icp.solvers.Target(ICP([[2.0, 1.0], [0.0, 2.0]], [-1.0, 0.0]))
    >>> target.why_not("energy"), target.why_not("gap")
    ('A is not symmetric', None)
    """

    problem: ProblemData
    frozen: bool = False
    tangent: bool = False

    @cached_property
    def c(self) -> Vector:
        """c of ψ(z) = Gz + c, shape (n,); −inf in rows without an obstacle below."""
        assert self.problem.psi.linear is not None
        return self.problem.psi.linear[1]

    @cached_property
    def d(self) -> Vector | None:
        """d of ψ̄(z) = Hz + d, shape (n,); +inf in rows without an upper obstacle, None where no row has one."""
        if self.problem.upper is None:
            return None
        assert self.problem.upper.linear is not None
        d = self.problem.upper.linear[1]
        return None if np.isposinf(d).all() else d

    @cached_property
    def near(self) -> Vector:
        """c, and d in the rows that have no other obstacle: what r is the distance to; ±inf in free rows."""
        return self.c if self.d is None else np.where(np.isneginf(self.c), self.d, self.c)

    @cached_property
    def has_obstacle(self) -> np.ndarray:
        """The rows with an obstacle, shape (n,), bool; p_i = 0 must hold in the others, which are free."""
        return np.isfinite(self.near)

    @cached_property
    def upper_only(self) -> np.ndarray:
        """The rows whose only obstacle is above z, shape (n,), bool: p and r have the other sign there."""
        return np.isneginf(self.c) & self.has_obstacle

    @cached_property
    def two_sided(self) -> np.ndarray:
        """The rows with an obstacle on either side, shape (n,), bool."""
        return np.isfinite(self.c) & np.isfinite(self._range[1])

    @cached_property
    def I_minus_G(self) -> sp.csr_array:
        """I − G, or I − H where r is the distance from above, shape (n, n).

        Its free rows are those of I: p_i = 0 there, so any r_i gives the same pᵀr.
        """
        G = self._sides[0]
        if self.d is not None:
            G = _row_selector(~self.upper_only) @ G + _row_selector(self.upper_only) @ self._sides[1]
        return sp.csr_array(sp.eye_array(self.problem.n) - _row_selector(self.has_obstacle) @ G)

    @cached_property
    def I_minus_H(self) -> sp.csr_array:
        """I − H of the rows with two obstacles, shape (k, n), for the distance s = d − (I − H)z from the second."""
        return sp.csr_array((sp.eye_array(self.problem.n) - self._sides[1])[self.two_sided])

    @cached_property
    def _sides(self) -> tuple[sp.csr_array, sp.csr_array]:
        """G and H."""
        below = self.problem.psi
        above = self.problem.upper or self.problem.psi
        assert below.linear is not None
        assert above.linear is not None
        return below.linear[0], above.linear[0]

    @cached_property
    def parallel(self) -> bool:
        """Whether both obstacles move alike in every row that has two."""
        return not self.two_sided.any() or abs(self.I_minus_G[self.two_sided] - self.I_minus_H).sum() == 0.0

    @cached_property
    def curvature(self) -> MatrixClasses:
        """S = Aᵀ(I − G) + (I − G)ᵀA, the Hessian of pᵀr, shape (n, n): whether it is positive (semi)definite."""
        half = self.problem.A.T @ self.I_minus_G
        return classify(half + half.T)

    @cached_property
    def bound_at_zero(self) -> ErrorBound:
        """δ with |z*| ≤ δ from the certificate at z = 0, thus independent of the answer under test.

        Not sharpened: that would hand |z*| itself to a solver that is asked for it.
        """
        return error_bound(self.problem, np.zeros(self.problem.n), sharp=False)

    @cached_property
    def bounds(self) -> tuple[Vector, Vector, Vector] | None:
        """Bounds on |z*|, |p*| and |r*|, each of shape (n,): δ of `bound_at_zero`, |q| + |A|δ and |I − G|δ + |c|.

        They are a little larger, as these sums round. The last one bounds |s*| as well, and is ∞ in free rows.
        Without δ a box bounds z; None without a box.
        """
        z_max = self.bound_at_zero.componentwise
        margin = 1 + 1e-9
        if z_max is None:
            if self.d is None or not (self.problem.psi.is_constant and self.two_sided.all()):
                return None
            z_max = np.maximum(np.abs(self.c), np.abs(self.d))
        z_max = z_max * margin
        p_max = (np.abs(self.problem.q) + self.problem.matrix.absolute @ z_max) * margin
        r_max = abs(self.I_minus_G) @ z_max + np.abs(self.near)
        if self.two_sided.any():
            assert self.d is not None
            s_max = abs(self.I_minus_H) @ z_max + np.abs(self.d[self.two_sided])
            r_max[self.two_sided] = np.maximum(r_max[self.two_sided], s_max)
        return z_max, p_max, r_max * margin

    @cached_property
    def unique(self) -> bool:
        """Whether at most one solution is proved to exist: by the certificate, or because S is positive definite.

        For two solutions (p − p′)ᵀ(r − r′) = −pᵀr′ − p′ᵀr ≤ 0, and it equals ½(z − z′)ᵀS(z − z′). Between obstacles
        that move alike r ∈ [0, d − c] and a larger p_i goes with an r_i that is not larger: it is ≤ 0 there, too.
        """
        if self.problem.f is not None or self.bound_at_zero.unique:
            return self.bound_at_zero.unique
        return self.parallel and self.curvature.definite.holds is True

    def why_not(self, form: str) -> str | None:
        """Why a form does not apply.

        Parameters
        ----------
        form : {"energy", "gap", "mpec", "nlp"}
            The form.

        Returns
        -------
        str or None
            One sentence, None where it does.
        """
        if form == "nlp":
            return "p is affine" if self.problem.f is None else None
        if self.problem.f is not None:
            return "p is nonlinear"
        A = self.problem.A
        constant = self.problem.psi.is_constant
        if form == "mpec":
            return None
        if form == "energy" and not constant:
            return "psi is not constant"
        # up to one rounding of its entries
        if form == "energy" and abs(A - A.T).max() > 4 * UNIT_ROUNDOFF * np.abs(A.data).max():
            return "A is not symmetric"
        if not self.parallel:
            return "psi and upper depend on z in different ways, so that the gap is not convex"
        # rounding does not make a QP nonconvex for a solver
        convex = self.curvature.semidefinite_up_to_rounding
        if convex.holds:
            return None
        matrix = "A + A'" if constant else "A'(I - G) + (I - G)'A"
        verdict = "is not" if convex.holds is False else "could not be shown to be"
        return f"{matrix} {verdict} positive semidefinite: {convex.reason}"

    def qp(self, form: str) -> QP:
        """The problem as a quadratic program, made once; call it only where `why_not` is None.

        Parameters
        ----------
        form : {"energy", "gap"}
            The form.

        Returns
        -------
        QP
            The program.
        """
        return self._energy if form == "energy" else self._gap

    @cached_property
    def _energy(self) -> QP:
        K = sp.csc_array(self.I_minus_G[self.has_obstacle])
        lower, upper = (side[self.has_obstacle] for side in self._range)
        return QP(sp.csc_array(self.curvature.A / 2), self.problem.q, K, lower, upper)

    @cached_property
    def _range(self) -> tuple[Vector, Vector]:
        """c ≤ (I − G)z ≤ d, in rows whose obstacles move alike."""
        return self.c, np.full(self.problem.n, np.inf) if self.d is None else self.d

    @cached_property
    def _gap(self) -> QP:
        A = self.problem.A
        q = self.problem.q
        has_obstacle = self.has_obstacle
        linear = self.I_minus_G.T @ q - A.T @ np.where(has_obstacle, self.near, 0.0)
        lower, upper = (side[has_obstacle] for side in self._range)
        least = np.where(self.upper_only, -np.inf, -q)
        most = np.where(has_obstacle & ~self.upper_only, np.inf, -q)
        K = sp.csc_array(sp.vstack([A, self.I_minus_G[has_obstacle]]))
        P = sp.csc_array(self.curvature.A)
        if not (k := int(self.two_sided.sum())):
            return QP(P, linear, K, np.append(least, lower), np.append(most, upper))
        # p + v ≥ 0, r, and v ≥ 0
        v = sp.eye_array(self.problem.n).tocsc()[:, self.two_sided]
        K = sp.csc_array(sp.block_array([[A, v], [self.I_minus_G[has_obstacle], None], [None, sp.eye_array(k)]]))
        width = (self._range[1] - self.c)[self.two_sided]
        lower = np.append(lower, np.zeros(k))
        upper = np.append(upper, np.full(k, np.inf))
        P = sp.csc_array(sp.block_diag([P, sp.csc_array((k, k))]))
        return QP(P, np.append(linear, width), K, np.append(least, lower), np.append(most, upper))


def targets(problem: ProblemData, y: Vector, tangent: bool = False) -> list[Target]:
    """The problems to be solved by foreign solvers.

    The first is `problem`, scaled, where ψ is constant or affine. Unless ψ is constant the second
    is the problem frozen at the answer under test `y`, shape (n,). It needs finite obstacles ψ(y)
    and ψ̄(y) that do not cross. `tangent` says that p is the tangent of a nonlinear one.
    """
    problems = [Target(problem, tangent=tangent)] if problem.psi.linear is not None else []
    if not problem.psi.is_constant and np.isfinite(y).all():
        with contextlib.suppress(InputError):  # they are not finite, or cross
            problems.append(Target(problem.frozen(y), frozen=True, tangent=tangent))
    return problems


def _row_selector(mask: np.ndarray) -> sp.dia_array:
    """The diagonal matrix that keeps the rows `mask` and makes the others 0."""
    return sp.diags_array(mask.astype(np.float64))
