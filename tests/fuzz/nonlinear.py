"""Problems with a nonlinear p, drawn and judged: f is taken as the floats that it gives, all else is exact."""

import sys
from contextlib import suppress
from dataclasses import dataclass
from itertools import product

import numpy as np
from exact import LEAST, ExactProblem, fractions, root
from hypothesis import strategies as st
from strategies import Data, data, integers, planted, scales, square, tuples

import icpmodel as icp

#: kind of f → its text, in which s > 0, b is a vector where f is 0 and K a matrix
FORCES = {
    "tanh": "icp.Elementwise(lambda z: s * np.tanh(z - b), lambda z: s / np.cosh(z - b) ** 2, slope_range=(0, s))",
    "exp": "icp.Elementwise(lambda z: s * np.expm1(z - b), lambda z: s * np.exp(z - b), slope_range=(0, np.inf))",
    "cube": "icp.Elementwise(lambda z: s * (z - b) ** 3, slope_range=(0, np.inf))",
    "sine": "icp.Elementwise(lambda z: s * np.sin(z - b), lambda z: s * np.cos(z - b), slope_range=(-s, s))",
    "cubic": "icp.Elementwise(lambda z: s * ((z - b) ** 3 - (z - b)), slope_range=(-s, np.inf))",
    "square": "icp.Elementwise(lambda z: s * (z - b) ** 2, lambda z: 2 * s * (z - b))",
    "root": "icp.Elementwise(lambda z: s * np.sqrt(z - b), lambda z: 0.5 * s / np.sqrt(z - b))",
    "logarithm": "lambda z: s * np.log1p(z - b)",
    "pole": "lambda z: s * (z - b) / (1 + z - b)",
    "function": "icp.Function(lambda z: s * (K @ (z - b)) ** 2, lambda z: 2 * s * (K @ (z - b))[:, None] * K)",
    "plain": "lambda z: s * (z - b) * np.roll(z - b, 1)",
    "gradient": "icp.Function(lambda z: K.T @ np.sinh(K @ (z - b)), lambda z: (K.T * np.cosh(K @ (z - b))) @ K)",
    "wrong derivative": "icp.Function(lambda z: s * (z - b) ** 3, lambda z: s * K)",
    "wrong slopes": "icp.Elementwise(lambda z: -s * (z - b) ** 3, slope_range=(0, np.inf))",
    "jump": "lambda z: s * np.sign(z - b)",
    "raises": "lambda z: s * (z - b) if np.abs(z - b).max() < 2 else 1 / 0",
    "undefined": "lambda z: np.where(np.abs(z - b) > 1, np.nan, s * (z - b))",
    "writes": "lambda z: np.multiply(z - b, s, out=z)",
}


@dataclass(frozen=True)
class Nonlinear:
    """The ICP of `affine`, and f as a key of `FORCES`."""

    affine: Data
    f: str
    s: float
    b: tuple
    K: tuple

    @property
    def known(self):
        return self.affine.known

    def code(self):
        """The problem as a user would write it."""
        lines = [self.affine.code(), f"s, b, K = {self.s!r}, np.array({self.b!r}), np.array({self.K!r})"]
        return "\n".join([*lines, f"problem = icp.ICP(problem.A, problem.q, problem.psi, f={FORCES[self.f]})"])

    def problem(self):
        """The ICP. Raises what the constructor raises."""
        affine = self.affine.problem()
        f = eval(FORCES[self.f], {"np": np, "icp": icp, "s": self.s, "b": np.array(self.b), "K": np.array(self.K)})
        return icp.ICP(affine.A, affine.q, affine.psi, f=f)


@st.composite
def nonlinear(draw):
    """Any problem with an f that is 0 at the solution that is known, if one is."""
    affine = draw(st.one_of(planted(largest=4), data(scaled=False), data()))
    n = len(affine.q)
    b = draw(integers(n)) if affine.known is None else affine.known
    s = draw(st.one_of(st.just(1.0), scales(1).map(lambda one: float(one[0]))))
    return Nonlinear(affine, draw(st.sampled_from(sorted(FORCES))), s, tuples(b), tuples(draw(square(n, -2, 2))))


class ExactNonlinear(ExactProblem):
    """An ICP with an f, in fractions but for the values of f and the units of p, which are those of the package."""

    is_affine = False

    def __init__(self, problem):
        super().__init__(problem)
        self.problem = problem

    def p(self, z):
        value = self.problem.f.value(np.array([float(x) for x in z]))
        if np.isnan(value).any():
            raise ValueError
        # what is beyond the floats is at least the largest one
        value = fractions(np.clip(value, -sys.float_info.max, sys.float_info.max))
        return [x + y for x, y in zip(super().p(z), value, strict=True)]

    def residual(self, z, weights=None):
        if not np.isfinite(np.array(z, dtype=float)).all():
            return None
        point = np.array([float(x) for x in z])
        p = 0.0
        with suppress(icp.MapError):
            p = self.problem.p(point)
        # the reciprocal of a slope below 1/max is infinite
        known = np.minimum(self.problem.weights_at(point, p), sys.float_info.max)
        return super().residual(z, weights or fractions(known))

    def scale(self, z, start):
        """The smaller of Res_D(0), unless that is next to 0, and the size of z."""
        at_0, size = self.residual([0.0] * self.n) or 0, sum(x * x for x in fractions(z))
        return root(min(at_0, size) if at_0 > (self.n * LEAST) ** 2 else size)

    def known(self, b):
        """The solutions within one of b, as far as they are whole numbers."""
        points = (np.add(b, step) for step in product((-1.0, 0.0, 1.0), repeat=self.n))
        return [point for point in points if self.residual(point) == 0]


def false_proof(drawn, exact, z, bound):
    """What is false of uniqueness and of the error bound at `z`."""
    if not bound.unique or drawn.f == "wrong slopes":
        return
    found = exact.known(drawn.b)
    if len(found) > 1:
        yield "false unique", f"{list(found[0])} and {list(found[1])} are solutions; {bound.proof}"
    elif found and bound.value is not None:
        far = [abs(x - y) - d for x, y, d in zip(*map(fractions, (z, found[0], bound.componentwise)), strict=True)]
        if max(far) > 0:
            yield "false bound", f"{list(found[0])} is farther from {list(z)} than {bound.value:.17g}; {bound.proof}"
