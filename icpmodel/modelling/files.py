"""Problems on disk. Files are data: nothing is ever unpickled or evaluated.

A saved problem is one `.npz` file, which other programs read with `numpy.load`. Its fields are format, q and A, the
latter as the CSR arrays A_data, A_indices and A_indptr. ψ(z) = Gz + c is stored in c and, like A, in G; an upper
obstacle in upper_c and upper_G. Without c, ψ = 0.

Files of other programs are read in two forms. A, q, psi and upper may be in one file each, see `formats`. Or a `.mat`
file, or one by `numpy.savez`, holds all of them under these names. ψ given by Python code has no file form.
"""

from __future__ import annotations

from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from ..errors import FileError, InputError, check_arguments
from ..icp import ICP
from ..present.whole_files import as_path
from ..problem.affine import Affine
from ..problem.data import ProblemLike, as_problem
from ..problem.two_sided import sides_of
from .archive import check_kind, content_errors, text_of, write_arrays
from .formats import as_values, read_named, read_values

Source = str | PathLike[str]

_PROBLEM = "icpmodel problem 3"
SOLUTION = "icpmodel solution 3"
#: obstacle → prefix of the names of its parts
OBSTACLE_PREFIXES = {"psi": "", "upper": "upper_"}
#: the parts of a problem in a file
_PARTS = ("A", "q", "c", "G", "upper_c", "upper_G")
#: name of a variable in files of other programs → part
_ALIASES = {"psi": "c", "upper": "upper_c"}


@check_arguments
def save_problem(problem: ProblemLike, path: str | PathLike[str]) -> None:
    """Write `problem` to the `.npz` file `path`; for other programs use `scipy.io.mmwrite("A.mtx", problem.A)`.

    Parameters
    ----------
    problem : ICP
        Its p is affine, and its obstacles are constant or affine.
    path : str or path
        The `.npz` file.

    Raises
    ------
    InputError
        For any other p or ψ.
    FileError
        Where the path cannot be written.

    Notes
    -----
    The file is written under another name and then renamed. So `path` is always the whole old file or the whole new
    one. Only a saved problem is replaced, and links are not followed.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_problem(ICP([[2.0]], [-1.0], psi=3.0), f"{folder}/p.npz")
    ...     load_problem(f"{folder}/p.npz")
    ICP(n=1, nnz=1, psi=Constant(3))
    """
    write_arrays(as_path(path), _PROBLEM, problem_parts(problem))


@check_arguments
def load_problem(
    path: Source, q: Source | None = None, psi: Source | float | None = None, upper: Source | float | None = None
) -> ICP:
    """Read a problem from one file, or from files of A, q and the obstacles.

    Parameters
    ----------
    path : str or path
        A whole problem: an `.npz` file by `save_problem` or `save_solution`. Or a `.mat` (-v6, -v7) or
        `numpy.savez` file with the variables A, q, and optionally psi and upper. Or A alone: `.npy`, `.npz` by
        `scipy.sparse.save_npz`, `.mat`, `.mtx`, `.bin` by PETSc, `.csv` or `.txt` without a header.
    q : str or path, optional
        A file of n numbers, if `path` does not hold them. In a file of several variables it is found by its name.
    psi, upper : str, path or float, optional
        A file of the obstacle, or a number. Without `psi` it is 0; without `upper` there is no upper obstacle.

    Returns
    -------
    ICP
        The problem.

    Raises
    ------
    FileError
        The message names the file, the field and what was expected.

    Notes
    -----
    No reader detects that a `.mat` file was truncated at the end of a variable: print the problem to see what was read.

    Examples
    --------
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
    parts = _parts_in(path)
    sources = dict.fromkeys(parts, path)
    for name, source in {"q": q, "psi": psi, "upper": upper}.items():
        part = _ALIASES.get(name, name)
        if source is None:
            continue
        if part in parts:
            raise FileError(f"{path}: holds its own {name}; drop {name}")
        if name in OBSTACLE_PREFIXES and is_number(source):
            parts[part] = source
        else:
            sources[part] = as_path(source, name)
            parts[part] = read_values(sources[part], name, parts["A"].shape[0] if parts["A"].ndim else 1)
    return problem_of(parts, sources)


def is_number(source: Any) -> TypeGuard[float]:
    """Whether an obstacle is given as a number, in place of a file."""
    return isinstance(source, Real) and not isinstance(source, bool)


def problem_of(parts: dict[str, Any], sources: dict[str, Path]) -> ICP:
    """The problem of the parts A and q, and of c, G, upper_c and upper_G if given.

    Raises FileError, which names the file of the wrong part by `sources`, part → file.
    """
    A = parts["A"]
    if "q" not in parts:
        raise FileError(f"{sources['A']}: has no q; give q as a file of its own, or write A and q into one")
    with content_errors(sources["A"]):
        problem = ICP(A, np.zeros(A.shape[0] if A.ndim else 1))
    with content_errors(sources["q"]):
        problem = problem.with_q(np.atleast_1d(as_values(sources["q"], parts["q"], problem.n)))
    for side, prefix in OBSTACLE_PREFIXES.items():
        part = f"{prefix}c"
        if part not in parts:
            if f"{prefix}G" in parts:
                raise FileError(f"{sources['A']}: holds {prefix}G, but no {part}")
            continue
        with content_errors(sources.get(part)):
            c = parts[part] if part not in sources else as_values(sources[part], parts[part], problem.n)
            obstacle = Affine(parts[f"{prefix}G"], c) if f"{prefix}G" in parts else c
            problem = problem.with_psi(obstacle) if side == "psi" else problem.with_upper(obstacle)
    return problem


def problem_parts(problem: ProblemLike) -> dict[str, Any]:
    """The parts of `problem`, as `problem_of` takes them. Raises InputError if p or ψ has no file form."""
    problem = as_problem(problem, nonlinear=True)
    if problem.f is not None:
        raise InputError(f"f is {problem.f!r}, code of yours; only problems with affine p can be written to a file")
    parts: dict[str, Any] = {"A": problem.A, "q": problem.q}
    for (side, prefix), one in zip(OBSTACLE_PREFIXES.items(), sides_of(problem.psi), strict=False):
        if one.linear is None:
            raise InputError(f"{side} is {one!r}; only zero, constant and affine maps can be written to a file")
        G, parts[f"{prefix}c"] = one.linear
        if not one.is_constant:
            parts[f"{prefix}G"] = G
    return parts


def check_has_problem(path: Path, fields: dict[str, Any]) -> None:
    """Raise FileError where the `fields` of a saved solution hold no problem."""
    if "A" not in fields:
        raise FileError(f"{path}: holds no problem, as psi or f was Python code; give it: load_solution(path, problem)")


def _parts_in(path: Path) -> dict[str, Any]:
    """The parts of a problem in a file, A at least. Raises FileError."""
    arrays = read_named(path)
    if text_of(path, arrays, "format") == SOLUTION:
        check_has_problem(path, arrays)
        arrays = {name: arrays[name] for name in _PARTS if name in arrays}
    elif "format" in arrays:
        check_kind(path, arrays, _PROBLEM)
        del arrays["format"]
    if len(arrays) == 1:
        return {"A": next(iter(arrays.values()))}
    parts = {_ALIASES.get(name, name): value for name, value in arrays.items()}
    if "A" not in parts or not parts.keys() <= {*_PARTS} or len(parts) < len(arrays):
        raise FileError(
            f"{path}: holds {', '.join(arrays) or 'nothing'}; A alone, or A, q, psi and upper, or A, q, c, G, upper_c "
            "and upper_G were expected"
        )
    return parts
