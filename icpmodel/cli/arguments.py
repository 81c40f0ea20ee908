"""Options of commands: made from a signature and its docstring, and those that name the problem and the method."""

from __future__ import annotations

import inspect
import os
import re
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import fields
from itertools import chain
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any, NamedTuple

import click
from click.shell_completion import CompletionItem

from ..errors import FileError, InputError, did_you_mean
from ..icp import ICP
from ..methods.contract import Method, named, names
from ..modelling.files import load_problem
from ..modelling.formats import SUFFIXES
from ..present.whole_files import file_errors, in_words
from ..scenes import Scene, scene
from ..scenes import names as scene_names
from ..scenes import parameters as parameters_of
from ..solvers.foreign import foreign_solvers
from .output import STANDARD_INPUT

SOURCE_HELP = f"""SOURCE is the name of a built-in scene (see `icpmodel scenes`) or an .npz file written by
--save-problem or -o. It may be a .mat file with A, q, psi and upper.
Without SOURCE give --A and --q, and --psi and --upper for obstacles other than 0. A file name of A or of a vector ends
in {in_words(SUFFIXES)}; in .csv and .txt the first line may have names. SOURCE, or one of the
files of --A, --q, --psi and --upper, may be -, standard input."""

Decorator = Callable[[Any], Any]

_NAME_VALUE: dict[str, Any] = {"multiple": True, "metavar": "NAME=VALUE"}


class _Whole(click.ParamType):
    """A whole number, also as 1e4."""

    name = "integer"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        number = _number(str(value))
        if not isinstance(number, int) or isinstance(number, bool) or abs(number) >= 2**63:
            self.fail(f"{value!r} is not a valid integer.", param, ctx)
        return number


def _number(text: str) -> bool | int | float | str:
    """Convert text to a truth value, an integer (also 1e4) or a float; return any other text as it is."""
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    for convert in (int, float):
        with suppress(ValueError):
            number = convert(text)
            return int(number) if number % 1 == 0 and "." not in text else number
    return text


_WHOLE = _Whole()
_KINDS = {"int": _WHOLE, "float": float, "str": str}


def completing(listed: Callable[[], Iterable[str]]) -> Callable[..., list[CompletionItem]]:
    """A function for shell completion: the matching names in `listed()`, or else files."""

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        items = [CompletionItem(name) for name in listed() if name.startswith(incomplete)]
        return items or [CompletionItem(incomplete, type="file")]

    return complete


#: part of a problem → the argument that names its file
_FILE_OPTIONS = {"A": "a_file", "q": "q_file", "psi": "psi", "upper": "upper"}

#: first bytes of standard input → the suffix of its format; all else is CSV
_SUFFIX_OF_PREFIX = {b"PK": ".npz", b"\x93NUMPY": ".npy", b"%%MatrixMarket": ".mtx"}
#: the argument and options that name the problem
SOURCE_OPTIONS = (
    click.argument("source", required=False, shell_complete=completing(scene_names)),
    click.option("--n", type=_WHOLE, help="Number of unknowns of a scene; the nearest possible number is used."),
    click.option("--set", "parameters", **_NAME_VALUE, help="A parameter of the scene; repeatable."),
    click.option("--A", "a_file", type=click.Path(), help="A file of A, in place of SOURCE."),
    click.option("--q", "q_file", type=click.Path(), help="A file of q."),
    click.option("--psi", type=click.Path(), help="A number, or a file of the obstacle below z.  [default: 0]"),
    click.option("--upper", type=click.Path(), help="A number, or a file of the upper obstacle.  [default: none]"),
)
#: the options that name the method
METHOD_OPTIONS = (
    click.option(
        "--method", shell_complete=completing(names), help=f"One of {', '.join(names())}; default: automatic."
    ),
    click.option("--option", "options", **_NAME_VALUE, help="An option of the method, such as theta1=1.2; repeatable."),
)
SOLVERS_OPTION = click.option(
    "--solver",
    "solvers",
    multiple=True,
    shell_complete=completing(foreign_solvers),
    help="An independent solver; repeatable; default: all that can take the problem.",
)


def options(*decorators: Decorator) -> Decorator:
    """Decorator: add these click options and arguments to a command, in this order."""

    def decorate(command: Any) -> Any:
        for decorator in reversed(decorators):
            command = decorator(command)
        return command

    return decorate


