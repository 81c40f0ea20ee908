"""Rounding in a proved direction: matrix–vector products, and numbers in sentences that say "<=" or ">="."""

from __future__ import annotations

import math
import warnings
from decimal import ROUND_CEILING, Context, Decimal
from functools import wraps
from typing import Any, cast

import numpy as np
import scipy.sparse as sp

from ..errors import Call, check_arguments
from .arrays import Vector
from .sparse_structure import absolute

#: unit roundoff of float64
UNIT_ROUNDOFF = float(np.finfo(np.float64).epsneg)
#: √ε, half of the digits of float64
SQRT_EPSILON = math.sqrt(np.finfo(np.float64).eps)
#: products of at least this size lose less to underflow than to rounding, and their error is a float
MIN_EXACT_PRODUCT = float(np.finfo(np.float64).tiny) / UNIT_ROUNDOFF
#: the smallest positive float64, the most that underflow can cost one operation
SMALLEST = math.ulp(0.0)
_FLUSHED = (
    "this thread flushes subnormal numbers to zero (libraries compiled with -ffast-math set that mode): errors and "
    "bounds below 2.2e-308 are not certain; unset it, for example by loading that library in another process"
)


#: the errors that Ctrl-C causes in code compiled by numba, and in compiled modules while they are imported
CTRL_C = SystemError, ImportError


def public_entry(function: Call) -> Call:
    """Decorator of public functions: `check_arguments`, NumPy's default floating-point errors, Ctrl-C in compiled code.

    Ctrl-C there raises KeyboardInterrupt. The function warns where the processor flushes numbers below 2.2e-308 to
    zero, as some libraries make it do. Proofs rely on gradual underflow.
    """
    function = check_arguments(function)

    @wraps(function)
    @np.errstate(divide="warn", over="warn", under="ignore", invalid="warn")
    def inner(*args: Any, **options: Any) -> Any:
        if SMALLEST * 1.0 == 0.0:
            warnings.warn(_FLUSHED, RuntimeWarning, stacklevel=2)
        try:
            return function(*args, **options)
        except CTRL_C as error:
            if is_ctrl_c(error):
                raise KeyboardInterrupt from error
            raise

    return cast(Call, inner)


def is_ctrl_c(error: BaseException | None) -> bool:
    """Whether `error` comes from a Ctrl-C in compiled code, in numba or during an import."""
    while isinstance(error, CTRL_C):
        error = error.__cause__
    return isinstance(error, KeyboardInterrupt)


def gamma(k: Any) -> Any:
    """γ_k = ku/(1 − ku), u = 2⁻⁵³: bounds the relative error of k successive operations."""
    return k * UNIT_ROUNDOFF / (1 - k * UNIT_ROUNDOFF)


def terms_of(matrix: Any) -> Any:
    """How many terms a product with a CSR or dense `matrix` has in each row."""
    return np.diff(matrix.indptr) if sp.issparse(matrix) else matrix.shape[1]


def product_lower_bound(matrix: sp.csr_array, v: Vector, size: Vector | None = None) -> Vector:
    """A lower bound of `matrix` @ `v`, entry by entry, whatever the order of summation; NaN or −inf where it overflows.

    The computed product minus 2ku|matrix||v|, which covers γ_k and the rounding of |matrix||v|, and k times the
    smallest float; k is the number of entries of the row plus 2. `size` is |matrix||v|, where it is known.
    Reference: Higham, Accuracy and Stability of Numerical Algorithms (2002), section 3.5.
    """
    k = terms_of(matrix) + 2
    with np.errstate(over="ignore", invalid="ignore"):
        size = absolute(matrix) @ np.abs(v) if size is None else size
        return np.asarray(matrix @ v - 2 * k * UNIT_ROUNDOFF * size - k * SMALLEST)


def product_upper_bound(matrix: sp.csr_array, v: Vector) -> Vector:
    """An upper bound of `matrix` @ `v`, entry by entry, shape (n,): the mirror image of `product_lower_bound`."""
    return -product_lower_bound(matrix, -v)


def rounded_share(x: Any, share: float) -> Any:
    """`share`·x minus the smallest float, at least 0: a limit that holds in spite of underflow; x may be an array."""
    return np.maximum(share * x - SMALLEST, 0.0)


def rounded_up(x: float, digits: int = 3, below: float = math.inf) -> str:
    """`x` as text, rounded up to `digits` digits, or to more if `x` < `below` and the rounded number is not."""
    if not math.isfinite(x):
        return f"{x:g}"
    exact = Context(prec=digits, rounding=ROUND_CEILING).create_decimal(Decimal(float(x)))
    text = f"{float(exact):.{digits}g}"
    if Decimal(text) != exact:  # the float next to it says something else: near underflow, or with all its digits
        text = str(exact).lower()
    return rounded_up(x, digits + 1, below) if float(text) >= below > x else text


def rounded_down(x: float, digits: int = 3) -> str:
    """`x` as text that is never above it: the mirror image of `rounded_up`."""
    text = rounded_up(-x, digits)
    return text[1:] if text.startswith("-") else text if float(text) == 0 else f"-{text}"
