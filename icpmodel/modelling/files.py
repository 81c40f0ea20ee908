"""Problems and solutions on disk. Files are data: nothing is ever unpickled or evaluated.

A problem is one `.npz` file, or a folder that can be read by other programs too:

    folder/A.mtx        A in Matrix Market format
    folder/q.mtx        q, a Matrix Market array of n × 1
    folder/psi.json     {"psi": "zero"} or {"psi": "constant"} or {"psi": "affine"}
    folder/c.mtx        c, n × 1      (constant and affine)
    folder/G.mtx        G             (affine)

ψ given by Python code has no file form. A solution is one `.npz` with z, p, r and its certificate as JSON text.
"""

from __future__ import annotations

import io
import json
import os
import shutil
import tempfile
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import FileError, InputError
from ..icp import ICP
from ..numerics.arrays import Vector
from ..problem.affine import Affine, Constant
from ..problem.data import as_problem
from ..solve.solution import Solution

_VERSION = 1
#: a sparse vector may claim any length in a few bytes
_LONGEST_VECTOR = 10**9
_KINDS = ("zero", "constant", "affine")


def save_problem(problem: ICP, path: str | Path) -> None:
    """Write `problem` to `path`: one file if it ends in `.npz`, a folder of Matrix Market files otherwise.

    ψ must be zero, constant or affine. Raises InputError for any other ψ, FileError where the path cannot be written.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_problem(ICP([[2.0]], [-1.0], psi=3.0), f"{folder}/p.npz")
    ...     load_problem(f"{folder}/p.npz")
    ICP(n=1, nnz=1, psi=Constant(3))
    """
    psi = as_problem(problem).psi
    if isinstance(psi, Constant):
        kind = "constant" if psi.c.any() else "zero"
    elif isinstance(psi, Affine):
        kind = "affine"
    else:
        raise InputError(f"psi is {psi!r}; only zero, constant and affine maps can be written to a file")
    parts: dict[str, Any] = {"A": problem.A, "q": problem.q}
    if kind != "zero":
        parts["c"] = psi.c
    if isinstance(psi, Affine):
        parts["G"] = psi.G
    if not str(path):
        raise FileError("the path is empty; the name of a folder or of an .npz file was expected")
    path = Path(path)
    try:
        if path.suffix.lower() == ".npz":
            _write_npz(path, kind, parts)
        else:
            _write_folder(path, kind, parts)
    except OSError as error:
        raise FileError(f"{path}: cannot be written ({error.strerror or error})") from error


def load_problem(path: str | Path, q: str | Path | None = None) -> ICP:
    """Read a problem from an `.npz` file, from a folder, or, with ψ = 0, from two Matrix Market files.

    Parameters: `path`; `q` the second Matrix Market file, only where `path` is A as Matrix Market.
    Raises FileError, which names the file, the field and what was expected.

    >>> load_problem("A.mtx", q="q.mtx")
    Traceback (most recent call last):
    icpmodel.errors.FileError: A.mtx: no such file or folder
    """
    path = Path(path)
    if not path.exists():
        raise FileError(f"{path}: no such file or folder")
    if path.is_dir():
        if q is not None:
            raise FileError(f"{path}: is a folder, which holds its own q; drop q")
        return _problem(path, *_read_folder(path))
    if path.suffix.lower() == ".npz":
        if q is not None:
            raise FileError(f"{path}: holds its own q; drop q")
        return _problem(path, *_read_npz(path))
    if q is None:
        raise FileError(f"{path}: is neither an .npz file nor a folder; a Matrix Market file of A needs its q as well")
    A, vector = read_matrix(path), read_vector(Path(q))
    if vector.size != A.shape[0]:
        raise FileError(f"{q}: holds {vector.size} numbers; {A.shape[0]} were expected, the rows of {path}")
    return _problem(path, "zero", {"A": A, "q": vector})


def save_solution(solution: Solution, path: str | Path) -> None:
    """Write z, p, r and the certificate of `solution` to the `.npz` file `path`. Raises FileError.

    >>> import tempfile
    >>> solution = ICP([[2.0]], [-1.0]).solve()
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_solution(solution, f"{folder}/s.npz")
    ...     load_solution(f"{folder}/s.npz")["z"]
    array([0.5])
    """
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise FileError(f"{path}: a solution is written to a file that ends in .npz")
    arrays: dict[str, Any] = {"z": solution.z, "p": solution.p, "r": solution.r}
    arrays["about"] = np.array(json.dumps(solution.about()))
    try:
        _write_whole(path, arrays)
    except OSError as error:
        raise FileError(f"{path}: cannot be written ({error.strerror or error})") from error


