"""Facts about the solutions of a problem whose solution is not proved to be unique.

**What all solutions share.** Let xᵀAx ≥ 0 for all x and the obstacles be fixed, one or two. Two
solutions y and z have (y − z)_i(p(y) − p(z))_i ≤ 0 in every row. So (y − z)ᵀA(y − z) = 0, the
minimum of a convex quadratic form, where its gradient vanishes: (A + Aᵀ)(y − z) = 0. Hence
(A + Aᵀ)z is the same in all solutions, and so is p if A is symmetric.

**How z may move.** With constant and affine obstacles the solutions that have the active set of z
are a polyhedron. Its directions are computed and its signs checked in rational arithmetic.

References
----------
Cottle, Pang and Stone, The Linear Complementarity Problem (1992), chapter 3.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..algebra.equations import Pattern
from ..algebra.linear_rows import RowEquation, has_linear_pieces
from ..numerics.arrays import Vector
from ..problem.data import ProblemData
from .certificates.bounds import enumerated_proof
from .certificates.enumerated import Disproof, EnumeratedProof
from .matrices.classes import MatrixClasses
from .matrices.definiteness import RATIONAL_UP_TO
from .solution_set import ExactRows, Face, listed


def solution_facts(problem: ProblemData, classes: MatrixClasses, z: Vector | None = None) -> Iterator[str]:
    """Sentences on all solutions of `problem` and, if a solution `z` is given, on those near it.

    Parameters
    ----------
    problem : ProblemData
        The problem.
    classes : MatrixClasses
        The classes of A.
    z : array of shape (n,), optional
        A solution.

    Yields
    ------
    str
        A proved statement.

    Examples
    --------
    >>> problem = ICP([[1, 1], [1, 1]], [-2, -2])
    >>> for sentence in solution_facts(problem, icp.theory.classify(problem.A), np.ones(2)):
    ...     print(sentence)
    p = Az + q is the same in all solutions: A is symmetric and positive semidefinite
    z may move along (-1, 1) without leaving the solutions, as far as no sign changes
    """
    if problem.f is not None:  # the classes of A say nothing of f
        return
    if problem.facts.has_fixed_obstacle and classes.semidefinite.holds:
        if classes.symmetric.holds:
            yield "p = Az + q is the same in all solutions: A is symmetric and positive semidefinite"
        else:
            yield "(A + A')z is the same in all solutions: A is monotone (x'Ax >= 0 for all x)"
    face = None if z is None else face_at(problem, z)
    if face is not None:
        along = ", ".join(listed(direction) for direction in face.directions)
        yield f"z may move along {along} without leaving the solutions, as far as no sign changes"
    elif has_linear_pieces(problem):
        proof = enumerated_proof(problem)
        if isinstance(proof, Disproof):
            yield proof
        elif isinstance(proof, EnumeratedProof):
            yield proof.sentence


def face_at(problem: ProblemData, z: Vector) -> Face | None:
    """The face of solutions with the active set of `z`; None if they are isolated or this is not known.

    Examples
    --------
    >>> face_at(ICP([[1, 1], [1, 1]], [-2, -2]), np.ones(2)).directions
    array([[-1.,  1.]])
    """
    if problem.f is not None or problem.n > RATIONAL_UP_TO or not has_linear_pieces(problem):
        return None
    pattern = Pattern.at(problem, z)
    sides = np.where(pattern.active, RowEquation.LOWER, RowEquation.FREE)
    if pattern.above is not None:
        sides[pattern.above] = RowEquation.UPPER
    face = ExactRows(problem).solve(sides)
    return face.rounded() if face is not None and face.directions else None
