"""`icpmodel measure`: what the README claims, measured on this machine."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from .. import benchmarks
from ..present.table import Table
from ..study.charts.figures import Figure, save
from ..study.charts.table_charts import benchmark_figures, choice, memory_figure
from .arguments import options, parameters, summary
from .output import AS_CSV, TO_FIGURE, make_folder, measured, must_be_writable, print_table, typed

_COMMANDS: dict[str, Callable[..., Table]] = {
    "sweep": benchmarks.sweep_cost,
    "counts": benchmarks.sweep_counts,
    "order": benchmarks.grid_order,
    "bounds": benchmarks.bound_ratios,
    "certificate": benchmarks.certificate_cost,
    "limit": benchmarks.solve_cost,
    "honesty": benchmarks.false_success,
    "modelling": benchmarks.reading_cost,
    "dominant": benchmarks.dominant_cost,
    "impulse": benchmarks.impulse_cost,
    "small": benchmarks.small_cost,
    "benchmark": benchmarks.benchmark,
    "dispatch": benchmarks.dispatch,
    "tuning": benchmarks.tuned_and_automatic,
    "memory": benchmarks.memory,
}
#: command → the figures of its table, by file name, with their data; no name for the file that --output is
_FIGURES: dict[str, Callable[[Table], dict[str, tuple[Figure, Table]]]] = {
    "benchmark": benchmark_figures,
    "dispatch": lambda table: {"dispatch": (choice(table), table)},
    "memory": lambda table: {"": (memory_figure(table), table)},
}
_FOLDER = click.option("-o", "--output", type=click.Path(), help="Write the CSV file and the figures to this folder.")


@click.group()
def measure() -> None:
    """Measure what the README claims, on this machine."""


def _command(name: str, function: Callable[..., Table]) -> click.Command:
    into_folder = name != "memory"
    settings = {"progress": True} if "progress" in inspect.signature(function).parameters else {}

    def run(as_csv: bool, output: str | None = None, **arguments: Any) -> int:
        if not into_folder:
            must_be_writable(output)
        elif output is not None:
            make_folder(output)
        asked = {key: value for key, value in arguments.items() if value != ()}  # no scenes: the default ones

        def show(table: Table) -> None:
            print_table(table, table, as_csv)
            if output is not None:
                for file, (figure, data) in _FIGURES[name](table).items():
                    save(figure, Path(output) / file if file else output, data, typed())
            if name == "benchmark" and not as_csv:
                faster = benchmarks.faster_peers(table)
                title = "A peer is faster than solve():" if faster else "No peer is faster."
                click.echo("\n".join(["", title, *faster]))

        return measured(lambda: function(**asked, **settings), show, "this is what was measured before")

    output = [_FOLDER if into_folder else TO_FIGURE] if name in _FIGURES else []
    return click.command(name, help=summary(function))(options(*parameters(function), AS_CSV, *output)(run))


for _name, _function in _COMMANDS.items():
    measure.add_command(_command(_name, _function))
