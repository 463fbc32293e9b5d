"""Derivatives through events, against closed forms, differences of tight runs, and motions that have none."""

import json

import numpy as np
import pytest
from conftest import ROOT

import lmoc
from lmoc import simulation
from lmoc.cli.main import main
from lmoc.messages.diagnostics import ModelError
from lmoc.numerics.events.occasion import START, Occasion
from lmoc.numerics.options.options import RunOptions


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
    run = lmoc.compile_text(COUNTER).simulate(stop=1, points=24, rtol=1e-8, sensitivities=("w", "p"))
    late = run.time > 0.65
    assert np.allclose(run.sensitivity("y", "w")[late], 1.3**2 / 2**2, atol=1e-7)
    assert np.allclose(run.sensitivity("y", "p")[late], 2 + run.time[late] - 2 * 1.3 / 2, atol=1e-7)
    assert np.allclose(run.sensitivity("seen", "p")[late], 1, atol=1e-7)
    assert not run.sensitivity("y", "p")[run.time < 0.64].any()


THERMOSTAT = """
model Thermostat "what switches off is below its threshold again at once"
  parameter Real lo = 18, hi = 22, P = 30, tau = 1.5, x0 = 10;
  output Real x(start = x0, fixed = true);
  discrete Boolean on(start = true, fixed = true);
equation
  on = {};
  tau*der(x) = (if on then P else 10) - x;
end Thermostat;
"""


@pytest.mark.parametrize(
    "rule", ["if x > hi then false else if x < lo then true else pre(on)", "pre(on) and not x > hi or x < lo"]
)
def test_a_thermostat(rule):
    """Pieces of exponentials towards P and 10, between lo and hi."""
    values = {"lo": 18.0, "hi": 22.0, "P": 30.0, "tau": 1.5, "x0": 10.0}
    run = lmoc.compile_text(THERMOSTAT.format(rule)).simulate(stop=4, points=14, rtol=1e-8, sensitivities=values)
    assert [event.name for event in run.events] == ["on"] * 5

    def temperature(lo, hi, P, tau, x0):
        found, at, x, ends = np.zeros(14), 0.0, x0, [(P, hi), (10.0, lo)] * 4
        for goal, threshold in ends:
            since = run.time - at
            found = np.where(since >= 0, goal + (x - goal) * np.exp(-since / tau), found)
            at, x = at + tau * np.log((goal - x) / (goal - threshold)), threshold
        return found

    assert run["x"] == pytest.approx(temperature(**values), rel=1e-7)
    for name in values:
        truth = _differences(temperature, values, name)
        assert np.abs(run.sensitivity("x", name) - truth).max() < 1e-6 * np.abs(truth).max()


STAIRS = """
model Stairs "what is rounded down, of states and of time"
  parameter Real k = 3, r = 0.5, T = 0.43;
  Real x(start = 0.1, fixed = true);
  output Real y(start = 0, fixed = true);
equation
  der(x) = r;
  der(y) = floor(k*x) + mod(time, T);
end Stairs;
"""


def test_numbers_that_are_rounded_down():
    """Each step of floor(k x) and of floor(time/T) = (time - mod(time, T))/T adds a ramp from its instant on."""
    run = lmoc.compile_text(STAIRS).simulate(stop=2, points=14, rtol=1e-8, sensitivities=("k", "r", "T", "x"))

    def height(k, r, T, x):
        ramps = [np.maximum(run.time - (n / k - x) / r, 0) - T * np.maximum(run.time - n * T, 0) for n in range(1, 9)]
        return run.time**2 / 2 + sum(ramps)

    values = {"k": 3.0, "r": 0.5, "T": 0.43, "x": 0.1}
    assert run["y"] == pytest.approx(height(**values), abs=1e-7)
    for name in values:
        truth = _differences(height, values, name)
        assert np.abs(run.sensitivity("y", name) - truth).max() < 1e-6 * np.abs(truth).max()


TENTS = """
model Tents "kinks in time that are elsewhere in each period"
  parameter Real k = 2, T = 0.7;
  output Real y(start = 0, fixed = true);
equation
  der(y) = k*abs(mod(time, T) - T/2);
end Tents;
"""


