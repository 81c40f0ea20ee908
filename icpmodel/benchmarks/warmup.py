"""Every loop compiled once, so that no later process has to: all methods, bounds and pages on small scenes."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np

from ..errors import IcpError
from ..icp import ICP
from ..methods.contract import named, names
from ..problem.affine import Affine
from ..problem.elementwise import Elementwise
from ..scenes import names as scene_names
from ..scenes import parameters, scene
from ..solve.many import solve_many

#: unknowns of a scene that has a size, and iterations: enough for every loop to be entered
_N, _STEPS = 100, 30


def warm_up(say: Callable[[str], None] = lambda text: None) -> float:
    """Compile all loops for the kinds of data that they are given, and keep them on disk. Returns the seconds.

    Parameters: `say` is told what is at work.
    """
    begin = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, problem in _problems():
            for method in (None, *names()):
                say(f"compiling: {name} by {method or 'solve()'}")
                with suppress(IcpError):  # not every method takes every scene
                    solution = problem.solve(method and named(method), max_iter=_STEPS, raise_on_failure=False)
            say(f"compiling: what is proved of {name}")
            for ask in (solution.polish, problem.explain):
                with suppress(IcpError, ArithmeticError, RuntimeError):  # of a scene that is made to be hard
                    str(ask())
    return time.perf_counter() - begin


def _problems() -> Iterator[tuple[str, ICP]]:
    for name in scene_names():
        yield name, scene(name, **({"n": _N} if "n" in parameters(name) else {})).problem
    grid = scene("membrane", n=_N).problem
    yield "an affine obstacle", grid.with_psi(Affine(0.05 * grid.A, -1.0))
    yield "an elementwise obstacle", grid.with_psi(Elementwise(lambda z: 0.3 * np.sin(z), lambda z: 0.3 * np.cos(z)))
    yield "two obstacles", grid.with_upper(1.0)
    yield "two affine obstacles", grid.with_sides(Affine(0.05 * grid.A, -1.0), Affine(0.05 * grid.A, 1.0))
    line = ICP(3.0 * np.eye(_N) - np.eye(_N, k=1) - np.eye(_N, k=-1), -np.ones(_N))
    yield "a line", line
    yield "a line between two obstacles", line.with_upper(0.1)
    for A in (line.A, line.A[:2, :2]):
        for upper in (None, 0.1):
            solve_many(A, np.stack([-np.ones(A.shape[0]), np.ones(A.shape[0])]), upper=upper)
