"""A scene with laws as derivations see it: one reduction for each mode, and the free one with the forces as inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.ir.law import COMPLEMENTARY, JENKINS, LawKind, Switched, law_count
from lmoc.ir.mode import law_names, mode_words, with_mode
from lmoc.ir.prepared import Prepared
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import ModelError
from lmoc.structure.laws.switched import free
from lmoc.support.records import dataclass

Reduce = Callable[[FlatDAE, np.ndarray, Sequence[str] | None], Reduced]
Met = dict[tuple[int, bytes, bytes, bytes], tuple[FlatDAE, Prepared]]  # by the scene that is kept beside, and its mode
_KEPT = 16  # modes: an equilibrium is found in one of them, and linearized in the same


@dataclass(frozen=True, eq=False)
class Lawful:
    """A scene with laws, its discrete variables held.

    Attributes
    ----------
    prepared : with the reduction of the switched form, whose states are those of runs
    reduce : from a flat model, parameter values and requested states (None for the scene's) to its reduction
    release : from a reduction to that with all coordinates of its closed loops as states
    reduce_at : as `reduce`, in coordinates that serve at a place {name: value}
    met : where the modes that have been reduced are kept
    """

    prepared: Prepared
    reduce: Reduce
    release: Callable[[Reduced], Reduced]
    reduce_at: Callable[[FlatDAE, np.ndarray, Mapping[str, float]], Reduced]
    met: Met | None = None

    @property
    def flat(self) -> FlatDAE:
        return self.prepared.flat

    @property
    def count(self) -> int:
        """Number of laws."""
        return law_count(self.flat.laws)

    @cached_property
    def names(self) -> list[str]:
        """Names of the laws."""
        return law_names(self.flat, self.flat.laws)

    @cached_property
    def force(self) -> np.ndarray:
        """(laws,) variables of the forces."""
        return np.concatenate([g.force for g in self.flat.laws])

    @cached_property
    def force_names(self) -> list[str]:
        """Names of the forces; one that is an expression is called after its law."""
        own = [self.flat.variable_name(int(v)) for v in self.force]
        return [o if self.flat.find(o) is not None else f"force of {n}" for o, n in zip(own, self.names, strict=True)]

    @cached_property
    def kinds(self) -> list[LawKind]:
        """The kind of each law."""
        return [g.kind for g in self.flat.laws for _ in range(g.rows)]

    @cached_property
    def complementary(self) -> np.ndarray:
        """(laws,) whether a law is a complementarity; the others are frictions."""
        return np.array([kind in COMPLEMENTARY for kind in self.kinds], bool)

    @cached_property
    def jenkins(self) -> np.ndarray:
        """(laws,) whether a law acts between springs alone."""
        form = self.prepared.reduced.switched
        return np.zeros(self.count, bool) if form is None else form.degree == JENKINS

    def words(self, closed: np.ndarray) -> dict[str, str]:
        """Return {law name: what its mode is called}."""
        return mode_words(self.flat, self.flat.laws, closed)

    def in_mode(self, closed: np.ndarray, direction: np.ndarray | None = None) -> Prepared:
        """Return the scene in a mode: which laws are closed, and how open friction slips (`ir.mode.with_mode`).

        Raises
        ------
        ModelError
            The closed laws contradict each other.
        """
        direction = np.zeros(self.count, int) if direction is None else direction
        values, met = self.prepared.values, {} if self.met is None else self.met
        key = id(self.flat), values.tobytes(), np.asarray(closed, bool).tobytes(), np.asarray(direction, int).tobytes()
        found = met.get(key)
        if found is None:
            flat = with_mode(self.flat, closed, direction)
            found = self.flat, Prepared(flat, self.reduce(flat, values, None), values)
            for oldest in list(met)[: 1 - _KEPT]:
                met.pop(oldest, None)  # another thread may have been faster
            met[key] = found
        return found[1]

    def loose(self) -> tuple[Prepared, Switched]:
        """Return the scene with all laws open and their forces as inputs, and where these are.

        Its states are those of the mode in which all laws are open, where these can be: places of bodies, no gaps.
        """
        flat, form = free(self.flat)
        values = flat.extended(self.prepared.values)
        states = self.in_mode(np.zeros(self.count, bool)).reduced.state_names
        try:
            reduced = self.reduce(flat, values, states)
        except ModelError:  # they can only be with the laws' forces left out
            reduced = self.reduce(flat, values, None)
        return Prepared(flat, reduced, values), form
