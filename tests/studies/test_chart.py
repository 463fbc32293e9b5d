"""Charts of speed against accuracy: their reference, their points, and what becomes of failures."""

import json
import math
import time

import numpy as np
import pytest
from conftest import ROOT
from oracles.models import STIFF, compiled

import lmoc
from lmoc.cli.chart import tolerances
from lmoc.cli.main import main
from lmoc.messages.diagnostics import ModelError, SimulationError
from lmoc.numerics.options.options import RunOptions
from lmoc.simulation import Request
from lmoc.studies import chart as chart_module
from lmoc.studies import points, reference
from lmoc.studies.chart import _QUICK_BUDGET, Chart, _quick_end
from lmoc.studies.chart_plot import spread
from lmoc.studies.deviation import Signals, deviation
from lmoc.studies.findings import COLUMNS, seconds_text
from lmoc.studies.points import Point, Setting
from lmoc.studies.reference import Reference
from lmoc.studies.residual import constraint_residual

OSCILLATOR = """model Oscillator "undamped"
  Mass m(m = 1, q(start = 0.1, fixed = true), v(start = 0, fixed = true));
  Spring s(k = 25);
  Fixed wall;
  output Real x = m.q;
equation
  connect(wall.flange, s.a); connect(s.b, m.flange);
  annotation(experiment(StopTime = 5));
end Oscillator;"""


@pytest.fixture(scope="module")
def chart() -> Chart:
    dae = lmoc.compile_text(OSCILLATOR)
    return dae.chart(["auto", "dop853", "cvode", "verlet"], rtols=[1e-4, 1e-8], quick=True)


def test_the_errors_are_those_against_the_closed_form(chart):
    dae, frame = lmoc.compile_text(OSCILLATOR), chart.to_dataframe()
    for row in frame[frame.step.isna()].itertuples():
        run = dae.simulate(solver=row.solver, rtol=row.rtol)
        exact = np.abs(run["x"] - 0.1 * np.cos(5 * run.time)).max() / 0.1
        assert row.error == pytest.approx(exact, rel=0.01, abs=10 * chart.reference.uncertainty + 1e-11)
    assert chart.reference.uncertainty < 1e-10
    assert chart.reference.signals.names == ("x",)


def test_the_columns_and_what_stands_in_them(chart):
    frame = chart.to_dataframe()
    assert list(frame.columns)[:10] == [
        "solver", "formulation", "rtol", "error", "seconds", "evaluations", "residual", "energy", "status", "note",
    ]  # fmt: skip
    assert (frame.status == "ok").all() and (frame.seconds > 0).all() and (frame.evaluations > 0).all()
    assert set(frame.solver) == {"auto", "dop853", "cvode", "verlet"} and set(frame.formulation) == {"reduced"}
    assert frame[frame.solver == "auto"].note.isin(["dop853", "taylor"]).all()
    fixed = frame[frame.solver == "verlet"]
    assert fixed.rtol.isna().all() and len(fixed) >= 3
    order = np.log(fixed.error.iloc[-2] / fixed.error.iloc[-1]) / np.log(fixed.step.iloc[-2] / fixed.step.iloc[-1])
    assert order == pytest.approx(2, abs=0.1)
    assert (frame.residual < 1e-12).all() and (frame[frame.rtol == 1e-8].energy < 1e-5).all()


def test_the_recommendation_is_the_fastest_point_with_the_digits(chart):
    best = chart.recommended(6)
    enough = [p for p in chart.points if p.ok and p.error <= 1e-6]
    assert best in enough and best.seconds == min(p.seconds for p in enough)
    assert chart.recommendation.startswith(f"for 6 digits: {best.setting.text}, ")
    assert chart.recommended(15) is None
    assert chart.recommendation in str(chart)


def test_files_and_picture(chart, tmp_path):
    import pandas

    chart.save(tmp_path / "c.csv")
    table = pandas.read_csv(tmp_path / "c.csv")
    assert list(table.columns) == list(COLUMNS) and len(table) == len(chart.points)
    chart.save(tmp_path / "c.json")
    data = json.loads((tmp_path / "c.json").read_text())
    assert len(data["points"]) == len(chart.points) and data["reference"]["uncertainty"] < 1e-10
    for ending in ("png", "svg"):
        chart.plot(tmp_path / f"c.{ending}")
        assert (tmp_path / f"c.{ending}").stat().st_size > 10_000
    text = (tmp_path / "c.svg").read_text()
    assert all(f">{name}<" in text for name in ("dop853", "cvode", "verlet"))
    with pytest.raises(ModelError, match="the format of .* is not known"):
        chart.save(tmp_path / "c.xlsx")


