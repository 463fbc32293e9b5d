"""Whole runs on systems written by hand: solvers, inputs, parameters, energy, observed variables."""

from pathlib import Path

import numpy as np
import pytest
from oracles.by_hand import Scene, oscillator

import lmoc
from lmoc.expression import dag
from lmoc.ir.flat import Check
from lmoc.ir.program import Apply, Solve, Total
from lmoc.messages.diagnostics import ModelError, SimulationError
from lmoc.numerics.options.options import ADAPTIVE, RunOptions
from lmoc.numerics.run.simulate import Simulator, simulate


@pytest.mark.parametrize("solver", ADAPTIVE)
def test_every_solver_on_the_undamped_oscillator(solver):
    run = simulate(oscillator().reduced(), options=RunOptions(solver=solver, rtol=1e-9, atol=1e-12, points=101))
    assert run.time == pytest.approx(np.linspace(0, 10, 101), abs=0)
    assert run["q"] == pytest.approx(0.1 * np.cos(5 * run.time), abs=1e-6)
    assert run["a"] == pytest.approx(-2.5 * np.cos(5 * run.time), abs=3e-5)


@pytest.mark.parametrize("solver", ADAPTIVE)
def test_energy_of_a_driven_damped_oscillator(solver):
    options = RunOptions(solver=solver, rtol=1e-6)
    run = simulate(oscillator(c=0.7).reduced(), options=options, inputs={"f": "3*sin(2*time)"})
    assert run.energy.scale > 0.1
    assert run.energy.balance < 1e-4


def test_times_are_those_asked_for():
    times = [0.5, 0.7, 3.0]
    run = simulate(oscillator().reduced(), options=RunOptions(start=0.5, times=times))
    assert run.time.tolist() == times
    assert run["q"] == pytest.approx(0.1 * np.cos(5 * (np.array(times) - 0.5)), abs=1e-5)
    assert len(simulate(oscillator().reduced(), options=RunOptions(times=[2.0])).time) == 1


@pytest.mark.parametrize("solver", ADAPTIVE)
def test_a_run_begins_at_its_start_whatever_times_are_asked_for(solver):
    options = {"solver": solver, "times": [3.0, 4.0, 5.0], "rtol": 1e-8}
    for start in ({}, {"start": 0.0}):
        run = simulate(oscillator().reduced(), options=RunOptions(**options, **start))
        assert run.time.tolist() == [3.0, 4.0, 5.0]
        assert run["q"] == pytest.approx(0.1 * np.cos(5 * run.time), abs=1e-5)
    with pytest.raises(ModelError, match="the first output time 3 s lies before the start time 3.5 s"):
        simulate(oscillator().reduced(), options=RunOptions(**options, start=3.5))


@pytest.mark.parametrize("solver", ADAPTIVE)
def test_no_step_is_longer_than_the_longest_allowed(solver):
    run = simulate(
        oscillator(m=1.0, k=1.0).reduced(), options=RunOptions(solver=solver, stop=10, max_step=0.02, rtol=1e-3)
    )
    assert run.stats["steps"] >= 500


@pytest.mark.parametrize(
    "signal",
    [
        "sin(2*time)",
        lambda t: np.sin(2 * t),
        (np.linspace(0, 10, 200_001), np.sin(2 * np.linspace(0, 10, 200_001))),
        dag.function("sin", 2 * dag.TIME),
    ],
    ids=["formula", "callable", "table", "expression"],
)
def test_signals_of_every_kind(signal):
    run = simulate(oscillator(m=1.0, k=9.0, q0=0.0).reduced(), options=RunOptions(rtol=1e-9), inputs={"f": signal})
    t = run.time
    exact = np.sin(2 * t) / 5 - 2 * np.sin(3 * t) / 15
    assert run["q"] == pytest.approx(exact, abs=2e-8)
    assert run["f"] == pytest.approx(np.sin(2 * t), abs=1e-8)


def test_formulas_use_parameters_of_the_model():
    simulator = Simulator(oscillator(m=1.0, k=9.0, q0=0.0).reduced())
    run = simulator.run(inputs={"f": "k*2"})
    assert run["q"] == pytest.approx(2 - 2 * np.cos(3 * run.time), abs=1e-5)


def test_a_number_as_input_and_parameters_change_without_lowering_again():
    simulator = Simulator(oscillator(m=1.0, k=1.0, q0=0.0).reduced())
    for force in (1.0, 2.0):
        for k in (4.0, 25.0):
            values = simulator.reduced.values.copy()
            values[simulator.reduced.flat.find("k")] = k
            run = simulator.run(values, inputs={"f": force})
            assert run["q"] == pytest.approx(force / k * (1 - np.cos(np.sqrt(k) * run.time)), abs=1e-5)
            assert (run["k"] == k).all()
    assert len(simulator._systems) == 1


