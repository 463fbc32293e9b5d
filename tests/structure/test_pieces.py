"""Piecewise linear equations that are solved together: which piece holds, and where the solution jumps."""

import math

import numpy as np
import pytest
from oracles.flattening import flat

from lmoc import compile_text
from lmoc.structure.blocks.pieces import with_pieces

GAIN = 15_000.0
LIMITS = {
    "as it is written": "if gain*v > 15 then 15 else if gain*v < -15 then -15 else gain*v",
    "without events": "smooth(0, noEvent(if gain*v > 15 then 15 else if gain*v < -15 then -15 else gain*v))",
    "by extremes": "smooth(0, noEvent(max(-15, min(15, gain*v))))",
}


def amplifier(limited: str, v: str, more: str = "") -> str:
    """Return a model of an amplifier with limits; `v` is the equation of its input."""
    return f"""
    model M
      parameter Real gain = {GAIN};
      Real v, out;
      {more.partition("equation")[0]}
    equation
      {v};
      out = {limited};
      {more.partition("equation")[2]}
    end M;
    """


@pytest.mark.parametrize("limited", LIMITS.values(), ids=LIMITS.keys())
def test_multivibrator_has_the_period_of_its_closed_form(limited):
    capacitor = "Real c(start = 8, fixed = true); equation 0.1*der(c) = out - c;"
    run = compile_text(amplifier(limited, "v = 0.5*out - c", capacitor)).simulate(stop=1.0, rtol=1e-10)
    low = 7.5 - 15 / GAIN  # where the solution on a limit ends
    times = np.array([e.time for e in run.events])
    switched = times[np.diff(times, prepend=-1) > 1e-6]
    first = 0.1 * math.log((8 + 15) / (15 - low))
    half = 0.1 * math.log((15 + low) / (15 - low))
    exact = first + half * np.arange(len(switched))
    assert len(switched) >= 7
    np.testing.assert_allclose(switched, exact, rtol=1e-9)
    late = run.time > first + 1e-3
    np.testing.assert_allclose(np.abs(run["out"][late]), 15, rtol=1e-12)
    assert np.abs(run["c"][late]).max() <= low + 1e-9


def test_switch_with_hysteresis_remembers_its_side():
    run = compile_text(amplifier(LIMITS["without events"], "v = 0.5*out - 10*sin(time + 2)")).simulate(
        stop=20.0, points=401
    )
    low = 7.5 - 15 / GAIN
    side, expected = -1.0, []  # 10·sin(2) > 7.5
    for u in 10 * np.sin(run.time + 2):
        side = -1.0 if u > low else 1.0 if u < -low else side
        expected.append(15 * side)
    np.testing.assert_allclose(run["out"], expected, atol=1e-12)


def test_feedback_against_the_input_has_one_solution_and_kinks_only():
    run = compile_text(amplifier(LIMITS["without events"], "v = 10*sin(time) - 0.5*out")).simulate(stop=7.0, points=200)
    slope = GAIN / (1 + 0.5 * GAIN)
    np.testing.assert_allclose(run["out"], np.clip(slope * 10 * np.sin(run.time), -15, 15), rtol=1e-8, atol=1e-9)


def test_homotopy_leads_to_the_side_that_it_names():
    for side in (15, -15):
        limited = f"homotopy({LIMITS['without events']}, {side})"
        run = compile_text(amplifier(limited, "v = 0.5*out - 1")).simulate(stop=1.0)
        assert (run["out"] == side).all()


def test_relations_are_added_only_where_they_are_solved_together():
    explicit = flat(amplifier(LIMITS["without events"], "v = sin(time)"), library=False)
    curved = flat(amplifier("noEvent(if v > 1 then sqrt(v) else v)", "v = 0.5*out - 1"), library=False)
    coupled = flat(amplifier(LIMITS["without events"], "v = 0.5*out - 1"), library=False)
    assert with_pieces(explicit) is explicit
    assert with_pieces(curved) is curved
    found = with_pieces(coupled)
    assert [r.text for r in found.events.relations] == ["gain*v > 15", "gain*v < -15"]
    assert found.equation_count == coupled.equation_count
