"""Tolerances follow the size of the motion: from 1e-12 to 1e12 a run is as accurate as at 1."""

import numpy as np
import pytest
from conftest import ROOT
from oracles.models import compiled, compiled_text

import lmoc
from lmoc.numerics.options.options import SOLVERS

SCENE = """
model M
  input Real u(unit = "N") = 0;
  Mass m(m = 1, q(start = {start}, fixed = true), v(fixed = true));
  Spring s(k = 4);
  Fixed f;
  Force push(f = u);
equation
  connect(f.flange, s.a);
  connect(s.b, m.flange);
  connect(push.flange, m.flange);
end M;
"""
SIZES = [1e-12, 1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9, 1e12]


def error(run: lmoc.Run, exact: np.ndarray) -> float:
    return float(np.abs(run["m.q"] - exact).max() / np.abs(exact).max())


@pytest.mark.parametrize("size", SIZES)
def test_a_swing_of_any_amplitude(size):
    run = compiled_text(SCENE.format(start=size)).simulate()
    assert error(run, size * np.cos(2 * run.time)) < 2e-5
    assert run.energy.balance < 1e-4


@pytest.mark.parametrize("size", SIZES)
def test_a_force_of_any_size_from_rest(size):
    run = compiled_text(SCENE.format(start=0)).simulate(inputs={"u": f"{size!r}*sin(time)"})
    assert error(run, size * (np.sin(run.time) / 3 - np.sin(2 * run.time) / 6)) < 2e-5


@pytest.mark.parametrize("solver", [s for s in SOLVERS if s != "moreau"])  # it takes scenes with laws alone
def test_every_solver_at_a_nanometre(solver):
    normal, small = (compiled_text(SCENE.format(start=a)).simulate(solver=solver) for a in (1, 1e-9))
    assert error(small, 1e-9 * np.cos(2 * small.time)) < 3 * error(normal, np.cos(2 * normal.time)) + 1e-6


@pytest.mark.parametrize("keep", [None, ["m.q"]])
def test_a_run_that_keeps_little_is_as_accurate(keep):
    run = compiled_text(SCENE.format(start=1e-9)).simulate(keep=keep, points=7)
    assert error(run, 1e-9 * np.cos(2 * run.time)) < 2e-5


def test_a_declared_nominal_and_atol_are_kept():
    text = SCENE.format(start=1e-9)
    declared = text.replace("fixed = true), v(fixed", "fixed = true, nominal = 1), v(nominal = 1, fixed")
    loose = [compiled_text(declared).simulate(), compiled_text(text).simulate(atol=1e-9)]
    assert [error(run, 1e-9 * np.cos(2 * run.time)) > 1e-3 for run in loose] == [True, True]


def test_rounding_beside_a_motion_is_not_followed():
    """What rests but for rounding makes no run longer, and a motion that dies away is followed from its beginning."""
    text = """model M Real x(start = 1, fixed = true), y(fixed = true), z(start = 1, fixed = true); equation
        der(x) = -x; der(y) = 1e-18*x; der(z) = -30*z; end M;"""
    run = compiled_text(text).simulate(stop=20)
    assert run["x"] == pytest.approx(np.exp(-run.time), abs=1e-5) and np.abs(run["y"]).max() < 1e-15
    alone = compiled_text(text.replace("1e-18*x", "0")).simulate(stop=20)
    assert run.stats["steps"] <= alone.stats["steps"] + 5


def test_a_scene_at_rest_is_run_once(monkeypatch):
    from lmoc.numerics.run import simulate

    calls = []
    monkeypatch.setattr(simulate, "run_segments", lambda *a, own=simulate.run_segments: calls.append(1) or own(*a))
    lmoc.compile_text(SCENE.format(start=0)).simulate()
    assert len(calls) == 1
    lmoc.compile_text(SCENE.format(start=1)).simulate()
    assert len(calls) == 2
    lmoc.compile_text(SCENE.format(start=1e-9)).simulate()
    assert len(calls) == 4


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-10])
@pytest.mark.parametrize("scene", ["ex05_suspension", "ex10_lever_and_mass"])
def test_an_equilibrium_is_kept_without_following_its_rounding(scene, rtol):
    """The forces on a body at rest cancel up to rounding, and all velocities are of that size."""
    dae = compiled(f"notes/{scene}")
    run = dae.simulate(initial="equilibrium", inputs=dict.fromkeys(dae.inputs, 0.0), rtol=rtol)
    assert int(run.stats["steps"]) < 2000
    assert all(np.ptp(run[name]) < 1e-9 for name in dae.states)


def test_what_is_smaller_than_double_precision_can_divide_rests():
    run = compiled_text(SCENE.format(start=1e-310)).simulate()
    assert np.isfinite(run["m.q"]).all() and run.stats["steps"] < 1000


def test_the_elements_of_an_array_have_one_size(monkeypatch):
    """The nodes of a standing wave make no second run, and a small wave is followed like a large one."""
    from lmoc.numerics.run import simulate

    text = """model M parameter Real a; parameter Integer n = 31;
      Mass m[n](each m = 1, q(start = {a*sin(4*3.141592653589793*i/(n + 1)) for i in 1:n}, each fixed = true));
      Spring s[n + 1](each k = 100); Fixed f, g;
    equation
      connect(f.flange, s[1].a); connect(s[n + 1].b, g.flange);
      for i in 1:n loop connect(s[i].b, m[i].flange); connect(m[i].flange, s[i + 1].a); end for;
    end M;"""
    calls = []
    monkeypatch.setattr(simulate, "run_segments", lambda *a, own=simulate.run_segments: calls.append(1) or own(*a))
    omega, nodes = 20 * np.sin(np.pi / 16), np.sin(np.pi * np.arange(1, 32) / 8)
    for size, runs in ((0.1, 1), (1e-8, 2)):
        calls.clear()
        run = lmoc.compile_text(text, parameters={"a": size}).simulate()
        exact = size * np.cos(omega * run.time)[:, None] * nodes
        assert len(calls) == runs
        assert np.abs(run["m.q"] - exact).max() < 2e-4 * size


@pytest.mark.parametrize("stop", [2.5, 3.0, 30.0])
def test_a_start_within_rounding_of_an_equilibrium_asks_for_no_tolerance_below_it(stop):
    """The errors of a pass with long steps are taken for the motion, and are too small to be resolved."""
    dae = lmoc.compile(ROOT / "models" / "planar" / "slider_crank.lmo")
    run = dae.simulate(initial={"main.phi": 1.2714735451303878, "main.omega": 0.0}, stop=stop)
    assert np.ptp(run["main.phi"]) < 1e-9 and run.stats["steps"] < 1000
