"""Every method on every scene, and the baselines against independent reference counts."""

import pickle
from dataclasses import dataclass, fields
from itertools import islice

import numpy as np
import pytest
import scipy.sparse as sp
from conformance import FAR_THOUGH_SOLVED, HONEST, METHODS, MUST_FAIL, SIZES
from icpmodel.solve.rules import after_trial, choose

import icpmodel as icp
from icpmodel import methods, scenes
from icpmodel.algebra.relaxation import best_omega
from icpmodel.algebra.steps import Sweep, in_a_row
from icpmodel.methods.lemke import Lemke
from icpmodel.solve.candidate import Candidate, Watch, Watched
from icpmodel.solve.goal import RTOL, Goal
from icpmodel.solve.run import Run

SCENES = {name: scenes.scene(name, SIZES.get(name)) for name in scenes.names()}


def test_every_registered_method_is_in_the_conformance_table():
    assert sorted(METHODS) == methods.names()
    assert all(type(method) is type(methods.named(name)) for name, method in METHODS.items())


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("method", METHODS)
def test_every_method_on_every_scene(method, scene):
    """Solved, certified by the judge and at its reference; or it must fail, and ends as is honest for the scene."""
    scene_, method_ = SCENES[scene], METHODS[method]
    reason = MUST_FAIL.get((method, scene), scene_.why_no_solution)
    if reason is not None and reason.startswith("why_not"):
        assert method_.why_not(scene_.problem) is not None
        with pytest.raises(icp.NotApplicable):
            scene_.problem.solve(method_)
        return
    try:
        solution = scene_.problem.solve(method_, raise_on_failure=False, max_iter=20_000)
    except icp.NotApplicable:
        assert "not applicable" in HONEST[scene]
        assert reason is not None
        return
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
    solution = scene_.problem.solve(z0=scene_.z0, raise_on_failure=False)
    assert solution.solved is (scene_.why_no_solution is None), solution.message
    assert solution.why
    if not solution.solved:
        assert solution.status.value in HONEST[scene]


@pytest.mark.parametrize("method", METHODS)
def test_iterates_start_at_z0_and_are_never_changed_afterwards(method):
    problem = SCENES["hand-affine"].problem
    path = METHODS[method].iterates(problem, np.array([3.0, -2.0]))
    kept = list(islice(path, 5))
    copies = [z.copy() for z, _ in kept]
    list(islice(path, 5))
    assert kept[0][0].tolist() == [3.0, -2.0]
    assert all(np.array_equal(z, copy) for (z, _), copy in zip(kept, copies, strict=True))
    for z, hint in kept:
        assert hint is None or hint == pytest.approx(problem.residual(z), rel=1e-12)


@pytest.mark.parametrize("scene", ["hand-affine", "hand-cyclic", "membrane", "hard-degenerate", "dividend"])
@pytest.mark.parametrize("method", METHODS)
def test_a_path_ends_or_goes_on_with_arrays_of_its_own(method, scene):
    """No iterate is the array of the one before, and the method object is after a run what it was before."""
    problem, method_ = SCENES[scene].problem, METHODS[method]
    if method_.why_not(problem) is not None:
        return
    before, listed = pickle.dumps(method_), repr(method_)
    last = None
    with np.errstate(all="ignore"):
        for z, _ in islice(method_.iterates(problem, np.zeros(problem.n)), 200):
            assert z is not last
            assert z.shape == (problem.n,)
            last = z
    assert last is not None
    solution = problem.solve(method_, raise_on_failure=False, max_iter=50)
    assert solution.method is method_
    assert (pickle.dumps(method_), repr(method_)) == (before, listed)
    with pytest.raises(AttributeError):
        method_.name = "another"


@pytest.mark.parametrize(
    ("scene", "mu", "counts"),
    [
        ("bai-symmetric", 0, [142, 493, 1037]),
        ("bai-symmetric", 4, [36, 39, 40]),
        ("bai-nonsymmetric", 0, [45, 67, 89]),
    ],
)
def test_mms_needs_the_sweeps_of_the_independent_reference(scene, mu, counts):
    """Gauss–Seidel splitting, γ = 2, Ω = D/2, z⁰ = (1, 0, 1, 0, …), Res ≤ 1e-5, m = 10, 20, 30."""
    found = []
    for m in (10, 20, 30):
        bai = scenes.scene(scene, m * m, mu=mu)
        found.append(bai.problem.solve(icp.MMS(), z0=bai.z0, atol=1e-5, rtol=0).iterations)
    assert found == counts


