"""The gallery's contract: what every scene carries, and how wrong wishes are refused."""

import numpy as np
import pytest

import icpmodel.scenes as scenes
from icpmodel.errors import InputError
from icpmodel.icp import ICP

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


def test_two_calls_build_the_same_problem():
    for name in NAMES:
        one, two = scenes.scene(name), scenes.scene(name)
        z = np.linspace(-1, 1, one.problem.n)
        np.testing.assert_array_equal(one.problem.natural_map(z), two.problem.natural_map(z))


@pytest.mark.parametrize("n", [0, -3, 2.5, 4.0, "9", True, float("nan")])
def test_n_must_be_a_positive_integer(n):
    for name in NAMES:
        with pytest.raises(InputError, match="n is"):
            scenes.scene(name, n)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -91, "much", None])
def test_no_parameter_takes_what_is_no_number_or_far_below(value):
    for name in set(NAMES) - ({"hard-skew"} if value == -91 else set()):
        for parameter in scenes.parameters(name).keys() - {"n"}:
            with pytest.raises(InputError, match=f"^{parameter} is "):
                scenes.scene(name, **{parameter: value})


def test_a_scene_of_one_size_takes_only_that():
    for name in set(NAMES) - set(SIZED):
        size = scenes.scene(name).problem.n
        assert scenes.scene(name, size).problem.n == size
        with pytest.raises(InputError, match=f"one size only, n = {size}"):
            scenes.scene(name, size + 1)


def test_an_unknown_name_gets_the_nearest_one_or_else_all():
    with pytest.raises(InputError, match="no scene 'membran'; did you mean membrane"):
        scenes.scene("membran")
    with pytest.raises(InputError, match=r"no scene 'xyz'; the scenes are: bai-nonsymmetric, .*membrane"):
        scenes.scene("xyz")
    with pytest.raises(InputError, match="no scene"):
        scenes.parameters("membran")


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("membrane", {"skew": 1.5}),
        ("coulomb", {"alpha": 90}),
        ("coulomb", {"mu": -0.1}),
        ("coulomb", {"mass": 0}),
        ("coulomb", {"g": 0}),
        ("hard-scaled", {"decades": 76}),
        ("manufactured-elementwise", {"seed": 0.5}),
        ("box-manufactured", {"coupling": -0.1}),
        ("box-manufactured", {"skew": 1.5}),
        ("game-put", {"delta": 0}),
        ("exchange", {"delta": 0}),
        ("bratu", {"heat": 0}),
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
        "kappa": 3.0,
        "heat": 2.0,
    }
    for name in NAMES:
        for parameter in scenes.parameters(name):
            one, two = scenes.scene(name).problem, scenes.scene(name, **{parameter: changed[parameter]}).problem
            z = np.ones(one.n)
            sides = (of.r_upper if one.upper is not None else of.r for of in (one, two))
            changes = one.n != two.n or (one.p(z) != two.p(z)).any() or (one.r(z) != two.r(z)).any()
            assert changes or np.not_equal(*(side(z) for side in sides)).any(), parameter


def test_errors_measure_every_reference_and_let_nan_through():
    bearing = scenes.bearing()
    assert set(bearing.errors(np.zeros(300))) == {"p_max", "cavitation angle"}
    lcp = scenes.hand_lcp()
    assert lcp.errors([0.5, 0.25]) == {"z": 0.25}
    assert np.isnan(lcp.errors([np.nan, 0.0])["z"])
    assert scenes.membrane().errors(np.zeros(900)) == {}
    with pytest.raises(InputError, match=r"z has shape \(3,\); shape \(2,\) was expected"):
        lcp.errors([0.0, 0.0, 0.0])
