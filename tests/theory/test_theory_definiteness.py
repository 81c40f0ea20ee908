"""Positive (semi)definite or not: decided for certain, with a witness, in any units, next to singularity, for any n."""

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from known_answers import GENERATORS, SEEDS

import icpmodel as icp
from icpmodel.numerics.arrays import as_csr
from icpmodel.numerics.rational import curvature
from icpmodel.problem.matrix import Matrix
from icpmodel.theory import check, classify
from icpmodel.theory.certificates import definite
from icpmodel.theory.certificates.proof import Proof
from icpmodel.theory.matrices import definiteness, eigenvalue

drawn = settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture(params=[0, 40, 100], ids=["fractions", "dense", "sparse"])
def padded(request):
    """S with further rows of the identity: up to 30 are decided by fractions, from 65 on sparse ones by SuperLU."""
    return lambda S: sp.block_diag([S, sp.eye_array(request.param)]).toarray()


def decided(S):
    """(definite, semidefinite, semidefinite up to rounding); a witness is one in fractions."""
    S = as_csr(S, "S", keep_diagonal=True)
    definite, semidefinite = definiteness.definiteness(S)
    if semidefinite.holds is False:
        x = [Fraction(entry) for entry in semidefinite.witness]
        entries = sp.coo_array(S)
        rows, columns = entries.coords
        terms = zip(rows, columns, entries.data, strict=True)
        assert sum(x[i] * x[j] * Fraction(float(value)) for i, j, value in terms) < 0
    return definite.holds, semidefinite.holds, classify(S).semidefinite_up_to_rounding.holds


@drawn
@given(rng=GENERATORS, decades=st.sampled_from([0, 6, 30]), whole=st.booleans())
def test_the_signs_are_those_of_the_eigenvalues_in_any_units(padded, rng, decades, whole):
    """Sylvester: DSD has the signs of S for every positive diagonal D."""
    B = rng.integers(-2, 3, size=(5, 5)) if whole else rng.normal(size=(5, 5)) * (rng.random((5, 5)) < 0.5)
    S = B + B.T + (0.0 if whole else rng.uniform(-2, 6)) * np.eye(5)
    d = 10.0 ** rng.uniform(-decades, decades, 5)
    smallest, found = np.linalg.eigvalsh(S)[0], decided(padded(S * np.outer(d, d)))
    if smallest > 1e-9:
        assert found == (True, True, True)
    elif smallest < -1e-9:
        assert found == (False, False, False)
    else:
        assert found[2] is True


@drawn
@given(seed=SEEDS, n=st.integers(2, 12))
def test_a_singular_matrix_is_never_called_definite(padded, seed, n):
    """A pivot is no eigenvalue: the last pivot of a graph Laplacian is far larger than its zero eigenvalue."""
    B = np.random.default_rng(seed).integers(-3, 4, size=(n, n - 1)).astype(float)
    definite, semidefinite, nearly = decided(padded(B @ B.T))
    assert definite is not True
    assert semidefinite is not False
    assert nearly is True
    ring = 2 * np.eye(n) - np.roll(np.eye(n), 1, 0) - np.roll(np.eye(n), -1, 0)
    assert decided(padded(ring)) == (False, True, True)


@drawn
@given(rng=GENERATORS, n=st.integers(1, 6), spread=st.sampled_from([0, 10, 25]))
def test_a_bound_on_the_smallest_eigenvalue_is_one_in_fractions(rng, n, spread):
    """S − bound·I is semidefinite, with c next to the eigenvalue, on either side of it."""
    B = np.ldexp(rng.integers(-3, 4, size=(n, n)), -rng.integers(0, spread + 1, size=(n, 1)))
    S = B @ B.T
    smallest = np.linalg.eigvalsh(S)[0]
    for c in (smallest, 0.0, *(smallest + sign * np.ldexp(1.0, [-30, -45, -52, -60]) for sign in (-1, 1))):
        for shift in np.atleast_1d(c):
            bound = eigenvalue.smallest_eigenvalue_bound(sp.csr_array(S), shift)
            if bound > -np.inf:
                exact = [[Fraction(S[i, j]) - (i == j) * Fraction(bound) for j in range(n)] for i in range(n)]
                assert curvature(exact)[0]


@pytest.mark.parametrize("less", [0.0, 2.0**-44, 2.0**-30])
def test_a_large_matrix_that_is_definite_by_rounding_alone_is_not_proved_so(less):
    """BBᵀ of rank n − 1, exact in floats, less `less` on its diagonal: Cholesky's method may well go through."""
    for seed in range(8):
        B = np.random.default_rng(seed).integers(-3, 4, size=(100, 99)).astype(float)
        S = B @ B.T - less * np.eye(100)
        assert isinstance(definite.prove(Matrix(S), icp.Constant(0.0).bind(100)), str)
        assert not eigenvalue.smallest_below(sp.csr_array(S / 512)) > 0
        assert isinstance(definite.prove(Matrix(S + 2.0**-20 * np.eye(100)), icp.Constant(0.0).bind(100)), Proof)


