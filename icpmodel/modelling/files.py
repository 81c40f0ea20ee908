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
import secrets
import shutil
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import FileError, InputError
from ..icp import ICP
from ..numerics.arrays import Vector
from ..problem.affine import Affine
from ..problem.data import as_problem
from ..solve.solution import Solution

_VERSION = 1
#: a sparse vector may claim any length in a few bytes
_LONGEST_VECTOR = 10**9
#: kind of ψ → what is stored of it
_KINDS: dict[str, tuple[str, ...]] = {"zero": (), "constant": ("c",), "affine": ("c", "G")}


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
    if psi.linear is None:
        raise InputError(f"psi is {psi!r}; only zero, constant and affine maps can be written to a file")
    G, c = psi.linear
    kind = "affine" if not psi.is_constant else "constant" if c.any() else "zero"
    stored = {"A": problem.A, "q": problem.q, "c": c, "G": G}
    parts = {name: stored[name] for name in ("A", "q", *_KINDS[kind])}
    if not str(path):
        raise FileError("the path is empty; the name of a folder or of an .npz file was expected")
    path = Path(path)
    with _writing(path):
        (_write_npz if path.suffix.lower() == ".npz" else _write_folder)(path, kind, parts)


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
    if path.is_dir() or path.suffix.lower() == ".npz":
        if q is not None:
            raise FileError(f"{path}: holds its own q; drop q")
        return _problem(path, _read_folder(path) if path.is_dir() else _read_npz(path))
    if q is None:
        raise FileError(f"{path}: is neither an .npz file nor a folder; a Matrix Market file of A needs its q as well")
    A, vector = _read_matrix(path), _read_vector(Path(q))
    if vector.size != A.shape[0]:
        raise FileError(f"{q}: holds {vector.size} numbers; {A.shape[0]} were expected, the rows of {path}")
    return _problem(path, {"A": A, "q": vector})


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
    about = np.array(json.dumps(solution.about()))
    with _writing(path):
        _write_whole(path, {"z": solution.z, "p": solution.p, "r": solution.r, "about": about})


def load_solution(path: str | Path) -> dict[str, Any]:
    """Read what `save_solution` wrote: z, p, r (shape (n,)) and `about`, the certificate as it was claimed then.

    Nothing read is believed: `icpmodel.certify(problem, z)` says what is true of z. Raises FileError.

    >>> load_solution("nowhere.npz")
    Traceback (most recent call last):
    icpmodel.errors.FileError: nowhere.npz: no such file or folder
    """
    fields = _Fields(Path(path))
    z = fields.vector("z")
    p, r = (fields.vector(name, z.size) for name in ("p", "r"))
    return {"z": z, "p": p, "r": r, "about": _json(f"{path}: field about", str(fields["about"]))}


def _problem(path: Path, parts: dict[str, Any]) -> ICP:
    try:
        psi = Affine(parts["G"], parts["c"]) if "G" in parts else parts.get("c", 0.0)
        return ICP(parts["A"], parts["q"], psi)
    except InputError as error:
        raise FileError(f"{path}: {error}") from error


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise FileError(f"{path}: cannot be written ({error.strerror or error})") from error


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
    beside = path.with_name(f"{path.name}.{secrets.token_hex(4)}.part")
    with beside.open("xb") as file:
        try:
            if path.exists():
                shutil.copymode(path, beside)
            np.savez_compressed(file, **arrays)
            file.close()
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)


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


def _read_folder(path: Path) -> dict[str, Any]:
    declared = path / "psi.json"
    if not declared.is_file():
        if not (path / "A.mtx").is_file():
            raise FileError(f"{path}: the folder holds no saved problem; psi.json, A.mtx and q.mtx were expected")
        raise FileError(f'{declared}: no such file; it declares psi, for an LCP as {{"psi": "zero"}}')
    try:
        text = declared.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"{declared}: cannot be read ({error})") from error
    content = _json(declared, text)
    if not isinstance(content, dict) or content.keys() != {"psi"}:
        found = f"holds the fields {', '.join(content) or 'none'}" if isinstance(content, dict) else "holds no object"
        raise FileError(f'{declared}: {found}; the field psi alone was expected, for an LCP {{"psi": "zero"}}')
    readers = {"A": _read_matrix, "q": _read_vector, "c": _read_vector, "G": _read_matrix}
    return {name: readers[name](path / f"{name}.mtx") for name in ("A", "q", *_stored(declared, content["psi"]))}


