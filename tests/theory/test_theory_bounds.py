"""Error bounds against exact rational solutions, and the certified active set."""

import numpy as np
import pytest
from conformance import WITH_Z
from exact import exceeds, solutions
from hypothesis import given, settings
from known_answers import GENERATORS, PAIR, sine

import icpmodel as icp
from icpmodel.theory.certificates import definite, h_plus
from icpmodel.theory.certificates.bounds import h_plus_proof


class TestNeverBelowTheTrueError:
    """The bound is a proof: in more than 10⁵ trials against solutions in rational arithmetic it never fails."""

    def test_underflow_of_a_quotient_is_not_lost(self):
        """F/α = 1e-325 is 0 in floats, but v multiplies it by 1e13."""
        problem = icp.ICP([[1e10, -1e23], [0, 1e10]], [0, -1e-315], -np.inf)
        exact = solutions(problem)[0]
        proof = h_plus_proof(problem)
        z = np.zeros(2)
        delta, _ = proof.bound(problem, z, *problem.rounding(z))
        assert exceeds(z, exact, delta) == []

    def test_a_jacobian_that_fails_costs_sharpness_only(self):
        psi = icp.Function(lambda z: 0.3 * z, jacobian=lambda z: np.full((1, 1), np.nan), lipschitz=0.3)
        bound = icp.error_bound(icp.ICP([[2.0]], [-2.0], psi), [1.5])
        assert bound.value >= 0.5


class TestSharpness:
    @pytest.mark.parametrize("name", WITH_Z)
    @pytest.mark.parametrize("size", [1e-8, 1.0])
    def test_bound_over_error_is_small_and_never_below_1_on_every_scene_with_an_exact_solution(self, name, size):
        n = 100 if "n" in icp.scenes.parameters(name) else None
        scene = icp.scenes.scene(name, n)
        rng = np.random.default_rng(0)
        ratios = []
        for _ in range(3):
            z = scene.z_exact + size * rng.uniform(-1, 1, scene.problem.n)
            bound = icp.error_bound(scene.problem, z)
            if bound.value is None:
                assert name in ("hard-empty-row", "hard-overflow", "hard-semidefinite")
                return
            ratios.append(bound.value / np.abs(z - scene.z_exact).max())
        assert np.median(ratios) <= 10 or name in ("hard-scaled", "hard-singular")  # rounding alone is larger there
        assert min(ratios) >= 1

    def test_a_users_function_has_no_rigorous_bound(self):
        problem = icp.ICP([[2.0]], [-1.0], sine(0.5))
        assert icp.error_bound(problem, [0.0]).unique
        bound = icp.error_bound(problem, [0.0], rigorous=True)
        assert bound.value is None
        assert "user's function" in bound.reason


class TestScalingVectors:
    @settings(max_examples=40)
    @given(rng=GENERATORS)
    def test_a_vector_for_a_and_psi_is_found_exactly_where_there_is_one(self, rng):
        """v with ⟨A⟩v > 0 and Gv < v exists iff every choice of rows of D⁻¹|B| and G has spectral radius < 1."""
        n = 4
        B = rng.random((n, n)) * (rng.random((n, n)) < 0.6)
        np.fill_diagonal(B, 0.0)
        G = rng.random((n, n)) * (rng.random((n, n)) < 0.6) * rng.choice([0.3, 0.6, 1.0])
        radius = max(
            np.abs(np.linalg.eigvals(np.where(np.array(rows)[:, None], G, B))).max()
            for rows in np.ndindex(*(2,) * n)
            for rows in [np.array(rows, dtype=bool)]
        )
        if abs(radius - 1) > 1e-6:
            found = h_plus_proof(icp.ICP(np.eye(n) - B, np.zeros(n), icp.Affine(G)))
            assert isinstance(found, str) == (radius >= 1)


def test_in_the_active_set_psi_may_move_by_what_z_is_wrong():
    """z* = 0 touches with p* = 0.1; at z = (2, 2) |z − z*| ≤ 2 < r = 3.8, but ψ changes by 1.8 as well."""
    problem = icp.ICP([[1.0, -0.5], [-0.5, 1.0]], [0.1, 0.1], icp.Affine(-0.9 * np.eye(2)))
    z, delta = np.full(2, 2.0), np.full(2, 2.0)
    known = icp.theory.active_set(problem, z, icp.ErrorBound(2.0, delta, 3.0, "z* = 0", ""))
    assert known.undecided.all()


@pytest.mark.parametrize("kind", [h_plus, definite])
def test_where_psi_is_steeper_than_z_there_are_two_solutions_and_no_proof(kind):
    """z = 0, and z = 2 sin z with p = z > 0."""
    psi = icp.Function(lambda z: 2 * np.sin(z), lambda z: np.diag(2 * np.cos(z)), lipschitz=2.0)
    problem = icp.ICP([[1.0]], [0.0], psi)
    assert isinstance(kind.prove(problem.matrix, problem.psi), str)


def test_a_z_that_is_not_finite_is_named():
    problem = icp.ICP(PAIR, [1.0, -2.0])
    for z, words in (([np.nan, 2.0], "z[0] is nan"), ([1.0, np.inf], "z[1] is inf")):
        bound = icp.error_bound(problem, z)
        assert (bound.value, bound.reason, bound.unique) == (None, words, True)


@pytest.mark.parametrize(
    ("psi", "upper", "name"),
    [
        (icp.Elementwise(lambda z: 0.9 * z + 3.0, lipschitz=0.1), None, "psi"),
        (icp.Function(lambda z: 0.9 * z[::-1] - 3.0, lipschitz=[[0.0, 0.2], [0.2, 0.0]]), None, "psi"),
        (-3.0, icp.Elementwise(lambda z: 0.4 + 0.3 * np.sin(z), lipschitz=0.1), "upper"),
    ],
)
def test_a_lipschitz_constant_that_is_seen_to_be_too_small_proves_nothing(psi, upper, name):
    problem = icp.ICP(PAIR, [-1.0, -2.0], psi, upper=upper)
    bound = icp.error_bound(problem, problem.solve().z)
    assert not bound.unique
    assert bound.value is None
    assert bound.reason.startswith(f"{name}.lipschitz is too small: {name}_0 differs by ")
