"""Classes in their places, and the lookup of names (Modelica specification, chapters 5 and 7).

A `Scope` is a class definition together with the scope it appears in. Its `table` holds what an instance of the
class has: its own elements and those it inherits, each with the class whose text declares it, because that is
where the names in it are looked up.

A base class is copied for each class that extends it (`heir`): the names in its text mean what they mean in the class
that is instantiated in the end (`derived`), where elements may have been redeclared. A class whose own elements a
modification redeclares is a copy as well (`specialized`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from lmoc.messages.diagnostics import Diagnostic, Label, Report, nearest
from lmoc.messages.source import Span
from lmoc.semantics.classes.elements import collect
from lmoc.semantics.classes.hints import classes_hint, either, import_hint, modelica_hint, suggest, visible
from lmoc.semantics.classes.place import Member, Resolved
from lmoc.semantics.classes.predefined import BUILTINS, Builtin
from lmoc.semantics.classes.redeclare import constraint_of
from lmoc.semantics.classes.resolve import resolve
from lmoc.semantics.mistakes.wrong import NoClass, NotAClass, Refused, Wrong
from lmoc.sources.natives import NAMES, native
from lmoc.sources.packages import Folder, Found
from lmoc.syntax import tree

# the kinds of classes that a kind can extend, where it is not only its own (7.1.3)
BASES = {
    "model": ("model", "block", "class", "record"),
    "class": ("model", "block", "class", "record"),
    "block": ("block", "class", "record"),
    "connector": ("connector", "record", "type"),
}


Redeclarations = Mapping[str, tuple[tree.Redeclaration, "Scope"]]


class Scope:
    """A class definition in its place; the root scopes have no definition of their own.

    Attributes
    ----------
    heir, derived : of the copy of a base class, the class that extends it and the last one in that row
    constraints : modifications that hold because the class redeclares another one, each with the place of its names
    replaces : the class that it redeclares
    """

    def __init__(self, definition: tree.Class | None, parent: Scope | None, report: Report, library: bool):
        self.definition = definition
        self.parent = parent
        self.report = report
        self.library = library
        self.local: dict[str, Scope] = {}
        self.heir: Scope | None = None
        self.derived: Scope | None = None
        self.constraints: tuple[tuple[tree.ShortClass, Scope], ...] = ()
        self.replaces: Scope | None = None
        self.clauses = _clauses(definition)
        self.redeclarations: Redeclarations = {}
        self._specialized: dict[tuple, Scope] = {}
        self._table: dict[str, Member | Scope] | None = None
        self._bases: list[tuple[tree.Extends, Resolved]] | None = None
        self._lineage: tuple[Scope, ...] | None = None
        self.made: dict[str, Any] = {}  # what has been made of it once, for every use of it
        self._open = False  # its table is being made
        self._searching = False  # its bases are being looked for
        self._types: dict[int, Resolved] = {}
        self.folders: tuple[Folder, ...] = ()
        self._missing: dict[str, tuple[Diagnostic, ...]] = {}  # not in the folders, and what is wrong with their files
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
        definition = self._native(definition)
        self.local[definition.name] = scope = Scope(definition, self, self.report, self.library)
        return scope

    def _native(self, definition: tree.Class) -> tree.Class:
        """The class that stands in the place of one of Modelica's library; others as they are."""
        found = native(f"{self.full_name}.{definition.name}") if definition.name in NAMES else None
        return definition if found is None else found

    def class_in(self, name: str) -> Scope | None:
        """A class in this one, which is read now if it is in a folder and has not been used before."""
        found = self.local.get(name)
        if found is not None or not self.folders or name in self._missing or name in BUILTINS:
            return found
        said: tuple[Diagnostic, ...] = ()
        for folder in self.folders:
            read = folder.find(name)
            if read is not None and read.definition is not None:
                return self._take(read)
            said += read.diagnostics if read is not None else ()
        self._missing[name] = said
        return None

    def _take(self, read: Found) -> Scope:
        """Put a class that has been read into this scope; the further ones of its file are seen from it alone."""
        self.report.diagnostics += [d for d in read.diagnostics if d not in self.report.diagnostics]
        around = self
        if read.others:
            around = Scope(None, self, self.report, self.library)
            for definition in read.others:
                around.add_class(definition)
        definition = self._native(read.definition)
        made = self.local[read.definition.name] = Scope(definition, around, self.report, self.library)
        made.folders = (read.folder,) if read.folder is not None else ()
        return made

    def names(self) -> Iterator[str]:
        """The names of the classes in this one, those in folders included."""
        yield from self.local
        for folder in self.folders:
            yield from folder.names()

    @property
    def complete(self) -> bool:
        """Return whether its elements can be read: not while they are being collected."""
        return self.definition is not None and not self._open and not self._searching

    # -------------------------------------------------------- inheritance

    @property
    def bases(self) -> list[tuple[tree.Extends, Resolved]]:
        """The `extends` clauses (or what a short definition is made of) with copies of the classes they mean."""
        if self._bases is None:
            self._bases = []
            self._searching = True
            for clause in self.clauses:
                try:
                    resolved = self._base(clause)
                    if isinstance(resolved.base, Scope):
                        resolved = replace(resolved, base=self._copied(resolved.base))
                    self._bases.append((clause, resolved))
                except Wrong as wrong:
                    wrong.put_into(self.report)
            self._searching = False
        return self._bases

    def _base(self, clause: tree.Extends) -> Resolved:
        """The class that an `extends` clause means; its kind must be one that this kind can build on (7.1.3)."""
        if self.definition.short is not None:
            return resolve(self.parent.find_class(clause.base))
        resolved = resolve(self.find_class(clause.base, inherited=False))
        kind = resolved.base.kind if isinstance(resolved.base, Scope) else "type"
        allowed = BASES.get(self.kind, (self.kind,))
        if kind not in allowed:
            raise Wrong("E0223", f"the {self.kind} '{self.name}' cannot extend the {kind} '{clause.base}'",
                        clause.base.span, expected=f"a {either(allowed)}", found=f"a {kind}")  # fmt: skip
        return resolved

    def _copied(self, base: Scope) -> Scope:
        """A base class for this class alone."""
        heir: Scope | None = self
        while heir is not None:
            if heir.definition is base.definition:
                raise Wrong("E0208", f"'{base.full_name}' extends itself", base.definition.name_span)
            heir = heir.heir
        made = Scope(base.definition, base.parent, base.report, base.library)
        made.heir, made.derived, made.folders = self, self.derived or self, base.folders
        return made

    def specialized(self, redeclarations: Redeclarations) -> Scope:
        """This class with some of the classes that are its elements redeclared."""
        key = tuple((name, id(argument), id(scope)) for name, (argument, scope) in redeclarations.items())
        found = self._specialized.get(key)
        if found is None:
            found = self._specialized[key] = Scope(self.definition, self.parent, self.report, self.library)
            found.redeclarations = {**self.redeclarations, **redeclarations}
            found.folders = self.folders
        return found

    def replaced(self, argument: tree.Argument, scope: Scope) -> Scope:
        """The class that ``redeclare model M = …``, written in `scope`, puts in the place of this one."""
        if not isinstance(argument, tree.Redeclaration) or not isinstance(argument.element, tree.Class):
            raise Wrong("E0205", f"'{self.name}' is a class: it can be redeclared, but not modified", argument.span)
        made = Scope(argument.element, scope, scope.report, scope.library)
        made.take_place_of(self, argument.span)
        return made

    def take_place_of(self, old: Scope, span: Span) -> None:
        """Hold what the redeclared class said of every class in its place (7.3.2)."""
        if not old.definition.replaceable:
            labels = (Label(old.definition.name_span, "declared here"),)
            raise Wrong("E0206", f"the class '{old.name}' is not replaceable", span, labels=labels)
        self.replaces = old
        base, modification = constraint_of(old.definition)
        if modification is not None:
            self.constraints = ((tree.ShortClass(base, (), modification, "", modification.span), old.parent),)
        self.constraints += old.constraints

    @property
    def table(self) -> dict[str, Member | Scope]:
        """Own and inherited elements by name, in the order of declaration."""
        if self._table is None:
            self.require_grammar()
            if self._open:
                raise Wrong("E0208", f"'{self.full_name}' extends itself", self.definition.name_span)
            self._open = True
            try:
                self._table = collect(self)
            finally:
                self._open = False
        return self._table

    def lineage(self) -> tuple[Scope, ...]:
        """This class and those it extends, bases first, each once."""
        if self._lineage is not None:
            return self._lineage
        seen: set[int] = set()

        def visit(scope: Scope) -> Iterator[Scope]:
            if id(scope.definition) in seen:
                return
            seen.add(id(scope.definition))
            for _, resolved in scope.bases:
                if isinstance(resolved.base, Scope):
                    yield from visit(resolved.base)
            yield scope

        found = tuple(visit(self))
        if not any(scope._searching for scope in found):
            self._lineage = found
        return found

    def is_made_of(self, scope: Scope) -> bool:
        """Return whether a class is this one or one that it extends."""
        return any(own.definition is scope.definition for own in self.lineage())

    def require_grammar(self) -> None:
        """A class that the grammar refuses cannot be used."""
        if self.definition is not None and any(d.severity == "error" for d in self.definition.mistakes):
            raise Refused(self.definition.mistakes)

    # ------------------------------------------------------------- lookup

    def find(self, name: str, inherited: bool = True) -> Member | Scope | Builtin | None:
        """A simple name seen from inside: own and inherited elements, imports, enclosing classes (5.3.1)."""
        scope: Scope | None = self
        while scope is not None:
            found = scope._seen(name) if inherited else scope.class_in(name)
            found = found or (scope._imported(name) if scope.imports else None)
            if found is not None:
                return found
            inherited = True
            encapsulated = scope.definition is not None and scope.definition.encapsulated
            scope = scope.root if encapsulated else scope.parent
        return BUILTINS.get(name)

    def element(self, name: str) -> Member | Scope | None:
        """Return the element of that name, own or inherited."""
        found = None if self.definition is None or self._searching else self.table.get(name)
        return found or self.class_in(name)

    def _seen(self, name: str) -> Member | Scope | None:
        """An element as it is in the class that is instantiated in the end."""
        found = self.element(name)
        return found if found is None or self.derived is None else self.derived.element(name) or found

    def _imported(self, name: str) -> Member | Scope | None:
        wildcards = []
        for element in self.imports:
            if element.wildcard:
                wildcards.append(element)
            elif name in element.names:
                return self._path((*element.path, name), element.span)
            elif not element.names and name == (element.alias or element.path[-1]):
                return self._path(element.path, element.span)
        found, chosen = None, None
        for element in wildcards:
            package = self._path(element.path, element.span)
            other = package.element(name) if isinstance(package, Scope) else None
            if isinstance(other, Member) and (other.protected or other.component.variability != "constant"):
                other = None
            if other is None or (found is not None and _same(found, other)):
                continue
            if found is not None:
                where, also = (".".join(e.path) for e in (chosen, element))
                raise Wrong("E0246", f"'{name}' is found by two imports", element.span,
                            found=f"{where}.{name} and {also}.{name}", labels=(Label(chosen.span, "the other one"),),
                            hint=f"import the one that is meant: 'import {where}.{name};'")  # fmt: skip
            found, chosen = other, element
        return found

    def _path(self, path: Sequence[str], span: Span) -> Member | Scope:
        """A fully qualified name, from the top (13.2.1)."""
        found: Member | Scope | Builtin | None = self.root.find(path[0])
        for k, name in enumerate(path[1:], 1):
            around, found = found, found.element(name) if isinstance(found, Scope) else None
            if found is None and isinstance(around, Scope) and k == len(path) - 1:
                found = self._literal(around, path, span)
        if found is None:
            raise NoClass("E0202", f"there is no '{'.'.join(path)}' to import", span, hint=import_hint(self, path))
        return found

    def _literal(self, enumeration: Scope, path: Sequence[str], span: Span) -> Member | None:
        """A literal of an enumeration, as a constant of its own; None where it has no such one."""
        base = resolve(enumeration).base if enumeration.kind == "type" else None
        if not isinstance(base, Builtin) or path[-1] not in base.literals:
            return None
        key = f"import {'.'.join(path)}"
        if key not in self.made:
            parts = tuple(tree.RefPart(name, (), span) for name in path)
            value = tree.Modification((), tree.Ref(parts, True, span), span)
            no = (False,) * 6
            component = tree.Component(path[-1], tree.Ref(parts[:-1], True, span), (), value, None, "", None, False,
                                       "constant", "", *no, None, span, span)  # fmt: skip
            self.made[key] = Member(component, self.root, (), False)
        return self.made[key]

    def check_import(self, element: tree.Import) -> None:
        """Raise `Wrong` where an import means nothing."""
        paths = [(*element.path, name) for name in element.names] or [element.path]
        for path in paths:
            self._path(path, element.span)

    def _classes(self) -> list[str]:
        """The names of the classes that can be seen from here."""
        return [name for name in dict.fromkeys(visible(self)) if not isinstance(self.find(name), Member)]

    def refuse_files(self, name: str, within: Scope | None = None) -> None:
        """Say what is wrong with the files that have the name of a class that is not found.

        Parameters
        ----------
        within : the scope in which a class of that name is found: only files of scopes inside of it count
        """
        scope: Scope | None = self
        while scope is not within and scope is not None:
            if scope._missing.get(name):
                raise Refused(scope._missing[name])
            scope = scope.parent

    def type_of(self, component: tree.Component) -> Resolved:
        """Return the meaning of the type of a component that is written in this class."""
        found = self._types.get(id(component.type))
        if found is None:
            found = self._types[id(component.type)] = resolve(self.find_class(component.type))
        return found

    def find_class(self, ref: tree.Ref, inherited: bool = True) -> Scope | Builtin:
        """The class that a type name, a base or a function name means."""
        found = self.meaning(ref, inherited)
        if isinstance(found, Member):
            name = ref.parts[-1].name
            raise NotAClass("E0223", f"'{_text(ref)}' is a component, not a class", ref.span,
                        hint=nearest(name, self._classes()))  # fmt: skip
        return found

    def meaning(self, ref: tree.Ref, inherited: bool = True) -> Member | Scope | Builtin:
        """The class that a name means, or the component that it begins with or that a class has."""
        names = [part.name for part in ref.parts]
        start = self.root if ref.absolute else self
        found = start.find(names[0], inherited)
        if isinstance(found, Scope):  # no class of the library takes the place of one whose file is wrong
            start.refuse_files(names[0], within=found.parent)
        for name in names[1:]:
            if not isinstance(found, Scope):
                break
            outer, found = found, found.element(name)
            if found is None:
                outer.refuse_files(name)
                hint = nearest(name, (*outer.table, *outer.names())) or classes_hint(outer)
                raise NoClass("E0202", f"'{outer.full_name}' has no class '{name}'", ref.span, hint=hint)
        if found is None:
            if names == ["ExternalObject"]:
                raise NoClass("E0116", "external objects are not part of lmo", ref.span)
            self.refuse_files(names[0])
            hint = modelica_hint(names) or suggest(self, names[-1])
            raise NoClass("E0202", f"there is no class '{_text(ref)}'", ref.span, hint=hint)
        return found


def _text(ref: tree.Ref) -> str:
    """A name without its subscripts."""
    return ".".join(part.name for part in ref.parts)


def _same(a: Member | Scope, b: Member | Scope) -> bool:
    """Return whether two names mean one element, reached by two ways."""
    if isinstance(a, Member) and isinstance(b, Member):
        return a.component is b.component
    return isinstance(a, Scope) and isinstance(b, Scope) and a.definition is b.definition


def _clauses(definition: tree.Class | None) -> tuple[tree.Extends, ...]:
    """The `extends` clauses; a short definition is one."""
    if definition is None:
        return ()
    if definition.short is not None:
        short = definition.short
        return (tree.Extends(short.base, short.modification, False, short.span),)
    return tuple(e for e in definition.elements if isinstance(e, tree.Extends))
