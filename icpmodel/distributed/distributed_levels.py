"""The levels of algebraic multigrid for a matrix on ranks, and V-cycles of them in which only some rows take part.

PETSc makes the hierarchy once: BoomerAMG by way of PCHMG, which gives away its interpolations, or
GAMG without hypre. It also runs the cycles (PCMG). Here rows are masked. On every level J = A_l
with the rows and columns that do not take part replaced by those of the diagonal. On the coarser
levels that diagonal is so large that these rows return no correction. On the finest one the sweep
after the correction puts such rows right.

Each coarse row has a representative, which decides whether it takes part. Of the fine unknowns of
its own rank, where there are any, that is the one with the largest weight. For hypre it is the
coarse point itself.

References
----------
Kornhuber, Numer. Math. 69 (1994), for the truncation. Henson and Yang, Appl. Numer. Math. 41
(2002), for BoomerAMG.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..algebra.newton_steps import MAX_KRYLOV_STEPS
from ..numerics.arrays import Mask, Vector
from ..numerics.threads import pools
from .distributed_matrix import DistributedMatrix
from .ranks import petsc, release, totals

#: the largest number of rows that every rank factorises whole if there is no coarser level
_DIRECT_UP_TO = 2000
#: Krylov's steps at the most after the active set has settled, to this part of the residual that is wanted
_MAX_STEPS = 60
_TARGET_SHARE = 0.3
#: factor of the diagonal that decouples a row: it returns no correction. Where the largest entry of f is between its
#: reciprocal and itself, the products of Krylov's method neither over- nor underflow
_LARGE = 1e100
#: options of what makes the levels begin with this in PETSc's database
_PREFIX = "icpmodel_"


class DistributedLevel:
    """One level: its `matrix`, and where there is a `coarser` one the interpolation `P` from it.

    `coarse_points` is the representative of each own coarse unknown: a fine unknown, counted from the
    first own one. `weight` is its weight in P.
    """

    def __init__(self, matrix: DistributedMatrix, coarser: Any, P: Any) -> None:
        self.matrix = matrix
        self.coarser = coarser
        self.P = P
        if P is not None:
            self.coarse_points, self.weight, self._points_are_local = _representatives(P, matrix)

    @cached_property
    def J(self) -> Any:
        """The memory of the masked matrix; the finest level does not always need it."""
        return self.matrix.mat.duplicate(copy=True)

    def inject(self, fine: Any) -> Vector:
        """The values at the coarse points, in the own rows of the coarser level, from those of all. Collective."""
        if self._points_are_local:
            return np.asarray(fine.array_r[self.coarse_points])
        return self.coarser.image(self.injection, fine).array.copy()

    def coarse_mask(self) -> Mask:
        """The own unknowns that are coarse points. Collective."""
        if self._points_are_local:
            mask = np.zeros(self.matrix.high - self.matrix.low, dtype=bool)
            mask[self.coarse_points] = True
            return mask
        fine = self.matrix.vector()
        ones = self.coarser.vector()
        ones.set(1.0)
        self.injection.multTranspose(ones, fine)
        return np.asarray(fine.array_r > 0)

    @cached_property
    def injection(self) -> Any:
        """Injection to the coarser level, a `Mat` with one 1 in each row. Collective, the first time.

        (A submatrix of PETSc has no row twice, but a point may represent two.)
        """
        columns = (self.matrix.low + self.coarse_points).astype(petsc().IntType)
        fine, coarse = self.P.getSizes()
        places = np.arange(columns.size + 1, dtype=columns.dtype)
        mat = petsc().Mat().createAIJ((coarse, fine), csr=(places, columns, np.ones(columns.size)), comm=self.P.comm)
        mat.assemble()
        return mat

    def interpolate(self, coarse: Any) -> Any:
        """Pz_c, a `Vec` of this level. Collective."""
        fine = self.matrix.vector()
        self.P.mult(coarse, fine)
        return fine

    def restrict_residual(self, fine: Any) -> Vector:
        """Pᵀf, in the own rows of the coarser level. Collective."""
        coarse = self.coarser.vector()
        self.P.multTranspose(fine, coarse)
        return coarse.array.copy()


class DistributedLevels:
    """The `levels` of `matrix`, finest first, and solves of A_FF x = f_F for changing free rows F.

    The diagonal must be positive. Where PETSc makes no hierarchy of it there is one level.
    """

    def __init__(self, matrix: DistributedMatrix) -> None:
        coarser = _hierarchy(matrix)
        matrices = [matrix, *(DistributedMatrix(mat) for mat, _ in coarser)]
        transfers = [*(P for _, P in coarser), None]
        self.levels = [DistributedLevel(*one) for one in zip(matrices, [*matrices[1:], None], transfers, strict=True)]
        self.krylov = "cg" if matrix.is_symmetric else "gmres"
        #: Krylov steps so far, on all levels
        self.steps = 0
        self._top = -1
        self._solver: Any = None
        release(matrix.comm, self.levels[-1].matrix.comm)  # hypre's levels have a communicator of their own

    def restrict(self, free: Vector, top: int) -> None:
        """Restrict later solves to the rows of level `top` where `free` is 1. Collective."""
        weight = 1.0
        for level in self.levels[top:]:
            mask = level.matrix.vector(free)
            level.matrix.mat.copy(level.J, petsc().Mat.Structure.SAME_NONZERO_PATTERN)
            level.J.diagonalScale(mask, mask)
            level.J.setDiagonal(level.matrix.vector(np.where(free > 0, 1.0, weight) * level.matrix.diagonal))
            if level.P is not None:
                free = level.inject(mask)
                weight = _LARGE

    def solve(self, f: Any, top: int, J: Any, share: float | None, target: float | None) -> Any:
        """Solve A_FF x = f_F on level `top`, with x = 0 elsewhere, or Jx = f where a `J` is given.

        The solve stops at ‖f − Jx‖ ≤ `share` ‖f‖, after at most `MAX_KRYLOV_STEPS` steps. With `target` it stops at
        ‖D⁻¹(f − Jx)‖ ≤ `_TARGET_SHARE` · `target`, after at most `_MAX_STEPS` steps.
        """
        largest_entry = f.norm(petsc().NormType.INFINITY)
        if not 0.0 < largest_entry < np.inf or 1.0 / _LARGE < largest_entry < _LARGE:
            return self._solve(f, top, J, share, target)
        scaled = f.duplicate()
        scaled.setArray(f.array_r / largest_entry)
        x = self._solve(scaled, top, J, share, None if target is None else target / largest_entry)
        x.scale(largest_entry)
        return x

    def _solve(self, f: Any, top: int, J: Any, share: float | None, target: float | None) -> Any:
        """`solve` for an f whose squares do not over- or underflow."""
        ksp = self.krylov_solver(top, J)
        x = f.duplicate()
        if target is None:
            ksp.setTolerances(rtol=share, atol=0.0, max_it=MAX_KRYLOV_STEPS)
        else:
            size = self.levels[top].matrix.smallest_row
            size = size if J is None else min(size, 1.0)  # some rows are those of r
            ksp.setTolerances(rtol=0.0, atol=_TARGET_SHARE * target * size, max_it=_MAX_STEPS)
        x.zeroEntries()
        ksp.solve(f, x)
        self.steps += ksp.getIterationNumber()
        ends = petsc().KSP.ConvergedReason
        indefinite = (ends.DIVERGED_INDEFINITE_PC, ends.DIVERGED_INDEFINITE_MAT)
        if ksp.getConvergedReason() in indefinite and self.krylov == "cg":
            self.krylov = "gmres"
            return self._solve(f, top, J, share, target)
        return x

    def krylov_solver(self, top: int, J: Any) -> Any:
        """CG or GMRES with a cycle of level `top`; it is kept until another level's is asked for."""
        PETSc = petsc()
        levels = self.levels[top:]
        if self._top != top:
            if self._solver is not None:
                self._solver.destroy()
            self._top = top
            self._solver = PETSc.KSP().create(self.levels[0].matrix.mat.comm)
            _make_cycle(self._solver.getPC(), levels)
        ksp = self._solver
        ksp.setOperators(levels[0].J if J is None else J, levels[0].J)
        kind = self.krylov if J is None else "gmres"
        if ksp.getType() != kind:
            ksp.setType(kind)
            ksp.setPCSide(PETSc.PC.Side.LEFT if kind == "cg" else PETSc.PC.Side.RIGHT)
            ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        return ksp


