"""What people write who come from other packages is taken, or answered by what to write instead."""

import numpy as np
import pytest
from known_answers import PAIR

import icpmodel as icp

A, Q = PAIR, np.array([-1.0, 3.0])
PROBLEM = icp.ICP(A, Q)


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
