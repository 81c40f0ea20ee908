"""Every method on a covering set of the scenes, on all of them where slow tests run, and independent references."""

import pickle
from dataclasses import fields
from itertools import islice

import numpy as np
import pytest
from conformance import BY_LUCK, FAR_THOUGH_SOLVED, HONEST, METHODS, MUST_FAIL, NONLINEAR, SCENES
from known_answers import attempt

import icpmodel as icp
from icpmodel import methods


def test_every_registered_method_is_in_the_conformance_table():
    assert sorted(METHODS) == methods.names()
    assert all(type(method) is type(methods.named(name)) for name, method in METHODS.items())


def covering(methods, scenes, every=6):
    """All pairs, those marked slow but for one in six, so that each method and each scene is there several times."""
    for i, method in enumerate(methods):
        for k, scene in enumerate(scenes):
            yield pytest.param(method, scene, marks=() if (i + k) % every == 0 else pytest.mark.slow)


@pytest.mark.parametrize(("method", "scene"), [*covering(METHODS, SCENES)])
def test_on_every_scene_each_method_solves_or_fails_honestly(method, scene):
    """Solved, certified by the judge and at its reference; or it must fail, and ends as is honest for the scene."""
    scene_, method_ = SCENES[scene], METHODS[method]
    reason = MUST_FAIL.get((method, scene), scene_.why_no_solution)
    if reason is not None and reason.startswith("why_not"):
        assert method_.why_not(scene_.problem) is not None
        with pytest.raises(icp.NotApplicable):
            scene_.problem.solve(method_)
        return
    try:
        start = scene_.z0 if scene in NONLINEAR else None
        solution = attempt(scene_.problem, method_, z0=start, max_iter=20_000)
    except icp.NotApplicable:
        assert "not applicable" in HONEST[scene]
        assert reason is not None
        return
    if not solution.solved:
        reason = reason or BY_LUCK.get((method, scene))
    assert solution.solved is (reason is None), solution.message
    assert solution.residual == scene_.problem.residual(solution.z)
    if reason is not None:
        assert solution.residual > solution.tolerance
        assert solution.status.advice
        assert solution.status.value in HONEST.get(scene, {solution.status.value})
        return
    assert solution.residual <= solution.tolerance
    if scene_.z_exact is not None:
        error = np.abs(solution.z - scene_.z_exact).max()
        assert error <= 1e-5 or scene in FAR_THOUGH_SOLVED
        if solution.error_bound is not None:
            assert error <= solution.error_bound


@pytest.mark.parametrize("scene", SCENES)
def test_the_automatic_choice_solves_every_scene_that_has_a_solution_and_says_why(scene):
    scene_ = SCENES[scene]
    solution = attempt(scene_.problem, z0=scene_.z0)
    assert solution.solved is (scene_.why_no_solution is None), solution.message
    assert solution.why
    if not solution.solved:
        assert solution.status.value in HONEST[scene]


@pytest.mark.parametrize("problem", [SCENES["hand-affine"].problem, icp.scenes.membrane(n=100).problem])
@pytest.mark.parametrize("method", METHODS)
def test_a_path_ends_or_goes_on_with_arrays_of_its_own(method, problem):
    """No iterate is the array of the one before, and the method object is after a run what it was before."""
    method_ = METHODS[method]
    if method_.why_not(problem) is not None:
        return
    before, listed = pickle.dumps(method_), repr(method_)
    last = kept = None
    with np.errstate(all="ignore"):
        for z, _ in islice(method_.iterates(problem, np.zeros(problem.n)), 40):
            assert z is not last
            assert last is None or last.tobytes() == kept
            last, kept = z, z.tobytes()
    assert last is not None
    solution = attempt(problem, method_, max_iter=50)
    assert solution.method is method_
    assert (pickle.dumps(method_), repr(method_)) == (before, listed)
    with pytest.raises(AttributeError):
        method_.name = "another"


