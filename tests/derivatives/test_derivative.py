"""The derivative of the answer, against exact rational ones, and what is said where there is none."""

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from exact import solve_rational
from hypothesis import given, settings
from hypothesis import strategies as st
from known_answers import PAIR, SEEDS

import icpmodel as icp
from icpmodel.numerics import work
from icpmodel.problem.affine import AffineData

FREE, BELOW, ABOVE = 0, 1, 2
KINDS = ["constant", "affine", "two-sided", "affine two-sided", "intervention", "elementwise"]


def bent(z):
    return np.where(np.abs(z) < 8, z**2 / 64.0, np.abs(z) / 4.0 - 1.0)


def bent_slope(z):
    return np.clip(z, -8, 8) / 32.0


class Exact:
    """A problem with integer data whose solution and sides are known: q and the obstacles are made for them."""

    def __init__(self, kind, n, seed):
        random = np.random.default_rng(seed)
        self.kind, self.n = kind, n
        A = random.integers(-2, 3, (n, n)) * (random.random((n, n)) < 0.6)
        np.fill_diagonal(A, np.abs(A).sum(axis=1) + 2)
        self.z = random.integers(-4, 5, n)
        self.sides = random.choice([FREE, BELOW, ABOVE] if "two" in kind else [FREE, BELOW], n)
        gap = random.integers(1, 5, n)
        pushes = np.select([self.sides == BELOW, self.sides == ABOVE], [gap, -gap], 0)
        self.A, self.q = A, pushes - A @ self.z
        below = np.where(self.sides == BELOW, 0, gap)  # r
        above = np.where(self.sides == ABOVE, 0, gap)  # ψ̄ − z
        G = random.integers(-1, 2, (n, n)) / 4.0 / n if "affine" in kind else np.zeros((n, n))
        self.G, self.slope = G, np.zeros((n, n))
        psi, upper = self.z - below, None
        if "two" in kind:
            upper = self.z + above
        if "affine" in kind:
            self.slope = np.where((self.sides == ABOVE)[:, None], -G, G)
            psi = icp.Affine(G, psi - G @ self.z)
            upper = None if upper is None else icp.Affine(-G, upper + G @ self.z)
        if kind == "elementwise":  # z²/64, and straight on from |z| = 8
            self.slope = np.diag(bent_slope(self.z))
            psi = icp.Elementwise(bent, bent_slope, 0.25, psi - bent(self.z))
        if kind == "intervention":
            self.targets = (np.arange(n) + 1) % n
            best = (np.arange(n), self.targets)
            # the last row has no jump, so that they end; a second jump is worse by 1
            gains = psi - self.z[self.targets]
            jumps = sp.lil_array((n, n))
            for i in range(n - 1):
                jumps[i, self.targets[i]] = gains[i] if gains[i] else 1e-300
                other = (i + 2) % n
                if other not in (i, self.targets[i]):
                    jumps[i, other] = psi[i] - 1 - self.z[other]
            self.jumps = sp.csr_array(jumps)
            self.jumps.data[np.abs(self.jumps.data) == 1e-300] = 0.0
            if self.sides[n - 1] == BELOW:
                self.sides[n - 1], self.q[n - 1] = FREE, -(A @ self.z)[n - 1]
            self.slope = np.zeros((n, n))
            self.slope[best] = 1.0
            self.slope[n - 1] = 0.0
            psi = icp.Intervention(self.jumps)
        self.problem = icp.ICP(A.astype(float), self.q.astype(float), psi, upper)

    def solution(self):
        return self.problem.solve(z0=self.z.astype(float), rtol=1e-12)

    def direction(self, seed):
        """Integer directions in all data, as keywords of forward."""
        random, n = np.random.default_rng(seed), self.n
        dA, dq, dc, dd = (random.integers(-3, 4, shape) for shape in ((n, n), n, n, n))
        dA = dA * (self.A != 0)
        told, moved = {"dA": dA, "dq": dq, "dpsi": dc}, (dc, dd)
        if "affine" in self.kind:
            dG = random.integers(-3, 4, (n, n)) * (self.G != 0)
            told["dpsi"], moved = (dG, dc), (dG @ self.z + dc, dd)
        if self.kind == "intervention":
            dK = sp.csr_array(self.jumps, copy=True)
            dK.data = random.integers(-3, 4, dK.nnz).astype(float)
            told["dpsi"], moved = dK, (dK.toarray()[np.arange(n), self.targets], dd)
        if "two" in self.kind:
            told["dupper"] = dd
        return told, (dA @ self.z + dq, *moved)

    def derivative(self, moved):
        """dz in exact arithmetic."""
        of_p, of_psi, of_upper = moved
        rows, right = [], []
        for i, side in enumerate(self.sides):
            own = [int(i == j) - Fraction(float(self.slope[i, j])) for j in range(self.n)]
            rows.append([Fraction(int(a)) for a in self.A[i]] if side == FREE else own)
            value = {FREE: -of_p[i], BELOW: of_psi[i], ABOVE: of_upper[i]}[int(side)]
            right.append(Fraction(float(value)))
        return np.array([float(x) for x in solve_rational(rows, right)])


