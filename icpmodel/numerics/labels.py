"""The labels of pandas' objects, which must agree where numbers are taken by their place."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

from ..errors import InputError


def check_labels(arguments: Mapping[str, Any]) -> Any:
    """The labels of pandas' objects, None without any; raises InputError where they differ.

    `arguments` maps argument → value. Rows and columns must have the labels, in the order, of the rows
    of the first object: numbers are taken by their place.
    """
    first = ""
    expected = None
    for name, value in arguments.items():
        for axis in ("index", "columns"):
            labels = getattr(value, axis, None)
            if labels is None or callable(labels):  # a list has a method of this name
                continue
            if expected is None:
                first = f"{name}.{axis}"
                expected = labels
            elif not labels.equals(expected):
                difference = f"{name}.{axis} has other labels than {first}, or in another order"
                advice = f"bring them into one order, or give {name}.to_numpy() if positions count"
                raise InputError(f"{difference}; {advice}")
    return expected


def along(table: Any, axis: str) -> Any:
    """An object with the labels of one `axis` of a `table`, "index" or "columns", alone."""
    return SimpleNamespace(**{axis: getattr(table, axis, None)})


def along_unknowns(rows: Any) -> Any:
    """An object with the labels of the unknowns of one vector, or of `rows` of a table with one for each problem."""
    return along(rows, "columns") if hasattr(rows, "columns") else rows
