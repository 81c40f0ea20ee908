"""The problem: validated once, never changed, and the only place where p, r and Res are computed."""

import numpy as np
import pytest
import scipy.sparse as sp
from known_answers import PAIR
from scipy.sparse.linalg import aslinearoperator

import icpmodel as icp
from icpmodel.numerics.arrays import norm


@pytest.mark.parametrize(
    ("A", "q", "psi", "words"),
    [
        ([[1.0, 2.0]], [1.0], 0, r"A has shape \(1, 2\)"),
        (np.zeros((0, 0)), [], 0, "A is empty"),
        ([[1.0, float("nan")], [0.0, 1.0]], [1.0, 1.0], 0, r"A\[0, 1\] is nan"),
        (sp.csr_array([[1.0, 0.0], [0.0, np.inf]]), [1.0, 1.0], 0, r"A\[1, 1\] is inf"),
        (np.eye(2), [1.0], 0, r"q has shape \(1,\); shape \(2,\)"),
        (np.eye(2), [1.0, float("inf")], 0, r"q\[1\] is inf"),
        (np.eye(2), [1.0, 1.0], [1.0, float("nan")], r"psi\[1\] is nan"),
        (np.eye(2), [1.0, 1.0], "zero", "psi is 'zero'"),
        (np.eye(2), [1.0, 1.0], icp.Affine(np.eye(3)), r"Affine.G has shape \(3, 3\)"),
    ],
)
def test_bad_input_is_named_with_what_was_found(A, q, psi, words):
    with pytest.raises(icp.InputError, match=words):
        icp.ICP(A, q, psi)


@pytest.mark.parametrize(
    "use",
    [
        lambda problem: icp.error_bound(problem, [1, 2]),
        icp.solve,
        lambda problem: icp.save_problem(problem, "nowhere.npz"),
    ],
)
@pytest.mark.parametrize(("problem", "found"), [(np.eye(2), "an ndarray"), (None, "None"), (icp.ICP, "the class ICP")])
def test_what_is_no_icp_is_named(use, problem, found):
    with pytest.raises(icp.InputError, match=f"problem is {found}; an ICP"):
        use(problem)


@pytest.mark.parametrize("form", [np.ndarray.tolist, sp.csc_array, sp.coo_matrix, sp.dia_array])
def test_every_form_of_A_is_the_same_matrix(form):
    dense = np.array([[4.0, -1.0, 0.0], [0.0, 0.0, 2.0], [1.0, 0.0, 3.0]])
    problem = icp.ICP(form(dense), [1, 2, 3])
    assert np.array_equal(problem.A.toarray(), dense)
    assert problem.A.nnz == 6  # the zero diagonal entry of row 1 is stored
    assert problem.A.data.dtype == np.float64
    assert problem.A.indices.dtype == np.int32


def test_a_problem_never_changes_and_leaves_the_user_s_arrays_alone():
    A, q, c = sp.csr_array(np.eye(2)), np.ones(2), np.zeros(2)
    problem = icp.ICP(A, q, c)
    A.data[:] = 7.0
    q[:] = 7.0
    c[:] = 7.0
    assert problem.A.toarray().tolist() == [[1.0, 0.0], [0.0, 1.0]]
    assert problem.q.tolist() == [1.0, 1.0]
    assert problem.psi.value(q).tolist() == [0.0, 0.0]
    for array in (problem.A.data, problem.A.indices, problem.q, problem.psi.value(q)):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    with pytest.raises(AttributeError, match="never changes"):
        problem.q = q
    with pytest.raises(AttributeError, match="never changes"):
        del problem.A


def test_a_series_of_problems_shares_A():
    problem = icp.ICP([[2.0]], [-2.0])
    assert problem.with_q([-4.0]).A is problem.A
    assert problem.with_psi(5.0).q is problem.q
    assert [problem.with_q([-q]).solve().z[0] for q in (1.0, 2.0, 3.0)] == pytest.approx([0.5, 1.0, 1.5])
    assert problem.with_psi(3.0).solve().z[0] == pytest.approx(3.0)


@pytest.mark.parametrize("size", [0.0, 5e-324, 1e-150, 1e-140, 1.0, 1e140, 1e300, np.inf])
def test_the_norm_is_right_at_every_size_of_its_entries(size):
    """Also where some squares, or all of them, over- or underflow."""
    x = np.array([3.0, -4.0]) * size / 4.0 if 0 < size < np.inf else np.array([size, -size])
    expected = np.hypot(*x)
    assert norm(x) == pytest.approx(expected, rel=1e-14)
    assert norm(np.append(x, 1e-170)) >= expected
    assert np.isnan(norm(np.append(x, np.nan)))


