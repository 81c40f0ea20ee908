"""The problem on ranks: A is PETSc's, and each rank holds its own rows, those that PETSc gives it, of A, q and ψ."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np

from ..errors import InputError, check_arguments
from ..numerics.arrays import Vector, as_array, as_float64, as_number, described
from ..numerics.rounding import SMALLEST, gamma
from ..present.display import Displayable
from ..problem.affine import Affine, Constant
from ..problem.by_rows import ByRows
from ..problem.data import ProblemData, as_problem
from ..problem.elementwise import Elementwise
from ..problem.two_sided import sides_of
from .distributed_map import DistributedMap
from .distributed_matrix import DistributedMatrix, check_aij, check_counts, from_rows
from .evaluation import Evaluation
from .ranks import count, petsc, together, world


class DistributedICP(Displayable):
    """An ICP on the ranks of a communicator: p = Az + q ≥ 0, r = z − ψ(z) ≥ 0, pᵀr = 0, or one with ψ ≤ z ≤ ψ̄.

    It is collective: every rank makes it at the same time, with its own part of each argument. So
    are all functions of `icpmodel.distributed`.

    Parameters
    ----------
    A : Mat of shape (n, n)
        An assembled PETSc matrix (aij) with its columns distributed as its rows. It is not copied:
        leave it as it is.
    q : Vec, float or array of the own rows
        A `Vec` has the layout of A.
    psi : float, Vec, array of the own rows, Elementwise or pair, default 0
        The obstacle below; −inf for none. An `icpmodel.Elementwise` map of the own rows needs a
        `lipschitz` < 1. A pair (`Mat`, any of these) stands for ψ(z) = Gz + f(z).
    upper : optional
        The same for the upper obstacle, or None.

    Raises
    ------
    InputError
        On all ranks, where one finds its part wrong.
    NotApplicable
        Where an obstacle depends on z and its `lipschitz` is not known.

    Examples
    --------
    >>> from petsc4py import PETSc
    >>> A = PETSc.Mat().createAIJ(
    ...     (2, 2), csr=([0, 2, 4], [0, 1, 0, 1], [2.0, -1.0, -1.0, 2.0])
    ... )
    >>> A.assemble()
    >>> icp.distributed.DistributedICP(A, np.array([-1.0, 3.0]))
    DistributedICP(n=2, ranks=1)
    """

    @check_arguments
    def __init__(self, A: Any, q: Any, psi: Any = 0.0, upper: Any = None) -> None:
        PETSc = petsc()
        if not isinstance(A, PETSc.Mat) or not A:  # one that was not created is false
            raise InputError(f"A is {described(A)}; a matrix of PETSc (petsc4py.PETSc.Mat) was expected")
        sizes = A.getSizes()
        comm = A.comm.tompi4py()
        with together(comm):
            if sizes[0] != sizes[1]:
                raise InputError(f"A has the sizes {sizes}; a square matrix, its columns as its rows, was expected")
            if not sizes[0][1]:
                raise InputError("A is empty; at least one row was expected")
            check_aij(A, "A")
        matrix = DistributedMatrix(A)
        with together(comm):
            q = _own_entries(q, matrix.low, matrix.high)
        if 0 < count(comm, upper is not None) < comm.size:
            raise InputError("upper is None on some ranks only; inf stands for no upper obstacle")
        below = DistributedMap.of(psi, matrix, "psi")
        self._set(matrix, q, below, None if upper is None else DistributedMap.of(upper, matrix, "upper"))
        with together(comm):
            if not matrix.own_rows[3]:
                raise InputError("A has an entry that is not finite; finite numbers were expected")
            self._check_sides()

    def _set(self, matrix: DistributedMatrix, q: Vector, psi: DistributedMap, upper: DistributedMap | None) -> None:
        self.matrix, self.q, self.psi, self.upper = matrix, q, psi, upper
        self.n, self.comm, self.low, self.high = matrix.n, matrix.comm, matrix.low, matrix.high

    @classmethod
    def of_checked(
        cls, matrix: DistributedMatrix, q: Vector, psi: DistributedMap, upper: DistributedMap | None
    ) -> DistributedICP:
        """Make a problem of parts that are already checked.

        Parameters
        ----------
        matrix : DistributedMatrix
            A.
        q : array
            The own entries of q.
        psi : DistributedMap
            The obstacle below.
        upper : DistributedMap or None
            The upper obstacle.

        Returns
        -------
        DistributedICP
            The problem.
        """
        new = object.__new__(cls)
        new._set(matrix, q, psi, upper)
        return new

    def _check_sides(self) -> None:
        if self.upper is None or not (self.psi.is_fixed and self.upper.is_fixed):
            return
        below = self.psi.fixed()
        above = self.upper.fixed()
        if (below > above).any():
            i = int(np.argmax(below > above))
            raise InputError(
                f"the obstacles cross in row {self.low + i}: psi has {below[i]:g} there, upper {above[i]:g}; "
                "psi <= upper was expected"
            )

    @property
    def A(self) -> Any:
        """A, the `Mat` that was handed in."""
        return self.matrix.mat

    @property
    def maps(self) -> tuple[DistributedMap, ...]:
        """ψ, and ψ̄ where there is one."""
        return (self.psi,) if self.upper is None else (self.psi, self.upper)

    @property
    def calls_user_code(self) -> bool:
        """Whether an obstacle is computed by a user's function."""
        return any(one.has_function for one in self.maps)

    def vector(self, own: Any = None) -> Any:
        """A new vector of this layout.

        Parameters
        ----------
        own : array, optional
            The entries of this rank, 0 by default.

        Returns
        -------
        petsc4py.PETSc.Vec
            The vector.
        """
        return self.matrix.vector(own)

    def sides(self, z: Any) -> tuple[Vector, Vector, Vector | None]:
        """p, z − ψ(z), and z − ψ̄(z) or None, in the own rows.

        Parameters
        ----------
        z : Vec
            The point.

        Returns
        -------
        tuple of arrays
            The three vectors; the last one None without an upper obstacle.

        Raises
        ------
        MapError
            On all ranks, where ψ fails.
        """
        p = self.matrix.product(z).array_r + self.q
        r_upper = None if self.upper is None else z.array_r - self.upper.value(z)
        return p, z.array_r - self.psi.value(z), r_upper

    def residual(self, z: Any) -> float:
        """Res_D(z) = ‖min(D⁻¹p, r)‖₂, see `ProblemData.residual`.

        Parameters
        ----------
        z : petsc4py.PETSc.Vec
            The point.

        Returns
        -------
        float
            The residual.
        """
        return Evaluation(self, check_point(self, z, "z")).residual

    def paper_residual(self, z: Any) -> float:
        """Res(z) = ‖min(p, r)‖₂.

        Parameters
        ----------
        z : petsc4py.PETSc.Vec
            The point.

        Returns
        -------
        float
            The residual.
        """
        return Evaluation(self, check_point(self, z, "z")).paper_residual

    def change(self, delta: Vector) -> Vector:
        """Bound |ψ(x) − ψ(y)|, and the same of ψ̄, for |x − y| ≤ `delta`, in the own rows.

        Parameters
        ----------
        delta : array
            The own entries.

        Returns
        -------
        array
            The bound.
        """
        most = np.zeros(delta.size)
        for one in self.maps:
            with np.errstate(over="ignore"):
                total = one.change(delta) * (1 + 2 * gamma(one.terms)) + (0.0 if one.is_fixed else one.terms * SMALLEST)
            most = np.maximum(most, total)
        return most

    def __repr__(self) -> str:
        return f"DistributedICP(n={self.n}, ranks={self.comm.size})"


