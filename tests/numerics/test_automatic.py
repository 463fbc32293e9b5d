"""What `auto` does on the way: refined tolerances over long runs, Taylor series, stiff methods."""

import numpy as np
import pytest
from oracles.models import compiled

import lmoc
from lmoc.messages.diagnostics import SimulationError
from lmoc.numerics.options.options import RunOptions
from lmoc.numerics.run.simulate import simulate
from lmoc.numerics.steps import automatic, series_rule

OSCILLATOR = """model O
  parameter Real c = 0;
  Real x(start = 1, fixed = true), v(start = 0, fixed = true);
  output Real H = x^2/2 + v^2/2;
equation
  der(x) = v; der(v) = -x - c*v;
end O;"""


PENDULUM = """model P
  Real phi(start = 2.5, fixed = true), w(start = 0, fixed = true);
  output Real H = w^2/2 - 9.81*cos(phi);
equation
  der(phi) = w; der(w) = -9.81*sin(phi);
end P;"""


@pytest.fixture
def dae():
    """A scene that nothing has been run of yet."""
    return lmoc.compile_text(OSCILLATOR)


@pytest.fixture
def large(monkeypatch):
    """The rules of large scenes hold for all."""
    monkeypatch.setattr(series_rule, "SMALL", 0)
    monkeypatch.setattr(series_rule, "PLAIN", 0)


def chain(masses):
    """A chain of masses and springs, of as many states twice."""
    return f"""model Chain
      Fixed wall; Mass m[{masses}](each m = 1); Spring s[{masses}](each k = 1);
    initial equation
      for i in 1:{masses} loop m[i].q = sin(i*{np.pi}/{2 * masses + 1}); m[i].v = 0; end for;
    equation
      connect(wall.flange, s[1].a); connect(s[1].b, m[1].flange);
      for i in 2:{masses} loop connect(m[i-1].flange, s[i].a); connect(s[i].b, m[i].flange); end for;
    end Chain;"""


@pytest.mark.parametrize("masses, solver", [(3, "taylor"), (60, "dop853")])
@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-9])
def test_a_small_scene_begins_along_a_series_and_a_large_one_with_dop853(masses, solver, rtol):
    """The chain moves in its lowest mode: every mass swings with one frequency, as long as its start says so."""
    dae = lmoc.compile_text(chain(masses))
    run = dae.simulate(stop=5, rtol=rtol, points=51)
    assert run.stats["solver"] == solver
    frequency = 2 * np.sin(np.pi / (2 * (2 * masses + 1)))
    for i in (1, masses):
        exact = np.sin(i * np.pi / (2 * masses + 1)) * np.cos(frequency * run.time)
        assert np.abs(run[f"m[{i}].q"] - exact).max() < 30 * rtol


@pytest.mark.usefixtures("large")
def test_ten_thousand_periods_keep_the_energy(dae):
    run = dae.simulate(stop=2e4 * np.pi, points=201)
    assert np.abs(run["H"] - 0.5).max() / 0.5 < 1e-4
    assert np.abs(run["x"] - np.cos(run.time)).max() < 30e-6
    assert "steps add up" in run.stats["reason"]


@pytest.mark.parametrize("periods", [100, 1000])
@pytest.mark.parametrize("rtol", [1e-4, 1e-7])
@pytest.mark.parametrize("small", [0, series_rule.SMALL])
def test_the_error_of_an_undamped_run_is_near_the_tolerance_however_long(dae, periods, rtol, small, monkeypatch):
    monkeypatch.setattr(series_rule, "SMALL", small)
    monkeypatch.setattr(series_rule, "PLAIN", small)
    run = dae.simulate(stop=2 * np.pi * periods, points=201, rtol=rtol)
    error = np.abs(run["x"] - np.cos(run.time)).max()
    assert error < 30 * rtol and (small or error > 0.01 * rtol)  # a series has more digits, which cost nothing


@pytest.mark.usefixtures("large")
def test_a_motion_that_forgets_its_errors_is_not_refined(dae):
    run = dae.simulate(stop=600, parameters={"c": 1.0})
    assert run.stats["solver"].startswith("dop853") and run.stats["reason"] == "not stiff"


