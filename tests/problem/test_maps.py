"""ψ: value, Jacobian and Lipschitz matrix of every map, and what happens when a user's function misbehaves."""

import math
import warnings

import numba
import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from known_answers import SEEDS

import icpmodel as icp
from icpmodel.problem.two_sided import as_map

N = 5


@numba.njit
def kinked(t):
    return 0.4 * t if t > 0 else 0.1 * t


@numba.njit
def kinked_slope(t):
    return 0.4 if t > 0 else 0.1


def sparse_jumps(seed, n=N):
    rng = np.random.default_rng(seed)
    mask = rng.random((n, n)) < 0.4
    rows, columns = np.nonzero(mask)
    gains = np.where(rng.random(rows.size) < 0.3, 0.0, -rng.random(rows.size))
    return sp.csr_array(sp.coo_array((gains, (rows, columns)), shape=(n, n)))


def all_maps(seed):
    rng = np.random.default_rng(seed)
    G = rng.normal(size=(N, N)) * 0.3
    shift = 0.5 * np.roll(np.eye(N), 1, 0)
    return {
        "vector": as_map(rng.normal(size=N), N),
        "affine": icp.Affine(G, 1.0).bind(N),
        "elementwise": icp.Elementwise(np.tanh, lambda z: 1 - np.tanh(z) ** 2, 1.0, c=rng.normal(size=N)).bind(N),
        "compiled": icp.Elementwise(kinked, kinked_slope, 0.4).bind(N),
        "function": icp.Function(lambda z: shift @ z, lambda z: shift, shift).bind(N),
        "max": icp.Intervention(sparse_jumps(seed)).bind(N),
        "min": icp.Intervention(sparse_jumps(seed), best="min").bind(N),
    }


@pytest.mark.parametrize("name", list(all_maps(0)))
@settings(max_examples=40)
@given(seed=SEEDS)
def test_the_jacobian_is_the_derivative_and_the_lipschitz_matrix_bounds_every_difference(name, seed):
    psi = all_maps(seed)[name]
    rng = np.random.default_rng(seed)
    z, direction, t = rng.normal(size=N), rng.normal(size=N), 1e-7
    before, after = psi.value(z), psi.value(z + t * direction)
    finite = np.isfinite(before)
    assert np.array_equal(finite, np.isfinite(after))
    moved = psi.jacobian(z) @ direction
    assert (after[finite] - before[finite]) / t == pytest.approx(moved[finite], abs=1e-5)
    x, y = rng.normal(size=(2, N)) * 3
    difference = np.abs(psi.value(x)[finite] - psi.value(y)[finite])
    assert (difference <= (psi.lipschitz @ np.abs(x - y))[finite] + 1e-12).all()


@given(seed=SEEDS, best=st.sampled_from(["max", "min"]))
def test_an_intervention_takes_the_best_jump(seed, best):
    jumps = sparse_jumps(seed)
    psi = icp.Intervention(jumps, best=best)
    z = np.random.default_rng(seed + 1).normal(size=N)
    value, target = psi.best_jump(z)
    for i in range(N):
        stored = range(jumps.indptr[i], jumps.indptr[i + 1])
        gains = {int(jumps.indices[k]): z[jumps.indices[k]] + jumps.data[k] for k in stored}
        if not gains:
            assert value[i] == -np.inf
            assert target[i] == -1
        else:
            assert value[i] == (max if best == "max" else min)(gains.values())
            assert gains[target[i]] == value[i]


def test_a_stored_zero_is_a_free_jump():
    jumps = sp.csr_array((np.array([0.0]), (np.array([0]), np.array([1]))), shape=(2, 2))
    assert icp.Intervention(jumps).value(np.array([0.0, 5.0])).tolist() == [5.0, -np.inf]


def test_what_a_map_is_made_of_is_copied():
    """Whoever goes on with his arrays changes no map, before it is bound or after."""
    c, bounds, G = np.ones(2), np.full(2, 0.3), [[0.0, 0.5], [0.5, 0.0]]
    elementwise, function = icp.Elementwise(np.sin, lipschitz=bounds, c=c), icp.Function(np.sin, lipschitz=G)
    c[:] = bounds[:] = G[0][1] = 9.0
    assert elementwise.bind(2).c.tolist() == [1.0, 1.0]
    assert elementwise.bind(2).lipschitz.diagonal().tolist() == [0.3, 0.3]
    assert function.bind(2).lipschitz.toarray().tolist() == [[0.0, 0.5], [0.5, 0.0]]


