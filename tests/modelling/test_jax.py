"""The answer of a problem as a function that JAX differentiates, compiles and maps."""

import copy
import logging
import pickle
from functools import partial

import numpy as np
import pytest
import scipy.sparse as sp
from known_answers import chain

import icpmodel as icp

jax = pytest.importorskip("jax", reason="jax is not installed: pip install icpmodel[jax]")
jnp = pytest.importorskip("jax.numpy")
check_grads = pytest.importorskip("jax.test_util").check_grads
ravel_pytree = pytest.importorskip("jax.flatten_util").ravel_pytree
solution_of = pytest.importorskip("icpmodel.modelling.jax").solution_of
nonlinear_solution_of = icp.modelling.jax.nonlinear_solution_of

N = 6
A = sp.csr_array(sp.diags_array([-1.2, 4.0, -0.8], offsets=[-1, 0, 1], shape=(N, N)))
Q = np.array([-3.0, 2.0, -1.0, 5.0, -4.0, 3.0])
C = np.array([0.1, -0.2, 0.4, -0.3, -np.inf, 0.2])
D = np.array([1.5, 0.6, np.inf, 0.4, 0.7, 0.9])
G = sp.csr_array(sp.diags_array([0.2, 0.1], offsets=[-1, 2], shape=(N, N)))
JUMPS = sp.csr_array((np.array([-0.4, -0.3, -0.5, -0.2, -0.6]), ([1, 1, 3, 3, 5], [0, 2, 2, 4, 4])), shape=(N, N))
THETA = np.array([0.3, 0.2])


@pytest.fixture(autouse=True)
def doubles():
    with jax.enable_x64(True):
        yield


def sine(theta):
    """ψ(z) = θ₀ sin z + θ₁, entry by entry."""
    return icp.Elementwise(
        lambda z: theta[0] * np.sin(z) + theta[1],
        lambda z: theta[0] * np.cos(z),
        parameter_derivative=lambda z: np.stack([np.sin(z), np.ones(N)], axis=1),
    )


def mirrored(theta):
    """ψ(z) = θ₀ z reversed + θ₁."""
    return icp.Function(
        lambda z: theta[0] * z[::-1] + theta[1],
        jacobian=lambda z: theta[0] * np.eye(N)[::-1],
        parameter_derivative=lambda z: np.stack([z[::-1], np.ones(N)], axis=1),
    )


SLOPE = icp.Elementwise(lambda z: 0.3 * np.sin(z), lambda z: 0.3 * np.cos(z), lipschitz=0.3, c=C)
#: kind → problem, what solution_of gets, and the arguments in which the answer is differentiated
KINDS = {
    "constant": (icp.ICP(A, Q, C), {}, {"A": A.data, "q": Q, "psi": C}),
    "a dense A and a number": (icp.ICP(A, Q, 0.1), {}, {"A": A.toarray(), "psi": 0.1}),
    "affine": (icp.ICP(A, Q, icp.Affine(G, C)), {}, {"A": A.data, "psi": (G.data, C)}),
    "elementwise": (icp.ICP(A, Q, SLOPE), {}, {"q": Q, "psi": C}),
    "function by parameters": (icp.ICP(A, Q, 0.0), {"psi": mirrored}, {"A": A.data, "psi": THETA}),
    "intervention": (icp.ICP(A, Q, icp.Intervention(JUMPS)), {}, {"q": Q, "psi": JUMPS.data}),
    "two sides": (icp.ICP(A, Q, C, upper=D), {}, {"A": A.data, "psi": C, "upper": D}),
    "two sides, dense and by parameters": (
        icp.ICP(A, Q, icp.Affine(G, C - 0.5), upper=3.0),
        {"upper": sine},
        {"psi": (G.toarray(), C - 0.5), "upper": THETA},
    ),
}
each_kind = pytest.mark.parametrize("kind", KINDS)


def layer_of(kind):
    """The layer of a kind, and the point at which it is differentiated; what is infinite there stays so."""
    problem, options, given = KINDS[kind]
    layer = solution_of(problem, rtol=1e-12, **options)

    def finite(some):
        return layer(**jax.tree.map(lambda x, own: jnp.where(np.isinf(own), own, x), some, given))

    return finite, jax.tree.map(lambda one: np.where(np.isinf(one), 0.0, one), given)


def loss(z):
    return jnp.sum(jnp.cos(z + jnp.arange(N)) * z)


@each_kind
def test_the_gradient_of_a_loss_is_that_of_differences_forward_and_in_reverse(kind):
    layer, given = layer_of(kind)
    check_grads(jax.jit(lambda one: loss(layer(one))), (given,), order=1, modes=("fwd", "rev"), rtol=1e-5, eps=1e-5)


