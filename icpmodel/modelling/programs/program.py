"""Affine variational inequalities over a polyhedron: their conditions as an ICP, and a judge in their own units.

Find x in C = {low ≤ x ≤ high, Ex = b, Gx ≤ h} with (Hx + g)ᵀ(y − x) ≥ 0 for all y in C. x solves this if and only if
there are multipliers ν and λ with

    Hx + g + Eᵀν + Gᵀλ  ⟂  low ≤ x ≤ high,       b − Ex = 0  (ν of any sign),       h − Gx ≥ 0  ⟂  λ ≥ 0,

which is an ICP in (x, ν, λ). Where H is symmetric and positive semidefinite, x minimises ½xᵀHx + gᵀx over C.
Reference: Facchinei and Pang, Finite-Dimensional Variational Inequalities (2003), section 1.2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from ...icp import ICP
from ...numerics.arrays import Vector, row_of
from ...numerics.equilibration import balanced, in_units
from ...numerics.rounding import UNIT_ROUNDOFF, gamma

#: the share of their sizes by which bounds may cross as data and quotients are rounded
_TOUCH = 4.0 * UNIT_ROUNDOFF
#: the share of the largest entry of g, or of the sides, up to which rounding is what is wrong with the gradient or rows
_SAID = 1e-3
#: the share of its terms up to which a row is tight at a start
_TIGHT = 1e-6
#: log₂ of the quotient of entries that are far apart
_FAR = 60
#: the largest exponent by which units are moved
_LARGEST = 400


class Values(NamedTuple):
    """x, the multipliers ν of Ex = b and λ of Gx ≤ h, and those of the bounds: ≥ 0 at the upper, ≤ 0 at the lower."""

    x: Vector
    equality: Vector
    inequality: Vector
    box: Vector


@dataclass(frozen=True, eq=False)
class Program:
    """The data of an affine variational inequality, CSR matrices and vectors; a quadratic program where H = Hᵀ."""

    H: sp.csr_array
    g: Vector
    G: sp.csr_array
    h: Vector
    E: sp.csr_array
    b: Vector
    low: Vector
    high: Vector

    def objective(self, x: Vector) -> float:
        """½xᵀHx + gᵀx."""
        return float(0.5 * x @ (self.H @ x) + self.g @ x)

    def has_matrices_of(self, other: Program) -> bool:
        """Whether H, G and E are those of `other`, in the same storage."""
        return all(map(_same, (self.H, self.G, self.E), (other.H, other.G, other.E)))

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether H = Hᵀ, up to rounding."""
        skew = np.abs((self.H - self.H.T).data).max(initial=0.0)
        return bool(skew <= self.g.size * UNIT_ROUNDOFF * np.abs(self.H.data).max(initial=0.0))

    @cached_property
    def _sizes(self) -> tuple[Any, ...]:
        """|H|, |G|, |E|, |G|ᵀ, |E|ᵀ, Gᵀ, Eᵀ, γ of the longest sum in the conditions, and γ times the sums of rows."""
        H, G, E = (abs(M) for M in (self.H, self.G, self.E))
        columns = sum(np.bincount(M.indices, minlength=self.g.size) for M in (G, E)) + np.diff(H.indptr)
        rows = [np.diff(M.indptr).max(initial=0) for M in (G, E)]
        loss = float(gamma(3 + max(int(columns.max()), *map(int, rows))))
        Gt, Et = sp.csr_array(G.T), sp.csr_array(E.T)
        sums = (M @ np.ones(M.shape[1]) for M in (H, G, E, Gt, Et))
        return H, G, E, Gt, Et, sp.csr_array(self.G.T), sp.csr_array(self.E.T), loss, [loss * one for one in sums]

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")
    def violation(self, values: Values, *, normwise: bool = False) -> float:
        """How far `values` are from the conditions; inf where one is not a number.

        The largest of what is wrong in a row of Ex = b, Gx ≤ h, the bounds or Hx + g + Gᵀλ + Eᵀν + box = 0, as a share
        of the sum of its |terms|; of the lesser share that a multiplier and its slack have; and of the gap, as a share
        of its own terms. No unit of a row or an unknown has an influence on a share. By the gap large entries of H do
        not hide what is wrong with g: where y = x + Δ is in C, (Hx + g)ᵀ(y − x) is at least −|stationarity|ᵀ|Δ| −
        λᵀ|h − Gx| − |ν|ᵀ|b − Ex| − |box|ᵀ|room|, and |Δ_i| is taken to be no more than (|H||x|)_i/h_ii, which moves row
        i by as much as is in it. What rounding explains, the largest |x_j| standing for all of them, is left out
        of the gradient, and where it is `normwise` of the rows as well.
        """
        x, nu, multiplier, box = values
        H, G, E, Gt, Et, columns, columns_of_E, loss, (of_H, of_G, of_E, of_Gt, of_Et) = self._sizes
        size = np.abs(x)
        price = np.abs(nu)
        force = np.abs(box)
        largest = size.max()
        most = max(price.max(initial=0.0), multiplier.max(initial=0.0))
        moved = self.H @ x
        in_row = H @ size
        in_gradient = in_row + np.abs(self.g) + Gt @ multiplier + Et @ price + force
        in_slack = np.abs(self.h) + G @ size
        in_left = np.abs(self.b) + E @ size
        stationarity = np.abs(moved + self.g + columns @ multiplier + columns_of_E @ nu + box)
        slack = self.h - self.G @ x
        left = np.abs(self.E @ x - self.b)
        bound = np.where(box > 0, self.high, np.where(box < 0, self.low, x))
        room = np.abs(bound - x)
        outside = np.maximum(np.maximum(self.low - x, x - self.high), 0.0)
        diagonal = H.diagonal()
        reach = np.where(diagonal > 0, in_row / np.where(diagonal > 0, diagonal, 1.0), size)
        gap = stationarity @ reach + multiplier @ np.abs(slack) + price @ left + force @ room
        # where rounding alone is as large as what g says, it explains nothing
        cap = _SAID * (np.abs(self.g).max() or np.inf)
        gap -= np.minimum(loss * in_gradient, cap) @ reach
        gap -= loss * (multiplier @ in_slack + price @ in_left + force @ (size + np.abs(bound)))
        # of multipliers that are large and cancel each other what is left
        terms = max(x @ moved, 0.0) + size @ np.abs(self.g) + abs(self.b @ nu + self.h @ multiplier + box @ bound)
        noise = np.minimum(largest * of_H + most * (of_Gt + of_Et), cap)
        if normwise:
            sides = np.abs(np.concatenate([self.b, self.h, self.low, self.high]))
            most_of_rows = _SAID * (sides[np.isfinite(sides)].max(initial=0.0) or np.inf)
            of_E, of_G = (np.minimum(largest * one, most_of_rows) for one in (of_E, of_G))
        else:
            of_E, of_G = loss * in_left, loss * in_slack
        terms += noise @ size
        row = row_of(G)
        binding = np.zeros(self.h.size)
        np.maximum.at(binding, row, _shares(G.data * multiplier[row] - noise[G.indices], in_gradient[G.indices]))
        shares = (
            _shares(stationarity - noise, in_gradient),
            _shares(left - of_E, in_left),
            _shares(-slack - of_G, in_slack),
            np.minimum(_shares(np.abs(slack) - of_G, in_slack), binding),
            _shares(outside, size + outside),
            np.minimum(_shares(room - loss * largest, size + np.abs(bound)), _shares(force - noise, in_gradient)),
            _shares(np.array([gap]), np.array([terms])),
        )
        worst = float(np.concatenate(shares).max(initial=0.0))
        return worst if worst < np.inf else np.inf


