"""What holds on any number of ranks: `mpiexec -n RANKS python checks_on_ranks.py` tells in JSON which checks failed,
and how; parts of names may follow."""

import json
import resource
import sys
import traceback
from pathlib import Path
from urllib.error import HTTPError

import checks_of_files
import numpy as np
import scipy.sparse as sp
from mpi4py import MPI
from petsc4py import PETSc
from ranked_problems import COMM, NEAR, PROBLEMS, coupled, raised, whole

import icpmodel as icp
from icpmodel.distributed import DistributedICP, by_rows, certify, distribute, solve
from icpmodel.distributed.distributed_matrix import from_rows


def check_the_answer_is_that_of_one_process():
    for name, make in PROBLEMS.items():
        problem = make()
        expected = problem.solve(rtol=1e-10)
        found = solve(distribute(problem), rtol=1e-10)
        z = whole(found.z)
        assert np.abs(z - expected.z).max() < NEAR, (name, np.abs(z - expected.z).max())
        assert np.isclose(problem.residual(z), found.residual, rtol=1e-3, atol=1e-13), name
        assert found.residual <= found.tolerance, name
        assert found.problem.low == len(whole(found.z.array_r)) * COMM.rank // COMM.size, name


def check_the_bound_holds_and_proves_what_it_does_on_one_process():
    for name, make in PROBLEMS.items():
        problem = make()
        known = problem.solve(rtol=1e-13, raise_on_failure=False)
        here = problem.certify(known.z).bound
        found = solve(distribute(problem))
        certificate = found.certify()
        bound = certificate.bound
        assert bound.unique == here.unique, (name, bound, here)
        if bound.unique:
            off = np.abs(whole(found.z) - known.z)
            assert (off <= whole(bound.componentwise) + here.componentwise).all(), name
            assert bound.value == whole(bound.componentwise).max()
            assert bound.euclidean >= np.linalg.norm(off) - here.euclidean


def check_the_rows_that_are_decided_are_those_of_one_process():
    problem = PROBLEMS["membrane"]()
    known = problem.solve(rtol=1e-13, raise_on_failure=False).active_set
    certificate = solve(distribute(problem), rtol=1e-12).certify()
    active, inactive = whole(certificate.own_active), whole(certificate.own_inactive)
    assert not (active & known.inactive).any()
    assert not (inactive & known.active).any()
    assert certificate.active == active.sum() > 0
    assert certificate.inactive == inactive.sum() > 0
    assert certificate.active + certificate.inactive + certificate.above + certificate.undecided == problem.n


def check_the_bound_of_a_wrong_z_holds_as_well():
    problem = PROBLEMS["ball"]()
    exact, spread = problem.solve(rtol=1e-12).z, distribute(problem)
    wrong = exact + 0.1 * np.sin(np.arange(problem.n))
    bound = certify(spread, spread.vector(wrong[spread.low : spread.high])).bound
    assert bound.unique
    assert (whole(bound.componentwise) >= np.abs(wrong - exact)).all()


def check_of_a_matrix_without_stored_diagonal_nothing_is_proved():
    A = sp.csr_array([[0.0, 1, 0], [1, 0, 0], [0, 0, 2]])
    problem = by_rows(icp.ByRows((3,), lambda lo, hi: (A[lo:hi], 1.0, 0.0)))
    certificate = certify(problem, problem.vector())
    assert "diagonal is not positive" in certificate.bound.reason
    assert certificate.undecided == 3


def check_data_whose_squares_over_or_underflow_are_solved():
    for make in (PROBLEMS["two unknowns"], coupled):
        problem = make()
        expected = problem.solve(rtol=1e-10).z
        for unit in (1e-300, 1e-158, 1e158, 1e290):
            psi = icp.Affine(problem.psi.G, unit * problem.psi.c) if make is coupled else 0.0
            found = solve(distribute(icp.ICP(problem.A, unit * problem.q, psi)), rtol=1e-10)
            assert np.abs(whole(found.z) / unit - expected).max() < NEAR, unit
            assert found.certify().bound.value < NEAR * unit, unit


