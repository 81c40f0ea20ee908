"""The arguments by which a command is told its problem and its method."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from ..errors import InputError
from ..icp import ICP
from ..methods.contract import Method, named, names
from ..modelling.files import load_problem
from ..scenes import Scene, scene
from ..scenes import names as scene_names
from .signatures import decorated

SOURCE_HELP = """SOURCE is the name of a built-in scene (see `icpmodel scenes`), a folder or .npz file written by
--save-problem, or a Matrix Market file of A together with --q."""

_PAIR: dict[str, Any] = {"multiple": True, "metavar": "NAME=VALUE"}
_KINDS = {"int": int, "float": float, "str": str}


class _MethodOption(click.Option):
    """An option whose help lists the methods, also those of plug-ins, when it is asked for."""

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        self.help = f"One of {', '.join(names())}; without it one is picked."
        return super().get_help_record(ctx)


#: by which the problem is named
SOURCE_OPTIONS = (
    click.argument("source"),
    click.option("--n", type=int, help="Wanted number of unknowns of a scene; it takes the nearest it can have."),
    click.option("--set", "parameters", **_PAIR, help="A parameter of the scene; repeatable."),
    click.option("--q", "q_file", type=click.Path(), help="Matrix Market file of q, where SOURCE is one of A."),
)
#: by which the method is named
METHOD_OPTIONS = (
    click.option("--method", cls=_MethodOption),
    click.option("--option", "options", **_PAIR, help="An option of the method, such as theta1=1.2; repeatable."),
)


def options(*decorators: Callable[..., Any]) -> Callable[..., Any]:
    """All of these click options and arguments at once, in this order."""
    return lambda command: decorated(command, decorators)


def from_signature(function: Callable[..., Any], told: dict[str, str]) -> list[Callable[..., Any]]:
    """An option for each parameter that is `told` of, with the type and the default that `function` gives it."""
    found, known = [], inspect.signature(function).parameters
    for name, text in told.items():
        kind, default = str(known[name].annotation).split(" ")[0], known[name].default
        shown = {"default": default, "show_default": default is not None, "help": text}
        found.append(click.option("--" + name.replace("_", "-"), type=_KINDS[kind], **shown))
    return found


def named_problem(arguments: dict[str, Any]) -> tuple[ICP, Scene | None]:
    """The problem that the arguments name, and its scene if it is one. Raises InputError, FileError."""
    source, n, q_file = arguments["source"], arguments["n"], arguments["q_file"]
    parameters = pairs(arguments["parameters"])
    if source in scene_names():
        if q_file is not None:
            raise InputError(f"--q belongs to a Matrix Market file of A; {source} is a scene, which has its own q")
        if "n" in parameters:
            raise InputError("the size of a scene is set by --n, not by --set n=...")
        found = scene(source, n, **parameters)
        if n is not None and found.problem.n != n:
            click.echo(f"note: {source} has no size {n}; the nearest is {found.problem.n}", err=True)
        return found.problem, found
    listed = ", ".join(scene_names())
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
