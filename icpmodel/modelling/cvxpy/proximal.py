"""Monotone LCPs whose matrix is singular, as those of quadratic programs are: the proximal point method.

Newton's method wants systems that can be solved. M + σI is positive definite where M is positive semidefinite, so

    z⁺ solves the LCP with M + σI and q − σz        (σ > 0; rows without obstacle stay so)

has exactly one solution, the residual of z⁺ in the LCP itself is at most σ|z⁺ − z|, and z converges wherever there is a
solution. Where there is none, z⁺ − z tends to the direction of a proof. σ falls where Newton's method needs few
steps, and rises where it fails.
Reference: Rockafellar, SIAM J. Control Optim. 14 (1976); Liao-McPherson and Kolmanovsky, FBstab, Automatica 113 (2020).
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ...icp import ICP
from ...methods.newton import Newton
from ...numerics.arrays import Vector
from ...solve.solution import Status

#: the first σ, how it changes, and its range, for a matrix with entries of about 1
_FIRST, _CHANGE, _LEAST, _MOST = 1e-2, 10.0, 1e-10, 1e2
#: Newton's steps for one proximal point, at the most and where they are few
_STEPS, _FEW = 100, 20


@dataclass(frozen=True)
class ProximalPoint:
    """One proximal point: `z`, the step `direction` = z⁺ − z that led to it, its `residual` and Newton's `steps`."""

    z: Vector
    direction: Vector
    residual: float
    steps: int


def proximal_points(problem: ICP, tolerance: float, time_limit: float = np.inf) -> Iterator[ProximalPoint]:
    """The proximal points of `problem`, an LCP with positive semidefinite A of entries about 1, from its obstacle on.

    Parameters: `tolerance` of the residual, from which that of Newton's method follows; `time_limit` in seconds.
    It ends when the time is over, or no σ lets Newton's method succeed. Raises KeyboardInterrupt after Ctrl-C.
    """
    end = time.perf_counter() + time_limit
    c = problem.psi.value(np.zeros(problem.n))
    z = np.where(np.isneginf(c), 0.0, c)
    sigma, shifted = _FIRST, _shifted(problem, _FIRST)
    while (left := end - time.perf_counter()) > 0:
        found = shifted.with_q(problem.q - sigma * z).solve(
            Newton(),
            z0=z,
            rtol=0.0,
            atol=0.1 * tolerance,
            max_iter=_STEPS,
            time_limit=None if np.isinf(left) else left,
            raise_on_failure=False,
        )
        if found.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        if found.status in (Status.SOLVED, Status.PRECISION_LIMIT):
            yield ProximalPoint(found.z, found.z - z, problem.residual(found.z), found.iterations)
            z, following = found.z, max(sigma / _CHANGE, _LEAST) if found.iterations <= _FEW else sigma
        elif sigma < _MOST:
            following = sigma * _CHANGE
        else:
            return
        if following != sigma:
            sigma, shifted = following, _shifted(problem, following)


def _shifted(problem: ICP, sigma: float) -> ICP:
    return ICP(problem.A + sigma * sp.eye_array(problem.n), problem.q, problem.psi)
