"""Directions and linear systems that lead to a proof of infeasibility."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ...numerics.arrays import Mask, Vector, inner
from ...problem.data import ProblemData
from ..answers import Answer
from .combination_rows import MAX_MISFIT, ZERO, CombinationRows
from .infeasible import infeasible


class Recession:
    """Directions along which iterates diverge, tried as proofs that there is no solution.

    Parameters
    ----------
    problem : ProblemData
        The problem; no proof is tried unless its obstacles are constant.
    origin : array of shape (n,), default 0
        An iterate from which directions are measured. If it solves the equations, the directions do not contain the
        bounded part of the iterates.

    Notes
    -----
    Let A be monotone and no z have p ≥ 0 and r ≥ 0. Then the iterates z of a proximal or interior
    method grow, and their direction y tends to a combination as in `infeasible`. The defect of y is
    the distance of Aᵀy to its required signs, in the units of W. Its merit is −(q + Ac)ᵀy. A y is
    tried once the quotient of the two is small, and again whenever it has fallen to a tenth.
    """

    def __init__(self, problem: ProblemData, origin: Vector | float = 0.0) -> None:
        self.problem = problem
        self.origin = origin
        self.max_misfit = MAX_MISFIT
        self._rows = CombinationRows.of(problem) if problem.psi.is_constant else None
        self._root = np.sqrt(problem.matrix.proximal_weights)
        self._transposed = problem.A.T

    def proof(self, z: Vector) -> Answer:
        """Try the direction to the iterate `z`, shape (n,), as a proof; from then on require a tenth of its misfit."""
        y = z - self.origin
        quotient = self.misfit(y)
        if not quotient < self.max_misfit:
            return Answer(None, "the iterates do not diverge along a combination of rows")
        self.max_misfit = 0.1 * quotient
        return infeasible(self.problem, y, accurate=quotient < ZERO)

    @np.errstate(all="ignore")
    def misfit(self, y: Vector) -> float:
        """How much `y`, shape (n,), violates the signs of a combination as in `infeasible`, over its merit.

        It is below `ZERO` if `y` is a proof up to rounding; inf unless the merit is positive and obstacles constant.
        """
        rows = self._rows
        if rows is None:
            return np.inf
        y = rows.with_known_signs(y)
        columns = (self._transposed @ y) / self._root
        ends = self._root * np.where(columns > 0.0, rows.high, rows.low)
        open_ = np.isinf(ends)
        ends = np.where(open_, 0.0, ends)
        q = self.problem.q
        decrease = -(inner(q, y) + inner(columns, ends))
        if not decrease > ZERO * (inner(np.abs(q), np.abs(y)) + inner(np.abs(columns), np.abs(ends))):
            return np.inf
        return float(np.abs(columns[open_]).max(initial=0.0)) / decrease


def least_violation(problem: ProblemData) -> tuple[ProblemData, Mask]:
    """The ICP whose solution shows whether some z has p ≥ 0 and r ≥ 0, and the rows where p must have a sign.

    min ½‖(p)⁻‖² over ψ ≤ z ≤ ψ̄, constant obstacles, always has a solution, whether A is monotone
    or not. Let y = (p)⁻ be the violation of p ≥ 0. The optimality conditions are an ICP in (z, y):
    −Aᵀy ⟂ ψ ≤ z ≤ ψ̄ and y + Az + q ⟂ y ≥ 0. Where p = 0 is required y has any sign; where p ≤ 0 is
    required y ≤ 0. Where y is not 0 it is the y of `infeasible`.
    """
    rows = CombinationRows.of(problem)
    assert rows is not None
    signed = rows.nonnegative | rows.nonpositive
    K = problem.A[signed]
    A = sp.block_array([[None, -K.T], [K, sp.eye_array(K.shape[0])]], format="csr")
    low = np.where(rows.nonpositive, -np.inf, 0.0)[signed]
    high = np.where(rows.nonnegative, np.inf, 0.0)[signed]
    q = np.concatenate([np.zeros(problem.n), problem.q[signed]])
    return ProblemData(A, q, np.concatenate([rows.low, low]), np.concatenate([rows.high, high])), signed
