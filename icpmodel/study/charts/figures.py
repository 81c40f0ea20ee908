"""What all figures share: colours, markers, and the functions that show, write or draw them into axes."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import singledispatch
from inspect import signature
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ...errors import InputError, check_arguments
from ...numerics.arrays import described
from ...numerics.plugins import in_notebook
from ...numerics.rounding import public_entry
from ...present.table import Table
from ...present.whole_files import check_ours, place_of, write_ours

Name = TypeVar("Name", bound=Hashable)

#: a matplotlib figure: matplotlib is loaded when the first one is drawn
Figure = Any

#: colours that colour-blind readers can distinguish: Okabe and Ito, Color Universal Design (2008)
BLUE = "#0072B2"
ORANGE = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
YELLOW = "#E69F00"
SKY = "#56B4E9"
COLOURS = (BLUE, ORANGE, GREEN, PURPLE, YELLOW, SKY)
MARKERS = ("s", "^", "D", "v", "P", "X")
#: the colour of small text and of everything but the series: contrast 4.7 : 1 on white
GREY = "0.45"
#: the objects with a picture, in words
_DRAWABLE = "a Solution, a list of them, Solutions, Fields, a Derivative, Sensitivity, History, Scene, Race or map"
#: the place of 0 on a logarithmic axis, as a share of the smallest value above 0
ZERO_SHARE = 0.1
#: the formats of a picture
FORMATS = (".png", ".pdf", ".svg")
#: the metadata of a picture of this package, and the first characters of the data beside it
_PICTURE_MARK = b"made by icpmodel"
_TABLE_MARK = b"# icpmodel"
#: the size of a single panel, in inches: its text stays legible on the screen of a phone
SINGLE_PANEL = (4.9, 3.7)


def styles(names: Iterable[Name]) -> dict[Name, tuple[str, str]]:
    """Name → (colour, marker), different for up to 36 names; "solve()" is a black circle.

    Any six successive names have different colours, so that colour alone distinguishes the series of a panel.
    """
    others = [name for name in names if name != "solve()"]
    count = len(COLOURS)
    pairs = {name: (COLOURS[k % count], MARKERS[(k + k // count) % count]) for k, name in enumerate(others)}
    return {name: pairs.get(name, ("black", "o")) for name in names}


@dataclass(frozen=True, eq=False, kw_only=True)
class Panel:
    """One part of a picture.

    Attributes
    ----------
    draw : callable
        Draws into axes and returns the handles of a legend; none if it has drawn its own.
    caption : str
        How to read the picture.
    alt : str
        The alternative text: what there is to see.
    height : float
        Height of a figure with this panel alone, in inches.
    """

    draw: Callable[[Any], Sequence[Any]]
    caption: str
    alt: str
    height: float = SINGLE_PANEL[1]


@dataclass(frozen=True, eq=False, kw_only=True)
class Drawing:
    """The description of a figure.

    Attributes
    ----------
    panels : sequence of Panel
        The first one is the most important.
    size : pair of float
        Width and height of the whole figure, in inches.
    mosaic : nested sequence of int
        The arrangement of the panels, by their numbers.
    layout : mapping
        Options of `Figure.subplot_mosaic`.
    columns : int
        Columns of the legend below the panels.
    title : str
        The title of the figure.
    """

    panels: Sequence[Panel]
    size: tuple[float, float]
    mosaic: Sequence[Sequence[int]] = ((0,),)
    layout: Mapping[str, Any] = field(default_factory=dict)
    columns: int = 3
    title: str = ""

    def figure(self) -> Figure:
        """Draw all panels on a new figure that belongs to no window."""
        from matplotlib.figure import Figure as Empty

        return self.on(Empty(figsize=self.size, layout="constrained"))

    def on(self, figure: Figure) -> Figure:
        """Draw all panels on an empty `figure`, and return it."""
        axes = figure.subplot_mosaic([list(row) for row in self.mosaic], **self.layout)
        handles = [handle for k, panel in enumerate(self.panels) for handle in panel.draw(axes[k])]
        if "sharex" in self.layout or "sharey" in self.layout:
            for ax in axes.values():
                ax.label_outer()
        if self.title:
            figure.suptitle(self.title, fontsize=10)
        if handles:
            figure.legend(handles=handles, loc="outside lower center", ncols=self.columns, frameon=False, fontsize=8)
        return figure

    def draw_into(self, ax: Any) -> Figure:
        """Draw into given axes, all panels or for one axes the first; return the figure. Raises InputError."""
        from matplotlib.axes import Axes

        axes = [ax] if isinstance(ax, Axes) else list(np.ravel(np.array(ax, dtype=object)))
        count = len(self.panels)
        if wrong := [one.name for one in axes if isinstance(one, Axes) and one.name != "rectilinear"]:
            raise InputError(f"ax has {wrong[0]} coordinates; rectilinear ones were expected")
        if not all(isinstance(one, Axes) for one in axes) or len(axes) not in (1, count):
            actual = f"{len(axes)} of them" if axes and isinstance(axes[0], Axes) else described(ax)
            raise InputError(f"ax is {actual}; one matplotlib axes, or {count} for all panels, were expected")
        for panel, one in zip(self.panels, axes, strict=False):
            if handles := panel.draw(one):
                one.legend(handles=handles, fontsize=8, frameon=False)
        if self.title and not axes[0].get_title():
            axes[0].set_title(self.title, fontsize=10, wrap=True)
        return axes[0].get_figure(root=True)


def panel_figure(panel: Panel) -> Figure:
    """A new figure with this panel alone."""
    return Drawing(panels=(panel,), size=(SINGLE_PANEL[0], panel.height), columns=1).figure()


@singledispatch
def drawing(what: Any, points: Any = None, shape: Any = None) -> Drawing:
    """The description of the figure of `what`; `points` or `shape` place its unknowns.

    Raises
    ------
    InputError
        Where it has no picture.
    """
    raise InputError(f"{described(what)} has no picture; {_DRAWABLE} was expected")


@check_arguments
def figure(what: Any, points: Any = None, shape: Any = None) -> Figure:
    """Draw a picture as a matplotlib figure that belongs to no window.

    Parameters
    ----------
    what : Solution, list of them, Solutions, Fields, Derivative, Sensitivity, History, Scene, Race or StabilityMap
        What is drawn.
    points : array_like of shape (n,), (n, 2) or (n, 3), optional
        Coordinates of the unknowns; by default those of the scene or grid that A is from, else row numbers.
    shape : tuple of int, optional
        Shape (ny, nx) or (nz, ny, nx) of the grid whose unknowns are numbered row by row, in place of `points`.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError
        For what has no picture, and for points or a shape that do not fit.

    Examples
    --------
    >>> solution = icp.scenes.membrane(n=100).problem.solve()
    >>> [axes.get_title() for axes in icp.study.figure(solution).axes[:2]]
    ['z, contact set outlined', 'force p']
    """
    return _drawing(what, points, shape).figure()


def _drawing(what: Any, points: Any, shape: Any) -> Drawing:
    """The `drawing` of `what`. Raises InputError also for `points` or `shape` if `what` has no unknowns."""
    where = {name: value for name, value in (("points", points), ("shape", shape)) if value is not None}
    if where and len(signature(drawing.dispatch(type(what))).parameters) == 1:
        raise InputError(f"{next(iter(where))} is given; {described(what)} has no unknowns to be placed: leave it out")
    return drawing(what, **where)


@public_entry
def plot(what: Any, path: Any = None, *, ax: Any = None, points: Any = None, shape: Any = None) -> Figure:
    """Show a picture, write it to a file, or draw it into axes.

    Without `path` and `ax` a notebook shows it as the value of a cell; elsewhere matplotlib opens a window, or warns.

    Parameters
    ----------
    what : Solution, list of them, Solutions, Fields, Derivative, Sensitivity, History, Scene, Race or StabilityMap
        What is drawn. A list of solutions gives one curve or field for each z.
    path : str or path, optional
        File to write instead; its suffix is .png, .pdf or .svg.
    ax : matplotlib axes or sequence of them, optional
        Axes to draw into instead: one for the first panel, or one for each panel.
    points : array_like of shape (n,), (n, 2) or (n, 3), optional
        Coordinates of the unknowns; by default those of the scene or grid that A is from, else row numbers.
    shape : tuple of int, optional
        Shape (ny, nx) or (nz, ny, nx) of the grid whose unknowns are numbered row by row, in place of `points`.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError
        For unsuitable axes, points or shape, or an object without a picture.
    FileError
        For another suffix, and where the file cannot be written.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> page = Figure()
    >>> axes = page.subplots()
    >>> _ = icp.study.plot(icp.scenes.hand_lcp().problem.solve(), ax=axes)
    >>> [line.get_label() for line in axes.lines]
    ['obstacle ψ(z)', 'z', 'contact set']
    >>> icp.study.plot(icp.scenes.hand_lcp(), "answer.doc")
    Traceback (most recent call last):
    icpmodel.errors.FileError: answer.doc: a file name that ends in .png, .pdf or .svg was expected; ...
    """
    if ax is not None and path is not None:
        raise InputError("path and ax are both given; a picture is written or drawn into axes: leave out one of them")
    place = None if path is None else picture_file(path)
    description = _drawing(what, points, shape)
    if ax is not None:
        return description.draw_into(ax)
    if place is not None:
        return write(description.figure(), place)
    from matplotlib import pyplot

    backend = pyplot.get_backend()
    inline = in_notebook() and "inline" in backend
    if not inline and not _has_windows(backend):
        return description.figure()
    picture = description.on(pyplot.figure(figsize=description.size, layout="constrained"))
    if inline:  # pyplot has set up how the notebook shows figures; an open figure would be shown twice
        pyplot.close(picture)
    else:
        pyplot.show()
    return picture


def _has_windows(backend: str) -> bool:
    """Whether matplotlib's `backend` has windows; warn if it has none, as matplotlib itself may not."""
    from matplotlib.backends import BackendFilter, backend_registry

    if backend.lower() not in map(str.lower, backend_registry.list_builtin(BackendFilter.NON_INTERACTIVE)):
        return True
    advice = 'plot("picture.png") writes the picture, plot(ax=...) draws it into axes of yours'
    warnings.warn(f"nothing is shown, as matplotlib's backend {backend} has no windows: {advice}", stacklevel=7)
    return False


