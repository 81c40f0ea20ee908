"""`icpmodel warmup`: what else the first calls on a machine would wait for."""

from __future__ import annotations

import click

from ..benchmarks.warmup import warm_up
from ..solve.progress import status_line


@click.command()
def warmup() -> int:
    """Compile all loops once, which takes minutes; every process finds them on the disk then."""
    with status_line(True) as say:
        seconds = warm_up(say)
    click.echo(f"all loops are compiled and kept on the disk: {seconds:.3g} s")
    return 0
