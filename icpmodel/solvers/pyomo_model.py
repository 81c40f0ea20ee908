"""An implicit complementarity problem as a Pyomo model."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import numpy as np
import scipy.sparse as sp

from ..errors import NotApplicable
from ..problem.data import ProblemData
from ..problem.elementwise import Elementwise
from ..problem.function import Function
from ..problem.map import Map
from ..problem.user_code import is_compiled

#: NumPy's functions of one argument that Pyomo has too, with Pyomo's name
_FUNCTIONS = {
    **{name: name for name in ("exp", "log", "log10", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh")},
    **{f"arc{name}": f"a{name}" for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
}
#: where Python code is compared with the expressions that it gave, in points of one sign and of both
_COMPARED_AT = ((0.1, 0.9), (-0.9, 0.9), (-5.0, 5.0))


@runtime_checkable
class Written(Protocol):
    """A ψ that can write itself: Gz + c, and in some rows an expression more, which `expressions` gives by row."""

    G: sp.csr_array
    c: np.ndarray

    def expressions(self, variables: list[Any]) -> dict[int, Any]:
        """Row → Pyomo expression in these `variables`."""


def to_pyomo(problem: ProblemData) -> Any:
    """`problem` as a Pyomo model: variables z[i], and complements(p_i ≥ 0, r_i ≥ 0) for every row i with an obstacle.

    A row without obstacle is the equality constraint `equation[i]`, p_i = 0. `objective` is the constant 0, without
    which some solvers do not start: every point that satisfies the conditions is a solution.
    Parameters: `problem` with a ψ that is constant, affine, read from a Pyomo model, or Python code of arithmetic and
    of NumPy functions that Pyomo has as well, without branches; the code is run once on symbols, and the expressions
    are compared with it.
    Returns a `pyomo.environ.ConcreteModel`. Raises NotApplicable for another ψ.
    """
    import pyomo.environ as pyo

    model = pyo.ConcreteModel()
    model.z = pyo.Var(range(problem.n))
    obstacle, q = _obstacle(problem.psi, model.z), problem.q.tolist()
    free = [isinstance(one, float) and one == -np.inf for one in obstacle]
    add_conditions(model, free, lambda i: affine_row(problem.A, model.z, i) + q[i], lambda i: model.z[i] - obstacle[i])
    return model


def add_conditions(model: Any, free: list[bool], p: Callable[[int], Any], r: Callable[[int], Any]) -> None:
    """Give `model` the conditions p_i ≥ 0 ⟂ r_i ≥ 0, p_i = 0 in the `free` rows, and an objective that is constant."""
    import pyomo.environ as pyo
    from pyomo.mpec import Complementarity, complements

    rows = range(len(free))
    model.complementarity = Complementarity(
        [i for i in rows if not free[i]], rule=lambda _, i: complements(p(i) >= 0, r(i) >= 0)
    )
    model.equation = pyo.Constraint([i for i in rows if free[i]], rule=lambda _, i: p(i) == 0)
    model.objective = pyo.Objective(expr=0.0)


def affine_row(matrix: Any, z: Any, i: int) -> Any:
    """(Mz)_i as a Pyomo expression: `matrix` M CSR, shape (n, n), `z` Pyomo variables by number."""
    entries = slice(matrix.indptr[i], matrix.indptr[i + 1])
    pairs = zip(matrix.data[entries].tolist(), matrix.indices[entries].tolist(), strict=True)
    return sum(value * z[j] for value, j in pairs)


def _obstacle(psi: Map, z: Any) -> list[Any]:
    """ψ_i(z) as Pyomo expressions of the variables `z`; numbers where they do not move, −inf in rows without."""
    variables = list(z.values())
    if psi.linear is not None:
        return _moved(*psi.linear, z)
    if isinstance(psi, Function) and isinstance(psi.fun, Written):
        found = _moved(psi.fun.G, psi.fun.c, z)
        for i, bend in psi.fun.expressions(variables).items():
            found[i] = found[i] + bend
        return found
    symbols = np.array([_Symbol(variable) for variable in variables], dtype=object)
    try:
        if isinstance(psi, Elementwise):
            f: Any = psi.f
            values = np.array([f.py_func(one) for one in symbols]) if is_compiled(f) else np.asarray(f(symbols))
            found = [-np.inf if c == -np.inf else one + c for one, c in zip(values, psi.c.tolist(), strict=True)]
        elif isinstance(psi, Function):
            found = list(np.asarray(psi.fun(symbols)).reshape(len(variables)))
        else:
            raise TypeError("it takes the best of several")
        found = [one.expression if isinstance(one, _Symbol) else float(one) for one in found]
        _compare(psi, found, variables)
    except Exception as error:  # a user's code may raise anything when it is given symbols
        raise NotApplicable(f"{psi!r} has no Pyomo expression: {type(error).__name__}: {error}") from error
    return found


def _moved(G: Any, c: Any, z: Any) -> list[Any]:
    """Gz + c, row by row."""
    return [one if one == -np.inf else affine_row(G, z, i) + one for i, one in enumerate(c.tolist())]


def _compare(psi: Map, expressions: list[Any], variables: list[Any]) -> None:
    """Raise ValueError where the expressions have not the values of ψ, so that code with a state is found out."""
    from pyomo.environ import value

    random = np.random.default_rng(0)
    for low, high in _COMPARED_AT:
        z = random.uniform(low, high, len(variables))
        for variable, one in zip(variables, z.tolist(), strict=True):
            variable.set_value(one)
        with np.errstate(all="ignore"):
            expected = psi.value(z)
        for i in np.flatnonzero(np.isfinite(expected)).tolist():
            found = value(expressions[i])
            if not abs(found - expected[i]) <= 1e-9 * max(abs(expected[i]), 1.0):
                raise ValueError(f"psi(z)[{i}] is {expected[i]:g} and its expression {found:g} at the same z")
    for variable in variables:
        variable.set_value(None)


class _Symbol:
    """A Pyomo expression on which arithmetic and NumPy's functions work: np.sin of an array of them asks x.sin()."""

    def __init__(self, expression: Any) -> None:
        self.expression = expression

    def __neg__(self) -> _Symbol:
        return _Symbol(-self.expression)

    def __abs__(self) -> _Symbol:
        return _Symbol(abs(self.expression))

    def __getattr__(self, name: str) -> Callable[[], _Symbol]:
        import pyomo.environ as pyo

        if name not in _FUNCTIONS:
            raise AttributeError(f"Pyomo has no {name}")
        return lambda: _Symbol(getattr(pyo, _FUNCTIONS[name])(self.expression))


def _arithmetic(operation: Callable[[Any, Any], Any], turned: bool) -> Callable[[_Symbol, Any], Any]:
    def method(self: _Symbol, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented  # NumPy goes through the entries
        other = other.expression if isinstance(other, _Symbol) else float(other)
        pair = (other, self.expression) if turned else (self.expression, other)
        return _Symbol(operation(*pair))

    return method


for _name in ("add", "sub", "mul", "truediv", "pow"):
    setattr(_Symbol, f"__{_name}__", _arithmetic(getattr(operator, _name), turned=False))
    setattr(_Symbol, f"__r{_name}__", _arithmetic(getattr(operator, _name), turned=True))
