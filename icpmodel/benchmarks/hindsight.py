"""How well `solve()` chooses: on random problems, against its own methods in hindsight and against QP solvers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..errors import InputError
from ..icp import ICP
from ..methods.contract import named
from ..methods.contract import names as method_names
from ..numerics.arrays import as_list, as_number
from ..present.table import Table
from ..scenes import names
from ..solvers.foreign import chosen_solvers
from ..study.cases import VARIANTS, Case, built, cases
from ..study.charts.table_charts import OWN, PEER
from ..study.competitors import Competitor, Foreign, Own, own_methods
from ..study.timing import machine
from .benchmark import Measurement, Record
from .families.gallery import drawn_sizes, family_names, problem_of

#: the peers: a proximal and an interior point method, two operator splittings and an active set
_PEERS = ("piqp", "clarabel", "osqp", "highs")
#: a method has so many times the time of the best one so far, a peer of solve(), and so many seconds at least
_PATIENCE, _LEAST = 3.0, 0.3
#: own methods that take so many times the time of the best are not timed again, nor what takes so many seconds; but all
#: are that take less than so many, as first runs are slower than others by about that
_NEAR, _SLOW, _BRIEF = 1.3, 3.0, 0.01
#: the gallery's scenes are families of this kind, which are measured where they are asked for
_GALLERY = "gallery"


class _Peer(Foreign):
    """A foreign solver where the problem is its own: min ½zᵀAz + qᵀz over z ≥ c."""

    def why_not(self, case: Case) -> str | None:
        energy = super().why_not(case) if case.posed is None else case.posed[0].why_not("energy")
        return energy or super().why_not(case)


class _Hindsight(Measurement):
    """Whoever is far behind need not end, and is not timed again."""

    def limit(self, kind: str, solve: float, quickest: float) -> float:
        of = {"own": quickest, "peer": solve}.get(kind, np.inf)
        return max(_PATIENCE * of, _LEAST)

    def again(self, record: Record, solve: float, quickest: float) -> bool:
        near = max(_NEAR * quickest, _BRIEF) if record.kind == "own" else _PATIENCE * solve
        return record.seconds[0] <= min(near, _SLOW)


def choice(
    seed: int | None = None,
    families: Sequence[str] = (),
    sizes: tuple[int, int, int] = (100, 10_000, 3),
    most: int | None = None,
    *,
    time_limit: float = 10.0,
    repeats: int = 3,
    own: Sequence[str] = (),
    peers: bool = True,
    entrants: Sequence[Competitor] | None = None,
    progress: bool = False,
) -> Table:
    """solve() against its best own method in hindsight and against QP solvers, on problems that are drawn anew.

    The best of all own methods, at their default options, relaxed for the estimated Jacobi radius or with theta1
    chosen, is known only when all have run. One that takes three times as long as the best so far, or .3 s, is stopped,
    a peer after three times the time of `solve()`. Peers (PIQP, Clarabel, OSQP, HiGHS) take part where A is symmetric
    and semidefinite and ψ constant, and count where they reach the residual, which is recomputed: see `benchmark`.
    What takes less than 3 s is then timed in turn, in at least `repeats` rounds; ratios are medians over the rounds.

    Parameters: `seed` an integer ≥ 0 that stands for all problems; without one they are others each time, and the title
    tells the seed; `families` the first letters of names (see `icpmodel.benchmarks.family_names`), "gallery" for the
    scenes, by default all but these; `sizes` smallest and largest n and how many sizes between them, drawn for each
    family; `most` so many problems at most, drawn of all; `time_limit` seconds for one run; `repeats` rounds of
    timings, ≥ 3; `own` names of the own methods to take part, by default all; `peers` whether foreign solvers do;
    `entrants` in place of all these; `progress` shows a line on what is going on.
    Returns a `Table`: ratios are times of `solve()` over those of the other, above 1 where `solve()` is slower.
    Raises InputError, and Interrupted, whose `report` is the table so far.

    >>> icp.benchmarks.choice(1, ["plate"], (10, 20, 1), most=1, own=["lemke"], peers=False).heads[:5]
    ('family', 'n', 'solve() by', 'solve(), s', 'best own method')
    """
    low, high, count = (int(as_number(one, "sizes", least=1, whole=True)) for one in as_list(sizes, "sizes"))
    if seed is None:
        seed = int(np.random.default_rng().integers(2**31))
    seed = int(as_number(seed, "seed", least=0, whole=True))
    drawn = [
        (family, n)
        for family in _families(as_list(families, "families"))
        for n in drawn_sizes(family, seed, (max(low, 3), max(low, high, 3), count))
    ]
    if most is not None and (most := int(as_number(most, "most", least=1, whole=True))) < len(drawn):
        kept = np.random.default_rng(seed).permutation(len(drawn))[:most]
        drawn = [drawn[k] for k in sorted(kept)]
    if entrants is None:
        foreign = [_Peer(solver) for solver in chosen_solvers(_PEERS)] if peers else []
        entrants = [Own(), *_own(as_list(own, "own")), *foreign]
    solvers = [one.name for one in entrants if one.kind == "peer"]
    measurement = _Hindsight(entrants, repeats, time_limit)
    found = cases(drawn, lambda family, n: _problem(family, seed, n))
    return measurement.over(found, progress, lambda records: _table(records, solvers, seed))


def summary_of(table: Table) -> list[str]:
    """What a `choice` comes to, in sentences: the ratios, by which kind of method, and what was not solved.

    Parameters: `table` of a `choice`.

    >>> table = icp.benchmarks.choice(1, ["plate"], (10, 20, 1), most=1, own=["lemke"], peers=False)
    >>> icp.benchmarks.summary_of(table)[-1]
    'not solved: none'
    """
    rows = table.records()
    said = []
    for head, bound in (("ratio", OWN), *((head, PEER) for head in table.heads if head.startswith("to "))):
        found = sorted((row[head], f"{row['family']}, n = {row['n']}") for row in rows if row[head] is not None)
        against = "the best own method" if head == "ratio" else head.removeprefix("to ")
        if found:
            ratios, (worst, where) = np.array([ratio for ratio, _ in found]), found[-1]
            above = f"above {bound:g} in {int((ratios > bound).sum())} of {len(found)} cases"
            said.append(f"{against}: median {np.median(ratios):.2f}, worst {worst:.2f} ({where}), {above}")
        else:
            said.append(f"{against}: no case")
    for words, least in (("all", 0), ("n > 64", 64)):
        kinds = Counter(_kind(row["solve() by"]) for row in rows if row["solve() by"] and row["n"] > least)
        shares = ", ".join(f"{kind} {number / kinds.total():.0%}" for kind, number in kinds.most_common())
        said.append(f"solves by family of method ({words}): {shares or 'none'}")
    failed = [f"  {row['family']}, n = {row['n']}: {row['note']}" for row in rows if not row["solve() by"]]
    return [*said, f"not solved: {len(failed) or 'none'}", *failed]


def _families(beginnings: list[str]) -> list[str]:
    """The random families that are meant, then scenes."""
    scenes = [f"{_GALLERY}-{text}" for text in sorted([*names(), *VARIANTS])]
    asked = [one for one in beginnings if one.startswith(_GALLERY)]
    found = [name for name in scenes if name.startswith(tuple(asked))] if asked else []
    if asked and not found:
        raise InputError(f"families has {asked[0]!r}; {_GALLERY} or {_GALLERY}- and the name of a scene was expected")
    others = [one for one in beginnings if one not in asked]
    return [*(family_names(others) if others or not asked else []), *found]


def _own(wanted: list[str]) -> list[Competitor]:
    """The own methods by these names, or all."""
    automatic = [Own(f"{name}, auto", named(name, theta1="auto")) for name in ("mnmaor", "mnmmod")]
    known = {one.name: one for one in [*own_methods(), *automatic]}
    for name in wanted:
        if name not in known:
            raise InputError(f"own has {name!r}; one of {', '.join(map(repr, known))} was expected")
    return [known[name] for name in wanted] or list(known.values())


def _problem(family: str, seed: int, n: int) -> ICP:
    if not family.startswith(f"{_GALLERY}-"):
        return problem_of(family, seed, n)
    return built(family.removeprefix(f"{_GALLERY}-"), n).problem


def _table(records: list[Record], peers: list[str], seed: int) -> Table:
    """One row for each problem: what `solve()` took, and the ratios to the best own method and to each peer."""
    rows: list[tuple[Any, ...]] = []
    for family, n in dict.fromkeys((one.scene, one.n) for one in records):
        here = [one for one in records if (one.scene, one.n) == (family, n)]
        solve, reached = here[0], {one.name: one for one in here[1:] if one.reached}
        if solve.reached and not solve.ratios:  # Ctrl-C came before all had run
            continue
        single = [one for one in reached.values() if one.kind == "own"]
        best = min(single, key=lambda one: one.median, default=None)
        told = (None, None) if best is None else (best.name, best.median)
        if not solve.reached:
            rows.append((family, n, "", None, *told, None, *[None] * len(peers), solve.note))
            continue
        ratios = [None if one is None else float(np.median(1.0 / np.array(one.ratios)))
                  for one in (best, *map(reached.get, peers))]  # fmt: skip
        bounds = (OWN, *[PEER] * len(peers))
        above = any(ratio is not None and ratio > bound for ratio, bound in zip(ratios, bounds, strict=True))
        note = "slow" if above else ""
        rows.append((family, n, solve.note.removeprefix("by "), solve.median, *told, *ratios, note))
    heads = ("family", "n", "solve() by", "solve(), s", "best own method", "its time, s", "ratio")
    title = f"solve() against its best own method and QP solvers, seed {seed} ({machine()})"
    return Table(title, (*heads, *(f"to {name}" for name in peers), "note"), tuple(rows))


def _kind(method: str) -> str:
    family = named(method).family if method in method_names() else ""
    return family or "other"