def load_solution(path: str | Path) -> dict[str, Any]:
    """Read what `save_solution` wrote: z, p, r (shape (n,)) and `about`, the certificate as it was claimed then.

    Nothing read is believed: `icpmodel.certify(problem, z)` says what is true of z. Raises FileError.

    >>> load_solution("nowhere.npz")
    Traceback (most recent call last):
    icpmodel.errors.FileError: nowhere.npz: no such file or folder
    """
    path = Path(path)
    fields = _load_npz(path, ("z", "p", "r", "about"))
    z = _npz_vector(path, fields, "z", None)
    result: dict[str, Any] = {"z": z}
    for name in ("p", "r"):
        result[name] = _npz_vector(path, fields, name, z.size)
    result["about"] = _json(f"{path}: field about", str(fields["about"]))
    return result


def read_matrix(path: Path) -> Any:
    """A sparse or dense matrix from a Matrix Market file. Raises FileError."""
    from scipy.io import mminfo, mmread

    if not path.is_file():
        raise FileError(f"{path}: no such file")
    try:
        path.open("rb").close()  # says so if it may not be read; SciPy would call its banner missing
        # SciPy allocates what the header promises
        rows, columns, entries, *_ = mminfo(path)
        if entries <= path.stat().st_size or path.suffix in (".gz", ".bz2"):
            return mmread(path, spmatrix=False)
    except PermissionError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror})") from error
    except (ValueError, OverflowError, OSError, EOFError) as error:
        raise FileError(f"{path}: not a readable Matrix Market file ({error})") from error
    raise FileError(
        f"{path}: its header promises {rows} x {columns} with {entries} entries, which do not fit into "
        f"{path.stat().st_size} bytes; is the file truncated?"
    )


def read_vector(path: Path) -> Vector:
    """A vector, shape (n,), from a Matrix Market file of n × 1 or 1 × n. Raises FileError."""
    matrix = read_matrix(path)
    if 1 not in matrix.shape:
        raise FileError(f"{path}: holds a matrix of shape {matrix.shape}; a vector (n x 1) was expected")
    if sp.issparse(matrix):
        if max(matrix.shape) > _LONGEST_VECTOR:
            raise FileError(
                f"{path}: holds a vector of shape {matrix.shape}; at most {_LONGEST_VECTOR} entries are read"
            )
        matrix = matrix.toarray()
    return np.asarray(matrix).reshape(-1)


def _problem(path: Path, kind: str, parts: dict[str, Any]) -> ICP:
    try:
        psi: Any = 0.0
        if kind == "constant":
            psi = Constant(parts["c"])
        elif kind == "affine":
            psi = Affine(parts["G"], parts["c"])
        return ICP(parts["A"], parts["q"], psi)
    except InputError as error:
        raise FileError(f"{path}: {error}") from error


def _write_npz(path: Path, kind: str, parts: dict[str, Any]) -> None:
    arrays: dict[str, Any] = {"format": np.array(_VERSION), "psi": np.array(kind)}
    for name, part in parts.items():
        if sp.issparse(part):
            arrays |= {f"{name}_data": part.data, f"{name}_indices": part.indices, f"{name}_indptr": part.indptr}
        else:
            arrays[name] = part
    _write_whole(path, arrays)


def _write_whole(path: Path, arrays: dict[str, Any]) -> None:
    """Write beside `path` and rename, so that an interruption leaves the old file or the new one."""
    path = path.resolve()  # of a link, the file behind it
    with tempfile.NamedTemporaryFile(dir=path.parent, prefix=path.name, suffix=".part", delete=False) as file:
        beside = Path(file.name)
        try:
            np.savez_compressed(file, **arrays)
            file.close()
            if path.exists():
                shutil.copymode(path, beside)
            else:
                beside.chmod(0o666 & ~_umask())
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)


