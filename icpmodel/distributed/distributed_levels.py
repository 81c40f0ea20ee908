"""The levels of algebraic multigrid for a matrix on ranks, and V-cycles restricted to the free rows.

PETSc makes the hierarchy once: BoomerAMG by PCHMG, which gives access to its interpolations, or
GAMG without hypre. It also runs the cycles (PCMG). This file masks rows. On every level, J is A_l
with the rows and columns that are not free replaced by those of the diagonal. On the coarser levels
that diagonal is so large that these rows return no correction. On the finest level the sweep after
the correction corrects these rows.

A coarse row is free if its representative is: the fine unknown with the largest weight in its
column of P. For hypre this is the coarse point itself.

References
----------
Kornhuber, Numer. Math. 69 (1994), for the truncation. Henson and Yang, Appl. Numer. Math. 41
(2002), for BoomerAMG.
"""

from __future__ import annotations

from functools import cached_property
from itertools import zip_longest
from typing import Any

import numpy as np

from ..algebra.newton_steps import MAX_KRYLOV_STEPS
from ..numerics.arrays import Vector
from ..numerics.threads import pools
from .distributed_matrix import DistributedMatrix
from .ranks import anywhere, petsc, release

#: the largest number of rows that every rank factorises whole if there is no coarser level
_DIRECT_UP_TO = 2000
#: the most Krylov steps once the active set has settled, and the share of the wanted residual that they aim at
_MAX_STEPS = 60
_TARGET_SHARE = 0.3
#: factor of the diagonal that decouples a row, which then returns no correction
_LARGE = 1e100
#: the prefix of the options of the hierarchy in PETSc's database
_PREFIX = "icpmodel_"


class DistributedLevel:
    """One level: its `matrix`, and where there is a coarser one the interpolation `P` from it.

    `injection` is the injection to the coarser level, a `Mat` with a 1 in each row. `weight` has the
    weights in P of the injected points.
    """

    def __init__(self, matrix: DistributedMatrix, P: Any) -> None:
        self.matrix = matrix
        self.P = P
        if P is not None:
            self.injection, self.weight = _injection(P)

    @cached_property
    def J(self) -> Any:
        """Memory for the masked matrix, which `restrict` fills; the finest level does not always need it."""
        return self.matrix.mat.duplicate(copy=True)


class DistributedLevels:
    """The `levels` of `matrix`, finest first, and solves of A_FF x = f_F for changing free rows F.

    The diagonal must be positive. Where PETSc makes no hierarchy, there is one level.
    """

    def __init__(self, matrix: DistributedMatrix) -> None:
        coarser = _hierarchy(matrix)
        matrices = [matrix, *(DistributedMatrix(mat) for mat, _ in coarser)]
        self.levels = [DistributedLevel(*one) for one in zip(matrices, [*(P for _, P in coarser), None], strict=True)]
        self.krylov = "cg" if matrix.is_symmetric else "gmres"
        #: Krylov steps so far, on all levels
        self.steps = 0
        release(matrix.comm, matrices[-1].comm)  # hypre's levels have a communicator of their own

    def restrict(self, free: Vector, top: int) -> None:
        """Restrict later solves to the rows of level `top` where `free` is 1. Collective."""
        weight = 1.0
        for level, coarser in zip_longest(self.levels[top:], self.levels[top + 1 :]):
            mask = level.matrix.vector(free)
            level.matrix.mat.copy(level.J, petsc().Mat.Structure.SAME_NONZERO_PATTERN)
            level.J.diagonalScale(mask, mask)
            level.J.setDiagonal(level.matrix.vector(np.where(free > 0, 1.0, weight) * level.matrix.diagonal))
            if coarser is not None:
                free = coarser.matrix.image(level.injection, mask).array_r
                weight = _LARGE

    def solve(self, f: Any, top: int, J: Any, share: float | None, target: float | None) -> Any:
        """Solve A_FF x = f_F on level `top`, with x = 0 elsewhere, or Jx = f where a `J` is given.

        The solve stops at ‖f − Jx‖ ≤ `share` ‖f‖, after at most `MAX_KRYLOV_STEPS` steps. With `target` it stops at
        ‖D⁻¹(f − Jx)‖ ≤ `_TARGET_SHARE` · `target`, after at most `_MAX_STEPS` steps. x is 0 where f is not finite.
        Where CG finds A indefinite, GMRES replaces it for good. Collective.
        """
        x = self.levels[top].matrix.vector()
        size = f.norm(petsc().NormType.INFINITY)
        if not 0.0 < size < np.inf:
            return x
        scaled = f.duplicate()  # the squares of its entries do not over- or underflow
        scaled.setArray(f.array_r / size)
        ksp = self._krylov_solver(top, J)
        if target is None:
            ksp.setTolerances(rtol=share, atol=0.0, max_it=MAX_KRYLOV_STEPS)
        else:
            row = self.levels[top].matrix.smallest_row
            row = row if J is None else min(row, 1.0)  # some rows are those of r
            ksp.setTolerances(rtol=0.0, atol=_TARGET_SHARE * target / size * row, max_it=_MAX_STEPS)
        ksp.solve(scaled, x)
        self.steps += ksp.getIterationNumber()
        end = ksp.getConvergedReason()
        ksp.destroy()
        ends = petsc().KSP.ConvergedReason
        if end in (ends.DIVERGED_INDEFINITE_PC, ends.DIVERGED_INDEFINITE_MAT) and self.krylov == "cg":
            self.krylov = "gmres"
            return self.solve(f, top, J, share, target)
        x.scale(size)
        return x

    def _krylov_solver(self, top: int, J: Any) -> Any:
        """CG or GMRES with a cycle of level `top`."""
        PETSc = petsc()
        levels = self.levels[top:]
        ksp = PETSc.KSP().create(self.levels[0].matrix.mat.comm)
        _make_cycle(ksp.getPC(), levels)
        ksp.setOperators(levels[0].J if J is None else J, levels[0].J)
        symmetric = J is None and self.krylov == "cg"
        ksp.setType("cg" if symmetric else "gmres")
        ksp.setPCSide(PETSc.PC.Side.LEFT if symmetric else PETSc.PC.Side.RIGHT)
        ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        return ksp


