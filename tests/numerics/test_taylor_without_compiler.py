"""Taylor series written out in casadi, where there is no C compiler: the same answers as those of C, and its limits."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT

import lmoc
from lmoc.expression.functions import SMOOTH
from lmoc.numerics.evaluate import casadi_series
from lmoc.numerics.evaluate.native.compiler import find_compiler

INSIDE = {"acosh": "1.5 + 0.3*sin(x)", "log": "1.5 + 0.3*sin(x)", "log10": "1.5 + 0.3*sin(x)"}


@pytest.fixture
def no_compiler(monkeypatch):
    """Return what has no C compiler be found from then on; it is looked for once, so anew before and after."""

    def without() -> None:
        monkeypatch.setenv("LMOC_CC", "")
        find_compiler.cache_clear()

    yield without
    monkeypatch.undo()
    find_compiler.cache_clear()


def model(variables: str, equations: str):
    return lmoc.compile_text(f"model M {variables} equation {equations} end M;")


def largest_difference(dae, one, two) -> float:
    """Return the difference of the states of two runs, in parts of the largest values of each kind of states."""
    size = {name.rsplit(".", 1)[-1]: 0.0 for name in dae.states}
    for name in dae.states:
        kind = name.rsplit(".", 1)[-1]
        size[kind] = max(size[kind], np.abs(two[name]).max())
    return max(np.abs(one[n] - two[n]).max() / (size[n.rsplit(".", 1)[-1]] or 1.0) for n in dae.states)


@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize(
    ("name", "stop", "grown"), [("planar/pendulum", 10.0, 10), ("planar/double_pendulum", 2.0, 10),
                                ("classic/pleiades", 2.0, 1000), ("notes/ex02_spring_mass_damper", 5.0, 10),
                                ("classic/slider_crank", 0.3, 10)],
)  # fmt: skip
def test_the_same_steps_and_answers_as_in_c(name, stop, grown, rtol, no_compiler):
    dae = lmoc.compile(ROOT / f"models/{name}.lmo")
    options = {"stop": stop, "points": 51, "rtol": rtol, "energy": False}
    exact = dae.simulate(**{**options, "solver": "dop853", "rtol": 1e-13})
    compiled = dae.simulate(solver="taylor", **options) if find_compiler() else None
    no_compiler()
    run = dae.simulate(solver="taylor", **options)
    assert (run.stats["solver"], run.stats["evaluation"]) == ("taylor", "casadi")
    assert largest_difference(dae, run, exact) < 30 * grown * rtol + 1e-11
    if compiled is not None:
        assert compiled.stats["evaluation"] == "C"
        assert abs(run.stats["steps"] - compiled.stats["steps"]) <= 1
        assert largest_difference(dae, run, compiled) < grown * 1e-12


def test_every_function_has_its_series(no_compiler):
    no_compiler()
    functions = {name: f"{name}({INSIDE.get(name, '0.4 + 0.3*sin(x)')})" for name in SMOOTH}
    for k, power in enumerate(["x^1.5", "x^(-2)", "x^x", "x^5", "1/x"]):
        functions[f"power_{k}"] = power.replace("x", "(1.2 + sin(x)/2)")
    functions["atan2"] = "atan2(sin(x), 0.5 + cos(x)^2)"
    names = [f"y_{name}" for name in functions]
    starts = ", ".join(f"{name}(start = 0, fixed = true)" for name in names)
    equations = " ".join(f"der({y}) = {f};" for y, f in zip(names, functions.values(), strict=True))
    dae = model(f"Real x(start = 0.2, fixed = true); Real {starts};", f"der(x) = 1 + y_sin/9; {equations}")
    run = dae.simulate(solver="taylor", stop=2, points=21, rtol=1e-11)
    reference = dae.simulate(solver="dop853", stop=2, points=21, rtol=1e-13)
    assert run.stats["solver"] == "taylor"
    for name in names:
        assert run[name] == pytest.approx(reference[name], rel=1e-10, abs=1e-11), name


@pytest.mark.parametrize("start", [1.0, 1e-9])
def test_a_start_from_rest_does_not_fool_the_step_control(start, no_compiler):
    no_compiler()
    dae = model(f"Real x(start = {start}, fixed = true), v(start = 0, fixed = true);", "der(x) = v; der(v) = -sin(x);")
    options = {"stop": 6, "points": 61, "atol": 1e-12 * start}
    run, reference = (dae.simulate(solver=s, rtol=r, **options) for s, r in (("taylor", 1e-9), ("dop853", 1e-13)))
    assert run.stats["solver"] == "taylor"
    assert np.abs(run["x"] - reference["x"]).max() < 1e-7 * start


def test_a_pole_ends_the_run(no_compiler):
    no_compiler()
    with pytest.raises(lmoc.SimulationError) as failure:
        model("Real x(start = 1, fixed = true);", "der(x) = x^2;").simulate(solver="taylor", stop=2, points=21)
    assert failure.value.time == pytest.approx(1.0, abs=1e-3)


def test_no_value_where_the_equations_have_none(no_compiler):
    """The root of x ends at x = 0, which the series of an earlier place does not know."""
    no_compiler()
    dae = model("Real x(start = 1, fixed = true), y(start = 0, fixed = true);", "der(x) = -1; der(y) = sqrt(x);")
    with pytest.raises(lmoc.SimulationError) as failure:
        dae.simulate(solver="taylor", stop=2, points=21)
    assert failure.value.time == pytest.approx(1.0, abs=1e-3)


def test_no_series_where_a_function_has_no_derivative(no_compiler):
    """Nor is one made up by dividing what vanishes by itself: the equation has many solutions."""
    no_compiler()
    with pytest.raises(lmoc.SimulationError, match="no finite value") as failure:
        model("Real x(start = 0, fixed = true);", "der(x) = sqrt(x);").simulate(solver="taylor", stop=1)
    assert failure.value.time == 0.0


def test_parameters_starts_and_formulas_of_the_next_run_count(no_compiler):
    no_compiler()
    variables = "parameter Real k = 1; input Real u = 0; Real x(start = 1, fixed = true), v(start = 0, fixed = true);"
    dae = model(variables, "der(x) = v; der(v) = u - k*x;")
    options = {"stop": 3, "points": 7, "rtol": 1e-11}
    dae.simulate(solver="taylor", **options)
    run = dae.simulate(solver="taylor", parameters={"k": 4}, initial={"x": 0.5}, **options)
    assert run.stats["solver"] == "taylor" and run["x"] == pytest.approx(0.5 * np.cos(2 * run.time), abs=1e-9)
    run = dae.simulate(solver="taylor", initial={"x": 0.0}, inputs={"u": "2*cos(time)"}, **options)
    assert run.stats["solver"] == "taylor" and run["x"] == pytest.approx(run.time * np.sin(run.time), abs=1e-9)


def test_a_nonlinear_block_follows_its_branch(no_compiler):
    """A circle in x and z, which is solved for z by Newton's method at order zero."""
    no_compiler()
    for sign in (1, -1):
        dae = model(
            f"Real x(start = 0.1, fixed = true), y(start = 0, fixed = true); Real z(start = {sign});",
            "der(x) = 0.4; der(y) = z; z^2 + x^2 = 1;",
        )
        run = dae.simulate(solver="taylor", stop=2, points=11, rtol=1e-10)
        assert run.stats["solver"] == "taylor"
        assert run["z"] == pytest.approx(sign * np.sqrt(1 - (0.1 + 0.4 * run.time) ** 2), abs=1e-8)
        area = [(x * np.sqrt(1 - x * x) + np.arcsin(x)) / 2 for x in (0.1 + 0.4 * run.time, 0.1)]
        assert run["y"] == pytest.approx(sign * (area[0] - area[1]) / 0.4, abs=1e-9)


def test_what_there_is_no_series_of_says_why(no_compiler, monkeypatch):
    no_compiler()
    oscillator = "Real x(start = 1, fixed = true), v(start = 0, fixed = true);"
    run = model(oscillator, "der(x) = v; der(v) = -x*abs(x);").simulate(solver="taylor", stop=1)
    assert run.stats["solver"] == "dop853" and "in place of taylor" in run.stats["reason"]
    assert "'abs' has kinks" in run.stats["reason"]
    monkeypatch.setattr(casadi_series, "LARGEST", 100)
    run = model(oscillator, "der(x) = v; der(v) = -sin(x);").simulate(solver="taylor", stop=1)
    assert run.stats["solver"] == "dop853" and "without a C compiler the series would take" in run.stats["reason"]


def test_the_solver_chosen_automatically_stays_with_dop853(no_compiler):
    """Its steps are faster than those made in Python."""
    no_compiler()
    dae = model("Real x(start = 1, fixed = true), v(start = 0, fixed = true);", "der(x) = v; der(v) = -sin(x);")
    assert dae.simulate(stop=2000, rtol=1e-9, points=5).stats["solver"] == "dop853"