def check_nothing_is_proved_where_nothing_is_true():
    """⟨A⟩ is singular, so A is no H-matrix."""
    problem = icp.ICP([[1.0, -1.0, 0], [-1.0, 2.0, -1.0], [0, -1.0, 1.0]], [1.0, 1.0, 1.0])
    bound = solve(distribute(problem)).certify().bound
    assert not bound.unique
    assert "H+" in bound.reason


def check_what_one_process_holds_is_sent():
    problem = coupled()
    given = problem if COMM.rank == 0 else None
    assert np.allclose(whole(solve(distribute(given)).z), problem.solve().z, atol=NEAR)


class Rows:
    """The scene by rows, as whoever assembles his own would."""

    def __init__(self, problem):
        self.problem, self.n, self.asked = problem, problem.n, []

    def local_rows(self, lo, hi):
        self.asked.append((lo, hi))
        problem = self.problem
        return problem.A[lo:hi], problem.q[lo:hi], problem.psi.c[lo:hi]


def check_every_rank_assembles_its_own_rows_only():
    rows = Rows(PROBLEMS["membrane"]())
    made = by_rows(rows)
    assert rows.asked == [(made.low, made.high)]
    assert np.allclose(whole(solve(made).z), rows.problem.solve().z, atol=NEAR)


def both(problem, between=False):
    """The membrane on ranks, and ψ(z) = Gz + 0.3 sin z + c and the one above it, of whole vectors."""
    G, c, rows = problem.psi.G, problem.psi.c, slice(*distribute(problem).A.getOwnershipRange())
    mat = from_rows(G[rows], COMM)

    def side(lift, derivative=None):
        f = icp.Elementwise(lambda z: 0.3 * np.sin(z), derivative, lipschitz=0.3, c=c[rows] + lift)
        return (mat, f), lambda z: G @ z + 0.3 * np.sin(z) + c + lift

    (psi, below), (upper, above) = side(0.0), side(0.1, lambda z: 0.3 * np.cos(z))
    made = DistributedICP(distribute(problem).A, problem.q[rows], psi, upper if between else None)
    return made, below, above if between else lambda z: np.full(problem.n, np.inf)


def check_an_obstacle_that_moves_with_its_own_unknown_and_with_others_is_solved_and_certified():
    """z solves such a problem if and only if it solves that with the obstacles held where they are at z."""
    for between in (False, True):
        problem = coupled()
        made, below, above = both(problem, between)
        found = solve(made, rtol=1e-10)
        z, bound = whole(found.z), found.certify().bound
        held = problem.with_sides(below(z), above(z)) if between else problem.with_psi(below(z))
        assert np.abs(held.solve(rtol=1e-12).z - z).max() < NEAR
        assert bound.unique
        assert bound.value < NEAR
        assert found.iterations < 10


def check_a_map_that_fails_on_the_way_ends_the_run_of_all_ranks_with_its_best_iterate():
    problem, last = coupled(), COMM.size - 1
    spread, mat = distribute(problem), both(problem)[0].psi.G
    c = problem.psi.c[spread.low : spread.high]
    for after, fault, told in (
        (20, float("nan"), "psi is nan in row "),
        (4, float("nan"), "nan"),
        (4, None, "is None"),
    ):
        calls = []

        def f(z, calls=calls, after=after, fault=fault):
            calls.append(z)
            wrong = COMM.rank == last and len(calls) > after
            return 0.1 * z if not wrong else fault if fault is None else np.full(z.size, fault)

        found = solve(
            spread.A, spread.q, (mat, icp.Elementwise(f, lipschitz=0.1, c=c)), rtol=1e-14, raise_on_failure=False
        )
        assert found.status is icp.Status.MAP_FAILED, found.message
        assert told in found.message, found.message
        assert COMM.allgather(found.message) == [found.message] * COMM.size
        assert np.isfinite(found.residual)


def check_petsc_objects_of_a_user_are_taken():
    problem = coupled()
    low, high = PETSc.Vec().createMPI(problem.n).getOwnershipRange()

    def mat(matrix):
        rows, size = matrix[low:high], (high - low, problem.n)
        made = PETSc.Mat().createAIJ((size, size), csr=(rows.indptr, rows.indices, rows.data))
        made.assemble()
        return made

    A, G = mat(problem.A), mat(problem.psi.G)
    q, c = A.createVecLeft(), A.createVecLeft()
    q.array, c.array = problem.q[low:high], problem.psi.c[low:high]
    found = solve(A, q, (G, c))
    assert np.allclose(whole(found.z), problem.solve().z, atol=NEAR)
    again = solve(A, q, (G, c), z0=found.z)
    assert again.iterations == 0
    assert np.array_equal(again.z.array, found.z.array)


