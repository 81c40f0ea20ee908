"""The labels of pandas' objects, which must agree, as entries are matched by position."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

from ..errors import InputError


def check_labels(arguments: Mapping[str, Any]) -> Any:
    """Check that pandas' objects have the same labels, and return these, or None if there are none.

    `arguments` maps argument → value. All rows and columns must have the labels of the first ones, in
    the same order: entries are matched by position. Raises InputError.
    """
    first = ""
    expected = None
    for name, value in arguments.items():
        for axis in ("index", "columns"):
            labels: Any = getattr(value, axis, None)
            if not hasattr(labels, "equals"):  # a list has a method of this name
                continue
            if expected is None:
                first = f"{name}.{axis}"
                expected = labels
            elif not labels.equals(expected):
                difference = f"{name}.{axis} has other labels than {first}, or in another order"
                advice = "bring them into one order, or give to_numpy() of each if positions count"
                raise InputError(f"{difference}; {advice}")
    return expected


def along_rows(table: Any) -> Any:
    """An object with the row labels of a `table` alone; None for a vector, which is one row."""
    return SimpleNamespace(index=getattr(table, "index", None)) if hasattr(table, "columns") else None


def along_unknowns(rows: Any) -> Any:
    """An object with the labels of the unknowns: `rows` itself if it is a vector, its columns if it is a table."""
    return SimpleNamespace(columns=rows.columns) if hasattr(rows, "columns") else rows


def parts_of(name: str, value: Any) -> dict[str, Any]:
    """The items of a list or tuple by their names in messages, such as "Q[0]"; anything else by its own `name`."""
    return {f"{name}[{k}]": one for k, one in enumerate(value)} if isinstance(value, list | tuple) else {name: value}
