"""The standard layout says the same as the text, keeps its comments, and is left as it is when applied again."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from oracles.syntax_trees import expressions, files

from lmoc.messages.diagnostics import Report, render
from lmoc.messages.source import Source
from lmoc.syntax import text, tree
from lmoc.syntax.format import format
from lmoc.syntax.lexer import comments, scan
from lmoc.syntax.lines import WIDTH, broken
from lmoc.syntax.node import alike
from lmoc.syntax.parse import parse
from lmoc.syntax.tables import load

ROOT = Path(__file__).parents[2]
PROGRAMS = sorted([*ROOT.glob("stdlib/*.lmo"), *ROOT.glob("models/**/*.lmo")])


def read(written: str) -> tree.File:
    report = Report()
    file = parse(Source("test.lmo", written), report)
    assert not report.diagnostics, "\n".join(map(render, report.diagnostics)) + "\n" + written
    return file


@settings(max_examples=100, suppress_health_check=list(HealthCheck))
@given(expressions)
def test_expressions_survive(e: tree.Expression) -> None:
    equation = read(f"model M equation {text.simple(e)} = 0; end M;").classes[0].equations[0]
    assert alike(equation.left, e)


@settings(max_examples=30, suppress_health_check=list(HealthCheck))
@given(files)
def test_files_survive(file: tree.File) -> None:
    assert alike(read(format(file)), file)


@pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: path.stem)
def test_programs_survive_with_their_comments(path: Path) -> None:
    original = Source(path.name, path.read_text(encoding="utf-8"))
    file = parse(original, Report())
    written = format(file)
    again = read(written)
    assert alike(again, file)
    assert [c.text.rstrip() for c in comments(again.span.source)] == [c.text.rstrip() for c in comments(original)]
    assert format(again) == written


@settings(max_examples=60)
@given(st.sampled_from(PROGRAMS), st.lists(st.tuples(st.integers(0, 10**4), st.booleans()), max_size=6))
def test_comments_anywhere_are_kept(path: Path, places: list) -> None:
    written = path.read_text(encoding="utf-8")
    tokens, _ = scan(Source(path.name, written), load())
    for number, (place, whole_line) in enumerate(sorted(places, reverse=True)):
        at = tokens.starts[place % len(tokens.starts)]
        comment = f" // comment {number}\n" if whole_line else f" /* comment {number} */ "
        written = written[:at] + comment + written[at:]
        tokens, _ = scan(Source(path.name, written), load())
    file = read(written)
    again = read(format(file))
    assert alike(again, file)
    kept, given_ones = ([c.text.strip() for c in comments(f.span.source)] for f in (again, file))
    assert sorted(kept) == sorted(given_ones)


def test_the_layout() -> None:
    written = """// about
model  A  // what it is
  /* a block
     comment */
  Real x(start=1,fixed = true)=2  "pos";  // m

  Real[3] y , z [2];
protected Real w;
equation
  // motion
  der( x ) = -(x);for i in 1:3 loop // all
  y[ i ] =i*(2+3);
  // last
  end for;
end A;
"""
    assert format(read(written)) == """// about
model A  // what it is
  /* a block
     comment */
  Real x(start = 1, fixed = true) = 2 "pos";  // m

  Real y[3], z[2, 3];
protected
  Real w;
equation
  // motion
  der(x) = -x;
  for i in 1:3 loop  // all
    y[i] = i*(2 + 3);
    // last
  end for;
end A;
"""


@pytest.mark.parametrize(
    "line",
    [
        "  Mass body[100](" + ", ".join(f"attribute{i}(start = {i}, fixed = true)" for i in range(9)) + ");",
        "  Real x(unit = \"m\") = " + " + ".join(f"a{i}*b{i}" for i in range(40)) + ' "a  sum, (of) products";',
        "  connect(" + "a" * 130 + ", b);",
        "  x = if " + " and ".join(f"condition{i}" for i in range(20)) + " then f(1, 2) else g(3, 4);",
    ],
    ids=["list", "sum", "long name", "condition"],
)  # fmt: skip
def test_long_lines(line: str) -> None:
    pieces = broken(line)
    assert " ".join(piece.strip() for piece in pieces).replace("( ", "(") == line.strip()
    assert all(len(piece) <= WIDTH or " " not in piece.strip() for piece in pieces)


def test_a_comment_inside_a_heading_is_kept() -> None:
    written = format(read("model A Real x; initial /* at first */ equation // told\n x = 1; end A;"))
    assert "/* at first */" in written and "// told" in written


def test_a_sum_of_thousands_of_terms() -> None:
    total = " + ".join(f"x{i}" for i in range(5000))
    (equation,) = read(f"model M equation {total} = 0; end M;").classes[0].equations
    assert text.simple(equation.left) == total


def test_declarations_and_products_are_cut_without_a_staircase() -> None:
    names = ", ".join(f"position{i}(start = {i}.5, fixed = true)" for i in range(12))
    first, *rest = broken(f"  Real {names};")
    assert {len(piece) - len(piece.lstrip()) for piece in rest} == {6}
    assert all(piece.endswith((",", ";")) for piece in (first, *rest))
    product = " + ".join(f"inertia{i}*der(omega{i})" for i in range(8))
    assert all(len(piece) <= WIDTH for piece in broken(f"  {product} = {product};"))


def test_a_description_longer_than_a_line_is_written_once() -> None:
    text = f'model M\n  parameter Real x = 1\n    "{"long " * 40}";\nend M;\n'
    assert format(read(text)) == text
