"""Segments that laws or events end, one after the other as C goes through them (``c/segments.h``)."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lmoc.engine.event_walk import EventWalk
from lmoc.engine.kernel import Call, Kernel
from lmoc.engine.library import library
from lmoc.engine.step_functions import Watched

ROOM = 100  # segments at a time; then somebody looks at the clock
_PLACE, _COUNT, _REAL = ctypes.c_void_p, ctypes.c_int64, ctypes.c_double


class _Given(ctypes.Structure):
    """``lmoc_given``."""

    _fields_ = [("w", _PLACE), ("tape", _PLACE), ("blocks", _COUNT), ("call", _PLACE)]


class _Kept(ctypes.Structure):
    """``lmoc_kept``."""

    _fields_ = [("at", _PLACE), ("count", _COUNT)]


class _Segments(ctypes.Structure):
    """``lmoc_segments``."""

    _fields_ = [
        *[(name, _PLACE) for name in ("taylor", "walk", "rates", "watched", "laws", "memory")],
        ("size", _COUNT),
        *[(name, _PLACE) for name in ("errors", "unresolved", "book", "discrete")],
        ("pieces", _COUNT),
        ("piece", _PLACE),
        ("shortly", _REAL),
        ("open", _PLACE),
        *[(name, _COUNT) for name in ("registers", "shown")],
        *[(name, _PLACE) for name in ("numbers", "places", "held")],
        ("programs", _COUNT),
        ("program", _PLACE),
        *[(name, _REAL) for name in ("begin", "end", "last", "time")],
        *[(name, _PLACE) for name in ("x", "times")],
        *[(name, _COUNT) for name in ("outputs", "first", "reached")],
        ("out", _PLACE),
        *[(name, _COUNT) for name in ("most", "functions")],
        ("work", _PLACE),
        ("room", _COUNT),
        *[(name, _PLACE) for name in ("base", "largest", "states", "ended", "kept", "until", "booked")],
        *[(name, _COUNT) for name in ("steps", "tries", "evaluations")],
    ]


class Laws(NamedTuple):
    """The laws of a run: where they are, their memory, and what the method allows itself, (states,) each."""

    address: int
    size: int
    memory: np.ndarray
    errors: np.ndarray
    unresolved: np.ndarray


class Events(NamedTuple):
    """The events of a run.

    Attributes
    ----------
    walk : of them
    registers : (discrete,) of their discrete values
    memory : what they know: addresses, and how many numbers
    functions : whose change of sign is an event, at the most
    shortly : s, within which one that crosses zero again may not have left it
    """

    walk: EventWalk
    registers: np.ndarray
    memory: Sequence[tuple[int, int]]
    functions: int
    shortly: float


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
    until, booked : (passed,) output times, and numbers of the book of events, up to its end
    kept : (passed + 1, …) the memory of the laws at the beginning of each, with the law of the impact before in the end
    steps, rejected, evaluations : of all of them
    """

    passed: int
    base: np.ndarray
    largest: np.ndarray
    states: np.ndarray
    ended: np.ndarray
    until: NDArray[np.int64]
    booked: NDArray[np.int64]
    kept: np.ndarray
    steps: int
    rejected: int
    evaluations: int


class Segments:
    """Goes through segments.

    Parameters
    ----------
    watched : what ends them, beside time; None for nothing
    laws, mode : of the run, if it has some
    events : of the run, if it has some
    given : the programs that read the registers, each with its call, if it remembers a solution
    registers : that stay as they are
    """

    def __init__(
        self,
        method: Method,
        watched: Watched | None,
        laws: tuple[Laws, ModeRegisters] | None,
        events: Events | None,
        given: Sequence[tuple[Kernel, Call | None]],
        registers: int,
    ) -> None:
        n, own, pieces, functions, chosen = method.rates.n, _Segments(), [], 0, 0
        programs = (_Given * len(given))(
            *(_Given(*k.addresses, len(k.tape.blocks), None if c is None else ctypes.addressof(c)) for k, c in given)
        )
        own.taylor, own.walk, own.rates = method.taylor, method.walk, ctypes.addressof(method.rates)
        self._kept: list[object] = [method, watched, laws, events, given, programs]
        if watched is not None:
            own.watched, chosen = ctypes.addressof(watched.data), watched.data.chosen
        if laws is not None:
            of, mode = laws
            tables = [np.ascontiguousarray(t, np.int64) for t in mode]
            own.laws, own.memory, own.size, functions = of.address, of.memory.ctypes.data, len(of.memory), 2 * of.size
            own.errors, own.unresolved, own.shown = of.errors.ctypes.data, of.unresolved.ctypes.data, len(tables[0])
            own.numbers, own.places, own.held = (t.ctypes.data for t in tables)
            self._kept.append(tables)
        if events is not None:
            pieces, functions, own.shortly = [*events.memory, *events.walk.in_c], events.functions, events.shortly
            places = (_Kept * len(pieces))(*(_Kept(*one) for one in pieces))
            table = np.ascontiguousarray(events.registers, np.int32)
            own.book, own.discrete = ctypes.addressof(events.walk.book.data), table.ctypes.data
            own.pieces, own.piece = len(pieces), ctypes.addressof(places)
            self._kept += [places, table]
        self._x = np.zeros(n)
        self._work = np.zeros(7 * n + 6 * functions + 2 * chosen + sum(count for _, count in pieces))
        own.functions, own.work, own.room, own.x = functions, self._work.ctypes.data, ROOM, self._x.ctypes.data
        own.programs, own.program, own.registers = len(programs), ctypes.addressof(programs), registers
        self._registers, self._n, self._size, self._data = registers, n, own.size, own
        self._reference, self._go = ctypes.byref(self._data), library().lmoc_segments_go

    @property
    def is_watched(self) -> bool:
        """Whether segments end by roots, too."""
        return bool(self._data.watched)

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
        base : registers that stay as they are, with all laws open and whatever discrete values
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
        ended, kept, until = np.empty(ROOM), np.empty((ROOM + 1, self._size + 2)), np.empty((2, ROOM), np.int64)
        data.base, data.largest, data.states = (r.ctypes.data for r in rows)
        data.ended, data.kept, data.until = ended.ctypes.data, kept.ctypes.data, until.ctypes.data
        data.booked = until[1].ctypes.data
        data.steps = data.tries = data.evaluations = 0
        count = self._go(self._reference)
        counts = data.steps, data.tries - data.steps, data.evaluations
        given, largest, states = (r[:count] for r in rows)
        ends = until[0, :count], until[1, :count]
        return Past(count, given, largest, states, ended[:count], *ends, kept[: count + 1], *counts)
