"""ψ as a Python function of the whole vector."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import InputError, MapError, check_arguments
from ..numerics.arrays import Vector, as_csr, as_float64, axes, locked, row_of
from ..numerics.labels import check_labels
from ..numerics.rounding import UNIT_ROUNDOFF
from .differences import colours, jacobian_by_differences
from .user_code import Parametrised, as_function, call_user, diagonal_lipschitz, raising_map_error


class Function(Parametrised):
    """ψ given by a Python function of the whole vector.

    Parameters
    ----------
    fun : callable
        z ↦ ψ(z), both of shape (n,).
    jacobian : callable, optional
        Maps z to an element of the generalised Jacobian, shape (n, n), dense or sparse.
    lipschitz : array_like or sparse of shape (n, n), float or array_like of shape (n,), optional
        The matrix G ≥ 0. A number or a vector stands for diag(ℓ), and thus says that ψ_i depends on
        z_i only. A `jacobian` with an entry where G has 0 is a MapError at the first z where it is
        evaluated.
    sparsity : array_like or sparse of shape (n, n), optional
        A matrix with an entry wherever ψ_i may depend on z_j. Where no `jacobian` is given it is then
        made by differences, one value of ψ for each group of columns that share no row.
    parameter_derivative : callable, optional
        For `icpmodel.Derivative`: maps z to the derivative of ψ(z) in m parameters of yours. Its
        shape is (n, m), dense or sparse, or (n,) for one parameter.

    Examples
    --------
    >>> psi = Function(lambda z: 0.5 * z[::-1], lipschitz=[[0, 0.5], [0.5, 0]]).bind(2)
    >>> psi.value(np.array([2.0, 4.0]))
    array([2., 1.])
    """

    calls_user_code = True
    #: the argument of `ICP`, for messages
    name: str = "psi"

    @check_arguments
    def __init__(
        self,
        fun: Callable[[Vector], Any],
        jacobian: Callable[[Vector], Any] | None = None,
        lipschitz: Any = None,
        *,
        sparsity: Any = None,
        parameter_derivative: Callable[[Vector], Any] | None = None,
    ) -> None:
        super().__init__(parameter_derivative)
        self.index = check_labels({"Function.lipschitz": lipschitz})
        self.fun = as_function(fun, "Function.fun")
        self.derivative = None if jacobian is None else as_function(jacobian, "Function.jacobian")
        checked: Any = None
        if lipschitz is not None:
            name = "Function.lipschitz"
            checked = (as_csr if axes(lipschitz, name) == 2 else as_float64)(lipschitz, name)
        self.given_lipschitz = locked(checked)
        if sparsity is not None:
            self.links = as_csr(sparsity, "Function.sparsity")

    def bind(self, n: int) -> Function:
        bound = Function(
            self.fun,
            self.derivative,
            self.given_lipschitz,
            sparsity=self.links,
            parameter_derivative=self.parameter_derivative,
        )
        if self.links is not None and self.links.shape != (n, n):
            raise InputError(f"Function.sparsity has shape {self.links.shape}; shape ({n}, {n}) was expected")
        if sp.issparse(self.given_lipschitz):
            G = as_csr(self.given_lipschitz, "Function.lipschitz", n)
            if (G.data < 0).any():
                raise InputError(f"Function.lipschitz has the entry {G.data.min()}; entries >= 0 were expected")
            bound.lipschitz = G
        elif self.given_lipschitz is not None:
            bound.lipschitz = diagonal_lipschitz(self.given_lipschitz, n, "Function.lipschitz")
        return bound

    def as_upper(self) -> Function:
        above = copy(self)
        above.name = "upper"
        return above

    def value(self, z: Vector) -> Vector:
        return call_user(lambda: self.fun(z.copy()), z.shape, self.name)

    def jacobian(self, z: Vector) -> sp.csr_array | None:
        derivative = self.derivative
        if derivative is None:
            if self.links is None:
                return None
            name = f"the Jacobian of {self.name}"
            matrix: Any = jacobian_by_differences(self.value, z, self.links, self._colours)
        else:
            function = derivative
            name = "Function.jacobian(z)"
            matrix = raising_map_error(lambda: function(z.copy()), "Function.jacobian")
        try:
            J = as_csr(matrix, name, z.size)
        except InputError as error:
            raise MapError(str(error)) from None
        if derivative is not None and self.lipschitz is not None:
            _check_links(J, self.lipschitz)
        return J

    def no_derivative(self) -> str | None:
        known = self.derivative is not None or self.links is not None
        return (
            None
            if known
            else "psi has no derivative: give `jacobian` to Function, or sparsity=np.ones((n, n)) for differences"
        )

    @cached_property
    def _colours(self) -> NDArray[np.intp]:
        return colours(self.links)

    def with_sparsity(self, pattern: Any) -> Function:
        """The same function with a Jacobian made by differences on a sparsity pattern.

        Parameters
        ----------
        pattern : array_like or sparse matrix of shape (n, n)
            Its nonzero entries are those of the Jacobian that may be nonzero.

        Returns
        -------
        Function
            A copy.

        Examples
        --------
        >>> psi = Function(lambda z: z**2).bind(1).with_sparsity(np.ones((1, 1)))
        >>> psi.jacobian(np.ones(1)).toarray().round(6)
        array([[2.]])
        """
        named = self.parameter_derivative
        new = Function(self.fun, None, self.given_lipschitz, sparsity=pattern, parameter_derivative=named)
        return new.bind(np.shape(pattern)[0])

    def __repr__(self) -> str:
        return f"Function({getattr(self.fun, '__name__', 'psi')})"


def _check_links(J: sp.csr_array, G: sp.csr_array) -> None:
    """Raise MapError where the Jacobian `J` has an entry beyond rounding where the Lipschitz matrix `G` has 0."""
    outside = sp.csr_array(J - J.multiply(G != 0.0))
    rounding = J.shape[0] * UNIT_ROUNDOFF * abs(J).max(axis=1).toarray().reshape(-1)
    excess = np.abs(outside.data) - rounding[row_of(outside)]
    if excess.max(initial=0.0) > 0.0:
        k = int(np.argmax(excess))
        i, j = row_of(outside)[k], outside.indices[k]
        raise MapError(
            f"Function.jacobian(z) has the entry {J[i, j]:.6g} in row {i}, column {j}, but by Function.lipschitz "
            f"row {i} does not depend on z_{j}: a number or a vector is a diagonal; give a matrix with that entry"
        )
