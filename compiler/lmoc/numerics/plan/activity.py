"""Detection of activity in expressions of time alone: an integrator at rest would step over a short pulse.

The functions of time in the equations, and the signals that are callables, are looked at on a fine grid. Where the
cubic through four neighbouring points misses the point in their middle, something happens on the scale of these points
(the details of Deslauriers and Dubuc's interpolating wavelets, Constructive Approximation 5, 1989). Steps are bounded
there by a few times the finest such scale, which is no shorter than what a method of high order takes by itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from lmoc.expression.calculus import linear_parts
from lmoc.expression.dag import TIME, Expr, depends_on_time, postorder, slots
from lmoc.expression.evaluate import evaluate
from lmoc.ir.program import Apply
from lmoc.numerics.plan.plan import Plan, walk
from lmoc.numerics.signals.signals import Function, Signal, sample
from lmoc.support.records import dataclass

_FORMULA, _CALLABLE = 17, 14  # halvings of a run between two looks at a formula, and at a callable
_CHUNKS = 4  # halvings into the parts in which callables are looked at
_MOST = 4_000_000  # values of formulas looked at
_DETAIL = 1e-3  # of a signal's range: what is missed by less does not count
_LONG = 8  # longest step, in distances of points that miss something which points twice as dense show …
_SHORT = 1.5  # … and where the densest miss it: less than a method's stages are apart
_AROUND = 4  # points to either side of one that was missed where the bound holds
_REGIONS = 500  # regions with bounds of their own
_STEADY = frozenset("add sub mul neg abs min max".split())  # of functions without short pulses have none either
_LEVELS = frozenset("lt le gt ge eq ne and or not sign floor ceil integer mod rem div_integer xor".split())


@dataclass(frozen=True, eq=False)
class StepBounds:
    """Longest steps over time.

    Attributes
    ----------
    edges : (k,) s, where another bound begins; the first is the start of the run
    longest : (k,) s, infinity where there is no bound
    """

    edges: np.ndarray
    longest: np.ndarray

    def within(self, begin: float, end: float) -> float:
        """Return the shortest of the bounds between two times."""
        if not len(self.edges):
            return np.inf
        first = max(0, int(np.searchsorted(self.edges, begin, "right")) - 1)
        last = max(first + 1, int(np.searchsorted(self.edges, end, "left")))
        return float(self.longest[first:last].min(initial=np.inf))


FREE = StepBounds(np.zeros(0), np.zeros(0))


class Lookout:
    """Looks at formulas for a whole run at once, and at callables shortly before the integration comes there."""

    def __init__(
        self,
        formulas: StepBounds = FREE,
        callables: Sequence[tuple[Signal, int]] = (),
        span: tuple[float, float] = (0.0, 0.0),
        key: tuple = (),
    ) -> None:
        self.key = key  # of what it has been made from
        self._formulas, self._callables = formulas, tuple(callables)
        self._start, self._chunk = span[0], (span[1] - span[0]) / 2**_CHUNKS
        self._seen: dict[int, StepBounds] = {}  # of the callables, by parts of the run
        self._ranges = [(np.inf, -np.inf)] * len(self._callables)  # of each, as far as it has been seen

    def edges(self, begin: float, end: float) -> Iterator[float]:
        """Yield the times between two where other bounds begin; by then it is known what follows each."""
        if not self._callables:
            yield from _between(self._formulas.edges, begin, end)
            return
        for k in range(self._part(begin), self._part(end) + 1):
            first, last = max(begin, self._start + k * self._chunk), min(end, self._start + (k + 1) * self._chunk)
            if last - first > 1e-6 * self._chunk:
                if first > begin:
                    yield first
                if k not in self._seen:
                    self._seen[k] = self._look(k)
                yield from _between(np.union1d(self._formulas.edges, self._seen[k].edges), first, last)

    @property
    def is_known(self) -> bool:
        """Return whether everything has been looked at."""
        return not self._callables

    @property
    def is_free(self) -> bool:
        """Return whether nothing bounds the steps."""
        return self.is_known and not len(self._formulas.edges)

    def longest(self, begin: float, end: float) -> float:
        """Return the longest step allowed between two times that lie between two of the edges."""
        seen = self._seen.get(self._part((begin + end) / 2), FREE) if self._callables else FREE
        return min(self._formulas.within(begin, end), seen.within(begin, end))

    def _part(self, time: float) -> int:
        return min(max(0, int((time - self._start) / self._chunk)), 2**_CHUNKS - 1)

    def _look(self, part: int) -> StepBounds:
        begin, end = self._start + part * self._chunk, self._start + (part + 1) * self._chunk
        times = np.linspace(begin, end, 2 ** (_CALLABLE - _CHUNKS) + 1)
        scales = []
        for k, (signal, order) in enumerate(self._callables):
            values = sample(signal, order, times)
            finite = values[np.isfinite(values)]
            low, high = self._ranges[k]
            low, high = min(low, finite.min(initial=np.inf)), max(high, finite.max(initial=-np.inf))
            self._ranges[k] = low, high
            scales.append(finest_scales(values, high - low))
        return _regions(np.minimum.reduce(scales) * (end - begin), begin, end)


def _between(edges: np.ndarray, begin: float, end: float) -> list[float]:
    return edges[(edges > begin) & (edges < end)].tolist()


def lookout(
    plan: Plan, base: np.ndarray, signals: Mapping[int, Signal], span: tuple[float, float], known: Lookout | None = None
) -> Lookout:
    """Return what bounds the steps of a run by what depends on time alone.

    Parameters
    ----------
    base : registers that do not change until the next event (`Plan.base`)
    span : s, the start and the end of the run
    known : of the segment of the run before; returned where it holds on
    """
    found, callables = plan.once(pulsing), _callables(plan, signals)
    key = (*((e, base[rows].tobytes()) for e, rows in found), *((id(s), order) for s, order in callables))
    if known is not None and known.key == key:
        return known
    scales = [finest_scales(v, float(np.ptp(v))) for v in _formula_values(found, base, *span)]
    formulas = _regions(np.minimum.reduce(scales) * (span[1] - span[0]), *span) if scales else FREE
    return Lookout(formulas, callables, span, key)


def pulsing(plan: Plan) -> list[tuple[Expr, np.ndarray]]:
    """Return expressions of time and parameters that may have short pulses, with the registers of their columns."""
    fixed = np.zeros(plan.count, bool)
    fixed[plan.parameters] = True
    found: dict[tuple[Expr, bytes], np.ndarray] = {}
    for step in walk(plan.program):
        if isinstance(step, Apply) and depends_on_time(step.shape):
            for expression in _largest(step.shape, fixed, step.slots):
                columns = sorted({leaf.value[0] for leaf in slots(expression)})
                rows = step.slots[fixed[step.slots[:, columns]].all(axis=1)]
                if len(rows) and not is_steady(expression):
                    found[expression, rows.tobytes()] = rows
    return [(expression, rows) for (expression, _), rows in found.items()]


def _largest(shape: Expr, fixed: np.ndarray, rows: np.ndarray) -> list[Expr]:
    """The largest parts of a shape that depend on time and, in some row, on nothing else that changes."""
    columns = sorted({leaf.value[0] for leaf in slots(shape)})
    if fixed[rows[:, columns]].all(axis=1).any():
        return [shape]
    timed = _timed(shape)
    found, pending = [], [a for a in reversed(shape.args) if a in timed]
    while pending:  # no recursion: a sum of a thousand terms is a thousand deep
        part = pending.pop()
        columns = sorted({leaf.value[0] for leaf in slots(part)})
        if fixed[rows[:, columns]].all(axis=1).any():
            found.append(part)
        else:
            pending += [a for a in reversed(part.args) if a in timed]
    return found


def _timed(expression: Expr) -> set[Expr]:
    """The nodes that depend on time."""
    found: set[Expr] = set()
    for node in postorder(expression):
        if node is TIME or not found.isdisjoint(node.args):
            found.add(node)
    return found


def is_steady(expression: Expr) -> bool:
    """Return whether a function of time has no short pulse: sums and products of powers, of sines and of steps.

    A run stops where it jumps or bends (`kinks`): a pulse between two of these places is not missed.
    """
    timed = _timed(expression)
    steady: set[Expr] = set()
    for node in postorder(expression):
        if _is_steady(node, timed, steady):
            steady.add(node)
    return expression in steady


def _is_steady(node: Expr, timed: set[Expr], steady: set[Expr]) -> bool:
    """Return whether a node is, if `steady` are those among its arguments that are."""
    if node not in timed or node.op in _LEVELS:
        return True
    if node.op in ("sin", "cos"):
        return linear_parts(node.args[0], [TIME]) is not None
    if node.op == "div":
        return node.args[0] in steady and node.args[1] not in timed
    if node.op == "pow":
        power = node.args[1]
        return power.op == "const" and power.value in (1.0, 2.0, 3.0) and node.args[0] in steady
    return (node.op in _STEADY or node.op == "if" or not node.args) and all(a in steady for a in node.args)


def _formula_values(found: list[tuple[Expr, np.ndarray]], base: np.ndarray, start: float, stop: float) -> list:
    """Values (2**k + 1,) of each formula, for each of its sets of parameters."""
    rows = [(expression, row) for expression, registers in found for row in np.unique(registers, axis=0)]
    if not rows:
        return []
    halvings = _FORMULA - max(0, int(np.ceil(np.log2(len(rows) * 2**_FORMULA / _MOST))))
    if halvings < 8:  # tens of thousands of formulas: they are not all at rest at once
        return []
    times = np.linspace(start, stop, 2**halvings + 1)
    with np.errstate(all="ignore"):
        values = (evaluate(e, lambda k, _: base[row[k]], times) for e, row in rows)  # noqa: B023
        return [np.broadcast_to(np.asarray(v, float), times.shape) for v in values]


def _callables(plan: Plan, signals: Mapping[int, Signal]) -> list[tuple[Signal, int]]:
    """The callables, each with the order of its highest derivative in use."""
    orders: dict[int, int] = {}
    for variable, order in plan.samplers:
        if isinstance(signals[variable], Function):
            orders[variable] = max(order, orders.get(variable, 0))
    return list({(id(signals[v]), n): (signals[v], n) for v, n in orders.items()}.values())


def finest_scales(values: np.ndarray, size: float) -> np.ndarray:
    """Return the finest scale on which a signal does something, (n,) on n even parts of its span, as a fraction of it.

    Parameters
    ----------
    values : (n + 1,) at even points, n a power of two; infinity in the result where nothing happens
    size : range of the signal, of which what happens is a part
    """
    values = np.where(np.isfinite(values), values, 0.0)
    n, least = len(values) - 1, _DETAIL * size
    finest = np.full(n, np.inf)
    if not 0 < least < np.inf:
        return finest
    step = n // 8
    while step >= 1:  # points 2·step apart, and what is missed in their middle
        coarse, middle = values[:: 2 * step], values[step :: 2 * step]
        left, right = np.append(coarse[0], coarse[:-2]), np.append(coarse[2:], coarse[-1])
        missed = np.flatnonzero(np.abs(middle - (9 * (coarse[:-1] + coarse[1:]) - left - right) / 16)[1:-1] > least) + 1
        for k in missed.tolist() if len(missed) < 64 else ():
            finest[max(0, (2 * k + 1 - _AROUND) * step) : (2 * k + 1 + _AROUND) * step] = 2 * step / n
        if len(missed) >= 64:
            inside = np.zeros(n // step + 1, int)
            np.add.at(inside, np.maximum(0, 2 * missed + 1 - _AROUND), 1)
            np.add.at(inside, np.minimum(n // step, 2 * missed + 1 + _AROUND), -1)
            finest[np.repeat(np.cumsum(inside)[:-1] > 0, step)] = 2 * step / n
        step //= 2
    return finest


def _regions(scale: np.ndarray, start: float, stop: float) -> StepBounds:
    """Bounds in few regions: in each the shortest one, neighbours differ by a factor of 8 or more."""
    densest = 2.5 / len(scale) * (stop - start)
    longest = np.where(scale < densest, _SHORT, _LONG) * scale
    longest[longest > (stop - start) / 2] = np.inf
    classes = np.floor(np.log2(longest) / 3)
    edges = np.append(0, np.flatnonzero(classes[1:] != classes[:-1]) + 1)
    if len(edges) > _REGIONS:
        edges = edges[:1]
    bounds = np.minimum.reduceat(longest, edges)
    return StepBounds(start + (stop - start) * edges / len(scale), bounds)
