"""The events of a run as text, as data, and as marks in pictures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from lmoc.numerics.observe.event import Event

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_MARKS = 300


def events_text(events: Sequence[Event]) -> str:
    """Return ``7 events: slack 3, taut 3, impact 1; lost 3.27 J``; empty without events."""
    if not events:
        return ""
    kinds = Counter(e.kind for e in events)
    text = f"{len(events)} event{'s' * (len(events) != 1)}: " + ", ".join(f"{k} {n}" for k, n in kinds.most_common())
    lost = sum(e.energy_lost for e in events)
    return text + (f"; lost {lost:.4g} J" if lost else "")


def events_data(events: Sequence[Event]) -> list[dict[str, Any]]:
    """Return the events as plain data, in their order."""
    return [asdict(e) for e in events]


def event_rows(events: Sequence[Event]) -> list[list[str]]:
    """Return a table of events with a head: when, to what, what, between which modes, impulse and energy lost."""
    rows = [["t in s", "name", "event", "before", "after", "impulse", "lost in J"]]
    for e in events:
        numbers = [f"{v:.6g}" if v else "" for v in (e.impulse, e.energy_lost)]
        rows.append([f"{e.time:.9g}", e.name, e.kind, e.before, e.after, *numbers])
    return rows


def modes_rows(modes: Sequence[tuple[float, Mapping[str, str]]]) -> list[list[str]]:
    """Return a table of the modes of laws over time: a head with the names of the laws, then a row for each change.

    Where a law keeps its mode the cell is empty.
    """
    if not modes or not modes[0][1]:
        return []
    names = list(modes[0][1])
    rows, last = [["t in s", *names]], dict.fromkeys(names, "")
    for time, words in modes:
        rows.append([f"{time:.9g}", *("" if words[n] == last[n] else words[n] for n in names)])
        last = dict(words)
    return rows


def modes_data(modes: Sequence[tuple[float, Mapping[str, str]]]) -> list[dict[str, Any]]:
    """Return the modes of laws over time as plain data; empty without laws."""
    return [{"time": time, "laws": dict(words)} for time, words in modes if words]


def mark_events(axis: Axes, events: Sequence[Event]) -> None:
    """Draw faint lines at the instants of events, where they are few enough to be told apart."""
    times = sorted({e.time for e in events})
    if len(times) <= _MOST_MARKS:
        for time in times:
            axis.axvline(time, color="#999999", linewidth=0.6, linestyle=":", zorder=0.4)