def test_a_short_run_is_not_looked_at(dae):
    assert dae.simulate(stop=10).stats["reason"] == "not stiff"


@pytest.mark.usefixtures("large")
def test_the_method_is_not_left_where_few_steps_lie_behind_those_of_the_trial(dae, monkeypatch):
    judged = []
    refinement = automatic.refinement
    monkeypatch.setattr(automatic, "refinement", lambda *given: judged.append(given[2]) or refinement(*given))
    run = dae.simulate(stop=40, rtol=1e-7)
    assert automatic.TRIAL < run.stats["steps"] < automatic.TRIAL + automatic.OVERRUN and not judged
    dae.simulate(stop=40, rtol=1e-7, max_step=0.3)
    assert len(set(judged)) == 1


@pytest.mark.usefixtures("large")
def test_a_limit_of_steps_holds_where_few_lie_ahead(dae):
    with pytest.raises(SimulationError, match="too many steps"):
        simulate(dae.reduced, options=RunOptions(stop=60, rtol=1e-7, max_steps=automatic.TRIAL + 10))


@pytest.mark.usefixtures("large")
def test_a_taylor_series_takes_over_where_so_many_steps_lie_ahead_that_they_pay_for_its_compilation(dae):
    run = dae.simulate(stop=20_000, points=101, rtol=1e-9)
    assert run.stats["solver"] == "dop853, taylor"
    assert np.abs(run["x"] - np.cos(run.time)).max() < 3e-8


@pytest.mark.usefixtures("large")
def test_what_has_been_run_before_changes_nothing(dae, monkeypatch):
    """Not even where the runs before have compiled a series, or have taken the steps that would pay for one."""
    monkeypatch.setattr(series_rule, "STEPS", 100)
    monkeypatch.setattr(series_rule, "SHARE", 1.0)
    before = dae.simulate(stop=10)
    assert before.stats["solver"] == "dop853"
    assert dae.simulate(stop=500).stats["solver"] == "dop853, taylor"
    dae.simulate(solver="taylor")
    for _ in range(6):
        again = dae.simulate(stop=10)
        assert again.stats["solver"] == "dop853"
        assert again["x"].tobytes() == before["x"].tobytes() and again["H"].tobytes() == before["H"].tobytes()


@pytest.mark.usefixtures("large")
def test_pieces_too_short_to_be_judged_begin_with_a_series_once_their_run_has_paid_for_it(monkeypatch):
    monkeypatch.setattr(series_rule, "STEPS", 100)
    monkeypatch.setattr(series_rule, "SHARE", 1.0)
    text = """model M Real x(start = 1, fixed = true), v(start = 0, fixed = true); Integer n(start = 0, fixed = true);
      equation der(x) = v; der(v) = -x; when sample(1, 1) then n = pre(n) + 1; end when; end M;"""
    run = lmoc.compile_text(text).simulate(stop=100)
    assert run.stats["solver"] == "dop853, taylor" and run["n"][-1] == 100
    assert np.abs(run["x"] - np.cos(run.time)).max() < 30e-6


def test_kinks_leave_no_series_however_often_a_scene_is_run(monkeypatch):
    monkeypatch.setattr(series_rule, "STEPS", 10)
    monkeypatch.setattr(series_rule, "SHARE", 1.0)
    text = "model M Real x(start = 1, fixed = true); Real v; equation der(x) = v; der(v) = -x - abs(x)/5; end M;"
    dae = lmoc.compile_text(text)
    assert [dae.simulate(stop=30).stats["solver"] for _ in range(3)] == ["dop853"] * 3


