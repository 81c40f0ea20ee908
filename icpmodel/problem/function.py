"""ψ as a Python function of the whole vector."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import MapError, check_arguments
from ..numerics.arrays import Vector, as_csr, row_of
from ..numerics.labels import check_labels
from ..numerics.rounding import UNIT_ROUNDOFF
from .user_code import as_map_error, call, call_for_vector
from .user_map import UserMap


class Function(UserMap):
    """ψ given by a Python function of the whole vector.

    Parameters
    ----------
    fun : callable
        z ↦ ψ(z), both of shape (n,).
    jacobian : callable, optional
        Maps z to an element of the generalised Jacobian, shape (n, n), dense or sparse.
    lipschitz : array_like or sparse of shape (n, n), float or array_like of shape (n,), optional
        The matrix G ≥ 0. A number or a vector stands for diag(ℓ), and thus says that ψ_i depends on
        z_i only. A `jacobian` with an entry where G has 0 raises MapError at the first z where it is
        evaluated.
    sparsity : array_like or sparse of shape (n, n), optional
        A matrix with an entry wherever ψ_i may depend on z_j. Without `jacobian` the Jacobian is then
        approximated by differences, with one value of ψ for each group of columns that share no row.
    parameter_derivative : callable, optional
        For `icpmodel.Derivative`: maps z to the derivative of ψ(z) with respect to m parameters of yours.
        Its shape is (n, m), dense or sparse, or (n,) for one parameter.

    Examples
    --------
    >>> psi = Function(lambda z: 0.5 * z[::-1], lipschitz=[[0, 0.5], [0.5, 0]]).bind(2)
    >>> psi.value(np.array([2.0, 4.0]))
    array([2., 1.])
    """

    function_names = ("fun", "jacobian")
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
        super().__init__(fun, jacobian, lipschitz, parameter_derivative)
        self.index = check_labels({"Function.lipschitz": lipschitz})
        if sparsity is not None:
            self.links = as_csr(sparsity, "Function.sparsity")

    def as_upper(self) -> Function:
        above = copy(self)
        vars(above)["name"] = "upper"
        return above

    def value(self, z: Vector) -> Vector:
        return call_for_vector(self.fun, z, self.name)

    def jacobian(self, z: Vector) -> sp.csr_array | None:
        derivative = self.derivative
        if derivative is None and self.links is None:
            return None
        name = f"the Jacobian of {self.name}" if derivative is None else "Function.jacobian(z)"
        matrix = super().jacobian(z) if derivative is None else call(derivative, z, "Function.jacobian")
        with as_map_error():
            J = as_csr(matrix, name, z.size)
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
