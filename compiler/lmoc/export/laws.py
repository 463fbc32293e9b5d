"""What an FMU needs to know of laws: tapes of their quantities with all laws open, and tables of registers.

The quantities are those of the switched form with all laws open: the forces are given from outside there, and its
implicit blocks leave nothing of the laws but a unit matrix. So an FMU has one set of registers for what moves and for
what decides.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from lmoc.ir.mode import law_names, law_rows
from lmoc.ir.program import unfilled
from lmoc.lower.tape import Tape
from lmoc.numerics.laws.free_dynamics import FreeDynamics, free_dynamics
from lmoc.numerics.laws.instant import ContactKinematics, LawTable, restitutions
from lmoc.numerics.laws.reading import reading_registers
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Signal
from lmoc.support.records import dataclass

MOST_LAWS = 300  # tables of what each does to all others: 23 numbers a pair, 12 MB of C for 300
_SAMPLES = 40  # places of a run at which the rounding of levels is bounded


@dataclass(frozen=True, eq=False)
class LawTables:
    """The laws of a scene as an FMU holds them (``fmu_laws`` in ``export/c/fmu.h``), an entry for each law.

    Attributes
    ----------
    table : LawTable
    curved, linear, position : as of ``lmoc_law_run``
    by_force, by_state : Tape
    given : registers that these read and that parameters, inputs and events fill
    entries : (2,) where their derivatives stand in their matrices
    quantity, known : (6, n) registers of the quantities; variables of those that are parameters, -1 for none
    restitution : variables, -1 for none
    inputs, held : (3, n), (states,) registers of the mode, -1 for none
    read : (4, n) registers that show the end of a mode
    noise : what levels are by rounding alone
    names : of the laws, each of its own
    texts : names of their parts, of what closes and what opens them
    """

    table: LawTable
    curved: np.ndarray
    linear: np.ndarray
    position: np.ndarray
    by_force: Tape
    by_state: Tape
    given: np.ndarray
    entries: tuple[np.ndarray, np.ndarray]
    quantity: np.ndarray
    known: np.ndarray
    restitution: np.ndarray
    inputs: np.ndarray
    held: np.ndarray
    read: np.ndarray
    noise: np.ndarray
    names: list[str]
    texts: tuple[tuple[str, ...], ...]

    @property
    def indicator_texts(self) -> tuple[str, ...]:
        """What each event indicator of the laws tells of."""
        return tuple(f"{what} of {name}" for what in ("the law", "the lower limit of the force") for name in self.names)


def why_not(plan: Plan) -> str:
    """Return why an FMU cannot have the laws of a plan; empty where it can."""
    form = plan.reduced.switched
    if form is not None and form.count > MOST_LAWS:
        return f"it has {form.count} laws, of which each may act on all others: an FMU holds {MOST_LAWS} at most"
    return ""


def law_tables(
    plan: Plan,
    values: np.ndarray,
    signals: Mapping[int, Signal],
    inputs_of: Callable[[Plan], np.ndarray],
    motion: tuple[np.ndarray, np.ndarray],
) -> LawTables:
    """Return the laws of a plan, which `why_not` does not refuse.

    Parameters
    ----------
    values : (flat.count,) of parameters
    inputs_of : returns the registers that are set from outside, and so are no constants of the motion
    motion : s, (times, states): places at which the rounding of levels is looked at
    """
    reduced, form = plan.reduced, plan.reduced.switched
    assert form is not None
    kinematics = ContactKinematics(plan, values, plan.base(values, signals), signals)
    scene, own = free_dynamics(plan, signals), FreeDynamics(plan, signals, own=False)
    tapes, (force_entry, state_entry, _, quantity, inputs) = own.tapes, own.tables
    wanted = np.concatenate([own.values, own.outputs, own.motions]).astype(int)
    linear, curved = scene.motions_by_shape(inputs_of(scene.plan))
    curved = curved | reduced.in_all_coordinates  # moved with the loops at the end of each step
    parameters = own.quantities.known_variables(plan)
    given = unfilled(own.program, wanted, plan.count)
    given = given[~np.isin(given, np.concatenate([inputs.ravel(), plan.held, plan.states]))]
    texts = zip(*((name, g.closing, g.opening) for name, g in law_rows(reduced.flat, form.laws)), strict=True)
    return LawTables(
        kinematics.table, curved, linear[1], plan.held < 0, *tapes, given, (force_entry, state_entry),
        quantity, parameters, restitutions(form), inputs, plan.held, reading_registers(kinematics),
        _noise(kinematics, *motion), law_names(reduced.flat, form.laws), tuple(texts),
    )  # fmt: skip


def _noise(kinematics: ContactKinematics, times: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Return bounds of what levels are by rounding alone, along a motion."""
    form = kinematics.form
    assert form is not None
    found = np.zeros(form.count)
    step = max(1, len(times) // _SAMPLES)
    for t, x in zip(times[::step].tolist(), states[::step], strict=True):
        found = np.maximum(found, kinematics.noise_at(t, x))
    return found
