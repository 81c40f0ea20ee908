"""The implicit complementarity problem: A, q and ψ, checked once and then never changed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .arrays import Vector, as_array, as_csr, as_square, as_vector, described, freeze, norm, not_finite
from .errors import InputError
from .maps import Constant, Map, as_map
from .threads import in_parts, threads_for

if TYPE_CHECKING:
    from .crosscheck.report import Report
    from .explain import Explanation
    from .methods import Method
    from .solution import Solution

#: unit roundoff of float64
UNIT_ROUNDOFF = 2.0**-53
#: the smallest positive float64, the most that underflow can cost one operation
SMALLEST = 2.0**-1074
#: a dense A of so many rows stays dense until its sparse form is asked for
_SMALL = 64
#: what is remembered of A alone
_OF_A = ("absolute", "hardly dominant", "jacobi radius", "rows")


class _Matrix:
    """A, `small` where it was handed in as a dense array with few rows; then `sparse` is made when it is asked for."""

    def __init__(self, A: Any) -> None:
        square = None if sp.issparse(A) else as_square(A, "A")
        self.small = square if square is not None and len(square) <= _SMALL else None
        if self.small is None:
            self.sparse = as_csr(A if square is None else square, "A", keep_diagonal=True)
        self.n = (self.sparse if self.small is None else self.small).shape[0]

    @cached_property
    def sparse(self) -> sp.csr_array:
        return as_csr(self.small, "A", keep_diagonal=True)


class ICP:
    """Find z with p = Az + q ≥ 0, r = z − ψ(z) ≥ 0 and pᵀr = 0.

    Parameters: `A` dense array-like or any SciPy sparse matrix, shape (n, n); `q` array-like, shape (n,); `psi` a
    number, a vector of shape (n,) (−inf: no obstacle in that row), an `Affine`, `Elementwise`, `Function` or
    `Intervention` map, or any callable z ↦ ψ(z). ψ = 0 is the linear complementarity problem (LCP).
    The data is copied: A becomes float64 CSR with every diagonal entry stored. An ICP never changes; `with_q` and
    `with_psi` make new ones that share the rest.
    Raises InputError where A, q or ψ has a wrong shape, is empty, complex or not finite.
    Reference: Kumar, Deepmala and Das, More on modulus based iterative method for solving implicit complementarity
    problem; Bensoussan and Lions (1973).

    >>> problem = ICP([[2, -1], [-1, 2]], [-1, 3])
    >>> problem.solve().z.round(6) + 0.0
    array([0.5, 0. ])
    >>> problem
    ICP(n=2, nnz=4, psi=Constant(0))
    """

    __slots__ = ("_matrix", "_memory", "n", "psi", "q")

    q: Vector
    psi: Map
    n: int
    _matrix: _Matrix
    #: what was found out about A and ψ (not q), kept for the problems that share them; see `remembered`
    _memory: dict[str, Any]

    def __init__(self, A: Any, q: Any, psi: Any = 0.0) -> None:
        matrix = _Matrix(A)
        n = matrix.n
        self._set(matrix, as_vector(q, n if np.ndim(q) else None, "q"), as_map(psi, n), {})

    def _set(self, matrix: _Matrix, q: Vector, psi: Map, memory: dict[str, Any]) -> None:
        q.flags.writeable = False
        for name, value in (("_matrix", matrix), ("q", q), ("psi", psi), ("n", q.size), ("_memory", memory)):
            object.__setattr__(self, name, value)

    @property
    def A(self) -> sp.csr_array:
        """A, CSR, shape (n, n), read-only; a small dense one is compressed when it is first asked for.

        >>> ICP([[2.0]], [1.0]).A.nnz
        1
        """
        return self._matrix.sparse

    def dense(self) -> NDArray[np.float64]:
        """A as a dense array, shape (n, n), read-only where it was handed in as one and n is small.

        >>> ICP([[2.0]], [1.0]).dense()
        array([[2.]])
        """
        return self.A.toarray() if self._matrix.small is None else self._matrix.small

    @property
    def nnz(self) -> int:
        """How many entries of A are stored, or not 0 where A is small and dense.

        >>> ICP(np.eye(3), np.ones(3)).nnz
        3
        """
        return self.A.nnz if self._matrix.small is None else int(np.count_nonzero(self._matrix.small))

    def product(self, z: Vector) -> Vector:
        """Az, shape (n,), for z of that shape.

        >>> ICP([[2.0]], [1.0]).product(np.array([3.0]))
        array([6.])
        """
        if self._matrix.small is not None:
            image: Vector = self._matrix.small @ z
            return image
        A, threads = self.A, threads_for(self.A.nnz)
        if threads == 1:
            return np.asarray(A @ z)
        from .kernels.rows import product  # loads numba

        image, z = np.empty(self.n), np.ascontiguousarray(z)
        in_parts(self.n, threads, lambda low, high: product(A.indptr, A.indices, A.data, z, low, high, image))
        return image

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"an ICP never changes; make a new one with with_q or with_psi instead of setting {name}")

    def __delattr__(self, name: str) -> None:
        self.__setattr__(name, None)

    def __reduce__(self) -> tuple[Any, ...]:
        return ICP, (self.A, self.q, self.psi)

    def with_q(self, q: Any) -> ICP:
        """The problem with another `q`, shape (n,); A, ψ and what is known of them are shared.

        >>> ICP([[2.0]], [1.0]).with_q([-4.0]).solve().z
        array([2.])
        """
        return self._with(as_vector(q, self.n if np.ndim(q) else None, "q"), self.psi, self._memory)

    def with_psi(self, psi: Any) -> ICP:
        """The problem with another `psi` (anything that `ICP` takes); A and q are shared.

        >>> ICP([[2.0]], [1.0]).with_psi(-3).solve().z
        array([-0.5])
        """
        of_A = {name: self._memory[name] for name in _OF_A if name in self._memory}
        return self._with(self.q, as_map(psi, self.n), of_A)

    def _with(self, q: Vector, psi: Map, memory: dict[str, Any]) -> ICP:
        new = object.__new__(ICP)
        new._set(self._matrix, q, psi, memory)
        return new

    @classmethod
    def _made(cls, A: sp.csr_array, q: Vector, psi: Any) -> ICP:
        """The problem of an `A` that is known to be as the constructor would leave it, and is not copied."""
        new, matrix = object.__new__(cls), object.__new__(_Matrix)
        matrix.small, matrix.sparse, matrix.n = None, freeze(A), q.size
        new._set(matrix, q, as_map(psi, q.size), {})
        return new

    def frozen(self, z: Any) -> ICP:
        """The ICP with its obstacle held at c = ψ(z): an LCP in y = z − c. z solves the one iff it solves the other.

        Parameters: `z` shape (n,). Returns the problem with constant ψ.

        >>> ICP([[2.0]], [1.0], psi=lambda z: 0.5 * z - 1).frozen([-2.0])
        ICP(n=1, nnz=1, psi=Constant(-2))
        """
        return self.with_psi(self.psi.value(self.vector(z)))

    def vector(self, z: Any, name: str = "z", *, finite: bool = False) -> Vector:
        """`z` as a float64 vector of shape (n,), of a `Solution` its z; NaN and infinities pass unless `finite`.

        Every method and function that takes a z takes it through here. Raises InputError for anything else.

        >>> ICP([[2.0]], [1.0]).vector([1, 2])
        Traceback (most recent call last):
        icpmodel.errors.InputError: z has shape (2,); shape (1,) was expected
        """
        array = as_array(getattr(z, "z", z), name)
        if not finite and array.dtype == np.float64 and array.shape == (self.n,):
            return array
        if array.shape != (self.n,):
            raise InputError(f"{name} has shape {array.shape}; shape ({self.n},) was expected")
        if array.dtype.kind not in "biuf":
            raise InputError(f"{name} has dtype {array.dtype}; real numbers were expected")
        vector: Vector = np.asarray(array, dtype=np.float64)
        if finite and (fault := not_finite(vector, name)):
            raise InputError(f"{fault}; a finite number was expected")
        return vector

    def p(self, z: Any) -> Vector:
        """p(z) = Az + q, shape (n,).

        >>> ICP([[2.0]], [1.0]).p([3.0])
        array([7.])
        """
        return self.product(self.vector(z)) + self.q

    def r(self, z: Any) -> Vector:
        """r(z) = z − ψ(z), shape (n,); +inf where there is no obstacle.

        >>> ICP([[2.0]], [1.0], psi=-1).r([3.0])
        array([4.])
        """
        z = self.vector(z)
        return z - self.psi.value(z)

    def natural_map(self, z: Any, omega: Any = 1.0) -> Vector:
        """F_Ω(z) = min(Az + q, Ω(z − ψ(z))), shape (n,): zero exactly at the solutions, for every Ω > 0.

        Parameters: `z` shape (n,); `omega` the diagonal of Ω, a positive number or vector of shape (n,).
        Raises InputError where it is not positive.

        >>> ICP([[2.0]], [-1.0]).natural_map([3.0], omega=0.5)
        array([1.5])
        """
        if not np.all(np.asarray(omega) > 0):
            raise InputError(f"omega has the entry {np.min(omega)}; positive numbers were expected")
        with np.errstate(over="ignore", invalid="ignore"):
            return np.minimum(self.p(z), omega * self.r(z))

    def residual(self, z: Any) -> float:
        """Res(z) = ‖min(r(z), p(z))‖₂, the natural residual; safe against overflow, NaN where z or ψ(z) is.

        >>> ICP([[3.0]], [-6.0]).residual([1.0])
        3.0
        """
        z = self.vector(z)
        with np.errstate(over="ignore", invalid="ignore"):
            psi = self.psi.value(z)
            if self._is_large() and 1e-280 < (squares := self._squares(z, psi)) < 1e280:
                return math.sqrt(squares)
            return norm(np.minimum(self.product(z) + self.q, z - psi))

    def residual_at_0(self) -> float:
        """Res(0) = ‖min(−ψ(0), q)‖₂, by which residuals are judged, without a product with A.

        >>> ICP([[3.0]], [-6.0]).residual_at_0()
        6.0
        """
        with np.errstate(over="ignore", invalid="ignore"):
            psi = self.psi.value(np.zeros(self.n))
            if self._is_large():
                from .kernels.rows import natural_at_0  # loads numba

                if 1e-280 < (squares := float(natural_at_0(self.q, np.ascontiguousarray(psi)))) < 1e280:
                    return math.sqrt(squares)
            return norm(np.minimum(self.q, -psi))

    def _is_large(self) -> bool:
        return self._matrix.small is None and threads_for(self.A.nnz) > 1

    def _squares(self, z: Vector, psi: Vector) -> float:
        """Res(z)², without care for overflow, in one pass over A on all cores."""
        from .kernels.rows import natural  # loads numba

        A, z, psi = self.A, np.ascontiguousarray(z), np.ascontiguousarray(psi)
        given = (A.indptr, A.indices, A.data, self.q, psi, z)
        return float(sum(in_parts(self.n, threads_for(A.nnz), lambda low, high: natural(*given, low, high))))

    def rounding(self, z: Any) -> tuple[Vector, Vector]:
        """Bounds on the rounding errors of p(z) and of r(z) as computed, entry by entry, both of shape (n,).

        γ_k(|A||z| + |q|) for p and γ_k(|z| + G|z| + |ψ(z)|) for r, 0 where r is infinite, with
        γ_k = ku/(1 − ku), u = 2⁻⁵³ and k two more than the entries of the row, and k·2⁻¹⁰⁷⁴ for underflow. ψ itself is
        taken as exact to a few u, which holds for constant and affine maps.
        Reference: Higham, Accuracy and Stability of Numerical Algorithms (2002), section 3.5.

        >>> for_p, for_r = ICP([[3.0]], [-6.0]).rounding([2.0])
        >>> bool(0 < for_p[0] < 1e-14), bool(0 < for_r[0] < 1e-14)
        (True, True)
        """
        z = self.vector(z)
        with np.errstate(over="ignore", invalid="ignore"):
            psi = self.psi.value(z)
            free = np.isneginf(psi)
            terms = np.diff(self.A.indptr) + 2
            for_p = _gamma(terms) * (self.absolute_A() @ np.abs(z) + np.abs(self.q)) + terms * SMALLEST
            size = np.abs(z) + np.where(free, 0.0, np.abs(psi))
            entries: Any = 3
            if self.psi.lipschitz is not None and self.psi.lipschitz.nnz:
                size = size + self.psi.lipschitz @ np.abs(z)
                entries = np.diff(self.psi.lipschitz.indptr) + 3
            return for_p, np.where(free, 0.0, _gamma(entries) * size + entries * SMALLEST)

    def absolute_A(self) -> sp.csr_array:
        """|A|, entry by entry; it shares the index arrays of A.

        >>> ICP([[-2.0]], [1.0]).absolute_A().toarray()
        array([[2.]])
        """

        def absolute() -> sp.csr_array:
            return sp.csr_array((np.abs(self.A.data), self.A.indices, self.A.indptr), shape=self.A.shape)

        return self.remembered("absolute", absolute)

    def remembered(self, name: str, make: Callable[[], Any]) -> Any:
        """What `make` returns, a fact about A and ψ alone, made once for all problems that share the two.

        >>> problem = ICP([[2.0]], [1.0])
        >>> problem.remembered("trace", lambda: 2.0), problem.with_q([3.0]).remembered("trace", lambda: None)
        (2.0, 2.0)
        """
        if name not in self._memory:
            self._memory[name] = make()
        return self._memory[name]

    @property
    def is_lcp(self) -> bool:
        """Whether ψ is constant, so that y = z − c solves an ordinary LCP.

        >>> ICP([[2.0]], [1.0], psi=3).is_lcp
        True
        """
        return isinstance(self.psi, Constant)

    def solve(self, method: str | Method | None = None, **options: Any) -> Solution:
        """Solve it; `icpmodel.driver.solve` says what `method` and the options are.

        >>> ICP([[2.0]], [-1.0]).solve("mnmgs").z
        array([0.5])
        """
        from .driver import solve

        return solve(self, method, **options)

    def crosscheck(
        self,
        solution: Any = None,
        solvers: Iterable[str] | None = None,
        *,
        atol: float | None = None,
        time_limit: float = 60.0,
        progress: bool = False,
    ) -> Report:
        """Have independent solvers check an answer; `icpmodel.crosscheck.crosscheck` says how.

        >>> ICP([[2.0]], [-1.0]).crosscheck(solvers=["osqp"]).agrees
        True
        """
        from .crosscheck import crosscheck

        return crosscheck(self, solution, solvers, atol=atol, time_limit=time_limit, progress=progress)

    def explain(self, method: str | Method | None = None, *, accuracy: float = 1e-6, **options: Any) -> Explanation:
        """What is certain before a solve; `icpmodel.explain.explain` says how.

        >>> ICP([[2.0]], [-1.0]).explain().bound.unique
        True
        """
        from .explain import explain

        return explain(self, method, accuracy=accuracy, **options)

    def to_pyomo(self) -> Any:
        """The problem as a Pyomo model; `icpmodel.modelling.pyomo_writer.to_pyomo` says how.

        >>> len(ICP([[2.0]], [-1.0]).to_pyomo().complementarity)
        1
        """
        from .modelling.pyomo_writer import to_pyomo

        return to_pyomo(self)

    def to_cvxpy(self, formulation: str = "qp") -> Any:
        """The problem as a CVXPY problem, "qp" or "mip"; `icpmodel.modelling.cvxpy_writer.to_cvxpy` says how.

        >>> model = ICP([[2.0]], [-1.0]).to_cvxpy()
        >>> float(model.solve(solver="CLARABEL").round(6)), model.var_dict["z"].value.round(6)
        (-0.25, array([0.5]))
        """
        from .modelling.cvxpy_writer import to_cvxpy

        return to_cvxpy(self, formulation)

    def __repr__(self) -> str:
        return f"ICP(n={self.n}, nnz={self.A.nnz}, psi={self.psi!r})"


def as_icp(problem: Any) -> ICP:
    """`problem`, which must be an ICP. Raises InputError.

    >>> as_icp(np.eye(2))
    Traceback (most recent call last):
    icpmodel.errors.InputError: problem is a ndarray; an ICP was expected
    """
    if not isinstance(problem, ICP):
        raise InputError(f"problem is {described(problem)}; an ICP was expected")
    return problem


def _gamma(k: Any) -> Any:
    return k * UNIT_ROUNDOFF / (1 - k * UNIT_ROUNDOFF)
