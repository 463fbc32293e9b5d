"""FMUs of scenes with laws: impacts, sticking, release as in `simulate`, with the same events in the same order."""

from __future__ import annotations

import re
from ctypes import c_double
from pathlib import Path

import numpy as np
import pytest
from oracles.between_springs import AMONG, ROW
from oracles.fmu import begin, beside_a_run, instance, simulated

import lmoc
from lmoc.export.fmu import find_compiler

fmpy = pytest.importorskip("fmpy")
pytestmark = pytest.mark.skipif(find_compiler() is None, reason="there is no C compiler")

as_it_is = pytest.mark.usefixtures("fixed_parameters")
MODELS = Path(__file__).parents[2] / "models/laws"
SLIDER = """
model Slider "a block that breaks away, slides against a stop, and whose pull is switched off"
  parameter Real mu(unit = "N") = 2;
  output Real x(unit = "m") = m.q, v(unit = "m/s") = m.v;
  output Integer n(start = 0, fixed = true);
  Boolean on = time < 1.5;
  Fixed wall;
  Mass m(m = 1, q(start = 0, fixed = true), v(start = 0, fixed = true));
  DryFriction f(F = mu, Fstick = 1.5*mu);
  Stop s(L = -1, e = 0.5);
  Force pull(f = if on then 4*time else 0);
equation
  connect(wall.flange, f.a); connect(f.b, m.flange);
  connect(m.flange, s.a); connect(s.b, wall.flange);
  connect(pull.flange, m.flange);
  when x > 0.5 then n = pre(n) + 1; end when;
  annotation(experiment(StopTime = 2));
end Slider;
"""
BALL = """
model Ball "a ball on a floor"
  parameter Real e = 0.7;
  output Real h(unit = "m") = b.q;
  Fixed floor;
  Mass b(m = 1, g = -9.81, q(start = 1, fixed = true), v(start = 0, fixed = true));
  Stop s(L = 0, e = e);
equation
  connect(floor.flange, s.a); connect(s.b, b.flange);
  annotation(experiment(StopTime = 3));
end Ball;
"""
THROWN = """
model Thrown "a point thrown onto a rough slope: it bounces, slides and sticks"
  import Planar.*;
  inner World world;
  PointMass p(m = 1.3, x(start = 0, fixed = true), y(start = 0.4, fixed = true), vx(start = 1, fixed = true),
    vy(start = 0, fixed = true));
  Contact c(nx = -sin(0.2), ny = cos(0.2), mu = 0.5, e = 0.4);
  Force f(fx = 2*sin(3*time), fy = 0);
equation
  connect(c.point, p.point); connect(f.point, p.point);
  annotation(experiment(StopTime = 3));
end Thrown;
"""
LIFT = """
model Lift "a load on a table whose height is given from outside"
  input Real u(unit = "m");
  output Real v(unit = "m/s") = b.v;
  output Real gap(unit = "m") = s.gap;
  Motion table(q = u);
  Mass b(m = 1, g = -9.81, q(start = 0, fixed = true), v(start = 0, fixed = true));
  Stop s(L = 0, e = 0);
equation
  connect(table.flange, s.a); connect(s.b, b.flange);
  annotation(experiment(StopTime = 1));
end Lift;
"""
BELT = """
model Belt "a block on a belt that is switched on"
  output Real v(unit = "m/s") = m.v;
  Boolean on = time > 1;
  Real x(start = 0, fixed = true, unit = "m");
  Mass m(m = 1, q(start = 0, fixed = true), v(start = 0, fixed = true));
  Motion belt(q = x);
  DryFriction f(F = 2);
equation
  der(x) = if on then 1 else 0;
  connect(belt.flange, f.a); connect(f.b, m.flange);
  annotation(experiment(StopTime = 2));
end Belt;
"""
REST = """
model Rest "a ball that falls onto a floor whose height is a parameter, and stays there"
  parameter Real d(unit = "m") = 0;
  output Real gap(unit = "m") = s.gap;
  Fixed floor;
  Mass b(m = 1, g = -9.81, q(start = 0.5, fixed = true), v(start = 0, fixed = true));
  Stop s(L = d, e = 0);
equation
  connect(floor.flange, s.a); connect(s.b, b.flange);
  annotation(experiment(StopTime = 2));
end Rest;
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Scenes with laws, and their FMUs."""
    folder, found = tmp_path_factory.mktemp("fmu"), {}
    for text, fmi in ((SLIDER, 3), (BALL, 2)):
        dae = lmoc.compile_text(text)
        found[dae.name] = dae, dae.export(folder / f"{dae.name}.fmu", fmi=fmi).path
    return found


