"""The conformance data: every method on every scene, and what must fail, with the reason.

To check a method of your own, add it to METHODS.
"""

import icpmodel as icp
from icpmodel import scenes
from icpmodel.algebra.linear_rows import piece_count
from icpmodel.methods.enumeration import MAX_CHOICES
from icpmodel.methods.shortcuts import Lemke

#: a method that is a special case of another by default is given options of its own
METHODS = {
    "accelerated": icp.Accelerated(of="mnmgs"),
    "enumerate": icp.Enumerate(),
    "interior": icp.Interior(),
    "josephy": icp.Josephy(),
    "lemke": Lemke(),
    "milp": icp.MixedInteger(),
    "mms": icp.MMS(),
    "mnmaor": icp.MNMAOR(theta1=1.1, theta2=0.8, phi=0.1),
    "mnmgs": icp.MNMGS(),
    "mnmj": icp.MNMJ(),
    "mnmmod": icp.MNMMOD(theta1=2.0),
    "mnmod": icp.MNMOD(),
    "mnmsor": icp.MNMSOR(theta1=0.9),
    "modulus": icp.Modulus(splitting="whole", phi=0.5, phi1=2.0, phi2=3.0),
    "multilevel": icp.Multilevel(),
    "newton": icp.Newton(),
    "nmms": icp.NMMS(splitting="jacobi"),
    "projection-fixed-point": icp.ProjectionFixedPoint(omega=0.9),
    "proximal": icp.Proximal(),
    "psor": icp.PSOR(omega=1.1),
    "newton-josephy": icp.NewtonJosephy(),
    "restarts": icp.Restarts(tries=40),
    "tridiagonal": icp.Tridiagonal(),
}

#: wanted sizes of the scenes that have one
SIZES = {
    name: {"bearing": 40, "dividend": 31, "game-put": 33, "bratu": 30}.get(name, 100)
    for name in scenes.names()
    if "n" in scenes.parameters(name)
}

SCENES = {name: scenes.scene(name, SIZES.get(name)) for name in scenes.names()}

#: scenes with nonlinear p
NONLINEAR = [name for name, scene in SCENES.items() if scene.problem.f is not None]

#: scenes with affine p and a known answer
WITH_Z = [name for name, scene in SCENES.items() if name not in NONLINEAR and scene.z_exact is not None]

#: scenes of more linear pieces than are enumerated
MANY_PIECES = [name for name, scene in SCENES.items() if piece_count(scene.problem) > MAX_CHOICES]

_CYCLIC = "P but not H+: overrelaxed or not, the sweeps turn in a circle (theory of the 3 x 3 cyclic P-matrix)"
_COUPLED = "rho(D^-1|B| + G) = 1.8: splittings that add both couplings fail, those that take their maximum do not"

_BY_DIAGONAL = (
    "accelerated",
    "mms",
    "mnmaor",
    "mnmgs",
    "mnmj",
    "mnmsor",
    "multilevel",
    "nmms",
    "projection-fixed-point",
    "psor",
)

#: scenes with an upper obstacle
TWO_SIDED = [name for name, scene in SCENES.items() if scene.problem.upper is not None]

#: scenes with nonlinear p whose rows are known to increase, and the methods that take these
_ROWS = ("accelerated", "mnmaor", "mnmgs", "mnmj", "mnmsor", "nmms", "projection-fixed-point", "psor", "newton-josephy")
TAKES_F = {"radiating-membrane": _ROWS, "bratu": (*_ROWS, "mnmod", "mnmmod", "modulus")}

#: (method, scene) → why rounding decides whether it fails
BY_LUCK = {
    ("mnmmod", "hand-splittings"): "the iterates wander without a rule, until one of them is near the solution",
    ("milp", "hard-semidefinite"): "branch and bound may go through more sets of active rows than there is time for",
}

