"""Friction between springs, without a mass in between: Jenkins' element, Iwan's models, what has no unique answer."""

import numpy as np
import pytest
from oracles.between_springs import IWAN, JENKINS, PEAK, ROW

import lmoc
from lmoc import ModelError


def test_jenkins_element():
    """Elastic up to the limit, then sliding; it turns where the drive does and slips again two limits later."""
    run = lmoc.compile_text(JENKINS).simulate(stop=5, rtol=1e-10)
    first = np.arcsin(0.5) / 2
    turns = np.pi / 4 + np.pi / 2 * np.arange(3)
    slips = np.pi / 2 * np.arange(1, 4)
    expected = sorted([(first, "slip"), *((t, "stick") for t in turns), *((t, "slip") for t in slips)])
    assert [e.kind for e in run.events] == [kind for _, kind in expected]
    assert [e.time for e in run.events] == pytest.approx([t for t, _ in expected], abs=1e-10)
    assert np.abs(run["slider.f"]).max() == pytest.approx(1, abs=1e-12)
    quarter, half = 0.02 - 0.01, 0.04 - 0.02  # slipped ways
    assert run.energy.lost[np.searchsorted(run.time, 4.0)] == pytest.approx(quarter + 2 * half, abs=1e-9)
    assert run.energy.balance < 1e-9


def test_iwans_elements_agree_with_elastic_steps_and_returns():
    """A fine explicit integration in which each force is cut off at its limit."""
    run = lmoc.compile_text(IWAN).simulate(stop=0.6, rtol=1e-11, points=2)
    limit, q, v, f, h = np.array([0.5, 1, 1.5]), 0.05, 0.0, np.zeros(3), 1e-5
    for _ in range(60_000):
        v -= h / 2 * (20 * q + f.sum())
        step = h * v
        q, f = q + step, np.clip(f + 100 * step, -limit, limit)
        v -= h / 2 * (20 * q + f.sum())
    assert run["m.q"][-1] == pytest.approx(q, abs=1e-8) and run["m.v"][-1] == pytest.approx(v, abs=1e-8)
    assert [run[f"f[{i}].f"][-1] for i in (1, 2, 3)] == pytest.approx(f, abs=1e-7)
    assert run.energy.balance < 1e-8


def test_sliders_in_a_row_give_way_one_after_the_other():
    """While all stick nothing yields, so that the force jumps to the least limit."""
    run = lmoc.compile_text(ROW).simulate(stop=1.0, rtol=1e-10, times=[0, 0.01, 0.5, 1.0])
    third = (1 - 0.5) / 300  # extension of the last spring where the second slider gives way
    both = (1.5 - 0.5) / 300 + (1.5 - 1) / 200
    back = 0.05 - 2 * (1 - 0.5) / 300  # after the jump by two limits of the last one
    kinds = [(e.name, e.kind) for e in run.events]
    assert kinds[:2] == [("f[2]", "slip"), ("f[1]", "slip")] and ("f[2]", "slip") in kinds[2:]
    times = [run.events[0].time, run.events[1].time, run.events[-1].time]
    ways = [np.arcsin(third / 0.05) / 2, np.arcsin(both / 0.05) / 2, (np.pi - np.arcsin(back / 0.05)) / 2]
    assert times == pytest.approx(ways, abs=1e-8)
    tension = run["f[3].f"] + 300 * run["k[3].extension"]
    drive = 0.05 * np.sin(2 * run.time)
    assert tension[1] == pytest.approx(0.5 + 300 * drive[1], abs=1e-8)
    assert tension[2] == pytest.approx((drive[2] + 1.5 / 100 + 1 / 200 + 0.5 / 300) / (1 / 100 + 1 / 200 + 1 / 300))


def test_a_force_that_drops_from_its_sticking_to_its_slipping_limit_moves_the_springs():
    run = lmoc.compile_text(PEAK).simulate(stop=2, rtol=1e-10)
    (slip,) = run.events
    assert slip.time == pytest.approx(0.3, abs=1e-10)
    assert slip.energy_lost == pytest.approx((1.5 + 1) / 2 * 0.5 / 150, abs=1e-12)
    assert run["f.f"][-1] == pytest.approx(1, abs=1e-12)
    assert run["k1.extension"][-1] == pytest.approx((1 + 50 * 0.1) / 150, abs=1e-12)
    assert run.energy.balance < 1e-10


def test_a_ratchet_between_springs_only_pushes():
    text = """model Pawl
    FixedShaft wall; Rotation drive(theta = sin(2*time)); TorsionSpring spring(k = 10); Ratchet pawl;
    equation connect(wall.shaft, pawl.a); connect(pawl.b, spring.a); connect(spring.b, drive.shaft); end Pawl;"""
    run = lmoc.compile_text(text).simulate(stop=3, rtol=1e-10)
    assert (run["pawl.tau"] <= 1e-9).all()
    assert run["spring.tau"][-1] == pytest.approx(10 * (np.sin(6) - 1), abs=1e-8)
    assert [(e.kind, e.time) for e in run.events] == [("lock", pytest.approx(np.pi / 4, abs=1e-8))]


def test_frictions_in_series_have_no_unique_answer():
    text = JENKINS.replace("DryFriction slider(F = 1);", "DryFriction slider(F = 1), other(F = 1);")
    text = text.replace("connect(slider.a, wall.flange)", "connect(slider.a, other.b); connect(other.a, wall.flange)")
    with pytest.raises(ModelError) as failed:
        lmoc.compile_text(text)
    assert failed.value.diagnostics[0].code == "E0416"
    assert "slider and other" in str(failed.value)


def test_the_equations_of_its_modes():
    """Sliding forward is a mode of its own: the sliding velocity follows from the rate of the force."""
    text = """model Held
      Fixed wall;
      Mass m(m = 1, q(start = 0.05, fixed = true), v(start = 0, fixed = true));
      Spring k1(k = 100), k0(k = 50);
      DryFriction f(F = 1);
    equation
      connect(m.flange, k1.b); connect(k1.a, f.b); connect(f.a, wall.flange);
      connect(m.flange, k0.b); connect(k0.a, wall.flange);
    end Held;"""
    printed = str(lmoc.compile_text(text).equations())
    assert "f stick" in printed and "f slip forward" in printed
    assert "m·q̈ + k·q = -F" in printed and "push" not in printed
