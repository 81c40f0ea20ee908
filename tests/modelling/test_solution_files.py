"""A saved solution comes back as one, and says no more than its problem bears out; its numbers go to other programs."""

import json

import numpy as np
import pytest
from damaged import mutated, read_or_refused

import icpmodel as icp

PROBLEM = icp.ICP([[4.0, -1.0], [1.0, 3.0]], [1.0, -30.0], icp.Affine([[0, 0.25], [0, 0]], [-0.5, 0]), upper=[2.0, 9.0])


def saved(path, solution, **changed):
    """The file of `solution` with some of what it says changed."""
    icp.save_solution(solution, path)
    if changed:
        with np.load(path) as archive:
            fields = dict(archive)
        fields["about"] = np.array(json.dumps(json.loads(str(fields["about"])) | changed))
        np.savez(path, **fields)
    return path


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"method": "psor"},
        {"accuracy": 1e-6},
        {"rtol": 1e-3},
        {"max_iter": 1, "method": "mnmgs", "raise_on_failure": False},
    ],
)
def test_a_solution_comes_back_as_one_whose_card_prints(tmp_path, options):
    solution = PROBLEM.solve(**options)
    asked = {name: value for name, value in options.items() if name in ("rtol", "accuracy")}
    back = icp.load_solution(saved(tmp_path / "s.npz", solution), **asked)
    assert type(back) is icp.Solution
    for name in ("z", "p", "r"):
        assert np.array_equal(getattr(back, name), getattr(solution, name))
    assert back.why.endswith(f"read from {tmp_path / 's.npz'}")
    card, before = dict(back.summary()), dict(solution.summary())
    for one in (card, before):
        one["status"] = one["status"].partition(";")[0]
        del one["method"]
    assert card == before
    about, told = back.about(), solution.about()
    named = ("why", "method", "last_method")
    assert {k: v for k, v in about.items() if k not in named} == {k: v for k, v in told.items() if k not in named}
    assert repr(solution.method) in back.why
    assert back.polish().residual <= back.residual
    assert PROBLEM.solve(z0=back).solved
    json.dumps(about, allow_nan=False)


def test_a_status_that_the_problem_does_not_bear_out_is_refused(tmp_path):
    """Whoever wrote it: SOLVED is said only of a residual, or a certified error, that was computed again."""
    path, rough = tmp_path / "s.npz", PROBLEM.solve("mnmgs", max_iter=1, raise_on_failure=False)
    with pytest.raises(icp.FileError, match=r"s\.npz: says that it is solved, but Res_D\(z\) = .*icpmodel.certify"):
        icp.load_solution(saved(path, rough, status="solved"))
    with pytest.raises(icp.FileError, match=r"says that it is solved, but its error bound is .*1e-09 was wanted"):
        icp.load_solution(saved(path, rough, status="solved", accuracy=1e300), accuracy=1e-9)
    for claimed in ({"tolerance": 1e300}, {"atol": 1e300}, {"accuracy": 1e300}, {"status": "infeasible"}):
        with pytest.raises(icp.FileError, match="says that "):
            icp.load_solution(saved(path, rough, **({"status": "solved"} | claimed)))
    with pytest.raises(icp.FileError, match="says that it is solved, but Res"):
        icp.load_solution(saved(path, PROBLEM.solve()), PROBLEM.with_q([1.0, 30.0]))
    assert icp.load_solution(saved(path, PROBLEM.solve(), tolerance=None)).solved
    with pytest.raises(icp.FileError, match=r"seconds = 10{60,}"):
        icp.load_solution(saved(path, PROBLEM.solve(), seconds=10**400))
    never = icp.ICP([[0.0, -1.0], [0.0, 0.0]], [1.0, -1.0]).solve(raise_on_failure=False)
    again = icp.load_solution(saved(path, never))
    assert again.status is icp.Status.INFEASIBLE
    assert again.infeasible.holds
    with pytest.raises(icp.FileError, match="says that there is no solution, which is not proved of"):
        icp.load_solution(path, PROBLEM)
    assert icp.load_solution(saved(path, rough)).status is icp.Status.ITERATION_LIMIT


@pytest.mark.parametrize(
    "problem",
    [icp.ICP([[-3.0]], [-2.0], icp.Affine([[0.5]], 1.0)), icp.ICP([[0.0, 0.0], [1.0, 0.0]], [1.0, -3.0], [-2.0, 1.0])],
)
def test_a_proof_of_the_presolved_problem_is_read_again(tmp_path, problem):
    icp.save_solution(problem.solve(raise_on_failure=False), tmp_path / "none.npz")
    assert icp.load_solution(tmp_path / "none.npz").status is icp.Status.INFEASIBLE


