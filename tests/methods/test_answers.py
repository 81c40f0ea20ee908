"""Every method on every kind of problem that it is made for: the answer is the one that was built in."""

import itertools

import numpy as np
import pytest
import scipy.sparse as sp
from known_answers import PAIR, affine, around

import icpmodel as icp
from icpmodel import methods, scenes


def matrix(rng, kind, n):
    """Strictly dominant ("H+"), with entries <= 0 off the diagonal ("M"), tridiagonal ("line"), or definite only."""
    A = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.6)
    if kind == "definite":
        return A @ A.T / n + 0.5 * np.eye(n) + 2.0 * (A - A.T)
    if kind == "line":
        A = np.triu(np.tril(rng.normal(size=(n, n)), 1), -1)
    if kind == "M":
        A = -np.abs(A)
    np.fill_diagonal(A, 0.0)
    return A + np.diag(1.2 * np.abs(A).sum(axis=1) + 0.3)


def maps(rng, n):
    """c ↦ ψ, which moves by less than z in the maximum norm."""
    G = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.5)
    G *= 0.4 / max(np.abs(G).sum(axis=1).max(), 0.4)
    bent = np.abs(G)
    return {
        "constant": icp.Constant,
        "affine": affine(G),
        "own": lambda c: icp.Elementwise(lambda z: 0.4 * np.sin(2 * z) / 2, lambda z: 0.4 * np.cos(2 * z), 0.4, c),
        "function": lambda c: icp.Function(lambda z: G @ np.sin(z) + c, lambda z: G * np.cos(z), bent),
    }


ALL = ("constant", "affine", "own", "function")
#: the kinds of A and of ψ that a method is made for; one without a name of its own here is in conformance.py only
MADE_FOR = {
    None: {"H+": ALL, "definite": ("constant",)},
    "accelerated": {"H+": ALL},
    "enumerate": {"H+": ALL},
    "josephy": {"H+": ALL},
    "lemke": {"H+": ("constant", "affine", "own"), "definite": ("constant",)},
    "milp": {"H+": ("constant", "affine", "own")},
    "mms": {"H+": ("constant", "affine")},
    "mnmaor": {"H+": ALL},
    "mnmgs": {"H+": ALL},
    "mnmj": {"H+": ALL},
    "mnmmod": {"definite": ("constant",), "M": ("affine",)},
    "mnmod": {"definite": ("constant",)},
    "mnmsor": {"H+": ("own",)},
    "modulus": {"H+": ("affine",)},
    "multilevel": {"M": ALL},
    "newton": {"H+": ALL, "definite": ("constant",)},
    "nmms": {"H+": ("affine",)},
    "projection-fixed-point": {"H+": ("constant", "affine")},
    "interior": {"definite": ("constant",)},
    "proximal": {"definite": ("constant",), "M": ("own",)},
    "psor": {"H+": ALL},
    "newton-josephy": {},  # of nonlinear p: tests/solve/test_newton_josephy.py
    "restarts": {"H+": ALL},
    "tridiagonal": {"line": ("constant", "own")},
}
CASES = [(name, A, psi) for name, made in MADE_FOR.items() for A, kinds in made.items() for psi in kinds]


def test_every_method_is_in_the_table():
    assert set(MADE_FOR) == {None, *methods.names()}


@pytest.mark.parametrize(("name", "kind", "psi"), CASES)
def test_the_answer_is_the_one_that_was_built_in(name, kind, psi):
    """Rows free, at ψ, at ψ̄ and without an obstacle; starts near and far away. The error bound holds."""
    for seed, n in enumerate((1, 2, 5, 3, 4, 6) if name == "enumerate" else (1, 2, 5, 9, 14, 20)):
        rng = np.random.default_rng(seed)
        exact, one_sided = rng.normal(size=n), name == "mms"
        free = 0.0 if one_sided else 0.3
        above = 0.0 if one_sided or (kind == "line" and psi == "own") else rng.choice([0.0, 0.4])
        problem = around(rng, matrix(rng, kind, n), exact, maps(rng, n)[psi], free=free, above=above)
        start = exact + rng.normal(size=n) * 10.0 ** rng.integers(-3, 4)
        solution = problem.solve(name, z0=start, rtol=1e-11, max_iter=200_000, raise_on_failure=False)
        assert solution.status in (icp.Status.SOLVED, icp.Status.PRECISION_LIMIT), solution.message
        np.testing.assert_allclose(solution.z, exact, atol=1e-7)
        bound = solution.error_bound
        assert bound is None or np.abs(solution.z - exact).max() <= bound + 1e-13 * np.abs(start).max()


