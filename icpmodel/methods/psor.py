"""Projected SOR as a modulus method: the modulus equation solved row by row with the newest values.

The other members have the newest values in M₁z⁺ and the previous iterate inside the modulus. Here the newest values are
in both.
Hold all other unknowns at their newest values, p_i = Σ_{j<i} a_ij z_j⁺ + Σ_{j≥i} a_ij z_j + q_i. Then solve row i of
the modulus equation for t = z_i⁺, with m = a_ii/ω in place of a_ii:

    (m + Ω_i) t = |(m − Ω_i) t + c + Ω_i ψ_i| − c + Ω_i ψ_i,        c = p_i − m z_i.

With |x − y| = x + y − 2 min(x, y), x = mt + c and y = Ω_i(t − ψ_i) this is min(mt + c, Ω_i(t − ψ_i)) = 0. Both terms
grow with t. So for every Ω_i > 0 the larger of their zeros −c/m = z_i − (ω/a_ii)p_i and ψ_i is the only solution.

So Ω drops out; with Ω = D/ω, t is not inside the modulus at all. MNMSOR with θ₁ = ω has the same M₁ = D/ω − L and the
previous iterate inside the modulus. So it moves rows that stay on the obstacle with their neighbours' steps. For
M₁ = D/ω no newest value is used, and with Ω = D/ω both are the same method. For the rate of projected SOR see
`theory.convergence.rowwise`.
"""

from __future__ import annotations

from typing import ClassVar

from ..algebra.secants import secant_step
from ..algebra.splittings import AOR, Splitting
from ..algebra.steps import Step, projected_sweep
from ..numerics.arrays import Vector, as_number
from ..problem.data import ProblemData
from .contract import why_not_diagonal, with_options
from .modulus import ModulusMember


@with_options
class PSOR(ModulusMember):
    """Projected successive overrelaxation, the row-wise modulus method.

        z_i⁺ = max(ψ_i(z), z_i − (ω/a_ii)(Σ_{j<i} a_ij z_j⁺ + Σ_{j≥i} a_ij z_j + q_i))

    Parameters
    ----------
    omega : float, default 1
        The relaxation factor, 0 < ω < 2.

    Notes
    -----
    M₁ = D/ω − L with any Ω, and the newest values inside the modulus; see the module's docstring. ψ
    is evaluated at the z before the sweep.

    References
    ----------
    Cryer, SIAM J. Control 9 (1971).

    Examples
    --------
    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(icp.PSOR(omega=1.1)).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "psor"
    family: ClassVar[str] = "modulus"
    to_try: ClassVar[str] = "a smaller omega"
    sees_newest: ClassVar[bool] = True
    omega: float = 1.0

    def __post_init__(self) -> None:
        as_number(self.omega, "omega", above=0, below=2)

    def why_not(self, problem: ProblemData) -> str | None:
        return why_not_diagonal(problem, "projected SOR divides by the diagonal of A")

    def splitting_of(self) -> Splitting:
        return AOR(self.omega, self.omega)

    def omega_of(self, problem: ProblemData) -> Vector:
        """The diagonal of Ω: D/ω. No other Ω > 0 would change a step.

        Parameters
        ----------
        problem : ProblemData
            The problem.

        Returns
        -------
        array of shape (n,)
            The diagonal.
        """
        return problem.matrix.rows.diagonal / self.omega

    def step_of(self, problem: ProblemData) -> Step:
        if problem.f is not None:
            return secant_step(problem, self.step_of)
        return projected_sweep(problem, self.omega)
