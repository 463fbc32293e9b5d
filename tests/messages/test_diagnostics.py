"""How a diagnostic looks as text."""

import pytest

from lmoc.messages.diagnostics import Diagnostic, Label, ModelError, Report, nearest, render
from lmoc.messages.source import Source, Span


def show(text: str, start: int, end: int, **more: object) -> str:
    source = Source("scene.lmo", text)
    more["labels"] = tuple(Label(Span(source, a, b), told) for a, b, told in more.get("labels", ()))
    return render(Diagnostic("E0101", "something is wrong", Span(source, start, end), **more))


def test_the_parts_of_a_message() -> None:
    assert show("model A\n  Real x;\n", 10, 14, expected="this", found="that", hint="do it") == (
        "error[E0101]: something is wrong\n"
        " --> scene.lmo:2:3\n"
        "  |\n"
        "2 |   Real x;\n"
        "  |   ^^^^\n"
        "  = expected: this\n"
        "  = found: that\n"
        "  = hint: do it"
    )


def test_without_a_place() -> None:
    assert render(Diagnostic("W0611", "no place")) == "warning[W0611]: no place"


def test_several_lines_show_their_first_and_last() -> None:
    text = "a\n  for i in 1:3 loop\n    x[i] = 1;\n    y = 2;\n  end for;\n"
    assert show(text, 4, text.index(";\n", 40)).splitlines()[1:] == [
        " --> scene.lmo:2:3",
        "  |",
        "2 |   for i in 1:3 loop",
        "  |   ^^^^^^^^^^^^^^^^^",
        "3 |     x[i] = 1;",
        "4 |     y = 2;",
        "  |     ^^^^^",
    ]


def test_labels_stand_in_the_order_of_the_text() -> None:
    text = "m(a = 1\n\n\n\n\n\n\n\nb = 2;\n"
    end, b = text.index(";"), text.index("b")
    shown = show(text, end, end + 1, labels=[(1, 2, "opened here"), (b, b + 1, "this")])
    assert shown.splitlines()[1:] == [
        " --> scene.lmo:9:6",
        "  |",
        "1 | m(a = 1",
        "  |  - opened here",
        " ...",
        "9 | b = 2;",
        "  |      ^",
        "  | - this",
    ]


def test_a_label_in_another_file() -> None:
    here, there = Source("a.lmo", "x\n"), Source("stdlib/b.lmo", "\n\nmodel B\n")
    first = Label(Span(there, 2, 7), "the first")
    shown = render(Diagnostic("E0201", "two of them", Span(here, 0, 1), labels=(first,)))
    assert " --> a.lmo:1:1" in shown and " --> stdlib/b.lmo:3:1" in shown and "  | ----- the first" in shown


def test_tabs_keep_the_mark_below_its_place() -> None:
    line, mark = show("\tReal\tx = y;", 10, 11).splitlines()[-2:]
    assert line == "1 |     Real    x = y;" and mark.index("^") == line.index("y")


def test_wide_characters_keep_the_mark_below_its_place() -> None:
    line, mark = show('x "力" = y;', 8, 9).splitlines()[-2:]
    assert mark.index("^") == line.index("y") + 1  # the character takes two columns


def test_long_lines_are_shown_around_the_mark() -> None:
    text = "x" * 300 + "HERE" + "y" * 300
    line, mark = show(text, 300, 304).splitlines()[-2:]
    assert len(line) < 140 and line.count("…") == 2
    assert line[mark.index("^") : mark.rindex("^") + 1] == "HERE"


LONG = "abcdefghij" * 40


@pytest.mark.parametrize(
    ("start", "end", "marked", "labels"),
    [
        (200, 390, LONG[200:289] + "…", []),  # the mark is cut with the text
        (5, 15, LONG[5:15], [(300, 320, "…")]),  # below the dots: it is there somewhere
        (5, 15, LONG[5:15], [(100, 200, LONG[100:119] + "…")]),
        (300, 320, LONG[300:320], [(5, 10, "…")]),  # the main mark is seen
        (80, 90, LONG[80:90], [(40, 50, LONG[40:50])]),
        (395, 400, LONG[395:400], []),
        (400, 401, "", []),  # behind the end of the line
    ],
)
def test_marks_do_not_run_past_a_line_that_is_cut(start, end, marked, labels) -> None:
    line, *marks = show(LONG, start, end, labels=[(a, b, "") for a, b, _ in labels]).splitlines()[3:]
    below = [line[min(row.index(sign) for sign in "^-" if sign in row) : len(row)].rstrip() for row in marks]
    assert below == [marked.rstrip(), *(text.rstrip() for _, _, text in labels)]
    assert all(len(row) <= len(line) + (start == len(LONG)) for row in marks)


@pytest.mark.parametrize("text", ["", "x", "x\n", "\n\n", "x\r\ny\r\n"])
def test_the_end_of_a_text(text: str) -> None:
    shown = show(text, len(text), len(text))
    assert shown.splitlines()[-1].count("^") == 1 and "\r" not in shown


def test_a_report_raises_all_that_it_holds() -> None:
    report = Report()
    report.warning("W0102", "only a warning")
    report.check()
    report.error("E0101", "first")
    report.error("E0102", "second")
    with pytest.raises(ModelError) as raised:
        report.check()
    assert [d.code for d in raised.value.diagnostics] == ["W0102", "E0101", "E0102"]
    assert "first" in str(raised.value) and "second" in str(raised.value)


def test_the_nearest_name() -> None:
    assert nearest("sping", ["spring", "damper"]) == "did you mean 'spring'?" and nearest("q", ["spring"]) == ""
