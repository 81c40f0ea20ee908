"""Anderson acceleration: the formula, the safeguard, units, and that it loses nothing that its method solves."""

from dataclasses import dataclass

import numpy as np
import pytest
import scipy.sparse as sp
from conformance import FAR_THOUGH_SOLVED, HONEST, METHODS, MUST_FAIL, SIZES

import icpmodel as icp
from icpmodel import methods, scenes
from icpmodel.algebra import relaxation as parameters
from icpmodel.methods.accelerated import Differences
from icpmodel.methods.contract import FixedPoint

SCENES = {name: scenes.scene(name, SIZES.get(name)) for name in scenes.names()}
ACCELERABLE = [name for name, method in METHODS.items() if isinstance(method, FixedPoint)]


def newest(history):
    """z and g(z), the last that the history was told."""
    image = history.G[history.newest]
    return image - history.F[history.newest], image.copy()


def combining(combined):
    """The method with another way to make a combination of its history."""

    class Other(Differences):
        def combined(self):
            return combined(self)

    class OtherAccelerated(icp.Accelerated):
        def differences(self, problem):
            return Other(problem, self.history_size)

    return OtherAccelerated


def path(method, problem, z, steps):
    iterates = method.iterates(problem, np.asarray(z, dtype=float))
    return [next(iterates)[0] for _ in range(steps + 1)]


def test_every_step_is_the_least_squares_combination_of_the_last_ones():
    """z⁺ = g(z) − ΔGγ with γ from a dense least-squares solver, weighted by D, on a problem that is far from linear."""
    problem, z = SCENES["membrane"].problem, np.zeros(100)
    problem = icp.ICP(sp.diags_array(np.linspace(1, 9, 100)) @ problem.A, problem.q, problem.psi)
    root = np.sqrt(problem.A.diagonal())
    for every in (1, 2):
        method = icp.Accelerated(of="mnmgs", history_size=3, mixing_frequency=every)
        found = path(method, problem, z, 16)
        step = icp.MNMGS().step_of(problem)
        known = []
        for k in range(16):
            image = step(found[k])[0]
            expected = image
            known.append((image - found[k], image))
            if (k + 1) % every == 0 and k > 0:
                F, G = (np.diff([pair[i] for pair in known[-4:]], axis=0).T for i in (0, 1))
                expected = image - G @ np.linalg.lstsq(root[:, None] * F, root * known[-1][0], rcond=None)[0]
            assert found[k + 1] == pytest.approx(expected, rel=1e-6, abs=1e-9), (every, k)


@pytest.mark.parametrize("distinct", [1, 4])
def test_on_a_linear_map_it_ends_after_as_many_steps_as_there_are_eigenvalues(distinct):
    """No obstacle and MNMJ: I − D⁻¹A has `distinct` eigenvalues, so that GMRES, whose steps these are, ends."""
    rng = np.random.default_rng(distinct)
    values = np.repeat([-0.8, -0.3, 0.4, 0.9][:distinct], 5)
    Q, _ = np.linalg.qr(rng.normal(size=(values.size, values.size)))
    # D = 2I: the diagonal of A is made equal by an orthogonal change of basis that keeps its eigenvalues
    A = Q @ np.diag(1.0 - values) @ Q.T
    problem = icp.ICP(A, rng.normal(size=values.size), -np.inf)
    flat = icp.Modulus(splitting=sp.eye_array(values.size), phi2=1.0)  # z⁺ = z − (Az + q)
    method = icp.Accelerated(of=flat, history_size=distinct, mixing_frequency=1)
    residuals = [problem.residual(z) for z in path(method, problem, np.zeros(values.size), distinct + 2)]
    assert residuals[distinct + 1] <= 1e-9 * residuals[0]
    assert residuals[distinct - 1] > 1e-6 * residuals[0]


