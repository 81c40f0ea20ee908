"""Where a method converges, how fast, how it fails elsewhere, and what the theorems say of it, over two parameters."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import IcpError, InputError, Interrupted, MapError, OutOfTime, did_you_mean
from ..methods.contract import Method
from ..methods.modulus import ModulusMember
from ..numerics.arrays import Mask, Vector, as_number, described
from ..numerics.rounding import public_entry
from ..numerics.work import check_budget, memory_suffices
from ..present.display import Plottable
from ..present.rendering import render
from ..present.table import Table, Tabular
from ..problem.data import ProblemData, ProblemLike, as_problem
from ..solve.driver import solve
from ..solve.goal import Limits
from ..solve.progress import status_line, time_left
from ..solve.solution import Status
from ..theory import theorems
from ..theory.convergence.theorems import holding
from .cases import uninterrupted
from .planes import PLANES, Plane
from .planes import plane as plane_named

#: the ends that contradict a proof of convergence
_CONTRADICTING_ENDS = ("stagnated", "cycled", "diverged", "overflowed")
#: the ends that do not: "slow" may be a rate near 1, "precision limit" is due to rounding, and where the obstacles
#: cross, the limit need not be a solution
_UNDECIDING_ENDS = ("slow", "memory limit", "precision limit", "map failed", "obstacles cross", "infeasible")
#: the ends of a run, from the best to the worst; the status "diverged" is split by whether the residual stayed finite
RUN_ENDS = ("solved", *_UNDECIDING_ENDS, *_CONTRADICTING_ENDS, "refused", "not run")
#: the theorems that prove convergence from every start; "monotone" needs a special one
GLOBAL_THEOREMS = tuple(name for name in theorems() if name != "monotone")
#: the theorems whose conditions the paper prints differently
MISPRINTED_THEOREMS = ("4.2", "4.3", "4.4")
#: the type of an end, most of the memory for a point
_END = np.dtype(f"<U{max(map(len, RUN_ENDS))}")


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class StabilityMap(Plottable, Tabular):
    """The result of `stability`: how the runs ended at every point of a plane of two parameters.

    Attributes
    ----------
    plane : Plane
        The plane, with its axes x and y.
    ends : array of str, shape (len(y), len(x))
        One of `RUN_ENDS` per point, the worst of its runs; "not run" after the time limit.
    steps : array of int
        The most steps of a run at a solved point, 0 elsewhere.
    proved : dict of str to array of bool
        Theorem → the points where it proves convergence.
    printed : dict of str to array of bool
        The same for the statements as printed in the paper, where they differ.
    max_iter, rtol : int, float
        The limits of the runs.
    command : str
        The command that repeats the map.

    Examples
    --------
    >>> found = icp.stability("units", points=5, n=9)
    >>> found.ends.shape, found.contradictions, found.printed_contradictions > 0
    ((5, 5), 0, True)
    >>> found.summary().heads
    ('end', 'points', 'proved', 'proved as printed')
    """

    plane: Plane
    ends: NDArray[np.str_]
    steps: NDArray[np.int64]
    proved: dict[str, Mask]
    printed: dict[str, Mask]
    max_iter: int
    rtol: float
    command: str = ""

    @property
    def failed(self) -> Mask:
        """The points where a run cycled, stagnated, diverged or overflowed."""
        return np.isin(self.ends, _CONTRADICTING_ENDS)

    @property
    def any_proved(self) -> Mask:
        """The points where some theorem proves convergence from every start, in exact arithmetic."""
        return np.any([*self.proved.values()], axis=0)

    @property
    def any_printed(self) -> Mask:
        """The points where a theorem as printed proves convergence."""
        return np.any([*self.printed.values()], axis=0)

    @property
    def contradictions(self) -> int:
        """The number of points where a theorem proves convergence and a run failed: must be 0."""
        return int((self.any_proved & self.failed).sum())

    @property
    def printed_contradictions(self) -> int:
        """The number of such points for the theorems as printed."""
        return int((self.any_printed & self.failed).sum())

    def table(self) -> Table:
        """One row per point: the two parameters, the end, the steps, and the theorems that prove convergence.

        Returns
        -------
        Table
            The table.
        """
        rows = []
        for j, i in np.ndindex(*self.ends.shape):
            by = (" ".join(name for name, at in masks.items() if at[j, i]) for masks in (self.proved, self.printed))
            where = float(self.plane.x.values[i]), float(self.plane.y.values[j])
            rows.append((*where, str(self.ends[j, i]), int(self.steps[j, i]) or None, *by))
        heads = (self.plane.x.name, self.plane.y.name, "end", "steps", "proved by", "proved as printed")
        return Table(self.plane.title, heads, tuple(rows))

    def summary(self) -> Table:
        """One row per end: the number of points, and how many of them are proved to converge.

        Returns
        -------
        Table
            The table.
        """
        rows = []
        for end in RUN_ENDS:
            selected = self.ends == end
            if selected.any():
                groups = selected, selected & self.any_proved, selected & self.any_printed
                rows.append((end, *(int(group.sum()) for group in groups)))
        return Table(self.plane.title, ("end", "points", "proved", "proved as printed"), tuple(rows))

    def _contradiction_note(self) -> str:
        return f"proved, and yet failed: {self.contradictions}; as printed: {self.printed_contradictions}"

    def __str__(self) -> str:
        return f"{self.summary()}\n{self._contradiction_note()}"

    def _repr_html_(self) -> str:
        return self.summary().to_html() + render("folded.html", text=self._contradiction_note())


@public_entry
def stability(
    plane: str | Plane = "relaxation",
    problem: ProblemLike | None = None,
    *,
    method: str | None = None,
    points: int = 25,
    n: int = 49,
    starts: int = 3,
    max_iter: int = 2000,
    rtol: float = 1e-8,
    time_limit: float | None = None,
    progress: bool = False,
    command: str = "",
) -> StabilityMap:
    """Solve at every point of a plane of two parameters, and check every convergence theorem there.

    Parameters
    ----------
    plane : {"relaxation", "shift", "coupling", "transport", "units"} or Plane
        The plane: "relaxation" and "shift" vary parameters of a method, the others of the problem.
    problem : ICP, or what else can be solved, optional
        The problem on the planes "relaxation" and "shift"; by default manufactured-affine.
    method : str, optional
        The method on the other planes, by default "mnmgs".
    points : int, default 25
        Points per axis.
    n : int, default 49
        Wanted number of unknowns of a built-in problem.
    starts : int, default 3
        Starts per point: 0, then random vectors, until a run fails. The worst run counts.
    max_iter : int, default 2000
        Maximal number of steps of a run.
    rtol : float, default 1e-8
        Relative tolerance of a run.
    time_limit : float, optional
        Seconds for all points; those not reached by then are "not run".
    progress : bool, default False
        Whether to show a status line.
    command : str, optional
        The command that repeats the map, stored in the result.

    Returns
    -------
    StabilityMap
        How the runs ended.

    Raises
    ------
    InputError
        For wrong arguments.
    NotApplicable
        Where p is nonlinear.
    Interrupted
        At Ctrl-C; its `report` is the map so far.

    Examples
    --------
    >>> icp.stability("relaxation", points=2, n=9).plane.x.name
    'theta1'
    """
    if isinstance(plane, str):
        if plane not in PLANES:
            raise InputError(
                f"plane is {plane!r}; one of {', '.join(PLANES)} was expected{did_you_mean(plane, PLANES)}"
            )
        points = int(as_number(points, "points", minimum=2, whole=True))
        n = int(as_number(n, "n", minimum=1, whole=True))
        _check_memory(points, points)
        plane = plane_named(plane, points, n, None if problem is None else as_problem(problem), method)
    elif not isinstance(plane, Plane):
        raise InputError(f"plane is {described(plane)}; one of {', '.join(PLANES)} or a Plane was expected")
    elif problem is not None or method is not None:
        raise InputError("a Plane has its own problems and methods: leave problem and method out")
    shape = (len(plane.y.values), len(plane.x.values))
    _check_memory(*shape)
    limits = Limits(rtol=rtol, atol=0.0, max_iter=max_iter, time_limit=time_limit)
    starts = int(as_number(starts, "starts", minimum=1, whole=True))
    result = StabilityMap(
        plane=plane,
        ends=np.full(shape, "not run", dtype=_END),
        steps=np.zeros(shape, dtype=np.int64),
        proved={name: np.zeros(shape, dtype=bool) for name in GLOBAL_THEOREMS},
        printed={name: np.zeros(shape, dtype=bool) for name in MISPRINTED_THEOREMS},
        max_iter=limits.max_iter,
        rtol=limits.rtol,
        command=command,
    )
    try:
        with suppress(OutOfTime), limits.enforced():
            _fill(result, starts, progress)
    except KeyboardInterrupt:
        raise Interrupted(result) from None
    return result


def _check_memory(rows: int, columns: int) -> None:
    """Raise InputError where a map of `rows` × `columns` points exceeds the free memory."""
    size = float(_END.itemsize * rows * columns)
    if not memory_suffices(size):
        raise InputError(
            f"the map has {rows:g} x {columns:g} points, which take {1e-9 * size:.3g} GB of memory, more than is free"
        )


def _fill(result: StabilityMap, starts: int, progress: bool) -> None:
    """Fill the arrays of `result`, point by point. Raises OutOfTime."""
    plane = result.plane
    total = result.ends.size
    start_time = time.monotonic()
    opening = f"{total} points, up to {starts} runs of at most {result.max_iter} steps at each"
    with status_line(progress, opening) as say:
        for k, (j, i) in enumerate(np.ndindex(*result.ends.shape)):
            say(f"point {k + 1} of {total}{time_left(start_time, k, total)}")
            one, member = plane.at(float(plane.x.values[i]), float(plane.y.values[j]))
            worst, steps = _worst_run(one, member, starts, result)
            if isinstance(member, ModulusMember) and member.why_not(one) is None:
                masks = result.proved, result.printed
                for mask_of, names in zip(masks, holding(one, member, *masks), strict=True):
                    for name in names:
                        mask_of[name][j, i] = True
            result.steps[j, i] = steps if worst == "solved" else 0
            result.ends[j, i] = worst


def _worst_run(problem: ProblemData, method: Method, starts: int, result: StabilityMap) -> tuple[str, int]:
    """The worst end of the runs from `starts` starts, and their largest number of steps. Raises OutOfTime."""
    runs = list[tuple[str, int]]()
    for k in range(starts):
        runs.append(_run(problem, method, k, result.max_iter, result.rtol))
        if runs[-1][0] in _CONTRADICTING_ENDS:
            break
    return max((end for end, _ in runs), key=RUN_ENDS.index), max(steps for _, steps in runs)


def _run(problem: ProblemData, method: Method, k: int, max_iter: int, rtol: float) -> tuple[str, int]:
    """The end of the run from the k-th start, and its number of steps. Raises OutOfTime."""
    check_budget()
    z0: Vector = 10.0 * np.random.default_rng(k).standard_normal(problem.n) if k else np.zeros(problem.n)
    options: dict[str, Any] = {"z0": z0, "max_iter": max_iter, "rtol": rtol, "history": True}
    try:
        solution = uninterrupted(solve(problem, method, **options, raise_on_failure=False))
    except MapError:
        return Status.MAP_FAILED.value, 0  # at the start
    except IcpError:
        return "refused", 0
    if solution.status is Status.TIME_LIMIT:
        raise OutOfTime(solution.message)
    end = "slow" if solution.status is Status.ITERATION_LIMIT else solution.status.value
    if end == "diverged" and not np.isfinite(solution.history.residual[-1]):
        end = "overflowed"
    return end, solution.iterations