def _umask() -> int:
    """The user's file mode mask, which can be read only by setting it."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _write_folder(path: Path, kind: str, parts: dict[str, Any]) -> None:
    from scipy.io import mmwrite

    path.mkdir(parents=True, exist_ok=True)
    # without psi.json, written last, a folder is not read: an interruption leaves no mixture of two problems
    (path / "psi.json").unlink(missing_ok=True)
    for name, part in parts.items():
        # written through a buffer, as mmwrite given a name may append its own suffix; symmetry="general" keeps A as is
        buffer = io.BytesIO()
        mmwrite(buffer, part if sp.issparse(part) else part.reshape(-1, 1), precision=17, symmetry="general")
        (path / f"{name}.mtx").write_bytes(buffer.getvalue())
    (path / "psi.json").write_text(json.dumps({"psi": kind}) + "\n")


def _read_folder(path: Path) -> tuple[str, dict[str, Any]]:
    declared = path / "psi.json"
    if not declared.is_file() and not (path / "A.mtx").is_file():
        raise FileError(f"{path}: the folder holds no saved problem; psi.json, A.mtx and q.mtx were expected")
    if not declared.is_file():
        raise FileError(f'{declared}: no such file; it declares psi, for an LCP as {{"psi": "zero"}}')
    try:
        text = declared.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"{declared}: cannot be read ({error})") from error
    content = _json(declared, text)
    if not isinstance(content, dict) or content.keys() != {"psi"}:
        found = f"holds the fields {', '.join(content) or 'none'}" if isinstance(content, dict) else "holds no object"
        raise FileError(f'{declared}: {found}; the field psi alone was expected, for an LCP {{"psi": "zero"}}')
    kind = _kind(declared, content["psi"])
    parts = {"A": read_matrix(path / "A.mtx"), "q": read_vector(path / "q.mtx")}
    if kind != "zero":
        parts["c"] = read_vector(path / "c.mtx")
    if kind == "affine":
        parts["G"] = read_matrix(path / "G.mtx")
    return kind, parts


def _read_npz(path: Path) -> tuple[str, dict[str, Any]]:
    fields = _load_npz(path, ("format", "psi", "q"))
    if fields["format"].shape != () or fields["format"].dtype.kind != "i" or int(fields["format"]) != _VERSION:
        raise FileError(f"{path}: field format is {fields['format']}; {_VERSION} was expected")
    kind = _kind(path, str(fields["psi"]))
    q = _npz_vector(path, fields, "q", None)
    parts: dict[str, Any] = {"q": q, "A": _npz_matrix(path, fields, "A", q.size)}
    if kind != "zero":
        parts["c"] = _npz_vector(path, fields, "c", q.size)
    if kind == "affine":
        parts["G"] = _npz_matrix(path, fields, "G", q.size)
    return kind, parts


def _load_npz(path: Path, wanted: tuple[str, ...]) -> dict[str, np.ndarray]:
    if not path.is_file():
        raise FileError(f"{path}: no such file or folder")
    try:
        with np.load(path, allow_pickle=False) as archive:
            fields = {name: archive[name] for name in archive.files}
    except ValueError as error:  # NumPy would have to unpickle something; its message says how, which must not be done
        raise FileError(f"{path}: not an .npz file of plain arrays") from error
    except (OSError, EOFError, KeyError, zipfile.BadZipFile, zlib.error) as error:
        raise FileError(f"{path}: not a readable .npz file, or truncated ({error})") from error
    for name in wanted:
        _field(path, fields, name)
    return fields


def _field(path: Path, fields: dict[str, np.ndarray], name: str) -> np.ndarray:
    if name not in fields:
        raise FileError(f"{path}: field {name} is missing; found {', '.join(sorted(fields)) or 'none'}")
    return fields[name]


def _npz_vector(path: Path, fields: dict[str, np.ndarray], name: str, n: int | None) -> Vector:
    vector = _field(path, fields, name)
    if vector.ndim != 1 or vector.dtype.kind not in "biuf" or (n is not None and vector.size != n):
        wanted = "a vector of numbers" if n is None else f"{n} numbers"
        raise FileError(f"{path}: field {name} has shape {vector.shape}, dtype {vector.dtype}; {wanted} expected")
    return vector


def _npz_matrix(path: Path, fields: dict[str, np.ndarray], name: str, n: int) -> sp.csr_array:
    indptr = _field(path, fields, f"{name}_indptr")
    indices = _field(path, fields, f"{name}_indices")
    data = _npz_vector(path, fields, f"{name}_data", None)
    for field, array, wanted in ((f"{name}_indptr", indptr, n + 1), (f"{name}_indices", indices, data.size)):
        if array.shape != (wanted,) or array.dtype.kind not in "iu":
            raise FileError(
                f"{path}: field {field} has shape {array.shape}, dtype {array.dtype}; {wanted} integers expected"
            )
    # SciPy's own check lets some of these pass and its compiled code then writes out of bounds
    ordered = indptr[0] == 0 and indptr[-1] == data.size and bool((indptr[1:] >= indptr[:-1]).all())
    if not ordered or ((indices < 0) | (indices >= n)).any():
        raise FileError(f"{path}: fields {name}_* are not a CSR matrix of shape ({n}, {n})")
    return sp.csr_array((data, indices.astype(np.int64), indptr.astype(np.int64)), shape=(n, n))


def _kind(path: Path, kind: Any) -> str:
    if kind not in _KINDS:
        raise FileError(f"{path}: field psi is {kind!r}; one of {', '.join(_KINDS)} was expected")
    return str(kind)


def _json(where: str | Path, text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileError(f"{where}: is not JSON ({error})") from error
