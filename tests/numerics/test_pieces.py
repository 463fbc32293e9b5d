"""Runs over the kinks of tables and formulas: pieces that the engine makes one after the other."""

import numpy as np
import pytest
from oracles.models import compiled

import lmoc
from lmoc.numerics.problem.base import Pieces
from lmoc.numerics.steps import choice

PUSHED = """
model M
  input Real u(unit = "N") = 0;
  Mass m(m = 2, q(fixed = true), v(fixed = true));
  Force f(f = u);
equation
  connect(f.flange, m.flange);
end M;
"""
NONE = Pieces((np.zeros(0), np.zeros(0), np.zeros(0)), np.zeros(0))
DROPPED = """
model Dropped
  input Real u(unit = "m") = 0;
  Motion floor(q = u);
  Mass ball(m = 1, g = -9.81, q(start = 0.2, fixed = true), v(fixed = true));
  Stop stop(e = 0.7, L = 0);
equation
  connect(floor.flange, stop.a);
  connect(stop.b, ball.flange);
end Dropped;
"""


def rows(count: int, stop: float, size: float = 1.0, jumps: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Return a table that is rough: lines, or steps."""
    rng = np.random.default_rng(count)
    times, values = np.sort(rng.uniform(0, stop, count)), size * rng.standard_normal(count + 1)
    return (np.repeat(times, 2), np.repeat(values, 2)[1:-1]) if jumps else (times, values[1:])


def velocity(times: np.ndarray, table: tuple[np.ndarray, np.ndarray], mass: float) -> np.ndarray:
    """Return the integral over time of a force by a table that holds its ends, for a mass at rest."""
    t, f = np.append(table[0], times), np.append(table[1], np.interp(times, *table))
    order = np.argsort(t, kind="stable")
    rise = np.append(0.0, np.cumsum((f[order][1:] + f[order][:-1]) / 2 * np.diff(t[order])))
    return rise[np.argsort(order)][len(table[0]) :] / mass


@pytest.mark.parametrize("solver", ["auto", "dop853", "taylor", "cvode"])
@pytest.mark.parametrize("jumps", [False, True])
def test_a_mass_under_a_force_by_a_table_moves_as_its_integral_says(solver, jumps):
    table = rows(60, 3.0, jumps=jumps)
    run = lmoc.compile_text(PUSHED).simulate(stop=4, points=401, inputs={"u": table}, solver=solver, rtol=1e-9)
    assert run["m.v"] - run["m.v"][0] == pytest.approx(velocity(run.time, table, 2.0), abs=1e-8)
    assert run.stats["breaks"] == 60 and run.energy.balance < 1e-6


def test_pieces_that_end_at_output_times_have_their_values():
    t = np.arange(101) / 20
    u = (-1.0) ** np.arange(101)
    run = lmoc.compile_text(PUSHED).simulate(times=t, inputs={"u": (t, u)})
    assert run.time.tolist() == t.tolist() and run["u"].tolist() == u.tolist()
    assert run["m.v"] == pytest.approx(np.zeros(101), abs=1e-13)


@pytest.mark.parametrize("solver", ["auto", "dop853", "taylor"])
@pytest.mark.parametrize("count", [12, 400])
def test_pieces_have_the_bits_of_pieces_made_one_by_one(count, solver, monkeypatch):
    """A piece of many steps goes by the rules of any run, between others that do not."""
    dae, (t, u) = compiled("notes/ex05_suspension"), rows(count, 3.0, 0.01)
    own = {"inputs": {"u": (np.where(t > 2, t + 6, t), u)}, "stop": 10.0, "rtol": 1e-8, "solver": solver}
    run = dae.simulate(**own)
    monkeypatch.setattr(choice._Following, "behind", lambda *_: NONE)
    other = dae.simulate(**own)
    for name in dae.states:
        assert run[name].tolist() == other[name].tolist()
    assert run.stats["breaks"] == other.stats["breaks"] == count


def test_kinks_of_formulas_are_passed_alike():
    table = np.arange(401) / 40, np.arange(401) % 2
    dae = lmoc.compile_text(PUSHED)
    one, two = (dae.simulate(inputs={"u": u}, rtol=1e-9) for u in (table, "abs(mod(40*time + 1, 2) - 1)"))
    assert one["m.q"] == pytest.approx(two["m.q"], abs=1e-9) and one.stats["breaks"] == 401


def test_a_ball_on_a_floor_by_a_table_bounces_as_on_one_by_its_formula():
    """The floor is a chain of lines, the same by both; the ball meets it at the same times."""
    dae, t = lmoc.compile_text(DROPPED), np.linspace(0, 1, 101)
    one, two = (dae.simulate(stop=1, inputs={"u": u}, rtol=1e-9) for u in ((t, 0.01 * t**2), "0.01*time^2"))
    assert [e.time for e in one.events] == pytest.approx([e.time for e in two.events], abs=1e-7)
    assert len(one.events) > 3 and one["ball.q"] == pytest.approx(two["ball.q"], abs=1e-7)


def test_a_bouncing_ball_has_the_bits_of_pieces_made_one_by_one(monkeypatch):
    dae, table = lmoc.compile_text(DROPPED), rows(200, 1.0, 0.0001)
    run = dae.simulate(stop=1, inputs={"u": table})
    monkeypatch.setattr(choice._Following, "behind", lambda *_: NONE)
    other = dae.simulate(stop=1, inputs={"u": table})
    assert [e.time for e in run.events] == [e.time for e in other.events] and len(run.events) > 2
    assert run["ball.q"].tolist() == other["ball.q"].tolist()


def test_runs_of_an_ensemble_have_their_own_tables():
    dae, tables = lmoc.compile_text(PUSHED), [rows(k, 1.0) for k in (5, 50)]
    many = dae.ensemble(inputs={"u": tables}, stop=1, points=11)
    for k, table in enumerate(tables):
        assert many["m.v"][k] == pytest.approx(dae.simulate(stop=1, points=11, inputs={"u": table})["m.v"], abs=0)