def check_point(problem: Any, z: Any, name: str, finite: bool = False) -> Any:
    """Check that `z` is a `Vec` with the layout of A, and return it.

    Collective. Raises InputError on all ranks.

    Parameters
    ----------
    problem : DistributedICP
        The problem; another object is refused.
    z : Vec
        The point.
    name : str
        What the point is called in messages.
    finite : bool, default False
        Whether entries that are not finite are refused.

    Returns
    -------
    petsc4py.PETSc.Vec
        The point.
    """
    if not isinstance(problem, DistributedICP):
        raise InputError(f"problem is {described(problem)}; a DistributedICP was expected")
    with together(problem.comm):
        if not isinstance(z, petsc().Vec) or not z:  # one that was not created is false
            raise InputError(f"{name} is {described(z)}; a petsc4py.PETSc.Vec was expected: problem.vector() makes one")
        expected = problem.A.getSizes()[0]
        if z.getSizes() != expected:
            raise InputError(f"{name} has the sizes {z.getSizes()}; {expected}, those of A, were expected")
        if finite and not np.isfinite(z.array_r).all():
            i = int(np.argmin(np.isfinite(z.array_r)))
            raise InputError(f"{name}[{problem.low + i}] is {z.array_r[i]}; a finite number was expected")
    return z


def _own_entries(value: Any, low: int, high: int) -> Vector:
    """q in the own rows, low ≤ i < high, as a copy. Raises InputError."""
    array = as_array(value.array_r if isinstance(value, petsc().Vec) else value, "q")
    size = high - low
    if not array.ndim:
        array = np.full(size, array)
    if array.shape != (size,):
        raise InputError(f"q has shape {array.shape} on this rank; ({size},) was expected")
    own = as_float64(array, "q")
    if not np.isfinite(own).all():
        i = int(np.argmin(np.isfinite(own)))
        raise InputError(f"q[{low + i}] is {own[i]}; finite numbers were expected")
    return own


