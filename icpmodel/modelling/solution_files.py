"""Solutions on disk: complete as `.npz`, or only the numbers for other programs.

- `.npz`: z, p, r, the status and the certificate as JSON text, and the problem if ψ can be saved.
- `.csv`: the header z,p,r, and one line for each row of the problem.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import suppress
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..algebra.subproblems import with_fixed_obstacle
from ..errors import FileError, InputError, NotApplicable, check_arguments
from ..methods.contract import Iterate, Method, with_options
from ..methods.enumeration import Enumerate
from ..numerics.arrays import Vector, as_float64, as_vector, described
from ..present.whole_files import as_path, check_ours, check_suffix, file_errors, write_whole
from ..problem.data import ProblemData, ProblemLike, as_problem
from ..solve.driver import solve
from ..solve.goal import RTOL, Goal, Limits
from ..solve.last_resort import DEFAULT_SECONDS
from ..solve.solution import Solution, Status
from ..theory.answers import Answer
from ..theory.certificates.infeasible import infeasible
from .archive import check_free, check_kind, content_errors, read_arrays, text_of, write_arrays
from .files import SOLUTION, Source, check_has_problem, problem_of, problem_parts
from .formats import read_text, read_values

#: the first line of a solution as text
_HEADS = "z,p,r"
WRITABLE_SUFFIXES = (".npz", ".csv")


@with_options
class FromFile(Method):
    """The method of an answer that was read from the file `path`."""

    path: str

    def why_not(self, problem: ProblemData) -> str | None:
        return f"the answer was read from {self.path}; name a method"

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        raise NotApplicable(self.why_not(problem))


@check_arguments
def save_solution(solution: Solution, path: str | PathLike[str]) -> None:
    """Write `solution` to the file `path`.

    Parameters
    ----------
    solution : Solution
        The answer.
    path : str or path
        `.npz` for all that `load_solution` reads: z, the status, the certificate, the options, and the problem unless
        ψ is Python code. `.csv` for z, p and r only, one line for each row below the header z,p,r.

    Raises
    ------
    InputError
        For an object that is not a Solution.
    FileError
        Where the path cannot be written or has another suffix. Only a file of the same kind is replaced.

    Examples
    --------
    >>> import tempfile
    >>> solution = ICP([[2.0]], [-1.0]).solve()
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_solution(solution, f"{folder}/s.npz")
    ...     load_solution(f"{folder}/s.npz").z, np.load(f"{folder}/s.npz")["p"]
    (array([0.5]), array([0.]))
    """
    if not isinstance(solution, Solution):
        raise InputError(f"solution is {described(solution)}; what solve returns was expected")
    path = as_path(path)
    check_suffix(path, WRITABLE_SUFFIXES)
    parts: dict[str, Any] = {"z": solution.z, "p": solution.p, "r": solution.r}
    if path.suffix.lower() == ".csv":
        rows = np.array(list(parts.values())).T
        write_whole(
            path,
            lambda file: np.savetxt(file, rows, "%.17g", ",", header=_HEADS, comments=""),
            lambda: check_place(path),
        )
        return
    if solution.infeasible is not None and solution.infeasible.witness is not None:
        parts["witness"] = np.array(solution.infeasible.witness, dtype=np.float64)
    with suppress(InputError):  # ψ may have no file form
        parts |= problem_parts(solution.problem)
    write_arrays(path, SOLUTION, parts | {"about": np.array(json.dumps(solution.about()))})


def check_place(path: Source) -> None:
    """Raise FileError where `save_solution` would: if `path` has another suffix, or is another file."""
    place = as_path(path)
    check_suffix(place, WRITABLE_SUFFIXES)
    with file_errors(place, "written"):
        if place.suffix.lower() == ".npz":
            check_free(place, SOLUTION)
        else:
            check_ours(place, begins=f"{_HEADS}\n".encode())


@check_arguments
def load_solution(
    path: Source,
    problem: ProblemLike | None = None,
    *,
    rtol: float = RTOL,
    atol: float = 0.0,
    accuracy: float | None = None,
) -> Solution:
    """Read what `save_solution` wrote to an `.npz` file.

    The file is not trusted: p, r, the residual, the tolerance, the proof that there is no solution, and the
    certificate are computed from z and the problem. If the run had looser tolerances than the default, give them here
    as well. Only why a run stopped unsolved, its steps, seconds and method are taken from the file.

    Parameters
    ----------
    path : str or path
        An `.npz` file by `save_solution`.
    problem : ICP, optional
        The problem, by default the one in the file. It is required if ψ is Python code.
    rtol, atol, accuracy : float, optional
        What a solution has to satisfy to be called solved, as in `solve`.

    Returns
    -------
    Solution
        The answer, with the tolerance that follows from `rtol` and the problem.

    Raises
    ------
    FileError
        Where the file cannot be read, or states wrongly that z is a solution, or without proof that there is none. Then
        `icpmodel.certify(problem, z)` tells how far off z is, with z from `numpy.load(path)`.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_solution(ICP([[2.0]], [-1.0]).solve("mnmgs"), f"{folder}/s.npz")
    ...     again = load_solution(f"{folder}/s.npz")
    >>> again.status, again.z, again.error_bound < 1e-14
    (<Status.SOLVED: 'solved'>, array([0.5]), True)
    """
    path = as_path(path)
    limits = Limits(rtol=rtol, atol=atol, max_iter=0, time_limit=None, accuracy=accuracy)
    if path.suffix.lower() == ".csv" and path.is_file():
        raise FileError(f"{path}: holds numbers alone; an .npz file was expected, or see icpmodel.certify(problem, z)")
    data = None if problem is None else as_problem(problem, nonlinear=True)
    fields = read_arrays(path)
    check_kind(path, fields, SOLUTION)
    if data is None:
        check_has_problem(path, fields)
    stored = problem_of(fields, dict.fromkeys(fields, path)) if data is None else data
    about = _as_json(f"{path}: field about", text_of(path, fields, "about"))
    return _judge_answer(path, about if isinstance(about, dict) else {}, stored, fields, limits)


def read_start(path: Path, n: int) -> Vector:
    """Read a start, shape (n,): z of a file by `save_solution`, or the vector in any other file.

    Raises FileError.
    """
    if path.suffix.lower() == ".csv" and path.is_file() and path.read_bytes().startswith(f"{_HEADS}\n".encode()):
        return _vector(path, read_text(path, _HEADS)[:, 0], n, "z")
    if path.suffix.lower() == ".npz" and "about" in (fields := read_arrays(path)):
        check_kind(path, fields, SOLUTION)
        return _vector(path, fields.get("z"), n, "z")
    return _vector(path, read_values(path, "z", n), n, "z")


def _vector(path: Path, value: Any, n: int, name: str) -> Vector:
    with content_errors(path):
        return as_vector(value, n, name)


def _known(path: Path, about: dict[str, Any], name: str, expected: str) -> Any:
    """The field `name` of the JSON text: "a text", cleared of control characters, or "a number >= 0"; or FileError."""
    value = about.get(name)
    if expected == "a text" and isinstance(value, str):
        # no character may move the cursor of a terminal
        return "".join(letter if letter.isprintable() or letter == "\n" else "?" for letter in value)
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and 0.0 <= value <= sys.float_info.max
    if expected == "a number >= 0" and is_number:
        return value
    raise FileError(f"{path}: field about has {name} = {value!r:.80}; {expected} was expected")


def _proof(problem: ProblemData, witness: Any) -> Answer | None:
    """The proof that there is no solution, if any, by the `witness` in a file or, if that fails, by another run."""
    with suppress(InputError):
        y = as_float64(witness, "witness").ravel()
        for one in (problem, with_fixed_obstacle(problem)):  # where y has another size it proves nothing
            if (answer := infeasible(one, y)).holds:
                return answer
    if Enumerate().why_not(problem) is None:
        solution = solve(problem, Enumerate(), raise_on_failure=False)
    else:
        solution = solve(problem, time_limit=DEFAULT_SECONDS, raise_on_failure=False)
    if solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return solution.infeasible


def _judge_answer(
    path: Path, about: dict[str, Any], problem: ProblemData, fields: dict[str, Any], limits: Limits
) -> Solution:
    """The solution of `problem` in the `fields` of a file. Raises FileError if its status does not hold."""
    z = _vector(path, fields.get("z"), problem.n, "field z")
    try:
        status = Status(about.get("status"))
    except ValueError:
        expected = ", ".join(one.value for one in Status)
        raise FileError(f"{path}: field about has status = {about.get('status')!r}; one of {expected}") from None
    scale = problem.residual_scale()
    goal = Goal(limits.tolerance(scale), problem, limits.atol, rtol_of_z=0.0 if scale else limits.rtol)
    residual = problem.residual(z)
    if status is Status.SOLVED and limits.accuracy is None:
        residual = goal.judged(z, residual)
    proof = None
    if status is Status.INFEASIBLE:
        proof = _proof(problem, fields.get("witness"))
        if proof is None or not proof.holds:
            raise FileError(f"{path}: says that there is no solution, which is not proved of {problem!r}")
    method = FromFile(path=str(path))
    solution = Solution(
        problem=problem,
        z=z,
        status=status,
        message=_known(path, about, "message", "a text"),
        method=method,
        adapted_method=method,
        last_method=method,
        why=f"found by {_known(path, about, 'method', 'a text')}; read from {path}",
        residual=residual,
        tolerance=goal.tolerance_at(z),
        atol=limits.atol,
        iterations=int(_known(path, about, "iterations", "a number >= 0")),
        seconds=float(_known(path, about, "seconds", "a number >= 0")),
        accuracy=limits.accuracy,
        infeasible=proof,
    )
    if status is Status.SOLVED:
        _check_solved(path, solution, goal)
    return solution


def _check_solved(path: Path, solution: Solution, goal: Goal) -> None:
    """Raise FileError if an answer that the file calls solved is not."""
    if solution.accuracy:
        bound = solution.error_bound
        holds = bound is not None and bound <= solution.accuracy
        off = f"its error bound is {bound}, and {solution.accuracy:.3g} was wanted"
    else:
        holds = goal.reached(solution.z, solution.residual)
        limit = f"at most {solution.tolerance:.3g} was wanted"
        off = f"Res_D(z) = {solution.residual:.3g} on {solution.problem!r}, and {limit}"
    if not holds:
        raise FileError(
            f"{path}: says that it is solved, but {off}. It was solved to another tolerance (give that as rtol, atol "
            "or accuracy of load_solution), is of another problem, or was changed; icpmodel.certify(problem, z) "
            "certifies z"
        )


def _as_json(where: str | Path, text: str) -> Any:
    """The content of the JSON `text`. Raises FileError."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileError(f"{where}: is not JSON ({error})") from error
