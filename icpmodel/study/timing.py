"""Timings."""

from __future__ import annotations

import os
import platform
from datetime import date

import numpy as np
from numpy.typing import NDArray

from ..numerics.arrays import as_number


def as_repeats(repeats: int) -> int:
    """How many pairs of timings: below three a median says nothing. Raises InputError."""
    return int(as_number(repeats, "repeats", least=3, whole=True))


def spread(ratios: NDArray[np.float64]) -> tuple[float, float, float]:
    """The median, the lowest and the highest of `ratios`, as tables show them."""
    return float(np.median(ratios)), float(ratios.min()), float(ratios.max())


def machine() -> str:
    """The machine, Python and today's date, for the title of a table with times."""
    return f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, {date.today()}"
