"""Everything that is made of one flat model: its reductions and the simulators of these, each made once and kept.

Kept by structure (values that shape the flat model), by guards (parameter values for which a reduction holds) and by
coordinates. Modes of laws are values of one reduction (`lmoc.numerics.laws`) and need no reduction of their own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from lmoc import pipeline
from lmoc.ir.flat import Block, FlatDAE, Kind
from lmoc.ir.prepared import Prepared
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Diagnostic, ModelError, Report, Subject
from lmoc.parameters import Value, indexed, starting_at
from lmoc.pipeline import Clock, Scene
from lmoc.semantics.parameter_checks import check_parameters
from lmoc.structure.coordinates.shared import Shared

if TYPE_CHECKING:
    from lmoc.numerics.events.occasion import Occasion
    from lmoc.numerics.observe.trajectory import Trajectory
    from lmoc.numerics.options.formulations import Requested
    from lmoc.numerics.options.options import RunOptions
    from lmoc.numerics.plan.plan import Plan
    from lmoc.numerics.problem.system import System
    from lmoc.numerics.run.simulate import Simulator
    from lmoc.numerics.signals.signals import Signal
    from lmoc.numerics.task.task import Progress
    from lmoc.symbolic.equations import EquationsOfMotion
    from lmoc.symbolic.equilibria import Equilibria
    from lmoc.symbolic.laws.modes import Lawful, Met
    from lmoc.symbolic.released import Released

_KNOWN_AGAIN = 10_000  # variables up to which the values checked last are kept
_MODEL = ()  # the key of the coordinates that the model and the user prefer


def refuse_remembered(prepared: Prepared, why: str) -> None:
    """Refuse to derive from equations that are held as at the start (E0660), where that would be wrong."""
    if prepared.remembered:
        from lmoc.symbolic.jumps import refuse_remembered

        raise refuse_remembered([prepared.flat.variable_name(v) for v in prepared.remembered], why)


class Session:
    """One flat model at work.

    Attributes
    ----------
    scene : Scene
        What the user gave.
    flat : FlatDAE
    values : (flat.count,) the model's own parameter values
    reduced : Reduced
        The reduction for these.
    """

    def __init__(self, scene: Scene, flat: FlatDAE, clock: Clock, reduced: Reduced | None = None) -> None:
        self.scene, self.flat = scene, flat
        self.values = flat.parameter_values(indexed(flat, flat.overrides))
        self._shared = Shared()
        self.reduced: Reduced = reduced or pipeline.reduce(flat, self.values, scene.states, clock, self._shared)
        self._reductions: dict[tuple, list[Reduced | None]] = {_MODEL: [self.reduced]}  # by coordinates
        self._formulated: dict[tuple[int, float], tuple[Reduced, Reduced]] = {}  # by identity of the first, and gain
        self._starts: dict[tuple, Reduced] = {}  # for starts at which the preferred coordinates do not serve
        self._redundant: dict[bytes, list[Reduced]] = {}  # by parameter values: each leaves out other constraints
        self._simulators: dict[int, Simulator] = {}  # by identity of the reduction
        self._met: Met = {}  # modes of the laws, by the scene and the mode
        self._busy = Lock()  # a simulator has one set of buffers
        self._reshaped: dict[tuple, Session] = {}  # one for each set of structural values met so far
        self._sound = b""  # parameter values with which nothing was wrong

    # ------------------------------------------------------------------ parameter values

    def prepare(
        self, parameters: Mapping[str, Value] | None = None, clock: Clock | None = None
    ) -> tuple[Session, Prepared]:
        """Return the session and what is ready in it for other parameter values, with notes of what was redone.

        A structural parameter means flattening again, a broken guard reducing again.
        """
        if not parameters:
            return self, Prepared(self.flat, self.reduced, self.values)
        clock = clock or Clock()
        resized = {name for name, value in parameters.items() if self._resizes(name, value)}
        overrides = indexed(self.flat, {n: v for n, v in parameters.items() if n not in resized})
        structural = {n: v for n, v in parameters.items() if n in resized or self._reshapes(n, v)}
        if not structural and not self._decided(parameters, overrides):
            structural = {n: v for n, v in parameters.items() if self._reshapes(n, v, conditional=True)}
        if structural:
            rest = {n: v for n, v in parameters.items() if n not in structural}
            shape = "shapes" if len(structural) == 1 else "shape"
            message = f"{', '.join(structural)} {shape} the model: it has been flattened again"
            note = Diagnostic("N0630", message, subject=Subject.RESHAPED)
            session, prepared = self._reshape(structural, clock).prepare(rest, clock)
            return session, replace(prepared, notes=(note, *prepared.notes))
        values = self.flat.parameter_values({**indexed(self.flat, self.flat.overrides), **overrides})
        broken = self.reduced.broken_guard(values)
        if broken is None:
            return self, Prepared(self.flat, self.reduced, values)
        note = Diagnostic("N0631", f"the reduction was redone because an assumption no longer holds: {broken}")
        return self, Prepared(self.flat, self._reduction(values, _MODEL, clock), values, (note,))

    def check(self, values: np.ndarray, report: Report) -> None:
        """Report what is wrong with parameter values (`check_parameters`); the last sound ones are known again."""
        key = values.tobytes() if len(values) <= _KNOWN_AGAIN else b""
        if key and key == self._sound:
            return
        before = len(report.diagnostics)
        check_parameters(self.flat, values, report)
        if len(report.diagnostics) == before:
            self._sound = key

    def for_derivation(self, parameters: Mapping[str, Value] | None = None, clock: Clock | None = None) -> Prepared:
        """Return the scene for symbolic derivations with other parameter values: events as they are at the start."""
        prepared = self.prepare(parameters, clock)[1]
        guess = prepared.reduced.guess
        if guess is not None and guess.failures:  # with the values it was reduced for
            raise ModelError(guess.failures)
        return prepared if prepared.flat.events is None else self.without_events(prepared, None, clock)

    def without_events(self, prepared: Prepared, held: np.ndarray | None, clock: Clock | None = None) -> Prepared:
        """Return the scene with discrete variables that depend on the past held, at their starts or as in a run."""
        from lmoc.ir.written import as_written

        made = as_written(prepared.flat, prepared.values, prepared.reduced.discrete, held)
        reduced = pipeline.reduce(made.flat, made.values, self.scene.states, clock or Clock())
        return Prepared(made.flat, reduced, made.values, prepared.notes, remembered=made.remembered)

    def equilibria(self, prepared: Prepared, inputs: Mapping[str, Any] | None) -> Equilibria:
        """Return the states of rest of what is prepared for derivations, with or without laws."""
        from lmoc.symbolic.interface import equilibria
        from lmoc.symbolic.laws.rest import equilibria_with_laws

        refuse_remembered(prepared, "what they are at rest is not known")
        if prepared.flat.laws:
            return equilibria_with_laws(self.lawful(prepared), inputs)
        return equilibria(prepared, inputs, self.reductions)

    @property
    def reductions(self) -> Released:
        """How derivations get the scene in other coordinates of its closed loops."""
        from lmoc.symbolic.released import Released

        return Released(self.released, reduced_at)

    def lawful(self, prepared: Prepared) -> Lawful:
        """Return a scene with laws for derivations, in which each mode has a reduction of its own."""
        from lmoc.symbolic.laws.modes import Lawful

        return Lawful(prepared, self._reduced_in_mode, released_in_mode, reduced_at, self._met)

    def _reduced_in_mode(self, flat: FlatDAE, values: np.ndarray, states: Sequence[str] | None) -> Reduced:
        """Return the reduction of one mode; requested states are those of the scene with all laws open."""
        asked = states or self.scene.states
        try:
            return pipeline.reduce(flat, values, asked, Clock())
        except ModelError as error:
            if not asked or any(d.subject is not Subject.STATE_REFUSED for d in error.diagnostics):
                raise
        return pipeline.reduce(flat, values, None, Clock())

    def _resizes(self, name: str, value: Value) -> bool:
        """Return whether an array is given that is longer or shorter than that of the model: its size may be open."""
        variables = self.flat.find(name)
        if variables is None or self.flat.kind[variables[0]] != Kind.PARAMETER or np.ndim(value) == 0:
            return False
        _, dims = self.flat.block_at(int(variables[0])).path[-1]
        return bool(dims) and np.size(value) != len(variables)

    def _reshapes(self, name: str, value: Value, conditional: bool = False) -> bool:
        """Return whether a value shapes the flat model, by conditions alone, and differs from the one that has."""
        variables, block = self.flat.find(name), self._block_of(name)
        return block.structural and block.conditional == conditional and bool(np.any(self.values[variables] != value))

    def _block_of(self, name: str) -> Block:
        return self.flat.block_at(int(self.flat.find(name)[0]))

    def _decided(self, parameters: Mapping[str, Value], overrides: Mapping[int, float]) -> bool:
        """Return whether conditions on parameters that have shaped the flat model are as they were."""
        if not any(self._block_of(name).conditional for name in parameters):
            return True
        values = self.flat.parameter_values({**indexed(self.flat, self.flat.overrides), **overrides})
        return bool(self.flat.keeps_shape(values))

    def _reshape(self, structural: Mapping[str, Value], clock: Clock) -> Session:
        key = tuple(sorted((name, np.asarray(value, float).tobytes()) for name, value in structural.items()))
        if key not in self._reshaped:
            scene = self.scene.with_parameters(structural)
            self._reshaped[key] = Session(scene, pipeline.flatten(scene, clock), clock)
        return self._reshaped[key]

    # ------------------------------------------------------------------ coordinates

    def _reduction(self, values: np.ndarray, states: tuple[str, ...], clock: Clock) -> Reduced:
        """Return the reduction whose guards hold for some values, with some variables as states."""
        kept = self._reductions.setdefault(states, [])
        found = next((r for r in kept if r is not None and r.broken_guard(values) is None), None)
        if found is None:
            found = pipeline.reduce(self.flat, values, states or self.scene.states, clock, self._shared)
            kept.append(found)
        return found

    def elsewhere(self, prepared: Prepared, initial: Mapping[str, float] | None, clock: Clock) -> Prepared | None:
        """Return what is prepared, in coordinates chosen for the start of one run; None where there are no others.

        Where constraints change along the motion, some coordinates serve at one start and not at another. Initial
        equations may depend on parameters.
        """
        reduced, values = prepared.reduced, prepared.values
        if reduced.guess is None or not (initial or self.flat.initial_groups):
            return None
        initial = initial or {}
        key = tuple(sorted((n, np.asarray(v, float).tobytes()) for n, v in initial.items())), values.tobytes()
        if key not in self._starts:
            flat = starting_at(self.flat, initial)
            other = replace(pipeline.reduce(flat, values, self.scene.states, clock), flat=self.flat)
            self._starts = {key: other}  # the last one only: starts are many
        other = self._starts[key]
        if other.state_names == reduced.state_names:
            same_side = np.array_equal(other.guess.states, reduced.guess.states)
            return None if same_side else replace(prepared, reduced=other)
        lost = f"{', '.join(reduced.state_names)} cannot be the coordinates where this run starts"
        note = Diagnostic("N0631", f"the reduction was redone because {lost}")
        return replace(prepared, reduced=other, notes=(*prepared.notes, note))

    def started(self, prepared: Prepared, initial: object, clock: Clock) -> Prepared:
        """Return what is prepared, able to look for the start of a run with values of its own.

        A reduction that has been kept on disk cannot where loops are closed: it is made again.
        """
        reduced = prepared.reduced
        if not isinstance(initial, Mapping) or not initial or reduced.guess is None or reduced.guess_at is not None:
            return prepared
        made = pipeline.reduce(self.flat, prepared.values, self.scene.states, clock)
        if reduced is self.reduced:
            self.reduced = made
        kept = self._reductions[_MODEL]
        self._reductions[_MODEL] = [made if r is reduced else r for r in kept]
        return replace(prepared, reduced=made)

    def continuing(self, prepared: Prepared, states: Sequence[str], clock: Clock) -> Prepared:
        """Return what is prepared, in the coordinates in which another run has ended."""
        if len(states) != len(prepared.reduced.states) or list(states) == prepared.reduced.state_names:
            return prepared  # a run in all coordinates of its loops has been in those, too
        return replace(prepared, reduced=self._reduction(prepared.values, tuple(sorted(states)), clock))

    def formulated(self, prepared: Prepared, wanted: Requested, clock: Clock) -> Prepared:
        """Return what is prepared, in another formulation of its closed loops.

        Raises
        ------
        NotFormulatedError
            E0626: the scene cannot be run in this formulation.
        """
        form = wanted.form
        if form.name in ("auto", "reduced"):
            return prepared
        if prepared.flat.laws or prepared.flat.events is not None:
            message = f"a scene with laws or events cannot be run in formulation '{form.name}'"
            from lmoc.numerics.options.formulations import NotFormulatedError

            raise NotFormulatedError([Diagnostic("E0626", message, expected="auto or reduced")])
        if prepared.reduced.invariants is None:
            note = Diagnostic("N0634", f"no closed loops are left in this scene: {form.name} is the same as reduced")
            return replace(prepared, notes=(*prepared.notes, note))
        released = self.in_all_coordinates(prepared, wanted.gain, clock)
        return replace(prepared, reduced=released, minimal=prepared.reduced)

    def released(self, prepared: Prepared) -> Reduced:
        """Return the reduction with all coordinates of closed loops as states, in which the scene can be run.

        Raises
        ------
        NotFormulatedError
            E0626: it cannot.
        """
        from lmoc.numerics.options.formulations import TABLE, Requested

        return self.formulated(prepared, Requested(TABLE["index1"]), Clock()).reduced

    def in_all_coordinates(self, prepared: Prepared, gain: float = 0.0, clock: Clock | None = None) -> Reduced:
        """Return the same whatever can be run in it; the reduction in minimal coordinates where no loops are left.

        Parameters
        ----------
        gain : 1/s, of the feedback of closures; 0 without

        Raises
        ------
        NotFormulatedError
            E0626: not all of them can be states.
        """
        minimal, key = prepared.reduced, (id(prepared.reduced), gain)
        if minimal.invariants is None:
            return minimal
        if key not in self._formulated:
            made = pipeline.reduce_with_loops(minimal, self.scene.states, gain, clock or Clock())
            self._formulated[key] = minimal, made
        return self._formulated[key][1]

    def equations_of_loops(self, prepared: Prepared) -> EquationsOfMotion:
        """Return the equations of motion of a scene with closed loops, in minimal coordinates where these are short.

        Raises
        ------
        ModelError
            E0660: there are none that could be read.
        """
        from lmoc.symbolic.equations import equations_in_short

        return equations_in_short(prepared, lambda: self.released(prepared))

    # ------------------------------------------------------------------ runs

    @property
    def busy(self) -> Lock:
        """Held by whoever works with simulators: they have one set of buffers."""
        return self._busy

    def simulator(self, reduced: Reduced) -> Simulator:
        """Return the simulator of one of the reductions."""
        from lmoc.numerics.run.simulate import Simulator

        return self._simulators.setdefault(id(reduced), Simulator(reduced))

    def run(
        self,
        prepared: Prepared,
        options: RunOptions,
        inputs: Mapping[str, object] | None = None,
        initial: Mapping[str, float] | None = None,
        progress: Progress | None = None,
        occasions: list[Occasion] | None = None,
    ) -> Trajectory:
        """Simulate once; concurrent runs are serialized. Parameters and errors as of `Simulator.run`."""
        with self._busy:
            simulator, values = self.simulator(prepared.reduced), prepared.values
            if prepared.minimal is None:
                return simulator.run(
                    values, options, inputs, initial, progress, OtherCoordinates(self, prepared), occasions
                )
            place = self.simulator(prepared.minimal).start(values, options, inputs, initial)
            return simulator.run(values, options, inputs, place, progress)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what belongs to this process: the solvers' functions are made again when needed."""
        kept = {name: value for name, value in self.__dict__.items() if name != "_busy"}
        return kept | {"_simulators": {}, "_formulated": {}, "_met": {}, "_shared": Shared()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ = state | {"_busy": Lock()}


def released_in_mode(reduced: Reduced) -> Reduced:
    """Return one mode with all coordinates of its closed loops as states, whatever states were requested."""
    return reduced if reduced.in_all_coordinates else pipeline.reduce_with_loops(reduced, None, 0.0, Clock())


def reduced_at(flat: FlatDAE, values: np.ndarray, place: Mapping[str, float]) -> Reduced:
    """Return the reduction of one mode in coordinates that serve at a place, which alone is fixed at its start."""
    return pipeline.reduce(starting_at(replace(flat, fixed=()), place), values, None, Clock())


class OtherCoordinates:
    """The systems of a session with other variables as states, for one set of parameter values."""

    def __init__(self, session: Session, prepared: Prepared) -> None:
        self.session, self.prepared, self.values = session, prepared, prepared.values

    def system(self, states: Sequence[str], signals: Mapping[int, Signal], energy: bool) -> tuple[Plan, System] | None:
        """Return the plan and the system with some variables as states; None where they cannot be."""
        session, key = self.session, tuple(sorted(states))
        kept = session._reductions.get(key, [])
        if None in kept:
            return None
        try:
            reduced = session._reduction(self.values, key, Clock())
        except ModelError:  # some of them cannot be states
            session._reductions[key] = [None]
            return None
        return session.simulator(reduced).system(signals, energy, Report())

    def of_loops(self, signals: Mapping[int, Signal], energy: bool) -> tuple[Plan, System] | None:
        """Return the plan and the system with all coordinates of the loops as states; None where they cannot be."""
        from lmoc.numerics.options.formulations import TABLE, Requested

        session, prepared = self.session, self.prepared
        if prepared.reduced.invariants is None:
            return None
        try:
            reduced = session.formulated(prepared, Requested(TABLE["projected"]), Clock()).reduced
        except ModelError:  # not all of them can be states
            return None
        return session.simulator(reduced).system(signals, energy, Report())

    def leaving_out_others(
        self, current: Reduced, place: Mapping[str, float], signals: Mapping[int, Signal], energy: bool
    ) -> Iterator[tuple[Plan, System]]:
        """Yield plans and systems that take other constraints for the redundant ones.

        Parameters
        ----------
        place : values of coordinates, where others shall be chosen if those met so far do not serve
        """
        session = self.session
        kept = session._redundant.setdefault(self.values.tobytes(), [])
        if current not in kept:
            kept.append(current)
        for reduced in tuple(kept):
            if reduced is not current:
                yield session.simulator(reduced).system(signals, energy, Report())
        try:
            flat = starting_at(session.flat, place)
            made = replace(pipeline.reduce(flat, self.values, session.scene.states, Clock()), flat=session.flat)
        except ModelError:
            return
        if made.left_out not in [reduced.left_out for reduced in kept]:
            kept.append(made)
            yield session.simulator(made).system(signals, energy, Report())
