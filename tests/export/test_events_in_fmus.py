"""FMUs of scenes with events: the same instants and the same motion as `simulate`, in both kinds and versions."""

from __future__ import annotations

import random
from ctypes import POINTER, c_double
from pathlib import Path

import numpy as np
import pytest
from oracles.fmu import begin, instance, simulated

import lmoc
from lmoc.export.fmu import find_compiler

fmpy = pytest.importorskip("fmpy")
pytestmark = pytest.mark.skipif(find_compiler() is None, reason="there is no C compiler")

MODELS = Path(__file__).parents[2] / "models"
BALL = """
model Ball "a ball that bounces by reinit"
  parameter Real e = 0.8;
  output Real h(start = 1, fixed = true), v(start = 0, fixed = true);
  output Integer n(start = 0, fixed = true);
  output Boolean falls = v < 0;
equation
  der(h) = v;
  der(v) = -9.81;
  when h <= 0 then
    reinit(v, -e*pre(v));
    n = pre(n) + 1;
  end when;
  annotation(experiment(StopTime = 2));
end Ball;
"""
ROOM = """
model Room "a heater with hysteresis, and a thermometer that is read now and then"
  parameter Real period = 0.5;
  output Real T(start = 15, fixed = true);
  output Real seen;
  Boolean on(start = false, fixed = true);
  Integer steps = integer(T/2);
  Real load = if time > 3.3 and time < 3.4 then 20 else 0;
initial equation
  pre(seen) = T;
equation
  der(T) = (if on then 10 else -3) - 0.2*(T - 5) + load;
  when {T < 18, T > 22} then
    on = T < 20;
  end when;
  when sample(0.5, period) then
    seen = T;
  end when;
  annotation(experiment(StopTime = 5));
end Room;
"""
FALL = """
model Fall
  parameter Real deep = 2;
  parameter Real low = -100;
  output Real x(start = 0, fixed = true), v(start = 0, fixed = true);
equation
  der(x) = v;
  der(v) = -10;
  assert(x > low, "it has fallen too low");
  when x < -deep then
    terminate("it is deep enough");
  end when;
  annotation(experiment(StopTime = 4));
end Fall;
"""
SWITCHED = """
model Switched "a block whose equations change"
  output Real u, i, x(start = 0, fixed = true);
  output Integer n(start = 0, fixed = true) "comes to rest at the start alone";
  Boolean closed = time < 1;
equation
  n = if pre(n) < 3 then pre(n) + 1 else 3;
  if closed then u = 0; else i = 0; end if;
  1 = 2*i + x + u;
  der(x) = i;
  annotation(experiment(StopTime = 2));
end Switched;
"""
PULSES = """
model Pulses
  output Integer n(start = 0, fixed = true);
equation
  when sin(40*time) > 0.99 then n = pre(n) + 1; end when;
  annotation(experiment(StopTime = 3));
end Pulses;
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Scenes with events, and their FMUs."""
    folder, found = tmp_path_factory.mktemp("fmu"), {}
    for text, fmi in ((BALL, 3), (ROOM, 2), (FALL, 3), (SWITCHED, 3), (PULSES, 2)):
        dae = lmoc.compile_text(text)
        found[dae.name] = dae, dae.export(folder / f"{dae.name}.fmu", fmi=fmi).path
    return found


def check(dae, path, kind: str, rtol: float, within: float, points: int = 41) -> None:
    """All variables are those of `simulate`."""
    run = dae.simulate(points=points, rtol=1e-9)
    start, stop = run.time[[0, -1]]
    names = [v.name for v in fmpy.read_model_description(str(path)).modelVariables if v.name in dae.variables]
    names = [n for n in names if n not in dae.parameters and not n.startswith("ledger.")]
    found = simulated(
        path, fmi_type=kind, stop_time=stop, relative_tolerance=rtol, output_interval=(stop - start) / (points - 1),
        output=names, record_events=False,
    )  # fmt: skip
    own = found[np.searchsorted(found["time"], run.time - 1e-9 * stop)]
    for name in names:
        size = max(np.abs(run[name]).max(), 1e-3)
        assert np.abs(own[name] - run[name]).max() <= within * size, (name, kind)


@pytest.mark.parametrize("kind", ["ModelExchange", "CoSimulation"])
@pytest.mark.parametrize("name", ["Ball", "Room", "Switched"])
def test_the_motion_is_that_of_simulate(made, name: str, kind: str) -> None:
    from fmpy.validation import validate_fmu

    dae, path = made[name]
    assert validate_fmu(str(path)) == []
    check(dae, path, kind, *((1e-9, 1e-5) if kind == "ModelExchange" else (1e-8, 1e-6)))


def test_elastic_play_and_a_cord_by_relations(tmp_path) -> None:
    for name in ("h17_backlash", "bungee_jump"):
        dae = lmoc.compile(MODELS / f"laws/{name}.lmo")
        check(dae, dae.export(tmp_path / f"{name}.fmu").path, "CoSimulation", 1e-9, 1e-5)


