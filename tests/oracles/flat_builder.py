"""Flat models from lines of text, for tests of reduction without a front end.

One line each: ``parameter m = 2`` (or without a value), ``constant``, ``input u``, ``var x y``, ``potential a.q``,
``flow a.f`` (of connectors), ``prefer x`` … (any stateSelect), ``connect a.q = b.q``, ``sum a.f + b.f - c.f``,
``start x = 1``, ``fixed x``; every other line with ``=`` is an equation of the part
whose name its first dotted name begins with.
"""

from __future__ import annotations

import ast
from dataclasses import replace

import numpy as np

from lmoc.expression.dag import TIME, Expr, const, function, lift, rebuild, slot
from lmoc.ir.flat import Assignments, Block, FlatDAE, Group, Kind, Part, StateSelect, Sums
from lmoc.messages.source import Source, Span

_BINARY = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.Div: "div", ast.Pow: "pow"}
_DECLARED = {
    "parameter": Kind.PARAMETER,
    "constant": Kind.CONSTANT,
    "input": Kind.INPUT,
    "var": Kind.UNKNOWN,
    "potential": Kind.UNKNOWN,
    "flow": Kind.UNKNOWN,
}


def flat_model(text: str, name: str = "Test") -> FlatDAE:
    """The flat model that some lines describe."""
    return _Builder(text, name).flat


class _Builder:
    def __init__(self, text: str, name: str):
        self.source = Source(f"{name}.lmo", text)
        self.blocks: dict[str, Block] = {}
        self.parts = [Part((), name, "", (), False)]
        self.groups: list[Group] = []
        self.sums: list[list[tuple[str, float]]] = []
        self.sum_spans: list[Span] = []
        self.bindings: list[Assignments] = []
        self.starts: list[Assignments] = []
        self.fixed: list[Assignments] = []
        at = 0
        for line in text.split("\n"):
            if line.strip():
                lead = len(line) - len(line.lstrip())
                self.line(line.strip(), Span(self.source, at + lead, at + len(line.rstrip())))
            at += len(line) + 1
        blocks = tuple(self.blocks.values())
        start = np.cumsum([0, *map(len, self.sums)])
        index = np.array([self.blocks[v].offset for row in self.sums for v, _ in row], np.int64)
        sign = np.array([s for row in self.sums for _, s in row], float)
        sums = Sums(start, index, sign, tuple(self.sum_spans), np.arange(len(self.sums)))
        self.flat = FlatDAE(
            name, "", blocks, tuple(self.parts), tuple(self.groups), sums,
            bindings=tuple(self.bindings), starts=tuple(self.starts), fixed=tuple(self.fixed),
        )  # fmt: skip

    def line(self, text: str, span: Span) -> None:
        word, _, rest = text.partition(" ")
        if word in _DECLARED:
            self.declare(word, rest, span)
        elif word in StateSelect.__members__:
            for name in rest.split():
                self.blocks[name] = replace(self.blocks[name], state_select=StateSelect[word])
        elif word == "sum":
            tree = ast.parse(rest, mode="eval").body
            self.sums.append(_terms(tree, 1.0))
            self.sum_spans.append(span)
        elif word in ("start", "fixed"):
            name, _, value = rest.partition("=")
            target = np.array([self.blocks[name.strip()].offset])
            shape, slots = self.shape(value or "1")
            (self.starts if word == "start" else self.fixed).append(Assignments(target, shape, slots, span))
        else:
            self.equation(rest if word == "connect" else text, span, "connection" if word == "connect" else "equation")

    def part(self, name: str) -> int:
        """The part a dotted name belongs to; part 0 for plain names."""
        head = name.split(".")[0] if "." in name else ""
        if not head:
            return 0
        path = ((head, ()),)
        known = [p.path for p in self.parts]
        if path not in known:
            self.parts.append(Part(path, head.capitalize(), "", (), True))
            known.append(path)
        return known.index(path)

    def declare(self, word: str, rest: str, span: Span) -> None:
        names, _, value = rest.partition("=")
        for name in names.split():
            path = tuple((n, ()) for n in name.split("."))
            self.blocks[name] = Block(
                path, len(self.blocks), 1, _DECLARED[word], flow=word == "flow",
                connector=word in ("flow", "potential"), part=self.part(name), span=span,
            )  # fmt: skip
            if value:
                shape, slots = self.shape(value)
                self.bindings.append(Assignments(np.array([self.blocks[name].offset]), shape, slots, span))

    def equation(self, text: str, span: Span, origin: str) -> None:
        left, right = text.split("=")
        columns: dict[str, int] = {}
        shapes = [self.expression(side, columns) for side in (left, right)]
        slots = np.array([[self.blocks[n].offset for n in columns]], np.int64).reshape(1, len(columns))
        dotted = next((n for n in columns if "." in n), "")
        self.groups.append(Group(*shapes, slots, span, self.part(dotted), origin))

    def shape(self, text: str) -> tuple[Expr, np.ndarray]:
        columns: dict[str, int] = {}
        shape = self.expression(text, columns)
        return shape, np.array([[self.blocks[n].offset for n in columns]], np.int64).reshape(1, len(columns))

    def expression(self, text: str, columns: dict[str, int]) -> Expr:
        return self.node(ast.parse(text.strip(), mode="eval").body, columns)

    def node(self, tree: ast.expr, columns: dict[str, int], order: int = 0) -> Expr:
        if isinstance(tree, ast.Constant):
            return const(tree.value)
        if isinstance(tree, (ast.Name, ast.Attribute)):
            name = ast.unparse(tree)
            return TIME if name == "time" else slot(columns.setdefault(name, len(columns)), order)
        if isinstance(tree, ast.BinOp):
            args = (self.node(tree.left, columns), self.node(tree.right, columns))
            return rebuild(_BINARY[type(tree.op)], args)
        if isinstance(tree, ast.UnaryOp):
            return -lift(self.node(tree.operand, columns))
        if tree.func.id == "der":
            return self.node(tree.args[0], columns, order + 1)
        return function(tree.func.id, *(self.node(a, columns) for a in tree.args))


def _terms(tree: ast.expr, sign: float) -> list[tuple[str, float]]:
    if isinstance(tree, ast.BinOp):
        right = sign if isinstance(tree.op, ast.Add) else -sign
        return _terms(tree.left, sign) + _terms(tree.right, right)
    if isinstance(tree, ast.UnaryOp):
        return _terms(tree.operand, -sign)
    return [(ast.unparse(tree), sign)]
