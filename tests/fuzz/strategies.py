"""Problems drawn by Hypothesis: data of every kind, as tuples that shrink, and as code that a user could paste."""

import re
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from hypothesis import strategies as st

import icpmodel as icp

#: kind of ψ → its text, in which c is a vector, −inf for no obstacle, and G a matrix; for ψ̄ they are d and H
PSI = {
    "constant": "c",
    "affine": "icp.Affine(G, c)",
    "sine": "icp.Elementwise(np.sin, np.cos, lipschitz=1.0, c=c)",
    "tanh": "icp.Elementwise(np.tanh, lambda x: 1 / np.cosh(x) ** 2, lipschitz=1.0, c=c)",
    "kink": "icp.Elementwise(lambda x: np.abs(x) / 2, lambda x: np.sign(x) / 2, lipschitz=0.5, c=c)",
    "root": "icp.Elementwise(np.sqrt, lambda x: 0.5 / np.sqrt(x), c=c)",
    "growing": "icp.Elementwise(np.exp, np.exp, c=c)",
    "no derivative": "icp.Elementwise(lambda x: np.abs(x) / 2, c=c)",
    "function": "icp.Function(lambda z: G @ z + c, lambda z: G, lipschitz=np.abs(G))",
    "plain": "lambda z: np.roll(z, 1) / 2 + c",
    "jump": "lambda z: np.where(z > 0, 1.0, c)",
    "undefined": "lambda z: np.where(np.abs(z) > 1, np.nan, c)",
    "raises": "lambda z: c if np.abs(z).max() < 1 else 1 / 0",
    "ragged": "lambda z: c if z[0] <= 0 else [1.0, [2.0]]",
    "writes": "lambda z: np.multiply(z, 0.5, out=z) + c",
    "intervention": "icp.Intervention(sp.csr_array(np.abs(G)))",
}
SCALES = [0, 0, 0, 0, 3, -3, 12, -12, 8, -8, 150, -150, 300, -320]
OPTIONS = {
    "rtol": (1e-2, 1e-5, 1e-12, 0.0),
    "atol": (1e-3, 1e-9, 1e-200),
    "accuracy": (1e-3, 1e-8, 1e-14),
    "max_iter": (0, 1, 3, 20),
    "time_limit": (0.0, 1e-6, 1e-3, 0.1),
    "memory_limit": (0.0, 1e4, 1e6),
    "family": ("paper", "modulus"),
}


@dataclass(frozen=True)
class Data:
    """The data of an ICP as tuples: `psi` and `upper` are keys of `PSI`, `upper` is "" for none; `known` is a solution
    that the data were made for, or None."""

    A: tuple
    q: tuple
    psi: str
    c: tuple
    G: tuple
    upper: str = ""
    d: tuple = ()
    H: tuple = ()
    known: tuple | None = None

    def code(self):
        """The problem as a user would write it."""
        lines = ["import numpy as np", "import scipy.sparse as sp", "from numpy import inf", "import icpmodel as icp"]
        lines += [f"{name} = np.array({getattr(self, name)!r})" for name in "AqcGdH" if getattr(self, name)]
        above = f", upper={_of_upper(self.upper)}" if self.upper else ""
        return "\n".join([*lines, f"problem = icp.ICP(A, q, {PSI[self.psi]}{above})"])

    def problem(self):
        """The ICP. Raises what the constructor raises."""
        names = {name: np.array(getattr(self, name), dtype=float) for name in "cG"}
        upper = {"c": np.array(self.d, dtype=float), "G": np.array(self.H, dtype=float)}
        made = {"np": np, "sp": sp, "icp": icp}
        psi = eval(PSI[self.psi], made | names)
        return icp.ICP(self.A, self.q, psi, upper=eval(PSI[self.upper], made | upper) if self.upper else None)

    def scaled(self, rows, unit):
        """The same problem with the rows of (A, q) times `rows`, in units of z that are `unit` times as small; only for
        constant and affine obstacles."""
        A = np.array(self.A) * np.array(rows)[:, None]
        q, c, d = (unit * np.array(one, dtype=float) for one in (np.array(rows) * self.q, self.c, self.d))
        return replace(self, A=tuples(A), q=tuples(q), c=tuples(c), d=tuples(d), known=None)


