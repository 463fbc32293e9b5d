"""Runs of an ensemble that go through C together: the bits of single runs, whatever is asked of them."""

import numpy as np
import pytest
from conftest import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st

import lmoc
from lmoc.engine.library import Many, address, at_once
from lmoc.numerics.evaluate import taylor_system
from lmoc.studies import batch, lanes
from lmoc.support.records import dataclass

DUFFING = """
model Duffing
  parameter Real k = 4, c = 0.1, b = 1, a = 0.5, w = 1.3;
  parameter Real k2 = 2*k + sin(c);
  input Real f = a*sin(w*time);
  Real x(start = 1 + 0.1*k, fixed = true), v(start = 0, fixed = true);
  output Real y = k2*x^2 + exp(-v)*f;
equation
  der(x) = v;
  der(v) = -k*x - c*v - b*x^3 + f;
end Duffing;
"""
STIFF = """
model Stiff
  parameter Real k = 1000;
  Real x(start = 1, fixed = true), y(start = 0, fixed = true);
equation
  der(x) = -k*(x - cos(time));
  der(y) = x - y;
end Stiff;
"""
LOST = """
model Lost
  parameter Real a = 1;
  output Real x(start = 1, fixed = true);
equation
  der(x) = -a*sqrt(x)/(x + 0.01);
end Lost;
"""
LONG = (ROOT / "models/planar/chain.lmo").read_text().replace("n = 5", "n = 10")  # with sparse factors
COUPLED = """
model Coupled "accelerations from a linear block"
  parameter Real m = 1, g = 9.81;
  Real a(start = 0.3, fixed = true), b(start = -0.5, fixed = true);
  Real u(start = 0, fixed = true), v(start = 0, fixed = true);
equation
  der(a) = u;
  der(b) = v;
  (2 + m)*der(u) + cos(a - b)*der(v) = -sin(a - b)*v^2 - g*sin(a)*2;
  cos(a - b)*der(u) + m*der(v) = sin(a - b)*u^2 - g*sin(b)*m;
end Coupled;
"""
TRIPLE = """
model Triple "a linear block whose order of pivots is another in each run"
  parameter Real m = 1;
  Real a(start = 0.3, fixed = true), b(start = -0.5, fixed = true);
  Real u(start = 0, fixed = true), v(start = 0, fixed = true), w(start = 1, fixed = true);
equation
  der(a) = u;
  der(b) = v;
  m*der(u) + cos(a - b)*der(v) + sin(a)*der(w) = -a*w^2;
  cos(a - b)*der(u) - m*der(v) + cos(b)*der(w) = -b*u;
  sin(a)*der(u) + cos(b)*der(v) + (m - 1)*der(w) = -w;
end Triple;
"""


NOMINAL = """
model Nominal "sizes that parameters give"
  parameter Real k = 4, s = 1e-4;
  output Real x(start = s, fixed = true, nominal = s);
  Real v(start = 0, fixed = true, nominal = 2*s);
equation
  der(x) = v;
  der(v) = -k*x - x^3;
end Nominal;
"""


@dataclass(frozen=True)
class Scene:
    """A model, and names in it with the ranges of their values."""

    model: object
    parameters: dict
    initial: dict
    inputs: dict


def _scenes():
    yield Scene(DUFFING, {"k": (0.5, 40), "c": (0, 2), "a": (0, 3)}, {"x": (-2, 2)}, {"f": (-1, 1)})
    yield Scene(STIFF, {"k": (1, 5000)}, {"y": (-1, 1)}, {})
    yield Scene(LOST, {"a": (-1, 1)}, {}, {})
    yield Scene(COUPLED, {"m": (0.5, 2), "g": (1, 10)}, {"u": (-3, 3)}, {})
    yield Scene(ROOT / "models/notes/ex05_suspension.lmo", {"k1": (1e5, 2e5), "m2": (200, 400)}, {}, {"u": (-0.1, 0.1)})
    yield Scene(ROOT / "models/planar/double_pendulum.lmo", {"upper.l": (0.5, 1)}, {"elbow.phi": (-2, 2)}, {})
    yield Scene(ROOT / "models/planar/chain.lmo", {"m": (0.5, 2)}, {}, {})
    yield Scene(LONG, {"l": (0.5, 1)}, {}, {})
    yield Scene(NOMINAL, {"k": (1, 9), "s": (1e-6, 1e-2)}, {}, {})
    yield Scene(TRIPLE, {"m": (-2, 3)}, {"u": (-1, 1)}, {})


SCENES = list(_scenes())
KEPT = {}


def _compiled(k):
    """Two sessions of a scene: for ensembles, and for single runs."""
    if k not in KEPT:
        model = SCENES[k].model
        KEPT[k] = [lmoc.compile_text(model) if isinstance(model, str) else lmoc.compile(model) for _ in range(2)]
    return KEPT[k]


