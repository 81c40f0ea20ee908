"""`icpmodel measure`: what the README claims, measured on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import FileError, Interrupted
from ..solve.progress import status_line
from .output import complain, must_be_writable, typed
from .source import options

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..present.table import Table


_AS_CSV = click.option("--csv", "as_csv", is_flag=True, help="Print CSV.")
_LARGE_SIZES = click.option(
    "--n",
    "sizes",
    type=int,
    multiple=True,
    default=(10_000, 100_000, 1_000_000),
    show_default=True,
    help="Wanted unknowns.",
)


@click.group()
def measure() -> None:
    """Measure what the README claims, on this machine."""


@measure.command()
@click.option("--n", type=int, default=1_000_000, show_default=True, help="Unknowns of the 5-point matrix.")
@click.option("--repeats", type=int, default=15, show_default=True, help="Pairs of timings.")
@_AS_CSV
def sweep(n: int, repeats: int, as_csv: bool) -> int:
    """One sweep with its residual against one SciPy A @ z, timed in turn."""
    from ..benchmarks import sweep_cost

    return _show(sweep_cost(n, repeats), as_csv)


@measure.command()
@click.option(
    "--m",
    "sides",
    type=click.IntRange(min=1),
    multiple=True,
    default=(10, 20, 30),
    show_default=True,
    help="Grid sides.",
)
@_AS_CSV
def counts(sides: tuple[int, ...], as_csv: bool) -> int:
    """Sweeps to Res <= 1e-5 on Bai's LCP, against the grid side m."""
    from ..benchmarks import sweep_counts

    return _show(sweep_counts(sides), as_csv)


@measure.command()
@click.argument("scene", default="dividend")
@click.option("--n", "sizes", type=int, multiple=True, default=(61, 241, 961), show_default=True, help="Unknowns.")
@click.option("--method", help="Name of the method; without it one is picked.")
@_AS_CSV
def order(scene: str, sizes: tuple[int, ...], method: str | None, as_csv: bool) -> int:
    """The error of SCENE against its closed form on finer and finer grids."""
    from ..benchmarks import grid_order

    return _show(grid_order(scene, sizes, method), as_csv)


@measure.command()
@click.option("--n", type=int, default=900, show_default=True, help="Wanted unknowns of the scenes that have a size.")
@click.option("--trials", type=int, default=10, show_default=True, help="Points at each distance.")
@_AS_CSV
def bounds(n: int, trials: int, as_csv: bool) -> int:
    """Error bound over true error on every scene with an exact answer."""
    from ..benchmarks import bound_ratios

    return _show(bound_ratios(n, trials), as_csv)


@measure.command()
@click.option("--n", type=int, default=1_000_000, show_default=True, help="Unknowns of the membrane.")
@click.option("--repeats", type=int, default=5, show_default=True, help="Pairs of timings.")
@_AS_CSV
def certificate(n: int, repeats: int, as_csv: bool) -> int:
    """A certificate from scratch against one linear solve, timed in turn."""
    from ..benchmarks import certificate_cost

    return _show(certificate_cost(n, repeats), as_csv)


@measure.command()
@_LARGE_SIZES
@click.option("--repeats", type=int, default=5, show_default=True, help="Pairs of timings.")
@_AS_CSV
def limit(sizes: tuple[int, ...], repeats: int, as_csv: bool) -> int:
    """solve() against its limit, one linear solve with the same matrix, timed in turn."""
    from ..benchmarks import solve_cost

    return _show(solve_cost(sizes, repeats), as_csv)


@measure.command()
@click.argument("scenes", nargs=-1)
@click.option("--seeds", type=int, default=10, show_default=True, help="Random starts, and random data.")
@click.option("--n", type=int, default=100, show_default=True, help="Wanted unknowns of the scenes that have a size.")
@_AS_CSV
def honesty(scenes: tuple[str, ...], seeds: int, n: int, as_csv: bool) -> int:
    """How runs end, and what of it is false: all methods on SCENES, default all, from random starts."""
    from ..benchmarks import false_success

    return _show(false_success(seeds, n, scenes, progress=True), as_csv)


@measure.command()
@click.option("--cvxpy-n", type=int, default=1_000_000, show_default=True, help="Unknowns of the CVXPY model.")
@click.option("--pyomo-n", type=int, default=100_000, show_default=True, help="Conditions of the Pyomo models.")
@click.option("--repeats", type=int, default=3, show_default=True, help="Pairs of timings.")
@_AS_CSV
def modelling(cvxpy_n: int, pyomo_n: int, repeats: int, as_csv: bool) -> int:
    """Reading CVXPY and Pyomo models against what these take to write them, timed in turn."""
    from ..benchmarks import reading_cost

    return _show(reading_cost(cvxpy_n, pyomo_n, repeats), as_csv)


@measure.command()
@click.option("--n", "sizes", type=int, multiple=True, default=(10_000, 100_000, 1_000_000), show_default=True)
@click.option("--repeats", type=int, default=9, show_default=True, help="Pairs of timings.")
@_AS_CSV
def dominant(sizes: tuple[int, ...], repeats: int, as_csv: bool) -> int:
    """solve() where A is strongly dominant (mu = 4), against sweeps times one SciPy A @ z, timed in turn."""
    from ..benchmarks import dominant_cost

    return _show(dominant_cost(sizes, repeats), as_csv)


@measure.command()
@click.option("--n", "sizes", type=int, multiple=True, default=(961, 6001, 25_601, 100_001), show_default=True)
@click.option("--repeats", type=int, default=9, show_default=True, help="Pairs of timings.")
@_AS_CSV
def impulse(sizes: tuple[int, ...], repeats: int, as_csv: bool) -> int:
    """solve() on the dividend scene against one sparse factorisation of its A, timed in turn."""
    from ..benchmarks import impulse_cost

    return _show(impulse_cost(sizes, repeats), as_csv)


