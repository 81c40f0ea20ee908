"""What a scene is, and how a function becomes one: `@register` on a function that returns a `Scene`."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial, wraps
from typing import Any, ParamSpec
from weakref import WeakKeyDictionary

import numpy as np

from ..errors import InputError, check_arguments, did_you_mean
from ..icp import ICP
from ..numerics.arrays import ReadOnly, Vector, as_number, locked
from ..numerics.plugins import load_plugins
from ..numerics.rounding import UNIT_ROUNDOFF
from ..present.display import Displayable, Plottable
from ..problem.by_rows import ByRows
from ..problem.data import ProblemData
from ..problem.matrix import Matrix
from ..solve.solution import Solution


@check_arguments
@dataclass(frozen=True, repr=False)
class Quantity(Displayable):
    """A number of a solution whose value in the continuous problem is known.

    Parameters
    ----------
    exact : float
        The value in the continuous problem.
    measure : callable
        z ↦ the number, for z of shape (n,); NaN where it is not defined for z.
    order : float or None
        Power of the grid spacing h with which the difference shrinks. None where the number is
        exact on every grid.

    Examples
    --------
    >>> Quantity(3.0, lambda z: float(z.sum()), order=None).error(np.array([1.0, 2.5]))
    0.5
    """

    exact: float
    measure: Callable[[Vector], float]
    order: float | None

    def error(self, z: Vector) -> float:
        """The error |measure(z) − exact| of the quantity.

        Parameters
        ----------
        z : array of shape (n,)
            The answer.

        Returns
        -------
        float
            The error; NaN where the quantity is not defined for z.

        Examples
        --------
        >>> Quantity(1.0, lambda z: float(z[0]), order=2.0).error(np.array([1.5]))
        0.5
        """
        return abs(float(self.measure(z)) - self.exact)


def distance_to(u: Vector) -> Quantity:
    """The quantity max_i |z_i − u_i|, of order h², with the solution `u` of the continuous problem."""
    return Quantity(0.0, partial(_max_distance, u), order=2.0)


def _max_distance(u: Vector, z: Vector) -> float:
    return float(np.abs(z - u).max())


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Scene(ReadOnly, Plottable):
    """A problem of the gallery, with the known facts about its answer.

    Parameters
    ----------
    problem : ICP
        The problem.
    models : str
        One sentence: what the scene models.
    name, title : str
        The name, and one line for a table. `register` fills them in.
    z_exact : array of shape (n,), optional
        Solution of the discrete problem, to rounding.
    quantities : dict of str to Quantity
        Numbers whose values are known for the continuous problem, or for each of several solutions.
    h : float, optional
        Grid spacing.
    why_no_reference : str, optional
        Why there is neither `z_exact` nor a quantity.
    why_no_solution : str, optional
        Why the problem has no solution.
    z0 : array of shape (n,), optional
        Start that the literature prescribes.
    points : array of shape (n,), (n, 2) or (n, 3), optional
        Coordinates of the unknowns.
    axes : tuple of str, default ("x", "y", "z")
        Names of the coordinates with their units, for pictures.
    unknown : str, default "z"
        Name of z with its unit, for pictures.

    Examples
    --------
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
    axes: tuple[str, ...] = ("x", "y", "z")
    unknown: str = "z"

    def __post_init__(self) -> None:
        locked((self.z_exact, self.z0, self.points))
        if self.points is not None:
            _PLACEMENTS[self.problem.matrix] = Placement(self.points, self.axes, self.unknown)
        if self.name:
            _NAMES[self.problem] = self.name

    def errors(self, z: Any) -> dict[str, float]:
        """Distance of `z` to each reference.

        Parameters
        ----------
        z : array_like of shape (n,)
            A point. NaN in it gives NaN.

        Returns
        -------
        dict of str to float
            "z" in the max-norm, then every quantity by its name. Empty where the scene has no
            reference.

        Raises
        ------
        InputError
            Where z has another shape.

        Examples
        --------
        >>> from icpmodel.scenes import scene
        >>> scene("hand-negative").errors([0.0])
        {'z': 3.0}
        """
        z = self.problem.vector(z)
        known = {} if self.z_exact is None else {"z": float(np.max(np.abs(z - self.z_exact)))}
        return known | {name: quantity.error(z) for name, quantity in self.quantities.items()}

    def solution(self) -> Solution:
        """Solve the problem from the start that the scene prescribes.

        Returns
        -------
        Solution
            The answer, solved or not.

        Examples
        --------
        >>> icp.scenes.hand_lcp().solution().solved
        True
        """
        return self.problem.solve(z0=self.z0, raise_on_failure=False)


Builder = Callable[..., Scene]
Arguments = ParamSpec("Arguments")


