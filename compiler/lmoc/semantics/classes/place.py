"""The view of a class in its place that resolution, collection of elements and hints share."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Span
from lmoc.semantics.classes.predefined import Builtin
from lmoc.support.records import dataclass
from lmoc.syntax import tree


class Place(Protocol):
    """A class definition together with the one around it: what a `Scope` offers to the functions it uses itself."""

    definition: tree.Class | None
    parent: Place | None
    report: Report
    local: dict[str, Place]
    imports: list[tree.Import]
    derived: Place | None
    constraints: tuple[tuple[tree.ShortClass, Place], ...]
    redeclarations: dict[str, tuple[tree.Redeclaration, Place]]
    clauses: tuple[tree.Extends, ...]

    @property
    def name(self) -> str: ...

    @property
    def full_name(self) -> str: ...

    @property
    def kind(self) -> str: ...

    def type_of(self, component: tree.Component) -> Resolved: ...

    @property
    def root(self) -> Place: ...

    @property
    def complete(self) -> bool: ...

    @property
    def bases(self) -> list[tuple[tree.Extends, Resolved]]: ...

    @property
    def table(self) -> dict[str, Member | Place]: ...

    def find(self, name: str) -> Member | Place | Builtin | None: ...

    def find_class(self, ref: tree.Ref) -> Place | Builtin: ...

    def names(self) -> Iterator[str]: ...

    def require_grammar(self) -> None: ...

    def replaced(self, argument: tree.Argument, scope: Place) -> Place: ...

    def take_place_of(self, old: Place, span: Span) -> None: ...


@dataclass(frozen=True)
class Resolved:
    """A type name followed through short class definitions.

    Attributes
    ----------
    base : the class with elements, or the predefined type, at the end
    steps : the short definitions passed, the outermost first, each with the scope its names are looked up in
    """

    base: Place | Builtin
    steps: tuple[tuple[tree.ShortClass, Place], ...]
    name: str
    kind: str


@dataclass(frozen=True, slots=True)
class Member:
    """A component that an instance of a class has.

    Attributes
    ----------
    scope : the class whose text declares it
    outer : modifications that `extends` clauses put on it, the outermost first, each with the class it appears in
    under : where it redeclares another one, modifications of that one that go on to hold, in the same form
    constraint : where it redeclares another one, the class that its own must be a subtype of, and where that is named
    """

    component: tree.Component
    scope: Place
    outer: tuple[tuple[tree.ElementModification | tree.Redeclaration, Place], ...]
    protected: bool
    under: tuple[tuple[tree.Modification, Place], ...] = ()
    constraint: tuple[tree.Ref, Place] | None = None

    @property
    def value(self) -> tuple[tree.Expression | None, Place]:
        """The value that the class gives to it, and where that is written: the outermost modification wins."""
        for argument, scope in self.outer:
            given = argument if isinstance(argument, tree.ElementModification) else argument.element
            modification = given.modification if not isinstance(given, tree.Class) else None
            if modification is not None and modification.value is not None:
                return modification.value, scope
        for modification, scope in ((self.component.modification, self.scope), *self.under):
            if modification is not None and modification.value is not None:
                return modification.value, scope
        return None, self.scope