@pytest.mark.usefixtures("large")
@pytest.mark.parametrize("series", [False, True])
@pytest.mark.parametrize("stop", [100, 1000])
@pytest.mark.parametrize("rtol", [1e-4, 1e-6])
def test_the_phase_of_a_wide_swing_is_kept_however_long(series, stop, rtol, monkeypatch):
    """Its frequency depends on its amplitude: an error of the first steps is felt for the rest of the run."""
    monkeypatch.setattr(series_rule, "STEPS", 0 if series else 10**9)
    monkeypatch.setattr(series_rule, "SHARE", 1.0)
    dae = lmoc.compile_text(PENDULUM)
    reference = dae.simulate(solver="dop853", rtol=1e-13, stop=stop, points=51)
    run = dae.simulate(rtol=rtol, stop=stop, points=51)
    assert run.stats["solver"] == ("taylor" if series else "dop853")
    assert np.abs(run["phi"] - reference["phi"]).max() < 100 * rtol * 2.5


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-9])
@pytest.mark.parametrize("series", [False, True])
def test_stiffness_of_linear_motion_is_known_by_its_eigenvalues(rtol, series, monkeypatch):
    """The errors of a slow mode ask for steps so fine that no step of DOP853 is ever limited by stability."""
    text = """model M Real x(start = 1, fixed = true), y(start = 0, fixed = true);
      equation der(x) = -x/8; der(y) = -8e4*(y - sin(3*time)) + 3*cos(3*time); end M;"""
    dae = lmoc.compile_text(text)
    if not series:
        monkeypatch.setattr(series_rule, "SMALL", 0)
    monkeypatch.setattr(series_rule, "PLAIN", 0)
    run = dae.simulate(stop=20, rtol=rtol)
    assert run.stats["solver"] == ("taylor" if series else "dop853") + ", cvode"
    assert "because the fastest mode decays (time constant 1.25e-05 s)" in run.stats["reason"]
    assert np.abs(run["y"] - np.sin(3 * run.time)).max() < 30 * rtol and run.stats["evaluations"] < 20_000


def test_a_steep_start_is_not_stiffness():
    """|λ| times the span is 2e5, but falls as the speed does."""
    text = "model M Real v(start = 2000, fixed = true); equation der(v) = -5*v*abs(v); end M;"
    run = lmoc.compile_text(text).simulate(stop=10)
    assert run.stats["solver"] == "dop853" and run.stats["steps"] < 200
    assert np.abs(run["v"] - 2000 / (1 + 10_000 * run.time)).max() < 30e-6 * 2000


def test_what_is_a_little_stiff_is_done_by_a_series():
    """20 000 steps of one microsecond are faster than any method that solves equations."""
    text = "model M Real y(start = 1, fixed = true); equation der(y) = -1e4*(y - sin(time)); end M;"
    run = lmoc.compile_text(text).simulate(stop=10, rtol=1e-9)
    lag = 1e-4
    exact = (np.sin(run.time) - lag * np.cos(run.time)) / (1 + lag**2)
    assert run.stats["solver"] == "taylor"
    assert np.abs(run["y"] - exact)[1:].max() < 30e-9


def test_a_series_is_not_patient_where_each_step_is_looked_at_for_events():
    text = """model M Real y(start = 1, fixed = true); discrete Real n(start = 0, fixed = true);
      equation der(y) = -1500*(y - sin(time)); when y < -0.5 then n = pre(n) + 1; end when; end M;"""
    run = lmoc.compile_text(text).simulate(stop=60)
    assert run.stats["solver"] == "taylor, dop853, cvode"
    assert run["n"][-1] == 9 and np.abs(run["y"] - np.sin(run.time))[1:].max() < 1e-3


def test_a_steep_start_does_not_make_all_that_follows_finer():
    """The speed falls as 1/t: the first 40 steps would suggest that thousands follow."""
    text = "model M Real v(start = 2000, fixed = true); equation der(v) = -5*v*abs(v); end M;"
    run = lmoc.compile_text(text).simulate(stop=10, rtol=1e-9)
    exact = 2000 / (1 + 10_000 * run.time)
    assert np.abs(run["v"] - exact).max() < 30e-9 * 2000
    assert run.stats["steps"] < 600


