"""One way to see a picture: it is shown, or written as its suffix says, or drawn into axes that are given."""

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure

import icpmodel as icp
from icpmodel.study.competitors import Entry

SQUARE = icp.scenes.membrane(n=100)
SOLUTION = SQUARE.problem.solve("psor", history=True)
LINE = icp.scenes.bearing(n=50)
ENTRIES = tuple(Entry("solve()", "solve", 1e-3, seconds=(1.0,), error=error, residual=1e-9) for error in (0.1, 0.01))
THINGS = {
    "solution": SOLUTION,
    "history": SOLUTION.history,
    "scene": SQUARE,
    "line": LINE,
    "race": icp.study.Race(title="a race", measure="error", entries=ENTRIES),
    "map": icp.stability("units", points=4, n=9),
}
PANELS = {"solution": 2, "history": 1, "scene": 2, "line": 2, "race": 2, "map": 1}
each = pytest.mark.parametrize("name", THINGS)


#: what a file of each suffix begins with
BEGINS = {".png": b"\x89PNG", ".PDF": b"%PDF", ".svg": b"<?xml"}


@pytest.mark.parametrize(("name", "suffix"), list(zip(THINGS, [*BEGINS, *BEGINS], strict=True)))
def test_a_picture_is_written_in_the_format_of_its_suffix_and_nothing_else_is(name, suffix, tmp_path):
    figure = THINGS[name].plot(tmp_path / f"picture{suffix}")
    (written,) = tmp_path.iterdir()
    assert written.name == f"picture{suffix}"
    assert written.read_bytes().startswith(BEGINS[suffix])
    assert isinstance(figure, Figure)


@each
def test_a_picture_is_drawn_into_axes_that_are_given(name):
    """All panels, or the first of them; the rest of the page stays as it is."""
    page = Figure()
    axes = np.ravel(page.subplots(1, PANELS[name] + 1))
    assert THINGS[name].plot(ax=axes[1:]) is page
    assert all(one.has_data() for one in axes[1:])
    alone = Figure()
    first, other = alone.subplots(1, 2)
    assert THINGS[name].plot(ax=first) is alone
    assert first.has_data()
    assert not other.has_data()
    assert not axes[0].has_data()
    assert first.get_xlabel()


@pytest.mark.parametrize("path", ["picture", "picture.doc", "picture.mat", "picture.png.old"])
def test_a_suffix_that_no_picture_has_is_refused(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(icp.InputError, match=r"a file name that ends in \.png, \.pdf or \.svg was expected"):
        SOLUTION.plot(path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "of", [SQUARE.problem, SQUARE.problem.with_q(2 * SQUARE.problem.q), SQUARE.problem.with_psi(0.1)]
)
def test_what_lives_in_the_plane_is_a_field_without_being_told_its_points(of):
    """The points go with the unknowns, that is with A, whatever q and ψ are."""
    axes = icp.study.figure(of.solve("psor")).axes[0]
    assert axes.get_title().startswith("z, ")
    assert axes.collections[0].get_array().reshape(10, 10).shape == (10, 10)
    again = icp.ICP(of.A, of.q, of.psi).solve("psor")  # its A is another one, of which nothing is known
    assert icp.study.figure(again).axes[0].get_ylabel() == "z"
    assert icp.study.figure(again, SQUARE.points).axes[0].get_title().startswith("z, ")


def test_where_there_is_no_window_it_is_said_what_to_do_instead():
    with pytest.warns(UserWarning, match=r"nothing is shown, .*plot\(\"picture.png\"\) writes") as warned:
        figure = SOLUTION.plot()
    assert isinstance(figure, Figure)
    assert warned[0].filename == __file__
    assert pyplot.get_fignums() == []
