"""The two arguments of a `Complementarity`, each an expression with no, one or two bounds."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from pyomo.common.numeric_types import native_numeric_types
from pyomo.core.expr.numvalue import value
from pyomo.core.expr.relational_expr import EqualityExpression, InequalityExpression, RangedExpression

from ...errors import InputError

#: a sum of expressions, each with its factor
Terms = tuple[tuple[float, Any], ...]


class BoundedArgument(NamedTuple):
    """One argument of a condition: what must be ≥ 0 (or, of an equality, = 0), and the expression itself."""

    bounds: tuple[Terms, ...]
    body: Terms
    equality: bool = False
    ends: tuple[Terms, ...] = ()


def bounded_argument(expression: Any, condition: Any) -> BoundedArgument:
    """`expression` with its bounds. Raises InputError, with the name of its `condition`, where one is strict."""
    kind = expression.__class__
    if kind is EqualityExpression:
        left, right = expression.args
        return BoundedArgument((((1.0, left), (-1.0, right)),), (), equality=True)
    if kind not in (InequalityExpression, RangedExpression):
        return BoundedArgument((), ((1.0, expression),))
    strict = expression._strict
    if strict is True or (strict and any(strict)):  # one truth value, or one for each end
        raise InputError(f"{condition.name} has a strict inequality, {expression}; >= or <= was expected")
    low, *between, high = map(_number, expression.args)
    if between:
        ends: list[Terms] = [((1.0, between[0]), (-1.0, low)), ((1.0, high), (-1.0, between[0]))]
        return BoundedArgument(_finite(ends), ((1.0, between[0]),), ends=tuple(ends))
    ends = [((1.0, high), (-1.0, low))]
    body = tuple(term for term in ends[0] if term[1].__class__ not in native_numeric_types)
    return BoundedArgument(_finite(ends), body)


def _number(expression: Any) -> Any:
    """The value of `expression` where that is infinite, as that of a parameter may be; else itself."""
    if expression.__class__ not in native_numeric_types and not expression.is_potentially_variable():
        number = value(expression, exception=False)
        if number in (math.inf, -math.inf):
            return number
    return expression


def _finite(bounds: list[Terms]) -> tuple[Terms, ...]:
    """Those that are not x ≥ −inf or x ≤ inf."""
    numbers = ([factor * one for factor, one in terms if one.__class__ in native_numeric_types] for terms in bounds)
    return tuple(terms for terms, constants in zip(bounds, numbers, strict=True) if math.inf not in constants)
