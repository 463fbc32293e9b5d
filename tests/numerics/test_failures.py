"""Runs that cannot go well end in words, with what was computed until then; odd ones that can go well do."""

import signal
from pathlib import Path

import numpy as np
import pytest
from oracles.by_hand import Scene, oscillator

import lmoc
from lmoc.expression import dag
from lmoc.messages.diagnostics import ModelError, RunInterrupted, SimulationError
from lmoc.numerics.events.hybrid_dynamics import HybridDynamics
from lmoc.numerics.failures.flood import Flood
from lmoc.numerics.options.options import ADAPTIVE, MOREAU, SOLVERS, RunOptions
from lmoc.numerics.problem import base
from lmoc.numerics.run.one_segment import SegmentSolver
from lmoc.numerics.run.segments import _Run
from lmoc.numerics.run.simulate import simulate
from lmoc.numerics.steps import loop
from lmoc.numerics.steps.choice import table
from lmoc.numerics.steps.roots import RootFinder
from lmoc.numerics.sundials import sundials

LAWS = Path(__file__).parents[2] / "models" / "laws"
every_solver = pytest.mark.parametrize("solver", ADAPTIVE)


def one_state(rate, start: float = 1.0):
    """x' = rate(x)."""
    s = Scene()
    x = s.state("x", start)
    s.rate(x, rate(x))
    return s.reduced()


def relaxing(k: float):
    """x' = -k·(x - cos t) - sin t from x = 1, so x = cos t."""
    return one_state(lambda x: -k * (x - dag.function("cos", dag.TIME)) - dag.function("sin", dag.TIME))


# ------------------------------------------------------------------ values that are lost


def logarithm_from_half(x):
    """1, and from t = 0.5 the logarithm of a negative number."""
    late = dag.function("gt", dag.TIME, dag.const(0.5))
    return dag.if_(late, dag.function("log", -1 * x), dag.const(1.0))


@every_solver
@pytest.mark.parametrize(
    ("rate", "start", "end", "words"),
    [
        (lambda x: -1.0 * dag.function("sqrt", x), 0.25, 1.0, "no finite value"),  # x = (1 - t)²/4, then √ of less
        (lambda x: x * x, 1.0, 1.0, "the step size collapsed"),  # x = 1/(1 - t)
        (logarithm_from_half, 1.0, 0.5, r"der\(x\) has no finite value"),
    ],
    ids=["root", "pole", "logarithm"],
)
def test_a_right_hand_side_that_loses_its_value(solver, rate, start, end, words):
    try:
        run = simulate(one_state(rate, start), options=RunOptions(solver=solver, stop=2.0))
    except SimulationError as failure:
        assert failure.time == pytest.approx(end, abs=0.03)
        partial = failure.partial
        assert len(partial.time) > 0.9 * 501 * end / 2
        assert np.isfinite(partial["x"]).all() and partial.time[-1] <= failure.time
        assert f"the run stopped at t = {failure.time:.6g} s of 2 s" in str(failure)
    else:
        assert start == 0.25 and run["x"][-1] == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize(
    ("equations", "line"),
    [
        ("Real y(start = 0, fixed = true);\nReal x(start = 1, fixed = true);\nequation der(y) = 1; der(x) = x^2;", 3),
        ("Real x(start = 1, fixed = true);\nequation der(x) = -0.5/x;", 2),
        ("Real y;\nReal w;\nReal x(start = 0, fixed = true);\nequation y = x; w = y; der(x) = 1/(time - 2)^2;", 4),
    ],
)
def test_the_state_that_grows_without_bound_is_named_with_its_line(equations, line):
    with pytest.raises(SimulationError, match=rf"collapsed: x \(.*, line {line}\) changes without bound"):
        lmoc.compile_text(f"model M\n{equations}\nend M;").simulate(stop=4)


@every_solver
def test_a_value_that_ends_with_the_state_is_named(solver):
    s = Scene()
    x, y = s.state("x", 1.0), s.state("y", 0.0)
    s.rate(x, -1.0)
    s.rate(y, dag.function("sqrt", x))
    with pytest.raises(SimulationError, match=r"der\(y\) has no finite value"):
        simulate(s.reduced(), options=RunOptions(solver=solver, stop=2.0))


