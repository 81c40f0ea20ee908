"""Matrix classes: known matrices, brute force in rational arithmetic, invariances, soundness next to singularity."""

from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st

from icpmodel.theory import p_matrix
from icpmodel.theory.matrices import p_matrix as pmatrix
from icpmodel.theory.matrices.classes import classify
from icpmodel.theory.matrices.h_matrix import row_sum_signs

CYCLE = [[1, 0, 2], [2, 1, 0], [0, 2, 1]]


def determinant(M):
    """By expansion, for fractions."""
    if not M:
        return Fraction(1)
    return sum((-1) ** j * M[0][j] * determinant([row[:j] + row[j + 1 :] for row in M[1:]]) for j in range(len(M)))


def rational(A):
    A = A.toarray() if sp.issparse(A) else np.asarray(A)
    return [[Fraction(float(a)) for a in row] for row in A]


def minor(A, indices):
    M = rational(A)
    return determinant([[M[i][j] for j in indices] for i in indices])


def comparison(A):
    return [[abs(a) if i == j else -abs(a) for j, a in enumerate(row)] for i, row in enumerate(rational(A))]


def times(M, x):
    return [sum(a * Fraction(b) for a, b in zip(row, x, strict=True)) for row in M]


def brute_p(A):
    n = len(A)
    return all(minor(A, s) > 0 for k in range(1, n + 1) for s in combinations(range(n), k))


def brute_h(A):
    """A Z-matrix is a nonsingular M-matrix iff its leading minors are positive."""
    C = comparison(A)
    return all(determinant([row[:k] for row in C[:k]]) > 0 for k in range(1, len(C) + 1))


def brute_curvature(A):
    """(definite, semidefinite) by all principal minors of A + Aᵀ."""
    M = rational(A)
    n = len(M)
    S = [[M[i][j] + M[j][i] for j in range(n)] for i in range(n)]
    minors = [
        determinant([[S[i][j] for j in s] for i in s]) for k in range(1, n + 1) for s in combinations(range(n), k)
    ]
    return all(m > 0 for m in minors), all(m >= 0 for m in minors)


def check(A, complete=True):
    """Every answer about A agrees with brute force, and every witness proves what it should."""
    c = classify(A)
    truth = {"p": brute_p(A), "h": brute_h(A)}
    truth["definite"], truth["semidefinite"] = brute_curvature(A)
    truth["generalised_dominant"] = truth["h"]
    truth["h_plus"] = truth["h"] and all(minor(A, [i]) > 0 for i in range(len(A)))
    truth["m"] = truth["h_plus"] and all(A[i][j] <= 0 for i in range(len(A)) for j in range(len(A)) if i != j)
    for name, true in truth.items():
        holds = getattr(c, name).holds
        assert holds is true or (holds is None and not complete), (name, getattr(c, name), A)
    if c.p.holds is False and c.p.witness is not None:
        assert minor(A, c.p.witness) <= 0
    if c.h.holds is False:
        x = c.h.witness
        assert x is None or (any(x) and min(x) >= 0 and max(times(comparison(A), x)) <= 0)
    v = c.generalised_dominant.witness
    if c.generalised_dominant.holds and v is not None:
        assert min(v) > 0
        assert min(times(comparison(A), v)) > 0
    for name in ("definite", "semidefinite"):
        answer = getattr(c, name)
        if answer.holds is False:
            x = [Fraction(e) for e in answer.witness]
            form = sum(a * b for a, b in zip(x, times(rational(A), x), strict=True))
            assert any(x)
            assert form < 0 or (form == 0 and name == "definite"), (name, A)
    return c


#: a matrix, and whether it is P, H, definite, semidefinite; the last ones have entries of extreme sizes
KNOWN = [
    (CYCLE, "Ps"),
    ([[1.0, -1.0], [-1.0, 1.0]], "s"),  # singular, so no M, no P and not definite
    ([[0.0, 1.0], [0.0, 0.0]], ""),
    ([[-1.0, 0.5], [0.0, -2.0]], "H"),
    ([[-1.0]], "H"),
    ([[0.0]], "s"),
    ([[5e-324]], "PHds"),
    ([[1.7e308]], "PHds"),
]


