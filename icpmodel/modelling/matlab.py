"""Read MATLAB's files of variables, versions 5 to 7, by SciPy.

SciPy's reader crashes if the type of an element is damaged. So a separate process reads the file first.

Reference: MathWorks, MAT-File Format.
"""

from __future__ import annotations

import io
import math
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import FileError
from ..numerics.processes import CAN_FORK, in_a_process
from ..numerics.sparse_input import checked_sparse
from ..present.whole_files import file_errors
from .archive import REAL_KINDS, check_room, content_errors, open_to_read

#: the bytes before the first variable; the last two of them tell the byte order
_HEADER_BYTES = 128
_ORDERS = {b"IM": "<", b"MI": ">"}
#: the type of a compressed variable
_COMPRESSED = 15


def read_variables(path: Path) -> dict[str, Any]:
    """Name → array of real numbers or sparse matrix. Raises FileError, also if a variable is not numeric."""
    with open_to_read(path) as (file, _), file_errors(path, "read"):
        content = file.read()
        order = _ORDERS.get(content[126:_HEADER_BYTES])
        if order is None or content[:6] != b"MATLAB":
            raise FileError(f"{path}: is no .mat file of the versions 5 to 7; save it with the option -v7")
        if content[124:126] in (b"\x00\x02", b"\x02\x00"):
            raise FileError(f"{path}: is of version 7.3; save it with the option -v7")
        _check_room(path, content, order)
        if CAN_FORK:
            next(in_a_process(lambda: iter([list(_load(content))]), math.inf))
        variables = _load(content)
    return {name: _numbers(path, name, value) for name, value in variables.items()}


def _check_room(path: Path, content: bytes, order: str) -> None:
    """Raise FileError if a variable unpacks to more than the free memory."""
    at = _HEADER_BYTES
    while at + 8 <= len(content):
        kind, size = struct.unpack_from(f"{order}II", content, at)
        at += 8 + size
        packed = zlib.decompressobj()
        packed_bytes = content[at - size : at] if kind == _COMPRESSED else b""
        total = 0
        while packed_bytes and not packed.eof:  # in pieces of the packed size: only what fits is unpacked
            total += len(packed.decompress(packed_bytes, size))
            packed_bytes = packed.unconsumed_tail
            check_room(str(path), 2.0 * total)


def _load(content: bytes) -> dict[str, Any]:
    from scipy.io import loadmat

    variables = loadmat(io.BytesIO(content), spmatrix=False)
    return {name: value for name, value in variables.items() if not name.startswith("__")}


def _numbers(path: Path, name: str, value: Any) -> Any:
    """The variable, if it is real. A matrix with one entry becomes a number, as MATLAB has no scalars."""
    if value.dtype.kind not in REAL_KINDS:
        actual = "complex" if value.dtype.kind == "c" else f"of dtype {value.dtype}"
        raise FileError(f"{path}: the variable {name} is {actual}; real numbers were expected")
    if not sp.issparse(value):
        return value.reshape(()) if value.size == 1 else value
    with content_errors(path):
        return checked_sparse(value, f"the variable {name}").astype(np.float64)
