"""Inputs that jump: the run stops at the jump and goes on behind it."""

import numpy as np
import pytest
from oracles.by_hand import oscillator

from lmoc.numerics.options.options import ADAPTIVE, RunOptions
from lmoc.numerics.plan.kinks import break_times
from lmoc.numerics.run.simulate import Simulator, simulate


def rest(**more):
    return oscillator(m=1.0, k=9.0, q0=0.0, **more).reduced()


def breaks(formula: str, start=0.0, stop=10.0):
    simulator = Simulator(rest())
    run = simulator.run(inputs={"f": formula}, options=RunOptions(times=[0.0]))
    return break_times(run.observer.plan, run.observer.base, start, stop)


@pytest.mark.parametrize(
    ("formula", "expected"),
    [
        ("if time < 1.25 then 0 else 4", [1.25]),
        ("if 2*time - k >= 1 then 0 else 4", [5.0]),  # k = 9
        ("max(0, time - 3)", [3.0]),
        ("abs(2 - time)", [2.0]),
        ("if time > 2 and time <= 2.0001 then 1e3 else 0", [2.0, 2.0001]),
        ("if sin(time) > 0 then 1 else -1", [0, np.pi, 2 * np.pi, 3 * np.pi]),
        ("if time < 0 then 1 else if time > 20 then 2 else 3", [0.0]),
        ("if time < -1 then 1 else if time > 20 then 2 else 3", []),
        ("floor(time/4)", [4.0, 8.0]),
        ("if mod(time, 4) < 1 then 1 else 0", [1.0, 4.0, 5.0, 8.0, 9.0]),
        ("sin(time)", []),
        ("time^2", []),
    ],
)
def test_where_a_formula_jumps(formula, expected):
    assert breaks(formula) == pytest.approx(np.array(expected), rel=1e-12)


@pytest.mark.parametrize("solver", ["dop853", "cvode", "ida", "radau"])
@pytest.mark.parametrize("relation", ["<", "<="])
def test_a_step_with_an_output_time_upon_it(solver, relation):
    options = RunOptions(solver=solver, rtol=1e-9, atol=1e-12, points=101)
    run = simulate(rest(), options=options, inputs={"f": f"if time {relation} 2 then 0 else 18"})
    assert len(run.time) == 101 and run.time[20] == 2.0
    exact = np.where(run.time < 2, 0, 2 * (1 - np.cos(3 * (run.time - 2))))
    assert run["q"] == pytest.approx(exact, abs=2e-6)
    assert run.stats["breaks"] == 1


def test_a_short_pulse_is_not_missed():
    """At rest the steps grow long; a pulse of 1 N.s within 0.1 ms still starts the motion."""
    run = simulate(rest(), inputs={"f": "if time >= 5 and time < 5.0001 then 1e4 else 0"})
    exact = np.where(run.time < 5.0001, 0, np.sin(3 * (run.time - 5.00005)) / 3)
    assert run["q"] == pytest.approx(exact, abs=1e-5)
    assert run.energy.balance < 1e-4


def test_a_square_wave_against_the_sum_of_its_steps():
    run = simulate(rest(), inputs={"f": "if sin(time) > 0 then 9 else -9"}, options=RunOptions(rtol=1e-9))
    exact = 1 - np.cos(3 * run.time)
    for n in (1, 2, 3):
        after = run.time > n * np.pi
        exact += np.where(after, 2 * (-1) ** n * (1 - np.cos(3 * (run.time - n * np.pi))), 0)
    assert run["q"] == pytest.approx(exact, abs=1e-7)


@pytest.mark.parametrize("solver", ["auto", "cvode"])
@pytest.mark.parametrize(
    ("formula", "share"),
    [
        ("if mod(time, {0}) < {0}/4 then 1 else 0", 1 / 4),
        ("if mod(time + {0}/3, {0}) < {0}/1000 then 1 else 0", 1 / 1000),
        ("if sin(6.283185307179586*time/{0}) > 0.5 then 1 else 0", 1 / 3),
        ("if sin(6.283185307179586*time/{0}) > 0.9999995 then 1 else 0", 1e-3 / np.pi),
    ],
    ids=["mod", "short", "sine", "peaks"],
)
@pytest.mark.parametrize("period", [2.5, 0.01])
def test_pulses_are_not_missed(solver, formula, share, period):
    """v' = u for a train of pulses; the whole run is a number of periods."""
    system = oscillator(m=1.0, k=0.0, q0=0.0, ledger=False).reduced()
    options = RunOptions(solver=solver, stop=100 * period if period < 1 else 10.0, points=5)
    run = simulate(system, options=options, inputs={"f": formula.format(period)})
    assert run["v"][-1] == pytest.approx(share * options.stop, rel=1e-6)


@pytest.mark.parametrize("solver", ADAPTIVE)
@pytest.mark.parametrize("start", [5.0])
def test_kinks_at_both_ends_of_a_run(solver, start):
    """The formula is 9 between them: nothing of what is beyond reaches the run."""
    options = RunOptions(solver=solver, start=start, stop=start + 2, rtol=1e-9)
    one = simulate(rest(), options=options, inputs={"f": f"if time > {start} and time < {start + 2} then 9 else 0"})
    two = simulate(rest(), options=options, inputs={"f": 9})
    if one.stats["solver"] == two.stats["solver"]:  # a formula with kinks is left to another method by some
        assert one.stats["steps"] <= two.stats["steps"] + 2
    assert one["q"] == pytest.approx(1 - np.cos(3 * (one.time - start)), abs=1e-6)


@pytest.mark.parametrize("solver", ADAPTIVE)
def test_more_kinks_than_output_times(solver):
    options = RunOptions(solver=solver, times=[0.0, 3.0])
    run = simulate(rest(), options=options, inputs={"f": "if mod(time, 0.5) < 0.25 then 9 else 0"})
    fine = simulate(
        rest(), options=RunOptions(stop=3.0, rtol=1e-11), inputs={"f": "if mod(time, 0.5) < 0.25 then 9 else 0"}
    )
    assert run["q"][-1] == pytest.approx(fine["q"][-1], abs=1e-4)
    assert run.stats["breaks"] == 12  # the end is one of them


def test_more_kinks_than_a_run_stops_at_are_told(monkeypatch):
    monkeypatch.setattr("lmoc.numerics.plan.kinks.MOST", 100)
    run = simulate(rest(), inputs={"f": "if mod(time, 0.1) < 0.05 then 1 else 0"})
    assert [n.code for n in run.notes if n.severity == "warning"] == ["W0526"]
    assert run.stats["breaks"] == 100
