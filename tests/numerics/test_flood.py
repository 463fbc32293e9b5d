"""Runs with so many events that their end is far are told while they go on."""

import logging

import pytest

import lmoc
from lmoc.messages.diagnostics import Report
from lmoc.numerics.failures import flood, pace
from lmoc.numerics.observe.event import Event


def counted(times, end):
    """Return what is said when events come at some times in a run until `end`."""
    report, records = Report(), []
    made = flood.Flood(end, {"x > 1": None}, report, None)
    for t in times:
        records.append(Event(t, "M", "when", "", "x > 1"))
        made.count(t, records)
    return [d.message for d in report.diagnostics]


def test_the_events_ahead_are_estimated_once():
    (message,) = counted([1e-3 * k for k in range(20_000)], 100.0)
    assert message.startswith("2000 events until t = 1.999 s") and "'x > 1'" in message
    assert "about 1e+05 are still ahead until 100 s" in message  # 98 000


def test_a_run_that_is_half_over_or_calms_down_is_none():
    assert counted([1e-3 * k for k in range(8000)], 8.0) == []
    assert counted([8.0 - 8 * 0.99**k for k in range(1200)] + [8 + 0.1 * k for k in range(3000)], 300.0) == []


def test_a_burst_after_a_calm_beginning_is_one():
    assert len(counted([*range(4000), *(4000 + 1e-6 * k for k in range(4000))], 5000.0)) == 1


def test_events_at_one_instant_have_no_rate():
    assert "about inf" in counted([1.0] * 4000, 2.0)[0]


@pytest.mark.parametrize(
    ("equation", "line"),
    [
        ("when sample(0, 1e-9) then n = pre(n) + 1; end when;", 3),
        ("n = integer(time/1e-9);", 1),
        ("n = 1; y = mod(time, 1e-9);", 3),
    ],
)
def test_a_run_says_so_when_it_is_still_on_its_way(equation, line, monkeypatch, caplog):
    monkeypatch.setattr(flood, "_MANY", 20)
    declared = "Integer n(start = 0);\nReal x(start = 0, fixed = true)" + (", y;" if "y =" in equation else ";")
    text = f"model M {declared} equation der(x) = 1e7;\n{equation}\nend M;"
    reached = []

    def progress(t, stop):
        reached.append((t, stop))

    monkeypatch.setattr(flood, "_EVERY", -1.0)
    with caplog.at_level(logging.WARNING, "lmoc"):
        run = lmoc.compile_text(text).simulate(stop=2e-7, progress=progress)
    found = [d for d in run.notes if d.code == "W0556"]
    assert len(found) == len(caplog.records) == 1 and found[0].span.line == line
    assert "about 2e+02 are still ahead until 2e-07 s" in found[0].message  # 180
    assert len(reached) == 200 and {stop for _, stop in reached} == {2e-7}


def test_a_slow_run_says_how_long_it_takes(monkeypatch, caplog):
    """By the pace so far; a run that is nearly over says nothing."""
    spent = [0.0]
    monkeypatch.setattr(pace.clock, "thread_time", lambda: spent[0])

    def said(steps):
        caplog.clear()
        spent[0] = 0.0
        made = pace.Pace(1.0, 3.0)
        with caplog.at_level(logging.WARNING, "lmoc"):
            for spent[0], t in steps:
                made.reached(t)
        return [r.getMessage() for r in caplog.records]

    (text,) = said([(1.0, 1.01), (6.0, 1.02), (20.0, 1.1), (50.0, 1.2)])
    assert "W0563" in text and "t = 1.02 s in 6 s of work" in text and "about 10 min more until 3 s" in text
    assert said([(6.0, 2.5), (20.0, 2.9)]) == []
    assert said([(6.0, 1.0)]) == []
    assert "3.3 h more" in said([(6.0, 1.001)])[0]
