"""What a scene is, and how a function becomes one: `@register` on a function that returns a `Scene`."""

from __future__ import annotations

import functools
import inspect
import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ParamSpec
from weakref import WeakKeyDictionary

import numpy as np

from ..errors import InputError
from ..icp import ICP
from ..numerics.arrays import ReadOnly, Vector, as_number, locked
from ..numerics.plugins import load_plugins
from ..present.shown import Plotted, Shown
from ..problem.by_rows import ByRows
from ..problem.data import ProblemData
from ..problem.matrix import Matrix
from ..solve.solution import Solution


@dataclass(frozen=True, repr=False)
class Quantity(Shown):
    """A number that can be read off a solution and whose value in the continuous problem is known.

    `exact` is that value; `measure` reads it off z, shape (n,), NaN where z does not have it; `order` is the power of
    the grid spacing h with which the difference shrinks, None where the number is exact on every grid.

    >>> Quantity(3.0, lambda z: float(z.sum()), order=None).error(np.array([1.0, 2.5]))
    0.5
    """

    exact: float
    measure: Callable[[Vector], float]
    order: float | None

    def error(self, z: Vector) -> float:
        """|measure(z) − exact|, NaN where z does not have the quantity.

        >>> Quantity(1.0, lambda z: float(z[0]), order=2.0).error(np.array([1.5]))
        0.5
        """
        return abs(float(self.measure(z)) - self.exact)


def farthest(exact: Vector, z: Vector) -> float:
    """The largest |z_i − exact_i|, a measure for `Quantity`."""
    return float(np.abs(z - exact).max())


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Scene(ReadOnly, Plotted):
    """A problem of the gallery with what is known of its answer.

    `name` and `title` (one line for a table) are filled in by `register`; `models` says in one sentence what it models;
    `z_exact` is the solution of the discrete problem, shape (n,), to rounding; `quantities` are numbers known for the
    continuous problem, or for each of many solutions; `why_no_reference` says why there is neither, `why_no_solution`
    that there is no solution; `h` is the grid spacing; `z0` a start that the literature prescribes; `points` are the
    coordinates of the unknowns, shape (n,) or (n, 2).

    >>> from icpmodel.scenes import scene
    >>> lcp = scene("hand-lcp")
    >>> lcp.errors(lcp.z_exact)
    {'z': 0.0}
    """

    problem: ICP
    models: str
    name: str = ""
    title: str = ""
    z_exact: Vector | None = None
    quantities: Mapping[str, Quantity] = field(default_factory=dict)
    h: float | None = None
    why_no_reference: str | None = None
    why_no_solution: str | None = None
    z0: Vector | None = None
    points: Vector | None = None

    def __post_init__(self) -> None:
        locked((self.z_exact, self.z0, self.points))
        if self.points is not None:
            _PLACES[self.problem.matrix] = self.points
        if self.name:
            _CALLED[self.problem] = self.name

    def errors(self, z: Any) -> dict[str, float]:
        """The distance of `z`, shape (n,), to each reference: "z" in the max-norm, then every quantity by its name.

        Empty where the scene has no reference. NaN in z gives NaN. Raises InputError where z has another shape.

        >>> from icpmodel.scenes import scene
        >>> scene("hand-negative").errors([0.0])
        {'z': 3.0}
        """
        z = self.problem.vector(z)
        known = {} if self.z_exact is None else {"z": float(np.max(np.abs(z - self.z_exact)))}
        return known | {name: quantity.error(z) for name, quantity in self.quantities.items()}

    def solution(self) -> Solution:
        """What `solve` finds from the start that the scene prescribes, solved or not.

        >>> icp.scenes.hand_lcp().solution().solved
        True
        """
        return self.problem.solve(z0=self.z0, raise_on_failure=False)

    def plot(
        self, path: str | os.PathLike[str] | None = None, *, ax: Any = None, solution: Solution | None = None
    ) -> Any:
        """Show the `solution` where its unknowns are, or write it, or draw it into axes; see `icpmodel.study.plot`.

        Parameters: `path` and `ax` as there; `solution` of the scene's problem, by default what `solve` finds.
        Returns the matplotlib figure. Raises InputError, and FileError where the file cannot be written.
        """
        from ..study import plot

        return plot(self if solution is None else solution, path, ax=ax)