def _of_upper(kind):
    return re.sub(r"\bc\b(?!=)", "d", PSI[kind].replace("G", "H"))


def tuples(values):
    """A vector or matrix as tuples of floats, without −0."""
    return tuple(map(tuples, values)) if np.ndim(values) > 1 else tuple(float(value) + 0.0 for value in values)


def integers(n, low=-4, high=4):
    return st.lists(st.integers(low, high), min_size=n, max_size=n).map(np.array)


def square(n, low=-4, high=4):
    return integers(n * n, low, high).map(lambda entries: entries.reshape(n, n).astype(float))


def _m_matrix(B):
    B = np.abs(B) - np.diag(np.abs(np.diag(B)))
    return np.diag(B.sum(axis=1) + np.arange(len(B)) % 2) - B


def _of_rank(B):
    k = max(len(B) // 2, 1)
    return B[:, :k] @ B[:k]


MATRICES = {
    "whole": lambda B: B,
    "reals": lambda B: B + np.sin(7.0 * B + np.arange(len(B))),
    "low rank": _of_rank,
    "no row": lambda B: B * (np.arange(len(B)) != 0)[:, None],
    "no column": lambda B: B * (np.arange(len(B)) != 0),
    "definite": lambda B: B @ B.T + np.eye(len(B)),
    "semidefinite": lambda B: _of_rank(B) @ _of_rank(B).T,
    "nearly semidefinite": lambda B: _of_rank(B) @ _of_rank(B).T + 1e-7 * np.eye(len(B)),
    "M-matrix": _m_matrix,
    "tridiagonal": lambda B: np.triu(np.tril(B, 1), -1),
    "nearly singular": lambda B: _of_rank(B) * (1 + 1e-13 * B),
    "skew": lambda B: np.triu(B, 1) - np.triu(B, 1).T + np.diag(np.abs(np.diag(B)) > 2),
    "cyclic": lambda B: np.eye(len(B)) + abs(B[0, 0]) * np.roll(np.eye(len(B)), 1, axis=1),
}
#: matrices of which an error bound is often known
PROVED = ("definite", "nearly semidefinite", "M-matrix")


@st.composite
def scales(draw, n, kinds=tuple(SCALES), base=10.0):
    """Powers of `base`, one for all or each by itself."""
    exponents = [draw(st.sampled_from(kinds))] * n
    if draw(st.booleans()):
        exponents = draw(st.lists(st.sampled_from(kinds), min_size=n, max_size=n))
    return base ** np.array(exponents, dtype=float)


@st.composite
def obstacles(draw, n, kinds=tuple(PSI)):
    """(kind, c, G)."""
    kind = draw(st.sampled_from(kinds))
    G = np.zeros((n, n))
    if "G" in PSI[kind]:
        G = draw(
            st.one_of(square(n, -2, 2).map(lambda B: B / 4), square(n, -2, 2).map(lambda B: np.diag(np.diag(B)) / 2))
        )
    return kind, draw(integers(n)).astype(float), G


@st.composite
def data(draw, largest=4, matrices=tuple(MATRICES), kinds=tuple(PSI), scaled=True):
    """Any problem: half of the obstacles are constant, a third of the problems have one above, some rows none."""
    n = draw(st.integers(1, largest))
    A = MATRICES[draw(st.sampled_from(matrices))](draw(square(n)))
    q = draw(integers(n)).astype(float)
    kind, c, G = draw(obstacles(n, draw(st.sampled_from([("constant",), kinds]))))
    upper, d, H = "", np.zeros(0), np.zeros((0, 0))
    if draw(st.integers(0, 2)) == 2:
        upper, room, H = draw(obstacles(n, draw(st.sampled_from([(kind,), kinds]))))
        d = c + draw(st.sampled_from([np.abs(room), room, 1e-9 * np.abs(room)]))
        H = draw(st.sampled_from([G, H]))
        d = np.where(draw(integers(n, 0, 4)) == 4, np.inf, d)
    if scaled:
        with np.errstate(over="ignore"):
            A, q = draw(scales(n))[:, None] * A * draw(scales(n)), draw(scales(n)) * q
            unit = draw(scales(n))
            A, q, c, d = (np.clip(part, -1e307, 1e307) for part in (A, q, unit * c, unit[: d.size] * d))
            d = np.where(d == 1e307, np.inf, d)
    c = np.where(draw(integers(n, 0, 6)) == 6, -np.inf, c)
    return Data(tuples(A), tuples(q), kind, tuples(c), tuples(G), upper, tuples(d), tuples(H))


@st.composite
def planted(draw, largest=5):
    """Whole numbers with a solution that is known exactly, degenerate ones included."""
    n = draw(st.integers(1, largest))
    A, c = MATRICES[draw(st.sampled_from(["whole", "low rank", "no row", "semidefinite", "skew"]))](draw(square(n))), 0
    c = draw(integers(n)).astype(float)
    side, room, push = draw(integers(n, 0, 3)), draw(integers(n, 0, 2)), draw(integers(n, 0, 2))
    pressed = side == 3
    z = np.where((side == 0) | pressed, c + room, c)
    p = np.where(side == 0, 0, np.where(pressed, -push, push))
    above = {}
    if pressed.any():
        z = np.where(side == 0, c, z)
        above = {"upper": "constant", "d": tuples(np.where(pressed, z, z + room)), "H": tuples(np.zeros((n, n)))}
    q = p - A @ z
    return Data(tuples(A), tuples(q), "constant", tuples(c), tuples(np.zeros((n, n))), **above, known=tuples(z))


@st.composite
def options(draw):
    """(method or None, options of `solve`)."""
    method = draw(st.one_of(st.none(), st.sampled_from(icp.methods.names())))
    names = draw(st.lists(st.sampled_from(sorted(OPTIONS)), max_size=2, unique=True))
    chosen = {name: draw(st.sampled_from(OPTIONS[name])) for name in names}
    if method is not None:
        chosen.pop("family", None)
    if "accuracy" in chosen:
        chosen = {name: value for name, value in chosen.items() if name not in ("rtol", "atol")}
    return method, {"max_iter": 100, "time_limit": 1.0} | chosen  # a search without a limit may take 10 s


@dataclass(frozen=True)
class Program:
    """min ½xᵀPx + qᵀx with Gx ≤ h, the first `equal` rows as equations."""

    P: tuple
    q: tuple
    G: tuple
    h: tuple
    equal: int


@st.composite
def programs(draw):
    """Small programs: feasible or not, bounded or not, of any rank, with equations alone or without interior.

    They are convex: P is an integer BᵀB times a power of two, which is not rounded.
    """
    n, m = draw(st.integers(1, 3)), draw(st.integers(1, 4))
    B = draw(square(n, -2, 2))
    P = draw(st.sampled_from([0.0, 1.0, 2.0**-20, 2.0**20])) * draw(
        st.sampled_from([B.T @ B, np.eye(n), np.outer(B[0], B[0])])
    )
    G, h = draw(integers(m * n, -2, 2)).reshape(m, n).astype(float), draw(integers(m)).astype(float)
    if m > 1 and draw(st.booleans()):
        G[-1], h[-1] = -G[0], -h[0]  # no interior
    q = draw(integers(n, -3, 3)) * draw(st.sampled_from([1.0, 1e-4, 1e4]))
    return Program(tuples(P), tuples(q), tuples(G), tuples(h), draw(st.integers(0, min(m, n))))