@pytest.mark.parametrize(
    "wrong",
    [
        lambda z, image, random: z.copy(),
        lambda z, image, random: image + (1 + np.abs(z)) * random.normal(size=z.size),
        lambda z, image, random: image + 3 * (z - image),
        lambda z, image, random: 1e9 * image,
        lambda z, image, random: np.full(z.size, np.nan),
        lambda z, image, random: np.full(z.size, 1e300),
    ],
)
def test_however_wrong_the_combinations_are_the_plain_sweeps_win(wrong):
    """Nothing gained, noise, overshooting, growth, NaN, overflow: Gauss–Seidel still ends."""
    random = np.random.default_rng(0)
    spoilt = combining(lambda self: wrong(*newest(self), random))
    for every in (1, 3):
        problem = scenes.membrane(n=100).problem
        solution = problem.solve(spoilt(of="mnmgs", mixing_frequency=every), raise_on_failure=False)
        assert solution.solved, solution.message


def test_where_psi_fails_at_an_accelerated_iterate_the_plain_step_is_taken():
    def psi(z):
        if np.abs(z).max() > 100:
            raise ValueError("outside of the domain")
        return 0.1 * np.sin(z)

    problem = icp.ICP([[4.0, -1.0], [-2.0, 4.0]], [-3.0, -2.0], psi)
    spoilt = combining(lambda self: newest(self)[1] + 1e6)
    assert problem.solve(spoilt(of="mnmgs", mixing_frequency=1)).solved
    start = np.array([99.0, 99.0])  # from which the first plain step of this one leaves the domain
    outside = icp.ICP(problem.A, [-3000.0, -2000.0], psi)
    solution = outside.solve(spoilt(of="mnmgs"), z0=start, raise_on_failure=False)
    assert solution.status.value == "psi failed"


def test_differences_that_depend_on_each_other_are_left_out():
    """Gram matrices of any rank and scale: what is left of f is what a least-squares solver leaves."""
    from icpmodel.numerics.kernels.anderson import combine

    rng = np.random.default_rng(0)
    for trial in range(20):
        n, known, rank = 600, 5, int(rng.integers(1, 5))
        dF = rng.normal(size=(known, rank)) @ rng.normal(size=(rank, n))
        if trial % 2:
            dF = rng.normal(size=(known, n))
            dF[1] = dF[0]
        dF *= 10.0 ** rng.integers(-3, 3, (known, 1))
        f, weight, newest, out = rng.normal(size=n), rng.uniform(0.1, 1.0, n), trial % (known + 1), np.empty(n)
        F = np.insert(f - dF, newest, f, axis=0)
        assert combine(F, F, known + 1, newest, weight, 1e-10, out)  # G = F, so that `out` is what is left of f
        root = np.sqrt(weight)
        scaled = dF / np.linalg.norm(dF, axis=1)[:, None]
        expected = f - scaled.T @ np.linalg.lstsq((root * scaled).T, root * f, rcond=1e-5)[0]
        assert out == pytest.approx(expected, abs=1e-5)
        F[trial % (known + 1), -1] = np.nan
        assert not combine(F, F, known + 1, newest, weight, 1e-10, out)


def test_it_needs_fewer_sweeps_than_its_method_and_counts_every_one():
    @dataclass(frozen=True, kw_only=True, eq=False, repr=False)
    class Counting(FixedPoint):
        def step_of(self, problem):
            step = icp.MNMGS().step_of(problem)

            def counted(z):
                calls.append(1)
                return step(z)

            return counted

    problem = scenes.membrane(n=400).problem
    plain = problem.solve("mnmgs").iterations
    for every, spoil in ((1, False), (3, False), (2, True)):
        calls = []
        # rejected iterates count as well
        kind = combining(lambda self: 1e3 + newest(self)[1]) if spoil else icp.Accelerated
        solution = problem.solve(kind(of=Counting(), mixing_frequency=every))
        assert len(calls) == solution.iterations + 1
        assert spoil or solution.iterations < plain / 3


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("of", [*ACCELERABLE, "auto", "default"])
def test_it_solves_every_scene_that_its_method_solves(of, scene):
    method = {"auto": icp.MNMAOR(theta1="auto"), "default": None, **METHODS}[of]
    like = of if of in METHODS else "mnmaor"
    if (like, scene) in MUST_FAIL or SCENES[scene].why_no_solution:
        return
    scene_ = SCENES[scene]
    solution = scene_.problem.solve(icp.Accelerated(of=method), z0=scene_.z0, raise_on_failure=False, max_iter=20_000)
    assert solution.solved or solution.status.value in HONEST.get(scene, ()), solution.message
    if solution.solved and scene_.z_exact is not None and scene not in FAR_THOUGH_SOLVED:
        assert np.abs(solution.z - scene_.z_exact).max() <= 1e-5