def test_equal_arrays_of_other_arguments_have_their_own_derivatives():
    """psi = 0 beside q = −3, and q = 0 beside psi = 3: z = 3 is free in the one and at rest in the other."""
    layer = solution_of(icp.ICP([[1.0]], [-3.0], psi=[3.0]))
    by_psi, by_q = jax.grad(lambda c: layer(psi=c)[0]), jax.grad(lambda q: layer(q=q)[0])
    zero = jnp.zeros(1)
    assert (by_psi(zero).item(), by_q(zero).item()) == (0.0, 0.0)


MAPPED = {
    "right-hand sides and obstacles": (icp.ICP(A, Q, C), {"q": [Q, -Q], "psi": [C, C - 0.5]}),
    "matrices by data": (icp.ICP(A, Q, C), {"A": [A.data, 1.5 * A.data]}),
    "affine": (icp.ICP(A, Q, icp.Affine(G, C)), {"psi": [(G.data, C), (2.0 * G.data, C - 0.5)]}),
    "gains": (icp.ICP(A, Q, icp.Intervention(JUMPS)), {"psi": [JUMPS.data, JUMPS.data - 0.3]}),
    "above": (icp.ICP(A, Q, C, upper=D), {"upper": [D, D + 0.2], "q": [Q, 2.0 * Q]}),
}


@pytest.mark.parametrize("kind", MAPPED)
def test_what_is_mapped_is_solved_by_one_solve_many_and_is_what_a_loop_gives(kind, caplog):
    problem, lists = MAPPED[kind]
    layer = solution_of(problem)
    rows = [dict(zip(lists, one, strict=True)) for one in zip(*lists.values(), strict=True)]
    stacked = jax.tree.map(lambda *several: np.stack(several), *rows)
    with caplog.at_level(logging.INFO, "icpmodel"):
        Z = jax.vmap(lambda one: layer(**one))(stacked)
    assert [record for record in caplog.messages if record.startswith("2 rows")]
    np.testing.assert_allclose(Z, [layer(**row) for row in rows], rtol=1e-13, atol=1e-13)


def test_gradients_are_mapped_too_over_some_arguments_or_all():
    layer, Qs, Cs = solution_of(icp.ICP(A, Q, C)), np.stack([Q, 2.0 * Q, -Q]), np.stack([C, C - 0.5])
    gradient = jax.grad(lambda a, q, c: loss(layer(A=a, q=q, psi=c)), argnums=(0, 1, 2))
    of_pairs = jax.jit(jax.vmap(jax.vmap(gradient, (None, 0, None)), (None, None, 0)))(A.data, Qs, Cs)
    for i, c in enumerate(Cs):
        for j, q in enumerate(Qs):
            for mapped, one in zip(of_pairs, gradient(A.data, q, c), strict=True):
                np.testing.assert_allclose(mapped[i, j], one, rtol=1e-12, atol=1e-13)


def test_a_map_may_compute_with_jax_in_double_precision_and_by_another_layer():
    inner = solution_of(icp.ICP(A, Q, C))
    height = jax.jit(lambda q: 0.1 * jnp.sin(inner(q=q)))

    def over_it(theta):
        return icp.Function(
            lambda z: np.asarray(height(theta[0] + jnp.asarray(Q))),
            jacobian=lambda z: np.zeros((N, N)),
            parameter_derivative=lambda z: np.asarray(jax.jacfwd(lambda t: height(t[0] + Q))(jnp.asarray(theta))),
        )

    layer = solution_of(icp.ICP(A, Q, 0.0), psi=over_it, rtol=1e-13)
    z, dz = jax.jit(lambda theta: jax.jvp(lambda t: layer(psi=t), (theta,), (jnp.ones(1),)))(np.array([0.3]))
    np.testing.assert_allclose(z, icp.ICP(A, Q, np.asarray(height(0.3 + Q))).solve().z, rtol=1e-9)
    h = 1e-5
    np.testing.assert_allclose(dz, (layer(psi=[0.3 + h]) - layer(psi=[0.3 - h])) / (2 * h), rtol=1e-6, atol=1e-9)


def test_without_a_solution_notsolved_is_raised_and_its_message_comes_out_of_compiled_code():
    layer = solution_of(icp.ICP([[-1.0]], [1.0]))
    np.testing.assert_array_equal(layer(), [0.0])
    with pytest.raises(icp.NotSolved):
        layer(q=[-1.0])
    with pytest.raises(jax.errors.JaxRuntimeError, match=r"NotSolved: .*"):
        jax.block_until_ready(jax.jit(lambda q: layer(q=q))(np.array([-1.0])))