def picture_file(path: Any) -> Path:
    """Check that a picture can be written to `path`, and return it. Raises InputError and FileError."""
    return place_of(path, FORMATS, holds=_PICTURE_MARK)


def write(figure: Figure, path: Path, command: str = "") -> Figure:
    """Write `figure` to `path`, with `command` in its metadata, and return it. Raises FileError."""
    form = path.suffix[1:].lower()
    picture = io.BytesIO()
    metadata = {"Software" if form == "png" else "Creator": _PICTURE_MARK.decode()} | (
        {"Title": command} if command else {}
    )
    figure.savefig(picture, format=form, dpi=100, metadata=metadata)
    write_ours(path, picture.getvalue(), holds=_PICTURE_MARK)
    return figure


def data_file(picture: Path) -> Path:
    """The path of the .csv file beside `picture`. Raises FileError where a file is there that `save` did not write."""
    data = picture.with_suffix(".csv")
    check_ours(data, begins=_TABLE_MARK)
    return data


def save(figure: Figure, path: Any, table: Table, command: str) -> list[Path]:
    """Write `figure`, and `table` beside it as .csv with `command` in the first line. Returns both paths."""
    path = picture_file(path)
    data = data_file(path)
    write(figure, path, command)
    write_ours(data, f"# {command}\n{table.to_csv()}".encode(), begins=_TABLE_MARK)
    return [path, data]