@pytest.mark.parametrize("kind", KINDS)
@given(st.integers(2, 6), SEEDS)
@settings(max_examples=15)
def test_it_is_the_exact_derivative_within_its_bound_and_the_adjoint_agrees(kind, n, seed):
    known = Exact(kind, n, seed)
    derivative = known.solution().derivative()
    told, moved = known.direction(seed)
    exact = known.derivative(moved)
    # of jumps it is not always proved that there is one solution only
    assert derivative.certain or (kind == "intervention" and derivative.solution.error_bound is None)
    dz = derivative.forward(**told)
    assert np.abs(dz - exact).max() <= 1e-10 * (1 + np.abs(exact).max())
    bound = derivative.bound(dz, **told)
    assert (bound is None) is (kind == "elementwise" or not derivative.certain)
    if bound is not None:
        assert np.abs(dz - exact).max() <= bound + 1e-15 * np.abs(exact).max() <= 1e-8
    # the adjoint weighs the data as the derivative moves the answer
    zbar = np.random.default_rng(seed).integers(-3, 4, n).astype(float)
    gradient = derivative.adjoint(zbar)
    assert gradient.A.nnz == known.problem.A.nnz
    total = (gradient.A * told["dA"]).sum() + gradient.q @ told["dq"]
    if isinstance(gradient.psi, AffineData):
        total += (gradient.psi.G * told["dpsi"][0]).sum() + gradient.psi.c @ told["dpsi"][1]
    elif sp.issparse(gradient.psi):
        total += (gradient.psi * told["dpsi"]).sum()
    else:
        total += gradient.psi @ told["dpsi"]
    if "dupper" in told:
        # of an affine one only c moves
        total += gradient.upper_values @ told["dupper"]
    size = 1 + np.abs(gradient.q).sum() * np.abs(told["dA"]).sum() * (1 + np.abs(known.z).max())
    assert total == pytest.approx(zbar @ dz, abs=1e-11 * size)


def test_the_parameters_of_a_users_map_are_its_data():
    # ψ = θ₀ sin z + θ₁
    theta = np.array([0.3, 1.0])

    def problem(theta):
        psi = icp.Elementwise(
            lambda z: theta[0] * np.sin(z) + theta[1],
            lambda z: theta[0] * np.cos(z),
            lipschitz=abs(theta[0]),
            parameter_derivative=lambda z: np.column_stack([np.sin(z), np.ones_like(z)]),
        )
        return icp.ICP(PAIR, [1.0, -5.0], psi)

    derivative = problem(theta).solve(rtol=1e-13).derivative()
    for k, step in enumerate(1e-5 * np.eye(2)):
        quotient = (problem(theta + step).solve(rtol=1e-13).z - problem(theta - step).solve(rtol=1e-13).z) / 2e-5
        np.testing.assert_allclose(derivative.forward(dpsi=1e5 * step), quotient, atol=1e-7)
        np.testing.assert_allclose(derivative.adjoint([1.0, 2.0]).psi[k], quotient @ [1.0, 2.0], atol=1e-7)
    assert derivative.certain
    assert "given that psi is what the user says and continuously differentiable" in derivative.reason
    assert derivative.bound([0.0, 0.0], dq=[1.0, 1.0]) is None


