"""The kinematics of contacts as C functions ask for them (``engine/c/kinematics.h``)."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np

from lmoc.engine.answers import Answers, doubles
from lmoc.engine.library import library
from lmoc.numerics.laws.complementarity import NO_SOLUTION, Array
from lmoc.numerics.laws.contradiction import Contradiction
from lmoc.numerics.laws.instant import ContactKinematics, Instant, Laws, Mask

_NO_MEMORY = -1
_REASONS = {NO_SOLUTION: "no forces keep them", 3: "no states nearby satisfy them", 4: "no impulses keep them"}
_PLACE, _TIME = ctypes.c_void_p, ctypes.c_double
_AT = ctypes.CFUNCTYPE(ctypes.c_int, _PLACE, _TIME, _PLACE, _PLACE)
_EXACT = ctypes.CFUNCTYPE(ctypes.c_int, _PLACE, _TIME, _PLACE, _PLACE, _PLACE)
_RELAX = ctypes.CFUNCTYPE(ctypes.c_int, _PLACE, _PLACE, _PLACE, _PLACE)
_DECIDE = ctypes.CFUNCTYPE(ctypes.c_int, _PLACE, _PLACE)


class _Kinematics(ctypes.Structure):
    """``lmoc_kinematics``."""

    _fields_ = [
        ("laws", Laws),
        ("states", ctypes.c_int64),
        *[(name, _PLACE) for name in ("unilateral", "ledger", "restitution", "errors", "unresolved", "owner")],
        *[(name, _PLACE) for name in ("at", "exact", "relax", "decide")],
    ]


class Asked:
    """What C asks in one call: values at places, which are kept.

    Parameters
    ----------
    kinematics : who is asked
    unresolved : (states,) what the integrator tells the states apart by no more
    """

    def __init__(self, kinematics: ContactKinematics, unresolved: Array | float = 0.0) -> None:
        self.kinematics = kinematics
        self._seen: list[Instant] = []
        self._answers = Answers(_NO_MEMORY)
        table, count = kinematics.table, len(kinematics.plan.states)
        self.laws, self.states = len(table.kind), count
        self._at, self._exact = _AT(self._values), _EXACT(self._without_rounding)
        arrays = (
            table.unilateral, np.ascontiguousarray(kinematics.plan.ledger, bool), table.restitution,
            *(np.full(count, 0.0) + v for v in (kinematics.errors, unresolved)),
        )  # fmt: skip
        hooks = (ctypes.cast(h, _PLACE).value for h in (self._at, self._exact))
        self._data = _Kinematics(table.in_c, count, *(a.ctypes.data for a in arrays), None, *hooks)
        self._kept: list[object] = [arrays]

    def springs(self, relax: Callable[[Instant], tuple[Array, Array]], decide: Callable[[Instant], None]) -> None:
        """Have Jenkins friction decided, too.

        Parameters
        ----------
        relax : returns the states behind what gives way, and the energy (laws,) that it costs
        decide : what it does in the mode that has been found
        """

        def relaxed(_: int, x: int, moved: int, lost: int) -> int:
            def work() -> None:
                states, energy = relax(self.instant(self._state(x)))
                doubles(moved, self.states)[:] = states
                doubles(lost, self.laws)[:] += energy

            return self._answers.answer(work)

        def decided(_: int, x: int) -> int:
            return self._answers.answer(lambda: decide(self.instant(self._state(x))))

        hooks = _RELAX(relaxed), _DECIDE(decided)
        self._kept.append(hooks)
        self._data.relax, self._data.decide = (ctypes.cast(h, _PLACE).value for h in hooks)

    def call(self, name: str, laws: Mask, *arguments: object) -> None:
        """Call a function.

        Parameters
        ----------
        laws : (n,) where it says which laws contradict each other

        Raises
        ------
        Contradiction
        """
        given = [a.ctypes.data if isinstance(a, np.ndarray) else a for a in arguments]
        status = self._answers.judge(getattr(library(), name)(ctypes.byref(self._data), *given))
        if status in _REASONS:
            raise Contradiction(np.flatnonzero(laws), _REASONS[status])

    def instant(self, x: Array) -> Instant:
        """Return what has been looked at with these states last."""
        return next(now for now in reversed(self._seen) if np.array_equal(now.x, x, equal_nan=True))

    # ------------------------------------------------------------------ answers

    def _values(self, _: int, t: float, x: int, found: int) -> int:
        def work() -> None:
            now = self.kinematics.at(t, self._state(x))
            self._seen.append(now)
            doubles(found, self.laws * (7 + self.laws + 3 * self.states))[:] = now.values()

        return self._answers.answer(work)

    def _without_rounding(self, _: int, t: float, x: int, which: int, bias: int) -> int:
        def work() -> None:
            own = np.frombuffer((ctypes.c_bool * self.laws).from_address(which), bool)
            now = self.instant(self._state(x))
            clean = self.kinematics.without_rounding(now, own)
            if clean is not now:
                self._seen.append(clean)
                doubles(bias, self.laws)[:] = clean.bias

        return self._answers.answer(work)

    def _state(self, place: int) -> Array:
        return doubles(place, self.states).copy()
