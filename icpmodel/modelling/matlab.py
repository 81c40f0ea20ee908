"""MATLAB's files of variables, versions 5 to 7. Only numbers are read: no text, no structure, no function.

Everything is looked at before it is believed; SciPy's reader ends the process on some damaged files.

Reference: MathWorks, MAT-File Format.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import FileError
from ..numerics.sparse_input import is_compressed
from ..present.whole_files import told
from .archive import check_room, opened

#: the bytes before the first variable, of which the last two tell the order of bytes
_HEAD, _ORDERS = 128, {b"IM": "<", b"MI": ">"}
#: types of elements: numbers, a variable, and one that is compressed
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_MATRIX, _COMPRESSED = 14, 15
#: classes of variables: sparse, the numbers, and what all others are called
_SPARSE, _DENSE = 5, range(6, 16)
_OTHERS = {1: "a cell array", 2: "a structure", 3: "an object", 4: "a text", 16: "a function"}
_COMPLEX, _LOGICAL = 0x800, 0x200
#: a compressed element is unpacked in pieces of so many bytes, so that what does not fit is not unpacked
_PIECE = 1 << 24

#: the type of an element, and its bytes
_Element = tuple[int, memoryview]


def read_variables(path: Path) -> dict[str, Any]:
    """Name → array of real numbers or sparse matrix. Raises FileError, for what is no number, too."""
    found: dict[str, Any] = {}
    with opened(path) as (file, _), told(path, "read"):
        content = memoryview(file.read())
        order = _ORDERS.get(bytes(content[126:_HEAD]))
        if order is None or content[:6] != b"MATLAB":
            raise FileError(f"{path}: is no .mat file of the versions 5 to 7; save it with the option -v7")
        if bytes(content[124:126]) in (b"\x00\x02", b"\x02\x00"):
            raise FileError(f"{path}: is of version 7.3; save it with the option -v7")
        for kind, element in _elements(path, content[_HEAD:], order):
            inner = [(kind, element)]
            if kind == _COMPRESSED:
                inner = list(_elements(path, memoryview(_unpacked(path, element)), order))
            for one, variable in inner:
                if one != _MATRIX:
                    raise FileError(f"{path}: has an element of type {one} where a variable was expected")
                name, value = _variable(path, list(_elements(path, variable, order)), order)
                if name in found:
                    raise FileError(f"{path}: holds the variable {name} twice")
                found[name] = value
    return found


def _elements(path: Path, content: memoryview, order: str) -> Iterator[_Element]:
    """The elements one after the other, each with its type; small ones have it in the same four bytes as their size."""
    at = 0
    while at < len(content):
        kind, size = struct.unpack_from(f"{order}II", content, at) if at + 8 <= len(content) else (0, len(content))
        start, following = at + 8, at + 8 + size
        if kind >> 16:
            kind, size, start, following = kind & 0xFFFF, kind >> 16, at + 4, at + 8
        elif kind != _COMPRESSED:
            following += -size % 8
        if start + size > (following if following == at + 8 else len(content)):
            raise FileError(f"{path}: an element promises {size} bytes, which it does not have; is the file truncated?")
        yield kind, content[start : start + size]
        at = following


def _unpacked(path: Path, content: memoryview) -> bytes:
    packed, parts, total, left = zlib.decompressobj(), [], 0, bytes(content)
    while left and not packed.eof:
        parts.append(packed.decompress(left, _PIECE))
        left = packed.unconsumed_tail
        total += len(parts[-1])
        check_room(str(path), 2.0 * total)
    if not packed.eof or packed.unused_data:  # which may be the next variable
        raise FileError(f"{path}: a compressed variable does not end where it should; is the file damaged?")
    return b"".join(parts)


def _variable(path: Path, elements: list[_Element], order: str) -> tuple[str, Any]:
    """The name and the value of a variable: flags, shape and name come first, then the numbers, places before them."""
    if [kind for kind, _ in elements[:2]] != [6, 5] or len(elements) < 3 or len(elements[0][1]) != 8:
        raise FileError(f"{path}: has a variable without flags, shape and name")
    flags = struct.unpack_from(f"{order}I", elements[0][1])[0]
    shape = tuple(np.frombuffer(elements[1][1], f"{order}i4").tolist())
    name = bytes(elements[2][1]).decode("ascii", "replace")
    what, kind = f"{path}: the variable {name}", flags & 0xFF
    if kind != _SPARSE and kind not in _DENSE:
        raise FileError(f"{what} is {_OTHERS.get(kind, 'no array')}; numbers were expected")
    if flags & _COMPLEX:
        raise FileError(f"{what} is complex; real numbers were expected")
    count = 3 if kind == _SPARSE else 1
    if len(elements) != 3 + count or any(one not in _NUMBERS for one, _ in elements[3:]):
        raise FileError(f"{what} does not hold its numbers")
    types = [_NUMBERS[one] for one, _ in elements[3:]]
    if kind == _SPARSE and flags & _LOGICAL:
        types[-1] = "u1"  # whatever type is said
    parts = [np.frombuffer(data, order + one) for one, (_, data) in zip(types, elements[3:], strict=True)]
    if len(shape) != 2 or min(shape) < 0:
        raise FileError(f"{what} has shape {shape}; two axes were expected")
    if kind == _SPARSE:
        return name, _csc(what, shape, *parts)
    if math.prod(shape) != parts[0].size:
        raise FileError(f"{what} has shape {shape}, but {parts[0].size} numbers")
    # there a number is a matrix of shape (1, 1)
    return name, parts[0].reshape(() if parts[0].size == 1 else shape, order="F")


def _csc(what: str, shape: tuple[int, ...], rows: np.ndarray, starts: np.ndarray, data: np.ndarray) -> sp.csc_array:
    """A sparse matrix; there may be room for more entries than it has."""
    count = int(starts[-1]) if starts.size and rows.dtype.kind in "iu" and starts.dtype.kind in "iu" else -1
    if not 0 <= count <= min(rows.size, data.size) or not is_compressed(starts, rows[:count], shape[1], shape[0]):
        raise FileError(f"{what} is not a sparse matrix of shape {shape}")
    places = rows[:count].astype(np.int64), starts.astype(np.int64)
    return sp.csc_array((data[:count].astype(np.float64), *places), shape=shape)
