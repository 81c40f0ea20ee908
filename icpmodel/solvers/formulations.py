"""The forms in which foreign solvers get a problem: as a convex QP or as it stands.

With p = Az + q, r = z − Gz − c (G = 0 for a constant ψ) and i "free" where c_i = −∞ (no obstacle:
p_i = 0):

    energy   min ½zᵀAz + qᵀz       subject to r_i ≥ 0 (i not free)                   ψ constant, A symmetric, A ≥ 0.
    gap      min p(z)ᵀr(z)         subject to p ≥ 0, r ≥ 0, p_i = 0 (i free)         Aᵀ(I − G) + (I − G)ᵀA ≥ 0.
    mpec     p ≥ 0 ⟂ r ≥ 0         and p_i = 0 (i free)                              always.
    nlp      the same with p(z) = Az + q + f(z)                                      p nonlinear.

An upper obstacle, s = ψ̄(z) − z = d + Hz − z ≥ 0, adds s ≥ 0 to energy. In a row without a lower
obstacle the condition is −p ≥ 0 ⟂ s ≥ 0. A row with two obstacles has an unknown v and the two
conditions p + v ≥ 0 ⟂ r ≥ 0 and v ≥ 0 ⟂ s ≥ 0. The gap is the sum of the products of all
conditions, pᵀr + vᵀ(d − c) where there are two obstacles. In these rows H = G is required, as
vᵀ(H − G)z is not convex.

z itself may have either sign. The affine ψ stays in the constraints: A(I − G)⁻¹ would be dense. If ψ
is not constant, there is a second problem with the *frozen obstacle* c = ψ(z), z the answer under
test. z solves ICP(q, A, ψ) if and only if it solves this LCP.

References
----------
Cottle, Pang and Stone, The Linear Complementarity Problem (2009), sections 1.4 and 3.1.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import InputError, check_arguments
from ..numerics.arrays import Mask, Vector
from ..numerics.rounding import UNIT_ROUNDOFF
from ..present.display import Displayable
from ..problem.data import ProblemData
from ..theory.certificates.bounds import ErrorBound, error_bound
from ..theory.matrices.classes import MatrixClasses, classify


@dataclass(frozen=True, repr=False)
class QP(Displayable):
    """A convex quadratic program: min ½yᵀPy + qᵀy subject to lower ≤ Ky ≤ upper.

    y is z, followed by v in the form "gap" if there are rows with two obstacles. A row with lower =
    upper is an equation.

    Attributes
    ----------
    P : csc_array of shape (n, n)
        Symmetric.
    q : array of shape (n,)
        The linear term.
    K : csc_array of shape (m, n)
        The rows of the constraints.
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


class Conditions(NamedTuple):
    """The conditions of a `Target`: Tp(z) + Vv ≥ 0 ⟂ Rz + b ≥ 0, but Tp(z) = 0 in the last rows, which are free.

    They come in three blocks, of ψ, of ψ̄ and of the free rows, with these `sizes`; `rows` are the rows of the problem
    that they belong to. v has an entry for each row with two obstacles.
    """

    rows: NDArray[np.integer]
    sizes: tuple[int, ...]
    T: sp.csr_array
    V: sp.csr_array
    R: sp.csr_array
    b: Vector