def test_where_nothing_is_to_be_raised_rows_without_a_solution_are_nan_with_their_derivatives():
    layer = solution_of(icp.ICP([[-1.0]], [1.0], upper=5.0), raise_on_failure=False)
    bad = solution_of(icp.ICP([[-1.0]], [1.0]), raise_on_failure=False)
    Qs = np.array([[1.0], [-1.0]])
    z, gradient = jax.vmap(jax.value_and_grad(lambda q: bad(q=q)[0]))(Qs)
    np.testing.assert_array_equal(z, [0.0, np.nan])
    np.testing.assert_array_equal(gradient, [[0.0], [np.nan]])
    np.testing.assert_array_equal(jax.vmap(lambda d: layer(upper=d))(np.array([[-1.0], [3.0]]))[0], [np.nan])
    np.testing.assert_array_equal(layer(q=np.array([np.nan])), [np.nan])


def test_what_is_accurate_to_rounding_is_an_answer_alone_as_well_as_among_others():
    problem = icp.ICP(A, Q / 3, C)
    layer = solution_of(problem, rtol=1e-300, raise_on_failure=False)
    assert problem.solve(rtol=1e-300, raise_on_failure=False).status is icp.Status.PRECISION_LIMIT
    expected = problem.solve().z
    np.testing.assert_allclose(layer(q=Q / 3), expected, atol=1e-8)
    np.testing.assert_allclose(jax.vmap(lambda q: layer(q=q))(np.array([Q / 3] * 2)), [expected] * 2, atol=1e-8)


def test_a_second_derivative_is_refused():
    layer = solution_of(icp.ICP(A, Q, C))
    with pytest.raises(icp.NotApplicable, match="cannot be differentiated again"):
        jax.hessian(lambda q: layer(q=q).sum())(Q)


BAD = {
    "a wrong length": ({"q": np.ones(2)}, r"q has shape \(2,\); shape \(6,\) was expected"),
    "data on no pattern": ({"A": np.ones(3)}, r"A has shape \(3,\); shape \(16,\) or \(6, 6\) was expected"),
    "a sparse matrix": ({"A": A}, "A is a csr_array; its data, on the pattern of the problem's own was expected"),
    "complex numbers": ({"q": 1j * Q}, "q has dtype complex128; real numbers were expected"),
    "truth values": ({"psi": np.ones(N, dtype=bool)}, "psi has dtype bool; real numbers were expected"),
    "nothing above": ({"upper": D}, "upper is given, but the problem has nothing above z"),
    "a pair for a constant": ({"psi": (G.data, C)}, "psi is a tuple; an array of numbers was expected"),
}


@pytest.mark.parametrize("what", BAD)
def test_a_wrong_array_is_named_when_it_is_traced(what):
    given, message = BAD[what]
    layer = solution_of(icp.ICP(A, Q, C))
    for call in (layer, lambda **some: jax.eval_shape(lambda: layer(**some))):
        with pytest.raises(icp.InputError, match=message):
            call(**given)


def test_an_argument_that_a_layer_does_not_take_is_named():
    layer = solution_of(icp.ICP(A, Q, C))
    for call, words in (
        (lambda: layer(psy=C), "has no argument psy.*did you mean psi"),
        (lambda: layer(Q), "without a"),
    ):
        with pytest.raises(icp.InputError, match=words):
            call()


def test_without_float64_an_answer_is_refused():
    layer = solution_of(icp.ICP(A, Q, C))
    answer = nonlinear_solution_of(lambda z, theta: z - theta, 1)
    for call in (lambda: layer(q=Q), lambda: answer(1.0)):
        with jax.enable_x64(False), pytest.raises(icp.InputError, match="jax_enable_x64"):
            call()


def test_a_failed_call_of_a_function_in_jax_raises_its_own_error():
    with pytest.raises(icp.NotSolved):
        nonlinear_solution_of(lambda z, theta: theta - z**2, 1)(-1.0)


def test_what_has_no_array_to_trace_is_solved_within_a_trace():
    psi = icp.Elementwise(lambda z: jnp.tanh(z) / 2, lipschitz=0.5)
    for call in (solution_of(icp.ICP(A, Q, psi)), partial(nonlinear_solution_of(lambda z, t: z - 1, 1), ())):
        assert jax.jit(call)() == pytest.approx(call())


def test_the_error_for_numpy_in_a_function_of_jax_names_jnp():
    with pytest.raises(icp.NotSolved, match=r"jnp\.sin in JAX"):
        nonlinear_solution_of(lambda z, t: np.sin(z) - t, 1)(0.5)


def test_a_copy_of_a_layer_gives_the_same_answer():
    layer = solution_of(icp.ICP(A, Q, C))
    z = layer(q=Q + 1)
    for there in (copy.copy(layer), copy.deepcopy(layer), pickle.loads(pickle.dumps(layer))):
        assert np.array_equal(there(q=Q + 1), z)


