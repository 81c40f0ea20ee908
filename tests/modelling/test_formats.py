"""What NumPy, SciPy, MATLAB and spreadsheets write is read as it is, or refused by a sentence that names the file."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import scipy.io.matlab
import scipy.sparse as sp
from damaged import Trap, cut, mutated, read_or_refused
from hypothesis import given, settings
from known_answers import SEEDS
from scipy.io import loadmat, mmwrite, savemat

import icpmodel as icp
from icpmodel.modelling.matlab import read_variables
from icpmodel.numerics import work

A = np.array([[4.0, -1.0, 0.0, 0.0], [1.0, 3.0, 0.5, 0.0], [0.0, 0.0, 2.0, -0.25], [0.0, 0.1, 0.0, 1.0]])
Q, UPPER = np.array([1.0, -2.0, 3.0, -4.0]), np.array([1.0, np.inf, 2.0, 0.5])


def petsc_bytes(value, integer=">i4"):
    """What PETSc's MatView or VecView write to a binary viewer, by the manual page of MatLoad."""
    if value.ndim == 1:
        return np.array([1211214, value.size], integer).tobytes() + value.astype(">f8").tobytes()
    rows = sp.csr_array(value)
    integers = [1211216, *rows.shape, rows.nnz, *np.diff(rows.indptr), *rows.indices]
    return np.array(integers, integer).tobytes() + rows.data.astype(">f8").tobytes()


MATRICES = {
    "npy": lambda path, A: np.save(path, A),
    "in columns npy": lambda path, A: np.save(path, np.asfortranarray(A)),
    "csv": lambda path, A: np.savetxt(path, A, delimiter=",", fmt="%.17g"),
    "txt": lambda path, A: np.savetxt(path, A, fmt="%.17g"),
    "mtx": lambda path, A: mmwrite(path, A, precision=17, symmetry="general"),
    "bin": lambda path, A: path.write_bytes(petsc_bytes(A)),
    "64 bits bin": lambda path, A: path.write_bytes(petsc_bytes(A, ">i8")),
    "mat": lambda path, A: savemat(path, {"any_name": A}),
    "sparse mat": lambda path, A: savemat(path, {"A": sp.csc_array(A)}),
    "compressed mat": lambda path, A: savemat(path, {"A": sp.csc_array(A)}, do_compression=True),
    "savez npz": lambda path, A: np.savez(path, A=A),
    **{
        f"{form} npz": lambda path, A, form=form: sp.save_npz(path, sp.csr_array(A).asformat(form))
        for form in ("csr", "csc", "coo", "dia", "bsr")
    },
    "stored npz": lambda path, A: sp.save_npz(path, sp.bsr_array(A, blocksize=(2, 2)), compressed=False),
}
VECTORS = {
    "npy": lambda path, v: np.save(path, v),
    "csv": lambda path, v: np.savetxt(path, v, fmt="%.17g"),
    "row csv": lambda path, v: np.savetxt(path, v[None], delimiter=",", fmt="%.17g"),
    "mtx": lambda path, v: mmwrite(path, v[:, None], precision=17),
    "bin": lambda path, v: path.write_bytes(petsc_bytes(v)),
    "mat": lambda path, v: savemat(path, {"rhs": v}),
    "sparse mat": lambda path, v: savemat(path, {"rhs": sp.csc_array(v[:, None])}),
    "savez npz": lambda path, v: np.savez(path, rhs=v, q=v, psi=v, upper=v),
    "sparse npz": lambda path, v: sp.save_npz(path, sp.csr_array(v[:, None])),
}


def written(folder, name, kind, value, writers):
    """`value` in a file of this kind."""
    path = folder / f"{name}.{kind.split()[-1]}"
    writers[kind](path, value)
    return path


@pytest.mark.parametrize("kind", MATRICES)
@settings(max_examples=5)
@given(seed=SEEDS)
def test_a_matrix_comes_from_any_file_to_the_last_bit(tmp_path_factory, kind, seed):
    folder, rng = tmp_path_factory.mktemp("formats"), np.random.default_rng(seed)
    matrix = np.where(rng.random((4, 4)) < 0.5, rng.normal(size=(4, 4)), 0.0)
    path = written(folder, "A", kind, matrix, MATRICES)
    np.save(folder / "q.npy", Q)
    problem = icp.load_problem(path, q=folder / "q.npy")
    assert np.array_equal(problem.A.toarray(), matrix)
    assert np.array_equal(problem.q, Q)
    assert repr(problem.psi) == "Constant(0)"