def _make_cycle(pc: Any, levels: list[DistributedLevel]) -> None:
    """Make `pc` a V(1, 1)-cycle with Gauss–Seidel in each rank, forwards before and backwards after.

    It is its own adjoint where A is symmetric.
    """
    PETSc = petsc()
    if len(levels) == 1 and levels[0].matrix.n > _DIRECT_UP_TO:
        pc.setType("bjacobi")  # with an incomplete factorisation in each rank
        return
    pc.setType("mg")
    pc.setUseAmat(False)  # or the finest residual would stay that of the first J that was given
    pc.setMGLevels(len(levels))
    options = PETSc.Options()
    coarse = pc.getMGCoarseSolve()
    coarse.setOperators(levels[-1].J, levels[-1].J)
    for k, level in enumerate(reversed(levels[:-1]), 1):
        pc.setMGInterpolation(k, level.P)
        # the first sweep begins with 0, where a single one needs no work space
        directions = (pc.getMGSmootherDown(k), "forward", "preonly"), (pc.getMGSmootherUp(k), "backward", "richardson")
        for smoother, direction, kind in directions:
            smoother.setType(kind)
            smoother.setTolerances(max_it=1)
            smoother.setOperators(level.J, level.J)
            sor = smoother.getPC()
            sor.setType("sor")
            sor.setOptionsPrefix(f"{_PREFIX}{direction}_")
            options[f"{_PREFIX}{direction}_pc_sor_local_{direction}"] = None
            sor.setFromOptions()


