"""The arguments by which a command is told its problem and its method."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import InputError
from ..icp import ICP
from ..methods.contract import Method, named, names
from ..modelling.files import load_problem

if TYPE_CHECKING:
    from ..scenes import Scene

SOURCE_HELP = """SOURCE is the name of a built-in scene (see `icpmodel scenes`), a folder or .npz file written by
--save-problem, or a Matrix Market file of A together with --q."""

_PAIR: dict[str, Any] = {"multiple": True, "metavar": "NAME=VALUE"}
#: by which the problem is named
SOURCE_OPTIONS = (
    click.argument("source"),
    click.option("--n", type=int, help="Wanted number of unknowns of a scene; it takes the nearest it can have."),
    click.option("--set", "parameters", **_PAIR, help="A parameter of the scene; repeatable."),
    click.option("--q", "q_file", type=click.Path(), help="Matrix Market file of q, where SOURCE is one of A."),
)
#: by which the method is named
METHOD_OPTIONS = (
    click.option("--method", help=f"One of {', '.join(names())}; without it one is picked."),
    click.option("--option", "options", **_PAIR, help="An option of the method, such as theta1=1.2; repeatable."),
)


def options(*decorators: Callable[..., Any]) -> Callable[..., Any]:
    """All of these click options and arguments at once, in this order."""

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        for one in reversed(decorators):
            command = one(command)
        return command

    return decorate


def named_problem(arguments: dict[str, Any]) -> tuple[ICP, Scene | None]:
    """The problem that the arguments name, and its scene if it is one. Raises InputError, FileError."""
    from .. import scenes as gallery

    source, n, q_file = arguments["source"], arguments["n"], arguments["q_file"]
    parameters = pairs(arguments["parameters"])
    if source in gallery.names():
        if q_file is not None:
            raise InputError(f"--q belongs to a Matrix Market file of A; {source} is a scene, which has its own q")
        if "n" in parameters:
            raise InputError("the size of a scene is set by --n, not by --set n=...")
        scene = gallery.scene(source, n, **parameters)
        if n is not None and scene.problem.n != n:
            click.echo(f"note: {source} has no size {n}; the nearest is {scene.problem.n}", err=True)
        return scene.problem, scene
    listed = ", ".join(gallery.names())
    if not source or not Path(source).exists():
        raise InputError(f"{source or 'SOURCE'} is neither a file or folder nor a scene; scenes: {listed}")
    if n is not None or parameters:
        raise InputError(f"--n and --set belong to scenes, and {source} is none of them: {listed}")
    return load_problem(source, q_file), None


def named_method(arguments: dict[str, Any]) -> Method | None:
    """The method that the arguments name, or None. Raises InputError."""
    given = pairs(arguments["options"])
    if arguments["method"] is not None:
        return named(arguments["method"], **given)
    if given:
        raise InputError("--option belongs to a method; name one with --method")
    return None


def pairs(texts: tuple[str, ...]) -> dict[str, Any]:
    """name=value with the value as a number or truth value where it is one. Raises InputError."""
    found: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise InputError(f"{text!r} is not of the form NAME=VALUE")
        if name in found:
            raise InputError(f"{name} is given twice")
        found[name] = value
        if value.lower() in ("true", "false"):
            found[name] = value.lower() == "true"
        for convert in (float, int):  # int last: it wins where both can read it
            try:
                found[name] = convert(value)
            except ValueError:
                continue
    return found
