"""Texts that are wrong anywhere: every question has an answer, and a change that is read alone gives the same one."""

import random
from pathlib import Path

import pytest

pytest.importorskip("lsprotocol")

from lmoc.editor import colours, hints, outline  # noqa: E402
from lmoc.editor.analysis import analyse  # noqa: E402
from lmoc.editor.answers import Answers  # noqa: E402
from lmoc.editor.completion import proposals, signature  # noqa: E402
from lmoc.editor.describe import markdown  # noqa: E402
from lmoc.editor.names import at, occurrences  # noqa: E402
from lmoc.editor.pieces import Reading, read  # noqa: E402
from lmoc.editor.positions import position  # noqa: E402
from lmoc.messages.diagnostics import ModelError  # noqa: E402
from lmoc.syntax.layout import formatted  # noqa: E402

MODELS = sorted((Path(__file__).parents[2] / "models").rglob("*.lmo"))
SNIPPETS = [
    "(",
    ")",
    ";",
    "connect(",
    "Spring s(",
    ".",
    '"',
    "/*",
    "end",
    " = ",
    "for i in 1:3 loop",
    "'",
    "\n",
    "α",
    "𝑥",
    "[",
    ",",
]


def edited(rng: random.Random, text: str) -> str:
    """The text after one change as by a person: something typed, or something taken away."""
    at = rng.randrange(len(text))
    if rng.random() < 0.5:
        return text[:at] + rng.choice(SNIPPETS) + text[at:]
    return text[:at] + text[at + rng.randrange(1, 30) :]


def in_a_package(rng: random.Random, text: str) -> str:
    """The text with some of its classes in a package, and some in one inside of it."""
    lines = [f"  {line}\n" if line else "\n" for line in text.split("\n")]
    inner = "  package Inner\n    constant Real c = 2;\n  end Inner;\n" if rng.random() < 0.5 else ""
    return f"package Pack\n  constant Real c = 1;\n{inner}{''.join(lines)}end Pack;\n"


def asked(analysis, offset: int) -> list[str]:
    """The answers at a place, as far as they can be compared."""
    found = at(occurrences(analysis, offset), offset)
    takes = signature(analysis, offset)
    return [
        markdown(found) if found else "",
        takes.label if takes else "",
        *(p.name for p in proposals(analysis, offset)),
    ]


def shown(answers: Answers) -> list:
    """The answers about a whole text."""
    return [
        answers.tokens(),
        sorted(answers.units(), key=str),
        list(answers.models()),
        list(answers.runnable()),
        list(answers.symbols()),
        list(answers.folds()),
        answers.formatted(),
    ]


def from_the_whole(text: str, path: str) -> list:
    """The same without pieces: colours, units, and the layout."""
    analysis = analyse(text, path)
    names = occurrences(analysis)
    source = analysis.source
    try:
        laid_out = formatted(source)
    except ModelError:
        laid_out = None
    units = [(position(source, h.at), h.text) for h in hints.units(analysis, names)]
    return [colours.encoded(source, names), sorted(units, key=str), laid_out]


def at_place(reading: Reading, place: int) -> list[str]:
    """The answers at a place."""
    k, own = reading.at(place)
    return asked(reading.analysis(k, reading.opened()), own)


@pytest.mark.parametrize("seed", range(15))
def test_every_question_has_an_answer(seed):
    rng = random.Random(seed)
    path = rng.choice(MODELS)
    text = path.read_text()
    for _ in range(3):
        text = edited(rng, text)
        analysis = analyse(text, str(path))
        names = occurrences(analysis)
        assert all(0 <= o.start <= o.end <= len(text) for o in names)
        colours.encoded(analysis.source, names)
        (
            list(hints.units(analysis, names)),
            list(hints.runnable(analysis)),
            outline.symbols(analysis),
            list(outline.folds(analysis)),
        )
        for offset in (rng.randrange(len(text) + 1), len(text), 0):
            asked(analysis, offset)


