"""Rows that are certain to touch the obstacle leave the sweeps: the others go on alone, from where they are.

Where A has an H₊ certificate, an iterate bounds the distance to the solution, and rows in which p is beyond what that
allows touch the obstacle: constants for the others. See `icpmodel.reduction.certain_rows`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Vector
from ..maps import Constant
from ..problem import ICP
from ..reduction import Blocks, Mask, certain_rows, restricted, without
from ..steps import rows_of
from ..theory.certificates.h_plus import HPlusProof
from .choose import after_trial, without_trial
from .parts import Part, advance

#: from this size on rows that are certain to touch the obstacle leave the plain sweeps
_FROM = 20_000
#: what that costs in sweeps: the look, and cutting out the open rows, if it were all of them; nothing is to be found
#: before the residual has fallen to this share of the first, divided by the condition of the certificate
_LOOKING, _CUTTING, _TOO_EARLY = 10.0, 20.0, 0.05


@dataclass(frozen=True, eq=False)
class Left:
    """Plain sweeps that were left `at` a z with the residual `last` for `following`, and their `first` residual.

    >>> Left(np.ones(1), np.zeros(1), 1.0, 0.5).last
    0.5
    """

    at: Vector
    following: Vector
    first: float
    last: float


def open_rows(problem: ICP, z: Vector, share: float, needed: float) -> Blocks | None:
    """What is open once the rows leave that are certain to touch a fixed obstacle; None where it does not pay.

    Whether the certificate can be of use yet is asked of the row sums first, or of the v that the problem remembers.
    Parameters: `z` shape (n,); the `share` of the first residual that is left; how many sweeps are still `needed`.

    >>> open_rows(ICP(np.eye(3), [1.0, 1.0, -1.0]), np.zeros(3), 1e-6, 30.0) is None
    True
    """
    if problem.n < _FROM or not isinstance(problem.psi, Constant):
        return None

    def pays(rows: Mask) -> bool:
        part = float(np.mean(rows))
        return part * needed >= _LOOKING + (1.0 - part) * _CUTTING

    if not pays(z <= problem.psi.c) or not share * _condition(problem) <= _TOO_EARLY:
        return None
    closed = certain_rows(problem, z)
    return replace(without(problem, ~closed), certain=True) if pays(closed) else None


def _condition(problem: ICP) -> float:
    """max_i (|A|v)_i/(⟨A⟩v)_i of the v that `certain_rows` takes: so many times smaller than p is what it can tell."""
    rows, proof = rows_of(problem), problem._memory.get("h plus")
    with np.errstate(all="ignore"):
        own, least = rows.diagonal, rows.diagonal - rows.rest
        if isinstance(proof, HPlusProof):
            own, least = own * proof.v, proof.alpha
        return float((2.0 * own / least).max() - 1.0) if (least > 0).all() else np.inf


def go_on(found: Blocks, left: Left) -> Iterator[tuple[Vector, float | None]]:
    """The sweeps go on in the rows that are open, judged by the same first residual; at the end z stands still.

    Yields (z, Res(z)), the residual being that of the open rows: the others have none.

    >>> problem, z = ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 3.0]), np.zeros(2)
    >>> found = without(problem, np.array([True, False]))
    >>> next(go_on(found, Left(z, z, 1.0, 1.0)))
    (array([0.5, 0. ]), 0.0)
    """
    problem, (rows,) = found.problem, found.parts
    z = np.where(found.open, left.following, problem.psi.value(left.following))
    inner = restricted(problem, rows, z)
    part = Part(inner, rows, z, after_trial(inner, without_trial(inner), left.first))
    part.step()
    while not part.over:
        z = advance([part], z)
        yield z, part.residual
    while True:
        yield z, None