def _same(one: sp.csr_array, other: sp.csr_array) -> bool:
    parts = ("data", "indices", "indptr")
    return one.shape == other.shape and all(np.array_equal(getattr(one, name), getattr(other, name)) for name in parts)


def _shares(wrong: Vector, size: Vector) -> Vector:
    """wrong/size, 0 where nothing is wrong."""
    return np.where(wrong <= 0, 0.0, wrong / size)


class Tightened:
    """A program whose rows of G with one entry are bounds, and without rows with h = ∞; and the multipliers back.

    Bounds that cross by no more than quotients and data are rounded are made to touch.
    """

    def __init__(self, program: Program) -> None:
        self.of = program
        G, h, n = program.G, program.h, program.g.size
        count = np.diff(G.indptr)
        finite = h < np.inf
        self.single = np.flatnonzero((count == 1) & finite)
        self.general = np.flatnonzero((count != 1) & finite)
        first = G.indptr[self.single]
        self.column = G.indices[first]
        self.entry = G.data[first]
        with np.errstate(over="ignore"):
            value = h[self.single] / self.entry
        up = self.entry > 0
        high, low = program.high.copy(), program.low.copy()
        np.minimum.at(high, self.column[up], value[up])
        np.maximum.at(low, self.column[~up], value[~up])
        #: of the single rows those that give the tightest bound of their variable, one for each side
        self.binding = np.zeros(self.single.size, dtype=bool)
        for side, tight, own in ((up, high, program.high), (~up, low, program.low)):
            at = np.flatnonzero(side & (value == tight[self.column]) & (value != own[self.column]))
            _, one = np.unique(self.column[at], return_index=True)
            self.binding[at[one]] = True
        with np.errstate(invalid="ignore"):
            touch = (low > high) & (low - high <= _TOUCH * (np.abs(low) + np.abs(high)))
        low = np.where(touch, high, low)
        self.program = replace(program, G=G[self.general], h=h[self.general], low=low, high=high)
        self.crossed = bool((low > high).any())
        self.n = n

    def back(self, values: Values) -> Values:
        """The multipliers of the program that was given."""
        inequality = np.zeros(self.of.h.size)
        inequality[self.general] = values.inequality
        box = values.box.copy()
        force = box[self.column] / self.entry  # positive where the row binds on its side
        taken = self.binding & (force > 0)
        inequality[self.single[taken]] = force[taken]
        box[self.column[taken]] = 0.0
        return values._replace(inequality=inequality, box=box)