def test_kinks_in_time_between_events():
    """They were looked for where they are in the first period, and none was there: an internal error."""
    run = lmoc.compile_text(TENTS).simulate(times=[0.3, 0.6, 1.0, 1.6, 2.3, 3.1], rtol=1e-8, sensitivities=("k", "T"))

    def height(k, T):
        periods, left = run.time // T, T / 2 - run.time % T
        return k * (periods * T**2 / 4 + T**2 / 8 - np.sign(left) * left**2 / 2)

    values = {"k": 2.0, "T": 0.7}
    assert run["y"] == pytest.approx(height(**values), abs=1e-7)
    for name in values:
        truth = _differences(height, values, name)
        assert np.abs(run.sensitivity("y", name) - truth).max() < 1e-6 * np.abs(truth).max()


TIMED = """
model Timed "what happens at times that are parameters"
  parameter Real t0 = 0.4, k = 3, T = 0.35;
  Real x(start = 1, fixed = true);
  Real y(start = 0, fixed = true);
  discrete Real u(start = 0, fixed = true);
equation
  der(x) = -k*x;
  der(y) = u;
  when time > t0 then
    reinit(x, 2*pre(x) + t0);
  end when;
  when sample(0.1, T) then
    u = x;
  end when;
end Timed;
"""


def test_times_that_are_parameters():
    """x = e^{-kt}, behind t0 plus (e^{-k t0} + t0) e^{-k(t - t0)}; y rises with x(0.1), then with x(0.1 + T)."""
    run = lmoc.compile_text(TIMED).simulate(stop=0.7, points=7, rtol=1e-9, sensitivities=("t0", "k", "T"))
    t, k, t0, T = run.time, 3.0, 0.4, 0.35
    late, second = t > t0, t > 0.1 + T
    x = np.exp(-k * t) + late * (np.exp(-k * t0) + t0) * np.exp(-k * (t - t0))
    by_t0 = (1 + k * t0) * np.exp(-k * (t - t0))  # of its part behind t0
    assert run["x"] == pytest.approx(x, rel=1e-8)
    seen = 2 * np.exp(-k * 0.45) + t0 * np.exp(-k * 0.05)
    moved = np.exp(-k * 0.1) - seen - k * seen * (t - 0.45)
    assert run.sensitivity("x", "t0") == pytest.approx(late * by_t0, abs=1e-7)
    assert run.sensitivity("y", "T") == pytest.approx(second * moved, abs=1e-7)
    assert not run.sensitivity("x", "T").any()


def test_a_pendulum_changes_its_coordinates_between_events():
    """With another g there is the same swing in another time, which goes with 1/sqrt(g)."""
    text = (ROOT / "models/planar/pendulum_cartesian.lmo").read_text()
    declared = "\n  discrete Real seen(start = 0, fixed = true);\nequation\n"
    text = text.replace("\nequation", f"{declared}  when x < 0.2 then\n    seen = time;\n  end when;", 1)
    run = lmoc.compile_text(text).simulate(stop=2.2, points=12, rtol=1e-9, sensitivities="g")
    assert len(run.trajectory.segments) > 3 and [event.kind for event in run.events] == ["when"]
    seen = run["seen"]
    assert run.sensitivity("seen", "g") == pytest.approx(-seen / (2 * 9.81), abs=1e-8)
    assert run.sensitivity("x", "g") == pytest.approx(run["vx"] * run.time / (2 * 9.81), abs=1e-6)


@pytest.mark.parametrize(
    ("start", "initial", "then"),
    [("u(start = p, fixed = true)", "", "u = pre(u);"), ("u", "when initial() then u = 2*p - 1; end when;", "")],
)
def test_discrete_values_at_the_start(start, initial, then):
    """x = e^{-ut}, and 2 p e^{-ut} behind x = 1/2, with u = p, or 2 p - 1, which are the same number for p = 1."""
    text = f"model A parameter Real p = 1; Real x(start = 1, fixed = true); discrete Real {start};"
    text += f"equation der(x) = -u*x; {initial} when x < 0.5 then reinit(x, p); {then} end when; end A;"
    run = lmoc.compile_text(text).simulate(stop=1, points=11, rtol=1e-9, sensitivities="p")
    t, own, late = run.time, 2.0 if initial else 1.0, run.time > np.log(2)
    truth = np.exp(-t) * np.where(late, 2 * (1 - own * t), -own * t)
    assert run.sensitivity("x", "p") == pytest.approx(truth, abs=1e-7)


