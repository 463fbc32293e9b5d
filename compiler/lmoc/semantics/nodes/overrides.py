"""Parameter values that the caller gives: the outermost modification of all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from lmoc.expression import dag
from lmoc.ir.flat import Assignments, Kind
from lmoc.ir.names import hint_among
from lmoc.ir.paths import parse_name
from lmoc.messages.diagnostics import Report, nearest
from lmoc.semantics.nodes.instance import ATTRIBUTES, Broken, Instance, Modifier, Variable
from lmoc.semantics.nodes.modification import given

Path = tuple[str, ...]


class Overrides:
    """Values for whole declarations become a modifier; values for single elements of arrays replace single rows.

    Attributes
    ----------
    given : as the caller said
    elements : {names of the path: [(subscripts of all dimensions, value)]}
    """

    def __init__(self, parameters: Mapping[str, object]):
        self.given = dict(parameters)
        self.whole: dict[Path, np.ndarray] = {}
        self.elements: dict[Path, list[tuple[tuple, np.ndarray]]] = {}
        self._names: dict[Path, str] = {}
        self._unreadable: list[str] = []
        self._no_numbers: list[str] = []
        for name, value in parameters.items():
            parsed = parse_name(name)
            if parsed is None:
                self._unreadable.append(name)
                continue
            try:
                value = np.asarray(value, float)
            except (TypeError, ValueError):
                self._no_numbers.append(name)
                continue
            path = tuple(n for n, _ in parsed)
            self._names[path] = name
            if any(subscripts for _, subscripts in parsed):
                self.elements.setdefault(path, []).append((tuple(s for _, s in parsed), value))
            else:
                self.whole[path] = value

    def modifier(self) -> Modifier:
        """The values of whole declarations, as a modification of the model."""
        tree: dict = {}
        for path, value in self.whole.items():
            at = tree
            for name in path:
                at = at.setdefault(name, {})
            at[None] = value
        return _modifier(tree)

    def check(self, root: Instance, report: Report) -> None:
        """Every name must be a parameter of the model."""
        known = [v for v in root.variables() if v.kind == Kind.PARAMETER]
        labels = [v.label for v in known]
        for name in self._unreadable:
            report.error("E0622", f"'{name}' is not a name", hint=nearest(name, labels))
        for name in self._no_numbers:
            report.error("E0301", f"the value given for '{name}' is not a number", found=repr(self.given[name]))
        for path in (*self.whole, *self.elements):
            name = self._names[path]
            found = _walk(root, path)
            if isinstance(found, Broken):
                continue  # it has been said what is wrong with it
            if not isinstance(found, Variable):
                hint = self._attribute_hint(root, path)
                hint = hint or hint_among(dict(zip(labels, labels, strict=True)), ".".join(path))
                report.error("E0622", f"the model has no parameter '{name}'", hint=hint)
            elif found.kind != Kind.PARAMETER:
                span = root.children[path[0]].name_span  # in the user's text; its own may be the library's
                report.error("E0622", f"'{name}' is not a parameter", span, hint=_other_way(name, found, self.given))
            elif found.final:
                report.error("E0206", f"'{name}' is final: its value follows from others", found.span)
            elif path in self.whole:
                self._check_value(name, found, report)
            else:
                for subscripts, value in self.elements[path]:
                    self._check_type(name, found, value, report)
                    if element_positions(found, subscripts) is None:
                        report.error("E0215", f"there is no '{name}'", found.span, expected=str(list(found.total)))

    def _attribute_hint(self, root: Instance, path: Path) -> str:
        """Return what to do instead of setting an attribute; empty where the name is none of a variable."""
        variable = _walk(root, path[:-1])
        if not isinstance(variable, Variable) or path[-1] not in ATTRIBUTES:
            return ""
        if path[-1] == "start" and variable.kind == Kind.UNKNOWN:
            name = self._names[path]
            return _other_way(name.removesuffix(".start"), variable, {name.removesuffix(".start"): self.given[name]})
        return f"'{path[-1]}' is an attribute: it is set in the model, {variable.label}({path[-1]} = …)"

    def _check_type(self, name: str, found: Variable, value: np.ndarray, report: Report) -> None:
        expected = other_type(found.type.name, value)
        if expected:
            report.error("E0301", f"'{name}' must be {expected}", found.span, found=str(self.given[name]))

    def _check_value(self, name: str, found: Variable, report: Report) -> None:
        value = self.whole[tuple(n for n, _ in parse_name(name))]
        self._check_type(name, found, value, report)
        shape = value.shape
        if shape not in ((), found.total):
            report.error("E0302", f"the value given for '{name}' has the wrong size", found.span,
                         expected=str(list(found.total)), found=str(list(shape)))  # fmt: skip

    def apply(self, bindings: list[Assignments], root: Instance) -> list[Assignments]:
        """The bindings with the values of single elements in place."""
        for path, items in self.elements.items():
            variable = _walk(root, path)
            if not isinstance(variable, Variable):
                continue
            for subscripts, value in items:
                where = element_positions(variable, subscripts)
                if where is None:
                    continue
                target = variable.offset + where
                bindings = [b for old in bindings if (b := _without(old, target)) is not None]
                numbers = np.broadcast_to(np.asarray(value, float), target.shape)
                for t, x in zip(target, numbers):
                    bindings.append(Assignments(np.array([t]), dag.const(float(x)), np.zeros((1, 0), int)))
        return bindings


def _other_way(name: str, found: Variable, given: Mapping[str, object]) -> str:
    """Return a hint on how a variable that is not a parameter gets a value."""
    value = given[name]
    value = f"{value:g}" if isinstance(value, float) else value
    if found.kind == Kind.INPUT and found.parent is not None and found.parent.parent is None:
        return f"it is an input: --input {name}={value}, or inputs={{'{name}': {value}}}"
    if found.kind != Kind.UNKNOWN:
        return "only parameters can be given a value from outside"
    return f"a start value: --init {name}={value}, or initial={{'{name}': {value}}}"


def other_type(type_: str, value: np.ndarray) -> str:
    """Describe what a parameter of this type must be, if a number given to it is not; empty where it is valid."""
    if type_ == "Boolean":
        return "true or false" if np.any((value != 0) & (value != 1)) else ""
    if type_ == "Real" or not np.any(value != np.round(value)):
        return ""
    return "an integer" if type_ == "Integer" else "a literal's number"


def _modifier(tree: dict) -> Modifier:
    value = tree.pop(None, None)
    inside = {name: _modifier(inner) for name, inner in tree.items()}
    return Modifier(given(value).value if value is not None else None, inside)


def _walk(root: Instance, path: Path):
    node = root
    for name in path:
        node = node.children.get(name) if isinstance(node, Instance) else None
    return node


def element_positions(variable: Variable, subscripts: tuple[tuple, ...]) -> np.ndarray | None:
    """Flat positions of the elements with these subscripts at each name of the path; None where there are none."""
    key: list[int | slice] = []
    for own, (_, dims) in zip(subscripts, variable.path):
        if own and len(own) != len(dims):
            return None
        for item, n in zip(own or ((1, None),) * len(dims), dims):
            low, high = item if isinstance(item, tuple) else (item, item)
            high = n if high is None else high
            if not 1 <= low <= high <= n:
                return None
            key.append(slice(low - 1, high))
    positions = np.arange(variable.size).reshape(variable.total)
    return positions[tuple(key)].reshape(-1)


def _without(a: Assignments, target: np.ndarray) -> Assignments | None:
    keep = ~np.isin(a.target, target)
    if keep.all():
        return a
    if not keep.any():
        return None
    numbers = a.numbers[keep] if a.numbers is not None else None
    return replace(a, target=a.target[keep], slots=a.slots[keep], numbers=numbers)
