"""Files are data: what is written is read back, and a wrong file names itself, the field and what was expected."""

import io
import itertools
import os
import signal
import sys
import zipfile

import numpy as np
import pytest
import scipy.sparse as sp
from damaged import Trap, cut, mutated, read_or_refused
from hypothesis import given, settings
from known_answers import SEEDS

import icpmodel as icp


def problem_of(kind, seed=0, n=4, above=None):
    rng = np.random.default_rng(seed)
    maps = {
        None: lambda height: None,
        "zero": lambda height: 0.0,
        "constant": lambda height: height + rng.normal(size=n),
        "free rows": lambda height: np.array([-np.inf, 1.0, -np.inf, 0.0]),
        "affine": lambda height: icp.Affine(sp.random_array((n, n), density=0.4, rng=rng), height + rng.normal(size=n)),
    }
    A = sp.random_array((n, n), density=0.5, rng=rng, data_sampler=rng.normal) + 3 * sp.eye_array(n)
    return icp.ICP(A, rng.normal(size=n), maps[kind](0.0), upper=maps[above](30.0))


@pytest.mark.parametrize("kind", ["zero", "constant", "free rows", "affine"])
@pytest.mark.parametrize("above", [None, "constant", "affine"])
@settings(max_examples=10)
@given(seed=SEEDS)
def test_a_problem_comes_back_to_the_last_bit(tmp_path_factory, kind, above, seed):
    path = tmp_path_factory.mktemp("files") / "problem.npz"
    problem = problem_of(kind, seed, above=above)
    icp.save_problem(problem, path)
    back = icp.load_problem(path)
    z = np.random.default_rng(seed).normal(size=4)
    assert np.array_equal(back.A.toarray(), problem.A.toarray())
    assert np.array_equal(back.q, problem.q)
    assert np.array_equal(back.r(z), problem.r(z))
    assert type(back.psi) is type(problem.psi)
    assert type(back.upper) is type(problem.upper)
    assert above is None or np.array_equal(back.r_upper(z), problem.r_upper(z))


def test_psi_from_code_has_no_file_form(tmp_path):
    with pytest.raises(icp.InputError, match="only zero, constant and affine"):
        icp.save_problem(icp.ICP([[1.0]], [1.0], np.sin), tmp_path / "p.npz")
    assert not (tmp_path / "p.npz").exists()


@pytest.mark.parametrize("side", ["psi", "upper"])
def test_an_obstacle_that_is_a_number_too_large_for_float64_is_named(tmp_path, side):
    np.savez(tmp_path / "p.npz", A=np.eye(2), q=np.ones(2))
    with pytest.raises(icp.InputError, match=f"{side} is an integer of hundreds of digits"):
        icp.load_problem(tmp_path / "p.npz", **{side: 10**400})


def damage(path, **changed):
    """The archive `path` with some fields replaced, or dropped where None."""
    with np.load(path) as archive:
        fields = {name: archive[name] for name in archive.files} | changed
    np.savez(path, **{name: value for name, value in fields.items() if value is not None})


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"q": None}, "has no q; give q"),
        ({"A_data": None}, "A_. are not a square CSR matrix"),
        ({"psi": np.zeros(4)}, "A alone, or A, q, psi and upper"),
        ({"c": None, "G_indptr": np.zeros(5, int)}, "G_. are not a square CSR matrix"),
        ({"format": np.array("99")}, "field format is '99'; 'icpmodel problem 3' was expected"),
        ({"q": np.ones(3)}, r"q has shape \(3,\); shape \(4,\)"),
        ({"A_indptr": np.array([0, 9, 2, 3, 4])}, "not a square CSR matrix"),
        ({"A_indptr": np.array([0, 1, 2, 3, 2**63], dtype=np.uint64)}, "not a square CSR matrix"),
        ({"A_indptr": np.array([0, 1, 2, 3, 3])}, "not a square CSR matrix"),
        ({"q": np.array([1.0, np.nan, 0.0, 0.0])}, r"q\[1\] is nan"),
    ],
)
def test_a_wrong_npz_names_the_file_and_the_field(tmp_path, changed, words):
    path = tmp_path / "p.npz"
    icp.save_problem(problem_of("zero"), path)
    damage(path, **changed)
    with pytest.raises(icp.FileError, match=words) as error:
        icp.load_problem(path)
    assert "p.npz" in str(error.value)


@pytest.mark.parametrize("reader", [icp.load_problem, icp.load_solution])
def test_nothing_in_a_file_is_ever_executed(tmp_path, reader):
    path, sprung = tmp_path / "p.npz", tmp_path / "sprung"
    icp.save_problem(problem_of("zero"), path)
    trap = np.array([Trap(sprung)] * 4, dtype=object)
    damage(path, q=trap, z=trap)
    with pytest.raises(icp.FileError, match=r"p\.npz: field [qz] .*Object arrays"):
        reader(path)
    assert not sprung.exists()


