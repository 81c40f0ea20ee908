"""Matrix Market files of real numbers. Nothing is guessed: what is not exactly as the format says is an error.

Reference: Boisvert, Pozo and Remington, The Matrix Market exchange formats (1996), NISTIR 5935.
"""

from __future__ import annotations

import io
import os
import warnings
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import numpy as np
import scipy.sparse as sp

from ..errors import FileError
from ..numerics.arrays import Vector
from .archive import opened

_INDEX = [("i", np.int64), ("j", np.int64)]
#: a_ji of the a_ij that a file holds, i > j, as a multiple of it
_MIRRORED = {"general": 0, "symmetric": 1, "skew-symmetric": -1}


class _Header(NamedTuple):
    """What a file says it holds: `lines` of numbers, in coordinates or not, with values or all 1."""

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
    """What `path` holds; a vector of `n` entries unless that is None."""
    with opened(path) as (raw, size):
        # a number that is cut short is a number, too
        if size and (raw.seek(-1, os.SEEK_END), raw.read(1))[1] not in b"\r\n":
            raise FileError(f"{path}: its last line does not end; is the file truncated?")
        raw.seek(0)
        file = io.TextIOWrapper(raw, encoding="utf-8", errors="replace")
        header = _header(path, file)
        shape = (header.rows, header.columns)
        if n is not None and sorted(shape) != sorted((n, 1)):
            raise FileError(f"{path}: is {shape[0]} x {shape[1]}; a vector of {n} numbers ({n} x 1) was expected")
        # a line has two bytes or more, and a matrix with fewer bytes than rows is a huge one with next to no entries
        if 2 * header.lines > size or (n is None and max(shape) > size):
            found = f"its header promises {shape[0]} x {shape[1]} with {header.lines} entries"
            raise FileError(f"{path}: {found}, which do not fit into {size} bytes; is the file truncated?")
        return (_in_coordinates if header.coordinate else _in_columns)(path, header, file)


def _header(path: Path, file: TextIO) -> _Header:
    """The banner and the line with the size, between which there may be comments."""
    banner = file.readline(1000).lower().split()
    if len(banner) != 5 or banner[:2] != ["%%matrixmarket", "matrix"]:
        raise FileError(f"{path}: not a readable Matrix Market file: it does not begin with %%MatrixMarket matrix ...")
    layout, field, symmetry = banner[2:]
    if field not in ("real", "integer", "unsigned-integer", "pattern") or symmetry not in _MIRRORED:
        raise FileError(f"{path}: is {field} {symmetry}; real numbers, {', '.join(_MIRRORED)}, were expected")
    if layout not in ("array", "coordinate") or (layout, field) == ("array", "pattern"):
        raise FileError(f"{path}: is {layout} {field}; an array of numbers, or coordinates, were expected")
    line = file.readline()
    while line and (line.startswith("%") or not line.strip()):
        line = file.readline()
    words, mirrored = line.split(), _MIRRORED[symmetry]
    if len(words) != (3 if layout == "coordinate" else 2) or not all(
        word.isascii() and word.isdecimal() for word in words
    ):
        raise FileError(f"{path}: has the line {line[:80]!r} where its size was expected; is the file truncated?")
    rows, columns, *entries = map(int, words)
    if mirrored and rows != columns:
        raise FileError(f"{path}: is {rows} x {columns}, and cannot be {symmetry}")
    lines = rows * (columns + mirrored) // 2 if mirrored else rows * columns
    return _Header(layout == "coordinate", field == "pattern", mirrored, rows, columns, *(entries or [lines]))


def _numbers(path: Path, header: _Header, file: TextIO, columns: list[tuple[str, Any]]) -> np.ndarray:
    """As many lines as were promised, each with one number for each of the `columns`."""
    found = np.empty(0, columns)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # NumPy warns where there is nothing at all
            if header.lines:
                found = np.loadtxt(file, dtype=columns, comments=None, ndmin=1)
    except (ValueError, Warning) as error:
        raise FileError(f"{path}: not a readable Matrix Market file ({error})") from error
    if not header.lines and file.read().strip():
        raise FileError(f"{path}: holds more than the 0 entries that its header promises")
    if found.size != header.lines:
        raise FileError(f"{path}: holds {found.size} entries; its header promises {header.lines}; is it truncated?")
    return found


def _in_columns(path: Path, header: _Header, file: TextIO) -> np.ndarray:
    """An array, column by column; of one that is mirrored the part below the diagonal."""
    values = _numbers(path, header, file, [("a", np.float64)])["a"]
    if not header.mirrored:
        return values.reshape(header.columns, header.rows).T
    j, i = np.triu_indices(header.rows, k=header.mirrored < 0)
    array = np.zeros((header.rows, header.columns))
    array[i, j] = values
    array[j, i] = header.mirrored * values
    return array


def _in_coordinates(path: Path, header: _Header, file: TextIO) -> sp.coo_array:
    """Lines of i, j and a_ij, counted from 1; entries that are there twice are added."""
    found = _numbers(path, header, file, _INDEX if header.pattern else [*_INDEX, ("a", np.float64)])
    values = np.ones(found.size) if header.pattern else found["a"]
    i, j = found["i"] - 1, found["j"] - 1
    wrong = (i < 0) | (i >= header.rows) | (j < 0) | (j >= header.columns)
    if header.mirrored:
        wrong |= i < j + (header.mirrored < 0)
    if wrong.any():
        k, part = int(np.argmax(wrong)), ("", " on or below the diagonal", " below the diagonal")[header.mirrored]
        within = f"{header.rows} x {header.columns}{part}"
        raise FileError(f"{path}: has an entry at {i[k] + 1}, {j[k] + 1}; places within {within} were expected")
    if header.mirrored:
        again = i != j
        i, j = np.append(i, j[again]), np.append(j, i[again])
        values = np.append(values, header.mirrored * values[again])
    return sp.coo_array((values, (i, j)), shape=(header.rows, header.columns))