@measure.command()
@click.option("--n", type=click.IntRange(min=1), default=16, show_default=True, help="Unknowns.")
@click.option("--k", type=click.IntRange(min=1), default=10_000, show_default=True, help="Right-hand sides of one A.")
@click.option("--repeats", type=int, default=15, show_default=True, help="Pairs of timings.")
@_AS_CSV
def small(n: int, k: int, repeats: int, as_csv: bool) -> int:
    """Small LCPs against OSQP, one at a time and many with one A, timed in turn."""
    from ..benchmarks import small_cost

    return _show(small_cost(n, k, repeats), as_csv)


def _comparison(repeats: int, sizes: tuple[int, ...]) -> Callable[..., Any]:
    """The arguments of the two commands that compare methods."""
    decorators = (
        click.argument("scenes", nargs=-1, metavar="[NAME[,PARAMETER=NUMBER]]..."),
        click.option(
            "--n", "sizes", type=int, multiple=True, default=sizes, show_default=True, help="Wanted unknowns."
        ),
        click.option("--repeats", type=int, default=repeats, show_default=True, help="Rounds of timings at least."),
        click.option("--time-limit", type=float, default=30.0, show_default=True, help="Seconds for one run."),
        click.option("-o", "--output", type=click.Path(), help="Write the CSV file and the figures to this folder."),
        _AS_CSV,
    )
    return options(*decorators)


@measure.command()
@_comparison(3, (1_000, 10_000, 100_000))
def benchmark(output: str | None, as_csv: bool, **arguments: Any) -> int:
    """solve() against osqp, Clarabel, PIQP, SCS, an active-set method, one linear solve and every own method.

    All to the same residual, on the scenes that are named, or on all. Minutes for each scene with n = 100000.
    """
    from ..benchmarks import benchmark as compare
    from ..benchmarks import faster_peers
    from ..present.table import Table
    from ..study.charts.figures import save
    from ..study.charts.profile_chart import profile_figure
    from ..study.charts.table_charts import scaling

    table, code = _measured(compare, arguments, output, as_csv)
    if output is not None:
        save(profile_figure(table), Path(output) / "benchmark", table, typed())
        for scene, figure in scaling(table).items():
            rows = tuple(row for row in table.rows if row[0] == scene)
            name = scene.replace(",", "-").replace("=", "")
            save(figure, Path(output) / name, Table(scene, table.heads, rows), typed())
    faster = faster_peers(table)
    if not as_csv:
        click.echo("\n".join(["", "A peer is faster than solve():", *faster] if faster else ["", "No peer is faster."]))
    return code


@measure.command()
@_comparison(5, (100, 1_000, 10_000, 100_000))
def dispatch(output: str | None, as_csv: bool, **arguments: Any) -> int:
    """solve() against the quickest single own method, on the scenes that are named, or on all."""
    from ..benchmarks import dispatch as compare
    from ..study.charts.figures import save
    from ..study.charts.table_charts import choice

    table, code = _measured(compare, arguments, output, as_csv)
    if output is not None:
        save(choice(table), Path(output) / "dispatch", table, typed())
    return code


def _measured(
    compare: Callable[..., Table], arguments: dict[str, Any], output: str | None, as_csv: bool
) -> tuple[Table, int]:
    """Measure and show; Ctrl-C leaves what was measured so far, and the exit code 130."""
    if output is not None:
        try:
            Path(output).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(f"{output}: cannot be made a folder: {error.strerror}") from None
    code = 0
    try:
        with status_line(True) as say:
            table = compare(**arguments, say=say)
    except Interrupted as stopped:
        table, code = stopped.report, 130
        complain("interrupted; what was measured so far follows")
    _show(table, as_csv)
    return table, code


@measure.command()
@click.argument("scenes", nargs=-1)
@click.option("--n", type=int, default=900, show_default=True, help="Wanted unknowns of the scenes with a plane grid.")
@click.option("--repeats", type=int, default=5, show_default=True, help="Timings of each run.")
@click.option("--method", "methods", multiple=True, default=("mnmaor", "mnmsor", "mnmmod"), show_default=True)
@_AS_CSV
def tuning(scenes: tuple[str, ...], n: int, repeats: int, methods: tuple[str, ...], as_csv: bool) -> int:
    """The best theta of a grid against theta1=auto and its acceleration, on SCENES, by default on all."""
    from ..benchmarks import tuned_and_automatic

    return _show(tuned_and_automatic(n, repeats, methods, scenes), as_csv)


@measure.command()
@click.argument("scenes", nargs=-1, metavar="[NAME[,PARAMETER=NUMBER]]...")
@_LARGE_SIZES
@click.option("--method", help="Name of the method; without it one is picked.")
@click.option("-o", "--output", type=click.Path(), help="Write the figure (PNG and SVG) and its data (CSV).")
@_AS_CSV
def memory(
    scenes: tuple[str, ...], sizes: tuple[int, ...], method: str | None, output: str | None, as_csv: bool
) -> int:
    """The most memory that solve() holds on SCENES, default the membrane, against the bytes of A."""
    from ..benchmarks import memory as measured
    from ..study.charts.figures import save
    from ..study.charts.table_charts import memory_figure

    must_be_writable(output)
    table = measured(scenes or ("membrane",), sizes, method)
    if output is not None:
        save(memory_figure(table), output, table, typed())
    return _show(table, as_csv)


def _show(table: Table, as_csv: bool) -> int:
    click.echo(table.to_csv() if as_csv else str(table), nl=not as_csv)
    return 0
