"""What conditions, equations and inequalities in CVXPY's terms have to be for an ICP."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cvxpy as cp

from ...errors import InputError
from .atoms import named
from .complementarity import BOUND_ATTRIBUTES, own_bounds


def pair(condition: Any) -> tuple[cp.Expression, cp.Expression]:
    """p and r as they were given. Raises InputError where they, or the bounds, are complex."""
    for side in (*condition.sides, *condition.bounds):
        if side is not None and side.is_complex():
            raise InputError(f"{named(side)} is complex; real expressions were expected: ICP is stated over the reals")
    p, r = condition.sides
    return p, r


def bounds_of(x: cp.Variable) -> list[cp.Constraint]:
    """The attributes of `x` as inequalities."""
    low, high = own_bounds(x)
    return [one for one in (low is not None and x >= low, high is not None and x <= high) if one is not False]


def check_constraints(equations: Sequence[cp.Constraint], inequalities: Sequence[cp.Constraint]) -> None:
    for one in (*equations, *inequalities):
        if one.is_complex():
            raise InputError(f"{named(one)} is complex; real expressions were expected")
    for one in inequalities:
        if not one.expr.is_affine():
            expected = "only affine ones are checked; ask its violation() after the solve"
            raise InputError(f"the inequality {named(one)} is not affine in the variables; {expected}")


def check_variables(variables: list[cp.Variable], rows: int, inequalities: bool) -> None:
    for x in variables:
        attributes = [name for name, value in x.attributes.items() if value and name not in BOUND_ATTRIBUTES]
        if attributes:
            actual = f"the variable {x.name()} has the attribute {attributes[0]}"
            raise InputError(f"{actual}; a variable of an ICP may have these alone: {', '.join(BOUND_ATTRIBUTES)}")
    unknowns = sum(x.size for x in variables)
    if rows != unknowns or not rows:
        entries = ", ".join(f"{x.name()} with {x.size}" for x in variables) or "no variables"
        actual = f"the conditions and equations have {rows} entries, the variables {unknowns} ({entries})"
        expected = "each entry of a variable needs one row of its own, a condition or an equation"
        more = "; inequalities are only checked: a <= b with a multiplier of its own is complements(b - a, multiplier)"
        raise InputError(f"{actual}; {expected}{more if inequalities else ''}")