def test_gauss_seidel_sweeps_grow_with_n_for_mu_0_and_not_for_mu_4():
    def sweeps(mu, m):
        bai = scenes.bai_symmetric(n=m * m, mu=mu)
        return bai.problem.solve("mnmgs", z0=bai.z0, atol=1e-5, rtol=0).iterations

    assert sweeps(4, 60) <= sweeps(4, 15) + 3
    assert sweeps(0, 60) >= 2.5 * sweeps(0, 30) >= 5 * sweeps(0, 15)


def test_psor_is_cryer_s_recursion():
    A = np.array([[4.0, -1.0, 0.5], [-2.0, 5.0, -1.0], [0.3, -1.0, 3.0]])
    problem = icp.ICP(A, [-3.0, 2.0, 1.0], [0.1, -0.2, 0.3])
    z = np.array([1.0, -2.0, 0.5])
    path = icp.PSOR(omega=1.3).iterates(problem, z)
    next(path)
    expected = z.copy()
    for i in range(3):
        expected[i] = max(problem.psi.c[i], expected[i] - 1.3 / A[i, i] * (A[i] @ expected + problem.q[i]))
    assert next(path)[0] == pytest.approx(expected, rel=1e-13)


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
        ("mnmxx", {}, "method is 'mnmxx'; one of accelerated, josephy, lemke, mms"),
        (3, {}, "method is 3"),
        ("mnmgs", {"theta1": 1.0}, "mnmgs has no option theta1; it takes phi, phi1, phi2"),
        ("psor", {"omega": 2.0}, "omega is 2.0; a finite number > 0 and < 2 was expected"),
        ("mms", {"inner": 0}, "inner is 0; a whole number >= 1"),
        ("mms", {"inner": True}, "inner is True"),
        ("mnmmod", {"theta1": [1.0, 2.0]}, "theta1 is .1.0, 2.0.; a finite number > 0"),
        ("mnmsor", {"theta1": -1.0}, "theta1 is -1.0"),
        ("mnmgs", {"maxiter": 3}, "mnmgs has no option maxiter; .* solve itself takes z0"),
        ("mms", {"omega": -1.0}, "omega has the entry -1"),
        (None, {"theta1": 1.0}, "solve has no option theta1; it takes z0, rtol"),
        (icp.MNMGS(), {"phi": 1.0}, "go into its constructor"),
    ],
)
def test_a_wrong_method_or_option_is_named(method, options, words):
    with pytest.raises(icp.InputError, match=words):
        icp.ICP([[2.0]], [1.0]).solve(method, **options)


@pytest.mark.parametrize("name", methods.names())
def test_every_option_changes_the_iterates(name):
    """Law 8: an option that changes nothing is a bug."""
    other = {"phi": 0.7, "phi1": 2.0, "phi2": 5.0, "theta1": 1.4, "theta2": 0.3, "omega": 0.8, "inner": 1}
    other |= {"of": "mnmj", "history_size": 1, "mixing_frequency": 1}
    A = np.array([[4.0, -1.0, 0.0], [-2.0, 4.0, -1.0], [0.0, -1.0, 3.0]])
    problem = icp.ICP(A, [-3.0, 2.0, -1.0], icp.Affine(0.2 * np.ones((3, 3)), [0.3, -0.1, 0.2]))
    z = np.array([1.0, -2.0, 0.5])

    def after(method, steps=4):
        path = method.iterates(problem, z)
        return [next(path)[0] for _ in range(steps + 1)][-1]

    plain = methods.named(name)
    for option in fields(plain):
        # phi1 acts through phi2/phi1, and the window where it is full
        base = {"phi1": {"phi2": 2.0}, "history_size": {"mixing_frequency": 1}}.get(option.name, {})
        value = "jacobi" if option.name == "splitting" else other[option.name]
        changed = methods.named(name, **base, **{option.name: value})
        assert not np.allclose(after(changed), after(methods.named(name, **base)), rtol=1e-10), option.name