def test_failures_are_points_with_their_reason(tmp_path):
    text = OSCILLATOR.replace("Spring s(k = 25);", "SpringDamper s(k = 25, c = 0.1);")
    chart = lmoc.compile_text(text).chart(["dop853", "verlet"], rtols=[1e-6], quick=True)
    failed = [p for p in chart.points if not p.ok]
    assert {p.setting.solver for p in failed} == {"verlet"}
    assert all("not separable" in p.status and math.isnan(p.error) for p in failed)
    assert "verlet at step" in str(chart) and "not separable" in str(chart)
    chart.plot(tmp_path / "c.svg")
    assert "not separable" in (tmp_path / "c.svg").read_text()


def test_a_scene_that_no_method_finishes():
    dae = lmoc.compile_text("model M Real x(start = 1, fixed = true); equation der(x) = x^2; end M;")
    with pytest.raises(SimulationError, match="the run stopped at t = 1 s of 2 s"):
        dae.chart(["dop853"], quick=True, stop=2.0)
    assert dae.chart(["dop853"], rtols=[1e-6], quick=True, stop=0.5).points[0].ok


def test_impacts_that_come_a_little_late_do_not_count_as_errors_of_the_velocity():
    text = """model B Mass m(m = 1, g = -9.81, q(start = 1, fixed = true), v(fixed = true)); Fixed w;
      Stop s(L = 0, e = 0.7); equation connect(w.flange, s.a); connect(s.b, m.flange); end B;"""
    chart = lmoc.compile_text(text).chart(["dop853", "cvode"], rtols=[1e-6], quick=True, stop=1.5, points=2001)
    assert [p.events for p in chart.points] == [2, 2]
    assert all(p.error < 1e-3 for p in chart.points)


def test_a_scene_without_states_has_no_chart():
    with pytest.raises(ModelError, match="the scene has no states to integrate"):
        lmoc.compile_text("model N Real y = sin(time); end N;").chart(quick=True)


def test_a_reference_takes_two_methods(monkeypatch):
    monkeypatch.setattr(reference, "_SMOOTH", (("dop853", 1e-13),))
    with pytest.raises(SimulationError, match="there is no reference to measure errors by"):
        lmoc.compile_text(OSCILLATOR).chart(["dop853"], quick=True)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"solvers": ["dop852"]}, "there is no solver 'dop852'"),
        ({"formulations": ["minimal"]}, "there is no formulation 'minimal'"),
        ({"rtols": [2.0]}, "tolerances are"),
        ({"rtols": []}, "tolerances are"),
    ],
)
def test_wrong_options(options, words):
    with pytest.raises(ModelError, match=words):
        lmoc.compile_text(OSCILLATOR).chart(**options, quick=True)


def test_an_interrupted_chart_keeps_its_points(monkeypatch):
    measured = points.Measurement._measured
    calls = []

    def interrupted(self, setting):
        calls.append(setting)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return measured(self, setting)

    monkeypatch.setattr(points.Measurement, "_measured", interrupted)
    chart = lmoc.compile_text(OSCILLATOR).chart(["dop853", "cvode"], rtols=[1e-4, 1e-6], quick=True)
    assert chart.interrupted and len(chart.points) == 2 and "interrupted" in str(chart)


# ------------------------------------------------------------------ pieces


def test_deviation_leaves_out_output_times_between_the_instants_of_an_event():
    time = np.linspace(0, 1, 11)

    def signals(instant: float) -> Signals:
        event = type("E", (), {"time": instant})()
        return Signals(("v",), time, np.where(time < instant, -1.0, 1.0)[:, None], (event,))

    assert deviation(signals(0.55), signals(0.45)).largest == 0.0
    late = Signals(("v",), time, signals(0.75).values, ())
    assert deviation(late, signals(0.45)).largest == 2.0
    assert deviation(late, signals(0.45)).note == "0 events, and 1 in the reference"


def test_signals_that_stay_zero_have_no_error():
    time = np.linspace(0, 1, 3)
    zero, noise = (Signals(("x", "y"), time, np.array([[1, n], [2, n], [4, n]], float), ()) for n in (0.0, 1e-20))
    assert deviation(noise, zero).largest == 0.0


@pytest.mark.parametrize("heights", [[0.1, 0.5], [0.5, 0.5, 0.5], [0.0, 0.01, 0.02, 0.9, 0.91], []])
def test_labels_are_moved_apart(heights):
    places = spread(heights, 0.05)
    assert len(places) == len(heights)
    assert all(b - a >= 0.05 - 1e-12 for a, b in zip(places, places[1:], strict=False))
    assert sum(places) == pytest.approx(sum(heights))


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("1e-3:1e-6", [1e-3, 1e-4, 1e-5, 1e-6]),
        ("1e-6:1e-3", [1e-3, 1e-4, 1e-5, 1e-6]),
        ("1e-4", [1e-4]),
        ("1e-4,2e-7", [1e-4, 2e-7]),
    ],
)
def test_tolerances_on_the_command_line(text, values):
    assert tolerances(text) == pytest.approx(values)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(2.0, "2 s"), (0.0123, "12 ms"), (0.0996, "100 ms"), (0.123, "123 ms"), (1e-4, "100 µs"), (math.nan, "–")],
)
def test_seconds_for_people(seconds, text):
    assert seconds_text(seconds) == text