TWO = """
model Two "balls on one floor"
  parameter Real e = 0.8, h = 1, low = 1;
  Mass a(m = 2, g = -9.81, q(start = h, fixed = true), v(start = 0, fixed = true));
  Mass b(m = 1, g = -9.81, q(start = h*low, fixed = true), v(start = 0, fixed = true));
  Fixed floor;
  Stop one(L = 0, e = e);
  Stop two(L = 0, e = 0.5);
equation
  connect(floor.flange, one.a);
  connect(one.b, a.flange);
  connect(floor.flange, two.a);
  connect(two.b, b.flange);
end Two;
"""


def test_events_at_one_instant():
    dae = lmoc.compile_text(TWO)
    run = dae.simulate(stop=0.8, points=9, rtol=1e-9, sensitivities=("e", "h"))
    assert [event.time for event in run.events] == pytest.approx([np.sqrt(2 / 9.81)] * 2)
    for ball, e in (("a", 0.8), ("b", 0.5)):
        truth = _differences(lambda **v: _ball(run.time, **v), {"e": e, "h": 1.0, "g": 9.81}, "h")
        assert run.sensitivity(f"{ball}.q", "h") == pytest.approx(truth, abs=1e-7)
    with pytest.raises(ModelError, match="at one instant only for this value of 'low'"):
        dae.simulate(stop=0.8, points=9, sensitivities="low")


SLIDES = """
model Slides "a point slides along the ground until friction has stopped it"
  import Planar.*;
  inner World world;
  PointMass p(
    m = 2,
    x(start = 0, fixed = true),
    y(start = 0, fixed = true),
    vx(start = 3, fixed = true),
    vy(start = 0, fixed = true));
  Contact ground(mu = 0.4);
equation
  connect(ground.point, p.point);
end Slides;
"""


def test_the_friction_of_a_contact():
    """x = v t - mu g t²/2 until v/(mu g), where it sticks: x = v²/(2 mu g)."""
    asked = ("ground.mu", "world.g")
    run = lmoc.compile_text(SLIDES).simulate(stop=1.2, points=15, rtol=1e-9, sensitivities=asked)
    assert [event.kind for event in run.events] == ["stick"]
    t, mu, g = run.time, 0.4, 9.81
    slides = t < 3 / (mu * g)
    by_mu, by_g = (np.where(slides, -other * t**2 / 2, -9 / (2 * mu * g * own)) for own, other in ((mu, g), (g, mu)))
    assert run.sensitivity("p.x", "ground.mu") == pytest.approx(by_mu, abs=1e-7)
    assert run.sensitivity("p.x", "world.g") == pytest.approx(by_g, abs=1e-7)


