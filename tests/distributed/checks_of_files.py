"""What holds of files on any number of ranks: checks that `checks_on_ranks.py` runs."""

import contextlib
import json
import resource
import tempfile
import tracemalloc
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from mpi4py import MPI
from petsc4py import PETSc
from ranked_problems import COMM, NEAR, between, coupled, raised, transport, whole
from scipy.io import mmwrite

import icpmodel as icp
from icpmodel.distributed import distribute, load_problem, save_solution, solve
from icpmodel.distributed.files_on_ranks import start_in


@contextlib.contextmanager
def folder():
    """A new one that all ranks see."""
    with tempfile.TemporaryDirectory() if COMM.rank == 0 else contextlib.nullcontext() as made:
        yield Path(COMM.bcast(made))
        COMM.barrier()


def put(path, content, **more):
    """Have rank 0 write bytes, or a matrix or vector as a Matrix Market file, while the others wait."""
    COMM.barrier()
    if COMM.rank == 0:
        if isinstance(content, bytes):
            path.write_bytes(content)
        else:
            mmwrite(path, content if sp.issparse(content) else np.reshape(content, (-1, 1)), precision=17, **more)
    COMM.barrier()


def own(mat):
    """The rows of a `Mat` on this rank."""
    indptr, indices, data = mat.getValuesCSR()
    return sp.csr_array((data, indices, indptr), shape=(indptr.size - 1, mat.getSize()[1]))


def assert_same(found, problem):
    assert found.n == problem.n
    assert not abs(own(found.A) - problem.A[found.low : found.high]).sum()
    assert np.array_equal(found.q, problem.q[found.low : found.high])


#: bodies of Matrix Market files of one matrix and one vector each, and q
SMALL = {
    "twice": (
        "coordinate real general\n3 3 5\n1 1 1.5\n2 2 2\n3 3 1\n1 1 .5\n1 3 -1\n",
        "array real general\n3 1\n1\n2\n3\n",
    ),
    "lines": (
        "coordinate real general\r\n% a comment\r\n\r\n3 3 3\r\n1 1 1\r\n\r\n2 2 1\r\n3 3 1e0\r\n\r\n",
        "array real general\n% c\n3 1\n\n-1\n2\n\n3\n",
    ),
    "pattern": ("coordinate pattern symmetric\n2 2 3\n2 1\n1 1\n2 2\n", "coordinate integer general\n2 1 1\n2 1 7\n"),
    "skew": (
        "array real skew-symmetric\n4 4\n1\n2\n3\n4\n5\n6\n",
        "coordinate real general\n1 4 3\n1 4 1\n1 1 2\n1 4 1\n",
    ),
    "dense": ("array real symmetric\n3 3\n3\n1\n0\n3\n1\n3\n", "array real general\n1 3\n-1\n-2\n-3\n"),
    "one": ("array real general\n1 1\n2\n", "array real general\n1 1\n-1\n"),
}


def check_a_matrix_market_file_is_read_in_parts_as_one_process_reads_it():
    with folder() as there:
        A, q = there / "A.mtx", there / "q.mtx"
        for texts in SMALL.values():
            for path, text in zip((A, q), texts, strict=True):
                put(path, f"%%MatrixMarket matrix {text}".encode())
            assert_same(load_problem(A, q), icp.load_problem(A, q))
        for problem, symmetry in ((coupled(), "symmetric"), (transport(), "general")):
            put(A, problem.A, symmetry=symmetry), put(q, problem.q)
            assert_same(load_problem(A, q), problem)


