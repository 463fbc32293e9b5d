"""Mechanisms whose minimal coordinates change along the motion, as FMUs in all coordinates of their loops."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.drag_link import DRAG_LINK, rocker
from oracles.fmu import begin, instance, simulated

import lmoc
from lmoc.export.fmu import find_compiler

fmpy = pytest.importorskip("fmpy")
pytestmark = pytest.mark.skipif(find_compiler() is None, reason="there is no C compiler")

as_it_is = pytest.mark.usefixtures("fixed_parameters")
MODELS = Path(__file__).parents[2] / "models"
RTOL = 1e-6
PENDULUM = """
model P
  {0} Real u(unit = "m"){1} "where the rod hangs";
  Real x(start = 0, fixed = true), y(start = -1), vx(start = 7.1, fixed = true), vy, T;
  {2}
equation
  der(x) = vx;
  der(y) = vy;
  der(vx) = -T*x;
  der(vy) = -T*(y - u) - 9.81;
  x^2 + (y - u)^2 = 1;
  {3}
  annotation(experiment(StopTime = 2));
end P;
"""


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory):
    """A particle on a rod in Cartesian coordinates, which swings over the top, and its FMUs of both versions."""
    dae = lmoc.compile(MODELS / "hard/h01_cartesian_pendulum.lmo")
    folder = tmp_path_factory.mktemp("loops")
    return dae, {fmi: dae.export(folder / f"pendulum{fmi}.fmu", fmi=fmi) for fmi in (3, 2)}


def differs(run, found, names) -> float:
    """The largest difference, as a share of the size of each variable."""
    own = found[np.searchsorted(found["time"], run.time - 1e-9 * run.time[-1])]
    return max(np.abs(own[n] - run[n]).max() / np.abs(run[n]).max() for n in names)


@pytest.mark.parametrize("fmi", [3, 2])
def test_over_the_top(pendulum, fmi: int) -> None:
    """Neither x nor y is a coordinate all the way: as `simulate` does it, with few and many communication steps."""
    from fmpy.validation import validate_fmu

    dae, made = pendulum
    assert validate_fmu(str(made[fmi].path)) == []
    run = dae.simulate(points=101, rtol=1e-10)
    ways = ("ModelExchange", 100, RTOL / 100), ("CoSimulation", 100 // (1 if fmi == 3 else 10), RTOL)
    for kind, steps, rtol in ways:
        found = simulated(
            made[fmi].path, fmi_type=kind, stop_time=10.0, output_interval=10 / steps, relative_tolerance=rtol,
            output=["x", "y", "vx", "vy", "T"],
        )  # fmt: skip
        assert np.abs(np.hypot(found["x"], found["y"]) - 1).max() < (1e-12 if kind == "CoSimulation" else 1e-6)
        every = run if steps == 100 else dae.simulate(points=steps + 1, rtol=1e-10)
        assert differs(every, found, ("x", "y", "vx", "vy", "T")) < 100 * RTOL, (kind, steps)


def test_parameters_and_starts_close_the_loop_elsewhere(pendulum) -> None:
    """A longer rod, and a start at another place with another speed: y and vy follow from what is set."""
    dae, made = pendulum
    run = dae.simulate(stop=2, points=3, parameters={"L": 1.7}, initial={"x": -0.6, "vx": 4.0}, rtol=1e-10)
    found = simulated(
        made[3].path, fmi_type="CoSimulation", stop_time=2.0, output_interval=1.0, relative_tolerance=1e-9,
        start_values={"L": 1.7, "x": -0.6, "vx": 4.0}, output=["x", "y", "vx", "vy"],
    )  # fmt: skip
    assert found["y"][0] == pytest.approx(-np.sqrt(1.7**2 - 0.36), rel=1e-12)
    assert differs(run, found, ("x", "y", "vx", "vy")) < 1e-6


def test_continuous_states_in_initialization_are_those_of_what_has_been_set(pendulum) -> None:
    """As `getFloat64` gives them, whichever is asked first."""
    import ctypes

    fmu, references = instance(pendulum[1][3].path, "ModelExchange")
    fmu.enterInitializationMode(startTime=0.0)
    fmu.setFloat64([references["L"], references["x"]], [1.7, 0.8])
    x = (ctypes.c_double * 4)()
    fmu.getContinuousStates(x, 4)
    assert np.hypot(x[0], x[2]) == pytest.approx(1.7, rel=1e-12) and x[0] == 0.8
    assert list(x) == fmu.getFloat64([references[n] for n in ("x", "vx", "y", "vy")])
    fmu.freeInstance()


def test_what_follows_cannot_be_set_and_no_rod_grows_on_the_way(pendulum) -> None:
    from fmpy.fmi1 import FMICallException

    fmu, references = instance(pendulum[1][3].path)
    with pytest.raises(FMICallException):
        fmu.setFloat64([references["y"]], [-0.9])  # follows from x
    begin(fmu)
    fmu.doStep(0.0, 0.1)
    with pytest.raises(FMICallException):
        fmu.setFloat64([references["L"]], [1.1])
    fmu.setFloat64([references["g"]], [1.62])
    fmu.freeInstance()
    fmu, references = instance(pendulum[1][3].path)
    fmu.setFloat64([references["x"]], [1.5])  # longer than the rod
    with pytest.raises(FMICallException):
        begin(fmu)
    fmu.freeInstance()


def test_a_state_saved_in_the_middle_goes_on_to_the_bit(pendulum) -> None:
    """Serialized into another instance, which has gone elsewhere; and again from the start after a reset."""
    one, references = instance(pendulum[1][3].path)
    other, _ = instance(pendulum[1][3].path)
    x = [references[n] for n in ("x", "y", "vx", "vy", "T")]
    other.setFloat64([references["L"]], [1.3])
    for fmu in (one, other):
        begin(fmu)
    one.doStep(0.0, 1.1)
    saved = one.serializeFMUState(one.getFMUState())
    one.doStep(1.1, 3.0)
    expected = one.getFloat64(x)
    other.doStep(0.0, 1.7)
    other.setFMUState(other.deserializeFMUState(saved))
    other.doStep(1.1, 3.0)
    assert other.getFloat64(x) == expected
    one.reset()
    begin(one)
    one.doStep(0.0, 1.1)
    one.doStep(1.1, 3.0)
    assert one.getFloat64(x) == expected
    for fmu in (one, other):
        fmu.freeInstance()


@as_it_is
def test_a_crank_passes_near_its_change_point(tmp_path) -> None:
    """Turns of a four-bar, whose crossed branch is close by."""
    dae = lmoc.compile(MODELS / "hard/h03_four_bar.lmo")
    made = dae.export(tmp_path / "four_bar.fmu")
    run = dae.simulate(stop=8, points=101, rtol=1e-9)
    names = ("theta", "omega", "phi", "k")
    ways = ("CoSimulation", RTOL, 10, 100 * RTOL), ("CoSimulation", 1e-8, 100, 1e-6), ("ModelExchange", 1e-9, 100, 1e-4)
    for kind, rtol, steps, allowed in ways:
        found = simulated(
            made.path, fmi_type=kind, stop_time=8.0, output_interval=8 / steps, relative_tolerance=rtol,
            output=list(names),
        )  # fmt: skip
        every = run if steps == 100 else dae.simulate(stop=8, points=steps + 1, rtol=1e-9)
        assert differs(every, found, names) < allowed, (kind, rtol, steps)


def test_values_far_from_those_of_the_scene_are_told_of(tmp_path) -> None:
    """The guide of a slider crank turned round is closed in another way than by `simulate`; a crank of another length
    is not. One that is longer than its rod comes to rest for ever where the rod stands across, in one long step."""
    made = lmoc.compile(MODELS / "hard/h04_slider_crank.lmo").export(tmp_path / "crank.fmu")
    said: list[bytes] = []
    options = {"fmi_type": "CoSimulation", "stop_time": 0.01, "output_interval": 0.01, "output": ["cylinder.s"]}
    for name, value, first in (("r", 0.3, 1.3), ("cylinder.nx", -1.0, -1.5)):
        values = {name: value}
        found = fmpy.simulate_fmu(str(made.path), start_values=values, logger=lambda *a: said.append(a[-1]), **options)
        assert found["cylinder.s"][0] == pytest.approx(first, rel=1e-9)
        assert len(said) == (name == "cylinder.nx"), said
    assert b"in another way" in said[0]
    with pytest.raises(fmpy.fmi1.FMICallException):
        values = {"r": 50.0}
        fmpy.simulate_fmu(str(made.path), start_values=values, logger=lambda *a: said.append(a[-1]), **options)
    assert b"no longer tell where it goes" in said[-1]


EVENTS = """
model Switching
  {}
  Real fn, gap, tau, w;
  discrete Integer turns(start = 0, fixed = true);
