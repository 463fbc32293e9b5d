"""Steps of equal length with impulses in place of events: convergence, balances, and where they are refused."""

from pathlib import Path

import numpy as np
import pytest

import lmoc

MODELS = Path(__file__).parents[3] / "models/laws"


def compiled(name):
    return lmoc.compile(MODELS / f"{name}.lmo")


@pytest.mark.parametrize(
    "name, variables",
    [("h06_bungee", ["upper.q", "lower.q"]), ("clutch_lock", ["load.theta"]), ("h16_stick_slip", ["mass.q"])],
)
def test_it_converges_to_the_run_from_event_to_event(name, variables):
    """Order one: four times smaller steps halve the error at least, whatever the place of events within the steps."""
    dae = compiled(name)
    exact = dae.simulate(points=11, rtol=1e-10)

    def error(steps):
        run = dae.simulate(points=11, solver="moreau", step=exact.time[-1] / steps)
        assert [(e.name, e.kind) for e in run.events] == [(e.name, e.kind) for e in exact.events]
        return max(np.abs(run[v] - exact[v]).max() for v in variables)

    coarse, fine = error(250), error(1000)
    assert fine < 0.5 * coarse and fine < 0.015


def test_the_ledger_of_an_inelastic_rest():
    """Friction takes what the block has had; it stands still afterwards, and its positions lie at the steps' ends."""
    run = compiled("friction_stop").simulate(stop=1, solver="moreau", step=1e-3)
    assert run.energy.balance < 1e-12 and run.energy.lost[-1] == pytest.approx(4.5, rel=1e-12)
    assert run["box.v"][-1] == pytest.approx(0.0, abs=1e-14)
    assert [(e.kind, round(e.time, 3)) for e in run.events] == [("stick", 0.765)]


def test_many_contacts_rest_on_each_other_without_sinking():
    """Ten masses dropped onto each other and a floor: penetration is taken back in every step."""
    text = """model Stack
      Fixed floor; Mass m[10](each m = 1, each g = -9.81); Stop s[10](each L = 0.1);
    equation
      connect(floor.flange, s[1].a); connect(s[1].b, m[1].flange);
      for i in 2:10 loop connect(m[i-1].flange, s[i].a); connect(s[i].b, m[i].flange); end for;
    initial equation
      for i in 1:10 loop m[i].q = 0.15*i; m[i].v = 0; end for;
    end Stack;"""
    run = lmoc.compile_text(text).simulate(stop=0.7, points=8, solver="moreau", step=2e-3)
    gaps = np.array([run[f"s[{i}].gap"] for i in range(1, 11)])
    assert gaps.min() > -1e-12 and gaps[:, -1] == pytest.approx(0.0, abs=1e-12)
    weights = 9.81 * np.arange(10, 0, -1)
    assert [-run[f"s[{i}].f"][-1] for i in range(1, 11)] == pytest.approx(weights, rel=1e-9)


@pytest.mark.parametrize(
    "text, reason",
    [
        ("model M Real x(start = 1); equation der(x) = -x; end M;", "has no laws"),
        (
            "model M Fixed w; Mass m(m = 1); DryFriction f(F = 1); discrete Real n; equation "
            "connect(w.flange, f.a); connect(f.b, m.flange); when time > 1 then n = 1; end when; end M;",
            "events of its own",
        ),
        (
            "model M Fixed w; Spring s(k = 1); Damper d(c = 1); Stop p(L = 0); equation connect(w.flange, s.a); "
            "connect(w.flange, d.a); connect(w.flange, p.a); connect(s.b, p.b); connect(d.b, p.b); end M;",
            "no mass",
        ),
    ],
)
def test_scenes_that_it_is_not_made_for(text, reason):
    with pytest.raises(lmoc.ModelError, match=f"(?s)E0540.*moreau.*{reason}"):
        lmoc.compile_text(text).simulate(stop=1, solver="moreau")


@pytest.mark.parametrize(
    "name, variable, steps, code",
    [
        ("h16_stick_slip", "mass.q", 400, "W0555"),
        ("h06_bungee", "lower.q", 50, "W0555"),
        ("h06_bungee", "lower.q", 500, "N0555"),
    ],
)
def test_the_error_is_estimated_and_told(name, variable, steps, code):
    """Twice the estimate bounds the error against the run from event to event; long steps are warned of."""
    dae = compiled(name)
    exact = dae.simulate(points=51, rtol=1e-10)
    run = dae.simulate(points=51, solver="moreau", step=exact.time[-1] / steps)
    error = np.abs(run[variable] - exact[variable]).max() / np.ptp(exact[variable])
    assert error < 2 * run.stats["estimated_error"] and code in [note.code for note in run.notes]
    assert run.stats["step"] == exact.time[-1] / steps


def test_without_a_length_the_steps_are_halved_until_the_error_is_small():
    dae = compiled("clutch_lock")
    exact, run = dae.simulate(points=11, rtol=1e-10), dae.simulate(points=11, solver="moreau")
    assert run.stats["estimated_error"] <= 0.01
    assert np.abs(run["load.theta"] - exact["load.theta"]).max() < 0.01 * np.ptp(exact["load.theta"])
