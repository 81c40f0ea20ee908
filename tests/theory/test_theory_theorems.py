"""The a-priori theorems as checks: true where they say yes, right by name on the counterexamples, rounding included."""

import itertools

import numpy as np
import pytest
from known_answers import affine, around

import icpmodel as icp
from icpmodel.theory.convergence.rates import Rate, predicted_rate
from icpmodel.theory.convergence.theorems import check, check_all, holding, theorems

BY_NORM = ("4.3", "4.4", "4.2", "4.1", "sharper")


def random_member(rng, A):
    """Any member of the family, with options of every sign that it takes."""
    n, d = A.shape[0], np.abs(np.diag(A))
    phi = rng.choice([0, 1, 1]) * rng.normal(size=n) * rng.choice([0.1, 1, 3]) * d
    phi = np.abs(phi) if rng.random() < 0.3 else phi
    phi1 = 10.0 ** rng.uniform(-1, 1, n)
    phi2 = phi1 * d * (1.0 if rng.random() < 0.3 else 10.0 ** rng.uniform(-0.5, 0.7, n))
    theta1 = rng.choice([1.0, rng.uniform(0.3, 1.6)])
    theta2 = rng.choice([theta1, rng.uniform(-1, 2.2), 1.0, 0.0])
    free = {"phi": phi, "phi1": phi1, "phi2": phi2}
    M1 = A * (rng.random((n, n)) < 0.6) + np.diag(rng.normal(size=n) * 0.2 + np.diag(A))
    makers = (
        lambda: icp.MNMOD(phi=phi),
        lambda: icp.MNMMOD(phi=phi, theta1=10.0 ** rng.uniform(-1, 1)),
        lambda: icp.MNMAOR(theta1=theta1, theta2=theta2, **free),
        lambda: icp.MNMSOR(theta1=theta1, **free),
        lambda: icp.MNMJ(**free),
        lambda: icp.NMMS(splitting=icp.AOR(theta1, theta2), omega=phi2 / phi1),
        lambda: icp.Modulus(splitting=M1, **free),
        lambda: icp.Modulus(splitting="whole", **free),
        lambda: icp.ProjectionFixedPoint(omega=rng.uniform(0.3, 1.5)),
    )
    return makers[rng.integers(len(makers))]()


