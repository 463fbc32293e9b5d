"""The Runge–Kutta method itself: coefficients, orders, both steppers, dense output, stiffness, failures."""

import numpy as np
import pytest
from oracles.by_hand import Scene, oscillator
from oracles.by_numpy import NumpyStepper, VectorSystem

import lmoc
from lmoc.expression import dag
from lmoc.messages.diagnostics import Report, SimulationError
from lmoc.numerics.dop853 import table as dop853_table
from lmoc.numerics.dop853.dense_output import dense_terms, evaluate_dense
from lmoc.numerics.evaluate.engine_system import EngineSystem
from lmoc.numerics.options.options import RunOptions
from lmoc.numerics.plan.plan import build_plan
from lmoc.numerics.run.simulate import Simulator, simulate
from lmoc.numerics.signals.signals import bind_signals


def made(system_class, scene: Scene):
    reduced, report = scene.reduced(), Report()
    signals = bind_signals(reduced.flat, {}, report)
    plan = build_plan(reduced, signals, True, report)
    system = system_class(plan)
    system.prepare(plan.base(reduced.values, signals), signals)
    return system


def pendulum() -> Scene:
    s = Scene()
    q, v = s.state("q", 2.0), s.state("v", 0.5)
    s.rate(q, v)
    s.rate(v, -dag.function("sin", q))
    return s


def test_coefficients_are_those_of_hairer():
    theirs = pytest.importorskip("scipy.integrate._ivp.dop853_coefficients")
    for name in ("A", "B", "C", "D", "E3", "E5"):
        assert np.array_equal(getattr(dop853_table, name), getattr(theirs, name))


def terms(stepper, h):
    """Dense output of the step just tried from time zero."""
    return dense_terms(np.array([h]), stepper.x[None], stepper.x_new[None], stepper.stages(0.0, h)[None])


@pytest.mark.parametrize("stepper", [NumpyStepper, EngineSystem.stepper])
def test_orders_of_the_step_and_of_its_dense_output(stepper):
    system = made(EngineSystem, oscillator(m=1.0, k=1.0, q0=1.0, ledger=False))
    errors = []
    for h in (0.8, 0.4):
        one = stepper(system)
        one.start(0.0, np.array([1.0, 0.0]), 1e-6, np.full(2, 1e-6))
        one.attempt(0.0, h)
        half = evaluate_dense(np.array([0.5]), one.x[None], terms(one, h))[0]
        exact_end, exact_half = np.array([np.cos(h), -np.sin(h)]), np.array([np.cos(h / 2), -np.sin(h / 2)])
        errors.append((np.abs(one.x_new - exact_end).max(), np.abs(half - exact_half).max()))
    (end, middle), (end_half, middle_half) = errors
    assert np.log2(end / end_half) == pytest.approx(9, abs=0.5)
    assert np.log2(middle / middle_half) == pytest.approx(8, abs=0.5)


def test_both_steppers_agree():
    one, two = (made(system, pendulum()).stepper() for system in (VectorSystem, EngineSystem))
    for stepper in (one, two):
        stepper.start(0.0, np.array([2.0, 0.5]), 1e-6, np.full(2, 1e-9))
    assert one.attempt(0.0, 0.5) == pytest.approx(two.attempt(0.0, 0.5), rel=1e-6)
    assert one.x_new == pytest.approx(two.x_new, rel=1e-14)
    assert terms(one, 0.5) == pytest.approx(terms(two, 0.5), rel=1e-10, abs=1e-13)


@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-10])
def test_damped_oscillator_between_the_steps(rtol):
    run = simulate(oscillator(m=1.0, k=101.0, c=2.0).reduced(), options=RunOptions(solver="dop853", rtol=rtol))
    t = run.time
    exact = 0.1 * np.exp(-t) * (np.cos(10 * t) + np.sin(10 * t) / 10)
    assert run["q"] == pytest.approx(exact, abs=10 * rtol * 0.1)


def test_prothero_robinson_goes_on_with_a_stiff_method():
    s = Scene()
    x, rate = s.state("x", 0.1), s.parameter("rate", 1e6)
    s.rate(x, -rate * (x - dag.function("sin", dag.TIME)) + dag.function("cos", dag.TIME))
    simulator = Simulator(s.reduced())
    run = simulator.run()
    assert run["x"] == pytest.approx(np.sin(run.time) + 0.1 * np.exp(-1e6 * run.time), abs=1e-6)
    assert run.stats["solver"] == "taylor, cvode" and "stiff" in run.stats["reason"]
    assert run.stats["steps"] < 2000


def test_stiff_and_undamped_with_the_fast_mode_at_work():
    """Two masses, stiffness ratio 1e6: every swing must be followed, and energy is kept."""
    s = Scene()
    k = s.parameter("k", 1e6)
    q1, v1, q2, v2 = (s.state(n, x) for n, x in (("q1", 1e-6), ("v1", 0.0), ("q2", 1.0), ("v2", 0.0)))
    for x, f in ((q1, v1), (q2, v2), (v1, -(k + 1) * q1 + q2), (v2, q1 - q2)):
        s.rate(x, f)
    s.define("energy", 0.5 * v1 * v1 + 0.5 * v2 * v2 + 0.5 * k * q1 * q1 + 0.5 * (q1 - q2) * (q1 - q2))
    run = simulate(s.reduced(), options=RunOptions(stop=5.0))
    assert run["energy"] == pytest.approx(run["energy"][0], rel=1e-5)