@pytest.mark.parametrize("seed", range(8))
def test_what_is_not_read_again_gives_the_answers_of_the_whole_text(seed):
    rng, path = random.Random(1000 + seed), "/nowhere/scene.lmo"
    text = "\n".join(p.read_text() for p in rng.sample(MODELS, 3))
    text = in_a_package(rng, text) if seed % 2 else text
    reading = read(path, text)
    answers = Answers(reading)
    for _ in range(2):  # the second one in a text that is wrong, often
        shown(answers)
        text = edited(rng, text)
        reading = read(path, text, reading.pieces)
        fresh, answers = read(path, text), Answers(reading, answers)
        found = shown(answers)
        assert found == shown(Answers(fresh))
        assert [found[0], found[1], found[6]] == from_the_whole(text, path)
        place = rng.randrange(len(text))
        assert at_place(reading, place) == at_place(fresh, place)
        names = occurrences(analyse(text, path))
        for o in rng.sample(names, min(10, len(names))):
            of, found = at(names, o.start), answers.declared(o.start)
            places = [] if found is None else answers.places(found.file, found.start, found.words)
            same = [n for n in names if of.declared is not None and n.declared is not None
                    and (n.declared.source.name, n.declared.start) == (of.declared.source.name, of.declared.start)]
            assert o.start == o.end or [(s.start, s.end) for s in places] == [(n.start, n.end) for n in same]


def test_declarations_matter_to_those_who_use_them_through_others():
    parts = {
        "length": 'type Length = Real(unit="m");\n',
        "bar": "model Bar\n  parameter Length l = 1;\nend Bar;\n",
        "frame": "model Frame\n  Bar bar(l = 2);\nequation\n  0 = time;\nend Frame;\n",
        "other": "model Other\n  Real x = 3;\nend Other;\n",
    }
    first = read("/nowhere/scene.lmo", "".join(parts.values()))
    answers = Answers(first)
    assert [text for _, text in answers.units()] == [" m", " m"]
    parts["length"] = 'type Length = Real(unit="mm");\n'
    second = read("/nowhere/scene.lmo", "".join(parts.values()), first.pieces)
    assert [text for _, text in Answers(second, answers).units()] == [" mm", " mm"]
    assert [a is b for a, b in zip(first.pieces, second.pieces)] == [False, True, True, True]
    assert [a == b for a, b in zip(first.uses, second.uses)] == [False, False, False, True]
    parts["frame"] = parts["frame"].replace("time", "2*time")  # an equation is nobody else's
    third = read("/nowhere/scene.lmo", "".join(parts.values()), second.pieces)
    assert [a == b for a, b in zip(second.uses, third.uses)] == [True, True, True, True]


def test_of_a_package_only_the_class_that_changes_is_read_again():
    text = """package Pack
  constant Real g = 9.81;
  model One
    Real x = g;
  end One;
  package Inner
    model Two
      extends One;
    end Two;
  end Inner;
  model Three
    Real y = 1;
  end Three;
end Pack;
"""
    path = "/nowhere/pack.lmo"
    first = read(path, text)
    edits = ("x = g", "x = 2*g", True), ("y = 1", "y = 1 + ", False), ("ds One;", "ds One; Real z;", True)
    for old, new, right in edits:
        changed = text.replace(old, new, 1)
        second = read(path, changed, first.pieces)
        again = [p for p in second.pieces if p not in first.pieces]
        assert len(second.pieces) == 4 and len(again) == 1 and again[0].right == right and new in again[0].source.text
        assert shown(Answers(second))[:2] == from_the_whole(changed, path)[:2]
        assert "".join(second.pieces[s.piece].source.text[s.start : s.end] for s in second.stretches) == changed
    assert [sorted(n) for n in first.needs] == [[0], [0, 1], [0, 1, 2], [0, 3]]
    commented = read(path, text.replace("= 9.81;", "= 9.81; /*").replace("  package", "*/  package"))
    assert [e.name for e in commented.file.classes[0].elements] == ["g", "Inner", "Three"]


def test_the_tokens_that_an_editor_has_become_the_new_ones():
    rng = random.Random(5)
    for _ in range(50):
        before = [rng.randrange(3) for _ in range(rng.randrange(12))]
        after = [rng.randrange(3) for _ in range(rng.randrange(12))]
        for start, gone, new in colours.edits(before, after):
            before = before[:start] + new + before[start + gone :]
        assert before == after