def check_a_rank_takes_the_memory_of_its_part():
    problem = icp.scenes.membrane(n=10_000).problem
    with folder() as there:
        files = there / "A.mtx", there / "q.mtx"
        for path, part in zip(files, (problem.A, problem.q), strict=True):
            put(path, part)
        peaks = []
        for comm in (MPI.COMM_SELF, COMM):
            tracemalloc.start()
            load_problem(*files, comm=comm)
            peaks.append(tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
        # what is read ahead of a file, and what a library loads at its first use, is not less for less rows
        assert peaks[1] < 1.1 * peaks[0] / COMM.size + 2e5, peaks


def check_a_folder_is_the_problem_that_one_process_reads():
    two = {"psi": "constant", "upper": "constant"}
    with folder() as there:
        for problem, declared in ((coupled(), {"psi": "affine"}), (between(), two)):
            parts = {"A": problem.A, "q": problem.q, "c": problem.psi.value(np.zeros(problem.n))}
            parts |= {"G": problem.psi.G} if declared is not two else {"upper_c": problem.psi.upper.value(problem.q)}
            for name, part in parts.items():
                put(there / f"{name}.mtx", part)
            put(there / "psi.json", json.dumps(declared).encode())
            found = load_problem(there)
            assert_same(found, problem)
            assert np.allclose(whole(solve(found).z), icp.load_problem(there).solve().z, atol=NEAR)


def check_files_of_petsc_are_read_on_ranks_and_by_one_process():
    problem = distribute(transport())
    with folder() as there:
        for part, name in ((problem.A, "A.bin"), (problem.vector(problem.q), "q.bin")):
            part.view(PETSc.Viewer().createBinary(str(there / name), "w", comm=COMM))
        COMM.barrier()
        for found in (
            load_problem(there / "A.bin", there / "q.bin"),
            icp.load_problem(there / "A.bin", there / "q.bin"),
        ):
            assert_same(distribute(found) if isinstance(found, icp.ICP) else found, transport())


def check_a_file_that_is_cut_or_changed_is_read_by_ranks_only_as_by_one_process():
    small, read = icp.scenes.membrane(n=9).problem, 0
    A = PETSc.Mat().createAIJ((9, 9), csr=(small.A.indptr, small.A.indices, small.A.data), comm=PETSc.COMM_SELF)
    A.assemble()
    with folder() as there:
        q = there / "q.mtx"
        put(there / "A.mtx", small.A, symmetry="general"), put(q, small.q)
        if COMM.rank == 0:
            A.view(PETSc.Viewer().createBinary(str(there / "A.bin"), "w", comm=PETSc.COMM_SELF))
        COMM.barrier()
        for path in (there / "A.mtx", there / "A.bin"):
            content = path.read_bytes()
            random = np.random.default_rng(7)
            damaged = [content[:cut] for cut in random.integers(0, len(content), 8)]
            for place, byte in zip(random.integers(0, len(content), 30), random.integers(0, 256, 30), strict=True):
                damaged.append(content[:place] + bytes([byte]) + content[place + 1 :])
            for one in damaged:
                put(path, one)
                try:
                    expected = icp.load_problem(path, q)
                except icp.FileError:
                    assert "FileError" in raised(load_problem, path, q), one
                else:
                    assert_same(load_problem(path, q), expected)
                    read += 1
    assert 0 < read < 60, read


def check_what_is_wrong_with_files_is_one_error_of_all_ranks():
    with folder() as there:
        A, q, z = there / "A.mtx", there / "q.mtx", there / "z.bin"
        put(A, sp.eye_array(3)), put(q, np.ones(3)), put(there / "inf.mtx", [1.0, np.inf, 2.0])
        assert "A alone" in raised(load_problem, A)
        assert "no such file" in raised(load_problem, there / "B.mtx", q)
        assert "no such file" in raised(load_problem, A, there / "p.mtx")
        assert "q.mtx: the matrix has shape (3, 1)" in raised(load_problem, q, q)
        assert "is 3 x 3; a vector of 3" in raised(load_problem, A, A)
        assert "A.mtx: q[1] is inf" in raised(load_problem, A, there / "inf.mtx")
        assert "distribute" in raised(load_problem, there / "A.mtx", "q.npy")
        assert "obstacles cross" in raised(load_problem, A, q, 1.0, 0.0)
        solution = solve(load_problem(A, q))
        save_solution(solution, z)
        assert "holds a vector" in raised(load_problem, z, q)
        assert "ends in .bin or .h5" in raised(save_solution, solution, there / "z.npz")
        assert "InputError" in raised(save_solution, solution.z, z)


def check_the_answer_is_read_by_numpy_petsc_and_one_process_and_is_a_start():
    problem = distribute(between())
    solution = solve(problem)
    z = whole(solution.z)
    with folder() as there:
        for _ in range(2):  # an older answer is replaced
            save_solution(solution, there / "z.bin")
        assert {path.name for path in there.iterdir()} == {"z.bin"}
        assert np.array_equal(np.fromfile(there / "z.bin", ">f8", offset=8), z)
        put(there / "A.mtx", sp.eye_array(z.size))
        assert np.array_equal(icp.load_problem(there / "A.mtx", there / "z.bin").q, z)
        again = start_in(there / "z.bin", problem)
        assert np.array_equal(again.array, solution.z.array)
        assert solve(problem, z0=again).iterations == 0
        if not PETSc.Sys.hasExternalPackage("hdf5"):
            return
        save_solution(solution, there / "z.h5")
        p, r, _ = problem.sides(solution.z)
        for name, expected in (("z", solution.z.array), ("p", p), ("r", r)):
            read = problem.vector()
            read.setName(name)
            read.load(PETSc.Viewer().createHDF5(str(there / "z.h5"), "r", comm=COMM))
            assert np.array_equal(read.array, expected)


def check_a_write_that_fails_leaves_what_was_there_and_nothing_beside():
    solution = solve(distribute(transport()))
    with folder() as there:
        old, text, link = there / "old.bin", there / "text.bin", there / "link.bin"
        save_solution(solution, old)
        put(text, b"a letter")
        if COMM.rank == 0:
            link.symlink_to(old)
        COMM.barrier()
        before = {path.name: path.read_bytes() for path in there.iterdir()}
        limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
        try:
            for name in ("old.bin", "new.bin", *(["new.h5"] if PETSc.Sys.hasExternalPackage("hdf5") else [])):
                assert "cannot be written" in raised(save_solution, solution, there / name)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert "is in the way" in raised(save_solution, solution, text)
        assert "symbolic link" in raised(save_solution, solution, link)
        assert "does not exist" in raised(save_solution, solution, there / "none" / "z.bin")
        assert {path.name: path.read_bytes() for path in there.iterdir()} == before
