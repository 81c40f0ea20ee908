"""The units in which foreign solvers get a problem, so that their absolute tolerances are meaningful."""

from __future__ import annotations

import contextlib
import math

import numpy as np
import scipy.sparse as sp

from ..errors import MapError
from ..numerics.arrays import Vector
from ..numerics.equilibration import in_units
from ..problem.data import ProblemData
from ..problem.function import Function
from ..problem.map import Map


def in_typical_units(problem: ProblemData) -> tuple[ProblemData, float]:
    """Scale `problem` so that a typical |a_ii| and a typical size of z are near 1; return it and the unit of z.

    A becomes 2⁻ⁱA, q 2⁻ⁱ⁻ᵏq, ψ y ↦ 2⁻ᵏψ(2ᵏy), without rounding; z = 2ᵏy. The size of z follows from
    the data, never from an answer. It is the larger of two typical sizes. One is that of |q_i/a_ii|,
    in rows with two obstacles at most the larger |obstacle|. The other is that of the obstacles at
    z = 0 which exclude 0. Returns (problem in y, 2ᵏ), or (problem, 1) if something would overflow.
    """
    diagonal = np.abs(problem.A.diagonal())
    size_A = _typical_size(diagonal) or _typical_size(np.abs(problem.A.data)) or 1.0
    with np.errstate(over="ignore", under="ignore"):
        from_q = np.abs(problem.q) / np.where(diagonal > 0, diagonal, size_A)
        obstacle = np.zeros(0)
        with contextlib.suppress(MapError):  # it only helps to choose a unit
            obstacle = problem.psi.value(np.zeros(problem.n))
            if problem.upper is not None:
                above = problem.upper.value(np.zeros(problem.n))
                from_q = np.minimum(from_q, np.maximum(np.abs(obstacle), np.abs(above)))
                obstacle = np.maximum(obstacle, -above)
        i = math.frexp(size_A)[1]
        k = math.frexp(max(_typical_size(from_q), _typical_size(obstacle)) or 1.0)[1]
        A = in_units(problem.A, np.full(problem.n, -i), np.zeros(problem.n, dtype=int))
        q = np.ldexp(problem.q, -i - k)
        unit = float(np.ldexp(1.0, k))
    if not (np.isfinite(A.data).all() and np.isfinite(q).all() and 0.0 < unit < math.inf):
        return problem, 1.0
    return ProblemData(A, q, _in_unit(problem.psi, problem.n, unit)), unit


def in_units_of_z(problem: ProblemData, unit: float) -> ProblemData:
    """A problem with nonlinear p, in y = z/`unit`, a power of two, scaled to typical entries of A + f′ near 1."""
    f = problem.f
    assert f is not None
    scale = 2.0 ** -math.frexp(_typical_size(1.0 / problem.matrix.row_weights) or 1.0)[1]
    scaled_f = Function(
        lambda y: scale / unit * f.value(unit * y),
        lambda y: scale * f.jacobian(unit * y),
        sparsity=sp.eye_array(problem.n) if f.is_elementwise else f.map.links,
    )
    psi = _in_unit(problem.psi, problem.n, unit)
    return ProblemData(scale * problem.A, scale / unit * problem.q, psi, f=scaled_f)


def _in_unit(psi: Map, n: int, unit: float) -> Map:
    return psi.composed(unit * sp.eye_array(n, format="csr"), factor=1.0 / unit)


def _typical_size(sizes: Vector) -> float:
    """The lower median of the positive finite `sizes`, 0 where there are none: one odd row must not set the unit."""
    positive = sizes[np.isfinite(sizes) & (sizes > 0)]
    return float(np.quantile(positive, 0.5, method="lower")) if positive.size else 0.0
