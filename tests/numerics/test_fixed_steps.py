"""Methods with steps of equal length: their orders, what they conserve, what they refuse, and events among steps."""

from pathlib import Path

import numpy as np
import pytest
from oracles.by_hand import oscillator
from oracles.models import compiled_text

import lmoc
from lmoc.expression import dag
from lmoc.messages.diagnostics import ModelError, SimulationError
from lmoc.numerics.options.options import EITHER, FIXED_STEP, RunOptions
from lmoc.numerics.run.simulate import Simulator, simulate
from lmoc.numerics.steps.choice import table

MODELS = Path(__file__).parents[2] / "models"

WHOLE = ("collocation", "collocation-radau")  # casadi's, a run in one call
METHODS = ("rk4", "midpoint", "verlet", "generalized-alpha")
PENDULUM = """model P
  Real phi(start = 2, fixed = true), w(start = 0, fixed = true);
  output Real H = w^2/2 - 9.81*cos(phi);
equation
  der(phi) = w; der(w) = -9.81*sin(phi);
end P;"""
BALL = """model B
  Mass m(m = 1, g = -9.81, q(start = 1, fixed = true), v(start = 0, fixed = true));
  Fixed floor; Stop s(L = 0, e = 0.8);
equation
  connect(floor.flange, s.a); connect(s.b, m.flange);
end B;"""


@pytest.mark.parametrize(
    ("solver", "order"),
    [("rk4", 4), ("midpoint", 2), ("verlet", 2), ("generalized-alpha", 2), ("gauss", 8),
     ("collocation", 6), ("collocation-radau", 5)],
)
def test_the_error_falls_with_the_order(solver, order):
    run = Simulator(oscillator(c=0.0 if solver == "verlet" else 0.3).reduced()).run
    times = np.linspace(0, 5, 3 if solver in WHOLE else 8)  # not those of the steps but where these end at them
    exact = run(options=RunOptions(times=times, rtol=1e-13))["q"]
    steps = {"gauss": (0.4, 0.2)}.get(solver, (0.1, 0.05) if solver in WHOLE else (0.02, 0.01))
    errors = [np.abs(run(options=RunOptions(solver=solver, step=h, times=times))["q"] - exact).max() for h in steps]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.15 * order)


@pytest.mark.parametrize(
    ("solver", "step", "largest"), [("midpoint", 0.02, 0.02), ("verlet", 0.02, 0.02), ("gauss", 0.2, 2e-4)]
)
def test_energy_of_a_pendulum_does_not_drift(solver, step, largest):
    run = compiled_text(PENDULUM).simulate(stop=80, points=801, solver=solver, step=step, energy=False)
    deviation = np.abs(run["H"] - run["H"][0]) / 9.81
    early, late = deviation[:200].max(), deviation[-200:].max()
    assert late < largest and late == pytest.approx(early, rel=0.05)


def test_gauss_at_a_tolerance_keeps_its_step_and_the_energy():
    run = compiled_text(PENDULUM).simulate(stop=200, points=601, solver="gauss", rtol=1e-6, energy=False)
    deviation = np.abs(run["H"] - run["H"][0]) / 9.81
    assert deviation[-200:].max() < 2 * deviation[:200].max() < 2e-5
    assert run.stats["rejected"] < 30


def test_generalized_alpha_damps_what_is_too_fast_for_its_steps():
    """A mode of 1000 rad/s at steps of 0.1 s loses the factor `RADIUS` a step; the implicit midpoint rule none."""
    run = Simulator(oscillator(m=1.0, k=1e6).reduced()).run
    last = {
        solver: np.abs(run(options=RunOptions(solver=solver, step=0.1, times=[10.0]))["q"][-1]) / 0.1
        for solver in ("generalized-alpha", "midpoint")
    }
    assert last["generalized-alpha"] < 1e-4 and last["midpoint"] > 0.5


@pytest.mark.parametrize("solver", METHODS)
def test_a_thousand_steps_where_nobody_says(solver):
    run = simulate(oscillator().reduced(), options=RunOptions(solver=solver, stop=2.0))
    assert run.stats["steps"] == 1000


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"solver": "dop853", "step": 0.1}, "solver 'dop853' chooses its steps by the tolerance"),
        ({"step": 0.1}, "solver 'auto' chooses its steps"),
        ({"solver": "rk4", "step": -0.1}, "the length of the steps is positive, found step = -0.1"),
        ({"solver": "rk4", "step": float("nan")}, "step must be a finite number"),
        ({"solver": "rk4", "step": 0.1, "max_step": 0.1}, "step and max_step exclude each other"),
    ],
)
def test_wrong_use_of_the_step(options, words):
    with pytest.raises(ModelError, match=words):
        simulate(oscillator().reduced(), options=RunOptions(**options))


