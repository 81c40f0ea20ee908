"""Problems drawn afresh: every kind of matrix, right-hand side, ψ, scale, option, method and front end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ...methods.contract import names as method_names
from ...numerics.arrays import Vector
from ...scenes import names as scene_names
from ...scenes import parameters
from ..families.gallery import family_names
from .trial import ASKED, PSI, Trial, tuples

Array = np.ndarray[Any, np.dtype[np.float64]]
_Made = Callable[[np.random.Generator, int], Array]

_OPTIONS: dict[str, tuple[str, ...]] = {
    "rtol": ("1e-2", "1e-5", "1e-12", "1e-15", "0.0"),
    "atol": ("1e-3", "1e-9", "1e-200"),
    "accuracy": ("1e-3", "1e-8", "1e-14"),
    "max_iter": ("0", "1", "3", "20"),
    "time_limit": ("0", "1e-6", "1e-3", "0.1"),
    "memory_limit": ("0", "1e4", "1e6"),
    "family": ("'paper'", "'modulus'"),
    "z0": ("np.ones(problem.n)", "-np.ones(problem.n)", "1e10 * np.ones(problem.n)", "np.full(problem.n, 1e-200)"),
    "callback": (
        "lambda state: path.append(state.z.copy())",
        "lambda state: path.append(state.z.copy()) or len(path) > 2",
        "lambda state: state.z.setflags(write=True)",
    ),
}
#: of `solve_many`
_MANY = ("rtol", "atol", "time_limit")
#: steps of nearly all runs, and seconds for many problems: what goes on for ever without them is not looked for here.
#: With 100 in place of 300 one in a hundred of those that are solved is not, and a tenth without a limit took a quarter
#: of the time: cProfile of 2000 trials, of which the longest hundred took two thirds
_STEPS, _SECONDS, _LIMITED = "100", "0.1", 0.98
_WITHOUT_DIAGONAL = ("josephy", "lemke", "mnmod", "modulus", "newton", "proximal", "reduced")
#: of `ASKED`: all bounds alike
_WEIGHTS = [0.3, 0.2, 0.1, 0.03, 0.01, *[0.36 / (len(ASKED) - 5)] * (len(ASKED) - 5)]


@np.errstate(over="ignore")
def drawn_trial(seed: int, number: int) -> Trial:
    """The trial that the two numbers stand for, whatever else is drawn."""
    rng = np.random.default_rng([seed, number])
    kinds = (_program, _model, _gallery, _large, _proved, _small)
    return kinds[rng.choice(6, p=[0.03, 0.02, 0.03, 0.002, 0.1, 0.818])](rng)


def _model(rng: np.random.Generator) -> Trial:
    return replace(_problem(rng, int(rng.integers(1, 5)), plain=True), front="pyomo", psi="constant")


def _small(rng: np.random.Generator) -> Trial:
    low, high = [(1, 5), (5, 13), (13, 40)][rng.choice(3, p=[0.8, 0.15, 0.05])]
    return _asked(rng, _problem(rng, int(rng.integers(low, high))))


def _whole(rng: np.random.Generator, n: int) -> Array:
    return rng.integers(-4, 5, (n, n)).astype(np.float64)


def _sparse(rng: np.random.Generator, n: int) -> Array:
    return np.where(rng.random((n, n)) < min(1.0, 2.5 / n), _whole(rng, n), 0.0)


def _low_rank(rng: np.random.Generator, n: int) -> Array:
    m = int(rng.integers(1, max(n, 2)))
    return rng.integers(-2, 3, (n, m)).astype(np.float64) @ rng.integers(-2, 3, (m, n))


def _no_row(rng: np.random.Generator, n: int) -> Array:
    A = _sparse(rng, n)
    A[rng.integers(n)] = 0.0
    return A if rng.random() < 0.5 else A.T.copy()


def _definite(rng: np.random.Generator, n: int) -> Array:
    B = _whole(rng, n)
    return B @ B.T + np.diag(rng.integers(0, 2, n))


def _flat(rng: np.random.Generator, n: int) -> Array:
    u = rng.integers(1, 3, n)
    return np.asarray(np.outer(u, u) + 10.0 ** -rng.integers(1, 9) * np.eye(n))


def _m_matrix(rng: np.random.Generator, n: int) -> Array:
    B = np.abs(_sparse(rng, n))
    np.fill_diagonal(B, 0.0)
    return np.diag(B.sum(axis=1) + rng.integers(0, 2, n)) - B


def _nearly(rng: np.random.Generator, n: int) -> Array:
    A = [_low_rank, _m_matrix][rng.integers(2)](rng, n)
    return np.asarray(A * (1 + 10.0 ** -rng.integers(8, 17) * rng.integers(-2, 3, A.shape)))


_MATRICES: tuple[_Made, ...] = (
    _whole,
    lambda rng, n: rng.standard_normal((n, n)),
    _sparse,
    _low_rank,
    _no_row,
    _definite,
    _flat,
    _m_matrix,
    lambda rng, n: np.triu(np.tril(_whole(rng, n), 1), -1),
    _nearly,
    lambda rng, n: 0.1 * _low_rank(rng, n),
    lambda rng, n: np.triu(_whole(rng, n), 1) - np.triu(_whole(rng, n), 1).T + np.diag(rng.integers(0, 2, n)),
    lambda rng, n: np.eye(n) + rng.integers(0, 3) * np.roll(np.eye(n), 1, axis=1),
)


def _scales(rng: np.random.Generator, n: int) -> Vector:
    """1, or powers of ten up to 1e±8, or up to 1e±150 or beyond; for all or each by itself."""
    most = [0, 8, 150, 322][rng.choice(4, p=[0.6, 0.3, 0.07, 0.03])]
    exponents = rng.integers(-most, most + 1, n if rng.random() < 0.5 else 1)
    return np.asarray(10.0 ** np.broadcast_to(exponents, n).clip(max=300).astype(np.float64))


def _vector(rng: np.random.Generator, n: int) -> Vector:
    kind = rng.integers(4)
    if kind == 0:
        return np.asarray(rng.standard_normal(n))
    return np.asarray(np.where(rng.random(n) < 0.2, 0.0, rng.integers(-4, 5, n)), dtype=np.float64)


def _problem(rng: np.random.Generator, n: int, plain: bool = False) -> Trial:
    A, q, c = _MATRICES[rng.integers(len(_MATRICES))](rng, n), _vector(rng, n), _vector(rng, n)
    kind, known = "zero", None
    if rng.random() < 0.65:
        kind = ("constant", "affine", *PSI)[rng.integers(len(PSI) + 2)]
    G = np.where(rng.random((n, n)) < 2 / n, rng.integers(-2, 3, (n, n)) / 4, 0.0)
    if rng.random() < 0.2:
        G = np.eye(n) if rng.random() < 0.5 else np.roll(np.eye(n), 1, axis=1)
    whole = bool((np.round(A) == A).all())
    if plain:
        return Trial(tuples(A), tuple(q), kind, tuple(c))
    if whole and kind in ("zero", "constant") and rng.random() < 0.3:  # made for a solution, in exact arithmetic
        c = np.round(c) if kind == "constant" else np.zeros(n)
        room, push, gap = rng.integers(0, 3, n), rng.integers(0, 3, n), rng.integers(0, 3, n)
        known, above = c + np.where(push > 0, 0, room), {}
        if rng.random() < 0.3:
            pressed = rng.random(n) < 0.4
            d = np.where(pressed, c + room, known + gap)
            known, push = np.where(pressed, d, known), np.where(pressed, -push, push)
            above = {"upper": "constant", "d": tuples(d)}
        q = np.asarray(push - A @ known, dtype=np.float64)
    else:
        A, q = _scales(rng, n)[:, None] * A * _scales(rng, n), _scales(rng, n) * q
        unit = _scales(rng, n)
        A, q, c = (np.clip(part, -1e307, 1e307) for part in (A, q, unit * c))
        above = _above(rng, kind, c, G, unit) if rng.random() < 0.35 else {}
        c = np.where(rng.random(n) < rng.choice([0.0, 0.0, 0.3]), -np.inf, c)
    raising = bool(rng.random() < 0.1)
    solution = None if known is None else tuples(known)
    return Trial(tuples(A), tuples(q), kind, tuples(c), tuples(G), **above, raising=raising, known=solution)


def _above(rng: np.random.Generator, kind: str, c: Vector, G: Array, unit: Vector) -> dict[str, Any]:
    """An obstacle above the one of that `kind`: like it, or of any kind; mostly not below it, in some rows equal to it,
    in some none."""
    n = c.size
    upper = ("constant", "affine", *PSI)[rng.integers(len(PSI) + 2)]
    if rng.random() < 0.5:
        upper = "constant" if kind == "zero" else kind
    H = G if rng.random() < 0.5 else np.where(rng.random((n, n)) < 2 / n, rng.integers(-2, 3, (n, n)) / 4, 0.0)
    base = np.zeros(n) if kind == "zero" else c
    room = rng.choice([0.0, 1.0, 3.0, 1e-9], n) if rng.random() < 0.8 else _vector(rng, n)
    d = np.clip(base + unit * room, -1e307, 1e307)
    d = np.where(rng.random(n) < rng.choice([0.0, 0.0, 0.4]), np.inf, d)
    return {"upper": upper, "d": tuples(d), "H": tuples(H)}


def _proved(rng: np.random.Generator) -> Trial:
    """One of which a bound is known, at any scale, and a bound."""
    n = int(rng.integers(1, 5 if rng.random() < 0.7 else 14))
    A = (_definite, _flat, _m_matrix)[rng.integers(3)](rng, n) + rng.integers(0, 2) * np.eye(n)
    scale, back = _scales(rng, n), _scales(rng, n)
    A, q = scale[:, None] * A * (scale if rng.random() < 0.5 else back), rng.integers(0, 2) * scale * _vector(rng, n)
    c = _scales(rng, n) * (-1.0 if rng.random() < 0.3 else _vector(rng, n))
    kind = ("zero", "constant", "affine")[rng.integers(3)]
    G = np.diag(rng.uniform(0.0, 1.0, n)) if rng.random() < 0.5 else _low_rank(rng, n) / 16
    A, q, c = (np.clip(part, -1e307, 1e307) for part in (A, q, np.broadcast_to(c, n)))
    above = _above(rng, kind, c, G, _scales(rng, n)) if rng.random() < 0.4 else {}
    if above and above["upper"] not in ("constant", "affine"):
        above |= {"upper": kind if kind == "affine" else "constant"}
    asked = str(rng.choice(list(ASKED)[5:]))
    options = (("max_iter", _STEPS),) if rng.random() < _LIMITED else ()
    return Trial(tuples(A), tuples(q), kind, tuples(c), tuples(G), **above, options=options, asked=asked)


def _asked(rng: np.random.Generator, trial: Trial) -> Trial:
    """The trial with a front end, a method, options, and what is asked of the answer."""
    front = str(rng.choice(["solve", "many", "file"], p=[0.9, 0.07, 0.03]))
    is_data = trial.psi in ("zero", "constant", "affine") and trial.upper in ("", "constant", "affine")
    if trial.source or (front == "many" and len(trial.q) > 12) or (front == "file" and not is_data):
        front = "solve"
    wanted = _MANY if front == "many" else tuple(_OPTIONS)
    chosen = [name for name in wanted if rng.random() < 0.6 / len(wanted) ** 0.5]
    method = None
    if front != "many" and rng.random() < 0.45:
        method = str(rng.choice(method_names()))
        if not all(trial.A[i][i] > 0 for i in range(len(trial.q))) and rng.random() < 0.8:  # most would refuse
            method = str(rng.choice(_WITHOUT_DIAGONAL))
        chosen = [name for name in chosen if name != "family"]
    if "accuracy" in chosen:
        chosen = [name for name in chosen if name not in ("rtol", "atol")]
    options = [(name, str(rng.choice(_OPTIONS[name]))) for name in chosen]
    if front == "many" and "time_limit" not in chosen:
        options.append(("time_limit", _SECONDS))
    elif front != "many" and "max_iter" not in chosen and rng.random() < _LIMITED:
        options.append(("max_iter", _STEPS))
    asked = "" if front == "many" else str(rng.choice(list(ASKED), p=_WEIGHTS))
    return replace(trial, front=front, method=method, options=tuple(options), asked=asked)


def _gallery(rng: np.random.Generator) -> Trial:
    n = int(rng.integers(3, 60))
    if rng.random() < 0.5:
        name, seed = rng.choice(family_names()), int(rng.integers(10**6))
        source = f"icp.benchmarks.drawn({str(name)!r}, {n}, np.random.default_rng({seed})){_pressed(rng)}"
        return _asked(rng, Trial(source=source))
    name = str(rng.choice(scene_names()))
    size = f", {n}" if "n" in parameters(name) else ""
    return _asked(rng, Trial(source=f"icp.scenes.scene({name!r}{size}).problem{_pressed(rng)}"))


def _pressed(rng: np.random.Generator) -> str:
    """Nothing, or an obstacle above a problem that has none."""
    return f".with_upper({rng.choice([0.0, 0.1, 1.0, 10.0])})" if rng.random() < 0.3 else ""


def _large(rng: np.random.Generator) -> Trial:
    """A time limit that a large problem does not fit into, with the solver or a method by its name."""
    n, seed = int(10 ** rng.uniform(2.5, 4)), int(rng.integers(10**6))
    if rng.random() < 0.5:
        sparse = f"sp.random_array(({n}, {n}), density=6 / {n}, rng=np.random.default_rng({seed}))"
        A = f"{sparse} + {rng.integers(1, 8)} * sp.eye_array({n})"
        source = f"icp.ICP({A}, np.tile([-1.0, 1.0], {n})[:{n}])"
    else:
        family = str(rng.choice([name for name in family_names() if "dense" not in name and "market" not in name]))
        source = f"icp.benchmarks.drawn({family!r}, {n}, np.random.default_rng({seed}))"
    method = None if rng.random() < 0.3 else str(rng.choice(method_names()))
    limits = (("time_limit", str(rng.choice(["0.05", "0.3", "1.0"]))),)
    return Trial(source=f"({source}){_pressed(rng)}", method=method, options=limits)


def _program(rng: np.random.Generator) -> Trial:
    n, m = int(rng.integers(1, 4)), int(rng.integers(1, 5))
    B = rng.integers(-2, 3, (n, n)).astype(np.float64)
    P = rng.choice([0.0, 1.0, 1e-10, 1e-6, 1e6]) * (B.T @ B if rng.random() < 0.5 else np.eye(n))
    G, c = rng.integers(-2, 3, (m, n)) * _scales(rng, m).clip(1e-8, 1e8)[:, None], rng.integers(-4, 5, m)
    equal = int(rng.integers(0, min(m, n))) if n > 1 else 0
    q = rng.integers(-3, 4, n) * rng.choice([1.0, 1e-4, 1e4])
    return Trial(tuples(P), tuples(q), "zero", tuples(c), tuples(G), front="cvxpy", equal=equal)
