"""The search before a small problem is given up."""

import numpy as np

import icpmodel as icp


def test_no_method_runs_twice_from_the_same_start(caplog):
    """No z solves this: p_0 ≥ 0 takes z_1 ≥ 1, where p_1 = z_1 > 0. A ψ that moves is behind a fixed one at first."""
    psi = icp.Elementwise(lambda s: 0.3 * np.sin(s), lambda s: 0.3 * np.cos(s), lipschitz=0.3)
    problem = icp.ICP([[0, 1], [0, 1]], [-1, 0], psi)
    with caplog.at_level("INFO", "icpmodel"):
        problem.solve(raise_on_failure=False, callback=lambda _: "a search of at most" in caplog.text)
    (begins,) = (one for one in caplog.messages if "a search of at most" in one and "Restarts(), " in one)
    methods = begins.split(" begins: ")[1].split(", ")
    assert "Newton()" in methods
    assert len(methods) == len(set(methods))


def test_the_message_names_the_search_alone_where_no_method_came_to_an_end():
    problem = icp.ICP([[0.0]], [1.0], lambda z: 0.3 * np.cos(z) - 0.09)
    message = problem.solve(raise_on_failure=False).message
    assert "stagnated: a search of at most" in message
