"""Derivatives through events, against closed forms, differences of tight runs, and motions that have none."""

import json

import numpy as np
import pytest
from conftest import ROOT

import lmoc
from lmoc.cli.main import main
from lmoc.messages.diagnostics import ModelError


def _differences(function, values, name):
    """The derivative of a closed form by one of its values."""
    step = 1e-4 * abs(values[name])
    around = {k: function(**{**values, name: values[name] + k * step}) for k in (-2, -1, 1, 2)}
    return (8 * (around[1] - around[-1]) - (around[2] - around[-2])) / (12 * step)


def _ball(t, e, h, g):
    """Height of a ball that falls from h and bounces."""
    at, v = np.sqrt(2 * h / g), np.sqrt(2 * g * h)
    height = h - g * t**2 / 2
    while at < t.max():
        v, s = e * v, t - at
        height = np.where(s > 0, v * s - g * s**2 / 2, height)
        at += 2 * v / g
    return height


@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
def test_a_ball_after_four_bounces(rtol):
    dae = lmoc.compile(ROOT / "models/laws/h19_bouncing_ball.lmo")
    run = dae.simulate(stop=2.5, points=51, rtol=rtol, sensitivities=("e", "ball.q", "ball.g"))
    assert [event.kind for event in run.events] == ["impact"] * 4
    values = {"e": 0.8, "h": 1.0, "g": 9.81}
    for name, own, sign in (("e", "e", 1), ("ball.q", "h", 1), ("ball.g", "g", -1)):
        truth = sign * _differences(lambda **v: _ball(run.time, **v), values, own)
        assert np.abs(run.sensitivity("y", name) - truth).max() < 100 * rtol * np.abs(truth).max()


CLUTCH = """
model Locks
  parameter Real J1 = 2, J2 = 3, T = 4;
  Inertia a(J = J1, omega(start = 10, fixed = true), theta(start = 0, fixed = true));
  Inertia b(J = J2, omega(start = 0, fixed = true), theta(start = 0, fixed = true));
  Clutch clutch(tau = T);
equation
  connect(a.shaft, clutch.a);
  connect(clutch.b, b.shaft);
end Locks;
"""


def test_a_clutch_that_locks():
    run = lmoc.compile_text(CLUTCH).simulate(stop=6, points=60, rtol=1e-8, sensitivities=("T", "J1", "a.omega"))
    assert [event.kind for event in run.events] == ["lock"]

    def angles(J1, J2, T, w):
        t, locked = run.time, w * J1 * J2 / ((J1 + J2) * T)
        common, s = w * J1 / (J1 + J2), np.minimum(t, locked)
        return np.stack([w * s - T * s**2 / (2 * J1), T * s**2 / (2 * J2)]) + common * np.maximum(t - locked, 0)

    values = {"J1": 2.0, "J2": 3.0, "T": 4.0, "w": 10.0}
    for name, own in (("T", "T"), ("J1", "J1"), ("a.omega", "w")):
        truth = _differences(lambda **v: angles(**v), values, own)
        found = np.stack([run.sensitivity(f"{part}.theta", name) for part in "ab"])
        assert np.abs(found - truth).max() < 1e-6 * np.abs(truth).max()


SLACK = """
model Slack "a mass thrown up from a string that pulls and does not push"
  parameter Real v0 = 3, k = 50, g = 9.81;
  Mass body(m = 1, g = g, q(start = 0, fixed = true), v(start = -v0, fixed = true));
  Fixed hook;
  ElasticCable string(k = k, d0 = 0);
equation
  connect(hook.flange, string.a);
  connect(string.b, body.flange);
end Slack;
"""


def test_a_string_that_goes_slack():
    run = lmoc.compile_text(SLACK).simulate(stop=1.3, points=40, rtol=1e-9, sensitivities=("v0", "k", "g"))

    def place(v0, k, g):
        t, w, down = run.time, np.sqrt(k), 2 * v0 / g
        taut = 2 * (np.pi - np.arctan2(v0 / w, g / k)) / w  # from q = 0 with v0 back to q = 0
        s = t - down
        up = s - taut
        hanging = g / k * (1 - np.cos(w * s)) + v0 / w * np.sin(w * s)
        return np.where(s < 0, -v0 * t + g * t**2 / 2, np.where(up < 0, hanging, -v0 * up + g * up**2 / 2))

    assert len(run.events) >= 2
    values = {"v0": 3.0, "k": 50.0, "g": 9.81}
    assert run["body.q"] == pytest.approx(place(**values), abs=1e-6)
    for name in values:
        truth = _differences(place, values, name)
        assert np.abs(run.sensitivity("body.q", name) - truth).max() < 1e-6 * np.abs(truth).max()


