"""Runs beside each other, and pictures that are not over time."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import lmoc
from lmoc.report.linear_plots import bode, peaks
from lmoc.report.portraits import amplitude_spectrum

SWING = """
model Swing "A mass on a spring"
  parameter Real k = 8;
  input Real f = 0;
  output Real x = body.q;
  Fixed wall; Spring spring(k = k); Damper damper(c = 0.4); Force push(f = f);
  Mass body(m = 2, q(start = 1, fixed = true), v(start = 0, fixed = true));
equation
  connect(wall.flange, spring.a); connect(wall.flange, damper.a);
  connect(spring.b, body.flange); connect(damper.b, body.flange); connect(push.flange, body.flange);
end Swing;
"""


@pytest.fixture(scope="module")
def dae():
    return lmoc.compile_text(SWING)


def test_differences_are_those_of_the_closed_form(dae):
    runs = {k: dae.simulate(stop=4, rtol=1e-9, parameters={"k": k, "damper.c": 0.0}) for k in (8.0, 18.0)}
    found = lmoc.compare({f"k = {k}": run for k, run in runs.items()}).differences("x")
    t = runs[8.0].time
    missed = np.abs(np.cos(3 * t) - np.cos(2 * t))
    row = found.loc["k = 18.0", "x"]
    assert row["largest"] == pytest.approx(missed.max(), rel=1e-6) and row["time"] == t[missed.argmax()]
    assert row["relative"] == pytest.approx(missed.max(), rel=1e-6)


def test_runs_of_different_length_and_grid_are_compared_where_both_are(dae):
    one, two = dae.simulate(stop=4, points=401), dae.simulate(stop=2, points=777)
    found = lmoc.compare([one, two]).differences("x").loc["run 2", "x"]
    assert found["time"] <= 2 and found["largest"] < 1e-4


def test_times_without_a_value_in_both_runs_are_counted(dae):
    text = SWING.replace("Real x = body.q", "Real x = body.q; output Real root = sqrt(body.q)")
    one, two = (lmoc.compile_text(text).simulate(stop=s, points=100 * s + 1) for s in (4, 2))
    found = lmoc.compare([one, two]).differences(["x", "root"]).loc["run 2"]
    inside = one.time <= 2
    assert found.loc["x", "missing"] == np.sum(~inside) == 200
    undefined = inside & (one["x"] < 0)
    assert undefined.any() and found.loc["root", "missing"] == 200 + np.sum(undefined)
    assert found.loc["root", "largest"] < 1e-3


def test_runs_without_a_common_time_have_no_difference(dae):
    late = dae.simulate(start=3, stop=4)
    row = lmoc.compare([late, dae.simulate(stop=1)]).differences("x").loc["run 2", "x"]
    assert np.isnan(row["largest"]) and np.isnan(row["time"]) and row["missing"] == len(late.time)


def test_pictures_of_several_runs(dae, tmp_path):
    runs = [dae.simulate(stop=1, points=11, parameters={"k": k}) for k in range(1, 15)]
    few = lmoc.compare(runs[:3]).plot(path=tmp_path / "few.png")
    assert isinstance(few, Figure) and (tmp_path / "few.png").stat().st_size > 0
    assert [t.get_text() for t in few.axes[0].get_legend().get_texts()] == ["run 1", "run 2", "run 3"]
    many = lmoc.compare(runs).plot("body.v")
    assert many.axes[0].get_legend() is None and len(many.axes[0].lines) == 14
    assert "14 runs" in many.axes[0].get_title(loc="right")
    with pytest.raises(ValueError, match="no runs"):
        lmoc.compare([])


def test_runs_of_different_scenes_are_compared_by_the_variables_they_share(dae):
    other = lmoc.compile_text(SWING.replace("Real x = body.q", "Real y = body.q")).simulate(stop=1)
    both = lmoc.compare({"x": dae.simulate(stop=1), "y": other})
    with pytest.raises(ValueError, match="have none of x in common"):
        both.plot()
    assert both.differences("body.q")["largest"].iloc[0] == 0
    with pytest.raises(TypeError, match="'b' is not a run but int"):
        lmoc.compare({"a": other, "b": 3})


def test_the_spectrum_of_a_sine_has_its_amplitude_at_its_frequency():
    time = np.linspace(0, 10, 2001)
    frequency, amplitude = amplitude_spectrum(time, 5 + 0.3 * np.sin(2 * np.pi * 4 * time))
    top = int(amplitude.argmax())
    assert frequency[top] == pytest.approx(4, abs=frequency[1]) and amplitude[top] == pytest.approx(0.3, rel=1e-2)


def test_portrait_and_spectrum_of_a_run(dae, tmp_path):
    run = dae.simulate(stop=20)
    portrait = run.phase(path=tmp_path / "phase.png")
    assert [portrait.axes[0].get_xlabel(), portrait.axes[0].get_ylabel()] == ["body.q in m", "body.v in m/s"]
    figure = run.spectrum("x", tmp_path / "spectrum.svg")
    line = figure.axes[0].lines[0]
    peak = line.get_xdata()[np.argmax(line.get_ydata())]
    assert peak == pytest.approx(2 / (2 * np.pi), abs=0.06)
    with pytest.raises(ValueError, match="two states"):
        lmoc.compile_text("model M Real x(start=1, fixed=true); equation der(x) = -x; end M;").simulate(stop=1).phase()


def test_frequency_responses_in_hertz_and_decibels_mark_their_peak(dae):
    tf = dae.transfer_function("f", "x")
    figure = bode(tf, hertz=True, decibels=True)
    upper = figure.axes[0]
    peak = np.sqrt(4 - 2 * (0.1) ** 2) / (2 * np.pi)  # ω² = ω0² - 2 δ² with δ = c/(2 m)
    (told,) = [text.get_text() for text in upper.texts]
    assert float(told.split()[0]) == pytest.approx(peak, rel=2e-2) and told.endswith("Hz")
    x, y = upper.lines[0].get_data()
    assert y[0] == pytest.approx(20 * np.log10(1 / 8), abs=0.2)
    assert figure.axes[1].get_xlabel() == "frequency in Hz"
    assert peaks(np.array([3.0, 1, 2, 2, 1, 4])).tolist() == [2]


def test_one_function_draws_everything(dae):
    run, tf = dae.simulate(stop=1, points=11), dae.transfer_function("f", "x")
    for shown in (run, [run, run], {"a": run}, lmoc.compare([run]), tf, dae.linearize()):
        assert isinstance(lmoc.plot(shown), Figure)
    assert lmoc.plot(tf, kind="step").axes[0].get_xlabel() == "time in s"
    with pytest.raises(ValueError, match="bode or step"):
        lmoc.plot(tf, kind="cake")
    with pytest.raises(ValueError, match="no picture 'step'"):
        lmoc.plot(run, kind="step")
    with pytest.raises(TypeError, match="no picture of int"):
        lmoc.plot(3)