def prescribed(order_two: bool) -> Scene:
    """No states: an angle prescribed by u, and the torque it takes, which needs u''."""
    s = Scene()
    u = s.input("u")
    ddu = s.input("ddu")
    s.define("theta", u / 3)
    s.define("tau", 0.02 * ddu + 0.9 / 9 * ddu)
    reduced = s.reduced()
    inputs = np.array([[0, 1], [0, 0], [0, 2]])  # register of ddu holds the second derivative of u
    object.__setattr__(reduced, "inputs", inputs)
    object.__setattr__(reduced, "required_inputs", np.array([True, order_two]))
    return reduced


def test_no_states_is_evaluation_on_the_times():
    run = simulate(prescribed(True), inputs={"u": "0.3*sin(4*time)"})
    assert run.stats["solver"] == "none"
    assert run["theta"] == pytest.approx(0.1 * np.sin(4 * run.time), abs=1e-15)
    assert run["tau"] == pytest.approx(-4.8 * 0.12 * np.sin(4 * run.time), abs=1e-14)


def test_derivatives_of_tables_and_callables():
    t = np.linspace(0, 10, 4001)
    run = simulate(prescribed(True), inputs={"u": (t, 0.3 * np.sin(4 * t))})
    assert run["tau"] == pytest.approx(-4.8 * 0.12 * np.sin(4 * run.time), abs=1e-4)
    with pytest.raises(ModelError) as wrong:
        simulate(prescribed(True), inputs={"u": lambda t: np.sin(t)})
    assert wrong.value.diagnostics[0].code == "E0522" and "der(der(u))" in str(wrong.value)
    run = simulate(prescribed(False), inputs={"u": lambda t: np.sin(t)})
    assert np.isnan(run["tau"]).all() and any(n.code == "N0523" for n in run.notes)

    class Swing:
        def __call__(self, t):
            return 0.3 * np.sin(4 * t)

        def derivative(self, n):
            return lambda t: 0.3 * 4**n * np.sin(4 * t + n * np.pi / 2)

    run = simulate(prescribed(True), inputs={"u": Swing()})
    assert run["tau"] == pytest.approx(-4.8 * 0.12 * np.sin(4 * run.time), abs=1e-12)


@pytest.mark.parametrize(
    ("inputs", "code", "words"),
    [
        ({}, "E0520", "'u'"),
        ({"v": 1.0}, "E0622", "the inputs are u, ddu"),
        ({"u": "sin(tmie)"}, "E0521", "did you mean 'time'"),
        ({"u": "sin(2"}, "E0521", "not a formula"),
        ({"u": ([0, 1, 0.5], [0, 1, 2])}, "E0625", "decrease"),
        ({"u": ([0, 1, 1, 10], [0, 1, 2, 2])}, "E0522", "there its values jump"),
        ({"u": "missing.csv"}, "E0610", "missing.csv"),
        ({"u": {"a": 1}}, "E0521", "a number, a formula"),
    ],
)
def test_wrong_inputs(inputs, code, words):
    with pytest.raises(ModelError) as wrong:
        simulate(prescribed(True), inputs=inputs)
    assert wrong.value.diagnostics[0].code == code
    assert words in str(wrong.value)


def test_table_from_a_file(tmp_path):
    path = tmp_path / "push.csv"
    path.write_text("time,f,other\n0,0,9\n1,1,9\n2,8,9\n3,27,9\n10,1000,9\n")
    run = simulate(oscillator().reduced(), inputs={"f": str(path)})
    assert run["f"] == pytest.approx(np.interp(run.time, [0, 1, 2, 3, 10], [0, 1, 8, 27, 1000]), abs=1e-12)


@pytest.mark.parametrize(
    ("options", "code"),
    [
        (RunOptions(solver="ode45"), "E0540"),
        (RunOptions(rtol=-1.0), "E0541"),
        (RunOptions(rtol="fine"), "E0541"),
        (RunOptions(rtol=np.nan), "E0541"),
        (RunOptions(atol=0.0), "E0541"),
        (RunOptions(atol=[1e-6, 1e-6]), "E0541"),
        (RunOptions(stop=-1.0), "E0541"),
        (RunOptions(times=[0.0, 0.0]), "E0541"),
        (RunOptions(points=1), "E0541"),
    ],
)
def test_wrong_options(options, code):
    with pytest.raises(ModelError) as wrong:
        simulate(oscillator().reduced(), options=options)
    assert wrong.value.diagnostics[0].code == code


def test_only_the_tolerances_given_are_quoted():
    with pytest.raises(ModelError, match="found rtol = 2$"):
        simulate(oscillator().reduced(), options=RunOptions(rtol=2.0))
    with pytest.raises(ModelError, match="found rtol = 1e-06, atol = 0$"):
        simulate(oscillator().reduced(), options=RunOptions(atol=0.0))


