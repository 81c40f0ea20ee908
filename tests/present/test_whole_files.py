"""Whatever is written is written whole, in the place of nothing else, and not through a link."""

import resource
from contextlib import contextmanager

import pytest
from known_answers import PAIR

import icpmodel as icp
from icpmodel.present.whole_files import write_ours
from icpmodel.study.charts.figures import figure, save
from icpmodel.study.html_report import GENERATOR

SOLUTION = icp.ICP(PAIR, [-1.0, 3.0]).solve(history=True)
REPORT = icp.crosscheck(SOLUTION.problem, SOLUTION, solvers=["osqp"])
TABLE = REPORT.table()
PAGE = b"<html>" + GENERATOR + b"</html>"
WRITERS = {
    "problem.npz": lambda path: icp.save_problem(SOLUTION.problem, path),
    "solution.npz": lambda path: icp.save_solution(SOLUTION, path),
    "solution.csv": lambda path: icp.save_solution(SOLUTION, path),
    "report.csv": REPORT.to_csv,
    "report.json": REPORT.to_json,
    "picture.png": SOLUTION.plot,
    "picture.pdf": SOLUTION.plot,
    "picture.svg": SOLUTION.plot,
    "data.csv": lambda path: save(figure(SOLUTION), path.with_suffix(".png"), TABLE, "icpmodel race"),
    "page.html": lambda path: write_ours(path, PAGE, holds=GENERATOR),
}
each = pytest.mark.parametrize("name", WRITERS)


@contextmanager
def room_for(size):
    """No file may grow beyond `size` bytes: what a full disk looks like."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@each
def test_a_full_disk_leaves_the_old_file_alone(name, tmp_path):
    path = tmp_path / name
    WRITERS[name](path)
    names, before = sorted(tmp_path.iterdir()), path.read_bytes()
    for size in (0, 1, len(before) // 2, len(before) - 1):
        with room_for(size), pytest.raises(icp.FileError, match="cannot be written"):
            WRITERS[name](path)
        assert path.read_bytes() == before
        assert sorted(tmp_path.iterdir()) == names


@each
def test_only_what_the_same_function_writes_is_replaced(name, tmp_path):
    path, empty, folder, link, real = (tmp_path / f"{which}{name}" for which in ("f-", "e-", "d-", "l-", "r-"))
    WRITERS[name](real)
    before = real.read_bytes()
    path.write_bytes(b"x,y\n1,2\n")
    folder.mkdir()
    link.symlink_to(real)
    for taken in (path, folder, link):
        with pytest.raises(icp.FileError):
            WRITERS[name](taken)
    assert path.read_bytes() == b"x,y\n1,2\n"
    assert real.read_bytes() == before
    empty.touch()  # as the names of temporary files are kept
    for free in (empty, real):
        WRITERS[name](free)
        assert free.stat().st_size > 0