@pytest.mark.parametrize("name", ["newton", "lemke", "josephy", "tridiagonal", "multilevel", "psor", "proximal"])
def test_units_of_rows_and_columns_change_nothing(name):
    """p in units of R, z in units of C, each row for itself, of all sizes together."""
    (kind, *_), rng = MADE_FOR[name], np.random.default_rng(5)
    options = {"rtol": 0.0, "atol": 0.0, "raise_on_failure": False, "max_iter": 2000}
    for n, far in ((1, 0), (6, 0), (6, 20), (9, 320)):
        exact = rng.normal(size=n)
        problem = around(rng, matrix(rng, kind, n), exact)
        R, C = (2.0 ** (rng.integers(-8, 9, n) + rng.choice([-1, 1]) * far) for _ in range(2))
        scaled = icp.ICP(R[:, None] * problem.A.toarray() / C, R * problem.q, C * problem.psi.c)
        path = []
        scaled.solve(name, callback=lambda state, path=path: path.append(state.z), **options)
        np.testing.assert_allclose(min(np.abs(z / C - exact).max() for z in path), 0.0, atol=1e-8)


@pytest.mark.parametrize("name", ["newton", "lemke", "proximal"])
@pytest.mark.parametrize(
    ("A", "q", "psi", "z"),
    [
        ([[2.0]], [-1.0], 0.0, [0.5]),
        ([[0.0]], [1.0], 3.0, [3.0]),
        ([[2.0]], [-1.0], -np.inf, [0.5]),
        (PAIR, [1.0, 2.0], [-np.inf, 0.0], [-0.5, 0.0]),
        ([[2.0, -1.0], [0.0, 0.0]], [-1.0, 1.0], 0.0, [0.5, 0.0]),  # a zero row
        ([[0.0, 1.0], [-1.0, 0.0]], [-1.0, 2.0], 0.0, [2.0, 1.0]),  # a zero diagonal: A only turns
        ([[1.0, 0.0, 2.0], [2.0, 1.0, 0.0], [0.0, 2.0, 1.0]], [-1.0, -1.0, -1.0], 0.0, [1 / 3, 1 / 3, 1 / 3]),
    ],
)
def test_small_and_singular_problems_have_the_answers_found_by_hand(name, A, q, psi, z):
    for start in itertools.product([0.0, 1.0], repeat=len(z)):
        solution = icp.ICP(A, q, psi).solve(name, z0=start, rtol=1e-11, max_iter=5000)
        np.testing.assert_allclose(solution.z, z, atol=1e-8)


@pytest.mark.parametrize(
    "name",
    [None, *(name for name in MADE_FOR if name not in (None, "enumerate", "mms", "newton-josephy", "tridiagonal"))],
)
def test_upside_down_the_problem_has_the_answer_upside_down(name):
    """z ↦ −z turns (A, q, ψ, ψ̄) into (A, −q, −ψ̄, −ψ); and an upper obstacle that is never touched changes nothing."""
    problem = scenes.membrane(n=36).problem
    alone = problem.solve(name).z
    np.testing.assert_allclose(problem.with_upper(1e3).solve(name).z, alone, atol=1e-6)
    problem = problem.with_upper(0.3 - problem.r(np.zeros(36)))
    turned = icp.ICP(problem.A, -problem.q, -problem.upper.c, upper=problem.r(np.zeros(36)))
    np.testing.assert_allclose(turned.solve(name).z, -problem.solve(name).z, atol=1e-6)


@pytest.mark.parametrize("name", [None, "mnmgs", "newton", "multilevel", "accelerated"])
def test_obstacles_may_be_any_two_maps(name):
    """z = cos z in every row that touches the upper one, z = sin(z)/2 − 1 in those that touch the lower one; and the
    best of some jumps, which row 0 alone may make."""
    below = icp.Elementwise(lambda z: 0.5 * np.sin(z) - 1.0, lambda z: 0.5 * np.cos(z), lipschitz=0.5)
    above = icp.Function(np.cos, lambda z: sp.diags_array(-np.sin(z)), lipschitz=0.9)
    problem = icp.ICP(np.diag([2.0, 3.0, 2.0]), [-9.0, 9.0, 0.0], below, upper=above)
    np.testing.assert_allclose(problem.solve(name).z, [0.7390851332, -1.4987011335, 0.0], atol=1e-6)
    jumps = sp.csr_array((np.array([1.0]), (np.array([0]), np.array([1]))), shape=(3, 3))
    jumping = icp.ICP(2.0 * np.eye(3), [-8.0, -2.0, 2.0], upper=icp.Intervention(jumps, "min"))
    np.testing.assert_allclose(jumping.solve(name).z, [2.0, 1.0, 0.0], atol=1e-7)


@pytest.mark.parametrize("name", ["newton", "josephy", "multilevel"])
def test_a_slope_that_is_not_finite_is_named(name):
    psi = icp.Elementwise(np.sqrt, lambda z: np.where(z > 2, 0.5, np.inf))
    solution = icp.ICP(2.0 * np.eye(2), [-1.0, -1.0], psi).solve(name, raise_on_failure=False)
    assert solution.status is icp.Status.MAP_FAILED
    assert "psi's derivative is not finite" in solution.message