@pytest.mark.parametrize("options", [{"rtol": -1.0}, {"z0": [1.0, 2.0, 3.0]}, {"time_limit": "x"}])
def test_wrong_options_of_a_function_in_jax_are_named_before_it_is_called(options):
    with pytest.raises(icp.InputError, match=next(iter(options))):
        nonlinear_solution_of(lambda z, theta: z - theta, 2, **options)


@pytest.mark.parametrize("name", ["psi", "upper"])
def test_a_bound_of_a_function_in_jax_that_does_not_fit_is_named(name):
    for wrong in ([1.0, 2.0, 3.0], [np.nan, 0.0], "one"):
        with pytest.raises(icp.InputError, match=name):
            nonlinear_solution_of(lambda z, theta: z - theta, 2, **{name: wrong})


def test_the_answer_of_a_function_in_jax_has_the_derivative_of_the_implicit_function():
    """Quadratics with rows on the lower bound, off it and on the upper one; θ is a tree, compiled and mapped."""

    def F(z, theta):
        coupled = jnp.array([z[1] * z[2], z[0], z[0] ** 2, 0.0])
        return theta["a"] * z**2 + z + coupled - theta["b"]

    theta = {"a": jnp.array(0.3), "b": jnp.array([2.0, -1.0, 3.0, 50.0])}
    answer = nonlinear_solution_of(F, 4, psi=[0, 0, 0.5, 0], upper=[9, 9, 9, 1])
    z = answer(theta)
    problem = icp.ICP.nonlinear(lambda z: np.asarray(F(z, theta)), psi=[0, 0, 0.5, 0], upper=[9, 9, 9, 1])
    assert np.abs(problem.natural_map(z)).max() < 1e-8
    assert (z[1], z[3]) == (0.0, 1.0)
    check_grads(answer, (theta,), 1, modes=("fwd", "rev"), eps=1e-4)
    assert jax.jit(answer)(theta) == pytest.approx(z)
    several = jax.vmap(lambda a: answer(theta | {"a": a}))(jnp.array([0.3, 0.6]))
    assert several[0] == pytest.approx(z)
    assert several[1] == pytest.approx(answer(theta | {"a": jnp.array(0.6)}))


@pytest.mark.parametrize("unit", [1e-10, 1.0, 1e10])
def test_the_derivative_does_not_depend_on_the_units_of_p(unit):
    """exp(z) = 1 + c: dz/dc = 1/(1 + c), whatever is left of p in its units; and 0 between two equal bounds."""
    free = nonlinear_solution_of(lambda z, c: unit * (jnp.exp(z) - 1 - c), 1, rtol=1e-8)
    assert jax.jacfwd(free)(3.0) == pytest.approx(0.25, rel=1e-6)
    fixed = nonlinear_solution_of(lambda z, t: z - t, 2, psi=[1.0, 0.0], upper=[1.0, 5.0])
    assert jax.jacrev(fixed)(1.0) == pytest.approx([0.0, 1.0])


def test_columns_that_share_no_row_are_differentiated_together():
    """A chain of 10⁴ links with a cubic force: the answer of the matrix and f, and the derivative by differences."""
    n = 10_000
    links = chain(n)
    load = jnp.sin(0.01 * jnp.arange(n))

    def F(z, k):
        apart = jnp.pad(z, 1)
        return 2.0 * z - apart[:-2] - apart[2:] + k * z**3 - load

    answer = nonlinear_solution_of(F, n, sparsity=links, rtol=1e-12)
    f = icp.Elementwise(lambda z: 0.5 * z**3, lambda z: 1.5 * z**2, slope_range=(0, np.inf))
    expected = icp.ICP(links, -np.asarray(load), f=f).solve(rtol=1e-12).z
    z, dz = jax.jvp(answer, (0.5,), (1.0,))
    np.testing.assert_allclose(z, expected, atol=1e-9)
    np.testing.assert_allclose(dz, (answer(0.5001) - answer(0.4999)) / 2e-4, atol=1e-6)


def test_an_entry_of_a_pattern_may_be_stored_as_0():
    def F(z, t):
        return jnp.array([2 * z[0] + z[1] ** 2 - t, 3 * z[1] + z[0] ** 2 - t])

    pattern = sp.csr_array((np.array([2.0, 0.0, 0.0, 3.0]), np.array([0, 1, 0, 1]), np.array([0, 2, 4])), shape=(2, 2))
    given, dense = (jax.jacrev(nonlinear_solution_of(F, 2, **options))(1.0) for options in ({"sparsity": pattern}, {}))
    assert given == pytest.approx(dense)
