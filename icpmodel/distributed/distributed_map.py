"""Obstacles on ranks: what moves with its own unknown is a map of the own rows, what is coupled a matrix of PETSc."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..algebra.multigrid_equations import LEAST_SLOPE
from ..errors import InputError, NotApplicable
from ..numerics.arrays import Vector, described
from ..problem.affine import Constant
from ..problem.differences import DIFFERENCE_STEP
from ..problem.elementwise import Elementwise
from ..problem.facts import Facts
from ..problem.map import Map
from ..problem.matrix import Matrix
from ..problem.two_sided import as_map
from .distributed_matrix import DistributedMatrix, check_aij, map_entries
from .ranks import largest, petsc, together, totals

_EXPECTED = (
    "a number, a Vec, the entries of the own rows, an Elementwise map of them, "
    "or a pair (Mat, one of these) for Gz + f(z) was expected"
)


class DistributedMap:
    """ψ(z) = f(z) + Gz: `local_map`, f as a map of the own rows (None where there are none), and `G`, a `Mat`, or None.

    `has_function`: f is no constant on some rank, so that a user's function is called.
    """

    def __init__(
        self, matrix: DistributedMatrix, local_map: Map | None, G: Any = None, has_function: bool = False
    ) -> None:
        self.matrix = matrix
        self.local_map = local_map
        self.G = G
        self.has_function = has_function

    @classmethod
    def constant(cls, matrix: DistributedMatrix, c: Vector, G: Any = None) -> DistributedMap:
        """Gz + c, `c` of the own rows."""
        return cls(matrix, Constant(c).bind(c.size) if c.size else None, G)

    @classmethod
    def of(cls, value: Any, matrix: DistributedMatrix, name: str) -> DistributedMap:
        """What a user gives as the obstacle `name`, psi or upper. Collective. Raises InputError."""
        PETSc = petsc()
        size = matrix.high - matrix.low
        G = None
        with together(matrix.comm):
            if isinstance(value, tuple):
                if len(value) != 2 or not isinstance(value[0], PETSc.Mat) or not value[0]:
                    raise InputError(f"{name} is {described(value)}; {_EXPECTED}")
                G, value = value
                if G.getSizes() != matrix.mat.getSizes():
                    actual = G.getSizes()
                    expected = matrix.mat.getSizes()
                    raise InputError(f"{name}[0] has the sizes {actual}; {expected}, those of A, were expected")
                check_aij(G, f"{name}[0]")
                if not np.isfinite(G.getValuesCSR()[2]).all():
                    raise InputError(f"{name}[0] has an entry that is not finite; finite numbers were expected")
            if isinstance(value, PETSc.Vec):
                value = value.array.copy()
            elif isinstance(value, Map) and not isinstance(value, Constant | Elementwise):
                raise InputError(f"{name} is {value!r}; {_EXPECTED}")
            if np.ndim(value) and np.shape(value) != (size,):
                raise InputError(f"{name} has shape {np.shape(value)} on this rank; ({size},) was expected")
            local_map = None
            if size:
                local_map = as_map(value, size) if name == "psi" else as_map(-np.inf, size, value).upper
            if local_map is not None and not isinstance(local_map, Constant) and local_map.lipschitz is None:
                raise NotApplicable(
                    f"{name} depends on z without a known bound: give an Elementwise with `lipschitz` < 1"
                )
        functions, pairs = totals(matrix.comm, local_map is not None and not local_map.is_constant, G is not None)
        if 0 < pairs < matrix.comm.size:
            raise InputError(f"{name} is a pair on some ranks only; on all of them or none it was expected")
        return cls(matrix, local_map, G, functions > 0)

    @property
    def is_fixed(self) -> bool:
        """Whether it is a constant."""
        return self.G is None and not self.has_function

    def value(self, z: Any) -> Vector:
        """ψ(z) in the own rows, `z` a `Vec`. Collective. Raises MapError on all ranks."""
        if self.has_function:
            with together(self.matrix.comm):
                values = self._local_values(z)
        else:
            values = self._local_values(z)
        if self.G is not None:
            values = values + self.matrix.image(self.G, z).array_r
        return values

    def _local_values(self, z: Any) -> Vector:
        return np.zeros(0) if self.local_map is None else self.local_map.value(z.array_r)

    def slopes(self, z: Any) -> Vector:
        """f′ in the own rows, at the `Vec` `z`, or a difference quotient.

        Collective. Raises MapError on all ranks.
        """
        if not self.has_function:
            return np.zeros(self.matrix.high - self.matrix.low)
        with together(self.matrix.comm):
            if self.local_map is None or self.local_map.is_constant:
                return np.zeros(self.matrix.high - self.matrix.low)
            z = z.array_r
            J = self.local_map.jacobian(z)
            if J is not None:
                return J.diagonal()
            step = DIFFERENCE_STEP * (1.0 + np.abs(z))
            return (self.local_map.value(z + step) - self.local_map.value(z)) / ((z + step) - z)

    def fixed(self) -> Vector:
        """c with c_i = f_i(c_i) in the own rows, which stands for f, see `Facts.obstacle`. Local.

        Raises MapError, and NotApplicable where f is not known to move by less than z.
        """
        if self.local_map is None:
            return np.zeros(0)
        facts = Facts(Matrix.of_checked(sp.csr_array(sp.eye_array(self.matrix.high - self.matrix.low))), self.local_map)
        if not facts.has_fixed_obstacle:
            raise NotApplicable("an obstacle may move as far as its own unknown: `lipschitz` < 1 was expected")
        return facts.obstacle

    @cached_property
    def own_slope(self) -> Any:
        """1 − g_ii in the own rows, at least `LEAST_SLOPE`, or 1 where there is no G."""
        return 1.0 if self.G is None else np.maximum(1.0 - self.G.getDiagonal().array, LEAST_SLOPE)

    @cached_property
    def _lipschitz(self) -> tuple[Vector, Any]:
        """ℓ in the own rows and |G|, or None, with |ψ(x) − ψ(y)| ≤ ℓ|x − y| + |G||x − y|. Collective."""
        lipschitz = np.zeros(self.matrix.high - self.matrix.low)
        if self.local_map is not None and self.local_map.lipschitz is not None:
            lipschitz = self.local_map.lipschitz.diagonal()
        return lipschitz, None if self.G is None else map_entries(self.G, np.abs)

    @cached_property
    def terms(self) -> int:
        """How many terms a row of ψ has at the most, which bounds its rounding. Collective."""
        if self.G is None:
            return 3
        lengths = np.diff(self.G.getValuesCSR()[0])
        return 3 + int(largest(self.matrix.comm, float(lengths.max(initial=0)))[0])

    def change(self, delta: Vector) -> Vector:
        """ℓδ + |G|δ in the own rows, without its rounding. Collective."""
        lipschitz, G = self._lipschitz
        with np.errstate(over="ignore", invalid="ignore"):
            total: Vector = lipschitz * delta
            return total if G is None else total + self.matrix.image(G, self.matrix.vector(delta)).array