class _Fields(dict[str, np.ndarray]):
    """The arrays of an `.npz` file by name; one that is missing is an error of the file."""

    def __init__(self, path: Path) -> None:
        if not path.is_file():
            raise FileError(f"{path}: no such file or folder")
        self.path = path
        try:
            with np.load(path, allow_pickle=False) as archive:
                super().__init__({name: archive[name] for name in archive.files})
        except ValueError as error:  # NumPy would have to unpickle something; its message says how, which must not be
            raise FileError(f"{path}: not an .npz file of plain arrays") from error
        except (OSError, EOFError, KeyError, zipfile.BadZipFile, zlib.error) as error:
            raise FileError(f"{path}: not a readable .npz file, or truncated ({error})") from error

    def __missing__(self, name: str) -> np.ndarray:
        raise FileError(f"{self.path}: field {name} is missing; found {', '.join(sorted(self)) or 'none'}")

    def vector(self, name: str, size: int | None = None, kinds: str = "biuf") -> Vector:
        """The field `name`, a vector of `size` numbers of the `kinds` that NumPy has letters for."""
        array = self[name]
        if array.ndim != 1 or array.dtype.kind not in kinds or size not in (None, array.size):
            numbers = "integers" if kinds == "iu" else "numbers"
            wanted = f"a vector of {numbers}" if size is None else f"{size} {numbers}"
            found = f"shape {array.shape}, dtype {array.dtype}"
            raise FileError(f"{self.path}: field {name} has {found}; {wanted} expected")
        return array

    def matrix(self, name: str, n: int) -> sp.csr_array:
        """The CSR matrix of shape (n, n) in three fields."""
        data = self.vector(f"{name}_data")
        indptr, indices = self.vector(f"{name}_indptr", n + 1, "iu"), self.vector(f"{name}_indices", data.size, "iu")
        # SciPy's own check lets some of these pass and its compiled code then writes out of bounds
        ordered = indptr[0] == 0 and indptr[-1] == data.size and bool((indptr[1:] >= indptr[:-1]).all())
        if not ordered or ((indices < 0) | (indices >= n)).any():
            raise FileError(f"{self.path}: fields {name}_* are not a CSR matrix of shape ({n}, {n})")
        return sp.csr_array((data, indices.astype(np.int64), indptr.astype(np.int64)), shape=(n, n))


def _read_npz(path: Path) -> dict[str, Any]:
    fields = _Fields(path)
    version = fields["format"]
    if version.shape != () or version.dtype.kind != "i" or int(version) != _VERSION:
        raise FileError(f"{path}: field format is {version}; {_VERSION} was expected")
    of_psi, q = _stored(path, str(fields["psi"])), fields.vector("q")
    readers: dict[str, Any] = {"A": fields.matrix, "c": fields.vector, "G": fields.matrix}
    return {"q": q} | {name: readers[name](name, q.size) for name in ("A", *of_psi)}


def _read_matrix(path: Path) -> Any:
    """A sparse or dense matrix from a Matrix Market file, whatever that claims to hold."""
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
    found = f"its header promises {rows} x {columns} with {entries} entries"
    raise FileError(f"{path}: {found}, which do not fit into {path.stat().st_size} bytes; is the file truncated?")


def _read_vector(path: Path) -> Vector:
    """A vector, shape (n,), from a Matrix Market file of n × 1 or 1 × n."""
    matrix = _read_matrix(path)
    if 1 not in matrix.shape:
        raise FileError(f"{path}: holds a matrix of shape {matrix.shape}; a vector (n x 1) was expected")
    if max(matrix.shape) > _LONGEST_VECTOR:
        raise FileError(f"{path}: holds a vector of shape {matrix.shape}; at most {_LONGEST_VECTOR} entries are read")
    return np.asarray(matrix.toarray() if sp.issparse(matrix) else matrix).reshape(-1)


def _stored(path: Path, kind: Any) -> tuple[str, ...]:
    if not isinstance(kind, str) or kind not in _KINDS:
        raise FileError(f"{path}: field psi is {kind!r}; one of {', '.join(_KINDS)} was expected")
    return _KINDS[kind]


def _json(where: str | Path, text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileError(f"{where}: is not JSON ({error})") from error
