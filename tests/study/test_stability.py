"""Stability maps: what is proved must converge, what the paper prints need not, and the pictures have their data."""

import csv
import functools

import numpy as np
import pytest

import icpmodel as icp
from icpmodel import study as measure
from icpmodel.methods.shortcuts import Lemke
from icpmodel.study import Axis, Plane, StabilityMap, planes
from icpmodel.study.charts.figures import save


@functools.cache
def mapped(name):
    """The map of a plane, with points enough to meet failures."""
    return icp.stability(name, points=4, n=9)


@pytest.mark.parametrize("name", planes.PLANES)
def test_where_a_theorem_proves_convergence_no_run_fails(name):
    """The region "proved and failed" is empty, and on every plane something is proved."""
    found = mapped(name)
    assert found.contradictions == 0
    assert found.any_proved.any()
    assert (found.ends != "not run").all()


@pytest.mark.parametrize("name", ["relaxation", "shift", "coupling", "transport", "units"])
def test_a_plane_reaches_into_the_region_of_failure_and_beyond_the_theorems(name):
    found = mapped(name)
    assert found.failed.any()
    assert ((found.ends == "solved") & ~found.any_proved).any()


def test_the_conditions_as_printed_contain_failures():
    """Theorem 4.3 as printed has phi2 G without D⁻¹: with a small diagonal it admits what cycles."""
    found = mapped("units")
    assert found.printed_contradictions > 0
    assert (found.failed & found.printed["4.3"])[:, 0].any()  # the smallest diagonal
    assert not (found.failed & found.any_printed)[:, -1].any()  # the largest


def test_units_change_neither_the_end_nor_the_steps():
    """Scaling A and q by s leaves MNMGS with Omega = D as it is: all columns of the plane units are the same."""
    found = mapped("units")
    assert (found.proved["sharper"] == found.proved["sharper"][:, :1]).all()
    solved = found.ends == "solved"
    assert (solved == solved[:, :1]).all()


def test_counts_of_steps_are_those_of_solve_from_the_worst_start():
    found = icp.stability("coupling", points=3, n=9, starts=2)
    problem, method = found.plane.at(found.plane.x.values[1], found.plane.y.values[0])
    z0 = 10.0 * np.random.default_rng(1).standard_normal(9)
    steps = [problem.solve(method, z0=start).iterations for start in (np.zeros(9), z0)]
    assert found.steps[0, 1] == max(steps)


def test_each_way_to_fail_has_an_end_of_its_own():
    """Each end is met on a plane that consists of one problem each: which is which is known by hand."""
    cases = [
        (icp.scenes.hand_lcp().problem, icp.MNMGS(), "solved"),
        (icp.scenes.hand_cyclic().problem, icp.MNMGS(), "cycled"),
        (icp.scenes.hard_skew(n=10).problem, icp.MNMGS(), "diverged"),
        (icp.scenes.hard_overflow().problem, icp.MNMGS(), "overflowed"),
        (icp.scenes.hard_empty_row().problem, icp.MNMGS(), "refused"),
        (icp.scenes.hard_domain().problem, icp.MNMGS(), "map failed"),
        (icp.scenes.hard_crossing().problem, icp.MNMGS(), "obstacles cross"),
        (icp.scenes.hard_infeasible().problem, Lemke(), "infeasible"),
        (icp.scenes.membrane(n=400).problem, icp.MNMGS(), "slow"),
    ]
    for problem, method, end in cases:
        axis = Axis("x", "x", np.array([0.0, 1.0]))
        found = icp.stability(Plane("one problem", axis, axis, lambda x, y, c=(problem, method): c), max_iter=300)
        assert (found.ends == end).any(), (end, found.ends)


def test_a_point_is_left_once_a_run_failed():
    axis, seen = Axis("x", "x", np.array([0.0, 1.0])), list[np.ndarray]()
    cyclic = icp.scenes.hand_cyclic().problem
    watched = icp.ICP(cyclic.A, cyclic.q, lambda z: seen.append(z) or cyclic.psi.value(z))
    found = icp.stability(Plane("cycles", axis, axis, lambda x, y: (watched, icp.MNMGS())), starts=2)
    second_start = 10.0 * np.random.default_rng(1).standard_normal(watched.n)
    assert (found.ends == "cycled").all()
    assert not any(np.array_equal(z, second_start) for z in seen)


