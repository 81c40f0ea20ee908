"""What conditions, equations and inequalities in CVXPY's terms have to be for an ICP."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cvxpy as cp

from ...errors import InputError
from .atoms import named
from .complementarity import BOUNDING, own_bounds

#: what to write where both sides are nonlinear
_NONLINEAR = "icpmodel.ICP(A, q, psi, f=...) and a model in Pyomo take nonlinear p"


def pair(condition: Any) -> tuple[cp.Expression, cp.Expression]:
    """p and r, as they are where r has bounds of its own; else the affine one first."""
    a, b = condition.sides
    for side in (*condition.sides, *condition.bounds):
        if side is not None and side.is_complex():
            raise InputError(f"{named(side)} is complex; real expressions were expected: ICP is stated over the reals")
    if condition.is_bounded and not a.is_affine():
        found = f"p = {named(a)} is not affine in the variables; lower and upper are bounds of the second one"
        raise InputError(f"{found}: {_NONLINEAR}")
    if not a.is_affine() and not b.is_affine():
        found = f"neither {named(a)} nor {named(b)} is affine in the variables; p = Az + q must be"
        raise InputError(f"{found}: {_NONLINEAR}")
    return (a, b) if a.is_affine() else (b, a)


def bounds_of(x: cp.Variable) -> list[cp.Constraint]:
    """What the attributes of `x` say, as inequalities."""
    low, high = own_bounds(x)
    return [one for one in (low is not None and x >= low, high is not None and x <= high) if one is not False]


def check_affine(constraints: Sequence[cp.Constraint], kind: str, wanted: str) -> None:
    for one in constraints:
        if one.is_complex() or not one.expr.is_affine():
            what = "complex" if one.is_complex() else "not affine in the variables"
            raise InputError(f"the {kind} {named(one)} is {what}; {wanted}")


def check_variables(variables: list[cp.Variable], rows: int, inequalities: bool) -> None:
    for x in variables:
        given = [name for name, value in x.attributes.items() if value and name not in BOUNDING]
        if given:
            found = f"the variable {x.name()} has the attribute {given[0]}"
            raise InputError(f"{found}; a variable of an ICP may have these attributes alone: {', '.join(BOUNDING)}")
    unknowns = sum(x.size for x in variables)
    if rows != unknowns or not rows:
        entries = ", ".join(f"{x.name()} with {x.size}" for x in variables) or "no variables"
        found = f"the conditions and equations have {rows} entries, the variables {unknowns} ({entries})"
        wanted = "each entry of a variable needs one row of its own, a condition with r = z - psi(z) or an equation"
        more = "; inequalities are only checked: a <= b with a multiplier of its own is complements(b - a, multiplier)"
        raise InputError(f"{found}; {wanted}{more if inequalities else ''}")
