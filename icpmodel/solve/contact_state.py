"""The state of contacts with friction at a solution: impulses, and which contacts separate, stick and slide."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError, NotApplicable, check_arguments
from ..numerics.arrays import Mask, ReadOnly, Vector, described
from ..present.display import Displayable
from ..problem.friction import FrictionIndex
from .solution import Solution


@dataclass(frozen=True, eq=False, repr=False)
class ContactState(ReadOnly, Displayable):
    """The state of every row of a contact problem, made by `contact_state`.

    Attributes
    ----------
    impulses : ndarray, shape (n,)
        z, in the units of momentum where A is an inverse mass.
    velocities : ndarray, shape (n,)
        w = Az − b after the impulses.
    separating : ndarray of bool, shape (n,)
        Normal rows without impulse that separate, and the friction rows of these contacts.
    sticking : ndarray of bool, shape (n,)
        Friction rows of touching contacts that do not move along the row.
    sliding : ndarray of bool, shape (n,)
        Friction rows of touching contacts that move along the row; their impulse is at a bound.

    Examples
    --------
    >>> problem = ICP.from_friction_index(
    ...     np.eye(2), [1, -3], [0, -0.5], [np.inf, 0.5], [-1, 0]
    ... )
    >>> icp.contact_state(problem.solve())
    2 rows: 0 separating, 0 sticking, 1 sliding
    """

    impulses: Vector
    velocities: Vector
    separating: Mask
    sticking: Mask
    sliding: Mask

    def __str__(self) -> str:
        names = ("separating", "sticking", "sliding")
        counts = (f"{int(getattr(self, name).sum())} {name}" for name in names)
        return f"{self.impulses.size} rows: {', '.join(counts)}"

    __repr__ = __str__


@check_arguments
def contact_state(solution: Solution) -> ContactState:
    """Return the impulses of a solution, and which of its rows separate, stick and slide.

    Parameters
    ----------
    solution : Solution
        A solution of a problem made by `ICP.from_friction_index`, or such a row of `solve_many`.

    Returns
    -------
    ContactState
        Masks by row; a normal row that touches is in none of them.

    Raises
    ------
    NotApplicable
        Where the problem has no friction index.

    Notes
    -----
    A row moves where |w_i|, in the units of z, exceeds the sum of the solution's tolerance and the rounding error of
    w_i. A friction row whose impulse is at a bound without motion, as in redundant contacts, counts as sticking.

    Examples
    --------
    >>> problem = ICP.from_friction_index(
    ...     np.eye(2), [1, -3], [0, -0.5], [np.inf, 0.5], [-1, 0]
    ... )
    >>> state = icp.contact_state(problem.solve())
    >>> state.impulses, state.sliding
    (array([ 1. , -0.5]), array([False,  True]))
    """
    if not isinstance(solution, Solution):
        raise InputError(f"solution is {described(solution)}; what solve() returns was expected")
    psi: Any = solution.problem.psi
    if not isinstance(psi, FrictionIndex):
        raise NotApplicable(f"psi is {psi!r}; a problem made by ICP.from_friction_index was expected")
    problem = solution.problem
    tolerance = solution.tolerance
    weights = problem.matrix.row_weights
    rounding = problem.rounding(solution.z)[0]
    moving = weights * np.abs(solution.p) > tolerance + weights * rounding
    friction = psi.friction
    opening = moving & ~friction & (psi.low == 0.0) & np.isposinf(psi.high)
    separating = opening | (friction & opening[psi.findex])
    touching = friction & ~separating
    return ContactState(
        impulses=solution.z,
        velocities=solution.p,
        separating=separating,
        sticking=touching & ~moving,
        sliding=touching & moving,
    )
