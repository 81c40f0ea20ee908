"""What all families share: how numbers are drawn, and how A, the obstacle and the load are brought to one scale."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...numerics.arrays import Vector

#: A as `ICP` takes it, the obstacle c and q, both of shape (n,)
Draw = tuple[Any, Vector, Vector]


def scattered(rng: np.random.Generator, low: float, high: float) -> float:
    """A number between two positive ones, its logarithm uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def some(rng: np.random.Generator, low: float, high: float) -> int:
    """The same as an integer."""
    return max(1, round(scattered(rng, low, high)))


def loaded(A: Any, c: Vector, load: Vector, rng: np.random.Generator) -> Draw:
    """A so scaled that its forces Ac on the obstacle are about as large as the `load`, and q that load about a mean,
    which presses: else A that is nearly singular would lift all rows off.
    Where p and r have like sizes a residual says something of both; in units of a fine grid p would be all rounding.
    """
    strength = scattered(rng, 0.3, 3.0) / float(np.median(np.abs(A @ c)))
    return A * strength, c, load + rng.uniform(0.1, 1.0)


def waves(points: Vector, length: float, rng: np.random.Generator) -> Vector:
    """A sum of six plane waves of about this `length` in any direction, of mean square 1; `points` has shape (n, k)."""
    total: Vector = np.zeros(len(points))
    for _ in range(6):
        direction = rng.standard_normal(points.shape[1])
        steep = 2.0 * np.pi / (np.linalg.norm(direction) * length * rng.uniform(0.7, 1.5))
        total += np.sin(points @ (steep * direction) + rng.uniform(0.0, 2.0 * np.pi))
    return total / np.sqrt(3.0)


def in_regions(points: Vector, values: Vector, rng: np.random.Generator) -> Vector:
    """At each of the `points` the value of the region that it is in: those nearest to one of so many random places."""
    from scipy.spatial import cKDTree

    low, high = points.min(axis=0), points.max(axis=0)
    places = rng.uniform(low, high, (values.size, points.shape[1]))
    return values[cKDTree(places).query(points)[1]]
