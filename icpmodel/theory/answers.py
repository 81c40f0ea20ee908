"""Three-valued answers: yes, no, or not known, each with its reason and, where there is one, a witness."""

from __future__ import annotations

import math
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

from ..numerics import work
from ..numerics.arrays import ReadOnly
from ..present.display import Displayable

UNDECIDED = "not decided"  #: the first words of the reason of an answer that a limit left open


@dataclass(frozen=True, eq=False, repr=False)
class Answer(ReadOnly, Displayable):
    """The answer to a question about a problem.

    Attributes
    ----------
    holds : bool or None
        True (proved), False (disproved) or None (not known).
    reason : str
        A sentence.
    witness : optional
        The proof, such as a vector or an index set, or None.
    number : float or None
        The number that decides, such as a spectral radius.

    Examples
    --------
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


@dataclass(frozen=True)
class Allowance:
    """The work limit of one question: this number of `products` with A, each counted as `unit` nanoseconds."""

    products: float = math.inf
    unit: float = 1.0

    def enforced(self) -> AbstractContextManager[None]:
        """Limit the work in a block; beyond the limit OutOfTime is raised."""
        return work.work_limit(nanoseconds=self.products * self.unit)

    def undecided(self, error: Exception) -> str:
        """The reason of an unknown answer after `error`, which says that this limit or one of memory was exceeded."""
        if isinstance(error, MemoryError):
            return f"{UNDECIDED}: {error}"
        return f"{UNDECIDED} within {self.products:.3g} products with A"


UNLIMITED = Allowance()
