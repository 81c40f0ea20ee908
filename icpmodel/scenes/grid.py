"""Finite differences that several scenes share. No scene is registered here."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ..numerics.arrays import Vector


def side(n: int) -> int:
    """m = round(√n), the side of the m × m grid whose number of points is nearest to `n`."""
    return round(n**0.5)


def five_point(m: int, mu: float = 0.0, skew: float = 0.0) -> sp.csr_array:
    """h² times the 5-point operator on m × m interior points, zero boundary values, plus `mu` on the diagonal.
    Tridiag(−(1+s)I, S, −(1−s)I) + μI with S = tridiag(−(1+s), 4, −(1−s)) and s = `skew`. Unknown i·m + j stands at (x,
    y) = ((j + 1)h, (i + 1)h). s = 0 is h²(−Δ); s ≠ 0 adds a flow of velocity (b, b), s = bh/2."""
    line = neighbours(m, -(1.0 + skew), -(1.0 - skew))
    eye = sp.eye_array(m)
    return sp.csr_array(sp.kron(eye, line) + sp.kron(line, eye) + (4.0 + mu) * sp.eye_array(m * m))


def adjacency(m: int) -> sp.csr_array:
    """The adjacency matrix of the m × m grid: 1 for each pair of neighbouring points."""
    line, eye = neighbours(m, 1.0, 1.0), sp.eye_array(m)
    return sp.csr_array(sp.kron(eye, line) + sp.kron(line, eye))


def neighbours(m: int, left: float, right: float) -> Any:
    """tridiag(`left`, 0, `right`), shape (m, m), CSR."""
    return tridiagonal(np.full(m - 1, left), np.zeros(m), np.full(m - 1, right))


def tridiagonal(left: Vector, middle: Vector, right: Vector) -> Any:
    """The CSR matrix with these three diagonals; `middle` has shape (n,), the others (n − 1,). Zeros are not stored."""
    matrix: Any = sp.csr_array(sp.diags_array([left, middle, right], offsets=(-1, 0, 1)))
    matrix.eliminate_zeros()
    return matrix


def square_points(low: float, high: float, m: int) -> Vector:
    """Coordinates of the m × m interior points of [low, high]², shape (m², 2), in the order of `five_point`."""
    line = np.linspace(low, high, m + 2)[1:-1]
    return np.column_stack([np.tile(line, m), np.repeat(line, m)])


def level_crossing(x: Vector, y: Vector, level: float) -> float:
    """The x at which the parabola x(y) through three points reaches `level`; NaN unless y is strictly monotone."""
    steps = np.diff(y)
    if x.size != 3 or not ((steps > 0).all() or (steps < 0).all()):
        return float("nan")
    t = level - y
    weights = [t[1] * t[2] / (steps[0] * (y[2] - y[0])), -t[0] * t[2] / (steps[0] * steps[1])]
    return float(x[0] * weights[0] + x[1] * weights[1] + x[2] * t[0] * t[1] / ((y[2] - y[0]) * steps[1]))
