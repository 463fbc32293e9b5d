"""The judge of the choice of coordinates in C (``engine/c/coordinate_watch.c``): its memory, and who is asked."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np

from lmoc.engine.answers import Answers, doubles
from lmoc.engine.kernel import Kernel, StepHook
from lmoc.engine.library import address, library
from lmoc.ir.reduced import Constraints
from lmoc.numerics.coordinates.entries import at_hand, constraints_tape, reads_of_entries
from lmoc.numerics.coordinates.limits import LIMITS, Limits, limits_in_c
from lmoc.numerics.plan.plan import Plan
from lmoc.numerics.problem.system import InC
from lmoc.support.records import dataclass

VALUES, REGULAR, VANISHES = 0, 1, 2  # what is asked
SERVE = 0  # what a judgement comes to where the coordinates go on being good
_PLACES, _HEAD, _NO_MEMORY = 6, 4, 3
_ASK = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.c_void_p, ctypes.c_int, ctypes.c_double, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64
)
Asked = Callable[[int, float, np.ndarray, int, int], float]
Step = tuple[float, np.ndarray, np.ndarray]  # its end: time, states, solutions of blocks


class _Coordinates(ctypes.Structure):
    """``lmoc_coordinates``."""

    _fields_ = [
        ("by", ctypes.c_double * len(vars(LIMITS))),
        *[(n, ctypes.c_int64) for n in ("rows", "columns", "watched", "count", "told", "solved", "n")],
        *[(n, ctypes.c_int64) for n in ("blocks", "ranked")],
        *[(n, ctypes.c_void_p) for n in ("row", "units", "barred", "owner", "ask")],
        *[(n, ctypes.c_double) for n in ("limit", "alert", "singular", "answer", "recent_least")],
        *[(n, ctypes.c_int64) for n in ("accepted", "last", "lost_rank", "inside", "equilibrated", "halted", "paced")],
        *[(n, ctypes.c_void_p) for n in ("places", "size", "bound", "row_factor", "column_factor", "range", "recent")],
        *[(n, ctypes.c_void_p) for n in ("apart", "pace", "work", "place")],
    ]


class _StepWatch(ctypes.Structure):
    """``lmoc_step_watch``."""

    _fields_ = [
        *[(n, ctypes.c_void_p) for n in ("by", "call", "evaluate", "mark", "registers", "w", "tape")],
        *[(n, ctypes.c_int64) for n in ("read_count", "entry_count")],
        *[(n, ctypes.c_void_p) for n in ("reads", "entry", "target", "told", "solved", "record")],
        *[(n, ctypes.c_int64) for n in ("kept", "room")],
    ]


@dataclass(frozen=True, eq=False)
class Place:
    """Where a mechanism has come to, as its coordinates are judged there; views of the judge's memory.

    Attributes
    ----------
    head : time, sign of the determinant of A, what the smallest singular value is not below, that value once known
    matrix : (rows, columns) of the constraints; its entries alone (n,) where they are seen block by block
    table : (watched, states) the tableau A⁻¹B of the watched dependent coordinates
    coordinates : their values, by the columns of the constraints; none where the system does not tell
    solutions, x : of the nonlinear blocks, in the order of `CoordinateWatch.unknowns`; the states
    """

    head: np.ndarray
    matrix: np.ndarray
    table: np.ndarray
    coordinates: np.ndarray
    solutions: np.ndarray
    x: np.ndarray

    @property
    def t(self) -> float:
        """s"""
        return float(self.head[0])

    @property
    def sign(self) -> float:
        """Of the determinant of A; one number for each combination of signs where it is seen in blocks."""
        return float(self.head[1])

    def step(self) -> Step:
        """Return what is kept of it."""
        return self.t, self.x.copy(), self.solutions.copy()


class Judge:
    """Judges places of one system.

    Attributes
    ----------
    data : ``lmoc_coordinates``
    places : the ends of the last two steps, and places in between
    size, row_factor, column_factor, ranges : largest magnitude of each entry so far; factors with which rows and
        columns of these sizes have one length; largest share of each coordinate in an equation
    units : (columns,) of coordinates
    watched, barred : (watched,) dependent coordinates that change along the motion; 1 for those that cannot be states
    """

    def __init__(
        self,
        own: Constraints,
        units: np.ndarray,
        sizes: tuple[int, int, int],
        asked: Asked,
        limits: Limits,
        entries: int | None,
    ) -> None:
        """
        Parameters
        ----------
        units : (columns,) of coordinates (`limits.coordinate_units`)
        sizes : numbers of unknowns of blocks, of coordinates whose values are told, of states
        asked : tells what only the owner knows, as a number where one is asked for
        entries : of a matrix that is seen block by block; None where it is seen as a whole
        """
        rows, columns, watched, (unknowns, told, n) = own.rows, len(own.variable), len(own.watched), sizes
        self._library, self._answers = library(), Answers(_NO_MEMORY)
        self.watched = np.ascontiguousarray(own.watched, np.int32)
        self.barred, self.units = np.zeros(max(1, watched), np.uint8), units
        tables = self.watched, units, self.barred
        count = rows * columns if entries is None else entries
        shape = rows, columns, watched, count, told, unknowns, n, entries is not None, True
        self.data = _Coordinates(limits_in_c(limits), *shape, *[a.ctypes.data for a in tables])
        self._own = ctypes.addressof(self.data)
        self.data.alert, self.data.ask = LIMITS.alert, ctypes.cast(self._asking(asked, n), ctypes.c_void_p).value
        memory = self._memory = np.zeros(self._library.lmoc_coordinates_lay_out(self._own, None))
        self._library.lmoc_coordinates_lay_out(self._own, memory.ctypes.data)
        whole = (rows, columns) if entries is None else (count,)
        shapes = (_HEAD,), whole, (watched, columns - rows), (told,), (unknowns,), (n,)
        self.places = []
        for _ in range(_PLACES):
            parts = []
            for part in shapes:
                parts.append(memory[: int(np.prod(part))].reshape(part))
                memory = memory[parts[-1].size :]
            self.places.append(Place(*parts))
        lengths = np.cumsum([0, count, count, rows, columns, columns])
        self.size, _, self.row_factor, self.column_factor, self.ranges = (
            memory[a:b] for a, b in zip(lengths, lengths[1:], strict=False)
        )

    def _asking(self, asked: Asked, n: int) -> ctypes._FuncPointer:
        def ask(_: int, what: int, time: float, x: int, k: int, other: int) -> int:
            def work() -> None:
                self.data.answer = asked(what, time, doubles(x, n) if x else np.zeros(0), k, other)

            return self._answers.answer(work)

        self._ask = _ASK(ask)  # C does not keep it alive
        return self._ask

    @property
    def accepted(self) -> Place:
        """Return the last place judged well; the next step begins there."""
        return self.places[self.data.accepted]

    @property
    def last(self) -> Place:
        """Return the last place judged."""
        return self.places[self.data.last]

    def begin(self, t: float, x: np.ndarray) -> bool:
        """Judge where a motion begins; return whether the coordinates serve."""
        own = np.ascontiguousarray(x, float)
        return self._judged(self._library.lmoc_coordinates_begin(self._own, t, own.ctypes.data))

    def __call__(self, t: float, x: np.ndarray) -> bool:
        """Judge a step, and accept it where the coordinates serve; return whether they do."""
        own = np.ascontiguousarray(x, float)
        return self._judged(self._library.lmoc_coordinates_judge(self._own, t, own.ctypes.data))

    def _judged(self, status: int) -> bool:
        self.data.halted = 0
        return self._answers.judge(status) == SERVE

    def margin(self, place: Place) -> float:
        """Return the smallest singular value of the constraints at a place, rows and columns being of one length."""
        return float(self._library.lmoc_coordinates_margin(self._own, self.places.index(place)))

    def vanishes(self, place: Place) -> bool:
        """Return whether the rest does not follow from the states at a place, in rows of one size."""
        found = self._library.lmoc_coordinates_vanish(self._own, self.places.index(place))
        self.data.halted = 0
        return bool(self._answers.judge(found))

    def passed(self) -> bool:
        """Return whether the last step has led over a place where the coordinates do not determine the rest."""
        return bool(self._library.lmoc_coordinates_passed(self._own))

    def tolerate(self) -> None:
        """Take the last step's coordinates for as good as they can be."""
        self._library.lmoc_coordinates_tolerate(self._own)

    def shorter(self, stalled: int, span: float) -> tuple[float, float]:
        """Return the longest step with which to go on where no others are better, 0 where that is none; and until when.

        Parameters
        ----------
        stalled : how often it has gone on from there
        span : s, of the run
        """
        until = ctypes.c_double()
        length = self._library.lmoc_coordinates_shorter(self._own, stalled, span, ctypes.byref(until))
        return length, until.value

    def stuck(self, below: float) -> bool:
        """Look back at the place accepted last; return whether its smallest singular value is below so much."""
        return bool(self._library.lmoc_coordinates_stuck(self._own, below))

    def lost(self) -> int:
        """Return which of the watched coordinates follows least from the states at the last place."""
        return int(self._library.lmoc_coordinates_lost(self._own))

    def better(self) -> list[list[int]]:
        """Return the columns that are the states in better choices, best first."""
        states = self.data.columns - self.data.rows
        held = np.empty(self.data.columns + 2 * states, np.int32)
        found = self._library.lmoc_coordinates_better(self._own, held.ctypes.data)
        return held[: found * states].reshape(found, states).tolist()

    def grown(self, size: np.ndarray) -> None:
        """Compare entries with these sizes from now on, in rows and columns that are equilibrated anew."""
        self.size[:], self.data.equilibrated = size, 0


