"""Rigid bodies in the plane that touch: impulses z ≥ 0 of the contacts, p their velocities after one time step.

A = JM⁻¹Jᵀ with a row of J per contact, q = Jv + gap/Δt, v the velocities without contacts. A is semidefinite, singular
where there are more contacts than ways to move. There is a solution always: by Farkas infeasibility needs y ≥ 0 with
Ay ≤ 0 and qᵀy < 0, but then yᵀAy = 0, Jᵀy = 0 and qᵀy = yᵀgap/Δt ≥ 0; a feasible monotone LCP has a solution.
Reference: Stewart and Trinkle, Int. J. Numer. Methods Eng. 39 (1996); Cottle, Pang and Stone (1992), theorem 3.1.2.
"""

import numpy as np
import scipy.sparse as sp

from .draw import scattered

#: a body that does not move
_WORLD = -1


def chain(n, rng):
    """Boxes in a row, one or more contacts between two neighbours, a wall at one end or both; some are pushed."""
    gaps = max(1, round(n / 2))
    count = rng.integers(1, 4, gaps)
    walls = int(rng.integers(1, 3))
    bodies = max(1, gaps - walls + 1)
    left = np.repeat(np.arange(gaps) - 1, count)
    right = left + 1
    right[right >= bodies] = _WORLD
    height = rng.uniform(-0.5, 0.5, left.size)
    moving = rng.random(bodies) < scattered(rng, 0.02, 1.0)
    v = np.where(moving, rng.standard_normal((3, bodies)), 0.0)
    v[0] -= rng.random()  # all drift to the first wall
    normal = np.tile([[1.0], [0.0]], left.size)
    return _touching(left, right, normal, -height, -height, v, rng)


def pile(n, rng):
    """A wall of bricks under gravity, each on the ground or on the ends of two others; some are hit."""
    across = max(1, round(np.sqrt(n / 4) * np.exp(rng.uniform(-0.7, 0.7))))
    rows = 1 + max(0, round((n - 2 * across) / (4 * across - 2)))
    row, column = (index.ravel() for index in np.indices((rows, across)))
    x, brick = column + 0.5 * (row % 2), np.arange(rows * across)
    touching = []
    for side in (-1, 1):  # on the ground an end rests, above it both ends of what two bricks share
        on = brick[row == 0]
        touching.append((np.full(on.size, _WORLD), on, x[on] + 0.5 * side))
        below = column + (row % 2) * (side > 0) - (1 - row % 2) * (side < 0)
        on = brick[(row > 0) & (below >= 0) & (below < across)]
        touching += [((row[on] - 1) * across + below[on], on, x[on] + end) for end in (0.0, 0.5 * side)]
    a, b, where = (np.concatenate(part) for part in zip(*touching, strict=True))
    v = np.zeros((3, brick.size))
    v[1] = -scattered(rng, 0.01, 1.0)
    hit = rng.random(brick.size) < scattered(rng, 0.02, 0.5)
    v[:, hit] += 0.5 * rng.standard_normal((3, int(hit.sum())))
    normal = np.tile([[0.0], [1.0]], a.size)
    return _touching(a, b, normal, np.where(a < 0, 0.0, where - x[a]), where - x[b], v, rng)


def redundant(n, rng):
    """A random packing whose contacts are patches, of two or three points each, some not quite closed."""
    from scipy.spatial import cKDTree

    degree, each = rng.uniform(3.0, 6.0), int(rng.integers(2, 4))
    touching = max(1, round(n / each))
    bodies = max(3, round(2 * touching / degree))
    at = rng.random((bodies, 2))
    pairs = cKDTree(at).query_pairs(np.sqrt(4.0 * degree / (np.pi * bodies)), output_type="ndarray")
    pairs = pairs[np.argsort(np.linalg.norm(at[pairs[:, 1]] - at[pairs[:, 0]], axis=1))[:touching]]
    a, b = np.repeat(pairs.T.astype(np.int64), each, axis=1)
    normal = (at[b] - at[a]).T
    normal /= np.linalg.norm(normal, axis=0)
    arm = 0.5 * rng.uniform(-1.0, 1.0, a.size)
    v = rng.standard_normal((3, bodies)) * scattered(rng, 0.1, 1.0)
    v[1] -= 1.0
    gap = np.where(rng.random(a.size) < 0.3, 0.3 * rng.random(a.size), 0.0)
    return _touching(a, b, normal, arm, arm, v, rng, gap)


def _touching(a, b, normal, arm_a, arm_b, v, rng, gap=0.0):
    """The problem of contacts between bodies `a` and `b`, whose `normal`s, (2, n), point from a to b, and lever arms.

    `v` has shape (3, bodies): two velocities and a rotation. Masses are up to a hundredfold apart.
    """
    contacts, bodies = a.size, v.shape[1]
    values = np.concatenate([-normal[0], -normal[1], -arm_a, normal[0], normal[1], arm_b])
    body = np.concatenate([a, a, a, b, b, b])
    columns = 3 * body + np.tile(np.repeat([0, 1, 2], contacts), 2)
    rows, held = np.tile(np.arange(contacts), 6), body != _WORLD
    J = sp.csr_array((values[held], (rows[held], columns[held])), (contacts, 3 * bodies))
    mass = 10.0 ** (rng.uniform(0.0, 2.0) * (rng.random(bodies) - 0.5))
    inverse = 1.0 / np.column_stack([mass, mass, mass / 6.0]).ravel()
    half = J @ sp.diags_array(np.sqrt(inverse))
    A = half @ half.T
    return sp.csr_array((A + A.T) / 2.0), np.zeros(contacts), J @ v.T.ravel() + gap
