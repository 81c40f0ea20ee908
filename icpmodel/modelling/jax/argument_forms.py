"""The arrays of a problem that are arguments in JAX: A, q and the data of an obstacle, and changes of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import InputError, NotApplicable
from ...numerics.arrays import described, row_of, with_entries
from ...problem.affine import Affine, Constant
from ...problem.data import ProblemData
from ...problem.elementwise import Elementwise
from ...problem.function import Function
from ...problem.intervention import Intervention
from ...problem.map import Map
from ...problem.two_sided import sides_of

Shape = tuple[int, ...]


def the_package() -> Any:
    """JAX. Raises NotApplicable where it is not installed."""
    try:
        import jax
    except ImportError as error:
        raise NotApplicable('jax is not installed: pip install "icpmodel[jax]"') from error
    return jax


def check_float64() -> None:
    """Raise InputError if JAX rounds to float32."""
    if not the_package().config.jax_enable_x64:
        reason = "JAX rounds to float32 here, and an answer is float64"
        raise InputError(f'{reason}: call jax.config.update("jax_enable_x64", True) at the start of the program')


@dataclass(frozen=True, eq=False)
class Argument:
    """The form of one argument, as one or two arrays, and of changes of them.

    `shapes`: the allowed shapes of each array; an empty list allows vectors of any length. `make`: the function of the
    arrays that gives the argument of `ICP`; None for the array itself. `matrix`: the pattern whose entries the first
    array holds, if any. `in_data`: whether a change is passed on as a change of the data of a map, gains or parameters;
    otherwise it is first converted to a change of values.
    """

    name: str
    shapes: tuple[Sequence[Shape], ...]
    make: Callable[..., Any] | None = None
    matrix: sp.csr_array | None = None
    in_data: bool = False

    def read(self, value: Any) -> tuple[Any, ...]:
        """The arrays, float64, checked. Raises InputError."""
        if len(self.shapes) == 1:
            return (_real(value, self.name, self.shapes[0]),)
        return tuple(_real(one, f"{self.name}[{k}]", self.shapes[k]) for k, one in enumerate(value))

    def to_icp(self, *arrays: Any) -> Any:
        """The argument of `ICP`."""
        return self.make(*arrays) if self.make else arrays[0]

    def change(self, z: Any, *tangents: Any) -> Any:
        """The effect of a change of the arrays at the answer z, a vector."""
        if self.matrix is None or self.in_data:
            return tangents[0]
        import jax

        entries, *constant = tangents
        if entries.ndim == 2:
            return sum(constant, entries @ z)
        rows = row_of(self.matrix)
        products = entries * z[self.matrix.indices]
        return sum(constant, jax.ops.segment_sum(products, rows, z.size, indices_are_sorted=True))

    def direction(self, change: Any) -> Any:
        """The change as an argument of `Derivative.forward`."""
        return _on(self.matrix, change) if self.in_data and self.matrix is not None else change

    def gradient(self, in_data: Callable[[], Any], in_values: Any) -> Any:
        """The gradient in the arrays, from the gradients in the data and in the values by `Derivative.adjoint`."""
        if not self.in_data:
            return in_values
        return in_data() if self.matrix is None else in_data().data


def _real(value: Any, name: str, shapes: Sequence[Shape]) -> Any:
    """`value` as a float64 array of JAX with one of the `shapes`; a number gets the first one. Raises InputError."""
    import jax.numpy as jnp

    try:
        array = jnp.asarray(value)
    except (TypeError, ValueError) as error:
        expected = "its data, on the pattern of the problem's own" if sp.issparse(value) else "an array of numbers"
        raise InputError(f"{name} is {described(value)}; {expected} was expected") from error
    if not (jnp.issubdtype(array.dtype, jnp.floating) or jnp.issubdtype(array.dtype, jnp.integer)):
        raise InputError(f"{name} has dtype {array.dtype}; real numbers were expected")
    if array.shape not in shapes if shapes else array.ndim != 1:
        expected = f"shape {' or '.join(map(str, shapes))}" if shapes else "a vector of parameters"
        raise InputError(f"{name} has shape {array.shape}; {expected} was expected")
    return (array if array.ndim else jnp.broadcast_to(array, shapes[0])).astype(np.float64)


def _on(pattern: sp.csr_array, data: Any) -> Any:
    """The matrix with `data` on the `pattern`; dense `data` are the matrix."""
    return data if data.ndim == 2 else with_entries(pattern, data)


def _of_parameters(name: str, make: Callable[[Any], Any], theta: Any) -> Map:
    """The map that the user's `make` returns for parameters. Raises InputError if it has no derivative in them."""
    result = make(theta.copy())
    if not isinstance(result, Function | Elementwise) or result.parameter_derivative is None:
        expected = "a Function or an Elementwise with its parameter_derivative was expected"
        raise InputError(f"{name}, the function that makes a map of parameters, returned {result!r}; {expected}")
    return result


def obstacles(problem: ProblemData) -> dict[str, Map | None]:
    """The obstacles of `problem`, by the names of its arguments."""
    return {"psi": sides_of(problem.psi)[0], "upper": problem.upper}


def argument(name: str, value: Any, problem: ProblemData, make: Callable[[Any], Any] | None) -> Argument:
    """The form of the argument `name`. Raises InputError."""
    A = problem.A
    psi = obstacles(problem).get(name)
    vector = [(problem.n,)]
    number_too = [(problem.n,), ()]
    if name == "A":
        return Argument(name, ([A.data.shape, A.shape],), partial(_on, A), A)
    if name in ("q", "z0"):
        return Argument(name, (vector,))
    if make is not None:
        return Argument(name, ([],), partial(_of_parameters, name, make), in_data=True)
    if psi is None:
        raise InputError(f"{name} is given, but the problem has nothing above z: make it with an upper, inf for none")
    if isinstance(psi, Affine) and isinstance(value, tuple) and len(value) == 2:
        G = psi.G
        return Argument(name, ([G.data.shape, G.shape], number_too), lambda data, c: Affine(_on(G, data), c), G)
    if isinstance(psi, Affine):
        return Argument(name, (number_too,), lambda c: Affine(psi.G, c))
    if isinstance(psi, Constant):
        return Argument(name, (number_too,), Constant)
    if isinstance(psi, Elementwise) and psi.parameter_derivative is None:
        return Argument(name, (number_too,), lambda c: Elementwise(psi.fun, psi.derivative, psi.given_lipschitz, c))
    if isinstance(psi, Intervention) and psi.jumps is not None:
        jumps = psi.jumps
        best = psi.best
        return Argument(name, ([jumps.data.shape],), lambda gains: Intervention(_on(jumps, gains), best), jumps, True)
    raise InputError(
        f"{name} of the problem is {psi!r}, which is not made of one array: give solution_of a function {name}= that "
        "makes the map of parameters"
    )
