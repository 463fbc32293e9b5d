"""Tables of points in time as signals, from arrays or CSV files."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from lmoc.messages.diagnostics import Report, nearest
from lmoc.messages.source import Source, Span
from lmoc.numerics.signals import curves
from lmoc.support.numbers import parsed_number
from lmoc.support.records import dataclass

_CELL = re.compile(r'\s*("(?:[^"]|"")*"|[^,]*?)\s*(,|$)')  # RFC 4180, within one line


@dataclass(frozen=True, eq=False)
class Table:
    """Points in time joined by a curve that stays between neighbouring points.

    Attributes
    ----------
    times, values : (n,); a time that occurs twice is a jump
    curve : Curve, as smooth as the equations need it
    """

    times: np.ndarray
    values: np.ndarray
    curve: curves.Curve

    @property
    def jumps(self) -> np.ndarray:
        """Times at which the values jump."""
        return self.curve.jumps

    def gives(self, order: int) -> bool:
        """Return whether the curve has a derivative of that order: where the values jump, the first is an impulse."""
        return order <= (1 if len(self.jumps) else curves.SMOOTHEST)

    def smooth(self, order: int) -> Table:
        """Return the points joined by a curve with that many continuous derivatives, at most two."""
        return make_table(self.times, self.values, min(order, curves.SMOOTHEST))

    def value(self, t: float, order: int) -> float:
        return self.curve.at(t, order)


def make_table(times: np.ndarray, values: np.ndarray, smoothness: int = 0) -> Table:
    """Return a table of points that are known to be in order."""
    return Table(times, values, curves.fit(times, values, smoothness))


@dataclass(frozen=True)
class Points:
    """Points as they were given, and where each number stands if they come from a file."""

    times: np.ndarray
    values: np.ndarray
    place: Callable[[int, str], Span | None] = lambda row, column: None  # noqa: E731
    title: str = "the table"


def checked_table(points: Points, name: str, report: Report) -> Table | None:
    """Return the points as a table; None, with errors in the report (E0625), where they are none.

    Parameters
    ----------
    name : of the input, for messages
    """
    times, values = points.times, points.values
    message = f"{points.title} for input '{name}' cannot be used"

    def refuse(problem: str, row: int | None = None, column: str = "time", hint: str = "") -> None:
        report.error("E0625", f"{message}: {problem}", None if row is None else points.place(row, column), hint=hint)

    for column, numbers in (("time", times), ("value", values)):
        for row in np.flatnonzero(~np.isfinite(numbers))[:1].tolist():
            refuse(f"{numbers[row]} is not a finite number", row, column)
            return None
    if len(times) < 2:
        refuse(f"it has {'one point' if len(times) else 'no points'}, and needs two")
        return None
    steps = np.diff(times)
    for row in (np.flatnonzero(steps < 0) + 1)[:1].tolist():
        hint = "a time that occurs twice is a jump; otherwise times increase"
        refuse(f"its times decrease: {times[row]:g} follows {times[row - 1]:g}", row, hint=hint)
        return None
    for row in (np.flatnonzero((steps[1:] == 0) & (steps[:-1] == 0)) + 2)[:1].tolist():
        hint = "two lines with one time are a jump, from the value of the first to that of the second"
        refuse(f"the time {times[row]:g} occurs more than twice", row, hint=hint)
        return None
    finest = curves.fit(times, values, curves.SMOOTHEST)
    for row in np.flatnonzero(~np.isfinite(finest.coefficients).all(axis=0))[:1].tolist():
        refuse("its times are too close together, or its values too large", row)
        return None
    return make_table(times, values)


def read_csv(path: Path, name: str, report: Report) -> Points | None:
    """Return two columns of a CSV file, ``time`` and one named as the input (or the only other one).

    None where that is not possible, with errors in the report: E0610 no such file, E0625 for what is wrong in it.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")  # spreadsheets write a byte order mark
    except (OSError, UnicodeDecodeError) as error:
        others = path.parent.iterdir() if path.parent.is_dir() and not path.exists() else ()
        hint = nearest(path.name, (p.name for p in others))
        reason = getattr(error, "strerror", None) or "it is not text in UTF-8"
        report.error("E0610", f"the table for input '{name}' cannot be read: {path} ({reason})", hint=hint)
        return None
    title, lines = f"the table {path}", _lines(Source(str(path), text))
    header = [_content(cell) for cell in lines[0]] if lines else []
    values = [h for h in header if h != "time"]
    column = name if name in header else values[0] if len(values) == 1 else ""
    twice = next((h for h in ("time", column) if header.count(h) > 1), None)
    if "time" not in header or not column or twice:
        report.error(
            "E0625",
            f"{title} for input '{name}' cannot be used",
            lines[0][0].to(lines[0][-1]) if lines else None,
            expected=f"a header line with columns 'time' and '{name}'",
            found=", ".join(header) or "an empty file",
            hint="columns are separated by commas" if len(header) == 1 else f"'{twice}' occurs twice" if twice else "",
        )
        return None
    places = {"time": header.index("time"), "value": header.index(column)}
    needed = tuple(places.values())
    if not all([_is_row(cells, len(header), needed, title, name, report) for cells in lines[1:]]):
        return None
    cells = {of: [row[k] for row in lines[1:]] for of, k in places.items()}
    times, numbers = (np.array([parsed_number(_content(c)) for c in of]) for of in cells.values())
    return Points(times, numbers, lambda row, of: cells[of][row], title)


def _lines(source: Source) -> list[list[Span]]:
    """The cells of all lines that are not empty."""
    found, begin = [], 0
    for line in source.text.splitlines(keepends=True):
        text = line.rstrip("\r\n")
        if text.strip():
            found.append([Span(source, begin + m.start(1), begin + m.end(1)) for m in _cells(text)])
        begin += len(line)
    return found


def _cells(line: str) -> list[re.Match]:
    """The cells of one line; the empty match behind the last one is none."""
    found = []
    for match in _CELL.finditer(line):
        found.append(match)
        if not match[2]:
            break
    return found


def _content(cell: Span) -> str:
    """The text of a cell without the quotation marks around it."""
    text = cell.text
    quoted = len(text) > 1 and text[0] == text[-1] == '"'
    return text[1:-1].replace('""', '"').strip() if quoted else text


def _is_row(cells: list[Span], width: int, needed: tuple[int, ...], title: str, name: str, report: Report) -> bool:
    """Return whether a line has as many cells as the header, numbers where needed; report the first few mistakes."""
    if len(report.errors) >= 3:
        return False
    message = f"{title} for input '{name}' cannot be used"
    if len(cells) != width:
        counted = f"{len(cells)} column{'s' * (len(cells) > 1)}, the header has {width}"
        report.error("E0625", f"{message}: this line has {counted}", cells[0].to(cells[-1]))
        return False
    for cell in (cells[k] for k in sorted(needed)):
        try:
            parsed_number(_content(cell))
        except ValueError:
            text = _content(cell)
            shown = f"'{text}'" if text else "an empty cell"
            hint = "numbers have a point, columns are separated by commas" if ";" in text else ""
            report.error("E0625", f"{message}: {shown} is not a number", cell, hint=hint)
            return False
    return True
