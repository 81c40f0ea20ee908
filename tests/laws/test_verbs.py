"""The verbs: each is a function of the package, a method of ICP, and takes whatever is, holds or makes a problem."""

import inspect

import cvxpy as cp
import numpy as np
import pytest

import icpmodel as icp
from icpmodel.modelling.pyomo import read_pyomo

SCENE = icp.scenes.hand_lcp()
Z = SCENE.z_exact
QUICK = {"repeats": 1, "tolerances": [1e-2]}
#: verb → its call on what stands for a problem, and what must be the same whatever that is
VERBS = {
    "solve": (lambda verb, of: verb(of), lambda found: found.z),
    "explain": (lambda verb, of: verb(of), lambda found: found.bound.unique),
    "crosscheck": (lambda verb, of: verb(of, Z, ["highs"]), lambda found: found.agrees),
    "certify": (lambda verb, of: verb(of, Z), lambda found: found.error_bound),
    "error_bound": (lambda verb, of: verb(of, Z), lambda found: found.value),
    "race": (lambda verb, of: verb(of, ["mnmgs"], [], **QUICK), lambda found: [one.residual for one in found.entries]),
    "stability": (lambda verb, of: verb("relaxation", of, points=2), lambda found: found.steps),
    # a page draws a race and maps
    "report": (lambda verb, of: verb(of, title="x", time_limit=1e-3), lambda found: "<h2>Answer</h2>" in found),
}
PROBLEM = SCENE.problem
SLOW = [pytest.mark.slow]


def model():
    z = cp.Variable(PROBLEM.n)
    return icp.Problem(icp.complements(PROBLEM.A @ z + PROBLEM.q, z))


LIKE = {
    "scene": lambda: SCENE,
    "solution": PROBLEM.solve,
    "cvxpy": model,
    "pyomo": lambda: read_pyomo(PROBLEM.to_pyomo()),
}


@pytest.mark.parametrize("like", LIKE)
@pytest.mark.parametrize("verb", [verb for verb in VERBS if verb != "report"])
def test_a_verb_takes_what_holds_or_makes_a_problem(verb, like):
    call, result = VERBS[verb]
    function = getattr(icp, verb)
    np.testing.assert_allclose(result(call(function, LIKE[like]())), result(call(function, PROBLEM)))


@pytest.mark.parametrize("verb", [pytest.param(verb, marks=SLOW if verb == "report" else []) for verb in VERBS])
def test_a_verb_is_a_method_of_the_problem(verb):
    call, result = VERBS[verb]
    method, function = getattr(PROBLEM, verb), getattr(icp, verb)
    assert inspect.getdoc(method)
    without = lambda *arguments, **options: method(*(x for x in arguments if x is not PROBLEM), **options)  # noqa: E731
    np.testing.assert_array_equal(result(call(without, PROBLEM)), result(call(function, PROBLEM)))


def test_a_scene_brings_its_reference_to_the_race():
    assert icp.race(SCENE, ["mnmgs"], [], **QUICK).measure == "max |z - z*|"


def test_parameters_follow_the_name_of_a_scene():
    assert icp.scenes.scene("membrane,n=100,mu=4").problem.A[0, 0] == icp.scenes.membrane(n=100, mu=4).problem.A[0, 0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("membrane,mu", "'membrane,mu' is not of the form NAME,PARAMETER=NUMBER"),
        ("membrane,n=x", "'membrane,n=x' is not of the form"),
    ],
)
def test_a_text_that_names_no_scene_says_why(text, words):
    with pytest.raises(icp.InputError, match=f"^{words}"):
        icp.scenes.scene(text)


def test_a_name_is_no_problem():
    for verb, (call, _) in VERBS.items():
        with pytest.raises(icp.InputError, match=r"'hand-lcp'.*scene"):
            call(getattr(icp, verb), "hand-lcp")
