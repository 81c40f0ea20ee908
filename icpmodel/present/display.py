"""What users see of an object: a short `repr`, a view in a notebook, and a picture."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import Field, fields, is_dataclass
from typing import Any

import numpy as np

from .rendering import render

#: the largest number of characters of a field, one or two lines of a terminal, and of a whole `repr`
_MAX_FIELD_LENGTH = 72
_MAX_REPR_LENGTH = 480
#: names that fit in a sentence
_MAX_LISTED = 8


class Displayable:
    """A base class: a `repr` of less than 500 characters, and in a notebook the text of `print`, folded to fit."""

    __slots__ = ()

    def __repr__(self) -> str:
        of: tuple[Field[Any], ...] = fields(self) if is_dataclass(self) else ()
        values = [f"{one.name}={brief(getattr(self, one.name))}" for one in of if one.repr]
        return cut(f"{type(self).__name__}({', '.join(values)}", _MAX_REPR_LENGTH) + ")"

    def _repr_html_(self) -> str:
        return render("folded.html", text=str(self))


class Plottable(Displayable):
    """A base class of objects with a picture, which `icpmodel.study` draws."""

    __slots__ = ()

    def plot(
        self,
        path: str | os.PathLike[str] | None = None,
        *,
        ax: Any = None,
        points: Any = None,
        shape: tuple[int, ...] | None = None,
    ) -> Any:
        """Show the picture, write it to a file, or draw it into given axes; see `icpmodel.study.plot`.

        Parameters
        ----------
        path : str or path, optional
            A file to write: PNG, PDF or SVG by its suffix.
        ax : matplotlib axes, optional
            Axes to draw into, one for each panel, or one for the first panel.
        points : array_like of shape (n,), (n, 2) or (n, 3), optional
            Coordinates of the unknowns, if the picture uses them; by default those of the scene or
            grid that A is from, else row numbers.
        shape : tuple of int, optional
            Shape (ny, nx) or (nz, ny, nx) of the grid whose unknowns are numbered row by row, in
            place of `points`.

        Returns
        -------
        matplotlib.figure.Figure
            The figure.

        Raises
        ------
        InputError
            For wrong arguments.
        FileError
            Where the file cannot be written.
        """
        from ..study import plot

        return plot(self, path, ax=ax, points=points, shape=shape)


def brief(value: Any) -> str:
    """`value` in a few words: an array or a long sequence by its size, a mapping by its keys, a long text cut."""
    if isinstance(value, np.ndarray) and value.size > 1:
        return f"<{' x '.join(map(str, value.shape))} values>"
    if isinstance(value, Mapping):
        return cut(f"{{{', '.join(f'{key!r}: ...' for key in value)}}}", _MAX_FIELD_LENGTH)
    if isinstance(value, tuple | list) and (len(value) > 8 or len(repr(value)) > _MAX_FIELD_LENGTH):
        return f"<{len(value)} entries>"
    if isinstance(value, float):
        return f"{value:.6g}"
    text = repr(value)
    return cut(" ".join(text.split()), _MAX_FIELD_LENGTH)


def cut(text: str, max_length: int) -> str:
    """`text`, or its beginning and dots where it is longer than `max_length` characters."""
    return text if len(text) <= max_length else f"{text[: max_length - 3]}..."


def counted(count: int | str, noun: str) -> str:
    """`count` and the noun: 1 step, 2 steps, no steps."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def listed(items: Sequence[Any]) -> str:
    """The first few of the `items`, and how many more there are."""
    more = f" and {len(items) - _MAX_LISTED} more" if len(items) > _MAX_LISTED else ""
    return ", ".join(map(str, items[:_MAX_LISTED])) + more
