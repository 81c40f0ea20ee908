"""The certified active set: which rows are proved to touch the obstacle, and which not.

With |z − z*| ≤ δ: p_i(z) − Σ|a_ij|δ_j > 0 proves p_i(z*) > 0, hence r_i(z*) = 0; r_i(z) − δ_i − Δψ_i > 0, Δψ a bound on
|ψ(z) − ψ(z*)|, proves r_i(z*) > 0, hence p_i(z*) = 0. Once every row is decided z* solves one system of equations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...numerics.arrays import described
from ...numerics.rounding import UNIT_ROUNDOFF, upper
from ...problem.data import ProblemData, as_problem
from .bounds import ErrorBound


@dataclass(frozen=True, eq=False)
class ActiveSet:
    """The rows that are proved to be `active` (p* > 0, r* = 0) and `inactive` (r* > 0, p* = 0); masks of shape (n,).

    >>> problem = ICP([[2, -1], [-1, 2]], [-1, 3])
    >>> print(problem.solve().active_set)
    1 at the obstacle, 1 off it, 0 undecided
    """

    active: NDArray[np.bool_]
    inactive: NDArray[np.bool_]

    @property
    def undecided(self) -> NDArray[np.bool_]:
        """The rows of which nothing is proved: too near to both, or no error bound.

        >>> ICP([[2.0]], [0.0]).solve().active_set.undecided
        array([ True])
        """
        return ~(self.active | self.inactive)

    def __str__(self) -> str:
        at, off, open_rows = (int(mask.sum()) for mask in (self.active, self.inactive, self.undecided))
        return f"{at} at the obstacle, {off} off it, {open_rows} undecided"


def active_set(problem: ProblemData, z: Any, bound: ErrorBound) -> ActiveSet:
    """The active set of z* as far as `bound` proves it, the error bound of this very `z` on this very `problem`.

    Bounds on the rounding errors are included. Nothing is decided where there is no bound, nor where p* = r* = 0.
    Parameters: `z` shape (n,), or a `Solution`; `bound` = `error_bound(problem, z)`. That it is the bound of this z and
    no other cannot be checked: with another one the answer is no proof. Returns an `ActiveSet`. Raises InputError where
    `bound` is no `ErrorBound`, or one of another n.

    >>> from icpmodel.theory import error_bound
    >>> problem, z = ICP([[2.0]], [-2.0]), np.array([1.25])
    >>> active_set(problem, z, error_bound(problem, z)).inactive
    array([ True])
    """
    z, nothing = as_problem(problem).vector(z), np.zeros(problem.n, dtype=bool)
    if not isinstance(bound, ErrorBound):
        raise InputError(f"bound is {described(bound)}; error_bound(problem, z), an ErrorBound, was expected")
    delta = bound.componentwise
    if delta is not None and delta.size != problem.n:
        raise InputError(f"bound is that of {delta.size} unknowns; {problem.n} were expected")
    change = None if delta is None else problem.psi.change(delta)
    if delta is None or change is None:
        return ActiveSet(nothing, nothing)
    for_p, for_r = problem.rounding(z)
    inflate = 1 + 8 * UNIT_ROUNDOFF
    with np.errstate(over="ignore", invalid="ignore"):
        active = problem.p(z) > (for_p + upper(problem.matrix.absolute, delta)) * inflate
        inactive = problem.r(z) > (for_r + delta + change) * inflate
    return ActiveSet(active & ~inactive, inactive & ~active)
