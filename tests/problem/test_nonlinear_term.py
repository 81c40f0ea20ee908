"""p = Az + q + f(z): what reads p sees f, its derivative is there in any case, and what needs affine p refuses."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
import scipy.sparse as sp
from known_answers import chain

import icpmodel as icp
from icpmodel import ICP

A = chain(3, 4.0).toarray()
Q = np.array([-9.0, 2.0, -40.0])
Z = np.array([0.5, 1.0, 2.0])


def cubes(z: np.ndarray) -> np.ndarray:
    """f(z) = z³ plus a coupling."""
    return z**3 + np.array([0.0, z[0], z[1]])


COUPLED = np.diag(3.0 * Z**2) + np.diag([1.0, 1.0], -1)
PATTERN = np.eye(3) + np.eye(3, k=-1)
FORMS = {
    "callable": (cubes, COUPLED),
    "pattern": (icp.Function(cubes, sparsity=PATTERN), COUPLED),
    "function": (icp.Function(cubes, lambda z: np.diag(3.0 * z**2) + np.diag([1.0, 1.0], -1)), COUPLED),
    "elementwise": (icp.Elementwise(np.exp, np.exp, c=1.0), np.diag(np.exp(Z))),
    "no derivative": (icp.Elementwise(np.exp), np.diag(np.exp(Z))),
    "affine": (icp.Affine(PATTERN, 2.0), PATTERN),
}


@pytest.mark.parametrize("sparse", [False, True])
@pytest.mark.parametrize("form", FORMS)
def test_every_form_of_f_has_its_tangent(form, sparse):
    f, jacobian = FORMS[form]
    problem = ICP(sp.csr_array(A) if sparse else A, Q, f=f)
    assert problem.p(Z) == pytest.approx(A @ Z + Q + problem.f.value(Z))
    tangent = problem.linearised(Z)
    assert tangent.f is None
    assert tangent.dense() == pytest.approx(A + jacobian, abs=1e-6)
    assert tangent.p(Z) == pytest.approx(problem.p(Z), abs=1e-12)


def test_what_makes_another_problem_keeps_f():
    problem = ICP(A, Q, f=cubes)
    for other in (problem.with_psi(-1.0), problem.with_upper(9.0), problem.frozen(Z), problem.with_q(Q)):
        assert (other.p(Z) == problem.p(Z)).all()
    again = pickle.loads(pickle.dumps(ICP(A, Q, -1.0, 5.0, f=np.exp)))
    assert (again.p(Z) == A @ Z + Q + np.exp(Z)).all()
    assert again.upper.value(Z)[0] == 5.0
    assert not problem.is_lcp


def test_an_affine_problem_has_no_f_and_is_its_own_tangent():
    problem = ICP(A, Q)
    assert problem.linearised(Z) is problem
    assert problem.offset(Z) is problem.q


@pytest.mark.parametrize("t", [1e-9, 1.0, 1e9])
def test_no_scaling_of_rows_of_p_changes_the_residual(t):
    scales = np.array([t, 1.0, 3.0])
    scaled = ICP(scales[:, None] * A, scales * Q, f=lambda z: scales * cubes(z))
    assert scaled.residual(Z) == pytest.approx(ICP(A, Q, f=cubes).residual(Z), rel=1e-6)


@pytest.mark.parametrize("width", [1.0, 0.1, 0.02, 0.005, 1e-4])
def test_slopes_that_are_far_larger_near_1_leave_a_tolerance_above_rounding(width):
    """The root of exp(z/w) = c is w·log c, where the slope is c/w; near 1 it is exp(1/w)/w."""
    c = np.linspace(1.5, 3.0, 20)
    problem = ICP.nonlinear(
        lambda z: np.exp(z / width) - c, lambda z: np.diag(np.exp(z / width) / width), psi=np.full(20, -np.inf)
    )
    with np.errstate(over="ignore"):
        solution = problem.solve()
    assert solution.z == pytest.approx(width * np.log(c), rel=1e-7)


def test_a_slope_without_bound_hides_no_p():
    """p = √z − 1 < 0 at z next to 0, where its slope is 1e10: no solution."""
    problem = ICP.nonlinear(lambda z: np.sqrt(z) - 1.0, n=1)
    assert problem.residual([1e-20]) > 0.1
    assert problem.solve(z0=[1e-20]).z == pytest.approx([1.0])


@pytest.mark.parametrize(
    ("made", "error", "told"),
    [
        (lambda: ICP(A, Q, f=3.0), icp.InputError, "f is 3.0"),
        (lambda: ICP(A, Q, f=icp.Constant(1.0)), icp.InputError, "f is"),
        (lambda: ICP(A, Q, f=icp.Affine(np.eye(2))), icp.InputError, "shape"),
        (lambda: ICP(A, Q, f=lambda z, y: z), icp.InputError, r"f is a function of \(z, y\)"),
        (lambda: ICP(A, Q, f=lambda z: z[0]).p(Z), icp.MapError, r"f\(z\) has shape"),
        (lambda: ICP(A, Q, f=lambda z: 1 / 0).p(Z), icp.MapError, r"f\(z\) raised"),
        (lambda: icp.save_problem(ICP(A, Q, f=cubes), "never.npz"), icp.InputError, "f is"),
        (lambda: ICP.nonlinear(cubes), icp.InputError, "n is not known"),
        (lambda: ICP.nonlinear(cubes, [0, 0, 0]), icp.InputError, r"jacobian is \[0, 0, 0\]"),
        (lambda: ICP.nonlinear(cubes, lower=0), icp.InputError, "ICP.nonlinear has no argument lower; it takes F, jac"),
        (lambda: ICP.nonlinear(cubes, sparsity=np.eye(2), n=3), icp.InputError, "Function.sparsity"),
        (lambda: ICP.nonlinear(np.log, n=1).linearised([0.0]), icp.MapError, "f"),
        (lambda: ICP(sp.eye_array(2000), np.ones(2000), f=np.exp), icp.InputError, "f has no derivative"),
        (lambda: ICP.nonlinear(lambda z: z / z, n=1).solve(), icp.MapError, r"f\(z\)\[0\] is nan at the start"),
    ],
)
def test_errors_speak_of_f(made, error, told):
    with np.errstate(all="ignore"), pytest.raises(error, match=told):
        made()


def test_differences_go_backwards_in_the_rows_alone_that_end_forwards():
    """z² ends at 0 below in one row and at 1 above in the other; both columns share one colour."""
    ends = np.array([0.0, -1.0]), np.array([2.0, 1.0])
    f = icp.Function(lambda z: np.where((ends[0] <= z) & (z <= ends[1]), z**2, np.nan), sparsity=np.eye(2))
    tangent = ICP(np.eye(2), np.ones(2), f=f).linearised([0.0, 1.0])
    assert tangent.dense() == pytest.approx(np.diag([1.0, 3.0]), abs=1e-6)


REFUSING = {
    "race": lambda problem: problem.race(),
    "stability": lambda problem: problem.stability(),
    "to_cvxpy": lambda problem: problem.to_cvxpy(),
    "contradiction": icp.contradiction,
    "newton": lambda problem: problem.solve("newton"),
    "lemke": lambda problem: problem.solve("lemke"),
    "select": icp.select_method,
}


@pytest.mark.parametrize("verb", REFUSING)
def test_what_needs_affine_p_refuses(verb):
    """Never a wrong answer: whoever knows nothing of f says so."""
    with pytest.raises(icp.NotApplicable, match="linearised"):
        REFUSING[verb](ICP(A, Q, f=cubes))


def test_every_method_says_whether_it_takes_f_and_explain_repeats_it():
    """A page for every f, although the theorems on steps have affine p."""
    for f in (cubes, icp.Elementwise(np.exp, slope_range=(0, np.inf)), icp.Elementwise(np.arctan, slope_range=(0, 1))):
        problem = ICP(A, Q, f=f)
        page = problem.explain()
        methods = page.sections()["methods"]
        assert page.bound.unique is isinstance(f, icp.Elementwise)
        for name in icp.methods.names():
            why_not = icp.methods.named(name).why_not(problem)
            assert why_not is None or " ".join(why_not.split()[:3]) in " ".join(methods.split())
        assert page.about()["nonlinear_part_f"][0].startswith(repr(problem.f))
    logarithm = icp.Elementwise(lambda z: np.array([math.log(t) for t in z]), slope_range=(0, np.inf))
    assert "at z = 0" in ICP([[1.0]], [1.0], f=logarithm).explain().sections()["solution"]
    with pytest.raises(icp.NotApplicable, match="linearised"):
        problem.explain("psor")
