"""The condition of an implicit complementarity problem between two CVXPY expressions."""

from __future__ import annotations

from typing import Any

import cvxpy as cp
import numpy as np
from cvxpy.atoms.affine.promote import promote

from ...errors import InputError, check_arguments
from ...numerics.arrays import described
from ...present.display import Displayable, cut
from .atoms import named

#: the attributes that a CVXPY variable of an ICP may have
BOUND_ATTRIBUTES = ("nonneg", "nonpos", "bounds")


class Complementarity(Displayable, cp.Constraint):
    """The condition p ≥ 0, r ≥ 0, pᵀr = 0 between two CVXPY expressions; `complements` makes it.

    Attributes
    ----------
    sides : tuple of two Expression
        The expressions as they were given.
    bounds : tuple of two, Expression or None
        The lower and the upper bound of r; by default the lower one is 0, and there is no upper one.

    Notes
    -----
    The attributes p and r are None before a solve. Afterwards they hold the values of both expressions,
    in their shape; after a failed solve, those at the present values of the variables. Each is the
    multiplier of the other's sign: p > 0 where r is at its lower bound, p < 0 where it is at its upper one.

    Examples
    --------
    >>> import cvxpy as cp
    >>> z = cp.Variable(2)
    >>> contact = icp.complements(2 * z - [2, -2], z)
    >>> _ = icp.Problem([contact]).solve()
    >>> z.value, contact.p, contact.r
    (array([1., 0.]), array([0., 2.]), array([1., 0.]))
    """

    def __init__(
        self,
        first: cp.Expression,
        second: cp.Expression,
        bounds: tuple[cp.Expression | None, cp.Expression | None] = (None, None),
    ) -> None:
        self.sides, self.bounds = (first, second), bounds
        self.p: np.ndarray | None = None
        self.r: np.ndarray | None = None

    def variables(self) -> list[cp.Variable]:
        """The variables of all its expressions, with repetitions.

        Returns
        -------
        list of Variable
            A variable that occurs in two expressions is listed twice.
        """
        return [x for one in (*self.sides, *self.bounds) if one is not None for x in one.variables()]

    @property
    def is_bounded(self) -> bool:
        """Whether r has bounds other than r ≥ 0.

        Examples
        --------
        >>> import cvxpy as cp
        >>> z = cp.Variable()
        >>> icp.complements(z - 1, z).is_bounded, icp.complements(z - 1, z, upper=3).is_bounded
        (False, True)
        """
        return any(bound is not None for bound in self.bounds)

    @property
    def dual_value(self) -> np.ndarray | None:
        """`p` under CVXPY's name: the multiplier of r ≥ 0, or that of r ≥ l minus that of r ≤ u.

        Examples
        --------
        >>> import cvxpy as cp
        >>> z = cp.Variable(2)
        >>> box = icp.complements(z - [3, -2], z, upper=1)
        >>> _ = icp.Problem(box).solve()
        >>> box.dual_value
        array([-2.,  2.])
        """
        return self.p

    @property
    def _refuse(self) -> Any:
        """Raise InputError when CVXPY reads a property that constraints of its own problems have."""
        advice = "icpmodel.Problem([complements(p, r), ...]).solve() solves it, without an objective"
        raise InputError(f"{self} is no constraint of cvxpy.Problem: {advice}")

    args = is_dcp = is_dgp = is_dpp = residual = _refuse

    def __str__(self) -> str:
        return repr(self)

    def __repr__(self) -> str:
        bounds = zip(("lower", "upper"), self.bounds, strict=True)
        keywords = "".join(f", {name}={named(bound)}" for name, bound in bounds if bound is not None)
        return cut(f"complements({named(self.sides[0])}, {named(self.sides[1])}{keywords}", 480) + ")"


