"""Model no more than the scene needs: problems that are smaller or simpler, and have the same solutions."""

from __future__ import annotations

import numpy as np

from .arrays import Vector
from .maps import Constant, Map
from .problem import ICP, UNIT_ROUNDOFF

#: evaluations of ψ at the most; with a derivative five are the rule
_EVALUATIONS = 100


def has_fixed_obstacle(problem: ICP) -> bool:
    """Whether every ψ_i is known to move with its own z_i alone, and by less than it: `with_fixed_obstacle` applies.

    >>> from icpmodel import Affine
    >>> has_fixed_obstacle(ICP([[2.0]], [1.0], Affine([[0.5]]))), has_fixed_obstacle(ICP([[2.0]], [1.0], np.sin))
    (True, False)
    """
    G = problem.psi.lipschitz
    if G is None:
        return False
    slope = G.diagonal()
    return bool(np.count_nonzero(G.data) == np.count_nonzero(slope) and (slope < 1).all())


def with_fixed_obstacle(problem: ICP) -> ICP:
    """The LCP with the same solutions, where `has_fixed_obstacle`.

    r_i(z) = z_i − ψ_i(z_i) then grows with z_i, so that r_i ≥ 0 says z_i ≥ c_i with r_i(c_i) = 0: a fixed obstacle. The
    n equations are solved at once by Newton's method, kept in the bracket that the Lipschitz constant ℓ_i < 1 gives,
    −r/(1 − ℓ) ≤ c − z ≤ −r/(1 + ℓ) for r > 0, and by halving it where ψ has no derivative.

    Returns the problem itself where ψ is constant. Raises MapError where ψ fails.

    >>> from icpmodel import Elementwise
    >>> with_fixed_obstacle(ICP([[2.0]], [1.0], Elementwise(lambda z: 0.5 * z + 1.0, lipschitz=0.5))).psi
    Constant(2)
    """
    if isinstance(problem.psi, Constant):
        return problem
    G = problem.psi.lipschitz
    assert G is not None, "ask has_fixed_obstacle first"
    return problem.with_psi(_roots(problem.psi, G.diagonal()))


def _roots(psi: Map, slope: Vector) -> Vector:
    """c with c_i = ψ_i(c_i), to rounding or until nothing moves; −inf where ψ_i is."""
    c = np.zeros(slope.size)
    low, high = np.full(c.size, -np.inf), np.full(c.size, np.inf)
    for _ in range(_EVALUATIONS):
        value = psi.value(c)
        r = np.where(np.isneginf(value), 0.0, c - value)
        if (np.abs(r) <= 2 * UNIT_ROUNDOFF * np.abs(c)).all():
            break
        near, far = c - r / (1.0 + slope), c - r / (1.0 - slope)
        low, high = np.maximum(low, np.minimum(near, far)), np.minimum(high, np.maximum(near, far))
        J = psi.jacobian(c)
        newton = np.nan if J is None else c - r / (1.0 - J.diagonal())
        before, c = c, np.where((low <= newton) & (newton <= high), newton, 0.5 * (low + high))
        if np.array_equal(c, before):
            break
    return np.where(np.isneginf(value), -np.inf, c)
