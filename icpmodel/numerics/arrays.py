"""Convert what users pass to float64 vectors and CSR matrices, or say in an error why that fails; norms and views."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Iterable
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import InputError
from .sparse_input import checked_sparse

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: the largest number of entries whose positions fit into 32 bits
_SHORT = np.iinfo(np.int32).max
#: the largest float, as an integer
_LARGEST = int(np.finfo(np.float64).max)
#: the types of numbers, whole or not; and those among them that do not count as numbers, bools and times
_WHOLE = (int, np.integer)
_REAL = (int, float, np.integer, np.floating)
_NO_NUMBER = (bool, np.timedelta64)
#: the number of entries up to which BLAS uses one thread for an inner product
_ONE_THREAD_UP_TO = 10_000


def as_vector(value: Any, n: int | None, name: str, *, infinite: float | None = None) -> Vector:
    """A float64 copy of `value`, a number or of shape (n,), (n, 1) or (1, n), as a vector; `n` None for any length.

    `infinite` is the infinite value that is allowed; +inf allows −inf, too. Raises InputError.
    """
    if sp.issparse(value) and (value.ndim == 1 or 1 in value.shape):
        value = checked_sparse(value, name).toarray()
    array: Any = value if sp.issparse(value) else as_array(value, name)
    if array.ndim == 2 and 1 in array.shape:
        array = array.reshape(-1)
    if array.ndim == 0 and n is not None:
        array = np.full(n, array)
    if array.ndim != 1 or (n is not None and array.size != n):
        expected = "a vector" if n is None else f"shape ({n},)"
        raise InputError(f"{name} has shape {array.shape}; {expected} was expected")
    if array.size == 0:
        raise InputError(f"{name} is empty; at least one entry was expected")
    vector = as_float64(array, name)
    if infinite is not None:
        allowed = np.where(np.abs(vector) == np.inf if infinite == np.inf else vector == infinite, 0.0, vector)
    if actual := not_finite(vector if infinite is None else allowed, name):
        expected = "a finite number" if infinite is None else f"a finite number or {infinite}"
        raise InputError(f"{actual}; {expected} was expected")
    return vector


def as_array(value: Any, name: str) -> np.ndarray:
    """`value` as a NumPy array of any shape. Raises InputError where it is a text, None or any other object."""
    if type(value) is not np.ndarray and np.ma.is_masked(value):
        raise InputError(f"{name} has masked entries; numbers were expected in their places: see its method filled()")
    try:
        array = np.asarray(value)
    except Exception as error:  # rows of different lengths, or whatever the class of a user raises
        raise InputError(f"{name} cannot be read as an array of numbers: {error}") from error
    if array.ndim == 0 and array.dtype.kind not in "biufc":
        if callable(getattr(value, "matvec", None)):  # a LinearOperator of SciPy's, or whatever behaves like one
            raise InputError(
                f"{name} is {described(value)}, which only multiplies vectors; its entries are needed: give the array "
                "or the sparse matrix that it is made of, or, where n is small, its product with np.eye(n)"
            )
        reader = "; icpmodel.load_problem reads files" if isinstance(value, str) else ""
        raise InputError(f"{name} is {described(value)}; real numbers were expected{reader}")
    return array


def axes(value: Any, name: str) -> int:
    """How many axes `value` has, 0 for a number. Raises InputError where it is no array."""
    return int(value.ndim if sp.issparse(value) else as_array(value, name).ndim)


def described(value: Any) -> str:
    """How a message names a `value` that was not expected.

    None, texts, numbers, and lists of these are shown as they are, other values by their type.
    """
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(value, int) and abs(value) > _LARGEST:
        return "an integer of hundreds of digits"
    items = value if isinstance(value, list | tuple) else [value]
    if all(one is None or isinstance(one, str | int | float | np.number) for one in items):
        return repr(value) if items is not value else reprlib.repr(value)
    name = type(value).__name__
    return f"{'an' if name[0] in 'aeioAEIOU' or name.startswith('nd') else 'a'} {name}"


def not_finite(vector: Vector, name: str) -> str:
    """A text that names the first NaN or infinite entry of `vector`, shape (n,); empty where there is none."""
    finite = np.isfinite(vector)
    return "" if np.count_nonzero(finite) == finite.size else f"{name}[{finite.argmin()}] is {vector[finite.argmin()]}"


def as_truth(value: Any, name: str) -> bool:
    """`value`, which must be True or False: the text "no" is neither. Raises InputError."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{name} is {described(value)}; True or False was expected")
    return bool(value)