@pytest.mark.parametrize("name", ["phi1", "phi2"])
def test_a_diagonal_of_zero_is_refused(name):
    with pytest.raises(icp.InputError, match="positive"):
        icp.MNMGS(**{name: 0.0})


def test_theta1_comes_from_both_norms():
    problem = icp.ICP([[0.0, 100.0], [-100.0, 1.0]], [-1.0, 1.0])
    inverse = np.abs(np.linalg.solve(problem.A.toarray(), np.ones(2))).max()
    method = next(one.method for one in choose(problem, RTOL) if one.method.name == "mnmmod")
    assert method.theta1 == pytest.approx(np.sqrt(101.0 / inverse))


def ring(n):
    """The identity, with one entry far off the diagonal."""
    A = np.eye(n)
    A[0, -1] = -0.5
    return A


def first_choice(problem, skip=()):
    """The method and the reason of the first candidate that is none of those to `skip`."""
    candidate = next(c for c in choose(problem, RTOL) if type(c.method) not in skip)
    return type(candidate.method), candidate.why


def second_choice(problem):
    """What comes where the first plain sweeps are slow."""
    candidate = next(after_trial(problem, RTOL))
    return type(candidate.method), candidate.why


def test_newton_is_chosen_first_where_sweeps_are_slow_and_its_steps_are_cheap():
    rng = np.random.default_rng(0)
    B = rng.normal(size=(80, 80))
    for problem, words in [
        (scenes.dividend(n=61).problem, "policy iteration"),
        (icp.ICP(B.T @ B + np.eye(80), rng.normal(size=80), icp.Elementwise(np.sin, np.cos)), "Jacobi radius below 1"),
        (icp.ICP([[0.0, 1.0], [-1.0, 0.0]], [-1.0, 1.0], icp.Elementwise(np.sin, np.cos)), "no positive diagonal"),
    ]:
        method, why = first_choice(problem, skip=[icp.Josephy, icp.PSOR])
        assert method is icp.Newton
        assert words in why


def test_for_impulse_control_the_coarser_levels_come_first_where_the_problem_is_large_and_second_else():
    for n, first, second in ((481, icp.Newton, icp.Multilevel), (511, icp.Multilevel, icp.Newton)):
        choices = [type(choice.method) for choice in choose(scenes.dividend(n=n).problem, RTOL)]
        assert choices[:2] == [first, second]


def test_multilevel_is_chosen_first_where_most_rows_of_a_large_matrix_are_hardly_dominant():
    for problem in (
        scenes.membrane(n=130**2).problem,
        scenes.bearing(n=400).problem,
        scenes.membrane(n=80**2).problem.with_psi(icp.Elementwise(np.sin, lipschitz=0.9)),
    ):
        assert first_choice(problem, skip=[icp.Tridiagonal])[0] is icp.PSOR
        method, why = second_choice(problem)
        assert method is icp.Multilevel
        assert "of the rows are hardly dominant" in why


def test_multilevel_is_left_out_where_it_cannot_do_or_sweeps_are_quick():
    large = scenes.membrane(n=80**2).problem
    for problem in (
        large.with_psi(np.sin),  # no derivative, and not known to move row by row
        scenes.membrane(n=80**2, mu=4.0).problem,
        icp.ICP(sp.block_diag([scenes.membrane(n=80**2, mu=4.0).problem.A, large.A[:320, :320]]), np.ones(80**2 + 320)),
        scenes.membrane(n=60**2).problem,
        scenes.membrane(n=80**2, skew=0.5).problem,  # what flows through it does so in one direction
        scenes.hard_skew(n=80**2).problem,  # far from every matrix that multigrid is made for
    ):
        assert second_choice(problem)[0] is not icp.Multilevel


