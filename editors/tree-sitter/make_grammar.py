"""Writes `grammar.js`, the grammar of lmo for tree-sitter, from `grammar/lmo.lark`: it says nothing of its own.

Three things differ between the two. A rule of tree-sitter is never empty: what may be empty in lark is optional where
it is used. Its tokens look no further than their own end and have no possessive groups: the `end` of an index is a name
as any other (tree-sitter takes a keyword for one where the keyword cannot stand). And a rule that lark drops where it
has one child only is hidden, and its other alternatives have rules of their own.
"""

from __future__ import annotations

import json
import textwrap
from pathlib import Path

from lark import Token, Tree
from lark.grammar import Terminal
from lark.load_grammar import GrammarBuilder

HERE = Path(__file__).parent
SOURCE = HERE.parent.parent / "grammar" / "lmo.lark"
TARGET = HERE / "grammar.js"
SPACE = r"(?:\s|\/\/[^\n]*\n|\/\*(?:[^*]|\*+[^*\/])*\*+\/)+"
TOKENS = {
    "COMMENT": r"\/\/[^\n]*|\/\*(?:[^*]|\*+[^*\/])*\*+\/",
    "STRING": r'"(?:[^"\\]|\\(?:.|\n))*"',
    "_INITIAL_EQUATION": f"initial{SPACE}equation",
    "_INITIAL_ALGORITHM": f"initial{SPACE}algorithm",
}
NAME = "INDEX_END"  # the token that is read as a name
HEAD = """// The grammar of lmo for tree-sitter. Made by make_grammar.py from grammar/lmo.lark: change that one.

module.exports = grammar({
  name: "lmo",
  word: $ => $.IDENT,
  extras: $ => [/[\\s\\uFEFF]/, $.COMMENT],
"""

# A rule as nested lists: ["seq", …], ["choice", …], ["optional", x], ["repeat", x], ["repeat1", x],
# ["alias", x, name], ["rule", name], ["word", text], ["pattern", text].


class Grammar:
    """The rules of a lark grammar, as those of tree-sitter.

    Attributes
    ----------
    rules : by name, in the order of the source
    """

    def __init__(self, text: str) -> None:
        builder = GrammarBuilder(False, [], None)
        builder.load_grammar(text, "lmo")
        self._definitions = builder._definitions
        self._dropped = {n for n, d in self._definitions.items() if not d.is_term and d.options.expand1}
        self._own: dict[str, list] = {}
        raw: dict[str, list] = {}
        for name, definition in self._definitions.items():
            if definition.is_term:
                if name != NAME and name not in builder._ignore_names:
                    raw[name] = self._token(name, definition.tree)
            else:
                raw[name] = self._read(definition.tree, name)
        raw |= self._own
        raw["COMMENT"] = self._token("COMMENT", self._definitions["COMMENT"].tree)
        empty = self._empty(raw)
        self.rules = {
            self._name(n): _flat(_filled(r, empty) if n in empty and n != "file" else _used(r, empty))
            for n, r in raw.items()
        }

    def _name(self, name: str) -> str:
        return f"_{name}" if name in self._dropped else name

    def _token(self, name: str, tree: Tree) -> list:
        (literal,) = tree.scan_values(lambda t: isinstance(t, Token))
        return ["pattern", TOKENS.get(name) or literal[1 : literal.rindex("/")]]

    def _read(self, node: Tree | Token, rule: str) -> list:
        """Read an expansion of a rule; alternatives with a name of their own become rules."""
        if isinstance(node, Token):
            return ["word", json.loads(str(node))]
        parts = node.children
        match node.data:
            case "expansions":
                return ["choice", *(self._read(p, rule) for p in parts if not _is_name(p))]
            case "expansion":
                return ["seq", *(self._read(p, rule) for p in parts)]
            case "alias":
                return self._alias(parts[0], parts[1].name, rule)
            case "expr":
                kinds = {"?": "optional", "*": "repeat", "+": "repeat1"}
                return [kinds[str(parts[1])], self._read(parts[0], rule)]
            case "value":
                return self._value(parts[0])
        raise ValueError(f"{node.data} in rule {rule}")

    def _alias(self, body: Tree, alias: str, rule: str) -> list:
        own = f"{rule.strip('_')}_{alias}"
        while own in self._own or own in self._definitions:
            own += "_"
        self._own[own] = self._read(body, rule)
        return ["alias", ["rule", own], alias]

    def _value(self, value: object) -> list:
        if isinstance(value, Tree):
            (literal,) = value.children
            return ["word", json.loads(str(literal))]
        return ["rule", self._name(value.name)]

    def _empty(self, raw: dict[str, list]) -> set[str]:
        """Find the rules that may be empty."""
        empty: set[str] = set()
        while found := {n for n, r in raw.items() if n not in empty and _may_be_empty(r, empty)}:
            empty |= found
        return empty


