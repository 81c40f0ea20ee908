"""Contact with friction as engines state it: Coulomb's law by formula, redundant stacks, unequal masses."""

import pickle

import numpy as np
import pytest

import icpmodel as icp
from icpmodel import ICP

CORNERS = [(1, 1), (1, -1), (-1, 1), (-1, -1)]


def stack(masses, push):
    """Boxes on each other, four corners between each two, after a step of 0.01 s with the accelerations `push`."""
    rows = []
    for k in range(len(masses)):
        for x, y in CORNERS:
            for t in np.eye(3)[[2, 0, 1]]:
                row = np.zeros((len(masses), 6))
                row[k] = [*t, *np.cross([x, y, -0.5], t)]
                if k:
                    row[k - 1] = -np.array([*t, *np.cross([x, y, 0.5], t)])
                rows.append(row.ravel())
    J = np.array(rows)
    inertia = np.array([[m, m, m, m / 2, m / 2, m / 2] for m in masses]).ravel()
    v = np.tile([0.01 * a for a in (*push, 0, 0, 0)], len(masses))
    contacts = len(rows) // 3
    bounds = np.tile([0, -0.5, -0.5], contacts), np.tile([np.inf, 0.5, 0.5], contacts)
    findex = np.ravel([[-1, 3 * k, 3 * k] for k in range(contacts)])
    return ICP.from_friction_index(J / inertia @ J.T, -J @ v, *bounds, findex), J[:12]


def contact(A, q):
    """The state of one contact with friction of at most a half of its force."""
    return icp.contact_state(ICP.from_friction_index(A, q, [0, -0.5], [np.inf, 0.5], [-1, 0]).solve())


@pytest.mark.parametrize(("speed", "slides"), [(0.0, False), (0.4, False), (3.0, True), (-3.0, True)])
def test_a_block_obeys_coulombs_law(speed, slides):
    state = contact(np.eye(2) / 2, [1, -speed])
    friction = -np.clip(2 * speed, -1, 1)
    np.testing.assert_allclose(state.impulses, [2, friction])
    np.testing.assert_allclose(state.velocities, [0, speed + friction / 2], atol=1e-12)
    assert [*state.sliding, *state.sticking, *state.separating] == [False, slides, False, not slides, False, False]


def test_a_block_in_the_air_separates():
    state = contact(np.eye(2), [-1, -3])
    assert state.separating.all()
    assert not state.sliding.any() | state.sticking.any()


@pytest.mark.parametrize("masses", [(1, 1, 1), (1, 1e6), (1e6, 1)])
def test_redundant_contacts_carry_the_weight_for_any_ratio_of_masses(masses):
    problem, floor = stack(masses, (1.0, 0.5, -9.81))
    assert np.linalg.matrix_rank(problem.dense()) < problem.n
    solution = problem.solve()
    force = floor[:, :3].T @ solution.z[:12]  # that of the floor; nothing moves
    np.testing.assert_allclose(force, 0.01 * sum(masses) * np.array([-1.0, -0.5, 9.81]), rtol=1e-5)
    assert not icp.contact_state(solution).sliding.any()


@pytest.mark.parametrize("masses", [[1], [1, 2, 1e6]])
def test_problems_in_a_batch_are_those_alone(masses):
    """With one A for all, and each with its own, in one compiled call."""
    pushed = [stack([mass], (4.0, 1.0, -9.81))[0] for mass in masses for _ in range(3)]
    A = [one.dense() for one in pushed] if masses[1:] else pushed[0].A
    Q = np.array([c * one.q for c, one in zip(np.tile([0.5, 1.0, -1.0], len(masses)), pushed, strict=True)])
    problem = pushed[0]
    many = icp.solve_many(A, Q, problem.psi)
    for one, q, row in zip(pushed, Q, many, strict=True):
        assert "at once" in row.why
        alone = icp.contact_state(one.with_q(q).solve())
        np.testing.assert_allclose(icp.contact_state(row).velocities, alone.velocities, atol=1e-9)
        np.testing.assert_array_equal(icp.contact_state(row).separating, alone.separating)
    kept = pickle.loads(pickle.dumps(problem)).psi
    np.testing.assert_array_equal(kept.findex, problem.psi.findex)


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"findex": [-1, 1]}, r"findex\[1\]"),
        ({"findex": [-1, 2]}, r"findex\[1\]"),
        ({"findex": [-1]}, "findex"),
        ({"findex": [-1, 0.0]}, "findex"),
        ({"lo": [-1, -0.5]}, r"lo\[0\]"),
        ({"hi": [np.inf, -0.5]}, "row 1"),
    ],
)
def test_what_is_no_friction_index_is_refused(changed, named):
    right = {"A": np.eye(2), "b": [1, 0], "lo": [0, -0.5], "hi": [np.inf, 0.5], "findex": [-1, 0]}
    with pytest.raises(icp.InputError, match=named):
        ICP.from_friction_index(**{**right, **changed})
    with pytest.raises(icp.NotApplicable):
        icp.contact_state(ICP([[1]], [1]).solve())
