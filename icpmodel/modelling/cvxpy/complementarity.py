"""The condition p ≥ 0 ⟂ r ≥ 0 between two CVXPY expressions, and what messages call expressions and their entries."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from typing import Any

import cvxpy as cp
import numpy as np

from ...errors import InputError
from ...numerics.arrays import Vector, described

#: constants with more entries than this are not printed
_PRINTED = 20


class Complementarity:
    """p ≥ 0, r ≥ 0, pᵀr = 0, entry by entry, between two CVXPY expressions of one shape; `complements` makes it.

    `sides` the two as they were given. After a solve `p` and `r` are their values, in the shape of the expressions:
    each is the multiplier of the other one's sign. Before, and after a solve that failed, they are None.

    >>> import cvxpy as cp
    >>> z = cp.Variable(2)
    >>> contact = icp.complements(2 * z - [2, -2], z)
    >>> _ = icp.Problem([contact]).solve()
    >>> z.value, contact.p, contact.r
    (array([1., 0.]), array([0., 2.]), array([1., 0.]))
    """

    def __init__(self, first: cp.Expression, second: cp.Expression) -> None:
        self.sides = (first, second)
        self.p: np.ndarray | None = None
        self.r: np.ndarray | None = None

    def __repr__(self) -> str:
        return f"complements({named(self.sides[0])}, {named(self.sides[1])})"


def complements(p: Any, r: Any) -> Complementarity:
    """The constraint p ≥ 0 ⟂ r ≥ 0 of a `Problem`: p = Az + q affine, r = z − ψ(z).

    Parameters: `p` and `r`, CVXPY expressions of one shape. Where only one of them can be r, because the other is not
    affine, or does not have one entry of z for itself in each row, their order does not matter.
    Returns a `Complementarity`. Raises InputError where they are no such expressions.

    >>> import cvxpy as cp
    >>> z = cp.Variable(2, name="z")
    >>> icp.complements(2 * z - 1, z - 3)
    complements(2.0 * z + -1.0, z + -3.0)
    """
    p, r = _expression(p), _expression(r)
    if p.shape != r.shape:
        raise InputError(
            f"complements(p, r) goes entry by entry: p = {named(p)} has shape {p.shape}, r = {named(r)} {r.shape}"
        )
    return Complementarity(p, r)


def _expression(side: Any) -> cp.Expression:
    if isinstance(side, cp.Constraint):
        raise InputError(f"complements was given the constraint {side}; give the two expressions p and r without >= 0")
    if isinstance(side, cp.Expression):
        return side
    try:
        if side is not None:  # CVXPY would make NaN of it
            return cp.Expression.cast_to_const(side)
    except Exception:
        pass
    raise InputError(f"complements was given {described(side)}; CVXPY expressions were expected")


def named(expression: cp.Expression) -> str:
    """What a message calls `expression`: its label, else its text where that is short enough."""
    if expression.label is None and any(constant.size > _PRINTED for constant in expression.constants()):
        names = ", ".join(x.name() for x in expression.variables())
        return f"an expression of shape {expression.shape}" + (f" in {names}" if names else "")
    text = re.sub(r"Promote\(([^()]*), \([\d, ]*\)\)", r"\1", expression.format_labeled())
    return textwrap.shorten(text, 80, placeholder=" ...")


def at(stacked: Sequence[cp.Expression], k: int) -> tuple[int, str]:
    """Which of the `stacked` expressions has the `k`-th of all their numbers, and in which entry, as "[i, j]"; ""
    where it is the only one."""
    number = 0
    while k >= stacked[number].size:
        k -= stacked[number].size
        number += 1
    x = stacked[number]
    index = np.unravel_index(k, x.shape, order="F")
    return number, f"[{', '.join(str(int(i)) for i in index)}]" if x.size > 1 else ""


def unstacked(z: Vector, like: Sequence[cp.Expression]) -> list[np.ndarray]:
    """The parts of `z`, one for each expression of `like` and in its shape, column by column."""
    ends = np.cumsum([x.size for x in like])[:-1]
    return [part.reshape(x.shape, order="F").copy() for x, part in zip(like, np.split(z, ends), strict=True)]