@given(st.floats(-2, 2), st.floats(-2, 2))
@settings(max_examples=30)
def test_where_p_and_r_are_both_zero_the_derivatives_are_one_sided(dq, dc):
    derivative = icp.ICP([[2.0]], [-4.0], psi=2.0).solve().derivative()
    assert derivative.undecided.tolist() == [0]
    assert not derivative.certain
    right, left = derivative.one_sided(dq=[dq], dpsi=[dc])
    # z = max(-q/2, c)
    assert right == pytest.approx([max(-dq / 2, dc)], abs=1e-9)
    assert left == pytest.approx([min(-dq / 2, dc)], abs=1e-9)


@pytest.mark.parametrize("dq", [1.0, -1.0])
def test_two_obstacles_that_touch_leave_no_choice(dq):
    derivative = icp.ICP([[2.0]], [-4.0], psi=2.0, upper=2.0).solve().derivative()
    right, left = derivative.one_sided(dq=[dq])
    assert right == left == derivative.forward(dq=[dq]) == pytest.approx([0.0])


def test_a_contact_that_separates_leaves_no_friction_to_move():
    """z_n = 0 holds z_t between −0 and 0, also where the tangential velocity is 0."""
    problem = icp.ICP.from_friction_index(np.eye(2), [-1.0, 0.0], [0, -0.5], [np.inf, 0.5], [-1, 0])
    derivative = problem.solve().derivative()
    assert derivative.forward(dq=[0.0, -1.0]) == pytest.approx([0.0, 0.0])
    assert derivative.adjoint([0.0, 1.0]).q == pytest.approx([0.0, 0.0])


def test_the_gradient_by_A_has_the_pattern_of_A_beside_any_f():
    """Also where f′ cancels an entry of A: there 2z = 1, so that dz_0 = −(da_00 z_0 + da_01 z_1)/2."""
    f = icp.Function(lambda z: z[::-1] * 1.0, lambda z: np.eye(2)[::-1])
    problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, -1.0], f=f)
    gradient = problem.solve().derivative().adjoint([1.0, 0.0])
    assert gradient.A.toarray() == pytest.approx(np.array([[-0.25, -0.25], [0.0, 0.0]]))
    assert gradient.A.nnz == problem.A.nnz


def test_ties_at_the_lower_and_the_upper_obstacle_are_distinguished():
    problem = icp.ICP(2.0 * np.eye(3), [0.0, -2.0, -1.0], psi=0.0, upper=1.0)
    derivative = problem.solve().derivative()
    assert derivative.undecided.tolist() == [0, 1]
    right, left = derivative.one_sided(dq=[2.0, 2.0, 2.0])
    np.testing.assert_allclose(right, [0.0, -1.0, -1.0], atol=1e-9)
    np.testing.assert_allclose(left, [-1.0, 0.0, -1.0], atol=1e-9)


