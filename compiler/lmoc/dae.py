"""The user's interface to a compiled scene: names, values, simulation, and access to symbolic results."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lmoc import pipeline
from lmoc.ir.flat import FlatDAE, Kind
from lmoc.ir.names import Names, names_of
from lmoc.ir.prepared import Prepared
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Diagnostic, ModelError, Report, RunInterrupted, SimulationError
from lmoc.messages.source import Source
from lmoc.parameters import Parameters, Value, check_initial, check_mappings
from lmoc.pipeline import Clock, Scene
from lmoc.semantics.parameter_checks import check_parameters, warn_of_lost
from lmoc.session import Session

if TYPE_CHECKING:
    import sympy

    from lmoc.numerics.evaluate.functions import Functions, StartValues
    from lmoc.report.live import Live
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
        self._session = Session(scene, flat, clock)
        self.timings: dict[str, float] = clock.seconds

    @property
    def flat(self) -> FlatDAE:
        return self._session.flat

    @property
    def values(self) -> np.ndarray:
        """(flat.count,) the model's own parameter values."""
        return self._session.values

    @property
    def reduced(self) -> Reduced:
        return self._session.reduced

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
        step: float | None = None,
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
        step : s, the size of the steps of solvers with a fixed one; a thousandth of the run
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
        from lmoc.numerics.observe.trajectory import End
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
        session, prepared = self._session.prepare(parameters, clock)
        if isinstance(initial, End):
            prepared = session.continuing(prepared, initial.states, clock)
        options = RunOptions(start, stop, points, times, rtol, atol, solver, formulation, energy, keep, max_step, step)
        try:
            return self._run(session, prepared, options, initial, inputs, clock, progress)
        except StartSingular:
            other = session.elsewhere(prepared, initial, clock)
            if other is None:
                raise
        return self._run(session, other, options, initial, inputs, clock, progress)

    def live(
        self,
        start: float | None = None,
        initial: Point | str | None = None,
        inputs: Mapping[str, object] | None = None,
        parameters: Mapping[str, Value] | None = None,
        rtol: float | None = None,
    ) -> Live:
        """Return the scene at its start, to be stepped from a loop.

        Parameters
        ----------
        start, initial, parameters, rtol : as in `simulate`
        inputs : as in `simulate`; numbers can be changed on the way

        Raises
        ------
        ModelError
            As `simulate` does at its start.
        """
        from lmoc.report.live import Live

        start = (self.flat.experiment.start or 0.0) if start is None else start
        options = {"parameters": parameters, "rtol": rtol, "energy": False}
        run = self.simulate(start=start, times=[start], initial=initial, inputs=inputs, **options)
        return Live(self, run, inputs or {}, options)

    def _run(self, session: Session, prepared: Prepared, options, initial, inputs, clock: Clock, progress) -> Run:
        report = Report()
        check_parameters(session.flat, prepared.values, report)
        report.check()
        with clock.stage("lower"):
            from lmoc.numerics.start.singular import StartSingular
            from lmoc.report.run import Run

            session.simulator(prepared.reduced)

        def result(trajectory, broke_off: float | None = None) -> Run:
            notes = *session.flat.notes, *prepared.reduced.notes, *prepared.notes, *report.diagnostics
            said = dict.fromkeys((*notes, *trajectory.notes))
            lower, start = (float(trajectory.stats[f"{stage}_seconds"]) for stage in ("lower", "start"))
            spent = {**self.timings, **clock.seconds}
            spent |= {"lower": spent["lower"] + lower, "start": start, "simulate": spent["simulate"] - lower - start}
            return Run(prepared.reduced, trajectory, tuple(said), spent, broke_off, again)

        def again(times: np.ndarray) -> Run:
            finer = replace(options, stop=None, points=None, times=times)
            return self._run(session, prepared, finer, initial, inputs, Clock(), None)

        try:
            with clock.stage("simulate"):
                trajectory = session.run(prepared, options, inputs, initial, progress)
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
        session, prepared = self._session.prepare()
        return self._run(session, prepared, only_start, None, None, Clock(listener), None).notes

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
        """Return the start of a run with the default values, with the values of some registers."""
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
        prepared = self._session.prepare(parameters, clock)[1]
        if prepared.flat.events is not None:
            return self._without_events(prepared.flat, prepared.values, None, prepared.notes, clock)
        return prepared

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
        reduced = pipeline.reduce(flat, values, self._session.scene.states, clock or Clock())
        return Prepared(flat, reduced, values, notes)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what belongs to this process."""
        return {name: value for name, value in self.__dict__.items() if name != "functions"}

    def __repr__(self) -> str:
        return (
            f"<DAE {self.name}: {self.reduced.counts['parts']} parts, {self.flat.equation_count} flat equations, "
            f"{len(self.reduced.states)} states>"
        )

    def _repr_html_(self) -> str:
        """Return the HTML representation for notebooks: the scene, and its main methods."""
        from lmoc.report.page import named_lists

        names = {"states": self.states, "inputs": self.inputs, "outputs": self.outputs, "parameters": self.parameters}
        return named_lists(repr(self).strip("<>"), names)