def told(path: Path, end: float, steps: int) -> tuple[object, dict[str, int], list[tuple[str, ...]]]:
    """A co-simulation at its end, and what it has told of events: (law, kind), in order."""
    lines: list[bytes] = []
    fmu, references = instance(path, debug_logging=True, logger=lambda *given: lines.append(given[-1]))
    begin(fmu, hasattr(fmu, "enterStepMode"))
    for k in range(steps):
        fmu.doStep(currentCommunicationPoint=k * end / steps, communicationStepSize=end / steps)
    found = [re.match(r"t = \S+ s: (.*): (.*), impulse", line.decode()) for line in lines]
    return fmu, references, [match.groups() for match in found if match]


def of_laws(run) -> list[tuple[str, str]]:
    return [(e.name, e.kind) for e in run.events if e.kind not in ("when", "time", "relation", "change")]


@pytest.mark.parametrize("steps", [10, 1000])
def test_what_happens_is_what_happens_in_a_run(made, steps: int) -> None:
    """Break away, hit, bounce, with a counter and a switch of events beside the laws."""
    dae, path = made["Slider"]
    run = dae.simulate(rtol=1e-9)
    fmu, references, events = told(path, 2.0, steps)
    assert events == of_laws(run) and {kind for _, kind in events} >= {"slip", "impact"}
    values = fmu.getFloat64([references[name] for name in ("x", "v")])
    assert values == pytest.approx([run["x"][-1], run["v"][-1]], abs=1e-5)
    assert fmu.getInt32([references["n"]]) == [run["n"][-1]]
    fmu.terminate()
    fmu.freeInstance()


@pytest.mark.parametrize("kind", ["ModelExchange", "CoSimulation"])
@pytest.mark.parametrize("name", ["Slider", "Ball"])
def test_the_motion_is_that_of_simulate(made, name: str, kind: str) -> None:
    from fmpy.validation import validate_fmu

    dae, path = made[name]
    assert validate_fmu(str(path)) == []
    run, own = beside_a_run(dae, path, kind)
    within = 1e-4 if kind == "ModelExchange" else 1e-5  # where bounces end follows from the tolerance
    for output in dae.outputs:
        assert np.abs(own[output] - run[output]).max() <= within * max(np.abs(run[output]).max(), 1e-3), output


def test_a_ball_bounces_by_the_quotients_of_its_restitution(made) -> None:
    """It comes down after √(2/g), and bounces end at √(2/g)·(1 + 2·Σ eᵏ): with e = 0.5, set in the FMU, at 1.355 s."""
    _, path = made["Ball"]
    end = np.sqrt(2 / 9.81) * (1 + 2 * 0.5 / 0.5)
    found = simulated(
        path, fmi_type="CoSimulation", stop_time=3.0, output_interval=0.01, start_values={"e": 0.5}, output=["h"]
    )
    t, h = found["time"], found["h"]
    assert (h[t > end + 1e-6] == 0.0).all() and (h[(t < end - 0.02)] >= 0.0).all()
    top = h[(t > np.sqrt(2 / 9.81)) & (t < end)].max()
    assert top == pytest.approx(0.25, abs=1e-4)


@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
def test_bounces_that_another_tool_does_not_resolve_are_foreseen(made, rtol: float) -> None:
    """Each is slower by the restitution than the last one, down to 1e-9 m/s; CVode alone at 1e-8 sees 27 of 62."""
    dae, path = made["Ball"]
    found = simulated(
        path, fmi_type="ModelExchange", stop_time=3.0, output_interval=0.1, relative_tolerance=rtol, output=["b.v"],
    )  # fmt: skip
    v, at_once = np.asarray(found["b.v"]), np.diff(found["time"]) == 0
    left = v[1:][at_once & (v[1:] > 0) & (v[:-1] < 0)]
    if rtol < 1e-6:  # early errors of the other one change the speed of all bounces to come
        assert len(left) == len(dae.simulate(points=2).events) - 1, "and the last one ends at rest"
    low = left < 1e-3
    assert low.sum() > 30 and left[-1] < 2e-9
    assert left[low][1:] / left[low][:-1] == pytest.approx(0.7, rel=1e-5), "time is rounded to 1e-6 of the last one"


