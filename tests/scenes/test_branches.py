"""Loops that close in several ways stay closed as they are: along long steps, through events, wherever outputs lie."""

from pathlib import Path

import numpy as np
import pytest
from oracles.drag_link import DRAG_LINK, rocker

import lmoc

MODELS = Path(__file__).parents[2] / "models"


@pytest.mark.parametrize(
    ("b", "c", "when", "rtol", "stop", "times"),
    [
        (1.2, 1.0, "time > 100", 1e-6, 8, 0),  # lost a turn without any event
        (1.2, 0.9, "phi > 10", 1e-9, 2.5, 1),
        (1.2, 1.0, "cos(phi) > 0.3", 1e-9, 3, 3),
    ],
)
def test_a_loop_that_moves_nothing_turns_with_its_crank(b, c, when, rtol, stop, times) -> None:
    """Nothing but their angles tells where coupler and rocker are: the integration has nothing to be careful about."""
    run = lmoc.compile_text(DRAG_LINK.format(g=9.81, b=b, c=c, when=when)).simulate(stop=stop, points=401, rtol=rtol)
    assert np.abs(run["phi"] - rocker(run["theta"], b, c)).max() < 1e-9
    assert run["n"][-1] == times == len(run.events)
    for event in run.events:
        assert event.time == pytest.approx(_crossing(when, b, c, event.time), abs=1e-7)


def _crossing(when: str, b: float, c: float, near: float) -> float:
    """When the closed form crosses the level, next to a time."""
    from scipy.optimize import brentq

    def height(time: float) -> float:
        phi = rocker(1.5 + 6 * np.linspace(0, time, 2001), b, c)[-1]
        return phi - 10 if "10" in when else np.cos(phi) - 0.3

    return brentq(height, near - 0.01, near + 0.01, xtol=1e-12)


FREUDENSTEIN = """
model Freudenstein "The same drag link by Freudenstein's equation"
  Real theta(start = 1.5, fixed = true), phi(start = 1.0768);
  discrete Integer n(start = 0, fixed = true);
equation
  der(theta) = 6;
  0.5*cos(phi) - 0.5/1.2*cos(theta) + 1.69/2.4 = cos(theta - phi);
  when cos(theta) > 0.3 then n = pre(n) + 1; end when;
  annotation(experiment(StopTime = 8));
end Freudenstein;
"""


def test_equations_that_no_motion_needs_go_on_behind_an_event() -> None:
    run = lmoc.compile_text(FREUDENSTEIN).simulate(points=401)
    assert np.abs(run["phi"] - rocker(run["theta"], 1.2, 1.0)).max() < 1e-9
    assert len(run.events) == 8


def test_an_angle_behind_a_change_of_coordinates_reaches_its_level_when_it_does() -> None:
    """`phi > 3` was true at 4.88 s, where phi is 0.12, and so did not become true at 7.92 s."""
    text = (MODELS / "hard/h03_four_bar.lmo").read_text()
    event = "discrete Integer n(start = 0, fixed = true);\nequation\n  when phi > 3 then n = pre(n) + 1; end when;\n"
    run = lmoc.compile_text(text.replace("equation\n", event, 1)).simulate(points=11, rtol=1e-9)
    assert [e.time for e in run.events] == pytest.approx([1.505227802, 7.915882618], abs=1e-6)

