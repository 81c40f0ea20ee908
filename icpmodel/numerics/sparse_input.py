"""Sparse matrices that users hand in, of any format, checked before SciPy's compiled code reads their positions."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import InputError


def checked_sparse(value: Any, name: str) -> Any:
    """The sparse matrix or vector `value` with every position inside its shape.

    Parameters
    ----------
    value : sparse matrix or array
        In any of SciPy's formats. It is not changed.
    name : str
        What the error calls it.

    Returns
    -------
    sparse array
        In CSR, CSC, BSR or COO, of the numbers of `value`. It may share its arrays.

    Raises
    ------
    InputError
        Where a position lies outside the shape, or the arrays do not fit each other.

    Notes
    -----
    SciPy checks when a matrix is made, not when its arrays are changed afterwards. Its conversions then write to
    memory of others. `check_format` exists for three formats, lets some wrong ones pass, and changes its matrix.
    """
    try:
        rows, columns = (1, *value.shape)[-2:]
        if value.format in ("csr", "csc", "bsr"):
            indptr = _whole(value.indptr)
            indices = _whole(value.indices)
            data = value.data[: indptr[-1]]
            height, width = data.shape[1:] if value.format == "bsr" else (1, 1)
            if rows % height or columns % width:
                raise ValueError(f"blocks of shape {height, width} do not tile the shape {value.shape}")
            counts = (rows // height, columns // width)[:: -1 if value.format == "csc" else 1]
            _check_compressed(indptr, indices[: indptr[-1]], data.shape[0], *counts)
            return getattr(sp, f"{value.format}_array")((data, indices[: indptr[-1]], indptr), shape=value.shape)
        if value.format == "lil" and [*map(len, value.rows)] != [*map(len, value.data)]:
            raise ValueError("a row has other numbers of positions than of entries")
        value = _of_dia(value) if value.format == "dia" else value.tocoo()
        data, positions = value.data, value.coords
        positions = tuple(_whole(one) for one in positions)
        for axis, (one, most) in enumerate(zip(positions, value.shape, strict=True)):
            if one.shape != data.shape or data.ndim != 1:
                raise ValueError(f"{data.size} numbers have {one.size} positions along axis {axis}")
            _check_within(one, 0, most, f"along axis {axis} the position")
        return sp.coo_array((data, positions), shape=value.shape)
    except Exception as error:  # of arrays changed by hand any of NumPy's
        raise InputError(f"{name} is no sparse matrix, its positions do not fit its shape: {error}") from None


def is_compressed(indptr: np.ndarray, indices: np.ndarray, rows: int, columns: int) -> bool:
    """Whether these are the positions of a CSR matrix of this shape, or of a CSC matrix of the transposed shape."""
    try:
        _check_compressed(_whole(indptr), _whole(indices), indices.size, rows, columns)
    except (IndexError, ValueError):
        return False
    return True


def _of_dia(value: Any) -> Any:
    """The diagonals as COO, which SciPy reads in compiled code."""
    offsets = _whole(value.offsets)
    if value.data.shape[:-1] != offsets.shape:
        raise ValueError(f"diagonals {offsets} for data of shape {value.data.shape}; one of each was expected")
    _check_within(offsets, 1 - value.shape[0], value.shape[1], "the offset")
    column = np.tile(np.arange(value.data.shape[1]), offsets.size)
    row = column - np.repeat(offsets, value.data.shape[1])
    inside = (row >= 0) & (row < value.shape[0]) & (column < value.shape[1])
    return sp.coo_array((value.data.ravel()[inside], (row[inside], column[inside])), shape=value.shape)


def _whole(positions: Any) -> np.ndarray:
    if positions.ndim != 1 or positions.dtype.kind not in "iu":
        actual = f"positions have {positions.ndim} axes and dtype {positions.dtype}"
        raise ValueError(f"{actual}; whole numbers along one axis were expected")
    return positions.astype(np.int64) if positions.dtype.kind == "u" else positions


def _check_within(positions: np.ndarray, low: int, high: int, name: str) -> None:
    if positions.size and not low <= positions.min() <= positions.max() < high:
        invalid = positions[np.argmax((positions < low) | (positions >= high))]
        raise ValueError(f"{name} {invalid} is not one of {low} to {high - 1}")


def _check_compressed(indptr: np.ndarray, indices: np.ndarray, stored: int, major: int, minor: int) -> None:
    if indptr.size != major + 1 or indptr[0] != 0 or not indptr[-1] == indices.size == stored:
        actual = f"indptr has {indptr.size} entries, from {indptr[0]} to {indptr[-1]}"
        raise ValueError(
            f"{actual}; {major + 1} from 0 to the {stored} numbers and {indices.size} indices were expected"
        )
    if (decreasing := indptr[1:] < indptr[:-1]).any():
        raise ValueError(f"indptr falls at {np.argmax(decreasing) + 1}; it may only rise")
    _check_within(indices, 0, minor, "the index")
