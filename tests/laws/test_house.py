"""House rules: who imports whom, what loads lazily, what is public and documented."""

import ast
import importlib
import inspect
import os
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher

import icpmodel
from icpmodel.numerics import kernels
from icpmodel.numerics.kernels import sweeps

HOUSE = Path(icpmodel.__file__).parent
ROOMS = [
    "errors",
    "arrays",
    "threads",
    "kernels",
    "maps",
    "intervention",
    "problem",
    "reduction",
    "steps",
    "operators",
    "splittings",
    "theory",
    "solution",
    "methods",
    "goal",
    "progress",
    "loop",
    "driver",
    "many",
    "explain",
    "files",
    "scenes",
    "crosscheck",
    "modelling",
    "measure",
    "cli",
    "__main__",
]
#: the thin methods of ICP load the rooms below at the moment they are called
THIN = {("problem", "driver"), ("problem", "explain"), ("problem", "crosscheck"), ("problem", "modelling")}


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
        if isinstance(node, ast.Import) and any(alias.name.split(".")[0] == "icpmodel" for alias in node.names):
            raise AssertionError(f"{path}: imports inside the house are relative")
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


HEAVY = {
    "numba",
    "pyamg",
    "cvxpy",
    "osqp",
    "pyomo",
    "highspy",
    "matplotlib",
    "rich",
    "click",
    "clarabel",
    "scs",
    "piqp",
}


def test_importing_icpmodel_loads_numpy_and_scipy_at_most():
    for code in ("import icpmodel", "import icpmodel; icpmodel.ICP([[1.0]], [1.0])"):
        added = loaded_by(code) - loaded_by("import numpy, scipy.sparse")
        assert added - sys.stdlib_module_names == {"icpmodel"}


def test_building_and_certifying_a_problem_loads_nothing_more():
    code = "import icpmodel as icp; icp.certify(icp.scenes.membrane().problem, [0.0] * 900)"
    assert loaded_by(code) & HEAVY == set()


def test_solving_loads_numba_only():
    assert loaded_by("import icpmodel as icp; icp.scenes.hand_lcp().problem.solve()") & HEAVY == {"numba"}


@pytest.mark.parametrize("room", ["crosscheck", "measure", "measure.charts"])
def test_the_rooms_of_foreign_solvers_load_them_at_first_use(room):
    assert loaded_by(f"import icpmodel.{room}") & HEAVY == set()


def test_without_a_writable_cache_everything_still_runs():
    code = "import icpmodel as icp; print(icp.scenes.hand_lcp().problem.solve('mnmgs').status.value)"
    environment = {**os.environ, "NUMBA_CACHE_DIR": "/dev/null/nowhere"}
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)
    assert run.stdout == "solved\n", run.stderr


def test_what_is_compiled_is_found_again_by_the_next_process():
    """numba takes what a closure closes over for a part of its name, and that is another one in every process."""
    rooms = [
        importlib.import_module(f"icpmodel.numerics.kernels.{info.name}")
        for info in pkgutil.iter_modules(kernels.__path__)
    ]
    kept = [value for room in [*rooms, sweeps.SWEEPS] for value in vars(room).values() if isinstance(value, Dispatcher)]
    assert len(kept) > 40
    assert [code for code in kept if code.py_func.__closure__] == []


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
        if not name.startswith("icpmodel.numerics.kernels.") and ">>>" not in (value.__doc__ or "")
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


def test_the_public_names_are_the_same_for_users_and_for_type_checkers():
    tree = ast.parse((HOUSE / "__init__.py").read_text())
    block = next(node for node in tree.body if isinstance(node, ast.If))
    declared = {alias.name: node.module for node in block.body for alias in node.names}
    assert declared == icpmodel._HOME
    for name, room in declared.items():
        home = importlib.import_module(f"icpmodel.{room}")
        assert getattr(icpmodel, name) is getattr(home, name)
    assert set(icpmodel.__all__) <= set(dir(icpmodel))
    with pytest.raises(AttributeError, match="no attribute 'Nwton'"):
        _ = icpmodel.Nwton


def test_no_file_or_function_has_grown_beyond_reason():
    """Law 12: 300 lines a file, 50 a function; docstrings, which hold the mathematics, do not count."""

    def lines(node):
        bodies = [n for n in ast.walk(node) if isinstance(n, ast.Module | ast.ClassDef | ast.FunctionDef)]
        docs = [n.body[0] for n in bodies if ast.get_docstring(n) is not None]
        return sum(doc.end_lineno - doc.lineno + 1 for doc in docs)

    for path in sources():
        text = path.read_text()
        tree = ast.parse(text)
        assert text.count("\n") - lines(tree) <= 300, path
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef):
                assert node.end_lineno - node.lineno + 1 - lines(node) <= 50, f"{path}: {node.name}"


def test_the_readme_has_no_gap_its_python_runs_and_its_figures_are_there():
    text = (HOUSE.parent / "README.md").read_text()
    assert "icpmodel." not in text
    names = {}
    for block in text.split("```python\n")[1:]:
        exec(compile(block.split("```")[0], "README.md", "exec"), names)
    figures = re.findall(r"!\[[^]]+\]\(([^)]+)\)", text)
    assert figures
    for figure in figures:
        assert (HOUSE.parent / figure).read_bytes().startswith(b"\x89PNG")
        assert (HOUSE.parent / figure).with_suffix(".csv").read_text().startswith("# icpmodel ")
