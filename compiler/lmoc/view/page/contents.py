"""The data of a page: a run and its picture as plain lists, numbers and texts, small whatever the scene is.

A page holds a limited number of values. Of a longer run fewer output times are shown, of a larger scene fewer
variables; `missing` says so.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from lmoc.ir.flat import Kind
from lmoc.messages.diagnostics import ModelError
from lmoc.report.events import events_data
from lmoc.report.plots import choose
from lmoc.report.result import Result
from lmoc.report.summary import energy_text
from lmoc.support.distinct import distinct
from lmoc.support.records import dataclass
from lmoc.view.javascript.script import Script
from lmoc.view.page.equations import page_equations
from lmoc.view.page.modes import modes_data
from lmoc.view.page.parts import parts_data
from lmoc.view.page.simulation import script_data, unit_shown, write_run
from lmoc.view.page.terms import jets_data, terms_of
from lmoc.view.scene.compose import picture_of
from lmoc.view.scene.picture import Circle, Item, Label, Path, Picture

MOST_VALUES = 100_000  # numbers of 32 bits: 0.53 MB of text
LEAST_TIMES = 201  # output times that are left in any case
MOST_VARIABLES = 4000
MOST_SHOWN = 6  # variables that are plotted at first
MOST_EVENTS = 500
MOST_ITEMS = 3000  # of a picture that moves
CHECKED, CHECK_TIMES = 40, 101  # variables and times at which the page compares its own run
LOOKED_AT, TENTH_DIGIT = 100, 1e-10  # places of each piece, and a change of the states there …
NOTHING_LEFT = 1e4  # … of which this many times makes a variable that cancels


@dataclass
class Contents:
    """The contents of a page.

    Attributes
    ----------
    data : for JSON; None stands for NaN
    missing : what is not shown, and why, in sentences
    equations : HTML
    terms : their terms as functions of JavaScript, by mode, equation and side
    """

    data: dict[str, Any]
    missing: list[str]
    equations: str
    terms: str


def contents(run: Result, title: str) -> Contents:
    """Return the data of a page.

    Parameters
    ----------
    run : complete or not
    title : of the page
    """
    missing = []
    if not run.complete:
        missing.append(f"The run broke off at t = {run.broke_off:.6g} s: this is what there is until then.")
    shown = [name for name in _plain_names(run, choose(run))][:MOST_SHOWN]
    picture = drawn(run, missing)
    moving = movers(picture)
    own = write_run(run, moving)
    script = own.script
    table = _Table.of(run, [*shown, *moving], script, missing)
    equations = page_equations(run)
    terms = terms_of(equations, run, table.rows)
    energy = _energy(run, table)
    if not np.isfinite(table.values).all():
        missing.append("Some variables have no value at some times: their curves have gaps there.")
    data = {
        "title": title,
        "complete": run.complete,
        "reason": "" if run.complete else f"broke off at {run.broke_off:.6g} s",
        "time": _packed(table.time, "<f8"),
        "values": _packed(np.concatenate([table.columns, terms.values]) if len(terms.values) else table.columns, "<f4"),
        "variables": table.variables,
        "shown": shown,
        "energy": energy,
        "events": _events(run, missing),
        "modes": _modes(run),
        "unbooked": _number(run.trajectory.unbooked[0]),
        "picture": None if picture is None else picture_data(picture),
        "swinging": {"names": moving, "modes": modes_data(run, moving)},
        "check": table.check(script),
        "checkTimes": table.check_times.tolist(),
        "sizes": table.sizes(),
        "parts": parts_data(run, [] if picture is None else [item.part for item in picture.items if item.part]),
        "script": script_data(run, own),
        "jets": jets_data(terms, run, own, len(table.columns)),
        "terms": terms.modes,
    }
    return Contents(data, missing, equations.html, terms.text)


def _plain_names(run: Result, names: Sequence[str]) -> list[str]:
    """Names of single variables: arrays by their members, derivatives of states left out."""
    found = [run.flat.find(name) for name in names]
    return [run.flat.variable_name(int(v)) for own in found if own is not None for v in own[:MOST_SHOWN]]


# ---------------------------------------------------------------------- variables


@dataclass(frozen=True)
class _Table:
    """The values that a page holds."""

    run: Result
    rows: np.ndarray  # of the output times
    numbers: np.ndarray  # variables of the flat model
    values: np.ndarray  # (times, variables)
    columns: np.ndarray  # (columns, times) those that change, each once
    variables: list[dict]

    @classmethod
    def of(cls, run: Result, first: Sequence[str], script: Script | None, missing: list[str]) -> _Table:
        """Choose variables, `first` before all others, and output times."""
        numbers = _chosen(run, first, missing)
        most = max(LEAST_TIMES, MOST_VALUES // max(1, len(numbers)))
        rows = _spread(len(run.time), most, run)
        values = run.values(numbers)[rows]
        columns, place = _distinct_columns(values)
        if columns.size > MOST_VALUES:  # a large scene: those that were named, then the first ones
            kept = max(len(first), MOST_VALUES // len(rows))
            missing.append(f"{len(numbers) - kept} of {len(numbers)} variables are left out.")
            numbers, values = numbers[:kept], values[:, :kept]
            columns, place = _distinct_columns(values)
        if len(rows) < len(run.time):
            missing.append(f"{len(rows)} of {len(run.time)} output times are shown.")
        variables = [_variable(run, script, int(v), values[0, k], place[k]) for k, v in enumerate(numbers.tolist())]
        return cls(run, rows, numbers, values, columns, variables)

    @property
    def time(self) -> np.ndarray:
        return self.run.time[self.rows]

    @property
    def check_times(self) -> np.ndarray:
        return self.time[_even(len(self.rows), CHECK_TIMES)]

    def sizes(self) -> dict[str, float]:
        """Return the largest magnitude for each unit."""
        with np.errstate(all="ignore"):
            largest = np.nanmax(np.abs(self.values), axis=0, initial=0.0)
        found: dict[str, float] = {}
        for variable, size in zip(self.variables, largest.tolist(), strict=True):
            if np.isfinite(size):
                found[variable["unit"]] = max(size, found.get(variable["unit"], 0.0))
        return found

    def check(self, script: Script | None) -> list[list[str]]:
        """Return [name, values at `check_times` to the last digit] of what the page computes as well."""
        if script is None:
            return []
        moving = (self.values != self.values[0]).any(axis=0)
        computed = np.flatnonzero((script.registers[self.numbers] >= 0) & moving)[: 2 * CHECKED]
        own = computed[~_of_rounding(self.run, self.numbers[computed])][:CHECKED]
        exact = self.values[_even(len(self.rows), CHECK_TIMES)]
        names = (self.run.flat.variable_name(int(v)) for v in self.numbers[own])
        return [[name, _packed(exact[:, k], "<f8")] for name, k in zip(names, own.tolist(), strict=True)]


def _of_rounding(run: Result, numbers: np.ndarray) -> np.ndarray:
    """Return which variables are nothing but what rounding leaves of terms that cancel.

    A change in the tenth digit of the states then changes more than their fourth digit.
    """
    size, change = np.zeros(len(numbers)), np.zeros(len(numbers))
    for piece in run.trajectory.segments:
        rows = _even(len(piece.time), LOOKED_AT) if len(piece.time) else []
        if run.trajectory.kept is not None or not len(rows):
            continue
        times, states = piece.time[rows], piece.table[rows]
        aside = states * (1.0 + TENTH_DIGIT * np.cos(np.arange(states.size)).reshape(states.shape))
        with np.errstate(all="ignore"):
            here, there = (piece.observer(numbers, times, x) for x in (states, aside))
        size = np.fmax(size, np.abs(here).max(axis=0))
        change = np.fmax(change, np.abs(here - there).max(axis=0))
    return (size <= NOTHING_LEFT * change) & (change > 0)


def _chosen(run: Result, first: Sequence[str], missing: list[str]) -> np.ndarray:
    wanted = [run.flat.find(name) for name in [*first, "ledger.stored", "ledger.work", "ledger.heat"]]
    leading = np.concatenate([np.zeros(0, int), *(w for w in wanted if w is not None)])
    every = np.concatenate([leading, run.table_variables()]).astype(int)
    if run.trajectory.kept is not None:
        every = every[np.isin(every, run.trajectory.kept) | (run.flat.kind[every] < Kind.INPUT)]
    every = every[np.sort(np.unique(every, return_index=True)[1])]
    if len(every) > MOST_VARIABLES:
        missing.append(f"{len(every) - MOST_VARIABLES} of {len(every)} variables are left out.")
    return every[:MOST_VARIABLES]


def _spread(count: int, most: int, run: Result) -> np.ndarray:
    """Rows of the output times to show: all, or evenly some and those beside events."""
    if count <= most:
        return np.arange(count)
    beside = np.searchsorted(run.time, [e.time for e in run.events[:MOST_EVENTS]])
    return distinct(np.concatenate([_even(count, most), np.clip(np.concatenate([beside, beside - 1]), 0, count - 1)]))


def _even(count: int, most: int) -> np.ndarray:
    return distinct(np.linspace(0, count - 1, min(count, most)).round().astype(int))


def _distinct_columns(values: np.ndarray) -> tuple[np.ndarray, list[int]]:
    """Return columns that change as rows, each once, and which of them each variable is; -1 for what is constant."""
    found: dict[bytes, int] = {}
    columns, place = [], []
    for column in np.ascontiguousarray(values.T):
        if (column == column[0]).all() or np.isnan(column).all():
            place.append(-1)
            continue
        key = column.tobytes()
        if key not in found:
            found[key] = len(columns)
            columns.append(column)
        place.append(found[key])
    return np.array(columns).reshape(len(columns), len(values)), place


def _variable(run: Result, script: Script | None, number: int, value: float, column: int) -> dict[str, Any]:
    flat = run.flat
    name = flat.variable_name(number)
    unit = run.unit(name)
    entry: dict[str, Any] = {"name": name, "unit": unit_shown(unit)}
    if column >= 0:
        entry["column"] = column
    else:
        entry["value"] = _number(value)
    if script is not None and script.registers[number] >= 0:
        entry["register"] = int(script.registers[number])
    return entry


def _energy(run: Result, table: _Table) -> dict[str, Any] | None:
    """Return the names of the ledger's variables and of the parts', and its balance; None where there is none."""
    names = {"stored": "ledger.stored", "supplied": "ledger.work", "lost": "ledger.heat"}
    numbers = [run.flat.find(name) for name in names.values()]
    if run.energy is None or any(n is None or not np.isin(n, table.numbers).all() for n in numbers):
        return None
    if not (run.energy.stored.any() or run.energy.supplied.any() or run.energy.lost.any()):
        return None
    parts = [v["name"] for v in table.variables if v["name"].endswith(".energy") and "column" in v]
    return {**names, "parts": parts, "text": energy_text(run), "exchanged": float(np.nan_to_num(run.energy.exchanged))}


# ---------------------------------------------------------------------- events and modes


def _events(run: Result, missing: list[str]) -> list[dict[str, Any]]:
    if len(run.events) > MOST_EVENTS:
        missing.append(f"{MOST_EVENTS} of {len(run.events)} events are shown.")
    events = events_data(run.events[:MOST_EVENTS])
    return [{k: _number(v) if isinstance(v, float) else v for k, v in e.items()} for e in events]


def _modes(run: Result) -> list[list]:
    """Return [since, {law: mode}], in order."""
    return [[float(time), dict(words)] for time, words in run.modes[:MOST_EVENTS] if words]


# ---------------------------------------------------------------------- the picture


def drawn(run: Result, missing: list[str]) -> Picture | None:
    def at_start():
        return lambda name: float(run[name][0])

    try:
        picture = picture_of(run.flat, run.trajectory.observer.values, at_start, numbers=False)
    except ModelError as error:
        missing.append(f"The scene cannot be drawn: {error.diagnostics[0].message}.")
        return None
    missing += picture.notes
    if len(picture.items) > MOST_ITEMS:
        missing.append(f"The picture is left out: it has {len(picture.items)} items.")
        return None
    return picture


def movers(picture: Picture | None) -> list[str]:
    """Names of the variables that a picture asks for."""
    if picture is None:
        return []
    names = [m.variable for item in picture.items for end in item.ends for m in end.moves]
    names += [item.turn.variable for item in picture.items if item.turn.variable]
    names += [name for item in picture.items for name in item.variables.values()]
    return list(dict.fromkeys(names))


def picture_data(picture: Picture) -> dict[str, Any]:
    """Return a picture as `picture.js` reads it."""
    return {
        "width": _short(picture.width),
        "height": _short(picture.height),
        "room": dict(picture.room),
        "items": [_item(item) for item in picture.items],
    }


def _item(item: Item) -> dict[str, Any]:
    return {
        "symbol": item.symbol,
        "part": item.part,
        "ends": [{"x": _short(e.x), "y": _short(e.y), "moves": [asdict(m) for m in e.moves]} for e in item.ends],
        "turn": asdict(item.turn),
        "shapes": [_shape(shape) for shape in item.shapes],
        "variables": dict(item.variables),
    }


def _shape(shape: Path | Circle | Label) -> dict[str, Any]:
    entry = {"kind": type(shape).__name__.lower()} | asdict(shape)
    for key in ("vertices", "centre", "at"):
        if key in entry:
            value = entry[key]
            entry[key] = [_vertex(v) for v in value] if key == "vertices" else _vertex(value)
    return entry


def _vertex(vertex: Sequence[float]) -> list[float]:
    return [round(vertex[0], 5), _short(vertex[1]), _short(vertex[2])]


def _short(value: float) -> float:
    return round(float(value), 2)


# ---------------------------------------------------------------------- numbers and units


def _packed(values: np.ndarray, kind: str) -> str:
    """Numbers as base64 of their bytes."""
    with np.errstate(over="ignore"):
        return b64encode(np.ascontiguousarray(values, kind).tobytes()).decode("ascii")


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
