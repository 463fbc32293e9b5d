"""The parser's tables that come with the package."""

from lmoc.syntax import tables


def test_the_packaged_tables_are_those_of_the_grammar():
    """`make grammar` writes them anew."""
    grammar = tables.grammar_text()
    assert tables.packaged(grammar) == tables.build(grammar)


def test_tables_of_another_grammar_are_not_taken():
    assert tables.packaged(tables.grammar_text() + "\n") is None


def test_a_damaged_entry_of_the_cache_is_made_anew(monkeypatch):
    monkeypatch.setattr(tables.cache, "read", lambda name, key: b"not marshalled")
    monkeypatch.setattr(tables.cache, "write", lambda *_: None)
    assert tables.load.__wrapped__().literals == tables.load().literals
