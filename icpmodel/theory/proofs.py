"""What is proved of A and ψ, each proof made once, when it is first asked for, for all problems that share the two."""

from __future__ import annotations

from functools import cached_property
from weakref import WeakKeyDictionary

from ..problem.data import ProblemData
from ..problem.facts import Facts
from ..problem.map import Map
from ..problem.matrix import Matrix
from .certificates import definite, h_plus, representatives, supersolution
from .matrices.classes import MatrixClasses


class Proofs:
    """The classes of `matrix`, and the proofs of uniqueness for it and ψ: each a `Proof`, or the reason why not."""

    def __init__(self, matrix: Matrix, psi: Map) -> None:
        self.matrix, self.psi = matrix, psi
        # that of a supersolution rests on q as well
        self._of_problem: WeakKeyDictionary[ProblemData, supersolution.SupersolutionProof | str] = WeakKeyDictionary()

    @cached_property
    def classes(self) -> MatrixClasses:
        """The classes of A, whatever ψ is."""
        if self.matrix not in _CLASSES:
            _CLASSES[self.matrix] = MatrixClasses(self.matrix.sparse)
        return _CLASSES[self.matrix]

    @cached_property
    def h_plus(self) -> h_plus.HPlusProof | str:
        """By a v > 0 with ⟨A⟩v > 0 and (I − G)v > 0."""
        return h_plus.prove(self.matrix, self.psi)

    @cached_property
    def representatives(self) -> representatives.RepresentativesProof | str:
        """By all choices of rows from A and I − G."""
        return representatives.prove(self.matrix, self.psi)

    @cached_property
    def definite(self) -> definite.DefiniteProof | str:
        """By the eigenvalues of Aᵀ(I − G)."""
        return definite.prove(self.matrix, self.psi)

    def supersolution(self, problem: ProblemData) -> supersolution.SupersolutionProof | str:
        """By a strict supersolution of this `problem`, which has this A and ψ."""
        if problem not in self._of_problem:
            self._of_problem[problem] = supersolution.prove(problem)
        return self._of_problem[problem]


_CLASSES: WeakKeyDictionary[Matrix, MatrixClasses] = WeakKeyDictionary()
_PROOFS: WeakKeyDictionary[Facts, Proofs] = WeakKeyDictionary()


def proofs_of(problem: ProblemData) -> Proofs:
    """The proofs that `problem` shares with all others of the same A and ψ."""
    if problem.facts not in _PROOFS:
        _PROOFS[problem.facts] = Proofs(problem.matrix, problem.psi)
    return _PROOFS[problem.facts]