TEXT = "model M Real x(start = 0, fixed = true); Real y = {}; equation der(x) = 1; end M;"


def lost(value: str, **options) -> list[str]:
    """What is said of a value y that is lost."""
    run = lmoc.compile_text(TEXT.format(value)).simulate(**options)
    return [note.message for note in run.notes if note.code == "W0537"]


def test_a_value_that_is_lost_and_comes_back_is_told():
    assert lost("sqrt((x - 5.01)^2 - 1)", stop=10) == ["y has no finite value (nan) at t = 4.02 s"]
    assert not lost("sqrt((x - 5.01)^2 - 1)", stop=4)
    assert not lost("sqrt((x - 5.01)^2 - 1)", times=[0, 3, 7])


def test_a_kink_is_not_the_reason_of_short_steps(monkeypatch):
    """It rings at 1 GHz through a kink, in a run of a second: it turns back on both sides, but not at the kink."""
    monkeypatch.setattr(loop, "_STALL", 300)
    text = """model A Real x(start = 1, fixed = true); Real v(start = 0, fixed = true); equation der(x) = v;
      der(v) = -1e7*v - 1e18*smooth(0, if x > 0 then x else 2*x); end A;"""
    with pytest.raises(lmoc.SimulationError) as raised:
        lmoc.compile_text(text).simulate(stop=1)
    assert "steps" in str(raised.value) and "back and forth" not in str(raised.value)


def test_a_value_that_nobody_takes_is_not_missed():
    """The logarithm has no value from t = 4 on."""
    (message,) = lost("if x < 5 then x else log(4 - x)", stop=10)
    assert 5 <= float(message.split("t = ")[1].split()[0]) < 7
    assert not lost("if x < 3 then log(4 - x) else x", stop=10)


# ------------------------------------------------------------------ accuracy


@every_solver
@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
def test_the_error_is_as_small_as_the_tolerance_says(solver, rtol):
    run = simulate(oscillator(c=0.5).reduced(), options=RunOptions(solver=solver, rtol=rtol, stop=5.0, points=301))
    m, k, c = 2.0, 50.0, 0.5
    d = c / (2 * m)
    w = np.sqrt(k / m - d * d)
    exact = 0.1 * np.exp(-d * run.time) * (np.cos(w * run.time) + d / w * np.sin(w * run.time))
    assert np.abs(run["q"] - exact).max() < 0.1 * 200 * rtol


@every_solver
@pytest.mark.parametrize("k", [1e2, 1e4])
def test_a_stiff_problem_between_the_steps_too(solver, k):
    run = simulate(relaxing(k), options=RunOptions(solver=solver, stop=3.0))
    assert run["x"] == pytest.approx(np.cos(run.time), abs=5e-5)


def test_radau_goes_back_where_its_output_would_be_rough():
    run = simulate(relaxing(1e6), options=RunOptions(solver="radau"))
    assert run.stats["rejected"] > 0
    assert run["x"] == pytest.approx(np.cos(run.time), abs=5e-6)


@every_solver
@pytest.mark.parametrize("size", [1e150, 1e-150])
def test_huge_and_tiny_values(solver, size):
    options = RunOptions(solver=solver, atol=1e-9 * size)
    run = simulate(oscillator(q0=size, ledger=False).reduced(), options=options)
    assert run["q"] / size == pytest.approx(np.cos(5 * run.time), abs=5e-4)


# ------------------------------------------------------------------ times


@every_solver
@pytest.mark.parametrize(
    ("rate", "options"),
    [
        (1.0, {"points": 2}),
        (1.0, {"times": [0.0, 1e-9, 1e-3, 1.0, 1.0 + 1e-14, 5.0, 9.0]}),
        (1.0, {"start": 1e9, "stop": 1e9 + 10}),
        (1.0, {"start": -5.0, "stop": 5.0}),
        (1e9, {"stop": 1e-8}),
        (1.0, {"stop": 1e-9}),
        (1e-9, {"stop": 1e9}),
    ],
    ids=["two", "uneven", "late", "negative", "short and fast", "short", "long"],
)
def test_odd_times(solver, rate, options):
    run = simulate(one_state(lambda x: -rate * x), options=RunOptions(solver=solver, **options))
    assert run["x"] == pytest.approx(np.exp(-rate * (run.time - run.time[0])), abs=2e-5)


