"""What a user holds of a compiled scene: names, values, simulation, and the door to symbolic results."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from numbers import Real
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from lmoc import pipeline
from lmoc.ir.flat import FlatDAE, Kind
from lmoc.ir.names import Names, names_of
from lmoc.ir.prepared import Prepared
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Diagnostic, ModelError, Report, RunInterrupted, SimulationError
from lmoc.messages.source import Source
from lmoc.parameters import Parameters, Value, check_initial, check_mappings, indexed, starting_at
from lmoc.pipeline import Clock, Scene
from lmoc.semantics.parameter_checks import check_parameters, warn_of_lost

if TYPE_CHECKING:
    import sympy

    from lmoc.numerics.evaluate.functions import Functions, StartValues
    from lmoc.numerics.simulate import Simulator
    from lmoc.report.run import Run
    from lmoc.symbolic.equations import EquationsOfMotion
    from lmoc.symbolic.equilibria import Equilibria
    from lmoc.symbolic.equivalent import Equivalent
    from lmoc.symbolic.linearize import LinearModel
    from lmoc.symbolic.places import Moment, Point
    from lmoc.symbolic.system import SymbolicSystem
    from lmoc.symbolic.transfer import InputOutputEquation, TransferFunction


def compile(
    file: str | Path | Sequence[str | Path],
    model: str | None = None,
    parameters: Mapping[str, Value] | None = None,
    states: str | Sequence[str] | None = None,
    path: str | Path | Sequence[str | Path] | None = None,
    *,
    listener: Callable[[str], None] | None = None,
) -> DAE:
    """Compile the scene in a file.

    Parameters
    ----------
    file : the `.lmo` file, or several; or the dotted name of a class that is found in a folder
    model : which model, where the file holds several that could be meant
    parameters : {dotted name: value}, overriding what the file says
    states : variables to prefer as states, or the name of one
    path : folders in which classes are looked for, after that of the file and before those of ``LMOPATH``
    listener : called with the name of each stage as it begins

    Raises
    ------
    ModelError
        The model is wrong, or the file cannot be read; `.diagnostics` say what and where.
    """
    return compile_source(file, model, parameters, states, path, listener)


def compile_text(
    text: str,
    name: str = "model.lmo",
    model: str | None = None,
    parameters: Mapping[str, Value] | None = None,
    states: str | Sequence[str] | None = None,
    path: str | Path | Sequence[str | Path] | None = None,
) -> DAE:
    """Compile a scene given as text; `name` stands for the file's name in messages. Otherwise as `compile`."""
    if not isinstance(text, str):
        raise TypeError(f"a model is a text (str), not {type(text).__name__}")
    return compile_source(Source(name, text), model, parameters, states, path)


def compile_source(
    source: Source | str | Path | Sequence[str | Path],
    model: str | None = None,
    parameters: Mapping[str, Value] | None = None,
    states: str | Sequence[str] | None = None,
    path: str | Path | Sequence[str | Path] | None = None,
    listener: Callable[[str], None] | None = None,
) -> DAE:
    """Compile a text or what files hold; otherwise as `compile`."""
    check_mappings(parameters=parameters)
    clock = Clock(listener)
    scene = Scene((), model, dict(parameters or {}), names_of(states), path)
    scene = pipeline.open_scene(source, scene, clock)
    return DAE(scene, pipeline.flatten(scene, clock), clock)


