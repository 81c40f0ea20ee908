"""The condition number of the answer with respect to the data: computed, estimated or certified."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..derivatives.derivative import Derivative
from ..errors import InputError, SingularOperator, check_arguments
from ..numerics.arrays import Vector
from ..numerics.rounding import UNIT_ROUNDOFF, rounded_up
from ..present.card import Card
from ..present.display import Plottable
from ..problem.data import ProblemData
from ..problem.two_sided import sides_of
from ..solve.solution import Solution
from ..theory.certificates.bounds import perturbation_bound

#: up to this n the inverse is computed; beyond it, its norm is estimated
_INVERT_UP_TO = 500
#: the number of random sign vectors of the changes
_RANDOM_SIGNS = 10
#: ε of the change that the certificate bounds: second-order terms and rounding are of the same size
_RELATIVE_CHANGE = np.sqrt(UNIT_ROUNDOFF)


@check_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Sensitivity(Plottable):
    """The condition number κ: max|δz| ≤ κ·ε·max|z| if every entry of A, q and ψ changes by at most ε of itself.

    Parameters
    ----------
    problem : ICP
        The problem.
    local : float or None
        κ to first order, on the active set of z; undecided rows take the side that z is nearer to.
        None where the equations of the active set are singular or ψ has no derivative.
    rows : array of shape (n,) or None
        The same for each entry of z, κ_i with |δz_i| ≤ κ_i·ε·max|z|; `plot` draws it.
    exact : bool
        Whether `local` and `rows` were computed, not estimated. Estimates are lower bounds. That of κ
        is seldom too small by more than a factor of 3. Those of κ_i are maxima over ten random sign
        vectors of the changes.
    certified : float or None
        An upper bound of κ to first order, from the proof of the error bound, for any active set.
        None where there is no proof.
    undecided : int
        The number of rows that are not proved to be at the obstacle or off it.

    Examples
    --------
    >>> found = icp.study.sensitivity(ICP([[2.0]], [-2.0]).solve())
    >>> found.local, found.rows
    (2.0, array([2.]))
    """

    problem: ProblemData
    local: float | None
    rows: Vector | None
    exact: bool
    certified: float | None
    undecided: int

    def __str__(self) -> str:
        local = "not known: the equations of the active set are singular" if self.local is None else f"{self.local:.3g}"
        rows = {
            "condition number, to first order" + ("" if self.exact else " (estimated)"): local,
            "the same from the certificate": "no proof"
            if self.certified is None
            else f"<= {rounded_up(self.certified)}",
            "undecided rows": str(self.undecided),
        }
        if self.local:
            rows["digits of the data that the answer loses"] = f"{max(np.log10(self.local), 0.0):.1f}"
        return str(Card(rows))


@check_arguments
def sensitivity(solution: Solution) -> Sensitivity:
    """Compute the condition number of z with respect to small relative changes ε of the entries of A, q and ψ.

    On the active set Jδz = δ with |δ| ≤ εE. J has the rows of I − ψ′ at the obstacle and of A elsewhere.
    E_i is (|A||z| + |q|)_i off the obstacle. At it, E_i is (|G||z| + |c|)_i, or |ψ_i(z)| where ψ is not
    affine. Hence κ = ‖|J⁻¹|E‖_∞/‖z‖_∞, Skeel's condition number.

    Parameters
    ----------
    solution : Solution
        A solved solution with z ≠ 0.

    Returns
    -------
    Sensitivity
        The condition number, computed and certified.

    Raises
    ------
    InputError
        Where the solution is not solved, or is 0.

    References
    ----------
    Skeel, J. ACM 26 (1979), doi:10.1145/322139.322148; for the 1-norm estimate Higham and Tisseur,
    SIAM J. Matrix Anal. Appl. 21 (2000), doi:10.1137/S0895479899356080.

    Examples
    --------
    >>> solution = ICP([[1.0, -0.999], [-0.999, 1.0]], [-1.0, -1.0]).solve()
    >>> round(icp.study.sensitivity(solution).local)
    2000
    """
    if not isinstance(solution, Solution) or not solution.solved:
        raise InputError("solution is not solved: only a solution has a sensitivity")
    size = float(np.abs(solution.z).max())
    if size == 0.0:
        raise InputError("solution has z = 0, to which no change is relative")
    answer = solution.polish()
    problem = solution.problem
    z = answer.z
    change_p, *changes_r = _relative_changes(problem, z, size)
    change_r = np.maximum.reduce(changes_r)
    unit = _RELATIVE_CHANGE * size
    certified = None
    if solution.certificate.unique:  # `perturbation_bound` alone would prove it for the tangent problem only
        with np.errstate(over="ignore", invalid="ignore"):
            certified = perturbation_bound(problem.linearised(z), z, unit * change_p, unit * change_r)
    local, rows = _local(answer, change_p, changes_r)
    return Sensitivity(
        problem=problem,
        local=local,
        rows=rows,
        exact=problem.n <= _INVERT_UP_TO,
        certified=None if certified is None else certified / unit,
        undecided=int(solution.active_set.undecided.sum()),
    )


def _relative_changes(problem: ProblemData, z: Vector, size: float) -> list[Vector]:
    """E/size, each of shape (n,): (|A||z| + |q|)/size for p, and (|G||z| + |c|)/size or |ψ(z)|/size for each obstacle.

    The terms are divided before they are added, so that none overflows.
    """
    x = np.abs(z) / size
    changes = [problem.matrix.absolute @ x + np.abs(problem.q) / size]
    for psi in sides_of(problem.psi):
        linear = psi.linear
        moved = np.abs(psi.value(z)) / size if linear is None else abs(linear[0]) @ x + np.abs(linear[1]) / size
        changes.append(np.where(np.isfinite(moved), moved, 0.0))
    return changes


def _local(answer: Solution, change_p: Vector, changes_r: list[Vector]) -> tuple[float | None, Vector | None]:
    """‖|J⁻¹|E‖_∞/max|z| and |J⁻¹|E/max|z|, computed or estimated; None where J is singular or ψ has no derivative.

    Reference: Higham, ACM Trans. Math. Softw. 14 (1988), for the estimate."""
    from scipy.sparse.linalg import LinearOperator, onenormest

    if answer.problem.psi.no_derivative() is not None:
        return None, None
    derivative = Derivative(answer)
    E = change_p
    for rows, change_r in zip(derivative.pattern.sides(), changes_r, strict=True):
        E = np.where(rows, change_r, E)
    exact = E.size <= _INVERT_UP_TO
    signs = np.eye(E.size) if exact else np.random.default_rng(0).choice([-1.0, 1.0], (_RANDOM_SIGNS, E.size))

    def adjoint_product(x: Vector) -> Vector:
        return derivative.solve(E * np.ravel(x))

    def matrix_product(x: Vector) -> Vector:
        return E * derivative.solve(np.ravel(x), transposed=True)

    try:
        columns = np.abs([adjoint_product(one) for one in signs])
        if exact:
            rows = columns.sum(axis=0)
            return float(rows.max()), rows
        rows = columns.max(axis=0)
        product = LinearOperator((E.size, E.size), matvec=matrix_product, rmatvec=adjoint_product, dtype=np.float64)
        # t = 1, as further columns would come from NumPy's global random state; the maximum with `rows` makes up for it
        return max(float(onenormest(product, t=1)), float(rows.max())), rows
    except SingularOperator:
        return None, None
