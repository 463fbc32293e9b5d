"""What a name is, in words: for hovers, completions and signatures."""

from __future__ import annotations

from collections.abc import Iterator

from lmoc.editor.names import Meaning, Occurrence, type_of
from lmoc.semantics.classes.place import Member
from lmoc.semantics.classes.predefined import Builtin
from lmoc.semantics.classes.scope import Scope
from lmoc.semantics.mistakes.wrong import Wrong
from lmoc.syntax import tree

FUNCTIONS = {
    "der": "der(x): the time derivative of x",
    "pre": "pre(x): the value of x just before an event",
    "edge": "edge(b): true at the instant at which b becomes true",
    "change": "change(x): true at the instant at which x changes",
    "initial": "initial(): true at the start",
    "terminal": "terminal(): true at the end of a run that succeeds",
    "sample": "sample(start, interval): true at start + k*interval",
    "reinit": "reinit(x, value): x jumps to a value; inside of `when`",
    "assert": "assert(condition, message, level): ends the run, or warns, where the condition does not hold",
    "terminate": "terminate(message): ends the run here",
    "noEvent": "noEvent(e): relations in e make no events",
    "smooth": "smooth(p, e): e has p continuous derivatives",
    "connect": "connect(a, b): the two connectors are joined",
    "sin": "sin(x)", "cos": "cos(x)", "tan": "tan(x)", "asin": "asin(x)", "acos": "acos(x)", "atan": "atan(x)",
    "atan2": "atan2(y, x)", "sinh": "sinh(x)", "cosh": "cosh(x)", "tanh": "tanh(x)", "exp": "exp(x)",
    "log": "log(x): natural logarithm", "log10": "log10(x)", "sqrt": "sqrt(x)", "abs": "abs(x)", "sign": "sign(x)",
    "min": "min(x, y) or min(array)", "max": "max(x, y) or max(array)", "sum": "sum(array) or sum(e for i in range)",
    "product": "product(array)", "mod": "mod(x, y)", "rem": "rem(x, y)", "div": "div(x, y)", "floor": "floor(x)",
    "ceil": "ceil(x)", "integer": "integer(x)", "size": "size(array, k)", "array": "array(a, b, …): {a, b, …}",
    "fill": "fill(value, n, …)",
    "zeros": "zeros(n, …)", "ones": "ones(n, …)", "linspace": "linspace(a, b, n)", "vector": "vector(a)",
    "scalar": "scalar(a)", "transpose": "transpose(a)", "cross": "cross(a, b)",
    "homotopy": "homotopy(actual, simplified)",
}  # fmt: skip


def markdown(occurrence: Occurrence) -> str:
    """Return what is known of a name, as Markdown."""
    meaning = occurrence.meaning
    if isinstance(meaning, Member):
        return _component(meaning)
    if isinstance(meaning, Scope):
        return _class(meaning)
    if isinstance(meaning, Builtin):
        listed = f"\n\n{', '.join(meaning.literals)}" if meaning.literals else ""
        return f"```modelica\ntype {meaning.name}\n```\npredefined{listed}"
    return f"```modelica\nfor {meaning.name}\n```\nindex of a loop"


def one_line(meaning: Meaning) -> str:
    """Return class, unit and value of a component, or the kind of a class, in a line."""
    if isinstance(meaning, Member):
        unit, value = unit_of(meaning), _value(meaning)
        return str(meaning.component.type) + (f" = {value}" if value else "") + (f"  [{unit}]" if unit else "")
    if isinstance(meaning, Scope):
        return f"{'partial ' * meaning.definition.partial}{meaning.kind}" if meaning.definition else "package"
    return "type" if isinstance(meaning, Builtin) else "index"


def description(meaning: Meaning) -> str:
    """Return what its declaration says of it."""
    if isinstance(meaning, Member):
        return meaning.component.description
    return meaning.definition.description if isinstance(meaning, Scope) and meaning.definition else ""


