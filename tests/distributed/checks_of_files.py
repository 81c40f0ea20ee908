"""What holds of files on any number of ranks: checks that `checks_on_ranks.py` runs."""

import contextlib
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
from icpmodel.distributed.files_on_ranks import vector_in


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


def view(there, comm=COMM, **parts):
    """Have PETSc write matrices and vectors, each to a file of its name, and return the files."""
    for name, part in parts.items():
        part.view(PETSc.Viewer().createBinary(str(there / f"{name}.bin"), "w", comm=comm))
    COMM.barrier()
    return [there / f"{name}.bin" for name in parts]


def check_a_rank_takes_the_memory_of_its_part():
    problem = distribute(icp.scenes.membrane(n=10_000).problem)
    with folder() as there:
        files = view(there, A=problem.A, q=problem.vector(problem.q))
        peaks = []
        for comm in (MPI.COMM_SELF, COMM):
            tracemalloc.start()
            load_problem(*files, comm=comm)
            peaks.append(tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
        # what a library loads at its first use is not less for less rows
        assert peaks[1] < 1.1 * peaks[0] / COMM.size + 2e5, peaks


def check_files_are_read_on_ranks_as_by_one_process():
    with folder() as there:
        one = there / "p.npz"
        for problem in (transport(), coupled(), between()):
            if COMM.rank == 0:
                icp.save_problem(problem, one)
            COMM.barrier()
            found = load_problem(one)
            assert_same(found, problem)
            assert np.allclose(whole(solve(found).z), problem.solve().z, atol=NEAR)
        problem = distribute(transport())
        A, q = view(there, A=problem.A, q=problem.vector(problem.q))
        put(there / "q.mtx", transport().q)
        for found in (load_problem(A, q), load_problem(A, there / "q.mtx"), distribute(icp.load_problem(A, q))):
            assert_same(found, transport())
        sides = {"psi": np.int64(-1), "upper": np.float32(0.5)}
        found = load_problem(A, q, **sides)
        fixed = all(one.is_fixed for one in found.maps)
        right = fixed and found.upper.fixed().tolist() == [0.5] * (found.high - found.low)
        assert all(COMM.allgather(right))


def check_a_file_that_is_cut_or_changed_is_read_by_ranks_only_as_by_one_process():
    small, read = icp.scenes.membrane(n=9).problem, 0
    with folder() as there:
        q, path = there / "q.mtx", there / "A.bin"
        put(q, small.q)
        view(there, A=distribute(small).A)
        content = path.read_bytes()
        random = np.random.default_rng(7)
        damaged = [content[:cut] for cut in random.integers(0, len(content), 16)]
        for place, byte in zip(random.integers(0, len(content), 60), random.integers(0, 256, 60), strict=True):
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
        put(there / "long.mtx", np.ones(4))
        assert "has no q" in raised(load_problem, A)
        assert "no such file" in raised(load_problem, there / "B.mtx", q)
        assert "no such file" in raised(load_problem, A, there / "p.mtx")
        assert "q.mtx: A has shape (3, 1)" in raised(load_problem, q, q)
        assert "inf.mtx: q[1] is inf" in raised(load_problem, A, there / "inf.mtx")
        (parted,) = view(there, A=distribute(icp.load_problem(A, q)).A)
        assert "has no q" in raised(load_problem, parted)
        assert "inf.mtx: q[1] is inf" in raised(load_problem, parted, there / "inf.mtx")
        assert "q has shape (4,)" in raised(load_problem, parted, there / "long.mtx")
        assert "holds a matrix with 3 rows" in raised(load_problem, parted, parted)
        assert "psi is True" in raised(load_problem, parted, q, True)
        problem = load_problem(parted, q)
        (nan,) = view(there, nan=problem.vector(np.full(problem.high - problem.low, np.nan)))
        assert "nan.bin: z0[0] is nan" in raised(vector_in, nan, problem.A, "z0")
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
        again = problem.vector(vector_in(there / "z.bin", problem.A, "z0"))
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
