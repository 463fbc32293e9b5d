"""The models of everyday mechanics with laws (`models/laws`, `models/notes`) against their closed forms."""

import json
from pathlib import Path

import numpy as np
import pytest
from oracles.models import compiled
from scipy.linalg import expm
from scipy.optimize import brentq

import lmoc

ROOT = Path(__file__).parents[2]
SLACK = next(s for s in json.loads((ROOT / "tests/data/laws.json").read_text()) if s["id"] == "H34")


def run(name: str, **options) -> lmoc.Run:
    return compiled(name).simulate(**({"rtol": 1e-10} | options))


def events(found: lmoc.Run, *kinds: str) -> list[tuple[str, str, float]]:
    return [(e.name, e.kind, e.time) for e in found.events if e.kind in kinds]


def test_figure_6_with_a_string_that_becomes_slack():
    """The 32nd system of the notes: m·q̈ + c·q̇ + k·q = max(0, −k2·q)."""
    found = run("notes/fig6_slack_string", times=SLACK["t"])
    for theirs, ours in {"q": "q", "v": "v_q", "T": "T_string"}.items():
        assert found[ours] == pytest.approx(np.array(SLACK["ref"][theirs], float), abs=2e-9)
    assert [e.kind for e in found.events] == [e["to"] for e in SLACK["events"]]
    assert [e.time for e in found.events] == pytest.approx([float(e["t"]) for e in SLACK["events"]], abs=1e-10)
    assert not any(e.impulse or e.energy_lost for e in found.events)  # the end of the string has no mass


def test_example_8_with_a_cable_that_becomes_slack():
    """Pieces of linear systems, joined by hand: free cylinder with and without its spring, plastic capture."""
    J, m, r, k, c, g = 0.05, 2.0, 0.1, 300.0, 0.08, 9.81
    found = run("notes/ex08_slack_cable", points=5)

    def alone(x: np.ndarray, t: float, stiffness: float) -> np.ndarray:
        return expm(t * np.array([[0, 1], [-stiffness * r**2 / J, -c / J]])) @ x

    def mass(t: float) -> tuple[float, float]:
        lift, fall, s = g - 40 / m, g + 4 / m, max(t - 0.2, 0)
        u = min(t, 0.2)
        return m * g / k + lift * u**2 / 2 + lift * u * s + fall * s**2 / 2, lift * u + fall * s

    start = np.array([m * g / (k * r), 0.0])
    slack = brentq(lambda t: alone(start, t, k)[0], 0.1, 0.3, xtol=1e-15)
    at_slack = alone(start, slack, k)
    taut = brentq(lambda t: r * alone(at_slack, t - slack, 0)[0] - mass(t)[0], 0.4, 0.7, xtol=1e-15)
    theta, w = alone(at_slack, taut - slack, 0)
    together = (J * w + m * r * mass(taut)[1]) / (J + m * r**2)
    lost = (J * w**2 + m * mass(taut)[1] ** 2 - (J + m * r**2) * together**2) / 2
    left, right = (e for e in found.events[:2])
    assert (left.name, left.kind, right.name, right.kind) == ("left", "slack", "right", "taut")
    assert [left.time, right.time] == pytest.approx([slack, taut], abs=1e-10)
    assert right.impulse == pytest.approx(m * (mass(taut)[1] - r * together), rel=1e-9)
    assert right.energy_lost == pytest.approx(lost, rel=1e-9)
    total, load = J + m * r**2, (m * g + 4) * r

    def both(t: float, x: np.ndarray, stiffness: float) -> np.ndarray:
        matrix = np.array([[0, 1, 0], [-stiffness * r**2 / total, -c / total, load / total], [0, 0, 0]])
        return (expm(t * matrix) @ [*x, 1])[:2]

    again = brentq(lambda t: both(t - taut, [theta, together], 0)[0], taut, 0.9, xtol=1e-15)
    assert found.events[2].time == pytest.approx(again, abs=1e-10)
    at_end = both(1 - again, both(again - taut, [theta, together], 0), k)
    assert [found["theta"][-1], found["v_theta"][-1]] == pytest.approx(at_end, abs=1e-9)


