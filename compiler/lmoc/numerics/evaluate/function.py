"""Places of a tape as a function of time and states, with the inputs and parameters of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lmoc.engine.instant import Instant
from lmoc.engine.kernel import Kernel
from lmoc.engine.library import library
from lmoc.engine.step_functions import Watched
from lmoc.engine.tables import Tables
from lmoc.lower.tape import Tape
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.system import Programs
from lmoc.numerics.signals.signals import Signal, sample
from lmoc.numerics.signals.tables import Table


def tables_of(registers: np.ndarray, signals: Sequence[tuple[Signal, int]]) -> Tables | None:
    """Return what C fills registers with, if all of them follow tables; None where Python has to be asked.

    Parameters
    ----------
    signals : of each register, and the order of the derivative
    """
    if not len(registers) or not all(isinstance(signal, Table) for signal, _ in signals):
        return None
    return Tables((int(r), order, s.curve.pieces(order)) for r, (s, order) in zip(registers, signals, strict=True))


_FEW = 32  # times whose memory is kept from call to call


class TapeFunction:
    """A tape that is called with states.

    Parameters
    ----------
    tape : of registers of a plan, and perhaps of more
    places : where the results stand
    constant : inputs that stay as they are between events
    """

    def __init__(self, tape: Tape, plan: Plan, places: np.ndarray, constant: np.ndarray | None = None) -> None:
        self._kernel, self._plan = Kernel(tape), plan
        varying = np.ones(len(plan.sampled), bool) if constant is None else ~np.isin(plan.sampled, constant)
        self._sampled = plan.sampled[varying]
        self._signals = [plan.samplers[k] for k in np.flatnonzero(varying)]
        self._places = np.ascontiguousarray(places, np.int32)
        self._call = self._kernel.call(plan.states, plan.states, self._sampled)
        self._tables: Tables | None = None  # of the inputs, where all of them follow tables
        self._many = library().lmoc_evaluate_many
        self._few: _Room | None = None
        self._samplers: list[tuple[Signal, int]] = []
        self._watched: Watched | None = None

    def prepare(self, base: np.ndarray, signals: Mapping[int, Signal]) -> None:
        """Take the registers that do not change between events, and the inputs."""
        self._kernel.w[: len(base)] = base
        self._kernel.forget()
        samplers = [(signals[v], order) for v, order in self._signals]
        if samplers != self._samplers:
            self._samplers, self._tables = samplers, tables_of(self._sampled, samplers)
            self._call.tables = None if self._tables is None else self._tables.address

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the results."""
        w = self._kernel.w
        w[self._plan.states] = x
        self.sample(t)
        self._kernel(t)
        return w[self._places]

    def sample(self, t: float) -> None:
        """Take the inputs at a time."""
        for register, (signal, order) in zip(self._sampled.tolist(), self._samplers, strict=True):
            self._kernel.w[register] = signal.value(t, order)

    @property
    def kernel(self) -> Kernel:
        """The tape with its registers."""
        return self._kernel

    def programs(self) -> Programs:
        """Return what is given the registers that do not change between events, as of a system."""
        return ((self._kernel, self._call),)

    def many(self, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Return the results at several times, (times, size)."""
        count, n = len(times), len(self._plan.states)
        room = self._room(count)
        room.times[:count], room.given[:count, :n] = times, states
        for k, (signal, order) in enumerate(self._samplers if self._tables is None else (), n):
            room.given[:count, k] = sample(signal, order, times)
        self._many(self._call.reference, count, *room.addresses)
        return room.out[:count].copy() if room is self._few else room.out

    def watched(self, count: int, laws: int | None = None, events: Instant | None = None) -> Watched | None:
        """Return root functions that C makes of the results; None where Python gives inputs. As of `Watched`."""
        if self._samplers and self._tables is None:
            return None
        if self._watched is None or self._watched.of != (laws, events):
            self._watched = Watched(self._call, self._places, laws, events)
        self._watched.count = count
        return self._watched

    def _room(self, count: int) -> _Room:
        """Return memory for so many times at least."""
        if count <= _FEW and self._few is not None:
            return self._few
        width = len(self._plan.states) + len(self._sampled)
        if count > _FEW:
            return _Room(count, width, self._places)
        self._few = _Room(_FEW, width, self._places)
        return self._few


def watched(
    evaluate: object, count: int, laws: int | None = None, events: Instant | None = None
) -> tuple[Watched, ...] | None:
    """Return `TapeFunction.watched` of what `TapeFunction.many` is; None for other functions."""
    own = getattr(evaluate, "__self__", None)
    found = own.watched(count, laws, events) if isinstance(own, TapeFunction) else None
    return None if found is None else (found,)


def programs(evaluate: object) -> Programs:
    """Return `TapeFunction.programs` of what `TapeFunction.many` is; nothing for other functions."""
    own = getattr(evaluate, "__self__", None)
    return own.programs() if isinstance(own, TapeFunction) else ()


class _Room:
    """Memory for the arguments and results of a call at several times, with the addresses that C is given."""

    def __init__(self, count: int, width: int, places: np.ndarray) -> None:
        self.times, self.given, self.out = np.empty(count), np.empty((count, width)), np.empty((count, len(places)))
        self._rest = np.zeros(0), np.empty(count, np.uint8), places
        guesses, good = (a.ctypes.data for a in self._rest[:2])
        own = self.times.ctypes.data, self.given.ctypes.data
        self.addresses = *own, guesses, len(places), places.ctypes.data, self.out.ctypes.data, good
