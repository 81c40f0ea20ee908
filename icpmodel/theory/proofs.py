"""Proofs, made once for all problems that share A and ψ."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from weakref import WeakKeyDictionary

from ..problem.data import ProblemData
from ..problem.facts import Facts


def made_once(prove: Callable[[ProblemData], Any]) -> Callable[[ProblemData], Any]:
    """`prove`, which asks for A and ψ alone, called once for all problems that share the two."""
    known: WeakKeyDictionary[Facts, Any] = WeakKeyDictionary()

    def proved(problem: ProblemData) -> Any:
        if problem.facts not in known:
            known[problem.facts] = prove(problem)
        return known[problem.facts]

    return proved