def test_a_short_excursion_within_a_step_is_seen(made) -> None:
    """``sin 40t > 0.99`` begins 3·40/2π times in 3 s, for 7 ms each."""
    _, path = made["Pulses"]
    found = simulated(path, fmi_type="CoSimulation", stop_time=3.0, output_interval=3.0, output=["n"])
    first = np.arcsin(0.99) / 40
    assert found["n"][-1] == len(np.arange(first, 3, 2 * np.pi / 40))


def test_event_indicators_and_event_mode_by_hand(made) -> None:
    """h = 1 - 4.905 t² comes to the floor at t = √(2/9.81); the indicator of ``h <= 0`` changes its sign there."""
    fmu, references = instance(made["Ball"][1], "ModelExchange")
    fmu.enterInitializationMode(startTime=0.0)
    fmu.exitInitializationMode()
    assert fmu.updateDiscreteStates()[:4] == (False, False, False, False)
    fmu.enterContinuousTimeMode()

    def indicators(t: float) -> np.ndarray:
        x = np.array([1 - 9.81 / 2 * t**2, -9.81 * t])
        fmu.setTime(t)
        fmu.setContinuousStates(x.ctypes.data_as(POINTER(c_double)), 2)
        z = np.zeros(2)
        fmu.getEventIndicators(z.ctypes.data_as(POINTER(c_double)), 2)
        return z

    t = np.sqrt(2 / 9.81)
    before, behind = indicators(t - 1e-9), indicators(t + 1e-9)
    assert (before * behind < 0).sum() == 1  # that of ``h <= 0``, not that of ``v < 0``
    fmu.completedIntegratorStep()
    fmu.enterEventMode()
    assert fmu.updateDiscreteStates()[3]  # values of continuous states have changed
    assert fmu.getFloat64([references["v"]]) == pytest.approx([0.8 * 9.81 * t])
    assert fmu.getInt32([references["n"]]) == [1]
    assert fmu.getBoolean([references["falls"]]) == [False]
    fmu.enterContinuousTimeMode()
    fmu.freeInstance()


def test_a_solver_is_begun_anew_where_the_equations_change(made) -> None:
    """Also where no state jumps: masters keep the history of their method unless they are told that values change."""
    fmu, _ = instance(made["Switched"][1], "ModelExchange")
    fmu.enterInitializationMode(startTime=0.0)
    fmu.exitInitializationMode()
    fmu.updateDiscreteStates()
    fmu.enterContinuousTimeMode()
    fmu.setTime(1.0)
    fmu.enterEventMode()
    assert fmu.updateDiscreteStates()[3]
    fmu.freeInstance()


def test_no_ball_falls_through_its_floor(made) -> None:
    """Its bounces are over after 9·√(2/9.81) s, about 4.06 s: there is no motion to be told behind that."""
    from fmpy.fmi1 import FMICallException

    fmu, _ = instance(made["Ball"][1])
    begin(fmu)
    with pytest.raises(FMICallException):
        for k in range(12):
            fmu.doStep(0.5 * k, 0.5)
    assert 0.5 * k <= 9 * np.sqrt(2 / 9.81) < 0.5 * (k + 1)
    fmu.freeInstance()


def test_the_instants_of_samples_are_told(made) -> None:
    fmu, references = instance(made["Room"][1], "ModelExchange")
    fmu.setReal([references["period"]], [0.7])
    begin(fmu, three=False)
    assert fmu.newDiscreteStates()[4:] == (True, 0.5)
    fmu.enterContinuousTimeMode()
    fmu.setTime(0.5)
    fmu.enterEventMode()
    assert fmu.newDiscreteStates()[4:] == (True, pytest.approx(1.2))
    assert fmu.getReal([references["seen"], references["T"]])[0] == 15.0
    fmu.freeInstance()


def test_terminate_and_assertions_end_a_run(made) -> None:
    """A fall of 2 m at 10 m/s² takes √0.4 s, one of 1 m √0.2 s."""
    from fmpy.fmi1 import FMICallException

    fmu, references = instance(made["Fall"][1])
    begin(fmu)
    assert fmu.doStep(0.0, 0.5)[1] is False
    event, terminated, early, reached = fmu.doStep(0.5, 1.0)
    assert terminated and reached == pytest.approx(np.sqrt(0.4), abs=1e-9)
    with pytest.raises(FMICallException):
        fmu.doStep(reached, 1.0)
    fmu.reset()
    fmu.setFloat64([references["low"]], [-1.0])
    begin(fmu)
    with pytest.raises(FMICallException):
        fmu.doStep(0.0, 1.0)
    assert fmu.getFloat64([references["time"]])[0] == pytest.approx(np.sqrt(0.2), abs=1e-9)
    fmu.freeInstance()


