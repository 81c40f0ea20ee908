"""The result of the adjoint: the gradient of a weighted answer in all data of the problem at once."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..algebra.equations import Pattern
from ..numerics.arrays import ReadOnly, Vector, freeze, locked, row_of, with_entries
from ..present.display import Displayable, brief
from ..problem.data import ProblemData
from ..problem.two_sided import sides_of


class Gradient(ReadOnly, Displayable):
    """The gradient of z̄ᵀz* in A, q and ψ, for a weight z̄.

    Attributes
    ----------
    q : array of shape (n,)
        Gradient in q.
    A : CSR array of shape (n, n)
        Gradient in A, on the pattern of A.
    psi
        Gradient in the data of ψ. Shape (n,) for a constant. An `AffineData` of G, on its pattern,
        and c. A CSR matrix of gains on the pattern of the jumps. Shape (m,) for a user's map with a
        `parameter_derivative`; for another one the gradient in its values.
    upper
        The same for ψ̄, None where there is none.
    psi_values, upper_values : array of shape (n,)
        Gradients in the values ψ(z) and ψ̄(z), whatever the map is.

    Notes
    -----
    With Jᵀw = z̄ the gradient in q is −w in the free rows, and that in the values of ψ is w in the rows
    at ψ; elsewhere both are 0. `A`, `psi` and `upper` are computed when they are first read.

    Examples
    --------
    >>> solution = ICP([[2, -1], [-1, 2]], [-1, 3], psi=-1.0).solve()
    >>> gradient = icp.Derivative(solution).adjoint([1.0, 0.0])
    >>> gradient.q, gradient.psi
    (array([-0.5,  0. ]), array([0. , 0.5]))
    """

    def __init__(self, problem: ProblemData, z: Vector, pattern: Pattern, w: Vector) -> None:
        self.problem, self.z = problem, z
        self.q: Vector = np.where(pattern.active, 0.0, -w)
        values = [np.where(rows, w, 0.0) for rows in pattern.sides()]
        self.psi_values: Vector = values[0]
        self.upper_values: Vector | None = values[1] if len(values) > 1 else None
        self.lock()

    @cached_property
    @np.errstate(over="ignore", invalid="ignore", under="ignore")
    def A(self) -> sp.csr_array:
        """The gradient in the entries of A that are stored, CSR, shape (n, n).

        Examples
        --------
        >>> icp.Derivative(ICP([[2.0]], [-2.0]).solve()).adjoint([1.0]).A.toarray()
        array([[-0.5]])
        """
        A = self.problem.A
        return freeze(with_entries(A, self.q[row_of(A)] * self.z[A.indices]))

    @cached_property
    @np.errstate(over="ignore", invalid="ignore", under="ignore")
    def psi(self) -> Any:
        """The gradient in ψ's own data, in their form.

        Examples
        --------
        >>> icp.Derivative(ICP([[2.0]], [2.0], psi=3).solve()).adjoint([1.0]).psi
        array([1.])
        """
        return locked(sides_of(self.problem.psi)[0].data_gradient(self.z, self.psi_values))

    @cached_property
    @np.errstate(over="ignore", invalid="ignore", under="ignore")
    def upper(self) -> Any:
        """The gradient in the data of the upper obstacle, None where there is none.

        Examples
        --------
        >>> icp.Derivative(ICP([[2.0]], [-8.0], upper=3).solve()).adjoint([1.0]).upper
        array([1.])
        """
        upper = self.problem.upper
        if upper is None or self.upper_values is None:
            return None
        return locked(upper.data_gradient(self.z, self.upper_values))

    def __repr__(self) -> str:
        return f"Gradient(q={brief(self.q)}, psi_values={brief(self.psi_values)})"
