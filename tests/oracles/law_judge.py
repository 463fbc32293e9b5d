"""Judge a run of a one-dimensional scene with laws by its matrices: every law and every balance, at every output."""

from __future__ import annotations

import numpy as np
from oracles.moreau import Scene
from oracles.random_laws import Drawn
from scipy.optimize import nnls

TOLERANCE = 1e-7  # of forces and velocities, as a share of the largest one in the run
CLOSED = 1e-10  # m, by which gaps may be negative
MOVING = 1e-6  # m/s, from where on a friction slides for certain
SHIFTED = 1e-6  # s, by which bounces may have amplified what differs in the last digits
APART = 1e-7  # s, by which the velocities before an impact are read before it


def judge(drawn: Drawn, run) -> list[str]:
    """Return what is wrong with a run, nothing if all is well."""
    scene = drawn.scene
    q, v, a = (np.array([run[names[k]] for names in drawn.bodies]).T for k in range(3))
    push = _forces(run, drawn.unilateral)
    drive = _forces(run, drawn.one_way)
    drag = _forces(run, drawn.friction)
    gap, way, slide = scene.gap_offset + q @ scene.gap_rows.T, v @ scene.one_way.T, v @ scene.friction_rows.T
    load = np.array([scene.forces(t, *at) for t, at in zip(run.time, zip(q, v, strict=True), strict=True)])
    force = 1.0 + np.abs(load).max() + max((np.abs(f).max() for f in (push, drive, drag) if f.size), default=0.0)
    speed = 1.0 + np.abs(v).max()
    laws = push @ scene.gap_rows + drive @ scene.one_way + drag @ scene.friction_rows
    balance = (scene.mass * a - load - laws) @ scene.free
    known = np.isfinite(laws).all(axis=1)  # forces that are not unique may be unknown
    sliding, slip = np.abs(slide) > MOVING, scene.slip * np.sign(slide)
    findings = {
        "a bilateral constraint is violated": np.abs((q - q[0]) @ scene.bilateral.T) > 1e-9,
        "a gap is negative": gap < -CLOSED,
        "a unilateral force is negative": push < -TOLERANCE * force,
        "a unilateral force acts across a gap": (push > TOLERANCE * force) & (gap > 1e-9),
        "a one-way velocity is negative": way < -TOLERANCE * speed,
        "a one-way force is negative": drive < -TOLERANCE * force,
        "a one-way force acts while its law is open": (drive > TOLERANCE * force) & (way > TOLERANCE * speed),
        "friction is beyond its limit": np.abs(drag) > scene.stick + TOLERANCE * force,
        "sliding friction is not at its limit": sliding & (np.abs(drag + slip) > TOLERANCE * force),
        "forces do not balance": (np.abs(balance) > TOLERANCE * force * 10) & known[:, None],
    }
    wrong = [f"{what} at t = {run.time[rows.any(axis=1)][0]:.9g}" for what, rows in findings.items() if rows.any()]
    moved = max(np.abs(run.energy.supplied).max(), np.abs(run.energy.lost).max())
    if not run.energy.balance < 1e-6 and moved > 1e-9:
        wrong.append(f"the energy balance is off by {run.energy.balance:.2g}")
    return wrong


def _forces(run, names: list[tuple[str, float]]) -> np.ndarray:
    """Return the forces of laws along their rows, (times, laws)."""
    return np.array([sign * run[name] for name, sign in names]).reshape(len(names), len(run.time)).T


def judge_impacts(drawn: Drawn, scene_run, again) -> list[str]:
    """Return what is wrong with the impacts of a run.

    Parameters
    ----------
    again : callable (times) -> the same run at other output times
    """
    struck = {e.time for e in scene_run.events if e.impulse > 0}
    instants = sorted(t for t in struck if APART < t < scene_run.time[-1] - APART)
    if not instants:
        return []
    end = float(scene_run.time[-1])
    run = again(sorted({0.0, *(t - APART for t in instants), *(t + APART for t in instants), end}))
    if [(e.name, e.kind) for e in run.events] != [(e.name, e.kind) for e in scene_run.events]:
        return ["other output times give other events"]
    shifts = [abs(one.time - other.time) for one, other in zip(run.events, scene_run.events, strict=True)]
    if max(shifts) > SHIFTED:
        return [f"other output times shift an event by {max(shifts):.2g} s"]
    place = {t: k for k, t in enumerate(run.time)}
    v, a = (np.array([run[names[k]] for names in drawn.bodies]).T for k in (1, 2))
    wrong = []
    for t in instants:
        if any(0 < abs(t - e.time) < 3 * APART for e in scene_run.events):
            continue  # what stands beside it is another event
        first, last = place[t - APART], place[t + APART]
        own = [e for e in scene_run.events if e.time == t and e.impulse > 0]
        wrong += _judge_impact(drawn, t, own, v[first] + APART * a[first], v[last] - APART * a[last])
    return wrong


def _judge_impact(drawn: Drawn, t: float, own: list, before: np.ndarray, after: np.ndarray) -> list[str]:
    scene: Scene = drawn.scene
    momentum = scene.free.T @ (scene.mass * (after - before))
    rows, wrong = [*scene.gap_rows, *scene.one_way], []
    reach = sum(event.impulse * _row(drawn, rows, event.name, before) for event in own)
    size = 1.0 + np.abs(scene.mass * before).max()
    held = [row for row in rows if abs(row @ before) < 1e-5 and abs(row @ after) < 1e-5]  # they pass impulses on
    rest = momentum - scene.free.T @ reach
    if held:
        rest = rest - scene.free.T @ np.transpose(held) @ nnls(scene.free.T @ np.transpose(held), rest)[0]
    if np.abs(rest).max() > 1e-5 * size:
        wrong.append(f"the impulses of the impact at t = {t:.9g} do not balance")
    lost = 0.5 * (scene.mass * before**2).sum() - 0.5 * (scene.mass * after**2).sum()
    if abs(lost - sum(e.energy_lost for e in own)) > 1e-5 * size**2 or lost < -1e-5 * size**2:
        wrong.append(f"the energy lost in the impact at t = {t:.9g} is wrong")
    rate, then = scene.gap_rows @ before, scene.gap_rows @ after
    struck = {e.name for e in own}
    if all(e.note == "Newton's law" and e.kind != "accumulation" for e in own):
        hit = np.array([p in struck for p in drawn.parts[: len(rate)]], bool) & (rate < -MOVING)
        wanted = -scene.restitution * np.minimum(rate, 0.0)
        if (then[hit] < wanted[hit] - 1e-5).any():
            wrong.append(f"the impact at t = {t:.9g} gives back too little")
    return wrong


def _row(drawn: Drawn, rows: list[np.ndarray], name: str, before: np.ndarray) -> np.ndarray:
    """Return the row of a law by the name of its part; of a backlash, that of the flank that closes."""
    own = [row for row, part in zip(rows, drawn.parts, strict=True) if part == name]
    return min(own, key=lambda row: float(row @ before))