def test_a_saved_state_goes_on_to_the_bit_over_events(made) -> None:
    """In the same instance and, serialized, in another one that stands behind other bounces; and after `reset`."""
    one, references = instance(made["Ball"][1])
    other, _ = instance(made["Ball"][1])
    shown = [references["h"], references["v"]]

    def values(fmu) -> tuple:
        return *fmu.getFloat64(shown), *fmu.getInt32([references["n"]])

    begin(one)
    other.setFloat64([references["e"]], [0.7])
    begin(other)
    one.doStep(0.0, 0.6)
    state = one.getFMUState()
    saved = one.serializeFMUState(state)
    one.doStep(0.6, 1.4)
    expected = values(one)
    assert expected[2] > 1
    one.setFMUState(state)
    one.doStep(0.6, 1.4)
    assert values(one) == expected
    other.doStep(0.0, 1.9)
    assert other.getInt32([references["n"]]) != [1]
    other.setFMUState(other.deserializeFMUState(saved))
    other.doStep(0.6, 1.4)
    assert values(other) == expected
    one.freeFMUState(state)
    one.reset()
    begin(one)
    one.doStep(0.0, 0.6)
    one.doStep(0.6, 1.4)
    assert values(one) == expected
    for fmu in (one, other):
        fmu.freeInstance()


def test_discrete_variables_are_read_by_their_type_and_not_set(made) -> None:
    from fmpy.fmi1 import FMICallException

    fmu, references = instance(made["Ball"][1])
    for call in (
        lambda: fmu.getFloat64([references["n"]]),
        lambda: fmu.getInt32([references["h"]]),
        lambda: fmu.setInt32([references["n"]], [3]),
    ):
        with pytest.raises(FMICallException):
            call()
    fmu.freeInstance()


def any_call(fmu, references: list[int], states: list, rng: random.Random, kind: str):
    """One of the calls of FMI, with any value."""
    given = (c_double * 2)()

    def number() -> float:
        return rng.choice([0.0, 1.0, -3.0, 1e300, float("nan"), float("inf")])

    calls = [
        lambda: fmu.enterInitializationMode(startTime=0.0),
        lambda: fmu.exitInitializationMode(),
        lambda: fmu.getFloat64([rng.choice(references)]),
        lambda: fmu.getInt32([rng.choice(references)]),
        lambda: fmu.setFloat64([rng.choice(references)], [number()]),
        lambda: states.append(fmu.getFMUState()),
        lambda: states and fmu.setFMUState(rng.choice(states)),
        lambda: fmu.reset(),
        lambda: fmu.terminate(),
    ]
    if kind == "CoSimulation":
        calls += [lambda: fmu.doStep(fmu.getFloat64([0])[0], rng.choice([0.1, 0.5, -1.0, float("nan")]))] * 4
    else:
        calls += [
            lambda: fmu.enterEventMode(),
            lambda: fmu.updateDiscreteStates(),
            lambda: fmu.enterContinuousTimeMode(),
            lambda: fmu.setTime(3 * rng.random()),
            lambda: fmu.setContinuousStates((c_double * 2)(number(), number()), 2),
            lambda: fmu.getContinuousStateDerivatives(given, 2),
            lambda: fmu.getEventIndicators(given, 2),
            lambda: fmu.completedIntegratorStep(),
        ] * 2
    return rng.choice(calls)


@pytest.mark.parametrize("kind", ["ModelExchange", "CoSimulation"])
def test_calls_in_any_order_get_a_status(made, kind: str) -> None:
    """Also those with values that are no numbers, and of states that are restored elsewhere: nothing crashes."""
    from fmpy.fmi1 import FMICallException

    path = made["Ball"][1]
    references = [v.valueReference for v in fmpy.read_model_description(str(path)).modelVariables]
    answered = refused = 0
    for seed in range(6):
        rng, states = random.Random(seed), []
        fmu, _ = instance(path, kind)
        for _ in range(60):
            try:
                any_call(fmu, references, states, rng, kind)()
                answered += 1
            except FMICallException:
                refused += 1
        fmu.freeInstance()
    assert answered > 30 and refused > 30


FOLLOWS = """
model Follows "a stiff state that follows a drive across a level"
  output Integer n(start = 0, fixed = true);
  Real v(start = 0, fixed = true);
equation
  der(v) = 1e6*(0.3*time - v);
  when v > 1.5 then
    n = pre(n) + 1;
  end when;
  annotation(experiment(StopTime = 10));
end Follows;
"""


def test_what_a_step_leaves_open_of_a_stiff_state_is_no_crossing(tmp_path) -> None:
    """With the states of another tool's steps: off by less than its tolerance leaves open, and then by more."""
    fmu, references = instance(lmoc.compile_text(FOLLOWS).export(tmp_path / "follows.fmu").path, "ModelExchange")
    fmu.enterInitializationMode(tolerance=1e-4, startTime=0.0)
    fmu.exitInitializationMode()
    crossings = []
    for k, v in enumerate([1.4, 1.5001, 1.4999, 1.5001, 1.5, 1.5002, 1.4, 1.6]):
        fmu.enterContinuousTimeMode()
        fmu.setTime(5.0 + 1e-6 * k)
        fmu.setContinuousStates((c_double * 1)(v), 1)
        fmu.completedIntegratorStep()
        fmu.enterEventMode()
        fmu.updateDiscreteStates()
        crossings += fmu.getInt32([references["n"]])
    assert crossings == [0, 1, 1, 1, 1, 1, 1, 2]
    fmu.freeInstance()
