"""The gallery: built-in problems, most of them with known answers, one file per field.

`scene("membrane", n=10000)` builds one by name, `icpmodel.scenes.membrane(n=10000)` is the same, `names()` lists them.
A scene is a function decorated with `@register`, in a file of this package, an imported module or a plug-in.
"""

from __future__ import annotations

import importlib
import inspect
import json
import pkgutil
from typing import Any

from ..errors import InputError, check_arguments, did_you_mean
from ..problem.by_rows import ByRows
from .registry import (
    ASSEMBLIES,
    MAX_UNKNOWNS,
    Builder,
    Quantity,
    Scene,
    builders,
    check_parameters,
    register,
    size,
    title_of,
)

__all__ = ["Quantity", "Scene", "by_rows", "names", "parameters", "register", "scene", "titles"]

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")


@check_arguments
def scene(name: str, /, n: int | None = None, **parameters: Any) -> Scene:
    """Build the scene called `name`, at its default size or with about `n` unknowns.

    Parameters
    ----------
    name : str
        Name of the scene. Parameters may follow it, as in "membrane,mu=4".
    n : int, optional
        Wanted number of unknowns; the scene takes the nearest possible number. On a square grid this
        is the m² nearest to n.
    **parameters
        Parameters of the scene, which `parameters(name)` lists.

    Returns
    -------
    Scene
        The problem with what is known of its answer.

    Raises
    ------
    InputError
        For an unknown name or parameter. For an n that is no positive integer, is too small, or
        differs from the only size of the scene.

    Examples
    --------
    >>> scene("membrane", n=1000).problem.n
    1024
    >>> scene("hand-lcp", n=1000)
    Traceback (most recent call last):
    icpmodel.errors.InputError: n is 1000; hand-lcp has one size only, n = 2
    """
    name, n, parameters = _split_name(name, n, parameters)
    build = _builder(name)
    if n is not None and "n" in inspect.signature(build).parameters:
        return build(n=n, **parameters)
    built = build(**parameters)
    if n is not None and size(n, maximum=MAX_UNKNOWNS) != built.problem.n:
        raise InputError(f"n is {n!r}; {name} has one size only, n = {built.problem.n}")
    return built


@check_arguments
def by_rows(name: str, /, n: int | None = None, **parameters: Any) -> ByRows:
    """The scene called `name` as an assembly of any range of its rows; nothing of size n is formed.

    Parameters
    ----------
    name : str
        As for `scene`, which forms all of the same rows.
    n : int, optional
        As for `scene`.
    **parameters
        As for `scene`.

    Returns
    -------
    ByRows
        The assembly; its `n` is the size that the scene takes.

    Raises
    ------
    InputError
        As `scene` does, and for a scene without such an assembly.

    Examples
    --------
    >>> by_rows("obstacle-3d", n=10**9).local_rows(0, 1).A.indices
    array([      0,       1,    1000, 1000000], dtype=int32)
    """
    name, n, parameters = _split_name(name, n, parameters)
    signature = inspect.signature(_builder(name))
    if name not in ASSEMBLIES:
        raise InputError(f"{name} is not assembled by rows; the scenes that are: {', '.join(sorted(ASSEMBLIES))}")
    check_parameters(name, parameters, signature.parameters)
    bound = signature.bind(**parameters, **({} if n is None else {"n": size(n)}))
    bound.apply_defaults()
    return ASSEMBLIES[name](**bound.arguments)


def _split_name(name: str, n: int | None, parameters: dict[str, Any]) -> tuple[str, int | None, dict[str, Any]]:
    """Split "NAME,PARAMETER=NUMBER,…" into the name, n and all other parameters. Raises InputError."""
    name, *pairs = str(name).split(",")
    try:
        parameters |= {key: json.loads(value) for key, _, value in (pair.partition("=") for pair in pairs)}
    except ValueError:
        raise InputError(f"{','.join([name, *pairs])!r} is not of the form NAME,PARAMETER=NUMBER") from None
    n = parameters.pop("n", n)
    return name, n, parameters


@check_arguments
def names() -> list[str]:
    """The names of all scenes, in alphabetical order.

    Returns
    -------
    list of str
        The names.

    Examples
    --------
    >>> "membrane" in names()
    True
    """
    return sorted(builders())


@check_arguments
def titles() -> dict[str, str]:
    """Name → title of each scene; no scene is built.

    Returns
    -------
    dict
        Name → title.

    Examples
    --------
    >>> titles()["coulomb"]
    'A block on a slope with dry friction'
    """
    return {name: title_of(build) for name, build in sorted(builders().items())}


@check_arguments
def parameters(name: str) -> dict[str, Any]:
    """Map each parameter of the scene `name` to its default value.

    Parameters
    ----------
    name : str
        Name of the scene.

    Returns
    -------
    dict of str to any
        Parameter → default; "n" is among them unless the scene has one size only.

    Raises
    ------
    InputError
        For an unknown name.

    Examples
    --------
    >>> parameters("membrane")
    {'n': 900, 'mu': 0.0, 'skew': 0.0}
    """
    return {key: value.default for key, value in inspect.signature(_builder(name)).parameters.items()}


def _builder(name: str) -> Builder:
    name = str(name)
    if name not in builders():
        listed = ", ".join(names())
        raise InputError(f"there is no scene {name!r}{did_you_mean(name, names()) or f'; the scenes are: {listed}'}")
    return builders()[name]


def __getattr__(name: str) -> Builder:
    build = None if name.startswith("__") else builders().get(name.replace("_", "-"))
    if build is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return build


def __dir__() -> list[str]:
    return sorted([*__all__, *(name.replace("-", "_") for name in names())])
