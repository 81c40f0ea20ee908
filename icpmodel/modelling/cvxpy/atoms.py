"""The parts of CVXPY's expressions that are not affine, as functions of z with their derivatives."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence
from functools import reduce
from typing import Any

import cvxpy as cp
import numpy as np
import scipy.sparse as sp
from cvxpy.atoms.affine.binary_operators import DivExpression
from cvxpy.atoms.affine.broadcast_to import broadcast_to
from cvxpy.atoms.elementwise.elementwise import Elementwise
from cvxpy.atoms.quad_form import QuadForm

from ...numerics.arrays import Vector
from ...problem.differences import misfit_of_derivative

#: constants with more entries than this are not printed
_MAX_PRINTED_ENTRIES = 20
#: the class of x**k, which CVXPY 1.6 calls power
_POWER: Any = getattr(cp, "Power", cp.power)


class Copies:
    """Copies of `expressions` as functions of `variables`, both stacked column by column.

    Leaves are replaced by their `copies`, to which the `variables` belong.
    """

    def __init__(
        self, expressions: Sequence[cp.Expression], variables: Sequence[cp.Variable], copies: dict[int, Any]
    ) -> None:
        self._variables, self._expressions = variables, [copied(one, copies) for one in expressions]

    def _write(self, z: Vector) -> None:
        for x, value in zip(self._variables, unstacked(z, self._variables), strict=True):
            x.save_value(value)

    def value(self, z: Vector) -> Vector:
        """The values of all expressions. Raises ArithmeticError if one has no finite value at `z`."""
        self._write(z)
        values = []
        for one in self._expressions:
            with np.errstate(all="ignore"):
                value = np.asarray(one.value, dtype=np.float64).ravel(order="F")
            if not np.isfinite(value).all():
                actual = f"{named(one)} is {value[np.argmin(np.isfinite(value))]} here"
                raise ArithmeticError(f"{actual}; start where it is finite, from the variables' values")
            values.append(value)
        return np.concatenate([np.zeros(0), *values])

    def magnitude(self, z: Vector) -> Vector:
        """The absolute values of all expressions: an atom is one term."""
        return np.abs(self.value(z))

    def jacobian(self, z: Vector) -> sp.csr_array:
        """The Jacobian in `z`, which may have further entries behind the variables.

        Raises ArithmeticError if an expression has no gradient at `z`.
        """
        self._write(z)
        with np.errstate(all="ignore"):
            J = sp.csr_array(sp.block_array([self._blocks(one) for one in self._expressions]))
        J.resize((J.shape[0], z.size))
        return J

    def _blocks(self, one: cp.Expression) -> list[sp.csr_array]:
        """∂one/∂x for each variable x."""
        gradients = one.grad
        blocks = []
        for x in self._variables:
            gradient: Any = gradients.get(x, sp.csr_array((x.size, one.size)))
            if gradient is None:
                raise ArithmeticError(f"{named(one)} has no gradient here")
            if not sp.issparse(gradient):  # CVXPY gives a number if both are scalars
                gradient = np.broadcast_to(gradient, (x.size, one.size))
            blocks.append(sp.csr_array(gradient).reshape(x.size, one.size).T.tocsr())
        return blocks

    def gradient_holds(self, z: Vector) -> bool:
        """Whether CVXPY gives a gradient that no difference quotient near `z` contradicts.

        Also True if no value or gradient is finite near `z`. CVXPY 1.9 has no gradient of norm_inf.
        """
        random = np.random.default_rng(0)
        size = float(np.abs(z).max(initial=0.0)) or 1.0
        for least in (-0.01, 0.0):
            at = z + size * random.uniform(least, 0.01, z.size)
            try:
                return misfit_of_derivative(self.value, self.jacobian(at), at) is None
            except ArithmeticError:
                continue
            except Exception:  # whatever an expression without a gradient raises
                return False
        return True


def frozen(atoms: Sequence[cp.Expression], variables: Sequence[cp.Variable]) -> Copies:
    """The `atoms` as functions of the `variables` at the present values of their parameters.

    They are copies, which later values of the variables and parameters do not change.
    """
    inner = [cp.Variable(x.shape, name=x.name()) for x in variables]
    copies: dict[int, Any] = {id(x): copy for x, copy in zip(variables, inner, strict=True)}
    copies |= {id(one): cp.Constant(value_of(one)) for atom in atoms for one in atom.parameters()}
    return Copies(atoms, inner, copies)


def value_of(parameter: cp.Parameter) -> Any:
    """A copy of the parameter's value as an array; None if it has none."""
    value: Any = parameter.value_sparse if parameter.attributes["sparsity"] else parameter.value
    return value.toarray() if sp.issparse(value) else value if value is None else np.array(value)