def test_units_that_are_powers_of_two_scale_the_iterates_exactly():
    problem = scenes.bearing(n=30).problem
    method, zero, steps = icp.Accelerated(of="mnmgs"), np.zeros(problem.n), 60
    expected = path(method, problem, zero, steps)
    for k in (-60, 300):
        unit = 2.0**k
        of_z = icp.ICP(problem.A, unit * problem.q, unit * problem.psi.c)
        assert np.array_equal(path(method, of_z, zero, steps), unit * np.array(expected))
    # Res adds p and r up, so that the safeguard, though not the combinations, depends on the unit of p
    problem = scenes.bai_symmetric(n=100).problem
    zero, expected = np.zeros(100), path(method, problem, np.zeros(100), 8)
    for k in (-60, -3, 10):
        of_p = icp.ICP(2.0**k * problem.A, 2.0**k * problem.q)
        assert np.array_equal(path(method, of_p, zero, 8), expected)
    s = 2.0 ** np.random.default_rng(0).integers(-3, 4, problem.n)
    both = icp.ICP(sp.diags_array(s) @ problem.A @ sp.diags_array(s), s * problem.q)
    assert np.array_equal(s * np.array(path(method, both, zero, 8)), expected)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"of": "lemke"}, "lemke cannot be accelerated: its iterates are not those of one map"),
        ({"of": 3}, "of is 3; a Method object or one of accelerated, josephy, lemke"),
        ({"of": "mnmgz"}, "method is 'mnmgz'"),
        ({"history_size": 0}, "history_size is 0; a whole number >= 1"),
    ],
)
def test_a_wrong_option_is_named(options, words):
    with pytest.raises(icp.InputError, match=words):
        icp.Accelerated(**options)


def test_it_takes_what_its_method_takes():
    problem = icp.ICP([[0.0, 1.0], [1.0, 2.0]], [1.0, 1.0])
    assert icp.Accelerated(of="psor").why_not(problem) == icp.PSOR().why_not(problem) is not None
    assert icp.Accelerated(of="mnmod").why_not(problem) is None
    assert repr(icp.Accelerated(of="mnmsor", history_size=3)) == "Accelerated(of=MNMSOR(), history_size=3)"
    assert repr(methods.named("accelerated")) == "Accelerated()"
    solution = scenes.hand_lcp().problem.solve("accelerated", of="mnmgs", mixing_frequency=1)
    assert solution.solved
    assert repr(solution.method) == "Accelerated(of=MNMGS(), mixing_frequency=1)"


def test_the_default_keeps_rows_at_a_fixed_obstacle_and_begins_with_jacobi():
    """Diagonal problems take one step; a moving obstacle gets MNMAOR, and a diagonal of A that is not positive none."""
    diagonal = icp.ICP(np.diag([2.0, 4.0]), [-2.0, 4.0])
    assert diagonal.solve("accelerated").iterations == 1
    problem, zero = scenes.membrane(n=100).problem, np.zeros(100)
    first, second = path(icp.Accelerated(), problem, zero, 2)[1:]
    assert (first == path(icp.MNMAOR(theta1="auto"), problem, zero, 2)[1]).all()
    relaxed = icp.PSOR(omega=parameters.relaxation(problem))
    assert (second == path(relaxed, problem, first, 2)[1]).all()
    moving = scenes.scene("manufactured-affine", 100).problem
    same = icp.Accelerated(of=icp.MNMAOR(theta1="auto"))
    for one, other in zip(path(icp.Accelerated(), moving, zero, 9), path(same, moving, zero, 9), strict=True):
        assert (one == other).all()
    assert icp.Accelerated().why_not(icp.ICP([[0.0]], [1.0])) == icp.MNMGS().why_not(icp.ICP([[0.0]], [1.0]))


def test_a_step_of_length_zero_is_not_divided_by():
    problem = icp.ICP(np.eye(2), [0.0, -1.0])
    iterates = path(icp.Accelerated(of="mnmgs", mixing_frequency=1), problem, [0.0, 1.0], 6)
    assert all(z.tolist() == [0.0, 1.0] for z in iterates)
