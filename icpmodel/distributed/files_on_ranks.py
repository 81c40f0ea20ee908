"""Problems and answers on disk: PETSc's binary files, of which each rank reads and writes its part, and others."""

from __future__ import annotations

import os
from contextlib import ExitStack, suppress
from os import PathLike
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..errors import FileError, InputError, NotApplicable, check_arguments
from ..modelling.archive import content_errors
from ..modelling.files import is_number
from ..modelling.files import load_problem as load_whole
from ..modelling.formats import read_values
from ..modelling.petsc_binary import PetscFile
from ..numerics.arrays import Vector, as_vector, described
from ..present.whole_files import as_path, check_replaceable, check_suffix, file_errors, part_of, put_in_place
from .distributed_icp import DistributedICP, distribute
from .distributed_matrix import from_rows
from .distributed_solution import DistributedSolution
from .ranks import petsc, together, world

Source = str | PathLike[str]
#: the formats of an answer: PETSc's own, and HDF5
WRITABLE_SUFFIXES = (".bin", ".h5")
#: the number that stands for no obstacle
_INFINITE = {"psi": -np.inf, "upper": np.inf}
#: the most bytes of a file besides the numbers themselves
_MAX_HEADER_BYTES = 65_536


@check_arguments
def load_problem(
    path: Source,
    q: Source | None = None,
    psi: Source | float | None = None,
    upper: Source | float | None = None,
    comm: Any = None,
) -> DistributedICP:
    """Read a problem from files: each rank reads its rows of PETSc's binary files, rank 0 all other files.

    Parameters
    ----------
    path : str or path
        A file of A, or of the whole problem, as `icpmodel.load_problem` takes it.
    q : str or path, optional
        A file of n numbers, where `path` does not hold them.
    psi, upper : str, path or float, optional
        A file of the obstacle, or a number. Without `psi` it is 0; without `upper` there is no
        upper obstacle.
    comm : optional
        A communicator of mpi4py or petsc4py, by default that of all ranks.

    Returns
    -------
    DistributedICP
        The problem.

    Raises
    ------
    FileError
        On all ranks; the message names the file and what was expected.

    Notes
    -----
    A `.bin` file is what PETSc's `MatView` or `VecView` writes to a binary viewer: one real matrix
    (aij) or vector in double precision, with integers of 32 or 64 bits. All ranks must see it; none
    holds all of it. Rank 0 reads all other files, and sends each rank its rows.

    Examples
    --------
    >>> import scipy.io, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     scipy.io.mmwrite(f"{folder}/A.mtx", sp.eye_array(3))
    ...     scipy.io.mmwrite(f"{folder}/q.mtx", np.ones((3, 1)))
    ...     icp.distributed.load_problem(f"{folder}/A.mtx", q=f"{folder}/q.mtx", upper=2.0)
    DistributedICP(n=3, ranks=1)
    """
    comm = world(comm)
    problem = None
    with together(comm):
        place = as_path(path)
        parted = _is_read_in_parts(place)
        if parted and q is None:
            raise FileError(f"{place}: has no q, which the problem needs, here or in another file")
        if not parted and comm.rank == 0:
            problem = load_whole(path, q, psi, upper)
    if not parted:
        return distribute(problem, comm)
    A = _matrix_in(place, comm)
    assert q is not None
    own_q = vector_in(q, A, "q")
    sides = [_side_in(psi, A, "psi"), _side_in(upper, A, "upper")]
    with content_errors(place):  # the same one on all ranks
        return DistributedICP(A, own_q, 0.0 if sides[0] is None else sides[0], sides[1])


def _side_in(source: Any, mat: Any, name: str) -> Any:
    """An obstacle: a number or None as it is, or the own entries of a file. Collective. Raises FileError."""
    return source if source is None or is_number(source) else vector_in(source, mat, name)


def _is_read_in_parts(path: Path) -> bool:
    return path.suffix.lower() == ".bin"


