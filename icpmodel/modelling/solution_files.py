"""Solutions on disk, whole as `.npz`, or as numbers alone for other programs.

.npz    z, p, r, what is known of z as JSON text, and the problem where ψ has a file form
.npy    an array of shape (3, n) with the rows z, p and r: `z, p, r = numpy.load("answer.npy")`
.csv    a line of the heads z,p,r, and one line for each row of the problem
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..errors import FileError, InputError, NotApplicable
from ..methods.contract import Iterate, Method
from ..numerics.arrays import Vector, as_vector, described
from ..present.whole_files import as_path, check_replaceable, check_suffix, told, write_whole
from ..problem.data import ProblemData, ProblemLike, as_problem
from ..solve.goal import RTOL, Goal, Limits
from ..solve.solution import Solution, Status
from ..theory.certificates.infeasible import infeasible
from .archive import check_free, opened, read_archive, read_array, write_archive
from .files import Source, as_json, problem_fields, stored_problem
from .formats import read_text, read_values

_SOLUTION = "icpmodel solution 2"
#: the first line of a solution as text
_HEADS = "z,p,r"
WRITTEN = (".npz", ".npy", ".csv")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Remembered(Method):
    """A method of which a file keeps what it was called."""

    called: str

    def why_not(self, problem: ProblemData) -> str | None:
        return f"a file keeps only that the method was called {self.called}; name a method"

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        raise NotApplicable(self.why_not(problem))

    def __repr__(self) -> str:
        return self.called


def save_solution(solution: Solution, path: str | PathLike[str]) -> None:
    """Write z, p and r of `solution` to the file `path`: what its name ends in says how.

    `.npz`: all that `load_solution` reads, with the certificate, and with the problem unless ψ is Python code; `.npy`:
    an array of shape (3, n), its rows z, p and r; `.csv`: one line for each row, below the heads z, p, r. It is written
    as `save_problem` does, and only a file of the same kind is replaced.
    Raises InputError for what is no solution, FileError where the path cannot be written or ends otherwise.

    >>> import tempfile
    >>> solution = ICP([[2.0]], [-1.0]).solve()
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_solution(solution, f"{folder}/s.npz")
    ...     save_solution(solution, f"{folder}/s.npy")
    ...     load_solution(f"{folder}/s.npz").z, np.load(f"{folder}/s.npy").shape
    (array([0.5]), (3, 1))
    """
    if not isinstance(solution, Solution):
        raise InputError(f"solution is {described(solution)}; what solve returns was expected")
    path, parts = as_path(path), {"z": solution.z, "p": solution.p, "r": solution.r}
    check_suffix(path, WRITTEN)
    if path.suffix.lower() == ".npz":
        about = np.array(json.dumps(solution.about() | {"settled": repr(solution.settled)}))
        if solution.infeasible is not None:
            parts["witness"] = np.array(solution.infeasible.witness, dtype=np.float64)
        write_archive(path, _SOLUTION, {**parts, "about": about, **_problem_fields(solution.problem)})
        return
    rows = np.array(list(parts.values()))

    def write(file: BinaryIO) -> None:
        if path.suffix.lower() == ".npy":
            np.save(file, rows)
        else:
            np.savetxt(file, rows.T, "%.17g", ",", header=_HEADS, comments="")

    write_whole(path, write, lambda: check_replaceable(path, lambda: _check_saved(path)))


def check_place(path: str) -> None:
    """Raise FileError now where `save_solution` would later: a name that ends otherwise, or another file there."""
    place = as_path(path)
    check_suffix(place, WRITTEN)
    with told(place, "written"):
        if place.suffix.lower() == ".npz":
            check_free(place, _SOLUTION)
        else:
            check_replaceable(place, lambda: _check_saved(place))


def load_solution(
    path: Source,
    problem: ProblemLike | None = None,
    *,
    rtol: float = RTOL,
    atol: float = 0.0,
    accuracy: float | None = None,
) -> Solution:
    """Read what `save_solution` wrote to an `.npz` file.

    Nothing read is believed: p, r, the residual, the tolerance, the proof that there is no solution, and the
    certificate are those of z and the problem. A run that was asked for less than by default is read by asking for as
    little here. What only the run knew is what the file says: why it stopped unsolved, its steps and seconds, and the
    names of its methods.

    Parameters
    ----------
    path : str or path
        An `.npz` file by `save_solution`.
    problem : ICP, optional
        The problem, by default the one in the file. It is needed where ψ is Python code.
    rtol, atol, accuracy : float, optional
        What a solution has to satisfy to be called solved, as in `solve`.

    Returns
    -------
    Solution
        With the tolerance that `rtol` makes of the problem.

    Raises
    ------
    FileError
        Where the file cannot be read, or says that z is a solution, or that there is none, and this is not so. Then
        `icpmodel.certify(problem, z)` says how far off z is, with z of `numpy.load(path)`.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_solution(ICP([[2.0]], [-1.0]).solve("mnmgs"), f"{folder}/s.npz")
    ...     again = load_solution(f"{folder}/s.npz")
    >>> again.status, again.z, again.method, again.error_bound < 1e-14
    (<Status.SOLVED: 'solved'>, array([0.5]), MNMGS(), True)
    """
    path, limits = as_path(path), Limits(rtol=rtol, atol=atol, max_iter=0, time_limit=None, accuracy=accuracy)
    if path.suffix.lower() in WRITTEN[1:] and path.is_file():
        raise FileError(f"{path}: holds numbers alone; an .npz file was expected, or see icpmodel.certify(problem, z)")
    given = None if problem is None else as_problem(problem)
    with read_archive(path, _SOLUTION) as archive:
        if given is None and "A_indptr" not in archive.names:
            raise FileError(f"{path}: holds no problem, as psi was Python code; give it: load_solution(path, problem)")
        held = stored_problem(archive) if given is None else given
        z, about = archive.vector("z", held.n), as_json(f"{path}: field about", archive.text("about"))
        size = held.n if held.psi.is_constant else 2 * held.n
        witness = archive.vector("witness", size) if "witness" in archive.names else np.zeros(size)
    return _judged(path, _Record(path, about), held, z, witness, limits)


def read_start(path: Path, n: int) -> Vector:
    """z, shape (n,), of what `save_solution` wrote in any form, or a vector in any other file, to start from. Raises
    FileError."""
    found = _start(path, n)
    try:
        return as_vector(found, n, "z")
    except InputError as error:
        raise FileError(f"{path}: {error}") from error


def _start(path: Path, n: int) -> Any:
    suffix = path.suffix.lower()
    if suffix == ".npz":
        with read_archive(path) as archive:
            if archive.is_ours:
                archive.check(_SOLUTION)
                return archive.vector("z", n)
    if suffix == ".csv" and _is_text(path):
        return read_text(path, _HEADS)[:, 0]
    found = read_values(path, "z", n)
    return found[0] if np.shape(found) == (3, n) else found


def _problem_fields(problem: ProblemData) -> dict[str, Any]:
    try:
        fields = problem_fields(problem)
    except InputError:
        return {}
    return fields | {"sides": np.array("psi upper" if "upper" in fields else "psi")}


def _is_text(path: Path) -> bool:
    with opened(path) as (file, _):
        return file.readline(len(_HEADS) + 2).strip() == _HEADS.encode()


def _check_saved(path: Path) -> None:
    """Raise FileError unless `path` holds the numbers of a solution, by all that can be seen of it."""
    if path.suffix.lower() == ".npy":
        right = lambda shape, dtype: shape[:-1] == (3,) and dtype == np.float64  # noqa: E731
        with opened(path) as (file, size):
            read_array(file, size, f"{path}: it", "z, p and r", right)
    elif not _is_text(path):
        raise FileError(f"{path}: its first line is not {_HEADS!r}")


class _Record:
    """What a file says `about` its solution, field by field, each of the type that it should have."""

    def __init__(self, path: Path, about: Any) -> None:
        self.path, self.about = path, about if isinstance(about, dict) else {}

    def _wrong(self, name: str, wanted: str) -> FileError:
        return FileError(f"{self.path}: field about has {name} = {self.about.get(name)!r:.80}; {wanted} was expected")

    def text(self, name: str) -> str:
        """A text, in which nothing moves the cursor of a terminal."""
        value = self.about.get(name)
        if not isinstance(value, str):
            raise self._wrong(name, "a text")
        return "".join(letter if letter.isprintable() or letter == "\n" else "?" for letter in value)

    def number(self, name: str) -> Any:
        """A number ≥ 0."""
        value = self.about.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < math.inf:
            raise self._wrong(name, "a number >= 0")
        return value

    def status(self) -> Status:
        try:
            return Status(self.about.get("status"))
        except ValueError:
            raise self._wrong("status", f"one of {', '.join(one.value for one in Status)}") from None


def _judged(path: Path, record: _Record, problem: ProblemData, z: Vector, witness: Vector, limits: Limits) -> Solution:
    """The solution `z` of `problem` with what is on `record`, as far as that holds. Raises FileError."""
    called = [record.text(name) for name in ("method", "settled", "last_method")]
    known = {text: Remembered(called=text) for text in called}  # one object for what is the same
    method, settled, last = (known[text] for text in called)
    status, scale = record.status(), problem.residual_scale()
    goal = Goal(limits.tolerance(scale), problem, limits.atol, of_z=0.0 if scale else limits.rtol)
    residual = problem.residual(z)
    if status is Status.SOLVED and limits.accuracy is None:
        residual = goal.judged(z, residual)
    proof = infeasible(problem, witness) if status is Status.INFEASIBLE else None
    found = Solution(
        problem=problem,
        z=z,
        status=status,
        message=record.text("message"),
        method=method,
        settled=settled,
        last_method=last,
        why="; ".join(filter(None, [record.text("why"), f"read from {path}"])),
        residual=residual,
        tolerance=goal.tolerance_at(z),
        atol=limits.atol,
        iterations=int(record.number("iterations")),
        seconds=float(record.number("seconds")),
        accuracy=limits.accuracy,
        infeasible=proof,
    )
    if proof is not None and not proof.holds:
        raise FileError(f"{path}: says that there is no solution, but its witness is no proof of that on {problem!r}")
    if status is Status.SOLVED:
        bound = found.error_bound if limits.accuracy else None
        if limits.accuracy:
            holds = bound is not None and bound <= limits.accuracy
            off = f"its error bound is {bound}, and {limits.accuracy:.3g} was wanted"
        else:
            holds = goal.reached(z, residual)
            off = f"Res_D(z) = {residual:.3g} on {problem!r}, and at most {found.tolerance:.3g} was wanted"
        if not holds:
            raise FileError(
                f"{path}: says that it is solved, but {off}: it was asked for less, which rtol, atol or accuracy of "
                "load_solution can allow, is of another problem, or was changed; icpmodel.certify(problem, z) says "
                "what is true of z"
            )
    return found