class DAE:
    """A compiled scene. Made by `lmoc.compile`; parameters can be changed from run to run without compiling again.

    Attributes
    ----------
    flat : FlatDAE
        The flat model: every variable and equation of the scene.
    reduced : Reduced
        The smallest system of equations, for the parameter values of the model.
    timings : {stage: seconds}
    """

    def __init__(self, scene: Scene, flat: FlatDAE, clock: Clock | None = None):
        clock = clock or Clock()
        self.flat = flat
        self.values = flat.parameter_values(indexed(flat, flat.overrides))
        self.reduced: Reduced = pipeline.reduce(flat, self.values, scene.states, clock)
        self.timings: dict[str, float] = clock.seconds
        self._scene = scene
        self._reductions = [self.reduced]  # one for each pattern of guards met so far
        self._simulators: dict[int, Simulator] = {}  # by identity of the reduction
        self._busy = Lock()  # a simulator has one set of buffers
        self._elsewhere: dict[str, Reduced] = {}  # for starts at which the coordinates of the others do not serve
        self._reshaped: dict[tuple, DAE] = {}  # one for each set of structural values met so far

    # ------------------------------------------------------------------------- names

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.flat.name

    @cached_property
    def states(self) -> list[str]:
        """Names of the solved states, in their order."""
        return self.reduced.state_names

    @cached_property
    def parameters(self) -> Parameters:
        """{name: value}; NaN where the model gives no value."""
        return Parameters(self.flat, self.values)

    @cached_property
    def inputs(self) -> list[str]:
        """Names of the top-level inputs."""
        return list(Names(self.flat, np.flatnonzero(self.flat.kind == Kind.INPUT)))

    @cached_property
    def outputs(self) -> list[str]:
        """Names of the top-level outputs."""
        return list(Names(self.flat, np.flatnonzero(self.flat.per_variable(lambda b: b.output, bool))))

    @cached_property
    def variables(self) -> Names:
        """Names of everything that changes in time: a sequence, its names made on demand."""
        return Names(self.flat, np.flatnonzero(self.flat.kind >= Kind.INPUT))

    @property
    def notes(self) -> tuple[Diagnostic, ...]:
        """Warnings and notes of the compilation."""
        report = Report()
        warn_of_lost(self.flat, self.values, report)
        return tuple(dict.fromkeys((*self.flat.notes, *self.reduced.notes, *report.diagnostics)))

    # -------------------------------------------------------------------- simulation

    def simulate(
        self,
        start: float | None = None,
        stop: float | None = None,
        points: int | None = None,
        times: Sequence[float] | None = None,
        rtol: float | None = None,
        atol: float | None = None,
        solver: str = "auto",
        formulation: str = "reduced",
        parameters: Mapping[str, Value] | None = None,
        initial: Point | str | None = None,
        inputs: Mapping[str, object] | None = None,
        *,
        energy: bool = True,
        keep: str | Sequence[str] | None = None,
        max_step: float | None = None,
        listener: Callable[[str], None] | None = None,
        progress: Callable[[float, float], None] | None = None,
    ) -> Run:
        """Simulate the scene.

        Parameters
        ----------
        start, stop : s; from the model's `experiment`, else 0 and 10
        points : number of output times, evenly spread; from the `experiment`, else 501
        times : the output times themselves
        rtol, atol : tolerances; 1e-6, and rtol·1e-3·nominal
        solver : one of `lmoc.numerics.options.SOLVERS`
        formulation : "reduced"
        parameters : {name: value} for this run only
        initial : {name: value}, fixing any variable at the start; an `Equilibrium`; or "equilibrium", for the only one
            there is with the inputs as they are at the start
        inputs : {name: number, text of an expression in `time`, callable, (times, values), or name of a CSV file}
        energy : integrate work and heat along, for `run.energy`
        keep : names of variables or arrays to retain; without it the states are kept, and everything can be asked for
        max_step : s, the longest step of the integrator
        listener : called with the name of each stage as it begins
        progress : called now and then with the time reached and the stop time

        Threads that run one scene take turns; for runs side by side give processes the scene itself (it can be
        pickled).

        Raises
        ------
        ModelError
            Unknown names, missing values, contradictory or impossible starts.
        SimulationError
            The integration failed; `.time` is the time reached, `.partial` the `Run` until then.
        RunInterrupted
            A KeyboardInterrupt with the same attributes.
        """
        from lmoc.numerics.options import RunOptions
        from lmoc.numerics.start.singular import StartSingular

        check_mappings(parameters=parameters, initial=None if isinstance(initial, str) else initial, inputs=inputs)
        if initial is not None and initial != {}:
            from lmoc.symbolic.starts import in_symbols, start_values

            if in_symbols(initial):
                begin = (self.flat.experiment.start or 0.0) if start is None else start
                initial = start_values(self.prepare(parameters), initial, inputs, begin)
        check_initial(initial or {})
        keep = names_of(keep)
        clock = Clock(listener)
        scene, reduced, values, notes = self.prepared(parameters or {}, clock)
        options = RunOptions(start, stop, points, times, rtol, atol, solver, formulation, energy, keep, max_step)
        try:
            return scene._run(reduced, values, options, initial, inputs, notes, clock, progress)
        except StartSingular:
            other = scene._reduced_at(initial, reduced, values, clock)
            if other is None:
                raise
        lost = f"{', '.join(reduced.state_names)} cannot be the coordinates where this run starts"
        notes = [*notes, Diagnostic("N0631", f"the equations have been reduced anew: {lost}")]
        return scene._run(other, values, options, initial, inputs, notes, clock, progress)

    def _reduced_at(self, initial: Mapping[str, float] | None, reduced: Reduced, values, clock) -> Reduced | None:
        """The reduction with other coordinates, chosen for initial values of one run; None where there are no others.

        Where constraints change along the motion, some coordinates serve at one start and not at another.
        """
        if not initial or reduced.nearby is None:
            return None
        key = repr((sorted(initial.items()), values.tobytes()))
        if key not in self._elsewhere:
            flat = starting_at(self.flat, initial)
            other = replace(pipeline.reduce(flat, values, self._scene.states, clock), flat=self.flat)
            self._elsewhere = {key: other}  # the last one only: starts are many
        other = self._elsewhere[key]
        return None if other.state_names == reduced.state_names else other

    def _run(self, reduced, values, options, initial, inputs, notes, clock, progress) -> Run:
        report = Report()
        check_parameters(self.flat, values, report)
        report.check()
        with clock.stage("lower"):
            from lmoc.numerics.simulate import Simulator
            from lmoc.numerics.start.singular import StartSingular
            from lmoc.report.run import Run

            simulator = self._simulators.setdefault(id(reduced), Simulator(reduced))

        def result(trajectory, broke_off: float | None = None) -> Run:
            said = dict.fromkeys((*self.flat.notes, *reduced.notes, *notes, *report.diagnostics, *trajectory.notes))
            lower, start = (float(trajectory.stats[f"{stage}_seconds"]) for stage in ("lower", "start"))
            spent = {**self.timings, **clock.seconds}
            spent |= {"lower": spent["lower"] + lower, "start": start, "simulate": spent["simulate"] - lower - start}
            return Run(reduced, trajectory, tuple(said), spent, broke_off, again)

        def again(times: np.ndarray) -> Run:
            finer = replace(options, start=None, stop=None, points=None, times=times)
            return self._run(reduced, values, finer, initial, inputs, notes, Clock(), None)

        try:
            with self._busy, clock.stage("simulate"):
                others = _OtherCoordinates(self, values)
                trajectory = simulator.run(values, options, inputs, initial, progress, others)
        except StartSingular as error:
            raise StartSingular((*report.diagnostics, *error.diagnostics), error.coordinates, error.place) from None
        except ModelError as error:
            raise ModelError((*report.diagnostics, *error.diagnostics)) from error.__cause__
        except (SimulationError, RunInterrupted) as failure:
            if failure.partial is not None:
                failure.partial = result(failure.partial, failure.time)
            raise
        return result(trajectory)

    def check(self, listener: Callable[[str], None] | None = None) -> tuple[Diagnostic, ...]:
        """Look for a consistent start with the default values, where `simulate` would begin; returns all notes.

        Raises
        ------
        ModelError
            There is none, or something has no value.
        """
        from lmoc.numerics.options import RunOptions

        only_start = RunOptions(times=[self.flat.experiment.start or 0.0])
        return self._run(self.reduced, self.values, only_start, None, None, (), Clock(listener), None).notes

    @cached_property
    def functions(self) -> Functions:
        """The solved system as casadi functions: `ode`, `output`, `jacobian`, `dae`, with the names of their arguments.

        Raises
        ------
        ModelError
            E0626 where the system is too large.
        """
        from lmoc.numerics.evaluate.functions import casadi_functions

        return casadi_functions(self.reduced, self.values, self._start_values)

    def _start_values(self, registers: np.ndarray) -> StartValues:
        """Where a run with the default values starts, with the values of some registers."""
        from lmoc.numerics.evaluate.functions import StartValues
        from lmoc.numerics.observe.slices import slice_of

        run = self.simulate(times=[self.flat.experiment.start or 0.0])
        piece = run.trajectory.pieces[0]
        observer, times, inputs = piece.observer, piece.time, piece.reduced.inputs[0]
        part = slice_of(observer.plan, np.concatenate([registers, inputs])).bind(observer.base, observer.signals)
        z, u = np.split(part(times, piece.table)[0], [len(registers)])
        return StartValues(float(times[0]), piece.table[0, : len(self.states)], z, u)

    # ----------------------------------------------------------------- derivations

    # All of them take `parameters`, {name: value} for this one derivation: a value of zero changes the equations.

    def symbolic(self, variables: str | Sequence[str] = (), parameters: Point | None = None) -> SymbolicSystem:
        """Return the solved system in SymPy, with the expressions of further variables; E0660 where there is none."""
        from lmoc.symbolic.system import symbolic_system

        prepared = self.prepare(parameters)
        return symbolic_system(prepared.reduced, prepared.values, names_of(variables))

    def symbolic_ode(self, parameters: Point | None = None) -> dict[str, sympy.Expr]:
        """Return {state name: SymPy expression of its derivative}, keys as in `states`."""
        return self.symbolic(parameters=parameters).ode

    def equations(
        self, forces: bool = False, parameters: Point | None = None, *, explicit: bool = False
    ) -> EquationsOfMotion:
        """Return the equations of motion as a person writes them.

        Parameters
        ----------
        forces : with the internal forces of ideal parts
        explicit : solved for the highest derivatives
        """
        from lmoc.symbolic.equations import equations_of_motion

        prepared = self.prepare(parameters)
        return equations_of_motion(prepared.reduced, prepared.values, forces, explicit)

    def equilibria(self, inputs: Point | None = None, parameters: Point | None = None) -> Equilibria:
        """Return the states of rest for constant inputs; see `lmoc.symbolic.interface.equilibria`."""
        from lmoc.symbolic.interface import equilibria

        return equilibria(self.prepare(parameters), inputs)

    def linearize(
        self,
        at: float | Point | Run | None = None,
        symbolic: bool = False,
        inputs: Point | None = None,
        outputs: str | Sequence[str] | None = None,
        parameters: Point | None = None,
    ) -> LinearModel:
        """Return the linear model A, B, C, D.

        Parameters
        ----------
        at : where: a time of the default run, a point {name: value} of states (an `Equilibrium` is one) and inputs, or
            a `Run`, for its last point with its parameter values; by default the equilibrium
        symbolic, inputs, outputs : as in `lmoc.symbolic.interface.linearize`, with its errors
        """
        from lmoc.symbolic.interface import linearize

        prepared, place = self._place(at, parameters)
        return linearize(prepared, place, symbolic, inputs, outputs)

    def transfer_function(
        self, u: str, y: str, parameters: Point | None = None, at: float | Point | Run | None = None
    ) -> TransferFunction:
        """Return the transfer function from an input to any variable, a rational expression in ``Symbol("s")``.

        The result can be used as the SymPy expression; it also has `poles`, `zeros`, `gain`, `cancelled`.

        Parameters
        ----------
        u, y : names of a top-level input and of a variable
        at : where a nonlinear scene is taken, as in `linearize`; by default its equilibrium without inputs
        """
        from lmoc.symbolic.interface import transfer_function

        prepared, place = self._place(at, parameters)
        return transfer_function(prepared, u, y, place)

    def input_output_equation(
        self, u: str, y: str, parameters: Point | None = None, at: float | Point | Run | None = None
    ) -> InputOutputEquation:
        """Return ``left(p)·y = right(p)·u`` with p = d/dt; the pair (left, right), which prints as an equation."""
        return self.transfer_function(u, y, parameters, at).input_output_equation

    def equivalent(self, port: str, other: str | None = None, parameters: Point | None = None) -> Equivalent:
        """Return the equivalent stiffness, damping and inertia seen at a port, against another one or the ground."""
        from lmoc.symbolic.equivalent import equivalent

        prepared = self.prepare(parameters)
        return equivalent(prepared.flat, prepared.values, port, other)

    def _place(self, at: object, parameters: Point | None) -> tuple[Prepared, Moment | Point | None]:
        """The scene, and where it is to be linear."""
        from lmoc.report.run import Run

        if isinstance(at, Real):
            at = self._until(float(at), parameters)
        if isinstance(at, Run):
            reduced = at.reduced
            values = at.trajectory.observer.values
            if parameters:
                prepared = self.prepare(parameters)
            elif reduced.flat.events is not None:
                prepared = self._without_events(reduced.flat, values, at.trajectory.end.values)
            else:
                prepared = Prepared(reduced.flat, reduced, values)
            names = (*reduced.state_names, *prepared.inputs)
            from lmoc.symbolic.places import Moment

            return prepared, Moment(float(at.time[-1]), {name: float(at[name][-1]) for name in names})
        if at is not None and not isinstance(at, Mapping):
            expected = "a time, {name: value}, an equilibrium or a run"
            raise TypeError(f"at is {expected}, not {type(at).__name__} {at!r:.40}")
        return self.prepare(parameters), at

    def _until(self, time: float, parameters: Point | None) -> Run:
        """The default run until a time."""
        start = self.flat.experiment.start or 0.0
        if time < start:
            from lmoc.symbolic.places import no_place

            raise no_place(f"the run starts at {start:g} s: there is no point at {time:g} s to be linear about")
        return self.simulate(times=sorted({start, time}), parameters=parameters)

    def prepare(self, parameters: Mapping[str, Value] | None = None, clock: Clock | None = None) -> Prepared:
        """Return the flat model, its reduction and the parameter values for other parameters; what was redone as notes.

        A structural parameter means flattening again; a broken guard means reducing again. Both are kept.
        """
        scene, reduced, values, notes = self.prepared(parameters or {}, clock)
        if scene.flat.events is not None:
            return self._without_events(scene.flat, values, None, tuple(notes), clock)
        return Prepared(scene.flat, reduced, values, tuple(notes))

    def _without_events(
        self,
        flat: FlatDAE,
        values: np.ndarray,
        held: np.ndarray | None,
        notes: tuple[Diagnostic, ...] = (),
        clock: Clock | None = None,
    ) -> Prepared:
        """The scene for derivations, its discrete variables as they are at the start or at a place of a run."""
        from lmoc.ir.written import as_written

        flat, values = as_written(flat, values, held)
        reduced = pipeline.reduce(flat, values, self._scene.states, clock or Clock())
        return Prepared(flat, reduced, values, notes)

    def prepared(
        self, parameters: Mapping[str, Value], clock: Clock | None = None
    ) -> tuple[DAE, Reduced, np.ndarray, list[Diagnostic]]:
        """The scene, its reduction and its parameter values for a run with other parameters, and what had to be redone.

        A structural parameter means flattening again; a broken guard means reducing again. Both are kept.
        """
        if not parameters:
            return self, self.reduced, self.values, []
        clock = clock or Clock()
        resized = {name: value for name, value in parameters.items() if self._resizes(name, value)}
        overrides = indexed(self.flat, {n: v for n, v in parameters.items() if n not in resized})
        structural = {n: v for n, v in parameters.items() if n in resized or self._reshapes(n, v)}
        if structural:
            scene = self._reshape(structural, clock)
            rest = {n: v for n, v in parameters.items() if n not in structural}
            shape = "shapes" if len(structural) == 1 else "shape"
            note = Diagnostic("N0630", f"{', '.join(structural)} {shape} the model: it has been flattened again")
            scene, reduced, values, notes = scene.prepared(rest, clock)
            return scene, reduced, values, [note, *notes]
        values = self.flat.parameter_values({**indexed(self.flat, self.flat.overrides), **overrides})
        reduced, notes = self._reduction(values, clock)
        return self, reduced, values, notes

    def _resizes(self, name: str, value: Value) -> bool:
        """Whether an array is given that is longer or shorter than that of the model: its size may be open."""
        variables = self.flat.find(name)
        if variables is None or self.flat.kind[variables[0]] != Kind.PARAMETER or np.ndim(value) == 0:
            return False
        _, dims = self.flat.block_at(int(variables[0])).path[-1]
        return bool(dims) and np.size(value) != len(variables)

    def _reshapes(self, name: str, value: Value) -> bool:
        """Whether a value shapes the flat model and differs from the one that has shaped it."""
        variables = self.flat.find(name)
        return self.flat.block_at(int(variables[0])).structural and bool(np.any(self.values[variables] != value))

    def _reshape(self, structural: Mapping[str, Value], clock: Clock) -> DAE:
        key = tuple(sorted((name, np.asarray(value, float).tobytes()) for name, value in structural.items()))
        if key not in self._reshaped:
            scene = self._scene.with_parameters(structural)
            self._reshaped[key] = DAE(scene, pipeline.flatten(scene, clock), clock)
        return self._reshaped[key]

    def _reduction(self, values: np.ndarray, clock: Clock) -> tuple[Reduced, list[Diagnostic]]:
        broken = self.reduced.broken_guard(values)
        if broken is None:
            return self.reduced, []
        note = Diagnostic("N0631", f"the equations have been reduced anew: it no longer holds that {broken}")
        for known in self._reductions[1:]:
            if known.broken_guard(values) is None:
                return known, [note]
        reduced = pipeline.reduce(self.flat, values, self._scene.states, clock)
        self._reductions.append(reduced)
        return reduced, [note]

    def __getstate__(self) -> dict[str, Any]:
        """What a copy begins with: the solvers' functions belong to this process and are made again when needed."""
        kept = {name: value for name, value in self.__dict__.items() if name not in ("_busy", "functions")}
        return kept | {"_simulators": {}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ = state | {"_busy": Lock()}

    def __repr__(self) -> str:
        return (
            f"<DAE {self.name}: {self.reduced.counts['parts']} parts, {self.flat.equation_count} flat equations, "
            f"{len(self.reduced.states)} states>"
        )

    def _repr_html_(self) -> str:
        """What a notebook shows: the scene, and what can be asked of it."""
        from lmoc.report.page import named_lists

        names = {"states": self.states, "inputs": self.inputs, "outputs": self.outputs, "parameters": self.parameters}
        return named_lists(repr(self).strip("<>"), names)


class _OtherCoordinates:
    """Simulators of a scene with other variables as states."""

    def __init__(self, scene: DAE, values: np.ndarray) -> None:
        self.scene, self.values = scene, values

    def system(self, states: Sequence[str], signals: Mapping, energy: bool):
        """Return the plan and the system with some variables as states; None where they cannot be."""
        scene, key = self.scene, ("states", *sorted(states))
        kept = scene._elsewhere.get(key)
        if key not in scene._elsewhere or kept is not None and kept.broken_guard(self.values) is not None:
            try:
                kept = pipeline.reduce(scene.flat, self.values, states, Clock())
            except ModelError:  # some of them cannot be states
                kept = None
            scene._elsewhere[key] = kept
        if kept is None:
            return None
        from lmoc.numerics.simulate import Simulator

        simulator = scene._simulators.setdefault(id(kept), Simulator(kept))
        return simulator.system(signals, energy, Report())
