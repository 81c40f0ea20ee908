"""House rules: who imports whom, what loads lazily, what is public and documented."""

import ast
import importlib
import inspect
import os
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import icpmodel

HOUSE = Path(icpmodel.__file__).parent
ROOMS = [
    "errors",
    "arrays",
    "kernels",
    "maps",
    "intervention",
    "problem",
    "operators",
    "splittings",
    "theory",
    "solution",
    "methods",
    "progress",
    "driver",
    "files",
    "scenes",
    "crosscheck",
    "measure",
    "cli",
    "__main__",
]
#: the thin methods of ICP load the rooms below at the moment they are called
THIN = {("problem", "driver"), ("problem", "crosscheck")}


def room_of(path):
    parts = path.relative_to(HOUSE).with_suffix("").parts
    return parts[0]


def imports_of(path):
    """The rooms that a file imports, wherever in the file, but not for type checking only."""
    package = ("icpmodel", *path.relative_to(HOUSE).parts[:-1])
    tree = ast.parse(path.read_text())
    skipped = {
        id(node)
        for branch in ast.walk(tree)
        if isinstance(branch, ast.If) and ast.unparse(branch.test) == "TYPE_CHECKING"
        for node in ast.walk(branch)
    }
    for node in ast.walk(tree):
        if id(node) in skipped or not isinstance(node, ast.ImportFrom) or not node.level:
            continue
        base = package[: len(package) - node.level + 1] + tuple((node.module or "").split(".") if node.module else ())
        names = [base[1]] if len(base) > 1 else [alias.name for alias in node.names]
        yield from names


def sources():
    return sorted(path for path in HOUSE.rglob("*.py") if path.name != "__init__.py" or path.parent != HOUSE)


def test_every_file_belongs_to_a_room():
    assert {room_of(path) for path in sources()} == set(ROOMS)


@pytest.mark.parametrize("path", sources(), ids=lambda p: str(p.relative_to(HOUSE)))
def test_a_room_imports_only_from_rooms_above_it(path):
    room = room_of(path)
    for other in imports_of(path):
        assert other == room or (room, other) in THIN or ROOMS.index(other) < ROOMS.index(room), other


def loaded_by(code):
    script = f"import sys\n{code}\nprint(*sorted({{m.split('.')[0] for m in sys.modules}}))"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(run.stdout.splitlines()[-1].split())


HEAVY = {"numba", "cvxpy", "osqp", "pyomo", "highspy", "matplotlib", "rich", "click", "clarabel"}


def test_importing_icpmodel_loads_numpy_and_scipy_at_most():
    assert loaded_by("import icpmodel") & HEAVY == set()


def test_building_and_certifying_a_problem_loads_nothing_more():
    code = "import icpmodel as icp; icp.certify(icp.scenes.membrane().problem, [0.0] * 900)"
    assert loaded_by(code) & HEAVY == set()


def test_solving_loads_numba_only():
    assert loaded_by("import icpmodel as icp; icp.scenes.hand_lcp().problem.solve()") & HEAVY == {"numba"}


def test_the_crosscheck_room_loads_its_solvers_at_first_use():
    assert loaded_by("import icpmodel.crosscheck") & HEAVY == set()


def test_without_a_writable_cache_everything_still_runs():
    code = "import icpmodel as icp; print(icp.scenes.hand_lcp().problem.solve('mnmgs').status.value)"
    environment = {**os.environ, "NUMBA_CACHE_DIR": "/dev/null/nowhere"}
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)
    assert run.stdout == "solved\n", run.stderr


def modules():
    yield icpmodel
    for info in pkgutil.walk_packages(icpmodel.__path__, "icpmodel."):
        yield importlib.import_module(info.name)


def public_objects():
    for module in modules():
        for name, value in vars(module).items():
            if name.startswith("_") or getattr(value, "__module__", None) != module.__name__:
                continue
            if inspect.isclass(value) or inspect.isfunction(value):
                yield f"{module.__name__}.{name}", value


@pytest.mark.parametrize("module", list(modules()), ids=lambda m: m.__name__)
def test_every_module_says_what_it_is(module):
    assert module.__doc__


def test_every_public_function_and_class_has_a_docstring_with_an_example():
    """Commands are no functions for Python; kernels are compiled code."""
    missing = [
        name
        for name, value in public_objects()
        if not name.startswith("icpmodel.kernels.") and ">>>" not in (value.__doc__ or "")
    ]
    assert missing == []


def test_every_public_method_has_a_docstring():
    missing = []
    for name, value in public_objects():
        if inspect.isclass(value):
            missing += [
                f"{name}.{attribute}"
                for attribute, member in vars(value).items()
                if not attribute.startswith("_")
                and (inspect.isfunction(member) or isinstance(member, property))
                and not inspect.getdoc(member)
            ]
    assert missing == []


def test_all_names_what_is_there():
    assert sorted(icpmodel.__all__) == icpmodel.__all__ or len(set(icpmodel.__all__)) == len(icpmodel.__all__)
    for name in icpmodel.__all__:
        assert hasattr(icpmodel, name)


def test_no_file_or_function_has_grown_beyond_reason():
    """Law 12, as a ceiling: 400 lines a file, 60 a function (docstrings count)."""
    for path in sources():
        text = path.read_text()
        assert text.count("\n") <= 400, path
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                assert node.end_lineno - node.lineno < 60, f"{path}: {node.name}"