class _OnProblem(click.Command):
    """A command that, for an unknown option, says how to type an option of a method or a parameter of a scene."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as error:
            name = error.option_name.lstrip("-").replace("-", "_")
            taken = [option for one in self.params for option in one.opts]
            known = {
                "--option": (one.name for method in names() for one in fields(named(method))),
                "--set": chain.from_iterable(map(parameters_of, scene_names())),
            }
            typed = [f"{option} {name}=VALUE" for option, words in known.items() if option in taken and name in words]
            typed = [f"--{name} VALUE"] if f"--{name}" in taken else typed
            hint = f"; {' or '.join(typed)} was expected" if typed else did_you_mean(name, taken)
            if not hint:
                raise
            words = f"No such option {error.option_name!r}{hint}"
            raise click.NoSuchOption(error.option_name, words, ctx=ctx) from None


def command(*decorators: Decorator) -> Decorator:
    """Decorator: make the function a command on a problem, with these options and arguments."""
    return lambda run: click.command(cls=_OnProblem, epilog=SOURCE_HELP)(options(*decorators)(run))


def from_signature(function: Callable[..., Any], *names: str) -> list[Decorator]:
    """A click option for each named parameter of a signature, with its type, default and description."""
    known = inspect.signature(function).parameters
    descriptions = _descriptions(function)
    return [_option(known[name], descriptions.get(name, "")) for name in names]


def _descriptions(function: Callable[..., Any]) -> dict[str, str]:
    """Parameter → its description in the section Parameters of a numpydoc docstring."""
    _, _, rest = (inspect.getdoc(function) or "").partition("Parameters\n----------\n")
    entries = re.findall(r"^(\w[\w, ]*) :.*\n((?: {4}.*\n|\n(?= ))+)", rest, re.MULTILINE)
    return {name: " ".join(text.split()) for names, text in entries for name in names.split(", ")}


def _option(parameter: inspect.Parameter, description: str) -> Decorator:
    default = parameter.default
    kind = _KINDS.get(str(parameter.annotation).split(" ")[0], type(default))
    display = {"default": default, "show_default": default is not None, "help": description}
    return click.option("--" + parameter.name.replace("_", "-"), parameter.name, type=kind, **display)


class NamedProblem(NamedTuple):
    """The named problem: a scene with `n` and `parameters`, or, as `files`, the arguments of `load_problem`."""

    scene: str | None
    n: int | None
    parameters: dict[str, Any]
    files: tuple[Any, ...]


def named_source(arguments: dict[str, Any]) -> NamedProblem:
    """The scene or the files that the arguments name; reads standard input for "-". Raises InputError, FileError."""
    if [arguments[key] for key in ("source", *_FILE_OPTIONS.values())].count("-") > 1:
        raise InputError("more than one file is -, standard input, which holds one; give the others by name")
    arguments = arguments | {key: _input(arguments[key]) for key in ("source", *_FILE_OPTIONS.values())}
    source = arguments["source"]
    file = arguments["a_file"]
    n = arguments["n"]
    parameters = pairs(arguments["parameters"], "--set")
    files = {f"--{name}": arguments[key] for name, key in _FILE_OPTIONS.items() if arguments[key] is not None}
    if (source is None) == (file is None):
        actual = f"both are given, {source} and {file}; drop one" if source is not None else "neither is given"
        raise InputError(f"SOURCE or --A names the problem; {actual}")
    if source in scene_names():
        if files:
            raise InputError(f"{next(iter(files))} belongs to a file of A; {source} is a scene, which has its own")
        if "n" in parameters:
            raise InputError("the size of a scene is set by --n, not by --set n=...")
        return NamedProblem(source, n, parameters, ())
    if file is None and not os.path.exists(source):
        if os.path.splitext(source)[1] or os.sep in source:
            raise FileError(f"{source}: no such file or folder")
        hint = did_you_mean(source, scene_names()) or "; `icpmodel scenes` lists the scenes"
        raise InputError(f"SOURCE is {source!r}; there is neither a scene nor a file or folder of this name{hint}")
    if n is not None or parameters:
        raise InputError(f"--n and --set belong to scenes, and {source or file} is not a scene; see `icpmodel scenes`")
    sides = (_side(arguments[name], f"--{name}") for name in ("psi", "upper"))
    return NamedProblem(None, None, {}, (source or file, arguments["q_file"], *sides))


def named_problem(arguments: dict[str, Any]) -> tuple[ICP, Scene | None]:
    """The problem that the arguments name, built or read, and its scene or None. Raises InputError, FileError."""
    named = named_source(arguments)
    if named.scene is None:
        return load_problem(*named.files), None
    named_scene = scene(named.scene, named.n, **named.parameters)
    note_size(named, named_scene.problem.n)
    return named_scene.problem, named_scene


def note_size(named: NamedProblem, n: int) -> None:
    """Report on standard error if the scene has `n` unknowns instead of the requested number."""
    if named.n not in (None, n):
        click.echo(f"note: {named.scene} has no size {named.n}; the nearest is {n}", err=True)


def _input(name: str | None) -> str | None:
    """`name`; for "-" a file with the data from standard input, deleted when the command ends."""
    if name != "-":
        return name
    with file_errors(Path(STANDARD_INPUT), "read"):
        data = sys.stdin.buffer.read()
    if data.startswith((b"{", b"[")):
        raise InputError(f"{STANDARD_INPUT} is JSON, which is not read; use solve -o answer.npz")
    suffix = next((suffix for begin, suffix in _SUFFIX_OF_PREFIX.items() if data.startswith(begin)), ".csv")
    with NamedTemporaryFile(prefix="standard-input-", suffix=suffix, delete=False) as file:
        file.write(data)
    context = click.get_current_context()
    context.meta[STANDARD_INPUT] = file.name
    context.call_on_close(lambda: os.unlink(file.name))
    return file.name


def _side(text: str | None, option: str) -> float | str | None:
    """The text as a number, or as the name of an existing file. Raises InputError."""
    try:
        return None if text is None else float(text)
    except ValueError:
        if not os.path.exists(str(text)):
            raise InputError(f"{option} is {text!r}; that is no number, and there is no such file") from None
        return text


def named_method(arguments: dict[str, Any]) -> Method | None:
    """The method that the arguments name, or None. Raises InputError."""
    values = pairs(arguments["options"], "--option")
    if arguments["method"] is not None:
        return named(arguments["method"], **values)
    if values:
        raise InputError("--option belongs to a method; name one with --method")
    return None


def pairs(texts: tuple[str, ...], option: str) -> dict[str, Any]:
    """Name → value for the texts NAME=VALUE of a repeated `option`, converted by `_number`. Raises InputError."""
    values: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise InputError(f"{option} is {text!r}; NAME=VALUE was expected")
        if name in values:
            raise InputError(f"{option} gives {name} twice; once was expected")
        values[name] = _number(value)
    return values