def test_an_elevator_that_is_stopped_on_its_way_up():
    found = run("laws/elevator")
    g, v0 = 9.81, 3.0
    taut = (v0 + np.sqrt(v0**2 - 4 * g / 2 * 0.06)) / g
    v = g * taut - v0
    after = v * 1000 / 1800
    stop = taut + after * 1800 / (60000 - 9810)
    assert [(e.name, e.kind) for e in found.events] == [
        ("brake", "lock"), ("brake", "unlock"), ("cable", "taut"), ("brake", "lock"),
    ]  # fmt: skip
    assert [e.time for e in found.events] == pytest.approx([0.04, taut, taut, stop], abs=1e-10)
    assert found.events[2].impulse == pytest.approx(800 * after, rel=1e-9)
    assert found.events[2].energy_lost == pytest.approx(1000 * v**2 / 2 * 800 / 1800, rel=1e-9)
    assert found["q"][-1] == pytest.approx(-0.06 + after * (stop - taut) / 2, abs=1e-10) and found["v"][-1] == 0
    assert found.energy.balance < 1e-10


def test_a_gear_shift():
    found = run("laws/gear_shift")
    before = 30 / 0.7 * 2
    slipping = before / 2 / (450 + 60)
    locked = before - 450 * slipping
    assert events(found, "lock", "unlock") == [
        ("first", "unlock", 2.0), ("second", "lock", pytest.approx(2 + slipping, abs=1e-10)),
    ]  # fmt: skip
    end = locked + 30 / 2.2 * (2 - slipping)
    assert [found["w1"][-1], found["w2"][-1]] == pytest.approx([end, end / 2], rel=1e-10)
    assert found.energy.lost[-1] == pytest.approx(120 * before / 2 * slipping / 2, rel=1e-9)


def test_a_bungee_jump():
    found = run("laws/bungee_jump")
    m, k, g, d0 = 75.0, 60.0, 9.81, 20.0
    w, fall = np.sqrt(k / m), np.sqrt(2 * d0 / g)
    rest, v = m * g / k, g * fall
    swing = 2 * (np.pi - np.arctan2(v / w, rest)) / w  # from d0 and back to it
    amplitude = np.hypot(rest, v / w)
    assert sorted({round(e.time, 9) for e in found.events}) == pytest.approx(
        [fall, fall + swing, 3 * fall + swing], abs=2e-9
    )
    depth = run("laws/bungee_jump", times=[fall + swing / 2])
    assert depth["q"][-1] == pytest.approx(d0 + rest + amplitude, rel=1e-10)
    assert depth["f"][-1] == pytest.approx(k * (rest + amplitude), rel=1e-9)


def test_an_elastic_string():
    found = run("laws/elastic_string")
    times = sorted({round(e.time, 10) for e in found.events})
    assert times[:2] == pytest.approx([0.4515236409857309, 0.4515236409857309 + 0.103768108669639], abs=1e-9)
    lowest = run("laws/elastic_string", times=[0.4515236409857309 + 0.103768108669639 / 2])
    assert lowest["q"][-1] == pytest.approx(1.15022451527530908, abs=1e-10)
    assert lowest["f"][-1] == pytest.approx(150.22451527530907, rel=1e-9)


def test_a_slack_pendulum():
    found = run("laws/slack_pendulum")
    slack, taut = found.events
    assert (slack.kind, taut.kind) == ("slack", "taut")
    assert [slack.time, taut.time] == pytest.approx([0.484466131711, 1.276023589312], abs=1e-9)
    assert taut.impulse == pytest.approx(5.966166408439, abs=1e-8)
    assert [found["x"][-1], found["y"][-1]] == pytest.approx([-0.09510623879475, -0.9954671282078], abs=1e-8)
    assert np.hypot(found["x"], found["y"]).max() <= 1 + 1e-9


def test_a_drivetrain_keeps_its_laws():
    """Clutch, freewheel and backlash: the first impact in closed form, limits and balances all the way."""
    found = run("laws/drivetrain")
    touch = np.sqrt(2 * 0.02 * 0.15 / 80)
    first = next(e for e in found.events if e.kind == "impact")
    assert first.time == pytest.approx(0.2 + touch, abs=1e-10)
    assert first.impulse == pytest.approx(1.2 * 80 / 0.15 * touch * 0.15 / 1.15, rel=1e-9)
    (lock,) = [t for name, kind, t in events(found, "lock") if name == "clutch"]
    assert 0.2 < lock < 1.5 and events(found, "unlock") == [("freewheel", "unlock", pytest.approx(1.5))]
    assert [e.name for e in found.events if abs(e.time - 1.5) < 1e-3] == ["freewheel"]  # the gear goes on to hold
    assert np.abs(found["clutch.torque"]).max() <= 80 * (1 + 1e-12)
    assert (found["w2"] - found["hub.omega"]).min() >= -1e-9 and np.abs(found["gear.delta"]).max() <= 0.02 + 1e-9
    assert found["freewheel.tau"].max() <= 1e-9  # it pushes b forward only
    assert found["w1"][-1] < found["w2"][-1]
    assert found.energy.balance < 1e-9
