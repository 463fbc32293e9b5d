"""Renaming: everything goes on to mean what it meant, or it is refused."""

import random
import re
from pathlib import Path

import pytest

pytest.importorskip("lsprotocol")

from lmoc.editor.analysis import analyse  # noqa: E402
from lmoc.editor.answers import Answers  # noqa: E402
from lmoc.editor.names import occurrences  # noqa: E402
from lmoc.editor.pieces import read  # noqa: E402
from lmoc.editor.rename import RenameRefused, rename  # noqa: E402

MODELS = sorted((Path(__file__).parents[2] / "models").rglob("*.lmo"))
TEXT = """package P
  model Base
    parameter Real k = 1;
    replaceable model Law = Linear;
    Law law(k = k);
  end Base;
  model Linear
    parameter Real k = 2;
    Real f = k;
  end Linear;
  model Derived
    extends Base(k = 3);
    redeclare model Law = Cubic;
    Real q = k + sum(k * i for i in 1:3);
  end Derived;
  model Cubic
    extends Linear;
  end Cubic;
  function scaled
    input Real factor;
    input Real x;
    output Real y = factor * x;
  end scaled;
  model Top
    import F = P.scaled;
    inner Real g = 9;
    Derived d(k = 4);
    Real 'a b' = F(factor = 2, x = d.k) + scaled(factor = 3, x = 'a c');
    Real 'a c' = d.law.f;
  end Top;
  model Shown
    parameter Boolean flag = true;
    parameter Real size = 1 annotation(Dialog(enable = flag));
    annotation(Icon(graphics = {Line(points = {{0, 0}, {1, 1}}, visible = not flag)}));
  end Shown;
end P;
"""


def spans_of(text: str, offset: int, new: str, path: str, others=()):
    return rename(Answers(read(path, text)), offset, new, lambda _: others, frozenset({"model"}))


def renamed(text: str, offset: int, new: str, path: str = "/nowhere/p.lmo") -> str:
    for s in sorted(spans_of(text, offset, new, path), key=lambda s: -s.start):
        text = text[: s.start] + new + text[s.end :]
    return text


def after(text: str, place: str, new: str) -> str:
    return renamed(text, text.index(place), new)


@pytest.mark.parametrize(
    ("place", "new", "changed"),
    [
        ("k = 1", "c", {"parameter Real k = 1": "parameter Real c = 1", "law(k = k)": "law(k = c)", "Base(k": "Base(c",
                        "q = k + sum(k *": "q = c + sum(c *", "d(k = 4)": "d(c = 4)", "d.k": "d.c"}),
        ("k = 2", "c", {"parameter Real k = 2": "parameter Real c = 2", "f = k": "f = c", "law(k = k)": "law(c = k)"}),
        ("factor;", "by", {"input Real factor": "input Real by", "y = factor": "y = by", "F(factor": "F(by",
                           "scaled(factor": "scaled(by"}),
        ("scaled\n", "times", {"function scaled": "function times", "P.scaled": "P.times", "+ scaled(": "+ times(",
                               "end scaled": "end times"}),
        ("flag = t", "on", {"flag = true": "on = true", "enable = flag": "enable = on", "not flag": "not on"}),
        ("i for", "j", {"k * i for i": "k * j for j"}),
        ("'a b'", "'b a'", {"'a b'": "'b a'"}),
        ("Top", "'The top'", {"model Top": "model 'The top'", "end Top": "end 'The top'"}),
    ],
)  # fmt: skip
def test_all_places_of_a_name_change(place, new, changed):
    expected = TEXT
    for old, text in changed.items():
        assert expected.count(old) == 1
        expected = expected.replace(old, text)
    assert after(TEXT, place, new) == expected


@pytest.mark.parametrize(
    ("place", "new", "why"),
    [
        ("k = 1", "q", "there is a 'q' in 'P.Derived'"),
        ("k = 1", "law", "there is a 'law'"),
        ("k = 1", "i", "would mean something else"),  # where a sum has an index of this name
        ("k = 1", "time", "a meaning everywhere"),
        ("k = 1", "model", "is not a name"),
        ("k = 1", "2k", "is not a name"),
        ("Law = L", "Rule", "'Law' is redeclared"),
        ("g = 9", "h", "inner or outer"),
        ("F(fac", "G", "another name of 'scaled'"),
        ("Linear;\n    Law", "Cubic", "there is a 'Cubic' in 'P'"),
        ("Real k", "Length", "no name of this text"),
    ],
)
def test_what_would_change_a_meaning_is_refused(place, new, why):
    with pytest.raises(RenameRefused, match=re.escape(why)):
        after(TEXT, place, new)


def test_a_class_that_its_file_is_named_after_is_refused_where_others_use_it(tmp_path):
    part, scene = tmp_path / "Part.lmo", tmp_path / "scene.lmo"
    part.write_text("model Part\n  parameter Real size = 1;\nend Part;\n")
    scene.write_text("model Scene\n  Part part(size = 2);\nend Scene;\n")
    texts = {p: Answers(read(str(p), p.read_text())) for p in (part, scene)}
    found = spans_of(part.read_text(), part.read_text().index("size"), "length", str(part), [texts[scene]])
    assert [(s.source.name, s.text) for s in found] == [(str(part), "size"), (str(scene), "size")]
    with pytest.raises(RenameRefused, match="found by the name of its file"):
        spans_of(part.read_text(), part.read_text().index("Part"), "Piece", str(part), [texts[scene]])
    with pytest.raises(RenameRefused, match="in no folder of the workspace"):
        spans_of(scene.read_text(), scene.read_text().index("size"), "length", str(scene))


def meanings(text: str) -> list:
    """Each name of a text that is read as one: which it is, and which one its declaration is."""
    names = occurrences(analyse(text, "/nowhere/p.lmo"))
    which = {o.start: k for k, o in enumerate(names)}
    places = (o.declared and (which[o.declared.start] if o.declared.source.name == "/nowhere/p.lmo" else o.declared)
              for o in names)  # fmt: skip
    return [(o.role, type(o.meaning), place) for o, place in zip(names, places)]


@pytest.mark.parametrize("seed", range(3))
def test_names_mean_what_they_meant_in_the_text_read_as_one(seed):
    rng = random.Random(seed)
    text = "\n".join([TEXT, *(p.read_text(encoding="utf-8") for p in rng.sample(MODELS, 2))])
    before = meanings(text)
    names = [o for o in occurrences(analyse(text, "/nowhere/p.lmo")) if o.start < o.end]
    for o in rng.sample(names, 10):
        other = rng.choice(names)
        for new in "quite_new", text[other.start : other.end]:
            try:
                changed = renamed(text, o.start, new)
            except RenameRefused:
                continue
            assert meanings(changed) == before, (text[o.start : o.end], new)
