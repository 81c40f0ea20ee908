"""The problems of a comparison: scenes by their text, and the one judge of all, the residual of the problem."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..errors import IcpError, InputError
from ..icp import ICP
from ..numerics.arrays import as_list, as_number
from ..problem.data import ProblemData
from ..scenes import Scene, parameters, scene
from ..solve.solution import Solution, Status
from ..solvers.formulations import Target, in_handy_units

#: scenes with other parameters, which make them harder or of another kind
VARIANTS = (
    "membrane,mu=4",
    "membrane,skew=0.5",
    "bai-symmetric,mu=0",
    "bai-nonsymmetric,mu=0",
    "manufactured-affine,mu=0",
    "manufactured-elementwise,mu=0",
)


def built(text: str, n: int | None) -> Scene:
    """The scene that `text`, NAME or NAME,PARAMETER=NUMBER,…, stands for, of about `n` unknowns if it can."""
    return scene(text, n if "n" in parameters(text.partition(",")[0]) else None)


def as_scenes(texts: Any) -> tuple[str, ...]:
    """The `texts` that `built` understands, found out before anything is measured. Raises InputError."""
    listed = tuple(as_list(texts, "scenes"))
    for text in listed:
        built(text, None)
    return listed


def as_sizes(sizes: Any) -> tuple[int, ...]:
    """Wanted numbers of unknowns. Raises InputError."""
    return tuple(int(as_number(n, "sizes", least=1, whole=True)) for n in as_list(sizes, "sizes"))


def fresh(problem: ProblemData) -> ICP:
    """The problem, nothing of which is known yet."""
    return ICP(problem.A, problem.q, problem.psi)


def unbroken(solution: Solution) -> Solution:
    """The solution of a run that Ctrl-C did not end: such an end is that of the whole study, not of one run."""
    if solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return solution


@dataclass(frozen=True, eq=False)
class Case:
    """One problem of a comparison: its `scene`'s text, and the `problem`."""

    scene: str
    problem: ProblemData

    @cached_property
    def scale(self) -> float:
        """Res(0), by which residuals are divided. Raises InputError where z = 0 is a solution."""
        scale = self.problem.residual_at_0()
        if not 0 < scale < np.inf:
            raise InputError(f"{self.scene}: Res(0) = {scale:g}, there is nothing to measure")
        return scale

    @cached_property
    def posed(self) -> tuple[Target, float] | None:
        """The problem as foreign solvers get it, and the unit of its z; None where ψ is not constant or affine."""
        if self.problem.psi.linear is None:
            return None
        problem, unit = in_handy_units(self.problem)
        return Target(problem), unit

    def judged(self, z: Any) -> float | None:
        """Res(z)/Res(0), None where z is no finite vector of shape (n,)."""
        try:
            ratio = self.problem.residual(np.asarray(z, dtype=np.float64)) / self.scale
        except (IcpError, TypeError, ValueError):
            return None
        return ratio if np.isfinite(ratio) else None


def cases(
    wanted: Iterable[tuple[str, int]], made: Callable[[str, int], ProblemData]
) -> Iterator[tuple[str, int, Case | str]]:
    """(text, n, the case or why there is none) of each problem that is `made` of a text and a wanted size, once."""
    seen: set[tuple[str, int]] = set()  # small scenes and grids cannot have every size
    for text, size in wanted:
        case: Case | str
        try:
            case = Case(text, made(text, size))
            n, _ = case.problem.n, case.scale
        except (IcpError, MemoryError) as error:
            case, n = str(error) or "not enough memory", size
        if (text, n) not in seen:
            seen.add((text, n))
            yield text, n, case
