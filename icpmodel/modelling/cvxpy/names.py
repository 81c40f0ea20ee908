"""What messages call the expressions of a model, and their entries."""

from __future__ import annotations

import re
import textwrap

import cvxpy as cp
import numpy as np

#: constants with more entries than this are not printed
_PRINTED = 20


def named(expression: cp.Expression) -> str:
    """What a message calls `expression`: its label, else its text where that is short enough.

    >>> x = cp.Variable(2, name="x")
    >>> named(x + 1), named(np.ones(1000) @ cp.Variable(1000, name="y"))
    ('x + 1.0', 'an expression of shape () in y')
    """
    if expression.label is None and any(constant.size > _PRINTED for constant in expression.constants()):
        names = ", ".join(x.name() for x in expression.variables())
        return f"an expression of shape {expression.shape}" + (f" in {names}" if names else "")
    text = re.sub(r"Promote\(([^()]*), \([\d, ]*\)\)", r"\1", expression.format_labeled())
    return textwrap.shorten(text, 80, placeholder=" ...")


def entry(x: cp.Expression, k: int) -> str:
    """Where the `k`-th number of `x` stands; nothing where it is the only one."""
    if x.size == 1:
        return ""
    index = np.unravel_index(k, x.shape, order="F")
    return f" in entry [{', '.join(str(int(i)) for i in index)}]"
