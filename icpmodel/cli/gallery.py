"""`icpmodel scenes`."""

from __future__ import annotations

import click

from .output import show_json


@click.command()
@click.argument("name", required=False)
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
def scenes(name: str | None, as_json: bool) -> int:
    """List the built-in scenes, or describe the scene NAME."""
    from .. import scenes as gallery

    if name is None:
        titles = gallery.titles()
        width = max(map(len, titles))
        if as_json:
            show_json(dict(titles))
        else:
            click.echo("\n".join(f"{scene:<{width}}  {title}" for scene, title in titles.items()))
        return 0
    scene = gallery.scene(name)
    reference = (["z"] if scene.z_exact is not None else []) + list(scene.quantities)
    parameters = gallery.parameters(name)
    if as_json:
        show_json(
            {
                "name": scene.name,
                "title": scene.title,
                "models": scene.models,
                "problem": repr(scene.problem),
                "parameters": parameters,
                "reference": reference,
                "why_no_reference": scene.why_no_reference,
                "why_no_solution": scene.why_no_solution,
            }
        )
        return 0
    listed = ["--n " + str(parameters["n"])] if "n" in parameters else []
    listed += [f"--set {key}={value}" for key, value in parameters.items() if key != "n"]
    click.echo(f"{scene.name}: {scene.title}\n{scene.models}\n{scene.problem!r}")
    click.echo("parameters: " + (" ".join(listed) or "none"))
    if scene.why_no_solution:
        click.echo(f"no solution: {scene.why_no_solution}")
        return 0
    click.echo("reference:  " + (", ".join(reference) or f"none: {scene.why_no_reference}"))
    return 0
