"""The time of a solve on any number of ranks, on paper: what one, and two, ranks were counted and timed to do.

A solve is so many Krylov steps, looks, rounds of sweeps and masks on each level, and the making of the levels. A part
costs f for each level that it goes through, e for each stored entry of A and P of the own rows there, and on ranks a
latency for each message, the time of its bytes, and one latency for each of the ⌈log₂ ranks⌉ rounds of a reduction; and
a hypre without tables compares each coarse row with all that other ranks ask for, in a time that no memory changes. f
and e are those of one rank at two sizes; messages, bytes and reductions are counted on two, whose times say how much
longer work takes where cores share a memory, and messages while the levels are made. Rows are dealt out in their
order, so that on a grid a rank asks as many ranks as the points that it needs of one side are spread over.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

#: parts that go through all coarser levels as well
_DEEP = ("steps", "masks")
_PARTS = (*_DEEP, "looks", "sweeps")
_WORD = 8.0
#: messages to each neighbour and collective calls by level while the levels are made, which no log has: counted at the
#: profiling interface of MPI (PETSc 3.18 with hypre 2.26, membranes of 1e5 and 1e6 unknowns on 2, 4 and 8 ranks); two
#: ranks had 45 sends, and 44 Allreduce, 48 Allgather and 6 Bcast
_MAKING_SENDS, _MAKING_ROUNDS = 45.0, 98.0


class Machine(NamedTuple):
    """Seconds of a `message` between ranks, of a `byte` of it, and how many times as long as where it was timed the
    work takes, which is memory's (`slower`)."""

    message: float
    byte: float
    slower: float = 1.0

    def reduction(self, ranks: int) -> float:
        """Seconds of a reduction over all ranks: as many messages one after the other as doubling needs."""
        return math.ceil(math.log2(ranks)) * self.message if ranks > 1 else 0.0


class Price(NamedTuple):
    """Seconds for each `level` and each stored `entry`; messages to each neighbour and words for each ghost by level,
    and reductions, in all."""

    level: float
    entry: float
    messages: float = 0.0
    words: float = 0.0
    reductions: float = 0.0


class LevelShape(NamedTuple):
    """Rows, entries of A and of P of a level, and what one side of a rank asks of others."""

    rows: float
    entries: float
    transfer: float
    reach: float


class Spent(NamedTuple):
    """Seconds on one rank, and messages, bytes and reductions of it: of all work with stored entries (`making` the
    levels, and `solving`), of `searching` for rows that other ranks ask for, of what each level costs whatever its size
    (`levels`), and of what ranks tell each other."""

    making: float = 0.0
    solving: float = 0.0
    searching: float = 0.0
    levels: float = 0.0
    messages: float = 0.0
    bytes: float = 0.0
    reductions: float = 0.0
    sent: float = 0.0
    size: float = 0.0
    rounds: float = 0.0

    @property
    def seconds(self) -> float:
        """Of all of it."""
        return sum(self[:7])

    def plus(self, other: Spent, times: float = 1.0) -> Spent:
        """This and so many `times` the other."""
        return Spent(*(a + times * b for a, b in zip(self, other, strict=True)))


def priced(
    small: float, levels_small: float, entries_small: float, large: float, levels: float, entries: float
) -> Price:
    """The price of which these are the seconds at two sizes; neither number of it is negative."""
    determinant = levels_small * entries - levels * entries_small
    if determinant > 0:
        level = (small * entries - large * entries_small) / determinant
        entry = (levels_small * large - levels * small) / determinant
        if level >= 0 and entry >= 0:
            return Price(level, entry)
    return Price(0.0, large / entries)


