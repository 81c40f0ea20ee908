"""Certificates on ranks: the error bound of H₊-matrices, and the rows whose side it proves.

One Krylov solve with the existing levels gives v > 0 with ⟨A⟩v ≥ α > 0 and (I − G)v ≥ β > 0. One
product each checks that both are positive, rounding included, so the proof does not depend on the
accuracy of v. The bound is that of `theory.certificates.h_plus`, the rows those of
`theory.certificates.certificate`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
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
from .evaluation import Evaluation
from .ranks import anywhere, count, largest, norm

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
        """The numbers of proved and of undecided rows, in words."""
        upper = f", {self.above} at the upper obstacle" if self.above else ""
        return f"{self.active} at the obstacle{upper}, {self.inactive} off it, {self.undecided} undecided"

    def __str__(self) -> str:
        return str(Card({"residual": f"{self.residual:.3g}", "error": str(self.bound), "rows": self.rows}))


@check_arguments
def certify(problem: DistributedICP, z: Any, levels: DistributedLevels | None = None) -> DistributedCertificate:
    """State what is certain of `z`: the residual, the error bound, the rows whose side it proves.

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
    here = Evaluation(problem, check_point(problem, z, "z"))
    if levels is not None and not isinstance(levels, DistributedLevels):
        raise InputError(f"levels is {described(levels)}; the levels of a DistributedSolution were expected")
    proof = _proof(problem, levels)
    if isinstance(proof, str):
        return _certificate(here, ErrorBound.none(proof))
    name, v, alpha, beta = proof
    comm = problem.comm
    rounding_p, rounding_r = here.rounding
    with np.errstate(over="ignore", invalid="ignore"):
        top = None if here.r_upper is None else here.r_upper / beta
        F = np.abs(mid(here.p / alpha, here.r / beta, top)) + np.maximum(rounding_p / alpha, rounding_r / beta)
        delta = np.nextafter(v * ((largest(comm, F) + SMALLEST) * (1 + 8 * UNIT_ROUNDOFF)), np.inf)
    value = largest(comm, delta)
    sentence = f"A is an H+-matrix ({name})" + (ASSUMED_PSI if problem.calls_user_code else "")
    change = problem.change(delta)
    if _may_cross(here, change):
        return _certificate(here, ErrorBound.none("psi <= upper is not proved near z, where z* would be"))
    if not np.isfinite(value):
        reason = "the proof gives no bound at this z: it is too far from z*, or not finite"
        return _certificate(here, ErrorBound.none(reason, sentence))
    euclidean = norm(comm, delta) * (1 + (problem.n + 8) * UNIT_ROUNDOFF)
    return _certificate(here, ErrorBound(value, delta, euclidean, sentence, ""), _decided_rows(here, delta, change))


def _certificate(here: Evaluation, bound: ErrorBound, rows: tuple[Mask, ...] = ()) -> DistributedCertificate:
    """The certificate with this bound, and with the masks of the proved `rows`, if any. Collective."""
    masks = rows or (np.zeros(here.p.size, dtype=bool),) * 3
    active, inactive, above = (count(here.problem.comm, mask) for mask in masks)
    undecided = here.problem.n - active - inactive - above
    return DistributedCertificate(here.residual, bound, active, inactive, above, undecided, *masks[:2])


def _decided_rows(here: Evaluation, delta: Vector, change: Vector) -> tuple[Mask, Mask, Mask]:
    """The masks of the rows that |z − z*| ≤ `delta` proves to be active, off both obstacles, at the upper one."""
    inflate = 1 + 8 * UNIT_ROUNDOFF
    rounding_p, rounding_r = here.rounding
    error_p = (rounding_p + here.problem.matrix.absolute(delta)) * inflate
    error_r = (rounding_r + delta + change) * inflate
    active = here.p > error_p
    inactive = here.r > error_r
    at_upper = np.zeros(delta.size, dtype=bool)
    if here.r_upper is not None:
        inactive &= -here.r_upper > error_r
        at_upper = here.p < -error_p
    return active & ~inactive, inactive & ~active & ~at_upper, at_upper & ~inactive


def _may_cross(here: Evaluation, change: Vector) -> bool:
    """Whether ψ > ψ̄ is possible within the bound around z. Fixed obstacles were checked before. Collective."""
    if here.r_upper is None or all(one.is_fixed for one in here.problem.maps):
        return False
    with np.errstate(invalid="ignore"):
        safe = np.isinf(here.r) | np.isinf(here.r_upper)
        safe |= here.r - here.r_upper > (2.0 * change + 2.0 * here.rounding[1]) * (1 + 8 * UNIT_ROUNDOFF)
    return anywhere(here.problem.comm, ~safe)


def _proof(problem: DistributedICP, levels: DistributedLevels | None) -> HPlusVectors | str:
    """(name, v, α, β), or why there is none. Collective."""
    matrix = problem.matrix
    if anywhere(matrix.comm, matrix.diagonal <= 0):
        return "A is not an H+-matrix: its diagonal is not positive"
    dominated = False
    for name, v in _candidates(matrix, levels):
        image = matrix.comparison.product(matrix.vector(v)).array
        k = matrix.terms + 2
        alpha = image - 2.0 * gamma(k) * matrix.absolute(v) - k * SMALLEST
        beta = v - problem.change(v) - 2.0 * UNIT_ROUNDOFF * v
        if not anywhere(matrix.comm, ~(alpha > 0)):
            if not anywhere(matrix.comm, ~(beta > 0)):
                return name, v, alpha, beta
            dominated = True
    if dominated:
        return "A is an H+-matrix, but no v > 0 found gives both <A>v > 0 and (I - G)v > 0: psi moves too much"
    return "A is not proved to be an H+-matrix: no v > 0 found gives <A>v > 0"


def _candidates(matrix: DistributedMatrix, levels: DistributedLevels | None) -> Iterator[tuple[str, Vector]]:
    """v = 1, and an approximate solution v > 0 of ⟨A⟩v = D1 (residual ≤ 0.3 min d_i if it converges). Collective."""
    ones = np.ones(matrix.high - matrix.low)
    yield "v = 1", ones
    comparison = matrix.comparison
    if levels is None or comparison is not matrix:
        levels = DistributedLevels(comparison)
    levels.restrict(ones, 0)
    v = levels.solve(matrix.vector(comparison.diagonal), 0, None, None, 1.0).array_r.copy()
    if not anywhere(matrix.comm, ~(v > 0)):
        yield "v = <A>^-1 D1", v
