"""The proximal point theorem: monotone A and a fixed obstacle are enough for convergence to a solution.

**proximal.** Let xᵀAx ≥ 0 for all x, ψ = c, and ψ̄ = c̄ ≥ c where there is an upper obstacle. Let W
be a positive diagonal and 0 < μ_k ≤ μ. Let z^{k+1} solve the LCP(A + μ_k W, q − μ_k W z^k), or with
c̄ the problem with both obstacles. Let N be the normal cone of z ≥ c, or of c ≤ z ≤ c̄. In the norm
‖x‖² = xᵀWx the map z ↦ W⁻¹(Az + q + N(z)) is maximal monotone, and its zeros are the solutions. The
step is its resolvent:

    ‖z^{k+1} − z*‖² ≤ ‖z^k − z*‖² − ‖z^{k+1} − z^k‖² for every solution z*.

So if there is a solution, zᵏ converges to one from every start. It also does if the steps are
inexact and their errors have a finite sum. If there is no solution, zᵏ is not bounded. The map is
polyhedral, so near the solutions the distance d to them has d^{k+1} ≤ d^k·Cμ_k/√(1 + C²μ_k²) for
some C. The smaller μ_k the faster, and faster than linear for μ_k → 0.

References
----------
Rockafellar, SIAM J. Control Optim. 14 (1976). Luque, SIAM J. Control Optim. 22 (1984), for the
rate.
"""

from __future__ import annotations

from ...errors import check_arguments
from ...problem.data import ProblemLike, as_problem
from ..answers import Answer
from ..certificates.bounds import classes_of


@check_arguments
def proximal_point(problem: ProblemLike) -> Answer:
    """Whether `Proximal` is proved to converge on `problem`, if there is a solution: A monotone, the obstacle fixed.

    Parameters
    ----------
    problem : ICP
        The problem.

    Returns
    -------
    Answer
        Yes if the theorem applies, no if not, unknown if it is not known whether A is monotone.

    References
    ----------
    `icpmodel.theory.convergence.proximal_point` holds statement and proof.

    Examples
    --------
    >>> print(proximal_point(ICP([[0, -1], [1, 0]], [1, -1])))
    yes: A is monotone and the obstacle fixed: from every start the iterates converge to a solution, if there is one
    >>> print(proximal_point(ICP([[1, 3], [3, 1]], [1, 1])))
    no: A is not monotone: indefinite: x'Ax < 0 for the witness x
    """
    problem = as_problem(problem)
    if not problem.facts.has_fixed_obstacle:
        return Answer(False, "the obstacle depends on other unknowns, or its slope is not known to be below 1")
    answer = classes_of(problem).semidefinite
    if not answer.holds:
        word = "A is not monotone" if answer.holds is False else "it is not known whether A is monotone"
        return Answer(answer.holds, f"{word}: {answer.reason}", answer.witness)
    reason = (
        "A is monotone and the obstacle fixed: from every start the iterates converge to a solution, if there is one"
    )
    return Answer(True, reason)