@every_solver
def test_output_at_kinks(solver):
    """x' = |t - 1| + (t > 2): x = 1/2 ∓ (t - 1)²/2 + max(0, t - 2)."""
    jump = dag.if_(dag.function("gt", dag.TIME, dag.const(2.0)), dag.const(1.0), dag.const(0.0))
    system = one_state(lambda x: dag.function("abs", dag.TIME - 1.0) + jump, 0.0)
    times = np.array([0.0, 1 - 1e-15, 1.0, 1 + 1e-15, 1.5, 2.0, 2 + 1e-9, 3.0])
    run = simulate(system, options=RunOptions(solver=solver, times=times, rtol=1e-9))
    exact = 0.5 + np.sign(times - 1) * (times - 1) ** 2 / 2 + np.maximum(0, times - 2)
    assert run["x"] == pytest.approx(exact, abs=1e-7)


@every_solver
def test_no_states_and_quadratures_alone(solver):
    s = Scene()
    s.quadrature("w", dag.function("cos", dag.TIME))
    run = simulate(s.reduced(), options=RunOptions(solver=solver))
    assert run["w"] == pytest.approx(np.sin(run.time), abs=2e-5)
    s = Scene()
    s.define("w", dag.function("cos", dag.TIME))
    run = simulate(s.reduced(), options=RunOptions(solver=solver))
    assert run["w"] == pytest.approx(np.cos(run.time), abs=1e-15) and run.stats["solver"] == "none"


@every_solver
def test_a_motion_faster_than_numbers_can_tell(solver):
    """x'' = -1e300·x over a period of 6e-150 s."""
    options = RunOptions(solver=solver, stop=6e-150, points=7, atol=1e-7, max_steps=3000)
    try:
        run = simulate(oscillator(m=1.0, k=1e300, ledger=False).reduced(), options=options)
    except SimulationError as failure:  # squares overflow in the norms
        run = failure.partial
    assert run["q"] == pytest.approx(0.1 * np.cos(1e150 * run.time), abs=1e-2)


# ------------------------------------------------------------------ functions and tables as inputs


def failing(t):
    if t > 1:
        raise ValueError("my own mistake")
    return 0.0


@every_solver
def test_what_a_function_for_an_input_raises_is_passed_on_with_its_place(solver):
    with pytest.raises(ValueError, match="my own mistake") as raised:
        simulate(oscillator().reduced(), options=RunOptions(solver=solver), inputs={"f": failing})
    assert "input 'f' at t = 1." in raised.value.__notes__[0]


@every_solver
@pytest.mark.parametrize("value", [[1.0, 2.0], None, "a"])
def test_a_function_for_an_input_that_stops_to_return_numbers(solver, value):
    with pytest.raises(ModelError, match="input 'f' does not return a number at t = 1."):
        simulate(
            oscillator().reduced(), options=RunOptions(solver=solver), inputs={"f": lambda t: value if t > 1 else 0.0}
        )


@every_solver
def test_a_function_for_an_input_that_returns_no_number(solver):
    with pytest.raises(SimulationError, match=r"f has no finite value \(nan\)") as failure:
        simulate(
            oscillator().reduced(), options=RunOptions(solver=solver), inputs={"f": lambda t: np.nan if t > 1 else 0.0}
        )
    assert failure.value.time == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(
    ("table", "code", "words"),
    [
        (([0.0], [1.0]), "E0625", "one point, and needs two"),
        (([], []), "E0625", "no points, and needs two"),
        (([0, 2, 1], [0, 1, 2]), "E0625", "1 follows 2"),
        (([0, 1, 1, 1], [0, 1, 2, 3]), "E0625", "1 occurs more than twice"),
        (([0, 1], [0, np.nan]), "E0625", "not a finite number"),
        (([0, 1e-300], [0, 1]), "E0625", "too close together"),
        (([0, 1], [1]), "E0521", "not understood"),
        (np.ones((3, 3)), "E0521", "not understood"),
        (float("nan"), "E0521", "not finite"),
    ],
)
def test_tables_that_cannot_be_used(table, code, words):
    with pytest.raises(ModelError, match=words) as wrong:
        simulate(oscillator().reduced(), inputs={"f": table})
    assert wrong.value.diagnostics[0].code == code