class TestKnownMatrices:
    @pytest.mark.parametrize(("A", "kinds"), KNOWN)
    def test_small_ones(self, A, kinds):
        c = check(A)
        found = zip("PHds", (c.p, c.h, c.definite, c.semidefinite), strict=True)
        assert "".join(letter for letter, answer in found if answer.holds) == kinds

    def test_inside_the_gap_of_a_shifted_laplacian_one_solve_decides(self):
        """2 − s on the diagonal: H iff s < 2 − 2cos(π/(n + 1)); x = v⁻ proves that it is not."""
        n = 60
        gap = 2 - 2 * np.cos(np.pi / (n + 1))
        for s, holds in ((0.999 * gap, True), (1.001 * gap, False), (3 * gap, False), (10 * gap, False)):
            diagonals = [-np.ones(n - 1), np.full(n, 2.0 - s), -np.ones(n - 1)]
            A = sp.csr_array(sp.diags_array(diagonals, offsets=[-1, 0, 1]))
            c = classify(A)
            assert c.m.holds is holds, s
            assert c.definite.holds is holds
            assert c.p.holds is holds
            product = times(comparison(A), c.generalised_dominant.witness)
            assert min(product) > 0 if holds else max(product) <= 0

    def test_structure(self):
        upper, lower, full = [[1, 2], [0, 3]], [[1, 0], [2, 3]], [[1, 2], [3, 4]]
        assert [classify(A).triangular.witness for A in (upper, lower, np.eye(2))] == ["upper", "lower", "diagonal"]
        assert classify(full).triangular.holds is False
        assert (classify(upper).reducible.holds, classify(full).reducible.holds) == (True, False)
        assert classify(full).symmetric.witness in ((0, 1), (1, 0))
        wide = sp.lil_array(np.eye(100))
        wide[0, 4] = wide[8, 3] = 1.0
        assert (classify(wide).banded.witness, classify(wide).banded.number) == ((5, 4), 10)
        assert classify(wide).banded.holds is True


