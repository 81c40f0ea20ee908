"""Problems on which methods fail; each docstring says, after "Honest", what an honest answer is."""

from __future__ import annotations

import numpy as np

from ..icp import ICP
from ..numerics.arrays import Vector, as_number
from ..problem.affine import Affine
from ..problem.elementwise import Elementwise
from ..problem.function import Function
from .grid import five_point, rows_of, side, square_points, tridiagonal
from .hand import PAIR, by_hand
from .manufactured import BOX_ROWS, manufactured, random_box, random_complementary, random_numbers
from .registry import Quantity, Scene, register, size


@register
def hard_infeasible() -> Scene:
    """Hard: an LCP that contradicts itself.

    A = [0, 1; −1, 0], q = (−2, −1), ψ = 0: p₂ = −z₁ − 1 ≥ 0 and z₁ ≥ 0 exclude each other. A is
    semidefinite: this is the LCP of the linear programme min −2x, x ≤ −1, x ≥ 0. Honest: INFEASIBLE
    where that is proved, else anything but solved.

    References
    ----------
    Cottle, Pang and Stone, The Linear Complementarity Problem (1992).
    """
    why = "p[1] = -z[0] - 1 >= 0 and z[0] >= 0 exclude each other"
    models = "A linear programme without a feasible point, and its dual."
    return Scene(problem=ICP([[0.0, 1.0], [-1.0, 0.0]], [-2.0, -1.0]), models=models, why_no_solution=why)


@register
def hard_many() -> Scene:
    """Hard: an LCP with a half-line of solutions.

    A = [1, −1; −1, 1], q = (1, −1), ψ = 0: p₁ = −p₂, so both are 0 and z = (t, t + 1) for every t ≥ 0. A is singular
    and semidefinite. Honest: solved, and no claim that the solution is unique. Quantity: "z2 - z1" = 1.
    """
    models = "Two carriages coupled by a spring on a track, free to roll together."
    known = {"z2 - z1": Quantity(1.0, _gap, order=None)}
    return Scene(problem=ICP([[1.0, -1.0], [-1.0, 1.0]], [1.0, -1.0]), models=models, quantities=known)


@register
def hard_steep() -> Scene:
    """Hard: an obstacle that rises faster than z.

    A = 1, q = 1, ψ(z) = 1.5z − 1: r = 1 − z/2 ≥ 0 says z ≤ 2, so the obstacle is a ceiling. Both z
    = −1 (p = 0) and z = 2 (r = 0) are solutions. Honest: solved, and no claim that the solution is
    unique; sweeps may diverge. Quantity: "|z - 1/2|" = 1½.
    """
    models = "A spring under a hand that follows it too eagerly."
    known = {"|z - 1/2|": Quantity(1.5, _from_half, order=None)}
    return Scene(problem=ICP([[1.0]], [1.0], Affine([[1.5]], -1.0)), models=models, quantities=known)


@register
def hard_jump() -> Scene:
    """Hard: an obstacle that gives way.

    A = 1, q = −½, ψ(z) = 1 for z < ¾ and 0 from there on. Below ¾ r = z − 1 < −¼; from ¾ on r = z > 0 and
    p = z − ½ > 0: the residual is at least ¼, and there is no solution, though p and r take either sign. (If it gave
    way at 1, z = 1 − ε would have the residual ε and pass for a solution.) Honest: cycled or stagnated.
    """
    problem = ICP([[1.0]], [-0.5], Function(_trapdoor))
    why = "r < 0 below 3/4, and from there on p and r are both positive"
    return Scene(problem=problem, models="A weight on a trapdoor that opens under it.", why_no_solution=why)


@register
def hard_domain() -> Scene:
    """Hard: an obstacle that has no value where the equations lead.

    A = tridiag(−1, 2, −1), n = 31, q = −.1, ψ_i(z) = −√(2 − z_i), NaN for z_i > 2. p ≥ 0 and A⁻¹ ≥
    0 lift z above the parabola .05 i(32 − i), which passes 2 in row 2. So there is no solution
    where ψ has values. Sweeps from 0 reach z_i > 2 only after many steps. Honest: map failed, with
    the best iterate before it did.
    """
    psi = Elementwise(_below_root, _its_slope)
    problem = ICP(tridiagonal(31), np.full(31, -0.1), psi)
    models = "A string pulled up out of the region where the shape of its support is known."
    why = "p >= 0 lifts z out of the domain of psi, row 1 already"
    return Scene(problem=problem, models=models, why_no_solution=why)


