"""What is certain of an answer on ranks: the error bound of H₊-matrices, and the rows that it decides.

One Krylov solve with the existing levels gives v > 0 with ⟨A⟩v ≥ α > 0 and (I − G)v ≥ β > 0. One
product each checks that both are positive, rounding included, so the proof does not depend on the
accuracy of v. The bound is that of `theory.certificates.h_plus`, the rows those of
`theory.certificates.certificate`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ..errors import InputError, check_arguments
from ..numerics.arrays import Mask, Vector, described
from ..numerics.rounding import SMALLEST, UNIT_ROUNDOFF, gamma
from ..present.card import Card
from ..present.display import Displayable
from ..problem.two_sided import mid
from ..theory.certificates.bounds import ASSUMED_PSI, ErrorBound
from .distributed_icp import DistributedICP, check_point
from .distributed_levels import DistributedLevels
from .distributed_matrix import DistributedMatrix
from .ranks import largest, norm, totals

#: (how it was found, v, α, β)
HPlusVectors = tuple[str, Vector, Vector, Vector]


@dataclass(frozen=True, repr=False)
class DistributedCertificate(Displayable):
    """The residual, error bound and active set of z on ranks, recomputed from (A, q, ψ, z).

    Attributes
    ----------
    residual : float
        Res_D(z), as in `ProblemData.residual`.
    bound : ErrorBound
        The error bound; its `componentwise` are the entries of the own rows.
    active : int
        Number of rows of z*, over all ranks, proved to be at the obstacle below.
    inactive : int
        Number of rows proved to be off both obstacles.
    above : int
        Number of rows proved to be at the upper obstacle.
    undecided : int
        Number of the other rows.
    own_active, own_inactive : mask
        The active and inactive rows among the own ones.

    Examples
    --------
    >>> problem = icp.distributed.distribute(icp.scenes.hand_lcp().problem)
    >>> icp.distributed.solve(problem).certify().bound.unique
    True
    """

    residual: float
    bound: ErrorBound
    active: int
    inactive: int
    above: int
    undecided: int
    own_active: Any = field(repr=False)
    own_inactive: Any = field(repr=False)

    @property
    def rows(self) -> str:
        """The rows in words."""
        upper = f", {self.above} at the upper obstacle" if self.above else ""
        return f"{self.active} at the obstacle{upper}, {self.inactive} off it, {self.undecided} undecided"

    def __str__(self) -> str:
        return str(Card({"residual": f"{self.residual:.3g}", "error": str(self.bound), "rows": self.rows}))


@check_arguments
def certify(problem: DistributedICP, z: Any, levels: DistributedLevels | None = None) -> DistributedCertificate:
    """State what is certain of `z`: the residual, the error bound, the rows that it decides.

    Every rank calls it at the same time.

    Parameters
    ----------
    problem : DistributedICP
        The problem.
    z : Vec
        Any point.
    levels : DistributedLevels, optional
        The levels of a solve with the same A.

    Returns
    -------
    DistributedCertificate
        The certificate.

    Raises
    ------
    InputError
        On all ranks, for wrong arguments.
    MapError
        Where ψ fails at z.

    Examples
    --------
    >>> problem = icp.distributed.distribute(ICP([[2.0]], [-2.0]))
    >>> icp.distributed.certify(problem, problem.vector([1.5])).bound.value >= 0.5
    True
    """
    here = _Point(problem, check_point(problem, z, "z"))
    if levels is not None and not isinstance(levels, DistributedLevels):
        raise InputError(f"levels is {described(levels)}; the levels of a DistributedSolution were expected")
    proof = _proof(problem, levels)
    if isinstance(proof, str):
        return here.certificate(ErrorBound.none(proof))
    delta = here.bound(proof)
    value = largest(problem.comm, float(delta.max(initial=0.0)))[0]
    change = obstacle_change(problem, delta)
    sentence = f"A is an H+-matrix ({proof[0]})" + (ASSUMED_PSI if problem.calls_user_code else "")
    if _may_cross(problem, here, change):
        return here.certificate(ErrorBound.none("psi <= upper is not proved near z, where z* would be"))
    if not np.isfinite(value):
        reason = "the proof gives no bound at this z: it is too far from z*, or not finite"
        return here.certificate(ErrorBound.none(reason, sentence))
    squares = totals(problem.comm, float(np.sum((delta / value) ** 2)))[0] if value else 0.0
    euclidean = value * float(np.sqrt(squares)) * (1 + (problem.n + 8) * UNIT_ROUNDOFF)
    return here.certificate(ErrorBound(value, delta, euclidean, sentence, ""), here.rows(delta, change))


class _Point:
    """A `Vec` z, and all that a bound needs of it in the own rows. Collective."""

    def __init__(self, problem: DistributedICP, z: Any) -> None:
        self.problem = problem
        self.z = z
        self.p, self.r, self.r_upper = problem.sides(z)

    @cached_property
    def rounding(self) -> tuple[Vector, Vector]:
        """Bounds on the rounding errors of p and r. Collective, the first time; A has a positive diagonal."""
        return rounding(self.problem, self.z)

    def certificate(self, bound: ErrorBound, rows: tuple[Mask, ...] = ()) -> DistributedCertificate:
        """The certificate with this bound, and with the masks of the decided `rows`, if any. Collective."""
        comm = self.problem.comm
        residual = norm(comm, mid(self.problem.matrix.row_weights * self.p, self.r, self.r_upper))
        masks = rows or (np.zeros(self.p.size, dtype=bool),) * 3
        active, inactive, above = (int(x) for x in totals(comm, *(float(mask.sum()) for mask in masks)))
        undecided = self.problem.n - active - inactive - above
        return DistributedCertificate(residual, bound, active, inactive, above, undecided, *masks[:2])

    def bound(self, proof: HPlusVectors) -> Vector:
        """δ with |z − z*| ≤ δ in the own rows. Collective."""
        _, v, alpha, beta = proof
        rounding_p, rounding_r = self.rounding
        with np.errstate(over="ignore", invalid="ignore"):
            top = None if self.r_upper is None else self.r_upper / beta
            F = np.abs(mid(self.p / alpha, self.r / beta, top))
            own = float(np.max(F + np.maximum(rounding_p / alpha, rounding_r / beta), initial=0.0))
            factor = largest(self.problem.comm, own)[0] + SMALLEST
            return np.nextafter(v * (factor * (1 + 8 * UNIT_ROUNDOFF)), np.inf)

    def rows(self, delta: Vector, change: Vector) -> tuple[Mask, Mask, Mask]:
        """The masks of the rows that |z − z*| ≤ `delta` proves to be active, off both obstacles, at the upper one."""
        inflate = 1 + 8 * UNIT_ROUNDOFF
        rounding_p, rounding_r = self.rounding
        error_p = (rounding_p + self.problem.matrix.absolute(delta)) * inflate
        error_r = (rounding_r + delta + change) * inflate
        active = self.p > error_p
        inactive = self.r > error_r
        at_upper = np.zeros(delta.size, dtype=bool)
        if self.r_upper is not None:
            inactive = inactive & (-self.r_upper > error_r)
            at_upper = self.p < -error_p
        return active & ~inactive, inactive & ~active & ~at_upper, at_upper & ~inactive


def rounding(problem: DistributedICP, z: Any) -> tuple[Vector, Vector]:
    """Bounds on the rounding errors of p(z) and r(z) in the own rows, as `ProblemData.rounding`. Collective."""
    size = np.abs(z.array_r)
    k = problem.matrix.terms + 2
    rounding_p = gamma(k) * (problem.matrix.absolute(size) + np.abs(problem.q)) + k * SMALLEST
    rounding_r = np.zeros(size.size)
    for one in problem.maps:
        value = np.abs(one.value(z))
        total = size + one.change(size) + np.where(np.isinf(value), 0.0, value)
        lost = gamma(one.terms) * total + one.terms * SMALLEST
        rounding_r = np.maximum(rounding_r, np.where(np.isinf(value), 0.0, lost))
    return rounding_p, rounding_r


def obstacle_change(problem: DistributedICP, delta: Vector) -> Vector:
    """A bound on |ψ(x) − ψ(y)|, and on that of ψ̄, for |x − y| ≤ `delta`, in the own rows. Collective."""
    most = np.zeros(delta.size)
    for one in problem.maps:
        k = one.terms
        with np.errstate(over="ignore"):
            total = one.change(delta) * (1 + 2 * gamma(k)) + (0.0 if one.is_fixed else k * SMALLEST)
        most = np.maximum(most, total)
    return most


def _may_cross(problem: DistributedICP, here: _Point, change: Vector) -> bool:
    """Whether ψ > ψ̄ is possible at an x within the bound of z. Fixed obstacles were checked before."""
    if here.r_upper is None or all(one.is_fixed for one in problem.maps):
        return False
    rounding_r = here.rounding[1]
    with np.errstate(invalid="ignore"):
        safe = np.isinf(here.r) | np.isinf(here.r_upper)
        safe |= here.r - here.r_upper > (2.0 * change + 2.0 * rounding_r) * (1 + 8 * UNIT_ROUNDOFF)
    return totals(problem.comm, float((~safe).sum()))[0] > 0


def _proof(problem: DistributedICP, levels: DistributedLevels | None) -> HPlusVectors | str:
    """(name, v, α, β), or why there is none. Collective."""
    matrix = problem.matrix
    comm = problem.comm
    if largest(comm, float((matrix.diagonal <= 0).any()))[0]:
        return "A is not an H+-matrix: its diagonal is not positive"
    dominated = False
    for name, v in _candidates(matrix, levels):
        image = matrix.comparison.product(matrix.vector(v)).array
        size = matrix.absolute(v)
        k = matrix.terms + 2
        alpha = image - 2.0 * gamma(k) * size - k * SMALLEST
        beta = v - obstacle_change(problem, v) - 2.0 * UNIT_ROUNDOFF * v
        bad = (float((~(one > 0)).any()) for one in (alpha, beta))
        not_alpha, not_beta = largest(comm, *bad)
        if not (not_alpha or not_beta):
            return name, v, alpha, beta
        dominated |= not not_alpha
    if dominated:
        return "A is an H+-matrix, but no v > 0 found gives both <A>v > 0 and (I - G)v > 0: psi moves too much"
    return "A is not proved to be an H+-matrix: no v > 0 found gives <A>v > 0"


def _candidates(matrix: DistributedMatrix, levels: DistributedLevels | None) -> Iterator[tuple[str, Vector]]:
    """v = 1, and the solution of ⟨A⟩v = D1 to a residual of at most half of it in every row. Collective."""
    size = matrix.high - matrix.low
    yield "v = 1", np.ones(size)
    comparison = matrix.comparison
    if levels is None or comparison is not matrix:
        levels = DistributedLevels(comparison)
    levels.restrict(np.ones(size), 0)
    v = levels.solve(matrix.vector(comparison.diagonal), 0, None, None, 1.0)
    if not largest(matrix.comm, float((~(v.array_r > 0)).any()))[0]:
        yield "v = <A>^-1 D1", v.array.copy()