@check_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Target(Displayable):
    """One problem for foreign solvers; data that several of them need are computed once.

    Parameters
    ----------
    problem : ProblemData
        The ICP, with constant or affine obstacles, in units that suit absolute tolerances.
    frozen : bool
        Whether the obstacles were frozen at the answer under test.
    tangent : bool
        Whether p is the linearisation at the answer under test of a nonlinear p.

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
    def below(self) -> tuple[sp.csr_array, Vector]:
        """G and c of ψ(z) = Gz + c; c is −inf in rows without an obstacle below."""
        assert self.problem.psi.linear is not None
        return self.problem.psi.linear

    @cached_property
    def above(self) -> tuple[sp.csr_array, Vector]:
        """H and d of ψ̄(z) = Hz + d; d is +inf in rows without an upper obstacle."""
        if self.problem.upper is None:
            return self.below[0], np.full(self.problem.n, np.inf)
        assert self.problem.upper.linear is not None
        return self.problem.upper.linear

    @property
    def c(self) -> Vector:
        """c of ψ(z) = Gz + c, shape (n,); −inf in rows without an obstacle below."""
        return self.below[1]

    @property
    def d(self) -> Vector:
        """d of ψ̄(z) = Hz + d, shape (n,); +inf in rows without an upper obstacle."""
        return self.above[1]

    @property
    def two_sided(self) -> Mask:
        """The mask of the rows with a lower and an upper obstacle, shape (n,)."""
        return np.isfinite(self.c) & np.isfinite(self.d)

    @cached_property
    def conditions(self) -> Conditions:
        """The complementarity conditions, as in the form "mpec"."""
        G, c = self.below
        H, d = self.above
        below = np.isfinite(c)
        above = np.isfinite(d)
        free = ~(below | above)
        rows = np.concatenate([np.flatnonzero(mask) for mask in (below, above, free)])
        one = sp.eye_array(self.problem.n, format="csr")
        T = sp.vstack([one[below], -sp.diags_array(1.0 * ~below).tocsr()[above], one[free]], format="csr")
        T.eliminate_zeros()
        R = sp.vstack([(one - G)[below], (H - one)[above], one[free]], format="csr")
        b = np.concatenate([-c[below], d[above], np.zeros(int(free.sum()))])
        sizes = tuple(int(mask.sum()) for mask in (below, above, free))
        return Conditions(rows, sizes, T, one[:, below & above][rows], R, b)

    @cached_property
    def parallel(self) -> bool:
        """Whether H = G in every row with two obstacles."""
        conditions = self.conditions
        return abs(conditions.V.T @ conditions.R).sum() == 0.0

    @cached_property
    def _map(self) -> sp.csr_array:
        """M of the gap (Az + q)ᵀ(Mz + m) + vᵀ(d − c): I − G, I − H in rows without ψ, and I in free ones (p_i = 0)."""
        return sp.csr_array(self.conditions.T.T @ self.conditions.R)

    @cached_property
    def curvature(self) -> MatrixClasses:
        """The classes of S = AᵀM + MᵀA, the Hessian of the gap in z: whether it is positive (semi)definite."""
        half = self.problem.A.T @ self._map
        return classify(half + half.T)

    @cached_property
    def bound_at_zero(self) -> ErrorBound:
        """δ with |z*| ≤ δ from the error bound at z = 0, thus independent of the answer under test.

        It is not sharpened: a sharp bound would give |z*| itself away to a solver that is to find it.
        """
        return error_bound(self.problem, np.zeros(self.problem.n), sharp=False)

    @cached_property
    def bounds(self) -> tuple[Vector, Vector, Vector] | None:
        """Bounds on |z*| and |p*|, shape (n,), and on the distances Rz* + b.

        They are δ of `bound_at_zero`, |q| + |A|δ and |R|δ + |b|, enlarged by 1e-9 each, as these sums round. Without δ,
        two constant obstacles in every row bound z; None without these.
        """
        z_max = self.bound_at_zero.componentwise
        margin = 1 + 1e-9
        if z_max is None:
            if not (self.problem.psi.is_constant and self.two_sided.all()):
                return None
            z_max = np.maximum(np.abs(self.c), np.abs(self.d))
        z_max = z_max * margin
        p_max = (np.abs(self.problem.q) + self.problem.matrix.absolute @ z_max) * margin
        return z_max, p_max, (abs(self.conditions.R) @ z_max + np.abs(self.conditions.b)) * margin

    @cached_property
    def unique(self) -> bool:
        """Whether at most one solution is proved to exist: by the certificate, or because S is positive definite.

        For two solutions (p − p′)ᵀ(r − r′) = −pᵀr′ − p′ᵀr ≤ 0, and it equals ½(z − z′)ᵀS(z − z′). In rows with two
        obstacles and H = G, a larger p_i goes with an r_i ∈ [0, d_i − c_i] that is not larger: it is ≤ 0 there, too.
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
        # beyond one rounding of its entries
        if form == "energy" and abs(A - A.T).max() > 4 * UNIT_ROUNDOFF * np.abs(A.data).max():
            return "A is not symmetric"
        if not self.parallel:
            return "psi and upper depend on z in different ways, so that the gap is not convex"
        # solvers accept a QP that only rounding errors make nonconvex
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
        rows = np.isfinite(self.c) | np.isfinite(self.d)
        K = sp.csc_array(sp.eye_array(self.problem.n, format="csr")[rows])
        return QP(sp.csc_array(self.curvature.A / 2), self.problem.q, K, self.c[rows], self.d[rows])

    @cached_property
    def _gap(self) -> QP:
        A = self.problem.A
        q = self.problem.q
        conditions = self.conditions
        T, V, R, b = conditions.T, conditions.V, conditions.R, conditions.b
        below, above, _ = conditions.sizes
        # in rows with two obstacles r ≤ d − c is the constraint s ≥ 0
        distances = np.r_[:below, below + np.flatnonzero(~self.two_sided[conditions.rows[below : below + above]])]
        K = sp.block_array([[T @ A, V], [R[distances], None]], format="csc")
        lower = -np.concatenate([T @ q, b[distances]])
        upper = np.full(lower.size, np.inf)
        upper[below + above : b.size] = lower[below + above : b.size]
        upper[b.size : b.size + below] = self.d[conditions.rows[:below]]
        P = sp.block_diag([self.curvature.A, sp.csc_array((V.shape[1],) * 2)], format="csc")
        return QP(sp.csc_array(P), np.append(self._map.T @ q + A.T @ (T.T @ b), V.T @ b), sp.csc_array(K), lower, upper)


def targets(problem: ProblemData, y: Vector, tangent: bool = False) -> list[Target]:
    """The problems that foreign solvers are to solve: `problem`, its frozen form, both, or none.

    The first is `problem`, where ψ is constant or affine. Unless ψ is constant, the second is the
    problem frozen at the answer under test `y`, shape (n,), in the same units. It needs finite
    obstacles ψ(y) and ψ̄(y) that do not cross. `tangent` says that p is a linearisation.
    """
    problems = [Target(problem, tangent=tangent)] if problem.psi.linear is not None else []
    if not problem.psi.is_constant and np.isfinite(y).all():
        with contextlib.suppress(InputError):  # they are not finite, or cross
            problems.append(Target(problem.frozen(y), frozen=True, tangent=tangent))
    return problems
