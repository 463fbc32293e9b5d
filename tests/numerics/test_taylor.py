"""The Taylor integrator: series of every function, of blocks, step control, values within steps, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT
from oracles.models import compiled

import lmoc
from lmoc.engine.compiler import find_compiler
from lmoc.expression.functions import SMOOTH
from lmoc.numerics.steps import loop, series_rule

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="no C compiler")

INSIDE = {"acosh": "1.5 + 0.3*sin(x)", "log": "1.5 + 0.3*sin(x)", "log10": "1.5 + 0.3*sin(x)"}
PENDULUM = """
model Pendulum
  parameter Real l = 1;
  Real phi(start = {phi}, fixed = true), w(start = 0, fixed = true);
equation
  der(phi) = w; der(w) = -9.81/l*sin(phi);
end Pendulum;
"""


def both(dae, **options):
    """The same run by Taylor series, and by DOP853 much more accurately."""
    run = dae.simulate(solver="taylor", **options)
    assert run.stats["solver"] == "taylor"
    return run, dae.simulate(**{**options, "solver": "dop853", "rtol": 1e-13})


@pytest.mark.parametrize("name", [*SMOOTH, "atan2", "x^1.5", "x^(-2)", "x^x", "x^5", "1/x"])
def test_every_function_has_its_series(name):
    inside = INSIDE.get(name, "0.4 + 0.3*sin(x)")
    f = {"atan2": "atan2(sin(x), 0.5 + cos(x)^2)"}.get(name) or (
        f"{name}({inside})" if name in SMOOTH else name.replace("x", "(1.2 + sin(x)/2)")
    )
    variables = "Real x(start = 0.2, fixed = true); output Real y(start = 0, fixed = true);"
    text = f"model M {variables} equation der(x) = 1 + y/9; der(y) = {f}; end M;"
    run, reference = both(lmoc.compile_text(text), stop=2, points=21, rtol=1e-11)
    assert run["y"] == pytest.approx(reference["y"], rel=1e-10, abs=1e-11)


@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-12])
def test_a_pendulum_to_the_tolerance_also_between_the_steps(rtol):
    run, reference = both(lmoc.compile_text(PENDULUM.format(phi=2.5)), stop=10, points=1001, rtol=rtol)
    assert run.stats["steps"] < 200
    assert np.abs(run["phi"] - reference["phi"]).max() < 30 * rtol + 1e-11


@pytest.mark.parametrize(
    "force", ["-x", "-x^3", "-sin(x)", "-x^5 + x^3/2", "-x/(1 + x^2)", "1 - x^4"], ids=lambda f: f.replace("/", ":")
)
@pytest.mark.parametrize("start", [1.0, 1e-9, 1e6])
def test_a_start_from_rest_does_not_fool_the_step_control(force, start):
    """Every second coefficient vanishes there."""
    if start == 1e6 and "^" in force:
        pytest.skip("too fast a motion")
    variables = f"Real x(start = {start}, fixed = true), v(start = 0, fixed = true);"
    text = f"model M {variables} equation der(x) = v; der(v) = {force}; end M;"
    run, reference = both(lmoc.compile_text(text), stop=6, points=61, rtol=1e-9, atol=1e-12 * start)
    assert np.abs(run["x"] - reference["x"]).max() < 1e-7 * max(start, np.abs(reference["x"]).max())


def test_an_equilibrium_takes_one_step():
    run = lmoc.compile_text(PENDULUM.format(phi=0)).simulate(solver="taylor", stop=100, points=5)
    assert run.stats["steps"] == 1 and not run["phi"].any()


@pytest.mark.parametrize(
    ("model", "stop"), [("classic/andrews", 0.03), ("classic/slider_crank", 0.3), ("classic/car_axis", 1.0),
                        ("planar/double_pendulum", 2.0), ("planar/chain", 1.0), ("hard/h08_turning_lever", 1.0)],
)  # fmt: skip
def test_scenes_with_blocks(model, stop):
    dae = compiled(model)
    run, reference = both(dae, stop=stop, points=11, rtol=1e-10)
    for name in dae.states:
        size = np.abs(reference[name]).max()
        assert np.abs(run[name] - reference[name]).max() < 1e-7 * size + 1e-12, name


def test_a_long_chain_with_a_sparse_block():
    dae = lmoc.compile(ROOT / "models/planar/chain.lmo", parameters={"n": 20})
    run, reference = both(dae, stop=0.3, points=4, rtol=1e-9, energy=False)
    for name in dae.states:
        assert run[name] == pytest.approx(reference[name], abs=1e-7 * max(1, np.abs(reference[name]).max())), name


def test_parameters_and_starts_of_the_next_run_count():
    dae = lmoc.compile_text(PENDULUM.format(phi=1))
    dae.simulate(solver="taylor", stop=1)
    run = dae.simulate(solver="taylor", stop=1, points=5, rtol=1e-10, parameters={"l": 4}, initial={"phi": 0.5})
    other = dae.simulate(solver="dop853", stop=1, points=5, rtol=1e-12, parameters={"l": 4}, initial={"phi": 0.5})
    assert run["phi"] == pytest.approx(other["phi"], abs=1e-9)


def test_inputs_with_formulas_and_with_kinks_in_time():
    text = "model M input Real u = 0; Real x(start = 0, fixed = true); equation der(x) = u - x; end M;"
    dae = lmoc.compile_text(text)
    for u in ("sin(3*time)*exp(-time)", "time^2/(1 + time)", ([0, 1, 1, 2, 4], [0, 1, -1, 0, 3])):
        run, reference = both(dae, stop=3, points=7, rtol=1e-10, inputs={"u": u})
        assert run["x"] == pytest.approx(reference["x"], abs=1e-9)


@pytest.mark.parametrize("inputs", [{"u": "if time < 1 then 0 else 1"}, {"u": abs}, {"u": "abs(x)"}])
def test_where_there_is_no_series_dop853_does_it_and_the_run_says_so(inputs):
    text = "model M input Real u = 0; Real x(start = -1, fixed = true); equation der(x) = {}; end M;"
    own = text.format("abs(x) + 1" if inputs == {"u": "abs(x)"} else "u - x")
    run = lmoc.compile_text(own).simulate(solver="taylor", stop=2, inputs={} if "abs" in own else inputs)
    assert run.stats["solver"] == "dop853" and "taylor" in run.stats["reason"]


def test_a_pole_ends_the_run():
    dae = lmoc.compile_text("model M Real x(start = 1, fixed = true); equation der(x) = x^2; end M;")
    with pytest.raises(lmoc.SimulationError) as failure:
        dae.simulate(solver="taylor", stop=2, points=21)
    assert failure.value.time == pytest.approx(1.0, abs=1e-3)
    partial = failure.value.partial
    assert partial["x"][:9] == pytest.approx(1 / (1 - partial.time[:9]), rel=1e-4)


@pytest.mark.parametrize("room", [1, 6, 40])
@pytest.mark.parametrize("solver", ["taylor", "auto"])
def test_output_within_one_step_that_there_is_no_room_for_at_once(solver, room, monkeypatch):
    """As in large scenes; the last step, too, has many output times within, and one is at its end."""
    monkeypatch.setattr(loop, "_BATCH", room)
    monkeypatch.setattr(series_rule, "STEPS", 100)
    dae = lmoc.compile_text("model M Real x(start = 1, fixed = true); Real v; equation der(x) = v; der(v) = -x; end M;")
    run = dae.simulate(solver=solver, stop=200, points=5001, rtol=1e-9)
    assert "taylor" in run.stats["solver"] and run.stats["steps"] < 500
    assert run.complete and len(run.time) == 5001
    assert np.abs(run["x"] - np.cos(run.time)).max() < 3e-8


@pytest.mark.parametrize("rtol", [1e-3, 1e-4, 1e-5, 1e-6, 1e-8])
def test_a_step_does_not_lead_from_one_side_of_a_turn_to_the_mirrored_one(rtol):
    """Where y is the coordinate a long step over the top comes down again with x on the side where it went up."""
    dae = compiled("hard/h01_cartesian_pendulum")
    run, reference = both(dae, rtol=rtol)
    assert np.abs(run["x"] - reference["x"]).max() < 30 * rtol
