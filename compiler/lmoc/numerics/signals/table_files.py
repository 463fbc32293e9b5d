"""Tables of points in time from files and data frames: which columns, in which units, every mistake where it stands.

Nothing is guessed about a number: what could be read in two ways is an error.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Any

import numpy as np

from lmoc.expression.units import SECOND, Unit, UnitError, parse_unit
from lmoc.messages.diagnostics import Report, nearest
from lmoc.messages.source import Source, Span
from lmoc.numerics.signals import decimal_marks
from lmoc.numerics.signals.delimited import NotText, Sheet, content, decoded, sheet
from lmoc.numerics.signals.tables import Points
from lmoc.support.records import dataclass

ENDINGS = (".csv", ".tsv", ".txt", ".dat")
_OF_PROGRAMS = (".xlsx", ".xls", ".xlsm", ".ods", ".numbers", ".mat", ".npz", ".npy", ".parquet")
_UNIT = re.compile(r"\s*(?:\[(.*)\]|\((.*)\)|/\s*(.*)|\bin (.*))", re.DOTALL)  # behind a name: u [mm], u/mm, u in mm
_WRITTEN = str.maketrans("\u00b2\u00b3\u00b5\u03bc\u00b7\u22c5*", "23uu...")
_ALSO = {"\u00b0": "deg", "-": "1", "\u00b0/s": "deg/s"}
_OFFSET = ("degC", "degF")  # scales with a zero of their own
_MOST = 3  # mistakes that are told


def is_file(given: str) -> bool:
    """Return whether a text names a file rather than a formula."""
    return given.lower().endswith(ENDINGS + _OF_PROGRAMS)


@dataclass(frozen=True)
class _Column:
    """A column that is needed: where it is, and the unit that is told for it."""

    place: int
    unit: str = ""


class _Refused(Exception):
    """What is wrong is in the report."""


@dataclass(frozen=True)
class _Reader:
    """What all messages about one table need.

    Attributes
    ----------
    title : of the table
    name : of the input
    unit : of the input, as declared; empty where it has none
    named : whether the column must have the name; else the only one beside ``time`` is meant, too
    said : what is wrong at which place: that of several columns is said once
    """

    title: str
    name: str
    unit: str
    report: Report
    named: bool = False
    said: set[tuple[Span, str, str]] = field(default_factory=set)

    def refuse(self, problem: str, span: Span | None = None, **more: str) -> _Refused:
        """Put a mistake into the report; returns what to raise."""
        if span is not None:
            own = span, problem, more.get("expected", "")
            if own in self.said:
                return _Refused()
            self.said.add(own)
        message = f"{self.title} for input '{self.name}' cannot be used"
        self.report.error("E0625", f"{message}: {problem}" if problem else message, span, **more)
        return _Refused()


def read_table(path: Path, name: str, unit: str, report: Report) -> Points | None:
    """Return two columns of a file, ``time`` and one named as the input (or the only other one).

    Parameters
    ----------
    unit : of the input; a column with another one of the same dimension is converted

    Returns
    -------
    None where that is not possible, with errors in the report: E0610 no such file, E0624 a file of another program,
    E0625 for what is wrong in it.
    """
    return _read(path, {name: unit}, report, named=False).get(name)


def read_tables(path: Path, units: Mapping[str, str], report: Report) -> dict[str, Points]:
    """Return what `read_table` does for several names, which the columns must have, with their units."""
    return _read(path, units, report, named=True)


def _read(path: Path, units: Mapping[str, str], report: Report, named: bool) -> dict[str, Points]:
    found: dict[str, Points] = {}
    table: Sheet | None = None
    said: set[tuple[Span, str, str]] = set()
    for name, unit in units.items():
        reader = _Reader(f"the table {path}", name, unit, report, named, said)
        try:
            if table is None:
                table = sheet(Source(str(path), _text(reader, path)))
            found[name] = _points(reader, table)
        except _Refused:
            continue
    return found


def table_of_frame(frame: Any, name: str, unit: str, report: Report) -> Points | None:
    """Return two columns of a pandas data frame by their names, as those of a file. Errors as `read_table`."""
    reader = _Reader("the data frame", name, unit, report)
    header = [str(column) for column in frame.columns]
    try:
        columns = _columns(reader, header, None)
        factors = [_factor(reader, None, c.unit, k) for k, c in enumerate(columns)]
        numbers = [np.asarray(frame.iloc[:, c.place], float) for c in columns]
    except _Refused:
        return None
    except (TypeError, ValueError) as error:
        reader.refuse(str(error))
        return None
    return Points(factors[0] * numbers[0], factors[1] * numbers[1], title=reader.title)


def _text(reader: _Reader, path: Path) -> str:
    if path.suffix.lower() in _OF_PROGRAMS:
        hint = "save the sheet as CSV" if path.suffix.lower() not in (".mat", ".npz", ".npy", ".parquet") else ""
        message = f"the table for input '{reader.name}' cannot be read from '{path}'"
        reader.report.error("E0624", message, expected=", ".join(ENDINGS), found=f"'{path.suffix}'", hint=hint)
        raise _Refused
    try:
        return decoded(path.read_bytes())
    except (OSError, NotText) as error:
        others = path.parent.iterdir() if path.parent.is_dir() and not path.exists() else ()
        hint = nearest(path.name, (p.name for p in others))
        reason = getattr(error, "strerror", None) or str(error)
        message = f"the table for input '{reader.name}' cannot be read: {path} ({reason})"
        reader.report.error("E0610", message, hint=hint)
        raise _Refused from None


def _points(reader: _Reader, table: Sheet | None) -> Points:
    if table is None:
        raise reader.refuse("", expected=_expected(reader), found="an empty file")
    columns = _columns(reader, [content(c) for c in table.header], table.header[0].to(table.header[-1]))
    rows = table.rows
    if rows and (units := _units_below(rows[0], table.header, columns)):
        columns, rows = units, rows[1:]
    wrong = 0
    for row in rows:
        wrong += not _is_whole(reader, table, row)
        if wrong == _MOST:
            break
    if wrong:
        raise _Refused
    cells = [[row[c.place] for row in rows] for c in columns]
    times, values = _numbers(reader, table, rows, cells)
    factors = [_factor(reader, table.header[c.place], c.unit, k) for k, c in enumerate(columns)]
    places = dict(zip(("time", "value"), cells))
    return Points(factors[0] * times, factors[1] * values, lambda row, of: places[of][row], reader.title)


# ---------------------------------------------------------------- columns and units


def _columns(reader: _Reader, header: list[str], span: Span | None) -> list[_Column]:
    """The columns of time and of the input."""
    time, value = _find("time", header), _find(reader.name, header)
    if len(time) == 1 and not value and not reader.named:
        value = [_Column(k, _of_any(h)) for k, h in enumerate(header) if k != time[0].place and h]
    if len(time) == len(value) == 1:
        return [time[0], value[0]]
    twice = next((n for n, of in (("time", time), (reader.name, value)) if len(of) > 1 and _find(n, header)), "")
    one = "columns are separated by commas, semicolons or tabs" if len(header) == 1 else ""
    missing = [n for n, of in (("time", time), (reader.name, value)) if not of]
    hint = f"'{twice}' occurs twice" if twice else one
    expected = "a header line with a column 'time'" if missing == ["time"] else _expected(reader)
    raise reader.refuse("", span, expected=expected, found=", ".join(header), hint=hint)


def _expected(reader: _Reader) -> str:
    return f"a header line with columns 'time' and '{reader.name}'"


def _find(name: str, header: Sequence[str]) -> list[_Column]:
    """The columns of a name: written as it is, or with a unit behind it; of time also with a capital."""
    exact = [_Column(k) for k, h in enumerate(header) if h == name]
    if exact:
        return exact
    for same in (str, str.lower) if name == "time" else (str,):
        found = []
        for k, h in enumerate(header):
            if same(h[: len(name)]) == same(name):
                unit = _UNIT.fullmatch(h[len(name) :])
                if unit or len(h) == len(name):
                    found.append(_Column(k, _unit_behind(h[len(name) :])))
        if found:
            return found
    return []


def _of_any(text: str) -> str:
    """The unit of a column of any name; one that is called `m/s` is so by its unit."""
    return text if "/" in text and _unit(text) is not None else _unit_behind(text, r".*?")


def _unit_behind(text: str, name: str = "") -> str:
    """The unit at the end of a header, behind a name or any one (with `name` a pattern); empty where there is none."""
    unit = re.fullmatch(name + _UNIT.pattern, text, re.DOTALL)
    return next((u.strip() for u in unit.groups() if u), "") if unit else ""


def _units_below(row: list[Span], header: list[Span], columns: Sequence[_Column]) -> list[_Column]:
    """The columns with the units that stand in the line below their names; empty where none stand there."""
    if len(row) != len(header):
        return []
    units = [content(row[c.place]).strip("[]()") for c in columns]
    time = any(c.isalpha() for c in units[0])  # for 1 is a unit, too
    if not time or any(_unit(u) is None or c.unit not in ("", u) for u, c in zip(units, columns) if u):
        return []
    return [_Column(c.place, u or c.unit) for c, u in zip(columns, units)]


def _unit(text: str) -> Unit | None:
    """A unit as a person writes it; None where it means nothing."""
    text = "".join(text.translate(_WRITTEN).split())
    try:
        return parse_unit(_ALSO.get(text, text))
    except (UnitError, ZeroDivisionError, OverflowError):
        return None


def _factor(reader: _Reader, cell: Span | None, text: str, column: int) -> float:
    """By what the numbers of a column are multiplied: time becomes seconds, the input its own unit, else SI."""
    if not text:
        return 1.0
    unit = _unit(text)
    declared = SECOND if column == 0 else _unit(reader.unit) if reader.unit else None
    own = "s" if column == 0 else reader.unit
    if unit is None:
        raise reader.refuse(f"'{text}' is not a unit", cell, expected=f"{own or 'a unit'}, as in 'u [{own or 'm'}]'")
    if text != own and (text in _OFFSET or own in _OFFSET):
        raise reader.refuse(f"its unit {text} has a zero of its own", cell, expected=own)
    if declared is None:
        return _converted(reader, text, "SI units", unit.factor)
    if unit.exponents != declared.exponents:
        raise reader.refuse(f"its unit {text} does not measure what {own} does", cell, expected=own, found=text)
    return _converted(reader, text, own, unit.factor / declared.factor)


def _converted(reader: _Reader, text: str, own: str, factor: float) -> float:
    """The factor, with a note where it changes anything."""
    if abs(factor - 1) < 1e-12:
        return 1.0
    reader.report.note("N0527", f"{reader.title} for input '{reader.name}' is converted from {text} to {own}")
    return factor


# ---------------------------------------------------------------- lines and numbers


def _is_whole(reader: _Reader, table: Sheet, row: list[Span]) -> bool:
    """Return whether a line has as many cells as the header, and no separator that the header does not have."""
    stray = table.stray_separator(row)
    if stray:
        message = f"this line has {stray}, the header separates its columns by {table.separated_by}"
        reader.refuse(message, row[0].to(row[-1]))
        return False
    if len(row) == len(table.header):
        return True
    counted = f"{len(row)} column{'s' * (len(row) > 1)}, the header has {len(table.header)}"
    comma = table.separator == "," and len(row) == 2 * len(table.header)
    hint = "with decimal commas, columns are separated by semicolons" if comma else ""
    reader.refuse(f"this line has {counted}", row[0].to(row[-1]), hint=hint)
    return False


def _numbers(reader: _Reader, table: Sheet, rows: list[list[Span]], cells: list[list[Span]]) -> list[np.ndarray]:
    """The numbers of the two columns, read with the marks that all of them have."""
    texts = [[content(cell) for cell in column] for column in cells]
    beside = (content(cell) for row in rows for cell in row)
    try:
        unproven = "." if table.separator in ", " else ""
        marks = decimal_marks.marks_of(texts[0] + texts[1], beside, unproven)
    except decimal_marks.Ambiguous as error:
        span = (cells[0] + cells[1])[error.place]
        raise reader.refuse(str(error), span, hint=error.hint) from None
    found: list[list[float]] = [[], []]
    wrong: dict[int, int] = {}  # row: the column of its first mistake
    for k, column in enumerate(texts):
        for row, text in enumerate(column):
            try:
                found[k].append(decimal_marks.number(text, marks))
            except ValueError:
                wrong.setdefault(row, k)
    for row, k in sorted(wrong.items())[:_MOST]:
        text = texts[k][row]
        shown = f"'{text}'" if text else "an empty cell"
        reader.refuse(f"{shown} is not a number", cells[k][row])
    if wrong:
        raise _Refused
    return [np.array(column, float) for column in found]
