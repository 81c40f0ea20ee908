"""IT, CPU and RES of the members of the family, in the form of the tables of the literature."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from ..errors import InputError, Interrupted
from ..icp import ICP
from ..methods.contract import Method, named
from ..methods.modulus import ModulusMember
from ..numerics.arrays import as_list, as_number
from ..present.table import Table
from ..scenes import Scene
from ..solve.progress import status_line
from ..solve.solution import Solution
from ..study.cases import as_scenes, built, fresh, unbroken
from ..study.timing import BRIEFLY, MORE, as_repeats, clocked, machine, timed

#: Bai's two matrices without ψ, with an affine and with an elementwise one, hard and easy
_PROBLEMS = tuple(
    f"{problem},mu={mu}"
    for problem in (
        "bai-symmetric",
        "bai-nonsymmetric",
        "manufactured-affine",
        "manufactured-affine,skew=0.5",
        "manufactured-elementwise",
        "manufactured-elementwise,skew=0.5",
    )
    for mu in (0, 4)
)
#: all that the paper prints, and the method that its kind is compared with
_MEMBERS = ("mms", "mnmod", "mnmmod,theta1=4", "mnmj", "mnmgs", "mnmsor,theta1=1.2", "mnmaor,theta1=1.2,theta2=1.5")
#: a run that needs more is given up
_MOST = 20_000


def member_runs(
    scenes: Sequence[str] = (),
    sides: Sequence[int] = (10, 20, 30, 40, 50, 60),
    *,
    methods: Sequence[str | Method] = _MEMBERS,
    phis: Sequence[float] = (0.0, -0.5, 0.5),
    atol: float = 1e-5,
    repeats: int = 3,
    progress: bool = False,
) -> Table:
    """IT, CPU and RES of the members of the family on the test problems of the literature, without ψ and with one.

    Each runs from z⁰ = (1, 0, 1, 0, …) until RES = Res(z) ≤ `atol`. IT is the number of steps, CPU the seconds of the
    whole solve, what is set up for it included, the median of runs in turn; "-" where 20 000 steps do not do, or where
    the run is seen to lead nowhere. Without φ, and with the default φ₁ = I, a member is the one of 2022 (NMMS).
    Parameters: `scenes` as NAME or NAME,PARAMETER=NUMBER, on a square grid, by default Bai's two matrices, μ = 0 and 4,
    with ψ = 0, affine and elementwise; `sides` m of the grids, n = m²; `methods` as NAME or NAME,OPTION=NUMBER, also
    `Method` objects; `phis` numbers f: a member named without phi is run with φ = fI for each; `atol` where to stop,
    > 0; `repeats` rounds of timings, ≥ 3, and more of short runs; `progress` shows a line on what is going on.
    Returns a `Table`, three rows for each method. Raises InputError, and Interrupted, whose `report` has the problems
    so far.
    Reference: Bai, Numer. Linear Algebra Appl. 17 (2010), for the problems with ψ = 0, the start and `atol`.

    >>> table = icp.benchmarks.member_runs(["bai-symmetric,mu=0"], [10], methods=["mms", "mnmgs"], phis=[0])
    >>> [row[3] for row in table.rows if row[2] == "IT"]
    [142, 217]
    """
    texts, repeats = as_scenes(scenes) or _PROBLEMS, as_repeats(repeats)
    atol = as_number(atol, "atol", above=0)
    grids = [int(as_number(m, "sides", least=1, whole=True)) for m in _filled(sides, "sides")]
    numbers = [as_number(phi, "phis") for phi in _filled(phis, "phis")]
    labels, run = zip(*_members(_filled(methods, "methods"), numbers), strict=True)
    rows: list[tuple[Any, ...]] = []
    heads = ("problem", "method", "", *(f"m = {m}" for m in grids))
    title = f"IT, CPU (s) and RES, to RES <= {atol:g} ({machine()})"
    with status_line(progress) as say:
        try:
            for text in texts:
                columns = []
                for m in grids:
                    say(f"{text}, m = {m}")
                    columns.append(_column(_on_square(text, m), run, atol, repeats))
                for label, *cells in zip(labels, *columns, strict=True):
                    rows += [(text, label, *row) for row in zip(("IT", "CPU", "RES"), *cells, strict=True)]
        except KeyboardInterrupt:
            raise Interrupted(Table(title, heads, tuple(rows))) from None
    return Table(title, heads, tuple(rows))


def _filled(values: Any, name: str) -> list[Any]:
    if not (listed := as_list(values, name)):
        raise InputError(f"{name} is empty; at least one was expected")
    return listed


def _members(methods: list[Any], phis: list[float]) -> Iterator[tuple[str, Method]]:
    """(label, method), each with every φ that it may have."""
    for given in methods:
        if isinstance(given, Method):
            yield repr(given), given
            continue
        method = _called(given)
        takes_phi = isinstance(method, ModulusMember) and "phi" in vars(method) and ",phi=" not in given
        for phi in phis if takes_phi else [0]:
            _, *options = text = [*given.split(","), *([f"phi={phi:g}"] if phi else [])]
            yield type(method).__name__ + (f"({', '.join(options)})" if options else ""), _called(",".join(text))


def _called(text: Any) -> Method:
    """The method that `text`, NAME or NAME,OPTION=VALUE,…, stands for."""
    name, *pairs = str(text).split(",")
    return named(name, **{key: _value(value) for key, _, value in (pair.partition("=") for pair in pairs)})


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


def _on_square(text: str, m: int) -> Scene:
    one = built(text, m * m)
    if one.problem.n != m * m:
        raise InputError(f"{text} has {one.problem.n} unknowns; a scene that can have m * m = {m * m} was expected")
    return one


def _column(one: Scene, methods: Sequence[Method], atol: float, repeats: int) -> list[tuple[Any, ...]]:
    """(IT, CPU, RES) of each method; all are timed in turn, after a first run, which compiles and tells IT and RES."""
    calls, counts = {}, {}
    for k, method in enumerate(methods):
        run = partial(_run, method=method, atol=atol)
        if method.why_not(one.problem) is None and (solution := run(fresh(one.problem))).solved:
            calls[k], counts[k] = clocked(run, partial(fresh, one.problem)), solution
    taken = timed(calls, repeats, warm=False, most=MORE * repeats, within=BRIEFLY)
    cells = {k: (found.iterations, taken.median(k), found.residual) for k, found in counts.items()}
    return [cells.get(k, (None, None, None)) for k in range(len(methods))]


def _run(problem: ICP, method: Method, atol: float) -> Solution:
    z0 = np.arange(1, problem.n + 1) % 2.0
    return unbroken(problem.solve(method, z0=z0, atol=atol, rtol=0.0, max_iter=_MOST, raise_on_failure=False))