def as_list(value: Any, name: str) -> list[Any]:
    """`value` as a list of its items. A text is no list, though it has letters. Raises InputError."""
    if isinstance(value, str) or not isinstance(value, Iterable) or (isinstance(value, np.ndarray) and not value.ndim):
        raise InputError(f"{name} is {described(value)}; a list was expected")
    return list(value)


def as_number(
    value: Any,
    name: str,
    *,
    above: float = -np.inf,
    minimum: float = -np.inf,
    maximum: float = np.inf,
    below: float = np.inf,
    whole: bool = False,
) -> float:
    """`value` as a finite float (an int if `whole`), no truth value, within these bounds. Raises InputError."""
    right = isinstance(value, _WHOLE if whole else _REAL) and not isinstance(value, _NO_NUMBER)
    right = right and not (isinstance(value, int) and abs(value) > _LARGEST)
    if not (right and math.isfinite(value) and above < value < below and minimum <= value <= maximum):
        bounds = ((">", above), (">=", minimum), ("<=", maximum), ("<", below))
        condition = "".join(f" and {sign} {bound:g}" for sign, bound in bounds if np.isfinite(bound))[4:]
        kind = "whole" if whole else "finite"
        raise InputError(f"{name} is {described(value)}; a {kind} number{condition} was expected")
    return int(value) if whole else float(value)


def as_csr(value: Any, name: str, n: int | None = None, *, keep_diagonal: bool = False) -> sp.csr_array:
    """A private float64 CSR copy of the square matrix `value`: sorted, duplicates summed, 32-bit indices if they fit.

    Its arrays are read-only. `keep_diagonal` stores every diagonal entry, a zero one explicitly. Raises InputError.
    """
    if sp.issparse(value):
        _check_square(value.shape, name, n)
    else:
        value = as_square(value, name, n)
    return freeze(as_rows(value, name, keep_diagonal))


def as_rows(value: Any, name: str, keep_diagonal: bool = False) -> sp.csr_array:
    """A float64 CSR copy of the matrix `value` of any shape, dense or sparse, as `as_csr` makes it of a square one.

    Every matrix of a user passes through here, or through `as_square` if it is dense. Raises InputError.
    """
    if sp.issparse(value):
        value = checked_sparse(value, name)
        if value.dtype != np.float64:
            value.data = as_float64(value.data, name)
        matrix = sp.csr_array(value, copy=True)
        matrix.sum_duplicates()
    else:
        matrix = sp.csr_array(as_float64(value, name))
    if not np.isfinite(matrix.data).all():
        k = int(np.argmin(np.isfinite(matrix.data)))
        raise _not_finite_entry(name, row_of(matrix)[k], matrix.indices[k], matrix.data[k])
    if keep_diagonal:
        matrix.eliminate_zeros()  # as where a dense array was handed in
        matrix = _with_stored_diagonal(matrix)
    if max(matrix.nnz, *matrix.shape) < _SHORT:
        matrix.indices = matrix.indices.astype(np.int32, copy=False)
        matrix.indptr = matrix.indptr.astype(np.int32, copy=False)
    return matrix


def as_square(value: Any, name: str, n: int | None = None) -> NDArray[np.float64]:
    """A float64 copy of the dense square matrix `value`, read-only; see `as_csr`."""
    array = as_array(value, name)
    if array.ndim == 0:
        array = array.reshape(1, 1)
    _check_square(array.shape, name, n)
    square = as_float64(array, name)
    finite = np.isfinite(square)
    if np.count_nonzero(finite) < finite.size:  # on few entries several times cheaper than all()
        i, j = divmod(int(np.argmin(finite)), square.shape[0])
        raise _not_finite_entry(name, i, j, square[i, j])
    square.flags.writeable = False
    return square


def _check_square(shape: tuple[int, ...], name: str, n: int | None) -> None:
    if len(shape) != 2 or shape[0] != shape[1] or n not in (None, shape[0]):
        expected = "a square matrix" if n is None else f"shape ({n}, {n})"
        raise InputError(f"{name} has shape {shape}; {expected} was expected")
    if shape[0] == 0:
        raise InputError(f"{name} is empty; at least one row was expected")


def _not_finite_entry(name: str, i: int, j: int, entry: float) -> InputError:
    return InputError(f"{name}[{i}, {j}] is {entry}; a finite number was expected")