class StepWatch:
    """What fills the places of a judge, and judges steps that are certainly good, without Python in between."""

    def __init__(self, plan: Plan, judge: Judge, reads: np.ndarray, told: np.ndarray, solved: np.ndarray) -> None:
        own: Constraints = plan.reduced.constraints
        self._judge, self._width = judge, 1 + judge.data.n + len(solved)
        self._kernel = Kernel(plan.once(constraints_tape))
        lists = reads, own.register, own.place, told, solved
        tables = self._tables = [np.ascontiguousarray(t, np.int32) for t in lists]
        places = [t.ctypes.data for t in tables]
        w, tape = self._kernel.addresses
        self._data = _StepWatch(ctypes.addressof(judge.data), w=w, tape=tape)
        data = self._data
        data.read_count, data.entry_count = len(reads), len(own.register)
        data.reads, data.entry, data.target, data.told, data.solved = places
        reference = ctypes.addressof(data)
        judge.data.owner, judge.data.ask = reference, address("lmoc_step_watch_values")
        functions = address("lmoc_step_watch_look"), None, address("lmoc_step_watch_keep")
        self._hook = StepHook(reference, *functions, 1)

    def stand_by(self, system: InC) -> None:
        """Have places filled by what evaluates the system now."""
        data = self._data
        data.call, data.evaluate, data.mark, data.registers = system

    def enter(self, most: int) -> int:
        """Return what judges up to `most` steps from the place accepted last, of which it makes a record."""
        self._record = np.empty((most, self._width))
        self._data.record, self._data.kept, self._data.room = self._record.ctypes.data, 0, most
        return ctypes.addressof(self._hook)

    def left(self) -> list[Step]:
        """Return the ends of the steps judged."""
        own, n = self._record[: self._data.kept], self._judge.data.n
        return list(zip(own[:, 0].tolist(), own[:, 1 : 1 + n], own[:, 1 + n :], strict=True))


def reads_in_c(plan: Plan, told: np.ndarray) -> np.ndarray | None:
    """Return the registers from which the entries follow; None where these, or some coordinates, do not stand there.

    Parameters
    ----------
    told : registers of coordinates
    """
    reads = reads_of_entries(plan)
    if reads is None or not np.isin(np.concatenate([reads, told]), plan.once(at_hand)).all():
        return None
    return reads

