"""The laws of one run on its way: the mode that holds, the functions whose roots end it, and what happens there.

The bookkeeping is C (``engine/c/law_run.c``); here its events get their names and its refusals their words.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from lmoc.engine.segments import ModeRegisters
from lmoc.ir.law import Switched
from lmoc.ir.mode import event_word, law_rows, mode_word
from lmoc.numerics.evaluate.function import watched
from lmoc.numerics.laws.complementarity import Array
from lmoc.numerics.laws.contradiction import Contradiction
from lmoc.numerics.laws.free_dynamics import mode_registers
from lmoc.numerics.laws.instant import ContactKinematics
from lmoc.numerics.laws.law_run import CHATTERS, GAP_JUMPS, NO_END, LawRun, Told
from lmoc.numerics.laws.reading import reader
from lmoc.numerics.observe.event import Event
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.mode import Mode
from lmoc.numerics.problem.roots import Roots
from lmoc.numerics.problem.status import Status, Stopped
from lmoc.numerics.signals.signals import Constant, Signal

KEPT = 1e-14  # share of its terms by which what is closed may miss zero at output times
NEAR = 1e-10  # a mode with values below zero by more does not hold any longer where a run goes on
_IMPACT_LAWS = ("Newton", "Poisson")
_KEPT = 16  # modes that are known again
_NOTHING, _ACCUMULATION, _IMPACT = range(3)  # (``law_run.h``); the others are what laws themselves call it


class LawSwitching:
    """The state of the laws of one run.

    Parameters
    ----------
    plan : of the reduction of a switched form
    values, base, signals : of the run, with all laws open
    moment : s, within which laws that open and close without end are chattering

    Attributes
    ----------
    mode : Mode
    run : LawRun
    """

    def __init__(
        self, plan: Plan, values: Array, base: Array, signals: Mapping[int, Signal], moment: float = 0.0
    ) -> None:
        self.kinematics = ContactKinematics(plan, values, base, signals)
        self.laws, self.parts = law_rows(plan.reduced.flat, self.kinematics.form.laws), plan.reduced.flat.parts
        self.reader = reader(self.kinematics)
        self.undecided: list[tuple[float, list[str]]] = []  # s, and the laws of impacts whose order would matter
        self.ledger = plan.accounts if self.kinematics.stored else (-1, -1)
        self.run = LawRun(self.kinematics, self.ledger, moment)
        registers = mode_registers(plan).ravel()
        self._shown = np.flatnonzero(registers >= 0)  # numbers of a mode that stand in registers, and in which
        self._registers = registers[self._shown]
        self._modes: dict[bytes, Mode] = {}  # the latest ones: an instant that is repeated leads to them again
        self._mode: Mode = self.run.mode
        self._signals: WeakKeyDictionary[Mode, dict[int, Signal]] = WeakKeyDictionary()

    # ------------------------------------------------------------------ the mode as values

    @property
    def mode(self) -> Mode:
        return self._mode

    @mode.setter
    def mode(self, mode: Mode) -> None:
        self.run.mode = self._mode = mode

    def _now(self) -> Mode:
        """Return the mode that holds now: the same object as before, where it is the same."""
        return self._known(self.run.mode)

    def _known(self, mode: Mode) -> Mode:
        key = mode.key + mode.push.tobytes()
        if key not in self._modes:
            for oldest in list(self._modes)[: 1 - _KEPT]:
                del self._modes[oldest]
            self._modes[key] = mode
        return self._modes[key]

    def pass_by(self, told: Told, mode: Mode) -> list[Event]:
        """Take the mode behind an instant that C has seen to; return what happened there."""
        self._mode = self._known(mode)
        return self._events(told)

    @property
    def second(self) -> NDArray[np.int64]:
        """The laws whose forces have a lower limit as well."""
        return np.flatnonzero(self.mode.closed & ~self.kinematics.table.complementary)

    @property
    def held(self) -> NDArray[np.bool_]:
        """(states,) velocities that the closed laws keep at zero."""
        return self.run.held

    @property
    def rounding(self) -> Array:
        """(states,) of their rates, by the forces that hold there."""
        return self.run.rounding.copy()

    def allow(self, unresolved: Array | float, errors: Array | float) -> None:
        """Take what the integrator tells the states apart by no more, and what it has allowed itself in a step."""
        self.run.unresolved[:], self.run.errors[:] = unresolved, errors

    @property
    def mode_registers(self) -> ModeRegisters:
        """Where `put` writes."""
        return ModeRegisters(self._shown, self._registers, self.kinematics.plan.held)

    def put(self, base: Array) -> None:
        """Put the mode into registers that do not change until the next event."""
        mode = self.mode
        numbers = np.concatenate([mode.closed & ~mode.implied, mode.push, mode.direction])
        base[self._registers] = numbers[self._shown]
        base[self.kinematics.plan.held[self.held]] = 1.0

    def signals(self) -> dict[int, Signal]:
        """Return the values of the mode, by flat variables."""
        mode = self.mode
        values = self._signals.get(mode)
        if values is None:
            pairs = mode.inputs(self.kinematics.form)
            values = {int(v): Constant(float(k)) for vs, ks in pairs for v, k in zip(vs, ks, strict=True)}
            self._signals[mode] = values
        return values

    # ------------------------------------------------------------------ what ends a mode

    def roots(self, t: float, x: Array, base: Array, signals: Mapping[int, Signal]) -> Roots:
        """Return the functions that are positive as long as the mode holds: one a law, two for stuck friction.

        Parameters
        ----------
        t, x : where the segment begins
        base, signals : those of the segment
        """
        evaluate, run = self.reader(base, signals), self.run
        count = run.watch(evaluate(np.array([t]), x[None])[0])
        in_c = watched(evaluate, count, laws=run.address)
        return Roots(lambda times, states: run.values(evaluate(times, states), count), np.ones(count), in_c=in_c)

    # ------------------------------------------------------------------ what stays closed

    @property
    def drifts(self) -> bool:
        """Whether there are gaps or rates of closed laws that the integrator keeps at zero within its errors alone."""
        return self.run.drifts

    def kept(self, t: float, x: Array, share: float = KEPT) -> Array:
        """Return a state moved onto what is closed: the same array where it is there, NaN where there is no way.

        Parameters
        ----------
        share : of the terms of a gap, or of a rate, by which it may miss zero
        """
        moved = np.array(x)
        try:
            self.run.call("lmoc_law_keep", t, share, moved)
        except Contradiction:
            return np.full(len(x), np.nan)
        return x if (moved == x).all() else moved

    # ------------------------------------------------------------------ what happens

    def start(self, t: float, x: Array) -> tuple[Array, list[Event]]:
        """Return the state at the start, on what is closed there, and what happened on the way."""
        return self._take("lmoc_law_start", t, x)

    def resume(self, t: float, x: Array, base: Array, signals: Mapping[int, Signal]) -> tuple[Array, list[Event]]:
        """Return the state with which a run goes on in the mode in which another one has ended, as `start`.

        Where that mode does not hold with the present parameters and inputs, the next one is found as at an event.

        Parameters
        ----------
        base, signals : with the mode
        """
        self.run.call("lmoc_law_go_on", t, x, 1)
        values = self.roots(t, x, base, signals).values(np.array([t]), x[None])[0]
        return (x, []) if (values >= -NEAR).all() else self.happen(t, x)

    def go_on(self, before: LawSwitching, t: float, x: Array) -> None:
        """Take over the mode at the same place from the laws in other coordinates."""
        self.mode = before.mode
        for name in ("touched", "begun", "force"):
            getattr(self.run, name)[:] = getattr(before.run, name)
        self.run.call("lmoc_law_go_on", t, x, 0)

    def memory(self) -> dict[str, NDArray[Any]]:
        """Return what decides about the next instant, for `recall`."""
        return self.run.memory()

    def recall(self, memory: Mapping[str, NDArray[Any]], push: Array, values: Array, base: Array) -> None:
        """Be as the laws were before an instant, with other values.

        Parameters
        ----------
        push : (laws,) as of `Mode`
        values : (flat.count,) of parameters
        base : registers that do not change between events
        """
        self.kinematics.revalue(values)
        self.renew(base)
        self.run.recall(memory, push)
        self._mode = self._now()
        self.undecided.clear()

    def renew(self, base: Array) -> None:
        """Take other registers that do not change between events."""
        self.kinematics.renew(base)
        self.run.call("lmoc_law_renew")

    def happen(
        self, t: float, x: Array, which: NDArray[np.bool_] | None = None, jumped: bool = False
    ) -> tuple[Array, list[Event]]:
        """Return the state behind an instant at which root functions vanish, and what happened.

        Parameters
        ----------
        which : of the root functions; None for none
        jumped : the states have been changed from outside
        """
        n, every = self.run.n, np.zeros(2 * self.run.n, bool)
        if which is not None:
            every[:n], every[n + self.second] = which[:n], which[n:]
        return self._take("lmoc_law_happen", t, x, every, jumped)

    def strike(self, t: float, before: Array, x: Array) -> Array:
        """Return states that a step has moved, with the impulses of closed laws that keep them closed.

        What steps does so ever faster, and what is closed does not bounce on that way: the impact is plastic.
        """
        moved = np.array(x)
        self.run.call("lmoc_law_strike", t, np.ascontiguousarray(before), moved)
        return moved

    def _names(self, which: NDArray[np.bool_]) -> str:
        return ", ".join(dict.fromkeys(self.laws[k][0] for k in np.flatnonzero(which).tolist()))

    def settle(
        self,
        t: float,
        before: Array,
        x: Array,
        renewed: Callable[[], Array],
        happened: Callable[[list[Event]], None],
        settle: Callable[[Array], Array],
    ) -> Array:
        """Return the states behind an instant at which laws and discrete equations answer each other.

        Parameters
        ----------
        before, x : the states as the laws have left them, and as they are now
        renewed : returns the registers that do not change between events, with the present discrete values
        happened : takes the events of the laws
        settle : returns the states behind the discrete equations, judged with the present mode

        Raises
        ------
        Stopped
        """
        before, x, run = np.array(before), np.array(x), self.run
        run.time = t

        def renew() -> None:
            self.kinematics.renew(renewed())

        def tell() -> None:
            happened(self._happened(t))

        self._judged(t, lambda: run.settle(before, x, renew, tell, settle))
        return x

    def _take(self, name: str, t: float, x: Array, *arguments: object) -> tuple[Array, list[Event]]:
        moved, run = np.array(x), self.run
        run.time = t
        self._judged(t, lambda: run.call(name, t, moved, *arguments))
        return moved, self._happened(t)

    def _judged(self, t: float, call: Callable[[], int]) -> None:
        """Make a call; say by `Stopped` why there is no way."""
        run = self.run
        try:
            status = call()
        except Contradiction as contradiction:
            names = ", ".join(dict.fromkeys(self.laws[k][0] for k in contradiction.laws.tolist()))
            reason = f"the laws of {names} contradict each other at t = {t:.6g} s: {contradiction}"
            raise Stopped(Status.CONTRADICTION, reason) from None
        if status == NO_END:
            raise Stopped(Status.UNSETTLED, f"laws and events change each other again and again at t = {t:g} s")
        if status == CHATTERS:
            names = self._names(run.laws)
            raise Stopped(Status.CHATTERING, f"the laws of {names} open and close without end at t = {t:.6g} s")
        if status:
            (k,) = np.flatnonzero(run.laws).tolist()
            (name, laws), gap = self.laws[k], run.gap(k)
            if status == GAP_JUMPS:
                reason = f"the gap of '{name}', which is closed, jumps to {gap:.6g} at t = {t:.6g} s"
                raise Stopped(Status.CONTRADICTION, f"{reason} (give a ramp of finite length instead of a step)")
            reason = f"the gap of '{name}' is negative, {gap:.6g}, at t = {t:.6g} s"
            hint = f"it may be zero or positive: start values of positions move the parts that meet in '{name}' apart"
            raise Stopped(Status.CONTRADICTION, reason, self.parts[laws.part].span, hint)

    def _happened(self, t: float) -> list[Event]:
        """Take what C has found; return it as events."""
        run = self.run
        if run.undecided.any():
            self.undecided.append((t, [self.laws[k][0] for k in np.flatnonzero(run.undecided).tolist()]))
        self._mode = self._now()
        return self._events(run.told())

    def _events(self, run: Told) -> list[Event]:
        events = []
        passed = tuple((self.laws[k][0], float(run.impulse[k])) for k in run.passing.nonzero()[0].tolist())
        for k in run.kind.nonzero()[0].tolist():
            name, laws = self.laws[k]
            was, now, impulse = bool(run.was[k]), bool(run.is_[k]), float(run.impulse[k])
            own = {_ACCUMULATION: "accumulation", _IMPACT: "impact"}.get(run.kind[k])
            events.append(
                Event(
                    float(run.when[k]),
                    name,
                    own or event_word(laws, was, now),
                    mode_word(laws, was),
                    mode_word(laws, now),
                    impulse,
                    float(run.lost[k]),
                    f"{_IMPACT_LAWS[run.law]}'s law" if impulse else "",
                    passed if impulse else (),
                )
            )
        return events


def all_open(form: Switched) -> dict[int, Signal]:
    """Return the values with which all laws are open and give no force, by flat variables."""
    held = form.modes
    return {int(v): Constant(0.0) for v in held}
