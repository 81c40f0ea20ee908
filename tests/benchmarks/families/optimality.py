"""Programs with their multipliers, A = [P, −Fᵀ; F, E]: control over time, flows through a network, convex regression.

A is monotone, its rows without obstacle have one solution for all others, and in these the program is bounded.
"""

import numpy as np
import scipy.sparse as sp

from .draw import scattered, some


def control(n, rng):
    """States x⁺ = Mx + Bu near where they ought to be, and pushes u ≥ 0 that cost something: (x, u, ν)."""
    states, pushes = min(some(rng, 2, 12), max(2, n // 4)), some(rng, 1, 4)
    steps = max(1, round(n / (2 * states + pushes)))
    x, u = steps * states, steps * pushes
    M = np.eye(states) + scattered(rng, 0.003, 0.3) / np.sqrt(states) * rng.standard_normal((states, states))
    B = sp.kron(sp.eye_array(steps), rng.standard_normal((states, pushes)))
    F = sp.hstack([sp.kron(sp.eye_array(steps, k=-1), M) - sp.eye_array(x), B])
    P = sp.diags_array(np.repeat([scattered(rng, 0.01, 1.0), scattered(rng, 1e-4, 1.0) * rng.integers(2)], [x, u]))
    begin = np.append(M @ rng.standard_normal(states), np.zeros(x - states))
    q = np.concatenate([0.3 * rng.standard_normal(x), rng.uniform(0.1, 1.0, u), begin])
    return sp.block_array([[P, -F.T], [F, None]], format="csr"), np.repeat([-np.inf, 0.0, -np.inf], [x, u, x]), q


def flow(n, rng):
    """Flows ≥ 0 between places that are near, at a cost for the way, and prices there; demand gives way to these."""
    from scipy.spatial import cKDTree

    degree = min(some(rng, 2, 12), int(np.sqrt(n)))
    places = max(degree + 1, round(n / (degree + 1)))
    at, arcs = rng.random((places, 2)), places * degree
    ways, near = (found[:, 1:].ravel() for found in cKDTree(at).query(at, k=degree + 1))
    ends = np.append(np.repeat(np.arange(places), degree), near)
    B = sp.csr_array((np.repeat([-1.0, 1.0], arcs), (ends, np.tile(np.arange(arcs), 2))), shape=(places, arcs))
    E, wanted = scattered(rng, 1e-6, 1.0) * sp.diags_array(rng.uniform(0.5, 1.5, places)), rng.standard_normal(places)
    q = np.append(ways * np.sqrt(places), wanted.mean() - wanted)
    return sp.block_array([[None, -B.T], [B, E]], format="csr"), np.repeat([0.0, -np.inf], [arcs, places]), q


def regression(n, rng):
    """The values of a convex function at places that are as near to one another as chance has it, and multipliers."""
    knots = max(3, round(n / 2))
    gaps = np.diff(np.sort(rng.random(knots)) * knots) + scattered(rng, 1e-3, 1.0)
    rises = [sp.diags_array([-1.0, 1.0], offsets=[0, 1], shape=(k, k + 1)) for k in (knots - 2, knots - 1)]
    F = rises[0] @ sp.diags_array(1.0 / gaps) @ rises[1]
    q = -(np.linspace(-2.0, 2.0, knots) ** 2) - scattered(rng, 0.03, 1.0) * rng.standard_normal(knots)
    A = sp.block_array([[sp.eye_array(knots), -F.T], [F, None]], format="csr")
    return A, np.repeat([-np.inf, 0.0], [knots, knots - 2]), np.append(q, np.zeros(knots - 2))
