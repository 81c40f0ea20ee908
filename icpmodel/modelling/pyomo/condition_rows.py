"""The conditions of a Pyomo model as rows of two sides, side 0 ≥ 0 ⟂ side 1 ≥ 0, each affine or with a nonlinear rest.

A `Complementarity` has two arguments with two bounds in all. Their meaning is Pyomo's own standard form:

1. f ≥ a, g ≥ b, or ≤ on either, means f − a ≥ 0 ⟂ g − b ≥ 0, with a − f where f ≤ a.
2. f = a, g without bound, means f − a = 0, as an equality constraint does.
3. a ≤ f ≤ b, g without bound, means g ≥ 0 where f = a, g ≤ 0 where f = b, g = 0 in between.

An infinite a or b is no bound. Then form 3 becomes form 1.

Reference: Ferris, Fourer and Gay, Expressing complementarity problems in an algebraic modeling language (1999),
doi 10.1137/S105262349833338X.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pyomo.environ as pyo
from pyomo.common.gc_manager import PauseGC
from pyomo.common.numeric_types import native_numeric_types
from pyomo.mpec import Complementarity
from pyomo.mpec.complementarity import ComplementarityData
from pyomo.repn.linear import LinearRepnVisitor
from pyomo.repn.util import VarRecorder, categorize_valid_components

from ...errors import InputError
from .bounded_arguments import BoundedArgument, Terms, bounded_argument
from .nonlinear import NOT_FINITE, flattened
from .sums import size_of_terms

#: the largest violation of a condition without variables, as a share of its terms: the user's own sums are rounded
_MAX_VIOLATION = 1e-9
#: one side of a row: a constant, coefficients by the variable's id, what is nonlinear, `flattened`, or None
Side = tuple[float, dict[int, float], Any]


class ConditionRows:
    """The rows of a model. Raises InputError, with the component's name, where one is no such condition.

    Attributes
    ----------
    sides : two lists
        Side 0 and side 1 of the conditions.
    owners : list
        The component of each condition.
    widths : dict
        b − a, by the number of a row of form 3; its sides are f − a and g.
    equations, inequalities : list
        (component, side) of what must be 0, or at most 0.
    """

    def __init__(self, model: Any) -> None:
        self.sides: tuple[list[Side], list[Side]] = ([], [])
        self.owners: list[Any] = []
        self.widths: dict[int, Side] = {}
        self.equations: list[tuple[Any, Side]] = []
        self.inequalities: list[tuple[Any, Side]] = []
        self._recorder = VarRecorder({}, None)
        self._walk = LinearRepnVisitor({}, var_recorder=self._recorder).walk_expression
        with PauseGC():  # as Pyomo's writers do: many small objects come and go
            self._refuse_what_is_no_icp(model)
            _read_each(model, pyo.Objective, self._read_objective)
            _read_each(model, Complementarity, self._read_condition)
            _read_each(model, pyo.Constraint, self._read_constraint)

    def rows(self) -> list[Side]:
        """Side 0 and side 1 of the conditions, then the widths, then the equations."""
        return [*self.sides[0], *self.sides[1], *self.widths.values(), *(side for _, side in self.equations)]

    def all_owners(self) -> list[Any]:
        """The components of the conditions, then those of the equations."""
        return [*self.owners, *(owner for owner, _ in self.equations)]

    def variables(self) -> list[Any]:
        """The variables that occur, in the order of the model."""
        seen = set[int]()
        for _, linear, nonlinear in self.rows():
            seen.update(linear)
            if nonlinear is not None:
                seen.update(map(id, nonlinear[1]))
        return [variable for key, variable in self._recorder.var_map.items() if key in seen]

    def name_of(self, key: int) -> str:
        """The name of the variable of that id."""
        return str(self._recorder.var_map[key].name)

    def _refuse_what_is_no_icp(self, model: Any) -> None:
        data = {pyo.Block, pyo.Var, pyo.Param, pyo.Expression, pyo.Set, pyo.RangeSet, pyo.Suffix}
        targets = {Complementarity, pyo.Constraint, pyo.Objective}
        _, unknown = categorize_valid_components(model, valid=data | {pyo.ExternalFunction}, targets=targets)
        if unknown:
            names = sorted(f"{kind.__name__} {components[0].name}" for kind, components in unknown.items())
            raise InputError(f"the model has the active {', '.join(names)}, which no complementarity problem has")

    def _read_objective(self, objective: Any) -> None:
        _, linear, nonlinear = self._read(((1.0, objective.expr),), objective)
        if linear or nonlinear is not None:
            reason = "a complementarity problem has nothing to minimise; deactivate it, or take an MPEC solver"
            raise InputError(f"{objective.name} is an active Objective: {reason}")

    def _read_constraint(self, constraint: Any) -> None:
        lower, body, upper = constraint.to_bounded_expression(evaluate_bounds=True)
        if lower is None and upper is None:
            return
        if isinstance(constraint.parent_block(), ComplementarityData):
            name = constraint.parent_block().name
            actual = f"{name} was a Complementarity until a transformation, or a solver that needs one, rewrote it"
            raise InputError(f"{actual}: build the model again, or clone() it before")
        if lower is None or upper is None or lower != upper:
            ends: list[Terms] = [((1.0, lower), (-1.0, body))] if lower is not None else []
            ends += [((1.0, body), (-1.0, upper))] if upper is not None else []
            return self._add_inequality(constraint, ends)
        self._add_equation(constraint, ((1.0, body), (-1.0, lower)))

    def _read_condition(self, condition: Any) -> None:
        arguments = getattr(condition, "_args", None)
        if arguments is None:
            raise InputError(f"{condition.name} has no expressions; complements(..., ...) was expected")
        first, second = (bounded_argument(one, condition) for one in arguments)
        for one, other in ((first, second), (second, first)):
            if one.equality and not other.bounds:
                return self._add_equation(condition, one.bounds[0])
            if one.ends and not other.bounds:
                return self._add_range(condition, one, other.body)
        if first.equality or second.equality or (len(first.bounds), len(second.bounds)) != (1, 1):
            count = [2 if one.equality else len(one.bounds) for one in (first, second)]
            actual = f"{condition.name} has {count[0]} + {count[1]} bounds (an equality is two)"
            raise InputError(f"{actual}; a Complementarity has one on each side, or two on one of them")
        return self._add(condition, first.bounds[0], second.bounds[0])

    def _add_range(self, condition: Any, one: BoundedArgument, force: Terms) -> None:
        """a ≤ f ≤ b with g."""
        low, high = one.ends
        if len(one.bounds) < 2:
            if not one.bounds:
                return self._add_equation(condition, force)
            sign = 1.0 if one.bounds[0] is low else -1.0
            return self._add(condition, one.bounds[0], tuple((sign * factor, term) for factor, term in force))
        side = self._read(low, condition)
        width = constant, linear, nonlinear = self._read((high[0], low[1]), condition)
        if not linear and nonlinear is None:
            if abs(self._share(constant, (high[0], low[1]))) <= _MAX_VIOLATION:
                width = 0.0, linear, nonlinear
                if not side[1] and side[2] is None:  # nothing is left to say of g
                    return self._add_equation(condition, low)
            elif constant < 0:
                actual = f"{condition.name} has a lower bound that is larger than the upper one"
                raise InputError(f"{actual}, by {-constant:g}")
        self.widths[len(self.owners)] = width
        return self._append(condition, side, self._read(force, condition))

    def _add_equation(self, owner: Any, zero: Terms) -> None:
        side = constant, linear, nonlinear = self._read(zero, owner)
        if linear or nonlinear is not None:
            self.equations.append((owner, side))
        elif not abs(self._share(constant, zero)) <= _MAX_VIOLATION:
            raise InputError(f"{owner.name} has no free variable and cannot hold: 0 = {constant:g}")

    def _add_inequality(self, constraint: Any, ends: list[Terms]) -> None:
        """Add an inequality, which must be ≤ 0 at the answer."""
        for terms in ends:
            side = constant, linear, nonlinear = self._read(terms, constraint)
            if nonlinear is not None:
                actual = f"{constraint.name} is a nonlinear inequality, and only affine ones are checked"
                raise InputError(f"{actual}: give it a partner, in Complementarity(expr=complements(..., ...))")
            if linear:
                self.inequalities.append((constraint, side))
            elif self._share(constant, terms) > _MAX_VIOLATION:
                raise InputError(f"{constraint.name} has no free variable and cannot hold: {constant:g} <= 0")

    def _add(self, owner: Any, first: Terms, second: Terms) -> None:
        sides = [self._read(terms, owner) for terms in (first, second)]
        is_nonlinear = [nonlinear is not None for _, _, nonlinear in sides]
        if not any(is_nonlinear) and not any(linear for _, linear, _ in sides):
            constants = [constant for constant, _, _ in sides]
            if not abs(min(map(self._share, constants, (first, second)))) <= _MAX_VIOLATION:
                actual = f"{constants[0]:g} and {constants[1]:g}; the smaller should be 0"
                raise InputError(f"{owner.name} has no free variable and does not hold: its sides are {actual}")
            return
        self._append(owner, *sides)

    @staticmethod
    def _share(constant: float, terms: Terms) -> float:
        """The value `constant` of `terms` without variables, as a share of their size."""
        size = sum(abs(factor) * size_of_terms(expression) for factor, expression in terms)
        return constant / size if size else 0.0

    def _append(self, owner: Any, *sides: Side) -> None:
        for stored, side in zip(self.sides, sides, strict=True):
            stored.append(side)
        self.owners.append(owner)

    def _read(self, terms: Terms, owner: Any) -> Side:
        constant = 0.0
        nonlinear = None
        linear: dict[int, float] = {}
        for factor, expression in terms:
            if expression.__class__ in native_numeric_types:
                constant += factor * expression
                continue
            term = self._walk(expression)
            constant += factor * term.constant
            for key, value in term.linear.items():
                linear[key] = linear.get(key, 0.0) + factor * value
            if term.nonlinear is not None:
                rest = factor * term.nonlinear
                nonlinear = rest if nonlinear is None else nonlinear + rest
        if not all(map(math.isfinite, (constant, *linear.values()))):
            raise ValueError(NOT_FINITE)
        linear = {key: value for key, value in linear.items() if value}
        return float(constant), linear, None if nonlinear is None else flattened(nonlinear, owner)


def _read_each(model: Any, kind: type, read: Callable[[Any], None]) -> None:
    """`read` the active components of a `kind`. Raises InputError, with the component's name."""
    for component in model.component_data_objects(kind, active=True, descend_into=True):
        try:
            read(component)
        except InputError:
            raise
        except (ValueError, TypeError, OverflowError) as error:  # of a number that is no float, or an InvalidNumber
            raise InputError(f"{component.name} has a number that is {NOT_FINITE}") from error
