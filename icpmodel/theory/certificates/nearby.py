"""A better point ẑ near z where A is large, by sweeps or by Newton steps with multigrid: |z − z*| ≤ |z − ẑ| + δ(ẑ).

The proof for H₊-matrices multiplies the largest residual by v, as if it had one sign everywhere. What a solver leaves
has both, and on a fine grid δ(z) is then thousands of times the error. A point ẑ that is nearer to z* by as much mends
that, and it needs no factorisation; whatever the steps are worth, δ(ẑ) is proved like any other bound. Where
δ(ẑ) ≤ θ|z − ẑ|, the sum is at most (1 + θ)/(1 − θ) times the error. Steps that cannot help are not made:

- |F_i(z)| ≤ Σ_j|V_ij||z_j − z*_j| for a V between A and I − Γ, and no ẑ has less rounding than z: where δ(z) is at most
  ten times what that leaves, it stands.
- Four sweeps show how fast F falls. If that is how the error falls, it is the way that z has come, divided by the share
  of F that is gone (Aitken): where δ(z) is at most ten times that, it stands. That is so where F is smooth.
- Where sweeps are foreseen to cost less than a multigrid hierarchy, sweeps it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator

import numpy as np

from ...algebra.hierarchy import Hierarchy, NoHierarchy
from ...algebra.newton_steps import SWEEPS, newton_steps, sweep_with_flow, swept
from ...algebra.subproblems import with_fixed_obstacle
from ...numerics import work
from ...numerics.arrays import Vector
from ...problem.data import ProblemData
from ...problem.two_sided import mid
from .h_plus import HPlusProof

#: a bound that is at most so many times the error will do
_GOOD = 10.0
#: the shares of |z − ẑ| where δ(ẑ) will do, and that is aimed at: the bound is then at most nine times the error
_ENOUGH = 0.8
_AIM = 0.6
#: the share of the price of a hierarchy that sweeps may cost, which are foreseen to do for less than they do
_SWEEPING = 0.25
#: looks at the active set at the most, of which two in a row halve δ(ẑ)
_LOOKS = 8
#: what is left of Az + q by the steps between two looks: at the most, and at the least, where rounding takes over
_MOST = 0.1
_LEAST = 1e-12

#: points ẑ; sent are the largest entries of |z − ẑ| and of δ(ẑ)
Points = Generator[Vector, tuple[float, float], None]


def points_near(
    problem: ProblemData, z: Vector, proof: HPlusProof, bound: float, for_p: Vector, for_r: Vector
) -> Points:
    """Points that are probably nearer to z* than `z`, whose own bound is `bound`, as long as they are needed.

    `for_p` and `for_r` bound the rounding errors of p(z) and r(z). Raises MapError where ψ fails, OutOfTime and
    OutOfMemory.
    """
    first = _natural(problem, z)
    with np.errstate(all="ignore"):
        floor = float(proof.v.max() * np.maximum(for_p / proof.alpha, for_r / proof.beta).max())
    # what underflows to 0 leaves nothing to go by
    if not (first > 0 and np.isfinite(z).all() and bound > _GOOD * max(first, floor)):
        return
    simple = with_fixed_obstacle(problem)
    sweep = sweep_with_flow(simple)
    better = z
    last = first
    count = float(SWEEPS)
    beyond = bound
    price = work.sweep(problem.n, problem.nnz)
    left = _SWEEPING * work.COSTS.hierarchy_entry * problem.nnz
    made = SWEEPS
    while count * price <= left:
        count = min(count, made)  # the first ones fall faster than the rest
        work.afford(count * price)
        better = swept(sweep, better, int(count))
        left = left - count * price
        made = made + int(count)
        now = _natural(problem, better)
        step = float(np.abs(better - z).max())
        beyond = bound * now / first  # as far as is known without the cost of another bound
        if not now > 0 or bound * (first - now) <= _GOOD * step * first:
            yield better
            return
        if beyond <= max(_ENOUGH * step, 2 * floor):
            step, beyond = yield better
            if beyond <= max(_ENOUGH * step, 2 * floor):
                return
        count = _more(count, now / last, _AIM * step / beyond)
        last = now
    try:
        hierarchy = None if simple.psi.no_derivative() else Hierarchy(simple)
    except NoHierarchy:
        hierarchy = None
    if hierarchy is None:  # sweeps for its price
        rest = 3 * _SWEEPING * work.COSTS.hierarchy_entry * problem.nnz
        work.afford(rest)
        yield swept(sweep, better, int(rest / price))
        return

    def seen(better: Vector) -> tuple[float, float]:
        return float(np.abs(better - z).max()), bound * _natural(problem, better) / first

    def smooth(better: Vector) -> Vector:
        return swept(sweep, better, SWEEPS)

    yield from _by_cycles(newton_steps(hierarchy, simple, better, 0), smooth, seen, beyond, 2 * floor)


def _by_cycles(
    path: Generator[tuple[Vector, float], float | None, None],
    smooth: Callable[[Vector], Vector],
    seen: Callable[[Vector], tuple[float, float]],
    beyond: float,
    enough: float,
) -> Points:
    """The points of Newton's `path`, whose first is where δ is about `beyond`, until it is `enough` or stays.

    `smooth` makes the largest residual, which decides, several times smaller for a fraction of a cycle, which leaves it
    rough. `seen` tells about what would be sent; a bound costs more, and is asked for where it may do, and at the end.
    """
    next(path)
    share = _MOST
    before = math.inf
    asked = True
    for _ in range(_LOOKS):
        # a look that finds another active set may leave as much as there was
        earlier = before
        before = beyond
        try:
            better, _ = path.send(share)
        except StopIteration:  # its steps lead no further
            break
        better = smooth(better)
        (step, beyond) = seen(better)
        asked = False
        if beyond <= max(_ENOUGH * step, enough):
            (step, beyond) = yield better
            asked = True
        if beyond <= max(_ENOUGH * step, enough) or not 2 * beyond <= earlier:
            break
        share = min(max(_AIM * step / beyond, _LEAST), _MOST)
    if not asked:
        yield better


def _more(count: float, left: float, wanted: float) -> float:
    """How many sweeps leave the share `wanted` if the last `count` have `left` that share."""
    falls = 0 < left < 1 and 0 < wanted < 1
    return math.ceil(count * math.log(wanted) / math.log(left)) if falls else math.inf


def _natural(problem: ProblemData, z: Vector) -> float:
    """The largest |F_i(z)| in units of z, which no error in the largest entry is below; up to rounding."""
    A = problem.matrix
    G = problem.psi.lipschitz
    assert G is not None  # there would be no proof
    with np.errstate(all="ignore"):
        r = problem.r(z)
        above = problem.r_upper(z)
        if G.nnz:
            moves = 1.0 + G @ np.ones(problem.n)
            r = r / moves
            above = None if above is None else above / moves
        return float(np.abs(mid(problem.p(z) / (A.rows.rest + A.rows.diagonal), r, above)).max())