# ------------------------------------------------------------------ ended from outside


@pytest.fixture
def watched(monkeypatch):
    """Progress at every look at the clock."""
    monkeypatch.setattr(base.Watch, "EVERY", 0.0)


@pytest.mark.parametrize("solver", [s for s in ADAPTIVE if s not in ("cvodes", "idas")])  # their run is one call
def test_what_the_report_of_progress_raises_is_passed_on(solver, watched):
    def report(t, stop):
        raise RuntimeError("no screen")

    with pytest.raises(RuntimeError, match="no screen"):
        simulate(oscillator().reduced(), options=RunOptions(solver=solver, stop=300), progress=report)


@every_solver
def test_an_interrupted_run_keeps_what_it_has(solver):
    def push(t):
        if t > 5:
            signal.raise_signal(signal.SIGINT)
        return 0.0

    with pytest.raises(RunInterrupted, match="it was interrupted") as stopped:
        simulate(oscillator().reduced(), options=RunOptions(solver=solver, rtol=1e-8), inputs={"f": push})
    partial = stopped.value.partial
    assert 0 < stopped.value.time <= 5 and len(partial.time) > 200
    assert partial["q"] == pytest.approx(0.1 * np.cos(5 * partial.time), abs=1e-5)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("place", [(HybridDynamics, "roots"), (HybridDynamics, "after"), (SegmentSolver, "_problem")])
def test_a_run_that_is_interrupted_outside_of_the_integration_keeps_what_it_has(place, monkeypatch):
    """Where events follow each other closely, a signal comes at an event more often than between two."""
    scene = lmoc.compile_text("""
        model Often Real x(start = 0, fixed = true); discrete Integer n(start = 0, fixed = true);
        equation der(x) = 1; when sample(0, 0.01) then n = pre(n) + 1; end when; end Often;""")
    work, calls = getattr(*place), []

    def interrupted(*arguments):
        calls.append(arguments)
        if len(calls) == 40:
            raise KeyboardInterrupt
        return work(*arguments)

    monkeypatch.setattr(_Run, "_through_segments", lambda run, x: (x, False))  # which takes what C has made as a whole
    monkeypatch.setattr(*place, interrupted)
    with pytest.raises(RunInterrupted, match="it was interrupted") as stopped:
        scene.simulate(stop=100, points=100_001)
    partial = stopped.value.partial
    assert stopped.value.time == pytest.approx(0.4, abs=0.02)
    assert stopped.value.time - 0.011 < partial.time[-1] <= stopped.value.time
    np.testing.assert_allclose(partial["x"], partial.time, atol=1e-12)


@every_solver
def test_an_interruption_between_a_step_and_the_search_for_its_roots(solver, monkeypatch):
    """What the step has gone beyond, here the floor, is no part of the run."""
    ball = lmoc.compile_text("""model Ball
        Mass m(m = 1, g = -10, q(start = 1, fixed = true), v(start = 0, fixed = true));
        Stop s(L = 0, e = 0.9); Fixed w; equation connect(w.flange, s.a); connect(s.b, m.flange); end Ball;""")
    first = RootFinder.first

    def interrupted(finder, run, end):
        found = first(finder, run, end)
        if found is not None and found[0] > 0.5:
            raise KeyboardInterrupt
        return found

    monkeypatch.setattr(_Run, "_through_segments", lambda run, x: (x, False))  # which looks for roots in C
    monkeypatch.setattr(RootFinder, "first", interrupted)
    with pytest.raises(RunInterrupted) as stopped:
        ball.simulate(stop=3.0, solver=solver, points=301)
    partial = stopped.value.partial
    assert partial.time[-1] <= stopped.value.time <= 0.2**0.5 * 2.8 and partial["m.q"].min() > -1e-12