def test_mms_is_the_recursion_of_hong_and_li():
    """(Ω + M)x⁺ = Nx + (Ω − A)|x| − γ(Aψ(z) + q), ψ renewed every `inner` steps; γ has no influence on z."""
    A = np.array([[4.0, -1.0], [-2.0, 4.0]])
    problem = icp.ICP(A, [-3.0, 2.0], icp.Affine([[0.0, 0.3], [0.2, 0.0]], 0.1))
    gamma, Omega, z = 1.5, np.diag([3.0, 2.0]), np.array([0.5, -1.0])
    path = icp.MMS(omega=np.diag(Omega), inner=2).iterates(problem, z)
    next(path)
    M, psi = np.tril(A), problem.psi.value(z)
    x = gamma / 2 * (z - psi)
    for k in range(6):
        if k and k % 2 == 0:
            psi = problem.psi.value(z)
        right = (M - A) @ x + (Omega - A) @ np.abs(x) - gamma * (A @ psi + problem.q)
        x = np.linalg.solve(Omega + M, right)
        z = psi + (np.abs(x) + x) / gamma
        assert next(path)[0] == pytest.approx(z, rel=1e-12)


@pytest.mark.parametrize(
    ("method", "options", "words"),
    [
        ("mnmxx", {}, "method is 'mnmxx'; did you mean mnmj"),
        ("mnmgs", {"theta1": 1.0}, "mnmgs has no option theta1; it takes phi, phi1, phi2"),
        ("psor", {"omega": 2.0}, "omega is 2.0; a finite number > 0 and < 2 was expected"),
        ("mnmgs", {"phi1": 0.0}, "positive"),
        (None, {"theta1": 1.0}, "solve has no option theta1; it takes z0, rtol"),
        (icp.MNMGS(), {"phi": 1.0}, "solve has no option phi; .* into the constructor of a Method"),
        (icp.MNMGS(), {"max_iterations": 9}, "did you mean max_iter"),
    ],
)
def test_a_wrong_method_or_option_is_named(method, options, words):
    with pytest.raises(icp.InputError, match=words):
        icp.ICP([[2.0]], [1.0]).solve(method, **options)


@pytest.mark.parametrize("name", methods.names())
def test_every_option_changes_the_iterates(name):
    """Law 8: an option that changes nothing is a bug."""
    other = {"phi": 0.7, "phi1": 2.0, "phi2": 5.0, "theta1": 1.4, "theta2": 0.3, "omega": 0.8, "inner": 1}
    other |= {
        "of": "mnmj",
        "history_size": 1,
        "mixing_frequency": 1,
        "tries": 1,
        "seed": 1,
        "inner_family": "paper",
        "restarts": 1,
    }
    A = np.array([[4.0, -1.0, 0.0], [-2.0, 4.0, -1.0], [0.0, -1.0, 3.0]])
    problem = icp.ICP(A, [-3.0, 2.0, -1.0], icp.Affine(0.2 * np.ones((3, 3)), [0.3, -0.1, 0.2]))
    if name == "restarts":  # a game with several equilibria; the path of the first try ends in a ray
        payoffs = 1 + np.eye(3)
        problem = icp.ICP(np.kron([[0, 1], [0, 0]], payoffs) + np.kron([[0, 0], [1, 0]], payoffs[::-1]), -np.ones(6))
    if name == "newton-josephy":  # of nonlinear p alone
        problem = icp.ICP(problem.A, problem.q, problem.psi, f=icp.Elementwise(np.exp, np.exp))
    z = np.resize([1.0, -2.0, 0.5], problem.n)

    hopeless = icp.ICP.nonlinear(lambda z: -(z**2) - 1.0, n=3)
    steps = {"restarts": 100, "newton-josephy": 2, "interior": 2}.get(name, 4)

    def after(method):
        # other starts come where there is no solution, after the last step
        at, count = (hopeless, 400) if option.name == "restarts" else (problem, steps)
        *_, (last, _) = islice(method.iterates(at, z), count + 1)
        return last

    plain = methods.named(name)
    for option in fields(plain):
        # phi1 acts through phi2/phi1, and the window where it is full
        base = {"phi1": {"phi2": 2.0}, "history_size": {"mixing_frequency": 1}}.get(option.name, {})
        value = "jacobi" if option.name == "splitting" else other[option.name]
        changed = methods.named(name, **base, **{option.name: value})
        assert not np.allclose(after(changed), after(methods.named(name, **base)), rtol=1e-10), option.name


def test_a_derivative_that_fails_does_not_end_the_automatic_choice():
    """sqrt has none at the start, where Newton stops; MNMMOD needs none."""
    psi = icp.Elementwise(lambda z: 0.1 * np.sqrt(np.abs(z)), lambda z: np.full(z.shape, np.nan))
    problem = icp.ICP([[0.0, 1.0], [-1.0, 2.0]], [-1.0, 1.0], psi)
    assert problem.solve().solved
