"""Problems and solutions on disk. Files are data: nothing is ever unpickled or evaluated.

What is saved is one `.npz` file, which other programs read with `numpy.load`: of a problem q, psi (zero, constant or
affine), c, and A as the CSR arrays A_data, A_indices and A_indptr, likewise G of an affine ψ, and where there is an
obstacle above the same of it: upper, upper_c and upper_G; of a solution z, p, r and its certificate as JSON text. The
two forms of problems have names of their own, so that nobody overlooks the upper one. A problem can also be read from
Matrix Market files, as other programs write them:

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
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import FileError, InputError
from ..icp import ICP
from ..problem.affine import Affine
from ..problem.between import Between
from ..problem.data import ProblemLike, as_problem
from ..solve.solution import Solution
from .archive import as_path, check_free, read_archive, told, write_archive
from .matrix_market import read_matrix, read_vector

_PROBLEM, _BETWEEN, _SOLUTION = "icpmodel problem 1", "icpmodel problem 2", "icpmodel solution 1"
#: what the names of what is stored of an obstacle begin with
_PREFIX = {"psi": "", "upper": "upper_"}
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
            arrays |= _fields(_PREFIX[side] + name, G if name == "G" else c)
    kinds = (_PROBLEM, _BETWEEN)
    write_archive(as_path(path), kinds[len(sides) - 1], arrays, *kinds)


def load_problem(path: str | PathLike[str], q: str | PathLike[str] | None = None) -> ICP:
    """Read a problem from an `.npz` file, from a folder, or, with ψ = 0, from two Matrix Market files.

    Parameters: `path`; `q` the second Matrix Market file, only where `path` is A as Matrix Market.
    Raises FileError, which names the file, the field and what was expected.

    >>> load_problem("A.mtx", q="q.mtx")
    Traceback (most recent call last):
    icpmodel.errors.FileError: A.mtx: no such file or folder
    """
    path = as_path(path)
    with told(path, "read"):
        path.stat()
        is_folder = path.is_dir()
    if is_folder or path.suffix.lower() == ".npz":
        if q is not None:
            raise FileError(f"{path}: holds its own q; drop q")
        return _problem(path, _from_folder(path) if is_folder else _from_archive(path))
    if q is None:
        raise FileError(f"{path}: is neither an .npz file nor a folder; a Matrix Market file of A needs its q as well")
    A = read_matrix(path)
    return _problem(path, {"A": A, "q": read_vector(as_path(q), A.shape[0]), "psi": "zero"})


def save_solution(solution: Solution, path: str | PathLike[str]) -> None:
    """Write z, p, r and the certificate of `solution` to the `.npz` file `path`, as `save_problem` does.

    Raises InputError for what is no solution, FileError where the path cannot be written.

    >>> import tempfile
    >>> solution = ICP([[2.0]], [-1.0]).solve()
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_solution(solution, f"{folder}/s.npz")
    ...     load_solution(f"{folder}/s.npz")["z"]
    array([0.5])
    """
    if not isinstance(solution, Solution):
        raise InputError(f"solution is a {type(solution).__name__}; what solve returns was expected")
    about = np.array(json.dumps(solution.about()))
    write_archive(as_path(path), _SOLUTION, {"z": solution.z, "p": solution.p, "r": solution.r, "about": about})


def check_place(path: str) -> None:
    """Raise FileError now where `save_solution` would later, as another file is in its place."""
    with told(as_path(path), "written"):
        check_free(as_path(path), _SOLUTION)


def load_solution(path: str | PathLike[str]) -> dict[str, Any]:
    """Read what `save_solution` wrote: z, p, r (shape (n,)) and `about`, the certificate as it was claimed then.

    Nothing read is believed: `icpmodel.certify(problem, z)` says what is true of z. Raises FileError.

    >>> load_solution("nowhere.npz")
    Traceback (most recent call last):
    icpmodel.errors.FileError: nowhere.npz: no such file or folder
    """
    path = as_path(path)
    with read_archive(path, _SOLUTION) as archive:
        z = archive.vector("z")
        p, r = (archive.vector(name, z.size) for name in ("p", "r"))
        return {"z": z, "p": p, "r": r, "about": _json(f"{path}: field about", archive.text("about"))}


def _problem(path: Path, parts: dict[str, Any]) -> ICP:
    try:
        sides = []
        for side, prefix in _PREFIX.items():
            c = parts.get(f"{prefix}c", 0.0 if side in parts else None)
            sides.append(Affine(parts[f"{prefix}G"], c) if f"{prefix}G" in parts else c)
        return ICP(parts["A"], parts["q"], *sides)
    except InputError as error:
        raise FileError(f"{path}: {error}") from error


def _from_archive(path: Path) -> dict[str, Any]:
    with read_archive(path, _PROBLEM, _BETWEEN) as archive:
        q = archive.vector("q")
        parts: dict[str, Any] = {"q": q, "A": archive.matrix("A", q.size)}
        for side in ("psi", "upper") if archive.text("format") == _BETWEEN else ("psi",):
            parts[side] = archive.text(side)
            for name in _stored(path, side, parts[side]):
                read = archive.matrix if name == "G" else archive.vector
                parts[_PREFIX[side] + name] = read(_PREFIX[side] + name, q.size)
        return parts


def _from_folder(path: Path) -> dict[str, Any]:
    declared = path / "psi.json"
    if not declared.is_file():
        if not (path / "A.mtx").is_file():
            raise FileError(f"{path}: the folder holds no problem; psi.json, A.mtx and q.mtx were expected")
        raise FileError(f'{declared}: no such file; it declares psi, for an LCP as {{"psi": "zero"}}')
    with told(declared, "read"):
        content = _json(declared, declared.read_text(encoding="utf-8"))
    if not isinstance(content, dict) or content.keys() not in ({"psi"}, {"psi", "upper"}):
        found = f"holds the fields {', '.join(content) or 'none'}" if isinstance(content, dict) else "holds no object"
        wanted = "the field psi alone was expected, or psi and upper"
        raise FileError(f'{declared}: {found}; {wanted}, for an LCP {{"psi": "zero"}}')
    stored = {side: _stored(declared, side, kind) for side, kind in content.items()}
    A = read_matrix(path / "A.mtx")
    parts = {"A": A, "q": read_vector(path / "q.mtx", A.shape[0])} | content
    for side, names in stored.items():
        for name in (_PREFIX[side] + name for name in names):
            file = path / f"{name}.mtx"
            parts[name] = read_matrix(file) if name.endswith("G") else read_vector(file, A.shape[0])
    return parts


def _fields(name: str, part: Any) -> dict[str, Any]:
    """`part`, an array or a CSR matrix, as the arrays that are stored of it."""
    if not sp.issparse(part):
        return {name: part}
    return {f"{name}_data": part.data, f"{name}_indices": part.indices, f"{name}_indptr": part.indptr}


def _stored(path: Path, side: str, kind: Any) -> tuple[str, ...]:
    if not isinstance(kind, str) or kind not in _KINDS:
        raise FileError(f"{path}: field {side} is {kind!r}; one of {', '.join(_KINDS)} was expected")
    return _KINDS[kind]


def _json(where: str | Path, text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileError(f"{where}: is not JSON ({error})") from error