def test_of_two_equally_good_jumps_the_better_one_counts_afterwards():
    jumps = sp.csr_array([[0.0, -1.0, -1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    problem = icp.ICP(np.eye(3), [5.0, -2.0, -2.0], icp.Intervention(jumps))
    derivative = problem.solve().derivative()
    assert derivative.undecided.tolist() == [0]
    gains = sp.csr_array([[0.0, 1.0, 0.5], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    right, left = derivative.one_sided(dpsi=gains)
    np.testing.assert_allclose(right, [1.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(left, [0.5, 0.0, 0.0], atol=1e-9)


def test_without_a_certificate_nothing_is_certain_and_the_sides_are_those_of_z():
    # A is no P-matrix: there is another solution
    derivative = icp.ICP([[-1.0]], [1.0]).solve(z0=[1.0], method="newton").derivative()
    assert not derivative.certain
    assert "no error bound" in derivative.reason
    right, left = derivative.one_sided(dq=[1.0])
    np.testing.assert_allclose([right, left], derivative.forward(dq=[1.0])[None].repeat(2, 0))


def test_wrong_arguments_of_the_derivative_are_named():
    problem = icp.ICP(PAIR, [-1.0, 3.0])
    derivative = problem.solve().derivative()
    with pytest.raises(icp.InputError, match=r"dq has shape \(3,\); shape \(2,\) was expected"):
        derivative.forward(dq=[1.0, 2.0, 3.0])
    with pytest.raises(icp.InputError, match="dupper was given, but the problem has no upper obstacle"):
        derivative.forward(dupper=1.0)
    with pytest.raises(icp.InputError, match=r"zbar\[0\] is nan"):
        derivative.adjoint([np.nan, 1.0])
    for wrong in ((1, 2, 3), "a", {"a": 1}):
        with pytest.raises(icp.InputError, match=r"^dpsi"):
            problem.with_psi(icp.Affine(np.zeros((2, 2)))).solve().derivative().one_sided(dpsi=wrong)
    with pytest.raises(icp.NotApplicable, match="give `jacobian` to Function"):
        problem.with_psi(lambda z: 0.1 * z).solve().derivative()
    with pytest.raises(icp.InputError, match="not solved"):
        problem.solve("mnmgs", max_iter=0, raise_on_failure=False).derivative()


def test_equations_that_are_singular_but_for_rounding_are_said_to_be():
    n = 80
    B = np.random.default_rng(n).normal(size=(n, n - 1))
    z = np.ones(n)
    problem = icp.ICP(B @ B.T, -B @ (B.T @ z), psi=-10.0)
    derivative = problem.solve(z0=z, raise_on_failure=False).derivative()
    with pytest.raises(icp.SingularOperator, match="the equations of the active set are singular"):
        derivative.forward(dq=np.arange(n))
    with pytest.raises(icp.SingularOperator):
        derivative.adjoint(np.arange(n))


def test_an_obstacle_that_has_no_value_at_0_has_a_derivative_elsewhere():
    def logarithm(z):
        if (z <= 0).any():
            raise ValueError("not here")
        return np.log(z)

    psi = icp.Elementwise(logarithm, lambda z: 1.0 / z, c=1.0)  # 1 + log z touches z at 1, and is below it
    derivative = icp.ICP([[1.0]], [-2.0], psi).solve("newton", z0=[3.0]).derivative()
    assert derivative.forward(dq=[1.0]) == pytest.approx([-1.0])


@pytest.mark.parametrize("A", [np.zeros((2, 2)), np.ones((2, 2)), np.array([[1.0, -1.0], [-1.0, 1.0]])])
def test_one_sided_derivatives_need_no_regular_equations(A):
    derivative = icp.ICP(A, [0.0, 0.0]).solve().derivative()
    with pytest.raises(icp.SingularOperator, match="one_sided may have an answer"):
        derivative.forward(dq=[1.0, 1.0])
    for end, sign in zip(derivative.one_sided(dpsi=1.0), (1.0, -1.0), strict=True):
        np.testing.assert_allclose(np.minimum(sign * end - sign, sign * (A @ end)), 0.0, atol=1e-9)


def test_a_bound_keeps_to_the_limits_of_the_certificate():
    problem = icp.scenes.scene("membrane", 400).problem
    derivative = problem.solve().derivative()
    ones = np.ones(problem.n)
    dz = derivative.forward(dq=ones)
    assert derivative.certain
    with work.work_limit(nanoseconds=1.0):
        assert derivative.bound(dz, dq=ones) is None
    assert derivative.bound(dz, dq=ones) < 1e-9


def test_obstacles_that_touch_are_not_moved_through_each_other():
    derivative = icp.ICP([[2.0]], [-1.0], psi=1.0, upper=1.0).solve().derivative()
    for derive in (derivative.forward, derivative.one_sided):
        with pytest.raises(icp.InputError, match=r"dpsi\[0\] is above dupper\[0\] where the obstacles touch"):
            derive(dpsi=1.0)
    assert derivative.forward(dpsi=1.0, dupper=1.0) == pytest.approx([1.0])