def test_an_interruption_while_segments_follow_each_other_in_c(monkeypatch):
    """What has been made is taken, and the run ends there."""
    ball = lmoc.compile(LAWS / "h19_bouncing_ball.lmo")
    whole, count, calls = ball.simulate(), Flood.count, []

    def interrupted(flood, time, records):
        calls.append(time)
        if len(calls) == 5:
            signal.raise_signal(signal.SIGINT)
        count(flood, time, records)

    monkeypatch.setattr(Flood, "count", interrupted)
    with pytest.raises(RunInterrupted) as stopped:
        ball.simulate()
    partial, end = stopped.value.partial, stopped.value.time
    assert 5 <= len(partial.events) and end == calls[-1]
    assert partial.events == whole.events[: len(partial.events)]
    np.testing.assert_array_equal(partial["y"][:-1], whole["y"][: len(partial.time) - 1])
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@every_solver
@pytest.mark.parametrize("limit", [{"max_seconds": 0.0}, {"max_steps": 100}], ids=["time", "steps"])
def test_a_run_that_takes_too_long(solver, limit):
    with pytest.raises(SimulationError, match="too many steps|the time limit of the run was reached") as failure:
        simulate(oscillator().reduced(), options=RunOptions(solver=solver, stop=1e4, **limit))
    partial = failure.value.partial
    assert 0 <= failure.value.time < 100 and len(partial.time) >= 1
    assert partial["q"] == pytest.approx(0.1 * np.cos(5 * partial.time), abs=1e-3)


# ------------------------------------------------------------------ libraries, and what the statistics say


def test_the_table_of_the_integrators_in_the_documentation():
    text = (Path(__file__).parents[2] / "docs/architecture.md").read_text(encoding="utf-8")
    for one in table():
        assert f"| {' | '.join((f'`{one.name}`', *one.cells[1:]))} |" in text
    assert {one.name for one in table()} | {"auto", MOREAU} == set(SOLVERS)


def test_radau_ends_where_its_output_stays_rough_by_rounding():
    """A step that is no smoother when it is shorter is taken, or the run ends: it is not tried again for ever."""
    dae = lmoc.compile(Path(__file__).parents[2] / "models/laws/gear_shift.lmo")
    try:
        run = dae.simulate(solver="radau", rtol=1e-12)
    except SimulationError as failure:
        run = failure.partial
        assert "the step size collapsed" in str(failure) and run.time[-1] >= 2
    exact = dae.simulate(rtol=1e-12)
    common = np.isin(run.time, exact.time)
    q = run.states[0]
    assert run[q][common] == pytest.approx(exact[q][: common.sum()], rel=1e-8, abs=1e-8)


@pytest.fixture
def without_sundials(monkeypatch):
    monkeypatch.setattr(sundials, "_load", lambda: None)


@pytest.mark.parametrize("solver", ["cvode", "adams", "ida"])
def test_a_solver_that_is_not_at_hand(solver, without_sundials):
    with pytest.raises(ModelError, match="the SUNDIALS libraries of scikit-sundae were not found") as wrong:
        simulate(oscillator().reduced(), options=RunOptions(solver=solver))
    assert wrong.value.diagnostics[0].code == "E0540"


def test_a_stiff_run_without_sundials_goes_on_with_radau(without_sundials):
    run = simulate(relaxing(1e6), options=RunOptions(rtol=1e-7))
    assert run.stats["solver"] == "taylor, radau"
    assert run["x"] == pytest.approx(np.cos(run.time), abs=1e-6)


def test_the_statistics_name_what_has_done_the_work():
    options = RunOptions(solver="cvodes")
    assert simulate(oscillator().reduced(), options=options).stats["solver"] == "cvodes"
    stats = simulate(oscillator().reduced(), options=options, inputs={"f": lambda t: 0.0}).stats
    assert (stats["solver"], stats["reason"]) == ("cvode", "in place of cvodes, which cannot do this run")


@pytest.mark.parametrize("keep", [None, ["y"]])
@pytest.mark.parametrize("solver", ["dop853", "cvode", "ida", "radau"])
def test_a_partial_result_ends_where_the_run_broke_off(solver, keep):
    dae = lmoc.compile_text("model M Real x(start = 1, fixed = true), y; equation der(x) = x^2; y = 2*x; end M;")
    with pytest.raises(lmoc.SimulationError) as caught:
        dae.simulate(stop=2, points=3, solver=solver, keep=keep)
    partial = caught.value.partial
    assert partial.time[-1] == caught.value.time == pytest.approx(1, abs=1e-3)
    assert len(partial["y"]) == len(partial.time) and partial["y"][-1] > 1e6
