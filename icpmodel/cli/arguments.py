"""What a user types: options read off a signature and its docstring, and those that name the problem and the method."""

from __future__ import annotations

import inspect
import os
import re
from collections.abc import Callable
from typing import Any

import click

from ..errors import InputError
from ..icp import ICP
from ..methods.contract import Method, named, names
from ..modelling.files import load_problem
from ..scenes import Scene, scene
from ..scenes import names as scene_names

SOURCE_HELP = """SOURCE is the name of a built-in scene (see `icpmodel scenes`), an .npz file written by --save-problem,
a folder of Matrix Market files with a psi.json, or a Matrix Market file of A together with --q."""

Decorator = Callable[[Any], Any]

#: what a command sets itself
_SET_HERE = ("progress", "command", "entrants")
#: options that are called otherwise than the parameter
_OPTIONS = {"sizes": "--n", "sides": "--m"}
#: what is one of several, where the s is not all
_SINGULAR = {"families": "family"}
#: the annotation of three numbers in one option
_TRIPLE = "tuple[int, int, int]"
#: parameters that are arguments without a name
_ARGUMENTS = ("scenes", "scene")
_KINDS = {"int": int, "float": float, "str": str}
_PAIR: dict[str, Any] = {"multiple": True, "metavar": "NAME=VALUE"}


class _MethodOption(click.Option):
    """Its help lists the methods, also those of plug-ins, when it is asked for."""

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


def options(*decorators: Decorator) -> Decorator:
    """All of these click options and arguments at once, in this order."""

    def decorate(command: Any) -> Any:
        for decorator in reversed(decorators):
            command = decorator(command)
        return command

    return decorate


def command(*decorators: Decorator) -> Decorator:
    """A command on a problem, with these options and arguments."""
    return lambda run: click.command(epilog=SOURCE_HELP)(options(*decorators)(run))


def documented(name: str, function: Callable[..., Any], *more: Decorator) -> Decorator:
    """The command `name` that takes what `function` takes, and says of it what its docstring says."""
    return lambda run: click.command(name, help=summary(function))(options(*parameters(function), *more)(run))


def from_signature(function: Callable[..., Any], told: dict[str, str]) -> list[Decorator]:
    """An option for each parameter that is `told` of, with the type and the default that `function` gives it."""
    known = inspect.signature(function).parameters
    return [_option(known[name], text) for name, text in told.items()]


def parameters(function: Callable[..., Any]) -> list[Decorator]:
    """Options for all parameters of `function`, in their order, with its defaults and what its docstring says of them.
    That is the section "Parameters: `name` text; `name` text; …"."""
    known = inspect.signature(function).parameters
    text = " ".join((inspect.getdoc(function) or "").split())
    section = re.search(r"Parameters: (.*?)(?: Returns| Raises|$)", text)
    pieces = re.split(rf"`({'|'.join(known)})`", section.group(1) if section else "")
    told = {name: said.strip(" ,;.").replace("`", "") for name, said in zip(pieces[1::2], pieces[2::2], strict=True)}
    return [_option(one, told.get(name)) for name, one in known.items() if name not in _SET_HERE]


def _option(parameter: inspect.Parameter, said: str | None) -> Decorator:
    """A tuple as default makes an option that can be repeated, called as one of its values: `methods` is --method."""
    name, default = parameter.name, parameter.default
    many = isinstance(default, tuple)
    if name in _ARGUMENTS:
        metavar = "[NAME[,PARAMETER=NUMBER]]..." if "PARAMETER" in (said or "") else None
        return click.argument(name, metavar=metavar, **({"nargs": -1} if many else {"default": default}))
    if parameter.annotation == _TRIPLE:
        shown = {"nargs": 3, "type": int, "default": default, "show_default": True, "help": said}
        return click.option(f"--{name}", name, metavar="LOW HIGH COUNT", **shown)
    if isinstance(default, bool):
        return click.option(f"--{name}/--no-{name}", name, default=default, show_default=True, help=said)
    singular = _SINGULAR.get(name, name.removesuffix("s"))
    option = _OPTIONS.get(name, "--" + (singular if many else name).replace("_", "-"))
    of_default = str if default is None or default == () else type(default[0] if many else default)
    kind = _KINDS.get(str(parameter.annotation).split(" ")[0], of_default)
    shown = {"default": default, "show_default": default is not None, "multiple": many, "help": said}
    return click.option(option, name, type=kind, **shown)


def summary(function: Callable[..., Any]) -> str:
    """The first paragraph of the docstring."""
    return (inspect.getdoc(function) or "").split("\n\n")[0]


def named_problem(arguments: dict[str, Any]) -> tuple[ICP, Scene | None]:
    """The problem that the arguments name, and its scene if it is one. Raises InputError, FileError."""
    source, n, q_file = arguments["source"], arguments["n"], arguments["q_file"]
    parameters, listed = pairs(arguments["parameters"]), ", ".join(scene_names())
    if source in scene_names():
        if q_file is not None:
            raise InputError(f"--q belongs to a Matrix Market file of A; {source} is a scene, which has its own q")
        if "n" in parameters:
            raise InputError("the size of a scene is set by --n, not by --set n=...")
        found = scene(source, n, **parameters)
        if n is not None and found.problem.n != n:
            click.echo(f"note: {source} has no size {n}; the nearest is {found.problem.n}", err=True)
        return found.problem, found
    if not source or not os.path.exists(source):
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
        found[name] = {"true": True, "false": False}.get(value.lower(), value)
        for convert in (float, int):  # int last: it wins where both can read it
            try:
                found[name] = convert(value)
            except ValueError:
                continue
    return found