COUNTER = """
model Counter "what happens at an instant remembers when that was"
  parameter Real w = 2, p = 0.3;
  Real x(start = 0, fixed = true);
  output Real y(start = 0, fixed = true);
  discrete Real seen(start = 0, fixed = true);
  Real phase = x - p;
equation
  der(x) = w;
  der(y) = seen;
  when phase > 1 then
    seen = pre(seen) + w*time;
    reinit(y, -pre(y) + 2*p);
  end when;
end Counter;
"""


def test_discrete_variables_and_reinit():
    """At t = (1 + p)/w the rate becomes 1 + p and y 2 p: y = 2 p + (1 + p)(t - (1 + p)/w)."""
    run = lmoc.compile_text(COUNTER).simulate(stop=1, points=21, rtol=1e-8, sensitivities=("w", "p"))
    late = run.time > 0.65
    assert np.allclose(run.sensitivity("y", "w")[late], 1.3**2 / 2**2, atol=1e-7)
    assert np.allclose(run.sensitivity("y", "p")[late], 2 + run.time[late] - 2 * 1.3 / 2, atol=1e-7)
    assert np.allclose(run.sensitivity("seen", "p")[late], 1, atol=1e-7)
    assert not run.sensitivity("y", "p")[run.time < 0.64].any()


@pytest.mark.parametrize(
    ("file", "names", "stop"),
    [
        ("h16_stick_slip", ("spring.k", "friction.F"), 3),
        ("gear_shift", ("shift",), 3),
        ("h18_freewheel", ("bearing.c",), 2),
    ],
)
def test_scenes_against_differences(file, names, stop):
    dae = lmoc.compile(ROOT / f"models/laws/{file}.lmo")
    run = dae.simulate(stop=stop, points=12, rtol=1e-8, sensitivities=names)
    assert run.events
    for name in names:
        value = float(dae.parameters[name])
        low, high = (
            dae.simulate(stop=stop, points=12, rtol=1e-11, parameters={name: value * (1 + h)}) for h in (-1e-5, 1e-5)
        )
        for variable in dae.states:
            slope = (high[variable] - low[variable]) / (2e-5 * value)
            assert np.abs(run.sensitivity(variable, name) - slope).max() < 1e-5 * max(np.abs(slope).max(), 1e-3)


CEILING = """
model Ceiling
  parameter Real v0 = 4;
  parameter Real height = 0.8154943934760449;
  Mass ball(m = 1, g = -9.81, q(start = 0, fixed = true), v(start = v0, fixed = true));
  Stop limit(L = 0, e = 0.5);
  Fixed lid(q0 = height);
equation
  connect(ball.flange, limit.a);
  connect(limit.b, lid.flange);
end Ceiling;
"""
EDGE = """
model Edge "the force is just the one that friction holds"
  parameter Real push = 5;
  Mass body(m = 1, q(start = 0, fixed = true), v(start = 0, fixed = true));
  Force force(f = push*min(1, time));
  Fixed floor;
  DryFriction dry(F = 5);
equation
  connect(force.flange, body.flange);
  connect(floor.flange, dry.a);
  connect(dry.b, body.flange);
end Edge;
"""


@pytest.mark.parametrize(("model", "name"), [(CEILING, "v0"), (EDGE, "push")])
def test_where_a_motion_grazes_or_a_mode_is_on_its_edge_there_is_no_derivative(model, name):
    with pytest.raises(ModelError, match="grazes"):
        lmoc.compile_text(model).simulate(stop=1.5, points=10, sensitivities=(name,))


def test_bounces_that_accumulate_are_told():
    dae = lmoc.compile(ROOT / "models/laws/h19_bouncing_ball.lmo")
    with pytest.raises(ModelError, match="accumulate"):
        dae.simulate(stop=6, points=10, sensitivities=("e",))


def test_from_the_command_line(capsys, tmp_path):
    file, out = str(ROOT / "models/laws/h19_bouncing_ball.lmo"), tmp_path / "ball.csv"
    command = ["run", file, "--stop", "1", "--points", "11", "--sensitivity", "e, ball.g"]
    assert main([*command, "-o", str(out)]) == 0
    text = capsys.readouterr().out
    assert "derivatives at t = 1 s" in text and "by e" in text and "by ball.g" in text
    head, *_, last = out.read_text().splitlines()
    row = dict(zip(head.split(","), map(float, last.split(",")), strict=True))
    truth = _differences(lambda **v: _ball(np.array([1.0]), **v), {"e": 0.8, "h": 1.0, "g": 9.81}, "e")[0]
    assert row["d(y)/d(e)"] == pytest.approx(truth, rel=1e-5)
    assert main([*command, "--json", "--quiet"]) == 0
    found = json.loads(capsys.readouterr().out)["sensitivities"]
    assert found["y"]["e"] == pytest.approx(truth, rel=1e-5)
    assert main(["run", file, "--sensitivity", "e", "--set", "e=0.5:0.1:0.7"]) == 2