def test_plain_sweeps_come_first_for_every_positive_diagonal_unless_psi_jumps_or_pivots_are_quicker():
    moving = icp.Elementwise(np.sin, np.cos)
    for problem in (
        scenes.bai_symmetric(n=100).problem,
        scenes.membrane(n=2500).problem,
        icp.ICP([[1.0, -2.0], [-2.0, 3.0]], [-1.0, 1.0], np.sin),
    ):
        assert first_choice(problem)[0] is icp.PSOR
    assert first_choice(icp.ICP([[1.0, 2.0], [2.0, -3.0]], [-1.0, 1.0], moving))[0] is icp.Josephy
    assert first_choice(scenes.dividend(n=61).problem)[0] is icp.Josephy
    assert first_choice(scenes.dividend(n=211).problem)[0] is icp.Newton


def test_where_plain_sweeps_are_slow_relaxed_ones_follow_psor_where_no_psi_depends_on_another_unknown():
    large = scenes.membrane(n=2500).problem
    neighbour = icp.Affine(sp.diags_array(np.full(large.n - 1, 0.1), offsets=1), 0.0)
    for psi, expected in [
        (large.psi, icp.PSOR),
        (icp.Affine(0.1 * sp.eye_array(large.n)), icp.PSOR),
        (icp.Elementwise(np.sin, np.cos, lipschitz=0.9), icp.PSOR),
        (neighbour, icp.MNMAOR),
    ]:
        method, why = second_choice(large.with_psi(psi))
        assert method is expected
        assert "relaxed for the estimated Jacobi radius 0.99" in why


def test_sweeps_stay_where_they_are_quick_and_say_why_they_give_way():
    quick = scenes.membrane(n=80**2, mu=4.0).problem.solve()
    assert quick.method.name == "psor"
    assert quick.why == "plain sweeps are watched: they stay as long as they are quick"
    slow = scenes.membrane(n=130**2).problem.solve()
    assert slow.method.name == "multilevel"
    assert "hardly dominant: sweeps would be slow (plain sweeps were slow)" in slow.why
    assert "PSOR(): gave way" in slow.why
    # most rows are hardly dominant, but few of them are in balance
    scattered = scenes.manufactured_elementwise(n=80**2, mu=0.0).problem
    assert scattered.solve().method.name == "psor"
    # relaxed ones take over from the best iterate, the coarser levels from the start
    relaxed = scenes.membrane(n=80**2, skew=0.5).problem.solve(history=True)
    assert relaxed.method.omega > 1.2
    by_step = dict(zip(relaxed.history.iteration, relaxed.history.residual, strict=True))
    assert by_step[10] < 0.9 * by_step[0]
    seen = []
    scenes.membrane(n=130**2).problem.solve(callback=lambda state: seen.append(state.residual))
    assert seen.count(seen[0]) == 2


def run_of(problem, *candidates, start=None, aim=RTOL):
    """A run of these candidates to `aim` times Res(0), begun but not made."""
    start = np.zeros(problem.n) if start is None else start
    scale = problem.residual(np.zeros(problem.n))
    run = Run(problem, start, problem.residual(start), Goal(aim * scale), aim=aim, scale=scale)
    return run, run.steps(iter(candidates))


def finder(problem, *candidates, start=None):
    """The name of the method that finds the answer."""
    run, steps = run_of(problem, *candidates, start=start)
    with np.errstate(all="ignore"):
        list(steps)
    assert run.ended.status is icp.Status.SOLVED
    return run.best.candidate.method.name


def watched(most, *, look=10, method=None, name="sweeps"):
    return Candidate(method or icp.PSOR(), "", None, Watch(most, name, look))


NEXT = Candidate(icp.Newton(), "because")


def test_relaxed_sweeps_that_break_their_promise_give_way_to_coarser_levels():
    """n = 80² takes some 170 of them with a fair estimate of the Jacobi radius, and with one of 0.95 a thousand."""
    problem = scenes.membrane(n=80**2).problem
    fair = problem.solve()
    assert fair.why.startswith("relaxed for the estimated Jacobi radius 0.9987 (plain sweeps were slow)")
    assert fair.iterations < 250
    omega = best_omega(0.95)
    promised = np.log(RTOL) / np.log(omega - 1.0)
    low = watched(1.5 * promised, look=int(np.ceil(promised)), method=icp.PSOR(omega=omega), name="relaxed sweeps")
    run, steps = run_of(problem, low, Candidate(icp.Multilevel(), "coarser levels"))
    list(steps)
    assert run.best.candidate.why == "coarser levels (relaxed sweeps were slow)"
    assert run.iteration < 100


