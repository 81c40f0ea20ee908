"""Nonlinear Pyomo expressions, and their derivatives by Pyomo, evaluated with NumPy for many rows at once.

The rows of an indexed model have few shapes: sin(x[1]) and sin(x[2]) differ in their variable only. Each shape is
differentiated once, by Pyomo's reverse symbolic mode, on placeholders for its variables and constants. It becomes a
list of NumPy calls, each of them on all rows of that shape.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from functools import cache, reduce
from typing import Any

import numpy as np
import pyomo.environ as pyo
import scipy.sparse as sp
from pyomo.common.numeric_types import native_numeric_types
from pyomo.core.expr import numeric_expr
from pyomo.core.expr.calculus.derivatives import Modes, differentiate

from ...errors import InputError
from ...numerics.arrays import Vector
from .sums import size_of_terms

#: the functions of one argument that Pyomo can differentiate; NumPy calls them the same
_FUNCTIONS = ("exp", "log", "log10", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan")
#: the operations, on arrays and on expressions, with the nodes that do them
_OPERATIONS: dict[str, tuple[type, Callable[..., Any]]] = {
    "sum": (numeric_expr.SumExpression, lambda *terms: reduce(operator.add, terms)),
    "product": (numeric_expr.ProductExpression, operator.mul),
    "quotient": (numeric_expr.DivisionExpression, operator.truediv),
    "minus": (numeric_expr.NegationExpression, operator.neg),
    "power": (numeric_expr.PowExpression, operator.pow),
    "abs": (numeric_expr.AbsExpression, abs),
}
#: the words for a number that is NaN or infinite, or has no value in Pyomo
NOT_FINITE = "not finite: a fixed variable or parameter without value?"
#: a shape, with the variables and constants of one row in order of appearance
Flat = tuple[tuple[Any, ...], list[Any], list[float]]


class NonlinearRows:
    """Nonlinear Pyomo expressions N(z), as `flat`: value, size of terms, Jacobian, and expressions of other variables.

    `columns` maps variable id → entry of z.
    Reference: Griewank and Walther, Evaluating Derivatives (2008), chapter 3; pyomo.core.expr.calculus.
    """

    def __init__(self, flat: Sequence[Flat], columns: dict[int, int]) -> None:
        self.size = len(flat)
        rows_by_shape: dict[tuple[Any, ...], tuple[list[Any], list[Any], list[Any]]] = {}
        for row, (tokens, variables, constants) in enumerate(flat):
            of_shape = rows_by_shape.setdefault(tokens, ([], [], []))
            for column, one in zip(of_shape, (row, [columns[id(x)] for x in variables], constants), strict=True):
                column.append(one)
        self.compiled = [_CompiledExpression(tokens, *of_shape) for tokens, of_shape in rows_by_shape.items()]

    def value(self, z: Vector) -> Vector:
        """N(z)."""
        return self._gathered(_CompiledExpression.value, z)

    def magnitude(self, z: Vector) -> Vector:
        """The sum of the absolute values of the terms of each expression."""
        return self._gathered(_CompiledExpression.magnitude, z)

    def _gathered(self, evaluated: Callable[[_CompiledExpression, Vector], Any], z: Vector) -> Vector:
        result = np.zeros(self.size)
        for one in self.compiled:
            result[one.rows] = evaluated(one, z)
        return result

    def jacobian(self, z: Vector) -> sp.csr_array:
        """N′(z), CSR."""
        parts = [
            (one.rows, columns, np.broadcast_to(derivative, one.rows.shape))
            for one in self.compiled
            for columns, derivative in zip(one.variables, one.derivatives(z), strict=True)
        ]
        rows, columns, data = map(np.concatenate, zip(*parts, strict=True))
        return sp.csr_array(sp.coo_array((data, (rows, columns)), shape=(self.size, z.size)))

    def expressions(self, z: Sequence[Any]) -> list[Any]:
        """The rows as Pyomo expressions of `z`, Pyomo variables or expressions."""
        expressions: list[Any] = [None] * self.size
        for one in self.compiled:
            for row, variables, constants in zip(one.rows, one.variables.T, one.constants.T.tolist(), strict=True):
                expressions[int(row)] = _rebuilt(one.tokens, [z[j] for j in variables], constants, pyo)
        return expressions


def flattened(expression: Any, owner: Any) -> Flat:
    """The shape of a Pyomo expression, in Polish notation, with its variables and constants in order of appearance.

    In the shape a variable is its number in that order, a constant is None, and an operation is its name with the
    number of its arguments. Raises InputError, which names the `owner`, if Pyomo cannot differentiate an operation or
    has no value of a number.
    """
    tokens: list[Any] = []
    variables: list[Any] = []
    place: dict[int, int] = {}
    constants: list[float] = []
    stack = [expression]
    while stack:
        node = stack.pop()
        if node.__class__ in native_numeric_types:
            tokens.append(None)
            constants.append(float(node))
        elif node.is_expression_type():
            word, arguments = _operation(node, owner)
            tokens.append((word, len(arguments)))
            stack.extend(reversed(arguments))
        elif not node.is_variable_type():  # Pyomo's InvalidNumber
            raise InputError(f"{owner} has a number in a nonlinear term that is {NOT_FINITE}")
        else:  # fixed variables and parameters have become numbers
            if id(node) not in place:
                place[id(node)] = len(variables)
                variables.append(node)
            tokens.append(place[id(node)])
    return tuple(tokens), variables, constants


def _operation(node: Any, owner: Any) -> tuple[str, tuple[Any, ...]]:
    """The operation of an expression node as a word, and its arguments. A constant exponent is part of the word."""
    word = _word(node.__class__) or node.getname()
    arguments = tuple(node.args)
    if word == "power" and not hasattr(arguments[1], "is_expression_type"):
        return f"power {float(arguments[1])!r}", arguments[:1]
    if word not in _FUNCTIONS and word not in _OPERATIONS:
        raise InputError(f"{owner} has the operation {node.getname()}, which Pyomo cannot differentiate: {node}")
    return word, arguments


@cache
def _word(kind: type) -> str:
    return next((word for word, (node, _) in _OPERATIONS.items() if issubclass(kind, node)), "")


def _rebuilt(tokens: tuple[Any, ...], variables: Any, constants: Any, functions: Any) -> Any:
    """The expression of the shape `tokens` with these variables and constants.

    `functions` is Pyomo or NumPy; with NumPy and arrays the result is the values of all rows.
    """
    left = list(constants)
    stack: list[Any] = []
    for token in reversed(tokens):
        if token is None:
            stack.append(left.pop())
        elif isinstance(token, int):
            stack.append(variables[token])
        else:
            word, count = token
            stack.append(_called(word, functions)(*[stack.pop() for _ in range(count)]))
    return stack.pop()


def _called(word: str, functions: Any) -> Callable[..., Any]:
    """The operation `word`; a function such as sin is that of `functions`, Pyomo or NumPy."""
    if word.startswith("power "):
        exponent = float(word.split()[1])
        return lambda x: x**exponent
    return _OPERATIONS[word][1] if word in _OPERATIONS else getattr(functions, word)


class _CompiledExpression:
    """A shape as NumPy calls: its value and its derivatives, for all its rows at once."""

    def __init__(self, tokens: tuple[Any, ...], rows: list[Any], variables: list[Any], constants: list[Any]) -> None:
        self.tokens, self.rows = tokens, np.array(rows)
        self.variables = np.array(variables, dtype=np.int64).reshape(self.rows.size, -1).T
        self.constants = np.array(constants, dtype=np.float64).reshape(self.rows.size, -1).T
        stand_in = pyo.ConcreteModel()
        stand_in.x, stand_in.c = pyo.Var(range(len(self.variables))), pyo.Var(range(len(self.constants)))
        x = list(stand_in.x.values())
        c = list(stand_in.c.values())
        self._template = _rebuilt(tokens, x, c, pyo)
        #: id of a node → position of its value in the list that `derivatives` fills: x and c, then one per step
        self._place = {id(leaf): k for k, leaf in enumerate([*x, *c])}
        self._steps: list[tuple[Callable[..., Any], tuple[Any, ...]]] = []
        gradient = differentiate(self._template, wrt_list=x, mode=Modes.reverse_symbolic)
        self._gradient = [self._compile(derivative) for derivative in gradient]
        self._references = (stand_in, gradient)  # keeps alive the objects whose ids are used

    def _where(self, node: Any) -> Any:
        """The number `node`, or the position of its value; None if it has no position yet."""
        return float(node) if node.__class__ in native_numeric_types else self._place.get(id(node))

    def _compile(self, root: Any) -> Any:
        """Append the steps that `root` needs. Return the position of its value, or a number."""
        stack = [root]
        while stack:
            if self._where(stack[-1]) is not None:
                stack.pop()
                continue
            word, arguments = _operation(stack[-1], "the derivative")
            places = tuple(map(self._where, arguments))
            if None in places:
                stack.extend(node for node, place in zip(arguments, places, strict=True) if place is None)
                continue
            self._place[id(stack.pop())] = len(self.variables) + len(self.constants) + len(self._steps)
            self._steps.append((_called(word, np), places))
        return self._where(root)

    @np.errstate(all="ignore")  # the judge sees what is not finite
    def value(self, x: Vector) -> Any:
        return _rebuilt(self.tokens, x[self.variables], self.constants, np)

    @np.errstate(all="ignore")
    def magnitude(self, x: Vector) -> Any:
        known = [*x[self.variables], *self.constants]

        def value(node: Any) -> Any:
            tokens, leaves, constants = flattened(node, "a term")
            return _rebuilt(tokens, [known[self._place[id(leaf)]] for leaf in leaves], constants, np)

        return size_of_terms(self._template, value)

    @np.errstate(all="ignore")
    def derivatives(self, x: Vector) -> list[Any]:
        known: list[Any] = [*x[self.variables], *self.constants]
        for function, places in self._steps:
            known.append(function(*[known[k] if isinstance(k, int) else k for k in places]))
        return [known[k] if isinstance(k, int) else k for k in self._gradient]
