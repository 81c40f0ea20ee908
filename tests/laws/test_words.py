"""What people write who come from other packages is taken, or answered by what to write instead."""

import inspect

import numpy as np
import pytest
from known_answers import PAIR
from public_names import public_objects

import icpmodel as icp

A, Q = PAIR, np.array([-1.0, 3.0])
PROBLEM = icp.ICP(A, Q)
#: what the shell and Pyomo call, and the classes that the package makes: these list no parameters
OTHERS = {"main", "pyomo_solver", "PyomoSolver"}


@pytest.mark.parametrize(
    ("call", "instead"),
    [
        (lambda: icp.solve(A, Q, 0.0), "ICP(A, q, psi).solve()"),
        (lambda: icp.solve(A=A, q=Q), "ICP(A, q, psi).solve()"),
        (lambda: icp.explain(A), "ICP(A, q, psi)"),
        (lambda: PROBLEM.solve(tol=1e-6), "did you mean rtol?"),
        (lambda: PROBLEM.solve("mnmgs", tol=1e-6), "did you mean rtol?"),
        (lambda: PROBLEM.solve(maxiter=9), "did you mean max_iter?"),
        (lambda: PROBLEM.solve().history.residual, "history=True"),
        (lambda: icp.Function(np.sin, derivative=np.cos), "did you mean jacobian?"),
        (lambda: icp.study.figure(PROBLEM.solve(), shape=(2, 3)), "shape is (2, 3); (ny, nx) or"),
    ],
)
def test_the_message_says_what_to_write(call, instead):
    with pytest.raises(icp.InputError) as error:
        call()
    assert instead in str(error.value)


def test_a_number_stands_for_all_entries_of_q():
    assert icp.ICP(A, -1.0).q.tolist() == [-1.0, -1.0]
    assert icp.solve_qp(A, -1.0).x == pytest.approx([1.0, 1.0])


def test_a_solution_is_true_where_it_is_one():
    assert PROBLEM.solve()
    assert not PROBLEM.solve("mnmgs", max_iter=0, raise_on_failure=False)


def test_whatever_users_call_names_the_arguments_that_it_takes():
    """Law 8, for an argument that it does not have and for one that is missing."""
    for name, value in public_objects():
        users_call_it = inspect.isfunction(value) or "\nParameters\n" in inspect.getdoc(value)
        if not users_call_it or name.rpartition(".")[2] in OTHERS:
            continue
        parameters = inspect.signature(value).parameters.values()
        needed = [one for one in parameters if one.default is one.empty and "VAR" not in one.kind.name]
        for wrong in [{"nothing": 1}, {}][: 1 + bool(needed)]:
            with pytest.raises(icp.InputError, match="; it takes "):
                value(**wrong)