def test_a_candidate_gives_way_by_the_observed_rate_alone():
    """Contraction by 1/2 in a sweep: 8 digits need 27 sweeps, of which 17 are left after the first 10."""
    a = np.sqrt(0.5)
    problem = icp.ICP([[1.0, -a], [-a, 1.0]], [-1.0, -1.0])
    assert finder(problem, watched(19), NEXT) == "psor"
    assert finder(problem, watched(15), NEXT) == "newton"
    # where nothing else is left they go on
    assert finder(problem, watched(15)) == "psor"
    # and sweeps that diverge are not quick
    rising = icp.ICP([[1.0, -2.0], [-2.0, 1.0]], [-1.0, -1.0], -np.inf)
    run, steps = run_of(rising, watched(1e9), NEXT)
    list(steps)
    assert run.tried[0][1] == "gave way"
    assert run.tried[1][1] == "solved"


def test_a_rather_candidate_goes_on_where_the_watched_one_is_neither_slow_nor_quick():
    """Some 17 more sweeps are needed at the first look: less than 25, and more than 5."""
    a = np.sqrt(0.5)
    problem = icp.ICP([[1.0, -a], [-a, 1.0]], [-1.0, -1.0])
    for most, looks, expected in ((5, 1, "newton"), (22, 1, "psor"), (5, 3, "psor")):
        watch = Watch(25, "sweeps", rather=(Candidate(icp.Newton(), "rather", goes_on=True), most, looks))
        run, steps = run_of(problem, Candidate(icp.PSOR(), "", None, watch))
        list(steps)
        assert run.best.candidate.method.name == expected
        if expected == "newton":
            assert run.best.candidate.why == "rather (more than 5 more sweeps would be needed)"
            assert run.iteration == 11


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Counted(icp.PSOR):
    """PSOR that counts its sweeps in `made`, without a name of its own."""

    made: list

    def step_of(self, problem):
        step = super().step_of(problem)

        def counted(sweeps, answers):
            self.made.append(len(answers))
            return sweeps

        def several(z, count):
            answers = in_a_row(step, z, count)
            return counted(answers, answers)

        return Sweep(lambda z: counted(step(z), [z]), several)


@pytest.mark.parametrize("n", [400, 70**2])
def test_no_sweep_is_made_to_judge_what_promises_to_be_the_last_iterate(n):
    """By the rate of the last sweeps: as many are made as there are iterates, and more of them are the same ones."""
    problem, made = scenes.membrane(n=n, mu=4.0).problem, []
    solution = problem.solve(Counted(made=made))
    assert methods.names().count("psor") == 1
    assert type(methods.named("psor")) is icp.PSOR
    assert sum(made) <= solution.iterations + 1
    assert len(made) < solution.iterations  # several at once
    path = icp.PSOR().iterates(problem, np.zeros(problem.n))
    forecast, seen = Watched(None, RTOL * problem.residual_at_0()), [next(path)]
    while len(seen) < solution.iterations + 9:
        z, hint = seen[-1]
        seen.append(path.send(forecast.expected(problem.residual(z) if hint is None else hint)))
    assert [k for k, (_, hint) in enumerate(seen) if hint is None] == [solution.iterations]
    for (z, hint), (plain, residual) in zip(seen, icp.PSOR().iterates(problem, np.zeros(problem.n)), strict=False):
        assert z == pytest.approx(plain, rel=1e-12, abs=1e-12)
        assert hint is None or hint == pytest.approx(residual, rel=1e-6)


def test_sweeps_that_are_far_too_slow_are_given_up_before_the_first_look():
    """Contraction by .98 in a sweep: some 900 are needed, more than four times 200 and less than four times 300."""
    problem = icp.ICP([[1.0, -0.99], [-0.99, 1.0]], [-1.0, -1.0])
    for worth, made in ((200.0, 4), (300.0, 11)):
        run, steps = run_of(problem, watched(worth), NEXT)
        for _ in steps:
            if len(run.tried) > 1:
                break
        assert run.iteration == made - 1


