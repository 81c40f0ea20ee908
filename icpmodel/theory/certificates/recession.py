"""Directions and linear systems that lead to a proof of infeasibility."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ...numerics.arrays import Mask, Vector, inner
from ...problem.data import ProblemData
from ..answers import Answer
from .combination_rows import SHOWN, ZERO, CombinationRows, lifted
from .infeasible import in_units_of_rows, infeasible

#: seconds for a linear program
_SECONDS = 1.0


class Recession:
    """Directions along which iterates diverge, tried as proofs that there is no solution.

    Parameters
    ----------
    problem : ProblemData
        The problem; where its obstacles are not constant no proof is tried.

    Notes
    -----
    Let A be monotone and no z have p ≥ 0 and r ≥ 0. Then the iterates z of a proximal or interior
    method grow, and their direction y tends to a combination as in `infeasible`. The defect of y is
    the distance of Aᵀy to its required signs, in the units of W. Its merit is −(q + Ac)ᵀy. Each y
    is tried whose quotient of the two is a tenth of the last one.
    """

    def __init__(self, problem: ProblemData) -> None:
        self.problem = problem
        self.share = SHOWN

    def proof(self, y: Vector) -> Answer:
        """What is proved by the direction `y`, shape (n,)."""
        unknown = Answer(None, "the iterates do not run away")
        problem = self.problem
        if not problem.psi.is_constant:
            return unknown
        share = _share(problem, y)
        if not share < self.share:
            return unknown
        self.share = 0.1 * share
        return infeasible(problem, y, bounded=share < ZERO)


def contradicts(problem: ProblemData, y: Vector) -> bool:
    """Whether `y`, shape (n,), is a combination as in `infeasible` up to rounding; constant obstacles."""
    return _share(problem, y) < ZERO


@np.errstate(all="ignore")
def _share(problem: ProblemData, y: Vector) -> float:
    """What is wrong with `y` as a share of what it shows."""
    rows = CombinationRows.of(problem)
    root = np.sqrt(problem.matrix.proximal_weights)
    y = np.where((rows.rises & (y > 0.0)) | (rows.falls & (y < 0.0)), y, 0.0)
    columns = (problem.A.T @ y) / root
    ends = root * np.where(columns > 0.0, rows.high, rows.low)
    open_ = np.isinf(ends)
    ends = np.where(open_, 0.0, ends)
    shown = -(inner(problem.q, y) + inner(columns, ends))
    if not shown > ZERO * (inner(np.abs(problem.q), np.abs(y)) + inner(np.abs(columns), np.abs(ends))):
        return np.inf
    return float(np.abs(columns[open_]).max(initial=0.0)) / shown if shown > 0.0 else np.inf


def least_violation(problem: ProblemData) -> tuple[ProblemData, Mask]:
    """The ICP whose solution shows whether some z has p ≥ 0 and r ≥ 0, and the rows where p must have a sign.

    min ½‖(p)⁻‖² over ψ ≤ z ≤ ψ̄, constant obstacles, always has a solution, whether A is monotone
    or not. Let y = (p)⁻ be the violation of p ≥ 0. The optimality conditions are an ICP in (z, y):
    −Aᵀy ⟂ ψ ≤ z ≤ ψ̄ and y + Az + q ⟂ y ≥ 0. Where p = 0 is required y has any sign; where p ≤ 0 is
    required y ≤ 0. Where y is not 0 it is the y of `infeasible`.
    """
    rows = CombinationRows.of(problem)
    asked = rows.rises | rows.falls
    K = problem.A[asked]
    A = sp.block_array([[None, -K.T], [K, sp.eye_array(K.shape[0])]], format="csr")
    low = np.where(rows.falls, -np.inf, 0.0)[asked]
    high = np.where(rows.rises, np.inf, 0.0)[asked]
    q = np.concatenate([np.zeros(problem.n), problem.q[asked]])
    return ProblemData(A, q, np.concatenate([rows.low, low]), np.concatenate([rows.high, high])), asked


def multipliers(problem: ProblemData) -> Vector | None:
    """A candidate y for `infeasible`: (q + Ac)ᵀy < 0, Aᵀy ≤ 0 and 0 ≤ y ≤ 1 in floats, for constant ψ = c.

    - Rows without an obstacle: −1 ≤ y ≤ 1 and (Aᵀy)_i = 0.
    - Rows with one above alone: −1 ≤ y ≤ 0 and (Aᵀy)_i ≥ 0.
    - Rows with both: y_i = 0, t_i ≥ 0, and (Aᵀy)_i(c̄_i − c_i) is added to the sum.

    Of several candidates, linear programming (HiGHS) takes the one with the most room for rounding.
    None where there is none, as where some z has p, r ≥ 0, or where none is found in a second. For
    an affine ψ it is (y, x), shape (2n,).
    """
    if not problem.psi.is_constant:
        higher = lifted(problem)
        found = None if higher is None else multipliers(higher)
        return None if found is None else np.concatenate([found[2 * problem.n :], found[: problem.n]])
    from scipy.optimize import linprog

    problem, units = in_units_of_rows(problem)
    A = problem.A.tocsc()
    n = problem.n
    (low, high, falls, rises) = CombinationRows.of(problem)
    free = falls & rises
    both = ~(falls | rises)
    sign = np.where(falls, -1.0, 1.0)
    with np.errstate(over="ignore", invalid="ignore"):
        load = problem.p(np.where(free, 0.0, np.where(falls, high, low)))
        width = np.where(both, high - low, 1.0)[:, None]
        unit = float(np.abs(load).max()) or 1.0  # a solver takes 1e20 for infinite
        load = load / unit
        width = np.where(both[:, None], width / unit, 1.0)
        size = np.abs(load).sum()
        sums = abs(A).sum(axis=0) * width[:, 0]
    if not (np.isfinite(10.0 * size) and np.isfinite(sums).all() and np.isfinite(width).all()):
        return None
    # the unknowns are y, t, and the room, in shares of what the rows could be
    k = int(both.sum())
    columns = sp.csr_array(A.T) * (sign[:, None] * width)
    more = -sp.eye_array(n).tocsc()[:, both]
    total = np.concatenate([load, np.ones(k), [size]])
    least = np.concatenate([np.where(falls, -1.0, 0.0), np.zeros(k + 1)])
    most = np.concatenate([np.where(rises, 1.0, 0.0), np.full(k, np.inf), [1.0]])
    found = linprog(
        np.append(total[:-1], -10.0 * size),
        A_ub=sp.vstack([sp.hstack([columns, more, sums[:, None]]).tocsr()[~free], total[None]]),
        b_ub=np.zeros(n - free.sum() + 1),
        A_eq=sp.hstack([A[:, free].T, np.zeros((free.sum(), k + 1))]),
        b_eq=np.zeros(free.sum()),
        bounds=np.column_stack([least, most]),
        options={"time_limit": _SECONDS},
    )
    return np.ldexp(found.x[:n], units) if found.status == 0 and total[:-1] @ found.x[:-1] < 0 else None