def _is_name(alternative: Tree) -> bool:
    return [v.name for v in alternative.scan_values(lambda v: isinstance(v, Terminal))] == [NAME]


def _may_be_empty(rule: list, empty: set[str]) -> bool:
    match rule:
        case ["optional" | "repeat", _]:
            return True
        case ["rule", name]:
            return name in empty or name.removeprefix("_") in empty
        case ["seq", *parts]:
            return all(_may_be_empty(p, empty) for p in parts)
        case ["choice", *parts]:
            return any(_may_be_empty(p, empty) for p in parts)
        case ["repeat1" | "alias", part, *_]:
            return _may_be_empty(part, empty)
    return False


def _used(rule: list, empty: set[str]) -> list:
    """Make what may be empty optional where it is used."""
    match rule:
        case ["rule", _]:
            return ["optional", rule] if _may_be_empty(rule, empty) else rule
        case ["alias", part, name] if _may_be_empty(part, empty):
            return ["optional", ["alias", part, name]]
        case [kind, *parts] if kind not in ("word", "pattern", "alias"):
            return [kind, *(_used(p, empty) if isinstance(p, list) else p for p in parts)]
    return rule


def _filled(rule: list, empty: set[str]) -> list:
    """Make a rule that may be empty one that is not."""
    match rule:
        case ["optional", part]:
            return _filled(part, empty) if _may_be_empty(part, empty) else _used(part, empty)
        case ["repeat", part]:
            return ["repeat1", _used(part, empty)]
        case ["choice", *parts]:
            return ["choice", *(_filled(p, empty) if _may_be_empty(p, empty) else _used(p, empty)
                                for p in parts if p != ["seq"])]  # fmt: skip
        case ["seq", *parts] if all(_may_be_empty(p, empty) for p in parts):
            rest = [[_filled(p, empty), *(_used(q, empty) for q in parts[i + 1 :])] for i, p in enumerate(parts)]
            return ["choice", *(["seq", *r] for r in rest)]
    return rule


def _flat(rule: list) -> list:
    """Take out sequences and choices of one, and repetitions of what is optional."""
    kind, *parts = rule
    if kind in ("word", "pattern", "rule"):
        return rule
    parts = [_flat(p) if isinstance(p, list) else p for p in parts]
    if kind in ("seq", "choice") and len(parts) == 1:
        return parts[0]
    if kind in ("repeat", "optional") and parts[0][0] in ("optional", "repeat"):
        return parts[0] if parts[0][0] == "repeat" else [kind, parts[0][1]]
    return [kind, *parts]


def _text(rule: list) -> str:
    match rule:
        case ["rule", name]:
            return f"$.{name}"
        case ["word", text]:
            return json.dumps(text)
        case ["pattern", text]:
            return f"token(/{text}/)"
        case ["alias", part, name]:
            return f"alias({_text(part)}, $.{name})"
        case [kind, *parts]:
            return f"{kind}({', '.join(_text(p) for p in parts)})"
    raise ValueError(rule)


def text() -> str:
    """Return the text of `grammar.js`."""
    rules = Grammar(SOURCE.read_text(encoding="utf-8")).rules
    first = {"file": rules.pop("file")}
    lines = [HEAD.rstrip(), "  rules: {"]
    for name, rule in (first | rules).items():
        line = f"    {name}: $ => {_text(rule)},"
        lines += textwrap.wrap(line, 116, subsequent_indent=" " * 8, break_long_words=False, break_on_hyphens=False)
    return "\n".join([*lines, "  },", "});", ""])


if __name__ == "__main__":
    TARGET.write_text(text(), encoding="utf-8")
