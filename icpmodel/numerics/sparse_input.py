"""Sparse matrices that users hand in, of any format, checked before SciPy's compiled code reads their positions."""

from __future__ import annotations

from copy import copy
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

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
    sparse array or matrix
        In CSR, CSC, BSR or COO, with the entries of `value`. It may share its arrays.

    Raises
    ------
    InputError
        Where a position lies outside the shape, or the arrays do not fit each other.

    Notes
    -----
    SciPy checks when a matrix is made, not when its arrays are changed afterwards. Its conversions would then write
    outside of their arrays.
    """
    try:
        return _checked(value)
    except Exception as error:  # arrays changed by hand may cause any of NumPy's
        raise InputError(f"{name} is no sparse matrix, its positions do not fit its shape: {error}") from None


def _checked(value: Any) -> Any:
    if value.format in ("csr", "csc", "bsr"):
        value = copy(value)  # `check_format` replaces the arrays
        _check_whole(value.indices, value.indptr)
        value.check_format()
        if (decreasing := value.indptr[1:] < value.indptr[:-1]).any():  # missed if the last one is 0
            raise ValueError(f"indptr falls at {np.argmax(decreasing) + 1}; it may only rise")
        return value
    if value.format == "lil" and [*map(len, value.rows)] != [*map(len, value.data)]:
        raise ValueError("a row has other numbers of positions than of entries")
    if value.format == "dia":
        if not np.all(np.abs(value.offsets) < max(value.shape)):
            raise ValueError(f"a diagonal of {value.offsets} is outside of the shape {value.shape}")
        value = sp.dia_array((value.data, value.offsets), shape=value.shape)
    entries = value.tocoo()
    _check_whole(*entries.coords)
    return sp.coo_array((entries.data, entries.coords), shape=value.shape)


def _check_whole(*positions: NDArray[Any]) -> None:
    """Raise ValueError where SciPy would truncate `positions` to whole numbers."""
    for one in positions:
        if one.dtype.kind not in "iu":
            raise ValueError(f"positions have dtype {one.dtype}; whole numbers were expected")