HIDDEN = [[1.0, 0.9, 0.9], [0.9, 1.0, -0.9], [0.9, -0.9, 1.0]]
SKEW = np.array([[0.0, 50.0, -3.0], [-50.0, 0.0, 7.0], [3.0, -7.0, 0.0]])
PLAIN = np.array([[2.0, 1.9, 0.0], [1.9, 2.0, 0.5], [0.0, 0.5, 3.0]])


@pytest.mark.parametrize(
    "S",
    [
        np.ones((3, 3)) - 1e-8 * np.eye(3),  # more than rounding
        sp.block_diag([[[1e20, 0.9e20], [0.9e20, 1e20]], [[1.0, 2.0], [2.0, 1.0]]]),  # large rows hide nothing
        [[0.0, 1.0], [1.0, 0.0]],
        [[5e-324, 2.0], [2.0, 5.0]],
        [[5.0, 2.0], [2.0, 1e-200]],
        [[1.0, 0.0, 1e-100], [0.0, 1.0, 0.0], [1e-100, 0.0, 0.0]],  # beside a zero on the diagonal
        # ±1e200 beside a diagonal of 1e-300 cancel in the symmetric part; the indefinite block is elsewhere
        sp.block_diag([[[1e-300, 1e200], [-1e200, 1e-300]], HIDDEN]),
        [[2.3e-308, 1.1, 0.0], [1.1, 2.3e-308, 0.7], [0.0, 0.7, 1.0]],
        HIDDEN,
        PLAIN - 0.2 * np.eye(3) + SKEW,
    ],
)
def test_what_is_indefinite_by_any_amount_is_neither(padded, S):
    assert decided(padded(S)) == (False, False, False)


def test_what_floats_cannot_tell_is_left_open_or_decided_right(padded):
    """[1, 1; 1, 1 + 2u] is definite, [1, 1; 1, 1 − u] and [2, −2 − 2⁻⁶⁰; …, 2] are not; a skew part does not matter."""
    for last, true in ((1 + 2.0**-52, True), (1 - 2.0**-53, False)):
        S = padded([[1.0, 1.0], [1.0, last]])
        found = decided(S)
        assert found[0] in ({true} if len(S) <= 30 else {true, None})
        assert found[2] is True
    assert decided(padded([[1.0, -2.0], [-(2.0**-60), 1.0]]))[1] is not True
    assert decided(padded(PLAIN + SKEW)) == (True, True, True)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_grid_that_is_not_dominant(sign):
    """(L − λ₁I)² ± 1e-3 I, L the five-point matrix: both answers by one sparse factorisation or two."""
    L = icp.scenes.membrane(n=1600).problem.A
    smallest = 8 * np.sin(np.pi / 82) ** 2 * (L.diagonal()[0] / 4)
    M = L - smallest * sp.eye_array(1600)
    assert decided(M @ M + sign * 1e-3 * sp.eye_array(1600)) == (sign > 0, sign > 0, sign > 0)


def test_large_matrices_are_decided_by_dominance_or_as_bands_and_else_left_open():
    """Neighbours at random: no order of the rows makes a narrow band of them. The pentadiagonal one is in disorder."""
    assert classify(icp.scenes.bai_nonsymmetric(n=90_000, mu=0).problem.A).definite.holds is True
    n, rng = 20_000, np.random.default_rng(0)
    rows, columns = rng.integers(0, n, size=(2, 4 * n))
    S = sp.csr_array((np.full(4 * n, 0.5), (rows, columns)), shape=(n, n))
    S = sp.csr_array(S + S.T + 3 * sp.eye_array(n))
    found = classify(S)
    assert [found.definite.holds, found.semidefinite.holds, found.semidefinite_up_to_rounding.holds] == [None] * 3
    assert isinstance(definite.prove(Matrix(S), icp.Constant(0.0).bind(n)), str)
    assert check("definite", icp.ICP(S, np.zeros(n)), icp.MNMOD()).number is None
    band = sp.diags_array([-np.ones(n - 2), -np.ones(n - 1), 3.0 + 3e-6 * np.ones(n)], offsets=[-2, -1, 0])
    order = rng.permutation(n)
    assert classify(sp.csr_array(sp.csr_array(band @ band.T)[order][:, order])).definite.holds is True
