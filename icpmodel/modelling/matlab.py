"""MATLAB's files of variables, versions 5 to 7: checked here, then read by SciPy.

SciPy's reader ends the process where the type of an element is damaged. So all elements are gone through before.

Reference: MathWorks, MAT-File Format.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import FileError
from ..numerics.sparse_input import checked_sparse
from ..present.whole_files import file_errors
from .archive import REAL, check_room, content_errors, opened

#: the bytes before the first variable; the last two of them tell the byte order
_HEADER_BYTES = 128
_ORDERS = {b"IM": "<", b"MI": ">"}
#: types of elements: numbers, a variable, and one that is compressed
_NUMBERS = {1, 2, 3, 4, 5, 6, 7, 9, 12, 13}
_MATRIX = 14
_COMPRESSED = 15
#: a variable of numbers begins with its flags, its shape and its name
_BEGINS = [6, 5, 1]
#: classes of variables: sparse matrices and numbers
_CLASSES = range(5, 16)
#: a compressed element is unpacked in pieces of so many bytes, so that what does not fit is not unpacked
_PIECE_BYTES = 1 << 24

#: the type of an element, and its bytes
_Element = tuple[int, memoryview]


def read_variables(path: Path) -> dict[str, Any]:
    """Name → array of real numbers or sparse matrix. Raises FileError, for what is no number, too."""
    from scipy.io import loadmat

    with opened(path) as (file, _), file_errors(path, "read"):
        content = memoryview(file.read())
        order = _ORDERS.get(bytes(content[126:_HEADER_BYTES]))
        if order is None or content[:6] != b"MATLAB":
            raise FileError(f"{path}: is no .mat file of the versions 5 to 7; save it with the option -v7")
        if bytes(content[124:126]) in (b"\x00\x02", b"\x02\x00"):
            raise FileError(f"{path}: is of version 7.3; save it with the option -v7")
        for kind, element in _elements(path, content[_HEADER_BYTES:], order):
            if kind == _COMPRESSED:
                inner = list(_elements(path, memoryview(_unpacked(path, element)), order))
            else:
                inner = [(kind, element)]
            for one in inner:
                _check_variable(path, one, order)
        content_by_name = loadmat(io.BytesIO(content), spmatrix=False)
    return {name: _numbers(path, name, value) for name, value in content_by_name.items() if not name.startswith("__")}


def _elements(path: Path, content: memoryview, order: str) -> Iterator[_Element]:
    """The elements one after the other, each with its type; small ones have it in the same four bytes as their size."""
    at = 0
    while at < len(content):
        kind, size = struct.unpack_from(f"{order}II", content, at) if at + 8 <= len(content) else (0, len(content))
        start = at + 8
        following = start + size
        if kind >> 16:
            kind, size = kind & 0xFFFF, kind >> 16
            start = at + 4
            following = at + 8
        elif kind != _COMPRESSED:
            following += -size % 8
        if start + size > (following if following == at + 8 else len(content)):
            raise FileError(f"{path}: an element promises {size} bytes, which it does not have; is the file truncated?")
        yield kind, content[start : start + size]
        at = following


def _unpacked(path: Path, content: memoryview) -> bytes:
    packed = zlib.decompressobj()
    parts = []
    total = 0
    left = bytes(content)
    while left and not packed.eof:
        parts.append(packed.decompress(left, _PIECE_BYTES))
        left = packed.unconsumed_tail
        total += len(parts[-1])
        check_room(str(path), 2.0 * total)
    if not packed.eof or packed.unused_data:  # which may be the next variable
        raise FileError(f"{path}: a compressed variable does not end where it should; is the file damaged?")
    return b"".join(parts)


def _check_variable(path: Path, element: _Element, order: str) -> None:
    """Raise FileError unless the `element` is a variable of numbers, whose own elements have known types."""
    kind, variable = element
    parts = list(_elements(path, variable, order)) if kind == _MATRIX else []
    if [one for one, _ in parts[:3]] != _BEGINS or len(parts[0][1]) != 8 or len(parts[1][1]) != 8:
        raise FileError(f"{path}: has a variable without flags, two axes and a name")
    name = bytes(parts[2][1]).decode("ascii", "replace")
    if struct.unpack_from(f"{order}I", parts[0][1])[0] & 0xFF not in _CLASSES:
        raise FileError(f"{path}: the variable {name} is no array; numbers were expected")
    if not parts[3:] or any(one not in _NUMBERS for one, _ in parts[3:]):
        raise FileError(f"{path}: the variable {name} does not hold its numbers; is the file damaged?")


def _numbers(path: Path, name: str, value: Any) -> Any:
    """The variable; one of shape (1, 1) is a number, as MATLAB has no others."""
    if value.dtype.kind not in REAL:
        actual = "complex" if value.dtype.kind == "c" else f"of dtype {value.dtype}"
        raise FileError(f"{path}: the variable {name} is {actual}; real numbers were expected")
    if not sp.issparse(value):
        return value.reshape(()) if value.size == 1 else value
    with content_errors(path):
        return checked_sparse(value, f"the variable {name}").astype(np.float64)
