"""Judge a run of a planar scene with laws by the equations of all its bodies: laws, balances and impacts."""

from __future__ import annotations

import numpy as np
from oracles.jets import Jet
from oracles.planar import GRAVITY, Spot
from oracles.planar_laws import CONTACT, DRY, ONE_WAY, UNILATERAL, LawfulMechanism

TOLERANCE = 1e-6  # of forces and accelerations, as a share of the largest one in the run
CLOSED = 1e-9  # m, by which gaps may be negative
MOVING = 1e-6  # m/s, from where on a friction slides for certain
APART = 1e-7  # s, by which the velocities before an impact are read before it
MOST = 12  # impacts that are looked at
PORTS = {"b": ("frame",), "r": ("a", "b"), "p": ("point",)}


def places(s: LawfulMechanism, run) -> tuple[np.ndarray, np.ndarray]:
    """Return the coordinates of all bodies and their rates over a run, (times, n)."""
    q, v = np.zeros((len(run.time), s.count)), np.zeros((len(run.time), s.count))
    for solid in s.solids:
        names = (("x", "vx"), ("y", "vy"), ("theta", "omega"))[: 2 if solid.name[0] == "p" else 3]
        for i, (place, rate) in enumerate(names):
            if solid.first >= 0:
                q[:, solid.first + i], v[:, solid.first + i] = run[f"{solid.name}.{place}"], run[f"{solid.name}.{rate}"]
    return q, v


def law_forces(s: LawfulMechanism, run) -> np.ndarray:
    """Return the forces of the laws, (times, laws)."""
    return np.array([law.sign * run[law.force] for law in s.laws]).reshape(len(s.laws), len(run.time)).T


def judge(s: LawfulMechanism, run) -> list[str]:
    """Return what is wrong at the output times of a run, nothing if all is well."""
    q, v = places(s, run)
    forces = law_forces(s, run)
    size = 1.0 + np.nanmax(np.abs(forces), initial=0.0) + GRAVITY
    found: dict[str, float] = {}
    flows = _flows(s, run)
    for k, t in enumerate(run.time):
        for what in _at(s, flows[k], q[k], v[k], forces[k], size):
            found.setdefault(what, t)
    if not run.energy.balance < 1e-5 and max(np.abs(run.energy.supplied).max(), np.abs(run.energy.lost).max()) > 1e-8:
        found[f"the energy balance is off by {run.energy.balance:.2g}"] = run.time[-1]
    return [f"{what} at t = {t:.9g}" for what, t in found.items()]


def _flows(s: LawfulMechanism, run) -> np.ndarray:
    """Return the forces along x and y that act on each moving solid, (times, solids, 2)."""
    moving = [solid for solid in s.solids if solid.first >= 0]
    return np.array(
        [[sum(run[f"{m.name}.{port}.{f}"] for port in PORTS[m.name[0]]) for f in ("fx", "fy")] for m in moving]
    ).transpose(2, 0, 1)


def _at(s: LawfulMechanism, flows: np.ndarray, q: np.ndarray, v: np.ndarray, force: np.ndarray, size: float) -> list:
    jets = Jet.coordinates(q)
    wrong = ["a joint is open"] if any(abs(row.value) > 1e-7 for row in s.rows(q)) else []
    known = np.isfinite(force).all()
    s.acting = np.nan_to_num(force)
    a, _, condition = s.motion(q, v)
    small = TOLERANCE * size * max(1.0, condition * 1e-3)
    for law, f in zip(s.laws, force, strict=True):
        motion = law.motion(jets)
        rate, onwards = motion.slope @ v, motion.slope @ a + v @ motion.bend @ v
        wrong += _of_law(s, law, f, motion.value, rate, onwards if known else 0.0, size, small, force)
    if not known:
        return wrong
    for total, solid in zip(flows, (solid for solid in s.solids if solid.first >= 0), strict=True):
        for axis, centre in enumerate(s.spot(jets, Spot(solid, *solid.c))):
            expected = solid.m * (centre.slope @ a + v @ centre.bend @ v + GRAVITY * axis)
            if not abs(total[axis] - expected) <= small:
                wrong.append(f"the forces on {solid.name} do not balance")
    return wrong


