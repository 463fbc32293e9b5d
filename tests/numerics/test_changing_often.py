"""Runs whose coordinates change often go on in all coordinates of their loops, and come back where that is needed."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.models import compiled, compiled_text
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

import lmoc
from lmoc.numerics.coordinates.watch import CoordinateWatch
from lmoc.numerics.formulations import manifold
from lmoc.numerics.problem.status import Status
from lmoc.numerics.run.changes import Changes, Continuation

PARALLELOGRAM = """
model Parallelogram "rods between particles; all three turn as one pendulum"
  Real bx(start = 0, fixed = true), by(start = 1), cx(start = 1), cy(start = 1);
  Real ux(start = 1, fixed = true), uy, wx, wy, S, T, U;
equation
  der(bx) = ux; der(by) = uy; der(cx) = wx; der(cy) = wy;
  der(ux) = -S*bx + T*(cx - bx); der(uy) = -S*by + T*(cy - by) - 9.81;
  der(wx) = -T*(cx - bx) - U*(cx - 1); der(wy) = -T*(cy - by) - U*cy - 9.81;
  bx^2 + by^2 = 1; (cx - bx)^2 + (cy - by)^2 = 1; (cx - 1)^2 + cy^2 = 1;
end Parallelogram;
"""
ROCKER = """
model Rocker "a four-bar of particles on rods, none of which can turn all the way"
  Real bx(start = 0, fixed = true), by(start = -0.8), cx(start = 0.5), cy(start = -0.6);
  Real ux(start = 1, fixed = true), uy, wx, wy, S, T, U;
equation
  der(bx) = ux; der(by) = uy; der(cx) = wx; der(cy) = wy;
  der(ux) = -S*bx + T*(cx - bx); der(uy) = -S*by + T*(cy - by) - 9.81;
  der(wx) = -T*(cx - bx) - U*(cx - 1); der(wy) = -T*(cy - by) - U*cy - 9.81;
  bx^2 + by^2 = 0.64; (cx - bx)^2 + (cy - by)^2 = 0.25; (cx - 1)^2 + cy^2 = 0.64;
