"""How the arrays of a problem are handed to JAX: A, q and the data of an obstacle, and what a change of them is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import InputError, NotApplicable
from ...numerics.arrays import described, row_of
from ...problem.affine import Affine, Constant
from ...problem.between import sides_of
from ...problem.data import ProblemData
from ...problem.elementwise import Elementwise
from ...problem.function import Function
from ...problem.intervention import Intervention
from ...problem.map import Map

Shape = tuple[int, ...]


def the_package() -> Any:
    """JAX. Raises NotApplicable where it is not installed."""
    try:
        import jax
    except ImportError as error:
        raise NotApplicable('jax is not installed: pip install "icpmodel[jax]"') from error
    return jax


def _real(value: Any, name: str, shapes: Sequence[Shape]) -> Any:
    """`value` as a float64 array of JAX, of one of the `shapes`. Raises InputError."""
    import jax.numpy as jnp

    try:
        array = jnp.asarray(value)
    except (TypeError, ValueError) as error:
        wanted = "its data, on the pattern of the problem's own" if sp.issparse(value) else "an array of numbers"
        raise InputError(f"{name} is {described(value)}; {wanted} was expected") from error
    if not (jnp.issubdtype(array.dtype, jnp.floating) or jnp.issubdtype(array.dtype, jnp.integer)):
        raise InputError(f"{name} has dtype {array.dtype}; real numbers were expected")
    if array.shape not in shapes:
        raise InputError(f"{name} has shape {array.shape}; shape {' or '.join(map(str, shapes))} was expected")
    return array.astype(np.float64)


class Argument:
    """How one argument is written, as one or two arrays, and what stands for a change of them.

    Here it is a vector, q or z0, or an obstacle by the c that `make` turns into a map.
    """

    def __init__(self, name: str, n: int, make: Callable[..., Any] | None = None) -> None:
        self.name, self.n, self.make = name, n, make

    def read(self, value: Any) -> tuple[Any, ...]:
        """The arrays, float64, checked."""
        import jax.numpy as jnp

        shapes: list[Shape] = [(self.n,)] if self.make is None else [(self.n,), ()]
        return (jnp.broadcast_to(_real(value, self.name, shapes), (self.n,)),)

    def made(self, *arrays: Any) -> Any:
        """What `ICP` takes."""
        return self.make(*arrays) if self.make else arrays[0]

    def change(self, z: Any, *tangents: Any) -> Any:
        """What a change of the arrays amounts to at the answer z, a vector: here the change of values."""
        return tangents[0]

    def direction(self, change: Any) -> Any:
        """That as `Derivative.forward` takes it."""
        return change

    def gradient(self, in_data: Callable[[], Any], in_values: Any) -> Any:
        """Its transpose, of the two gradients that `Derivative.adjoint` knows."""
        return in_values


class Entries(Argument):
    """A square matrix by its data on the pattern of `matrix`, or as a dense array."""

    def __init__(self, name: str, matrix: sp.csr_array) -> None:
        super().__init__(name, matrix.shape[0])
        self.matrix = matrix

    def read(self, value: Any) -> tuple[Any, ...]:
        return (_real(value, self.name, [self.matrix.data.shape, self.matrix.shape]),)

    def made(self, *arrays: Any) -> Any:
        return arrays[0] if arrays[0].ndim == 2 else _on(self.matrix, arrays[0])

    def change(self, z: Any, *tangents: Any) -> Any:
        import jax

        (data,) = tangents
        if data.ndim == 2:
            return data @ z
        products = data * z[self.matrix.indices]
        return jax.ops.segment_sum(products, row_of(self.matrix), self.n, indices_are_sorted=True)


class Moving(Argument):
    """Gz + c by both."""

    def __init__(self, name: str, psi: Affine) -> None:
        super().__init__(f"{name}[1]", psi.G.shape[0], Affine)
        self.G = Entries(f"{name}[0]", psi.G)

    def read(self, value: Any) -> tuple[Any, ...]:
        return *self.G.read(value[0]), *super().read(value[1])

    def made(self, *arrays: Any) -> Any:
        return Affine(self.G.made(arrays[0]), arrays[1])

    def change(self, z: Any, *tangents: Any) -> Any:
        return self.G.change(z, tangents[0]) + tangents[1]


class Gains(Argument):
    """The gains of an `Intervention` that has the pattern of `jumps`."""

    def __init__(self, name: str, jumps: sp.csr_array, best: str) -> None:
        super().__init__(name, jumps.shape[0], lambda gains: Intervention(_on(jumps, gains), best))
        self.jumps = jumps

    def read(self, value: Any) -> tuple[Any, ...]:
        return (_real(value, self.name, [self.jumps.data.shape]),)

    def direction(self, change: Any) -> Any:
        return _on(self.jumps, change)

    def gradient(self, in_data: Callable[[], Any], in_values: Any) -> Any:
        return in_data().data


class Parameters(Argument):
    """A user's parameters, of which `make` makes the map."""

    def read(self, value: Any) -> tuple[Any, ...]:
        shape = np.shape(value)
        if len(shape) != 1:
            raise InputError(f"{self.name} has shape {shape}; a vector of parameters was expected")
        return (_real(value, self.name, [shape]),)

    def made(self, *arrays: Any) -> Any:
        assert self.make is not None
        made = self.make(arrays[0].copy())
        if not isinstance(made, Function | Elementwise) or made.parameter_derivative is None:
            wanted = "a Function or an Elementwise with its parameter_derivative was expected"
            raise InputError(f"{self.name}, the function that makes a map of parameters, returned {made!r}; {wanted}")
        return made

    def gradient(self, in_data: Callable[[], Any], in_values: Any) -> Any:
        return in_data()


def _on(pattern: sp.csr_array, data: Any) -> sp.csr_array:
    """The matrix with other `data` on a pattern."""
    return sp.csr_array((data, pattern.indices, pattern.indptr), shape=pattern.shape)


def obstacles(problem: ProblemData) -> dict[str, Map | None]:
    """The obstacles of `problem`, by the names of its arguments."""
    return {"psi": sides_of(problem.psi)[0], "upper": problem.upper}


def argument(name: str, value: Any, problem: ProblemData, make: Callable[[Any], Any] | None) -> Argument:
    """How the argument `name` is written. Raises InputError."""
    n, psi = problem.n, obstacles(problem).get(name)
    if name == "A":
        return Entries(name, problem.A)
    if name in ("q", "z0"):
        return Argument(name, n)
    if make is not None:
        return Parameters(name, n, make)
    if psi is None:
        raise InputError(f"{name} is given, but the problem has nothing above z: make it with an upper, inf for none")
    if isinstance(psi, Affine):
        pair = isinstance(value, tuple) and len(value) == 2
        return Moving(name, psi) if pair else Argument(name, n, lambda c: Affine(psi.G, c))
    if isinstance(psi, Constant):
        return Argument(name, n, Constant)
    if isinstance(psi, Elementwise) and psi.parameter_derivative is None:
        return Argument(name, n, lambda c: Elementwise(psi.f, psi.derivative, psi.given_lipschitz, c))
    if isinstance(psi, Intervention) and psi.jumps is not None:
        return Gains(name, psi.jumps, psi.best)
    raise InputError(
        f"{name} of the problem is {psi!r}, which is not made of one array: give solution_of a function {name}= that "
        "makes the map of parameters"
    )
