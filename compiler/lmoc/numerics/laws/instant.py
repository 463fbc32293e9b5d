"""The laws of a scene at one instant: gaps, rates, the effect of their forces, and their limits."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmoc.engine.library import library
from lmoc.ir.law import COMPLEMENTARY, NONE, LawKind, Switched
from lmoc.numerics.laws.free_dynamics import ByEngine, Interpreted, free_dynamics, quantities_of
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.signals.signals import Signal
from lmoc.support.records import dataclass

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
_NOISES = 4.0  # times the bound for its rounding, within which a level is zero
_SMALL = 1e-12  # of its terms: levels that may be rounding alone
_KEPT = 32  # registers between events that are known again
KINDS = tuple(LawKind)


class Laws(ctypes.Structure):
    """``lmoc_laws`` in ``engine/c/laws.h``."""

    _fields_ = [
        ("count", ctypes.c_int64),
        *[(name, ctypes.c_void_p) for name in ("degree", "normal", "complementary", "dry", "contact")],
    ]


@dataclass(frozen=True, eq=False)
class LawTable:
    """The constants of a run, an entry for each law.

    Attributes
    ----------
    kind : index into KINDS
    degree : 0, 1, 2 or JENKINS (`structure.laws.degree`)
    restitution : Newton's coefficient, 0 for laws without
    normal : index of the law whose force is the normal force of contact friction, NONE for others
    """

    kind: NDArray[np.int64]
    degree: NDArray[np.int64]
    restitution: Array
    normal: NDArray[np.int64]

    def _of(self, *kinds: LawKind) -> Mask:
        return np.isin(self.kind, [KINDS.index(k) for k in kinds])

    @cached_property
    def unilateral(self) -> Mask:
        return self._of(LawKind.UNILATERAL)

    @cached_property
    def complementary(self) -> Mask:
        return self._of(*COMPLEMENTARY)

    @cached_property
    def dry(self) -> Mask:
        return self._of(LawKind.DRY_FRICTION)

    @cached_property
    def contact(self) -> Mask:
        return self._of(LawKind.CONTACT_FRICTION)

    @cached_property
    def in_c(self) -> Laws:
        """The structure that the engine reads; valid as long as the table lives."""
        numbers = [np.ascontiguousarray(v, np.int64) for v in (self.degree, self.normal)]
        made = Laws(len(self.kind), *(v.ctypes.data for v in (*numbers, self.complementary, self.dry, self.contact)))
        made.kept = numbers
        return made


@dataclass(frozen=True, eq=False)
class Instant:
    """Values at a time and state, with all laws open and their forces zero.

    Attributes
    ----------
    t, x : s, (states,)
    gap, rate : (n,) NaN where a law has none
    gap_scale, rate_scale : (n,) sizes of the terms whose sums they are; 0 where there are none
    slope : (2, n, states) derivatives of gaps and rates by the states
    bias : (n,) the level quantities y (`structure.laws.switched`)
    delassus : (n, n) their derivatives by the forces
    response : (states, n) the derivatives of the states' rates by the forces
    slip, stick : (n,) limits of friction, not negative; NaN for complementarities. Those of contact friction are shares
        of the normal force.
    stored : J, NaN without a ledger
    """

    t: float
    x: Array
    gap: Array
    rate: Array
    gap_scale: Array
    rate_scale: Array
    slope: Array
    bias: Array
    delassus: Array
    response: Array
    slip: Array
    stick: Array
    stored: float

    @classmethod
    def of(cls, t: float, x: Array, row: Array, n: int) -> Instant:
        """Return an instant from its values in one row, as ``lmoc_contact`` has them behind the states."""
        m = len(x)
        gap, rate, gap_scale, rate_scale, bias, slip, stick, _ = row[: 8 * n].reshape(8, n)
        delassus, response, slope = np.split(row[8 * n : -1], np.cumsum([n * n, m * n]))
        return cls(
            t, x, gap, rate, gap_scale, rate_scale, slope.reshape(2, n, m), bias, delassus.reshape(n, n),
            response.reshape(m, n), slip, stick, float(row[-1]),
        )  # fmt: skip


class ContactKinematics:
    """Evaluates the laws' quantities for one run.

    Attributes
    ----------
    in_c : what evaluates them in C, as ``lmoc_free_at`` reads it; None where inputs are given by Python, and of scenes
        with nonlinear blocks
    noise : (n,) bounds of what levels are by rounding alone, where that has been looked at; 0 before

    Parameters
    ----------
    plan : of the reduction of a switched form
    values : (flat.count,) parameter values
    base : (plan.count,) registers with all laws open and all forces zero
    signals : of the inputs
    """

    def __init__(self, plan: Plan, values: Array, base: Array, signals: Mapping[int, Signal]) -> None:
        form = plan.reduced.switched
        self.form, self.plan, self.values, self.signals = form, plan, values, signals
        self.base = base
        own = quantities_of(plan, form, form.degree)
        self.registers, self.known = own.registers, own.known(plan, values)
        self._known_variables = own.known_variables(plan)
        self._opened: dict[bytes, Array] = {}
        self.force = plan.reduced.register_of[form.force]
        self.table = law_table(form, values)
        self._restitutions = restitutions(form)
        self.scene = free_dynamics(plan, signals)
        self.stored = self.scene.stored >= 0
        self.noise = np.zeros(form.count)
        self._noisy: tuple[float, Array] | None = None  # where it has been looked at
        self._present = self.scene.quantities.registers >= 0
        self._open_base = self.scene.base(base, signals)
        self._evaluate = self.scene.bind(self._open_base, signals)
        self._program = self._evaluate.in_c(self.known) if isinstance(self._evaluate, ByEngine) else None
        self.in_c = None if self._program is None or self.scene.asks_for_inputs else self._program
        self._last: tuple[float, Array, Array] | None = None

    def revalue(self, values: Array) -> None:
        """Take other parameter values, for what registers do not hold; `renew` is to follow."""
        self.values = values
        there = self._known_variables != NONE
        self.known[there] = values[self._known_variables[there]]
        self.table.restitution[:] = _restitution(self._restitutions, values)

    def renew(self, base: Array) -> None:
        """Take other registers that do not change between events."""
        self.base, self._last, self._noisy = base, None, None
        self.noise[:] = 0.0
        self._open_base = self._opened_by(base)
        self._evaluate.prepare(self._open_base, self.signals)

    def _opened_by(self, base: Array) -> Array:
        """Return what the scene makes of them; the latest ones are known again, where an instant is repeated."""
        key = base.tobytes()
        if key not in self._opened:
            for oldest in list(self._opened)[: 1 - _KEPT]:
                del self._opened[oldest]
            self._opened[key] = self.scene.base(base, self.signals)
        return self._opened[key].copy()

    def stand_at(self, unknowns: NDArray[np.int64], solutions: Array) -> None:
        """Start again from these solutions of nonlinear blocks."""
        self.base[unknowns] = solutions
        self._last = None
        if isinstance(self._evaluate, Interpreted) and self.scene.plan is self.plan:
            self._evaluate.stand_at(unknowns, solutions)

    def without_rounding(self, t: float, x: Array, which: Mask, bias: Array) -> None:
        """Make levels of these laws zero, in place, that are rounding alone.

        Two bodies that fly side by side under the same gravity have no relative acceleration, but the quotient of a
        weight and its mass is not always that gravity to the last digit.
        """
        which = which & (self.scene.quantities.registers[2] >= 0)
        if which.any() and self._noisy is None:
            self._find_noise(t, x)
        small = which & (np.abs(bias) <= np.fmax(_SMALL / 2.0**-53 * self.noise, self.noise))
        if small.any() and (self._noisy[0] != t or (self._noisy[1] != x).any()):
            self._find_noise(t, x)
        bias[small & (np.abs(bias) <= self.noise)] = 0.0

    @property
    def noise_known(self) -> tuple[Array, tuple[float, Array] | None]:
        """What levels are by rounding alone, and where that has been looked at."""
        return self.noise.copy(), self._noisy

    @noise_known.setter
    def noise_known(self, known: tuple[Array, tuple[float, Array] | None]) -> None:
        self.noise[:], self._noisy = known

    def noise_at(self, t: float, x: Array) -> Array:
        """Return bounds of what levels are by rounding alone at an instant, (n,)."""
        self._find_noise(t, x)
        return self.noise.copy()

    def _find_noise(self, t: float, x: Array) -> None:
        """Bound the rounding of the levels at an instant."""
        scene, places = self.scene, self.scene.quantities.registers[2]
        w = self._open_base.copy()
        w[scene.plan.states] = x
        for register, (variable, order) in zip(scene.plan.sampled.tolist(), scene.plan.samplers, strict=True):
            signal = self.signals.get(variable)
            w[register] = 0.0 if signal is None or register in scene.push else signal.value(t, order)
        w[scene.push] = 0.0
        found = np.zeros(len(places))
        found[places >= 0] = scene.level_rounding(w, t)
        self.noise[:], self._noisy = _NOISES * np.nan_to_num(found, nan=0.0, posinf=0.0), (t, x)

    def at(self, t: float, x: Array) -> Instant:
        """Return the laws' quantities at a time and state."""
        return Instant.of(t, x, self.row(t, x), self.form.count)

    def row(self, t: float, x: Array, mode: int | None = None) -> Array:
        """Return them in one row, as ``lmoc_contact`` has them behind the states.

        Parameters
        ----------
        mode : address of an ``lmoc_settled``; with all laws open without it
        """
        last, own = self._last, self._evaluate
        if mode is not None or last is None or last[0] != t or not (last[1] == x).all():
            found = self._by_program(own, t, x, mode) if isinstance(own, ByEngine) else self._found(own, t, x, mode)
            self._last = last = (np.nan if mode else t), x.copy(), found
        return last[2]

    def _by_program(self, program: ByEngine, t: float, x: Array, mode: int | None) -> Array:
        n, m = self.form.count, len(x)
        found, x = np.empty(n * (8 + n + 3 * m) + 1), np.ascontiguousarray(x)
        program.sample(t)
        library().lmoc_free_at(ctypes.byref(self._program), t, x.ctypes.data, mode, found.ctypes.data)
        return found

    def _found(self, program: Interpreted, t: float, x: Array, mode: int | None) -> Array:
        n, present = self.form.count, self._present
        inputs = [library().lmoc_mode_input(mode, n, i) for i in range(3 * n)] if mode else None
        found, force, own = program(t, x, None if inputs is None else np.reshape(inputs, (3, n)))
        value = self.known.copy()
        value[present] = found[: int(present.sum())]
        gap, rate, bias, slip, stick, forces = value
        slope, scale = np.zeros((2, n, len(x))), np.zeros((2, n))
        slope[present[:2]] = own
        motion = value[:2][present[:2]]
        scale[present[:2]] = np.abs(own) @ np.abs(x) + np.abs(motion - own @ x)
        stored = [float(found[-1]) if self.stored else np.nan]
        rows = gap, rate, *scale, bias, np.maximum(slip, 0.0), np.maximum(stick, 0.0), forces
        return np.concatenate([*rows, force.ravel(), slope.ravel(), stored])


def law_table(form: Switched, values: Array) -> LawTable:
    """Return the constants of laws, with parameters (flat.count,)."""
    kind = np.concatenate([np.full(g.rows, KINDS.index(g.kind)) for g in form.laws])
    by_force = {int(v): k for k, v in enumerate(form.force)}
    normal = [
        np.full(g.rows, NONE) if g.normal is None else np.array([by_force.get(int(v), NONE) for v in g.normal])
        for g in form.laws
    ]
    return LawTable(kind, form.degree, _restitution(restitutions(form), values), np.concatenate(normal))


def restitutions(form: Switched) -> NDArray[np.int64]:
    """Return the variables of Newton's coefficients, NONE of laws without."""
    return np.concatenate([np.full(g.rows, NONE) if g.restitution is None else g.restitution for g in form.laws])


def _restitution(own: NDArray[np.int64], values: Array) -> Array:
    return np.where(own == NONE, 0.0, values[own])
