"""The laws of one run as the engine keeps them (``engine/c/law_run.c``): their memory, and who is asked."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lmoc.engine.answers import Answers, doubles
from lmoc.engine.library import address, library
from lmoc.engine.segments import Laws as Kept
from lmoc.numerics.laws.complementarity import NO_SOLUTION, Array
from lmoc.numerics.laws.contradiction import Contradiction
from lmoc.numerics.laws.instant import ContactKinematics, Laws, Mask
from lmoc.numerics.problem.mode import Mode

OVERLAPS, GAP_JUMPS, CHATTERS, NO_END = 5, 6, 7, 8  # what else a call may come to, (``law_run.h``)
_NO_MEMORY = -1
_REASONS = {NO_SOLUTION: "no forces keep them", 3: "no states nearby satisfy them", 4: "no impulses keep them"}
_PLACE, _TIME, _COUNT = ctypes.c_void_p, ctypes.c_double, ctypes.c_int64
_AT = ctypes.CFUNCTYPE(ctypes.c_int, _PLACE, _TIME, _PLACE, _PLACE, _PLACE)
_EXACT = ctypes.CFUNCTYPE(ctypes.c_int, _PLACE, _TIME, _PLACE, _PLACE, _PLACE)
_DO = ctypes.CFUNCTYPE(ctypes.c_int, _PLACE)
_SETTLE = ctypes.CFUNCTYPE(ctypes.c_int, _PLACE, _TIME, _PLACE)


def _places(*names: str) -> list[tuple[str, Any]]:
    return [(name, _PLACE) for name in names]


class _Kinematics(ctypes.Structure):
    """``lmoc_kinematics``."""

    _fields_ = [
        ("laws", Laws),
        ("states", _COUNT),
        *_places("unilateral", "ledger", "restitution", "errors", "unresolved"),
        ("guessed", _COUNT),
        *_places("owner"),
        *_places("at", "exact"),
        ("ties", _COUNT),
        *_places("tie"),
    ]


class _Contact(ctypes.Structure):
    """``lmoc_contact``."""

    _fields_ = [
        ("time", _TIME),
        *_places("x", "gap", "rate", "gap_scale", "rate_scale", "bias", "slip", "stick", "force"),
        *_places("delassus", "response", "slope", "stored"),
    ]


class _Settled(ctypes.Structure):
    """``lmoc_settled``."""

    _fields_ = _places("closed", "implied", "unique", "laws", "direction", "push", "force", "level")


class _LawRun(ctypes.Structure):
    """``lmoc_law_run``."""

    _fields_ = [
        ("k", _Kinematics),
        *_places("curved", "linear", "position", "limits", "noise"),
        ("work", _COUNT),
        ("heat", _COUNT),
        ("moment", _TIME),
        *_places("times", "direction", "push", "force", "idle", "rounding", "forms", "impacts", "changes", "left"),
        *_places("apart", "turning", "opening", "closing", "closed", "implied", "touched", "held"),
        *_places("kind", "when", "impulse", "lost", "level"),
        *_places("was", "is_", "passing", "accumulated", "undecided", "laws"),
        ("until", _TIME),
        ("law", _COUNT),
        ("some", _COUNT),
        ("now", _Contact),
        ("past", _Contact),
        ("spare", _Contact),
        ("next", _Settled),
        *_places("root", "inputs", "none"),
    ]


class _Discrete(ctypes.Structure):
    """``lmoc_discrete``."""

    _fields_ = _places("owner", "renew", "happened", "settle")


_TIMES, _SERIES, _CHANGES = 4, 3, 500  # (``law_run.h``)
_REMEMBERED = (
    "force", "idle", "direction", "turning", "opening", "closed", "implied", "touched", "errors", "unresolved", "left",
)  # fmt: skip
_NUMBERS = ("push", "force", "idle", "left", "when", "impulse", "lost", "level")
_COUNTS = ("direction", "turning", "kind")
_MODE = {"closed": bool, "direction": np.int64, "implied": bool, "push": float}
_TOLD = {"kind": np.int64, "when": float, "impulse": float, "lost": float, "was": bool, "is_": bool, "passing": bool}
_FLAGS = (
    "opening", "closing", "closed", "implied", "touched", "was", "is_", "passing", "accumulated", "undecided", "laws",
)  # fmt: skip


class Told(NamedTuple):
    """What has happened at an instant, (n,) each as of ``lmoc_law_run``."""

    kind: NDArray[np.int64]
    when: Array
    impulse: Array
    lost: Array
    was: Mask
    is_: Mask
    passing: Mask
    law: int


class LawRun:
    """The state of the laws of one run.

    Attributes
    ----------
    data : what C works on
    time : s, of the instant that is decided
    push, closed, … : arrays as of ``lmoc_law_run``; what C and Python write is the same memory
    errors, unresolved : (states,) what the integrator allows itself in a step, and what it tells apart by no more

    Parameters
    ----------
    ledger : the states that are work and heat; -1 where there are none
    moment : s, within which laws chatter
    """

    push: Array
    force: Array
    impulse: Array
    lost: Array
    level: Array
    when: Array
    direction: NDArray[np.int64]
    turning: NDArray[np.int64]
    kind: NDArray[np.int64]
    closed: Mask
    implied: Mask
    touched: Mask
    opening: Mask
    was: Mask
    is_: Mask
    passing: Mask
    accumulated: Mask
    undecided: Mask
    laws: Mask

    def __init__(self, kinematics: ContactKinematics, ledger: tuple[int, int], moment: float) -> None:
        self.kinematics, self.time = kinematics, 0.0
        self._answers = Answers(_NO_MEMORY)
        self._asked_at, self._noise = -np.inf, kinematics.noise_known  # what was known before it was asked last
        self.n, self.states = len(kinematics.table.kind), len(kinematics.plan.states)
        self.errors, self.unresolved = np.zeros((2, self.states))
        self.data = self._laid_out(ledger, moment)
        self.reference, self.address = ctypes.byref(self.data), ctypes.addressof(self.data)
        self._memory = np.zeros(library().lmoc_law_place(self.reference, None))
        library().lmoc_law_place(self.reference, self._memory.ctypes.data)
        library().lmoc_law_open(self.reference)
        for names, kind in ((_NUMBERS, float), (_COUNTS, np.int64), (_FLAGS, bool)):
            for name in names:
                setattr(self, name, self._view(getattr(self.data, name), self.n, kind))
        self.rounding = self._view(self.data.rounding, self.states, float)
        self.held = self._view(self.data.held, self.states, bool)
        self.begun = self._view(self.data.times, 1, float)
        self._history = {"times": self._view(self.data.times, _TIMES, float)}
        self._history["impacts"] = self._view(self.data.impacts, self.n * _SERIES, float)
        self._history["apart"] = self._view(self.data.apart, 2 * self.n, float)
        self._changes = self._view(self.data.changes, _CHANGES, float)
        self.call("lmoc_law_renew")

    def _laid_out(self, ledger: tuple[int, int], moment: float) -> _LawRun:
        kinematics, table = self.kinematics, self.kinematics.table
        flags = kinematics.plan.ledger, kinematics.scene.curved, kinematics.scene.linear[1], kinematics.plan.held < 0
        ledger_states, *masks = (np.ascontiguousarray(v, bool) for v in flags)
        limits = np.ascontiguousarray(kinematics.known[4])
        in_c = kinematics.in_c
        at = None if in_c is not None else _AT(self._values)
        exact = _EXACT(self._without_rounding)
        self._kept: list[object] = [ledger_states, masks, limits, in_c, at, exact]
        asked = address("lmoc_free_at") if at is None else ctypes.cast(at, _PLACE).value
        owner = None if in_c is None else ctypes.addressof(in_c)
        given = (table.unilateral, ledger_states, table.restitution, self.errors, self.unresolved)
        own = _Kinematics(
            table.in_c, self.states, *(a.ctypes.data for a in given), 0, owner, asked, ctypes.cast(exact, _PLACE).value
        )
        return _LawRun(own, *(a.ctypes.data for a in (*masks, limits, kinematics.noise)), *ledger, moment)

    def _view(self, place: int | None, count: int, kind: type) -> NDArray[Any]:
        size = count * np.dtype(kind).itemsize
        if not size or place is None:
            return np.zeros(0, kind)
        return np.frombuffer((ctypes.c_char * size).from_address(place), kind)

    # ------------------------------------------------------------------ the mode

    @property
    def mode(self) -> Mode:
        """The mode that holds."""
        return Mode(self.closed.copy(), self.direction.copy(), self.implied.copy(), self.push.copy())

    @mode.setter
    def mode(self, mode: Mode) -> None:
        for name in ("closed", "direction", "implied", "push"):
            getattr(self, name)[:] = getattr(mode, name)

    def gap(self, law: int) -> float:
        """Return the gap that has been looked at last."""
        return float(self._view(self.data.spare.gap, self.n, float)[law])

    def memory(self) -> dict[str, NDArray[Any]]:
        """Return what decides about the next instant, for `recall`."""
        return {name: getattr(self, name).copy() for name in _REMEMBERED} | {
            name: view.copy() for name, view in self._history.items()
        }

    def recall(self, memory: dict[str, NDArray[Any]], push: Array) -> None:
        """Be as it was; changes of laws by which chattering is known are forgotten.

        Parameters
        ----------
        push : (laws,) in place of that of then
        """
        for name, value in memory.items():
            (self._history[name] if name in self._history else getattr(self, name))[:] = value
        self.push[:] = push
        self._changes[:] = -np.inf

    # ------------------------------------------------------------------ instants

    @property
    def in_c(self) -> Kept:
        """What goes from instant to instant in C reads."""
        return Kept(self.address, self.n, self._memory, self.errors, self.unresolved)

    def told(self) -> Told:
        """Return what has happened last."""
        return Told(**{name: getattr(self, name) for name in _TOLD}, law=self.data.law)

    def kept(self, memory: Array) -> list[tuple[Mode, Array, Told]]:
        """Return the mode behind some instants, the rounding there as of `rounding`, and what has happened.

        Parameters
        ----------
        memory : (instants, …) of the laws behind each, with the law of impact and what else C keeps in the end
        """
        rows, begin, n = memory.view(np.uint8), self._memory.ctypes.data, self.n

        def view(name: str, count: int, kind: type) -> NDArray[Any]:
            place = getattr(self.data, name) - begin
            return rows[:, place : place + count * np.dtype(kind).itemsize].copy().view(kind)

        mode = (view(k, n, kind) for k, kind in _MODE.items())
        own = (view(name, n, kind) for name, kind in _TOLD.items())
        modes, told = map(Mode, *mode), map(Told, *own, memory[:, -1].astype(int).tolist())
        return list(zip(modes, view("rounding", self.states, float), told, strict=True))

    def forget_after(self, time: float) -> None:
        """Know as little of rounding as before what has been asked later than at a time, which is to be done again."""
        self._answers.judge(0)
        if self._asked_at > time:
            self.kinematics.noise_known, self._asked_at = self._noise, -np.inf

    # ------------------------------------------------------------------ calls

    def call(self, name: str, *arguments: Any) -> int:
        """Call a function; the status is 0 or one of those above.

        Raises
        ------
        Contradiction
        """
        given = [a.ctypes.data if isinstance(a, np.ndarray) else a for a in arguments]
        status: int = self._answers.judge(getattr(library(), name)(self.reference, *given))
        if status in _REASONS:
            raise Contradiction(np.flatnonzero(self.laws), _REASONS[status])
        return status

    @property
    def drifts(self) -> bool:
        """Whether something is closed that integrators keep so within their errors alone."""
        return bool(library().lmoc_law_drifts(self.reference))

    def settle(
        self,
        before: Array,
        x: Array,
        renew: Callable[[], None],
        happened: Callable[[], None],
        settle: Callable[[Array], Array],
    ) -> int:
        """Let laws and discrete equations answer each other until nothing changes; the status is as of `call`.

        Parameters
        ----------
        before, x : states as the laws have left them, and as they are now; moved to what follows
        renew : has the laws judged with the present discrete values
        happened : tells of the laws
        settle : returns the states behind the discrete equations, judged with the present mode
        """

        def settled(_: int, t: float, place: int) -> int:
            def work() -> None:
                states = doubles(place, self.states)
                states[:] = settle(states.copy())

            return self._answers.answer(work)

        hooks = (
            _DO(lambda _: self._answers.answer(renew)), _DO(lambda _: self._answers.answer(happened)), _SETTLE(settled)
        )  # fmt: skip
        asked = _Discrete(None, *(ctypes.cast(h, _PLACE).value for h in hooks))
        return self.call("lmoc_law_settle", ctypes.addressof(asked), self.time, before, x)

    def watch(self, read: Array) -> int:
        """Begin a segment where the quantities of the roots, (4 laws), are these; return how many roots there are."""
        library().lmoc_law_watch(self.reference, np.ascontiguousarray(read).ctypes.data)
        return self.n + int((self.closed & ~self.kinematics.table.complementary).sum())

    def values(self, read: Array, count: int) -> Array:
        """Return the root functions, (k, count), from their quantities at some places, (k, 4 laws)."""
        read, found = np.ascontiguousarray(read), np.empty((len(read), count))
        library().lmoc_law_values(self.reference, len(read), read.ctypes.data, found.ctypes.data)
        return found

    # ------------------------------------------------------------------ answers

    def _values(self, _: int, t: float, x: int, mode: int | None, found: int) -> int:
        def work() -> None:
            row = self.kinematics.row(t, doubles(x, self.states).copy(), mode)
            doubles(found, len(row))[:] = row

        return self._answers.answer(work)

    def _without_rounding(self, _: int, t: float, x: int, which: int, bias: int) -> int:
        def work() -> None:
            if t != self._asked_at:
                self._asked_at, self._noise = t, self.kinematics.noise_known
            own = np.frombuffer((ctypes.c_bool * self.n).from_address(which), bool)
            self.kinematics.without_rounding(t, doubles(x, self.states).copy(), own, doubles(bias, self.n))

        return self._answers.answer(work)
