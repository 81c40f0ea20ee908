"""Problems on disk. Files are data: nothing is ever unpickled or evaluated.

What is saved is one `.npz` file, which other programs read with `numpy.load`: q, psi (zero, constant or affine), c, and
A as the CSR arrays A_data, A_indices and A_indptr, likewise G of an affine ψ, and where there is an obstacle above the
same of it: upper, upper_c and upper_G. The two forms have names of their own, so that nobody overlooks the upper one.
What other programs write is read as well: A, q, psi and upper in a file each, see `formats`, or together, by these
names, in a `.mat` file or one by `numpy.savez`; and a folder of Matrix Market files:

    folder/A.mtx        A
    folder/q.mtx        q, n × 1
    folder/psi.json     {"psi": "zero"} or {"psi": "constant"} or {"psi": "affine"}
    folder/c.mtx        c, n × 1      (constant and affine)
    folder/G.mtx        G             (affine)

and psi.json may have a second field, "upper": "constant" or "affine", with upper_c.mtx and upper_G.mtx. A file of c has
no infinite numbers: where an obstacle is missing in some rows take the `.npz` file. ψ given by Python code has no file
form.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import OBSTACLES, FileError, InputError, by_name
from ..icp import ICP
from ..present.whole_files import as_path, told
from ..problem.affine import Affine
from ..problem.between import Between
from ..problem.data import ProblemLike, as_problem
from .archive import Archive, read_archive, write_archive
from .formats import as_values, read_fields, read_named, read_values
from .matrix_market import read_matrix, read_vector

Source = str | PathLike[str]

_PROBLEM, _BETWEEN = "icpmodel problem 1", "icpmodel problem 2"
#: what the names of what is stored of an obstacle begin with
SIDES = {"psi": "", "upper": "upper_"}
#: the variables that a file of another program may hold
_PARTS = {"A", "q", *SIDES}
#: kind of an obstacle → what is stored of it
_KINDS: dict[str, tuple[str, ...]] = {"zero": (), "constant": ("c",), "affine": ("c", "G")}


def save_problem(problem: ProblemLike, path: str | PathLike[str]) -> None:
    """Write `problem` to the `.npz` file `path`; other programs may take `scipy.io.mmwrite("A.mtx", problem.A)`.

    Both obstacles must be zero, constant or affine. The file is written beside and then renamed, so that whatever
    happens the old file or the new one is there, whole; only a file that holds a saved problem is replaced, and links
    are not followed. Raises InputError for any other ψ, FileError where the path cannot be written.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_problem(ICP([[2.0]], [-1.0], psi=3.0), f"{folder}/p.npz")
    ...     load_problem(f"{folder}/p.npz")
    ICP(n=1, nnz=1, psi=Constant(3))
    """
    arrays = problem_fields(problem)
    kind, other = (_BETWEEN, _PROBLEM) if "upper" in arrays else (_PROBLEM, _BETWEEN)
    write_archive(as_path(path), kind, arrays, other)


@by_name("load_problem", OBSTACLES)
def load_problem(
    path: Source, q: Source | None = None, psi: Source | float | None = None, upper: Source | float | None = None
) -> ICP:
    """Read a problem from one file or folder, or from files of A, q and the obstacles.

    Parameters: `path` an `.npz` file by `save_problem`, a folder of Matrix Market files, or a `.mat` file (-v6, -v7)
    or one by `numpy.savez` with the variables A, q, psi and upper, of which the last two may be missing; or a
    file of A alone: `.npy`, `.npz` by `scipy.sparse.save_npz`, `.mat`, `.mtx`, `.bin` by PETSc, `.csv` or `.txt`
    (numbers with commas, or spaces, between, no heads). `q`, `psi`, `upper` files of what `path` does not hold, of n
    numbers each, of the obstacles also a number; without `psi` it is 0, without `upper` there is none. In a file of
    several variables each is found by its name.
    A `.mat` file that is cut where a variable ends is whole to every reader: look at what is printed of the problem.
    Raises FileError, which names the file, the field and what was expected.

    >>> load_problem("A.npy", q="q.csv", psi=-1.0)
    Traceback (most recent call last):
    icpmodel.errors.FileError: A.npy: no such file or folder
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     np.save(f"{folder}/A.npy", np.eye(2))
    ...     np.savetxt(f"{folder}/q.csv", [-1.0, 3.0])
    ...     load_problem(f"{folder}/A.npy", q=f"{folder}/q.csv", psi=-1.0)
    ICP(n=2, nnz=2, psi=Constant(-1))
    """
    path = as_path(path)
    with told(path, "read"):
        path.stat()
        is_folder = path.is_dir()
    parts = _from_folder(path) if is_folder else _from_file(path)
    sources = dict.fromkeys(parts, path)
    problem = _of_A(path, parts["A"])
    for name, given in {"q": q, "psi": psi, "upper": upper}.items():
        if given is not None and name in parts:
            raise FileError(f"{path}: holds its own {name}; drop {name}")
        if isinstance(given, Real) and not isinstance(given, bool) and name in SIDES:
            parts[name] = float(given)
        elif given is not None:
            sources[name] = as_path(given, name)
            parts[name] = read_values(sources[name], name, problem.n)
        elif name in parts and not isinstance(parts[name], str):
            parts[name] = as_values(path, parts[name], problem.n)
    if "q" not in parts:
        raise FileError(f"{path}: holds A alone; a problem needs its q as well, in a file of its own")
    return _complete(problem, parts, sources)


def stored_problem(archive: Archive) -> ICP:
    """The problem whose `problem_fields` are among those of `archive`, and the names of its obstacles in the field
    sides."""
    parts = _stored_parts(archive, archive.text("sides").split())
    return _complete(_of_A(archive.path, parts["A"]), parts, dict.fromkeys(parts, archive.path))


def _stored_parts(archive: Archive, sides: Iterable[str]) -> dict[str, Any]:
    q = archive.vector("q")
    parts: dict[str, Any] = {"q": q, "A": archive.matrix("A", q.size)}
    for side in (side for side in SIDES if side in sides):
        parts[side] = archive.text(side)
        for name in _stored(archive.path, side, parts[side]):
            read = archive.matrix if name == "G" else archive.vector
            parts[SIDES[side] + name] = read(SIDES[side] + name, q.size)
    return parts


def problem_fields(problem: ProblemLike) -> dict[str, Any]:
    """The arrays that are stored of `problem`. Raises InputError where ψ has no file form."""
    problem = as_problem(problem)
    psi = problem.psi
    sides = {"psi": psi} if not isinstance(psi, Between) else {"psi": psi.lower, "upper": psi.upper}
    arrays: dict[str, Any] = _fields("A", problem.A) | {"q": problem.q}
    for side, one in sides.items():
        if one.linear is None:
            raise InputError(f"{side} is {one!r}; only zero, constant and affine maps can be written to a file")
        G, c = one.linear
        kind = "affine" if not one.is_constant else "constant" if c.any() else "zero"
        arrays[side] = np.array(kind)
        for name in _KINDS[kind]:
            arrays |= _fields(SIDES[side] + name, G if name == "G" else c)
    return arrays


def _of_A(path: Path, A: Any) -> ICP:
    """The problem of `A` with q = 0 and ψ = 0."""
    try:
        return ICP(A, np.zeros(A.shape[0] if A.ndim else 1))
    except InputError as error:
        raise FileError(f"{path}: {error}") from error


def _complete(problem: ICP, parts: dict[str, Any], sources: dict[str, Path]) -> ICP:
    """The `problem`, of which A is known, with the other parts; an error names the source of the part that is wrong."""
    for name in ("q", *(side for side in SIDES if side in parts)):
        try:
            if name == "q":
                problem = problem.with_q(np.atleast_1d(parts["q"]))
                continue
            prefix = SIDES[name]
            c = parts.get(f"{prefix}c", 0.0) if isinstance(parts[name], str) else parts[name]
            side = Affine(parts[f"{prefix}G"], c) if f"{prefix}G" in parts else c
            problem = problem.with_psi(side) if name == "psi" else problem.with_upper(side)
        except InputError as error:
            if name not in sources:
                raise
            raise FileError(f"{sources[name]}: {error}") from error
    return problem


def _from_file(path: Path) -> dict[str, Any]:
    """The parts of a problem that a file holds, A at least, by `save_problem` or by another program."""
    if path.suffix.lower() == ".npz":
        with read_archive(path) as archive:
            if archive.is_ours:
                archive.check(_PROBLEM, _BETWEEN)
                return _stored_parts(archive, SIDES if archive.text("format") == _BETWEEN else ("psi",))
            parts = read_fields(archive)
    else:
        parts = read_named(path)
    if len(parts) == 1 and parts.keys() != {"q"}:
        return {"A": next(iter(parts.values()))}
    if "A" not in parts or not parts.keys() <= _PARTS:
        found = ", ".join(parts) or "nothing"
        raise FileError(f"{path}: holds {found}; A alone, or A, q, psi and upper by these names, were expected")
    return parts


def _from_folder(path: Path) -> dict[str, Any]:
    content, files = folder_files(path)
    A = read_matrix(files.pop("A"))
    read = {"A": A}
    for name, file in files.items():
        read[name] = read_matrix(file) if name.endswith("G") else read_vector(file, A.shape[0])
    return read | content


def folder_files(path: Path) -> tuple[dict[str, str], dict[str, Path]]:
    """What a folder of Matrix Market files declares of the obstacles, and name → the file of what it holds. Raises
    FileError."""
    declared = path / "psi.json"
    if not declared.is_file():
        if not (path / "A.mtx").is_file():
            raise FileError(f"{path}: the folder holds no problem; psi.json, A.mtx and q.mtx were expected")
        raise FileError(f'{declared}: no such file; it declares psi, for an LCP as {{"psi": "zero"}}')
    with told(declared, "read"):
        content = as_json(declared, declared.read_text(encoding="utf-8"))
    if not isinstance(content, dict) or content.keys() not in ({"psi"}, {"psi", "upper"}):
        found = f"holds the fields {', '.join(content) or 'none'}" if isinstance(content, dict) else "holds no object"
        wanted = "the field psi alone was expected, or psi and upper"
        raise FileError(f'{declared}: {found}; {wanted}, for an LCP {{"psi": "zero"}}')
    stored = [SIDES[side] + name for side, kind in content.items() for name in _stored(declared, side, kind)]
    return content, {name: path / f"{name}.mtx" for name in ("A", "q", *stored)}


def _fields(name: str, part: Any) -> dict[str, Any]:
    """`part`, an array or a CSR matrix, as the arrays that are stored of it."""
    if not sp.issparse(part):
        return {name: part}
    return {f"{name}_data": part.data, f"{name}_indices": part.indices, f"{name}_indptr": part.indptr}


def _stored(path: Path, side: str, kind: Any) -> tuple[str, ...]:
    if not isinstance(kind, str) or kind not in _KINDS:
        raise FileError(f"{path}: field {side} is {kind!r}; one of {', '.join(_KINDS)} was expected")
    return _KINDS[kind]


def as_json(where: str | Path, text: str) -> Any:
    """What the JSON `text` says. Raises FileError."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileError(f"{where}: is not JSON ({error})") from error
