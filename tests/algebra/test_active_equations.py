"""The linear systems of Newton's method and of derivatives, and their transposes: by elimination, and by V-cycles."""

import numpy as np
import pytest
import scipy.sparse as sp
from known_answers import chain

import icpmodel as icp
from icpmodel import scenes
from icpmodel.algebra.active_equations import ActiveEquations


def derivatives(rng, n):
    """Derivatives of ψ of every kind: jumps in chains and in circles, slopes of one's own, and full ones."""
    jumps = np.zeros((n, n))
    jumps[np.arange(1, n), rng.integers(0, np.arange(1, n))] = 1.0
    circle = np.roll(np.eye(n), 1, axis=1)
    own = np.diag(rng.uniform(-2.0, 0.9, n))
    unit = np.eye(n) + 0.5 * circle  # I − ψ′ has no diagonal
    return {
        "none": 0 * own,
        "unit slope": unit,
        "jumps": jumps,
        "circle": 0.9 * circle,
        "own": own,
        "own and jumps": own + 0.3 * jumps,
        "full": rng.normal(size=(n, n)) / n,
    }


KINDS = sorted(derivatives(np.random.default_rng(0), 3))


def solves(equations, J, f, tolerance=1e-12, size=1e-9):
    """Whether both systems with J, dense or sparse, are solved by `equations`."""
    x, y = equations.solve(f, tolerance), equations.solve(f, tolerance, True)
    return J @ x == pytest.approx(f, abs=size) and J.T @ y == pytest.approx(f, abs=size)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [2, 80])
def test_both_systems_are_solved_whatever_psi_and_the_active_set_are(kind, n):
    """I − ψ′ in the active rows and A in the others, and its transpose, though the active unknowns are eliminated."""
    rng = np.random.default_rng(n)
    for share in (0.0, 0.3, 0.9, 1.0):
        jacobian = derivatives(rng, n)[kind]
        problem = icp.ICP(n * np.eye(n) + rng.normal(size=(n, n)), np.zeros(n))
        active = rng.random(n) < share
        J = np.where(active[:, None], np.eye(n) - jacobian, problem.A.toarray())
        assert solves(ActiveEquations(problem, active, sp.csr_array(jacobian)), J, rng.normal(size=n))


def test_singular_equations_have_no_solution():
    """Jumps in a circle, a row that moves with itself as fast as ψ does, and free rows that are alike."""
    n, everywhere, nowhere = 3, np.ones(3, dtype=bool), np.zeros(3, dtype=bool)
    problem, f = icp.ICP(np.ones((n, n)), np.zeros(n)), np.array([1.0, 2.0, 3.0])
    for active, jacobian in (
        (everywhere, np.roll(np.eye(n), 1, axis=1)),
        (everywhere, np.eye(n)),
        (nowhere, np.eye(n)),
    ):
        for by_cycles in (True, False):
            equations = ActiveEquations(problem, active, sp.csr_array(jacobian), by_cycles)
            assert equations.solve(f, 1e-8) is None
            assert equations.solve(f, 1e-8, True) is None


def rows_of(problem, active, jacobian):
    """J, sparse."""
    held = sp.diags_array(active.astype(float))
    return sp.csr_array(problem.A - held @ problem.A + held @ (sp.eye_array(problem.n) - jacobian))


@pytest.mark.parametrize("skew", [0.0, 0.4])
def test_cycles_solve_both_systems_of_a_membrane(skew):
    """n = 10 000, on a disc in the middle, with many right-hand sides on one hierarchy; no factorisation is made."""
    problem = scenes.membrane(n=10_000, skew=skew).problem
    active = np.hypot(*(scenes.membrane(n=10_000).points - 0.5).T) < 0.3
    jacobian = problem.psi.jacobian(problem.q)
    equations, J = ActiveEquations(problem, active, jacobian, by_cycles=True), rows_of(problem, active, jacobian)
    rng = np.random.default_rng(2)
    for _ in range(3):
        w, d = rng.normal(size=(2, problem.n))
        x, y = equations.solve(d, 1e-10), equations.solve(w, 1e-10, True)
        assert np.linalg.norm(J @ x - d) <= 1e-9 * np.linalg.norm(d)
        assert np.linalg.norm(J.T @ y - w) <= 1e-9 * np.linalg.norm(w)
        assert np.linalg.norm(J @ equations.solve(d, 1e-3) - d) > 1e-9 * np.linalg.norm(d)  # inexact: by cycles
        assert w @ x == pytest.approx(y @ d, rel=1e-7)


def large(kind, n):
    """Derivatives of ψ that leave the free rows to V-cycles: own slopes, some of 1, and neighbours on a grid."""
    rng, m = np.random.default_rng(3), round(n**0.5)
    beside = sp.kron(sp.eye_array(m), sp.diags_array([0.2, 0.2], offsets=[-1, 1], shape=(m, m)))
    own = sp.diags_array(rng.uniform(-1.0, 0.8, n))
    return sp.csr_array(
        {"own": own, "steep": sp.diags_array(np.full(n, 0.98)), "beside": beside, "both": 0.5 * own + beside}[kind]
    )


@pytest.mark.parametrize(
    ("kind", "skew", "unit"), [("own", 0.0, 1e8), ("steep", 0.4, 1.0), ("beside", 0.0, 1.0), ("both", 0.4, 1e8)]
)
def test_cycles_follow_a_psi_that_moves(kind, skew, unit):
    """In units of z, so that active rows are solved as well as free ones whatever A is measured in."""
    n = 900
    problem = icp.ICP(unit * scenes.membrane(n=n, skew=skew).problem.A, np.zeros(n))
    active, jacobian = np.random.default_rng(4).random(n) < 0.3, large(kind, n)
    J = rows_of(problem, active, jacobian)
    z, w = np.random.default_rng(6).normal(size=(2, n))
    equations = ActiveEquations(problem, active, jacobian, by_cycles=True)
    assert equations.solve(J @ z, 1e-10) == pytest.approx(z, abs=1e-6)
    assert equations.solve(J.T @ w, 1e-10, True) == pytest.approx(w, abs=1e-6 * unit)


def test_what_cycles_cannot_do_is_eliminated():
    """A matrix without a positive diagonal has no hierarchy, one with wild signs one that leads nowhere."""
    n, rng = 300, np.random.default_rng(7)
    active = rng.random(n) < 0.5
    for A in (rng.normal(size=(n, n)), np.abs(rng.normal(size=(n, n))) + np.eye(n)):
        problem, jacobian = icp.ICP(A, np.zeros(n)), sp.csr_array((n, n))
        J = np.where(active[:, None], np.eye(n), A)
        assert solves(ActiveEquations(problem, active, jacobian, by_cycles=True), J, rng.normal(size=n), size=1e-7)


def test_the_foreseen_cost_decides_between_cycles_and_factors():
    """As for any matrix: a grid in the plane of some size is for cycles, which stop at the tolerance, a line is not."""
    f = np.random.default_rng(8).normal(size=76**2)
    line = chain(76**2)
    for A, inexact in ((scenes.membrane(n=230**2).problem.A, True), (line, False)):
        f = np.random.default_rng(8).normal(size=A.shape[0])
        equations = ActiveEquations(icp.ICP(A, f), np.zeros(f.size, dtype=bool), sp.csr_array(A.shape))
        assert bool(np.linalg.norm(A @ equations.solve(f, 1e-2) - f) > 1e-9 * np.linalg.norm(f)) is inexact
