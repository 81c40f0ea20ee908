"""Maps that are defined by a user's functions."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import InputError, MapError
from ..numerics.arrays import Vector, as_array, as_csr, as_float64, as_rows, as_vector, axes, freeze, locked
from .differences import colours, jacobian_by_differences
from .map import Map
from .user_code import as_function, as_map_error, call


class UserMap(Map):
    """A map defined by a user's functions `fun` and `derivative`; `function_names` are their argument names.

    `given_lipschitz` are the Lipschitz constants as given: a number, a vector, a matrix or None.
    """

    calls_user_code = True
    function_names: ClassVar[tuple[str, str]]

    def __init__(
        self,
        fun: Callable[[Any], Any],
        derivative: Callable[[Any], Any] | None,
        lipschitz: Any,
        parameter_derivative: Callable[[Vector], Any] | None,
    ) -> None:
        self.fun = as_function(fun, self._argument(self.function_names[0]))
        names = self.function_names[1], "parameter_derivative"
        for name, function in zip(names, (derivative, parameter_derivative), strict=True):
            if function is not None:
                as_function(function, self._argument(name))
        self.derivative = derivative
        self.parameter_derivative = parameter_derivative
        if lipschitz is not None:
            name = self._argument("lipschitz")
            lipschitz = (as_csr if axes(lipschitz, name) == 2 else as_float64)(lipschitz, name)
        self.given_lipschitz = locked(lipschitz)

    def _argument(self, name: str) -> str:
        return f"{type(self).__name__}.{name}"

    def bind(self, n: int) -> Self:
        bound = copy(self)
        given = self.given_lipschitz
        name = self._argument("lipschitz")
        if sp.issparse(given):
            given = as_csr(given, name, n)
        elif given is not None:
            given = freeze(sp.csr_array(sp.diags_array(as_vector(given, n, name))))
        if given is not None and (given.data < 0).any():
            raise InputError(f"{name} has the entry {given.data.min()}; numbers >= 0 were expected")
        vars(bound).update(lipschitz=given)
        if self.links is not None and self.links.shape != (n, n):
            raise InputError(f"{self._argument('sparsity')} has shape {self.links.shape}; ({n}, {n}) was expected")
        return bound

    def jacobian(self, z: Vector) -> sp.csr_array | None:
        """The Jacobian by differences on the sparsity pattern; None where that is not known."""
        return None if self.links is None else jacobian_by_differences(self.value, z, self.links, self._colours)

    @cached_property
    def _colours(self) -> NDArray[np.intp]:
        return colours(self.links)

    def with_sparsity(self, pattern: Any) -> Self:
        """The same map with a Jacobian made by differences on a sparsity pattern.

        Parameters
        ----------
        pattern : array_like or sparse matrix of shape (n, n)
            Its nonzero entries are those of the Jacobian that may be nonzero.

        Returns
        -------
        UserMap
            A copy.

        Examples
        --------
        >>> psi = icp.Function(lambda z: z**2).bind(1).with_sparsity(np.ones((1, 1)))
        >>> psi.jacobian(np.ones(1)).toarray().round(6)
        array([[2.]])
        """
        new = copy(self)
        vars(new).pop("_colours", None)  # those of the old pattern
        vars(new).update(derivative=None, links=as_csr(pattern, self._argument("sparsity")))
        return new

    def data_change(self, z: Vector, change: Any, name: str) -> tuple[sp.csr_array | None, Vector]:
        if self.parameter_derivative is None:
            return super().data_change(z, change, name)
        D = self._by_parameters(z)
        return None, np.asarray(D @ as_vector(change, D.shape[1], name))

    def data_gradient(self, z: Vector, weight: Vector) -> Any:
        return weight if self.parameter_derivative is None else np.asarray(self._by_parameters(z).T @ weight)

    def _by_parameters(self, z: Vector) -> Any:
        """∂ψ(z)/∂θ, shape (n, m), m the number of parameters."""
        name = self._argument("parameter_derivative")
        assert self.parameter_derivative is not None
        D = call(self.parameter_derivative, z, name)
        with as_map_error():
            D = as_rows(D if axes(D, name) != 1 else as_array(D, name)[:, None], f"{name}(z)")
        if D.shape[0] != z.size:
            raise MapError(f"{name}(z) has shape {D.shape}; a row for each unknown, ({z.size}, m), was expected")
        return D

    def __repr__(self) -> str:
        return f"{type(self).__name__}({getattr(self.fun, '__name__', self.function_names[0])})"
