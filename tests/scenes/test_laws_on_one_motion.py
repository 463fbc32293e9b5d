"""Several laws on one motion, whose forces share what they hold: the motion is unique, and agrees with small steps."""

import random

import numpy as np
import pytest

import lmoc

STOP, STEP = 2.0, 1e-4


def scene(seed: int) -> tuple[str, dict]:
    """Return the text of a mass between a stop, a cable and frictions, pushed to and fro, and what it is made of."""
    dice = random.Random(seed)
    limits = [(f, f if dice.random() < 0.5 else round(1.3 * f, 2)) for f in (0.4, 0.9, 1.4)[: dice.randint(1, 3)]]
    stop, cable = dice.choice([(True, True), (True, False), (False, True)])
    amplitude, speed, phase = (round(dice.uniform(a, b), 1) for a, b in ((2, 8), (2, 6), (0, 3)))
    parts = [f"DryFriction f{k}(F = {slip}, Fstick = {stick});" for k, (slip, stick) in enumerate(limits)]
    joins = [f"connect(wall.flange, f{k}.a); connect(f{k}.b, m.flange);" for k in range(len(limits))]
    for name, part, wanted in (("s", "Stop s(L = 0);", stop), ("c", "Cable c(L = 0.2);", cable)):
        if wanted:
            parts.append(part)
            joins.append(f"connect(wall.flange, {name}.a); connect({name}.b, m.flange);")
    text = f"""model Shared Fixed wall; Mass m(m = 1, q(start = 0.1, fixed = true), v(start = 0, fixed = true));
    Force p(f = {amplitude}*sin({speed}*time + {phase})); {" ".join(parts)}
    equation connect(p.flange, m.flange); {" ".join(joins)} end Shared;"""
    wave = amplitude, speed, phase
    return text, {"limits": limits, "low": 0.0 if stop else -np.inf, "high": 0.2 if cable else np.inf, "wave": wave}


def in_small_steps(limits, low, high, wave) -> float:
    """Return where the mass is at the end."""
    q, v, (amplitude, speed, phase) = 0.1, 0.0, wave
    for k in range(round(STOP / STEP)):
        free = v + STEP * amplitude * np.sin(speed * (k + 0.5) * STEP + phase)
        held = STEP * sum(slip if v else stick for slip, stick in limits)
        v = np.sign(free) * max(0.0, abs(free) - held)
        if not low <= q + STEP * v <= high:
            q, v = np.clip(q + STEP * v, low, high), 0.0
        q += STEP * v
    return float(q)


@pytest.mark.parametrize("seed", range(8))
def test_the_motion_is_that_of_small_steps(seed):
    text, made = scene(seed)
    run = lmoc.compile_text(text).simulate(stop=STOP, rtol=1e-9, points=101)
    assert run["m.q"][-1] == pytest.approx(in_small_steps(**made), abs=5e-3)
    assert run["m.q"].min() >= made["low"] - 1e-12 and run["m.q"].max() <= made["high"] + 1e-12
    assert run.energy.balance < 1e-7


def test_a_ratchet_beside_a_brake_that_holds_tells_of_nothing():
    """Either of them may carry the load: that one of them carries none is no event as long as the other holds."""
    text = """model Beside
  FixedShaft wall; Inertia disk(J = 1, theta(start = 0, fixed = true), omega(start = 0, fixed = true)); Ratchet ratchet;
  BearingFriction brake(tau = 2); Torque load(tau = -1 + 0.5*sin(20*time) + (if time < 1 then 0 else 20*(time - 1)));
equation
  connect(wall.shaft, ratchet.a); connect(ratchet.b, disk.shaft);
  connect(wall.shaft, brake.a); connect(brake.b, disk.shaft); connect(load.shaft, disk.shaft);
end Beside;"""
    run = lmoc.compile_text(text).simulate(stop=2, points=201, rtol=1e-9)
    assert run["disk.theta"][run.time <= 1] == pytest.approx(0, abs=0)
    held = [e for e in run.events if e.name != "load.tau" and e.kind in ("lock", "unlock", "stick", "slip")]
    assert {e.name for e in held} == {"ratchet", "brake"}
    (slip,) = {e.time for e in held}
    assert -1 + 0.5 * np.sin(20 * slip) + 20 * (slip - 1) == pytest.approx(2, abs=1e-9)