def test_a_proof_by_enumeration_is_made_again(tmp_path):
    solution = icp.ICP([[0.0, 2.0], [1.0, -1.0]], [2.0, -2.0], [0.0, 1.0]).solve(raise_on_failure=False)
    assert solution.infeasible.witness is None
    icp.save_solution(solution, tmp_path / "none.npz")
    assert icp.load_solution(tmp_path / "none.npz").infeasible.reason == solution.infeasible.reason


@pytest.mark.parametrize("field", ["about", "format"])
def test_characters_that_there_are_not_are_refused(tmp_path, field):
    path = saved(tmp_path / "s.npz", PROBLEM.solve())
    with np.load(path) as archive:
        fields = dict(archive)
    fields[field] = np.frombuffer(np.array([0x110000, 65], dtype="<u4"), dtype="<U2").reshape(())
    np.savez(path, **fields)
    with pytest.raises(icp.FileError, match=r"s\.npz"):
        icp.load_solution(path)


def test_a_saved_solution_is_the_file_of_its_problem_too(tmp_path):
    again = icp.load_problem(saved(tmp_path / "s.npz", PROBLEM.solve()))
    for residual in ("p", "r", "r_upper"):
        np.testing.assert_array_equal(*(getattr(one, residual)([3.0, -7.0]) for one in (again, PROBLEM)))


def test_a_solution_of_psi_from_code_needs_its_problem(tmp_path):
    problem = icp.ICP([[2.0]], [-1.0], psi=lambda z: 0.3 * np.sin(z))
    path = saved(tmp_path / "s.npz", problem.solve())
    with pytest.raises(icp.FileError, match=r"holds no problem.*load_solution\(path, problem\)"):
        icp.load_solution(path)
    with pytest.raises(icp.FileError, match="holds no problem"):
        icp.load_problem(path)
    assert icp.load_solution(path, problem).solved
    with pytest.raises(icp.InputError, match="problem is 3; an ICP"):
        icp.load_solution(path, 3)
    with pytest.raises(icp.FileError, match="field z has shape"):
        icp.load_solution(path, PROBLEM)


def test_the_numbers_alone_go_to_numpy_and_to_tables(tmp_path):
    solution = PROBLEM.with_psi([-np.inf, 0.0]).solve()
    for name in ("s.npz", "s.csv"):
        for _ in range(2):  # of its own kind a file is replaced
            icp.save_solution(solution, tmp_path / name)
    with pytest.raises(icp.FileError, match=r"holds numbers alone.*certify"):
        icp.load_solution(tmp_path / "s.csv")
    table = np.genfromtxt(tmp_path / "s.csv", delimiter=",", names=True)
    with np.load(tmp_path / "s.npz") as fields:
        for name in "zpr":
            assert np.array_equal(fields[name], getattr(solution, name))
            assert np.array_equal(table[name], fields[name])


def test_a_name_that_ends_otherwise_is_refused(tmp_path):
    solution = PROBLEM.solve()
    for name in ("s.npy", "s", "s.txt"):
        with pytest.raises(icp.FileError, match=r"a file name that ends in \.npz or \.csv was expected"):
            icp.save_solution(solution, tmp_path / name)
    with pytest.raises(icp.FileError, match=r"x\.mat: a file name that ends in \.npz"):
        icp.save_problem(PROBLEM, tmp_path / "x.mat")
    assert list(tmp_path.iterdir()) == []


def test_a_saved_solution_with_a_changed_byte_is_the_same_or_refused(tmp_path):
    """Also where the change hides a part of its problem, such as the upper obstacle."""
    path = saved(tmp_path / "s.npz", PROBLEM.solve())
    right = repr(icp.load_solution(path).problem)
    for changed in mutated(path, 3, 300):
        found = read_or_refused(icp.load_solution, changed)
        assert found is None or repr(found.problem) == right


def test_a_file_with_more_columns_is_not_replaced(tmp_path):
    mine = tmp_path / "mine.csv"
    mine.write_text("z,p,radius\n1,2,3\n")
    with pytest.raises(icp.FileError, match="is in the way"):
        icp.save_solution(icp.ICP([[2.0]], [-1.0]).solve(), mine)
    assert mine.read_text().startswith("z,p,radius")
