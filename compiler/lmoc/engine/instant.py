"""What happens at an instant, as C functions work on it (``c/instant.h``): its memory, and who is asked."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from lmoc.engine.kernel import Kernel
from lmoc.engine.library import address, library
from lmoc.lower.tape import Tape

SETTLED, NO_VALUE, HALTED, UNSETTLED = range(4)
BEGUN, _HISTORY = 100, 102  # rows of ``history``: behind the rounds the values before them (``LMOC_BEGUN``); how many

_HOOK = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p)
_MOVE = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_double, ctypes.c_void_p
)
COUNTED = {  # by the lengths of which tables
    "discrete": "own", "zeros": "of_zero", "relations": "op", "before": "now", "samples": "sample", "reinits": "guard",
    "told": "tell", "bounded": "read", "assigned": "filled",
}  # fmt: skip
TABLES = (
    "own", "op", "target", "row", "of_zero", "slope", "offset", "written", "now", "past", "held", "sample", "start",
    "interval", "guard", "state", "value", "tell", "sought", "read",
    "filled", "first_used", "used",
)  # fmt: skip
_NUMBERS = {
    "zero": "zeros", "margin": "zeros", "largest": "zeros", "high": "zeros", "crossed": "zeros", "bound": "zeros",
    "way": "states", "known": "bounded", "supposed": "relations", "early": "relations", "changed": "discrete",
    "flipped": "discrete", "moved": "states",
}  # fmt: skip
_SCALARS = ("time", "bound_time", "bound_size", "bound_known")
_HOOKS = ("look", "widen", "bounds", "others", "regular")


class _Looking(ctypes.Structure):
    """``lmoc_looking``."""

    _fields_ = [
        ("w", ctypes.c_void_p), ("tape", ctypes.c_void_p), ("blocks", ctypes.c_int64), ("block", ctypes.c_void_p)
    ]  # fmt: skip


class _View(ctypes.Structure):
    """``lmoc_view``."""

    _fields_ = [
        ("at", _Looking), ("along", _Looking), ("seen", ctypes.c_int64),
        *[(name, ctypes.c_void_p) for name in ("states", "given", "zero", "rates", "from_", "to")],
    ]  # fmt: skip


class _Instant(ctypes.Structure):
    """``lmoc_instant``."""

    _fields_ = [
        *[(name, ctypes.c_int64) for name in ("states", *COUNTED)],
        *[(name, ctypes.c_void_p) for name in (*TABLES, "assign", "lines", "v", "line", *_NUMBERS, "history")],
        *[(name, ctypes.c_void_p) for name in ("near", "found")],
        *[(name, ctypes.c_int64) for name in ("found_count", "literal", "supposing", "jumped", "bound_known")],
        *[(name, ctypes.c_double) for name in ("time", "bound_time", "bound_size")],
        ("owner", ctypes.c_void_p),
        *[(name, ctypes.c_void_p) for name in _HOOKS],
        *[(name, ctypes.c_void_p) for name in ("move", "follow")],
    ]


class Instant:
    """The memory of the discrete equations.

    Parameters
    ----------
    tables : by name, as in ``lmoc_instant``
    states : how many
    programs : the discrete equations, over the places of the tables, and the relations of time

    Attributes
    ----------
    v : the memory of `assign`
    zero, margin, … : arrays as of ``lmoc_instant``; what C and Python write is the same memory
    """

    zero: np.ndarray
    margin: np.ndarray
    largest: np.ndarray
    high: np.ndarray
    crossed: np.ndarray
    bound: np.ndarray
    way: np.ndarray
    supposed: np.ndarray
    early: np.ndarray
    changed: np.ndarray
    flipped: np.ndarray
    moved: np.ndarray

    def __init__(self, tables: Mapping[str, np.ndarray], states: int, programs: tuple[Tape, Tape]) -> None:
        assign, lines = map(Kernel, programs)
        counts = {"states": states, **{name: len(tables[column]) for name, column in COUNTED.items()}}
        self._tables = [np.ascontiguousarray(tables[name], np.int32) for name in TABLES]
        numbers = {name: np.zeros(counts[size]) for name, size in _NUMBERS.items()}
        for name, array in numbers.items():
            setattr(self, name, array)
        self._numbers = numbers
        self.v, self._line = assign.w, lines.w
        self.history = np.empty((_HISTORY, counts["discrete"]))
        self._near, self._found = np.zeros(counts["zeros"], np.uint8), np.zeros(counts["told"], np.int64)
        lined = lines if len(tables["slope"]) else None
        self.data = _Instant(
            *counts.values(), *(t.ctypes.data for t in self._tables), assign.addresses[1],
            None if lined is None else lined.addresses[1], self.v.ctypes.data, lines.w.ctypes.data,
            *(a.ctypes.data for a in numbers.values()), self.history.ctypes.data, self._near.ctypes.data,
            self._found.ctypes.data, widen=address("lmoc_widen"), others=address("lmoc_try_relations"),
        )  # fmt: skip
        self.reference = ctypes.byref(self.data)
        self._kept: list[object] = [assign, lines]
        self._library = library()
        self._failed: BaseException | None = None
        self.roots = int(self._library.lmoc_roots(self.reference))

    # ------------------------------------------------------------------ who is asked

    def fill(self, values: np.ndarray) -> None:
        """Take the first values of the memory."""
        self.v[: len(values)] = self._line[: len(values)] = values

    def give(self, places: np.ndarray, values: np.ndarray) -> None:
        """Take other values of parameters."""
        self.v[places] = self._line[places] = values

    def view(self, tape: Tape, registers: tuple[np.ndarray, ...], seen: np.ndarray, along: Tape | None) -> list[Kernel]:
        """Look by programs at a place, and at the motion where there is one for that; they are returned.

        Parameters
        ----------
        registers : of states, of discrete values, zero functions, and rates of the states
        seen : (2, k) registers of what is seen, and its places
        """
        kernels = [Kernel(one) for one in (tape, along) if one is not None]
        tables = [np.ascontiguousarray(t, np.int32) for t in (*registers, *seen)]
        looking = [_Looking(*k.addresses, len(k.tape.blocks), ctypes.addressof(k.blocks)) for k in kernels]
        own = _View(looking[0], looking[-1], seen.shape[1], *(t.ctypes.data for t in tables))
        self._kept += [kernels, tables, own]
        self.data.owner, self.data.look = ctypes.addressof(own), address("lmoc_look_at")
        return kernels

    def ask(self, name: str, hook: Callable[[float, np.ndarray], bool]) -> None:
        """Have a function of time and states answer; whether it has one."""
        self._kept.append(one := self.hook(hook))
        setattr(self.data, name, ctypes.cast(one, ctypes.c_void_p).value)

    def hook(self, hook: Callable[[float, np.ndarray], bool]) -> Any:
        """Return a function that C asks: of a structure, a time and states, which it may move."""
        states = self.data.states

        def call(_: int, time: float, x: int) -> int:
            return self.answer(lambda: hook(time, _array(x, states)))

        return _HOOK(call)

    def memory(self, *names: str) -> list[tuple[int, int]]:
        """Return where numbers of the ``lmoc_instant`` stand, and how many they are."""
        found = [self._numbers[name] if name != "v" else self.v for name in names if name not in _SCALARS]
        return [(a.ctypes.data, a.size) for a in found] + [
            (ctypes.addressof(self.data) + getattr(_Instant, name).offset, 1) for name in names if name in _SCALARS
        ]

    def read_by(self, changed: np.ndarray) -> np.ndarray:
        """Return the zero functions of relations in the discrete equations of what has changed, (discrete,)."""
        found = np.zeros(len(self.zero), np.int64)
        count = self.call("lmoc_zeros_read", np.asarray(changed, float), found)
        if count < 0:
            raise MemoryError
        return found[:count]

    def begun(self) -> np.ndarray:
        """Return the discrete values with which the last round of an event began, (discrete,)."""
        begun: np.ndarray = self.history[BEGUN]
        return begun.copy()

    def tried(
        self,
        x: np.ndarray,
        begun: np.ndarray,
        zeros: np.ndarray,
        most: tuple[int, int],
        accept: Callable[[float, np.ndarray], bool],
    ) -> bool:
        """Take values with which all equations hold, and that are accepted, if there are any.

        Parameters
        ----------
        begun : (discrete,) values that are changed
        zeros : functions of the relations whose values are tried
        most : of them that are changed at once, and how many combinations are tried
        accept : a function of time and states
        """
        hook = self.hook(accept)
        place = ctypes.cast(hook, ctypes.c_void_p).value
        own = np.asarray(zeros, np.int64)
        return bool(self.call("lmoc_try", x, begun, len(own), own, *most, place) == SETTLED)

    def ask_to_move(self, hook: Callable[[np.ndarray, int, float, np.ndarray], bool]) -> None:
        """Have a function of states, the number of a `reinit`, its value and the states behind it change these."""
        states = self.data.states

        def call(_: int, x: int, reinit: int, wanted: float, moved: int) -> int:
            return self.answer(lambda: hook(_array(x, states).copy(), reinit, wanted, _array(moved, states)))

        self._kept.append(one := _MOVE(call))
        self.data.move = ctypes.cast(one, ctypes.c_void_p).value

    def answering(
        self, look: Callable[[float, np.ndarray], tuple[np.ndarray, ...]], sizes: tuple[int, ...]
    ) -> Callable[..., int]:
        """Return a function that C asks: of this structure, a time and states, and the places of arrays of results."""
        states = self.data.states

        def call(_: int, time: float, x: int, *places: int) -> int:
            def work() -> bool:
                found = look(time, _array(x, states))
                for values, place, size in zip(found, places, sizes, strict=True):
                    _array(place, size)[:] = values
                return True

            return self.answer(work)

        return call

    def answer(self, work: Callable[[], bool]) -> int:
        """Do what C has asked for; keep what is raised until C has come back."""
        try:
            return SETTLED if work() else UNSETTLED
        except BaseException as raised:
            self._failed = raised
            return HALTED

    def call(self, name: str, *arguments: Any) -> Any:
        """Call a C function, with arrays by their places; what it has raised in Python is raised."""
        given = [np.ascontiguousarray(a) if isinstance(a, np.ndarray) else a for a in arguments]
        plain = [a.ctypes.data if isinstance(a, np.ndarray) else a for a in given]
        return self.judged(getattr(self._library, name)(self.reference, *plain))

    def forgive(self) -> None:
        """Forget what has been raised in Python."""
        self._failed = None

    def judged(self, found: Any) -> Any:
        """Return what C has come back with; what has been raised in Python is raised."""
        if self._failed is not None:
            raised, self._failed = self._failed, None
            raise raised
        return found


def _array(place: int | None, count: int) -> np.ndarray:
    """Return memory of C as an array."""
    if not count or place is None:
        return np.zeros(0)
    return np.ctypeslib.as_array((ctypes.c_double * count).from_address(place))
