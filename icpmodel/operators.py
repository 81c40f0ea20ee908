"""The operators X⁻¹, X = M₁ + φ + Ω, and the step of the modulus family that each makes possible.

By |x − y| = x + y − 2 min(x, y) every method of the family is the one step

    z⁺ = z − 2 X⁻¹ F_Ω(z),        F_Ω(z) = min(Az + q, Ω(z − ψ(z))),

so a method is nothing but a choice of X and Ω. `Operator.step` is that line; the triangular and diagonal operators fuse
it into one compiled pass over A.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .arrays import Vector, diagonal_positions
from .errors import SingularOperator
from .maps import Affine, Constant, Elementwise, is_compiled, raising_map_error
from .problem import ICP, UNIT_ROUNDOFF

#: entries that stay in a core's cache while a second sweep follows the first
_NEAR = 50_000
#: z ↦ (z⁺, Res(z) or None where it does not fall out of the step)
Step = Callable[[Vector], tuple[Vector, float | None]]


class Rows(NamedTuple):
    """What the sweeps and the choice of a method ask of the rows of A, as `rows_of` finds it.

    `diag` where in A.data each diagonal entry stands; `diagonal`; `rest` = Σ_{j≠i}|a_ij|, all of shape (n,); how far
    the entries reach `below` the diagonal and `above` it.

    >>> rows_of(ICP([[2.0, -1.0], [0.0, 3.0]], [0.0, 0.0])).rest
    array([1., 0.])
    """

    diag: Any
    diagonal: Vector
    rest: Vector
    below: int
    above: int


def rows_of(problem: ICP) -> Rows:
    """The rows of A, looked at in one pass, once for all problems with this A.

    >>> rows_of(ICP([[2.0, -1.0], [0.0, 3.0]], [0.0, 0.0])).diagonal
    array([2., 3.])
    """

    def look() -> Rows:
        from .kernels.rows import look  # loads numba

        A = problem.A
        rows = Rows(*look(A.indptr, A.indices, A.data))
        for array in rows[:3]:
            array.flags.writeable = False
        return rows

    found: Rows = problem.remembered("rows", look)
    return found


class Operator(ABC):
    """X⁻¹ of a splitting.

    >>> DiagonalOperator(np.array([0.5])).solve(np.array([4.0]))
    array([2.])
    """

    @abstractmethod
    def solve(self, f: Vector) -> Vector:
        """X⁻¹f, shape (n,).

        >>> DiagonalOperator(np.array([0.5])).solve(np.array([4.0]))
        array([2.])
        """

    def step(self, problem: ICP, omega: Vector) -> Step:
        """The modulus step z ↦ (z − 2 X⁻¹ F_Ω(z), Res(z)) on `problem` with Ω = diag(`omega`).

        >>> step = DiagonalOperator(np.array([0.25])).step(ICP([[2.0]], [-2.0]), np.array([2.0]))
        >>> step(np.array([3.0]))
        (array([1.]), 3.0)
        """

        def step(z: Vector) -> tuple[Vector, float]:
            p, r = problem.A @ z + problem.q, z - problem.psi.value(z)
            residual = float(np.linalg.norm(np.minimum(p, r)))
            return z - 2.0 * self.solve(np.minimum(p, omega * r)), residual

        return step


@dataclass(frozen=True)
class DiagonalOperator(Operator):
    """X = diag(1/`inverse`), `inverse` of shape (n,).

    >>> DiagonalOperator(np.array([0.5])).solve(np.array([4.0]))
    array([2.])
    """

    inverse: Vector

    def solve(self, f: Vector) -> Vector:
        """See `Operator.solve`."""
        return self.inverse * f

    def step(self, problem: ICP, omega: Vector) -> Step:
        """See `Operator.step`."""
        A = problem.A
        return compiled_step(problem, "diagonal", (A.indptr, A.indices, A.data, problem.q), (omega, self.inverse))


@dataclass(frozen=True)
class AOROperator(Operator):
    """X = diag(1/`inverse`) + `tau` times the strict lower triangle of `A`.

    >>> A = sp.csr_array([[4.0, -1.0], [-2.0, 4.0]])
    >>> AOROperator(np.array([0.25, 0.25]), A, 1.0).solve(np.array([4.0, 2.0]))
    array([1., 1.])
    """

    inverse: Vector
    A: sp.csr_array
    tau: float

    @cached_property
    def diag(self) -> Any:
        """Where in `A.data` each row's diagonal entry stands, shape (n,).

        >>> AOROperator(np.ones(1), sp.csr_array([[4.0]]), 1.0).diag.tolist()
        [0]
        """
        return diagonal_positions(self.A)

    def solve(self, f: Vector) -> Vector:
        """See `Operator.solve`."""
        from .kernels.sweeps import substitute

        A, out = self.A, np.empty(f.size)
        substitute(A.indptr, self.diag, A.indices, A.data, self.tau, self.inverse, True, f, out)
        return out

    def step(self, problem: ICP, omega: Vector) -> Step:
        """See `Operator.step`."""
        A, rows = problem.A, rows_of(problem)
        matrix = (A.indptr, A.indices, A.data, rows.diag if self.A is A else self.diag, problem.q)
        known, below = np.zeros(1, dtype=np.bool_), np.empty(problem.n)
        after = (omega, self.inverse, self.tau, known, below)
        two: Callable[..., tuple[float, float]] | None = None
        if isinstance(problem.psi, Constant) and rows.above * (A.nnz / problem.n + 4) <= _NEAR:
            from .kernels.sweeps import SWEEPS

            two = partial(SWEEPS.two_aor, *matrix, problem.psi.c, *after, rows.above)
        return _with_memory(compiled_step(problem, "aor", matrix, after), two, known)


@dataclass(frozen=True)
class TriangularOperator(Operator):
    """X = diag(1/`inverse`) + the strict lower (or upper) triangle of `M1`, whose diagonal stands at `diag`.

    >>> M1 = sp.csr_array([[4.0, -1.0], [0.0, 4.0]])
    >>> TriangularOperator(np.array([0.25, 0.25]), M1, np.array([0, 2]), lower=False).solve(np.array([3.0, 4.0]))
    array([1., 1.])
    """

    inverse: Vector
    M1: sp.csr_array
    diag: Any
    lower: bool

    @property
    def _rows(self) -> tuple[Any, Any]:
        """Where each row's strictly triangular entries begin and end."""
        return (self.M1.indptr[:-1], self.diag) if self.lower else (self.diag + 1, self.M1.indptr[1:])

    def solve(self, f: Vector) -> Vector:
        """See `Operator.solve`."""
        from .kernels.sweeps import substitute

        out = np.empty(f.size)
        substitute(*self._rows, self.M1.indices, self.M1.data, 1.0, self.inverse, self.lower, f, out)
        return out

    def step(self, problem: ICP, omega: Vector) -> Step:
        """See `Operator.step`."""
        A, M1 = problem.A, self.M1
        X = (*self._rows, M1.indices, M1.data, self.inverse, self.lower)
        return compiled_step(problem, "triangular", (A.indptr, A.indices, A.data, problem.q), (omega, *X))


