"""What the adjoint gives: the gradient of a weighted answer in all data of the problem at once."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..algebra.equations import Pattern
from ..numerics.arrays import ReadOnly, Vector, freeze, locked, row_of
from ..present.shown import Shown, brief
from ..problem.between import sides_of
from ..problem.data import ProblemData


class Gradient(ReadOnly, Shown):
    """The gradient of z̄ᵀz* in A, q and ψ, z̄ a weight: with Jᵀw = z̄ it is −w in rows with p = 0, w in those at ψ.

    `q`, shape (n,); `A`, CSR on the pattern of A; `psi` in the form of ψ's own data: shape (n,) for a constant, an
    `AffineData` of G, on its pattern, and c, a CSR matrix of gains on the pattern of the jumps, shape (m,) for a user's
    map with a `parameter_derivative`, and for another one that in its values; `upper` the like of ψ̄, None where there
    is none. `psi_values` and `upper_values` are those in the values ψ(z) and ψ̄(z), shape (n,), whatever the map is.
    What takes a pass over A is computed when it is asked for.

    >>> gradient = icp.Derivative(ICP([[2, -1], [-1, 2]], [-1, 3], psi=-1.0).solve()).adjoint([1.0, 0.0])
    >>> gradient.q, gradient.psi
    (array([-0.5,  0. ]), array([0. , 0.5]))
    """

    def __init__(self, problem: ProblemData, z: Vector, pattern: Pattern, w: Vector) -> None:
        active, above = pattern.active, pattern.above
        self.problem, self.z = problem, z
        self.q: Vector = np.where(active, 0.0, -w)
        at_upper = np.zeros_like(active) if above is None else above
        self.psi_values: Vector = np.where(active & ~at_upper, w, 0.0)
        self.upper_values: Vector | None = None if above is None else np.where(above, w, 0.0)
        self.lock()

    @cached_property
    @np.errstate(over="ignore", invalid="ignore", under="ignore")
    def A(self) -> sp.csr_array:
        """The gradient in the entries of A that are stored, CSR, shape (n, n).

        >>> icp.Derivative(ICP([[2.0]], [-2.0]).solve()).adjoint([1.0]).A.toarray()
        array([[-0.5]])
        """
        A = self.problem.A
        return freeze(sp.csr_array((self.q[row_of(A)] * self.z[A.indices], A.indices, A.indptr), shape=A.shape))

    @cached_property
    @np.errstate(over="ignore", invalid="ignore", under="ignore")
    def psi(self) -> Any:
        """The gradient in ψ's own data, in their form.

        >>> icp.Derivative(ICP([[2.0]], [2.0], psi=3).solve()).adjoint([1.0]).psi
        array([1.])
        """
        return locked(sides_of(self.problem.psi)[0].data_gradient(self.z, self.psi_values))

    @cached_property
    @np.errstate(over="ignore", invalid="ignore", under="ignore")
    def upper(self) -> Any:
        """The same of the obstacle above, None where there is none.

        >>> icp.Derivative(ICP([[2.0]], [-8.0], upper=3).solve()).adjoint([1.0]).upper
        array([1.])
        """
        upper = self.problem.upper
        if upper is None or self.upper_values is None:
            return None
        return locked(upper.data_gradient(self.z, self.upper_values))

    def __repr__(self) -> str:
        return f"Gradient(q={brief(self.q)}, psi_values={brief(self.psi_values)})"
