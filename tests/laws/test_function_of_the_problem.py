"""Law 6: `solve()` is a function of the problem and its options, whatever was asked before."""

from contextlib import suppress

import numpy as np
import pytest
import scipy.sparse as sp
from known_answers import attempt, sine

import icpmodel as icp
from icpmodel import scenes

SCENES = {
    "bai-nonsymmetric": 400,
    "dividend": 211,
    "hand-affine": None,
    "hand-cyclic": None,
    "hard-degenerate": 400,
    "hard-singular": None,
    "manufactured-affine": 400,
    "membrane": 900,
}


def random_problem(seed):
    """Dominant, indefinite and block triangular matrices, dense and sparse, with every kind of ψ."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 120))
    A = rng.normal(size=(n, n)) * (rng.random((n, n)) < 5 / n)
    if seed % 3 < 2:
        np.fill_diagonal(A, (0.9, 1.2)[seed % 3] * np.abs(A).sum(axis=1) + 0.1)
    else:
        A = np.tril(A, -1) + np.diag(rng.uniform(0.5, 2.0, n))
        k = min(n, 80)
        A[:k, :k] += rng.normal(size=(k, k)) / 20
    c = np.where(rng.random(n) < 0.2, -np.inf, rng.normal(size=n))
    psi = (
        c,
        icp.Affine(0.2 * sp.random_array((n, n), density=2 / n, rng=rng), c),
        sine(0.3, c),
        icp.Function(lambda z: 0.2 * np.roll(np.sin(z), 1) - 1.0),
    )[seed % 4]
    return icp.ICP(A if seed % 2 else sp.csr_array(A), rng.normal(size=n), psi)


def use(problem):
    """Everything that may leave something behind."""
    with suppress(icp.IcpError):
        icp.error_bound(problem, np.zeros(problem.n))
    with suppress(icp.IcpError):
        icp.error_bound(problem, np.ones(problem.n), sharp=True)
    pivots = ("lemke",) if problem.n <= 1000 else ()  # an iterate is n pivots, of n² operations each
    for method in ("psor", "newton", "mnmmod", "accelerated", *pivots, "multilevel"):
        with suppress(icp.IcpError):
            str(attempt(problem, method, max_iter=20))
    if problem.n <= 60 or problem.n > 150:  # else a page takes seconds, as what is proved is sought in many ways
        str(problem.explain())
    with suppress(icp.IcpError):
        solution = attempt(problem)
        str(icp.certify(problem, solution)), solution.certificate, solution.active_set
        problem.crosscheck(solution, ["osqp"])
        problem.solve(accuracy=1e-3)


def answer(problem, **options):
    solution = attempt(problem, max_iter=1000, **options)
    last = repr(solution.last_method)
    return solution.z.tobytes(), repr(solution.method), last, solution.status, solution.iterations, solution.why


def check(make, **options):
    fresh, used = make(), make()
    use(used)
    assert answer(fresh, **options) == answer(used, **options)
    again = used.with_q(used.q)  # what is shared, too
    assert answer(again, **options) == answer(fresh, **options)


@pytest.mark.parametrize("name", SCENES)
def test_a_used_scene_is_solved_like_a_fresh_one(name):
    check(lambda: scenes.scene(name, SCENES[name]).problem)


@pytest.mark.parametrize("seed", range(8))
def test_a_used_problem_is_solved_like_a_fresh_one(seed):
    check(lambda: random_problem(seed))


@pytest.mark.parametrize("seed", range(2))
def test_options_make_no_difference_to_that(seed):
    check(lambda: random_problem(seed), rtol=1e-12)
    check(lambda: random_problem(seed), method="accelerated", rtol=1e-6)