def unit_of(member: Member) -> str:
    """Return the unit of a component: of the outermost declaration that gives one; empty where there is none."""
    for argument, _ in member.outer:
        if isinstance(argument, tree.ElementModification):
            found = _attribute(argument.modification, "unit")
            if found:
                return found
    found = _attribute(member.component.modification, "unit")
    if found:
        return found
    try:
        steps = member.scope.type_of(member.component).steps
    except Wrong:
        return ""
    return next((unit for short, _ in steps if (unit := _attribute(short.modification, "unit"))), "")


def parameters(scope: Scope) -> Iterator[Member]:
    """Yield the parameters of a class that a modification can set."""
    for member in elements(scope):
        if isinstance(member, Member) and member.component.variability == "parameter" and not member.protected:
            yield member


def elements(scope: Scope) -> list[Member | Scope]:
    """Return own and inherited elements of a class; none of one that cannot be understood."""
    try:
        return list(scope.table.values())
    except Wrong:
        return []


def ports(scope: Scope) -> list[Member]:
    """Return the connectors of a class."""
    found = [m for m in elements(scope) if isinstance(m, Member) and not m.protected]
    return [m for m in found if isinstance(c := type_of(m), Scope) and c.kind == "connector"]


def _attribute(modification: tree.Modification | None, name: str) -> str:
    for argument in modification.arguments if modification else ():
        if isinstance(argument, tree.ElementModification) and argument.name == (name,) and argument.modification:
            value = argument.modification.value
            return value.value if isinstance(value, tree.String) else ""
    return ""


def _value(member: Member) -> str:
    value, _ = member.value
    text = value.span.text if value is not None and getattr(value, "span", None) is not None else ""
    return " ".join(text.split()) if len(text) <= 200 else ""


def _prefixes(c: tree.Component) -> str:
    words = ("flow" * c.flow, c.variability, c.causality, "inner" * c.inner, "outer" * c.outer)
    return "".join(f"{w} " for w in words if w)


def _component(member: Member) -> str:
    c = member.component
    value = _value(member)
    dims = f"[{', '.join(d.span.text for d in c.dimensions)}]" if c.dimensions else ""
    lines = ["```modelica", f"{_prefixes(c)}{c.type} {c.name}{dims}" + (f" = {value}" if value else ""), "```"]
    unit = unit_of(member)
    lines += [
        text for text in (c.description, f"unit: `{unit}`" if unit else "", f"in `{member.scope.full_name}`") if text
    ]
    cls = type_of(member)
    if isinstance(cls, Scope):
        lines += ["", *_equations(cls)]
    return "\n\n".join(["\n".join(lines[:3]), *lines[3:]])


def _class(scope: Scope) -> str:
    d = scope.definition
    if d is None:
        return "```modelica\npackage\n```"
    head = f"```modelica\n{'partial ' * d.partial}{d.kind} {scope.full_name}\n```"
    lines = [head, d.description] if d.description else [head]
    rows = [f"| `{m.component.name}` | {one_line(m)} | {m.component.description} |" for m in parameters(scope)]
    if rows:
        lines.append("\n".join(["| parameter | | |", "| --- | --- | --- |", *rows]))
    joined = [f"`{m.component.name}`" for m in ports(scope)]
    if joined:
        lines.append("ports: " + ", ".join(joined))
    return "\n\n".join([*lines, *_equations(scope)])


def _equations(scope: Scope) -> list[str]:
    """The equations of a part, its own and those it inherits; none of a long one."""
    try:
        classes = list(scope.lineage())
    except Wrong:
        return []
    written = [e.span.text.strip().rstrip(";") for c in classes if c.definition for e in c.definition.equations]
    written = [" ".join(w.split()) for w in written if not w.startswith("connect")]
    return ["```modelica\n" + "\n".join(written) + "\n```"] if 0 < len(written) <= 12 else []