def inner(x: Vector, y: Vector) -> float:
    """xᵀy, both of shape (n,)."""
    # vdot does not check for overflow, as ufuncs do; for long vectors BLAS starts threads, which then spin for a while
    # on the core that a sweep could use
    return float(np.vdot(x, y) if x.size <= _ONE_THREAD_UP_TO else np.einsum("i,i", x, y))


def norm(x: Vector) -> float:
    """‖x‖₂, safe against over- and underflow of the squares; infinite or NaN where an entry is."""
    squares = inner(x, x)
    if 1e-280 < squares < 1e280:
        return math.sqrt(squares)
    largest = float(np.abs(x).max())
    if largest == 0.0 or not math.isfinite(largest):
        return largest
    x = x / largest
    return largest * math.sqrt(inner(x, x))


def largest_size(*arrays: Vector) -> float:
    """The largest finite absolute value in the `arrays`; 1 where that is 0."""
    values = np.concatenate(arrays)
    return float(np.abs(values[np.isfinite(values)]).max(initial=0.0)) or 1.0


class ReadOnly:
    """Base of immutable objects: their arrays are read-only, also in copies and in the processes they are sent to."""

    def __post_init__(self) -> None:
        self.lock()

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.lock()

    def lock(self) -> None:
        """Make the arrays and the CSR matrices among the attributes read-only."""
        for value in vars(self).values():
            locked(value)


def read_only(value: Any) -> Any:
    """Read-only C-contiguous views of the arrays in `value`: a compiled loop sees one type, and is compiled once.

    Parameters
    ----------
    value : array or tuple
        Arrays, and tuples of them; anything else is returned as it is.
    """
    if isinstance(value, tuple):
        parts = [read_only(one) for one in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    if isinstance(value, np.ndarray) and (value.flags.writeable or not value.flags.c_contiguous):
        value = np.ascontiguousarray(value).view()
        value.flags.writeable = False
    return value


def locked(value: Any) -> Any:
    """Make `value` read-only if it is an array, a CSR matrix or a tuple of these, and return it."""
    for one in value if isinstance(value, tuple) else (value,):
        if isinstance(one, np.ndarray):
            one.flags.writeable = False
        elif type(one) is sp.csr_array:  # isinstance is slow where a class has abstract bases
            freeze(one)
    return value


def freeze(matrix: sp.csr_array) -> sp.csr_array:
    """Make the three arrays of a CSR matrix read-only, and return it."""
    locked((matrix.data, matrix.indices, matrix.indptr))
    return matrix


def row_of(matrix: sp.csr_array) -> NDArray[np.int64]:
    """The row of each stored entry of a CSR matrix, shape (nnz,)."""
    return np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))


def with_entries(matrix: sp.csr_array, entries: Any) -> sp.csr_array:
    """The CSR matrix with the pattern of `matrix`, whose index arrays it shares, and these `entries`, shape (nnz,)."""
    return sp.csr_array((entries, matrix.indices, matrix.indptr), shape=matrix.shape)


def _with_stored_diagonal(matrix: sp.csr_array) -> sp.csr_array:
    """`matrix`, which is sorted and stores no zeros, with stored zeros where diagonal entries are missing."""
    missing = np.flatnonzero(matrix.diagonal() == 0.0)
    if not missing.size:
        return matrix
    rows = np.append(row_of(matrix), missing)
    columns = np.append(matrix.indices, missing)
    return sp.csr_array((np.append(matrix.data, np.zeros(missing.size)), (rows, columns)), shape=matrix.shape)


def as_float64(value: Any, name: str) -> NDArray[np.float64]:
    """A float64 copy of the array `value` of any shape.

    Raises InputError where an entry is no real number, or has a wider type and would be rounded.
    """
    array = as_array(value, name)
    kind = array.dtype.kind
    if kind == "c":
        raise InputError(f"{name} is complex ({array.dtype}); real numbers were expected: ICP is stated over the reals")
    if kind not in "biuf":
        raise InputError(f"{name} has dtype {array.dtype}; real numbers were expected")
    with np.errstate(over="ignore"):
        converted = np.array(array, dtype=np.float64, order="C")
    if array.dtype.itemsize > (converted.itemsize if kind == "f" else 4):
        doubtful = array == array if kind == "f" else np.spacing(np.abs(converted)) > 1.0
        for one, rounded in zip(array[doubtful].tolist(), converted[doubtful].tolist(), strict=True):
            if one != rounded:
                actual = f"{name} holds {one} of dtype {array.dtype}, which rounds to the float64 {rounded}"
                raise InputError(f"{actual}; write {name}.astype(float) if that is intended")
    return converted