class FactorisedOperator(Operator):
    """X⁻¹ by a sparse LU factorisation of the CSR matrix `X`, made once.

    Raises SingularOperator where X is singular to working precision.

    >>> FactorisedOperator(sp.csr_array([[2.0, 1.0], [1.0, 2.0]])).solve(np.array([3.0, 3.0]))
    array([1., 1.])
    """

    def __init__(self, X: sp.csr_array) -> None:
        X = sp.csr_array(X)
        size = _row_maxima(X)
        if not size.all():
            row = int(np.argmin(size))
            raise SingularOperator(f"X = M1 + phi + Omega is singular: row {row} is zero", row)
        # rows and columns are brought to the size 1, so that units do not look like singularity
        self._row_scale = 1.0 / np.maximum(size, np.finfo(np.float64).tiny)
        scaled = sp.csr_array(sp.diags_array(self._row_scale) @ X)
        size = _row_maxima(sp.csr_array(scaled.T))
        self._column_scale = 1.0 / np.where(size > np.finfo(np.float64).tiny, size, 1.0)
        scaled = sp.csr_array(scaled @ sp.diags_array(self._column_scale))
        self._lu = factorise(scaled)
        if self._lu is not None:
            pivots = np.abs(self._lu.U.diagonal())
            if pivots.min() > 16 * UNIT_ROUNDOFF * pivots.max():
                return
        row = _dependent_row(scaled)
        raise SingularOperator(
            f"X = M1 + phi + Omega is singular to working precision: row {row} is a linear combination of the others; "
            "change phi or phi2",
            row,
        )

    def solve(self, f: Vector) -> Vector:
        """See `Operator.solve`."""
        solution: Vector = self._column_scale * self._lu.solve(self._row_scale * f)
        return solution


def factorise(matrix: sp.csr_array) -> Any:
    """SuperLU of a sparse matrix (n × n), ordered for its pattern; None where a pivot is exactly zero.

    >>> factorise(sp.csr_array([[0.0]])) is None
    True
    """
    from scipy.sparse.linalg import splu

    columns = sp.csc_array(matrix)
    pattern = sp.csr_array((np.ones(matrix.nnz), matrix.indices, matrix.indptr), shape=matrix.shape)
    symmetric = (pattern != pattern.T).nnz == 0
    # threshold pivoting keeps the fill of the symmetric ordering where the diagonal is not small
    options: dict[str, Any] = (
        {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.1} if symmetric else {"permc_spec": "COLAMD"}
    )
    try:
        return splu(columns, **options)
    except RuntimeError as error:
        if "singular" not in str(error):
            raise
        return None


