"""What all families share: how numbers are drawn, and how A, the obstacle and the load are brought to one scale.

A family is a function (n, rng) ↦ (A, c, q): A as `ICP` takes it, the obstacle c and q of shape (n,).
"""

import numpy as np


def scattered(rng, low, high):
    """A number between two positive ones, its logarithm uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def some(rng, low, high):
    """The same as an integer."""
    return max(1, round(scattered(rng, low, high)))


def loaded(A, c, load, rng):
    """A so scaled that its forces Ac on the obstacle are about as large as the `load`, and q that load about a mean,
    which presses: else A that is nearly singular would lift all rows off.
    Where p and r have like sizes a residual says something of both; in units of a fine grid p would be all rounding.
    """
    strength = scattered(rng, 0.3, 3.0) / float(np.median(np.abs(A @ c)))
    return A * strength, c, load + rng.uniform(0.1, 1.0)


def waves(points, length, rng):
    """A sum of six plane waves of about this `length` in any direction, of mean square 1; `points` has shape (n, k)."""
    total = np.zeros(len(points))
    for _ in range(6):
        direction = rng.standard_normal(points.shape[1])
        steep = 2.0 * np.pi / (np.linalg.norm(direction) * length * rng.uniform(0.7, 1.5))
        total += np.sin(points @ (steep * direction) + rng.uniform(0.0, 2.0 * np.pi))
    return total / np.sqrt(3.0)


def in_regions(points, values, rng):
    """At each of the `points` the value of its region: the points nearest to one of the random places."""
    from scipy.spatial import cKDTree

    low, high = points.min(axis=0), points.max(axis=0)
    places = rng.uniform(low, high, (values.size, points.shape[1]))
    return values[cKDTree(places).query(points)[1]]
