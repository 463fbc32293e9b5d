"""The base class of the nodes of the syntax tree."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from lmoc.messages.source import Span
from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from typing_extensions import dataclass_transform

    @dataclass_transform(frozen_default=True)
    def node(cls: type) -> type: ...

else:

    def node(cls: type) -> type:
        """A dataclass with slots; nodes are never changed once made.

        ``frozen=True`` and the generated methods would say so too, but they take four times as long to
        set up: 14 ms of every start for the classes below.
        """
        return dataclass(eq=False, repr=False, slots=True)(cls)


class Node:
    """Equality, hash and printing by the fields, as dataclasses have them."""

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        return all(getattr(self, name) == getattr(other, name) for name in self.__slots__)

    def __hash__(self) -> int:
        return hash((type(self), *(getattr(self, name) for name in self.__slots__)))

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        """For the trees in the cache: pickle's own way for dataclasses with slots takes twice as long."""
        kind = type(self)
        return kind, tuple([getattr(self, name) for name in kind.__slots__])

    def __repr__(self) -> str:
        fields = ", ".join(f"{name}={getattr(self, name)!r}" for name in self.__slots__)
        return f"{type(self).__name__}({fields})"


def walk(item: object) -> Iterator[Node]:
    """Yield all nodes of a tree, or of a tuple of trees, in the order of their places."""
    pending = [item]
    while pending:
        item = pending.pop()
        if isinstance(item, tuple):
            pending += reversed(item)
        elif isinstance(item, Node):
            yield item
            pending += [getattr(item, name) for name in reversed(item.__slots__)]


def alike(a: object, b: object) -> bool:
    """Return whether two trees are equal apart from their spans."""
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(alike, a, b))
    if not isinstance(a, Node):
        return a == b or isinstance(a, Span)
    return type(a) is type(b) and all(alike(getattr(a, name), getattr(b, name)) for name in a.__slots__)
