"""Fixed velocities of inertias that contradict each other: a plastic impact at the start.

Wheels that turn at given speeds are brought into mesh. The impulses of the constraints do no work on motions that these
allow, so the velocities afterwards are the nearest in the metric of the kinetic energy: of all allowed ones they
minimize the sum of m·(v⁺ − v⁻)² (Carnot's theorem), and half of that sum is lost.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lmoc.messages.diagnostics import Report
from lmoc.numerics.observe.event import Event
from lmoc.numerics.observe.slices import slice_of
from lmoc.numerics.start.gauss_newton import GaussNewtonResult
from lmoc.numerics.start.start_system import StartSystem
from lmoc.structure.messages.equations import listed
from lmoc.support.quoted import parent
from lmoc.support.records import dataclass

_ALIKE = 1e-9  # share of the kinetic energy by which sums may differ


@dataclass(frozen=True, eq=False)
class PlasticImpact:
    """The velocities after a plastic impact at the start.

    Attributes
    ----------
    rows : of the start system: the fixed velocities that are overruled
    states, value : (c,) the states that they determine, and their values
    after : velocities of the rows
    lost : J
    """

    rows: np.ndarray
    states: np.ndarray
    value: np.ndarray
    after: np.ndarray
    lost: float

    def event(self, system: StartSystem) -> Event:
        """Return the record of the impact."""
        parts = [parent(system.name(k)) for k in self.rows.tolist()]
        return Event(system.time, ", ".join(parts), "start", energy_lost=self.lost, note="plastic impact")

    def report(self, system: StartSystem, report: Report) -> None:
        """Warn of the velocities that are not those of the model."""
        who = listed([system.text(k) for k in self.rows.tolist()])
        pairs = zip(self.rows.tolist(), self.after.tolist(), strict=True)
        found = ", ".join(f"{system.name(k)} = {v:.6g}" for k, v in pairs)
        report.warning(
            "W0538",
            f"the fixed velocities {who} contradict each other: a plastic impact at the start loses {self.lost:.6g} J",
            system.span_of(self.rows),
            found=f"afterwards {found}",
            hint="fix fewer of them, or values that fit the constraints between them",
        )


def plastic_impact(system: StartSystem, group: np.ndarray, start: GaussNewtonResult) -> PlasticImpact | None:
    """Return the impact that makes contradicting fixed values possible; None where they are no velocities of inertias.

    Every body that the constraints between them move must have a fixed velocity: of others nobody knows how they
    came.

    Parameters
    ----------
    group : rows that are missed and depend on each other
    """
    rows, states, jacobian = _involved(group, start)
    if not len(states) or (rows >= len(system.targets)).any() or not system.hard[rows].all():
        return None
    names = [f"{parent(system.name(k))}.energy" for k in rows.tolist()]
    found = [system.flat.find(name) for name in (*names, "ledger.stored")]
    if len(set(names)) < len(names) or any(v is None or len(v) != 1 for v in found):
        return None
    register = system.plan.reduced.register_of[np.concatenate(found)]
    if (register < 0).any():
        return None
    *own, whole = _curvature(system, register, start.x, states)
    masses = np.array([np.trace(k) / (g @ g) if g.any() else 0.0 for k, g in zip(own, jacobian, strict=True)])
    share = masses[:, None, None] * jacobian[:, :, None] * jacobian[:, None, :]
    size = _ALIKE * np.abs(whole).max(initial=0.0)
    if (masses <= 0.0).any() or np.abs(share - own).max() > size or np.abs(share.sum(axis=0) - whole).max() > size:
        return None
    root = np.sqrt(masses)
    step = np.linalg.lstsq(root[:, None] * jacobian, -root * start.residual[rows], rcond=None)[0]
    missed = start.residual[rows] + jacobian @ step
    lost = 0.5 * float(masses @ missed**2)
    return PlasticImpact(rows, states, start.x[states] + step, system.value[rows] + missed, lost)


def _involved(group: np.ndarray, start: GaussNewtonResult) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return all rows that share states with a group, these states, and the block of the Jacobian."""
    row, column, value = (part[start.jacobian[2] != 0.0] for part in start.jacobian)
    rows, before = group, -1
    while len(rows) > before:
        before = len(rows)
        states = np.unique(column[np.isin(row, rows)])
        rows = np.unique(np.concatenate([rows, row[np.isin(column, states)]]))
    block = np.zeros((len(rows), len(states)))
    own = np.isin(row, rows)
    block[np.searchsorted(rows, row[own]), np.searchsorted(states, column[own])] = value[own]
    return rows, states, block


def _curvature(system: StartSystem, registers: np.ndarray, x: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Return the second derivatives (registers, c, c) of energies by some states, exact where these are quadratic."""
    plan, count = system.plan, len(states)
    signals: Mapping = system.signals
    evaluate = slice_of(plan, registers).bind(system.w[: plan.count], signals)
    unit = np.zeros((count, len(x)))
    unit[np.arange(count), states] = 1.0
    places = np.concatenate([x[None], x + unit, (x + unit[:, None] + unit[None]).reshape(-1, len(x))])
    energy = evaluate(np.full(len(places), system.time), places)
    single, double = energy[1 : count + 1], energy[count + 1 :].reshape(count, count, -1)
    return (double - single[:, None] - single[None] + energy[0]).transpose(2, 0, 1)
