"""The comparison matrix ⟨A⟩, tests of the signs of A, and vectors v > 0 with ⟨A⟩v > 0."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import check_arguments
from ...numerics import work
from ...numerics.arrays import Vector, as_csr, row_of, with_entries
from ...numerics.equilibration import times_rows
from ...numerics.factorisation import factorise
from ...numerics.multigrid import linear_solve
from ...numerics.sparse_structure import diagonal_positions, is_symmetric
from ..answers import Answer

FACTORISE_FIRST_UP_TO = 20_000  #: up to this size a factorisation costs less than the search for a cheaper way


@check_arguments
def comparison_matrix(A: Any) -> sp.csr_array:
    """⟨A⟩: |a_ii| on the diagonal and −|a_ij| off it.

    Parameters
    ----------
    A : array_like or sparse matrix of shape (n, n)
        The matrix.

    Returns
    -------
    CSR array of shape (n, n)
        ⟨A⟩. It has the same pattern where `A` is CSR with every diagonal entry stored. It is `A`
        itself where `A` is its own comparison matrix.

    Raises
    ------
    InputError
        Where A is no square matrix of numbers.

    Examples
    --------
    >>> comparison_matrix([[-2.0, 1.0], [-1.0, 3.0]]).toarray()
    array([[ 2., -1.],
           [-1.,  3.]])
    """
    if not isinstance(A, sp.csr_array):
        A = as_csr(A, "A", keep_diagonal=True)
    work.charge_matrices(A.nnz)
    diagonal = diagonal_positions(A)
    if np.array_equal(np.flatnonzero(A.data > 0), diagonal):
        return A  # a copy of a large matrix would cost page faults
    data = -np.abs(A.data)
    data[diagonal] = -data[diagonal]
    return with_entries(A, data)


def z_matrix(A: sp.csr_array) -> Answer:
    """Whether no entry off the diagonal is positive; the witness of False is (i, j) with a_ij > 0."""
    rows = row_of(A)
    positive = np.flatnonzero((A.data > 0) & (rows != A.indices))
    if not positive.size:
        return Answer(True, "no positive entry off the diagonal")
    i = int(rows[positive[0]])
    j = int(A.indices[positive[0]])
    return Answer(False, f"A[{i}, {j}] = {A.data[positive[0]]:g} is positive", (i, j))


def positive_diagonal(A: sp.csr_array) -> Answer:
    """Whether D > 0; the witness of False is a row with a_ii ≤ 0."""
    diagonal = A.diagonal()
    i = int(np.argmax(diagonal <= 0))
    if diagonal[i] > 0:
        return Answer(True, "D > 0")
    return Answer(False, f"A[{i}, {i}] = {diagonal[i]:g} is not positive", i)


def scaling_vectors(comparison: sp.csr_array) -> Iterator[tuple[str, Vector]]:
    """Yield (name, v): candidates v > 0 for ⟨A⟩v > 0, to be checked, cheapest first, without v = 1, assuming D > 0."""
    n = comparison.shape[0]
    if n > FACTORISE_FIRST_UP_TO and (v := layered(comparison)) is not None:
        yield "v = f(layer)", v
    v = solve_for_diagonal(comparison)
    if v is not None and (v > 0).all():
        yield "v = <A>^-1 D1", v


def solve_for_diagonal(M: sp.csr_array) -> Vector | None:
    """v with Mv ≈ D1, D the diagonal of the Z-matrix M; None if M is singular.

    v may have any sign, and the rows any units. A large M gets a few Krylov steps with multigrid,
    which leave a residual of at most 1/2 in every row of D⁻¹M. Where those do not give a v > 0 with
    Mv > 0, M is factorised.
    """
    diagonal = M.diagonal()
    if (np.abs(diagonal) < np.finfo(np.float64).tiny).any():
        return None
    work.charge_matrices(M.nnz)
    rows = times_rows(1.0 / diagonal, M)  # so that units do not look like singularity
    ones = np.ones(M.shape[0])
    if M.shape[0] > FACTORISE_FIRST_UP_TO and (diagonal > 0).all():
        with suppress(np.linalg.LinAlgError):
            v = linear_solve(rows, ones, 0.5 / np.sqrt(ones.size))
            if (v > 0).all() and (rows @ v > 0).all():
                return v
    lu = factorise(rows)
    if lu is None or not np.isfinite(v := lu.solve(ones)).all():
        return None
    return v


def layered(comparison: sp.csr_array) -> Vector | None:
    """v = f(layer) with ⟨A⟩v ≥ D1, in one pass over the matrix, where its rows are weakly dominant.

    Layer 0 are the rows with Σ_j≠i|a_ij| < |a_ii|. Layer k are those coupled to layer k − 1 and to
    no earlier one. Let g_k = f(k) − f(k−1) > 0. Row i of layer k is

        Σ_below|a_ij|(f(k) − f(layer j)) − Σ_above|a_ij|(f(layer j) − f(k)) ≥ a_ii.

    It gives g_k from g_k+1, g_k+2, …, beginning with the last layer. On a grid with zero boundary
    values f is the parabola of the distance to the edge. Where couplings to later layers dominate,
    as with transport against the layers, f grows too much. v is refused if more than a tenth of the
    (⟨A⟩v)_i/a_ii are above 4. The result is also None if a row is not weakly dominant, or not
    connected to a strictly dominant one.
    """
    from ...numerics.kernels.graph import breadth_first_layers, layer_increments

    work.charge_matrices(comparison.nnz, 4)
    diagonal = comparison.diagonal()
    # exactly 0 where the entries cancel exactly; a row that is dominant only by rounding gives a bad v, not a wrong one
    with np.errstate(over="ignore", invalid="ignore"):
        surplus = (comparison @ np.ones(diagonal.size)) / diagonal
    surplus[np.abs(surplus) < 1e-14] = 0.0
    if not (surplus >= 0).all() or not (surplus > 0).any():
        return None
    T = comparison if is_symmetric(comparison) else comparison.T.tocsr()
    layer, order = breadth_first_layers(T.indptr, T.indices, T.data, surplus > 0)
    if order.size < surplus.size:
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        f = layer_increments(comparison.indptr, comparison.indices, comparison.data, surplus, layer, order).cumsum()
        v = f[layer]
        if not np.isfinite(v).all() or np.count_nonzero(comparison @ v > 4.0 * diagonal) > 0.1 * v.size:
            return None
    return np.asarray(v)
