"""Random families: what their builders promise of A, that a solution exists, and that the seed alone decides."""

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel.benchmarks import drawn, family_names, gallery

FIXED = [name for name in family_names() if "+" not in name]
#: what is promised of A beside a solution
M_MATRICES = ("grid", "convection", "graph", "market-leontief", "option-one", "option-two")
SYMMETRIC = ("grid", "plate", "graph-expander", "graph-geometric", "graph-scale-free", "market-trade", "market-cournot",
             "contact", "dense-covariance", "dense-definite")  # fmt: skip
SEMIDEFINITE = ("market-trade", "market-prices", "market-traffic", "contact", "program")
SIZES_AND_SEEDS = [(11, 1), (33, 2), (57, 3)]

every_family = pytest.mark.parametrize("family", family_names())


def problem(family, n, seed):
    return drawn(family, n, np.random.default_rng([seed, n]))


@pytest.mark.parametrize("family", FIXED)
def test_a_has_the_structure_from_which_a_solution_follows(family):
    for n, seed in SIZES_AND_SEEDS:
        A = problem(family, n, seed).dense()
        size = abs(A).max()
        if family.startswith(SYMMETRIC):
            assert (A == A.T).all()
        if family.startswith(M_MATRICES):
            assert (A - np.diag(A.diagonal()) <= 0).all()
            assert np.linalg.inv(A).min() >= -1e-9 * abs(np.linalg.inv(A)).max()
        else:
            least = np.linalg.eigvalsh(A + A.T)[0]
            assert least > (-1e-12 * size if family.startswith(SEMIDEFINITE) else 1e-12 * size)


def test_chains_and_patches_of_contacts_are_redundant():
    for family in ("contact-chain", "contact-pile", "contact-redundant"):
        ranks = [(np.linalg.matrix_rank(one.dense()), one.n) for one in (problem(family, 57, k) for k in range(6))]
        assert any(rank < n for rank, n in ranks)


@every_family
def test_every_problem_has_a_solution_and_it_is_found(family):
    for n, seed in SIZES_AND_SEEDS:
        one = problem(family, n, seed)
        assert one.n <= 2 * n + 3
        assert one.solve(raise_on_failure=False).solved


@pytest.mark.parametrize("family", [name for name in FIXED if name.startswith(SEMIDEFINITE)])
def test_a_semidefinite_problem_has_a_feasible_point_also_where_the_obstacle_gives_way(family):
    """z ≥ ψ(z) and Az + q ≥ 0, found by a linear programme that knows nothing of complementarity."""
    from scipy.optimize import linprog

    for kind in ("", "+affine"):
        one = problem(family + kind, 33, 5)
        G, c = one.psi.linear
        sides = -sp.vstack([one.A, sp.eye_array(one.n) - G])
        held = np.append(np.full(one.n, True), np.isfinite(c))
        sides, ends = sides.tocsr()[held], np.concatenate([one.q, -c])[held]
        feasible = linprog(np.zeros(one.n), sides, ends + 1e-12, bounds=(None, None))
        assert feasible.status == 0


@pytest.mark.parametrize("kind", ["+affine", "+elementwise"])
def test_what_moves_stays_a_contraction(kind):
    for family in FIXED:
        lipschitz = problem(family + kind, 33, 4).psi.lipschitz
        assert 0 < lipschitz.sum(axis=1).max() < 1
        assert lipschitz.min() >= 0


def test_an_elementwise_obstacle_has_the_solution_of_the_fixed_one():
    """ψ(c) = c and |ψ'| < 1: r and z − c have one sign."""
    for family in FIXED:
        fixed = problem(family, 33, 6)
        bent = drawn(family + "+elementwise", 33, np.random.default_rng([6, 33]))
        assert bent.residual(fixed.solve(rtol=1e-11).z) <= 1e-7 * fixed.residual_at_0()


def test_a_real_share_of_the_rows_is_active():
    """Over the seeds: a family of problems without contact, or with nothing else, would be linear equations."""
    for family in FIXED:
        shares = []
        for seed in range(6):
            one = problem(family, 57, seed)
            z = one.solve().z
            shares.append(np.mean(one.p(z) > one.r(z)))
        assert 0.05 < np.mean(shares) < 0.95, family


@every_family
def test_the_seed_alone_decides(family):
    one, same, other = problem(family, 33, 1), problem(family, 33, 1), problem(family, 33, 2)
    assert (one.q == same.q).all()
    assert (one.A != same.A).nnz == 0
    assert (one.psi.value(one.q) == same.psi.value(one.q)).all()
    assert one.q.size != other.q.size or (one.q != other.q).any()


def test_the_gallery_has_every_family_at_sizes_of_the_seed_and_no_round_ones():
    labels = [label for label, _ in gallery(1, (10, 60, 2), ["graph", "plate"])]
    assert labels == [label for label, _ in gallery(1, (10, 60, 2), ["graph", "plate"])]
    assert labels != [label for label, _ in gallery(2, (10, 60, 2), ["graph", "plate"])]
    assert {label.split(",")[0] for label in labels} == set(family_names(["graph", "plate"]))
    assert [label for label in labels if label.startswith("graph") and label.endswith("0")] == []


def test_wrong_names_and_sizes_are_told():
    with pytest.raises(icp.InputError, match="there is no family 'grap-'"):
        family_names(["grap-"])
    with pytest.raises(icp.InputError, match=r"family is 'plate\+moving'"):
        problem("plate+moving", 10, 1)
    with pytest.raises(icp.InputError, match="n is 100000; a whole number >= 3 and <= 5000"):
        problem("dense-definite", 100_000, 1)