def test_a_warm_start_survives_the_trial():
    problem = scenes.membrane(n=80**2).problem
    cold = problem.solve()
    warm = problem.with_q(problem.q * 1.0001).solve(z0=cold.z)
    assert warm.iterations < cold.iterations + 1


def test_sweeps_from_a_start_near_the_answer_have_less_to_do():
    """It takes some sixty sweeps from Res(0) to 1e-8 of it, and a third of them from a start with 1e-5 of it."""
    problem = scenes.membrane(n=400, mu=0.1).problem
    near = problem.solve().z
    near = near + 1e-5 * problem.residual(np.zeros(400)) / problem.residual(near + 1.0)
    cold, warm = (problem.solve("psor", z0=z, rtol=1e-8).iterations for z in (np.zeros(400), near))
    assert 2 * warm < cold
    assert [finder(problem, watched(1.5 * warm), NEXT, start=z) for z in (np.zeros(400), near)] == ["newton", "psor"]


def test_newton_follows_on_sweeps_that_fail():
    chosen = [choice.method.name for choice in choose(scenes.hand_cyclic().problem, RTOL)]
    assert chosen == ["lemke", "psor", "newton", "mnmgs", "mnmj", "mnmmod", "mnmmod", "mnmmod"]


def test_a_derivative_that_fails_does_not_end_the_automatic_choice():
    """sqrt has none at the start, where Newton stops; MNMMOD needs none."""
    psi = icp.Elementwise(lambda z: 0.1 * np.sqrt(np.abs(z)), lambda z: np.full(z.shape, np.nan))
    problem = icp.ICP([[0.0, 1.0], [-1.0, 2.0]], [-1.0, 1.0], psi)
    solution = problem.solve()
    assert isinstance(solution.method, icp.MNMMOD)
    assert "Newton(): psi failed" in solution.why


def test_small_problems_are_pivoted_first_larger_ones_after_sweeps_and_still_larger_ones_after_newton():
    for psi in (0.0, icp.Affine(0.1 * sp.eye_array(32)), icp.Elementwise(np.sin, lipschitz=0.9)):
        assert first_choice(icp.ICP(ring(32), -np.ones(32), psi))[0] is Lemke
    full = icp.ICP(ring(64) + 0.001, -np.ones(64))
    for problem in (full, scenes.membrane(n=36).problem, scenes.bai_symmetric(n=64, mu=0.0).problem):
        assert first_choice(problem)[0] is Lemke
    for problem in (
        icp.ICP(ring(33), -np.ones(33)),
        scenes.membrane(n=64, mu=4.0).problem,
        scenes.hard_singular(n=36).problem,
    ):
        assert first_choice(problem)[0] is icp.PSOR
        assert second_choice(problem)[0] is Lemke
    assert first_choice(icp.ICP(ring(64), -np.ones(64), icp.Elementwise(np.sin, np.cos)))[0] is icp.Josephy
    coupled = icp.ICP(ring(64), -np.ones(64), icp.Function(np.sin, lambda z: np.diag(np.cos(z))))
    assert first_choice(coupled)[0] is icp.PSOR
    assert second_choice(coupled)[0] is icp.Josephy
    assert second_choice(icp.ICP(ring(65), -np.ones(65), icp.Elementwise(np.sin, np.cos)))[0] is not icp.Josephy
    assert first_choice(icp.ICP(ring(65), -np.ones(65)))[0] is icp.PSOR
    for psi in (0.0, icp.Elementwise(np.sin, lipschitz=0.9)):
        assert second_choice(icp.ICP(ring(200), -np.ones(200), psi))[0] is Lemke
    names = [choice.method.name for choice in choose(icp.ICP(np.eye(201), -np.ones(201)), RTOL)]
    assert names.index("lemke") == names.index("newton") + 1
    for n in (64, 65, 200, 201):
        assert [c.method.name for c in choose(icp.ICP(np.eye(n), -np.ones(n)), RTOL)].count("lemke") == 1
    assert "lemke" not in [choice.method.name for choice in choose(icp.ICP(sp.eye(501), -np.ones(501)), RTOL)]