@pytest.mark.parametrize(
    ("file", "names", "stop"),
    [
        ("h17_backlash", ("mesh.N",), 0.5),  # a flank pushes as soon as it touches
        ("bungee_jump", ("m",), 4),  # of the elastic string's heat there is nothing but rounding
        ("h16_stick_slip", ("spring.k", "friction.F"), 3),
        ("gear_shift", ("shift",), 3),
        ("h18_freewheel", ("bearing.c",), 2),
        ("../textbook/valve_train", ("k",), 0.03),  # smooth() says that the cam does not jump
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


def test_a_start_on_the_edge_of_sticking_is_refused():
    """The mass moves with the belt: on a belt that is faster or slower, it slips at first."""
    dae = lmoc.compile_text("""model Edge
  parameter Real vb = 0.2;
  Motion belt(q = vb*time);
  DryFriction friction(F = 2, Fstick = 4);
  Spring spring(k = 50);
  Mass mass(m = 1, v(start = 0.2, fixed = true));
  Fixed wall;
equation
  connect(belt.flange, friction.a);
  connect(friction.b, mass.flange);
  connect(wall.flange, spring.a);
  connect(spring.b, mass.flange);
end Edge;""")
    with pytest.raises(lmoc.ModelError, match="on its edge"):
        dae.simulate(stop=0.3, points=4, sensitivities=("vb",))
    assert dae.simulate(stop=0.3, points=4, sensitivities=("spring.k",)).time[-1] == 0.3


EDGE_OF_A_CONDITION = """
model A
  parameter Real p = 0;
  Real x(start = {x0}, fixed = true);
  output Real y(start = 0, fixed = true);
equation
  der(x) = {v};
  der(y) = {rate};
end A;
"""


@pytest.mark.parametrize(
    ("x0", "v", "rate"),
    [("p", 1, "floor(x)"), ("p", -1, "floor(x)"), ("p", 1, "mod(x, 1)"), ("0", 1, "if time > p then 1 else 0")],
)
def test_a_start_on_the_edge_of_a_condition_is_refused(x0, v, rate):
    with pytest.raises(ModelError, match="edge"):
        lmoc.compile_text(EDGE_OF_A_CONDITION.format(x0=x0, v=v, rate=rate)).simulate(stop=0.5, sensitivities="p")


def test_a_start_at_a_kink_that_is_left_has_a_derivative():
    dae = lmoc.compile_text(EDGE_OF_A_CONDITION.format(x0="p", v=-1, rate="if x > 0 then 2*x else x"))
    run = dae.simulate(stop=0.5, points=5, rtol=1e-9, sensitivities="p")
    assert run.sensitivity("y", "p") == pytest.approx(run.time, abs=1e-7)


def test_an_output_at_an_instant_that_moves_has_two_derivatives():
    """x = k t comes to 1 at t = 1/2: y has two there, z has one though it bends, and before and behind each has one."""
    model = "model A parameter Real k = 2; Real x(start = 0, fixed = true), y(start = 0, fixed = true), z(start = 0, "
    model += "fixed = true); equation der(x) = k; der(y) = if x > 1 then 2 else 1; der(z) = if x > 1 then 2*x - 1 else "
    model += "x; end A;"
    dae = lmoc.compile_text(model)
    run = dae.simulate(times=[0, 0.25, 0.5, 1], rtol=1e-9, sensitivities="k")
    assert run.sensitivity("z", "k") == pytest.approx([0, 1 / 32, 1 / 8, 7 / 8], abs=1e-7)
    with pytest.raises(ModelError, match="output time t = 0.5 s"):
        run.sensitivity("y", "k")
    with pytest.raises(ModelError, match="output time t = 0.5 s"):
        dae.simulate(times=[0, 0.25, 0.5], rtol=1e-9, sensitivities="k").sensitivity("y", "k")
    beside = dae.simulate(times=[0, 0.499, 0.501, 1], rtol=1e-9, sensitivities="k")
    assert beside.sensitivity("y", "k") == pytest.approx([0, 0, 1 / 4, 1 / 4], abs=1e-7)


def test_before_the_laws_have_taken_their_modes_none_of_them_is_watched():
    """A stop and a condition: functions of events at the start are those of the condition alone."""
    when = "when ball.q > 0.2 then seen = time; end when;"
    ball = CEILING.replace("equation\n", f"  discrete Real seen;\nequation\n{when}\n")
    occasions: list[Occasion] = []
    request = simulation.Request(RunOptions(stop=0.1), occasions=occasions)
    simulation.simulate(lmoc.compile_text(ball)._session, request)
    first, dynamics = occasions[0], occasions[0].dynamics
    memory, x = first.memory, first.outcome.x
    assert first.segment == START
    discrete = np.zeros(len(memory.plan.reduced.flat.events.discrete))
    dynamics.recall(memory, memory.values, memory.open, memory.push, discrete, 0.0)
    assert dynamics.heights()(np.zeros(1), x[None])[0] == pytest.approx([-0.2])
