"""Casadi functions of implicit scenes: the same motion through casadi's idas and SUNDIALS' IDA, and derivatives."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from conftest import ROOT
from sksundae.ida import IDA

import lmoc

SLIDER = ROOT / "models/classic/slider_crank.lmo"
ANDREWS = ROOT / "models/classic/andrews.lmo"
LEVER = ROOT / "models/hard/h08_turning_lever.lmo"
PUSHED = """
model Pushed
  input Real u = 0.5;
  parameter Real k = 2;
  Fixed wall; CubicSpring a(k = k), b(k = 3); Mass mass(m = 1, q(start = 1, fixed = true)); Force push(f = u);
  output Real x = mass.q;
  output Real f = b.f;
equation
  connect(wall.flange, a.a); connect(a.b, b.a); connect(b.b, mass.flange); connect(push.flange, mass.flange);
end Pushed;
"""
TIMES = [0.0, 0.05, 0.1, 0.2]


@pytest.fixture(scope="module", params=[SLIDER, LEVER, PUSHED], ids=["slider crank", "lever", "springs"])
def scene(request):
    dae = lmoc.compile_text(request.param) if isinstance(request.param, str) else lmoc.compile(request.param)
    return dae, dae.functions, dae.simulate(times=TIMES, rtol=1e-11)


def test_the_start_is_consistent(scene):
    dae, f, run = scene
    d = f.dae
    assert d.states == tuple(dae.states)
    assert len(d.algebraic) > 0 or dae.name == "TurningLever"  # whose block is small and linear
    residual = d.residual(d.start.t, d.yp0[: len(d.states)], d.start.x, d.start.z, d.start.u, d.values)
    assert np.abs(np.array(residual)).max() < 1e-9
    assert d.start.x == pytest.approx([run[name][0] for name in d.states])


def test_ode_is_the_right_hand_side_of_the_run(scene):
    dae, f, run = scene
    h = 1e-4
    at = dae.simulate(times=[0.0, 0.1 - 2 * h, 0.1 - h, 0.1, 0.1 + h, 0.1 + 2 * h], rtol=1e-12)
    x = np.array([at[name] for name in dae.states])
    found = np.array(f.ode(0.1, x[:, 3], f.dae.start.u, f.values)).ravel()
    slope = (x[:, 1] - 8 * x[:, 2] + 8 * x[:, 4] - x[:, 5]) / (12 * h)
    assert found == pytest.approx(slope, rel=1e-6, abs=1e-6 * np.abs(slope).max())


def test_casadi_idas_takes_it_as_it_is(scene):
    dae, f, run = scene
    d = f.dae
    options = {"abstol": 1e-11, "reltol": 1e-11, "max_num_steps": 100_000}
    sim = ca.integrator("sim", "idas", d.expressions, 0, TIMES[1:], options)
    result = np.array(sim(x0=d.start.x, z0=d.start.z, u=np.tile(d.start.u[:, None], 3), p=d.values)["xf"])
    for k, name in enumerate(d.states):
        assert result[k] == pytest.approx(run[name][1:], abs=1e-6 * max(1, np.abs(run[name]).max())), name


def test_scikit_sundae_ida_takes_it_as_it_is(scene):
    dae, f, run = scene
    d = f.dae
    solver = IDA(d.resfn, algebraic_idx=d.algebraic_idx, rtol=1e-9, atol=1e-11, max_num_steps=100_000)
    result = solver.solve(np.array(TIMES), d.y0, d.yp0)
    assert result.success
    for k, name in enumerate(d.states):
        assert result.y[:, k] == pytest.approx(run[name], abs=1e-5 * max(1, np.abs(run[name]).max())), name


def test_derivatives_through_the_rootfinder(scene):
    dae, f, run = scene
    d, h = f.dae, 1e-6
    a, b, c, _ = (np.array(m) for m in f.jacobian(0.0, d.start.x, d.start.u, d.values))
    for k in range(len(d.states)):
        step = h * np.eye(len(d.states))[k]
        high, low = (np.array(f.ode(0.0, d.start.x + s, d.start.u, d.values)).ravel() for s in (step, -step))
        assert a[:, k] == pytest.approx((high - low) / (2 * h), rel=1e-5, abs=1e-5 * max(1.0, np.abs(a).max()))


def test_outputs_of_blocks_and_inputs():
    dae = lmoc.compile_text(PUSHED)
    f = dae.functions
    assert f.inputs == ("u",) and f.outputs == ("x", "f") and f.parameters[:1] == ("k",)
    keq = (2 ** (-1 / 3) + 3 ** (-1 / 3)) ** -3
    y = np.array(f.output(0, [0.7, 0.0], 0.5, f.values)).ravel()
    assert y == pytest.approx([0.7, keq * 0.7**3], rel=1e-10)
    assert np.array(f.ode(0, [0.7, 0.0], 0.5, f.values)).ravel() == pytest.approx([0, 0.5 - keq * 0.7**3], rel=1e-10)
    by_input = np.array(f.jacobian(0, [0.7, 0.0], 0.5, f.values)[1]).ravel()
    assert by_input == pytest.approx([0, 1])


def test_an_explicit_scene_has_no_algebraic_variables():
    dae = lmoc.compile(ROOT / "models/notes/ex05_suspension.lmo")
    d = dae.functions.dae
    assert d.algebraic == () and len(d.algebraic_idx) == 0
    n = len(d.states)
    x = np.linspace(0.1, 0.2, n)
    rate = np.array(dae.functions.ode(0.0, x, d.start.u, d.values)).ravel()
    assert np.abs(np.array(d.residual(0.0, rate, x, [], d.start.u, d.values))).max() < 1e-12


def test_without_a_solution_the_rootfinder_says_so():
    f = lmoc.compile_text(
        "model M Real x(start = 0.3, fixed = true), u(start = 1.2); "
        "output Real y(start = 0, fixed = true); "
        "equation der(x) = 0.1; der(y) = sin(u); cos(u) = x; end M;"
    ).functions
    assert np.array(f.ode(0, [0.5, 0.0], [], [])).ravel()[1] == pytest.approx(np.sqrt(0.75))
    with pytest.raises(RuntimeError):
        f.ode(0, [1.5, 0.0], [], [])


def test_another_branch_by_another_guess():
    f = lmoc.compile_text(
        "model M Real x(start = 0.3, fixed = true), u(start = 1.2); "
        "output Real y(start = 0, fixed = true); "
        "equation der(x) = 0.1; der(y) = sin(u); cos(u) = x; end M;"
    ).functions
    for guess, sign in ((1.0, 1), (-1.0, -1)):
        assert float(f.algebraic(0, [0.5, 0.0], [], [], guess)) == pytest.approx(sign * np.arccos(0.5))


def test_inputs_that_hold_the_modes_of_laws_have_names():
    """A mass that sticks to the ground by friction, and one that slides."""
    dae = lmoc.compile_text("""model Held Fixed wall; Mass m(m = 2); DryFriction f(F = 3); Force p(f = 5);
    equation connect(wall.flange, f.a); connect(f.b, m.flange); connect(p.flange, m.flange); end Held;""")
    made = dae.functions
    assert set(made.inputs) == {"closed(f)", "force(f)", "direction(f)"}

    def acceleration(**mode):
        given = [mode.get(name.split("(")[0], 0.0) for name in made.inputs]
        return float(made.ode(0, [0, 1], given, made.values)[made.states.index("m.v")])

    assert acceleration(closed=1) == 0.0
    assert acceleration(direction=1) == 1.0 and acceleration(direction=-1) == 4.0