@dataclass(frozen=True)
class Calibration:
    """What was counted and timed of one problem: the `shapes` of its levels, `prices` by part, "making" among them,
    how often each part is `done` on each level, and the machine it was timed on. The grid has so many `dimensions`."""

    shapes: tuple[LevelShape, ...]
    prices: dict[str, Price]
    done: dict[tuple[str, int], int]
    machine: Machine
    dimensions: int
    #: what of the seconds of a message is the programs', bytes a row and those of the programs alone, and the bytes a
    #: second that products get from memory
    overhead: float = 0.0
    memory: float = 0.0
    programs: float = 0.0
    bandwidth: float = 0.0
    #: how many times as long work takes while all cores are at it, and messages while the levels are made
    crowd: float = 1.0
    startup: float = 1.0
    #: seconds in which a coarse row is compared with one of those that other ranks ask for, where hypre does that
    search: float = 0.0

    def levels(self, n: float) -> list[LevelShape]:
        """Those of n unknowns: the finest ones as they were, and as many more, in the ratio of the last ones, as lead
        down to as few rows."""
        found: list[LevelShape] = []
        first, least = self.shapes[0], self.shapes[-1].rows
        narrow = 1.0 - 1.0 / self.dimensions
        last = self.shapes[-2] if len(self.shapes) > 1 else first
        ratio = (first.rows / least) ** (1.0 / max(len(self.shapes) - 1, 1))
        scale = n / first.rows
        for shape in self.shapes[:-1]:
            if found and shape.rows * scale <= least:
                break
            found.append(_scaled(shape, scale, narrow))
        while len(self.shapes) > 1 and found[-1].rows > ratio**1.5 * least:
            found.append(_scaled(last, found[-1].rows / ratio / last.rows, narrow))
        if len(self.shapes) > 1:
            found.append(self.shapes[-1])
        return found

    def counts(self, what: str, level: int) -> float:
        """How often `what` is done on this level; below the levels that there were as often as on a coarse one."""
        if level < len(self.shapes):
            return float(self.done.get((what, level), 0))
        coarse = range(1, len(self.shapes))
        return sum(self.done.get((what, k), 0) for k in coarse) / max(len(coarse), 1)

    def part(self, what: str, shapes: list[LevelShape], ranks: int, machine: Machine) -> Spent:
        """One of these on the first of the levels `shapes`."""
        price, total = self.prices[what], Spent()
        for shape in shapes if what in _DEEP else shapes[:1]:
            entries = (shape.entries + shape.transfer if what in _DEEP else shape.entries) / min(ranks, shape.rows)
            neighbours, ghosts = spread(shape, ranks)
            sent, size = price.messages * neighbours, price.words * ghosts * _WORD
            total = total.plus(
                Spent(
                    solving=price.entry * entries * machine.slower,
                    levels=price.level,
                    messages=sent * machine.message,
                    bytes=size * machine.byte,
                    sent=sent,
                    size=size,
                )
            )
        rounds = price.reductions if ranks > 1 else 0.0
        return total.plus(Spent(reductions=rounds * machine.reduction(ranks), rounds=rounds))

    def making(self, shapes: list[LevelShape], ranks: int, machine: Machine) -> Spent:
        """The levels, and all that is done once."""
        price, count = self.prices["making"], len(shapes)
        entries = sum((shape.entries + shape.transfer) / min(ranks, shape.rows) for shape in shapes)
        sent = price.messages * sum(spread(shape, ranks)[0] for shape in shapes)
        pairs = sum(shape.rows / min(ranks, shape.rows) * spread(shape, ranks)[1] for shape in shapes[1:])
        rounds = price.reductions * count if ranks > 1 else 0.0
        return Spent(
            making=price.entry * entries * machine.slower,
            searching=self.search * pairs,
            levels=price.level * count,
            messages=sent * machine.message * self.startup,
            reductions=rounds * machine.reduction(ranks) * self.startup,
            sent=sent,
            rounds=rounds,
        )

    def expected(self, n: float, ranks: int, machine: Machine | None = None) -> Spent:
        """Of a whole solve with n unknowns."""
        here, shapes = machine or self.machine, self.levels(n)
        total = self.making(shapes, ranks, here)
        for what, level in self._all(len(shapes)):
            total = total.plus(self.part(what, shapes[level:], ranks, here), self.counts(what, level))
        return total

    def seconds(self, n: float, ranks: int) -> float:
        """Of a whole solve with n unknowns, where it was timed."""
        here = self.machine._replace(slower=self.crowd) if ranks > 1 else self.machine
        return self.expected(n, ranks, here).seconds

    def _all(self, levels: int) -> Iterator[tuple[str, int]]:
        return ((what, level) for level in range(levels) for what in _PARTS)


def spread(shape: LevelShape, ranks: int) -> tuple[float, float]:
    """(the ranks that one of so many has as neighbours on a level, the unknowns that it asks of them)."""
    busy = min(float(ranks), shape.rows)
    if busy <= 1:
        return 0.0, 0.0
    own, sides = shape.rows / busy, 1.0 if busy <= 2 else 2.0
    reach = min(shape.reach, shape.rows - own)
    neighbours = min(busy - 1.0, sides * max(1.0, math.ceil(reach / own)))
    return neighbours, min(sides * reach, shape.rows - own)


def _scaled(shape: LevelShape, scale: float, narrow: float) -> LevelShape:
    """The same level of a problem so many times as large; what one side asks for grows as a cross-section does."""
    return LevelShape(shape.rows * scale, shape.entries * scale, shape.transfer * scale, shape.reach * scale**narrow)


