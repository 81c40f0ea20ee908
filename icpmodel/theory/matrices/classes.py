"""The matrix classes of A on which theorems about complementarity problems rest, each decided when first needed."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import OutOfTime, check_arguments
from ...numerics import work
from ...numerics.arrays import ReadOnly, as_csr
from ...numerics.sparse_structure import bandwidths
from ...present.display import Displayable
from ..answers import Allowance, Answer
from .comparison_matrix import comparison_matrix, positive_diagonal, z_matrix
from .definiteness import definiteness, semidefinite_up_to_rounding
from .h_matrix import decide, h_matrix, irreducible_blocks, row_sum_signs, without_zeros
from .p_matrix import MAX_BLOCK_SIZE, by_pivots, minor_of_order_two, open_blocks

#: the classes in the order of the table, with their names
CLASS_NAMES = {
    "symmetric": "symmetric",
    "triangular": "triangular",
    "banded": "banded",
    "reducible": "reducible",
    "dominant": "strictly diagonally dominant",
    "z": "Z-matrix",
    "m": "M-matrix",
    "h_plus": "H+-matrix",
    "definite": "positive definite",
    "semidefinite": "positive semidefinite",
    "p": "P-matrix",
}

#: those that depend on others come last
_BASIC_FIRST = sorted(CLASS_NAMES, key=lambda name: name in ("m", "definite", "semidefinite", "p"))


@check_arguments
def classify(A: Any) -> MatrixClasses:
    """The classes of a matrix.

    Parameters
    ----------
    A : array_like or sparse matrix of shape (n, n)
        The matrix.

    Returns
    -------
    MatrixClasses
        The classes, each with its proof.

    Raises
    ------
    InputError
        Where `A` is no square matrix of numbers.

    References
    ----------
    Cottle, Pang and Stone, The Linear Complementarity Problem (1992), chapter 3.

    Examples
    --------
    >>> classes = classify([[2.0, -1.0], [-1.0, 2.0]])
    >>> print(classes.m)
    yes: Z-matrix and H+-matrix
    """
    return MatrixClasses(as_csr(A, "A", keep_diagonal=True))


@check_arguments
def p_matrix(A: Any) -> Answer:
    """Whether `A` is a P-matrix.

    Parameters
    ----------
    A : array_like or sparse matrix of shape (n, n)
        The matrix.

    Returns
    -------
    Answer
        The witness of False is the index set, an array, of a principal minor ≤ 0; None where the
        reason is the proof.

    Raises
    ------
    InputError
        Where A is no square matrix of finite numbers.

    References
    ----------
    `icpmodel.theory.matrices.p_matrix`.

    Examples
    --------
    >>> p_matrix([[1, 0, 2], [2, 1, 0], [0, 2, 1]]).holds
    True
    >>> (
    ...     p_matrix([[1, 0, -2], [2, 1, 0], [0, -2, 1]]).witness,
    ...     p_matrix([[1, 2], [2, 1]]).witness,
    ... )
    (None, array([0, 1]))
    """
    return classify(A).p


@check_arguments
class MatrixClasses(ReadOnly, Displayable):
    """Three-valued answers about a matrix; see `classify`.

    Each is computed when it is first asked for; `print` asks for all. Yes and no are proved, rounding
    included.

    Parameters
    ----------
    A : csr_array of shape (n, n)
        The matrix, with every diagonal entry stored.

    Examples
    --------
    >>> MatrixClasses(as_csr([[1.0, 2.0], [0.0, 1.0]], "A")).triangular.witness
    'upper'
    """

    def __init__(self, A: sp.csr_array) -> None:
        self.A = A

    def decided(self, limit: Allowance) -> MatrixClasses:
        """A copy with every answer computed within a limit; answers that do not depend on it are kept here too.

        Parameters
        ----------
        limit : Allowance
            The limit of each answer, which is unknown if it exceeds the limit.

        Returns
        -------
        MatrixClasses
            The copy.
        """
        classes = MatrixClasses(self.A)
        all_known = True
        vars(classes).update(vars(self))
        for name in _BASIC_FIRST:
            try:
                with limit.enforced():
                    answer = getattr(classes, name)
                if all_known or answer.holds is not None:  # an unknown answer may follow from one that the limit cut
                    vars(self)[name] = answer
            except (OutOfTime, MemoryError) as error:
                all_known = False
                vars(classes)[name] = unknown = Answer(None, limit.undecided(error))
                if name == "h_plus":  # answers that depend on it do not compute it again
                    vars(classes)["h"] = unknown
                if name == "definite":
                    vars(classes)["_definiteness"] = unknown, unknown
        return classes

    def __str__(self) -> str:
        return "\n".join(f"{title:<29} {getattr(self, name)}" for name, title in CLASS_NAMES.items())

    def __repr__(self) -> str:
        return f"MatrixClasses(A with shape {self.A.shape}, nnz={self.A.nnz})"

    @cached_property
    def z(self) -> Answer:
        """Z-matrix: no entry off the diagonal is positive. Witness of no: (i, j) with a_ij > 0."""
        return z_matrix(self.A)

    @cached_property
    def m(self) -> Answer:
        """Nonsingular M-matrix: a Z-matrix with A⁻¹ ≥ 0, that is Z and H₊. Witnesses: those of `z` and `h_plus`."""
        if not self.z.holds:
            return Answer(False, f"no Z-matrix: {self.z.reason}", self.z.witness)
        h_plus = self.h_plus
        return Answer(h_plus.holds, "Z-matrix and H+-matrix" if h_plus.holds else h_plus.reason, h_plus.witness)

    @cached_property
    def h(self) -> Answer:
        """H-matrix: ⟨A⟩ is a nonsingular M-matrix.

        Witness of yes, where there is one: v > 0 with ⟨A⟩v > 0; of no: x ≥ 0, x ≠ 0, with ⟨A⟩x ≤ 0.
        """
        return Answer(True, "v = 1", self.dominant.witness) if self.dominant.holds else h_matrix(self.A)

    @cached_property
    def h_plus(self) -> Answer:
        """H-matrix with positive diagonal. Witness of no: a row with a_ii ≤ 0, or x as for `h`."""
        if not (positive := positive_diagonal(self.A)).holds:
            return positive
        return Answer(self.h.holds, ("D > 0; " if self.h.holds else "") + self.h.reason, self.h.witness)

    @cached_property
    def dominant(self) -> Answer:
        """Strictly diagonally dominant by rows: |a_ii| > Σ_{j≠i} |a_ij|. Witness of yes: v = 1; of no: a row."""
        low = row_sum_signs(comparison_matrix(self.A)) <= 0
        if not low.any():
            return Answer(True, "|a_ii| > sum of the other |a_ij| in every row", np.ones(self.A.shape[0]))
        i = int(np.argmax(low))
        return Answer(False, f"|a_ii| <= sum of the other |a_ij| in row {i}", i)

    @cached_property
    def generalised_dominant(self) -> Answer:
        """H-matrix, with v computed. Witness of yes, where floats can hold one: v > 0 with ⟨A⟩v > 0; of no: as `h`."""
        if not self.h.holds or self.h.witness is not None:
            return self.h
        v = decide(comparison_matrix(self.A), 1, np.zeros(self.A.shape[0], dtype=np.int32)).witness
        return Answer(True, f"{self.h.reason}; a vector v was not found" if v is None else "<A>v > 0", v)

    @cached_property
    def symmetric(self) -> Answer:
        """A = Aᵀ, entry by entry. Witness of no: (i, j) with a_ij ≠ a_ji."""
        work.charge_matrices(self.A.nnz, 2)
        difference = sp.coo_array(self.A != self.A.T)
        if not difference.nnz:
            return Answer(True, "A equals its transpose")
        i, j = (int(index[0]) for index in difference.coords)
        return Answer(False, f"A[{i}, {j}] = {self.A[i, j]:g} but A[{j}, {i}] = {self.A[j, i]:g}", (i, j))

    @cached_property
    def _definiteness(self) -> tuple[Answer, Answer]:
        return definiteness(self.A)

    @cached_property
    def definite(self) -> Answer:
        """xᵀAx > 0 for all x ≠ 0, A symmetric or not. Witness of no: x ≠ 0 with xᵀAx ≤ 0."""
        if self.symmetric.holds and self.h_plus.holds:
            return Answer(True, "symmetric and H+-matrix")
        return self._definiteness[0]

    @cached_property
    def semidefinite(self) -> Answer:
        """xᵀAx ≥ 0 for all x, A symmetric or not. Witness of no: x with xᵀAx < 0."""
        return self.definite if self.definite.holds else self._definiteness[1]

    @cached_property
    def semidefinite_up_to_rounding(self) -> Answer:
        """Semidefinite, or within rounding errors of a matrix that is, such as a computed BᵀB; `reason` says which."""
        if self.semidefinite.holds:
            return self.semidefinite
        answer = semidefinite_up_to_rounding(self.A)
        return answer if answer.holds else self.semidefinite

    @cached_property
    def p(self) -> Answer:
        """P-matrix: all principal minors are positive; see `p_matrix`. Witness of no: the indices of one ≤ 0."""
        if not (positive := positive_diagonal(self.A)).holds:
            return Answer(False, positive.reason, np.array([positive.witness]))
        if self.h_plus.holds:
            return Answer(True, "H+-matrix")
        pair = minor_of_order_two(self.A)
        if pair is not None:
            return Answer(False, f"the minor of rows and columns {pair[0]} and {pair[1]} is not positive", pair)
        unknown = None
        minors = 0
        proved = "every irreducible diagonal block is a P-matrix"
        for rows, part in open_blocks(self.A):
            is_irreducible = rows.size == self.A.shape[0]
            small = rows.size <= MAX_BLOCK_SIZE
            minors += 2**rows.size if small else 0
            if small and minors > 2 ** (MAX_BLOCK_SIZE + 2):
                return Answer(None, f"too many blocks of up to {MAX_BLOCK_SIZE} rows to compute all of their minors")
            answer = by_pivots(part) if small else (self if is_irreducible else MatrixClasses(part))._p_by_theorems()
            reason = answer.reason if is_irreducible else f"{answer.reason} (irreducible block of {rows.size} rows)"
            if answer.holds is False:
                return Answer(False, reason, None if answer.witness is None else rows[answer.witness])
            if answer.holds is None:
                unknown = unknown or reason
            proved = reason if is_irreducible else proved
        return Answer(True, proved) if unknown is None else Answer(None, unknown)

    def _p_by_theorems(self) -> Answer:
        """The answer for blocks beyond MAX_BLOCK_SIZE, by theorems."""
        if self.h_plus.holds:
            return Answer(True, "H+-matrix")
        if self.definite.holds:
            return Answer(True, "the symmetric part is positive definite")
        if self.z.holds and self.h.holds is False:
            return Answer(False, "a Z-matrix that is no nonsingular M-matrix")
        if self.symmetric.holds and self.definite.holds is False:
            return Answer(False, "symmetric and not positive definite")
        unproved = "neither an H+-matrix nor a positive definite symmetric part was proved"
        return Answer(None, f"n = {self.A.shape[0]} is beyond the exact test (n <= {MAX_BLOCK_SIZE}); {unproved}")

    @cached_property
    def triangular(self) -> Answer:
        """No nonzero entry below, or none above, the diagonal. Witness of yes: "lower", "upper" or "diagonal"."""
        below, above = bandwidths(without_zeros(self.A))
        if below and above:
            return Answer(False, "there are entries on both sides of the diagonal")
        kind = "lower" if below else "upper" if above else "diagonal"
        return Answer(True, kind if kind == "diagonal" else f"{kind} triangular", kind)

    @cached_property
    def banded(self) -> Answer:
        """Bandwidth w = lower + upper + 1 ≤ max(3, √n): elimination inside the band takes O(n²) operations at most.

        Witness: (lower, upper); number: w.
        """
        below, above = bandwidths(without_zeros(self.A))
        width = below + above + 1
        limit = max(3.0, float(np.sqrt(self.A.shape[0])))
        reason = f"bandwidth {below} + {above} + 1 {'<=' if width <= limit else '>'} max(3, sqrt(n)) = {limit:g}"
        return Answer(width <= limit, reason, (below, above), width)

    @cached_property
    def reducible(self) -> Answer:
        """Block triangular after a permutation. Witness: the block of each row, shape (n,); number: that of blocks."""
        count, block = irreducible_blocks(self.A)
        reason = f"{count} irreducible diagonal blocks" if count > 1 else "the graph of A is strongly connected"
        return Answer(count > 1, reason, block, count)