def test_points_beyond_the_time_limit_are_not_run_and_the_picture_says_so():
    axis = Axis("x", "x", np.array([0.0, 1.0]))
    never = icp.ICP([[1.0]], [-1.0], lambda z: 0.0 * z), icp.MNMGS()
    found = icp.stability(Plane("four points", axis, axis, lambda x, y: never), time_limit=0)
    assert (found.ends == "not run").all()
    assert icp.study.figure(found).legends[0].get_texts()[0].get_text() == "not run"


@pytest.mark.parametrize("where", ["between two runs", "in a run"])
def test_ctrl_c_keeps_the_points_that_were_done(where):
    axis, asked = Axis("x", "x", np.array([0.0, 1.0, 2.0])), []

    def interrupted(z):
        raise KeyboardInterrupt

    def at(x, y):
        asked.append((x, y))
        if len(asked) == 3:
            if where == "between two runs":
                raise KeyboardInterrupt
            return icp.ICP([[1.0]], [1.0], interrupted), icp.MNMGS()
        return icp.scenes.hand_lcp().problem, icp.MNMGS()

    with pytest.raises(icp.Interrupted) as stopped:
        icp.stability(Plane("nine points", axis, axis, at))
    found = stopped.value.report
    assert isinstance(found, StabilityMap)
    assert (found.ends.ravel() == "not run").tolist() == [False, False] + 7 * [True]
    assert len(found.table().rows) == 9


def test_a_map_is_written_with_its_data_and_its_command(tmp_path):
    found = icp.stability("units", points=4, n=9, max_iter=200, command="icpmodel stability units --points 4")
    picture, data = save(icp.study.figure(found), tmp_path / "units.svg", found.table(), found.command)
    assert "<svg" in picture.read_text()
    first, *rest = data.read_text().splitlines()
    assert first == "# icpmodel stability units --points 4"
    rows = list(csv.DictReader(rest))
    assert len(rows) == 16
    assert {row["end"] for row in rows} == set(found.ends.ravel().tolist())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"plane": "theta"}, "plane is 'theta'; one of relaxation, shift"),
        ({"plane": None}, "plane is None; one of relaxation, .* or a Plane was expected"),
        ({"plane": "relaxation", "problem": 5}, "problem is 5; an ICP, "),
        ({"plane": "units", "n": 0}, "n is 0"),
        ({"points": 1}, "points is 1"),
        ({"points": 10**9}, "the map has 1e.09 x 1e.09 points, which take .* GB of memory, more than is free"),
        ({"plane": "units", "points": 10**7}, "more than is free"),
        ({"starts": 0}, "starts is 0"),
        ({"rtol": -1.0}, "rtol is -1"),
        ({"max_iter": 2.5}, "max_iter is 2.5"),
        ({"plane": "coupling", "problem": icp.ICP([[1.0]], [1.0])}, "this plane makes its own"),
        ({"plane": "relaxation", "method": "mnmgs"}, "this plane varies the parameters of its own method"),
        ({"plane": "coupling", "method": "nonsense"}, "method is 'nonsense'"),
        ({"plane": "shift", "problem": icp.ICP([[0.0]], [1.0])}, "A.0, 0. = 0; the plane shift needs"),
    ],
)
def test_wrong_arguments_are_named(arguments, words):
    with pytest.raises(icp.InputError, match=words):
        icp.stability(**arguments)


def test_a_problem_of_ones_own_is_mapped():
    found = measure.stability("relaxation", icp.scenes.hand_splittings().problem, points=4)
    assert found.plane.title == "MNMAOR on hand-splittings, 2 unknowns"
    assert found.failed.any()


def test_between_two_obstacles_no_proof_is_contradicted():
    found = measure.stability("relaxation", icp.scenes.box_manufactured(n=16, mu=1.0).problem, points=4, starts=2)
    assert found.any_proved.any()
    assert found.contradictions == 0