def fitted(small: dict[str, Any], large: dict[str, Any], pair: dict[str, Any], own: dict[str, Any]) -> Calibration:
    """What the counts say on one rank at a `small` and a `large` size and on a `pair` of ranks at the large one, with
    those at the small one as its "small", and a run of `own`."""
    shapes = tuple(
        LevelShape(one["rows"], one["entries"], one["transfer"], two["ghosts"])
        for one, two in zip(large["shapes"], _padded(pair["shapes"], len(large["shapes"])), strict=True)
    )
    prices = {}
    for what in _PARTS:
        price = priced(*_size(small, what), *_size(large, what))
        sent, through = pair["parts"][what], pair["shapes"] if what in _DEEP else pair["shapes"][:1]
        ghosts = sum(one["ghosts"] for one in through) * _WORD
        counted = sent["messages"] / len(through), sent["bytes"] / max(ghosts, 1.0), sent["reductions"]
        prices[what] = price._replace(messages=counted[0], words=counted[1], reductions=counted[2])
    rest = [_rest(told) for told in (small, large | {"seconds": min(large["seconds"], own["cpu"])})]
    levels, entries = zip(*(_size(told, "steps")[1:] for told in (small, large)), strict=True)
    making = priced(rest[0], levels[0], entries[0], rest[1], levels[1], entries[1])
    message = max(pair["latency"], _message(pair["small"], prices["steps"]))
    prices["making"] = making._replace(messages=_MAKING_SENDS, reductions=_MAKING_ROUNDS)
    product = 12.0 * shapes[0].entries + 24.0 * shapes[0].rows  # bytes: the matrix, its rows, and both vectors
    made = Calibration(
        shapes,
        prices,
        _done(large),
        Machine(message, pair["byte"]),
        len(large["shape"]),
        overhead=message - pair["latency"],
        memory=own["beyond"] / own["n"],
        programs=own["memory"] - own["beyond"],
        bandwidth=product / large["product"],
        search=pair["search"],
    )
    return _shared(made, pair)


def _shared(made: Calibration, pair: dict[str, Any]) -> Calibration:
    """The model with what two ranks took longer than it says: with few unknowns in messages, with many in work."""
    few = made.making(made.levels(pair["small"]["n"]), 2, made.machine)
    told = few.messages + few.reductions
    startup = (_rest(pair["small"]) - few.making - few.searching - few.levels) / told if told else 1.0
    made = replace(made, startup=max(startup, 1.0))
    whole = replace(made, done=_done(pair)).expected(pair["n"], 2)
    work = whole.making + whole.solving
    return replace(made, crowd=max((pair["seconds"] - whole.seconds + work) / work, 1.0))


def _done(told: dict[str, Any]) -> dict[tuple[str, int], int]:
    """How often each part was done on each level."""
    return {(what, level): count for what, level, count in told["done"]}


def _message(told: dict[str, Any], steps: Price) -> float:
    """Seconds of a message as PETSc sends it: what steps on two ranks take longer than the work in them."""
    seconds, levels, entries = _size(told, "steps")
    sent = told["parts"]["steps"]["messages"] + told["parts"]["steps"]["reductions"]
    return (seconds - steps.level * levels - steps.entry * entries / told["ranks"]) / sent


def _size(told: dict[str, Any], what: str) -> tuple[float, float, float]:
    """(seconds, levels, entries) of one part."""
    through = told["shapes"] if what in _DEEP else told["shapes"][:1]
    transfer = 1.0 if what in _DEEP else 0.0
    entries = sum(one["entries"] + transfer * one["transfer"] for one in through)
    return told["parts"][what]["seconds"], float(len(through)), entries


def _rest(told: dict[str, Any]) -> float:
    """The seconds of the run without its parts: what is done once."""
    total, shapes = told["seconds"], told["shapes"]
    for what, level, count in told["done"]:
        through = shapes[level:] if what in _DEEP else shapes[level : level + 1]
        entries = sum(one["entries"] + one["transfer"] for one in through)
        whole = sum(one["entries"] + one["transfer"] for one in (shapes if what in _DEEP else shapes[:1]))
        total -= count * told["parts"][what]["seconds"] * entries / whole
    return max(float(total), 0.0)


def _padded(shapes: list[dict[str, float]], count: int) -> list[dict[str, float]]:
    """`count` of them: on two ranks there may be a level more, or fewer."""
    return [shapes[min(k, len(shapes) - 1)] for k in range(count)]