def test_a_reference_that_cannot_be_trusted_recommends_no_more_digits_than_it_has():
    setting = Setting("dop853", "reduced", 1e-8)
    signals = Signals(("x",), np.zeros(1), np.zeros((1, 1)), ())
    doubtful = Reference(signals, ("one", "two"), 3e-4)
    chart = Chart("M", (Point(setting, error=1e-9, seconds=1e-3),), doubtful)
    assert chart.recommendation.startswith("for 3 digits")
    assert "do not trust smaller errors" in str(chart)


# ------------------------------------------------------------------ command line


def test_the_command(tmp_path, capsys):
    (tmp_path / "o.lmo").write_text(OSCILLATOR)
    command = ["chart", str(tmp_path / "o.lmo"), "--solvers", "dop853,adams", "--rtol", "1e-5:1e-7", "--quick"]
    assert main([*command, "-o", str(tmp_path / "c.csv"), "--set", "m.m=2"]) == 0
    out = capsys.readouterr().out
    assert "Oscillator: speed against accuracy" in out and "for 6 digits: " in out and "points written to" in out
    assert len((tmp_path / "c.csv").read_text().splitlines()) == 1 + 2 * 3
    assert main([*command, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["points"][0]["status"] == "ok"
    assert main(["chart", str(tmp_path / "o.lmo"), "--solvers", "nix"]) == 2
    assert "there is no solver 'nix'" in capsys.readouterr().err
    assert main(["chart", str(tmp_path / "o.lmo"), "--rtol", "3:4"]) == 2
    assert main(["chart", str(tmp_path / "o.lmo"), "--plot", "c.bmp"]) == 2


def test_an_output_that_is_nothing_but_rounding_is_left_out():
    """Signals in which the two methods of the reference differ by their size tell nothing of accuracy."""
    more = OSCILLATOR.replace("output Real x = m.q;", "output Real x = m.q, e = (m.q + 1)^2 - m.q^2 - 2*m.q - 1;")
    chart = lmoc.compile_text(more).chart(["dop853"], rtols=[1e-6], quick=True)
    assert chart.reference.left_out == ("e",) and chart.reference.signals.names == ("x",)
    assert chart.reference.uncertainty < 1e-10 and chart.points[0].error < 1e-3
    assert "without e, nothing but rounding" in str(chart)
    alone = OSCILLATOR.replace("output Real x = m.q;", "output Real e = (m.q + 1)^2 - m.q^2 - 2*m.q - 1;")
    chart = lmoc.compile_text(alone).chart(["dop853"], rtols=[1e-6], quick=True)
    assert chart.reference.signals.names == ("m.q", "m.v") and chart.points[0].error < 1e-3


def test_methods_of_one_call_have_a_deadline_where_another_one_takes_their_place():
    ball = """model B Mass m(m = 1, g = -9.81, q(start = 1, fixed = true), v(fixed = true)); Fixed w;
      Stop s(L = 0, e = 0.7); equation connect(w.flange, s.a); connect(s.b, m.flange); end B;"""
    for text, one_call in ((OSCILLATOR, True), (ball, False)):
        runner = points.Runner(lmoc.compile_text(text)._session, Request(RunOptions()))
        assert runner._is_one_call("cvodes") is one_call and not runner._is_one_call("dop853")


def test_a_quick_chart_ends_where_its_reference_can_follow():
    """`auto` is quick at 1e-6, but a reference at 1e-13 would take all the time that the chart has."""
    text = """model M Real x(start = 1e-6, fixed = true), v(start = 0, fixed = true);
      Real y(start = 1, fixed = true), w(start = 0, fixed = true);
      equation der(x) = v; der(v) = -1e8*x; der(y) = w; der(w) = -y; annotation(experiment(StopTime = 10)); end M;"""
    chart = lmoc.compile_text(text).chart(["auto", "dop853"], rtols=[1e-6], quick=True)
    assert "to be quick, only until" in chart.note and chart.reference.uncertainty < 1e-8
    assert chart.points[0].ok and chart.points[0].error < 1e-4


@pytest.mark.parametrize("text", [STIFF, OSCILLATOR.replace("StopTime = 5", "StopTime = 2000")])
def test_what_is_charted_follows_from_the_scene_and_not_from_the_clock(text, monkeypatch):
    def ends(pace: float) -> float:
        with monkeypatch.context() as patch:
            for name in ("thread_time", "monotonic", "perf_counter"):
                clock = getattr(time, name)
                patch.setattr(time, name, lambda clock=clock: pace * clock())
            runner = points.Runner(lmoc.compile_text(text)._session, Request(RunOptions()))
            return _quick_end(runner, _QUICK_BUDGET)

    own = ends(1.0)
    assert ends(0.05) == own and ends(2.0) == own  # by the clock of a fast machine, and of a slow or busy one


def test_what_a_quick_chart_recommends_has_the_digits_in_the_whole_run(monkeypatch):
    """The errors of an undamped motion add up: what has six digits at the beginning has five in the end."""
    monkeypatch.setattr(chart_module, "_QUICK_RUN", 0.001)
    dae = lmoc.compile_text(OSCILLATOR.replace("StopTime = 5", "StopTime = 500"))
    chart = dae.chart(["dop853", "adams"], rtols=[1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-11], quick=True)
    assert "to be quick, only until" in chart.note
    best = chart.recommended()

    def error_of(setting):
        run = dae.simulate(solver=setting.solver, rtol=setting.rtol)
        return np.abs(run["x"] - 0.1 * np.cos(5 * run.time)).max() / 0.1

    error = error_of(best.setting)
    assert error <= 1e-6 and best.error == pytest.approx(error, abs=2 * chart.whole.uncertainty)
    early = [p.setting for p in chart.points if p.ok and p.error <= 1e-6]
    assert any(error_of(setting) > 1e-6 for setting in early), "else this test says nothing"
    assert "for the whole run" in chart.recommendation and "of the whole run" in str(chart)


def test_a_whole_run_that_would_take_too_long_is_not_tried(monkeypatch):
    monkeypatch.setattr(chart_module, "_QUICK_RUN", 1e-3)
    monkeypatch.setattr(chart_module, "_QUICK_WHOLE", 0.0)
    chart = lmoc.compile_text(OSCILLATOR).chart(["dop853", "adams"], rtols=[1e-8], quick=True, stop=200)
    assert chart.recommendation.endswith("; the whole run takes too long to be tried")


def test_a_method_that_is_given_up_is_not_tried_at_finer_tolerances():
    """The run that was stopped says how long it took, and those that take longer still are not begun."""
    dae = lmoc.compile_text(OSCILLATOR)
    runner = points.Runner(dae._session, Request(RunOptions(stop=200)))
    wanted = [Setting("midpoint", "reduced", math.nan, step) for step in (1e-5, 1e-6, 1e-7)]
    signals = Signals(("x",), np.linspace(0, 200, 501), np.ones((501, 1)), ())
    measurement = points.Measurement(runner, signals, 0.05, math.inf, lambda text, share: None)
    measurement.measure([wanted], 1)
    first, *others = (measurement.points[setting].status for setting in wanted)
    assert first.startswith("the run stopped at t = ") and points.TOO_SLOW in first
    assert all(text.startswith(f"{points.NOT_RUN}: a coarser one takes more than 0.") for text in others)


def test_a_scene_whose_parts_have_no_energy_has_no_balance():
    text = "model M Real x(start = 1, fixed = true); equation der(x) = -x; end M;"
    assert math.isnan(lmoc.compile_text(text).chart(["dop853"], rtols=[1e-6], quick=True).points[0].energy)
    assert lmoc.compile_text(OSCILLATOR).chart(["dop853"], rtols=[1e-6], quick=True).points[0].energy < 1e-4


def test_a_run_that_has_met_its_deadline_is_made_once_more_without(monkeypatch):
    """The balance of a rough run is judged between its output times, too: it is run again, however long that takes."""
    from lmoc import simulation

    dae = lmoc.compile_text(OSCILLATOR)
    runner = points.Runner(dae._session, Request(RunOptions(points=11)))
    run, _ = runner.run(Setting("cvode", "reduced", 1e-3), 60.0)
    seen, whole = [], simulation.run_prepared
    monkeypatch.setattr(simulation, "run_prepared", lambda *given: seen.append(given[2].options) or whole(*given))
    assert run.energy.balance > 1e-3 and len(run.fine.time) > len(run.time)
    assert [options.max_seconds for options in seen] == [None]


@pytest.mark.parametrize("wrong", [{"stop": 0.0}, {"points": 1}, {"start": 9.0}])
def test_a_span_that_is_none_is_told(wrong):
    with pytest.raises(ModelError, match="E0541"):
        lmoc.compile_text(OSCILLATOR).chart(["dop853"], rtols=[1e-6], quick=True, **wrong)


def test_the_equations_that_switch_laws_are_no_constraints():
    """They hold what decides between open and closed, which is not computed for a mode that is known."""
    run = compiled(ROOT / "models" / "laws" / "h06_bungee.lmo").simulate()
    assert len(run.modes) > 2 and constraint_residual(run) < 1e-12