def test_a_parameter_without_value_is_named():
    s = oscillator()
    s.bindings = [b for b in s.bindings if b.target[0] != 1]
    with pytest.raises(ModelError) as wrong:
        simulate(s.reduced())
    assert wrong.value.diagnostics[0].code == "E0530" and "'k'" in str(wrong.value)


def test_keep_retains_only_what_is_named():
    run = simulate(oscillator().reduced(), options=RunOptions(keep=("a", "q")))
    assert run["a"] == pytest.approx(-25 * run["q"], abs=1e-12)
    assert run.energy is not None
    with pytest.raises(KeyError, match="not kept"):
        run["v"]


def test_names_are_looked_up_with_a_hint():
    run = simulate(oscillator().reduced())
    with pytest.raises(KeyError, match="ledger.stored"):
        run["ledger.store"]
    assert run.at(-1)[run.observer.flat.find("q")] == pytest.approx(run["q"][-1])


def test_energy_left_out():
    run = simulate(oscillator().reduced(), options=RunOptions(energy=False))
    assert run.energy is None
    assert len(run.table[0]) == 2


def with_check(error: bool):
    s = oscillator()
    condition = dag.function("ge", dag.slot(0), dag.const(-0.05))
    check = Check(condition, "the spring hits the wall", error, np.array([[s.names.index("q")]]), None)
    return s.reduced(checks=(check,))


def test_assertions():
    with pytest.raises(SimulationError, match="hits the wall") as failure:
        simulate(with_check(True))
    assert failure.value.time == pytest.approx(np.arccos(-0.5) / 5, abs=1e-6)
    assert failure.value.partial.time[-2] < failure.value.time <= failure.value.partial.time[-1]
    with pytest.raises(SimulationError, match="hits the wall"):
        simulate(with_check(True), options=RunOptions(keep=("v",)))
    run = simulate(with_check(False))
    assert [n.code for n in run.notes] == ["W0551"]


def test_progress_is_reported():
    told = []
    options = RunOptions(solver="dop853", stop=1e5, points=2)
    simulate(oscillator().reduced(), options=options, progress=lambda t, stop: told.append((t, stop)))
    assert told and all(0 < t <= stop == 1e5 for t, stop in told) and told[0][0] < 1e5


@pytest.mark.parametrize("linear", [True, False])
def test_unknowns_of_a_large_block_are_algebraic_variables_of_ida(linear):
    """(3 + cos q[i])·a[i] - a[i-1] - a[i+1] = -q[i] for 70 accelerations a: sparse, and different at every step."""
    n, s = 70, Scene()
    q = [s.state(f"q{i}", 0.1 * (i % 7)) for i in range(n)]
    v = [s.state(f"v{i}") for i in range(n)]
    a = np.array([s.variable(f"a{i}").value[0] for i in range(n)])
    for i in range(n):
        s.rate(q[i], v[i])
        s.rate(v[i], dag.slot(int(a[i])))
    first = len(s.names) + 2 * n
    residual, product = first + np.arange(n), first + n + np.arange(n)
    shape = (3 + dag.function("cos", dag.slot(1))) * dag.slot(0) + dag.slot(1)
    inner = Apply(shape, np.stack([a, np.arange(n)], axis=1), product)
    terms = [[(product[i], 1.0)] + [(a[j], -1.0) for j in (i - 1, i + 1) if 0 <= j < n] for i in range(n)]
    index, coefficient = np.array([t for row in terms for t in row]).T
    total = Total(np.cumsum([0, *map(len, terms)]), index.astype(int), coefficient, residual)
    block = Solve((inner, total), a[None], residual[None], linear, False)
    reduced = s.reduced(steps=(block,), more_registers=2 * n)
    options = {"stop": 2.0, "points": 21, "rtol": 1e-8, "atol": 1e-11}
    one, two = (simulate(reduced, options=RunOptions(solver=name, **options)) for name in ("dop853", "ida"))
    assert two.stats["algebraic"] == n and "algebraic" not in one.stats
    for name in ("q3", "v69", "a10"):
        assert two[name] == pytest.approx(one[name], abs=1e-6)


@pytest.mark.parametrize("solver", ["cvode", "ida"])
def test_a_sparse_jacobian_that_fails_at_once_ends_the_run_in_order(solver: str, monkeypatch) -> None:
    from lmoc.numerics.steps import cvode

    def fail(*_args, **_more) -> None:
        raise ZeroDivisionError

    dae = lmoc.compile(Path(__file__).parents[2] / "models/bench/lattice.lmo", parameters={"N": 12})
    monkeypatch.setattr(cvode.Multistep, "fill", fail)
    with pytest.raises(ZeroDivisionError):
        dae.simulate(solver=solver)