def raising(z):
    raise RuntimeError("no value here")


def test_a_psi_without_derivative_is_differenced_on_the_sparsity_that_the_message_names():
    psi, A, q = lambda z: 0.1 * np.sin(z[::-1]), [[2.0, -1.0], [-1.0, 2.0]], [-1.0, 1.0]
    with pytest.raises(icp.NotApplicable, match=r"sparsity=np.ones\(\(n, n\)\) for differences"):
        icp.ICP(A, q, psi).solve("newton")
    assert icp.ICP(A, q, icp.Function(psi, sparsity=np.ones((2, 2)))).solve("newton").solved


@pytest.mark.parametrize(
    ("psi", "words"),
    [
        (raising, "psi.z. raised RuntimeError: no value here"),
        (lambda z: z[:1], r"psi\(z\) has shape \(1,\); shape \(2,\)"),
        (icp.Elementwise(lambda z: z.sum()), r"Elementwise.f\(z\) has shape \(\)"),
        (icp.Intervention(lambda z: z), "a tuple .value, target. was expected"),
        (icp.Intervention(lambda z: (z, z)), "target has shape .* float64"),
        (icp.Intervention(lambda z: (z, np.array([0, 2]))), "outside -1 ... 1"),
        (icp.Intervention(lambda z: (z, [[0], [1, 1]])), "target cannot be read as an array"),
        (icp.Intervention(lambda z: (z, np.array([0, -1]))), "row 1 has the value .* no jump"),
    ],
)
def test_a_map_that_misbehaves_says_how(psi, words):
    problem = icp.ICP(np.eye(2), np.ones(2), psi)
    with pytest.raises(icp.MapError, match=words):
        problem.r(np.zeros(2))
    with pytest.raises(icp.MapError, match=words):
        problem.solve("mnmgs")


def test_differences_that_are_not_finite_are_named():
    psi = icp.Function(lambda z: z + np.array([0.0, np.nan]), sparsity=np.eye(2)).bind(2)
    for one, words in ((psi, "psi"), (psi.as_upper(), "upper")):
        with pytest.raises(icp.MapError, match=rf"the Jacobian of {words}\[1, 1\] is nan"):
            one.jacobian(np.zeros(2))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: icp.Affine(np.ones((2, 3))), r"Affine.G has shape \(2, 3\)"),
        (lambda: icp.Constant([0.0, np.nan]), r"Constant.c\[1\] is nan"),
        (lambda: icp.Function(3), "Function.fun is 3"),
        (lambda: icp.Elementwise(np.exp, 3), "Elementwise.derivative is 3"),
        (lambda: icp.Elementwise(np.exp, np.exp, slope_range=(1, 0)), "Elementwise.slope_range is"),
        (
            lambda: icp.Elementwise(np.tanh, slope_range=([0, 0], 1)).bind(3),
            r"Elementwise.slope_range has shape \(2,\)",
        ),
        (lambda: icp.Elementwise(np.sin, lipschitz=np.eye(2)), "Elementwise.lipschitz is a matrix"),
        (lambda: icp.Elementwise(np.sin, lipschitz=sp.eye_array(2)), "Elementwise.lipschitz is a matrix"),
        (lambda: icp.Function(np.exp, parameter_derivative=3), "Function.parameter_derivative is 3"),
        (lambda: icp.Elementwise(kinked, np.sin), "both or neither"),
        (lambda: icp.Elementwise(np.sin, lipschitz=-1).bind(2), "Elementwise.lipschitz has the entry -1"),
        (lambda: icp.Intervention(sp.eye_array(2), best="most"), '"max" or "min"'),
        (lambda: icp.Intervention(sp.coo_array(([1.0, 2.0], ([0, 0], [1, 1])), shape=(2, 2))), "the same jump twice"),
    ],
)
def test_wrong_data_of_a_map_is_named(make, words):
    """By its class: it may become psi, upper or f."""
    with pytest.raises(icp.InputError, match=words):
        make()