@check_arguments
def by_rows(problem: Any, comm: Any = None) -> DistributedICP:
    """Assemble a problem by rows: each rank makes its own rows, and none holds all.

    Parameters
    ----------
    problem : icpmodel.ByRows
        The problem, or an object with `n` and `local_rows(lo, hi)`.
    comm : optional
        A communicator of mpi4py or petsc4py, by default that of all ranks.

    Returns
    -------
    DistributedICP
        The problem.

    Raises
    ------
    InputError
        On all ranks, where one finds its rows wrong.
    RuntimeError
        For any other exception in `local_rows`.

    Examples
    --------
    >>> class Springs:
    ...     n = 1000
    ...
    ...     def local_rows(self, lo, hi):
    ...         return (
    ...             2.0 * sp.eye_array(self.n).tocsr()[lo:hi],
    ...             np.full(hi - lo, -1.0),
    ...             np.zeros(hi - lo),
    ...         )
    >>> icp.distributed.solve(icp.distributed.by_rows(Springs())).z.sum()
    500.0
    """
    comm = world(comm)
    PETSc = petsc()
    with together(comm):
        checked = _as_by_rows(problem)
        check_counts(checked.n, 0)
    sizes = comm.allgather(checked.n)
    if min(sizes) != max(sizes):
        raise InputError(f"problem.n is between {min(sizes)} and {max(sizes)} on the ranks; one number was expected")
    layout = PETSc.Vec().createMPI(checked.n, comm=comm)
    with together(comm):
        A, q, psi, upper = checked.local_rows(*layout.getOwnershipRange())
    return DistributedICP(from_rows(A, comm), q, psi, upper)


def _as_by_rows(problem: Any) -> ByRows:
    """The problem that `by_rows` takes. Raises InputError."""
    if isinstance(problem, ByRows):
        return problem
    if not callable(getattr(problem, "local_rows", None)) or not hasattr(problem, "n"):
        raise InputError(
            f"problem is {described(problem)}; a ByRows, or an object with n and local_rows(lo, hi), was expected"
        )
    return ByRows((int(as_number(problem.n, "problem.n", minimum=1, whole=True)),), problem.local_rows)


@check_arguments
def distribute(problem: Any, comm: Any = None) -> DistributedICP:
    """Spread the `problem` of rank 0, or of all ranks, over the ranks of `comm`.

    Parameters
    ----------
    problem : ICP, Scene or None
        An ICP, or an object that has one, with obstacles that are constant, affine or elementwise.
        Where a rank passes None, rank 0 sends all ranks their rows, and functions in ψ must be
        picklable.
    comm : optional
        A communicator of mpi4py or petsc4py, by default that of all ranks.

    Returns
    -------
    DistributedICP
        The problem.

    Raises
    ------
    InputError
        On all ranks, where ψ is of another kind or rank 0 has no problem.

    Examples
    --------
    >>> icp.distributed.distribute(icp.scenes.membrane(n=100))
    DistributedICP(n=100, ranks=1)
    """
    comm = world(comm)
    everywhere = count(comm, problem is not None) == comm.size
    with together(comm):
        shares: list[Any] = []
        if everywhere or comm.rank == 0:
            data = as_problem(problem)
            bounds = [data.n * k // comm.size for k in range(comm.size + 1)]
            shares = [_share(data, *bounds[k : k + 2]) for k in ([comm.rank] if everywhere else range(comm.size))]
            # here, as an error of pickle within `scatter` would leave the other ranks waiting
            shares = shares if everywhere else [pickle.dumps(one) for one in shares]
    share = shares[0] if everywhere else comm.scatter(shares or None)
    with together(comm):
        A, q, sides = share if everywhere else pickle.loads(share)
    maps = [own if G is None else (from_rows(G, comm), own) for own, G in sides]
    return DistributedICP(from_rows(A, comm), q, *maps)


def _share(problem: ProblemData, low: int, high: int) -> tuple[Any, ...]:
    """The rows `low` ≤ i < `high` of A, of q, and of each obstacle as a pair (f, G or None)."""
    sides: list[tuple[Any, Any]] = []
    for psi in sides_of(problem.psi):
        if isinstance(psi, Constant):
            sides.append((psi.c[low:high], None))
        elif isinstance(psi, Affine):
            sides.append((psi.c[low:high], psi.G[low:high]))
        elif isinstance(psi, Elementwise):
            own = psi.restricted(np.arange(low, high), np.zeros(0)) if high > low else np.zeros(0)
            sides.append((own, None))
        else:
            raise InputError(f"psi is {psi!r}; a constant, affine or elementwise obstacle was expected")
    return problem.A[low:high], problem.q[low:high], sides
