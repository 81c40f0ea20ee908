"""Solutions that are chosen before the data. No scene is registered here."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..numerics.arrays import Vector, as_number


def complementary(n: int, seed: Any, degenerate: float = 0.0) -> tuple[Vector, Vector, Vector]:
    """Random z* in [−1, 1] and p*, r* ≥ 0 with p*ᵀr* = 0: half of the rows at the obstacle.

    Parameters: `n` the number of rows; `seed` an integer ≥ 0; `degenerate` the share of all rows with p* = r* = 0, the
    entries of the others lie in [.5, 1.5]. Returns z, p, r, shape (n,). Raises InputError for a bad seed.
    """
    random = np.random.default_rng(int(as_number(seed, "seed", least=0, whole=True)))
    z, size = random.uniform(-1.0, 1.0, n), random.uniform(0.5, 1.5, n)
    place = random.permutation(n)
    size[place >= round((1.0 - degenerate) * n)] = 0.0
    at_obstacle = place < round((1.0 - degenerate) * n) // 2
    return z, np.where(at_obstacle, size, 0.0), np.where(at_obstacle, 0.0, size)