def test_both_residuals_are_two_norms_of_the_natural_map_and_do_not_overflow():
    """Law 5: Res_D = ‖min(D⁻¹p, r)‖ with d_i = max_j |a_ij| does not know the units of p, the paper's Res does."""
    problem = icp.ICP([[1.0, 0.0], [8.0, 4.0]], [-3.0, 8.0])
    assert problem.residual([0.0, 5.0]) == pytest.approx(np.hypot(3.0, 28.0 / 8.0))
    assert problem.paper_residual([0.0, 5.0]) == pytest.approx(np.hypot(3.0, 5.0))
    for unit in (1.0, 1e200, 1e-200):
        of_p = icp.ICP(np.eye(2) * unit, [-3.0 * unit, -4.0 * unit])
        assert of_p.residual([0.0, 0.0]) == of_p.residual_scale() == pytest.approx(5.0)
        assert of_p.paper_residual([0.0, 0.0]) == pytest.approx(5.0 * unit)
        of_z = icp.ICP(np.eye(2), [-3.0 * unit, -4.0 * unit])
        assert of_z.residual([0.0, 0.0]) == of_z.residual_scale() == pytest.approx(5.0 * unit)


@pytest.mark.parametrize("kind", [np.array, sp.csr_array])
def test_a_row_without_entries_counts_alike_in_all_units(kind):
    """q_1 ≥ 0 says nothing of z: where it holds strictly z_1 is at its obstacle, where it fails there is no
    solution."""
    for unit in (1e-12, 1.0, 1e12):
        problem = icp.ICP(kind([[1.0, 0.0], [0.0, 0.0]]), [-1.0, unit], [0.0, 2.0])
        assert problem.residual([1.0, 2.0]) == 0.0
        assert problem.residual([1.0, 2.5]) == 0.5
        assert problem.solve().z == pytest.approx([1.0, 2.0])
        assert not problem.with_q([-1.0, -unit]).solve(raise_on_failure=False).solved
        assert problem.with_q([-1.0, 0.0]).residual([1.0, 2.5]) == 0.0


def test_a_certificate_tells_each_violation_by_its_own_name():
    """p = 2z − 6, r = z − 1 for z = (0, 5): p = (−6, 4), r = (−1, 4); min(D⁻¹p, r) = (−3, 2)."""
    problem = icp.ICP(np.diag([2.0, 2.0]), [-6.0, -6.0], 1.0)
    certificate = icp.certify(problem, [0.0, 5.0])
    assert certificate.violation_p == 6.0
    assert certificate.violation_r == 1.0
    assert certificate.residual_max == 3.0
    assert certificate.residual == pytest.approx(np.hypot(3.0, 2.0))
    assert certificate.residual_of_paper == pytest.approx(np.hypot(6.0, 4.0))
    with pytest.raises(icp.InputError, match="omega"):
        problem.natural_map([0.0, 5.0], omega=-1.0)


def test_an_operator_that_only_multiplies_is_refused_with_what_to_give_instead():
    operator = 2.0 * aslinearoperator(np.eye(3))
    words = "Operator, which only multiplies vectors; its entries are needed: give the array or the sparse matrix"
    for build in (lambda: icp.ICP(operator, np.ones(3)), lambda: icp.Affine(operator).bind(3)):
        with pytest.raises(icp.InputError, match=words):
            build()
    assert icp.ICP(operator @ np.eye(3), np.ones(3)).n == 3
    assert icp.ICP(np.eye(3), np.ones(3), operator).psi.value(np.ones(3)).size == 3  # as psi products are enough


