"""Structures as bytes and back: frozen dataclasses, expressions, arrays and plain values, each object once.

A text in JSON lists the objects, each after those it refers to, and the numbers of all arrays follow it. Nothing in it
is code: reading makes arrays, interned expressions, and instances of dataclasses and enumerations of this package.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from importlib import import_module
from typing import Any

import numpy as np

from lmoc.expression.dag import Expr, interned, postorder
from lmoc.messages.source import Source

_PACKAGE = "lmoc."
_PLAIN = (type(None), bool, int, float, str)


class NotStorable(Exception):
    """There is something in it that is no data, such as a function."""


def store(root: object, texts: Sequence[Source] = ()) -> bytes:
    """Return a structure as bytes.

    Parameters
    ----------
    texts : that are known when it is read: they are not stored

    Raises
    ------
    NotStorable
    """
    writer = _Writer(texts)
    value = writer.value(root)
    head = {"classes": writer.classes, "arrays": writer.heads, "objects": writer.objects, "root": value}
    text = json.dumps(head, separators=(",", ":")).encode()
    return len(text).to_bytes(8, "little") + text + b"".join(writer.blobs)


def restore(stored: bytes | memoryview, texts: Sequence[Source] = ()) -> Any:
    """Return the structure that `store` has made the bytes of, with the same texts.

    Raises
    ------
    ValueError, KeyError, TypeError, AttributeError, ImportError, IndexError
        They are not such bytes, or those of another version of this package.
    """
    size = int.from_bytes(stored[:8], "little")
    return _Reader(json.loads(bytes(stored[8 : 8 + size])), bytearray(stored[8 + size :]), texts).root()


class _Writer:
    """Collects objects. Plain values stand for themselves, others are lists that begin with a letter for their kind."""

    def __init__(self, texts: Sequence[Source]) -> None:
        self._texts = {(text.name, text.text): k for k, text in enumerate(texts)}
        self.objects: list[list[Any]] = []
        self.classes: list[str] = []
        self.heads: list[list[Any]] = []
        self.blobs: list[bytes] = []
        self._number: dict[int, list[Any]] = {}  # of the objects met so far
        self._class: dict[type, int] = {}
        self._kept: list[object] = []  # so that no two have the same identity

    def value(self, item: Any) -> Any:
        kind = type(item)
        if kind in _PLAIN:
            return item
        if kind is tuple or kind is list:
            return ["t" if kind is tuple else "l", *map(self.value, item)]
        if kind is dict:
            return ["d", *([self.value(k), self.value(v)] for k, v in item.items())]
        if isinstance(item, Enum):
            return ["e", self._class_of(kind), item.value]
        found = self._number.get(id(item))
        if found is None and kind is Expr:
            return self._expression(item)
        if found is None:
            found = self._number[id(item)] = self._object(item)
            self._kept.append(item)
        return found

    def _expression(self, root: Expr) -> list[Any]:
        """Return an expression as a value: its nodes in order, without recursion, since a long sum is a deep one."""
        for node in postorder(root):
            if id(node) not in self._number:
                arguments = [self._number[id(a)][1] for a in node.args]
                self.objects.append(["x", node.op, arguments, self.value(node.value)])
                self._number[id(node)] = ["o", len(self.objects) - 1]
                self._kept.append(node)
        return self._number[id(root)]

    def _object(self, item: Any) -> list[Any]:
        if type(item) is np.ndarray and item.dtype.kind in "biuf":
            self.heads.append([item.dtype.str, item.shape])
            self.blobs.append(item.tobytes())
            return ["a", len(self.heads) - 1]
        if type(item) is Source and (item.name, item.text) in self._texts:
            return ["s", self._texts[item.name, item.text]]
        if is_dataclass(item) and type(item).__module__.startswith(_PACKAGE):
            record = [self._class_of(type(item)), *(self.value(getattr(item, f.name)) for f in fields(item))]
        else:
            raise NotStorable(type(item).__qualname__)
        self.objects.append(record)
        return ["o", len(self.objects) - 1]

    def _class_of(self, kind: type) -> int:
        if kind not in self._class:
            self._class[kind] = len(self.classes)
            self.classes.append(f"{kind.__module__}:{kind.__qualname__}")
        return self._class[kind]


class _Reader:
    def __init__(self, head: dict[str, Any], blob: bytearray, texts: Sequence[Source]) -> None:
        self.texts = texts
        self.classes = [_class(name) for name in head["classes"]]
        self.names = [[f.name for f in fields(c)] if is_dataclass(c) else [] for c in self.classes]
        self.arrays, at = [], 0
        for code, shape in head["arrays"]:
            kind, count = np.dtype(code), int(np.prod(shape, dtype=int))
            self.arrays.append(np.frombuffer(blob, kind, count, at).reshape(shape))
            at += count * kind.itemsize
        self.objects: list[Any] = []
        for record in head["objects"]:
            self.objects.append(self._object(record))
        self._root = head["root"]

    def root(self) -> Any:
        return self.value(self._root)

    def value(self, item: Any) -> Any:
        if type(item) is not list:
            return item
        kind = item[0]
        if kind == "o":
            return self.objects[item[1]]
        if kind == "a":
            return self.arrays[item[1]]
        if kind == "s":
            return self.texts[item[1]]
        if kind == "t":
            return tuple([self.value(v) for v in item[1:]])
        if kind == "e":
            return self.classes[item[1]](item[2])
        if kind == "l":
            return [self.value(v) for v in item[1:]]
        return {self.value(k): self.value(v) for k, v in item[1:]}

    def _object(self, record: list[Any]) -> object:
        if record[0] == "x":
            _, op, args, value = record
            return interned(op, tuple([self.objects[k] for k in args]), self.value(value))
        own = self.classes[record[0]]
        made = object.__new__(own)
        for name, value in zip(self.names[record[0]], record[1:], strict=True):
            object.__setattr__(made, name, self.value(value))
        return made


def _class(name: str) -> Any:
    """Return a dataclass or an enumeration of this package.

    Raises
    ------
    ValueError
        It is something else.
    """
    module, _, qualified = name.partition(":")
    found = getattr(import_module(module), qualified) if module.startswith(_PACKAGE) else None
    if not (isinstance(found, type) and (is_dataclass(found) or issubclass(found, Enum))):
        raise ValueError(f"'{name}' is no class of a structure")
    return found
