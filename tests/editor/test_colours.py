"""The grammars that editors colour by know the words of the language's own grammar, and every model."""

import json
import re
from pathlib import Path

import pytest
from pygments.token import Error, Keyword, Name, Number

import lmoc.semantics.flatten  # noqa: F401  registers every function: pre, edge, cardinality, …
from lmoc.editor import highlight
from lmoc.editor.highlight import LmoLexer
from lmoc.semantics.classes.predefined import BUILTINS
from lmoc.semantics.values.builtins import BUILTIN_FUNCTIONS
from lmoc.syntax.tables import load

ROOT = Path(__file__).parents[2]
TEXTMATE = json.loads((ROOT / "editors/textmate/lmo.tmLanguage.json").read_text())["repository"]
LISTS = ("CLASSES", "PREFIXES", "CONTROL", "WORD_OPERATORS", "CONSTANTS")


def words(name: str) -> set[str]:
    return set(getattr(highlight, name))


def test_keywords_are_those_of_the_grammar():
    keywords = {word for word in load().literals if word.isidentifier()}
    known = [word for name in LISTS for word in getattr(highlight, name)]
    assert len(known) == len(set(known))
    assert set(known) | {"der"} == keywords  # der is coloured as a function
    assert words("TYPES") == set(BUILTINS)
    elsewhere = {"time", "assert", "terminate", "reinit"}
    assert words("FUNCTIONS") >= {name for name in BUILTIN_FUNCTIONS if name[0].islower() and name != "initial"}
    assert words("FUNCTIONS") - elsewhere <= set(BUILTIN_FUNCTIONS)


@pytest.mark.parametrize(
    ("rule", "name"),
    [("declaration", "CLASSES"), ("control", "CONTROL"), ("prefix", "PREFIXES"), ("type", "TYPES"),
     ("function", "FUNCTIONS"), ("constant", "CONSTANTS"), ("operator_word", "WORD_OPERATORS")],
)  # fmt: skip
def test_textmate_has_the_same_words(rule, name):
    listed = re.search(r"\\b\(([\w|]+)\)\\b", TEXTMATE[rule]["match"])[1]
    assert set(listed.split("|")) == words(name)


def test_the_extension_has_the_grammar_of_the_repository():
    package = json.loads((ROOT / "editors/vscode/package.json").read_text())
    (grammar,) = package["contributes"]["grammars"]
    assert grammar["scopeName"] == json.loads((ROOT / "editors/textmate/lmo.tmLanguage.json").read_text())["scopeName"]
    for snippet in package["contributes"]["snippets"]:
        assert json.loads((ROOT / "editors/vscode" / snippet["path"]).read_text())


@pytest.mark.parametrize("path", sorted((ROOT / "models").rglob("*.lmo"))[::4], ids=lambda p: p.stem)
def test_pygments_knows_every_character_of_a_model(path):
    text = path.read_text()
    tokens = list(LmoLexer(ensurenl=False, stripnl=False).get_tokens(text))
    assert not [value for kind, value in tokens if kind is Error]
    assert "".join(value for _, value in tokens) == text


def test_pygments_tells_classes_names_and_numbers():
    found = {value: kind for kind, value in LmoLexer().get_tokens("model A Real x = 2e-3*sin(time); end A;")}
    assert found["A"] is Name.Class and found["Real"] is Keyword.Type and found["2e-3"] is Number
    assert found["sin"] is Name.Builtin and found["x"] is Name


def test_pygments_finds_it_by_name():
    from pygments.lexers import get_lexer_by_name

    assert get_lexer_by_name("lmo").name == "lmo"
