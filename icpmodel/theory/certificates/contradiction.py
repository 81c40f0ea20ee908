"""Which conditions of a problem contradict each other, by how much, and the nearest q for which they do not.

The conditions p ≥ 0 and r ≥ 0 of constant and affine obstacles are linear, Mz ≥ m. By how much they fail is
min s, Mz + s·e ≥ m, with e = 1 in rows of p, in the units of Res_D. Its dual is max mᵀy, Mᵀy = 0, eᵀy = 1, y ≥ 0. A
vertex of that has a minimal support: each proper subset of these conditions can be met. So no filter is needed.

Reference: Gleeson and Ryan, ORSA J. Comput. 2 (1990), doi:10.1287/ijoc.2.1.61.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...numerics import work
from ...numerics.arrays import ReadOnly, Vector
from ...numerics.exact_polyhedron import null_space
from ...numerics.rational import nearest, rationals
from ...numerics.rounding import public_entry
from ...present.shown import Shown
from ...problem.data import ProblemData, ProblemLike, as_problem

#: conditions up to which a combination is confirmed in fractions: 30 with 31 unknowns took .9 s, 15 took .06 s
_CONFIRMED = 30
#: multipliers below this share of the largest one count as 0: HiGHS's tolerance is 1e-10
_ZERO = 1e-9
#: entries of a linear program that is not tried: 10⁵ take about a second
_LARGEST = 100_000
#: seconds for a linear program, as for the other proofs
_SECONDS = 1.0
#: kinds of conditions, with row i in the place of {}
_KINDS = ("p[{}] >= 0", "p[{}] <= 0", "z[{}] >= psi[{}]", "z[{}] <= upper[{}]")


@dataclass(frozen=True, eq=False, repr=False)
class Contradiction(ReadOnly, Shown):
    """Conditions that no z meets together, confirmed in rational arithmetic.

    Attributes
    ----------
    rows : ndarray of int, shape (k,)
        The rows of the conditions; any k − 1 of these can be met.
    conditions : tuple of str
        Each of them in words, in the same order.
    weights : ndarray, shape (k,)
        Positive weights, with which their sum says 0 ≥ `by`.
    by : float
        The least s such that |dq_i|/d_i ≤ s for some q + dq with p ≥ 0 and r ≥ 0 at some z; d as in `ICP.residual`, 1
        where row i of A is 0. It is inf where the obstacles alone contradict each other.
    change : ndarray or None, shape (n,)
        Such a dq of the smallest Σ|dq_i|/d_i, up to rounding; None where there is none, and where Az overflows.

    Examples
    --------
    >>> print(icp.contradiction(ICP([[0, -1], [1, 0]], [1, -3], upper=[2, np.inf])))
    infeasible by 1: p[1] >= 0, z[0] <= upper[0]
    """

    rows: NDArray[np.intp]
    conditions: tuple[str, ...]
    weights: Vector
    by: float
    change: Vector | None
    _kinds: NDArray[np.intp]

    def witness(self, n: int) -> Vector:
        """The weights of all conditions as one vector (y, x), as in `infeasible`.

        Parameters
        ----------
        n : int
            The number of rows.

        Returns
        -------
        array of shape (2n,)
            The weights of the n rows of p, then those of the rows of r, with their signs.

        Examples
        --------
        >>> icp.contradiction(ICP([[0]], [-2])).witness(1)
        array([1., 0.])
        """
        signed = np.where(self._kinds % 2 == 0, self.weights, -self.weights)
        weights: Vector = np.zeros(2 * n)
        np.add.at(weights, self.rows + n * (self._kinds // 2), signed)
        return weights

    def __str__(self) -> str:
        how = "infeasible by its obstacles alone" if self.by == np.inf else f"infeasible by {self.by:.3g}"
        return f"{how}: {', '.join(self.conditions)}"

    def named(self, name: Callable[[int], str]) -> Contradiction:
        """The same contradiction with names of rows before the conditions.

        Parameters
        ----------
        name : callable
            Row → its name: the constraint of a model, the label of a DataFrame.

        Returns
        -------
        Contradiction
            A copy.

        Examples
        --------
        >>> found = icp.contradiction(ICP([[0]], [-2]))
        >>> print(found.named(["balance"].__getitem__))
        infeasible by 2: balance: p[0] >= 0
        """
        named = (f"{name(int(i))}: {one}" for i, one in zip(self.rows, self.conditions, strict=True))
        return replace(self, conditions=tuple(named))


@public_entry
@np.errstate(all="ignore")  # what overflows proves nothing
def contradiction(problem: ProblemLike) -> Contradiction | None:
    """Find a minimal set of contradictory conditions among p ≥ 0 and r ≥ 0, and the nearest q without one.

    Parameters
    ----------
    problem : ICP, or what holds or makes one
        With constant or affine obstacles.

    Returns
    -------
    Contradiction or None
        None where there is none, or where it is not confirmed: for other obstacles, more than 30 conditions, or a
        linear program of more than 10⁵ entries or a second.

    Notes
    -----
    Where p ≥ 0 and r ≥ 0 contradict each other there is no solution. Without a contradiction there is one where the
    obstacle is constant and A is monotone or copositive-plus; for other A there may be none.

    References
    ----------
    Cottle, Pang and Stone, The Linear Complementarity Problem (1992), chapter 3.

    Examples
    --------
    >>> found = icp.contradiction(ICP([[0, -1], [1, 0]], [1, -1.5], upper=[1, np.inf]))
    >>> found.rows, found.by, found.change
    (array([1, 0]), 0.5, array([0. , 0.5]))
    """
    conditions = _Conditions.of(as_problem(problem))
    if conditions is None or conditions.M.nnz > _LARGEST or not conditions.representable:
        return None
    found = _least(conditions)
    if found is None:  # no q helps where the obstacles contradict each other
        sides = conditions.of_obstacles()
        found = _least(sides)
        return None if found is None else sides.confirmed(found[1], change=None)
    z, y, least = found
    return conditions.confirmed(y, change=conditions.change(z, least))


@dataclass(frozen=True, eq=False)
class _Conditions:
    """Mz ≥ m: of each the `kinds` and the `rows`; rows of p are in the units of Res_D."""

    problem: ProblemData
    M: sp.csr_array
    m: Vector
    kinds: NDArray[np.intp]
    rows: NDArray[np.intp]

    @classmethod
    def of(cls, problem: ProblemData) -> _Conditions | None:
        if problem.psi.linear is None or (problem.upper is not None and problem.upper.linear is None):
            return None
        unit = sp.eye_array(problem.n, format="csr")
        inverse = _inverse_units(problem)
        (G, c) = problem.psi.linear
        none = np.full(problem.n, np.inf)
        H, d = (G, none) if problem.upper is None or problem.upper.linear is None else problem.upper.linear
        p = sp.diags_array(inverse) @ problem.A
        right = -inverse * problem.q
        sides = [
            (p, right, np.isinf(d)),
            (-p, -right, np.isinf(c)),
            (unit - G, c, ~np.isinf(c)),
            (H - unit, -d, ~np.isinf(d)),
        ]
        matrices = [sp.csr_array(K)[there] for K, _, there in sides]
        rows = [np.flatnonzero(there) for *_, there in sides]
        kinds = np.repeat(np.arange(4), [one.size for one in rows])
        m = np.concatenate([side[there] for _, side, there in sides])
        return cls(problem, sp.csr_array(sp.vstack(matrices)), m, kinds, np.concatenate(rows))

    @property
    def representable(self) -> bool:
        """Whether none of its entries overflows."""
        return bool(np.isfinite(self.M.data).all() and np.isfinite(self.m).all())

    def of_obstacles(self) -> _Conditions:
        """Those of r alone."""
        kept = self.kinds >= 2
        return _Conditions(self.problem, self.M[kept], self.m[kept], self.kinds[kept], self.rows[kept])

    def change(self, z: Vector, least: float) -> Vector | None:
        """The smallest dq with |dq_i|/d_i ≤ `least`: with the fewest units in all, else that which makes `z` do."""
        asked = np.flatnonzero(self.kinds < 2)
        E = sp.csr_array((np.ones(asked.size), (asked, np.arange(asked.size))), shape=(self.m.size, asked.size))
        sparse = _minimised(self, E, (1.0 + _ZERO) * least)
        z = z if sparse is None else sparse[0]
        p = self.problem.p(z)
        change = np.zeros(self.problem.n)
        at_least, at_most = (self.rows[self.kinds == kind] for kind in (0, 1))
        change[at_least] = np.maximum(-p[at_least], 0.0)
        change[at_most] += np.minimum(-p[at_most], 0.0)
        change[np.abs(change) * _inverse_units(self.problem) < _ZERO * least] = 0.0
        return change if np.isfinite(change).all() else None

    def confirmed(self, y: Vector, change: Vector | None) -> Contradiction | None:
        """The combination of the support of `y`, if it is one in fractions."""
        support = np.flatnonzero(y > _ZERO * y.max())
        if support.size > _CONFIRMED:
            return None
        M, m = self._exact(support)
        columns = [list(column) for column in zip(*M, strict=True) if any(column)]
        basis = null_space(columns, support.size)
        if len(basis) != 1:
            return None
        weights = basis[0] if sum(basis[0]) > 0 else [-x for x in basis[0]]
        total = sum((a * b for a, b in zip(weights, m, strict=True)), Fraction(0))
        if min(weights) <= 0 or total <= 0:
            return None
        inverse = _inverse_units(self.problem)[self.rows[support]]
        sizes = [
            x / Fraction(float(w)) for x, w, kind in zip(weights, inverse, self.kinds[support], strict=True) if kind < 2
        ]
        return Contradiction(
            rows=self.rows[support],
            conditions=tuple(
                _KINDS[k].format(i, i) for k, i in zip(self.kinds[support], self.rows[support], strict=True)
            ),
            weights=np.array([nearest(x) for x in weights]),
            by=nearest(total / sum(sizes)) if sizes else np.inf,  # no q helps where the obstacles alone contradict
            change=change if sizes else None,
            _kinds=self.kinds[support],
        )

    def _exact(self, support: NDArray[np.intp]) -> tuple[Any, list[Fraction]]:
        """These conditions as they are stated, in fractions."""
        M = []
        m = []
        problem = self.problem
        for kind, i in zip(self.kinds[support], self.rows[support], strict=True):
            sign = 1 if kind in (0, 2) else -1
            if kind < 2:
                [row] = rationals(problem.A[[i]])
                side = -problem.q[i]
            else:
                G, c = (problem.psi if kind == 2 else problem.upper).linear  # type: ignore[union-attr,misc]
                [moves] = rationals(G[[i]])
                side = c[i]
                row = [int(j == i) - x for j, x in enumerate(moves)]
            M.append([sign * x for x in row])
            m.append(sign * Fraction(float(side)))
        return M, m


def _inverse_units(problem: ProblemData) -> Vector:
    """1/d of Res_D, and 1 in rows of A without an entry."""
    return np.where(problem.matrix.empty_rows, 1.0, problem.matrix.row_weights)


def _least(conditions: _Conditions) -> tuple[Vector, Vector, float] | None:
    """z, multipliers and the value of min s, Mz + s ≥ m in rows of p, else in all; None where it is 0 or unknown."""
    relaxed = conditions.kinds < 2
    relaxed = relaxed if relaxed.any() else ~relaxed
    found = _minimised(conditions, sp.csr_array(relaxed.astype(np.float64)[:, None]), np.inf) if relaxed.any() else None
    return found if found is not None and found[2] > 0.0 else None


def _minimised(conditions: _Conditions, E: sp.csr_array, most: float) -> tuple[Vector, Vector, float] | None:
    """z, the multipliers and the value of min Σs, Mz + Es ≥ m, 0 ≤ s ≤ `most`, by the dual simplex method."""
    from scipy.optimize import linprog

    M = conditions.M
    m = conditions.m
    n = conditions.M.shape[1]
    unit = float(np.abs(m).max(initial=0.0)) or 1.0  # a solver takes 1e20 for infinite
    found = linprog(
        np.concatenate([np.zeros(n), np.ones(E.shape[1])]),
        A_ub=-sp.hstack([M, E]).tocsr(),
        b_ub=-m / unit,
        bounds=[*[(None, None)] * n, *[(0.0, most / unit)] * E.shape[1]],
        method="highs-ds",
        options={
            "time_limit": min(_SECONDS, max(1e-9 * work.nanoseconds_left(), 0.0)),
            "primal_feasibility_tolerance": 1e-10,
            "dual_feasibility_tolerance": 1e-10,
        },
    )
    if found.status != 0:
        return None
    return unit * found.x[:n], -found.ineqlin.marginals, unit * float(found.fun)
