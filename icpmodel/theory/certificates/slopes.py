"""Uniqueness and error bounds where p is nonlinear and the slopes of an elementwise f are in a known interval.

Let f be continuous and f_i(x_i) − f_i(y_i) = d_i(x_i − y_i) with d_i ≥ m_i for all x and y. Then p(x) − p(y) = (A +
diag(d))(x − y). Where f jumps there may be no solution: z − ½ + sign(z) is strongly monotone and has no zero.

1. ⟨A + diag(d)⟩ ≥ ⟨A⟩ + diag(m) where a_ii + m_i > 0. So the proof of `h_plus` for A + diag(m) and ψ also holds for
   the nonlinear problem, with its p.
2. Let A + diag(m) be positive definite and the obstacles fixed, λ‖x‖² ≤ xᵀ(A + diag(m))x. Take any z̃ between the
   obstacles and u such that p(z̃) − u ≥ 0 at ψ, ≤ 0 at ψ̄, and = 0 in between. Then ‖z̃ − z*‖₂ ≤ ‖u‖₂/λ.

Proof of 2: z̃ solves the variational inequality of p − u, and z* that of p. The sum of the two inequalities at each
other's solution is (p(z̃) − u − p(z*))ᵀ(z̃ − z*) ≤ 0. So λ‖z̃ − z*‖² ≤ uᵀ(z̃ − z*). The problem has one solution as p is
strongly monotone and continuous. Units are those of `definite`.

References
----------
Facchinei and Pang, Finite-Dimensional Variational Inequalities and Complementarity Problems (2003), theorem 2.3.3.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...numerics.arrays import Vector
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF
from ...problem.data import ProblemData
from ...problem.matrix import Matrix
from .definite import DefiniteProof
from .definite import prove as prove_definite
from .h_plus import prove as prove_h_plus
from .proof import Proof, norm_up


@dataclass(frozen=True, eq=False)
class MonotoneProof(Proof):
    """`definite` proves λ for A + diag(m)."""

    definite: DefiniteProof

    needs_sharpening = True  # as in `definite`, δ bounds the Euclidean norm of the error only

    def bound(self, problem: ProblemData, z: Vector, rounding_p: Vector, rounding_r: Vector) -> tuple[Vector, float]:
        low = problem.psi.value(z)
        high = np.full(z.size, np.inf) if problem.upper is None else problem.upper.value(z)
        with np.errstate(over="ignore", invalid="ignore"):
            inside = np.clip(z, low, high)
            ahead = inside - problem.matrix.row_weights * problem.p(z)
            at_low = ahead < low
            at_high = ahead > high
            point = np.where(at_low, low, np.where(at_high, high, inside))
            p = problem.p(point)
            u = np.where(at_low, np.minimum(p, 0.0), np.where(at_high, np.maximum(p, 0.0), p))
            u = np.ldexp(np.abs(u) + problem.rounding(point)[0], self.definite.exponent) + SMALLEST
            root = norm_up(u) / self.definite.smallest * (1.0 + 8.0 * UNIT_ROUNDOFF)
            delta = np.ldexp(np.full(z.size, root), self.definite.exponent) + np.abs(point - z)
            delta = np.nextafter(delta * (1.0 + 8.0 * UNIT_ROUNDOFF), np.inf)
        return delta, norm_up(delta)


def proofs_by_slopes(problem: ProblemData) -> Iterator[Proof | str]:
    """Yield the proofs for a problem with an f, or why one fails."""
    assert problem.f is not None
    bounds = problem.f.slope_range
    if bounds is None:
        advice = ": give `slope_range` to Elementwise" if problem.f.is_elementwise else ""
        yield f"p is nonlinear, and the slopes of f are not known{advice}"
        return
    matrix = problem.matrix
    added = ""
    if bounds[0].any():
        A, diagonal = problem.A.copy(), problem.A.diagonal()
        # rounded down: a lower bound of a_ii + m_i
        A.setdiag(np.nextafter(diagonal + bounds[0], -np.inf))
        matrix = Matrix(A)
        added = "with the least slopes of f added to its diagonal, "
    h_plus = prove_h_plus(matrix, problem.psi)
    yield added + h_plus if isinstance(h_plus, str) else h_plus
    if not problem.psi.is_constant:
        yield "where the obstacles move, strong monotonicity of a nonlinear p proves nothing"
        return
    definite = prove_definite(matrix, problem.psi)
    yield (
        added + definite
        if isinstance(definite, str)
        else MonotoneProof(f"p is strongly monotone: {definite.sentence}", definite)
    )
