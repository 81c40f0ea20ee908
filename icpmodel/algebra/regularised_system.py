"""Linear systems with A + D + δW, D a diagonal that changes, and δ as small as accurate factors allow."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from ..numerics.arrays import Vector
from ..numerics.condensed import CondensedFactors
from ..numerics.factorisation import factorise
from ..numerics.fill import SymbolicAnalysis
from ..numerics.linear import ROUGH_SOLVE, refine
from ..numerics.rounding import SQRT_EPSILON
from ..numerics.symmetric_factors import SymmetricFactors
from ..problem.data import ProblemData

#: the first δ, for a symmetric and for an unsymmetric A, and the least δ, near rounding. In an unsymmetric A the
#: diagonal does not bound the entries, and δ² must be above rounding, or pivots may vanish
_FIRST_REGULARISATION = 1e-9
FIRST_REGULARISATION_SKEW = 1e-7
MIN_REGULARISATION = 1e-13
#: a solve with a relative residual of at most √ε reduces δ to a tenth; one above ε^¼ is repeated with ten times δ
_DECREASE = 0.1
#: (f, relative residual) ↦ x with the matrix of the system
Solve = Callable[[Vector, float], Vector]


def first_regularisation(problem: ProblemData) -> float:
    """The first δ, which depends on whether A is symmetric."""
    return _FIRST_REGULARISATION if problem.matrix.is_nearly_symmetric else FIRST_REGULARISATION_SKEW


class RegularisedSystem:
    """A + D + δW with the A of a problem.

    Parameters
    ----------
    problem
        The problem.
    analysis
        The factorisation that keeps its pattern, or a symbolic analysis; with None each matrix is analysed anew.
    weights
        The diagonal of W, shape (n,).
    """

    def __init__(
        self,
        problem: ProblemData,
        analysis: SymmetricFactors | CondensedFactors | SymbolicAnalysis | None,
        weights: Vector,
    ) -> None:
        self.problem = problem
        self.weights = weights
        self.analysis = analysis
        self.matrix = sp.csr_array(problem.A, dtype=np.float64, copy=True)
        self.delta = self.first_delta = first_regularisation(problem)
        # raised where factors with a smaller δ were inaccurate
        self.least_delta = MIN_REGULARISATION
        self.error = 0.0

    def adapt(self) -> bool:
        """Adapt δ to the `error` of the last solve; return False if that was too inaccurate and must be repeated."""
        if self.error > ROUGH_SOLVE and self.delta < self.first_delta:
            self.delta = self.least_delta = min(self.delta / _DECREASE, self.first_delta)
            return False
        if self.error <= SQRT_EPSILON:
            self.delta = max(_DECREASE * self.delta, self.least_delta)
        return True

    def solver(self, diagonal: Vector, subtracted: sp.csr_array | None = None) -> Solve:
        """The solver of (A + D + δW − `subtracted`)x = f, D the `diagonal`; x is NaN where the factorisation fails.

        It is valid until the next call. x is refined to the given relative residual while each step halves it. Each
        solve sets `error`, the relative residual before refinement.
        """
        M = self.matrix
        M.data[:] = self.problem.A.data
        M.data[self.problem.matrix.rows.diag] += diagonal + self.delta * self.weights
        if subtracted is not None:
            M = sp.csr_array(M - subtracted)
        unit = 1.0 / np.sqrt(np.abs(M.diagonal()))
        M.data *= np.repeat(unit, np.diff(M.indptr))
        M.data *= unit[M.indices]
        if self.analysis is None or isinstance(self.analysis, SymbolicAnalysis):  # symmetric at most by chance
            factors = factorise(M, definite=True, analysis=self.analysis or SymbolicAnalysis(M, lambda: False))
        else:
            factors = self.analysis.factors(M.data)

        def solve(f: Vector, accuracy: float) -> Vector:
            if factors is None:
                self.error = np.inf
                return np.full(f.size, np.nan)
            # without exchanges of rows digits may be lost
            x, self.error, _ = refine(factors.solve, lambda x: M @ x, unit * f, accuracy)
            return np.asarray(unit * x)

        return solve
