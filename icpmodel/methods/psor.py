"""Projected successive overrelaxation: Gauss–Seidel rows, each projected on its obstacle at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..algebra.relaxation import sor_speed
from ..algebra.steps import Step, compiled_step
from ..numerics.arrays import as_number
from ..problem.data import ProblemData
from ..problem.facts import Facts
from .contract import Estimate, FixedPoint, positive_diagonal


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PSOR(FixedPoint):
    """z_i⁺ = max(ψ_i(z), z_i − (ω/a_ii)(Σ_{j<i} a_ij z_j⁺ + Σ_{j≥i} a_ij z_j + q_i)), 0 < ω < 2.

    It is not of the form z − 2X⁻¹F(z): the projection sits inside the substitution.
    Reference: Cryer, SIAM J. Control 9 (1971).

    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(icp.PSOR(omega=1.1)).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "psor"
    family: ClassVar[str] = "modulus"
    to_try: ClassVar[str] = "a smaller omega"
    omega: float = 1.0

    def __post_init__(self) -> None:
        as_number(self.omega, "omega", above=0, below=2)

    def estimate(self, facts: Facts, aim: float) -> Estimate:
        # at ω = 1 a radius that costs nothing will do; it may be too small, which the run then sees
        matrix = facts.matrix
        radius = matrix.rough_jacobi_radius if self.omega == 1.0 else matrix.jacobi_radius
        return Estimate.of_sweeps(facts, aim, sor_speed(self.omega, max(radius, facts.coupling)))

    def why_not(self, problem: ProblemData) -> str | None:
        return positive_diagonal(problem, "projected SOR divides by the diagonal of A")

    def step_of(self, problem: ProblemData) -> Step:
        A, rows = problem.A, problem.matrix.rows
        matrix = (A.indptr, A.indices, A.data, rows.diag, problem.q)
        return compiled_step(problem, "in_order", matrix, ((self.omega,), True), rows.above)
