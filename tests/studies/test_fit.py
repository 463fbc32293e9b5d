"""Fits against what the data were made with."""

import json

import numpy as np
import pytest
from conftest import ROOT
from scipy.optimize import brentq, minimize_scalar
from scipy.stats import chi2, f

import lmoc
from lmoc.cli.main import main
from lmoc.messages.diagnostics import ModelError
from lmoc.studies.misses import Misses

SWING = """
model Swing
  parameter Real k = 30, c = 1, m = 2;
  output Real x(start = 0.5, fixed = true);
  Real v(start = 0, fixed = true);
  input Real f = 0;
equation
  der(x) = v;
  m*der(v) = -k*x - c*v + f;
end Swing;
"""
TIMES = np.linspace(0.1, 4, 40)


def truth(k=40.0, c=1.2, m=2.0, x=0.5, v=0.0, t=TIMES):
    """The closed form of the damped oscillation."""
    d = c / (2 * m)
    w = np.sqrt(k / m - d * d)
    return np.exp(-d * t) * (x * np.cos(w * t) + (v + d * x) / w * np.sin(w * t))


@pytest.fixture(scope="module")
def dae():
    return lmoc.compile_text(SWING)


def test_exact_data_give_the_exact_values(dae):
    found = dae.fit({"time": TIMES, "x": truth()}, {"k": 30, "c": (1, 0, 10)})
    assert found.values == pytest.approx({"k": 40, "c": 1.2}, rel=1e-6)
    assert found.converged and found.identifiable and "k  40" in str(found)
    assert abs(found.run["x"] - truth()).max() < 1e-6 and abs(found.residuals[0]["x"]).max() < 1e-6


def test_start_values_may_be_unknown_and_bounds_hold(dae):
    data = {"time": TIMES, "x": truth(x=0.4, v=0.8)}
    found = dae.fit(data, {"k": 35, "x": 0.5, "v": 0}, parameters={"c": 1.2})
    assert found.values == pytest.approx({"k": 40, "x": 0.4, "v": 0.8}, rel=1e-5)
    held = dae.fit(data, {"k": (35, 30, 38), "x": 0.5, "v": 0}, parameters={"c": 1.2})
    assert held.values["k"] == pytest.approx(38, abs=1e-3)


def test_several_experiments_share_their_unknowns(dae):
    push = 3.0 / 40 * (1 - truth(x=1.0))
    one = ({"time": TIMES, "x": truth()}, {})
    two = ({"time": TIMES, "x": push}, {"initial": {"x": 0}, "inputs": {"f": "3"}})
    found = dae.fit([one, two], {"k": 33, "c": 1, "m": 2.2})  # the force tells the mass apart
    assert found.values == pytest.approx({"k": 40, "c": 1.2, "m": 2}, rel=1e-5) and found.identifiable


def test_what_the_data_do_not_determine_is_told(dae):
    found = dae.fit({"time": TIMES, "x": truth()}, {"k": 36, "c": 1, "m": 1.8})
    assert not found.identifiable and len(found.undetermined) == 1
    direction = found.undetermined[0]  # only k/m and c/m are seen
    assert direction["k"] == pytest.approx(direction["m"], rel=1e-3) and set(direction) == {"k", "c", "m"}
    assert found.values["k"] / found.values["m"] == pytest.approx(20, rel=1e-4)
    assert np.isinf(found.deviations["k"]) and "do not tell apart" in str(found)


def test_a_value_at_which_nothing_changes_is_not_determined():
    """``der(x) = k^2 - x`` has no slope by k at 0: the fit stays, and its interval would be wider than the bounds."""
    text = "model M parameter Real k = 2; Real x(start = 0, fixed = true); equation der(x) = k*k - x; end M;"
    dae = lmoc.compile_text(text)
    data = {"time": TIMES, "x": 4 * (1 - np.exp(-TIMES))}
    found = dae.fit(data, {"k": (0, 0, 10)})
    assert not found.identifiable and found.undetermined == ({"k": 1.0},) and "not determined" in str(found)
    assert dae.fit(data, {"k": (1, 0, 10)}).values == pytest.approx({"k": 2}, rel=1e-6)


