"""The one judge of an answer z: its residual and error bound, from (A, q, ψ, z) only, and the proved active set of z*.

Let |z − z*| ≤ δ and Δψ a bound on |ψ(z) − ψ(z*)|. p_i(z) − Σ|a_ij|δ_j > 0 proves p_i(z*) > 0, hence
r_i(z*) = 0. r_i(z) − δ_i − Δψ_i > 0 proves r_i(z*) > 0, hence p_i(z*) = 0. Once every row is
decided, z* solves one system of equations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...algebra.equations import Pattern
from ...errors import InputError
from ...numerics.arrays import Mask, ReadOnly, as_truth, described
from ...numerics.rounding import UNIT_ROUNDOFF, product_upper_bound, public_entry
from ...present.card import Card
from ...present.display import Displayable
from ...problem.data import ProblemLike, as_problem
from ...problem.two_sided import mid
from .bounds import ErrorBound, error_bound

NOT_COMPUTED = "it was not computed"  #: the reason of a certificate whose bound was not asked for


@dataclass(frozen=True, eq=False, repr=False)
class Certificate(Displayable):
    """The residual, violations, error bound and uniqueness of z, recomputed from (A, q, ψ, z) by `certify`.

    Attributes
    ----------
    residual : float
        Res_D(z) = ‖min(D⁻¹p, r)‖₂, see `ICP.residual`.
    residual_max : float
        The max-norm of the same vector.
    residual_of_paper : float
        Res(z) = ‖min(p, r)‖₂.
    violation_p, violation_r : float
        The largest negative parts of p and r.
    bound : ErrorBound
        The error bound.

    Notes
    -----
    With an upper obstacle, the median with z − ψ̄ replaces the minimum. `violation_p` is then the
    largest of −p in rows without upper obstacle and of p in rows without a lower one. `violation_r`
    is how far z is beyond either obstacle.

    Examples
    --------
    >>> certify(ICP([[2.0]], [-2.0]), [1.0]).residual
    0.0
    """

    residual: float
    residual_max: float
    residual_of_paper: float
    violation_p: float
    violation_r: float
    bound: ErrorBound

    @property
    def error_bound(self) -> float | None:
        """An upper bound of max_i |z_i − z*_i|; None where there is none (`bound.reason` says why)."""
        return self.bound.value

    @property
    def unique(self) -> bool:
        """Whether the solution is proved to exist and to be the only one."""
        return self.bound.unique

    def __str__(self) -> str:
        rows = {
            "residual": f"{self.residual:.3g}, largest entry {self.residual_max:.3g}",
            "p >= 0": f"violated by {self.violation_p:.3g}",
            "r >= 0": f"violated by {self.violation_r:.3g}",
            "error": str(self.bound),
        }
        return str(Card(rows))

    def __repr__(self) -> str:
        return f"Certificate(residual={self.residual:.6g}, error_bound={self.error_bound}, unique={self.unique})"


@public_entry
@np.errstate(all="ignore")  # what overflows proves nothing
def certify(
    problem: ProblemLike,
    z: Any,
    *,
    bound: bool = True,
    sharp: bool | None = None,
    rigorous: bool = False,
    time_limit: float | None = None,
    memory_limit: float | None = None,
) -> Certificate:
    """Certify an answer z of any solver: its residual, violations, error bound and uniqueness.

    Parameters
    ----------
    problem : ICP
        The problem.
    z : array_like of shape (n,) or Solution
        The answer.
    bound : bool, default True
        Whether to compute an error bound as well, which may cost a few factorisations.
    sharp, rigorous, time_limit, memory_limit : optional
        Options of the bound, as for `icpmodel.error_bound`.

    Returns
    -------
    Certificate
        The certificate.

    Raises
    ------
    InputError
        For an object that is no ICP or no such z.
    MapError
        Where ψ fails.

    Examples
    --------
    >>> certify(ICP([[2.0]], [-2.0]), [1.5]).violation_p
    0.0
    """
    problem = as_problem(problem, nonlinear=True)
    bound = as_truth(bound, "bound")
    z = problem.vector(z, finite=True)
    how: Any = {"sharp": sharp, "rigorous": rigorous, "time_limit": time_limit, "memory_limit": memory_limit}
    p = problem.p(z)
    r = problem.r(z)
    r_upper = problem.r_upper(z)
    beyond = np.maximum(-r, 0.0)
    violation = np.maximum(-p, 0.0)
    if r_upper is not None:
        # p < 0 where nothing is above, p > 0 where nothing is below
        beyond = np.maximum(beyond, r_upper)
        violation = np.where(np.isneginf(r_upper), violation, 0.0)
        violation = np.where(np.isposinf(r), np.maximum(p, violation), violation)
    return Certificate(
        residual=problem.residual(z),
        residual_max=float(np.abs(mid(problem.weighted(p, problem.weights_at(z, p)), r, r_upper)).max()),
        residual_of_paper=problem.paper_residual(z),
        violation_p=float(violation.max()),
        violation_r=float(beyond.max()),
        bound=error_bound(problem, z, **how) if bound else ErrorBound.none(NOT_COMPUTED),
    )


@dataclass(frozen=True, eq=False, repr=False)
class ActiveSet(ReadOnly, Displayable):
    """The rows that are proved to be active (p* > 0, r* = 0) and inactive (r* > 0, p* = 0).

    Attributes
    ----------
    active : mask of shape (n,)
        Rows at the lower obstacle.
    inactive : mask of shape (n,)
        Rows off it; with an upper obstacle, off both.
    above : mask of shape (n,) or None
        Rows at the upper obstacle (p* < 0, z* = ψ̄); None where there is none.

    Examples
    --------
    >>> problem = ICP([[2, -1], [-1, 2]], [-1, 3])
    >>> print(problem.solve().active_set)
    1 at the obstacle, 1 off it, 0 undecided
    """

    active: Mask
    inactive: Mask
    above: Mask | None = None

    @property
    def undecided(self) -> Mask:
        """The undecided rows: p and r are both too near to 0, or there is no error bound."""
        decided = self.active | self.inactive
        return ~decided if self.above is None else ~(decided | self.above)

    def completed(self, pattern: Pattern) -> tuple[Mask, Mask | None]:
        """The active set with undecided rows taken from a pattern, in the form that `solve_on` expects.

        Parameters
        ----------
        pattern : Pattern
            The pattern.

        Returns
        -------
        active : mask of shape (n,)
            Rows at either obstacle.
        above : mask of shape (n,) or None
            Rows at the upper obstacle.
        """
        active = self.active | (self.undecided & pattern.active)
        if self.above is None or pattern.above is None:
            return active, None
        return active | self.above, self.above | (self.undecided & pattern.above)

    def __str__(self) -> str:
        at, off, open_rows = (int(mask.sum()) for mask in (self.active, self.inactive, self.undecided))
        if self.above is None:
            return f"{at} at the obstacle, {off} off it, {open_rows} undecided"
        return (
            f"{at} at the lower obstacle, {int(self.above.sum())} at the upper, {off} off both, {open_rows} undecided"
        )


@public_entry
@np.errstate(all="ignore")  # what overflows proves nothing
def active_set(problem: ProblemLike, z: Any, bound: ErrorBound) -> ActiveSet:
    """The active set of z* as far as `bound` proves it.

    Parameters
    ----------
    problem : ICP
        The problem.
    z : array_like of shape (n,) or Solution
        The point.
    bound : ErrorBound
        `error_bound(problem, z)`. The bound of another z proves nothing; that cannot be detected.

    Returns
    -------
    ActiveSet
        The rows. Nothing is decided where there is no bound, nor where p* = r* = 0.

    Raises
    ------
    InputError
        Where `bound` is no `ErrorBound`, or one of another n.

    Notes
    -----
    Bounds on the rounding errors are included.

    Examples
    --------
    >>> from icpmodel.theory import error_bound
    >>> problem, z = ICP([[2.0]], [-2.0]), np.array([1.25])
    >>> active_set(problem, z, error_bound(problem, z)).inactive
    array([ True])
    """
    problem = as_problem(problem, nonlinear=True)
    z = problem.vector(z)
    nothing = np.zeros(problem.n, dtype=bool)
    if not isinstance(bound, ErrorBound):
        raise InputError(f"bound is {described(bound)}; error_bound(problem, z), an ErrorBound, was expected")
    delta = bound.componentwise
    if delta is not None and delta.size != problem.n:
        raise InputError(f"bound is that of {delta.size} unknowns; {problem.n} were expected")
    change = None if delta is None else problem.psi.change(delta)
    r = problem.r(z)
    r_upper = problem.r_upper(z)
    if delta is None or change is None:
        return ActiveSet(nothing, nothing, None if r_upper is None else nothing)
    rounding_p, rounding_r = problem.rounding(z)
    inflate = 1 + 8 * UNIT_ROUNDOFF
    error_p = (rounding_p + product_upper_bound(problem.matrix.absolute, delta)) * inflate
    if problem.f is not None:
        error_p = (error_p + problem.f.change(z, delta)) * inflate
    error_r = (rounding_r + delta + change) * inflate
    p = problem.p(z)
    active = p > error_p
    inactive = r > error_r
    if r_upper is None:
        return ActiveSet(active & ~inactive, inactive & ~active)
    # a row that is proved to be both shows that the bound is wrong, and stays undecided
    inactive &= -r_upper > error_r
    at_upper = p < -error_p
    return ActiveSet(active & ~inactive, inactive & ~active & ~at_upper, at_upper & ~inactive)
