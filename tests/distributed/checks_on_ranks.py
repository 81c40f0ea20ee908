"""What holds on any number of ranks: run by `mpiexec -n RANKS python checks_on_ranks.py`, rank 0 tells in JSON which
checks failed, and how."""

import json
import sys
import traceback

import numpy as np
import scipy.sparse as sp
from mpi4py import MPI
from petsc4py import PETSc

import icpmodel as icp
from icpmodel.distributed import by_rows, certify, distribute, solve

COMM = MPI.COMM_WORLD
#: the answers of both are within their bounds of z*, and these are far below
NEAR = 1e-6


def whole(vector):
    """All entries of a `Vec` or of own rows, on every rank."""
    return np.concatenate(COMM.allgather(np.array(getattr(vector, "array_r", vector))))


def transport(n=400):
    return icp.scenes.membrane(n=n, skew=0.7).problem


def coupled(n=400):
    """A membrane whose obstacle at each point follows the membrane at the next point."""
    problem = icp.scenes.membrane(n=n).problem
    G = sp.diags_array([np.full(problem.n - 1, 0.3)], offsets=[1], shape=(problem.n, problem.n))
    return problem.with_psi(icp.Affine(G, problem.psi.c))


def moving(n=400):
    """A membrane whose obstacle gives way where it is pressed upwards."""
    c = icp.scenes.membrane(n=n).problem.psi.c
    psi = icp.Elementwise(lambda z: 0.3 * np.sin(z), lambda z: 0.3 * np.cos(z), lipschitz=0.3, c=c)
    return icp.scenes.membrane(n=n).problem.with_psi(psi)


def between(n=400):
    problem = icp.scenes.membrane(n=n).problem
    return problem.with_sides(problem.psi.c, 0.3 + np.abs(problem.psi.c - 0.2))


PROBLEMS = {
    "membrane": lambda: icp.scenes.membrane(n=2500).problem,
    "ball": lambda: icp.scenes.ball(n=900).problem,
    "bearing": lambda: icp.scenes.bearing(n=300).problem,
    "transport": transport,
    "coupled": coupled,
    "moving": moving,
    "between": between,
    "one unknown": lambda: icp.ICP([[2.0]], [-2.0]),
    "two unknowns": lambda: icp.scenes.hand_lcp().problem,
    "no obstacle": lambda: icp.ICP(icp.scenes.membrane(n=100).problem.A, -np.ones(100), -np.inf),
    "positive off the diagonal": lambda: icp.ICP([[4, 1, 0], [1, 4, 1], [0, 1, 4]], [-1.0, 2.0, -3.0]),
}


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
    for name, sizes in (("membrane", (900, 10_000, 40_000)), ("ball", (10_000, 40_000)), ("obstacle-3d", (10_000,))):
        counts = [solve(by_rows(icp.scenes.by_rows(name, n))).iterations for n in sizes]
        assert max(counts) <= 2, (name, counts)


def check_where_rounding_allows_no_more_that_is_said():
    """The film of a long bearing, whose stiffness grows as n squared."""
    found = solve(by_rows(icp.scenes.by_rows("bearing", 50_000)), raise_on_failure=False)
    assert found.status.value == "precision limit", found.message
    assert found.iterations < 20


def raised(call):
    """The error that every rank gets, which must be the same one."""
    try:
        call()
    except Exception as error:
        told = f"{type(error).__name__}: {error}"
    else:
        told = ""
    every = COMM.allgather(told)
    assert len(set(every)) == 1, every
    return told


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
    assert told == f"MapError: psi.f(z) raised ZeroDivisionError: division by zero{where}"

    class Broken(Rows):
        def local_rows(self, lo, hi):
            return faulty(None, super().local_rows(lo, hi))

    assert "TypeError" in raised(lambda: by_rows(Broken(PROBLEMS["membrane"]())))


def check_wrong_arguments_are_told():
    problem = distribute(PROBLEMS["two unknowns"]())
    assert raised(lambda: solve(np.eye(2), np.ones(2))).startswith("InputError: A is")
    assert raised(lambda: solve(problem, rtol=2.0)).startswith("InputError: rtol is 2.0")
    assert raised(lambda: solve(problem, problem.q)).startswith("InputError: A is a DistributedICP")
    assert raised(lambda: distribute(problem, comm=3)).startswith("InputError: comm is a int")
    assert "constant, affine or elementwise" in raised(lambda: distribute(icp.ICP([[2.0]], [1.0], psi=np.sin)))
    upside_down = icp.ICP([[-1.0, 0.0], [0.0, 1.0]], [1.0, 1.0])
    assert "diagonal" in raised(lambda: solve(distribute(upside_down)))


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
    for name, check in list(globals().items()):
        if name.startswith("check_"):
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
