"""How much fits beside each other where texts are printed."""

from __future__ import annotations

import shutil
import sys


def width(otherwise: int) -> int:
    """The columns of the terminal that standard output is; `otherwise` where it is none, such as a file or a pipe."""
    if sys.stdout is None or not sys.stdout.isatty():
        return otherwise
    return max(shutil.get_terminal_size().columns, 40)
