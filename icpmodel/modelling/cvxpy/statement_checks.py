"""The parts of a CVXPY model, and checks that they state an ICP."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import cvxpy as cp

from ...errors import InputError
from .atoms import at, named
from .complementarity import BOUND_ATTRIBUTES, Complementarity, own_bounds


class Part(NamedTuple):
    """Expressions, stacked column by column, each with the constraint that it is in."""

    owners: Sequence[Any]
    expressions: list[cp.Expression]

    @property
    def size(self) -> int:
        """The number of rows."""
        return sum(one.size for one in self.expressions)

    def row_name(self, row: int) -> str:
        """The constraint of the `row` as it was written, and the entry."""
        number, place = at(self.expressions, row)
        owner = self.owners[number]
        words = str(owner) if isinstance(owner, Complementarity) else named(owner)
        return words + (place and f", entry {place},")


def bounds_of(x: cp.Variable) -> list[cp.Constraint]:
    """The bounds that the attributes of `x` state, as inequalities."""
    low, high = own_bounds(x)
    return [one for one in (low is not None and x >= low, high is not None and x <= high) if one is not False]


def check_parts(parts: list[Part], inequalities: Part, variables: list[cp.Variable], rows: int) -> None:
    """Raise InputError for a complex part, a nonlinear inequality, another attribute, or a wrong number of `rows`."""
    for one in (one for part in parts for one in part.expressions):
        if one.is_complex():
            raise InputError(f"{named(one)} is complex; real expressions were expected: ICP is stated over the reals")
    for constraint, one in zip(*inequalities, strict=True):
        if not one.is_affine():
            expected = "only affine ones are checked; ask its violation() after the solve"
            raise InputError(f"the inequality {named(constraint)} is not affine in the variables; {expected}")
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
        raise InputError(f"{actual}; {expected}{more if inequalities.owners else ''}")
