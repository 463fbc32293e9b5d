"""Words that an editor shows between those of the text: units of values, and what a model reduces to."""

from __future__ import annotations

from collections.abc import Iterator

from lmoc.editor import describe
from lmoc.editor.analysis import Analysis
from lmoc.editor.checking import Checked
from lmoc.editor.names import Occurrence
from lmoc.semantics.classes.choose import can_run
from lmoc.semantics.classes.place import Member
from lmoc.support.records import dataclass
from lmoc.syntax import tree
from lmoc.syntax.node import walk

COMMANDS = (("lmoc.run", "run"), ("lmoc.draw", "draw"), ("lmoc.view", "view"), ("lmoc.equations", "equations"))


@dataclass(frozen=True)
class Hint:
    """A word behind a character."""

    at: int
    text: str


def units(analysis: Analysis, names: list[Occurrence]) -> Iterator[Hint]:
    """Yield the unit behind each number that a modification or a declaration gives to a quantity."""
    of = {o.start: o for o in names}
    for node in walk(analysis.file.classes):
        if isinstance(node, tree.ElementModification | tree.Component) and node.modification is not None:
            value = node.modification.value
            if not isinstance(value, tree.Number | tree.Unary):
                continue
            start = node.name_span.start if isinstance(node, tree.Component) else _name_start(node)
            o = of.get(start)
            unit = describe.unit_of(o.meaning) if o is not None and isinstance(o.meaning, Member) else ""
            if unit and unit != "1":
                yield Hint(value.span.end, f" {unit}")


def reduction(checked: Checked | None, model: str) -> str | None:
    """Return what is shown behind the name of a model: how many states it has, if that is known."""
    counts = dict(checked.counts) if checked is not None else {}
    n = dict(counts.get(model, ())).get("states")
    return None if n is None else f"  {n} state{'s' * (n != 1)}"


def runnable(analysis: Analysis) -> Iterator[tuple[tree.Class, str]]:
    """Yield the models of a text that can be run, with their full names."""
    for definition in analysis.classes():
        scope = analysis.scopes.get(definition.name_span.start)
        if scope is not None and scope.kind == "model" and can_run(scope) and not _has_open_ports(scope):
            yield definition, scope.full_name


def _has_open_ports(scope: object) -> bool:
    """A model with connectors is a part."""
    return bool(describe.ports(scope))  # type: ignore[arg-type]


def _name_start(argument: tree.ElementModification) -> int:
    text, at = argument.span.text, 0
    for word in ("each", "final"):
        while text[at:].lstrip().startswith(word + " "):
            at += len(text[at:]) - len(text[at:].lstrip()) + len(word)
    at += len(text[at:]) - len(text[at:].lstrip())
    if len(argument.name) > 1:
        at += text[at:].rfind(argument.name[-1], 0, text[at:].find("=") if "=" in text[at:] else None)
    return argument.span.start + at