@register
def hard_skew(n: int = 100, skew: float = 10.0, seed: int = 0) -> Scene:
    """Hard: a matrix that is almost skew-symmetric.

    A = I + s·tridiag(−1, 0, 1), ψ = z* − r*, q = p* − Az* for random complementary p*, r*. A is
    positive definite, hence a P-matrix, but far from H₊: sweeps diverge. Honest: one solution; sweeps
    end as diverged or cycled.

    Parameters
    ----------
    n : int, default 100
        Number of unknowns, at least 2.
    skew : float, default 10
        The factor s.
    seed : int, default 0
        Seed ≥ 0 of the random numbers.
    """
    n = size(n, 2)
    s = as_number(skew, "skew")
    z, p, r = random_complementary(n, seed)
    A = tridiagonal(n, -s, 1.0, s)
    return manufactured(A, z, p, z - r, "A ring of gyroscopes, each turning the next, with little friction and stops.")


@register
def hard_semidefinite(n: int = 40, seed: int = 0) -> Scene:
    """Hard: a linear programme and its dual as one LCP.

    A = [0, −Bᵀ; B, 0] with a random m × m matrix B: min cᵀx with Bx ≥ b, x ≥ 0, and its dual. Half
    of the x and half of the constraints are active, strictly. A is skew-symmetric with a zero
    diagonal: semidefinite, no splitting by the diagonal exists. Honest: solved by pivoting or
    Newton; sweeps refuse.

    Parameters
    ----------
    n : int, default 40
        Number of unknowns, about 2m, at most 5000.
    seed : int, default 0
        Seed ≥ 0 of the random numbers.

    References
    ----------
    Cottle, Pang and Stone, The Linear Complementarity Problem (1992).
    """
    m = max(round(size(n, maximum=5000) / 2), 1)
    random = random_numbers(seed)
    B = random.standard_normal((m, m))
    amount = random.uniform(0.5, 1.5, 2 * m)
    basic = np.concatenate([random.permutation(m) < (m + 1) // 2 for _ in range(2)])
    z = np.where(basic, amount, 0.0)
    p = np.where(basic, 0.0, amount)
    A = np.block([[np.zeros((m, m)), -B.T], [B, np.zeros((m, m))]])
    return manufactured(A, z, p, 0.0, "A production plan and the prices that support it.")


@register
def hard_degenerate(n: int = 100, seed: int = 0) -> Scene:
    """Hard: half of the rows touch without force.

    A is the 5-point matrix on m × m points, z* is random, ψ = z* − r*, q = p* − Az*. Half of the
    rows have p* = r* = 0; a quarter is in contact and a quarter is free. Rounding decides whether the
    former are taken as active. Honest: solved, and those rows are left undecided.

    Parameters
    ----------
    n : int, default 100
        Number of unknowns; the nearest m² is taken.
    seed : int, default 0
        Seed ≥ 0 of the random numbers.
    """
    m = side(n)
    z, p, r = random_complementary(m * m, seed, degenerate=0.5)
    models = "A membrane laid on a support of its own shape."
    return manufactured(five_point(m), z, p, z - r, models, points=square_points(m))


@register
def hard_singular(n: int = 100) -> Scene:
    """Hard: a ring of springs held by almost nothing.

    A = the periodic tridiag(−1, 2, −1) plus 2⁻⁴⁰I, n even; z* = (1, 2, 1, 2, …), ψ = 0, q = −Az* without rounding. An
    H₊-matrix with condition number 4·2⁴⁰: a residual of 1e-8 leaves z undetermined by 1e4. Honest: solved by the
    residual, and an error bound that says how little that means here. `n` ≥ 4, odd numbers are raised by 1.
    """
    n = size(n, 4) + n % 2
    A = rows_of(n, 0, n, {1 - n: -1.0, -1: -1.0, 0: 2.0 + 2.0**-40, 1: -1.0, n - 1: -1.0})
    z = np.tile([1.0, 2.0], n // 2)
    return manufactured(A, z, 0.0, 0.0, "A ring of masses and springs that hardly anything holds in place.")


@register
def hard_scaled(n: int = 100, decades: float = 75.0, seed: int = 0) -> Scene:
    """Hard: every unknown in a unit of its own.

    A = S tridiag(−1, 4, −1) S with S = diag(10^u), u uniform in ± `decades`. Entries of A reach
    from 1e-150 to 1e150. z* = S⁻¹z₀, p* = Sp₀ and r* = S⁻¹r₀ for random complementary z₀, p₀, r₀. A
    small residual says nothing about the rows with small entries. Honest: solved by the residual, or
    a precision limit; the bound of each entry shows how much is known.

    Parameters
    ----------
    n : int, default 100
        Number of unknowns, at least 2.
    decades : float, default 75
        Range of the exponents, 0 ≤ `decades` ≤ 75.
    seed : int, default 0
        Seed ≥ 0 of the random numbers.
    """
    n = size(n, 2)
    z, p, r = random_complementary(n, seed)
    most = as_number(decades, "decades", minimum=0, maximum=75)
    S = 10.0 ** np.random.default_rng(seed).uniform(-most, most, n)
    A = tridiagonal(n, -S * np.roll(S, 1), 4.0 * S * S, -S * np.roll(S, -1))
    return manufactured(A, z / S, S * p, z / S - r / S, "A row of springs, each measured in units of its own.")


@register
def hard_overflow() -> Scene:
    """Hard: forces near the largest number.

    A = [2, −1; −1, 2], q = (−1.5e308, 1.5e308), ψ = 0; z* = (7.5e307, 0), p* = (0, 7.5e307). Sums and squares of such
    numbers overflow though the answer does not. Honest: solved, or diverged; never NaN called solved.
    """
    q = [-1.5e308, 1.5e308]
    models = "Two weights on a string under forces at the end of the scale."
    return by_hand(PAIR, q, 0.0, [7.5e307, 0.0], models)


@register
def hard_empty_row() -> Scene:
    """Hard: a row of A without entries.

    A = [2, −1, 0; −1, 2, 0; 0, 0, 0], q = (−1, 3, 1), ψ = (0, 0, 2): p₃ = 1 whatever z is, so z₃ = 2; the others are
    hand-lcp. Honest: solved by methods that need no diagonal; the others refuse and name the row.
    """
    A = [[*PAIR[0], 0.0], [*PAIR[1], 0.0], [0.0, 0.0, 0.0]]
    models = "Two weights on a string, and a third on the floor beside it, tied to nothing."
    return by_hand(A, [-1.0, 3.0, 1.0], [0.0, 0.0, 2.0], [0.5, 0.0, 2.0], models)


@register
def hard_pinned(n: int = 100, seed: int = 0) -> Scene:
    """Hard: the two obstacles are the same in some rows.

    A is the 5-point matrix on m × m points. Two rows of five are pinned, ψ_i = ψ̄_i = z*_i, with p* = z*
    of either sign. Of the other three, one is at ψ, one at ψ̄ and one between. In a pinned row z_i
    is known whatever p_i is; at which of the two obstacles it is remains open. Honest: solved, each
    row at one of its obstacles.

    Parameters
    ----------
    n : int, default 100
        Number of unknowns; the nearest m² is taken.
    seed : int, default 0
        Seed ≥ 0 of the random numbers.
    """
    m = side(n)
    pinned = [(0.0, 0.0)] * 2
    z, p, r, s = random_box(m * m, seed, [*pinned, *(BOX_ROWS[kind] for kind in ("at psi", "at upper", "between"))])
    p = np.where(r + s == 0.0, z, p)
    models = "A membrane between two plates, glued where they meet."
    points = square_points(m)
    return manufactured(five_point(m), z, p, z - r, models, z + s, points=points)


@register
def hard_crossing() -> Scene:
    """Hard: obstacles that cross where a solution would be.

    A = I, q = (0, −1), ψ(z) = (z₂ − ½, 0), ψ̄ = (.4, 2): row 2 rises to z₂ = 1 off its obstacles, and lifts the floor of
    row 1 to ½, above its ceiling. For z₂ ≤ .9 they do not cross, but p₂ ≤ −.1, so that there is no solution, and no
    small residual either. Honest: infeasible; the obstacles cross, in row 0; or stagnated where the best iterate is
    elsewhere.
    """
    psi = Affine([[0.0, 1.0], [0.0, 0.0]], [-0.5, 0.0])
    why = "z[1] = 1 lifts psi[0] to 1/2, above upper[0] = 0.4"
    models = "A vice whose lower jaw is lifted by a float, past the upper one."
    return Scene(problem=ICP(np.eye(2), [0.0, -1.0], psi, [0.4, 2.0]), models=models, why_no_solution=why)


@register
def hard_three() -> Scene:
    """Hard: three solutions between two obstacles.

    A = −1, q = −¼, −1 ≤ z ≤ 1: z = −1 with p = ¾, z = 1 with p = −1¼, and z = −¼ with p = 0 all solve; the last one is
    unstable. Honest: solved, and no claim that the solution is unique. Quantity: "(z + 1)(z + 1/4)(z - 1)" = 0.
    """
    known = {"(z + 1)(z + 1/4)(z - 1)": Quantity(0.0, _three_roots, order=None)}
    problem = ICP([[-1.0]], [-0.25], -1.0, 1.0)
    return Scene(problem=problem, models="A ball on a hill between two walls.", quantities=known)


def _gap(z: Vector) -> float:
    return float(z[1] - z[0])


def _from_half(z: Vector) -> float:
    return float(abs(z[0] - 0.5))


def _three_roots(z: Vector) -> float:
    return float((z[0] + 1.0) * (z[0] + 0.25) * (z[0] - 1.0))


def _trapdoor(z: Vector) -> Vector:
    return np.where(z < 0.75, 1.0, 0.0)


def _below_root(z: Vector) -> Vector:
    return np.asarray(-np.sqrt(np.where(z <= 2.0, 2.0 - z, np.nan)))


def _its_slope(z: Vector) -> Vector:
    return np.asarray(0.5 / np.sqrt(np.where(z < 2.0, 2.0 - z, np.nan)))
