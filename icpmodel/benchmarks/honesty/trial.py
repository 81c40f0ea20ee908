"""One problem of the fuzz with the question put to it, as data that can be cut down, and as the code that asks it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

Row = tuple[float, ...]
Rows = tuple[Row, ...]

#: kind of ψ → its text, in which c is a vector, −inf for no obstacle, and G a matrix
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
problem = again
answer = problem.solve({arguments}raise_on_failure=False)""",
    "many": "answer = icp.solve_many(A, [q, -q, q], psi, {arguments}raise_on_failure=False)",
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
    "file": "import tempfile\n",
    "cvxpy": "import contextlib\nimport cvxpy as cp\n",
    "pyomo": "import pyomo.environ as pyo\nimport icpmodel.modelling.pyomo\n"
    "from pyomo.mpec import Complementarity, complements\n",
}
#: what is asked of the answer
ASKED = {
    "": "",
    "print": "told = str(answer)",
    "polish": "answer = answer.polish()",
    "bound": "bound = icp.error_bound(problem, answer)",
    "sharp": "bound = icp.error_bound(problem, answer, sharp=True)",
    "rigorous": "bound = icp.error_bound(problem, answer, rigorous=True)",
    "explain": "told = str(problem.explain())",
    "crosscheck": "told = str(problem.crosscheck(answer, solvers=['osqp'], time_limit=2.0))",
}


@dataclass(frozen=True)
class Trial:
    """A, q and ψ = `psi` of `PSI` with its `c` and `G`, or the text `source` of a problem; asked by the front end
    `front`, with a `method` or None and `options` as texts; then `asked` of the answer, a key of `ASKED`.

    For "cvxpy" A is the matrix of the objective, and the rows of Gx ≤ c from number `equal` on are inequalities.
    `raising`: the user has asked NumPy to raise. `known` is a solution that the data were made for, or None.
    """

    A: Rows = ()
    q: Row = ()
    psi: str = "zero"
    c: Row = ()
    G: Rows = ()
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
        lines = [
            f"{_IMPORTS.get(self.front, '')}import numpy as np\nimport icpmodel as icp\nfrom numpy import inf, nan"
        ]
        if self.source:
            lines.append(f"problem = {self.source}")
            return "\n".join(lines)
        data = {"A": self.A, "q": self.q}
        psi = PSI[self.psi]
        data |= {name: value for name, value in (("c", self.c), ("G", self.G)) if self._names(name, psi)}
        lines += [f"{name} = np.array({_listed(value)})" for name, value in data.items()]
        if self.front == "cvxpy":
            lines.append(f"equal = {self.equal}")
        elif self.front != "pyomo":
            lines.append(f"psi = {psi}\nproblem = icp.ICP(A, q, psi)")
        return "\n".join(lines)

    def question(self) -> str:
        """The code after it."""
        named = [] if self.method is None else [repr(self.method)]
        arguments = "".join(f"{one}, " for one in (*named, *(f"{name}={text}" for name, text in self.options)))
        text = "\n".join([FRONTS[self.front].format(arguments=arguments), ASKED[self.asked]]).strip()
        if "callback" in dict(self.options):
            text = f"path = []\n{text}"
        if self.raising:
            text = 'with np.errstate(all="raise"):\n    ' + text.replace("\n", "\n    ")
        return text

    def code(self) -> str:
        """The whole of it, as a user would write it."""
        return f"{self.setup()}\n{self.question()}"

    def _names(self, name: str, psi: str) -> bool:
        return self.front == "cvxpy" or name in psi.replace("icp", "").replace("np.", "") or self.front == "pyomo"


def _listed(value: Any) -> str:
    return "[" + ", ".join(map(_listed, value)) + "]" if isinstance(value, tuple) else repr(float(value))