def _hierarchy(matrix: DistributedMatrix) -> list[tuple[Any, Any]]:
    """(A of a coarser level, the interpolation to the finer one) of each coarser level, as PETSc makes them.

    None where PETSc fails, or where a coarse diagonal is not positive.
    """
    PETSc = petsc()
    pc = PETSc.PC().create(matrix.mat.comm)
    options = PETSc.Options(_PREFIX)
    # the smoothers that come with it are replaced: Chebyshev's would look for eigenvalues, which is half of the set-up
    for name, value in (("ksp_type", "richardson"), ("pc_type", "none")):
        if not options.hasName(f"mg_levels_{name}"):
            options[f"mg_levels_{name}"] = value
    pc.setOptionsPrefix(_PREFIX)
    pc.setType("hmg" if PETSc.Sys.hasExternalPackage("hypre") else "gamg")
    pc.setOperators(matrix.mat, matrix.mat)
    pc.setFromOptions()
    try:
        with pools("openmp").limit(limits=1):  # a hypre with tables has such threads, and the cores are for the ranks
            pc.setUp()
    except PETSc.Error:
        return []
    count = pc.getMGLevels()
    levels = [(pc.getMGSmoother(k).getOperators()[0], pc.getMGInterpolation(k + 1)) for k in range(count - 2, -1, -1)]
    pc.destroy()
    not_positive = sum(float((mat.getDiagonal().array_r <= 0).sum()) for mat, _ in levels)
    return [] if totals(matrix.comm, not_positive)[0] else levels


def _representatives(P: Any, matrix: DistributedMatrix) -> tuple[NDArray[np.integer], Vector, bool]:
    """The fine unknown in which each coarse unknown of this rank has its largest weight. Collective.

    Returns
    -------
    places : array of int
        The fine unknowns, counted from the first one of this rank.
    weights : array
        The weights.
    is_local : bool
        Whether on every rank all of them belong to that rank. If not, they were chosen among those of all ranks.
    """
    from ..numerics.kernels.vcycle import largest_of  # loads numba

    PETSc = petsc()
    coarse = P.getLocalSize()[1]
    indptr, indices, data = P.getDiagonalBlock().getValuesCSR()
    places, coarse_points = largest_of(indptr, indices, data, coarse)
    points_are_local = not totals(matrix.comm, float((places < 0).any()))[0]
    if not points_are_local:  # GAMG leaves coarser levels to fewer ranks
        indptr, columns, data = P.transpose(PETSc.Mat()).getValuesCSR()
        places, _ = largest_of(indptr[[0, -1]], np.repeat(np.arange(coarse), np.diff(indptr)), data, coarse)
        coarse_points = np.where(places < 0, 0, columns[places] if data.size else 0) - matrix.low
    return coarse_points, np.where(places < 0, 1.0, data[places] if data.size else 1.0), points_are_local
