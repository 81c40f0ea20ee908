"""The problems that are solved on ranks, and what the checks there share."""

import numpy as np
import scipy.sparse as sp
from mpi4py import MPI

import icpmodel as icp

COMM = MPI.COMM_WORLD
#: the answers of one process and of ranks are within their bounds of z*, and these are far below
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
    "torsion": lambda: icp.scenes.torsion(n=900).problem,
    "one unknown": lambda: icp.ICP([[2.0]], [-2.0]),
    "two unknowns": lambda: icp.scenes.hand_lcp().problem,
    "no obstacle": lambda: icp.ICP(icp.scenes.membrane(n=100).problem.A, -np.ones(100), -np.inf),
    "positive off the diagonal": lambda: icp.ICP([[4, 1, 0], [1, 4, 1], [0, 1, 4]], [-1.0, 2.0, -3.0]),
}


def raised(call, *arguments):
    """The error that every rank gets, which must be the same one."""
    try:
        call(*arguments)
    except Exception as error:
        told = f"{type(error).__name__}: {error}"
    else:
        told = ""
    every = COMM.allgather(told)
    assert len(set(every)) == 1, every
    return told
