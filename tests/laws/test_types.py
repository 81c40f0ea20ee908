"""Types: what a user writes is checked by `mypy --strict`, and an editor can complete every call."""

import ast
import importlib
import inspect
import re
from pathlib import Path

import pytest
from public_names import public_objects

import icpmodel as icp
from icpmodel import scenes

HERE, HOUSE = Path(__file__).parent, Path(icp.__file__).parent
#: whose further keywords are the options of a method or the parameters of a scene, which have signatures of their own,
#: belong to another package, or are in the stub beside the verbs of ICP
OPEN = {"solve", "explain", "named", "scene", "render", "pyomo_solver", "by_rows", "race", "stability", "report"}


@pytest.mark.slow
def test_a_users_script_that_names_every_public_name_passes_mypy_strict():
    """What mypy thinks of the package itself is asked elsewhere; without a cache it takes as long as that."""
    api = importlib.import_module("mypy.api")
    script, cache = HERE / "users_script.py", HOUSE.parent / ".mypy_cache" / "strict"
    unnamed = [name for name in icp.__all__ if not re.search(rf"\bicp\.{name}\b", script.read_text())]
    assert unnamed == []
    options = ["--strict", "--config-file=", "--follow-imports=silent", f"--cache-dir={cache}"]
    said, errors, code = api.run([*options, str(script)])
    assert (said.startswith("Success"), errors, code) == (True, "", 0), said


def test_every_public_call_has_its_keywords_and_types_in_its_signature():
    """No `**options` in which an editor finds nothing, and nothing without an annotation."""
    open_, bare = set(), []
    for name, value in public_objects():
        members = vars(value).values() if inspect.isclass(value) else [value]
        for function in filter(inspect.isfunction, members):
            if function.__name__.startswith("_") or not function.__module__.startswith("icpmodel"):
                continue
            signature = inspect.signature(function)
            given = [one for key, one in signature.parameters.items() if key not in ("self", "cls")]
            if signature.empty in (signature.return_annotation, *(one.annotation for one in given)):
                bare.append(f"{name}: {function.__name__}")
            if any(one.kind is one.VAR_KEYWORD for one in given):
                open_.add(function.__name__)
    assert bare == []
    assert open_ <= OPEN


def stubbed(room):
    """Function → parameters and defaults, of the stub of a room."""
    path = Path(room.__file__).with_suffix(".pyi")
    return {
        node.name: ast.unparse(node.args)
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef)
    }


def defined(function):
    source = ast.parse(inspect.getsource(inspect.unwrap(function)))
    return source.body[0].args


def test_stubs_say_what_the_functions_say():
    known = stubbed(scenes)
    for name in ("scene", "names", "titles", "parameters"):
        assert known[name] == ast.unparse(defined(getattr(scenes, name)))
    verb, method = defined(icp.stability), stubbed(importlib.import_module("icpmodel.icp"))["stability"]
    of = [one.arg for one in verb.args].index("problem")
    del verb.args[of], verb.defaults[of - len(verb.args) - 1]
    assert method == f"self, {ast.unparse(verb)}"


def test_every_file_of_the_gallery_is_in_its_stub():
    stars = re.findall(r"from \.(\w+) import \*", Path(scenes.__file__).with_suffix(".pyi").read_text())
    files = {
        build.__wrapped__.__module__.rpartition(".")[2]
        for build in scenes.registry.builders().values()
        if build.__wrapped__.__module__.startswith("icpmodel.")
    }
    assert set(stars) == files