def content(path):
    problem = icp.load_problem(path)
    return problem.A.toarray().tolist(), problem.q.tolist()


def save_until(last, problem, path):
    """Save, and be killed at the `last` call of a function on the way."""
    calls = itertools.count()
    sys.setprofile(lambda *_: next(calls) == last and os.kill(os.getpid(), signal.SIGKILL))
    icp.save_problem(problem, path)
    sys.setprofile(None)
    os._exit(0)


def test_a_writer_that_is_killed_at_any_moment_leaves_the_old_file_or_the_new(tmp_path):
    path, old, new = tmp_path / "p.npz", problem_of("zero", 1), problem_of("zero", 2)
    icp.save_problem(new, path)
    changed = content(path)
    icp.save_problem(old, path)
    before = content(path)
    found, ended = [], None
    for last in itertools.count(0, 60):
        if not (child := os.fork()):
            save_until(last, new, path)
        ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        found.append(content(path))
        assert found[-1] in (before, changed)
        if ended == 0:
            break
        icp.save_problem(old, path)
    assert ended == 0
    assert before in found
    assert found[-1] == changed
    assert list(tmp_path.iterdir()) == [path]  # what killed writers had begun is gone
    assert len(found) > 10


@pytest.mark.parametrize("kind", ["zero", "affine"])
def test_a_saved_problem_cut_after_any_byte_is_refused_and_a_changed_byte_changes_nothing_unseen(tmp_path, kind):
    path, problem = tmp_path / "p.npz", problem_of(kind, n=2)
    icp.save_problem(problem, path)
    right = content(path)
    for changed in mutated(path, 0, 200):
        assert read_or_refused(content, changed) in (None, right)
    assert content(path) == right
    assert [path.stat().st_size for part in cut(path) if read_or_refused(content, part)] == []


@pytest.mark.parametrize(
    ("kind", "body", "words"),
    [
        ("coordinate real general", "1 1 1\n1 1 1,5\n", "'1,5'"),
        ("coordinate real general", "1 1 1\n1 1 1 2\n", "requires 3 columns but 4"),
        ("coordinate real general", "1 1 1\n1.5 1 1\n", "'1.5' to int64"),
        ("coordinate real general", "1 1 1\n1 1 1e999\n", r"A\[0, 0\] is inf"),
        ("coordinate real general", "1 1 1\n0 1 1\n", "an entry at 0, 1; places within 1 x 1"),
        ("coordinate real general", "1 1 1\n1 1 1\n1 1 1\n", "holds 2 entries; its header promises 1"),
        ("coordinate real general", "900000000 900000000 1\n1 1 1\n", "promises 900000000 x 900000000 with 1 entries"),
        ("coordinate real general", "1 1\n1 1 1\n", "not a readable Matrix Market file"),
        ("coordinate real general", f"1 1 {'9' * 5000}\n1 1 1\n", "not a readable Matrix Market file"),
        ("coordinate real symmetric", "2 2 1\n1 2 1\n", "places within 2 x 2 on or below the diagonal"),
        ("coordinate real skew-symmetric", "2 2 1\n1 1 1\n", "places within 2 x 2 below the diagonal"),
        ("coordinate real symmetric", "2 1 1\n1 1 1\n", "is 2 x 1, and cannot be symmetric"),
        ("coordinate complex general", "1 1 1\n1 1 1 0\n", "is coordinate complex general; real numbers"),
        ("array real symmetric", "2 2\n1\n2\n", "holds 2 entries; its header promises 3"),
        ("array pattern general", "1 1\n1\n", "is array pattern"),
    ],
)
def test_what_matrix_market_does_not_have_is_not_guessed_at(tmp_path, kind, body, words):
    (tmp_path / "A.mtx").write_text(f"%%MatrixMarket matrix {kind}\n{body}")
    (tmp_path / "q.mtx").write_text("%%MatrixMarket matrix array real general\n1 1\n1\n")
    with pytest.raises(icp.FileError, match=words) as error:
        icp.load_problem(tmp_path / "A.mtx", q=tmp_path / "q.mtx")
    assert "A.mtx" in str(error.value)


@pytest.mark.parametrize("compressed", [True, False])
def test_a_small_file_does_not_become_a_large_array(tmp_path, compressed):
    """Neither by compression, nor by what a header says, nor by fields that no problem has."""
    path = tmp_path / "p.npz"
    icp.save_problem(problem_of("zero"), path)
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (2**40,)})
    members["q.npy"] = header.getvalue() + bytes(2**20 if compressed else 8)
    way = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
    with zipfile.ZipFile(path, "w", way) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    with pytest.raises(icp.FileError, match="field q is no array by NumPy, or truncated"):
        icp.load_problem(path)