class TestAgainstBruteForce:
    @pytest.mark.parametrize("n", [2, 3, 4, 5])
    def test_small_integers_make_minors_of_exactly_zero(self, n):
        rng = np.random.default_rng(n)
        for _ in range(300 // n**2):
            A = rng.integers(-2, 3, size=(n, n)) + np.diag(rng.integers(0, 4, size=n))
            check(A.tolist())
            check((np.tril(A) + np.tril(A, -1).T).tolist())

    def test_matrices_that_are_p_and_not_h_plus(self):
        """Products of P-matrices 1 + skew and the like: the pivots have to do the work."""
        rng, seen = np.random.default_rng(3), 0
        for _ in range(60):
            K = rng.integers(-3, 4, size=(5, 5))
            A = (np.eye(5) + K - K.T) @ np.diag(rng.integers(1, 9, size=5))
            A[rng.integers(5), rng.integers(5)] += rng.integers(-2, 3)
            c = check(A.tolist())
            seen += c.p.holds and not c.h.holds and not c.definite.holds
        assert seen > 10

    def test_larger_p_matrices_and_those_with_one_bad_minor(self):
        """1 + skew has all minors ≥ 1; (−1)^n times too strong a cycle makes the whole determinant negative alone."""
        rng = np.random.default_rng(4)
        K = rng.normal(size=(14, 14))
        assert p_matrix((np.eye(14) + K - K.T) @ np.diag(rng.random(14) + 0.1)).holds is True
        for n in (6, 13, pmatrix.MAX_BLOCK_SIZE - 6):
            A = np.eye(n) + (-1) ** n * 1.001 * np.roll(np.eye(n), 1, axis=1)
            assert p_matrix(A).witness.tolist() == list(range(n))
            A[0, 1] *= -1
            assert p_matrix(A).holds is True


class TestInvariance:
    def test_positive_scaling_of_rows_and_columns_and_permutation(self):
        """P and H do not notice units, even such as 1e±100."""
        rng = np.random.default_rng(5)
        for _ in range(60):
            n = int(rng.integers(2, 6))
            A = (rng.integers(-2, 3, size=(n, n)) + np.diag(rng.integers(1, 4, size=n))).astype(float)
            r, c = rng.integers(-330, 331, size=(2, n))
            order = rng.permutation(n)
            scaled = np.ldexp(A, r[:, None] + c)[order][:, order]
            a, b = classify(A), classify(scaled)
            assert (a.p.holds, a.h.holds, a.m.holds) == (b.p.holds, b.h.holds, b.m.holds)
            if b.p.holds is False:
                assert minor(scaled, b.p.witness) <= 0

    def test_block_triangular_matrices_are_decided_block_by_block(self):
        """Beyond MAX_BLOCK_SIZE rows, with huge entries between the blocks, in a random order."""
        rng = np.random.default_rng(7)
        n = 3 * 15
        A = np.kron(np.eye(15), np.array(CYCLE, dtype=float)) + np.triu(1e9 * rng.random((n, n)), 3) * (
            np.arange(n)[:, None] // 3 < np.arange(n) // 3
        )
        order = rng.permutation(n)
        good = A[order][:, order]
        answer = p_matrix(good)
        assert answer.holds is True
        assert "block" in answer.reason
        A[3:6, 3:6] = [[1, 0, -2], [2, 1, 0], [0, 2, 1]]
        bad = p_matrix(A[order][:, order])
        assert bad.holds is False
        assert sorted(order[bad.witness]) == [3, 4, 5]
        assert classify(good).reducible.number == 15


class TestSoundness:
    def test_one_unit_in_the_last_place_around_singularity(self):
        """Entries moved by one ulp from an exactly singular matrix: never a wrong answer, and here always one."""
        rng = np.random.default_rng(8)
        for _ in range(60):
            n = int(rng.integers(2, 5))
            B = rng.integers(-3, 4, size=(n, n - 1)).astype(float)
            A = B @ B.T + (lambda K: K - K.T)(rng.integers(-1, 2, size=(n, n)) * (rng.random() < 0.5))
            moved = np.nextafter(A, A + rng.integers(-1, 2, size=(n, n)))
            check((moved / 3).tolist())
            Z = -np.abs(rng.integers(0, 4, size=(n, n)) / 10)
            np.fill_diagonal(Z, 0.0)
            np.fill_diagonal(Z, -Z.sum(axis=1))
            check(np.nextafter(Z, Z + rng.integers(-1, 2, size=(n, n))).tolist())

    def test_extreme_magnitudes(self):
        for A in (
            [[1e308, -1e308], [-1e308, 1e308]],
            [[1e308, -1.7e308], [1e308, 1e308]],
            [[5e-324, -5e-324], [0.0, 5e-324]],
            [[1.0, 1e308, 0.0], [0.0, 1.0, 1e308], [1e308, 0.0, 1.0]],
            [[1e-320, -1e300], [-1e-320, 1e300]],
            [[1.0, -1e200, 0.0], [-1e-200, 2.0, -1e-310], [0.0, -1e300, 1.0]],
        ):
            check(A, complete=False)

    def test_beyond_the_exact_test_the_answer_is_unknown_and_says_so(self):
        n = pmatrix.MAX_BLOCK_SIZE + 5
        rng = np.random.default_rng(10)
        K = rng.normal(size=(n, n))
        # D1 (I + K) D2 is P, neither H+ nor definite
        A = np.diag(2.0 ** rng.integers(-5, 6, size=n)) @ (np.eye(n) + K - K.T)
        answer = p_matrix(A)
        assert answer.holds is None
        assert f"n = {n}" in answer.reason
        A[4, 7], A[7, 4] = 3 * A[4, 4], 3 * A[7, 7]
        worse = p_matrix(A)
        assert worse.holds is False
        assert minor(A, worse.witness) <= 0


@given(st.lists(st.lists(st.floats(-1.7e308, 1.7e308), min_size=1, max_size=5), min_size=1), st.data())
def test_the_signs_of_row_sums_are_those_of_fractions(rows, data):
    """Whatever nearly cancels, over- or underflows on the way: each row with its negative, but for one unit."""
    others = [[-np.nextafter(x, data.draw(st.sampled_from([-np.inf, x, np.inf]))) for x in row] for row in rows]
    mixed = [data.draw(st.permutations(row + other)) for row, other in zip(rows, others, strict=True)]
    indptr = np.append(0, np.cumsum([len(row) for row in mixed]))
    columns = np.concatenate([np.arange(len(row)) for row in mixed])
    found = row_sum_signs(sp.csr_array((np.concatenate(mixed), columns, indptr), shape=(len(mixed), 10)))
    exact = [sum(map(Fraction, row)) for row in mixed]
    assert found.tolist() == [(x > 0) - (x < 0) for x in exact]