def _matrix_in(path: Path, comm: Any) -> Any:
    """The `Mat`, n × n, in the binary file `path`. Collective. Raises FileError on all ranks."""
    with together(comm):
        file = PetscFile(path, comm.size)
        if not file.is_matrix or file.rows != file.columns or not file.rows:
            actual = f"a matrix of shape ({file.rows}, {file.columns})" if file.is_matrix else "a vector"
            raise FileError(f"{path}: holds {actual}; a square matrix was expected")
    seen = file.rows, file.size
    first = comm.bcast(seen)
    with together(comm):
        if seen != first:
            raise FileError(f"{path}: is not the same file as on rank 0; one that all ranks see was expected")
    low, high = petsc().Vec().createMPI(file.rows, comm=comm).getOwnershipRange()
    with together(comm):
        rows = file.matrix(low, high)
    return from_rows(rows, comm)


def vector_in(source: Source, mat: Any, name: str) -> Vector:
    """Read the own entries of the vector `name` from a file; its rows are distributed as those of `mat`.

    Collective. Raises FileError on all ranks.

    Parameters
    ----------
    source : str or path
        The file: each rank reads its rows of a `.bin` file, rank 0 all rows of another one.
    mat : Mat
        The matrix whose rows have these entries.
    name : str
        What the vector is called, in messages and in files of several variables.

    Returns
    -------
    array
        The own entries.
    """
    low, high = mat.getOwnershipRange()
    n = mat.getSize()[0]
    comm = mat.comm.tompi4py()
    ends = comm.gather(high)
    with together(comm):
        path = as_path(source, name)
        parted = _is_read_in_parts(path)
        own = np.empty(0)
        if parted:
            file = PetscFile(path, comm.size)
            if file.is_matrix or file.rows != n:
                actual = f"a matrix with {file.rows} rows" if file.is_matrix else f"a vector of {file.rows} numbers"
                raise FileError(f"{path}: holds {actual}; a vector of {n} numbers was expected")
            own = file.vector(low, high)
            finite = np.isfinite(own) | (own == _INFINITE.get(name, 0.0))
            if not finite.all():
                i = int(np.argmin(finite))
                raise FileError(f"{path}: {name}[{low + i}] is {own[i]}; a finite number was expected")
        elif comm.rank == 0:
            with content_errors(path):
                own = as_vector(read_values(path, name, n), n, name, infinite=_INFINITE.get(name))
    return own if parted else comm.scatter(np.split(own, ends[:-1]) if comm.rank == 0 else None)


@check_arguments
def save_solution(solution: DistributedSolution, path: Source) -> None:
    """Write the answer to the file `path`, which all ranks see; each rank writes its rows.

    Every rank calls it at the same time.

    Parameters
    ----------
    solution : DistributedSolution
        The answer.
    path : str or path
        The suffix decides on the format, `.bin` or `.h5`.

    Raises
    ------
    InputError
        For an object that is no solution.
    FileError
        On all ranks, where the path cannot be written.
    NotApplicable
        For `.h5` where PETSc has no HDF5.

    Notes
    -----
    `.bin` has z, as PETSc's `VecView` writes it to a binary viewer. `Vec.load` reads it, and so
    does `icpmodel` wherever it takes a vector, such as `--z0`. NumPy reads it by
    `numpy.fromfile(path, ">f8", offset=8)`; where PETSc's integers have 64 bits the head takes 16
    bytes. `.h5` has z, p and r as vectors of these names in HDF5, where PETSc has it:
    `h5py.File(path)["z"][:]`. Numbers have double precision.

    The file is written under another name, read again, compared, and then renamed. So either the old
    file or the new one is there, complete. An old file is replaced only if it is a PETSc vector, not
    if it is HDF5. Links are not followed.

    Examples
    --------
    >>> import tempfile
    >>> solution = icp.distributed.solve(icp.distributed.distribute(ICP([[2.0]], [-1.0])))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     icp.distributed.save_solution(solution, f"{folder}/z.bin")
    ...     np.fromfile(f"{folder}/z.bin", ">f8", offset=8)
    array([0.5], dtype='>f8')
    """
    if not isinstance(solution, DistributedSolution):
        raise InputError(f"solution is {described(solution)}; what icpmodel.distributed.solve returns was expected")
    problem = solution.problem
    check_place_on_ranks(path, problem.comm)
    path = as_path(path)
    vectors = {"z": solution.z}
    if path.suffix.lower() == ".h5":
        p, r, _ = problem.sides(solution.z)
        vectors |= {"p": problem.vector(p), "r": problem.vector(r)}
    _write(path, vectors, problem.comm)