equation
  {}
  gap = 0.6 - {};
  Law.unilateral(fn, gap);
  Law.dryFriction(tau, w, 2, 2.5);
  when {} > 0.1 then turns = pre(turns) + 1; end when;
  annotation(experiment(StopTime = 3));
end Switching;
"""
IN_X_AND_Y = EVENTS.format(
    "Real x(start = 0, fixed = true), y(start = -1), vx(start = -9, fixed = true), vy, T;",
    "der(x) = vx; der(y) = vy; x^2 + y^2 = 1; w = x*vy - y*vx; "
    "der(vx) = -T*x - fn - y*(tau + 9); der(vy) = -T*y - 9.81 + x*(tau + 9);", "x", "y",
)  # fmt: skip
BY_ANGLE = EVENTS.format(
    "Real theta(start = 0, fixed = true), omega(start = -9, fixed = true);",
    "w = omega; der(theta) = omega; der(omega) = tau + 9 - 9.81*sin(theta) - fn*cos(theta);",
    "sin(theta)", "-cos(theta)",
)  # fmt: skip
REINIT = "when x > 0.5 then reinit(vx, 0.9*pre(vx)); end when;"
SLOWED = """
model Slowed
  Real theta(start = 0, fixed = true), omega(start = 7.1, fixed = true);