@pytest.mark.parametrize("kind", VECTORS)
@settings(max_examples=5)
@given(seed=SEEDS)
def test_q_and_the_obstacles_come_from_any_file_to_the_last_bit(tmp_path_factory, kind, seed):
    folder, rng = tmp_path_factory.mktemp("formats"), np.random.default_rng(seed)
    np.save(folder / "A.npy", A)
    vectors = {"q": rng.normal(size=4), "psi": -rng.random(4), "upper": rng.random(4)}
    paths = {name: written(folder, name, kind, vector, VECTORS) for name, vector in vectors.items()}
    problem = icp.load_problem(folder / "A.npy", **paths)
    assert np.array_equal(problem.q, vectors["q"])
    assert np.array_equal(problem.psi.lower.value(Q), vectors["psi"])
    assert np.array_equal(problem.upper.value(Q), vectors["upper"])


@pytest.mark.parametrize("kind", ["mat", "compressed mat", "npz"])
def test_a_whole_problem_is_one_file_of_variables(tmp_path, kind):
    path = tmp_path / f"p.{kind.split()[-1]}"

    def write(**variables):
        if kind == "npz":
            np.savez_compressed(path, **variables)
        else:
            savemat(path, variables, do_compression=" " in kind)

    write(A=A, q=Q, psi=-0.5, upper=UPPER)
    problem = icp.load_problem(path)
    assert np.array_equal(problem.A.toarray(), A)
    assert problem.psi.lower.c.tolist() == [-0.5] * 4
    assert problem.upper.c.tolist() == UPPER.tolist()
    write(A=A, q=Q)
    assert repr(icp.load_problem(path)) == "ICP(n=4, nnz=9, psi=Constant(0))"
    assert repr(icp.load_problem(path, psi=-np.inf, upper=3)).endswith("psi=Constant(-inf), upper=Constant(3))")
    with pytest.raises(icp.FileError, match=r"p\..*: holds its own q; drop q"):
        icp.load_problem(path, q=path)
    write(A=A, q=Q, x=Q)
    with pytest.raises(icp.FileError, match=r"p\..*: holds A, q, x; A alone, or A, q, psi and upper"):
        icp.load_problem(path)
    write(A=np.array([[2.0]]), q=np.array([[-1.0]]), psi=np.array([[1.0]]))
    assert icp.load_problem(path).psi.c.tolist() == [1.0]


def content(path, folder):
    problem = icp.load_problem(path, q=folder / "q.npy")
    return problem.A.toarray().tolist()


@pytest.mark.parametrize(("field", "value"), [("shape", ["4", "4"]), ("indices", [9] * 9)])
def test_a_field_of_scipy_that_is_wrong_is_an_error_that_names_the_file(tmp_path, field, value):
    path = tmp_path / "A.npz"
    sp.save_npz(path, sp.csr_array(A))
    np.savez(path, **(dict(np.load(path)) | {field: np.array(value)}))
    with pytest.raises(icp.FileError, match=r"A\.npz: "):
        icp.load_problem(path, q=Q)


@pytest.mark.parametrize("kind", MATRICES)
def test_a_file_cut_after_any_byte_is_refused_and_never_read_wrongly(tmp_path, kind):
    matrix = A[:2, :2]
    path = written(tmp_path, "A", kind, matrix, MATRICES)
    np.save(tmp_path / "q.npy", Q[:2])
    assert content(path, tmp_path) == matrix.tolist()
    for changed in mutated(path, 1, 60):  # a digit for another one is another matrix, but nothing may break
        read_or_refused(content, changed, tmp_path)
    assert [found for part in cut(path) if (found := read_or_refused(content, part, tmp_path))] == []


#: files that MATLAB itself wrote, on machines of both orders of bytes, as far as SciPy is installed with its tests
BY_MATLAB = sorted(
    path
    for kind in ("double", "matrix", "minus", "multi", "sparse", "sparsefloat", "bool", "vec")
    for path in Path(scipy.io.matlab.__file__).parent.glob(f"tests/data/test{kind}_[67]*.mat")
)


@pytest.mark.skipif(not BY_MATLAB, reason="SciPy was installed without its test data")
def test_what_matlab_wrote_is_read_as_scipy_reads_it():
    for path in [*BY_MATLAB, BY_MATLAB[0].with_name("logical_sparse.mat")]:
        found, right = read_variables(path), loadmat(path, spmatrix=False)
        assert found.keys() == {name for name in right if not name.startswith("__")}
        for name, value in found.items():
            dense, expected = (one.toarray() if sp.issparse(one) else one for one in (value, right[name]))
            assert np.array_equal(np.atleast_2d(dense), expected)


