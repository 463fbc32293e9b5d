"""Actions of the grammar's rules for files, classes, components and modifications."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from lmoc.messages.diagnostics import Label
from lmoc.messages.source import Span
from lmoc.syntax import tree
from lmoc.syntax.expressions import Comment, Subscripts, Word
from lmoc.syntax.prefixes import EXCLUSIVE, OF_CLASSES, OF_COMPONENTS, PrefixActions


class Condition(tuple):
    """The condition of a component, alone in a tuple."""


Constraint = namedtuple("Constraint", "base modification comment")
Declaration = namedtuple("Declaration", "name dimensions modification condition comment")
Section = namedtuple("Section", "kind items")  # what stands below a word, by the name of the grammar's rule


def _first(values: list, kind: type) -> Any:
    """Return the first value of a type, or None: distinguishes optional symbols."""
    return next((value for value in values if isinstance(value, kind)), None)


def _flat(items: list) -> Iterator:
    """The items, those of a component clause one by one."""
    for item in items:
        if type(item) is list:
            yield from item
        else:
            yield item


class Actions(PrefixActions):
    """All rules of the grammar."""

    # ------------------------------------------------------------- file

    def file(self, v: list, start: int, end: int) -> tree.File:
        within = v[0] if v and isinstance(v[0], tuple) else ()
        classes = tuple([c for c in v if isinstance(c, tree.Class)])
        return tree.File(within, classes, self.span(0, len(self.source.text)))

    def within(self, v: list, start: int, end: int) -> tuple[str, ...]:
        return tuple([n.text for n in v[0]]) if v else ()

    # ------------------------------------------------------------- classes

    def class_kind(self, v: list, start: int, end: int) -> Word:
        return Word(v[0], start, end)

    def class_definition(self, v: list, start: int, end: int) -> tree.Class:
        prefixes, kind, body = v[:3]
        self._refuse(prefixes, OF_COMPONENTS, f"a {kind.text}")
        if kind.text != "connector":
            self._refuse(prefixes, {"expandable"}, f"a {kind.text}")
        if kind.text != "function":
            self._refuse(prefixes, {"pure"}, f"a {kind.text}")
        return self._class(prefixes, kind.text, body, _first(v[3:], Constraint), start, end)

    def _class(
        self, prefixes: dict, kind: str, body: dict, constraint: Constraint | None, start: int, end: int
    ) -> tree.Class:
        name = body["name"]
        if "outer" in prefixes:
            word = prefixes["outer"]
            self.report.error("E0116", f"a {kind} that is 'outer' is not part of lmo", self.span(word.start, word.end),
                              hint="make it 'replaceable' and redeclare it where it is used")  # fmt: skip
        if constraint:  # a comment after `constrainedby` describes the class
            body["description"] = body.get("description") or constraint.comment.description
            body["annotation"] = body.get("annotation") or constraint.comment.annotation
        fields = {
            "description": "",
            "elements": (),
            "equations": (),
            "initial_equations": (),
            "statements": (),
            "initial_statements": (),
            "annotation": None,
            "short": None,
            "literals": None,
            **body,
            "name": name.text,
        }
        return tree.Class(
            kind=kind,
            partial="partial" in prefixes,
            encapsulated="encapsulated" in prefixes,
            pure="pure" in prefixes,
            expandable="expandable" in prefixes,
            final="final" in prefixes,
            inner="inner" in prefixes,
            outer="outer" in prefixes,
            replaceable="replaceable" in prefixes,
            redeclare="redeclare" in prefixes,
            protected=False,
            span=self.span(start, end),
            name_span=self.span(name.start, name.end),
            constrained_by=constraint.base if constraint else None,
            constraint=constraint.modification if constraint else None,
            **fields,
        )

    def long_class(self, v: list, start: int, end: int) -> dict:
        name, *rest, closing = v
        if closing.text != name.text:
            self._wrong_end(name, closing)
        description = ""
        if rest and isinstance(rest[0], str):
            description = rest.pop(0)
        parts: dict[str, list] = {
            kind: [] for kind in ("elements", "equations", "initial_equations", "statements", "initial_statements")
        }
        annotation = external = None
        breaks: dict[str, list[int]] = {"statements": [], "initial_statements": []}
        for item in rest:
            kind, items = item if isinstance(item, Section) else ("public", [item])
            if kind in breaks and parts[kind]:
                breaks[kind].append(len(parts[kind]))
            for one in _flat(items):
                if isinstance(one, tree.Modification):
                    if annotation is not None:
                        self.report.error("E0101", "a class can have only one annotation", one.span)
                    annotation = one
                elif kind == "external":
                    external = one
                elif kind == "protected":
                    parts["elements"].append(one if isinstance(one, tree.Import) else replace(one, protected=True))
                else:
                    parts["elements" if kind == "public" else kind].append(one)
        return {
            "name": name,
            "description": description,
            "annotation": annotation,
            "external": external,
            "sections": tuple(breaks["statements"]),
            "initial_sections": tuple(breaks["initial_statements"]),
            **{kind: tuple(items) for kind, items in parts.items()},
        }

    def _wrong_end(self, name: Word, closing: Word) -> None:
        self.report.error(
            "E0108",
            f"'{name.text}' ends with the name '{closing.text}'",
            self.span(closing.start, closing.end),
            expected=f"'end {name.text};'",
            found=f"'end {closing.text};'",
            labels=(Label(self.span(name.start, name.end), "begins here"),),
        )

    def extending_class(self, v: list, start: int, end: int) -> dict:
        names = [value for value in v if isinstance(value, Word)]
        self.report.error(
            "E0116",
            "a class that extends its inherited namesake is not part of lmo",
            self.span(start, names[0].end),
            hint="give it a name of its own and write 'extends' inside",
        )
        rest = [value for value in v if value not in names and not isinstance(value, tree.Modification)]
        return self.long_class([names[0], *rest, names[-1]], start, end)

    def short_class(self, v: list, start: int, end: int) -> dict:
        name, causality, base, *rest, comment = v
        short = tree.ShortClass(
            base,
            tuple(_first(rest, Subscripts) or ()),
            _first(rest, tree.Modification),
            causality,
            self.span(base.span.start, end),
        )
        return {"name": name, "short": short, **comment._asdict()}

    def base_prefix(self, v: list, start: int, end: int) -> str:
        return v[0] if v else ""

    def literal(self, v: list, start: int, end: int) -> tuple[str, str]:
        return v[0].text, v[1].description

    def enumeration(self, v: list, start: int, end: int) -> dict:
        name, *literals, comment = v
        return {
            "name": name,
            "literals": tuple([text for text, _ in literals]),
            "literal_descriptions": tuple([description for _, description in literals]),
            **comment._asdict(),
        }

    def open_enumeration(self, v: list, start: int, end: int) -> dict:
        self.report.error(
            "E0116", "an enumeration of unknown literals is not part of lmo", self.span(start, end), hint="list them"
        )
        return {"name": v[0], "literals": (), **v[1]._asdict()}

    # ------------------------------------------------------------ sections

    def public(self, v: list, start: int, end: int) -> Section:
        return Section("public", v)

    def protected(self, v: list, start: int, end: int) -> Section:
        return Section("protected", v)

    def equations(self, v: list, start: int, end: int) -> Section:
        return Section("equations", v)

    def initial_equations(self, v: list, start: int, end: int) -> Section:
        return Section("initial_equations", v)

    def statements(self, v: list, start: int, end: int) -> Section:
        return Section("statements", v)

    def initial_statements(self, v: list, start: int, end: int) -> Section:
        return Section("initial_statements", v)

    def section(self, v: list, start: int, end: int) -> Section:
        return v[0]

    def external(self, v: list, start: int, end: int) -> Section:
        own = [value for value in v if isinstance(value, tree.Modification)][-1:] if len(v) > 1 else []
        if not v or v[0] != '"builtin"':
            self.report.error(
                "E0116",
                "functions in another language are not part of lmo",
                self.span(start, end),
                hint="write the body in an 'algorithm' section",
            )
            return Section("public", own)
        body = _first(v, tree.External) or tree.External(None, None, self.span(start, end))
        return Section("external", [body, *own])

    def external_call(self, v: list, start: int, end: int) -> tree.External:
        return tree.External(v[0] if len(v) > 1 else None, v[-1], self.span(start, end))

    def class_annotation(self, v: list, start: int, end: int) -> tree.Modification:
        return v[0]

    # ------------------------------------------------------------ elements

    def import_one(self, v: list, start: int, end: int) -> tree.Import:
        return self._import(v[0], "", False, (), v[1], start, end)

    def import_alias(self, v: list, start: int, end: int) -> tree.Import:
        return self._import(v[1], v[0].text, False, (), v[2], start, end)

    def import_all(self, v: list, start: int, end: int) -> tree.Import:
        return self._import(v[0], "", True, (), v[1], start, end)

    def import_some(self, v: list, start: int, end: int) -> tree.Import:
        *names, comment = v
        brace = self.source.text.index("{", start)
        path = [name for name in names if name.start < brace]
        some = tuple([name.text for name in names[len(path) :]])
        return self._import(path, "", False, some, comment, start, end)

    def _import(self, path: list, alias: str, wildcard: bool, names: tuple, comment: Comment, start: int, end: int):
        return tree.Import(tuple([n.text for n in path]), alias, wildcard, names, self.span(start, end), *comment)

    def extends_clause(self, v: list, start: int, end: int) -> tree.Extends:
        return tree.Extends(v[0], _first(v[1:], tree.Modification), False, self.span(start, end), *v[-1])

    def condition(self, v: list, start: int, end: int) -> Condition:
        return Condition(v)

    def constraint(self, v: list, start: int, end: int) -> Constraint:
        return Constraint(v[0], _first(v, tree.Modification), v[-1])

    def declaration(self, v: list, start: int, end: int) -> Declaration:
        condition = _first(v, Condition)
        return Declaration(
            v[0],
            tuple(_first(v, Subscripts) or ()),
            _first(v, tree.Modification),
            condition[0] if condition else None,
            v[-1],
        )

    def component_clause(self, v: list, start: int, end: int) -> list[tree.Component]:
        prefixes, type_name, *rest = v
        self._refuse(prefixes, OF_CLASSES, "a component")
        dimensions = tuple(_first(rest, Subscripts) or ())
        constraint = _first(rest, Constraint)
        place = self.span(start, end)
        return [
            self._component(prefixes, type_name, dimensions, d, constraint, place)
            for d in rest
            if isinstance(d, Declaration)
        ]

    def _component(
        self,
        prefixes: dict[str, Word],
        type_name: tree.Ref,
        dimensions: tuple,
        declaration: Declaration,
        constraint: Constraint | None,
        place: Span,
    ) -> tree.Component:
        name = declaration.name
        return tree.Component(
            name=name.text,
            type=type_name,
            dimensions=declaration.dimensions + dimensions,
            modification=declaration.modification,
            condition=declaration.condition,
            description=declaration.comment.description or (constraint.comment.description if constraint else ""),
            annotation=declaration.comment.annotation or (constraint.comment.annotation if constraint else None),
            flow="flow" in prefixes,
            variability=next((p for p in prefixes if p in EXCLUSIVE[0]), ""),
            causality=next((p for p in prefixes if p in EXCLUSIVE[1]), ""),
            inner="inner" in prefixes,
            outer="outer" in prefixes,
            final="final" in prefixes,
            replaceable="replaceable" in prefixes,
            redeclare="redeclare" in prefixes,
            protected=False,
            constrained_by=constraint.base if constraint else None,
            span=place,
            name_span=self.span(name.start, name.end),
            constraint=constraint.modification if constraint else None,
        )

    # ------------------------------------------------------- modifications

    def modification_list(self, v: list, start: int, end: int) -> tree.Modification:
        return tree.Modification(tuple(v), None, Span(self.source, start, end))

    def binding(self, v: list, start: int, end: int) -> tree.Modification:
        arguments = v[0].arguments if len(v) > 1 else ()
        return tree.Modification(arguments, v[-1], Span(self.source, start, end))

    def element_modification(self, v: list, start: int, end: int) -> tree.ElementModification:
        prefixes, path, *rest = v
        self._refuse(prefixes, prefixes.keys() - {"each", "final"}, "a modification")
        return tree.ElementModification(
            tuple([n.text for n in path]),
            _first(rest, tree.Modification),
            "each" in prefixes,
            "final" in prefixes,
            _first(rest, str) or "",
            self.span(start, end),
        )

    def redeclared_component(self, v: list, start: int, end: int) -> tree.Redeclaration:
        prefixes, type_name, *rest = v
        self._refuse(prefixes, OF_CLASSES, "a component")
        self._need_redeclare(prefixes, start, end)
        dimensions = tuple(_first(rest, Subscripts) or ())
        place = self.span(start, end)
        component = self._component(
            prefixes, type_name, dimensions, _first(rest, Declaration), _first(rest, Constraint), place
        )
        return tree.Redeclaration(component, "each" in prefixes, "final" in prefixes, place)

    def redeclared_class(self, v: list, start: int, end: int) -> tree.Redeclaration:
        prefixes, kind, body = v[:3]
        self._refuse(prefixes, OF_COMPONENTS, f"a {kind.text}")
        self._need_redeclare(prefixes, start, end)
        definition = self._class(prefixes, kind.text, body, _first(v[3:], Constraint), start, end)
        return tree.Redeclaration(definition, "each" in prefixes, "final" in prefixes, self.span(start, end))

    def _need_redeclare(self, prefixes: dict[str, Word], start: int, end: int) -> None:
        if not {"redeclare", "replaceable"} & prefixes.keys():
            self.report.error(
                "E0113",
                "a declaration among modifications begins with 'redeclare'",
                self.span(start, end),
                hint="to give a value write 'name = value'",
            )