equation
  der(theta) = omega; der(omega) = -9.81*sin(theta);
  when sin(theta) > 0.5 then reinit(omega, 0.9*pre(omega)); end when;
  annotation(experiment(StopTime = 2));
end Slowed;
"""


@as_it_is
@pytest.mark.parametrize(
    ("fmi", "text", "by_angle", "happens"),
    [(2, IN_X_AND_Y, BY_ANGLE, 4),  # thrown up backwards against friction and a torque, it comes to rest at a wall
     (3, PENDULUM.format("parameter", " = 0", "", REINIT), SLOWED, 2)],
)  # fmt: skip
def test_laws_and_events_where_coordinates_change(fmi, text, by_angle, happens, tmp_path) -> None:
    """A pendulum in x and y against the same with its angle as the coordinate, in which nothing has to change."""
    from fmpy.validation import validate_fmu

    run = lmoc.compile_text(by_angle).simulate(points=101, rtol=1e-10)
    theta, omega = run["theta"], run["omega"]
    expected = {"x": np.sin(theta), "y": -np.cos(theta), "vx": omega * np.cos(theta), "vy": omega * np.sin(theta)}
    made = lmoc.compile_text(text).export(tmp_path / "scene.fmu", fmi=fmi)
    assert validate_fmu(str(made.path)) == []
    assert len(run.events) >= happens
    for kind, steps, rtol in (("ModelExchange", 100, 1e-8), ("CoSimulation", 10, RTOL)):
        found = simulated(
            made.path, fmi_type=kind, stop_time=run.time[-1], output_interval=run.time[-1] / steps,
            relative_tolerance=rtol, output=list(expected), record_events=False,
        )  # fmt: skip
        own = found[np.searchsorted(found["time"], run.time[:: 100 // steps] - 1e-9)]
        for name, values in expected.items():
            there = values[:: 100 // steps]
            assert np.abs(own[name] - there).max() < 100 * RTOL * np.abs(there).max(), (kind, steps, name)


BESIDE = """
Real h = if time < 0.7 then 0 else 0.1 + 0.3*(time - 0.7);
Motion road(q = h); Spring s(k = 100, d0 = 0); Damper d(c = 2);
Mass m(m = 1, q(start = 0, fixed = true), v(start = 0, fixed = true));
equation connect(road.flange, s.a); connect(s.b, m.flange); connect(road.flange, d.a); connect(d.b, m.flange);
"""


@as_it_is
@pytest.mark.parametrize(
    ("fmi", "parts"),
    [(2, ("input", " = if time < 0.9 then 0.2*time else 0.18 - 0.5*(time - 0.9)", "", "")),  # the pivot turns back
     (3, ("parameter", " = 0", BESIDE, ""))],
)  # fmt: skip
def test_what_is_prescribed_may_jump(fmi, parts, tmp_path) -> None:
    """By impulses, also in all coordinates; what the other tool accepts at a kink has the velocities before it."""
    dae = lmoc.compile_text(PENDULUM.format(*parts))
    run, made = dae.simulate(points=11, rtol=1e-10), dae.export(tmp_path / "scene.fmu", fmi=fmi)
    assert [e.time for e in run.events if e.kind == "step"] == [0.7 if fmi == 3 else 0.9]
    assert len({s.observer.plan for s in run.trajectory.segments}) > 1  # its coordinates change
    for kind, rtol in ("ModelExchange", 1e-8), ("CoSimulation", RTOL):
        found = simulated(
            made.path, fmi_type=kind, stop_time=2.0, output_interval=0.2, relative_tolerance=rtol,
            output=list(dae.states) + ["x", "y", "vx", "vy"], record_events=False,
        )  # fmt: skip
        assert differs(run, found, {*dae.states, "x", "y", "vx", "vy"}) < 10 * RTOL, kind


@pytest.mark.parametrize(
    ("parts", "why"),
    [(("parameter", " = 0", "", "when x > 0.5 then reinit(y, pre(y)); end when;"), "`reinit` sets 'y' in a closed"),
     (("input", "", "", ""), "follow the input 'u'")],
)  # fmt: skip
def test_what_cannot_be_exported_is_refused_by_name(parts: tuple[str, ...], why: str, tmp_path) -> None:
    with pytest.raises(lmoc.ModelError) as caught:
        lmoc.compile_text(PENDULUM.format(*parts)).export(tmp_path / "scene.fmu")
    (found,) = caught.value.diagnostics
    assert found.code == "E0669" and "its coordinates change along the motion" in found.message and why in found.message
    assert not list(tmp_path.iterdir())


def test_a_rocker_turns_with_its_crank_however_long_the_communication_step(tmp_path) -> None:
    """Nothing asks for short steps: its states are a steady turn, and Newton's method found the rocker turns away."""
    b, c = 1.4, 1.05
    dae = lmoc.compile_text(DRAG_LINK.format(g=0, b=b, c=c, when="time > 100"))
    made = dae.export(tmp_path / "link.fmu")
    for steps in 1, 4:
        found = simulated(made.path, fmi_type="CoSimulation", stop_time=8, output_interval=8 / steps, output=["phi"])
        expected = rocker(1.5 + 6 * np.linspace(0, 8, 4001), b, c)[-1]
        assert found["phi"][-1] == pytest.approx(expected, abs=1e-9)
