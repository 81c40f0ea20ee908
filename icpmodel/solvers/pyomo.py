"""An ICP as a Pyomo model, and HiGHS on the mixed-integer program that Pyomo makes of it.

p ≥ 0 ⟂ r ≥ 0 becomes p_i = 0 or r_i = 0 (mpec.simple_disjunction, then gdp.bigm). This needs no convexity, but bounds
on p and r.

Reference: Bynum et al., Pyomo: Optimization Modeling in Python (2021), doi 10.1007/978-3-030-68928-5.
"""

from __future__ import annotations

import itertools
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import NotApplicable, check_arguments
from ..problem.data import ProblemData, ProblemLike, as_problem
from ..problem.elementwise import Elementwise
from ..problem.function import Function
from ..problem.map import Map
from ..problem.two_sided import sides_of
from ..problem.user_code import is_compiled
from .foreign import Claim, ForeignSolver, missing
from .formulations import Target

#: NumPy's functions of one argument that Pyomo has too; it calls arcsin asin
_FUNCTIONS: tuple[str, ...] = ("exp", "log", "log10", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh")
_FUNCTIONS += tuple(f"arc{name}" for name in _FUNCTIONS[4:])


@check_arguments
def to_pyomo(problem: ProblemLike) -> Any:
    """State `problem` as a Pyomo model in the variables z[i].

    Parameters
    ----------
    problem : ICP
        Its ψ and f are constant, affine, read from a Pyomo model, or Python code. Such code may use
        arithmetic and NumPy functions that Pyomo has as well, without branches. It is run once on
        symbols, and the values of the expressions are compared with its own.

    Returns
    -------
    pyomo.environ.ConcreteModel
        The model.

    Raises
    ------
    NotApplicable
        For another ψ or f.

    Notes
    -----
    A row with a lower obstacle is complements(p_i ≥ 0, r_i ≥ 0), one with an upper obstacle
    complements(p_i ≤ 0, z_i − ψ̄_i ≤ 0). A row with both is complements(c_i ≤ z_i ≤ d_i, p_i) if the
    obstacles are constant. Otherwise it gets a variable v[i], complements(p_i + v_i ≥ 0, r_i ≥ 0) and
    `above[i]`, complements(v_i ≥ 0, ψ̄_i − z_i ≥ 0). A row without obstacle is the equality constraint
    `equation[i]`, p_i = 0.

    `objective` is the constant 0, without which some solvers do not start: every point that
    satisfies the conditions is a solution.

    Examples
    --------
    >>> len(ICP([[2.0]], [-1.0]).to_pyomo().complementarity)
    1
    """
    import pyomo.environ as pyo
    from pyomo.mpec import Complementarity, complements

    problem = as_problem(problem, nonlinear=True)
    model = pyo.ConcreteModel()
    z = model.z = pyo.Var(range(problem.n))
    p = _forces(problem, z)
    below = _side(sides_of(problem.psi)[0], z)
    above = _side(problem.upper, z)
    two_sided = below.keys() & above.keys()
    fixed = problem.psi.is_constant
    model.v = pyo.Var([] if fixed else sorted(two_sided))
    for i, v in model.v.items():
        p[i] = p[i] + v

    def rule(_: Any, i: int) -> Any:
        if i in two_sided and fixed:
            low, high = below[i], above[i]
            return complements(z[i] == low if low == high else pyo.inequality(low, z[i], high), p[i])
        if i in below:
            return complements(p[i] >= 0, z[i] - below[i] >= 0)
        return complements(p[i] <= 0, z[i] - above[i] <= 0)

    model.complementarity = Complementarity([i for i in z if i in below or i in above], rule=rule)
    model.above = Complementarity([*model.v], rule=lambda m, i: complements(m.v[i] >= 0, above[i] - z[i] >= 0))
    model.equation = pyo.Constraint([i for i in z if i not in below and i not in above], rule=lambda _, i: p[i] == 0)
    model.objective = pyo.Objective(expr=0.0)
    return model


def _forces(problem: ProblemData, z: Any) -> list[Any]:
    """p_i(z) = (Az + q + f(z))_i as expressions."""
    affine = _affine_rows(problem.A, problem.q, z)
    return affine if problem.f is None else list(map(operator.add, affine, _expressions(problem.f.map, z, "f")))


def _side(psi: Map | None, z: Any) -> dict[int, Any]:
    """Row → the obstacle of one side as an expression, where there is one."""
    expressions = [] if psi is None else _expressions(psi, z, "psi")
    return {i: one for i, one in enumerate(expressions) if not (isinstance(one, float) and np.isinf(one))}


def _expressions(psi: Map, z: Any, name: str) -> list[Any]:
    """ψ_i(z) as Pyomo expressions of the variables `z`: numbers where they are constant, ±inf in rows without obstacle.

    `name` is that of ψ in messages. Raises NotApplicable.
    """
    variables = list(z.values())
    if psi.linear is not None:
        return _affine_rows(*psi.linear, z)
    code: Any = psi.fun if isinstance(psi, Function) else None
    terms: Any = getattr(code, "w", None)
    if hasattr(terms, "expressions"):  # read from a Pyomo model: Gz + c + Vw
        return _affine_rows(
            sp.hstack([code.G, code.V], format="csr"), code.c, [*variables, *terms.expressions(variables)]
        )
    symbols = np.array([_Symbol(variable) for variable in variables], dtype=object)
    try:
        if isinstance(psi, Elementwise):
            f: Any = psi.fun
            values = [f.py_func(one) for one in symbols] if is_compiled(f) else np.asarray(f(symbols))
            expressions = [c if np.isinf(c) else one + c for one, c in zip(values, psi.c.tolist(), strict=True)]
        elif isinstance(psi, Function):
            expressions = list(np.asarray(code(symbols)).reshape(len(variables)))
        else:
            raise TypeError("it takes the best of several")
        # whether a row has an obstacle does not depend on z
        at_one_half = psi.value(np.full(len(variables), 0.5)).tolist()
        expressions = [one.expression if isinstance(one, _Symbol) else float(one) for one in expressions]
        expressions = [value if np.isinf(value) else one for one, value in zip(expressions, at_one_half, strict=True)]
        _compare(psi, expressions, z, name)
    except Exception as error:  # a user's code may raise anything when it is given symbols
        raise NotApplicable(f"{psi!r} has no Pyomo expression: {type(error).__name__}: {error}") from error
    return expressions


def _affine_rows(G: Any, c: Any, z: Any) -> list[Any]:
    """Gz + c, row by row, as Pyomo expressions: `G` CSR, shape (n, n), `z` Pyomo variables by number."""
    start = G.indptr.tolist()
    data = G.data.tolist()
    columns = G.indices.tolist()
    rows = ([data[k] * z[columns[k]] for k in range(*ends)] for ends in itertools.pairwise(start))
    return [one if np.isinf(one) else sum(row) + one for row, one in zip(rows, c.tolist(), strict=True)]


def _compare(psi: Map, expressions: list[Any], z: Any, name: str) -> None:
    """Raise ValueError if the expressions differ from ψ in value, as for code with a state. Sets and clears `z`."""
    from pyomo.environ import value

    random = np.random.default_rng(0)
    for low, high in ((0.1, 0.9), (-0.9, 0.9), (-5.0, 5.0)):  # points of one sign and of both
        at = random.uniform(low, high, len(z))
        z.set_values(dict(enumerate(at.tolist())))
        with np.errstate(all="ignore"):
            expected = psi.value(at)
        for i in np.flatnonzero(np.isfinite(expected)).tolist():
            actual = value(expressions[i])
            if not abs(actual - expected[i]) <= 1e-9 * max(abs(expected[i]), 1.0):
                raise ValueError(f"{name}(z)[{i}] is {expected[i]:g} and its expression {actual:g} at the same z")
    z.set_values(dict.fromkeys(z))


class _Symbol:
    """A Pyomo expression on which arithmetic and NumPy's functions work: np.sin of an array of them calls x.sin()."""

    def __init__(self, expression: Any) -> None:
        self.expression = expression

    def __eq__(self, other: object) -> bool:
        raise TypeError("its code compares z, and a Pyomo expression has no branches")

    def __bool__(self) -> bool:
        raise TypeError("its code has a branch, and a Pyomo expression has none")

    def __neg__(self) -> _Symbol:
        return _Symbol(-self.expression)

    def __abs__(self) -> _Symbol:
        return _Symbol(abs(self.expression))

    def __getattr__(self, name: str) -> Callable[[], _Symbol]:
        import pyomo.environ as pyo

        if name not in _FUNCTIONS:
            raise AttributeError(f"Pyomo has no {name}")
        return lambda: _Symbol(getattr(pyo, name.replace("arc", "a"))(self.expression))


def _arithmetic(operation: Callable[[Any, Any], Any], reflected: bool) -> Callable[[_Symbol, Any], Any]:
    def method(self: _Symbol, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented  # then NumPy applies the operation to each entry
        other = other.expression if isinstance(other, _Symbol) else float(other)
        pair = (other, self.expression) if reflected else (self.expression, other)
        return _Symbol(operation(*pair))

    return method


for _name in ("add", "sub", "mul", "truediv", "pow"):
    setattr(_Symbol, f"__{_name}__", _arithmetic(getattr(operator, _name), reflected=False))
    setattr(_Symbol, f"__r{_name}__", _arithmetic(getattr(operator, _name), reflected=True))


class PyomoHighs(ForeignSolver):
    """HiGHS's branch and bound on the big-M form, for n ≤ 250. M follows from `Target.bounds`."""

    name = "pyomo-highs"
    package = "highspy"
    forms = ("mpec",)
    used_by = ("crosscheck",)
    # tighter than 1e-8, or with a large M, HiGHS's rounding errors make a solvable problem "infeasible"
    tight = (1e-8, 1e-6)
    largest = 250
    too_large = "branch and bound may take minutes"

    def why_not(self, target: Target) -> str | None:
        if (reason := missing("pyomo") or super().why_not(target)) is None and target.bounds is None:
            return f"no bounds on p and r for the big-M form: {target.bound_at_zero.reason}"
        return reason

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        from pyomo.contrib.appsi.solvers import Highs

        solver = Highs()
        solver.config.time_limit = float(time_limit)
        solver.config.load_solution = False
        solver.highs_options = {f"{of}_feasibility_tolerance": tolerance for of in ("mip", "primal", "dual")}
        return _big_m_model(target), solver

    def run(self, model: Any) -> Claim:
        from pyomo.contrib.appsi.base import TerminationCondition

        program, solver = model
        result = solver.solve(program)
        if result.termination_condition is not TerminationCondition.optimal:
            return Claim(None, result.termination_condition.name, False)
        values = result.solution_loader.get_primals()
        return Claim([values[one] for one in program.z.values()], "optimal", True)


def _big_m_model(target: Target) -> Any:
    """`target` as a mixed-integer Pyomo model: that of `to_pyomo` with bounds on z, from which Pyomo takes M."""
    import pyomo.environ as pyo

    assert target.bounds is not None
    z_max, p_max, _ = target.bounds
    model = to_pyomo(target.problem)
    for i, z in model.z.items():
        z.setlb(-z_max[i])
        z.setub(z_max[i])
    for i, v in model.v.items():
        v.setlb(0.0)
        v.setub(p_max[i])
    for transformation in ("mpec.simple_disjunction", "gdp.bigm"):
        pyo.TransformationFactory(transformation).apply_to(model)
    return model
