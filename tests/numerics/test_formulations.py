"""Formulations of closed loops: the same motion from each, and what tells them apart."""

import json
import re

import numpy as np
import pytest
from conftest import ROOT
from oracles.models import PARALLELOGRAM, compiled, compiled_text
from scipy.integrate import solve_ivp

import lmoc
from lmoc.ir.flat import Kind
from lmoc.numerics.options.options import FORMULATIONS

SCENES = ROOT / "models"
ACCURATE = [name for name in FORMULATIONS if name != "index3"]
PENDULUM = """
model Pendulum
  Real x(start = 1, fixed = true), y(start = 0), vx, vy(start = 0, fixed = true), T;
equation
  der(x) = vx; der(y) = vy; der(vx) = -T*x; der(vy) = -T*y - 9.81; x^2 + y^2 = 1;
end Pendulum;
"""
MANY = """
model Many "pendulums of different lengths"
  parameter Integer n = 30;
  Real x[n](start = {0.5 + i/20 for i in 1:n}, each fixed = true), y[n](each start = 0), vx[n], vy[n], T[n];
equation
  for i in 1:n loop
    der(x[i]) = vx[i]; der(y[i]) = vy[i]; der(vx[i]) = -T[i]*x[i]; der(vy[i]) = -T[i]*y[i] - 9.81;
    x[i]^2 + y[i]^2 = (0.5 + i/20)^2;
  end for;
end Many;
"""
RATES = """
model Rates "a constraint between velocities: a skate on the plane that turns steadily"
  Real x(start = 0, fixed = true), y(start = 0, fixed = true), u(start = 1, fixed = true), v(start = 0), T;
  parameter Real w = 1.5;
equation
  der(x) = u; der(y) = v; der(u) = T*sin(w*time); der(v) = -T*cos(w*time);
  u*sin(w*time) = v*cos(w*time);
end Rates;
"""


def pendulum_by_angle(times: np.ndarray) -> np.ndarray:
    """x and y (2, times) of the pendulum, from its angle to the downward direction."""
    found = solve_ivp(lambda t, z: [z[1], -9.81 * np.sin(z[0])], (0, times[-1]), [np.pi / 2, 0], "DOP853", times,
                      rtol=1e-13, atol=1e-13)  # fmt: skip
    return np.array([np.sin(found.y[0]), -np.cos(found.y[0])])


@pytest.fixture(scope="module")
def pendulum() -> lmoc.DAE:
    return compiled_text(PENDULUM)


@pytest.mark.parametrize("formulation", ACCURATE)
def test_cartesian_pendulum_moves_as_by_its_angle(pendulum, formulation):
    run = pendulum.simulate(stop=3, points=31, rtol=1e-9, formulation=formulation)
    error = np.abs(np.array([run["x"], run["y"]]) - pendulum_by_angle(run.time)).max()
    assert error < (2e-5 if formulation == "ggl" else 2e-6)
    tension = run["vx"] ** 2 + run["vy"] ** 2 - 9.81 * run["y"]
    np.testing.assert_allclose(run["T"], tension, atol=1e-4)


@pytest.mark.parametrize("formulation", ["projected", "index1", "baumgarte:500", "ggl"])
def test_andrews_mechanism_ends_where_the_literature_says(formulation):
    dae = compiled(SCENES / "classic/andrews.lmo")
    truth = json.loads((ROOT / "tests/data/classic.json").read_text(encoding="utf-8"))["andrews"]
    run = dae.simulate(times=truth["times"], rtol=1e-8, formulation=formulation)
    angles = {name: values for name, values in truth["reference"].items() if name != "dbeta"}
    error = max(np.abs(run[name] - values).max() for name, values in angles.items())
    assert error < (1e-5 if formulation == "ggl" else 1e-7)


@pytest.mark.parametrize("scene", ["four_bar", "scissor_lift", "three_cranks"])
def test_every_variable_of_a_mechanism_is_the_same(scene):
    dae = compiled(SCENES / f"planar/{scene}.lmo")
    variables = np.flatnonzero(dae.flat.kind >= Kind.INPUT)
    expected = dae.simulate(stop=0.3, points=7, rtol=1e-11)
    values = expected.values(variables)
    size = np.maximum(1.0, np.abs(np.nan_to_num(values)).max(axis=0))
    for formulation in ("projected", "index1", "baumgarte", "ggl"):
        run = dae.simulate(stop=0.3, points=7, rtol=1e-9, formulation=formulation)
        assert set(run.states) > set(expected.states)
        np.testing.assert_allclose(run.values(variables) / size, values / size, atol=5e-5, err_msg=formulation)
        assert run.energy.balance < 1e-5


def test_undifferentiated_drift_grows_with_the_square_of_time(pendulum):
    """Local errors of the acceleration add up once in the velocities and twice in the positions."""
    runs = [pendulum.simulate(stop=t, rtol=1e-5, formulation="index1", solver="dop853") for t in (10, 40)]
    drift = [run.stats for run in runs]
    position, velocity = ([np.log(s[f"{k}_residual"]) for s in drift] for k in ("position", "velocity"))
    growth = (position[1] - position[0]) / np.log(4)
    assert 1.2 < growth < 2.5, growth
    assert (velocity[1] - velocity[0]) / np.log(4) < growth


