"""Texts that are wrong anywhere: every question has an answer, and a change that is read alone gives the same one."""

import random
from pathlib import Path

import pytest

pytest.importorskip("lsprotocol")

from lmoc.editor import colours, hints, outline  # noqa: E402
from lmoc.editor.analysis import analyse, with_change  # noqa: E402
from lmoc.editor.completion import proposals, signature  # noqa: E402
from lmoc.editor.describe import markdown  # noqa: E402
from lmoc.editor.names import at, occurrences  # noqa: E402
from lmoc.syntax.node import walk  # noqa: E402
from lmoc.syntax.outline import outline as tree_lines  # noqa: E402

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


def asked(analysis, offset: int) -> list[str]:
    """The answers at a place, as far as they can be compared."""
    found = at(occurrences(analysis, offset), offset)
    takes = signature(analysis, offset)
    return [
        markdown(found) if found else "",
        takes.label if takes else "",
        *(p.name for p in proposals(analysis, offset)),
    ]


def shown(analysis, part) -> list:
    """The trees and names of a part of a text, with their places."""
    own = [c for c in analysis.placed if part.start <= c.span.start < part.end]
    places = [(n.span.start, n.span.end) for n in walk(own) if getattr(n, "span", None) is not None]
    names = [
        (o.start, o.end, o.role, markdown(o))
        for c in own
        for o in occurrences(analysis, c.name_span.start)
    ]
    return [*(line for c in own for line in tree_lines(c)), places, names]


@pytest.mark.parametrize("seed", range(30))
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


@pytest.mark.parametrize("seed", range(15))
def test_a_change_inside_of_a_class_gives_the_answers_of_the_whole_text(seed):
    rng = random.Random(1000 + seed)
    text = "\n".join(p.read_text() for p in rng.sample(MODELS, 3))
    before = analyse(text, "/nowhere/scene.lmo")
    for _ in range(2):  # the second one in a text that is wrong, often
        after = edited(rng, before.source.text)
        quick, whole = with_change(before, after), analyse(after, "/nowhere/scene.lmo")
        if quick is not None:
            assert quick.mended == whole.mended and shown(quick, quick.known) == shown(whole, quick.known)
            offset = rng.randrange(*quick.known)
            assert asked(quick, offset) == asked(whole, offset)
        before = whole
