"""The data of an implicit complementarity problem: A, q, f and ψ, checked once and then never changed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import HOW_TO_BUILD, InputError, MapError, NotApplicable, check_arguments
from ..numerics.arrays import Vector, as_array, as_number, as_vector, described, not_finite
from ..numerics.labels import check_labels
from .affine import vertical_map
from .facts import Facts
from .friction import FrictionIndex
from .function import Function
from .map import Map
from .matrix import Matrix
from .nonlinear_term import NonlinearTerm
from .point_values import PointValues
from .two_sided import TwoSidedObstacle, as_map
from .user_code import as_function


class ProblemData(PointValues):
    """A, q, f and ψ; evaluates p = Az + q + f(z), r = z − ψ(z), Res_D(z) and their rounding errors at any z.

    `icpmodel.ICP` is this class with the methods that users call.

    Parameters
    ----------
    A, q, psi, upper, f
        See `icpmodel.ICP`.

    Attributes
    ----------
    matrix : Matrix
        A with the facts about it.
    facts : Facts
        The facts about A and ψ.
    psi : Map
        The lower obstacle; a `TwoSidedObstacle` where there is an upper one too.
    upper : Map or None
        The upper obstacle.
    f : NonlinearTerm or None
        The nonlinear part of p; None where p is affine.

    Notes
    -----
    Problems that share A, or A and ψ, share the facts.
    """

    __slots__ = ("__weakref__", "facts")

    facts: Facts

    @check_arguments
    def __init__(self, A: Any, q: Any, psi: Any = 0.0, upper: Any = None, f: Any = None) -> None:
        check_labels({"A": A, "q": q, "psi": psi, "upper": upper, "f": f})
        matrix = Matrix(A, check_labels({"A": A, "q": q}))
        n = matrix.n
        term = None
        if f is not None:
            term = NonlinearTerm(f, n)
            matrix = term.weighted(matrix)
        self._set(matrix, as_vector(q, n, "q"), as_map(psi, n, upper), f=term)

    def _set(
        self, matrix: Matrix, q: Vector, psi: Map, facts: Facts | None = None, f: NonlinearTerm | None = None
    ) -> Self:
        q.flags.writeable = False
        for name, value in (("matrix", matrix), ("q", q), ("psi", psi), ("n", q.size), ("f", f)):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "facts", Facts(matrix, psi) if facts is None else facts)
        return self

    @classmethod
    def of_checked(cls, A: sp.csr_array, q: Vector, psi: Any, row_weights: Vector | None = None) -> Self:
        """The problem of valid arrays, which are made read-only, but neither checked nor copied.

        Parameters
        ----------
        A : CSR array of shape (n, n)
            In the form that the constructor makes.
        q : array of shape (n,)
        psi : Map or array_like
        row_weights : array of shape (n,), optional
            The diagonal of D⁻¹, where A is a part of a larger matrix whose rows determine it.
        """
        return object.__new__(cls)._set(Matrix.of_checked(A, row_weights), q, as_map(psi, q.size))

    @classmethod
    @check_arguments
    def vertical(cls, A: Any, q: Any, B: Any, d: Any) -> Self:
        """The vertical linear complementarity problem of two matrices: min(Az + q, Bz + d) = 0, entry by entry.

        Parameters
        ----------
        A, B : array_like or sparse matrix of shape (n, n)
            The matrices.
        q, d : array_like of shape (n,)
            The vectors; d_i = +inf for a row without a second side, which is the equation p_i = 0.

        Returns
        -------
        ICP
            The problem with ψ(z) = z − D⁻¹(Bz + d), D the diagonal of B.

        Raises
        ------
        InputError
            Where one of them has a wrong shape or is not finite.

        Notes
        -----
        Then r(z) = D⁻¹(Bz + d). The division by D changes no solution, as each row of (B, d) may be
        multiplied by a positive number. It makes ψ_i independent of z_i. Otherwise a step that is
        scaled by the diagonal of A would be wrong by the factor B_ii in rows where r is the smaller. Where
        B_ii ≤ 0, row i of (B, d) is divided by its largest |entry| instead. Each quotient is
        rounded once.

        References
        ----------
        Cottle and Dantzig, J. Combin. Theory 8 (1970), doi:10.1016/S0021-9800(70)80010-2. Sznajder
        and Gowda, Linear Algebra Appl. 223/224 (1995), for when z is unique.

        Examples
        --------
        >>> problem = ICP.vertical([[2, -1], [0, 2]], [-1, 1], [[1, 0], [-2, 4]], [-1, 6])
        >>> z = problem.solve().z
        >>> z, problem.p(z), problem.r(z)
        (array([ 1. , -0.5]), array([1.5, 0. ]), array([0. , 0.5]))
        """
        check_labels({"A": A, "q": q, "B": B, "d": d})
        problem = cls(A, q)
        return problem.with_psi(vertical_map(B, d, problem.n))

    @classmethod
    @check_arguments
    def nonlinear(
        cls,
        F: Callable[[Vector], Any],
        jacobian: Callable[[Vector], Any] | None = None,
        psi: Any = 0.0,
        upper: Any = None,
        *,
        n: int | None = None,
        sparsity: Any = None,
    ) -> Self:
        """The problem of a general p = F(z): the mixed complementarity problem (MCP), with bounds that may move.

        Parameters
        ----------
        F : callable
            z ↦ F(z), both of shape (n,).
        jacobian : callable, optional
            Maps z to F′(z), shape (n, n), dense or sparse. Without it F′ is approximated by differences.
        psi, upper
            The obstacles, see `icpmodel.ICP`; ψ = 0 makes a nonlinear complementarity problem (NCP).
        n : int, optional
            Number of unknowns; needed where neither obstacle is a vector and no `sparsity` is given.
        sparsity : array_like or sparse of shape (n, n), optional
            An entry wherever F_i may depend on z_j. Columns that share no row are differenced together.

        Returns
        -------
        ICP
            The problem with A = 0, q = 0 and f = F.

        Raises
        ------
        InputError
            Where n is not known, and as for `icpmodel.ICP`.

        References
        ----------
        Dirkse and Ferris, Optim. Methods Softw. 5 (1995), doi:10.1080/10556789508805606.

        Examples
        --------
        >>> problem = ICP.nonlinear(lambda z: z**2 - [4, -1], psi=[0, 0])
        >>> problem.solve().z.round(6), problem.p([2, 0])
        (array([2., 0.]), array([0., 1.]))
        """
        as_function(F, "F")
        if jacobian is not None:
            as_function(jacobian, "jacobian")
        known = [np.shape(side)[0] for side in (psi, upper, sparsity) if np.ndim(side)]
        if n is None and not known:
            raise InputError("n is not known, as psi and upper are no vectors; give n, the number of unknowns")
        size = int(as_number(known[0] if n is None else n, "n", minimum=1, whole=True))
        return cls(sp.csr_array((size, size)), np.zeros(size), psi, upper, f=Function(F, jacobian, sparsity=sparsity))

    @classmethod
    @check_arguments
    def from_friction_index(cls, A: Any, b: Any, lo: Any, hi: Any, findex: Any) -> Self:
        """The contact problem of a physics engine: w = Az − b, with bounds on z that depend on the normal impulses.

        Rows with findex −1 have lo_i ≤ z_i ≤ hi_i. Rows of friction, findex[t] = n, have lo_t z_n ≤ z_t ≤ hi_t z_n.
        Within its bounds w_i = 0; w_i ≥ 0 at the lower one, w_i ≤ 0 at the upper one. The ICP has p = w and q = −b.

        Parameters
        ----------
        A : array_like or sparse, shape (n, n)
            The inverse mass seen at the contacts, JM⁻¹Jᵀ.
        b : array_like, shape (n,)
            Minus the velocity at the contacts without impulses: b = −Jv.
        lo, hi : array_like, shape (n,)
            Bounds, ±inf for none; 0 and inf for a normal row. In rows of friction they are coefficients, −μ and μ.
        findex : array_like of int, shape (n,)
            The normal row that bounds each row of friction; −1 in all others.

        Returns
        -------
        ICP
            `contact_state` returns the impulses of a solution, and which contacts slide, stick and separate.

        Raises
        ------
        InputError
            Where a shape, a sign or an index is wrong.

        Notes
        -----
        ODE, Bullet and DART use this form. Two rows of friction at a contact bound |z_t| by μz_n each: a pyramid,
        which allows up to √2 times the friction of Coulomb's cone along its edges.

        References
        ----------
        Smith, Open Dynamics Engine, user guide (2006); Anitescu and Potra, Nonlinear Dynam. 14 (1997),
        doi:10.1023/A:1008292328909, for linearised cones.

        Examples
        --------
        A block of 2 kg is pressed down at 1 m/s and pushed at 3 m/s, with μ = ½: it slides on.

        >>> problem = ICP.from_friction_index(
        ...     np.eye(2) / 2, [1, -3], [0, -0.5], [np.inf, 0.5], [-1, 0]
        ... )
        >>> z = problem.solve().z
        >>> z, problem.p(z)
        (array([ 2., -1.]), array([0. , 2.5]))
        """
        check_labels({"A": A, "b": b, "lo": lo, "hi": hi, "findex": findex})
        problem = cls(A, -as_vector(b, None, "b"))
        if (shape := as_array(findex, "findex").shape) != (problem.n,):
            raise InputError(f"findex has shape {shape}; shape ({problem.n},) was expected")
        return problem.with_psi(FrictionIndex(lo, hi, findex))

    def _with(self, q: Vector, psi: Map, facts: Facts | None = None) -> Self:
        return object.__new__(type(self))._set(self.matrix, q, psi, facts, self.f)

    def with_matrix(self, matrix: Matrix, q: Vector) -> Self:
        """The problem with p = Az + q for a valid `matrix` and `q`; ψ is shared."""
        return object.__new__(type(self))._set(matrix, q, self.psi)

    def dense(self) -> NDArray[np.float64]:
        """A as a dense array, shape (n, n); read-only if A was given as a dense array and n is small.

        Examples
        --------
        >>> ICP([[2.0]], [1.0]).dense()
        array([[2.]])
        """
        return self.A.toarray() if self.matrix.dense is None else self.matrix.dense

    @property
    def nnz(self) -> int:
        """Number of stored entries of A; if A is small and dense, of its nonzero entries.

        Examples
        --------
        >>> ICP(np.eye(3), np.ones(3)).nnz
        3
        """
        return self.matrix.nnz

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"an ICP never changes; make a new one with with_q or with_psi instead of setting {name}")

    def __delattr__(self, name: str) -> None:
        self.__setattr__(name, None)

    def __reduce__(self) -> tuple[Any, ...]:
        arguments: tuple[Any, ...] = (self.A, self.q, self.psi)
        if self.f is not None:
            arguments = (*arguments, None, self.f.map)
        return type(self), arguments, self.matrix.index

    def __setstate__(self, index: Any) -> None:
        self.matrix.index = index

    def with_q(self, q: Any) -> Self:
        """The problem with another `q`, shape (n,); A, ψ, f and the facts about them are shared.

        Examples
        --------
        >>> ICP([[2.0]], [1.0]).with_q([-4.0]).solve().z
        array([2.])
        """
        check_labels({"A": self.matrix, "q": q})
        return self._with(as_vector(q, self.n, "q"), self.psi, self.facts)

    def with_psi(self, psi: Any) -> Self:
        """The problem with another lower obstacle `psi`, in any form that `ICP` takes; the rest is shared.

        Examples
        --------
        >>> ICP([[2.0]], [1.0]).with_psi(-3).solve().z
        array([-0.5])
        """
        return self.with_sides(psi, None if isinstance(psi, TwoSidedObstacle) else self.upper)

    def with_sides(self, psi: Any, upper: Any = None) -> Self:
        """The problem with other obstacles, `psi` and `upper` (None for none); A, q and f are shared.

        Examples
        --------
        >>> ICP([[2.0]], [-8.0]).with_sides(1, 3).solve().z
        array([3.])
        """
        check_labels({"A": self.matrix, "psi": psi, "upper": upper})
        return self._with(self.q, as_map(psi, self.n, upper))

    def with_upper(self, upper: Any) -> Self:
        """The problem with another `upper` obstacle, in any form that `ICP` takes, or None; the rest is shared.

        Examples
        --------
        >>> ICP([[2.0]], [-8.0]).with_upper(3).solve().z
        array([3.])
        """
        return self.with_sides(self.psi.lower if isinstance(self.psi, TwoSidedObstacle) else self.psi, upper)

    def frozen(self, z: Any) -> Self:
        """The ICP with its obstacles fixed at c = ψ(z), and ψ̄(z).

        z solves this problem if and only if it solves the original one. Without upper obstacles
        the result is an LCP in y = z − c.

        Parameters
        ----------
        z : array_like of shape (n,)
            The point.

        Returns
        -------
        ICP
            The problem with constant ψ.

        Raises
        ------
        InputError
            Where the obstacles cross at z by more than rounding; those that cross by less are set equal.

        Examples
        --------
        >>> ICP([[2.0]], [1.0], psi=lambda z: 0.5 * z - 1).frozen([-2.0])
        ICP(n=1, nnz=1, psi=Constant(-2))
        """
        z = self.vector(z)
        psi = self.psi.value(z)
        if self.upper is None:
            return self.with_psi(psi)
        upper = self.upper.value(z)
        touch = (psi > upper) & (psi - upper <= 2.0 * self.rounding(z)[1])
        return self.with_sides(psi, np.where(touch, psi, upper))

    def linearised(self, z: Any) -> Self:
        """The problem with p replaced by its tangent at z: A + f′(z) and q + f(z) − f′(z)z; itself where p is affine.

        p(z) and r(z) are unchanged. So z solves this problem if and only if it solves the original
        one.

        Parameters
        ----------
        z : array_like of shape (n,) or Solution
            The point.

        Returns
        -------
        ICP
            The problem with affine p.

        Raises
        ------
        MapError
            Where f or its derivative fails at z.

        References
        ----------
        Josephy, MRC report 1965, Wisconsin (1979).

        Examples
        --------
        >>> tangent = ICP([[1.0]], [-6.0], f=lambda z: z**2).linearised([2.0])
        >>> tangent.dense().round(6), tangent.q.round(6)
        (array([[5.]]), array([-10.]))
        """
        z = self.vector(z, finite=self.f is not None)
        if self.f is None:
            return self
        matrix, slope_times_z = self.f.tangent(self.matrix, z)
        offset = self.offset(z) - slope_times_z
        if fault := not_finite(offset, "q + f(z) - f'(z)z"):
            raise MapError(f"{fault}; a finite number was expected")
        return self.with_matrix(matrix, offset)

    @property
    def is_lcp(self) -> bool:
        """Whether p is affine, ψ constant and the only obstacle, so that y = z − c solves an ordinary LCP.

        Examples
        --------
        >>> ICP([[2.0]], [1.0], psi=3).is_lcp
        True
        """
        return self.psi.is_constant and self.upper is None and self.f is None

    def __repr__(self) -> str:
        psi = self.psi
        upper = ""
        if isinstance(psi, TwoSidedObstacle):
            upper = f", upper={psi.upper!r}"
            psi = psi.lower
        f = "" if self.f is None else f", f={self.f!r}"
        return f"ICP(n={self.n}, nnz={self.A.nnz}, psi={psi!r}{upper}{f})"


class Holder(Protocol):
    """An object with a problem, such as a scene, a solution, or a Pyomo model that was read."""

    @property
    def problem(self) -> ProblemData: ...


class Model(Protocol):
    """An object that makes a problem on request, because its parameters may have changed."""

    def icp(self) -> ProblemData: ...


#: the type of the argument `problem` of `solve`, `explain` and the like
ProblemLike = ProblemData | Holder | Model


#: the message of the error where p must be affine
NONLINEAR = (
    "p(z) = Az + q + f(z) is nonlinear, and affine p = Az + q was expected: give problem.linearised(z), "
    "with p's tangent at a z, such as that of problem.solve()"
)


def as_problem(problem: ProblemLike, *, nonlinear: bool = False) -> ProblemData:
    """Return `problem` if it is an ICP, else the ICP that it holds or makes.

    Raises
    ------
    InputError
        For anything else.
    NotApplicable
        Where p is nonlinear, unless `nonlinear` is true.
    """
    if isinstance(problem, str):
        raise InputError(f"problem is {problem!r}; an ICP was expected: icpmodel.scenes.scene makes a scene of a name")
    data: Any = problem
    if not isinstance(problem, ProblemData):
        make = getattr(problem, "icp", None)
        data = make() if callable(make) else getattr(problem, "problem", None)
    if not isinstance(data, ProblemData):
        expected = "an ICP, or what holds one such as a scene, was expected"
        if isinstance(problem, list | tuple) or hasattr(problem, "shape"):
            expected = f"{expected}{HOW_TO_BUILD}"
        raise InputError(f"problem is {described(problem)}; {expected}")
    if data.f is not None and not nonlinear:
        raise NotApplicable(NONLINEAR)
    return data