@settings(max_examples=15, deadline=None)
@given(st.integers(0, len(SCENES) - 1), st.data())
def test_lanes_have_the_bits_of_single_runs(k, data):
    scene, (many, single) = SCENES[k], _compiled(k)
    rng = np.random.default_rng(data.draw(st.integers(0, 10_000)))
    solver = data.draw(st.sampled_from(["auto", "auto", "dop853", "taylor"]))
    options = {
        "stop": data.draw(st.sampled_from([0.3, 2.0, 9.0])),
        "rtol": data.draw(st.sampled_from([1e-3, 1e-6, 1e-9])),
        "atol": data.draw(st.sampled_from([None, None, 1e-7])),
        "solver": solver,
        "points": data.draw(st.sampled_from([1, 2, 7, 60])) + 1,
        "max_step": data.draw(st.sampled_from([None, None, 0.05])),
        "energy": data.draw(st.booleans()),
    }
    count = 5
    drawn = [
        {name: rng.uniform(*own, count) for name, own in table.items() if data.draw(st.booleans())}
        for table in (scene.parameters, scene.initial, scene.inputs)
    ]
    if not any(drawn):
        drawn[0] = {name: rng.uniform(*own, count) for name, own in scene.parameters.items()}
    parameters, initial, inputs = drawn
    got = many.ensemble(parameters, initial or None, inputs or None, workers=1, **options)
    for row in range(count):
        own = [{name: float(values[row]) for name, values in table.items()} for table in drawn]
        try:
            run = single.simulate(parameters=own[0], initial=own[1] or None, inputs=own[2], **options)
        except lmoc.SimulationError as error:
            assert got.failed[row] and got.reasons[row] == str(error)
            continue
        assert not got.failed[row], got.reasons[row]
        for name in got.kept:
            assert np.array_equal(got[name][row], run[name], equal_nan=True), (name, row)
            assert np.array_equal(got.end[name][row], run[name][-1], equal_nan=True)


def _in_lanes(monkeypatch, dae, *given, **options):
    """The rows that have gone through C."""
    found = set()

    def seen(job, rows):
        made = lanes.rows_in_lanes(job, rows)
        found.update(row for part, _ in made for row in part)
        return made

    monkeypatch.setattr(batch, "rows_in_lanes", seen)
    return found, dae.ensemble(*given, workers=1, **options)


@pytest.mark.parametrize("k", [0, 1, 3, 4, 5, 6, 7, 8])
def test_smooth_scenes_go_through_c(monkeypatch, k):
    name, own = next(iter(SCENES[k].parameters.items()))
    solver = "dop853" if k == 1 else "auto"
    values = np.linspace(*own, 4)
    found, many = _in_lanes(monkeypatch, _compiled(k)[0], {name: values}, stop=2.0, points=20, solver=solver)
    assert found == {0, 1, 2, 3} and not many.failed.any()


@pytest.mark.parametrize(("k", "rtol"), [(0, 1e-6), (3, 1e-9)])
def test_long_runs_go_through_c(monkeypatch, k, rtol):
    """Behind the steps by which they are judged they go on along series, each with the tolerance that follows."""
    many, single = _compiled(k)
    name, own = next(iter(SCENES[k].parameters.items()))
    values = np.linspace(*own, 4)
    found, runs = _in_lanes(monkeypatch, many, {name: values}, stop=60.0, points=7, rtol=rtol)
    assert found == {0, 1, 2, 3}
    for row, value in enumerate(values.tolist()):
        run = single.simulate(parameters={name: value}, stop=60.0, points=7, rtol=rtol)
        assert run.stats["steps"] > 100 and run.stats["solver"] == "taylor"
        assert all(np.array_equal(runs[kept][row], run[kept]) for kept in runs.kept)


def test_rows_that_cannot_go_through_c_are_made_one_by_one(monkeypatch):
    """A stiff one goes to another method, one that fails tells why, one whose guard breaks has another reduction."""
    found, many = _in_lanes(monkeypatch, _compiled(1)[0], {"k": [1.0, 2.0, 1e7]}, stop=50.0, points=20, rtol=1e-8)
    assert found == {0, 1} and not many.failed.any()
    assert many["x"][2, -1] == pytest.approx(np.cos(50.0), abs=1e-5)
    found, many = _in_lanes(monkeypatch, _compiled(2)[0], {"a": [0.1, 1.0]}, stop=2.0)
    assert found == {0} and many.failed.tolist() == [False, True] and "stopped" in many.reasons[1]
    oscillator = lmoc.compile_text(
        "model M Mass m(m = 1, q(start = 1)); Spring s(k = 9); Fixed w; equation "
        "connect(w.flange, s.a); connect(s.b, m.flange); end M;"
    )
    found, many = _in_lanes(monkeypatch, oscillator, {"s.k": [9.0, 4.0, 0.0]}, stop=2.0, keep=("m.q",))
    assert {0, 1} <= found and many.end["m.q"] == pytest.approx(np.cos([6.0, 4.0, 0.0]), abs=1e-5)


