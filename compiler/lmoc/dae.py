"""What a user holds: a compiled scene with its simulations and derivations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

from lmoc import simulation
from lmoc.ir.names import names_of
from lmoc.messages.budgeted import budgeted
from lmoc.messages.diagnostics import Diagnostic
from lmoc.model import CompiledModel
from lmoc.parameters import Value, extreme_values
from lmoc.pipeline import Clock
from lmoc.simulation import Request

if TYPE_CHECKING:
    import sympy

    from lmoc.live.scene import Live
    from lmoc.numerics.evaluate.functions import Functions
    from lmoc.run import Run
    from lmoc.symbolic.equations import EquationsOfMotion
    from lmoc.symbolic.equilibria import Equilibria
    from lmoc.symbolic.equivalent import Equivalent
    from lmoc.symbolic.laws.equations import EquationsOfModes
    from lmoc.symbolic.linearize import LinearModel
    from lmoc.symbolic.places import Point
    from lmoc.symbolic.system import SymbolicSystem
    from lmoc.symbolic.transfer import InputOutputEquation, TransferFunction


def suspicion(scene: CompiledModel, *_: object, parameters: Mapping[str, Value] | None = None, **__: object) -> str:
    """Return which numbers may be the reason why work on a scene does not end."""
    return extreme_values(scene.flat, scene.values, parameters or {})


class CompiledDAE(CompiledModel):
    """A compiled scene with its runs and derivations; `lmoc.DAE` adds studies and pictures.

    Most methods take `parameters`, {name: value} for this one result, without compiling again.
    """

    # -------------------------------------------------------------------- simulation

    @budgeted("the simulation", suspicion)
    def simulate(
        self,
        start: float | None = None,
        stop: float | None = None,
        points: int | None = None,
        times: Sequence[float] | None = None,
        rtol: float | None = None,
        atol: float | None = None,
        solver: str = "auto",
        formulation: str = "auto",
        parameters: Mapping[str, Value] | None = None,
        initial: Point | str | None = None,
        inputs: Mapping[str, object] | None = None,
        *,
        energy: bool = True,
        keep: str | Sequence[str] | None = None,
        max_step: float | None = None,
        step: float | None = None,
        sensitivities: str | Sequence[str] = (),
        listener: Callable[[str], None] | None = None,
        progress: Callable[[float, float], None] | None = None,
    ) -> Run:
        """Simulate the scene.

        Parameters
        ----------
        start, stop : s; from the model's `experiment`, else 0 and 10
        points : number of output times, evenly spread; from the `experiment`, else 501
        times : the output times themselves, in place of `stop` and `points`; the run begins at `start` all the same
        rtol : relative tolerance; 1e-6
        atol : absolute tolerance of all states; rtol·1e-3 of the magnitude of each
        solver : one of `lmoc.numerics.options.options.SOLVERS`
        formulation : of closed loops, one of `lmoc.numerics.options.options.FORMULATIONS`; ``baumgarte:25`` with a
            gain in 1/s
        parameters : {name: value} for this run only
        initial : {name: value}, fixing any variable at the start; an `Equilibrium`; or "equilibrium", for the only one
            there is with the inputs as they are at the start
        inputs : {name: number, text of an expression in `time`, callable, (times, values), or name of a CSV file}
        energy : integrate work and heat along, for `run.energy`
        keep : names of variables or arrays to retain; by default the states, from which every variable can be computed
        max_step : s, the longest step of the integrator
        step : s, the length of every step, for the solvers with fixed steps; a thousandth of the run
        sensitivities : names of parameters, and of variables at the start, by which the motion is differentiated, for
            `run.sensitivity`; through events, too, where they are transversal
        listener : called with the name of each stage as it begins
        progress : called now and then with the time reached and the stop time

        Concurrent runs of one scene are serialized; for parallel runs pass the scene to processes (it can be pickled).

        Raises
        ------
        ModelError
            Unknown names, missing values, contradictory or impossible starts; E0575: no sensitivities.
        SimulationError
            The integration failed; `.time` is the time reached, `.partial` the `Run` until then.
        RunInterrupted
            A KeyboardInterrupt with the same attributes.
        """
        from lmoc.numerics.options.options import RunOptions

        options = RunOptions(
            start, stop, points, times, rtol, atol, solver, formulation, energy, names_of(keep), max_step, step
        )
        request = Request(options, parameters, initial, inputs, progress, self.timings, [] if sensitivities else None)
        run = simulation.simulate(self._session, request, Clock(listener))
        if sensitivities:
            run.tangents = simulation.sensitivities(self._session, request, run, names_of(sensitivities) or ())
        return run

    @budgeted("the start", suspicion)
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
        from lmoc.live.scene import Live

        start = (self.flat.experiment.start or 0.0) if start is None else start
        options = {"parameters": parameters, "rtol": rtol, "energy": False}
        run = self.simulate(start=start, times=[start], initial=initial, inputs=inputs, **options)
        return Live(self, run, inputs or {}, options)

    @budgeted("the start", suspicion)
    def check(self, listener: Callable[[str], None] | None = None) -> tuple[Diagnostic, ...]:
        """Look for a consistent start with the default values, where `simulate` would begin; returns all notes.

        Raises
        ------
        ModelError
            There is none, or something has no value.
        """
        from lmoc.numerics.options.options import RunOptions

        only_start = Request(RunOptions(times=[self.flat.experiment.start or 0.0]), compiled=self.timings)
        return simulation.run_prepared(*self._session.prepare(), only_start, Clock(listener)).notes

    @cached_property
    @budgeted("the functions", suspicion)
    def functions(self) -> Functions:
        """The solved system as casadi functions: `ode`, `output`, `jacobian`, `dae`, with the names of their arguments.

        Raises
        ------
        ModelError
            E0626 where the system is too large.
        """
        from lmoc.numerics.evaluate.functions import casadi_functions

        return casadi_functions(self.reduced, self.values, partial(simulation.start_values, self._session))

    # ----------------------------------------------------------------- derivations

    @budgeted("the equations in symbols", suspicion)
    def symbolic(self, variables: str | Sequence[str] = (), parameters: Point | None = None) -> SymbolicSystem:
        """Return the solved system in SymPy, with the expressions of further variables; E0660 where there is none."""
        from lmoc.symbolic.interface import symbolic

        return symbolic(self.prepare(parameters), variables)

    def symbolic_ode(self, parameters: Point | None = None) -> dict[str, sympy.Expr]:
        """Return {state name: SymPy expression of its derivative}, keys as in `states`."""
        return self.symbolic(parameters=parameters).ode

    @budgeted("the equations of motion", suspicion)
    def equations(
        self, forces: bool = False, parameters: Point | None = None, *, explicit: bool = False
    ) -> EquationsOfMotion | EquationsOfModes:
        """Return the equations of motion as a person writes them.

        Of a scene with laws these are the equations of each mode that the default run meets, and the laws between them.
        Of closed loops without a short form in minimal coordinates, those in all coordinates of the loops, with a
        multiplier for each closure. A curve through many points stands in them by its name.

        Parameters
        ----------
        forces : with the internal forces of ideal parts
        explicit : solved for the highest derivatives
        """
        from lmoc.symbolic.equations import equations_of_motion

        prepared = self.prepare(parameters)
        if prepared.flat.laws:
            from lmoc.places import modes_met
            from lmoc.symbolic.laws.equations import equations_of_modes

            modes = modes_met(self._session, parameters)
            return equations_of_modes(self._session.lawful(prepared), modes, forces, explicit)
        if prepared.reduced.invariants is not None and not (forces or explicit):
            found = self._session.equations_of_loops(prepared)
        else:
            found = equations_of_motion(prepared.reduced, prepared.values, forces, explicit)
        return replace(found, held=prepared.held)

    @budgeted("the equilibria", suspicion)
    def equilibria(self, inputs: Point | None = None, parameters: Point | None = None) -> Equilibria:
        """Return the states of rest for constant inputs; see `lmoc.symbolic.interface.equilibria`.

        Of a scene with laws each says which of them are closed, and what friction may hold (`Equilibrium.laws`).
        """
        return self._session.equilibria(self.prepare(parameters), inputs)

    @budgeted("the linear model", suspicion)
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
        from lmoc.places import place
        from lmoc.symbolic.interface import linearize

        prepared, point = place(self._session, at, parameters, inputs)
        return linearize(prepared, point, symbolic, inputs, outputs, self._session.reductions)

    @budgeted("the transfer function", suspicion)
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
        from lmoc.places import place
        from lmoc.symbolic.interface import transfer_function

        prepared, point = place(self._session, at, parameters)
        return transfer_function(prepared, u, y, point, self._session.reductions)

    def input_output_equation(
        self, u: str, y: str, parameters: Point | None = None, at: float | Point | Run | None = None
    ) -> InputOutputEquation:
        """Return ``left(p)·y = right(p)·u`` with p = d/dt; the pair (left, right), which prints as an equation."""
        return self.transfer_function(u, y, parameters, at).input_output_equation

    @budgeted("the equivalent", suspicion)
    def equivalent(self, port: str, other: str | None = None, parameters: Point | None = None) -> Equivalent:
        """Return the equivalent stiffness, damping and inertia seen at a port, against another one or the ground."""
        from lmoc.symbolic.equivalent import equivalent

        prepared = self.prepare(parameters)
        return equivalent(prepared.flat, prepared.values, port, other)

    def at_start(self, parameters: Mapping[str, Value] | None = None) -> Callable[[str], float]:
        """Return what gives the value of a variable, by its name, where a run starts."""
        run = self.simulate(times=[self.flat.experiment.start or 0.0], parameters=parameters, energy=False)
        return lambda name: float(run[name][0])

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what belongs to this process."""
        return {name: value for name, value in self.__dict__.items() if name != "functions"}
