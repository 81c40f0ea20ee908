"""An ICP as a CVXPY problem has the ICP's answer, and is refused with a reason where it has no such form."""

import cvxpy as cp
import numpy as np
import pytest

import icpmodel as icp


def a_problem(seed, *, symmetric=False, affine=False, free=False):
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 7))
    B = random.normal(size=(n, n))
    A = B @ B.T + n * np.eye(n) + (0 if symmetric else 0.3 * (B - B.T))
    c = random.normal(size=n)
    if free:
        c[random.integers(n)] = -np.inf
    G = 0.1 * random.uniform(-1, 1, (n, n)) / n
    return icp.ICP(A, random.normal(size=n) * 3, icp.Affine(G, c) if affine else c)


def answer(model):
    model.solve(solver="HIGHS" if model.is_mixed_integer() else "CLARABEL")
    assert model.status == cp.OPTIMAL
    return model.var_dict["z"].value


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(
    "kind", [{}, {"symmetric": True}, {"affine": True}, {"free": True}, {"free": True, "affine": True}]
)
@pytest.mark.parametrize("formulation", ["qp", "mip"])
def test_the_round_trip_ends_at_the_same_z(seed, kind, formulation):
    """A symmetric or not, ψ constant or affine, with a row without obstacle; P-matrices, so that z* is the only one."""
    problem = a_problem(seed, **kind)
    if formulation == "mip" and not problem.solve().certificate.unique:
        pytest.skip("no bounds on p and r")
    z = problem.solve().z
    assert answer(problem.to_cvxpy(formulation)) == pytest.approx(z, abs=1e-4 * (1 + np.abs(z).max()))


def test_the_gap_is_zero_at_the_answer_and_the_energy_its_value():
    gap = a_problem(1, affine=True)
    model = gap.to_cvxpy()
    z = answer(model)
    assert model.value == pytest.approx(0, abs=1e-5)
    assert model.value == pytest.approx(gap.p(z) @ gap.r(z), abs=1e-7)
    energy = a_problem(1, symmetric=True)
    model = energy.to_cvxpy()
    z = answer(model)
    assert model.value == pytest.approx(0.5 * z @ energy.A @ z + energy.q @ z)
    assert model.constraints[0].dual_value == pytest.approx(energy.p(z), abs=1e-4)


def test_the_mixed_integer_form_needs_no_convexity():
    problem = icp.ICP([[1.0, 0.0], [-4.0, 1.0]], [-1.0, 1.0], 0.0)  # a P-matrix, A + A' is indefinite
    with pytest.raises(icp.NotApplicable, match=r"no convex QP: A \+ A' is not positive semidefinite.*'mip'"):
        problem.to_cvxpy()
    assert answer(problem.to_cvxpy("mip")) == pytest.approx([1, 3])


def test_what_was_written_and_read_again_is_the_same_icp():
    """p and r of the written model, paired: A and q, and ψ with each row divided by 1 − g_ii."""
    problem = a_problem(4, affine=True)
    p, r = (row.args[1] for row in problem.to_cvxpy().constraints)
    read = icp.Problem(icp.complements(p, r)).icp()
    assert read.A.toarray() == pytest.approx(problem.A.toarray())
    assert read.q == pytest.approx(problem.q)
    own = problem.psi.G.diagonal()
    others = problem.psi.G.toarray() - np.diag(own)
    assert read.psi.G.toarray() == pytest.approx(others / (1 - own)[:, None])
    assert read.psi.c == pytest.approx(problem.psi.c / (1 - own))


def test_what_has_no_such_form_is_refused():
    problem = icp.ICP([[2.0]], [1.0])
    with pytest.raises(icp.InputError, match="formulation is 'lp'; 'qp' or 'mip' was expected"):
        problem.to_cvxpy("lp")
    with pytest.raises(icp.NotApplicable, match=r"not Function.sin.: freeze its obstacle"):
        icp.ICP([[2.0]], [1.0], np.sin).to_cvxpy()
    with pytest.raises(icp.NotApplicable, match="no bounds on p and r for a mixed-integer program"):
        icp.ICP(np.kron(np.eye(7), [[0.0, 1.0], [-1.0, 0.0]]), np.ones(14)).to_cvxpy("mip")