@dataclass(frozen=True, eq=False)
class Placement:
    """The coordinates of the unknowns of a scene, and the names of its axes and of its unknown."""

    points: Vector
    coordinates: tuple[str, ...]
    unknown: str


#: A of a scene → the placement of its unknowns: a plot of a solution need not know its scene
_PLACEMENTS: WeakKeyDictionary[Matrix, Placement] = WeakKeyDictionary()


def placement_of(problem: ProblemData) -> Placement | None:
    """Where the unknowns of `problem` are if its A is that of a scene, else None."""
    return _PLACEMENTS.get(problem.matrix)


#: the problem of a scene → the name of the scene
_NAMES: WeakKeyDictionary[ProblemData, str] = WeakKeyDictionary()


def title(problem: ProblemData) -> str:
    """A title of the `problem`, such as "membrane, 900 unknowns"; without a name if it is no scene."""
    unknowns = f"{problem.n:_} unknown{'' if problem.n == 1 else 's'}".replace("_", " ")
    return f"{_NAMES[problem]}, {unknowns}" if problem in _NAMES else unknowns


#: for more unknowns the matrix alone would need many gigabytes; by rows, the side of a grid must be exact in float64
MAX_UNKNOWNS = 100_000_000
MAX_UNKNOWNS_BY_ROWS = int(0.5 / UNIT_ROUNDOFF)

_BUILDERS: dict[str, Builder] = {}
#: name of a scene → the function that assembles its rows, for `by_rows`
ASSEMBLIES: dict[str, Callable[..., ByRows]] = {}


def builders() -> dict[str, Builder]:
    """Name of each scene → the function that builds it, after loading the plug-ins."""
    load_plugins()
    return _BUILDERS


@check_arguments
def register(build: Callable[Arguments, Scene]) -> Callable[Arguments, Scene]:
    """Decorator: register the function as a scene.

    The function's name (with hyphens) is the scene's, the first line of its docstring the title.

    Parameters
    ----------
    build : callable
        Returns a `Scene`. Its parameters, all with defaults, are the scene's. One called `n` is the
        wanted number of unknowns; the scene takes the nearest possible number. Without `n` the scene
        has one size only.

    Returns
    -------
    callable
        The function with `n` checked and `name` and `title` filled in.

    Raises
    ------
    InputError
        For a second scene of the same name, and for a function without a docstring.

    Notes
    -----
    The function may be in any module: it is known once that is imported. The files of
    `icpmodel.scenes` are imported, and the entry points of the group "icpmodel" of all packages.

    Examples
    --------
    >>> register(lambda: None)
    Traceback (most recent call last):
    icpmodel.errors.InputError: the scene <lambda> has no docstring; its first line is the scene's title
    """
    name = build.__name__.replace("_", "-")
    signature = inspect.signature(build)
    if not build.__doc__ and sys.flags.optimize < 2:  # `python -OO` drops them all
        raise InputError(f"the scene {name} has no docstring; its first line is the scene's title")
    if name in _BUILDERS:
        raise InputError(f"there is already a scene called {name}")

    @wraps(build)
    def checked(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Scene:
        check_parameters(name, kwargs, signature.parameters)
        bound = signature.bind(*args, **kwargs)
        if "n" in bound.arguments:
            bound.arguments["n"] = size(bound.arguments["n"], maximum=MAX_UNKNOWNS)
        return replace(build(*bound.args, **bound.kwargs), name=name, title=title_of(build))

    _BUILDERS[name] = checked
    return checked


def check_parameters(name: str, parameters: Iterable[str], known: Iterable[str]) -> None:
    """Raise InputError where one of the `parameters` of the scene called `name` is not among the `known` ones."""
    for parameter in parameters:
        if parameter not in known:
            hint = did_you_mean(parameter, known)
            listed = ", ".join(known) or "none"
            raise InputError(f"{name} has no parameter {parameter!r}; its parameters are: {listed}{hint}")


def assembles(name: str) -> Callable[[Callable[Arguments, ByRows]], Callable[Arguments, ByRows]]:
    """Decorator: register the function as the assembly of the scene `name`, whose parameters it takes."""
    return lambda build: ASSEMBLIES.setdefault(name, build)


def title_of(build: Builder) -> str:
    """The first line of the docstring, without its period; without a docstring the name."""
    return (build.__doc__ or build.__name__.replace("_", " ")).strip().splitlines()[0].rstrip(".")


def size(n: Any, minimum: int = 1, maximum: int = MAX_UNKNOWNS_BY_ROWS) -> int:
    """`n` as an int, checked to be a number of unknowns that a scene can have. Raises InputError."""
    return int(as_number(n, "the number of unknowns n", minimum=minimum, maximum=maximum, whole=True))
