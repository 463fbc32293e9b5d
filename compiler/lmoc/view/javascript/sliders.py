"""The parameters that a page lets change: those given as numbers, which the equations read."""

from __future__ import annotations

import numpy as np

from lmoc.ir.flat import Kind
from lmoc.ir.flat import Slider as Declared
from lmoc.numerics.observe.observer import Observer
from lmoc.support.distinct import distinct
from lmoc.support.records import dataclass

_TRIED = (1.29, 0.77)  # times the value, at which the assumptions of the reduction are looked at: each costs a while
_TRIED_OF_ZERO = (0.29, -0.83)
NOTHING_SAID = Declared()


@dataclass(frozen=True)
class Slider:
    """A parameter of a page.

    Attributes
    ----------
    variable : of the flat model
    slot : where the script keeps its value
    alike : slots of the other elements of an array that have it from the same `each`
    fixed : why it cannot be changed in the page; "" where it can
    group : the part that it belongs to, "" for the model itself
    first : its declaration asks for a place among the first
    least, most, step : of its range, where the declaration says it
    """

    name: str
    variable: int
    slot: int
    value: float
    unit: str
    text: str
    fixed: str = ""
    alike: tuple[int, ...] = ()
    group: str = ""
    first: bool = False
    least: float | None = None
    most: float | None = None
    step: float | None = None


def sliders(observer: Observer, slots: np.ndarray, most: int = 100) -> list[Slider]:
    """Return independent parameters: those whose declaration asks for it, the model's own, those of its parts.

    Among each of these they stand in the order of the model, those that are zero behind the others.

    Parameters
    ----------
    slots : (flat.count,) as of `Script`
    most : of them
    """
    flat, values = observer.flat, observer.values
    found: list[Slider] = []
    together = _together(observer)

    def place(variable: int) -> tuple[bool, bool, bool]:
        block = flat.block_at(variable)
        return block.slider is None, len(block.path) > 1, bool(values[variable] == 0)

    for variable in sorted(independent(observer)[0].tolist(), key=place):
        if len(found) == most:
            break
        own = together.get(variable, (variable,))
        if variable != own[0]:
            continue
        block = flat.block_at(variable)
        numeric = block.quantity == "Real" and np.isfinite(values[variable])
        if slots[variable] < 0 or not numeric or block.protected or block.final:
            continue
        name = flat.variable_name(variable) if len(own) == 1 else ".".join(word for word, _ in block.path)
        why = "it shapes the model" if block.structural else _why_fixed(observer, own)
        value = float(values[variable])
        alike = tuple(int(s) for s in slots[list(own[1:])])
        asked = block.slider or NOTHING_SAID
        group = ".".join(word for word, _ in block.path[:-1])
        found.append(Slider(
            name, variable, int(slots[variable]), value, block.unit, block.description, why, alike, group,
            block.slider is not None, asked.min, asked.max, asked.step,
        ))  # fmt: skip
    return found


def independent(observer: Observer) -> tuple[np.ndarray, np.ndarray]:
    """Return the parameters that are bound to numbers, and those given otherwise than the model binds them."""
    flat, values = observer.flat, observer.values
    literal, given = [np.zeros(0, int)], [np.zeros(0, int)]
    for a in flat.bindings:
        if len(a.target) and flat.kind[a.target[0]] <= Kind.PARAMETER:
            bound = a.values(values)
            other = (bound != values[a.target]) & ~np.isnan(values[a.target])
            given.append(a.target[other])
            literal.append(a.target if not a.slots.shape[1] else a.target[other])
    literal = distinct(np.concatenate(literal))
    return literal[flat.kind[literal] == Kind.PARAMETER], distinct(np.concatenate(given))


def _together(observer: Observer) -> dict[int, tuple[int, ...]]:
    """Return for the elements of an array that one `each` gives a number to, all of them."""
    flat, values = observer.flat, observer.values
    given = set(independent(observer)[1].tolist())
    found = {}
    for a in flat.bindings:
        whole = len(a.target) > 1 and flat.block_at(int(a.target[0])).size == len(a.target)
        if not whole or a.slots.shape[1] or a.numbers is not None or given & set(a.target.tolist()):
            continue
        if (values[a.target] == values[a.target[0]]).all():
            found |= dict.fromkeys(a.target.tolist(), tuple(a.target.tolist()))
    return found


def _why_fixed(observer: Observer, variables: tuple[int, ...]) -> str:
    """Return which assumption of the reduction fails for other values of parameters; "" where it holds for some."""
    reduced, values = observer.plan.reduced, observer.values
    flat, own = reduced.flat, float(values[variables[0]])
    given = independent(observer)[1]
    broken = ""
    for other in [own * f for f in _TRIED] if own else _TRIED_OF_ZERO:
        overrides = dict(zip(given.tolist(), values[given].tolist(), strict=True)) | dict.fromkeys(variables, other)
        text = reduced.broken_guard(flat.parameter_values(overrides))
        if text is None:
            return ""
        broken = broken or text
    return f"the equations were reduced with {broken}"
