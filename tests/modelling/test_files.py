"""Files are data: what is written is read back, and a wrong file names itself, the field and what was expected."""

import json
import os
import zipfile

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import mmwrite

import icpmodel as icp


def problem_of(kind, seed=0, n=4):
    rng = np.random.default_rng(seed)
    psi = {
        "zero": 0.0,
        "constant": rng.normal(size=n),
        "free rows": np.array([-np.inf, 1.0, -np.inf, 0.0]),
        "affine": icp.Affine(sp.random_array((n, n), density=0.4, rng=rng), rng.normal(size=n)),
    }[kind]
    A = sp.random_array((n, n), density=0.5, rng=rng, data_sampler=rng.normal) + 3 * sp.eye_array(n)
    return icp.ICP(A, rng.normal(size=n), psi)


@pytest.mark.parametrize("form", ["problem.npz", "folder"])
@pytest.mark.parametrize("kind", ["zero", "constant", "free rows", "affine"])
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_a_problem_comes_back_to_the_last_bit(tmp_path_factory, form, kind, seed):
    path = tmp_path_factory.mktemp("files") / form
    problem = problem_of(kind, seed)
    icp.save_problem(problem, path)
    back = icp.load_problem(path)
    z = np.random.default_rng(seed).normal(size=4)
    assert np.array_equal(back.A.toarray(), problem.A.toarray())
    assert np.array_equal(back.q, problem.q)
    assert np.array_equal(back.psi.value(z), problem.psi.value(z))
    assert type(back.psi) is type(problem.psi)


def test_a_and_q_as_matrix_market_are_an_lcp(tmp_path):
    mmwrite(tmp_path / "A.mtx", sp.coo_array(np.array([[2.0, -1.0], [-1.0, 2.0]])))
    mmwrite(tmp_path / "q.mtx", np.array([[-1.0], [3.0]]))
    problem = icp.load_problem(tmp_path / "A.mtx", q=tmp_path / "q.mtx")
    assert problem.solve().z == pytest.approx([0.5, 0.0], abs=1e-7)


def test_a_symmetric_matrix_market_file_is_read_whole(tmp_path):
    (tmp_path / "A.mtx").write_text("%%MatrixMarket matrix coordinate real symmetric\n2 2 3\n1 1 2\n2 1 -1\n2 2 2\n")
    (tmp_path / "q.mtx").write_text("%%MatrixMarket matrix array real general\n2 1\n-1\n3\n")
    problem = icp.load_problem(tmp_path / "A.mtx", q=tmp_path / "q.mtx")
    assert problem.A.toarray().tolist() == [[2.0, -1.0], [-1.0, 2.0]]


def test_psi_from_code_has_no_file_form(tmp_path):
    with pytest.raises(icp.InputError, match="only zero, constant and affine"):
        icp.save_problem(icp.ICP([[1.0]], [1.0], np.sin), tmp_path / "p.npz")
    assert not (tmp_path / "p.npz").exists()


def test_a_solution_comes_back_with_its_certificate(tmp_path):
    solution = problem_of("affine").solve()
    icp.save_solution(solution, tmp_path / "s.npz")
    back = icp.load_solution(tmp_path / "s.npz")
    for name in ("z", "p", "r"):
        assert np.array_equal(back[name], getattr(solution, name))
    assert back["about"]["status"] == "solved"
    assert back["about"]["error_bound"] == solution.error_bound
    json.dumps(back["about"], allow_nan=False)


def damage(path, **changed):
    """The archive `path` with some fields replaced, or dropped where None."""
    with np.load(path) as archive:
        fields = {name: archive[name] for name in archive.files} | changed
    np.savez(path, **{name: value for name, value in fields.items() if value is not None})


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"q": None}, "field q is missing"),
        ({"psi": np.array("cubic")}, "field psi is 'cubic'; one of zero, constant, affine"),
        ({"psi": np.array("affine")}, "field c is missing"),
        ({"format": np.array(99)}, "field format is 99; 1 was expected"),
        ({"q": np.ones(3)}, "field A_indptr has shape .5,.*; 4 integers"),
        ({"q": np.array(["a"] * 4)}, "field q has shape .4,., dtype <U1"),
        ({"A_data": None}, "field A_data is missing"),
        ({"A_indices": np.array([0])}, "field A_indices has shape"),
        ({"A_indptr": np.array([0, 9, 2, 3, 4])}, "not a CSR matrix"),
        ({"A_indptr": np.array([0, 1, 2, 3, -1])}, "not a CSR matrix"),
        ({"A_indptr": np.array([0, 1, 2, 3, 2**63], dtype=np.uint64)}, "not a CSR matrix"),
        ({"A_indptr": np.array([0, 0, 0, 0, 0])}, "not a CSR matrix"),
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


