"""The recipe for conda says what pyproject.toml says, under the names of conda-forge."""

import re
import tomllib

import pytest
from installed import HOUSE

yaml = pytest.importorskip("yaml", reason="PyYAML, which comes with the extra docs, is not installed")

RECIPE = HOUSE / ".ci" / "conda" / "recipe.yaml"
#: what is not called on conda-forge as on PyPI (the recipes of its feedstocks say so)
CALLED = {"matplotlib": "matplotlib-base", "qdldl": "qdldl-python"}


@pytest.fixture(scope="module")
def said():
    """(project of pyproject.toml, its build requirements, the recipe with its context put in)."""
    with (HOUSE / "pyproject.toml").open("rb") as file:
        told = tomllib.load(file)
    text = RECIPE.read_text(encoding="utf-8")
    context = yaml.safe_load(text)["context"]
    filled = re.sub(r"\$\{\{ (\w+) \}\}", lambda found: context.get(found[1], found[0]), text)
    return told["project"], told["build-system"]["requires"], yaml.safe_load(filled)


def conda_name(requirement):
    """A requirement of PyPI as conda-forge writes it: "name >=version"."""
    name, at_least = re.fullmatch(r"([\w-]+)(>=[\w.]+)", requirement).groups()
    return f"{CALLED.get(name, name)} {at_least}"


def test_the_recipe_needs_what_the_package_needs(said):
    project, build, recipe = said
    needs = recipe["requirements"]
    python = project["requires-python"].removeprefix(">=")
    assert sorted(needs["run"]) == sorted([f"python >={python}", *map(conda_name, project["dependencies"])])
    assert sorted(needs["host"]) == sorted([f"python {python}.*", "pip", *map(conda_name, build)])


def test_the_recipe_makes_the_package_that_pyproject_describes(said):
    project, _, recipe = said
    assert recipe["package"] == {"name": project["name"], "version": project["version"]}
    commands = [f"{name} = {where}" for name, where in project["scripts"].items()]
    assert recipe["build"]["python"]["entry_points"] == commands
    assert recipe["about"]["summary"] == project["description"]
    assert recipe["about"]["license"] == project["license"]
    assert [recipe["about"]["license_file"]] == project["license-files"]
    assert (RECIPE.parent / recipe["source"]["path"]).resolve() == HOUSE