def conditions_of(program: Program) -> ICP:
    """The conditions of `program`, as they are, in (x, ν, λ). Raises InputError where bounds cross or h is infinite."""
    return ICP(_matrix(program), np.concatenate([program.g, program.b, program.h])).with_sides(*_sides(program))


def _matrix(program: Program) -> sp.csr_array:
    """[[H, Eᵀ, Gᵀ], [−E, 0, 0], [−G, 0, 0]]."""
    H, E, G = program.H, program.E, program.G
    use = [True, E.shape[0] > 0, G.shape[0] > 0]
    blocks = [[H, E.T, G.T], [-E, None, None], [-G, None, None]]
    rows = [[block for block, used in zip(row, use, strict=True) if used] for row in blocks]
    return sp.csr_array(sp.block_array([row for row, used in zip(rows, use, strict=True) if used], format="csr"))


def _sides(program: Program) -> tuple[Vector, Vector | None]:
    """The obstacles of the conditions below and above, None where there is none above."""
    none = np.full(program.b.size, np.inf)
    low = np.concatenate([program.low, -none, np.zeros(program.h.size)])
    if np.isposinf(program.high).all():
        return low, None
    return low, np.concatenate([program.high, none, np.full(program.h.size, np.inf)])


def _units(A: sp.csr_array) -> Vector:
    """Whole exponents e: the entries 2^(e_i + e_j)a_ij are about 1.

    By `balanced`; where that leaves them far apart, by least squares of log₂|a_ij| + e_i + e_j if these do not.
    """
    from scipy.sparse.linalg import lsmr

    sizes = np.frexp(A.data)[1].astype(np.float64)
    row = row_of(A)

    def spread(e: Vector) -> float:
        return float(np.ptp(sizes + e[row] + e[A.indices]))

    e = np.rint(-0.5 * np.log2(balanced(A)))
    if A.nnz and spread(e) > _FAR:
        ones, each = np.ones(2 * row.size), np.arange(row.size)
        pairs = sp.csr_array((ones, (np.tile(each, 2), np.append(row, A.indices))), shape=(row.size, e.size))
        by_logarithms = np.rint(lsmr(pairs, -sizes)[0])
        e = by_logarithms if spread(by_logarithms) <= _FAR else e
    return e.astype(np.int64)


