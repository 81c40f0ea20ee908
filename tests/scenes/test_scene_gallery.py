"""The gallery's contract: what every scene carries, and how wrong wishes are refused."""

from __future__ import annotations

import pkgutil
import subprocess
import sys

import numpy as np
import pytest
from installed import announce, run

import icpmodel.scenes as scenes
from icpmodel.errors import InputError
from icpmodel.icp import ICP
from icpmodel.scenes.registry import Quantity, Scene, builders, register

NAMES = scenes.names()
SIZED = [name for name in NAMES if "n" in scenes.parameters(name)]


@pytest.mark.parametrize("name", NAMES)
def test_every_scene_says_what_it_is_and_has_a_reference_or_the_reason_why_not(name):
    scene = scenes.scene(name)
    assert scene.name == name
    assert scene.title == scenes.titles()[name]
    assert "\n" not in scene.title
    assert len(scene.title) <= 72
    assert scene.models.endswith(".")
    assert isinstance(scene.problem, ICP)
    assert scene.problem.n <= 1000
    has_reference = scene.z_exact is not None or bool(scene.quantities)
    assert has_reference is (scene.why_no_reference is None and scene.why_no_solution is None)
    for array in (scene.z_exact, scene.z0):
        assert array is None or (array.shape == (scene.problem.n,) and not array.flags.writeable)
    assert scene.points is None or len(scene.points) == scene.problem.n


@pytest.mark.parametrize("name", SIZED)
@pytest.mark.parametrize("n", [50, 333, 1000])
def test_a_scene_takes_the_nearest_size_it_can_have(name, n):
    problem = scenes.scene(name, n).problem
    m = round(problem.n**0.5)
    if name in ("bearing", "hard-skew", "hard-scaled", "phase-step"):
        assert problem.n == n
    elif name in ("hard-semidefinite", "hard-singular", "game-put"):
        assert problem.n % 2 == (name == "game-put")
        assert abs(problem.n - n) <= 1
    elif name == "dividend":
        assert problem.n % 30 == 1
        assert abs(problem.n - n) <= 15
    elif name == "obstacle-3d":
        k = round(problem.n ** (1 / 3))
        assert problem.n == k**3
        assert abs(problem.n - n) <= min(abs((k + 1) ** 3 - n), abs((k - 1) ** 3 - n))
    else:
        assert problem.n == m * m
        assert abs(problem.n - n) <= min(abs((m + 1) ** 2 - n), abs((m - 1) ** 2 - n))


def test_two_calls_build_the_same_problem():
    for name in NAMES:
        one, two = scenes.scene(name), scenes.scene(name)
        z = np.linspace(-1, 1, one.problem.n)
        np.testing.assert_array_equal(one.problem.natural_map(z), two.problem.natural_map(z))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("n", [0, -3, 2.5, 4.0, "9", True, float("nan")])
def test_n_must_be_a_positive_integer(name, n):
    with pytest.raises(InputError, match="n is"):
        scenes.scene(name, n)


@pytest.mark.parametrize(
    ("name", "n"),
    [
        ("bearing", 9),
        ("ball", 15),
        ("dividend", 30),
        ("game-put", 32),
        ("obstacle-3d", 26),
        ("phase-step", 32),
        ("torsion", 24),
    ],
)
def test_a_scene_says_how_many_unknowns_it_needs(name, n):
    assert scenes.scene(name, n + 1).problem.n >= n + 1
    with pytest.raises(InputError, match=f"number of unknowns n is {n}; a whole number >= {n + 1}"):
        scenes.scene(name, n)


def test_a_scene_of_one_size_takes_only_that():
    for name in set(NAMES) - set(SIZED):
        size = scenes.scene(name).problem.n
        assert scenes.scene(name, size).problem.n == size
        with pytest.raises(InputError, match=f"one size only, n = {size}"):
            scenes.scene(name, size + 1)


def test_the_smallest_squares_are_problems_too():
    for name in ("membrane", "bai-symmetric", "bai-nonsymmetric", "manufactured-affine", "manufactured-elementwise"):
        assert scenes.scene(name, 1).problem.n == 1


def test_an_unknown_name_gets_the_nearest_one_or_else_all():
    with pytest.raises(InputError, match="no scene 'membran'; did you mean membrane"):
        scenes.scene("membran")
    with pytest.raises(InputError, match=r"no scene 'xyz'; the scenes are: bai-nonsymmetric, .*membrane"):
        scenes.scene("xyz")
    with pytest.raises(InputError, match="no scene"):
        scenes.parameters("membran")


def test_an_unknown_parameter_lists_the_parameters():
    with pytest.raises(InputError, match="membrane has no parameter 'nu'; its parameters are: n, mu, skew"):
        scenes.scene("membrane", nu=1)
    with pytest.raises(InputError, match="hand-lcp has no parameter 'mu'; its parameters are: none"):
        scenes.scene("hand-lcp", mu=1)


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("membrane", {"mu": -1}),
        ("membrane", {"mu": float("nan")}),
        ("membrane", {"skew": 1.5}),
        ("bai-symmetric", {"mu": float("inf")}),
        ("bai-nonsymmetric", {"mu": "much"}),
        ("manufactured-affine", {"seed": -1}),
        ("manufactured-elementwise", {"seed": 0.5}),
        ("manufactured-affine", {"mu": None}),
        ("coulomb", {"alpha": 90}),
        ("coulomb", {"alpha": -1}),
        ("coulomb", {"mu": -0.1}),
        ("coulomb", {"mass": 0}),
        ("coulomb", {"g": 0}),
        ("coulomb", {"dt": -1}),
        ("hard-skew", {"skew": float("inf")}),
        ("hard-scaled", {"decades": 76}),
        ("hard-semidefinite", {"seed": -1}),
        ("box-manufactured", {"coupling": -0.1}),
        ("box-manufactured", {"skew": 1.5}),
        ("game-put", {"delta": 0}),
    ],
)
def test_a_bad_value_names_its_parameter(name, parameters):
    with pytest.raises(InputError, match=f"^{next(iter(parameters))} is "):
        scenes.scene(name, **parameters)


