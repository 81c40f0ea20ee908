"""The size of the terms of an expression, relative to which its value may count as 0."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pyomo.environ as pyo
from pyomo.core.expr.numeric_expr import DivisionExpression, NegationExpression, ProductExpression, SumExpression
from pyomo.core.expr.visitor import StreamBasedExpressionVisitor


def _number(node: Any) -> float:
    """The value of `node`; 0 for a variable without a value, since its coefficients are 0."""
    return float(pyo.value(node, exception=False) or 0.0)


def size_of_terms(expression: Any, value: Callable[[Any], Any] = _number) -> Any:
    """The sum of the absolute values of the terms of `expression`, whose parts are evaluated by `value`.

    Sums within products and quotients are multiplied out. Anything else, such as a power, is one term.

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> model = pyo.ConcreteModel()
    >>> model.x = pyo.Var(initialize=3.0)
    >>> size_of_terms((model.x - 3.0) / 2)
    3.0
    """

    def of_node(node: Any, parts: list[Any]) -> Any:
        if isinstance(node, SumExpression | NegationExpression) or (parts and node.is_named_expression_type()):
            return sum(parts)
        if isinstance(node, ProductExpression):
            return math.prod(parts)
        if isinstance(node, DivisionExpression):
            return parts[0] / abs(value(node.args[1]))
        return abs(value(node))

    return StreamBasedExpressionVisitor(exitNode=of_node).walk_expression(expression)
