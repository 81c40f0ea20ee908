"""A better point ẑ near z where A is large, by sweeps and by Newton steps with multigrid: |z − z*| ≤ |z − ẑ| + δ(ẑ).

The proof for H₊-matrices multiplies the largest residual by v, as if it had one sign everywhere. What a solver leaves
has both, and on a fine grid δ(z) is then thousands of times the error. A point ẑ that is nearer to z* by as much mends
that, and it needs no factorisation; whatever the steps are worth, δ(ẑ) is proved like any other bound. Where
δ(ẑ) ≤ θ|z − ẑ|, the sum is at most (1 + θ)/(1 − θ) times the error. Steps that cannot help are not made:

- |F_i(z)| ≤ Σ_j|V_ij||z_j − z*_j| for a V between A and I − Γ, and no ẑ has less rounding than z: where δ(z) is at most
  ten times what that leaves, it stands.
- Four sweeps show how the error falls. Where δ falls with them by at most ten times what z moves, it is about ten times
  the error at the most: that is so where the residual is smooth.
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import suppress
from functools import cache, partial

import numpy as np

from ...algebra.hierarchy import Hierarchy, Level, NoHierarchy
from ...algebra.looks import newton_looks
from ...algebra.subproblems import with_fixed_obstacle
from ...numerics.arrays import Vector
from ...problem.data import ProblemData
from .h_plus import HPlusProof

#: a bound that is at most so many times the error will do
_GOOD = 10.0
#: the shares of |z − ẑ| where δ(ẑ) will do, and that is aimed at: the bound is then at most three times the error
_ENOUGH, _AIM = 0.5, 0.25
#: looks at the active set at the most, of which two in a row halve δ(ẑ)
_LOOKS = 8
#: what is left of Az + q by the steps between two looks: at the most, and at the least, where rounding takes over
_MOST, _LEAST = 0.1, 1e-12

#: points ẑ; sent are the largest entries of |z − ẑ| and of δ(ẑ)
Points = Generator[Vector, tuple[float, float], None]


def points_near(
    problem: ProblemData, z: Vector, proof: HPlusProof, bound: float, for_p: Vector, for_r: Vector
) -> Points:
    """Points that are probably nearer to z* than `z`, whose own bound is `bound`, as long as they are needed.

    `for_p` and `for_r` bound the rounding errors of p(z) and r(z). Raises MapError where ψ fails, OutOfTime and
    OutOfMemory.
    """
    if not np.isfinite(z).all() or bound <= _GOOD * _least(problem, z, proof, for_p, for_r):
        return
    simple = with_fixed_obstacle(problem) if problem.facts.has_fixed_obstacle else problem
    if simple.psi.no_derivative() is not None:
        return
    with suppress(NoHierarchy, StopIteration):
        path = newton_looks(simple, z, Level(simple), cache(partial(Hierarchy, simple)))
        step, beyond = yield next(path)[0]
        if beyond <= _ENOUGH * step or abs(bound - beyond) <= _GOOD * step:
            return
        share, before = _MOST, np.inf
        for _ in range(_LOOKS):
            # a look that finds another active set may leave as much as there was
            earlier, before = before, beyond
            step, beyond = yield path.send(share)[0]
            if beyond <= _ENOUGH * step or not 2 * beyond <= earlier:
                return
            share = min(max(_AIM * step / beyond, _LEAST), _MOST)


def _least(problem: ProblemData, z: Vector, proof: HPlusProof, for_p: Vector, for_r: Vector) -> float:
    """What neither the error of `z` nor the rounding in δ is below; up to rounding."""
    A, G = problem.matrix, problem.psi.lipschitz
    assert G is not None  # there would be no proof
    with np.errstate(all="ignore"):
        r = problem.r(z)
        if G.nnz:
            r /= 1.0 + G @ np.ones(problem.n)
        error = np.abs(np.minimum(problem.p(z) / (A.rows.rest + A.rows.diagonal), r)).max()
        rounding = proof.v.max() * np.maximum(for_p / proof.alpha, for_r / proof.beta).max()
        return float(max(error, rounding))