def test_formulas_and_numbers_for_each_run(monkeypatch):
    many, single = _compiled(0)
    given = ["sin(time)", 0.5, "sin(time)", "time^2"]
    found, runs = _in_lanes(monkeypatch, many, {"k": [1.0, 2.0, 3.0, 4.0]}, None, {"f": given}, stop=1.0, points=5)
    assert found == {0, 1, 2, 3}
    for row, signal in enumerate(given):
        run = single.simulate(stop=1.0, points=5, parameters={"k": row + 1.0}, inputs={"f": signal})
        assert np.array_equal(runs["y"][row], run["y"])


@pytest.mark.parametrize(("k", "solver"), [
    (0, "auto"), (3, "auto"), (5, "auto"), (9, "auto"), (1, "dop853"), (2, "dop853"), (5, "dop853"), (9, "dop853"),
])  # fmt: skip
def test_as_many_lanes_as_the_processor_likes_change_no_bit(monkeypatch, k, solver):
    """Four at a time is what others have; one at a time what a scene with sparse factors has."""
    model, name = SCENES[k].model, next(iter(SCENES[k].parameters))
    values, found = np.linspace(*SCENES[k].parameters[name], 11), []
    for many in (at_once(), Many.from_address(address("lmoc_four")), None):
        monkeypatch.setattr(taylor_system, "at_once", lambda many=many: many)
        dae = lmoc.compile_text(model) if isinstance(model, str) else lmoc.compile(model)
        stop = 0.3 if model is TRIPLE else 2.0  # its matrices become singular all the time
        found.append(dae.ensemble({name: values}, stop=stop, points=20, workers=1, solver=solver))
    for runs in found[1:]:
        assert all(np.array_equal(runs[kept], found[0][kept], equal_nan=True) for kept in runs.kept)


def test_threads_share_the_rows_and_change_nothing():
    dae, values = _compiled(5)[0], np.linspace(0.5, 1, 40)
    one, two = (dae.ensemble({"upper.l": values}, stop=1.0, points=30, workers=n) for n in (1, 2))
    assert all(np.array_equal(one[name], two[name]) for name in one.kept)


def test_a_small_motion_is_run_again_at_its_size():
    many, single = _compiled(5)
    got = many.ensemble(initial={"elbow.phi": [1e-7, 1.0]}, stop=1.0, points=10, workers=1)
    for row, angle in enumerate((1e-7, 1.0)):
        run = single.simulate(initial={"elbow.phi": angle}, stop=1.0, points=10)
        assert all(np.array_equal(got[name][row], run[name]) for name in got.kept)


def test_scenes_with_laws_are_planned_once(monkeypatch):
    """Whatever the modes and the numbers: what is kept for one run serves all."""
    from lmoc.numerics.plan.plan import build_plan as plan
    from lmoc.numerics.run import simulate

    planned = []
    monkeypatch.setattr(simulate, "build_plan", lambda *given: planned.append(1) or plan(*given))
    dae = lmoc.compile(ROOT / "models/laws/h19_bouncing_ball.lmo")
    values = {"e": np.linspace(0.5, 0.8, 6)}, {"ball.q": np.linspace(1, 2, 6)}
    many = dae.ensemble(*values, stop=2.0, points=5, workers=1)
    assert len(planned) == 1 and not many.failed.any() and all(many.events)


MASSLESS = """
model Massless "two springs and a damper in series, and a lever: forces from linear blocks"
  Fixed wall; Spring s1(k = 2), s2(k = 3), s3(k = 1); Damper d(c = 1); Mass m(m = 1, q(start = 1), v(start = 0));
equation
  connect(wall.flange, s1.a); connect(s1.b, s2.a); connect(s2.b, s3.a); connect(s3.b, m.flange);
  connect(wall.flange, d.a); connect(d.b, s2.b);
end Massless;
"""


@pytest.mark.parametrize("model", [MASSLESS, COUPLED, LONG])
def test_assumptions_on_the_values_of_many_runs_are_those_of_each(model):
    reduced, rng = lmoc.compile_text(model)._session.reduced, np.random.default_rng(3)
    values = np.repeat(reduced.values[:, None], 60, axis=1)
    known = np.flatnonzero(np.isfinite(reduced.values))
    for column in values.T[1:]:
        some = rng.choice(known, 2)
        column[some] *= rng.choice([0, -1, -1.5, 1e-20, 1e20, 2, np.nan], 2)
    held = reduced.guards_hold(values)
    assert held.tolist() == [reduced.broken_guard(own.copy()) is None for own in values.T]
    assert held[0] and not held.all()
