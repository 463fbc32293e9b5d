"""Mechanisms whose minimal coordinates change along the motion, as FMUs in all coordinates of their loops."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.fmu import begin, instance, simulated

import lmoc
from lmoc.export.fmu import find_compiler

fmpy = pytest.importorskip("fmpy")
pytestmark = pytest.mark.skipif(find_compiler() is None, reason="there is no C compiler")

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


def test_a_crank_passes_near_its_change_point(tmp_path) -> None:
    """Several turns of a four-bar, whose crossed branch is close by."""
    dae = lmoc.compile(MODELS / "hard/h03_four_bar.lmo")
    made = dae.export(tmp_path / "four_bar.fmu")
    run = dae.simulate(stop=20, points=101, rtol=1e-9)
    names = ("theta", "omega", "phi", "k")
    ways = ("CoSimulation", RTOL, 10, 100 * RTOL), ("CoSimulation", 1e-8, 100, 1e-6), ("ModelExchange", 1e-9, 100, 1e-4)
    for kind, rtol, steps, allowed in ways:
        found = simulated(
            made.path, fmi_type=kind, stop_time=20.0, output_interval=20 / steps, relative_tolerance=rtol,
            output=list(names),
        )  # fmt: skip
        every = run if steps == 100 else dae.simulate(stop=20, points=steps + 1, rtol=1e-9)
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


@pytest.mark.parametrize(
    ("parts", "why"),
    [(("parameter", " = 0", "discrete Real n(start = 0, fixed = true);", "when x > 0.5 then n = pre(n) + 1; end when;"),
      "laws or events"),
     (("input", "", "", ""), "follow the input 'u'")],
)  # fmt: skip
def test_what_cannot_be_exported_is_refused_by_name(parts: tuple[str, ...], why: str, tmp_path) -> None:
    with pytest.raises(lmoc.ModelError) as caught:
        lmoc.compile_text(PENDULUM.format(*parts)).export(tmp_path / "scene.fmu")
    (found,) = caught.value.diagnostics
    assert found.code == "E0669" and "its coordinates change along the motion" in found.message and why in found.message
    assert not list(tmp_path.iterdir())