def ruge_stuben(A: sp.csr_array, **options: Any) -> Any:
    """PyAMG's algebraic multigrid hierarchy of `A` (CSR, shape (n, n)), with the `options` of its Ruge–Stüben solver.

    Reference: Ruge and Stüben, Algebraic multigrid (1987).

    >>> len(ruge_stuben(sp.csr_array([[2.0]])).levels)
    1
    """
    import pyamg

    with quiet():
        return pyamg.ruge_stuben_solver(sp.csr_matrix(A), **options)  # PyAMG takes the older class only


@contextmanager
def quiet() -> Iterator[None]:
    """What PyAMG warns of, matrices that are nothing for it above all, its callers see by the result.

    >>> with quiet():
    ...     np.ones(1) / np.zeros(1)
    array([inf])
    """
    # recorded, and dropped: PyAMG switches some of its warnings on again while it runs
    with np.errstate(all="ignore"), warnings.catch_warnings(record=True):
        warnings.simplefilter("ignore")
        yield


def compiled_step(problem: ICP, name: str, before: tuple[Any, ...], after: tuple[Any, ...]) -> Step:
    """One compiled sweep as a step: `before` and `after` are the kernel's arguments around ψ.

    ψ = constant, affine and compiled elementwise maps are evaluated inside the sweep; any other is called once for it.

    >>> problem = ICP([[2.0]], [-2.0])
    >>> matrix = (problem.A.indptr, problem.A.indices, problem.A.data, problem.q)
    >>> compiled_step(problem, "diagonal", matrix, (np.array([2.0]), np.array([0.25])))(np.array([3.0]))
    (array([1.]), 3.0)
    """
    from .kernels.sweeps import SWEEPS, USER_SWEEPS

    psi = problem.psi
    inside: Any = None
    if isinstance(psi, Constant):
        inside = psi.c
    elif isinstance(psi, Affine):
        inside = (psi.c, psi.G.indptr, psi.G.indices, psi.G.data)
    elif isinstance(psi, Elementwise) and is_compiled(psi.f):
        inside = (psi.c, psi.f)
    user = isinstance(psi, Elementwise) and inside is not None
    sweep = getattr(USER_SWEEPS if user else SWEEPS, name)

    def step(z: Vector) -> tuple[Vector, float]:
        out = np.empty(z.size)
        squares = sweep(*before, psi.value(z) if inside is None else inside, *after, z, out)
        return out, float(np.sqrt(squares))

    if not user:
        return step
    # the sweep calls the user's compiled function, which may raise
    return lambda z: raising_map_error(lambda: step(z), "psi.f")


def _with_memory(single: Step, two: Callable[..., tuple[float, float]] | None, known: NDArray[np.bool_]) -> Step:
    """`single`, which knows the sums over the lower triangle where z is its own last answer, and says so in `known`.

    Where there is `two`, it looks one step ahead, which costs little; once a z other than its own comes, no longer.
    """
    last: Vector | None = None
    ahead: tuple[Vector, Vector, float] | None = None

    def step(z: Vector) -> tuple[Vector, float | None]:
        nonlocal last, ahead, two
        if ahead is not None:
            came, following, residual = ahead
            ahead = None
            if z is came:
                return following, residual
            two = None
        known[0], last = z is last, None  # a sweep that raises leaves no sums behind
        if two is None:
            last, hint = single(z)
            return last, hint
        one, last = np.empty(z.size), np.empty(z.size)
        squares = np.sqrt(two(z, one, last))
        ahead = one, last, float(squares[1])
        return one, float(squares[0])

    return step


def inverse_diagonal(diagonal: Vector, shift: Vector) -> Vector:
    """1/(`diagonal` + `shift`), both of shape (n,). Raises SingularOperator where the sum cancels.

    >>> inverse_diagonal(np.array([1.0]), np.array([1.0]))
    array([0.5])
    """
    total = diagonal + shift
    if diagonal.min() > 0.0 and shift.min() >= 0.0:  # nothing cancels
        return np.divide(1.0, total, out=total)
    bad = np.abs(total) <= 4 * UNIT_ROUNDOFF * (np.abs(diagonal) + np.abs(shift))
    if bad.any():
        row = int(np.argmax(bad))
        raise SingularOperator(
            f"X = M1 + phi + Omega is singular: its diagonal entry in row {row} is {total[row]:g} "
            f"({diagonal[row]:g} from M1, {shift[row]:g} from phi + Omega); change phi or phi2",
            row,
        )
    inverse: Vector = 1.0 / total
    return inverse


def _row_maxima(X: sp.csr_array) -> Vector:
    return np.asarray(abs(X).max(axis=1).toarray(), dtype=np.float64).reshape(-1)


def _dependent_row(X: sp.csr_array) -> int:
    """The largest entry of a left null vector of X, by two steps of inverse iteration on a slightly shifted X."""
    lu = factorise(sp.csr_array(X + 1e-10 * sp.eye_array(X.shape[0])))
    if lu is None:
        return 0
    # a start without symmetries, which could be orthogonal to the null vector
    y = lu.solve(lu.solve(np.random.default_rng(0).random(X.shape[0]), trans="T"), trans="T")
    return int(np.argmax(np.abs(y)))
