"""The one judge: what is true of z, recomputed from (A, q, ψ, z)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...numerics.arrays import as_truth
from ...present.card import Card
from ...problem.data import ProblemData, as_problem
from .bounds import ErrorBound, error_bound

#: the reason of a certificate without a bound that nobody asked for
NOT_COMPUTED = "it was not computed"


@dataclass(frozen=True)
class Certificate:
    """What is true of z, recomputed from (A, q, ψ, z) by `certify` and by nothing else.

    `residual` = ‖min(r, p)‖₂; `residual_max` the max-norm of the same vector; `residual_scaled` the max-norm of
    min(r, D⁻¹p) with D = |diag(A)|, in the units of z, or None where the diagonal has a zero; `violation_p` and
    `violation_r` the largest negative parts of p and r; `bound` the `ErrorBound`.

    >>> certify(ICP([[2.0]], [-2.0]), [1.0]).residual
    0.0
    """

    residual: float
    residual_max: float
    residual_scaled: float | None
    violation_p: float
    violation_r: float
    bound: ErrorBound

    @property
    def error_bound(self) -> float | None:
        """max_i |z_i − z*_i| is at most this; None where there is no certificate (`bound.reason` says why).

        >>> certify(ICP([[0.0]], [1.0]), [0.0]).error_bound is None
        True
        """
        return self.bound.value

    @property
    def unique(self) -> bool:
        """Whether the solution is proved to exist and to be the only one.

        >>> certify(ICP([[2.0]], [-2.0]), [1.0]).unique
        True
        """
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


def certify(
    problem: ProblemData, z: Any, *, bound: bool = True, sharp: bool | None = None, rigorous: bool = False
) -> Certificate:
    """The one judge of an answer, ours or a foreign solver's.

    Parameters: `z` shape (n,), or a `Solution`; `bound` whether to look for an error bound as well, which may cost one
    linear solve, and `sharp` and `rigorous` how: see `icpmodel.error_bound`.
    Returns a `Certificate`. Raises InputError for what is no ICP or no such z, MapError where ψ fails.

    >>> certify(ICP([[2.0]], [-2.0]), [1.5]).violation_p
    0.0
    """
    z, bound = as_problem(problem).vector(z), as_truth(bound, "bound")
    diagonal = np.abs(problem.A.diagonal())
    with np.errstate(over="ignore", invalid="ignore"):
        p, r = problem.p(z), problem.r(z)
        scaled = None if (diagonal == 0).any() else float(np.abs(np.minimum(r, p / diagonal)).max())
    return Certificate(
        residual=problem.residual(z),
        residual_max=float(np.abs(np.minimum(r, p)).max()),
        residual_scaled=scaled,
        violation_p=float(np.maximum(-p, 0.0).max()),
        violation_r=float(np.maximum(-r, 0.0).max()),
        bound=(error_bound(problem, z, sharp=sharp, rigorous=rigorous) if bound else ErrorBound.none(NOT_COMPUTED)),
    )