def test_the_options_agree_with_the_table():
    lengths = {one.name: one.lengths for one in table()}
    assert {n for n, kind in lengths.items() if kind == "fixed"} <= set(FIXED_STEP)
    assert {n for n, kind in lengths.items() if kind == "either"} == set(EITHER)


def test_verlet_names_the_force_that_depends_on_a_velocity():
    with pytest.raises(ModelError, match=r"not separable into positions and velocities: der\(.*v\) depends on itself"):
        simulate(oscillator(c=0.1).reduced(), options=RunOptions(solver="verlet", step=0.01))
    text = """model M Real x(start = 1, fixed = true), y(start = 0, fixed = true), z(start = 0, fixed = true);
        equation der(x) = y; der(y) = z; der(z) = x; end M;"""
    with pytest.raises(ModelError, match="not separable"):
        compiled_text(text).simulate(solver="verlet", step=0.01)


@pytest.mark.parametrize("solver", [*METHODS, "gauss"])
def test_impacts_among_steps(solver):
    """Free fall is a parabola, which these methods follow exactly, all but one; so are the instants of the impacts."""
    near = 1e-5 if solver == "generalized-alpha" else 1e-9
    ball = compiled_text(BALL)
    run = ball.simulate(stop=2, solver=solver, step=0.01)
    fall = np.sqrt(2 / 9.81)
    impacts = np.array([e.time for e in run.events])[:3]
    assert impacts == pytest.approx(fall * np.array([1, 2.6, 2.6 + 2 * 0.64]), rel=near)
    assert run["m.q"][-1] == pytest.approx(ball.simulate(stop=2, rtol=1e-10)["m.q"][-1], abs=10 * near)


@pytest.mark.parametrize("solver", ["midpoint", "generalized-alpha"])
def test_steps_whose_equations_are_not_solved(solver):
    """x' = x² from 5 with steps of 1: the midpoint's k = (5 + k/2)² has no real solution."""
    text = "model M Real x(start = 5, fixed = true); equation der(x) = x^2; end M;"
    with pytest.raises(SimulationError, match="Newton's method does not solve the equations of a step of this length"):
        compiled_text(text).simulate(stop=2, solver=solver, step=1.0)


@pytest.mark.parametrize("solver", WHOLE)
def test_casadi_refuses_what_it_cannot_take(solver):
    with pytest.raises(ModelError, match="casadi integrates small smooth scenes only, without events"):
        compiled_text(BALL).simulate(stop=2, solver=solver, step=0.01)


@pytest.mark.parametrize("solver", [*METHODS, "gauss"])
def test_the_last_step_ends_where_the_run_does(solver):
    run = simulate(oscillator().reduced(), options=RunOptions(solver=solver, step=0.3, stop=1.0))
    assert run.time[-1] == 1.0 and run.stats["steps"] == 4


@pytest.mark.parametrize("solver", ["rk4", "midpoint", "generalized-alpha", "gauss"])
def test_a_driven_scene(solver):
    driven = dag.function("sin", 2 * dag.TIME)
    options = RunOptions(solver=solver, step=0.005, stop=5)
    run = simulate(oscillator(c=0.5).reduced(), options=options, inputs={"f": driven})
    exact = simulate(oscillator(c=0.5).reduced(), options=RunOptions(rtol=1e-10, stop=5), inputs={"f": driven})
    assert run["q"] == pytest.approx(exact["q"], abs=2e-4)
    assert run.energy.balance < 1e-2


@pytest.mark.parametrize(("solver", "step"), [("midpoint", 0.058), ("verlet", 0.1), ("midpoint", 0.05)])
def test_a_string_that_goes_slack_stays_so_between_long_steps(solver: str, step: float) -> None:
    run = lmoc.compile(MODELS / "laws" / "h06_bungee.lmo").simulate(solver=solver, step=step)
    assert [e.kind for e in run.events][:3] == ["taut", "slack", "taut"]
    assert run.stats["steps"] < 150
    assert run["string.gap"].min() > -0.01


@pytest.mark.parametrize("solver", WHOLE)
def test_collocation_of_stiff_equations_is_silent(solver, capfd):
    """Rounding in a large state keeps Newton's method from the last digits of casadi's own tolerance."""
    run = lmoc.compile(MODELS / "hard/h28_prothero_robinson.lmo").simulate(solver=solver, step=0.1)
    apart = np.abs(run["x"] - np.sin(run.time))[1:]
    assert apart[-1] < 1e-3 if solver == "collocation-radau" else 0.05 < apart[0] < 0.1  # Gauss damps nothing at once
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("solver", WHOLE)
def test_collocation_whose_equations_have_no_solution_says_so(solver, capfd):
    text = "model M Real x(start = 1, fixed = true); equation der(x) = x^2; end M;"
    with pytest.raises(SimulationError, match="Newton's method does not solve the equations of a step") as failure:
        compiled_text(text).simulate(solver=solver, step=0.5, stop=2, points=3)
    assert failure.value.time == 0
    assert capfd.readouterr() == ("", "")