@pytest.mark.parametrize("solver", ["dop853", "cvode", "adams", "ida", "cvodes", "radau", "auto"])
def test_a_solution_that_ends_is_told_with_what_was_reached(solver):
    s = Scene()
    x = s.state("x", 1.0)
    s.rate(x, x * x)  # infinite at t = 1
    with pytest.raises(SimulationError) as failure:
        simulate(s.reduced(), options=RunOptions(stop=2.0, points=201, solver=solver))
    assert failure.value.time == pytest.approx(1.0, abs=1e-2)
    partial = failure.value.partial
    assert 90 <= len(partial.time) <= 102
    assert partial["x"][:90] == pytest.approx(1 / (1 - partial.time[:90]), rel=1e-3)


@pytest.mark.parametrize("solver", ["dop853", "cvode", "adams", "ida", "radau", "auto"])
def test_a_value_that_is_lost_is_named(solver):
    s = Scene()
    x = s.state("tank.level", 1.0)
    s.rate(x, -1.0 - 1e-9 * s.define("flow", dag.function("sqrt", x)))
    with pytest.raises(SimulationError, match="t = ") as failure:
        simulate(s.reduced(), options=RunOptions(stop=2.0, solver=solver))
    assert failure.value.time == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("solver", ["dop853", "auto"])
@pytest.mark.parametrize("others", [0, 1])
def test_a_state_at_the_edge_of_what_the_equations_have_values_for(solver, others):
    s = Scene()
    x = s.state("x", 1.0)
    s.rate(x, -1.0 - dag.function("sqrt", x + -1.0))  # no value below x = 1
    for k in range(others):  # which every step, however short, moves by some digits
        y = s.state(f"y{k}", 0.0)
        s.rate(y, 1.0 + x)
    with pytest.raises(SimulationError, match="no finite value") as failure:
        simulate(s.reduced(), options=RunOptions(stop=10.0, solver=solver))
    assert failure.value.time < 1e-9
    assert failure.value.partial.stats["evaluations"] < 100_000


def test_a_domain_that_the_motion_keeps_close_to_is_followed():
    s = Scene()
    x = s.state("x", 1.0)
    edge = 1e-9
    s.rate(x, -1.0 * x * dag.function("sqrt", x + -edge))  # which long steps would cross
    run = simulate(s.reduced(), options=RunOptions(stop=9e4, rtol=1e-8, atol=1e-16, solver="dop853"))
    u = np.tan(np.arctan(np.sqrt(1 / edge - 1)) - np.sqrt(edge) * run.time / 2)
    assert run["x"] == pytest.approx(edge * (1 + u * u), rel=1e-4)


def test_limits_end_a_run():
    reduced = oscillator().reduced()
    with pytest.raises(SimulationError, match=r"too many steps: the last ones are 0\.\d+ s long"):
        simulate(reduced, options=RunOptions(solver="dop853", max_steps=20))
    for solver in ("dop853", "cvode", "ida"):
        with pytest.raises(SimulationError, match="time limit"):
            simulate(reduced, options=RunOptions(stop=1e7, points=3, solver=solver, max_seconds=0.05))


@pytest.mark.parametrize("times", [None, [8.0, 9.0]])
def test_a_motion_that_has_left_all_scale_is_told_where_a_run_breaks_off(times):
    s = Scene()
    x, y = s.state("x", 1.0), s.state("y", 0.0)
    s.rate(x, 5.0 * x)
    s.rate(y, dag.function("cos", 1e-8 * x))  # ever faster
    with pytest.raises(SimulationError, match="too many steps") as failure:
        simulate(s.reduced(), options=RunOptions(solver="dop853", stop=20.0, max_steps=20_000, times=times))
    assert failure.value.partial.stats["steps"] <= 20_000
    assert ("x has grown to" in str(failure.value)) == (times is None), str(failure.value)


def test_output_between_steps_that_stability_limits_is_as_good_as_the_steps() -> None:
    """A damper without mass: its fast decay is over at once and limits the steps ever after."""
    text = """model D
      Mass m(m = 1, q(start = 1, fixed = true)); Spring s(k = 1), s2(k = 1); Damper d(c = 0.007), d2(c = 0.3); Fixed w;
    equation
      connect(w.flange, s.a); connect(s.b, d.a); connect(d.b, w.flange); connect(s.b, s2.a);
      connect(s2.b, m.flange); connect(w.flange, d2.a); connect(d2.b, m.flange);
    end D;"""
    dae = lmoc.compile_text(text)
    exact = dae.simulate(stop=10, points=301, solver="cvode", rtol=1e-11, atol=1e-13)
    run = dae.simulate(stop=10, points=301, solver="dop853", rtol=1e-6)
    assert max(np.max(np.abs(run[name] - exact[name])) for name in dae.states) < 1e-5


def test_a_state_next_to_zero_that_begins_to_move_fast() -> None:
    """Its size asks for a first step of 1e-29 s, which is none at 0.1 s: the run stopped there."""
    text = """model M Real z(start = 1, fixed = true), x(start = 0, fixed = true), v(start = 0, fixed = true);
        equation der(z) = -z; der(x) = v; der(v) = if time > 0.1 then 1e18 else 0; end M;"""
    run = lmoc.compile_text(text).simulate(stop=1, solver="dop853")
    assert run["x"][-1] == pytest.approx(0.5e18 * 0.9**2, rel=1e-6)
