"""The conditions of a Pyomo model as rows of two sides, side 0 ≥ 0 ⟂ side 1 ≥ 0, each affine or with a nonlinear part.

A `Complementarity` has two arguments with two bounds in all. Their meaning is Pyomo's own standard form:

1. f ≥ a, g ≥ b, or ≤ on either, means f − a ≥ 0 ⟂ g − b ≥ 0, with a − f in place of f − a if f ≤ a.
2. f = a, g without bound, means f − a = 0, like an equality constraint.
3. a ≤ f ≤ b, g without bound, means g ≥ 0 where f = a, g ≤ 0 where f = b, g = 0 in between.

An infinite a or b is no bound. Then form 3 becomes form 1.

Reference: Ferris, Fourer and Gay, Expressing complementarity problems in an algebraic modeling language (1999),
doi 10.1137/S105262349833338X.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import pyomo.environ as pyo
from pyomo.common.numeric_types import native_numeric_types
from pyomo.core.expr.relational_expr import EqualityExpression, InequalityExpression, RangedExpression
from pyomo.mpec import Complementarity
from pyomo.mpec.complementarity import ComplementarityData
from pyomo.repn.linear import LinearRepnVisitor
from pyomo.repn.util import VarRecorder, categorize_valid_components

from ...errors import InputError
from ...theory.certificates.combination_rows import ZERO
from .nonlinear import NOT_FINITE, flattened
from .sums import size_of_terms


class Side(NamedTuple):
    """One side of a row: its constant, coefficients by variable id, and nonlinear part, `flattened`, or None."""

    constant: float
    linear: dict[int, float]
    nonlinear: Any = None

    def ids(self) -> list[int]:
        """The ids of its variables; some may occur twice."""
        return [*self.linear, *map(id, self.nonlinear[1] if self.nonlinear else ())]


class Condition(NamedTuple):
    """A condition, whose component is `owner`. In form 3 the sides are f − a and g, and `width` is b − a."""

    owner: Any
    sides: tuple[Side, Side]
    width: Side | None = None


class _Argument(NamedTuple):
    """lower ≤ body ≤ upper, None for no bound; `kind` is the class of the relation in Pyomo."""

    kind: Any
    lower: Any
    body: Any
    upper: Any

    def gaps(self) -> list[Any]:
        """The expressions that must be ≥ 0."""
        low = [] if self.lower is None else [self.body - self.lower]
        return low if self.upper is None else [*low, self.upper - self.body]


class ConditionRows:
    """The rows of a model. Raises InputError, with the component's name, if one is not of these forms.

    Attributes
    ----------
    conditions : list of Condition
    equations, inequalities : list
        (component, side), where the side must be 0, or ≥ 0.
    """

    def __init__(self, model: Any) -> None:
        self.conditions: list[Condition] = []
        self.equations: list[tuple[Any, Side]] = []
        self.inequalities: list[tuple[Any, Side]] = []
        self._recorder = VarRecorder({}, None)
        self._walk = LinearRepnVisitor({}, var_recorder=self._recorder).walk_expression
        readers = {
            pyo.Objective: self._read_objective,
            Complementarity: self._read_condition,
            pyo.Constraint: self._read_constraint,
        }
        data = {pyo.Block, pyo.Var, pyo.Param, pyo.Expression, pyo.Set, pyo.RangeSet, pyo.Suffix, pyo.ExternalFunction}
        _, unknown = categorize_valid_components(model, valid=data, targets=set(readers))
        if unknown:
            names = sorted(f"{kind.__name__} {components[0].name}" for kind, components in unknown.items())
            raise InputError(f"the model has the active {', '.join(names)}, which no complementarity problem has")
        for kind, read in readers.items():
            for component in model.component_data_objects(kind, active=True, descend_into=True):
                try:
                    read(component)
                except InputError:
                    raise
                except (ValueError, TypeError, OverflowError) as error:  # a number that is no float
                    raise InputError(f"{component.name} has a number that is {NOT_FINITE}") from error

    def sides(self) -> list[Side]:
        """Side 0 and side 1 of the conditions, then the widths, then the equations."""
        both = [one.sides[k] for k in (0, 1) for one in self.conditions]
        widths = [one.width for one in self.conditions if one.width]
        return [*both, *widths, *(side for _, side in self.equations)]

    def owners(self) -> list[Any]:
        """The components of the conditions, then those of the equations."""
        return [owner for owner, *_ in (*self.conditions, *self.equations)]

    def variables(self) -> list[Any]:
        """The variables that occur, in the order of the model."""
        seen = {key for side in self.sides() for key in side.ids()}
        return [variable for key, variable in self._recorder.var_map.items() if key in seen]

    def name_of(self, key: int) -> str:
        """The name of the variable with the id `key`."""
        return str(self._recorder.var_map[key].name)

    def _read_objective(self, objective: Any) -> None:
        if self._side(objective.expr, objective).ids():
            reason = "a complementarity problem has nothing to minimise; deactivate it, or take an MPEC solver"
            raise InputError(f"{objective.name} is an active Objective: {reason}")

    def _read_constraint(self, constraint: Any) -> None:
        argument = _Argument(None, *constraint.to_bounded_expression(evaluate_bounds=True))
        gaps = argument.gaps()
        if gaps and isinstance(constraint.parent_block(), ComplementarityData):
            name = constraint.parent_block().name
            actual = f"{name} was a Complementarity until a transformation, or a solver that needs one, rewrote it"
            raise InputError(f"{actual}: build the model again, or clone() it before")
        if len(gaps) == 2 and argument.lower == argument.upper:
            return self._add_equation(constraint, gaps[0])
        for gap in gaps:
            self._add_inequality(constraint, gap)

    def _read_condition(self, condition: Any) -> None:
        expressions = getattr(condition, "_args", None)
        if expressions is None:
            raise InputError(f"{condition.name} has no expressions; complements(..., ...) was expected")
        first, second = (_argument(one, condition) for one in expressions)
        for one, other in ((first, second), (second, first)):
            if not other.gaps() and one.kind is EqualityExpression:
                return self._add_equation(condition, one.gaps()[0])
            if not other.gaps() and one.kind is RangedExpression:
                return self._add_range(condition, one, other.body)
        gaps = first.gaps(), second.gaps()
        count = list(map(len, gaps))
        if count != [1, 1]:
            actual = f"{condition.name} has {count[0]} + {count[1]} bounds (an equality is two)"
            raise InputError(f"{actual}; a Complementarity has one on each side, or two on one of them")
        return self._add_condition(condition, *gaps[0], *gaps[1])

    def _add_range(self, owner: Any, one: _Argument, force: Any) -> None:
        """Add a ≤ f ≤ b ⟂ g, where `one` is a ≤ f ≤ b and `force` is g."""
        gaps = one.gaps()
        if not gaps:
            return self._add_equation(owner, force)
        if len(gaps) == 1:
            return self._add_condition(owner, gaps[0], force if one.upper is None else -force)
        side = self._side(gaps[0], owner)
        width = self._side(one.upper - one.lower, owner)
        if not width.ids():
            share = _share(width, one.upper - one.lower)
            if share < -ZERO:
                actual = f"{owner.name} has a lower bound that is larger than the upper one"
                raise InputError(f"{actual}, by {-width.constant:g}")
            if share <= ZERO:
                width = width._replace(constant=0.0)
                if not side.ids():  # g may have any value
                    return self._add_equation(owner, gaps[0])
        self.conditions.append(Condition(owner, (side, self._side(force, owner)), width))

    def _add_equation(self, owner: Any, zero: Any) -> None:
        side = self._side(zero, owner)
        if side.ids():
            self.equations.append((owner, side))
        else:
            _check_constant(owner, abs(_share(side, zero)), f"0 = {side.constant:g}")

    def _add_inequality(self, constraint: Any, gap: Any) -> None:
        """Add an inequality, `gap` ≥ 0 at the answer."""
        side = self._side(gap, constraint)
        if side.nonlinear:
            actual = f"{constraint.name} is a nonlinear inequality, and only affine ones are checked"
            raise InputError(f"{actual}: give it a partner, in Complementarity(expr=complements(..., ...))")
        if side.linear:
            self.inequalities.append((constraint, side))
        else:
            _check_constant(constraint, -_share(side, gap), f"{side.constant:g} >= 0")

    def _add_condition(self, owner: Any, *gaps: Any) -> None:
        first, second = sides = tuple(self._side(gap, owner) for gap in gaps)
        if first.ids() or second.ids():
            self.conditions.append(Condition(owner, (first, second)))
        else:
            words = f"the smaller of {first.constant:g} and {second.constant:g} is 0"
            _check_constant(owner, abs(min(map(_share, sides, gaps))), words)

    def _side(self, expression: Any, owner: Any) -> Side:
        term = self._walk(expression)
        if not all(map(math.isfinite, (term.constant, *term.linear.values()))):
            raise ValueError(NOT_FINITE)
        linear = {key: value for key, value in term.linear.items() if value}
        nonlinear = None if term.nonlinear is None else flattened(term.nonlinear, owner)
        return Side(float(term.constant), linear, nonlinear)


def _argument(expression: Any, condition: Any) -> _Argument:
    """Read an argument of a `condition`. Raises InputError if it is a strict inequality."""
    kind = expression.__class__
    if kind not in (EqualityExpression, InequalityExpression, RangedExpression):
        return _Argument(kind, None, expression, None)
    strict = getattr(expression, "_strict", False)
    if strict is True or (strict and any(strict)):  # one truth value, or one for each end
        raise InputError(f"{condition.name} has a strict inequality, {expression}; >= or <= was expected")
    low, *between, high = expression.args
    if kind is EqualityExpression:
        return _Argument(kind, high, low, high)
    if between:
        body = between[0]
    elif _is_number(high):
        low, body = None, low
    elif _is_number(low):
        body, high = high, None
    else:
        low, body, high = 0.0, high - low, None
    lower, upper = (None if _is(end, none) else end for end, none in ((low, -math.inf), (high, math.inf)))
    return _Argument(kind, lower, body, upper)


def _is_number(expression: Any) -> bool:
    return expression.__class__ in native_numeric_types or not expression.is_potentially_variable()


def _is(end: Any, number: float) -> bool:
    """Whether `end` is a number, or a parameter, with this value."""
    return end is not None and _is_number(end) and pyo.value(end, exception=False) == number


def _share(side: Side, expression: Any) -> float:
    """The value of an `expression` without variables, as a share of the sum of its |terms|."""
    return side.constant / size_of_terms(expression) if side.constant else 0.0


def _check_constant(owner: Any, violation: float, words: str) -> None:
    """Raise InputError if a row without variables is violated by more than rounding."""
    if not violation <= ZERO:
        raise InputError(f"{owner.name} has no free variable and cannot hold: {words}")