#: (method, scene) → the reason why it must fail; an unexpected success fails the test. On a scene without a solution
#: every method must, and need not be listed here
MUST_FAIL = {
    **{("newton-josephy", scene): "why_not: p is affine" for scene in scenes.names() if scene not in NONLINEAR},
    **{
        (method, scene): "why_not: p is nonlinear, and its rows do not increase or are coupled"
        for method in METHODS
        for scene in NONLINEAR
        if method not in TAKES_F.get(scene, ("newton-josephy",))
    },
    **dict.fromkeys([(m, "hand-cyclic") for m in _BY_DIAGONAL if m != "accelerated"], _CYCLIC),
    **dict.fromkeys([(m, "hand-splittings") for m in ("mnmaor", "mnmgs", "mnmod", "mnmsor", "modulus")], _COUPLED),
    **dict.fromkeys(
        [
            ("tridiagonal", scene)
            for scene in (
                "bai-nonsymmetric",
                "bai-symmetric",
                "ball",
                "box-manufactured",
                "hand-cyclic",
                "hard-degenerate",
                "hard-pinned",
                "hard-semidefinite",
                "hard-singular",
                "manufactured-affine",
                "manufactured-elementwise",
                "manufactured-vertical",
                "membrane",
                "obstacle-3d",
                "torsion",
            )
        ],
        "why_not: A is not tridiagonal",
    ),
    **dict.fromkeys(
        [
            ("tridiagonal", scene)
            for scene in (
                "coulomb",
                "dividend",
                "hand-affine",
                "hand-splittings",
                "hard-crossing",
                "hard-domain",
                "hard-jump",
                "hard-steep",
            )
        ],
        "why_not: an obstacle moves with other unknowns, or faster than its own, or it is not known how",
    ),
    **dict.fromkeys([("enumerate", s) for s in MANY_PIECES], "why_not: more than 2^14 choices of active rows"),
    **dict.fromkeys([("mms", s) for s in TWO_SIDED], "why_not: one |x| for each row"),
    **dict.fromkeys([(m, "hard-three") for m in (*_BY_DIAGONAL, "tridiagonal")], "why_not: the diagonal is negative"),
    ("mnmod", "hard-three"): "A + Omega = 0",
    ("mnmmod", "hard-three"): "X = A + Omega = 1 and Omega = 2: at either obstacle the step overshoots threefold",
    **dict.fromkeys(
        [(m, "hard-jump") for m in ("enumerate", "interior", "milp", "proximal", "restarts")],
        "why_not: psi has no derivative",
    ),
    ("interior", "hard-overflow"): "p and r at the first iterate, far from the obstacle, overflow",
    ("lemke", "dividend"): "why_not: psi is neither constant nor affine",
    ("mms", "dividend"): "why_not: a row without obstacle",
    ("mms", "hand-free"): "why_not: a row without obstacle",
    **dict.fromkeys(
        [(m, s) for m in _BY_DIAGONAL for s in ("hard-empty-row", "hard-infeasible", "hard-semidefinite")],
        "why_not: the diagonal has a zero",
    ),
    **dict.fromkeys(
        [(m, "hard-semidefinite") for m in ("mnmmod", "mnmod", "modulus")],
        "A is only semidefinite, and X = A + Omega turns without shrinking",
    ),
    **dict.fromkeys(
        [(m, "hard-skew") for m in _BY_DIAGONAL],
        "far from H+: rho(D^-1|B|) = 20, and nothing but the diagonal is kept, or smoothed with",
    ),
    **dict.fromkeys(
        [("lemke", s) for s in ("hard-domain", "hard-jump")], "why_not: psi is neither constant nor affine"
    ),
    **dict.fromkeys(
        [("tridiagonal", s) for s in ("hard-empty-row", "hard-infeasible")], "why_not: the diagonal has a zero"
    ),
    **dict.fromkeys([(m, "hard-jump") for m in ("josephy", "multilevel", "newton")], "why_not: psi has no derivative"),
    **dict.fromkeys(
        [(m, "hard-overflow") for m in ("accelerated", "mms", "mnmaor", "mnmgs", "mnmsor")],
        "intermediate sums overflow",
    ),
    **dict.fromkeys(
        [("josephy", "hard-singular")],
        "no tolerance for a zero pivot is right for entries from 1e-150 to 1e150, or for a condition number of 4e12",
    ),
    **dict.fromkeys(
        [(m, "hard-scaled") for m in ("mnmmod", "mnmod", "modulus")], "A + Omega is singular to working precision"
    ),
    **dict.fromkeys(
        [(m, "hard-scaled") for m in ("accelerated", "mnmaor", "mnmgs", "mnmsor")],
        "what rounding leaves of z in the rows with the largest units is more than Res_D(0)",
    ),
}

#: scene → how a method may end there without solving it; on scenes that are not listed, however it likes
HONEST = {
    "hard-crossing": {"infeasible", "obstacles cross", "stagnated"},
    "hard-domain": {"map failed", "stagnated"},
    "hard-infeasible": {"infeasible", "stagnated", "diverged"},
    "hard-jump": {"cycled", "stagnated"},
    "hard-overflow": {"diverged", "stagnated", "cycled"},
    "hard-scaled": {"stagnated", "cycled", "not applicable"},
    "hard-semidefinite": {"stagnated", "cycled", "iteration limit"},
    "hard-singular": {"stagnated"},
    "hard-skew": {"diverged", "cycled", "stagnated"},
    "hard-three": {"not applicable", "cycled", "stagnated"},
}

#: scenes on which a small residual leaves z far from the solution, and the reason; the error bound says so
FAR_THOUGH_SOLVED = {
    "hard-overflow": "the largest entry is 7.5e307, and the tolerance is relative",
    "hard-scaled": "rows with small entries do not show in the residual",
    "hard-singular": "the condition number is 4e12",
}