def unique(items: Iterable[Any]) -> list[Any]:
    """Each of the `items` once, in order of appearance."""
    return list(dict.fromkeys(items))


def copied(expression: Any, copies: dict[int, Any]) -> Any:
    """`expression` with leaves replaced by their `copies`; atoms for which CVXPY 1.9 has no gradient are rewritten.

    Parameters that are not arguments (power, huber) become constants. Arguments are broadcast beforehand, since CVXPY's
    gradients ignore broadcasting. It has no gradient of a/b in b, which becomes ab/b², of a quadratic form in its
    matrix, and of x³ where x ≤ 0.
    """
    if id(expression) in copies or not expression.args:
        return copies.get(id(expression), expression)
    arguments = [copied(argument, copies) for argument in expression.args]
    if isinstance(expression, DivExpression) and not arguments[1].is_constant():
        return cp.multiply(cp.multiply(*arguments), cp.power(cp.square(arguments[1]), -1))
    if isinstance(expression, Elementwise):
        arguments = [x if x.shape == expression.shape else broadcast_to(x, expression.shape) for x in arguments]
    if isinstance(expression, QuadForm) and not arguments[1].is_constant():
        return cp.sum(cp.multiply(arguments[0], arguments[1] @ arguments[0]))
    if isinstance(expression, _POWER) and (exponent := expression.p.value) is not None and exponent in range(3, 100):
        return reduce(cp.multiply, [arguments[0]] * int(exponent))
    data = expression.get_data() or []
    if not any(isinstance(x, cp.Expression) for x in data):
        return expression.copy(arguments)
    return type(expression)(*arguments, *(cp.Constant(x.value) if isinstance(x, cp.Expression) else x for x in data))


def named(expression: cp.Expression | cp.Constraint) -> str:
    """The name of `expression` in messages: its label, its text or, if it has large constants, its shape."""
    if expression.label is None and any(constant.size > _MAX_PRINTED_ENTRIES for constant in expression.constants()):
        names = ", ".join(x.name() for x in expression.variables())
        kind = "a constraint" if isinstance(expression, cp.Constraint) else "an expression"
        text = f"{kind} of shape {expression.shape}" + (f" in {names}" if names else "")
    else:
        text = re.sub(r"Promote\(([^()]*), \([\d, ]*\)\)", r"\1", expression.format_labeled())
    return textwrap.shorten(text, 80, placeholder=" ...")


def at(stacked: Sequence[cp.Expression], k: int) -> tuple[int, str]:
    """The number of the `stacked` expression that contains the `k`-th of all entries, and its index there as "[i, j]".

    The index of a scalar is "".
    """
    number = 0
    while k >= stacked[number].size:
        k -= stacked[number].size
        number += 1
    x = stacked[number]
    index = np.unravel_index(k, x.shape, order="F")
    return number, f"[{', '.join(str(int(i)) for i in index)}]" if x.size > 1 else ""


def unstacked(z: Vector, like: Sequence[cp.Expression]) -> list[np.ndarray]:
    """The parts of `z`, one for each expression of `like` and in its shape, column by column."""
    parts = np.split(z, np.cumsum([x.size for x in like]))  # the last one is empty
    return [part.reshape(x.shape, order="F").copy() for x, part in zip(like, parts, strict=False)]