@pytest.mark.parametrize("part", [0.1, 0.5, 0.9, 0.99])
@pytest.mark.parametrize("reader", ["problem", "solution"])
def test_a_truncated_npz_is_an_error_at_every_length(tmp_path, part, reader):
    path = tmp_path / "p.npz"
    if reader == "problem":
        icp.save_problem(problem_of("affine"), path)
    else:
        icp.save_solution(problem_of("affine").solve(), path)
    content = path.read_bytes()
    path.write_bytes(content[: int(part * len(content))])
    with pytest.raises(icp.FileError, match=r"p\.npz"):
        {"problem": icp.load_problem, "solution": icp.load_solution}[reader](path)


class Trap:
    """Unpickling this creates a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


@pytest.mark.parametrize("reader", [icp.load_problem, icp.load_solution])
def test_nothing_in_a_file_is_ever_executed(tmp_path, reader):
    path, sprung = tmp_path / "p.npz", tmp_path / "sprung"
    icp.save_problem(problem_of("zero"), path)
    trap = np.array([Trap(sprung)] * 4, dtype=object)
    damage(path, q=trap, z=trap)
    with pytest.raises(icp.FileError, match=r"p\.npz: not an \.npz file of plain arrays"):
        reader(path)
    assert not sprung.exists()


def test_a_file_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "s.npz"
    icp.save_solution(problem_of("zero").solve(), path)
    before = path.read_bytes()

    def press(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez_compressed", press)
    with pytest.raises(KeyboardInterrupt):
        icp.save_solution(problem_of("affine").solve(), path)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["s.npz"]


def test_a_matrix_market_file_that_claims_to_be_huge_is_an_error(tmp_path):
    (tmp_path / "A.mtx").write_text("%%MatrixMarket matrix array real general\n1000000 100000000\n1\n")
    mmwrite(tmp_path / "q.mtx", np.array([[-1.0], [3.0]]))
    with pytest.raises(icp.FileError, match=r"A\.mtx: its header promises 1000000 x 100000000"):
        icp.load_problem(tmp_path / "A.mtx", q=tmp_path / "q.mtx")


def test_q_of_the_wrong_length_is_named_by_its_own_file(tmp_path):
    mmwrite(tmp_path / "A.mtx", np.eye(2))
    mmwrite(tmp_path / "q.mtx", np.ones((3, 1)))
    with pytest.raises(icp.FileError, match=r"q\.mtx: holds 3 numbers; 2 were expected"):
        icp.load_problem(tmp_path / "A.mtx", q=tmp_path / "q.mtx")


def test_any_bytes_are_an_error_not_a_crash(tmp_path):
    for name, content in (("a.npz", b""), ("b.npz", b"PK\x03\x04 nonsense"), ("c.npz", bytes(range(256)) * 10)):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(icp.FileError, match=name):
            icp.load_problem(tmp_path / name)
    with zipfile.ZipFile(tmp_path / "d.npz", "w") as archive:
        archive.writestr("hello.txt", "hello")
    with pytest.raises(icp.FileError, match=r"d\.npz"):
        icp.load_problem(tmp_path / "d.npz")


@pytest.mark.parametrize(
    ("file", "content", "words"),
    [
        ("psi.json", None, "it declares psi"),
        ("psi.json", "{", "not JSON"),
        ("psi.json", '{"psi": "sine"}', "field psi is 'sine'"),
        ("psi.json", '{"psi": []}', r"field psi is \[\]; one of zero, constant, affine"),
        ("psi.json", "[]", r"psi\.json: holds no object; the field psi alone"),
        ("psi.json", "{}", r"psi\.json: holds the fields none; the field psi alone"),
        ("psi.json", '{"psi": "zero", "c": 1}', r"psi\.json: holds the fields psi, c; the field psi alone"),
        ("psi.json", "[" * 100_000, "not JSON"),
        ("q.mtx", "%%MatrixMarket matrix coordinate real general\n10000000000000 1 1\n1 1 1.0\n", "at most"),
        ("q.mtx", None, "no such file"),
        ("q.mtx", "hello", "not a readable Matrix Market file"),
        ("A.mtx", "%%MatrixMarket matrix coordinate real general\n4 4 9\n1 1 1.0\n", "header promises|not a readable"),
        ("A.mtx", "%%MatrixMarket matrix coordinate real general\n4 3 1\n1 1 1.0\n", r"A has shape \(4, 3\)"),
        ("A.mtx", "%%MatrixMarket matrix coordinate complex general\n4 4 1\n1 1 1.0 1.0\n", "A is complex"),
        ("q.mtx", "%%MatrixMarket matrix array real general\n2 2\n1\n2\n3\n4\n", r"shape \(2, 2\); a vector"),
        ("q.mtx", "%%MatrixMarket matrix array real general\n3 1\n1\n2\n3\n", r"q has shape \(3,\)"),
    ],
)
def test_a_wrong_folder_names_the_file_and_what_was_expected(tmp_path, file, content, words):
    folder = tmp_path / "problem"
    icp.save_problem(problem_of("zero"), folder)
    if content is None:
        (folder / file).unlink()
    else:
        (folder / file).write_text(content)
    with pytest.raises(icp.FileError, match=words) as error:
        icp.load_problem(folder)
    assert str(error.value).count(str(folder)) == 1


def test_a_folder_without_a_problem_is_called_that(tmp_path):
    with pytest.raises(icp.FileError, match="the folder holds no saved problem"):
        icp.load_problem(tmp_path)


def test_paths_that_do_not_fit_are_refused(tmp_path):
    icp.save_problem(problem_of("zero"), tmp_path / "folder")
    with pytest.raises(icp.FileError, match="drop q"):
        icp.load_problem(tmp_path / "folder", q="q.mtx")
    with pytest.raises(icp.FileError, match="needs its q"):
        icp.load_problem(tmp_path / "folder" / "A.mtx")
    with pytest.raises(icp.FileError, match=r"ends in \.npz"):
        icp.save_solution(problem_of("zero").solve(), tmp_path / "s.txt")
    with pytest.raises(icp.FileError, match="cannot be written"):
        icp.save_problem(problem_of("zero"), tmp_path / "no" / "such" / "p.npz")
    (tmp_path / "taken").write_text("")
    with pytest.raises(icp.FileError, match="cannot be written"):
        icp.save_problem(problem_of("zero"), tmp_path / "taken")


def test_an_interrupted_folder_is_no_mixture_of_two_problems(tmp_path, monkeypatch):
    folder = tmp_path / "problem"
    icp.save_problem(problem_of("constant", seed=1), folder)

    def press(self, data):
        raise KeyboardInterrupt

    monkeypatch.setattr(type(folder), "write_bytes", press)
    with pytest.raises(KeyboardInterrupt):
        icp.save_problem(problem_of("zero", seed=2), folder)
    with pytest.raises(icp.FileError, match=r"psi\.json: no such file"):
        icp.load_problem(folder)


@pytest.mark.skipif(os.name != "posix", reason="file modes and links")
def test_writing_again_keeps_the_mode_and_follows_a_link(tmp_path):
    real, link = tmp_path / "real.npz", tmp_path / "link.npz"
    icp.save_problem(problem_of("zero"), real)
    real.chmod(0o600)
    link.symlink_to(real)
    icp.save_problem(problem_of("affine"), link)
    assert link.is_symlink()
    assert real.stat().st_mode & 0o777 == 0o600
    assert isinstance(icp.load_problem(real).psi, icp.Affine)


def test_an_empty_path_is_refused():
    with pytest.raises(icp.FileError, match="path is empty"):
        icp.save_problem(problem_of("zero"), "")
