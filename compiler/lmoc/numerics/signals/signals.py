"""Input signals: a number, a formula in time, a function, or a table; and their derivatives.

A formula becomes steps of the program, so it costs no Python while a run goes on. Functions and tables are asked by
the integrator at the times of its stages.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from lmoc.expression.calculus import total_derivative
from lmoc.expression.dag import Expr, postorder
from lmoc.ir.flat import FlatDAE, Kind
from lmoc.messages.diagnostics import Diagnostic, ModelError, Report, nearest
from lmoc.numerics.signals.tables import Points, Table, checked_table
from lmoc.support.distinct import distinct
from lmoc.support.records import dataclass

# where a formula with one of these is differentiated, the derivative lacks what happens at the kink itself
_KINKED = frozenset("abs sign floor ceil integer min max mod rem div_integer if lt le gt ge eq ne".split())


_DIFFERENCE = 1e-5  # of a run, between the values of a callable whose slope is estimated


@dataclass(frozen=True)
class Constant:
    """The same number at all times."""

    value: float


@dataclass(frozen=True, eq=False)
class Formula:
    """A shape over time and parameters; column k is the parameter ``variables[k]`` of the flat model."""

    shape: Expr
    variables: tuple[int, ...] = ()

    def derivative(self, order: int) -> Expr:
        return formula_derivative(self.shape, order)

    @property
    def kinked(self) -> bool:
        return any(node.op in _KINKED for node in postorder(self.shape))


@dataclass(frozen=True, eq=False)
class Function:
    """A Python callable of time, with derivatives where it has a method ``derivative(n)`` that returns a callable.

    Attributes
    ----------
    name : of the input
    span : s, first and last time at which it is asked
    """

    call: Callable[[float], float]
    name: str = ""
    span: tuple[float, float] = (-np.inf, np.inf)

    @lru_cache(maxsize=8)  # noqa: B019 - a handful of orders of one signal
    def at_order(self, order: int) -> Callable[[float], float] | None:
        if order == 0:
            return self.call
        make = getattr(self.call, "derivative", None)
        return make(order) if make is not None else self.slope if self.estimates(order) else None

    def estimates(self, order: int) -> bool:
        """Return whether differences stand for a derivative: good enough for the work of a source, not for a motion."""
        first, last = self.span
        return order == 1 and not hasattr(self.call, "derivative") and 0 < last - first < np.inf

    def slope(self, t: float) -> float:
        """The first derivative by five values (of order 4), inside the span alone: forward or backward at its ends."""
        first, last = self.span
        h = _DIFFERENCE * (last - first)
        side = 1 if t - 2 * h < first else -1 if t + 2 * h > last else 0
        places, weights = ((-2, -1, 1, 2), (1, -8, 8, -1)) if side == 0 else ((0, 1, 2, 3, 4), (-25, 48, -36, 16, -3))
        step = h if side >= 0 else -h
        return sum(w * self.value(t + k * step, 0) for k, w in zip(places, weights, strict=True)) / (12 * step)

    def value(self, t: float, order: int) -> float:
        """
        Raises
        ------
        ModelError
            E0521: what the callable returns is not a number.
        """
        try:
            given = self.at_order(order)(t)
        except Exception as error:
            error.add_note(f"raised by the function for input '{self.name}' at t = {t:g} s")
            raise
        if isinstance(given, float):  # an integrator asks often
            return given
        try:
            return float(given if np.ndim(given) == 0 else np.asarray(given).item())
        except (TypeError, ValueError):
            message = f"the function for input '{self.name}' does not return a number at t = {t:g} s"
            found = f"{type(given).__name__} {given!r:.60}"
            raise ModelError([Diagnostic("E0521", message, expected="one number", found=found)]) from None


Signal = Constant | Formula | Table | Function


@lru_cache(maxsize=512)
def formula_derivative(shape: Expr, order: int) -> Expr:
    """The order-th derivative by time; the columns are parameters."""
    for _ in range(order):
        columns = {node.value[0] for node in postorder(shape) if node.op == "slot"}
        shape = total_derivative(shape, columns)
    return shape


def gives(signal: Signal, order: int, required: bool = True) -> bool:
    """Return whether the signal has a derivative of that order; if no state needs it, whether it can be estimated."""
    if isinstance(signal, Table):
        return signal.gives(order)
    if isinstance(signal, Function):
        return signal.at_order(order) is not None and not (required and signal.estimates(order))
    return True


def sample(signal: Signal, order: int, times: np.ndarray) -> np.ndarray:
    """A sampled signal at many times."""
    if isinstance(signal, Table):
        return signal.curve(times, order)
    return np.array([signal.value(t, order) for t in times.tolist()])


def default_signals(flat: FlatDAE) -> dict[int, Signal]:
    """The bindings of top-level inputs as formulas, by variable."""
    found: dict[int, Signal] = {}
    for a in flat.input_bindings:
        for target, slots in zip(a.target.tolist(), a.slots.tolist(), strict=True):
            found[target] = Formula(a.shape, tuple(slots))
    return found


def is_own(signal: Signal, flat: FlatDAE, variable: int) -> bool:
    """Return whether it is the binding that the model itself gives its input."""
    own = default_signals(flat).get(variable)
    return isinstance(signal, Formula) and own is not None and signal.shape is own.shape


def bind_signals(
    flat: FlatDAE,
    inputs: Mapping[str, object] | None,
    report: Report,
    orders: np.ndarray | None = None,
    span: tuple[float, float] = (-np.inf, np.inf),
) -> dict[int, Signal]:
    """One signal for each input that has one: what the caller gives, else the model's own binding.

    Parameters
    ----------
    orders : (2, k) inputs and orders of their derivatives that are in use: a table is joined by a curve that has them
    span : s, the start and the end of the run
    inputs : {name: number, text, callable, or table}
        A table is a pair (times, values), an array with two columns, a data frame, or the path of a file. The name of
        an array of inputs gives all of them the same signal.
    """
    signals = default_signals(flat)
    for name, given in (inputs or {}).items():
        variables = flat.find(name)
        if variables is None or flat.kind[variables[0]] != Kind.INPUT:
            names = [b.pattern for b in flat.blocks if b.kind == Kind.INPUT]
            listed = f"the inputs are {', '.join(names)}" if names else "the model has no top-level input"
            report.error("E0622", f"'{name}' is not an input of '{flat.name}'", hint=nearest(name, names) or listed)
            continue
        signal = make_signal(given, flat, name, report)
        if isinstance(signal, Function):
            signal = replace(signal, span=span)
        if isinstance(signal, Table) and orders is not None:
            signal = signal.smooth(int(orders[1, np.isin(orders[0], variables)].max(initial=0)))
        if signal is not None:
            signals |= dict.fromkeys(variables.tolist(), signal)
    return signals


def break_times(signals: Mapping[int, Signal], start: float, stop: float, most: int) -> np.ndarray:
    """Return the times at which tables jump or bend; of very many bends none, and the steps have to find them."""
    tables = {id(s): s for s in signals.values() if isinstance(s, Table)}
    if not tables:
        return np.zeros(0)
    found = []
    for table in tables.values():
        kinks = table.curve.kinks
        kinks = kinks[(kinks >= start) & (kinks <= stop)]
        found += [table.jumps, kinks if len(kinks) <= most else np.zeros(0)]
    every = distinct(np.concatenate(found))
    return every[(every >= start) & (every <= stop)]


def make_signal(given: object, flat: FlatDAE, name: str, report: Report) -> Signal | None:
    """A signal from what a caller may give; None with an error in the report where it cannot be understood."""
    if isinstance(given, Constant | Formula | Table | Function):
        return given
    if isinstance(given, Expr):
        return Formula(given)
    if isinstance(given, bool | int | float | np.number) or (isinstance(given, np.ndarray) and given.shape == ()):
        if np.isfinite(float(given)):
            return Constant(float(given))
        report.error("E0521", f"the signal for input '{name}' is not finite", expected="a number", found=f"{given}")
        return None
    from lmoc.numerics.signals.table_files import is_file, read_table, table_of_frame

    if isinstance(given, str) and not is_file(given):
        from lmoc.numerics.signals.signal_text import formula_from_text

        made = formula_from_text(given, flat, name, report)
        return None if made is None else Formula(*made)
    unit = flat.block_at(int(flat.find(name)[0])).unit
    if isinstance(given, str | Path):
        points = read_table(Path(given), name, unit, report)
        return None if points is None else checked_table(points, name, report)
    if any(isinstance(column, str) for column in getattr(given, "columns", ())):  # a data frame
        points = table_of_frame(given, name, unit, report)
        return None if points is None else checked_table(points, name, report)
    if callable(given):
        return Function(given, name)
    try:
        array = np.asarray(given, float)
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.ndim == 2 and 2 in array.shape:
        points = array.T if array.shape[1] == 2 and not (isinstance(given, tuple) and len(given) == 2) else array
        return checked_table(Points(points[0], points[1]), name, report)
    report.error(
        "E0521",
        f"the signal for input '{name}' is not understood",
        expected="a number, a formula in time, a callable, a table (times, values), or the name of a CSV file",
        found=f"{type(given).__name__} {given!r:.60}",
    )
    return None


def note_held_ends(signals: Mapping[int, Signal], flat: FlatDAE, times: np.ndarray, report: Report) -> None:
    """Warn where a run goes beyond the points of a table."""
    for variable, signal in signals.items():
        if isinstance(signal, Table):
            first, last = float(signal.times[0]), float(signal.times[-1])
            if times[0] < first or times[-1] > last:
                report.warning(
                    "W0525",
                    f"the table for input '{flat.variable_name(variable)}' covers {first:g} … {last:g} s of a run over "
                    f"{times[0]:g} … {times[-1]:g} s: it is extrapolated with its end values",
                )