def check_place_on_ranks(path: Source, comm: Any) -> None:
    """Raise FileError now, on all ranks, where `save_solution` would refuse the path later. Collective.

    It refuses another suffix, and a file there that it does not replace. Raises NotApplicable without HDF5.
    """
    with together(comm):
        place = as_path(path)
        check_suffix(place, WRITABLE_SUFFIXES)
        if place.suffix.lower() == ".h5" and not petsc().Sys.hasExternalPackage("hdf5"):
            raise NotApplicable(f"{place}: this PETSc was built without HDF5; a name that ends in .bin is written")
        if comm.rank == 0:
            with file_errors(place, "written"):
                check_replaceable(place, lambda: _check_vector(place))


def _check_vector(path: Path) -> None:
    if path.suffix.lower() == ".h5":
        raise FileError(f"{path}: files of HDF5 are not replaced")
    if PetscFile(path).is_matrix:
        raise FileError(f"{path}: holds a matrix")


def _write(path: Path, vectors: dict[str, Any], comm: Any) -> None:
    """Write `vectors` to a temporary file, which then replaces `path`. Collective. Raises FileError on all ranks."""
    file: BinaryIO | None = None
    with ExitStack() as stack:
        with together(comm), file_errors(path, "written"), ExitStack() as begun:
            if comm.rank == 0:
                file = begun.enter_context(part_of(path))
                begun.callback(Path(f"{file.name}.info").unlink, missing_ok=True)  # PETSc writes it, too
                size = sum(8 * vector.getSize() for vector in vectors.values())
                _check_free_space(file, size + _MAX_HEADER_BYTES)
            stack.push(begun.pop_all())
        beside = comm.bcast(file and Path(file.name))
        hdf5 = path.suffix.lower() == ".h5"
        fault = _view(beside, hdf5, "w", vectors, comm)
        copies = {name: vector.duplicate() for name, vector in vectors.items()}
        fault = fault or _view(beside, hdf5, "r", copies, comm)
        # MPI reports no error when a disk is full
        same = all(np.array_equal(copies[name].array_r, one.array_r, equal_nan=True) for name, one in vectors.items())
        written = not any(comm.allgather(bool(fault) or not same))
        with together(comm), file_errors(path, "written"), stack:  # no rank goes on before its files are removed
            if not written:
                raise FileError(f"{path}: cannot be written ({fault or 'what was written is not what is read'})")
            if file is not None:
                put_in_place(file, path)


def _check_free_space(file: BinaryIO, size: int) -> None:
    """Raise OSError now where there is no room for `size` bytes.

    Later, while ranks write, one may wait for ever for another one that has failed.
    """
    if hasattr(os, "posix_fallocate"):  # not on macOS
        os.posix_fallocate(file.fileno(), 0, size)
        file.truncate(0)


def _view(path: Path, hdf5: bool, mode: str, vectors: dict[str, Any], comm: Any) -> str:
    """Write or read the vectors by PETSc and MPI; return the error, or "" if there is none. Collective."""
    PETSc = petsc()
    viewer = PETSc.Viewer()
    try:
        (viewer.createHDF5 if hdf5 else viewer.createMPIIO)(str(path), mode, comm=comm)
        for name, vector in vectors.items():
            vector.setName(name)
            vector.view(viewer) if mode == "w" else vector.load(viewer)
        viewer.destroy()
    except PETSc.Error as error:
        with suppress(PETSc.Error):
            viewer.destroy()
        return str(error).splitlines()[-1]
    return ""
