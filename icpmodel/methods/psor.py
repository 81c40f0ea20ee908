"""Projected successive overrelaxation, a baseline: Gauss–Seidel rows, each projected on its obstacle at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ..arrays import as_number, diagonal_positions
from ..operators import Step, compiled_step
from ..problem import ICP
from . import FixedPoint, positive_diagonal


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PSOR(FixedPoint):
    """z_i⁺ = max(ψ_i(z), z_i − (ω/a_ii)(Σ_{j<i} a_ij z_j⁺ + Σ_{j≥i} a_ij z_j + q_i)), 0 < ω < 2.

    It is not of the form z − 2X⁻¹F(z): the projection sits inside the substitution.
    Reference: Cryer, SIAM J. Control 9 (1971).

    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(PSOR(omega=1.1)).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "psor"
    to_try: ClassVar[str] = "a smaller omega"
    omega: float = 1.0

    def __post_init__(self) -> None:
        as_number(self.omega, "omega", above=0, below=2)

    def why_not(self, problem: ICP) -> str | None:
        """See `Method.why_not`."""
        return positive_diagonal(problem, "projected SOR divides by the diagonal of A")

    def step_of(self, problem: ICP) -> Step:
        """See `FixedPoint.step_of`."""
        A = problem.A
        matrix: tuple[Any, ...] = (A.indptr, A.indices, A.data, diagonal_positions(A), problem.q)
        return compiled_step(problem, "projected", matrix, (self.omega / A.diagonal(), True))
