"""The variables of an FMU: what they are called, what they mean, and where their values stand."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from lmoc.export.instants import Instants
from lmoc.ir.flat import Kind
from lmoc.numerics.plan.plan import Plan
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from lmoc.dae import CompiledDAE


class Place(IntEnum):
    """Where the value of a variable stands (``export/c/fmu.h``)."""

    PARAMETER = 0
    DERIVED = 1
    STATE = 2
    INPUT = 3
    DERIVATIVE = 4
    OBSERVED = 5
    DISCRETE = 6
    INDICATOR = 7


class Type(IntEnum):
    """What kind of values a variable has; enumerations are numbers."""

    REAL = 0
    INTEGER = 1
    BOOLEAN = 2


@dataclass(frozen=True)
class Variable:
    """A variable of an FMU.

    Attributes
    ----------
    place, index : where its value stands: which parameter, state, input or derivative; or a register
    register : of the plan; -1 for parameters and event indicators
    causality, variability, initial : as FMI calls them
    state : of a derivative, which state it is of; else -1
    """

    name: str
    place: Place
    index: int
    register: int
    causality: str
    variability: str
    initial: str
    unit: str = ""
    description: str = ""
    state: int = -1
    type: Type = Type.REAL


def listed(
    dae: CompiledDAE,
    plan: Plan,
    inputs: np.ndarray,
    exported: np.ndarray,
    settable: np.ndarray,
    events: Instants,
    more: Sequence[str] = (),
) -> tuple[Variable, ...]:
    """Return all variables: parameters, states, inputs, what is observed, derivatives, event indicators.

    Parameters
    ----------
    inputs : registers that are set from outside
    exported : (plan.count,) registers that have values
    settable : flat variables of parameters that can be set
    events : which variables are discrete
    more : what event indicators tell of behind those of `events`
    """
    reduced, flat = plan.reduced, dae.flat
    found: list[Variable] = []
    table = reduced.registers
    state_of = {int(r): i for i, r in enumerate(plan.states)}
    input_of = {int(r): i for i, r in enumerate(inputs)}
    derivative_of = {state_of[int(r)]: i for i, r in enumerate(plan.derivatives) if int(r) in state_of}
    owner = {i: int(table.variable[r]) if table.order[r] == 0 else -1 for r, i in state_of.items()}
    place_of = {int(v): k for k, v in enumerate(settable)}
    bound = {int(v) for a in flat._parameter_bindings[1] for v in a.target}
    seen: set[int] = set()
    discrete = {} if flat.events is None else {int(v): k for k, v in enumerate(flat.events.discrete)}
    register_of = reduced.register_of.copy()
    register_of[reduced.inputs[1][reduced.inputs[2] == 0]] = reduced.inputs[0][reduced.inputs[2] == 0]
    for block in flat.blocks:
        if block.protected or (block.quantity != "Real" and block.kind != Kind.DISCRETE) or block.quantity == "String":
            continue
        for position in range(block.size):
            v = block.offset + position
            said = block.name(position), block.unit, block.description
            if block.kind <= Kind.PARAMETER:
                if np.isfinite(dae.values[v]):
                    found.append(_parameter(said, v, place_of, plan.count, v in bound))
                continue
            register = int(register_of[v])
            if register < 0:
                continue
            causality = "output" if block.output else "local"
            if v in discrete:
                own = Place.DISCRETE, discrete[v], register, causality, "discrete", "calculated"
                found.append(Variable(said[0], *own, *said[1:], type=_type(block.quantity)))
                continue
            i = state_of.get(register, -1)
            if register in input_of and table.variable[register] == v and table.order[register] == 0:
                own = Place.INPUT, input_of[register], register, "input", "continuous", ""
            elif i >= 0 and owner[i] in (v, -1) and i not in seen:
                seen.add(i)
                own = Place.STATE, i, register, causality, "continuous", "exact"
            elif exported[register]:
                own = Place.OBSERVED, register, register, causality, "continuous", "calculated"
            else:
                continue
            found.append(Variable(said[0], *own, *said[1:], derivative_of.get(i, -1) if own[0] == Place.STATE else -1))
    found += _helpers(plan, found, seen, input_of, derivative_of)
    return tuple(found + _indicators(found, (*events.indicator_texts, *more)))


def _type(quantity: str) -> Type:
    return {"Real": Type.REAL, "Boolean": Type.BOOLEAN}.get(quantity, Type.INTEGER)


def _indicators(found: list[Variable], texts: Sequence[str]) -> list[Variable]:
    """Return the functions whose change of sign is an event."""
    names, more = {v.name for v in found}, []
    for k, text in enumerate(texts):
        name = f"event indicator {k + 1}"
        while name in names:
            name += "'"
        own = Place.INDICATOR, k, -1, "local", "continuous", "calculated"
        more.append(Variable(name, *own, description=text))
    return more


def _parameter(
    said: tuple[str, str, str], variable: int, place_of: dict[int, int], count: int, bound: bool
) -> Variable:
    name, unit, description = said
    if variable in place_of:
        own = Place.PARAMETER, place_of[variable], -1, "parameter", "tunable", "exact"
    elif bound:
        own = Place.DERIVED, count + variable, -1, "calculatedParameter", "tunable", "calculated"
    else:
        own = Place.DERIVED, count + variable, -1, "local", "fixed", "calculated"
    return Variable(name, *own, unit, description)


def _helpers(
    plan: Plan,
    found: list[Variable],
    seen: set[int],
    input_of: dict[int, int],
    derivative_of: dict[int, int],
) -> list[Variable]:
    """Return states, inputs and derivatives that no variable of the flat model stands for."""
    more: list[Variable] = []
    reduced, names = plan.reduced, {v.name for v in found}

    def unique(name: str) -> str:
        own = name if not name.startswith("#") else f"helper{name[1:]}"
        while own in names:
            own += "'"
        names.add(own)
        return own

    for i, register in enumerate(plan.states.tolist()):
        if i not in seen:
            name, of = unique(reduced.register_name(register)), derivative_of.get(i, -1)
            more.append(Variable(name, Place.STATE, i, register, "local", "continuous", "exact", state=of))
    have = {v.index for v in found if v.place == Place.INPUT}
    for register, i in input_of.items():
        if i not in have:
            name = unique(reduced.register_name(register))
            why = "the derivative of an input, which the motion that it prescribes depends on"
            more.append(Variable(name, Place.INPUT, i, register, "input", "continuous", "", description=why))
    name_of = {v.index: v.name for v in (*found, *more) if v.place == Place.STATE}
    direct = set(derivative_of.values())
    for i, register in enumerate(plan.derivatives.tolist()):
        if i not in direct:
            name = unique(f"der({name_of[i]})")
            more.append(Variable(name, Place.DERIVATIVE, i, register, "local", "continuous", "calculated", state=i))
    return more