def test_every_parameter_matters():
    changed = {
        "n": 144,
        "decades": 9.0,
        "mu": 0.7,
        "skew": 0.5,
        "seed": 3,
        "alpha": 20.0,
        "mass": 2.0,
        "g": 1.62,
        "dt": 0.2,
        "coupling": 0.5,
        "delta": 0.1,
    }
    for name in NAMES:
        for parameter in scenes.parameters(name):
            one, two = scenes.scene(name).problem, scenes.scene(name, **{parameter: changed[parameter]}).problem
            z = np.ones(one.n)
            sides = (of.r_upper if one.upper is not None else of.r for of in (one, two))
            changes = one.n != two.n or (one.p(z) != two.p(z)).any() or (one.r(z) != two.r(z)).any()
            assert changes or np.not_equal(*(side(z) for side in sides)).any(), parameter


def test_each_scene_is_an_attribute_and_no_module_hides_one():
    modules = {module.name for module in pkgutil.iter_modules(scenes.__path__)}
    for name in NAMES:
        attribute = name.replace("-", "_")
        assert attribute not in modules | set(scenes.__all__)
        assert getattr(scenes, attribute) is builders()[name]
        assert attribute in dir(scenes)
    assert scenes.membrane(n=100).problem.n == 100
    with pytest.raises(AttributeError, match="nothing_of_the_kind"):
        _ = scenes.nothing_of_the_kind


def test_adding_a_field_is_adding_a_file(tmp_path):
    (tmp_path / "another_field.py").write_text(
        "from icpmodel.icp import ICP\n"
        "from icpmodel.scenes.registry import Scene, register\n\n\n"
        "@register\n"
        "def put(n: int = 2) -> Scene:\n"
        '    """A new field.\n    """\n'
        '    return Scene(problem=ICP([[1.0]], [0.0]), models="Nothing.", why_no_reference="None.")\n'
    )
    code = (
        "import pkgutil; walk = pkgutil.iter_modules\n"
        "def with_more(path):\n"
        f"    path.extend([{str(tmp_path)!r}] * path[0].endswith('scenes'))\n"
        "    return walk(path)\n"
        "pkgutil.iter_modules = with_more\n"
        "import icpmodel.scenes as s; print(s.titles()['put'], '|', s.put().name)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.stdout.strip() == "A new field | put", run.stderr


def test_a_name_is_taken_once():
    def membrane() -> Scene:
        """Another one."""
        raise AssertionError

    with pytest.raises(InputError, match="already a scene called membrane"):
        register(membrane)


def test_importing_the_gallery_loads_no_compiler_and_no_solver():
    code = (
        "import sys, icpmodel.scenes; print([m for m in ('numba', 'cvxpy', 'pyomo', 'matplotlib') if m in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"


def test_errors_measure_every_reference_and_let_nan_through():
    bearing = scenes.bearing()
    assert set(bearing.errors(np.zeros(300))) == {"p_max", "cavitation angle"}
    lcp = scenes.hand_lcp()
    assert lcp.errors([0.5, 0.25]) == {"z": 0.25}
    assert np.isnan(lcp.errors([np.nan, 0.0])["z"])
    assert scenes.membrane().errors(np.zeros(900)) == {}
    with pytest.raises(InputError, match=r"z has shape \(3,\); shape \(2,\) was expected"):
        lcp.errors([0.0, 0.0, 0.0])


@pytest.mark.parametrize("name", ["ball", "bearing", "dividend"])
@pytest.mark.parametrize("fill", [0.0, -1.0, 1.0, np.nan])
def test_a_quantity_of_a_wrong_answer_is_a_number_or_nan_never_a_crash(name, fill):
    scene = scenes.scene(name)
    for error in scene.errors(np.full(scene.problem.n, fill)).values():
        assert isinstance(error, float)
        assert not error < 1e-3


def test_a_quantity_measures_a_distance():
    quantity = Quantity(2.0, lambda z: float(z[0]), order=None)
    assert quantity.error(np.array([1.5])) == 0.5


OUTSIDE = """
from icpmodel.scenes import Scene, register
from icpmodel import ICP


@register
def put(n: int = 2) -> Scene:
    \"\"\"A field of another package.\"\"\"
    return Scene(problem=ICP([[2.0]], [-1.0]), models="Nothing.", why_no_reference="None.")
"""


@pytest.mark.parametrize("how", ["imported", "announced"])
def test_a_scene_from_outside_is_found_by_name_and_on_the_command_line(tmp_path, how):
    """Once its module is imported, or where its package announces it as an entry point."""
    (tmp_path / "outside.py").write_text(OUTSIDE)
    if how == "announced":
        announce(tmp_path, "outside", {"icpmodel": {"scenes": "outside"}})
    first = "import outside; " if how == "imported" else ""
    code = "import icpmodel.scenes as s; print(s.scene('put').title, '|', s.put().name, 'put' in s.names())"
    ran = run("-c", first + code, folder=tmp_path)
    assert ran.stdout.strip() == "A field of another package | put True", ran.stderr
    for arguments in (["scenes"], ["solve", "put"]):
        ran = run("-c", f"{first}from icpmodel.cli import main; main({arguments})", folder=tmp_path)
        assert ran.returncode == 0, ran.stderr
        assert ("A field of another package" if arguments == ["scenes"] else "solved after") in ran.stdout
