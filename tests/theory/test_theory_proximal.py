"""The proximal point theorem: where it holds, and that the page before a solve says so."""

import numpy as np

import icpmodel as icp
from icpmodel.theory import proximal_point


def test_explain_says_that_it_is_proved_where_a_is_monotone_and_psi_fixed():
    program = icp.ICP([[0.0, -1.0], [1.0, 0.0]], [1.0, -1.0])
    assert proximal_point(program).holds
    assert "Proximal() is proved (theorem proximal)" in program.explain().sections()["best proved"]
    indefinite = icp.ICP([[1.0, 3.0], [3.0, 1.0]], [1.0, 1.0])
    moving = icp.ICP(np.eye(2), [1.0, 1.0], icp.Affine([[0.0, 1.5], [0.0, 0.0]]))
    for problem in (indefinite, moving):
        assert proximal_point(problem).holds is False
        assert "Proximal()" not in problem.explain().sections()["best proved"]
