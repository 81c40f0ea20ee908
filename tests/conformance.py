"""The conformance data: every method on every scene, and what must fail, with the reason.

To check a method of your own, add it to METHODS.
"""

import icpmodel as icp
from icpmodel import scenes
from icpmodel.methods.lemke import Lemke

#: a method that is a special case of another by default is given options of its own
METHODS = {
    "lemke": Lemke(),
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
    "psor": icp.PSOR(omega=1.1),
}

#: wanted sizes of the scenes that have one
SIZES = {
    name: {"bearing": 40, "dividend": 31}.get(name, 100) for name in scenes.names() if "n" in scenes.parameters(name)
}

_CYCLIC = "P but not H+: overrelaxed or not, the sweeps turn in a circle (theory of the 3 x 3 cyclic P-matrix)"
_COUPLED = "rho(D^-1|B| + G) = 1.8: splittings that add both couplings fail, those that take their maximum do not"

#: (method, scene) → the reason why it must fail; an unexpected success fails the test
MUST_FAIL = {
    **dict.fromkeys(
        [
            (m, "hand-cyclic")
            for m in ("mms", "mnmaor", "mnmgs", "mnmj", "mnmsor", "nmms", "projection-fixed-point", "psor")
        ],
        _CYCLIC,
    ),
    **dict.fromkeys(
        [(m, "hand-splittings") for m in ("mnmaor", "mnmgs", "mnmmod", "mnmod", "mnmsor", "modulus")], _COUPLED
    ),
    ("lemke", "dividend"): "why_not: psi is neither constant nor affine",
    ("lemke", "manufactured-elementwise"): "why_not: psi is neither constant nor affine",
    ("mms", "dividend"): "why_not: a row without obstacle",
    ("mms", "hand-free"): "why_not: a row without obstacle",
}