def test_a_scene_that_becomes_stiff_on_the_series_way():
    """The relaxation rate grows from 1 to 1e5 where the series is already at work."""
    text = """model M Real x(start = 1, fixed = true), v(start = 0, fixed = true), y(start = 1, fixed = true);
      equation der(x) = v; der(v) = -x; der(y) = -exp(time/100)*(y - x); end M;"""
    run = lmoc.compile_text(text).simulate(stop=1200, points=101, rtol=1e-9)
    assert np.abs(run["x"] - np.cos(run.time)).max() < 1e-5  # BDF keeps fewer digits than DOP853 and the series
    assert run.stats["solver"].endswith("cvode")
    late = run.time > 1000
    assert run["y"][late] == pytest.approx(run["x"][late], abs=1e-3)


def test_fine_steps_without_work():
    run = lmoc.compile_text(OSCILLATOR).simulate(stop=1000, energy=False, rtol=1e-8)
    with_ledger = lmoc.compile_text(OSCILLATOR).simulate(stop=1000, rtol=1e-8)
    exact = np.cos(run.time)
    assert np.abs(run["x"] - exact).max() < 3 * np.abs(with_ledger["x"] - exact).max() + 1e-10


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-9])
def test_bdf_is_given_tolerances_for_what_it_loses_in_each_period(rtol):
    text = """model M Real x(start = 1, fixed = true), v(start = 0, fixed = true), y(start = 1, fixed = true);
      equation der(x) = v; der(v) = -x; der(y) = -1e4*(y - x); end M;"""
    run = lmoc.compile_text(text).simulate(stop=300, points=301, rtol=rtol)
    assert run.stats["solver"] == "taylor, cvode"
    assert np.abs(run["x"] - np.cos(run.time)).max() < 40 * rtol


@pytest.mark.parametrize("rtol", [1e-4, 1e-7, 1e-10, 1e-12])
def test_a_series_does_not_take_over_what_is_stiff_behind_its_transient(rtol):
    """x relaxes to cos(t) with a time constant of 1 µs, from beside it: short steps, whose number tells nothing."""
    text = "model M Real x(start = 0, fixed = true); equation der(x) = -1e6*(x - cos(time)) - sin(time); end M;"
    run = lmoc.compile_text(text).simulate(rtol=rtol)
    assert run.stats["solver"] == "taylor, cvode" and run.stats["evaluations"] < 30_000
    assert np.abs(run["x"] - np.cos(run.time))[1:].max() < 30 * rtol + 1e-11


@pytest.mark.parametrize("rtol", [1e-3, 1e-4, 1e-6])
def test_a_fast_swing_at_work_is_followed_to_the_end(rtol):
    """Noticed as stiff or not: steps are limited by stability from the first one on, and no method helps."""
    text = """model M Real x(start = 1e-6, fixed = true), v(start = 0, fixed = true);
      Real y(start = 1, fixed = true), w(start = 0, fixed = true);
      equation der(x) = v; der(v) = -1e8*x; der(y) = w; der(w) = -y; end M;"""
    run = lmoc.compile_text(text).simulate(stop=5, rtol=rtol)
    assert run.complete and len(run.time) == 501 and run.stats["steps"] > 1000
    assert np.abs(run["y"] - np.cos(run.time)).max() < 30 * rtol


def test_a_stiff_scene_whose_conditions_are_looked_at_goes_on_by_bdf_early():
    """Some 2000 steps of DOP853, each looked at, take longer than BDF needs for the whole."""
    text = """model M Real x(start = 1, fixed = true), y; Integer n(start = 0, fixed = true);
      equation der(x) = -6000*(x - cos(time)) - 100*y^3; y + y^3 = x;
        when y < 0 then n = pre(n) + 1; end when; end M;"""
    run = lmoc.compile_text(text).simulate(stop=2)
    assert "cvode" in run.stats["solver"] and run.stats["steps"] < 1000 and run["n"][-1] == 1
    (event,) = run.events
    assert event.time == pytest.approx(np.pi / 2 + 1 / 6000, abs=1e-6)


@pytest.mark.parametrize(("scene", "begins"), [("classic/pleiades", "taylor"), ("planar/scissor_lift", "dop853")])
def test_larger_scenes_begin_along_a_series_where_they_have_no_blocks(scene, begins):
    """Both have more rows than `SMALL` and fewer than `PLAIN`."""
    run = compiled(scene).simulate(stop=0.1, points=2, energy=False)
    assert run.stats["solver"] == begins
