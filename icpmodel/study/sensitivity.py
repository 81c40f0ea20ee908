"""How much the answer moves when the data move: a condition number, found in three ways."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..derivatives.derivative import Derivative
from ..errors import InputError, SingularOperator
from ..icp import ICP
from ..numerics.arrays import Vector, as_number
from ..numerics.rounding import at_most
from ..present.card import Card
from ..present.shown import Plotted
from ..problem.affine import Affine, Constant
from ..problem.data import ProblemData
from ..problem.map import Map
from ..problem.two_sided import TwoSidedObstacle
from ..solve.solution import Solution
from ..theory.certificates.bounds import bound_of_change
from .cases import unbroken

#: up to this size the inverse is computed, beyond its norm is estimated
_INVERT_UP_TO = 500
#: the relative tolerance of linear systems that are solved by steps
_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivity(Plotted):
    """κ with max|δz| ≤ κ·ε·max|z| where A, q and ψ change by at most ε of themselves, entry by entry.

    Parameters
    ----------
    problem : ICP
        The problem.
    local : float or None
        To first order, on the active set of z, undecided rows on the side they are nearer to. None
        where its equations are singular or ψ has no derivative.
    exact : bool
        Whether `local` was computed. An estimate is from below, seldom by more than a factor of 3.
    certified : float or None
        An upper bound to first order, from the proof behind the error bound, whatever the active
        set. None where there is no proof.
    moved : array of shape (n,) or None
        The largest |δz_i|/(ε max|z|) among random changes, each solved again; `plot` draws it. None
        where one of them was not solved.
    change : float
        ε of the random changes.
    trials : int
        How many random changes were solved.
    undecided : int
        Rows of which it is not proved that they are at the obstacle or off it.

    Examples
    --------
    >>> found = icp.study.sensitivity(ICP([[2.0]], [-2.0]).solve())
    >>> found.local, 0.0 < found.observed <= 2.00001
    (2.0, True)
    """

    problem: ProblemData
    local: float | None
    exact: bool
    certified: float | None
    moved: Vector | None
    change: float
    trials: int
    undecided: int

    @property
    def observed(self) -> float | None:
        """The largest entry of `moved`."""
        return None if self.moved is None else float(self.moved.max())

    def __str__(self) -> str:
        local = "not known: the equations of the active set are singular" if self.local is None else f"{self.local:.3g}"
        seen = "not known: a changed problem was not solved" if self.observed is None else f"{self.observed:.3g}"
        rows = {
            "condition number, to first order" + ("" if self.exact else " (estimated)"): local,
            "the same from the certificate": "no proof" if self.certified is None else f"<= {at_most(self.certified)}",
            f"largest of {self.trials} random changes of {self.change:g}": seen,
            "undecided rows": str(self.undecided),
        }
        if self.local:
            rows["digits of the data that the answer loses"] = f"{max(np.log10(self.local), 0.0):.1f}"
        return str(Card(rows))


def sensitivity(solution: Solution, *, change: float = 1e-6, trials: int = 10, seed: int = 0) -> Sensitivity:
    """How much z moves when A, q and ψ move by the relative amount `change`, entry by entry.

    On the active set Jδz = δ with |δ| ≤ εE. J has the rows of I − ψ′ at the obstacle and of A elsewhere.
    E_i is (|A||z| + |q|)_i off the obstacle. At it, E_i is (|G||z| + |c|)_i, or |ψ_i(z)| where ψ is not
    affine. Hence κ = ‖|J⁻¹|E‖_∞/‖z‖_∞, Skeel's condition number.

    Parameters
    ----------
    solution : Solution
        A solved solution with z ≠ 0.
    change : float in (0, 0.1), default 1e-6
        The relative size ε of the random changes.
    trials : int, default 10
        Number of random changes, at least 1.
    seed : int, default 0
        Seed of the random changes.

    Returns
    -------
    Sensitivity
        The condition number, computed in three ways.

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
    >>> round(icp.study.sensitivity(ICP([[1.0, -0.999], [-0.999, 1.0]], [-1.0, -1.0]).solve()).local)
    2000
    """
    change = as_number(change, "change", above=0.0, below=0.1)
    trials = int(as_number(trials, "trials", least=1, whole=True))
    random = np.random.default_rng(int(as_number(seed, "seed", least=0, whole=True)))
    if not isinstance(solution, Solution) or not solution.solved:
        raise InputError("solution is not solved: only the sensitivity of a solution can be told")
    size = float(np.abs(solution.z).max())
    if size == 0.0:
        raise InputError("solution has z = 0, to which no change is relative")
    answer = solution.polish()
    problem = solution.problem
    z = answer.z
    of_p, of_r = _moved_by(problem, z, size)
    unit = change * size
    with np.errstate(over="ignore", invalid="ignore"):
        certified = bound_of_change(problem, z, unit * of_p, unit * of_r)
    moved = _observed(problem, z, change, trials, random)
    return Sensitivity(
        problem=problem,
        local=_local(answer, size),
        exact=problem.n <= _INVERT_UP_TO,
        certified=None if certified is None else certified / unit,
        moved=None if moved is None else moved / unit,
        change=change,
        trials=trials,
        undecided=int(solution.active_set.undecided.sum()),
    )


def _moved_by(problem: ProblemData, z: Vector, size: float) -> tuple[Vector, Vector]:
    """E/size where p and where r counts: |A||z| + |q|, and |G||z| + |c| or |ψ(z)|, of both obstacles the larger one;
    divided first, so none overflows."""
    x = np.abs(z) / size
    of_r = np.zeros(z.size)
    for psi in (problem.psi, problem.upper):
        if psi is None:
            continue
        linear = psi.linear
        moved = np.abs(psi.value(z)) / size if linear is None else abs(linear[0]) @ x + np.abs(linear[1]) / size
        of_r = np.maximum(of_r, np.where(np.isfinite(moved), moved, 0.0))
    return problem.matrix.absolute @ x + np.abs(problem.q) / size, of_r


def _local(answer: Solution, size: float) -> float | None:
    """‖J⁻¹ diag(E/max|z|)‖_∞ = ‖diag(E/max|z|) J⁻ᵀ‖₁, computed or estimated.

    Reference: Higham, ACM Trans. Math. Softw. 14 (1988), for the estimate."""
    from scipy.sparse.linalg import LinearOperator, onenormest

    if answer.problem.psi.no_derivative() is not None:
        return None
    derivative = Derivative(answer)
    equations = derivative.equations
    (of_p, of_r) = _moved_by(answer.problem, answer.z, size)
    E = np.where(derivative.pattern.active, of_r, of_p)
    try:
        derivative.solved(E)
    except SingularOperator:
        return None
    if E.size <= _INVERT_UP_TO:
        columns = [equations.solve(column, _TOLERANCE) for column in np.diag(E)]
        known = [column for column in columns if column is not None]
        if len(known) < E.size:
            return None
        return float(np.abs(np.column_stack(known)).sum(axis=1).max())
    times, back = (
        lambda x: E * equations.transposed(np.ravel(x), _TOLERANCE),
        lambda x: equations.solve(E * np.ravel(x), _TOLERANCE),
    )
    product = LinearOperator((E.size, E.size), matvec=times, rmatvec=back, dtype=np.float64)
    # with t = 1, as more columns are drawn from NumPy's global state; what that may miss, Higham's vector shows
    slanted = np.linspace(1.0, 2.0, E.size) * np.where(np.arange(E.size) % 2, -1.0, 1.0)
    return max(float(onenormest(product, t=1)), float(np.abs(times(slanted)).sum() / np.abs(slanted).sum()))


def _uncrossed(psi: Map) -> Map:
    """`psi` with its obstacles exchanged in rows where they are constant and have crossed: had each of them moved by a
    relative ε at the most, so has each of what they are exchanged for."""
    if not isinstance(psi, TwoSidedObstacle) or psi.linear is None or psi.upper.linear is None or not psi.is_constant:
        return psi
    c = psi.linear[1]
    d = psi.upper.linear[1]
    return psi if (c <= d).all() else TwoSidedObstacle(Constant(np.minimum(c, d)), Constant(np.maximum(c, d)))


def _perturbed(psi: Map, n: int, moved: Callable[[Any], Any]) -> Map:
    """ψ with its data changed by `moved`, array ↦ array; with its values changed where it has no data."""
    if isinstance(psi, TwoSidedObstacle):
        return TwoSidedObstacle(_perturbed(psi.lower, n, moved), _perturbed(psi.upper, n, moved))
    if isinstance(psi, Constant):
        return Constant(moved(psi.c)).bind(n)
    if isinstance(psi, Affine):
        G = psi.G.copy()
        G.data = moved(G.data)
        return Affine(G, moved(psi.c))
    return psi.composed(1.0, factor=moved(np.ones(n)))


def _observed(
    problem: ProblemData, z: Vector, change: float, trials: int, random: np.random.Generator
) -> Vector | None:
    """The largest |δz_i| over random changes of every entry by a factor 1 ± ε."""

    def moved(x: Any) -> Any:
        return x * (1.0 + change * random.choice([-1.0, 1.0], np.shape(x)))

    largest = np.zeros(problem.n)
    for _ in range(trials):
        A = problem.A.copy()
        A.data = moved(A.data)
        other = ICP(A, moved(problem.q), _uncrossed(_perturbed(problem.psi, problem.n, moved)))
        again = unbroken(other.solve(z0=z, raise_on_failure=False)).polish()
        if not again.solved:
            return None
        largest = np.maximum(largest, np.abs(again.z - z))
    return largest