def test_intervals_hold_the_truth_as_often_as_they_say(dae):
    """Noise of known size, 25 times: of 50 intervals of 95 %, 42 to 50 hold the truth but once in some thousands."""
    random, inside, spread = np.random.default_rng(1), 0, []
    for _ in range(25):
        data = {"time": TIMES, "x": truth() + 0.01 * random.standard_normal(len(TIMES))}
        found = dae.fit(data, {"k": 38, "c": 1}, rtol=1e-7)
        inside += sum(found.intervals[n][0] <= v <= found.intervals[n][1] for n, v in (("k", 40), ("c", 1.2)))
        spread.append((found.values["k"], found.deviations["k"], found.sigma["x"]))
    values, deviations, sigma = np.array(spread).T
    assert 42 <= inside <= 50
    assert np.std(values) == pytest.approx(np.mean(deviations), rel=0.45) and np.mean(sigma) == pytest.approx(0.01, 0.1)


def test_a_given_sigma_scales_the_intervals(dae):
    data = {"time": TIMES, "x": truth() + 0.01 * np.sin(40 * TIMES)}
    one, two = (dae.fit(data, {"k": 38, "c": 1}, sigma=s) for s in (0.01, 0.02))
    assert two.deviations["k"] == pytest.approx(2 * one.deviations["k"], rel=1e-3)


def test_several_starts_find_the_lowest_minimum(dae):
    data = {"time": TIMES, "x": truth(k=40)}
    free, known = {"k": (290, 10, 300)}, {"c": 1.2}
    one = dae.fit(data, free, parameters=known, rtol=1e-6)
    assert one.values["k"] != pytest.approx(40, rel=0.01), "else this test says nothing"
    assert dae.fit(data, free, starts=6, parameters=known, rtol=1e-6).values["k"] == pytest.approx(40, rel=1e-4)


def test_a_coefficient_of_restitution_from_the_bounces():
    ball = lmoc.compile_text("""
model Ball
  parameter Real e = 0.7;
  Mass ball(m = 1, g = -9.81, q(start = 1, fixed = true), v(start = 0, fixed = true));
  Fixed floor;
  Stop stop(L = 0, e = e);
  output Real h = ball.q;
equation
  connect(floor.flange, stop.a);
  connect(stop.b, ball.flange);
end Ball;
""")
    times, e, g = np.linspace(0.05, 1.15, 23), 0.8, 9.81
    fall = np.sqrt(2 / g)
    since = times - fall
    heights = np.where(since < 0, 1 - g * times**2 / 2, e * g * fall * since - g * since**2 / 2)  # until it lands again
    found = ball.fit({"time": times, "h": heights}, {"e": (0.7, 0.1, 1)})
    assert found.values["e"] == pytest.approx(0.8, rel=1e-5)


@pytest.mark.parametrize(
    ("file", "column", "factors", "stop"),
    [
        ("notes/ex05_suspension", "q2", {"k1": 0.8, "k2": 1.2, "c2": 0.7}, 3),
        ("laws/h19_bouncing_ball", "y", {"e": 0.97}, 1.5),
        ("laws/h16_stick_slip", "mass.q", {"friction.F": 1.1}, 2),
    ],
)
def test_tangents_lead_where_differences_lead_with_fewer_runs(file, column, factors, stop, monkeypatch):
    dae, random = lmoc.compile(ROOT / f"models/{file}.lmo"), np.random.default_rng(3)
    run = dae.simulate(stop=stop, points=31, rtol=1e-9, energy=False)
    data = {"time": run.time, column: run[column] + 1e-3 * np.ptp(run[column]) * random.standard_normal(31)}
    start = {name: float(dae.parameters[name]) * factor for name, factor in factors.items()}
    tangents = dae.fit(data, start)
    monkeypatch.setattr(Misses, "_tangents", lambda *_: {})
    differences = dae.fit(data, start)
    for name in start:
        apart = tangents.values[name] - differences.values[name]
        assert abs(apart) < 1e-3 * differences.deviations[name]
        assert tangents.deviations[name] == pytest.approx(differences.deviations[name], rel=1e-4)
        assert abs(tangents.values[name] - float(dae.parameters[name])) < 5 * tangents.deviations[name]
    assert not tangents.differences and tangents.evaluations < differences.evaluations / 2


def test_where_there_are_no_tangents_differences_are_taken_and_said():
    """How many there are is decided when the scene is compiled: what is given for c shapes the model."""
    dae = lmoc.compile_text("""
model Decay
  parameter Real c = 1;
  parameter Integer n = if c > 5 then 2 else 1;
  Real part[n](each start = 1, each fixed = true);
  output Real x = part[1];
equation
  der(part) = -c*part;
end Decay;
""")
    times = np.linspace(0, 2, 9)
    found = dae.fit({"time": times, "x": np.exp(-1.3 * times)}, {"c": 1})
    assert found.values["c"] == pytest.approx(1.3, rel=1e-6)
    assert "shapes the model" in found.differences["c"] and "differences of runs" in str(found)