Builder = Callable[..., Scene]
Given = ParamSpec("Given")

#: where the unknowns of a scene's A stand, as long as that A is there: whoever plots a solution need not know its scene
_PLACES: WeakKeyDictionary[Matrix, Vector] = WeakKeyDictionary()


def points_of(problem: ProblemData) -> Vector | None:
    """Where the unknowns of `problem` are if its A is that of a scene, shape (n,) or (n, 2), else None."""
    return _PLACES.get(problem.matrix)


#: the scene that a problem is
_CALLED: WeakKeyDictionary[ProblemData, str] = WeakKeyDictionary()


def title(problem: ProblemData) -> str:
    """What people call the `problem`, such as "membrane, 900 unknowns"; without the name where it is no scene's."""
    unknowns = f"{problem.n:_} unknown{'' if problem.n == 1 else 's'}".replace("_", " ")
    return f"{_CALLED[problem]}, {unknowns}" if problem in _CALLED else unknowns


#: beyond this the matrix alone would need tens of gigabytes, and the side of a grid would not be exact in float64
LARGEST, LARGEST_BY_ROWS = 10**8, 2**52

_BUILDERS: dict[str, Builder] = {}
#: what assembles the rows of a scene, by its name
ASSEMBLIES: dict[str, Callable[..., ByRows]] = {}


def builders() -> dict[str, Builder]:
    """Name of the scene → the function that builds it, those of plug-ins among them."""
    load_plugins()
    return _BUILDERS


def register(build: Callable[Given, Scene]) -> Callable[Given, Scene]:
    """Make the function a scene: its name (with hyphens) is the scene's, its docstring's first line the title.

    It may stand anywhere: it is known once its module is imported, which is done for the files of this room and for
    what packages announce as entry points of the group "icpmodel". Its parameters, all with defaults, are the scene's;
    one called `n` is the wanted number of unknowns, of which it takes the nearest that it can; without `n` it has one
    size only. Returns the function with `n` checked and `name` and `title` filled in. Raises InputError for a second
    scene of the same name.

    >>> register(lambda: None)
    Traceback (most recent call last):
    icpmodel.errors.InputError: the scene <lambda> has no docstring; its first line is the scene's title
    """
    name, signature = build.__name__.replace("_", "-"), inspect.signature(build)
    if not build.__doc__ and sys.flags.optimize < 2:  # `python -OO` drops them all
        raise InputError(f"the scene {name} has no docstring; its first line is the scene's title")
    if name in _BUILDERS:
        raise InputError(f"there is already a scene called {name}")

    @functools.wraps(build)
    def checked(*args: Given.args, **kwargs: Given.kwargs) -> Scene:
        given = signature.bind(*args, **kwargs)
        if "n" in given.arguments:
            given.arguments["n"] = size(given.arguments["n"], most=LARGEST)
        return replace(build(*given.args, **given.kwargs), name=name, title=title_of(build))

    _BUILDERS[name] = checked
    return checked


def assembles(name: str) -> Callable[[Callable[Given, ByRows]], Callable[Given, ByRows]]:
    """Make the function, which takes the parameters of the scene called `name`, what `by_rows` asks for its rows."""
    return lambda build: ASSEMBLIES.setdefault(name, build)


def title_of(build: Builder) -> str:
    """The first line of the docstring."""
    return (build.__doc__ or build.__name__.replace("_", " ")).strip().splitlines()[0].rstrip(".")


def size(n: Any, least: int = 1, most: int = LARGEST_BY_ROWS) -> int:
    """`n`, a number of unknowns that a scene can have. Raises InputError."""
    return int(as_number(n, "the number of unknowns n", least=least, most=most, whole=True))
