"""The answer of a solve on ranks."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ..numerics.rounding import public_entry
from ..present.card import Card
from ..present.display import Displayable, counted
from ..solve.solution import Status
from .distributed_bound import DistributedCertificate, certify
from .distributed_icp import DistributedICP
from .distributed_levels import DistributedLevels


@dataclass(frozen=True, eq=False, repr=False)
class DistributedSolution(Displayable):
    """An answer on ranks: the returned z, the reason why the run stopped and, on request, what is certain of z.

    Attributes
    ----------
    problem : DistributedICP
        The problem.
    z : Vec
        The best iterate.
    status : Status
        Why the run stopped.
    message : str
        The same in words, with advice.
    residual : float
        Res_D(z).
    tolerance : float
        The tolerance for the residual.
    iterations : int
        Newton steps and rounds of sweeps on the finest level.
    krylov_steps : int
        Krylov steps on all levels.
    sizes : tuple of int
        The number of unknowns of each level.
    seconds : float
        Time, set-up included.

    Examples
    --------
    >>> solution = icp.distributed.solve(
    ...     icp.distributed.distribute(icp.scenes.membrane(n=100).problem)
    ... )
    >>> solution.status, solution.solved
    (<Status.SOLVED: 'solved'>, True)
    """

    problem: DistributedICP
    z: Any
    status: Status
    message: str
    residual: float
    tolerance: float
    iterations: int
    krylov_steps: int
    sizes: tuple[int, ...]
    seconds: float
    levels: DistributedLevels | None = field(repr=False)

    @property
    def solved(self) -> bool:
        """Whether the status is SOLVED."""
        return self.status is Status.SOLVED

    def __bool__(self) -> bool:
        return self.solved

    @public_entry
    def certify(self) -> DistributedCertificate:
        """State what is certain of z: the error bound, uniqueness, and which rows are decided.

        Collective: all ranks must call it. It costs about one linear solve, once.

        Returns
        -------
        DistributedCertificate
            The certificate.
        """
        return self._certificate

    @cached_property
    def _certificate(self) -> DistributedCertificate:
        return certify(self.problem, self.z, self.levels)

    @property
    def _known(self) -> DistributedCertificate | None:
        """The certificate, once all ranks have called `certify`."""
        return vars(self).get("_certificate")

    def summary(self) -> dict[str, str]:
        """The lines that `print` shows, as names and texts.

        Returns
        -------
        dict
            It has the error bound once all ranks have called `certify`.
        """
        steps = counted(self.iterations, "iteration")
        rows = {
            "problem": f"{self.problem.n} unknowns on {counted(self.problem.comm.size, 'rank')}",
            "status": f"{self.status.value} after {steps} and {self.krylov_steps} Krylov steps",
            "method": f"multilevel modulus Newton on {len(self.sizes)} levels",
            "residual": f"{self.residual:.3g} (stop at {self.tolerance:.3g})",
        }
        known = self._known
        if known is not None:
            rows |= {"error": known.bound.in_words(), "rows": known.rows}
        if not self.solved:
            rows["message"] = self.message
        return rows | {"seconds": f"{self.seconds:.3g}"}

    def about(self) -> dict[str, Any]:
        """What is known of this answer as plain data for JSON.

        Returns
        -------
        dict
            It has no arrays.
        """
        data = {
            "n": self.problem.n,
            "ranks": self.problem.comm.size,
            "status": self.status.value,
            "message": self.message,
            "residual": self.residual,
            "tolerance": self.tolerance,
            "iterations": self.iterations,
            "krylov_steps": self.krylov_steps,
            "levels": list(self.sizes),
            "seconds": self.seconds,
        }
        known = self._known
        if known is not None:
            bound = known.bound
            data |= {"error_bound": bound.value, "unique": bound.unique or None, "proof": bound.proof or None}
            data |= {"no_error_bound_because": bound.reason or None}
            data |= {f"rows_{name}": getattr(known, name) for name in ("active", "inactive", "above", "undecided")}
        return {name: None if isinstance(x, float) and not np.isfinite(x) else x for name, x in data.items()}

    def __repr__(self) -> str:
        return f"DistributedSolution({self.problem!r}, {self.status.value}, residual={self.residual:.3g})"

    def __str__(self) -> str:
        return str(Card(self.summary()))
