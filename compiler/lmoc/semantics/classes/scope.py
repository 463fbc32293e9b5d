"""Classes in their places, and the lookup of names (Modelica specification, chapters 5 and 7).

A `Scope` is a class definition together with the scope it stands in. Its `table` holds what an instance of the
class has: its own elements and those it inherits, each with the class whose text declares it, because that is
where the names in it are looked up.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from lmoc.messages.diagnostics import Label, Report, nearest
from lmoc.messages.source import Span
from lmoc.semantics.classes.predefined import BUILTINS, FOREIGN_TYPES, Builtin
from lmoc.semantics.classes.resolve import Resolved, resolve
from lmoc.semantics.wrong import Wrong
from lmoc.sources import library
from lmoc.syntax import tree

# the kinds of classes that a kind can extend, where it is not only its own (7.1.3)
BASES = {
    "model": ("model", "block", "class", "record"),
    "class": ("model", "block", "class", "record"),
    "block": ("block", "class", "record"),
    "connector": ("connector", "record", "type"),
}


@dataclass(frozen=True, slots=True)
class Member:
    """A component that an instance of a class has.

    Attributes
    ----------
    scope : the class whose text declares it
    outer : modifications that `extends` clauses put on it, the outermost first, each with the class it stands in
    """

    component: tree.Component
    scope: Scope
    outer: tuple[tuple[tree.ElementModification | tree.Redeclaration, Scope], ...]
    protected: bool


class Scope:
    """A class definition in its place; the root scopes have no definition of their own."""

    def __init__(self, definition: tree.Class | None, parent: Scope | None, report: Report, library: bool):
        self.definition = definition
        self.parent = parent
        self.report = report
        self.library = library
        self.local: dict[str, Scope] = {}
        self._table: dict[str, Member | Scope] | None = None
        self._bases: list[tuple[tree.Extends, Resolved]] | None = None
        self._open = False  # its table is being made
        self._searching = False  # its bases are being looked for
        self._types: dict[int, Resolved] = {}
        self.imports: list[tree.Import] = []
        for element in definition.elements if definition else ():
            if isinstance(element, tree.Class):
                self.add_class(element)
            elif isinstance(element, tree.Import):
                self.imports.append(element)

    # -------------------------------------------------------------- facts

    @property
    def name(self) -> str:
        return self.definition.name if self.definition else ""

    @property
    def full_name(self) -> str:
        """Dotted name from the top."""
        prefix = self.parent.full_name if self.parent else ""
        return f"{prefix}.{self.name}" if prefix else self.name

    @property
    def kind(self) -> str:
        return self.definition.kind if self.definition else "package"

    @property
    def root(self) -> Scope:
        """The outermost scope of the file or of the library."""
        scope = self
        while scope.definition is not None:
            scope = scope.parent
        return scope

    def __repr__(self) -> str:
        return f"Scope({self.full_name})"

    def add_class(self, definition: tree.Class) -> Scope:
        """Put a class into this scope; a second one of the same name is reported and left out."""
        old = self.local.get(definition.name)
        if old is not None:
            self.report.error(
                "E0204",
                f"'{definition.name}' is defined twice",
                definition.name_span,
                labels=(Label(old.definition.name_span, "first defined here"),),
            )
            return old
        self.local[definition.name] = scope = Scope(definition, self, self.report, self.library)
        return scope

    # -------------------------------------------------------- inheritance

    @property
    def bases(self) -> list[tuple[tree.Extends, Resolved]]:
        """The `extends` clauses with the classes they mean."""
        if self._bases is None:
            self._bases = []
            self._searching = True
            clauses = [e for e in self.definition.elements if isinstance(e, tree.Extends)] if self.definition else ()
            for clause in clauses:
                try:
                    self._bases.append((clause, self._base(clause)))
                except Wrong as wrong:
                    wrong.put_into(self.report)
            self._searching = False
        return self._bases

    def _base(self, clause: tree.Extends) -> Resolved:
        """The class that an `extends` clause means; its kind must be one that this kind can build on (7.1.3)."""
        resolved = resolve(self.find_class(clause.base, inherited=False))
        kind = resolved.base.kind if isinstance(resolved.base, Scope) else "type"
        allowed = BASES.get(self.kind, (self.kind,))
        if kind not in allowed:
            raise Wrong("E0223", f"the {self.kind} '{self.name}' cannot extend the {kind} '{clause.base}'",
                        clause.base.span, expected=f"a {_either(allowed)}", found=f"a {kind}")  # fmt: skip
        return resolved

    @property
    def table(self) -> dict[str, Member | Scope]:
        """Own and inherited elements by name, in the order of declaration."""
        if self._table is None:
            if self._open:
                raise Wrong("E0208", f"'{self.full_name}' extends itself", self.definition.name_span)
            self._open = True
            try:
                self._table = self._collect()
            finally:
                self._open = False
        return self._table

    def _collect(self) -> dict[str, Member | Scope]:
        table: dict[str, Member | Scope] = {}
        if self.definition is None:
            return dict(self.local)
        bases = iter(self.bases)
        known = {id(clause) for clause, _ in self.bases}
        for element in self.definition.elements:
            if isinstance(element, tree.Component):
                self._declare(table, Member(element, self, (), element.protected))
            elif isinstance(element, tree.Class):
                if self.local[element.name].definition is element:
                    table[element.name] = self.local[element.name]
            elif isinstance(element, tree.Extends) and id(element) in known:
                self._inherit(table, *next(bases))
        for name, scope in self.local.items():  # of other files that are `within` this package
            table.setdefault(name, scope)
        return table

    def _inherit(self, table: dict, clause: tree.Extends, resolved: Resolved) -> None:
        base = resolved.base
        if isinstance(base, Builtin):
            return
        try:
            inherited = base.table
        except Wrong as wrong:
            wrong.put_into(self.report)
            return
        layers = [(by_name(clause.modification), self)]
        layers += [(by_name(short.modification), scope) for short, scope in resolved.steps]
        for name, arguments in layers[0][0].items():
            if name not in inherited:
                self.report.error(
                    "E0205",
                    f"'{base.name}' has no element '{name}' to modify",
                    arguments[0].span,
                    hint=nearest(name, inherited),
                )
        for name, found in inherited.items():
            if isinstance(found, Member):
                outer = tuple((a, scope) for arguments, scope in layers for a in arguments.get(name, ()))
                protected = found.protected or clause.protected
                self._declare(table, Member(found.component, found.scope, outer + found.outer, protected))
            else:
                table.setdefault(name, self._redeclared(found, name, layers))

    def _redeclared(self, found: Scope, name: str, layers: list) -> Scope:
        try:
            for arguments, scope in reversed(layers):
                for argument in arguments.get(name, ()):
                    found = redeclared_class(found, argument, scope)
        except Wrong as wrong:
            wrong.put_into(self.report)
        return found

    def _declare(self, table: dict, member: Member) -> None:
        name = member.component.name
        old = table.get(name)
        if old is None:
            table[name] = member
            return
        same = isinstance(old, Member) and old.component.span.text == member.component.span.text
        if same and (old.scope is not member.scope):
            return  # inherited twice, or repeated: allowed where identical (7.1)
        if same and old.component is member.component and not (old.outer and member.outer):
            table[name] = old if old.outer else member  # one base reached by two ways
            return
        first = old.component.name_span if isinstance(old, Member) else old.definition.name_span
        self.report.error(
            "E0204",
            f"'{name}' is declared twice in '{self.name}'",
            member.component.name_span,
            labels=(Label(first, "first declared here"),),
        )

    def lineage(self) -> Iterator[Scope]:
        """This class and those it extends, bases first, each once."""
        seen: set[int] = set()

        def visit(scope: Scope) -> Iterator[Scope]:
            if id(scope) in seen:
                return
            seen.add(id(scope))
            for _, resolved in scope.bases:
                if isinstance(resolved.base, Scope):
                    yield from visit(resolved.base)
            yield scope

        return visit(self)

    # ------------------------------------------------------------- lookup

    def find(self, name: str, inherited: bool = True) -> Member | Scope | Builtin | None:
        """A simple name seen from inside: own and inherited elements, imports, enclosing classes (5.3.1)."""
        scope: Scope | None = self
        while scope is not None:
            table = scope.table if inherited and scope.definition else scope.local
            found = table.get(name) or (scope._imported(name) if scope.imports else None)
            if found is not None:
                return found
            inherited = True
            encapsulated = scope.definition is not None and scope.definition.encapsulated
            scope = scope.root if encapsulated else scope.parent
        return BUILTINS.get(name)

    def _imported(self, name: str) -> Member | Scope | None:
        wildcards = []
        for element in self.imports:
            if element.wildcard:
                wildcards.append(element)
            elif name in element.names:
                return self._path((*element.path, name), element.span)
            elif not element.names and name == (element.alias or element.path[-1]):
                return self._path(element.path, element.span)
        for element in wildcards:
            package = self._path(element.path, element.span)
            found = package.table.get(name) if isinstance(package, Scope) else None
            if found is not None:
                return found
        return None

    def _path(self, path: Sequence[str], span: Span) -> Member | Scope:
        """A fully qualified name, from the top (13.2.1)."""
        found: Member | Scope | Builtin | None = self.root.find(path[0])
        for name in path[1:]:
            found = found.table.get(name) if isinstance(found, Scope) else None
        if found is None:
            raise Wrong("E0202", f"there is no '{'.'.join(path)}' to import", span, hint=self._import_hint(path))
        return found

    def _import_hint(self, path: Sequence[str]) -> str:
        first = self.root.find(path[0])
        if first is None and path[0] == "Modelica":
            return "the Modelica Standard Library is not there; lmo's own parts need no import"
        if isinstance(first, Scope) and len(path) == 2:
            return nearest(path[1], first.table) or _classes_hint(first)
        around = self.root.parent or self.root
        names = (*self.root.local, *around.local, *library.PACKAGES.values())
        return nearest(path[0], names) if first is None else ""

    def check_import(self, element: tree.Import) -> None:
        """Raise `Wrong` where an import means nothing."""
        paths = [(*element.path, name) for name in element.names] or [element.path]
        for path in paths:
            self._path(path, element.span)

    def type_of(self, component: tree.Component) -> Resolved:
        """What the type of a component that is written in this class means."""
        found = self._types.get(id(component))
        if found is None:
            found = self._types[id(component)] = resolve(self.find_class(component.type))
        return found

    def _known_package(self, element: tree.Import) -> Scope | None:
        try:
            package = self._path(element.path, element.span)
        except Wrong:
            return None  # reported where a name is looked up
        return package if isinstance(package, Scope) else None

    def find_class(self, ref: tree.Ref, inherited: bool = True) -> Scope | Builtin:
        """The class that a type name, a base or a function name means."""
        names = [part.name for part in ref.parts]
        start = self.root if ref.absolute else self
        found = start.find(names[0], inherited)
        for name in names[1:]:
            if not isinstance(found, Scope):
                break
            outer, found = found, found.table.get(name)
            if found is None:
                hint = nearest(name, outer.table) or _classes_hint(outer)
                raise Wrong("E0202", f"'{outer.full_name}' has no class '{name}'", ref.span, hint=hint)
        if found is None:
            text = ".".join(names)
            raise Wrong("E0202", f"there is no class '{text}'", ref.span, hint=self.suggest(names[-1]))
        if isinstance(found, Member):
            raise Wrong("E0223", f"'{'.'.join(names)}' is a component, not a class", ref.span)
        return found

    def visible(self) -> Iterator[str]:
        """All names that can be seen from here, for typo hints."""
        scope: Scope | None = self
        while scope is not None:
            making = scope.definition is None or scope._open or scope._searching
            yield from scope.local if making else scope.table
            for element in scope.imports:
                yield from element.names or (element.alias or element.path[-1],)
                if element.wildcard:
                    package = scope._known_package(element)
                    yield from package.table if package else ()
            scope = scope.parent
        yield from BUILTINS

    def suggest(self, name: str) -> str:
        """A hint with the visible name most like this one."""
        if name in FOREIGN_TYPES:
            return f"write '{FOREIGN_TYPES[name]}'"
        packages = library.packages_with(name)
        if packages:
            return f"'import {packages[0]}.*;' in the model brings the library's {packages[0]}.{name}"
        visible = set(self.visible())
        return f"did you mean '{name}'?" if name in visible else nearest(name, sorted(visible))


def _either(words: Sequence[str]) -> str:
    return f"{', '.join(words[:-1])} or {words[-1]}" if len(words) > 1 else words[0]


def _classes_hint(scope: Scope) -> str:
    names = [name for name, found in scope.table.items() if isinstance(found, Scope)]
    return f"it has {', '.join(names[:8])}" if names else ""


def redeclared_class(old: Scope, argument: tree.Argument, scope: Scope) -> Scope:
    """The class that ``redeclare model M = …`` puts in the place of another one."""
    if not isinstance(argument, tree.Redeclaration) or not isinstance(argument.element, tree.Class):
        raise Wrong("E0205", f"'{old.name}' is a class: it can be redeclared, but not modified", argument.span)
    if not old.definition.replaceable:
        raise Wrong("E0206", f"the class '{old.name}' is not replaceable", argument.span)
    return Scope(argument.element, scope, scope.report, scope.library)


def by_name(modification: tree.Modification | None) -> dict[str, list]:
    """The arguments of a modification by the first name of what they modify."""
    result: dict[str, list] = {}
    for argument in modification.arguments if modification else ():
        name = argument.name[0] if isinstance(argument, tree.ElementModification) else argument.element.name
        result.setdefault(name, []).append(argument)
    return result
