"""Symbolic results as functions of a `Prepared`: one for each kind that a textbook shows.

Symbols are plain ``sympy.Symbol("dotted.name")``; an input's derivative is ``Symbol("der(u)")``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.flat import Kind
from lmoc.ir.names import names_of
from lmoc.ir.prepared import Prepared
from lmoc.ir.reduced import Reduced
from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.symbolic import places
from lmoc.symbolic.places import Moment, Point
from lmoc.symbolic.released import Released
from lmoc.symbolic.system import SymbolicSystem, refuse, symbolic_system
from lmoc.symbolic.too_long import NoSymbolsError
from lmoc.symbolic.values import exactly, read_values

if TYPE_CHECKING:
    import sympy

    from lmoc.symbolic.equilibria import Equilibria
    from lmoc.symbolic.linearize import LinearModel
    from lmoc.symbolic.numeric import NumericSystem
    from lmoc.symbolic.transfer import TransferFunction

def symbolic(prepared: Prepared, variables: str | Sequence[str] = ()) -> SymbolicSystem:
    """Return the solved system, with the expressions of further variables.

    Raises
    ------
    ModelError
        E0660: the scene has laws, or no solved form in symbols. E0661: an unknown name.
    """
    if prepared.flat.laws:
        raise refuse(
            "a scene with laws has other equations in each of its modes",
            hint="equations() gives those of each mode that the run meets, linearize(at=…) numbers in one of them",
        )
    return symbolic_system(prepared.reduced, prepared.values, names_of(variables))


def equilibria(prepared: Prepared, inputs: Point | None = None, released: Released | None = None) -> Equilibria:
    """Return the states of rest for constant inputs.

    Inputs not given stay symbols as long as the equations can be solved in symbols, otherwise they are zero. A scene
    for which symbols are too much gets those that are found in numbers; closed loops are searched in all of their
    coordinates where `released` is given.

    Raises
    ------
    ModelError
        E0661 an unknown name, E0521 or E0621 a value that does not fit, E0660 time in the equations.
    """
    from lmoc.symbolic.equilibria import equilibria
    from lmoc.symbolic.motion import balances
    from lmoc.symbolic.numeric import linearize_numerically
    from lmoc.symbolic.rests import equilibria_numerically

    places.check_names(inputs or {}, prepared.inputs)
    given = read_values(inputs or {}, prepared.flat)
    reduced, values = prepared.reduced, prepared.values
    try:
        system = balances(reduced, values)
        return equilibria(system, given, lambda point: linearize_numerically(reduced, values, point, ()))
    except NoSymbolsError:
        return equilibria_numerically(prepared, places.numbers(prepared, given), released)


def linearize(
    prepared: Prepared,
    at: Moment | Point | None = None,
    symbolic: bool = False,
    inputs: Point | None = None,
    outputs: str | Sequence[str] | None = None,
    released: Released | None = None,
) -> LinearModel:
    """Return the linear model A, B, C, D.

    Parameters
    ----------
    at : where: a moment of a run or {name: value} of states and inputs; by default the equilibrium
    symbolic : matrices in symbols; otherwise in numbers, for a scene of any size
    inputs : constant values of the inputs at the equilibrium, {name: value}
    outputs : names of variables; by default the scene's outputs, else its states, rates without a name left out
    released : gives the reductions in other coordinates of closed loops

    Raises
    ------
    ModelError
        E0660 symbols are too much, E0661 an unknown name, E0662 a parameter without a value, E0663 several equilibria
        or none to choose, or no derivative there.
    """
    from lmoc.symbolic.numeric import NumericSystem, linearize_numerically, variable

    if released is not None and not symbolic:
        prepared, at = _at_rest_of_loops(prepared, at, inputs or {}, released)
    reduced, values = prepared.reduced, prepared.values
    outputs = names_of(outputs)
    for name in outputs or ():
        check_output(reduced, name)
    if symbolic:
        return _linearize_in_symbols(prepared, at, inputs or {}, outputs, released)
    named = [name for name in reduced.state_names if reduced.flat.find(name) is not None]
    shown = list(outputs if outputs is not None else prepared.outputs or named)
    system = NumericSystem(reduced, values, [variable(reduced, name) for name in shown])
    point = _numeric_point(prepared, system, at, inputs or {})
    time = at.time if isinstance(at, Moment) else 0.0
    return linearize_numerically(reduced, values, point, shown, time, system)


def _at_rest_of_loops(
    prepared: Prepared, at: Moment | Point | None, inputs: Point, released: Released
) -> tuple[Prepared, Moment | Point | None]:
    """Return a scene at a state of rest of closed loops in coordinates that serve there; others as they are."""
    from lmoc.symbolic.equilibria import Equilibrium
    from lmoc.symbolic.numeric import NumericSystem

    if prepared.reduced.invariants is None:
        return prepared, at
    if at is None and not NumericSystem(prepared.reduced, prepared.values, ()).is_linear():
        at = places.only(equilibria(prepared, dict.fromkeys(prepared.inputs, 0) | dict(inputs), released))
    if not isinstance(at, Equilibrium) or at.model is None or set(at) <= set(prepared.reduced.state_names):
        return prepared, at
    place = {name: places.number(prepared, value, {s.name for s in at.free}) for name, value in at.items()}
    there = replace(prepared, reduced=released.at(prepared.flat, prepared.values, place))
    point = {name: place.get(name, 0.0) for name in there.reduced.state_names}
    return there, point | {s.name: v for s, v in at.inputs.items()}


def _numeric_point(prepared: Prepared, system: NumericSystem, at: Moment | Point | None, inputs: Point) -> Point:
    if isinstance(at, Moment):
        return places.at_moment(at, inputs)
    places.check_names(inputs, system.inputs)
    inputs = read_values(inputs, prepared.flat)
    if at is not None:
        given = places.with_inputs(at, inputs)
        places.check_names(given, (*system.states, *system.inputs))
        return places.numbers(prepared, read_values(given, prepared.flat))
    fixed = places.numbers(prepared, inputs)
    if system.is_linear():
        u = np.array([fixed.get(name, 0.0) for name in system.inputs])
        rest = system.rest(u)
        found = {} if rest is None else dict(zip(system.states, rest.tolist(), strict=True))
        return {**found, **fixed}
    rest = places.only(equilibria(prepared, {name: 0 for name in system.inputs} | fixed))
    return {**places.numbers(prepared, rest), **fixed}


def _linearize_in_symbols(
    prepared: Prepared,
    at: Moment | Point | None,
    inputs: Point,
    outputs: tuple[str, ...] | None,
    released: Released | None,
) -> LinearModel:
    from lmoc.symbolic.linearize import linearize

    if isinstance(at, Moment):
        raise places.no_place("a point of a run has numbers: a model in symbols needs an equilibrium or names")
    try:
        system = symbolic_system(prepared.reduced, prepared.values, outputs or ())
    except NoSymbolsError:
        if released is None or prepared.reduced.invariants is None:
            raise
        return _linearize_loops(prepared, at, inputs, outputs, released)
    if outputs is not None:
        system = replace(system, outputs={name: system.variables[name] for name in outputs})
    return linearize(system, symbolic_point(prepared, system, at, inputs), symbolic=True)


def _linearize_loops(
    prepared: Prepared, at: Point | None, inputs: Point, outputs: tuple[str, ...] | None, released: Released
) -> LinearModel:
    """Return the linear model of closed loops in symbols; without a place, about the one equilibrium there is."""
    from lmoc.symbolic.loops import linearize_loops

    given = places.with_inputs(at, inputs)
    states = prepared.reduced.state_names
    places.check_names(given, (*states, *prepared.inputs))
    if at is None:
        rest = places.only(equilibria(prepared, dict.fromkeys(prepared.inputs, 0) | given, released))
        given = places.with_inputs(rest, given)
    point = dict.fromkeys((*states, *prepared.inputs), exactly(0)) | read_values(given, prepared.flat)
    shown = list(outputs if outputs is not None else prepared.outputs or states)
    return linearize_loops(prepared, released.everywhere(prepared), point, shown)


def transfer_function(
    prepared: Prepared, u: str, y: str, at: Moment | Point | None = None, released: Released | None = None
) -> TransferFunction:
    """Return the transfer function from an input to any variable, a rational expression in ``Symbol("s")``.

    Where a scene has no equations in closed form, or they grow long, its coefficients are numbers.

    Parameters
    ----------
    u, y : names of a top-level input and of a variable
    at : where a nonlinear scene is taken; zero where nothing is given. By default its equilibrium without inputs.
    released : as of `linearize`

    Raises
    ------
    ModelError
        E0660 to E0663, as `linearize`.
    """
    from lmoc.symbolic.linearize import linearize as linearize_in_symbols
    from lmoc.symbolic.transfer import index_of, transfer_function, transfer_function_of_numbers

    index_of(prepared.inputs, u, "input")
    check_output(prepared.reduced, y)
    if isinstance(at, Moment):
        return transfer_function_of_numbers(linearize(prepared, at, outputs=y), u, y)
    try:
        system = symbolic_system(prepared.reduced, prepared.values, (y,))
        system = replace(system, outputs={y: system.variables[y]})
        if at is not None:
            at = {s.name: 0 for s in (*system.states, *system.inputs)} | dict(at)
        model = linearize_in_symbols(system, symbolic_point(prepared, system, at, {}), symbolic=True)
        return transfer_function(model, u, y, system.values)
    except NoSymbolsError:
        return _of_loops(prepared, u, y, at, released) or transfer_function_of_numbers(
            linearize(prepared, at, outputs=y, released=released), u, y
        )


def _of_loops(
    prepared: Prepared, u: str, y: str, at: Point | None, released: Released | None
) -> TransferFunction | None:
    """Return the transfer function of closed loops in symbols; None where there is none that could be read."""
    from lmoc.symbolic.transfer import transfer_function_of_loops

    if released is None or prepared.reduced.invariants is None:
        return None
    try:
        return transfer_function_of_loops(_linearize_loops(prepared, at, {}, (y,), released), u, y)
    except NoSymbolsError:
        return None


def check_output(reduced: Reduced, name: str) -> None:
    """An output is something that can move, and that the equations determine; E0661 or E0660 otherwise."""
    found = reduced.flat.find(name)
    if found is None or len(found) != 1:
        return  # reported where it is looked up
    if reduced.flat.kind[found[0]] in (Kind.CONSTANT, Kind.PARAMETER):
        raise ModelError([Diagnostic("E0661", f"'{name}' is a parameter: no input moves it")])
    if found[0] in reduced.undetermined:
        raise refuse(f"'{name}' is not determined, because of a redundant loop")


def symbolic_point(prepared: Prepared, system: SymbolicSystem, at: Point | None, inputs: Point) -> dict:
    """Return states and inputs about which to be linear; empty where the equations are linear anyway."""
    from lmoc.symbolic.linearize import is_linear

    known = {s.name: s for s in (*system.states, *system.inputs)}
    given = places.with_inputs(at, inputs)
    places.check_names(given, list(known))
    if at is None and not is_linear(system):
        return _only_equilibrium(prepared, system, inputs)
    return {known[name]: value for name, value in read_values(given, prepared.flat).items()}


def _only_equilibrium(prepared: Prepared, system: SymbolicSystem, inputs: Point) -> dict[sympy.Symbol, sympy.Expr]:
    """The one equilibrium, inputs not given at zero. Errors as `places.only`."""
    at_zero = {u.name: 0 for u in system.inputs} | dict(inputs)
    rest = places.only(equilibria(prepared, at_zero))
    return {**rest.values, **places.values_by_symbol(read_values(at_zero, prepared.flat))}