@pytest.mark.parametrize(
    ("name", "write", "words"),
    [
        ("q.npy", lambda path: np.save(path, [1.0, np.nan, 0.0, 0.0]), r"q\.npy: q\[1\] is nan"),
        ("q.npy", lambda path: np.save(path, Q[:3]), r"q\.npy: q has shape \(3,\); shape \(4,\)"),
        ("q.csv", lambda path: path.write_text("1;2;3;4\n"), r"q\.csv: could not convert .*commas between"),
        ("q.csv", lambda path: path.write_text("1\n2\n3\n4"), r"q\.csv: its last line does not end"),
        ("q.mat", lambda path: savemat(path, {"a": Q, "b": Q}), r"q\.mat: holds a, b; q, or one thing only"),
        ("q.mat", lambda path: savemat(path, {"q": 1j * Q}), r"q\.mat: the variable q is complex"),
        ("q.mat", lambda path: savemat(path, {"q": Q}, format="4"), r"q\.mat: is no \.mat file of the versions 5 to 7"),
        ("q.mat", lambda path: path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM"), r"7\.3; save it with"),
        ("q.npz", lambda path: sp.save_npz(path, sp.csr_array((1, 10**9))), r"q\.npz: has the shape \(1, 1000000000\)"),
    ],
)
def test_what_is_wrong_with_q_is_said_of_its_file(tmp_path, name, write, words):
    np.save(tmp_path / "A.npy", A)
    write(tmp_path / name)
    with pytest.raises(icp.FileError, match=words) as error:
        icp.load_problem(tmp_path / "A.npy", q=tmp_path / name)
    assert "A.npy" not in str(error.value)


def test_objects_in_an_array_are_never_made(tmp_path):
    trap, sprung = np.array([Trap(tmp_path / "sprung")] * 4, dtype=object), tmp_path / "sprung"
    np.save(tmp_path / "A.npy", trap, allow_pickle=True)
    np.savez(tmp_path / "p.npz", A=trap, q=trap)
    for name in ("A.npy", "p.npz"):
        with pytest.raises(icp.FileError, match=f"{name}.*Object arrays"):
            icp.load_problem(tmp_path / name)
    assert not sprung.exists()


def matlab_element(kind, data):
    return struct.pack("<II", kind, len(data)) + data


@pytest.mark.parametrize("kind", ["npz", "mat"])
def test_what_unpacks_to_more_than_there_is_room_for_is_refused_before(tmp_path, kind):
    path, zeros = tmp_path / f"A.{kind}", np.zeros((2000, 2000))
    if kind == "npz":
        np.savez_compressed(path, A=zeros)
    else:
        head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM"
        path.write_bytes(head + matlab_element(15, zlib.compress(matlab_element(14, zeros.tobytes()))))
    assert path.stat().st_size < 100_000
    with work.work_limit(memory=1e6), pytest.raises(icp.FileError, match=r"A\..*GB of memory, more than is"):
        icp.load_problem(path, q="q.npy")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("coordinate real general\n3 3 4\n1 1 1.5\n2 2 2\n1 1 .5\n1 3 -1\n", [[2, 0, -1], [0, 2, 0], [0, 0, 0]]),
        ("coordinate real general\r\n% c\r\n\r\n1 1 1\r\n1 1 1e0\r\n\r\n", [[1]]),
        ("coordinate pattern symmetric\n2 2 2\n2 1\n1 1\n", [[1, 1], [1, 0]]),
        ("coordinate real skew-symmetric\n2 2 1\n2 1 3.5\n", [[0, -3.5], [3.5, 0]]),
        ("coordinate real general\n2 2 0\n", [[0, 0], [0, 0]]),
        ("array real symmetric\n3 3\n3\n1\n0\n4\n1\n5\n", [[3, 1, 0], [1, 4, 1], [0, 1, 5]]),
        ("array real skew-symmetric\n3 3\n1\n2\n3\n", [[0, -1, -2], [1, 0, -3], [2, 3, 0]]),
        ("array integer general\n% c\n2 2\n\n1\n2\n\n3\n4\n", [[1, 3], [2, 4]]),
    ],
)
def test_a_matrix_market_file_means_what_its_format_says(tmp_path, text, expected):
    path = tmp_path / "A.mtx"
    path.write_bytes(f"%%MatrixMarket matrix {text}".encode())
    np.save(tmp_path / "q.npy", Q[: len(expected)])
    assert content(path, tmp_path) == expected