def test_a_number_as_lipschitz_says_that_the_jacobian_is_diagonal():
    """Where it is not, no obstacle counts as fixed, and what needs the Jacobian says so."""
    swap = icp.Function(lambda z: 0.5 * z[::-1] + 1.0, lambda z: 0.5 * np.eye(2)[::-1], lipschitz=0.5)
    problem = icp.ICP(np.eye(2), [1.0, 2.0], swap)
    np.testing.assert_allclose(problem.solve().z, [2.0, 2.0], atol=1e-6)
    with pytest.raises(
        icp.MapError, match=r"entry 0.5 in row 0, column 1, but by Function.lipschitz row 0 does not depend on"
    ):
        problem.psi.jacobian(np.zeros(2))


def test_a_user_s_function_cannot_spoil_the_iterate():
    def spoil(z):
        z[:] = np.nan
        return np.zeros_like(z)

    assert icp.ICP([[2.0]], [-2.0], spoil).solve("mnmgs").z == pytest.approx([1.0])


def test_of_equal_jumps_the_first_is_taken():
    jumps = sp.csr_array(np.array([[1.0, 1.0], [0.0, 1.0]]))
    assert icp.Intervention(jumps).best_jump(np.zeros(2))[1].tolist() == [0, 1]


@pytest.mark.parametrize("best", ["max", "min"])
def test_a_jump_to_an_unknown_that_is_nan_passes_without_a_warning(best):
    jumps = icp.Intervention(sp.csr_array(np.array([[0.0, 1.0, 2.0], [1.0, 0.0, 1.0], [0.0, 0.0, 0.0]])), best)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        value, target = jumps.best_jump(np.array([0.0, np.nan, 0.0]))
    assert np.isnan(value[0])
    assert target.tolist() == [-1, 0, -1]


def test_another_sparsity_has_its_own_differences():
    """The columns of a diagonal share one difference; those of a full matrix have one each."""
    turn = icp.Function(lambda z: 0.5 * z + 0.25 * z[::-1], sparsity=np.eye(2)).bind(2)
    turn.jacobian(np.zeros(2))
    full = turn.with_sparsity(np.ones((2, 2))).jacobian(np.zeros(2)).toarray()
    assert full == pytest.approx(np.array([[0.5, 0.25], [0.25, 0.5]]), abs=1e-6)


def test_a_psi_that_reuses_its_buffer_does_no_harm():
    buffer = np.zeros(2)

    def psi(z):
        buffer[:] = 0.5 * z
        return buffer

    bound = icp.ICP(np.eye(2), [1.0, 1.0], psi=psi).psi
    first = bound.value(np.ones(2))
    bound.value(np.zeros(2))
    assert first.tolist() == [0.5, 0.5]


@pytest.mark.parametrize("psi", [math.sin, icp.Elementwise(math.sin), lambda z: 0.1 if z > 0 else 0.0])
def test_the_error_of_a_function_of_one_number_says_that_z_is_an_array(psi):
    with pytest.raises(
        icp.MapError, match=r"(Type|Value)Error: .*; z is an array of all unknowns: use np\.sin, not math"
    ):
        icp.ICP(np.eye(2), [1.0, -2.0], psi).solve()


def test_a_jacobian_that_is_diagonal_up_to_rounding_may_have_a_number_as_lipschitz():
    Q, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(5, 5)))
    half = Q @ (0.5 * np.eye(5)) @ Q.T
    assert np.count_nonzero(half) > 5
    psi = icp.Function(lambda z: 0.5 * z, lambda z: half, lipschitz=0.5)
    assert icp.ICP(np.eye(5), -np.ones(5), psi).solve("josephy").solved


def test_a_map_that_can_be_called_keeps_its_structure():
    class Called(icp.Affine):
        def __call__(self, z):
            return self.value(z)

    assert icp.ICP(np.eye(2), [1.0, 2.0], Called(0.5 * np.eye(2))).psi.linear is not None


def test_a_and_psi_may_be_next_to_overflow_at_the_same_place():
    large = np.eye(100) + 1.5e308 * np.eye(100, k=1)
    facts = icp.ICP(large, np.ones(100), icp.Affine(1.5e308 * np.eye(100, k=1))).facts
    assert facts.equations.nnz == 199
