"""One way to see a picture: it is shown, or written as its suffix says, or drawn into axes that are given."""

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure

import icpmodel as icp
from icpmodel.study.charts.figures import styles
from icpmodel.study.charts.race_charts import in_seconds
from icpmodel.study.competitors import Entry

SQUARE = icp.scenes.membrane(n=100)
LINE = icp.scenes.bearing(n=50)
KINDS = {"solve()": "solve"} | {f"m{k}": "own" for k in range(8)} | {f"s{k}": "peer" for k in range(8)}
ENTRIES = tuple(Entry(name, kind, 1e-3, seconds=(1.0,), error=0.1, residual=1e-9) for name, kind in KINDS.items())
#: what is drawn, and in how many panels
PANELS = {"solution": 2, "history": 1, "scene": 2, "line": 2, "race": 2, "map": 1}


@pytest.fixture(scope="module")
def solution():
    return SQUARE.problem.solve("psor", history=True)


@pytest.fixture(scope="module")
def things(solution):
    race = icp.study.Race(title="a race", measure="error", entries=ENTRIES[:2])
    drawn = (solution, solution.history, SQUARE, LINE, race, icp.stability("units", points=4, n=9))
    return dict(zip(PANELS, drawn, strict=True))


#: what a file of each suffix begins with
BEGINS = {".png": b"\x89PNG", ".PDF": b"%PDF", ".svg": b"<?xml"}


@pytest.mark.parametrize(("name", "suffix"), list(zip(PANELS, [*BEGINS, *BEGINS], strict=True)))
def test_a_picture_is_written_in_the_format_of_its_suffix_and_nothing_else_is(things, name, suffix, tmp_path):
    figure = things[name].plot(tmp_path / f"picture{suffix}")
    (written,) = tmp_path.iterdir()
    assert written.name == f"picture{suffix}"
    assert written.read_bytes().startswith(BEGINS[suffix])
    assert isinstance(figure, Figure)


@pytest.mark.parametrize("name", PANELS)
def test_a_picture_is_drawn_into_axes_that_are_given(things, name):
    """All panels, or the first of them; the rest of the page stays as it is."""
    page = Figure()
    axes = np.ravel(page.subplots(1, PANELS[name] + 1))
    assert things[name].plot(ax=axes[1:]) is page
    assert all(one.has_data() for one in axes[1:])
    alone = Figure()
    first, other = alone.subplots(1, 2)
    assert things[name].plot(ax=first) is alone
    assert first.has_data()
    assert not other.has_data()
    assert not axes[0].has_data()
    assert first.get_xlabel()