def test_feedback_bounds_the_drift_and_projection_leaves_rounding(pendulum):
    def drift(formulation: str, stop: float) -> float:
        return pendulum.simulate(stop=stop, rtol=1e-5, formulation=formulation).stats["position_residual"]

    assert drift("baumgarte", 40) < 3 * drift("baumgarte", 10)
    assert drift("baumgarte", 40) < 0.01 * drift("index1", 40)
    assert drift("projected", 40) < 1e-14
    run = pendulum.simulate(stop=40, rtol=1e-5, formulation="projected")
    assert np.abs(run["x"] ** 2 + run["y"] ** 2 - 1).max() < 1e-14, "between the steps, too"
    assert np.abs(run["x"] * run["vx"] + run["y"] * run["vy"]).max() < 1e-13


@pytest.mark.parametrize("solver", ["dop853", "taylor", "radau", "gauss"])
def test_projection_goes_with_every_method_of_one_step(pendulum, solver):
    run = pendulum.simulate(stop=1.2, points=13, rtol=1e-8, formulation="projected", solver=solver)
    assert np.abs(np.array([run["x"], run["y"]]) - pendulum_by_angle(run.time)).max() < 3e-6


def test_closures_that_are_not_differentiated_end_the_run_with_the_reason(pendulum):
    with pytest.raises(lmoc.SimulationError, match="index 3"):
        pendulum.simulate(stop=1, rtol=1e-6, formulation="index3")


def test_many_loops_of_one_shape_are_one_batch():
    run = compiled_text(MANY).simulate(stop=1, points=11, rtol=1e-8, formulation="projected")
    length = 0.5 + np.arange(1, 31) / 20
    assert np.abs(run["x"] ** 2 + run["y"] ** 2 - length**2).max() < 1e-14
    energy = (run["vx"] ** 2 + run["vy"] ** 2) / 2 + 9.81 * run["y"]
    assert np.abs(energy).max() < 1e-6


@pytest.mark.parametrize("formulation", ACCURATE)
def test_a_constraint_between_velocities_alone(formulation):
    """The speed of the skate stays, its direction turns: a circle of radius u/w."""
    run = compiled_text(RATES).simulate(stop=2, points=21, rtol=1e-8, formulation=formulation)
    np.testing.assert_allclose(run["x"], np.sin(1.5 * run.time) / 1.5, atol=1e-5)
    np.testing.assert_allclose(run["y"], (1 - np.cos(1.5 * run.time)) / 1.5, atol=1e-5)


@pytest.mark.parametrize(
    ("formulation", "rtol"),
    [*(("projected", rtol) for rtol in (1e-3, 1e-6, 1e-9)), ("index1", 1e-3), ("baumgarte", 1e-9), ("ggl", 1e-6)],
)
def test_a_run_ends_where_its_closures_depend_on_each_other(formulation, rtol):
    """Bars of a parallelogram that come to lie in line, after 0.70846 s."""
    with pytest.raises(lmoc.SimulationError, match="singular position") as caught:
        compiled_text(PARALLELOGRAM).simulate(stop=1, points=201, rtol=rtol, formulation=formulation)
    assert 0.69 < caught.value.time < 0.7086
    run = caught.value.partial
    exact = solve_ivp(lambda t, z: [z[1], 1.2 * 9.81 * np.sin(z[0])], (0, 1), [0, -1], "DOP853", run.time, rtol=1e-12,
                      atol=1e-12).y[0]  # fmt: skip
    assert np.abs(run["first.phi"] - np.pi / 2 + exact).max() < max(1e-6, 50 * rtol)


def test_a_run_goes_on_from_the_end_of_another(pendulum):
    first = pendulum.simulate(stop=1, rtol=1e-9, formulation="projected")
    run = pendulum.simulate(start=1, stop=2, points=11, rtol=1e-9, initial=first.end, formulation="projected")
    whole = pendulum_by_angle(np.array([0.5, *run.time]))[:, 1:]
    assert np.abs(np.array([run["x"], run["y"]]) - whole).max() < 1e-6
    back = pendulum.simulate(start=1, stop=2, points=11, rtol=1e-9, initial=first.end)
    assert np.abs(np.array([back["x"], back["y"]]) - whole).max() < 1e-6


def test_trees_are_the_same_in_every_formulation():
    dae = compiled(SCENES / "planar/pendulum.lmo")
    expected, run = (dae.simulate(stop=1, formulation=f) for f in ("reduced", "projected"))
    assert any("no closed loops" in note.message for note in run.notes)
    np.testing.assert_array_equal(run["pin.phi"], expected["pin.phi"])


@pytest.mark.parametrize(
    "options, expected",
    [
        ({"formulation": "ggl", "solver": "dop853"}, "auto, ida"),
        ({"formulation": "projected", "solver": "cvode"}, "dop853"),
        ({"formulation": "projekted"}, "did you mean 'projected'"),
        ({"formulation": "baumgarte:-2"}, "a gain is a positive number"),
        ({"formulation": "baumgarte:fast"}, "a gain is a positive number"),
        ({"formulation": "ggl:3"}, "ggl"),
    ],
)
def test_what_cannot_be_is_refused_with_what_can(pendulum, options, expected):
    with pytest.raises(lmoc.ModelError, match=re.escape(expected)) as caught:
        pendulum.simulate(stop=1, **options)
    assert caught.value.diagnostics[0].code == "E0626"


def test_scenes_with_laws_are_run_in_minimal_coordinates():
    dae = compiled_text(
        "model M Mass m(m = 1, g = -9.81, q(start = 1, fixed = true)); Fixed f; Stop stop(L = 0);"
        " equation connect(f.flange, stop.a); connect(stop.b, m.flange); end M;"
    )
    with pytest.raises(lmoc.ModelError, match="laws or events"):
        dae.simulate(formulation="projected")
