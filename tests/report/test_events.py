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


HANGING = """model Hanging
Fixed c; Cable s(L = 1); Mass m(m = 2, g = 9.81, q(start = 0.5, fixed = true), v(fixed = true));
equation connect(c.flange, s.a); connect(s.b, m.flange); annotation(experiment(StopTime = 1)); end Hanging;"""


def test_modes_over_time(lmoc, tmp_path) -> None:
    path = tmp_path / "hanging.lmo"
    path.write_text(HANGING)
    lines = lmoc("run", str(path), "--events").out.splitlines()
    assert lines[-3].split() == ["t", "in", "s", "s"]
    assert lines[-2].split() == ["0", "slack"] and lines[-1].split() == ["0.319275428", "taut"]
    assert any(line.split()[1:6] == ["s", "taut", "slack", "taut", "6.26418"] for line in lines)
    data = json.loads(lmoc("run", str(path), "--json").out)
    assert [m["laws"] for m in data["modes"]] == [{"s": "slack"}, {"s": "taut"}]


def test_an_assertion_names_its_part() -> None:
    run = lmoc.compile_text("""model Pull
    Mass a(m = 1), b(m = 1), c(m = 1); Rod r[2](each string = true); Force f(f = -1);
    equation connect(a.flange, r[1].a); connect(r[1].b, b.flange); connect(b.flange, r[2].a);
    connect(r[2].b, c.flange); connect(f.flange, c.flange); end Pull;""").simulate(stop=1)
    told = [n.message for n in run.notes if n.code == "W0551"]
    assert told[0].startswith("r[1]: the string would have to push")
