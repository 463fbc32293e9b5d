"""The events of a run in the summary, in JSON and in plots."""

import json

import pytest

import lmoc
from lmoc.numerics.observe.event import Event
from lmoc.report.events import events_text

BALL = """model Ball Real h(start = 1, fixed = true), v(start = 0, fixed = true); equation der(h) = v; der(v) = -9.81;
  when h <= 0 then reinit(v, -pre(v)); end when; annotation(experiment(StopTime = 2)); end Ball;"""


def test_the_line_of_the_summary() -> None:
    events = [Event(1, "c", "taut"), Event(2, "c", "slack"), Event(3, "c", "taut", energy_lost=1.5)]
    assert events_text(events) == "3 events: taut 2, slack 1; lost 1.5 J"
    assert events_text(events[:1]) == "1 event: taut 1" and events_text([]) == ""


def test_the_summary_and_json(lmoc, tmp_path) -> None:
    path = tmp_path / "ball.lmo"
    path.write_text(BALL)
    assert "events    2 events: when 2" in lmoc("run", str(path)).out
    data = json.loads(lmoc("run", str(path), "--json", "--rtol", "1e-10").out)
    assert [e["kind"] for e in data["events"]] == ["when", "when"]
    assert [e["time"] for e in data["events"]] == pytest.approx([0.4515236409857309, 3 * 0.4515236409857309], abs=1e-9)


def test_marks_in_a_plot() -> None:
    figure = lmoc.compile_text(BALL).simulate().plot("h")
    upright = [line for axis in figure.axes for line in axis.lines if len(set(line.get_xdata())) == 1]
    assert len(upright) == 2
