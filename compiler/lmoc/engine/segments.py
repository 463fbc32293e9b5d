"""Segments that laws end, one after the other as C goes through them (``c/segments.h``): memory, and what has been."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lmoc.engine.kernel import Call, Kernel
from lmoc.engine.library import library
from lmoc.engine.step_functions import Watched

ROOM = 100  # segments at a time; then somebody looks at the clock
_PLACE, _COUNT, _REAL = ctypes.c_void_p, ctypes.c_int64, ctypes.c_double


class _Given(ctypes.Structure):
    """``lmoc_given``."""

    _fields_ = [("w", _PLACE), ("tape", _PLACE), ("blocks", _COUNT), ("call", _PLACE)]


class _Segments(ctypes.Structure):
    """``lmoc_segments``."""

    _fields_ = [
        *[(name, _PLACE) for name in ("taylor", "walk", "rates", "watched", "laws", "memory")],
        ("size", _COUNT),
        *[(name, _PLACE) for name in ("errors", "unresolved", "open")],
        *[(name, _COUNT) for name in ("registers", "shown")],
        *[(name, _PLACE) for name in ("numbers", "places", "held")],
        ("programs", _COUNT),
        ("program", _PLACE),
        *[(name, _REAL) for name in ("begin", "end", "last", "time")],
        *[(name, _PLACE) for name in ("x", "times")],
        *[(name, _COUNT) for name in ("outputs", "first", "reached")],
        ("out", _PLACE),
        ("most", _COUNT),
        ("work", _PLACE),
        ("room", _COUNT),
        *[(name, _PLACE) for name in ("base", "largest", "states", "ended", "kept", "until")],
        *[(name, _COUNT) for name in ("steps", "tries", "evaluations")],
    ]


class Laws(NamedTuple):
    """The laws of a run: where they are, their memory, and what the method allows itself, (states,) each."""

    address: int
    size: int
    memory: np.ndarray
    errors: np.ndarray
    unresolved: np.ndarray


class ModeRegisters(NamedTuple):
    """Which numbers of a mode stand in registers, in which, and those of velocities that it holds, (states,)."""

    numbers: np.ndarray
    places: np.ndarray
    held: np.ndarray


class Method(NamedTuple):
    """Steps along series: addresses of the ``lmoc_taylor`` and of its walk; the rates of the same states."""

    taylor: int
    walk: int
    rates: Call


class Past(NamedTuple):
    """Segments that have been.

    Attributes
    ----------
    passed : how many
    base : (passed, registers) that stayed as they were
    largest, states : (passed, n) magnitudes of the states, and the states behind its end
    ended : (passed,) s
    until : (passed,) output times up to its end
    kept : (passed + 1, …) the memory of the laws at the beginning of each, with the law of the impact before in the end
    steps, rejected, evaluations : of all of them
    """

    passed: int
    base: np.ndarray
    largest: np.ndarray
    states: np.ndarray
    ended: np.ndarray
    until: NDArray[np.int64]
    kept: np.ndarray
    steps: int
    rejected: int
    evaluations: int


class LawSegments:
    """Goes through segments.

    Parameters
    ----------
    given : the programs that read the registers, each with its call, if it remembers a solution
    """

    def __init__(
        self,
        method: Method,
        watched: Watched,
        laws: Laws,
        mode: ModeRegisters,
        given: Sequence[tuple[Kernel, Call | None]],
        registers: int,
    ) -> None:
        n, size = method.rates.n, len(laws.memory)
        own = [
            _Given(*kernel.addresses, len(kernel.tape.blocks), None if call is None else ctypes.addressof(call))
            for kernel, call in given
        ]
        programs = (_Given * len(own))(*own)
        tables = [np.ascontiguousarray(t, np.int64) for t in mode]
        self._x, self._work = np.zeros(n), np.zeros(7 * n + 2 * watched.data.chosen + 9 * laws.size)
        self._registers, self._n, self._size = registers, n, size
        self._data = _Segments(
            method.taylor, method.walk, ctypes.addressof(method.rates), ctypes.addressof(watched.data), laws.address,
            laws.memory.ctypes.data, size, laws.errors.ctypes.data, laws.unresolved.ctypes.data, None, registers,
            len(tables[0]), *(t.ctypes.data for t in tables), len(own), ctypes.addressof(programs),
            x=self._x.ctypes.data, work=self._work.ctypes.data, room=ROOM,
        )  # fmt: skip
        self._kept = method, watched, laws, given, programs, tables
        self._reference, self._go = ctypes.byref(self._data), library().lmoc_segments_go

    def go(
        self,
        place: tuple[float, np.ndarray],
        span: tuple[float, float],
        last: float,
        base: np.ndarray,
        output: tuple[np.ndarray, np.ndarray, int, int],
        most: int,
    ) -> Past:
        """Go on from a place as far as all is as usual.

        Parameters
        ----------
        place : time and states
        span, last : s, of the run, and when something has happened last
        base : registers that stay as they are, with all laws open
        output : output times, room for the states at them, the first one of the segment, and how many are reached
        most : steps of a segment
        """
        data, n = self._data, self._n
        data.time, self._x[:] = place
        (data.begin, data.end), data.last, data.most = span, last, most
        base = np.ascontiguousarray(base)
        times, out, data.first, data.reached = output
        data.open, data.times, data.outputs, data.out = base.ctypes.data, times.ctypes.data, len(times), out.ctypes.data
        rows = [np.empty((ROOM, k)) for k in (self._registers, n, n)]
        ended, kept, until = np.empty(ROOM), np.empty((ROOM + 1, self._size + 2)), np.empty(ROOM, np.int64)
        data.base, data.largest, data.states = (r.ctypes.data for r in rows)
        data.ended, data.kept, data.until = ended.ctypes.data, kept.ctypes.data, until.ctypes.data
        data.steps = data.tries = data.evaluations = 0
        count = self._go(self._reference)
        counts = data.steps, data.tries - data.steps, data.evaluations
        given, largest, states = (r[:count] for r in rows)
        return Past(count, given, largest, states, ended[:count], until[:count], kept[: count + 1], *counts)
