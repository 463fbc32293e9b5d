"""Every verb and every method ends: with an answer, or with what was reached, why it ends there, and what to change."""

import inspect
import time

import pytest
from conftest import ROOT
from oracles.models import compiled

import lmoc
from lmoc.cli.main import VERBS, main
from lmoc.session import Session
from lmoc.support import budget

SUSPENSION = str(ROOT / "models" / "notes" / "ex05_suspension.lmo")
SWING = """
model Swing "a stiff spring that needs some 1e10 steps"
  Fixed w; Spring s(k = 1e20); Mass m(m = 1, q(start = 1, fixed = true), v(start = 0, fixed = true)); Force push;
  input Real u = 0;
equation
  connect(w.flange, s.a); connect(s.b, m.flange); connect(m.flange, push.flange); push.f = u;
  annotation(experiment(StopTime = 1));
end Swing;
"""
# every run of an ensemble has one, and so have the run and the page of a widget
MADE_OF_OTHERS = {"at_start", "ensemble", "input_output_equation", "symbolic_ode", "widget"}


@pytest.fixture(autouse=True)
def often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(budget, "_EVERY", 0.02)


def without_end(*_: object, **__: object) -> None:
    while True:
        time.monotonic()


def test_every_method_has_a_budget():
    methods = {n: f for n, f in inspect.getmembers(lmoc.DAE, inspect.isfunction) if not n.startswith("_")}
    assert {n for n, f in methods.items() if not hasattr(f, "__wrapped__")} == MADE_OF_OTHERS
    assert hasattr(lmoc.compile, "__wrapped__") and hasattr(lmoc.compile_text, "__wrapped__")


@pytest.mark.parametrize("method", ["equations", "equilibria", "linearize", "symbolic_ode", "draw", "simulate", "view"])
def test_a_method_whose_work_does_not_end_says_so(method, monkeypatch):
    dae = compiled("notes/ex05_suspension")
    monkeypatch.setattr(Session, "prepare", without_end)
    monkeypatch.setattr(Session, "for_derivation", without_end)
    with lmoc.budget(0.2), pytest.raises(lmoc.ModelError) as error:
        getattr(dae, method)()
    (found,) = error.value.diagnostics
    assert found.code == "E0557" and "--budget 0.8" in found.hint and "lmoc.budget(0.8)" in found.hint


def test_a_run_keeps_what_it_has_reached():
    dae = lmoc.compile_text(SWING)
    with lmoc.budget(0.5), pytest.raises(lmoc.SimulationError) as error:
        dae.simulate()
    run = error.value.partial
    assert 0 < error.value.time < 1e-3 and run.time[0] == 0 and run["m.q"][0] == 1
    assert "is s.k = 1e+20 meant?" in str(error.value) and "lmoc.budget(2)" in str(error.value)


def test_a_function_given_as_an_input_may_not_end():
    dae = lmoc.compile_text(SWING.replace("1e20", "1"))
    with lmoc.budget(0.3), pytest.raises(lmoc.SimulationError) as error:
        dae.simulate(inputs={"u": lambda t: 0.0 if t < 0.5 else without_end()})
    assert error.value.time <= 0.5


def test_one_run_of_a_sweep_that_does_not_end_does_not_end_the_others():
    dae = lmoc.compile_text(SWING)
    with lmoc.budget(0.5):
        found = dae.sweep({"s.k": [1.0, 1e20, 4.0]})
    assert [run.complete for run in found.runs] == [True, False, True] and list(found.failed) == [(1e20,)]


def test_a_step_of_a_live_scene_ends():
    live = lmoc.compile_text(SWING).live()
    with lmoc.budget(0.3), pytest.raises(lmoc.SimulationError) as error:
        live.advance(1.0)
    assert 0 < error.value.time < 1e-3 and live.time == 0


@pytest.mark.parametrize("verb", [v for v in VERBS if v not in ("explain", "solvers")])
def test_every_verb_has_the_option(verb, capsys):
    with pytest.raises(SystemExit):
        main([verb, "--help"])
    assert "--budget SECONDS" in capsys.readouterr().out


def test_the_command_keeps_the_result_and_says_what_to_change(tmp_path, capsys):
    (tmp_path / "swing.lmo").write_text(SWING)
    code = main(["run", str(tmp_path / "swing.lmo"), "--budget", "0.5", "-o", str(tmp_path / "kept.csv")])
    said = capsys.readouterr().err
    assert code == 3 and "hardly moved on" in said and "--budget 2" in said and "kept.csv" in said
    assert (tmp_path / "kept.csv").read_text().startswith("time")


@pytest.mark.parametrize("verb", ["run", "check", "equations", "linearize", "equilibria"])
@pytest.mark.parametrize("value", ["1e308", "1e30", "1e-308"])
def test_absurd_numbers_end_by_themselves(verb, value, capsys):
    """Without the help of the clock: hopeless runs are known by the pace of their steps."""
    code = main([verb, SUSPENSION, "--set", f"k1={value}"])
    assert code in (0, 1, 2, 3)  # 2: there is no linear model for such numbers
    if (verb, value) in (("run", "1e308"), ("run", "1e30")):
        assert code == 3 and f"is k1 = {float(value):g}, tire.k" in capsys.readouterr().err


@pytest.mark.parametrize("power", ["(-2)^(10^400)", "(1/3)^(10^8)", "2^(10^9)"])
def test_powers_that_nobody_can_write_down_are_not_worked_out(power):
    text = "model M Real x(start = 1, fixed = true), v(start = 0, fixed = true); equation der(x) = v; der(v) = -x"
    dae = lmoc.compile_text(f"{text} - v*{power}; end M;")
    assert "x" in str(dae.equations()) and len(dae.equilibria()) == 1


def test_too_little_memory_is_said(monkeypatch, capsys):
    def greedy(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr(Session, "prepare", greedy)
    with pytest.raises(lmoc.ModelError) as error:
        lmoc.compile(SUSPENSION).simulate()
    assert error.value.diagnostics[0].code == "E0559" and isinstance(error.value, MemoryError)
    assert main(["run", SUSPENSION]) == 1 and "not enough memory" in capsys.readouterr().err
