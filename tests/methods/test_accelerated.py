"""Anderson acceleration: the formula, the safeguard, units, and that it loses nothing that its method solves."""

from dataclasses import dataclass

import numpy as np
import pytest
import scipy.sparse as sp
from conformance import SCENES

import icpmodel as icp
from icpmodel import scenes
from icpmodel.methods.accelerated import Differences
from icpmodel.methods.contract import FixedPoint


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
    assert solution.status.value == "map failed"


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


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"of": "lemke"}, "lemke cannot be accelerated: its iterates are not those of one map"),
        ({"of": 3}, "of is 3; a Method or the name of one"),
        ({"of": "mnmgz"}, "method is 'mnmgz'"),
        ({"history_size": 0}, "history_size is 0; a whole number >= 1"),
    ],
)
def test_a_wrong_option_is_named(options, words):
    with pytest.raises(icp.InputError, match=words):
        icp.Accelerated(**options)


def test_a_step_of_length_zero_is_not_divided_by():
    problem = icp.ICP(np.eye(2), [0.0, -1.0])
    iterates = path(icp.Accelerated(of="mnmgs", mixing_frequency=1), problem, [0.0, 1.0], 6)
    assert all(z.tolist() == [0.0, 1.0] for z in iterates)