end Rocker;
"""


class Crawled(Exception):
    pass


def pendulum_from_rest(times: np.ndarray) -> np.ndarray:
    """x and y (2, times) of a pendulum of 1 m released horizontally: sin(θ/2) = k·sn(K − ω·t, k), k² = 1/2."""
    period = 4 * ellipk(0.5)
    half = np.sqrt(0.5) * ellipj((period / 4 - np.sqrt(9.81) * times) % period, 0.5)[0]
    return np.array([2 * half * np.sqrt(1 - half**2), 2 * half**2 - 1])


def went_over(run: lmoc.Run) -> bool:
    return any(n.code == "N0635" for n in run.notes)


@pytest.fixture(scope="module")
def pendulum() -> lmoc.DAE:
    return compiled("planar/pendulum_cartesian")


@pytest.mark.parametrize("solver", ["auto", "taylor"])
def test_cartesian_pendulum_after_845_periods(pendulum, solver):
    run = pendulum.simulate(stop=2000, rtol=1e-10, solver=solver)
    x, y = pendulum_from_rest(run.time)
    assert went_over(run) and len(run.coordinates) < 6
    assert max(np.abs(run["x"] - x).max(), np.abs(run["y"] - y).max()) < 1e-6
    assert np.abs(run["x"] ** 2 + run["y"] ** 2 - 1).max() < 1e-12
    assert max(run.residual) < 1e-12


@pytest.mark.parametrize("solver", ["auto", "dop853"])
@pytest.mark.parametrize("rtol", [1e-3, 1e-6])
def test_the_outputs_are_those_of_few_coordinates(pendulum, solver, rtol):
    """Tensions, too: between the steps states are moved onto the closures."""
    runs = [pendulum.simulate(stop=40, rtol=rtol, solver=solver, formulation=f) for f in ("auto", "reduced")]
    assert went_over(runs[0]) and not went_over(runs[1])
    x, _ = pendulum_from_rest(runs[0].time)
    errors = [np.abs(run["x"] - x).max() for run in runs]
    assert errors[0] < 30 * errors[1] + rtol
    assert np.abs(runs[0]["lambda"] + 3 * 9.81 * runs[0]["y"]).max() < 100 * errors[0] + 1e-9


def test_few_changes_are_no_reason(pendulum):
    run = pendulum.simulate(stop=5)
    assert len(run.coordinates) > 4 and not went_over(run)


@pytest.mark.parametrize("solver", ["adams", "radau"])
def test_methods_that_have_to_begin_anew_stay_in_few_coordinates(pendulum, solver):
    assert not went_over(pendulum.simulate(stop=12, points=11, solver=solver))


def test_radau_comes_on_at_the_finest_tolerances():
    """Where a state passes zero, rounding of time alone makes its output rough: shorter steps would gain nothing."""
    dae = compiled_text("""model Turning
      Real x(start = 0, fixed = true), y(start = -1), vx(start = 7.1, fixed = true), vy, T;
    equation
      der(x) = vx; der(y) = vy; der(vx) = -T*x; der(vy) = -T*y - 9.81; x^2 + y^2 = 1;
    end Turning;""")
    run = dae.simulate(stop=0.7, points=8, solver="radau", rtol=1e-12)
    exact = solve_ivp(lambda t, z: [z[1], -9.81 * np.sin(z[0])], (0, 0.7), [0, 7.1], "DOP853", run.time, rtol=1e-13,
                      atol=1e-14).y[0]  # fmt: skip
    assert run["x"][-2] > 0 > run["x"][-1]
    assert np.abs(run["x"] - np.sin(exact)).max() < 1e-10


def test_a_linkage_that_only_swings_is_the_same_in_both():
    dae = compiled_text(ROCKER)
    run, other = (dae.simulate(stop=15, rtol=1e-10, formulation=f) for f in ("auto", "reduced"))
    assert went_over(run) and len(run.coordinates) < 10 < len(other.coordinates)
    for name in ("bx", "cy", "T"):
        assert np.abs(run[name] - other[name]).max() < 1e-5


@pytest.mark.parametrize(("solver", "rtol"), [("auto", 1e-7), ("auto", 1e-11), ("taylor", 1e-9)])
def test_singular_positions_of_four_rods_are_passed(rtol, solver):
    run = compiled_text(PARALLELOGRAM).simulate(stop=10, rtol=rtol, solver=solver)
    angle = solve_ivp(lambda t, z: [z[1], 9.81 * np.sin(z[0])], (0, 10), [0, 1], "DOP853", run.time, rtol=1e-13,
                      atol=1e-13).y[0]  # fmt: skip
    assert any(n.code == "N0633" and "10 singular positions" in n.message for n in run.notes)
    assert np.abs(run["bx"] - np.sin(angle)).max() < 300 * rtol + 1e-8
    assert np.abs(run["cx"] - 1 - np.sin(angle)).max() < 300 * rtol + 1e-8


def test_projection_in_c_is_that_of_numpy(monkeypatch):
    dae = lmoc.compile_text(ROCKER)
    options = {"stop": 2, "rtol": 1e-6, "formulation": "projected", "points": 41}
    run = dae.simulate(**options)
    monkeypatch.setattr(manifold, "landing", lambda *_: None)
    other = dae.simulate(**options)
    for name in ("bx", "uy", "cx", "wy"):
        assert np.abs(run[name] - other[name]).max() < 1e-8
    assert max(run.residual) < 1e-14 and max(other.residual) < 1e-14


@pytest.mark.parametrize("margin, status", [(0.05, Status.COORDINATES), (0.5, Status.CRAWLING)])
def test_steps_that_hardly_get_on_end_a_run_near_a_singular_position(monkeypatch, margin, status):
    """Elsewhere short steps may have other reasons: the longest one allowed, for example."""
    stuck, found = CoordinateWatch.stuck, []

    def near(watch, crawling):
        watch.accepted.head[3] = margin
        found.append(stuck(watch, crawling))
        raise Crawled

    monkeypatch.setattr(CoordinateWatch, "stuck", near)
    with pytest.raises(Crawled):
        lmoc.compile_text(ROCKER).simulate(stop=1.0, points=2, max_step=1e-9)
    assert found == [status]


def test_choices_that_take_turns_without_getting_on_end_a_run(monkeypatch):
    """Every step is said to need other coordinates, however short it is."""
    monkeypatch.setattr(CoordinateWatch, "__call__", lambda watch, t, x: Status.COORDINATES)
    monkeypatch.setattr(Changes, "_changed", lambda changes, segment, outcome: Continuation(segment, outcome.x))
    with pytest.raises(lmoc.SimulationError, match="have been exchanged 100 times without progress"):
        lmoc.compile_text(ROCKER).simulate(stop=1.0)


def test_a_crank_that_passes_near_its_change_point_many_times():
    """No forces, two flywheels: the time follows from the energy and the ratio of speeds, over the crank's angle."""
    run = compiled("hard/h03_four_bar").simulate(initial={"left.omega": 20.0}, stop=3, rtol=1e-8)

    def slopes(theta: float, z: np.ndarray) -> list[float]:
        c, s = 1.001 * np.cos(z[0]), 1.001 * np.sin(z[0])
        dx, dy = 2 + c - np.cos(theta), s - np.sin(theta)
        ratio = (dy * np.cos(theta) - dx * np.sin(theta)) / (dy * c - dx * s)
        return [ratio, np.sqrt((1 + 0.5 * ratio**2) / energy)]

    energy = 20.0**2 * (1 + 0.5 * run["k"][0] ** 2)
    theta, phi = run["theta"], run["phi"]
    exact = solve_ivp(slopes, (theta[0], theta[-1]), [phi[0], 0], "DOP853", theta, rtol=1e-12, atol=1e-13).y
    assert np.abs(exact[0] - phi).max() < 1e-8 and np.abs(exact[1] - run.time).max() < 1e-7
    assert went_over(run) and len(run.coordinates) < 10 and theta[-1] > 9 * 2 * np.pi


def test_coordinates_change_where_more_constraints_tie_rates_than_places():
    """cos and sin of an angle as coordinates beside its rate: both rates are dependent, and one of the places."""
    dae = compiled_text("""
        model Turning "a pendulum that turns over, whose angle is known by its cosine and sine"
          Real c(start = 1, fixed = true), s(start = 0), x, y, u, v;
          Real w(start = 3, fixed = true, stateSelect = StateSelect.prefer);
        equation
          c^2 + s^2 = 1; w = c*der(s) - s*der(c);
          x = c/2; y = s/2; u = der(x); v = der(y);
          3*der(w) + c*der(v) - s*der(u) = -4*s;
        end Turning;""")
    run = dae.simulate(stop=5, rtol=1e-8)
    truth = solve_ivp(
        lambda _, z: [z[1], -4 * np.sin(z[0]) / 3.5], (0, 5), [0, 3], rtol=1e-12, atol=1e-12, t_eval=run.time
    )
    assert truth.y[0, -1] > 4 * np.pi
    assert np.hypot(run["c"] - np.cos(truth.y[0]), run["s"] - np.sin(truth.y[0])).max() < 1e-7
