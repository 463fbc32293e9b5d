"""What `DAE` offers of symbols: one method for each thing that a textbook shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from numbers import Real
from typing import TYPE_CHECKING, Any, Protocol

from lmoc.messages.diagnostics import Diagnostic, ModelError, nearest

if TYPE_CHECKING:
    import numpy as np
    import sympy

    from lmoc.ir.reduced import Reduced
    from lmoc.numerics.observe.trajectory import Trajectory
    from lmoc.symbolic.equations import EquationsOfMotion
    from lmoc.symbolic.equilibria import Equilibria, Equilibrium
    from lmoc.symbolic.equivalent import Equivalent
    from lmoc.symbolic.linearize import LinearModel
    from lmoc.symbolic.numeric import NumericSystem
    from lmoc.symbolic.system import SymbolicSystem
    from lmoc.symbolic.transfer import InputOutputEquation, TransferFunction

Point = Mapping[str, Any]


class Run(Protocol):
    """What is asked of the result of a simulation here; `lmoc.Run` offers it, and more."""

    reduced: Reduced
    trajectory: Trajectory
    time: np.ndarray

    def __getitem__(self, name: str) -> np.ndarray: ...


class SymbolicMethods:
    """Derivations from a compiled scene; a base of `DAE`.

    All of them take `parameters`, ``{name: value}`` for this one derivation: a value of zero changes the equations.
    Symbols are plain ``sympy.Symbol("dotted.name")``; an input's derivative is ``Symbol("der(u)")``.
    """

    def symbolic(self, variables: Sequence[str] = (), parameters: Point | None = None) -> SymbolicSystem:
        """The solved system in SymPy, with the expressions of further variables.

        Raises
        ------
        ModelError
            E0660 where the scene is too large or has no closed form.
        """
        from lmoc.symbolic.system import symbolic_system

        _, reduced, values, _ = self.prepared(parameters or {})
        return symbolic_system(reduced, values, tuple(variables))

    def symbolic_ode(self, parameters: Point | None = None) -> dict[str, sympy.Expr]:
        """{state name: SymPy expression of its derivative}, keys as in `states`."""
        return self.symbolic(parameters=parameters).ode

    def equations(self, forces: bool = False, parameters: Point | None = None) -> EquationsOfMotion:
        """Equations of motion as a person writes them; with the internal forces of ideal parts where asked for."""
        from lmoc.symbolic.equations import equations_of_motion

        _, reduced, values, _ = self.prepared(parameters or {})
        return equations_of_motion(reduced, values, forces)

    def equilibria(self, inputs: Point | None = None, parameters: Point | None = None) -> Equilibria:
        """States of rest for constant inputs.

        Inputs not given stay symbols as long as the equations can be solved in symbols, otherwise they are zero. A
        scene that is too large for symbols gets the one state of rest that Newton's method finds.
        """
        scene, reduced, values, _ = self.prepared(parameters or {})
        _check_names(inputs or {}, scene.inputs)
        return _equilibria(reduced, values, inputs or {})

    def linearize(
        self,
        at: float | Point | Run | None = None,
        symbolic: bool = False,
        inputs: Point | None = None,
        outputs: Sequence[str] | None = None,
        parameters: Point | None = None,
    ) -> LinearModel:
        """Linear model A, B, C, D.

        Parameters
        ----------
        at : where: a time of the default run, a point {name: value} of states (an `Equilibrium` is one) and inputs, or
            a `Run`, for its last point with its parameter values; by default the equilibrium
        symbolic : matrices in symbols; otherwise in numbers, for a scene of any size
        inputs : constant values of the inputs at the equilibrium, {name: value}
        outputs : names of variables; by default the scene's outputs, else its states

        Raises
        ------
        ModelError
            E0660, E0661 as above, E0662 a parameter without a value, E0663 several equilibria or none to choose.
        """
        _check_place(at)
        if symbolic:
            return self._linearize_in_symbols(at, inputs or {}, outputs, parameters)
        from lmoc.symbolic.numeric import NumericSystem, linearize_numerically, variable

        scene, reduced, values, _ = self.prepared(parameters or {})
        if _is_run(at) and not parameters:
            reduced, values = at.reduced, at.trajectory.observer.values
        shown = list(outputs if outputs is not None else scene.outputs or reduced.state_names)
        for name in outputs or ():
            _check_output(reduced, name)
        system = NumericSystem(reduced, values, [variable(reduced, name) for name in shown])
        time = float(at) if isinstance(at, Real) else float(at.time[-1]) if _is_run(at) else 0.0
        point = self._numeric_point(system, at, inputs or {}, parameters)
        return linearize_numerically(reduced, values, point, shown, time, system)

    def _numeric_point(self, system, at, inputs: Point, parameters: Point | None) -> dict[str, float]:
        if isinstance(at, Real):
            return self._moment(system, float(at), inputs, parameters)
        if _is_run(at):
            return _last_point(at, system, inputs)
        given = _with_inputs(at, inputs)
        _check_names(given, (*system.states, *system.inputs))
        if at is not None:
            return self._numbers({name: value for name, value in given.items() if value is not None})
        if system.is_linear():
            import numpy as np

            u = np.array([float(inputs.get(name, 0.0)) for name in system.inputs])
            rest = system.rest(u)
            found = {} if rest is None else dict(zip(system.states, rest.tolist(), strict=True))
            return {**found, **inputs}
        _, reduced, values, _ = self.prepared(parameters or {})
        only = _only(_equilibria(reduced, values, {name: 0 for name in system.inputs} | dict(inputs)))
        return self._numbers({**only, **inputs}, parameters)

    def _moment(self, system, time: float, inputs: Point, parameters: Point | None) -> dict[str, float]:
        """States and inputs at a time of the default run."""
        start = self.flat.experiment.start or 0.0
        if time < start:
            message = f"the run starts at {start:g} s: there is no point at {time:g} s to be linear about"
            raise ModelError([Diagnostic("E0663", message)])
        return _last_point(self.simulate(times=sorted({start, time}), parameters=parameters), system, inputs)

    def _numbers(self, point: Point, parameters: Point | None = None) -> dict[str, float]:
        """Expressions in parameters as numbers."""
        _, _, values, _ = self.prepared(parameters or {})
        result = {}
        for name, value in point.items():
            if hasattr(value, "free_symbols"):
                known = {s: float(values[self.flat.find(s.name)[0]]) for s in value.free_symbols if s.name != name}
                value = value.subs(known)
                value = 0.0 if value.free_symbols else value  # a free state of a family stands for itself
            result[name] = float(value)
        return result

    def _linearize_in_symbols(self, at, inputs: Point, outputs, parameters) -> LinearModel:
        from lmoc.symbolic.linearize import linearize

        _, reduced, _, _ = self.prepared(parameters or {})
        for name in outputs or ():
            _check_output(reduced, name)
        system = self.symbolic(tuple(outputs or ()), parameters)
        if outputs is not None:
            system = replace(system, outputs={name: system.variables[name] for name in outputs})
        if isinstance(at, Real) or _is_run(at):
            raise ModelError(
                [Diagnostic("E0663", "a point of a run has numbers: a model in symbols needs an equilibrium or names")]
            )
        return linearize(system, symbolic_point(system, at, inputs), symbolic=True)

    def transfer_function(
        self, u: str, y: str, parameters: Point | None = None, at: Point | None = None
    ) -> TransferFunction:
        """Transfer function from an input to any variable, a rational expression in ``Symbol("s")``.

        The result can be used as the SymPy expression; it also has `poles`, `zeros`, `gain`, `cancelled`. Where a scene
        has no equations in closed form (E0660), its coefficients are numbers.

        Parameters
        ----------
        u, y : names of a top-level input and of a variable
        at : {name: value} of states (an `Equilibrium` is one) and inputs, zero where nothing is given; about which a
            nonlinear scene is taken. By default its equilibrium without inputs.
        """
        from lmoc.symbolic.linearize import linearize
        from lmoc.symbolic.transfer import index_of, transfer_function, transfer_function_of_numbers

        scene, reduced, _, _ = self.prepared(parameters or {})
        index_of(scene.inputs, u, "input")
        _check_output(reduced, y)
        try:
            system = self.symbolic((y,), parameters)
        except ModelError as error:
            if [d.code for d in error.diagnostics] != ["E0660"]:
                raise
            return transfer_function_of_numbers(self.linearize(at, outputs=[y], parameters=parameters), u, y)
        system = replace(system, outputs={y: system.variables[y]})
        if at is not None:
            at = {s.name: 0 for s in (*system.states, *system.inputs)} | dict(at)
        model = linearize(system, symbolic_point(system, at, {}), symbolic=True)
        return transfer_function(model, u, y, system.values)

    def input_output_equation(
        self, u: str, y: str, parameters: Point | None = None, at: Point | None = None
    ) -> InputOutputEquation:
        """``left(p)·y = right(p)·u`` with p = d/dt; the pair (left, right), which prints as an equation."""
        return self.transfer_function(u, y, parameters, at).input_output_equation

    def equivalent(self, port: str, other: str | None = None, parameters: Point | None = None) -> Equivalent:
        """Equivalent stiffness, damping and inertia seen at a port, against another one or the ground."""
        from lmoc.symbolic.equivalent import equivalent

        scene, _, values, _ = self.prepared(parameters or {})
        return equivalent(scene.flat, values, port, other)


def _is_run(at: object) -> bool:
    from lmoc.numerics.observe.trajectory import Trajectory

    return isinstance(getattr(at, "trajectory", None), Trajectory)


def _check_place(at: object) -> None:
    """Refuse what is no place to be linear about."""
    if not (at is None or isinstance(at, Real | Mapping) or _is_run(at)):
        expected = "a time, {name: value}, an equilibrium or a run"
        raise TypeError(f"at is {expected}, not {type(at).__name__} {at!r:.40}")


def _last_point(run: Run, system: NumericSystem, inputs: Point) -> dict[str, float]:
    """States and inputs at the end of a run."""
    if inputs:
        hint = "leave the values of the inputs out, or say where by a point {state: value}"
        raise ModelError([Diagnostic("E0663", "at a time of the run its own inputs act", hint=hint)])
    return {name: float(run[name][-1]) for name in (*system.states, *system.inputs)}


def _with_inputs(at: Point | None, inputs: Point) -> dict[str, Any]:
    """A point, with the inputs that an equilibrium was found for."""
    own = {u.name: value for u, value in getattr(at, "inputs", {}).items()}
    return {**(at or {}), **own, **inputs}


def _check_names(given: Point, known: Sequence[str]) -> None:
    for name in given:
        if name not in known:
            hint = nearest(name, known)
            raise ModelError([Diagnostic("E0661", f"'{name}' is neither a state nor an input", hint=hint)])


def _check_output(reduced: Reduced, name: str) -> None:
    """An output is something that can move, and that the equations determine; E0661 or E0660 otherwise."""
    from lmoc.ir.flat import Kind
    from lmoc.symbolic.system import refuse

    found = reduced.flat.find(name)
    if found is None or len(found) != 1:
        return  # told where it is looked up
    if reduced.flat.kind[found[0]] in (Kind.CONSTANT, Kind.PARAMETER):
        raise ModelError([Diagnostic("E0661", f"'{name}' is a parameter: no input moves it")])
    if found[0] in reduced.undetermined:
        raise refuse(f"'{name}' is not determined, because of a redundant loop")


def symbolic_point(system: SymbolicSystem, at: Point | None, inputs: Point) -> dict:
    """States and inputs about which to be linear; empty where the equations are linear anyway."""
    from lmoc.symbolic.equilibria import exactly
    from lmoc.symbolic.linearize import is_linear

    known = {s.name: s for s in (*system.states, *system.inputs)}
    given = _with_inputs(at, inputs)
    _check_names(given, list(known))
    if at is None and not is_linear(system):
        return only_equilibrium(system, inputs)
    return {known[name]: exactly(value) for name, value in given.items()}


def only_equilibrium(system: SymbolicSystem, inputs: Point) -> dict:
    """The one isolated equilibrium, inputs not given at zero. Errors as `_only`."""
    import sympy as sp

    from lmoc.symbolic.equilibria import equilibria

    at_zero = {u.name: 0 for u in system.inputs} | dict(inputs)
    found = _only(equilibria(system, at_zero))
    return {**found.values, **{sp.Symbol(n): sp.sympify(v) for n, v in at_zero.items()}}


def _only(found: list[Equilibrium]) -> Equilibrium:
    """The one that is isolated.

    Raises
    ------
    ModelError
        E0663 where there is not exactly one.
    """
    if len(found) == 1 and found[0].isolated:
        return found[0]
    if not found:
        raise ModelError([Diagnostic("E0663", "there is no equilibrium to be linear about", hint=_WHERE)])
    shown = "; ".join(f"({i}) {_point_text(e)}" for i, e in enumerate(found, 1))
    message = "there is not one equilibrium to be linear about"
    hint = f"choose one, `--equilibrium 1` or in Python `at=dae.equilibria()[0]`; or {_WHERE}"
    raise ModelError([Diagnostic("E0663", message, found=shown, hint=hint)])


_WHERE = "say where, as `--at name=value` or `at={name: value}`"


def _point_text(e: Equilibrium) -> str:
    """The coordinates that are not zero, or say that all are."""
    values = {n: f"{float(v):.6g}" if v.is_Float else str(v) for n, v in e.items()}
    return ", ".join(f"{n} = {v}" for n, v in values.items() if v != "0") or "all states 0"


def _equilibria(reduced: Reduced, values: np.ndarray, inputs: Point) -> Equilibria:
    from lmoc.symbolic.equilibria import equilibria
    from lmoc.symbolic.motion import balances
    from lmoc.symbolic.numeric import equilibria_numerically, linearize_numerically

    try:
        system = balances(reduced, values)
    except ModelError as error:
        if [d.code for d in error.diagnostics] != ["E0660"]:
            raise
        return equilibria_numerically(reduced, values, inputs)
    return equilibria(system, inputs, lambda point: linearize_numerically(reduced, values, point, ()))
