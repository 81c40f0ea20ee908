"""The house: which rooms there are, who imports whom, what loads lazily, what is public and documented."""

import ast
import collections
import inspect
import re
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher
from public_names import modules, public_objects

import icpmodel

HOUSE = Path(icpmodel.__file__).parent
TESTS = HOUSE.parent / "tests"
#: a file imports only from its own room or from rooms before it
ROOMS = [
    "errors",
    "numerics",
    "present",
    "problem",
    "algebra",
    "theory",
    "methods",
    "solve",
    "derivatives",
    "solvers",
    "crosscheck",
    "explain",
    "icp",
    "scenes",
    "modelling",
    "distributed",
    "study",
    "cli",
    "__main__",
]
#: what is loaded when it is first used, inside functions
HEAVY = {
    "casadi",
    "clarabel",
    "click",
    "cvxpy",
    "cvxpylayers",
    "gamspy_base",
    "highspy",
    "IPython",
    "jax",
    "jinja2",
    "matplotlib",
    "mpi4py",
    "numba",
    "osqp",
    "qdldl",
    "pandas",
    "petsc4py",
    "piqp",
    "pyamg",
    "pyomo",
    "qpsolvers",
    "rich",
    "scs",
    "threadpoolctl",
}


def sources():
    """Every file of the house but the face itself, which names what users may name."""
    return sorted(path for path in HOUSE.rglob("*.py") if path != HOUSE / "__init__.py")


def module_of(path):
    parts = path.relative_to(HOUSE).with_suffix("").parts
    return parts[:-1] if parts[-1] == "__init__" else parts


FILES = {module_of(path): path for path in sources()}
TREES = {path: ast.parse(path.read_text()) for path in sources()}


def imports_of(path):
    """(module, node) for every import from inside the house, wherever in the file, whatever it is for."""
    package = module_of(path) if path.name == "__init__.py" else module_of(path)[:-1]
    for node in ast.walk(TREES[path]):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - node.level + 1] + tuple(
                (node.module or "").split(".") if node.module else ()
            )
            for alias in node.names:
                yield next(one for one in ((*base, alias.name), base) if one in FILES or one == base), node


def in_functions(tree):
    return {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        for inner in ast.walk(node)
    }


def test_every_file_belongs_to_a_room():
    assert {module_of(path)[0] for path in sources()} == set(ROOMS)


def late_imports(path):
    """The imports that may go up: in the verbs of `icp.py`, and in methods called `plot`."""
    functions = [node for node in ast.walk(TREES[path]) if isinstance(node, ast.FunctionDef)]
    allowed = functions if module_of(path) == ("icp",) else [one for one in functions if one.name == "plot"]
    return {id(inner) for one in allowed for inner in ast.walk(one)}


def test_a_file_imports_only_from_its_own_room_and_those_above():
    """But for what is asked of an object and made by a room below, openly; `sys.modules` is no way round."""
    for path, tree in TREES.items():
        room = ROOMS.index(module_of(path)[0])
        free = late_imports(path)
        down = [".".join(to) for to, node in imports_of(path) if ROOMS.index(to[0]) > room and id(node) not in free]
        assert down == [], path
        assert "sys.modules" not in {ast.unparse(node) for node in ast.walk(tree) if isinstance(node, ast.Attribute)}


def test_imports_are_at_the_top_but_for_heavy_libraries_at_first_use():
    """The compiled loops count as numba, which they load; SciPy loads its own parts slowly, too."""
    for path, tree in TREES.items():
        assert "TYPE_CHECKING" not in path.read_text(), path
        inside = in_functions(tree)
        allowed = inside - late_imports(path)
        late = [to for to, node in imports_of(path) if id(node) in allowed and "kernels" not in to]
        assert late == [], path
        for node in ast.walk(tree):
            names = [node.module] if isinstance(node, ast.ImportFrom) and not node.level else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                top = name.split(".")[0]
                assert top != "icpmodel", f"{path}: imports inside the house are relative"
                assert id(node) not in inside or top in HEAVY | {"scipy"}, (path, name)


def test_no_two_files_import_each_other():
    imported = {}
    for module, path in FILES.items():
        free = late_imports(path)
        imported[module] = {
            to for to, node in imports_of(path) if to in FILES and to != module and id(node) not in free
        }
    TopologicalSorter(imported).prepare()  # its CycleError names those that do


def test_a_name_means_one_thing():
    """No two classes of one name, no two files of one name."""
    files = collections.Counter(path.name for path in sources() if path.name != "__init__.py")
    assert [name for name, count in files.items() if count > 1] == []
    classes = collections.Counter(
        node.name for path in sources() for node in ast.walk(TREES[path]) if isinstance(node, ast.ClassDef)
    )
    assert [name for name, count in classes.items() if count > 1] == []