def test_a_foreseen_hop_takes_its_closed_form_and_outlives_a_saved_state(made) -> None:
    """2ev/g, then e times that, in another instance that knows of it from bytes. A ball that somebody has caught
    meanwhile stays where it is."""

    def event(fmu, time: float, x: list[float]) -> tuple[float, list[float]]:
        fmu.setTime(time)
        fmu.setContinuousStates((c_double * 2)(*x), 2)
        fmu.enterEventMode()
        *_, told, upcoming = fmu.newDiscreteStates()
        fmu.enterContinuousTimeMode()
        fmu.getContinuousStates(found := (c_double * 2)(), 2)
        return upcoming if told else np.inf, list(found)

    path, v = made["Ball"][1], 1e-4
    fmu, other = (instance(path, "ModelExchange")[0] for _ in range(2))
    for one in (fmu, other):
        begin(one, False)
        one.newDiscreteStates()
        one.enterContinuousTimeMode()
    first, x = event(fmu, 0.5, [-1e-13, -v])
    assert (first - 0.5, x) == (pytest.approx(2 * 0.7 * v / 9.81, rel=1e-9), [0.0, pytest.approx(0.7 * v)])
    state = fmu.getFMUstate()
    other.setFMUstate(other.deSerializeFMUstate(fmu.serializeFMUState(state)))
    for one in (fmu, other):
        second, x = event(one, first, [2e-14, -0.69 * v])  # what another tool has made of it
        assert [second - first, x[1]] == pytest.approx([2 * 0.49 * v / 9.81, 0.49 * v], rel=1e-9)
    fmu.setFMUstate(state)
    assert event(fmu, first, [0.5, 0.0]) == (np.inf, [0.5, 0.0])
    for one in (fmu, other):
        one.terminate()
        one.freeInstance()


@pytest.mark.parametrize("rtol, within", [(1e-3, None), (1e-8, 1e-3)])
def test_bounces_end_where_another_tool_no_longer_tells_them_from_none(made, rtol: float, within: float | None) -> None:
    """The FMU is not told how finely CVode integrates, and sees it: a coarse one ends with the ball at rest, not below
    its floor, which is not at zero. In closed form."""
    end, first = np.sqrt(2 / 9.81) * (1 + 2 * 0.7 / (1 - 0.7)), np.sqrt(2 / 9.81)
    found = simulated(
        made["Ball"][1], fmi_type="ModelExchange", stop_time=3.0, output_interval=0.002, relative_tolerance=rtol,
        start_values={"b.q": 1.5, "s.L": 0.5}, output=["b.q", "b.v"], record_events=False,
    )  # fmt: skip
    assert (found["b.q"][found["time"] > 2.8], found["b.v"][-1]) == (pytest.approx(0.5, abs=1e-12), 0.0)
    leave, speed = first + 2 * first * np.cumsum([0, *0.7 ** np.arange(1, 40)]), 9.81 * first * 0.7 ** np.arange(1, 41)
    t = found["time"][(found["time"] > first) & (found["time"] < end)]
    k = np.searchsorted(leave, t) - 1
    exact = speed[k] - 9.81 * (t - leave[k])
    own = found["b.v"][(found["time"] > first) & (found["time"] < end)]
    assert within is None or np.abs(own - exact).max() < within * 9.81 * first


def test_a_saved_state_goes_on_to_the_bit(made) -> None:
    """Saved between two bounces, serialized, and restored after the ball has come to rest."""
    _, path = made["Ball"]
    fmu, references, _ = told(path, 0.9, 9)
    state = fmu.getFMUstate()
    bits = fmu.serializeFMUState(state)
    ends = []
    for _ in range(2):
        for k in range(5):
            fmu.doStep(currentCommunicationPoint=0.9 + 0.1 * k, communicationStepSize=0.1)
        ends.append(fmu.getReal([references["h"], references["b.v"]]))
        fmu.setFMUstate(fmu.deSerializeFMUstate(bits))
    assert ends[0] == ends[1] and ends[0][0] > 0
    fmu.terminate()
    fmu.freeInstance()


@as_it_is
def test_what_is_closed_stays_closed_in_the_plane(tmp_path) -> None:
    """A string has a gap that is not linear in the states there; contact friction has the normal force for a limit."""
    for dae in (lmoc.compile(MODELS / "h07_ball_on_string.lmo"), lmoc.compile_text(THROWN)):
        run = dae.simulate(rtol=1e-9)
        path = dae.export(tmp_path / f"{dae.name}.fmu", type="cs").path
        fmu, references, events = told(path, float(run.time[-1]), 7)
        assert events == of_laws(run)
        values = fmu.getFloat64([references[n] for n in dae.states if n in references])
        assert values == pytest.approx([run[n][-1] for n in dae.states if n in references], abs=2e-5)
        fmu.terminate()
        fmu.freeInstance()


def test_a_start_beyond_a_stop_has_no_values(made) -> None:
    """Not even where it is asked again, before the start is set otherwise."""
    fmu, references = instance(made["Slider"][1])
    fmu.enterInitializationMode(startTime=0.0)
    fmu.setFloat64([references["m.q"]], [2.0])
    for _ in range(2):
        with pytest.raises(Exception, match="error"):
            fmu.getFloat64([references["s.f"]])
    fmu.setFloat64([references["m.q"]], [0.5])
    assert fmu.getFloat64([references["s.f"]]) == [0.0]
    fmu.freeInstance()