class Conditions:
    """The conditions of a program as an ICP in (x, ν, λ), in `units`, powers of two, in which A is balanced.

    Parameters
    ----------
    given
        The program, tightened.
    like
        The conditions of a program that has the same matrices, of which all that is known of A is taken over.

    Attributes
    ----------
    program
        The program in these units.
    problem
        The ICP.
    """

    def __init__(self, given: Program, like: Conditions | None = None) -> None:
        self.given = given
        self.program: Program
        self.problem: ICP
        n, k, m = given.g.size, given.b.size, given.h.size
        self.sizes = np.cumsum([n, k])
        if like is None or not given.has_matrices_of(like.given):
            A = _matrix(given)
            self.units = _units(A)
            if not given.H.nnz:
                self.units += self._shift()
            base = ICP(in_units(A, self.units, self.units), np.zeros(n + k + m))
            x, nu, multiplier = np.split(self.units, self.sizes)
            matrices = in_units(given.H, x, x), in_units(given.G, multiplier, x), in_units(given.E, nu, x)
        else:
            self.units = like.units
            base = like.problem
            matrices = like.program.H, like.program.G, like.program.E
        q = np.ldexp(np.concatenate([given.g, given.b, given.h]), self.units)
        g, b, h = np.split(q, self.sizes)
        low, high = (np.ldexp(side, -self.units[:n]) for side in (given.low, given.high))
        H, G, E = matrices
        self.program = Program(H, g, G, h, E, b, low, high)
        if like is not None and H is like.program.H:
            self.program.__dict__["_sizes"] = like.program._sizes
        self.problem = base.with_q(q).with_sides(*_sides(self.program))

    def _shift(self) -> Vector:
        """What makes g as large as the right-hand sides: without H the units of x and of the multipliers are free."""
        given = self.given
        n = given.g.size
        ends = [np.where(np.isfinite(side), side, 0.0) for side in (given.low, given.high)]
        of_g = np.ldexp(np.abs(given.g), self.units[:n]).max()
        of_rows = np.ldexp(np.abs(np.append(given.b, given.h)), self.units[n:]).max(initial=0.0)
        of_rows = max(of_rows, np.ldexp(np.maximum(*np.abs(ends)), -self.units[:n]).max())
        if not (0.0 < of_g < np.inf and 0.0 < of_rows < np.inf):
            return np.zeros(self.units.size, np.int64)
        by = int(np.clip(np.rint(0.5 * np.log2(of_rows / of_g)), -_LARGEST, _LARGEST))
        return np.where(np.arange(self.units.size) < n, by, -by)

    def near(self, x: Vector) -> Vector:
        """z of an `x` as it was given, with multipliers of the rows that are tight there by least squares."""
        from scipy.sparse.linalg import lsmr

        program = self.program
        x = np.ldexp(x, -self.units[: x.size])
        slack = program.h - program.G @ x
        tight = np.abs(slack) <= _TIGHT * (np.abs(program.h) + abs(program.G) @ np.abs(x))
        free = (program.low < x) & (x < program.high)
        rows = sp.csr_array(sp.vstack([program.E, program.G[tight]]))
        found = lsmr(rows.T[free], -(program.H @ x + program.g)[free], atol=_TIGHT, btol=_TIGHT)[0]
        nu, of_tight = np.split(found, [program.b.size])
        multiplier = np.zeros(slack.size)
        multiplier[tight] = np.maximum(of_tight, 0.0)
        return np.concatenate([x, nu, multiplier])

    def values(self, z: Vector) -> Values:
        """The values that belong to `z`, in its units: multipliers of bounds where p is no rounding, and λ ≥ 0."""
        x, nu, multiplier = np.split(z, self.sizes)
        low, high = self.program.low, self.program.high
        p = self.problem.p(z)[: x.size]
        # where p is less than the way to the bound it is rounding and no multiplier
        p = np.where(p > 0, np.where(p > x - low, p, 0.0), np.where(-p > high - x, p, 0.0))
        return Values(np.minimum(np.maximum(x, low), high), nu, np.maximum(multiplier, 0.0), -p)

    def back(self, values: Values) -> Values:
        """The same in the units of the program that was given."""
        x, nu, multiplier = np.split(self.units, self.sizes)
        pairs = (values.x, x), (values.equality, nu), (values.inequality, multiplier), (values.box, -x)
        return Values(*(np.ldexp(one, units) for one, units in pairs))