def check_iterations_grow_neither_with_ranks_nor_with_n():
    """What is left where the active set has settled is solved for at once, so that luck does not decide how often."""
    if not PETSc.Sys.hasExternalPackage("hypre"):
        return  # with GAMG they grow: 4, 9, 12
    for name, sizes in (("membrane", (900, 10_000, 40_000)), ("ball", (10_000, 40_000)), ("obstacle-3d", (10_000,))):
        counts = [solve(by_rows(icp.scenes.by_rows(name, n))).iterations for n in sizes]
        assert max(counts) <= 2, (name, counts)


def check_no_newton_step_is_taken_where_as_many_sweeps_again_are_enough():
    problem = by_rows(icp.scenes.by_rows("membrane", n=2500))
    started = solve(problem, rtol=1e-13, max_iter=0, raise_on_failure=False)
    assert started.status is icp.Status.ITERATION_LIMIT
    share = started.residual / problem.residual(problem.vector())
    assert solve(problem, rtol=share / 1.02, max_iter=0).solved
    far = solve(problem, rtol=share / 10.0, max_iter=0, raise_on_failure=False)
    assert far.residual == started.residual  # nothing was tried that could not be enough


def check_what_a_solve_took_is_given_back():
    """Once some have grown the heap, five more take the memory of a few vectors; each makes about a hundred."""
    if not Path("/proc/self/statm").exists():
        return  # who asks for resident memory elsewhere gets its largest value so far
    problem = by_rows(icp.scenes.by_rows("ball", 40_000))

    def resident():
        for _ in range(5):
            solve(problem).certify()
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()

    resident()
    before = resident()
    grown, vector = resident() - before, 8 * 40_000 / COMM.size
    assert grown < 20 * vector, (grown / vector, "vectors")


def check_where_rounding_allows_no_more_that_is_said():
    """The film of a long bearing, whose stiffness grows as n squared."""
    found = solve(by_rows(icp.scenes.by_rows("bearing", 50_000)), raise_on_failure=False)
    assert found.status.value == "precision limit", found.message
    assert found.iterations < 20


def check_what_one_rank_finds_wrong_all_ranks_raise():
    problem, last = distribute(PROBLEMS["membrane"]()), COMM.size - 1
    where = f" (rank {last} of {COMM.size})" if COMM.size > 1 else ""
    size = problem.high - problem.low

    def faulty(bad, good):
        return bad if COMM.rank == last else good

    A, q = problem.A, problem.q
    told, there = raised(lambda: solve(A, faulty(np.ones(size + 1), q))), COMM.bcast(size, root=last)
    assert told == f"InputError: q has shape ({there + 1},) on this rank; ({there},) was expected{where}"
    assert "psi" in raised(lambda: solve(A, q, faulty(np.full(size, np.nan), np.zeros(size))))
    assert "lipschitz" in raised(lambda: solve(A, q, faulty(np.sin, 0.0)))
    assert "upper" in raised(lambda: solve(A, q, 0.0, faulty(np.full(size, -1.0), 1.0)))

    def nan(z):
        return faulty(np.full(z.size, np.nan), 0.1 * z)

    def fails(z):
        return faulty(1 / 0 if COMM.rank == last else 0, 0.1 * z)

    told = raised(lambda: solve(A, q, icp.Elementwise(nan, lipschitz=0.5)))
    assert told.startswith("MapError: psi is nan in row "), told
    assert told.endswith(f"at the start{where}"), told
    told = raised(lambda: solve(A, q, icp.Elementwise(fails, lipschitz=0.5)))
    assert told == f"MapError: Elementwise.f(z) raised ZeroDivisionError: division by zero{where}"

    class Broken(Rows):
        def local_rows(self, lo, hi):
            return faulty(None, super().local_rows(lo, hi))

    assert raised(lambda: by_rows(Broken(PROBLEMS["membrane"]()))).startswith("InputError: rows(")


