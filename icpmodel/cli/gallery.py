"""`icpmodel scenes`."""

from __future__ import annotations

import click

from ..present.card import Card
from ..present.table import Table
from ..scenes import parameters as parameters_of
from ..scenes import scene as scene_called
from ..scenes import titles
from .output import AS_JSON, show_json


@click.command()
@click.argument("name", required=False)
@AS_JSON
def scenes(name: str | None, as_json: bool) -> int:
    """List the built-in scenes, or describe the scene NAME."""
    if name is None:
        if as_json:
            show_json(titles())
        else:
            click.echo(str(Table("", ("scene", "what it is"), tuple(titles().items()))))
        return 0
    scene, parameters = scene_called(name), parameters_of(name)
    reference = (["z"] if scene.z_exact is not None else []) + list(scene.quantities)
    about = {"name": scene.name, "title": scene.title, "models": scene.models, "problem": repr(scene.problem)}
    if as_json:
        why = {"why_no_reference": scene.why_no_reference, "why_no_solution": scene.why_no_solution}
        show_json(about | {"parameters": parameters, "reference": reference} | why)
        return 0
    listed = [f"--n {parameters['n']}"] if "n" in parameters else []
    listed += [f"--set {key}={value}" for key, value in parameters.items() if key != "n"]
    known = ", ".join(reference) or f"none: {scene.why_no_solution or scene.why_no_reference}"
    title = "solution" if scene.why_no_solution else "reference"
    click.echo(Card(about | {"parameters": " ".join(listed) or "none", title: known}))
    return 0