def _make_cycle(pc: Any, levels: list[DistributedLevel]) -> None:
    """Make `pc` a V(1, 1)-cycle with Gauss–Seidel in each rank, forward before the coarse level, backward after it.

    It is self-adjoint where A is symmetric. Without coarser levels, `pc` is a direct solver or, for many rows, block
    Jacobi.
    """
    PETSc = petsc()
    if len(levels) == 1 and levels[0].matrix.n > _DIRECT_UP_TO:
        pc.setType("bjacobi")  # with an incomplete factorisation in each rank
        return
    pc.setType("mg")
    pc.setUseAmat(False)  # else the finest residual would stay that of the first J
    pc.setMGLevels(len(levels))
    options = PETSc.Options()
    coarse = pc.getMGCoarseSolve()
    coarse.setOperators(levels[-1].J, levels[-1].J)
    for k, level in enumerate(reversed(levels[:-1]), 1):
        pc.setMGInterpolation(k, level.P)
        # the first sweep starts from 0, where `preonly` needs no work space
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
    """(A of the level, the interpolation to the finer one) of each coarser level of PETSc's, finest first.

    The list is empty where PETSc fails, or where a coarse diagonal is not positive. Collective.
    """
    PETSc = petsc()
    pc = PETSc.PC().create(matrix.mat.comm)
    options = PETSc.Options(_PREFIX)
    # PETSc's own smoothers are replaced: Chebyshev's would estimate eigenvalues, which is half of the set-up
    for name, value in (("ksp_type", "richardson"), ("pc_type", "none")):
        if not options.hasName(f"mg_levels_{name}"):
            options[f"mg_levels_{name}"] = value
    pc.setOptionsPrefix(_PREFIX)
    pc.setType("hmg" if PETSc.Sys.hasExternalPackage("hypre") else "gamg")
    pc.setOperators(matrix.mat, matrix.mat)
    pc.setFromOptions()
    try:
        with pools("openmp").limit(limits=1):  # hypre may have such threads, but the cores are for ranks
            pc.setUp()
    except PETSc.Error:
        return []
    count = pc.getMGLevels()
    levels = [(pc.getMGSmoother(k).getOperators()[0], pc.getMGInterpolation(k + 1)) for k in range(count - 2, -1, -1)]
    pc.destroy()
    diagonals = [mat.getDiagonal().array_r for mat, _ in levels]  # collective: of all levels on every rank
    not_positive = any((diagonal <= 0).any() for diagonal in diagonals)
    return [] if anywhere(matrix.comm, not_positive) else levels


def _injection(P: Any) -> tuple[Any, Vector]:
    """The injection from the fine unknown with the largest weight of each coarse one, and these weights in own rows.

    Collective. (PETSc's submatrices have no row twice, but one fine unknown may represent two coarse ones.)
    """
    from ..numerics.kernels.vcycle import largest_of  # loads numba

    PETSc = petsc()
    fine, coarse = P.getSizes()
    transposed = P.transpose(PETSc.Mat())
    indptr, columns, data = transposed.getValuesCSR()
    transposed.destroy()
    own = indptr.size - 1
    places, _ = largest_of(indptr[[0, -1]], np.repeat(np.arange(own), np.diff(indptr)), data, own)
    empty = places < 0
    points = np.zeros(own, dtype=PETSc.IntType)
    points[~empty] = columns[places[~empty]]
    weights = np.ones(own)
    weights[~empty] = data[places[~empty]]
    csr = (np.arange(own + 1, dtype=PETSc.IntType), points, np.ones(own))
    injection = PETSc.Mat().createAIJ((coarse, fine), csr=csr, comm=P.comm)
    injection.assemble()
    return injection, weights
