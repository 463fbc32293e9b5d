"""The grammar for tree-sitter is that of the parser, and reads every model as the parser does."""

import re
import shutil
import subprocess
import sys
from collections import Counter
from functools import cache
from pathlib import Path

import pytest
from lark import Lark

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "editors" / "tree-sitter"
MODELS = sorted([*(ROOT / "models").rglob("*.lmo"), *(ROOT / "stdlib").rglob("*.lmo")])
COUNTED = (
    "class_definition", "component_clause", "declaration", "modification_list", "element_modification", "equality",
    "connect", "for_equation", "when_equation", "assignment", "call", "named_argument", "reference", "subscripts",
    "additive", "multiplicative", "power", "relational", "annotation", "description",
)  # fmt: skip


@pytest.fixture(scope="module")
def made():
    sys.path.insert(0, str(FOLDER))
    try:
        import make_grammar
    finally:
        sys.path.remove(str(FOLDER))
    return make_grammar


def test_the_grammar_is_made_from_that_of_the_parser(made):
    assert (FOLDER / "grammar.js").read_text(encoding="utf-8") == made.text()


def test_colours_know_the_nodes_of_the_grammar(made):
    rules = made.Grammar(made.SOURCE.read_text(encoding="utf-8")).rules
    leaves = [leaf for rule in rules.values() for leaf in leaves_of(rule)]
    nodes = set(rules) | {name for kind, name in leaves if kind == "alias"}
    query = re.sub(r";.*|\(#any-of\?[^)]*\)", "", (FOLDER / "queries" / "highlights.scm").read_text(encoding="utf-8"))
    assert set(re.findall(r"\((\w+)", query)) <= nodes
    assert set(re.findall(r'"([^"]+)"', query)) <= {name for kind, name in leaves if kind == "word"}


def leaves_of(rule: list) -> list[tuple[str, str]]:
    """Return the words, patterns, rules and aliases of a rule, each with its kind."""
    kind, *parts = rule
    own = [(kind, part) for part in parts if isinstance(part, str)]
    return own + [leaf for part in parts if isinstance(part, list) for leaf in leaves_of(part)]


@cache
def automaton(kind: str) -> Lark:
    """Make lark's parser of the rules for tree-sitter, or of the source."""
    make_grammar = sys.modules["make_grammar"]
    source = make_grammar.SOURCE.read_text(encoding="utf-8")
    if kind == "lark":
        return Lark(source, start="file", parser="lalr")
    rules = make_grammar.Grammar(source).rules
    return Lark("\n".join(lark_rule(n, r) for n, r in rules.items()) + "\n%ignore /[\\s\\uFEFF]+/\n%ignore COMMENT\n",
                start="file", parser="lalr")  # fmt: skip


def lark_rule(name: str, rule: list) -> str:
    if rule[0] == "pattern":
        return f"{name}{'.2' if 'INITIAL' in name else ''}: /{rule[1]}/"
    return f"{name}: {lark_text(rule)}"


def lark_text(rule: list) -> str:
    match rule:
        case ["rule", name]:
            return name
        case ["word", text]:
            return f'"{text}"'
        case ["alias", part, _]:
            return lark_text(part)
        case ["choice", *parts]:
            return f"({' | '.join(map(lark_text, parts))})"
        case ["seq", *parts]:
            return f"({' '.join(map(lark_text, parts))})"
        case [kind, part]:
            return lark_text(part) + {"optional": "?", "repeat": "*", "repeat1": "+"}[kind]
    raise ValueError(rule)


def counted(kind: str, text: str) -> Counter:
    found = Counter(str(t.data) for t in automaton(kind).parse(text).iter_subtrees())
    return Counter({n: found[n] for n in COUNTED})


@pytest.mark.parametrize("path", MODELS[::3], ids=lambda p: p.stem)
def test_a_model_has_the_parts_that_the_parser_finds(made, path):
    text = path.read_text(encoding="utf-8")
    assert counted("tree-sitter", text) == counted("lark", text)


@pytest.mark.parametrize("text", ["x[end]", "x[end - 1, f(end)]", "initial()", "x[1:end]"])
def test_words_that_are_told_apart_by_what_follows(made, text):
    whole = f"model A\n  Real x[3];\ninitial /* a */ equation\n  y = {text};\nequation\n  y = {text};\nend A;"
    automaton("tree-sitter").parse(whole)


@pytest.mark.skipif(shutil.which("tree-sitter") is None, reason="tree-sitter is not installed")
def test_tree_sitter_reads_every_model(tmp_path):
    shutil.copytree(FOLDER, tmp_path / "grammar")
    here = {"cwd": tmp_path / "grammar", "check": True, "capture_output": True}
    subprocess.run(["tree-sitter", "generate"], **here)
    subprocess.run(["tree-sitter", "parse", "--quiet", *map(str, MODELS)], **here)