def test_what_lies_on_an_input_moves_with_it(tmp_path) -> None:
    """At the start the input is zero: its velocity is no constant of the motion for that."""
    path = lmoc.compile_text(LIFT).export(tmp_path / "Lift.fmu", fmi=3).path
    fmu, references = instance(path)
    begin(fmu)
    inputs = [references[name] for name in ("u", "der(u)", "der(der(u))")]
    for k in range(10):
        t = 0.1 * k
        fmu.setFloat64(inputs, [0.5 * t * t, t, 1.0])
        fmu.doStep(currentCommunicationPoint=t, communicationStepSize=0.1)
    fmu.setFloat64(inputs, [0.5, 1.0, 1.0])
    fmu.doStep(currentCommunicationPoint=1.0, communicationStepSize=1e-9)
    assert fmu.getFloat64([references["v"], references["gap"]]) == pytest.approx([1.0, 0.0], abs=1e-6)
    fmu.terminate()
    fmu.freeInstance()


def test_what_an_event_moves_on_is_not_thrown(tmp_path) -> None:
    """The belt jumps to its speed: its friction accelerates the block, until both are as fast."""
    path = lmoc.compile_text(BELT).export(tmp_path / "Belt.fmu", fmi=3).path
    fmu, references, events = told(path, 1.25, 5)
    assert events == [("f", "slip")]
    assert fmu.getFloat64([references["v"]]) == pytest.approx([0.5], abs=1e-6)
    fmu.terminate()
    fmu.freeInstance()


def test_what_a_parameter_moves_is_open_or_refused(tmp_path) -> None:
    """The floor sinks by 0.1 m under a ball at rest, which falls; it cannot rise through it."""
    path = lmoc.compile_text(REST).export(tmp_path / "Rest.fmu", fmi=3).path
    for height, left in ((-0.1, 0.1 - 0.5 * 9.81 * 0.1**2), (0.1, None)):
        fmu, references, _ = told(path, 1.0, 1)
        fmu.setFloat64([references["d"]], [height])
        if left is None:
            with pytest.raises(Exception, match="error"):
                fmu.doStep(currentCommunicationPoint=1.0, communicationStepSize=0.1)
        else:
            fmu.doStep(currentCommunicationPoint=1.0, communicationStepSize=0.1)
            assert fmu.getFloat64([references["gap"]]) == pytest.approx([left], abs=1e-9)
            fmu.terminate()
        fmu.freeInstance()


@as_it_is
def test_a_string_in_a_linkage_stops_its_rocker(tmp_path) -> None:
    """The closures of its loop are solved by iteration: also where the laws are judged, wherever a step has led."""
    text = (MODELS.parent / "planar/four_bar.lmo").read_text(encoding="utf-8")
    string = "Anchor nail(x = 0.2, y = 1.2); PointOf tip(rx = 0, ry = 0); Cable string(L = 0.8, e = 0.3);"
    wires = "connect(nail.point, string.a); connect(string.b, tip.point); connect(tip.frame, rocker.b);"
    text = text.replace("equation\n", f"{string}\nequation\n{wires}\n", 1)
    text = text.replace(".TorsionDamper friction(c = 0.5)", ".BearingFriction friction(tau = 1)")
    dae = lmoc.compile_text(text.replace("StopTime = 5", "StopTime = 2"))
    run = dae.simulate(rtol=1e-8)
    path = dae.export(tmp_path / "scene.fmu").path
    fmu, references, events = told(path, 2.0, 7)
    assert events == of_laws(run) and {kind for _, kind in events} == {"impact", "reversal"}
    values = fmu.getFloat64([references[n] for n in dae.outputs])
    assert values == pytest.approx([run[n][-1] for n in dae.outputs], abs=1e-5)
    fmu.terminate()
    fmu.freeInstance()


@as_it_is
@pytest.mark.parametrize(
    "text, kind, fmi",
    [(ROW, "ModelExchange", 3), (AMONG, "ModelExchange", 2), (AMONG, "CoSimulation", 3), (ROW, "CoSimulation", 2)],
)  # fmt: skip
def test_friction_between_springs(tmp_path, text: str, kind: str, fmi: int) -> None:
    """Its forces are states, which give way at once where those of others rise without end."""
    dae = lmoc.compile_text(text.replace("\nend", "\n  annotation(experiment(StopTime = 2));\nend"))
    path = dae.export(tmp_path / "scene.fmu", fmi=fmi).path
    run, own = beside_a_run(dae, path, kind)
    for name in dae.states:
        assert np.abs(own[name] - run[name]).max() <= 2e-5 * max(np.abs(run[name]).max(), 1e-3), name
