"""Obstacles on ranks, ψ(z) = f(z) + Gz: f is an elementwise map of the own rows, G a matrix of PETSc that couples."""

from __future__ import annotations

from contextlib import nullcontext
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
from .ranks import anywhere, count, largest, petsc, together

_EXPECTED = (
    "a number, a Vec, the entries of the own rows, an Elementwise map of them, "
    "or a pair (Mat, one of these) for Gz + f(z) was expected"
)


class DistributedMap:
    """ψ(z) = f(z) + Gz: `local_map`, f as a map of the own rows, and `G`, a `Mat`, or None.

    `has_function` says whether f calls a user's function, on any rank.
    """

    def __init__(self, matrix: DistributedMatrix, local_map: Map, G: Any = None, has_function: bool = False) -> None:
        self.matrix = matrix
        self.local_map = local_map
        self.G = G
        self.has_function = has_function

    @classmethod
    def constant(cls, matrix: DistributedMatrix, c: Vector, G: Any = None) -> DistributedMap:
        """Gz + c, `c` of the own rows."""
        return cls(matrix, Constant.of_checked(c), G)

    @classmethod
    def of(cls, value: Any, matrix: DistributedMatrix, name: str) -> DistributedMap:
        """Convert the user's obstacle `name`, psi or upper. Collective. Raises InputError, NotApplicable."""
        PETSc = petsc()
        comm = matrix.comm
        size = matrix.high - matrix.low
        G = None
        with together(comm):
            if isinstance(value, tuple):
                if len(value) != 2 or not isinstance(value[0], PETSc.Mat) or not value[0]:
                    raise InputError(f"{name} is {described(value)}; {_EXPECTED}")
                G, value = value
                actual, expected = (mat.getSizes() for mat in (G, matrix.mat))
                if actual != expected:
                    raise InputError(f"{name}[0] has the sizes {actual}; {expected}, those of A, were expected")
                check_aij(G, f"{name}[0]")
                if not np.isfinite(G.getValuesCSR()[2]).all():
                    raise InputError(f"{name}[0] has an entry that is not finite; finite numbers were expected")
            local_map = _as_local_map(value.array.copy() if isinstance(value, PETSc.Vec) else value, size, name)
        if 0 < count(comm, G is not None) < comm.size:
            raise InputError(f"{name} is a pair on some ranks only; on all of them or none it was expected")
        return cls(matrix, local_map, G, anywhere(comm, not local_map.is_constant))

    @property
    def is_fixed(self) -> bool:
        """Whether it is a constant."""
        return self.G is None and not self.has_function

    def value(self, z: Any) -> Vector:
        """ψ(z) in the own rows, `z` a `Vec`. Collective. Raises MapError on all ranks."""
        with together(self.matrix.comm) if self.has_function else nullcontext():
            values = self.local_map.value(z.array_r)
        return values if self.G is None else values + self.matrix.image(self.G, z).array_r

    def slopes(self, z: Any) -> Vector:
        """f′ in the own rows, at the `Vec` `z`, or a difference quotient.

        Collective. Raises MapError on all ranks.
        """
        f = self.local_map
        z = z.array_r
        with together(self.matrix.comm) if self.has_function else nullcontext():
            J = f.jacobian(z)
            if J is not None:
                return np.asarray(J.diagonal())
            step = DIFFERENCE_STEP * (1.0 + np.abs(z))
            return (f.value(z + step) - f.value(z)) / ((z + step) - z)

    def fixed(self) -> Vector:
        """The fixed point c_i = f_i(c_i) in the own rows, which can replace f, see `Facts.obstacle`. Local.

        Raises MapError, and NotApplicable where f is not known to move by less than z.
        """
        facts = Facts(Matrix.of_checked(sp.csr_array(sp.eye_array(self.matrix.high - self.matrix.low))), self.local_map)
        if not facts.has_fixed_obstacle:
            raise NotApplicable("an obstacle may move as far as its own unknown: `lipschitz` < 1 was expected")
        return facts.obstacle

    @cached_property
    def own_slope(self) -> Any:
        """1 − g_ii in the own rows, at least `LEAST_SLOPE`, or 1 where there is no G."""
        return 1.0 if self.G is None else np.maximum(1.0 - self.G.getDiagonal().array, LEAST_SLOPE)

    @cached_property
    def _size_of_G(self) -> Any:
        """|G|, a `Mat`. Collective, the first time."""
        return map_entries(self.G, np.abs)

    @cached_property
    def terms(self) -> int:
        """The largest number of terms in a row of ψ, which bounds its rounding. Collective, the first time."""
        lengths = 0 if self.G is None else np.diff(self.G.getValuesCSR()[0])
        return 3 + int(largest(self.matrix.comm, lengths))

    def change(self, delta: Vector) -> Vector:
        """ℓδ + |G|δ in the own rows, without its rounding: a bound on |ψ(x) − ψ(y)| for |x − y| ≤ δ. Collective."""
        lipschitz = self.local_map.lipschitz
        assert lipschitz is not None
        with np.errstate(over="ignore", invalid="ignore"):
            total: Vector = lipschitz.diagonal() * delta
            if self.G is None:
                return total
            return total + self.matrix.image(self._size_of_G, self.matrix.vector(delta)).array


def _as_local_map(value: Any, size: int, name: str) -> Map:
    """The map of `size` own rows that a user gives as `name`. Raises InputError, NotApplicable."""
    if isinstance(value, Map) and not isinstance(value, Constant | Elementwise):
        raise InputError(f"{name} is {value!r}; {_EXPECTED}")
    if np.ndim(value) and np.shape(value) != (size,):
        raise InputError(f"{name} has shape {np.shape(value)} on this rank; ({size},) was expected")
    if not size:
        return Constant.of_checked(np.zeros(0))
    local_map = as_map(value, size) if name == "psi" else as_map(-np.inf, size, value).upper
    assert local_map is not None
    if not local_map.is_constant and local_map.lipschitz is None:
        raise NotApplicable(f"{name} depends on z without a known bound: give an Elementwise with `lipschitz` < 1")
    return local_map
