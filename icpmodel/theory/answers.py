"""Three-valued answers: yes, no, or not known, each with its reason and, where there is one, a witness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..numerics.arrays import ReadOnly


@dataclass(frozen=True)
class Answer(ReadOnly):
    """The answer to a question about a problem.

    `holds` is True (proved), False (disproved) or None (not known); `reason` a sentence; `witness` what proves it, such
    as a vector or an index set, or None; `number` the figure behind it, such as a spectral radius, or None.

    >>> print(Answer(None, "n = 40 is too large for the exact test"))
    unknown: n = 40 is too large for the exact test
    """

    holds: bool | None
    reason: str
    witness: Any = None
    number: float | None = None

    def __bool__(self) -> bool:
        raise TypeError("an answer may be unknown, so it has no truth value; ask for .holds")

    def __str__(self) -> str:
        word = {True: "yes", False: "no", None: "unknown"}[self.holds]
        return f"{word}: {self.reason}"
