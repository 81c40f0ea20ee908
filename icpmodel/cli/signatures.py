"""A command from a function: its options are those of the signature, its help is what the docstring says."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable
from typing import Any

import click

from ..errors import Interrupted
from .output import complain

#: what a command sets itself
_SET_HERE = ("progress", "command", "entrants")
#: options that are called otherwise than the parameter
_OPTIONS = {"sizes": "--n", "sides": "--m"}
#: parameters that are arguments without a name
_ARGUMENTS = ("scenes", "scene")


def summary(function: Callable[..., Any]) -> str:
    """The first paragraph of the docstring."""
    return inspect.getdoc(function).split("\n\n")[0]  # type: ignore[union-attr]


def parameters(function: Callable[..., Any]) -> list[Callable[[Any], Any]]:
    """Click's decorators for the parameters of `function`, in their order, with its defaults and what it says of them.

    A default that is a tuple makes an option that can be repeated, called as one of its values: `methods` is --method.
    """
    told, found = _told(function), []
    for name, parameter in inspect.signature(function).parameters.items():
        default = parameter.default
        if name in _SET_HERE:
            continue
        if name in _ARGUMENTS:
            more: dict[str, Any] = {"nargs": -1} if isinstance(default, tuple) else {"default": default}
            if "PARAMETER" in told.get(name, ""):
                more["metavar"] = "[NAME[,PARAMETER=NUMBER]]..."
            found.append(click.argument(name, **more))
            continue
        many = isinstance(default, tuple)
        option = _OPTIONS.get(name, "--" + (name.removesuffix("s") if many else name).replace("_", "-"))
        kind = str if default is None else type(default[0] if many else default)
        shown = {"default": default, "show_default": default is not None, "multiple": many, "help": told.get(name)}
        found.append(click.option(option, name, type=kind, **shown))
    return found


def _told(function: Callable[..., Any]) -> dict[str, str]:
    """What the docstring says of each parameter, in its section "Parameters: `name` text; `name` text; …"."""
    text = " ".join(inspect.getdoc(function).split())  # type: ignore[union-attr]
    section = re.search(r"Parameters: (.*?)(?: Returns| Raises|$)", text)
    names = "|".join(inspect.signature(function).parameters)
    pieces = re.split(rf"`({names})`", section.group(1) if section else "")
    return {name: said.strip(" ,;.").replace("`", "") for name, said in zip(pieces[1::2], pieces[2::2], strict=True)}


def decorated(function: Callable[..., Any], decorators: Iterable[Callable[[Any], Any]]) -> Callable[..., Any]:
    """`function` with all of these click options and arguments, in this order."""
    for decorate in reversed(list(decorators)):
        function = decorate(function)
    return function


def measured(measure: Callable[[], Any], show: Callable[[Any], None], partly: str) -> int:
    """Measure and show; after Ctrl-C show what there is, with the sentence `partly`. Returns 0 or 130."""
    try:
        found, code = measure(), 0
    except Interrupted as stopped:
        found, code = stopped.report, 130
        complain(f"interrupted: {partly}")
    show(found)
    return code