@pytest.mark.parametrize("path", ["picture", "picture.doc", "picture.mat", "picture.png.old"])
def test_a_suffix_that_no_picture_has_is_refused(solution, path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(icp.FileError, match=r"a file name that ends in \.png, \.pdf or \.svg was expected"):
        solution.plot(path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "of", [SQUARE.problem, SQUARE.problem.with_q(2 * SQUARE.problem.q), SQUARE.problem.with_psi(0.1)]
)
def test_points_of_a_plane_grid_need_not_be_given(of):
    """The points go with the unknowns, that is with A, whatever q and ψ are."""
    axes = icp.study.figure(of.solve("psor")).axes[0]
    assert axes.get_title().startswith("z, ")
    assert axes.collections[0].get_array().reshape(10, 10).shape == (10, 10)
    again = icp.ICP(of.A, of.q, of.psi).solve("psor")  # its A is another one, of which the grid is known
    assert icp.study.figure(again).axes[0].get_ylabel() == "row"
    assert icp.study.figure(again, SQUARE.points).axes[0].get_title().startswith("z, ")


def test_where_there_is_no_window_it_is_said_what_to_do_instead(solution):
    with pytest.warns(UserWarning, match=r"nothing is shown, .*plot\(\"picture.png\"\) writes") as warned:
        figure = solution.plot()
    assert isinstance(figure, Figure)
    assert warned[0].filename == __file__
    assert pyplot.get_fignums() == []


@pytest.mark.parametrize("couples", ["blocks of a grid's size", "every third unknown", "nothing", "a short grid"])
def test_what_is_no_grid_is_drawn_over_its_rows(couples):
    chain = np.diag(np.full(8, 2.0)) - np.eye(8, k=1) - np.eye(8, k=-1)
    matrices = {
        "blocks of a grid's size": np.kron(np.eye(9), chain),
        "every third unknown": 4.0 * np.eye(72) - np.eye(72, k=3) - np.eye(72, k=-3),
        "nothing": np.eye(72),
        "a short grid": np.kron(np.eye(7), chain) + 2.0 * np.eye(56) - np.eye(56, k=8) - np.eye(56, k=-8),
    }
    solution = icp.ICP(matrices[couples], np.ones(len(matrices[couples]))).solve()
    assert icp.study.figure(solution).axes[-1].get_xlabel() == "row"


def test_the_obstacle_of_a_row_is_drawn_whole():
    """Its tick is as wide as half of the row, and the axis begins half a row before the first one."""
    axes = icp.study.figure(icp.ICP(np.eye(3), [-1.0, 0.0, 1.0], 0.5).solve()).axes[0]
    low, high = axes.get_xlim()
    assert low <= -0.5
    assert high >= 2.5


def test_an_own_grid_is_drawn_in_the_plane_or_in_slices():
    for shape, m in (((8, 13), 1), ((3, 4, 6), 3)):
        lines = [np.diag(np.full(k, 2.0)) - np.diag(np.ones(k - 1), 1) - np.diag(np.ones(k - 1), -1) for k in shape]
        A = sum(
            np.kron(np.kron(np.eye(int(np.prod(shape[:k]))), line), np.eye(int(np.prod(shape[k + 1 :]))))
            for k, line in enumerate(lines)
        )
        solution = icp.ICP(A, -np.ones(len(A)), -1.0).solve()
        drawn = icp.study.figure(solution)
        fields = [axes.collections[0] for axes in drawn.axes if axes.get_title()]
        assert len(fields) == 2 * m
        middle = solution.z.reshape(shape)[shape[0] // 2] if m == 3 else solution.z.reshape(shape)
        assert np.array_equal(fields[0].get_array().reshape(shape[-2:]), middle)
        assert all(field.colorbar.ax.get_ylabel() for field in fields)
        points = np.indices(shape)[::-1].reshape(len(shape), -1).T
        for again in (icp.study.figure(solution, points), icp.study.figure(solution, shape=shape)):
            assert np.array_equal(again.axes[0].collections[0].get_array(), fields[0].get_array())


@pytest.mark.parametrize("wrong", [{"shape": (10, 11)}, {"points": np.zeros(3)}, {"shape": (10, 10), "points": [0.0]}])
def test_places_that_do_not_fit_are_refused(solution, wrong):
    with pytest.raises(icp.InputError, match=r"expected|placed"):
        icp.study.figure(solution, **wrong)
    with pytest.raises(icp.InputError, match="no unknowns to be placed"):
        icp.study.figure(solution.history, **wrong)


@pytest.mark.parametrize(("ax", "actual"), [([], r"\[\]"), (3, "3"), (Figure().subplots(3), "3 of them")])
def test_what_is_no_axes_is_named(solution, ax, actual):
    with pytest.raises(icp.InputError, match=f"ax is {actual}; one matplotlib axes, or 2 for all panels"):
        solution.plot(ax=ax)


@pytest.mark.parametrize("projection", ["polar", "3d"])
def test_axes_of_other_coordinates_are_refused(solution, projection):
    with pytest.raises(icp.InputError, match=f"ax has {projection} coordinates; rectilinear"):
        solution.plot(ax=Figure().add_subplot(projection=projection))


@pytest.mark.parametrize("n", [1, 2, 6])
def test_the_picture_of_equations_has_no_obstacle_and_no_force_of_rounding(n, tmp_path):
    A = np.eye(n) + 0.1
    heights, forces = icp.ICP(A, np.arange(n) / 3 - 1, psi=-np.inf).solve().plot(tmp_path / "z.png").axes
    assert [text.get_text() for text in heights.get_legend().get_texts()] == ["z"]
    assert not forces.lines[0].get_ydata().any()
    assert [tick % 1 for tick in forces.get_xticks()] == [0.0] * len(forces.get_xticks())


def test_a_history_shows_its_tolerance_and_where_another_method_took_over():
    solution = SQUARE.problem.solve(history=True)
    history = solution.history
    assert history.iteration[-1] == solution.iterations
    assert history.tolerance == solution.tolerance
    (axes,) = icp.study.figure(history).axes
    level = [line.get_ydata()[0] for line in axes.lines if line.get_label() == "tolerance"]
    assert level == [history.tolerance]
    changes = [k for k in range(1, len(history.method)) if history.method[k] != history.method[k - 1]]
    drawn = {text.get_text() for text in axes.texts}
    assert all(history.method[k] in drawn for k in changes)


def test_a_competitor_has_one_colour_and_marker_of_its_own_in_all_panels():
    """And a logarithmic axis has no bars."""
    look = styles(KINDS)
    assert len(set(look.values())) == len(KINDS)
    race = icp.study.Race(title="a race", measure="error", entries=ENTRIES)
    *panels, times = icp.study.figure(race).axes
    assert len(panels) == 4
    assert not times.patches
    for axes in (*panels, times):
        for line in axes.lines:
            if line.get_label() in look and line.get_marker() not in ("None", ""):
                assert (line.get_color(), line.get_marker()) == look[line.get_label()]


def test_solves_in_a_row_and_what_moves_with_the_data_have_a_picture(solution):
    solves = [LINE.problem.with_q(c * LINE.problem.q).solve() for c in (1.0, 2.0, 3.0)]
    (axes,) = icp.study.figure(solves).axes
    assert all(np.array_equal(line.get_ydata(), one.z) for line, one in zip(axes.lines, solves, strict=True))
    moved = icp.study.sensitivity(solution)
    field = icp.study.figure(moved).axes[0].collections[0]
    assert np.array_equal(np.ravel(field.get_array()), moved.rows)
    many = icp.solve_many(LINE.problem.A, [c * LINE.problem.q for c in range(1, 20)], LINE.problem.psi)
    (axes,) = icp.study.figure(many).axes
    assert [line.get_label() for line in axes.lines][:: len(axes.lines) - 1] == ["row 0", "row 18"]
    derivative = solution.derivative()
    field = icp.study.figure(derivative).axes[0].collections[0]
    assert np.array_equal(np.ravel(field.get_array()), derivative.forward(dq=-np.ones(100)))


@pytest.mark.parametrize(
    ("t", "words"), [(0.0, "0 s"), (3.31e-7, "330 ns"), (0.0123, "12 ms"), (0.9996, "1 s"), (1234.0, "1200 s")]
)
def test_times_are_written_to_two_digits(t, words):
    assert in_seconds(t) == words