@check_arguments
def complements(p: Any, r: Any, *, lower: Any = "default", upper: Any = None) -> Complementarity:
    """The constraint p ≥ 0 ⟂ r ≥ 0 of a `Problem`, best with r = z − ψ(z); p may be any expression.

    Bounds l and u of r make it a mixed condition:

        l ≤ r ≤ u,    p_i ≥ 0 where r_i = l_i,    p_i ≤ 0 where r_i = u_i,    else p_i = 0.

    Parameters
    ----------
    p, r : Expression
        Two CVXPY expressions of one shape. Their order does not matter, unless r has bounds. Each row of
        r is z_i − ψ_i(z), with an entry z_i of its own. If there is none, `Problem` adds an unknown s with
        the equation s − r(z) = 0.
    lower, upper : Expression, float or array, optional
        l and u; −inf, +inf or None means no bound. By default 0 and None. If neither is given, a variable r
        with the attribute `nonneg`, `nonpos` or `bounds` has its own bounds.

    Returns
    -------
    Complementarity
        The constraint.

    Raises
    ------
    InputError
        Where an argument is not a CVXPY expression, or shapes differ.

    References
    ----------
    Dirkse and Ferris, Optim. Methods Softw. 5 (1995), for mixed complementarity.

    Examples
    --------
    >>> import cvxpy as cp
    >>> z = cp.Variable(2, name="z")
    >>> icp.complements(2 * z - 1, z - 3)
    complements(2.0 * z + -1.0, z + -3.0)
    >>> box = icp.complements(z - [3, 0.5], z, upper=1)
    >>> icp.Problem(box).solve().z, box.p
    (array([1. , 0.5]), array([-2.,  0.]))
    """
    p = _expression(p, "p")
    r = _expression(r, "r")
    if p.shape != r.shape:
        actual = f"p = {named(p)} has shape {p.shape}, r = {named(r)} {r.shape}"
        raise InputError(f"complements(p, r) works entry by entry: {actual}")
    variable_bounds = own_bounds(r)
    if isinstance(lower, str) and lower == "default":
        takes_own = upper is None and any(one is not None for one in variable_bounds)
        lower, upper = variable_bounds if takes_own else (0.0, upper)
    below = None if _is_zero(lower) else _bound(-np.inf if lower is None else lower, "lower", r)
    return Complementarity(p, r, (below, None if upper is None else _bound(upper, "upper", r)))


def own_bounds(r: cp.Expression) -> tuple[Any, Any]:
    """The bounds that `nonneg`, `nonpos` and `bounds` give a variable; (None, None) for other expressions."""
    if not isinstance(r, cp.Variable):
        return None, None
    has: dict[str, Any] = r.attributes
    if has["bounds"] is None:
        return 0.0 if has["nonneg"] else None, 0.0 if has["nonpos"] else None
    low, high = (one if isinstance(one, cp.Expression) or np.isfinite(one).any() else None for one in has["bounds"])
    return low, high


def _is_zero(bound: Any) -> bool:
    return bound is not None and not isinstance(bound, cp.Expression) and np.ndim(bound) == 0 and bool(bound == 0)


def _bound(value: Any, name: str, r: cp.Expression) -> cp.Expression:
    """`value` as an expression of the shape of r."""
    bound = _expression(value, name)
    if bound.shape == r.shape:
        return bound
    if bound.is_scalar():
        return promote(bound if bound.shape == () else cp.reshape(bound, (), order="F"), r.shape)
    actual = f"{name} = {named(bound)} has shape {bound.shape}, r = {named(r)} {r.shape}"
    raise InputError(f"complements(p, r) works entry by entry: {actual}")


def _expression(side: Any, name: str) -> cp.Expression:
    if isinstance(side, cp.Constraint):
        advice = "give the expressions p and r without >= 0, and other bounds of r as lower and upper"
        raise InputError(f"complements was given the constraint {side} as {name}; {advice}")
    if isinstance(side, cp.Expression):
        return side
    try:
        if not isinstance(side, str | None):  # CVXPY would make NaN of None, and 1.0 of "1"
            return cp.Expression.cast_to_const(side)
    except Exception:
        pass
    raise InputError(f"complements was given {described(side)} as {name}; a CVXPY expression was expected")
