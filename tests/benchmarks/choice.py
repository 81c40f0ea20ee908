"""solve() against its best own method and QP solvers."""

from collections import Counter

import numpy as np

import icpmodel as icp
from icpmodel.solvers import Target, ask, foreign_solvers
from icpmodel.study.competitors import tuned_omega

from .families import drawn_sizes, family_names, problem_of
from .harness import compared, relaxed, run, scene, time_calls

#: a proximal and an interior point method, operator splitting, an active set
PEERS = ("piqp", "clarabel", "osqp", "highs")
#: what a peer is asked for until its answer is good enough
LADDER = tuple(10.0**-k for k in range(3, 13))
#: the largest times of `solve()` that are good, in times of the best own method, or of a peer
OWN, PEER = 2.0, 1.5
#: the time of a method: this multiple of the best so far, and at least these seconds
PATIENCE, LEAST = 3.0, 0.3
#: a method that takes longer than this multiple of the best, and than these seconds, is timed once
NEAR, BRIEF = 1.3, 0.01
GALLERY = "gallery-"


def table(seed=1, families=(), low=100, high=10_000, count=1, most=60, time_limit=2.0, repeats=7, own=(), peers=PEERS):
    """`solve()` against its best own method in hindsight and against QP solvers, on problems drawn anew.

    Own methods run at their default options, relaxed for the Jacobi radius, or with θ₁ chosen. Peers take part where
    the problem is a convex QP in z, and count with the first tolerance at which the recomputed residual is at most
    1e-8 Res_D(0). Ratios are times of `solve()` over those of the other, medians over rounds in turn.

    Parameters
    ----------
    seed : stands for all problems
    families : first letters of names; "gallery" takes the scenes; by default all but these
    low, high, count : smallest and largest n, and how many sizes between them, drawn for each family
    most : the largest number of problems, drawn of all
    time_limit : seconds for one run
    repeats : rounds of timings
    own : names of the own methods to take part, by default all
    peers : names of the foreign solvers to take part
    """
    heads = ("family", "n", "solve() by", "solve(), s", "best own method", "its time, s", "ratio")
    yield *heads, *(f"to {name}" for name in peers), "note"
    known = own_methods()
    makers = {name: known[name] for name in own or known}
    solvers = [foreign_solvers()[name] for name in peers]
    wanted = [(name, n) for name in named(families) for n in drawn_sizes(name, seed, low, high, count)]
    kept = np.random.default_rng(seed).permutation(len(wanted))[:most]
    for family, n in (wanted[k] for k in sorted(kept)):
        try:
            made = scene(family.removeprefix(GALLERY), n).problem if GALLERY in family else problem_of(family, seed, n)
        except icp.InputError as error:  # a scene that has no such size
            yield family, n, *[None] * (5 + len(peers)), str(error)
            continue
        if made.residual_at_0() > 0.0:
            yield family, made.n, *contest(made, makers, solvers, time_limit, repeats)


def named(beginnings):
    of_scenes = tuple(one for one in beginnings if one.startswith("gallery"))
    others = [one for one in beginnings if one not in of_scenes]
    scenes = [GALLERY + name for name in icp.scenes.names() if (GALLERY + name).startswith(of_scenes)]
    return [*(family_names(others) if others or not of_scenes else []), *scenes]


def own_methods():
    """Name ↦ problem ↦ method."""

    makers = {name: lambda problem, name=name: icp.methods.named(name) for name in icp.methods.names()}
    makers["psor, tuned"] = lambda problem: icp.PSOR(omega=tuned_omega(problem))
    makers["mnmaor, tuned"] = lambda problem: relaxed(problem, tuned_omega(problem))
    for name in ("mnmaor", "mnmmod"):
        makers[f"{name}, auto"] = lambda problem, name=name: icp.methods.named(name, theta1="auto")
    return makers


def contest(problem, makers, solvers, limit, repeats):
    """The rest of the row: what `solve()` took, and the ratios to the best own method and to each peer."""
    none = [None] * len(solvers)
    calls = {"solve()": lambda: run(problem, None, time_limit=limit)}
    mine, solution = twice(calls["solve()"])
    if not solution.solved:
        return "", None, None, None, None, *none, f"not solved: {solution.status.value}"
    first = {}
    quickest = mine
    for name, make in makers.items():
        if "tuned" in name and not problem.matrix.has_positive_diagonal:
            continue
        if make(problem).why_not(problem) is None:
            patience = min(limit, max(PATIENCE * quickest, LEAST))
            call = lambda make=make, patience=patience: run(problem, make, time_limit=patience)  # noqa: E731
            seconds, other = twice(call)
            if other.solved:
                first[name] = seconds
                calls[name] = call
                quickest = min(quickest, seconds)
    for name, seconds in first.items():
        if seconds > max(NEAR * quickest, BRIEF):
            del calls[name]
    rivals = {solver.name: peer(problem, solver, min(limit, max(PATIENCE * mine, LEAST))) for solver in solvers}
    calls |= {name: call for name, call in rivals.items() if call is not None}
    brief = {name: (lambda call=call: twice(call)[0]) for name, call in calls.items()}
    taken = time_calls(brief, repeats, warm=False)
    medians = {name: float(np.median(seconds)) for name, seconds in taken.items()}
    best = min((name for name in makers if name in calls), key=medians.get, default=None)
    ratios = [compared(taken, "solve()", name)[2] if name in calls else None for name in (best, *rivals)]
    return solution.method.name, medians["solve()"], best, medians.get(best), *ratios, ""


def twice(call):
    """(seconds, answer) of a call; where it is short, of a second one, as the first compiles and has cold caches."""
    first = call()
    return first if first[0] > 1.0 else call()


def peer(problem, solver, limit):
    """A call of `solver` at the first tolerance at which its answer is good enough, or None."""
    target = Target(problem)
    if problem.psi.linear is None or target.why_not("energy") or solver.why_not(target):
        return None
    for tolerance in LADDER:
        claim = ask(solver, target, tolerance, limit)
        is_answer = np.shape(claim.z) == (problem.n,)
        if is_answer and problem.residual(claim.z) <= 1e-8 * problem.residual_at_0():
            return lambda: (ask(solver, target, tolerance, limit).seconds, None)
        if claim.seconds > limit:
            break
    return None


def below(table):
    """The ratios, by which kind of method, and what was not solved, in sentences."""
    rows = table.records()
    for head in ("ratio", *(head for head in table.heads if head.startswith("to "))):
        cases = sorted((row[head], f"{row['family']}, n = {row['n']}") for row in rows if row[head] is not None)
        against = "the best own method" if head == "ratio" else head.removeprefix("to ")
        if cases:
            bound = OWN if head == "ratio" else PEER
            ratios = np.array([ratio for ratio, _ in cases])
            worst = f"worst {ratios[-1]:.2f} ({cases[-1][1]})"
            above = f"above {bound:g} in {int((ratios > bound).sum())} of {len(cases)} cases"
            yield f"{against}: median {np.median(ratios):.2f}, {worst}, {above}"
    kinds = Counter(icp.methods.named(row["solve() by"]).family or "other" for row in rows if row["solve() by"])
    yield "solves by family of method: " + ", ".join(f"{k} {v / kinds.total():.0%}" for k, v in kinds.most_common())
    failed = [f"  {row['family']}, n = {row['n']}: {row['note']}" for row in rows if not row["solve() by"]]
    yield f"not solved: {len(failed) or 'none'}"
    yield from failed