@pytest.mark.parametrize(
    ("data", "free", "more"),
    [
        ({"x": TIMES}, {"k": 1}, {}), ({"time": TIMES, "y": TIMES}, {"k": 1}, {}),
        ({"time": TIMES, "x": TIMES}, {}, {}),
        ({"time": TIMES, "x": TIMES}, {"k": (1, 2, 3)}, {}), ({"time": TIMES, "x": TIMES}, {"kk": 1}, {}),
        ({"time": TIMES[:1], "x": TIMES[:1]}, {"k": 1, "c": 1}, {}), ("nowhere.csv", {"k": 1}, {}),
        ({"time": TIMES, "x": TIMES[:3]}, {"k": 1}, {}), ({"time": TIMES, "x": TIMES}, {"k": 1}, {"sigma": -1}),
        ({"time": TIMES, "x": TIMES}, {"k": 1}, {"outputs": {"x": "z"}}),
        ({"time": TIMES, "x": TIMES}, {"k": 1}, {"starts": 0}),
    ],
)  # fmt: skip
def test_what_does_not_go_together_is_refused(dae, data, free, more):
    with pytest.raises(ModelError):
        dae.fit(data, free, **more)


def test_a_scene_whose_motion_is_all_given_has_derivatives():
    times = np.array([0, 0.1, 0.2, 0.4])
    given = lmoc.compile_text("model B parameter Real p = 3; output Real x = p*time; end B;")
    found = given.fit({"time": times, "x": np.array([0, 0.01, 0.05, 0.1])}, {"p": 3})
    assert found.values["p"] == pytest.approx(0.051 / 0.21) and "differences" not in str(found)