def test_labels_of_pandas_that_differ_are_named():
    """Numbers are taken by their place: rows that are called otherwise would be taken for each other."""
    pd = pytest.importorskip("pandas")
    A = pd.DataFrame(PAIR, index=list("ab"), columns=list("ab"))
    q = pd.Series([-2.0, 1.0], index=list("ab"))
    assert icp.ICP(A, q, psi=pd.Series([0.0, 0.0], index=list("ab"))).solve().z.tolist() == [1.0, 0.0]
    for wrong, name in (((A[["b", "a"]], q), "A.columns"), ((A, q, q[::-1]), "psi.index")):
        with pytest.raises(icp.InputError, match=f"{name} has other labels than A.index"):
            icp.ICP(*wrong)
    problem = icp.ICP(A, q)
    swapped = q[::-1]
    moving = icp.ICP(A, q, icp.Affine(0.1 * A, q))
    for wrong in (
        icp.Constant(swapped),
        icp.Elementwise(np.sin, c=swapped),
        icp.Function(np.sin, lipschitz=swapped),
        icp.Affine(0.1 * A[["b", "a"]].loc[["b", "a"]]),
    ):
        with pytest.raises(icp.InputError, match=r"psi\.index has other labels than A\.index"):
            icp.ICP(A, q, wrong)
    with pytest.raises(icp.InputError, match=r"f\.index has other labels than A\.index"):
        icp.ICP(A, q, f=icp.Elementwise(np.sin, c=swapped))
    with pytest.raises(icp.InputError, match=r"Affine\.c\.index has other labels than Affine\.G\.index"):
        icp.Affine(A, swapped)
    with pytest.raises(icp.InputError, match=r"upper\.index has other labels than psi\.index"):
        icp.ICP(PAIR, np.array([-2.0, 1.0]), q, swapped)
    for call, name in (
        (lambda: icp.ICP.from_friction_index(A, q, 0.0, swapped, [-1, -1]), "hi.index"),
        (lambda: problem.with_q(swapped), "q.index"),
        (lambda: problem.with_psi(swapped), "psi.index"),
        (lambda: problem.solve(z0=swapped), "z0.index"),
        (lambda: icp.solve_many(A, pd.DataFrame([swapped])), "Q.columns"),
        (lambda: icp.solve_many(A, [q, swapped]), r"Q\[1\].index"),
        (lambda: icp.solve_many([A, A], pd.DataFrame([swapped] * 2)), "Q.columns"),
        (lambda: icp.solve_many([A, A[["b", "a"]]], [q, q]), r"A\[1\].columns"),
        (lambda: problem.solve().derivative().forward(dpsi=swapped), "dpsi.index"),
        (lambda: moving.solve().derivative().forward(dpsi=(A, swapped)), r"dpsi\[1\].index"),
    ):
        with pytest.raises(icp.InputError, match=rf"{name} has other labels than A(\[0\])?.index"):
            call()
    # dates, which follow each other where A has no labels, and an attribute of the user's own
    windows = icp.ICP(PAIR, [-2.0, 1.0], pd.Series([0.0, 0.1], index=["May", "June"]))
    assert windows.with_psi(pd.Series([0.2, 0.1], index=["June", "July"])).psi.c.tolist() == [0.2, 0.1]

    class Floor:
        index = (0, 1)

        def __call__(self, z):
            return 0.0 * z

    assert icp.ICP(A, q, Floor()).solve().z.tolist() == [1.0, 0.0]
    assert icp.solve_many(A, pd.DataFrame([q, q], index=["day", "night"])).Z.tolist() == [[1.0, 0.0]] * 2


_OBSTACLES = r"has no argument ub; .* is called psi, .* upper$"
_LOWER = r"has no argument lower; .*; did you mean psi\?$"
_VERBS = "all_solutions certify comparison_matrix contact_state contradiction crosscheck load_solution race report"
_ALONE = "one of {} alone was expected"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: icp.ICP([[1.0]], [1.0], lower=0), _LOWER),
        (lambda: icp.solve_many([[1.0]], [[1.0]], ub=0), _OBSTACLES),
        (lambda: icp.load_problem("A.npy", lower=0), _LOWER),
        (lambda: icp.ICP([[1.0]], [1.0], psi=[None, 1.0]), r"psi\[0\] is None; real numbers were"),
        (lambda: icp.ICP([[1.0]], [1.0], psi=([[0.5]], [1.0])), r"psi is a matrix G and .*; Affine\(G, c\) was"),
        (lambda: icp.ICP([[1.0]], [1.0], upper=(sp.eye_array(1), 1.0)), r"upper is a matrix G .*; Affine\(G, c\) was"),
        (lambda: icp.complements(1), "complements was not given r; it takes p, r, lower, upper"),
        (lambda: icp.complements(1, 2, lowr=0), "complements has no argument lowr; .* did you mean lower"),
        (lambda: icp.Problem(), "Problem was not given constraints"),
        (lambda: icp.ICP([[1.0]], [1.0]).solve().polish(3), "Solution.polish was given an argument twice, or too many"),
        (lambda: icp.ICP([[1.0]], [1.0]).solve(method=3), r"method is 3; .*methods\.names"),
        (lambda: icp.ICP([[1.0]], [1.0]).solve(callback=lambda: None), _ALONE.format("a Progress")),
        (lambda: icp.ICP([[1.0]], [1.0], psi=lambda z, w: z), _ALONE.format("z")),
        (lambda: icp.select_method(icp.ICP([[1.0]], [1.0]), family="x"), "family is 'x'; 'paper', 'modulus' or None"),
        *((getattr(icp, verb), f"{verb} was not given") for verb in _VERBS.split()),
    ],
)
def test_arguments_that_do_not_fit_are_named(call, words):
    with pytest.raises(icp.InputError, match=words):
        call()


def test_the_rounding_of_an_obstacle_without_a_value_is_nan():
    psi = icp.Elementwise(lambda z: np.sqrt(-1.0 - z), lambda z: 0 * z)
    with np.errstate(invalid="ignore"):
        assert np.isnan(icp.ICP(2.0 * np.eye(2), [1.0, -5.0], psi).rounding(np.ones(2))[1]).all()
