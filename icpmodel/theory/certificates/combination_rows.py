"""What is known of z, and which signs a combination of rows may have: the data of a proof of infeasibility."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ...numerics.arrays import Vector
from ...problem.data import ProblemData

Combination = dict[int, Fraction]

#: what is smaller than this share of the largest entry of a computed y counts as zero
ZERO = 1e-9
#: a direction is tried as a proof if what is wrong with it is so small a share of what it shows, and a tenth each time;
#: and so far from it a proof may be, as a share of its largest entry
SHOWN = 1e-5


@dataclass(frozen=True, eq=False)
class Known:
    """Every solution has `low` ≤ z ≤ `high`, shape (n,), infinite where nothing is known; `proof` says why."""

    low: Vector
    high: Vector
    proof: str


class CombinationRows(NamedTuple):
    """The interval of each unknown, and the rows whose sign of p is known.

    z lies between `low` and `high`. p ≤ 0 may be assumed where y_i `falls`, and p ≥ 0 where it
    `rises`: masks of shape (n,).
    """

    low: Vector
    high: Vector
    falls: np.ndarray
    rises: np.ndarray

    @classmethod
    def of(cls, problem: ProblemData, known: Known | None = None) -> CombinationRows:
        low = problem.facts.obstacle
        high = problem.facts.upper_obstacle
        high = np.full(problem.n, np.inf) if high is None else high
        falls = np.isneginf(low)
        rises = np.isposinf(high)
        if known is not None:
            low = np.where(np.isfinite(known.low), known.low, low)
            high = np.where(np.isfinite(known.high), known.high, high)
        return cls(low, high, falls, rises)


def lifted(problem: ProblemData) -> ProblemData | None:
    """The problem of an affine ψ in (z, u, s), where the obstacle is constant; None for another ψ, and with two."""
    if problem.psi.linear is None or problem.upper is not None:
        return None
    (G, c) = problem.psi.linear
    unit = sp.eye_array(problem.n)
    nothing = np.full(problem.n, -np.inf)
    there = np.isfinite(c)
    A = sp.block_array([[-G, unit, None], [unit, -unit, -unit], [problem.A, None, None]])
    q = np.concatenate([np.where(there, -c, 0.0), np.zeros(problem.n), problem.q])
    return ProblemData(A, q, np.concatenate([nothing, nothing, np.where(there, 0.0, -np.inf)]))
