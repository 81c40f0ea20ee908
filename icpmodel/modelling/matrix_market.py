"""Matrix Market files of real numbers, whole or in parts. What is not exactly as the format says is an error.

SciPy's reader takes 1,5 for 1, leaves out what follows on a line, and reads no parts.

Reference: Boisvert, Pozo and Remington, The Matrix Market exchange formats (1996), NISTIR 5935.
"""

from __future__ import annotations

import io
import os
import warnings
from collections.abc import Callable, Iterable
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import FileError
from ..numerics.arrays import Vector
from .archive import opened

_INDEX: list[tuple[str, Any]] = [("i", np.int64), ("j", np.int64)]
Places = NDArray[np.int64]
#: a_ji of the a_ij that a file holds, i > j, as a multiple of it
_MIRRORED = {"general": 0, "symmetric": 1, "skew-symmetric": -1}


class MarketHead(NamedTuple):
    """The header of a file: `lines` of numbers, in coordinates or not, with values or all 1."""

    coordinate: bool
    pattern: bool
    mirrored: int
    rows: int
    columns: int
    lines: int


def read_matrix(path: Path) -> Any:
    """The matrix in a Matrix Market file, sparse if it is in coordinates, else dense. Raises FileError."""
    return _read(path, None)


def read_vector(path: Path, n: int) -> Vector:
    """A vector, shape (n,), from a Matrix Market file of n × 1 or 1 × n. Raises FileError."""
    matrix = _read(path, n)
    return np.asarray(matrix.toarray() if sp.issparse(matrix) else matrix).reshape(-1)


def _read(path: Path, n: int | None) -> Any:
    """The content of `path`; a vector of `n` entries unless that is None."""
    with opened(path) as (raw, size):
        check_end(path, raw, size)
        file = io.TextIOWrapper(raw, encoding="utf-8", errors="replace")
        head = market_head(path, file.readline, size, n)
        numbers = numbers_of(path, head, file)
        check_count(path, head, numbers.size)
        i, j, values = entries_of(path, head, numbers)
        if head.coordinate:
            return sp.coo_array((values, (i, j)), shape=(head.rows, head.columns))
        array = np.zeros((head.rows, head.columns))
        array[i, j] = values
        return array


def check_end(path: Path, raw: BinaryIO, size: int) -> None:
    """Raise FileError unless the last line ends: a number that is cut short is a number, too."""
    if size and (raw.seek(-1, os.SEEK_END), raw.read(1))[1] not in b"\r\n":
        raise FileError(f"{path}: its last line does not end; is the file truncated?")
    raw.seek(0)


def market_head(path: Path, readline: Callable[..., str], size: int, n: int | None) -> MarketHead:
    """Read the banner, comments and the line with the size of a file of `size` bytes.

    It is to hold a vector of `n` entries unless that is None. Raises FileError.
    """
    banner = readline(1000).lower().split()
    if len(banner) != 5 or banner[:2] != ["%%matrixmarket", "matrix"]:
        raise FileError(f"{path}: not a readable Matrix Market file: it does not begin with %%MatrixMarket matrix ...")
    layout, field, symmetry = banner[2:]
    if field not in ("real", "integer", "unsigned-integer", "pattern") or symmetry not in _MIRRORED:
        raise FileError(f"{path}: is {field} {symmetry}; real numbers, {', '.join(_MIRRORED)}, were expected")
    if layout not in ("array", "coordinate") or (layout, field) == ("array", "pattern"):
        raise FileError(f"{path}: is {layout} {field}; an array of numbers, or coordinates, were expected")
    line = readline()
    while line and (line.startswith("%") or not line.strip()):
        line = readline()
    words, mirrored = line.split(), _MIRRORED[symmetry]
    are_numbers = all(word.isascii() and word.isdecimal() for word in words)
    if len(words) != (3 if layout == "coordinate" else 2) or not are_numbers:
        raise FileError(f"{path}: has the line {line[:80]!r} where its size was expected; is the file truncated?")
    rows, columns, *entries = map(int, words)
    if mirrored and rows != columns:
        raise FileError(f"{path}: is {rows} x {columns}, and cannot be {symmetry}")
    if n is not None and sorted((rows, columns)) != sorted((n, 1)):
        raise FileError(f"{path}: is {rows} x {columns}; a vector of {n} numbers ({n} x 1) was expected")
    lines = entries[0] if entries else rows * (columns + mirrored) // 2 if mirrored else rows * columns
    # a line has two bytes or more, and a matrix with fewer bytes than rows is a huge one with next to no entries
    if 2 * lines > size or (n is None and max(rows, columns) > size):
        actual = f"its header promises {rows} x {columns} with {lines} entries"
        raise FileError(f"{path}: {actual}, which do not fit into {size} bytes; is the file truncated?")
    return MarketHead(layout == "coordinate", field == "pattern", mirrored, rows, columns, lines)


def numbers_of(path: Path, head: MarketHead, lines: Iterable[Any]) -> np.ndarray:
    """The numbers in each of the `lines` that is not empty: i, j and a, as far as the header says. Raises FileError."""
    columns = [] if not head.coordinate else _INDEX
    columns = columns if head.pattern else [*columns, ("a", np.float64)]
    lines = iter(lines)
    first = next((line for line in lines if line.strip()), None)
    if first is None:
        return np.empty(0, columns)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            numbers: np.ndarray = np.loadtxt(chain([first], lines), dtype=columns, comments=None, ndmin=1)
    except (ValueError, Warning) as error:
        raise FileError(f"{path}: not a readable Matrix Market file ({error})") from error
    return numbers


def check_count(path: Path, head: MarketHead, count: int) -> None:
    """Raise FileError unless the file has as many entries as it says."""
    if count != head.lines:
        raise FileError(f"{path}: holds {count} entries; its header promises {head.lines}; is it truncated?")


def entries_of(path: Path, head: MarketHead, numbers: np.ndarray, before: int = 0) -> tuple[Places, Places, Vector]:
    """i, j and a_ij, counted from 0, of the lines `numbers` after so many lines `before`, with mirrored ones.

    Entries that are there twice are to be added. Raises FileError.
    """
    values = np.ones(numbers.size) if head.pattern else numbers["a"]
    i, j = (numbers["i"] - 1, numbers["j"] - 1) if head.coordinate else _positions(head, numbers.size, before)
    wrong = (i < 0) | (i >= head.rows) | (j < 0) | (j >= head.columns)
    if head.mirrored:
        wrong |= i < j + (head.mirrored < 0)
    if wrong.any():
        k, part = int(np.argmax(wrong)), ("", " on or below the diagonal", " below the diagonal")[head.mirrored]
        within = f"{head.rows} x {head.columns}{part}"
        raise FileError(f"{path}: has an entry at {i[k] + 1}, {j[k] + 1}; places within {within} were expected")
    if head.mirrored:
        again = i != j
        i, j = np.append(i, j[again]), np.append(j, i[again])
        values = np.append(values, head.mirrored * values[again])
    return i, j, values


def _positions(head: MarketHead, count: int, before: int) -> tuple[Places, Places]:
    """Where `count` numbers of an array stand, column by column, after so many `before`."""
    k = np.arange(before, before + count)
    if not head.mirrored:
        return k % head.rows, k // head.rows
    first = np.arange(head.rows) + (head.mirrored < 0)  # the row at which a column begins
    begin = np.r_[0, np.cumsum(head.rows - first)]
    j = np.searchsorted(begin, k, side="right") - 1
    return k - begin[j] + first[j], j