def check_an_error_of_any_class_and_an_exit_on_one_rank_are_raised_on_all():
    class Unsendable(OSError):
        pass

    class Mute(Exception):
        def __str__(self):
            raise ValueError

    class Ending(Rows):
        def local_rows(self, lo, hi):
            if COMM.rank == COMM.size - 1:
                raise fault
            return super().local_rows(lo, hi)

    for fault, told in (
        (Unsendable("no disk"), "OSError: Unsendable: no disk"),
        (HTTPError("", 404, "none", {}, None), "OSError: HTTPError: HTTP Error 404: none"),
        (Mute(), "FailedOnRank: Mute: its text raised ValueError"),
        (SystemExit("no data"), "FailedOnRank: SystemExit: no data"),
    ):
        assert raised(lambda: by_rows(Ending(PROBLEMS["two unknowns"]()))).startswith(told), fault


class Unreadable:
    """A function of ψ that can be sent, and read on no rank."""

    def __call__(self, z):
        return 0.1 * z

    def __reduce__(self):
        return int, ("nine",)


def check_a_map_that_another_rank_cannot_read_is_an_error_of_all():
    problem = icp.ICP(2.0 * np.eye(6), -np.ones(6), icp.Elementwise(Unreadable(), lipschitz=0.1))
    told = raised(lambda: distribute(problem if COMM.rank == 0 else None))
    assert told.startswith("FailedOnRank: ValueError: invalid literal") or COMM.size == 1, told


def check_a_point_that_is_no_vector_of_the_problem_is_told():
    problem = distribute(PROBLEMS["two unknowns"]())
    longer = PETSc.Vec().createMPI(7)
    nan = problem.vector(np.full(problem.high - problem.low, np.nan))
    for z, told in ((np.zeros(2), "an ndarray"), (0.0, "0.0"), (PETSc.Vec(), "a Vec")):
        assert raised(lambda z=z: solve(problem, z0=z)).startswith(f"InputError: z0 is {told}; a petsc4py.PETSc.Vec")
        assert raised(certify, problem, z).startswith(f"InputError: z is {told}; a petsc4py.PETSc.Vec")
        assert raised(problem.residual, z) == raised(problem.paper_residual, z) == raised(certify, problem, z)
    assert "z0 has the sizes" in raised(lambda: solve(problem, z0=longer))
    assert "z has the sizes" in raised(certify, problem, longer)
    assert "z0[0] is nan" in raised(lambda: solve(problem, z0=nan))
    assert certify(problem, nan).bound.value is None
    assert raised(certify, PROBLEMS["two unknowns"](), nan).startswith("InputError: problem is an ICP")
    assert "levels is 3" in raised(certify, problem, problem.vector(), 3)


def check_rows_and_obstacles_that_ranks_do_not_share_are_told():
    problem = PROBLEMS["two unknowns"]()
    for wrong in (3, None, problem):
        assert "an object with n and local_rows" in raised(by_rows, wrong)
    rows = Rows(problem)
    rows.n = 2.5
    assert "problem.n is 2.5" in raised(by_rows, rows)
    if COMM.size == 1:
        return
    rows.n = 2 + COMM.rank
    assert f"problem.n is between 2 and {1 + COMM.size}" in raised(by_rows, rows)
    A, first = distribute(problem).A, COMM.rank == 0
    assert "upper is None on some ranks" in raised(DistributedICP, A, 1.0, 0.0, 2.0 if first else None)
    assert "psi is a pair on some ranks" in raised(DistributedICP, A, 1.0, (A, 0.0) if first else 0.0)


def check_a_q_that_is_no_real_vector_is_told():
    A = distribute(icp.ICP(2.0 * np.eye(6), np.ones(6))).A
    own = A.getLocalSize()[0]
    for q, told in (
        (None, "q is None"),
        ("one", "q is 'one'"),
        (object(), "q is an object"),
        (np.full(own, 1 + 2j), "q is complex"),
        (2j, "q is complex"),
        ([[1.0], [2.0, 3.0]], "q cannot be read"),
        (np.full(own, "1"), "q has dtype"),
        (np.inf, "q[0] is inf"),
    ):
        assert raised(DistributedICP, A, q).startswith(f"InputError: {told}"), told
    assert DistributedICP(A, [1] * own).q.tolist() == [1.0] * own


