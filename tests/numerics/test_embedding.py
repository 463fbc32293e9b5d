"""A scene inside other programs: copies for other processes, threads, and what a run is as a mapping of names."""

import copy
import multiprocessing
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from conftest import ROOT, SPRING

import lmoc
from lmoc.expression import dag

SUSPENSION = ROOT / "models/notes/ex05_suspension.lmo"
LEVER = ROOT / "models/hard/h08_turning_lever.lmo"  # nonlinear constraints
CHAIN = ROOT / "models/bench/chain.lmo"
CRANKS = ROOT / "models/planar/three_cranks.lmo"  # constraints that follow from others
FOUR_BAR = ROOT / "models/planar/four_bar.lmo"
DRIVE = ROOT / "models/laws/drivetrain.lmo"


def copied(thing):
    return pickle.loads(pickle.dumps(thing))


@pytest.mark.parametrize("file", [SUSPENSION, LEVER, CHAIN, CRANKS, FOUR_BAR, DRIVE], ids=lambda f: f.stem)
def test_a_copy_of_a_scene_runs_as_the_scene_does(file):
    dae = lmoc.compile(file)
    run = dae.simulate(stop=0.2, points=5)  # the solver's own functions stay behind
    for twin in (copied(dae), copy.deepcopy(dae)):
        assert twin.states == dae.states
        again = twin.simulate(stop=0.2, points=5)
        np.testing.assert_allclose(again.trajectory.table, run.trajectory.table, rtol=1e-9, atol=1e-12)  # C from now on


def test_a_copy_takes_other_parameters_and_reduces_again():
    twin = copied(lmoc.compile(SUSPENSION))
    assert [n.code for n in twin.simulate(stop=0.1, parameters={"m1": 0}).notes] == ["N0631"]
    assert str(twin.equations()) == str(lmoc.compile(SUSPENSION).equations())


def test_a_copy_of_a_run_still_computes_variables_when_asked():
    run = lmoc.compile(SUSPENSION).simulate(stop=1, points=11)
    twin = copied(run)
    assert np.array_equal(twin["tire.f"], run["tire.f"])
    assert twin.energy.balance == run.energy.balance


def test_copies_of_expressions_are_the_same_nodes():
    x = dag.slot(0)
    expression = dag.function("sin", x * 3.0) + x**2
    assert copied(expression) is expression
    assert copy.deepcopy(expression) is expression


def test_errors_reach_another_process_with_all_they_say():
    with pytest.raises(lmoc.ModelError) as found:
        lmoc.compile_text("model A\n  Real x;\nequation\n  x = y;\nend A;")
    twin = copied(found.value)
    assert [d.code for d in twin.diagnostics] == ["E0201"]
    assert str(twin) == str(found.value)
    run = lmoc.compile(SUSPENSION).simulate(stop=1, points=11)
    failure = copied(lmoc.SimulationError("too stiff", 0.5, run))
    assert failure.time == 0.5 and np.array_equal(failure.partial["body.q"], run["body.q"])


def end_of_body(dae, stiffness):
    return float(dae.simulate(stop=0.5, points=3, parameters={"k1": stiffness})["body.q"][-1])


def test_processes_share_a_scene():
    dae, values = lmoc.compile(SUSPENSION), [1e5, 2e5]
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        ends = pool.starmap(end_of_body, [(dae, k) for k in values])
    assert ends == [end_of_body(dae, k) for k in values]


def test_threads_that_share_a_scene_do_not_mix_their_runs():
    dae, values = lmoc.compile(SUSPENSION), np.linspace(1e5, 3e5, 6).tolist()
    alone = [end_of_body(dae, k) for k in values]
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(lambda k: end_of_body(dae, k), values * 3))
    assert together == alone * 3


def test_a_run_is_a_mapping_of_names():
    run = lmoc.compile_text(SPRING).simulate(points=3)
    names = list(run)
    assert names[0] == "time" and {"f", "x", "body.q", "spring.f"} <= set(names)
    assert all(len(run[name]) == 3 for name in names)
    assert list(lmoc.compile_text(SPRING).simulate(points=3, keep=["x"])) == ["time", "x"]


def test_one_name_can_be_kept():
    run = lmoc.compile_text(SPRING).simulate(points=3, keep="x")
    assert run.kept == ["x"]


@pytest.mark.parametrize("solver", ["dop853", "cvode", "ida", "cvodes", "radau"])
@pytest.mark.parametrize("wrong", ["a", None, [1.0, 2.0]], ids=["text", "nothing", "two"])
def test_a_function_that_gives_no_number_is_told(solver, wrong):
    dae = lmoc.compile_text(SPRING)
    with pytest.raises(lmoc.ModelError, match="function for input 'f' does not return a number at t = 1.") as found:
        dae.simulate(inputs={"f": lambda t: wrong if t > 1 else 1}, solver=solver)
    assert found.value.diagnostics[0].code == "E0521"


def test_arrays_of_one_number_are_numbers():
    dae = lmoc.compile_text(SPRING)
    plain = dae.simulate(inputs={"f": 2})["x"]
    assert np.array_equal(dae.simulate(inputs={"f": np.array(2)})["x"], plain)
    assert np.allclose(dae.simulate(inputs={"f": lambda t: np.array([2.0])})["x"], plain, atol=1e-6)


def test_a_mistake_in_a_function_is_the_callers():
    with pytest.raises(ZeroDivisionError):
        lmoc.compile_text(SPRING).simulate(inputs={"f": lambda t: 1 / (t - t)})


@pytest.mark.parametrize(
    "text, words",
    [
        ("time;f\n0;1\n", "it has one point, and needs two"),
        ("time,f\n0,1\n\n1,\n", "an empty cell is not a number\n --> .*:4:3"),
        ("time,f\n0,1\n1\n", "this line has 1 column, the header has 2\n --> .*:3:1"),
        ("seconds,f\n0,1\n", "a header line with a column 'time'"),
    ],
)
def test_tables_that_cannot_be_used(tmp_path, text, words):
    (tmp_path / "table.csv").write_text(text)
    with pytest.raises(lmoc.ModelError, match=words):
        lmoc.compile_text(SPRING).simulate(inputs={"f": tmp_path / "table.csv"})


@pytest.mark.parametrize("text", ["\ufefftime,f\n0,2\n3,2\n", "time, f\r\n0, 2\r\n3, 2\r\n", '"time","f"\n0,2\n\n3,2'])
def test_tables_as_spreadsheets_write_them(tmp_path, text):
    (tmp_path / "table.csv").write_bytes(text.encode())
    dae = lmoc.compile_text(SPRING)
    run = dae.simulate(inputs={"f": tmp_path / "table.csv"}, rtol=1e-9)  # tables have no series, and numbers have one
    assert np.allclose(run["x"], dae.simulate(inputs={"f": 2}, rtol=1e-9)["x"], atol=1e-7)


@pytest.mark.parametrize("name", ["parameters", "initial", "inputs"])
def test_what_is_given_by_name_is_a_mapping(name):
    dae = lmoc.compile_text("model M Mass m(m = 1); end M;")
    with pytest.raises(TypeError, match=f"{name} must be a mapping"):
        dae.simulate(**{name: [1, 2]})