def random_case(seed):
    """(problem, z*, member, A, Γ), ψ(z) = Γz + c with Γ of any sign, n ≤ 4; many at the border of the theorems."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))
    off = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.7)
    np.fill_diagonal(off, 0.0)
    off = -np.abs(off) if rng.random() < 0.4 else off
    d = np.abs(off).sum(axis=1) * rng.uniform(0.8, 3) + rng.uniform(0.05, 1, n)
    d = d * rng.choice([-1, 1], n) if rng.random() < 0.08 else d
    A = off + np.diag(d)
    slope = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.6) * rng.choice([0, 0.1, 0.3, 0.6]) / n
    if rng.random() < 0.6:
        rows, columns = 10.0 ** rng.uniform(-2, 2, n), 10.0 ** rng.uniform(-2, 2, n)
        A, slope = rows[:, None] * A * columns, slope * columns / columns[:, None]
    z = rng.normal(size=n)
    return around(rng, A, z, affine(slope), np.abs(np.diag(A))), z, random_member(rng, A), A, slope


def matrices(problem, member):
    """(M̂, Ω, X), dense."""
    omega = member.omega_of(problem)
    M = member.splitting_of().matrix(problem.A).toarray() + np.diag(np.broadcast_to(member.phi, problem.n))
    return M, omega, M + np.diag(omega)


def worst_error_matrix(problem, member, A, slope, rng):
    """The largest ρ(I − 2X⁻¹(ΘA + (I − Θ)Ω(I − Γ))) over the corners Θ and some more, and some |Γ| ≤ G."""
    (_, omega, X), n = matrices(problem, member), problem.n
    inverse = np.linalg.inv(X)
    thetas = [np.array(corner, dtype=float) for corner in itertools.product([0, 1], repeat=n)]
    thetas += [rng.random(n) for _ in range(5)]
    stack = [
        np.eye(n) - 2 * inverse @ (t[:, None] * A + ((1 - t) * omega)[:, None] * (np.eye(n) - g))
        for t in thetas
        for g in (slope, -slope, np.abs(slope) * np.sign(rng.normal(size=(n, n))))
    ]
    return np.abs(np.linalg.eigvals(np.array(stack))).max()


def spectral_radius(M):
    return np.abs(np.linalg.eigvals(M)).max()


class TestEveryTheoremIsTrue:
    @pytest.mark.parametrize("block", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 8))])
    def test_where_one_holds_every_error_matrix_contracts_and_the_iterates_obey_the_rate(self, block):
        counted = dict.fromkeys(theorems(), 0)
        del counted["rowwise"]  # of the other degree of implicitness: test_theory_rowwise.py
        for seed in range(150 * block, 150 * (block + 1)):
            problem, exact, member, A, slope = random_case(seed)
            found = check_all(problem, member)
            for name in counted:
                counted[name] += found[name].holds is True
            # what the proofs say of one another
            for stronger, weaker in (("4.3", "4.2"), ("4.2", "4.1"), ("4.4", "4.1"), ("4.1", "sharper")):
                assert not found[stronger].holds or found[weaker].holds, (seed, stronger)
            if not any(found[name].holds for name in (*BY_NORM, "definite")):
                continue
            rng = np.random.default_rng(seed)
            assert worst_error_matrix(problem, member, A, slope, rng) < 1 + 1e-9, (seed, member)
            if not found["sharper"].holds:
                continue
            path = member.iterates(problem, exact + rng.normal(size=problem.n) * 10.0 ** rng.uniform(-2, 2))
            iterates = np.array([next(path)[0] for _ in range(25)])
            for name in BY_NORM:
                if found[name].holds:
                    v = found[name].vector
                    size = (np.abs(iterates - exact) / v).max(axis=1)
                    rounding = 1e-12 * (size[0] + ((1 + np.abs(exact)) / v).max())
                    assert (size[1:] <= size[:-1] + rounding).all(), (seed, name)
                    if name == "sharper":
                        assert (size[1:] <= found[name].number * size[:-1] + rounding).all(), seed
        assert min(counted.values()) >= 2, counted

    def test_those_that_hold_are_the_same_where_their_numbers_are_not_asked_for(self):
        of_the_paper = ("4.1", "4.2", "4.3", "4.4")
        for seed in range(7000, 7025):
            problem, _, member, *_ = random_case(seed)
            corrected = {name for name, found in check_all(problem, member).items() if found.holds}
            printed = {name for name in of_the_paper if check(name, problem, member, as_printed=True).holds}
            assert holding(problem, member, theorems(), of_the_paper) == (corrected, printed), seed

    def test_the_radius_is_right_on_both_sides(self):
        """ρ(L) of Theorem 4.1 from eigenvalues: the answer is never wrong, the number never below, and close."""
        decided = 0
        for seed in range(5000, 5080):
            problem, _, member, A, slope = random_case(seed)
            M, omega, X = matrices(problem, member)
            if not (omega > 0).all() or np.linalg.cond(X) > 1e10:
                continue
            F = np.abs(M - A) + np.abs(A - np.diag(omega)) + 2 * omega[:, None] * np.abs(slope)
            rho = spectral_radius(np.abs(np.linalg.inv(X)) @ F)
            found = check("4.1", problem, member)
            if abs(rho - 1) > 1e-6:
                assert found.holds is bool(rho < 1), (seed, rho)
                decided += 1
            assert found.number >= rho * (1 - 1e-9)
            assert found.number <= rho + 0.05 * max(abs(1 - rho), 0.2 * rho)
        assert decided >= 60


#: problems with which every hypothesis holds, but for what is said
ONE, TWO = icp.ICP([[1.0]], [0.0]), icp.ICP([[2.0, 1.0], [1.0, 2.0]], [0.0, 0.0])


@pytest.mark.parametrize(
    ("theorem", "problem", "member", "holds"),
    [
        ("monotone", icp.ICP([[1.0, 0.5], [0.0, 1.0]], [0.0, 0.0]), icp.MNMJ(), False),
        ("monotone", icp.ICP([[1.0, 0.0], [-0.5, 1.0]], [0.0, 0.0]), icp.MNMGS(), False),
        ("monotone", ONE.with_psi(icp.Affine([[-0.1]])), icp.MNMJ(), False),
        ("monotone", ONE.with_psi(np.sin), icp.MNMJ(), None),
        ("monotone", ONE, icp.MNMJ(phi2=1.5), False),
        ("monotone", ONE, icp.ProjectionFixedPoint(omega=1.2), False),
        ("monotone", ONE, icp.ProjectionFixedPoint(omega=0.8), True),
        ("definite", icp.ICP([[1.0, 3.0], [0.0, 1.0]], [0.0, 0.0]), icp.MNMOD(), False),
        ("definite", icp.ICP([[1.0, 1.0], [-1.0, 1.0]], [0.0, 0.0]), icp.MNMOD(), True),
        ("definite", icp.ICP([[1.0, 1.0], [1.0, 1.0]], [0.0, 0.0]), icp.MNMOD(), False),
        ("definite", TWO.with_psi(icp.Affine([[0.0, 0.1], [0.0, 0.0]])), icp.MNMOD(), False),
        ("definite", TWO.with_upper(lambda z: z + 9.0), icp.MNMOD(), False),
        ("definite", TWO, icp.MNMOD(phi=0.1), False),
        ("definite", TWO, icp.MNMGS(), False),
    ],
)
def test_each_hypothesis_is_asked_for(theorem, problem, member, holds):
    assert check(theorem, problem, member).holds is holds


class TestRounding:
    @pytest.mark.parametrize("n", [2, 5, 400])
    def test_a_radius_of_exactly_one_is_never_called_less(self, n):
        """The periodic chain 2z_i − z_{i−1} − z_{i+1}: ρ(D⁻¹|B|) = 1."""
        ring = 2 * np.eye(n) - np.roll(np.eye(n), 1, 0) - np.roll(np.eye(n), -1, 0)
        for member in (icp.MNMJ(), icp.MNMGS()):
            assert not any(
                found.holds
                for name, found in check_all(icp.ICP(ring, np.zeros(n)), member).items()
                if name != "monotone"
            )

    def test_the_answers_do_not_depend_on_the_units(self):
        """Rows times 10^±100, columns times 10^±100: the triangular members keep every answer."""
        for seed in range(12):
            problem, _, _, A, slope = random_case(seed)
            n, rng = problem.n, np.random.default_rng(seed)
            if not (np.diag(A) > 0).all():
                continue
            rows, columns = 10.0 ** rng.uniform(-100, 100, n), 10.0 ** rng.uniform(-100, 100, n)
            scaled = icp.ICP(
                rows[:, None] * A * columns, np.zeros(n), icp.Affine(slope * columns / columns[:, None], np.zeros(n))
            )
            plain = icp.ICP(A, np.zeros(n), icp.Affine(slope, np.zeros(n)))
            for member in (icp.MNMJ(), icp.MNMGS(), icp.MNMAOR(theta1=0.9, theta2=1.1)):
                before, after = check_all(plain, member), check_all(scaled, member)
                for name in BY_NORM:
                    assert before[name].holds is after[name].holds, (seed, name)


class TestAnswers:
    def test_names_and_sentences(self):
        assert set(theorems()) == {*BY_NORM, "rowwise", "monotone", "definite"}
        with pytest.raises(icp.InputError, match=r"theorem is '4\.5'"):
            check("4.5", ONE, icp.MNMGS())
        with pytest.raises(icp.InputError, match="does not print"):
            check("sharper", ONE, icp.MNMGS(), as_printed=True)
        for member in ("mnmgs", icp.MNMGS, icp.MMS()):
            with pytest.raises(icp.InputError, match=r"^member is "):
                check("4.3", ONE, member)

    def test_many_unknowns_without_any_dense_matrix(self):
        """Both answers at n = 90000: 4.1 holds on the LCP, not with G = .9/4 times the adjacency."""
        lcp, coupled = icp.scenes.bai_symmetric(n=90_000, mu=4), icp.scenes.manufactured_affine(n=90_000)
        assert check("4.1", lcp.problem, icp.MNMGS()).number == pytest.approx(3 / 7, abs=1e-3)
        assert check("4.1", coupled.problem, icp.MNMGS()).holds is False
        assert check("sharper", coupled.problem, icp.MNMJ()).number == pytest.approx(0.9, abs=1e-3)
        assert isinstance(predicted_rate(coupled.problem, icp.MNMJ()), Rate)