def check_wrong_arguments_are_told():
    problem = distribute(PROBLEMS["two unknowns"]())
    assert raised(lambda: solve(np.eye(2), np.ones(2))).startswith("InputError: A is")
    assert raised(lambda: solve(problem, rtol=2.0)).startswith("InputError: rtol is 2.0")
    for given in ({"q": problem.q}, {"psi": 1.0}, {"upper": 1.0}):
        assert raised(lambda given=given: solve(problem, **given)).startswith("InputError: A is a DistributedICP")
    assert raised(lambda: distribute(problem, comm=3)).startswith("InputError: comm is 3")
    assert "constant, affine or elementwise" in raised(lambda: distribute(icp.ICP([[2.0]], [1.0], psi=np.sin)))
    upside_down = icp.ICP([[-1.0, 0.0], [0.0, 1.0]], [1.0, 1.0])
    assert "diagonal" in raised(lambda: solve(distribute(upside_down)))


def check_a_matrix_of_another_type_or_not_assembled_is_told():
    A, q = distribute(icp.ICP(2.0 * np.eye(8), np.ones(8))).A, 1.0
    sizes = A.getSizes()
    unassembled = PETSc.Mat().createAIJ(sizes, nnz=1)
    assert raised(DistributedICP, unassembled, q).startswith("InputError: A is not assembled")
    assert raised(DistributedICP, A, q, (unassembled, 0.0)).startswith("InputError: psi[0] is not assembled")
    assert raised(DistributedICP, PETSc.Mat(), q).startswith("InputError: A is a Mat")
    assert raised(DistributedICP, A, q, (PETSc.Mat(), 0.0)).startswith("InputError: psi is a tuple")
    infinite = distribute(icp.ICP(np.eye(8), np.ones(8))).A
    infinite.scale(np.inf)
    assert "psi[0] has an entry that is not finite" in raised(DistributedICP, A, q, (infinite, 0.0))
    blocks = PETSc.Mat().createBAIJ(sizes, 1, nnz=1), PETSc.Mat().createSBAIJ(sizes, 1, nnz=1)
    for other in (*blocks, PETSc.Mat().createDense(sizes)):
        other.setUp()
        other.assemble()
        assert "InputError: A is of PETSc's type" in raised(DistributedICP, other, q)
        assert "InputError: upper[0] is of PETSc's type" in raised(DistributedICP, A, q, -np.inf, (other, 0.0))


def check_limits_end_a_run_with_its_best_iterate():
    problem = distribute(PROBLEMS["ball"]())
    for limit, status in (({"max_iter": 0}, "iteration limit"), ({"time_limit": 0.0}, "time limit")):
        found = solve(problem, **limit, raise_on_failure=False)
        assert found.status.value == status
        assert found.z.getSize() == problem.n
        assert np.isclose(found.residual, problem.residual(found.z))
        assert raised(lambda limit=limit: solve(problem, **limit)).startswith(f"NotSolved: {status}")


def check_what_has_no_solution_ends_without_one():
    """z_1 + z_2 must grow for ever: p = A z + q with A singular, and q < 0 along its null vector."""
    problem = icp.ICP([[1.0, -1.0], [-1.0, 1.0]], [-1.0, -1.0])
    found = solve(distribute(problem), raise_on_failure=False)
    assert not found.solved
    assert found.certify().bound.value is None


def main():
    failures = {}
    for name, check in [*globals().items(), *vars(checks_of_files).items()]:
        if name.startswith("check_") and any(part in name for part in sys.argv[1:] or [""]):
            try:
                check()
                told = ""
            except Exception:
                told = f"rank {COMM.rank}: {traceback.format_exc()}"
            told = [one for one in COMM.allgather(told) if one]
            if told:
                failures[name] = told[0]
            print(
                f"{MPI.Wtime():.1f} {name}: {'failed' if told else 'passed'}", file=sys.stderr
            ) if COMM.rank == 0 else None
    if COMM.rank == 0:
        print(json.dumps(failures))


if __name__ == "__main__":
    main()
