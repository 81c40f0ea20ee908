"""`icpmodel measure`: what the README claims, measured on this machine."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from ..benchmarks import (
    benchmark,
    bound_ratios,
    certificate_cost,
    dispatch,
    dominant_cost,
    false_success,
    faster_peers,
    grid_order,
    impulse_cost,
    memory,
    reading_cost,
    small_cost,
    solve_cost,
    sweep_cost,
    sweep_counts,
    tuned_and_automatic,
)
from ..errors import FileError
from ..present.table import Table
from ..study.charts.figures import Figure, save
from ..study.charts.table_charts import benchmark_figures, choice, memory_figure
from .output import must_be_writable, typed
from .signatures import decorated, measured, parameters, summary

_COMMANDS: dict[str, Callable[..., Table]] = {
    "sweep": sweep_cost,
    "counts": sweep_counts,
    "order": grid_order,
    "bounds": bound_ratios,
    "certificate": certificate_cost,
    "limit": solve_cost,
    "honesty": false_success,
    "modelling": reading_cost,
    "dominant": dominant_cost,
    "impulse": impulse_cost,
    "small": small_cost,
    "benchmark": benchmark,
    "dispatch": dispatch,
    "tuning": tuned_and_automatic,
    "memory": memory,
}
#: command → the figures of its table, by file name, with their data; no name for the file that --output is
_FIGURES: dict[str, Callable[[Table], dict[str, tuple[Figure, Table]]]] = {
    "benchmark": benchmark_figures,
    "dispatch": lambda table: {"dispatch": (choice(table), table)},
    "memory": lambda table: {"": (memory_figure(table), table)},
}
_OUTPUT = {
    True: click.option("-o", "--output", type=click.Path(), help="Write the CSV file and the figures to this folder."),
    False: click.option("-o", "--output", type=click.Path(), help="Write the figure (PNG and SVG) and its data (CSV)."),
}


@click.group()
def measure() -> None:
    """Measure what the README claims, on this machine."""


def _command(name: str, function: Callable[..., Table]) -> click.Command:
    into_folder = name != "memory"
    settings = {"progress": True} if "progress" in inspect.signature(function).parameters else {}

    def run(as_csv: bool, output: str | None = None, **arguments: Any) -> int:
        if into_folder and output is not None:
            _make(output)
        else:
            must_be_writable(output)
        asked = {key: value for key, value in arguments.items() if value != ()}  # no scenes: the default ones
        return measured(
            lambda: function(**asked, **settings),
            lambda table: _show(name, table, as_csv, output),
            "this is what was measured before",
        )

    options = [*parameters(function), click.option("--csv", "as_csv", is_flag=True, help="Print CSV.")]
    if name in _FIGURES:
        options.append(_OUTPUT[into_folder])
    return click.command(name, help=summary(function))(decorated(run, options))


def _show(name: str, table: Table, as_csv: bool, output: str | None) -> None:
    click.echo(table.to_csv() if as_csv else str(table), nl=not as_csv)
    if output is not None:
        for file, (figure, data) in _FIGURES[name](table).items():
            save(figure, Path(output) / file if file else output, data, typed())
    if name == "benchmark" and not as_csv:
        faster = faster_peers(table)
        click.echo("\n".join(["", "A peer is faster than solve():", *faster] if faster else ["", "No peer is faster."]))


def _make(folder: str) -> None:
    """Make the folder before the work."""
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"{folder}: cannot be made a folder: {error.strerror}") from None


for _name, _function in _COMMANDS.items():
    measure.add_command(_command(_name, _function))
