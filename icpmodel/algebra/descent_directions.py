"""Descent directions of a merit function ½‖φ‖²."""

from __future__ import annotations

from collections.abc import Iterator

import scipy.sparse as sp

from ..numerics.arrays import Vector, norm
from ..numerics.linear import solver_of
from ..numerics.rounding import SQRT_EPSILON
from ..problem.data import ProblemData
from .factor_costs import factor_costs
from .regularised_system import FIRST_REGULARISATION_SKEW

#: the relative tolerance of a Newton direction near the solution
NEWTON_RTOL = SQRT_EPSILON


def descent_directions(problem: ProblemData, V: sp.csr_array, phi: Vector, shift: Vector) -> Iterator[Vector]:
    """Yield the Newton direction, with V regularised if singular, then steepest descent with Cauchy's step length.

    Parameters
    ----------
    problem : ProblemData
        The problem; its A has about the pattern of V, so that its symbolic analysis serves for all V.
    V : CSR array of shape (n, n)
        An element of the generalised derivative of φ.
    phi : array of shape (n,)
        φ.
    shift : array of shape (n,)
        A singular V gets this diagonal, times `FIRST_REGULARISATION_SKEW`, added.
    """
    analysis = factor_costs(problem.matrix).analysis
    step = solver_of(V, analysis.of_similar(V))(-phi, NEWTON_RTOL)
    if step is None:
        regularised = sp.csr_array(V + sp.diags_array(FIRST_REGULARISATION_SKEW * shift))
        step = solver_of(regularised, analysis.of_similar(regularised))(-phi, NEWTON_RTOL)
    if step is not None:
        yield step
    gradient = V.T @ phi
    steepest = gradient / norm(gradient)
    size = norm(V @ steepest)
    yield -steepest * (phi @ (V @ steepest)) / size / size  # the square may under- or overflow
