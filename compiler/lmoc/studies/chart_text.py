"""A chart as text and as files."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.report.files import check_target
from lmoc.studies.findings import Findings, seconds_text
from lmoc.studies.points import Point
from lmoc.support.replacing import replace_file

FORMATS = (".csv", ".json")
_MOST_FAILURES = 12  # lines about runs that gave no result


def table(chart: Findings) -> str:
    """Return the time that each method needs for so many digits, its failures, and one recommendation."""
    lines = [f"{chart.name}: speed against accuracy", f"  reference: {chart.reference.text}"]
    if chart.note:
        lines.append(f"  {chart.note}")
    if chart.whole is not None and chart.whole.tried:
        tried = (f"{p.setting.text}: error {p.error:.0e}, {seconds_text(p.seconds)}" for p in chart.whole.tried)
        lines.append(f"  of the whole run {'; '.join(tried)}")
    if chart.reference.uncertainty > 1e-6:
        lines.append("  the reference itself has fewer than 6 digits: do not trust smaller errors")
    lines += ["", *_times(chart), "", *_failures(chart), chart.recommendation]
    if chart.interrupted:
        lines.append("interrupted: some methods and repeats are missing")
    return "\n".join(lines)


def _times(chart: Findings) -> list[str]:
    """Rows of methods, columns of digits: the shortest time; and the best error, the worst energy balance."""
    good = [p for p in chart.points if p.ok]
    best = min((p.error for p in good), default=1.0)
    most = min(12, max(3, math.floor(-math.log10(max(best, chart.reference.uncertainty, 1e-12)))))
    digits = range(3, most + 1, 1 if most < 9 else 2)
    rows = [["method", *(f"{d} digits" for d in digits), "best error", "at", "energy"]]
    for name, points in by_method(chart.points).items():
        own = [p for p in points if p.ok]
        if not own:
            continue
        cells = [_shortest(own, 10.0**-d) for d in digits]
        finest = min(own, key=lambda p: p.error)
        balance = "–" if math.isnan(finest.energy) else f"{finest.energy:.0e}"
        at = finest.setting.text.split(" at ")[1]
        rows.append([name, *(seconds_text(t) for t in cells), f"{finest.error:.0e}", at, balance])
    return _aligned(rows)


def _shortest(points: Sequence[Point], error: float) -> float:
    return min((p.seconds for p in points if p.error <= error), default=math.nan)


def by_method(points: Sequence[Point]) -> dict[str, list[Point]]:
    """Return the points by solver and formulation, in their order."""
    found: dict[str, list[Point]] = {}
    for point in points:
        setting = point.setting
        name = setting.solver if setting.formulation == "reduced" else f"{setting.solver} ({setting.formulation})"
        found.setdefault(name, []).append(point)
    return found


def _failures(chart: Findings) -> list[str]:
    """Lines about what gave no result: one a method and reason, with the settings it concerns."""
    reasons: dict[tuple[str, str], list[Point]] = {}
    for name, points in by_method(chart.points).items():
        for p in points:
            if not p.ok:
                reasons.setdefault((name, p.status), []).append(p)
    lines = []
    for (name, reason), points in reasons.items():
        settings = [p.setting.text.split(" at ")[1] for p in points]
        where = settings[0] if len(settings) == 1 else f"{settings[0]} … {settings[-1]}"
        lines.append(f"{name} at {where}: {reason}")
    hidden = len(lines) - _MOST_FAILURES
    shown = lines if hidden <= 0 else [*lines[:_MOST_FAILURES], f"and {hidden} more, in the file written by -o"]
    return [*shown, ""] if shown else []


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return [
        "  " + "  ".join(c.ljust(w) if k == 0 else c.rjust(w) for k, (c, w) in enumerate(zip(row, widths, strict=True)))
        for row in rows
    ]


def as_data(chart: Findings) -> dict[str, object]:
    """Return the chart as plain data for JSON; what is not finite becomes None."""
    from lmoc.report.summary import plain

    reference = chart.reference
    return plain(
        {
            "model": chart.name,
            "reference": {"methods": reference.methods, "uncertainty": reference.uncertainty},
            "note": chart.note,
            "signals": reference.signals.names,
            "recommendation": chart.recommendation,
            "points": chart.records(),
        }
    )


def save(chart: Findings, path: Path) -> Path:
    """Write the points; errors as `Chart.save`."""
    check_target(path, FORMATS)

    def write(target: Path) -> None:
        if path.suffix.lower() == ".csv":
            chart.to_dataframe().to_csv(target, index=False)
        else:
            target.write_text(json.dumps(as_data(chart), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")

    try:
        replace_file(path, write)
    except OSError as error:
        message = f"'{path}' cannot be written: {error.strerror or error}"
        raise ModelError([Diagnostic("E0623", message)]) from None
    return path