def _of_law(s, law, f, value, rate, onwards, size, small, force) -> list[str]:
    found = {}
    if law.kind in (UNILATERAL, ONE_WAY):
        found["pulls where it can only push"] = f < -TOLERANCE * size
        closed = (value <= 1e-12 or law.kind == ONE_WAY) and rate <= MOVING
        found["is closed and opens by itself inwards"] = closed and onwards < -small
        if law.kind == UNILATERAL:
            found["has a negative gap"] = value < -CLOSED
            found["acts across a gap"] = f > TOLERANCE * size and value > 1e-8
        else:
            found["has a negative velocity"] = rate < -MOVING
            found["acts while it is open"] = f > TOLERANCE * size and rate > MOVING
        found["acts while it opens"] = f > TOLERANCE * size and onwards > small
    else:
        slip, stick = law.slip, law.stick
        if law.kind == CONTACT:
            slip = stick = law.slip * max(force[law.normal], 0.0)
        found["is beyond its limit"] = abs(f) > stick + TOLERANCE * size
        sliding = abs(rate) > MOVING
        found["slides below its limit"] = sliding and abs(f + slip * np.sign(rate)) > TOLERANCE * size
        held = abs(f) < min(slip, stick) - TOLERANCE * size
        found["moves without sliding"] = not sliding and held and abs(onwards) > small
    return [f"{law.kind} of {law.part} {what}" for what, is_so in found.items() if is_so]


def judge_impacts(s: LawfulMechanism, run, again) -> list[str]:
    """Return what is wrong with the impacts of a run.

    Parameters
    ----------
    again : callable (times) -> the same run at other output times
    """
    end = float(run.time[-1])
    instants = sorted({e.time for e in run.events if e.impulse > 0 and APART < e.time < end - APART})[:MOST]
    if not instants:
        return []
    other = again(sorted({0.0, *(t - APART for t in instants), *(t + APART for t in instants), end}))
    if [(e.name, e.kind) for e in other.events] != [(e.name, e.kind) for e in run.events]:
        return ["other output times give other events"]
    q, v = places(s, other)
    place, forces = {t: k for k, t in enumerate(other.time)}, law_forces(s, other)
    wrong: list[str] = []
    for t in instants:
        if any(0 < abs(t - e.time) < 3 * APART for e in run.events):
            continue  # what stands beside it is another event
        own = [e for e in run.events if e.time == t and e.impulse > 0]
        first, last = place[t - APART], place[t + APART]
        rates = []
        for at, sign in ((first, 1.0), (last, -1.0)):
            s.acting = np.nan_to_num(forces[at])
            rates.append(v[at] + sign * APART * s.motion(q[at], v[at])[0])
        wrong += [f"{what} at t = {t:.9g}" for what in _impact(s, (q[first] + q[last]) / 2, *rates, own)]
    return wrong


def _impact(s: LawfulMechanism, q: np.ndarray, before: np.ndarray, after: np.ndarray, own: list) -> list[str]:
    jets = Jet.coordinates(q)
    mass, _, ties = s.equations(jets, before)
    change = mass @ (after - before)
    size = 1.0 + np.abs(mass @ before).max()
    struck = {e.name: e for e in own}
    columns = [row.slope for row in ties]  # impulses of any sign
    for law in s.laws:
        motion = law.motion(jets)
        taking = law.kind != DRY and (law.part in struck or abs(motion.slope @ after) < 1e-4)
        columns += [motion.slope] if taking else []
    left = change - (np.transpose(columns) @ np.linalg.lstsq(np.transpose(columns), change, rcond=1e-10)[0])
    wrong = ["the impulses of an impact do not balance"] if np.abs(left).max() > 1e-5 * size else []
    lost = 0.5 * before @ mass @ before - 0.5 * after @ mass @ after
    if abs(lost - sum(e.energy_lost for e in own)) > 1e-5 * size**2 or lost < -1e-5 * size**2:
        wrong.append(f"an impact loses {lost:.9g} J instead of {sum(e.energy_lost for e in own):.9g} J")
    for law in s.laws:
        slope = law.motion(jets).slope
        came, goes = slope @ before, slope @ after
        if law.kind == UNILATERAL and law.part in struck and came < -MOVING:
            event = struck[law.part]
            least = -law.restitution * came - 1e-5 * size**2
            if event.note == "Newton's law" and event.kind != "accumulation" and goes < least:
                wrong.append(f"{law.part} gives back {goes:.9g} m/s of {-came:.9g} m/s")
    return wrong