def of_itself(function):
    """The nodes of a function without those of functions within it."""
    for node in ast.iter_child_nodes(function):
        if not isinstance(node, ast.FunctionDef | ast.Lambda):
            yield node
            yield from of_itself(node)


def test_no_generator_holds_errstate_over_a_yield():
    """Who waits would lend his state to whoever has the turn; and where the garbage collector closes a generator that
    was left there, it sets a context variable, at which Python 3.11 crashes if another one is just being set."""
    functions = [
        (path, one) for path, tree in TREES.items() for one in ast.walk(tree) if isinstance(one, ast.FunctionDef)
    ]
    for path, function in functions:
        if "contextmanager" in " ".join(map(ast.unparse, function.decorator_list)):
            continue
        for block in of_itself(function):
            if isinstance(block, ast.With) and "errstate" in " ".join(map(ast.unparse, block.items)):
                kinds = {type(node) for node in of_itself(block)}
                assert not kinds & {ast.Yield, ast.YieldFrom}, f"{path}: {function.name}, line {block.lineno}"


def test_tests_patch_nothing_private():
    """What a test must vary is a parameter."""
    patched = []
    for path in TESTS.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("patch.setattr", "patch.delattr")):
                target = ", ".join(ast.unparse(one) for one in node.args[:2])
                if re.search(r"['\".]_[a-zA-Z]|icpmodel|\"[A-Z_]+\"", target):
                    patched.append(f"{path.relative_to(TESTS)}: {target}")
    assert patched == []


#: lines of a script, one after the other in one process → what they load of what is neither ours nor Python's
LOADS = {
    "import icpmodel as icp; icp.ICP([[1.0]], [1.0])": {"icpmodel", "lazy_loader"},
    "import icpmodel.solvers, icpmodel.crosscheck, icpmodel.study; icp.solvers.foreign_solvers()": set(),
    "scene = icp.scenes.membrane()": set(),
    "import icpmodel.solve.many, icpmodel.explain.explanation, icpmodel.crosscheck.judge": set(),
    "assert all(map(callable, (icp.solve, icp.explain, icp.crosscheck))), 'verbs with the names of rooms'": set(),
    "icp.certify(scene.problem, [0.0] * 900); icp.scenes.hand_lcp().problem.solve()": {"numba"},
}


def test_importing_loads_numpy_and_scipy_at_most_and_solving_numba():
    """Law 10; and a verb with the name of its room stays a verb, whatever is imported later."""
    script = f"""
import sys, numpy, scipy.sparse
def names():
    return {{name.split(".")[0] for name in sys.modules}}
for line in {list(LOADS)!r}:
    before = names()
    exec(line)
    # multiprocessing has __main__ under another name, too
    print(*(names() - before - sys.stdlib_module_names - {{"__mp_main__"}}))
"""
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    for (code, expected), added in zip(LOADS.items(), run.stdout.splitlines(), strict=True):
        loaded = set(added.split())
        assert (loaded if "icpmodel" in expected else loaded & HEAVY) == expected, code


def test_what_is_compiled_is_found_again_by_the_next_process():
    """numba takes what a closure closes over for a part of its name, and that is another one in every process."""
    rooms = [module for module in modules() if ".kernels." in module.__name__]
    kept = [value for room in rooms for value in vars(room).values() if isinstance(value, Dispatcher)]
    assert len(kept) > 40
    assert [code for code in kept if code.py_func.__closure__] == []


def test_every_public_function_and_class_has_a_docstring_with_an_example():
    """Commands are no functions for Python; errors and protocols show theirs where they are raised or met."""
    assert [module.__name__ for module in modules() if not module.__doc__] == []
    missing = [
        name
        for name, value in public_objects()
        if ">>>" not in (value.__doc__ or "") and not name.startswith("icpmodel.cli")
    ]
    assert missing == []


def test_every_public_method_has_a_docstring():
    missing = {
        f"{name}.{attribute}"
        for name, value in public_objects()
        if inspect.isclass(value)
        for attribute, member in vars(value).items()
        if not attribute.startswith("_")
        and (inspect.isfunction(member) or isinstance(member, property))
        and not inspect.getdoc(getattr(value, attribute))
    }
    assert missing == set()


def test_the_face_lists_every_name_once_and_has_it():
    stub = ast.parse((HOUSE / "__init__.pyi").read_text())
    names = [alias.asname for node in ast.walk(stub) if isinstance(node, ast.ImportFrom) for alias in node.names]
    assert len(names) == len(set(names))
    assert set(names) == set(icpmodel.__all__) <= set(dir(icpmodel))
    for name in names:
        getattr(icpmodel, name)
    with pytest.raises(AttributeError, match="Nwton"):
        _ = icpmodel.Nwton