def test_the_command_and_the_picture(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "swing.lmo").write_text(SWING)
    rows = [f"{t:.4f};{1000 * x:.6f}" for t, x in zip(TIMES, truth(), strict=True)]
    (tmp_path / "measured.csv").write_text("\n".join(["time [s];place", *rows]) + "\n")
    command = ["fit", "swing.lmo", "--data", "measured.csv", "--free", "k,c=1:0:10", "--outputs", "place=x"]
    (tmp_path / "swing.lmo").write_text(SWING.replace("output Real x(", 'output Real x(unit = "m", '))
    (tmp_path / "measured.csv").write_text("\n".join(["time [s];place [mm]", *rows]) + "\n")
    assert main([*command, "--plot", "fit.svg"]) == 0
    assert "k  40 " in capsys.readouterr().out and "data − fit" in (tmp_path / "fit.svg").read_text()
    assert main([*command, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["values"]["c"] == pytest.approx(1.2, rel=1e-3)
    for wrong in (["--data", "measured.csv"], ["--free", "k"], ["--data", "measured.csv", "--free", "kk"],
                  ["--data", "no.csv", "--free", "k"], ["--data", "measured.csv", "--free", "k=1:2"]):  # fmt: skip
        assert main(["fit", "swing.lmo", *wrong]) == 2


def test_an_array_of_parameters_begins_at_its_common_value(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = "model M parameter Real k[2] = {{{}, 1}}; Real x(start = 1); equation der(x) = -k[1]*k[2]*x; end M;"
    rows = [f"{t},{np.exp(-4 * t)}" for t in np.linspace(0, 1, 11)]
    (tmp_path / "measured.csv").write_text("\n".join(["time,x", *rows]) + "\n")
    command = ["fit", "m.lmo", "--data", "measured.csv", "--outputs", "x=x", "--free"]
    (tmp_path / "m.lmo").write_text(text.format(1))
    assert main([*command, "k"]) == 0 and "k  2 " in capsys.readouterr().out
    (tmp_path / "m.lmo").write_text(text.format(3))
    assert main([*command, "k"]) == 2 and "no value in common" in capsys.readouterr().err
    assert main([*command, "k=1"]) == main([*command, "k[1]"]) == 0


def test_data_may_hold_what_the_ledger_of_a_run_holds(tmp_path) -> None:
    text = """model Swing
      Fixed w; Spring s(k = 50); Damper d(c = 1); Mass m(m = 2, q(start = 0.5, fixed = true));
    equation
      connect(w.flange, s.a); connect(w.flange, d.a); connect(s.b, m.flange); connect(d.b, m.flange);
    end Swing;"""
    dae = lmoc.compile_text(text)
    dae.simulate(stop=2, rtol=1e-9).save(str(tmp_path / "run.csv"))  # all variables, ledger.heat among them
    assert dae.fit(tmp_path / "run.csv", free={"m.m": 1.5}).values["m.m"] == pytest.approx(2.0, rel=1e-6)


DECAY = """
model Decay
  parameter Real c = 1, a = 1, b = 1;
  output Real x(start = 1, fixed = true);
equation
  der(x) = -c*x;
end Decay;
"""


@pytest.mark.parametrize("sigma", [0.1, None])
def test_profile_likelihoods(sigma):
    """Of x = a exp(-c t) with few noisy data, whose profile over c has a closed form: a is linear."""
    t, noise = np.array([0.2, 0.5, 1.0, 2.0, 3.0]), np.array([0.06, -0.11, 0.09, 0.05, -0.07])
    data = 1.5 * np.exp(-0.9 * t) + noise
    found = lmoc.compile_text(DECAY).fit({"time": t, "x": data}, {"c": 1, "x": 1}, sigma=sigma, profile=["c"], start=0)

    def squares(c):
        e = np.exp(-c * t)
        return np.sum((data - e * (data @ e) / (e @ e)) ** 2)

    least = minimize_scalar(squares, bounds=(0.1, 5), method="bounded", options={"xatol": 1e-10})
    variance = 0.1**2 if sigma else least.fun / 3
    limit = (chi2.ppf(0.95, 1) if sigma else f.ppf(0.95, 1, 3)) * variance + least.fun
    low, high = (
        brentq(lambda c: squares(c) - limit, *sorted((least.x, far))) if squares(far) > limit else np.inf
        for far in (0.001, 60.0)
    )
    own = found.profiles["c"]
    assert (own.low, own.high) == pytest.approx((low, high), rel=1e-3) and not own.lower
    assert (np.diff(own.values) > 0).all() and (np.diff(own.distance) >= 0).all()
    linear = found.intervals["c"]
    assert own.high - found.values["c"] > 1.05 * (linear[1] - found.values["c"]), "it leans to one side"
    assert "by its profile likelihood" in str(found)


def test_profiles_of_what_data_do_not_bound_and_of_bounds(dae):
    data = {"time": TIMES, "x": truth(c=0.0)}
    found = dae.fit(data, {"k": (38, 1, np.inf), "m": 1.9}, parameters={"c": 0}, sigma=0.01, profile="k")
    assert not found.identifiable and found.profiles["k"].high == np.inf and found.profiles["k"].low == 1
    with pytest.raises(ModelError, match="E0668"):
        dae.fit(data, {"k": 30}, profile="m")


def test_a_lower_minimum_is_told(dae):
    """A phase that is wrong by a turn is a minimum, too."""
    data = {"time": TIMES, "x": truth()}
    found = dae.fit(data, {"k": 300.0}, sigma=0.2, profile=True)
    own = found.profiles["k"]
    assert found.values["k"] == pytest.approx(40, rel=0.01) or own.lower or own.low > 60


def test_pictures_of_profiles(dae, tmp_path):
    found = dae.fit({"time": TIMES, "x": truth()}, {"k": 35, "c": 1}, sigma=0.05, profile=True)
    assert set(found.profiles) == {"k", "c"}
    assert len(found.plot(tmp_path / "profile.png", kind="profile").axes) == 2 and (tmp_path / "profile.png").exists()
    with pytest.raises(ModelError, match="E0668"):
        dae.fit({"time": TIMES, "x": truth()}, {"k": 35}).plot(kind="profile")


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({"time": [0.0, 1.0, 2.0], "x": [1e308, -1e308, 1e308]}, "too large to be squared"),
        ({"time": [0.0, 1.0], "x": [np.nan, np.nan]}, "has no numbers"),
        ({"time": [1.0], "x": [0.5]}, "too few to determine k and the deviation"),
        ({"time": [0.0, 1.0], "y": [0.5, 0.4]}, "none of the columns"),
    ],
)
def test_data_that_no_fit_can_use_are_refused(dae, data, said):
    with pytest.raises(ModelError, match=said) as found:
        dae.fit(data, {"k": 30})
    assert [d.code for d in found.value.diagnostics] == ["E0668"]


def test_an_empty_file_is_no_table(dae, tmp_path):
    (tmp_path / "empty.csv").write_text("")
    with pytest.raises(ModelError, match="no table with a column 'time'"):
        dae.fit(tmp_path / "empty.csv", {"k": 30})
