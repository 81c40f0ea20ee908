"""Derivatives of an answer in the parameters of a CVXPY model, with the `backward` and `derivative` of CVXPY.

The derivatives of p, ψ and ψ̄ at the answer in the parameters are computed here, by CVXPY's `.grad`, with variables in
place of parameters. The derivative of z in p, ψ and ψ̄ is `icpmodel.Derivative`.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any

import cvxpy as cp
import numpy as np
import scipy.sparse as sp
from cvxpy.reductions.cvx_attr2constr import build_dim_reduced_expression, lower_value, recover_value_for_leaf

from ...derivatives.derivative import Derivative
from ...errors import InputError
from ...numerics.arrays import Vector, as_float64, as_rows, not_finite
from ...solve.solution import Solution
from .atoms import Copies, copied, named, unstacked, value_of
from .expressions import CvxpyReading


class ParameterDerivative:
    """The derivative of the `solution` of a `reading` in the parameters at their present values.

    Raises InputError if CVXPY has no gradient in one of them.
    """

    def __init__(self, reading: CvxpyReading, solution: Solution) -> None:
        self._solution, self._variables, self._parameters = solution, reading.variables, reading.parameters
        for one in self._parameters:
            if one.is_complex():
                advice = "give its real and its imaginary part as two parameters"
                raise InputError(f"the parameter {one.name()} is complex, and no derivative is known: {advice}")
        #: θ: the independent entries of each parameter, half of them if it is symmetric
        self._entries = {one: cp.Variable(lower_value(one, value_of(one)).shape) for one in self._parameters}
        p, psi, upper = reading.parameter_jacobians(reading.compiled.rows())
        by_parameters = self._by_rows(reading)
        self._p, self._psi = p @ by_parameters, psi @ by_parameters
        self._upper = None if upper is None else upper @ by_parameters

    @cached_property
    def _derivative(self) -> Derivative:
        return Derivative(self._solution)

    def backward(self) -> None:
        """Write the gradient of z̄ᵀz to each parameter's `gradient`; z̄ is the variables' `gradient`, by default 1."""
        zbar = [_fill(x, "gradient", 1.0).ravel(order="F") for x in self._variables]
        further = np.zeros(self._solution.z.size - sum(x.size for x in self._variables))
        gradient = self._derivative.adjoint(np.concatenate([*zbar, further]))
        theta = self._p.T @ gradient.q + self._psi.T @ gradient.psi_values
        if self._upper is not None:
            theta = theta + self._upper.T @ gradient.upper_values
        for parameter, part in zip(self._parameters, unstacked(theta, list(self._entries.values())), strict=True):
            parameter.gradient = recover_value_for_leaf(parameter, part, project=False)

    def derivative(self) -> None:
        """Write the derivative of z along the parameters' `delta`, by default 0, to the variables' `delta`."""
        parts = [_free_entries(one, _fill(one, "delta", 0.0)) for one in self._parameters]
        delta = np.concatenate([np.zeros(0), *parts])
        upper = None if self._upper is None else self._upper @ delta
        dz = self._derivative.forward(dq=self._p @ delta, dpsi=self._psi @ delta, dupper=upper)
        for variable, part in zip(self._variables, unstacked(dz, self._variables), strict=True):
            variable.delta = part

    def _by_rows(self, reading: CvxpyReading) -> sp.csr_array:
        """∂row/∂θ of the compiled rows at the answer, row by row."""
        compiled = reading.compiled
        values = dict(reading.values(self._solution.z))
        constants: dict[int, Any] = {id(x): cp.Constant(value) for x, value in values.items()}
        constants |= {id(one): cp.Constant(value_of(one)) for one in self._parameters}
        if self._solution.problem.psi.no_derivative() is not None:
            for atom in compiled.atoms.values():  # one has no gradient in a variable: the error names it
                for x in atom.variables():
                    copy = cp.Variable(x.shape)
                    _gradient(atom, x, constants | {id(x): copy}, copy, values[x].ravel(order="F"))
        blocks = [sp.csr_array((0, sum(entries.size for entries in self._entries.values())))]
        for one in compiled.sides:
            parts = [sp.csr_array((one.size, 0))]
            for parameter, entries in self._entries.items():
                if any(parameter is x for x in one.parameters()):
                    copies = constants | {id(parameter): build_dim_reduced_expression(parameter, entries)}
                    parts.append(
                        _gradient(one, parameter, copies, entries, _free_entries(parameter, value_of(parameter)))
                    )
                else:
                    parts.append(sp.csr_array((one.size, entries.size)))
            blocks.append(sp.hstack(parts))
        return sp.csr_array(sp.vstack(blocks))


def _gradient(
    one: cp.Expression, leaf: cp.Variable | cp.Parameter, copies: dict[int, Any], entries: cp.Variable, at: Vector
) -> sp.csr_array:
    """The derivative of `one` in the `entries` that make the copy of `leaf`, where they are `at`. Raises InputError."""
    kind = "parameter" if isinstance(leaf, cp.Parameter) else "variable"
    without = f"CVXPY has no gradient of {named(one)} in the {kind} {leaf.name()}"
    if any(leaf is x for x in _data_parameters(one)):
        raise InputError(f"{without}, which is none of its arguments; x**a is exp(a*log(x)) where x > 0")
    at = np.where(np.isfinite(at), at, 0.0)  # an infinite bound has no influence
    try:
        copy = Copies([one], [entries], copies)
        if copied(one, copies).is_affine() or copy.gradient_holds(at):
            return copy.jacobian(at)
    except Exception as error:  # whatever an expression that expects a constant raises
        raise InputError(f"{without}: {error}") from error
    raise InputError(f"{without}, or a wrong one; requires_grad=True needs it: write it in other atoms")


def _data_parameters(expression: Any) -> Iterator[cp.Parameter]:
    """The parameters of `expression` that are not among its arguments, such as an exponent."""
    for argument in expression.args:
        yield from _data_parameters(argument)
    for x in (expression.get_data() or []) if expression.args else []:
        if isinstance(x, cp.Expression):
            yield from x.parameters()


def _fill(leaf: cp.Variable | cp.Parameter, name: str, default: float) -> np.ndarray:
    """The attribute `name` of `leaf`, else `default`, in its shape; a number fills all entries. Raises InputError."""
    value = getattr(leaf, name)
    title = f"the {name} of {leaf.name()}"
    if value is None:
        value = default
    array = as_float64(as_rows(value, title).toarray() if sp.issparse(value) else value, title)
    if array.shape != leaf.shape and array.size != 1:
        raise InputError(f"{title} has shape {array.shape}; {leaf.shape}, or a number for all entries, was expected")
    if actual := not_finite(np.ravel(array, order="F"), title):
        raise InputError(f"{actual}; finite numbers were expected")
    return np.full(leaf.shape, array if array.shape == leaf.shape else array.item())


def _free_entries(parameter: cp.Parameter, value: np.ndarray) -> Vector:
    """The independent entries of `value` in CVXPY's order: half of a symmetric matrix, or the diagonal."""
    return np.ravel(lower_value(parameter, value), order="F")
