"""One problem of the fuzz with the question put to it, as data that can be cut down, and as the code that asks it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

Row = tuple[float, ...]
Rows = tuple[Row, ...]

#: kind of ψ → its text, in which c is a vector, −inf for no obstacle, and G a matrix; for ψ̄ they are d and H
PSI = {
    "zero": "0.0",
    "constant": "c",
    "affine": "icp.Affine(G, c)",
    "sine": "icp.Elementwise(np.sin, np.cos, lipschitz=1.0, c=c)",
    "tanh": "icp.Elementwise(np.tanh, lambda x: 1 / np.cosh(x) ** 2, lipschitz=1.0, c=c)",
    "shift": "icp.Elementwise(lambda x: x, np.ones_like, lipschitz=1.0, c=c)",
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
#: front end → how it is asked; `answer` is what comes back
FRONTS = {
    "solve": "answer = problem.solve({arguments}raise_on_failure=False)",
    "file": """with tempfile.TemporaryDirectory() as folder:
    icp.save_problem(problem, f"{{folder}}/p.npz")
    again = icp.load_problem(f"{{folder}}/p.npz")
assert (again.A.data.tobytes(), again.q.tobytes()) == (problem.A.data.tobytes(), problem.q.tobytes())
assert (again.upper is None) == (problem.upper is None)
problem = again
answer = problem.solve({arguments}raise_on_failure=False)""",
    "many": "answer = icp.solve_many(A, [q, -q, q], psi, {upper}{arguments}raise_on_failure=False)",
    "cvxpy": """x = cp.Variable(len(q))
rows = [G[:equal] @ x == c[:equal]] * (equal > 0) + [G[equal:] @ x <= c[equal:]] * (equal < len(c))
answer = cp.Problem(cp.Minimize(0.5 * cp.quad_form(x, cp.psd_wrap(A)) + q @ x), rows)
with contextlib.suppress(cp.SolverError):
    answer.solve(solver=icp.cvxpy_solver())""",
    "pyomo": """model = pyo.ConcreteModel()
model.x = pyo.Var(range(len(q)))
model.rows = Complementarity(
    range(len(q)), rule=lambda m, i: complements(sum(A[i][j] * m.x[j] for j in m.x) + q[i] >= 0, m.x[i] >= c[i])
)
solver = pyo.SolverFactory("icpmodel")
answer = solver.solve(model, load_solutions=False, raise_exception_on_nonoptimal_result=False)""",
}
_IMPORTS = {
    "file": ("import tempfile",),
    "cvxpy": ("import contextlib", "import cvxpy as cp"),
    "pyomo": (
        "import pyomo.environ as pyo",
        "import icpmodel.modelling.pyomo",
        "from pyomo.mpec import Complementarity, complements",
    ),
}
#: how far from the answer a bound is asked for
_OFF = {"there": "answer.z", "near": "answer.z + 1e-3 * np.cos(np.arange(problem.n))"} | {
    f"at {size}": f"answer.z + {size} * np.cos(3 * np.arange(problem.n))" for size in ("1e-200", "1e-9", "1e9", "1e150")
}
_BOUNDS = {"bound": "", "sharp": ", sharp=True", "rough": ", sharp=False", "rigorous": ", rigorous=True"}
#: what is asked of the answer
ASKED = {
    "": "",
    "print": "told = str(answer)",
    "polish": "answer = answer.polish()",
    "explain": "page = problem.explain()\ntold = str(page)",
    "crosscheck": "told = str(problem.crosscheck(answer, solvers=['osqp'], time_limit=2.0))",
} | {
    f"{kind} {off}": f"z = {point}\nbound = icp.error_bound(problem, z{options})"
    for kind, options in _BOUNDS.items()
    for off, point in _OFF.items()
}


@dataclass(frozen=True)
class Trial:
    """A, q and ψ = `psi` of `PSI` with its `c` and `G`, or the text `source` of a problem; asked by the front end
    `front`, with a `method` or None and `options` as texts; then `asked` of the answer, a key of `ASKED`. With an
    obstacle above, `upper` is its kind, with `d` and `H`, else empty.

    For "cvxpy" A is the matrix of the objective, and the rows of Gx ≤ c from number `equal` on are inequalities.
    `raising`: the user has asked NumPy to raise. `known` is a solution that the data were made for, or None.
    """

    A: Rows = ()
    q: Row = ()
    psi: str = "zero"
    c: Row = ()
    G: Rows = ()
    upper: str = ""
    d: Row = ()
    H: Rows = ()
    source: str = ""
    front: str = "solve"
    method: str | None = None
    options: tuple[tuple[str, str], ...] = ()
    asked: str = ""
    equal: int = 0
    raising: bool = False
    known: Row | None = None

    @property
    def label(self) -> str:
        """The front end and the method, for the table."""
        return self.front if self.front != "solve" else f"solve {self.method or ''}".strip()

    def number(self, name: str, otherwise: float) -> float:
        """An option that is a number."""
        text = dict(self.options).get(name)
        return otherwise if text is None else float(text)

    def setup(self) -> str:
        """The code up to the problem."""
        lines = [f"problem = {self.source}"]
        if not self.source:
            psi, upper = self._texts()
            named = {"A": self.A, "q": self.q}
            named |= {name: getattr(self, name) for name in ("c", "G", "d", "H") if self._has(name)}
            lines = [f"{name} = np.array({_listed(value)})" for name, value in named.items()]
            if self.front == "cvxpy":
                lines.append(f"equal = {self.equal}")
            elif self.front != "pyomo":
                above = [f"upper = {upper}", "problem = icp.ICP(A, q, psi, upper=upper)"]
                lines += [f"psi = {psi}", *(above if upper else ["problem = icp.ICP(A, q, psi)"])]
        text = "\n".join(lines)
        more = (("sp.", "import scipy.sparse as sp"), ("inf", "from numpy import inf"))
        imported = [line for word, line in more if word in text]
        always = [*_IMPORTS.get(self.front, ()), "import numpy as np", "import icpmodel as icp"]
        return "\n".join([*always, *imported, text])

    def question(self) -> str:
        """The code after it."""
        named = [] if self.method is None else [repr(self.method)]
        arguments = "".join(f"{one}, " for one in (*named, *(f"{name}={text}" for name, text in self.options)))
        upper = "upper=upper, " if self.upper else ""
        text = "\n".join([FRONTS[self.front].format(arguments=arguments, upper=upper), ASKED[self.asked]]).strip()
        if "callback" in dict(self.options):
            text = f"path = []\n{text}"
        if self.raising:
            text = 'with np.errstate(all="raise"):\n    ' + text.replace("\n", "\n    ")
        return text

    def code(self) -> str:
        """The whole of it, as a user would write it."""
        return f"{self.setup()}\n{self.question()}"

    def _has(self, name: str) -> bool:
        foreign = self.front in ("cvxpy", "pyomo") and name in ("c", "G")
        return foreign or re.search(rf"\b{name}\b", " ".join(self._texts())) is not None

    def _texts(self) -> tuple[str, str]:
        """ψ, and ψ̄ or nothing."""
        above = PSI[self.upper] if self.upper else ""
        return PSI[self.psi], re.sub(r"\bG\b", "H", re.sub(r"\bc\b(?!=)", "d", above))


def _listed(value: Any) -> str:
    return "[" + ", ".join(map(_listed, value)) + "]" if isinstance(value, tuple) else repr(float(value))


def tuples(values: Any) -> Any:
    """A vector or matrix as tuples of floats, without −0."""
    return tuple(map(tuples, values)) if np.ndim(values) > 1 else tuple(float(value) + 0.0 for value in values)
