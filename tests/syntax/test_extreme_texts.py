"""Texts that nobody would write by hand: they are understood or refused with a place, never with a traceback."""

from bisect import bisect_left

import pytest

import lmoc
from lmoc.messages.diagnostics import ModelError, Report, render
from lmoc.messages.source import Source
from lmoc.sources.files import read_source
from lmoc.syntax.automaton import MOST_PENDING
from lmoc.syntax.format import format
from lmoc.syntax.outline import outline
from lmoc.syntax.parse import MOST_ERRORS, parse

# Each makes a text that is nested n levels deep, in one way of the language.
NESTED = {
    "parentheses": lambda n: f"model M Real x = {'(' * n}time{')' * n}; end M;",
    "signs": lambda n: f"model M Real x = {'-(' * n}time{')' * n}; end M;",
    "arrays": lambda n: f"model M Real x = sum({'{' * n}time{'}' * n}); end M;",
    "choices": lambda n: f"model M Real x = {'if time > 1 then 1 else ' * n}2; end M;",
    "calls": lambda n: f"model M Real x = {'sin(' * n}time{')' * n}; end M;",
    "powers": lambda n: f"model M Real x = {'(2^' * n}time{')' * n}; end M;",
    "functions": lambda n: (
        "function f input Real x; output Real y = x; algorithm end f;"
        f"model M Real x = {'f(' * n}time{')' * n}; end M;"
    ),
    "branches": lambda n: f"model M Real x; equation {'if true then ' * n}x = 1;{' end if;' * n} end M;",
    "loops": lambda n: (
        f"model M Real x; equation {' '.join(f'for i{k} in 1:1 loop' for k in range(n))}"
        f" x = 1;{' end for;' * n} end M;"
    ),
    "classes": lambda n: (
        f"{' '.join(f'package P{k}' for k in range(n))} model M Real x = 1; end M;"
        f"{' '.join(f'end P{k};' for k in reversed(range(n)))}"
    ),
}


def errors(text: str) -> list[str]:
    try:
        lmoc.compile_text(text)
    except ModelError as error:
        return [d.code for d in error.diagnostics if d.severity == "error"]
    return []


@pytest.mark.parametrize("kind", NESTED)
@pytest.mark.parametrize("levels", [10, 30])
def test_what_is_nested_as_deep_as_a_person_might(kind: str, levels: int) -> None:
    text = NESTED[kind](levels)
    assert errors(text) == []
    report = Report()
    file = parse(Source("deep.lmo", text), report)
    assert format(file) and list(outline(file))


@pytest.mark.parametrize("kind", NESTED)
def test_as_deep_as_the_parser_lets_pass_all_stages_go(kind: str) -> None:
    def refused(n: int) -> bool:
        report = Report()
        parse(Source("deep.lmo", NESTED[kind](n)), report)
        return bool(report.errors)

    deepest = bisect_left(range(MOST_PENDING + 1), True, key=refused) - 1
    assert errors(NESTED[kind](deepest)) == []
    assert errors(NESTED[kind](deepest + 1)) == ["E0123"]


def test_nested_too_deeply_is_said_once_at_its_place() -> None:
    with pytest.raises(ModelError) as caught:
        lmoc.compile_text("model M\n  Real x = " + "-(" * 5000 + "1;\nend M;")
    (only,) = caught.value.diagnostics
    assert (only.code, only.span.line) == ("E0123", 2)
    assert len(render(only)) < 1000


@pytest.mark.parametrize(
    "text",
    [
        "\n".join(f"model P{k} P{k + 1} p; end P{k};" for k in range(1500)) + " model P1500 Real x = 1; end P1500;",
        "\n".join(f"model P{k} extends P{k + 1}; end P{k};" for k in range(1500)) + " model P1500 end P1500;",
    ],
    ids=["parts", "bases"],
)
def test_a_model_of_a_thousand_levels_is_refused(text: str) -> None:
    assert errors(text) == ["E0227"]


def test_long_sums_have_no_limit() -> None:
    text = f"model M Real x = time{' + 2*time' * 3000}; end M;"
    dae = lmoc.compile_text(text)
    assert dae.simulate(stop=1, points=2)["x"][-1] == pytest.approx(6001)
    report = Report()
    assert sum(1 for _ in outline(parse(Source("long.lmo", text), report))) > 10_000


def test_a_power_that_overflows_is_no_traceback() -> None:
    assert errors("model M Real x = 10^(10^10); Real y = (-2)^(10^400); Real z = (-2)^0.5; end M;") == []


def test_a_long_name_is_cut_in_messages() -> None:
    with pytest.raises(ModelError) as caught:
        lmoc.compile_text(f"model M Real {'a' * 50_000} = {'b' * 50_000}; end M;")
    assert all(len(line) < 1000 for line in str(caught.value).splitlines())


def test_only_so_many_errors_of_one_text() -> None:
    report = Report()
    parse(Source("noise.lmo", "".join(map(chr, range(0x4E00, 0x4F00, 2))).replace("", " ")), report)
    assert len(report.diagnostics) == MOST_ERRORS


def test_what_cannot_be_seen_is_named_by_its_number() -> None:
    report = Report()
    parse(Source("odd.lmo", "model M\n  Real x\x07 = 1;\nend M;"), report)
    assert [d.message for d in report.diagnostics] == ["the character U+0007 means nothing here"]


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_end_in_three_ways(tmp_path, end: str) -> None:
    path = tmp_path / "ends.lmo"
    path.write_bytes(end.join(["model M // a comment", "  Real x = ;", "end M;"]).encode())
    report = Report()
    parse(read_source(path), report)
    assert [(d.code, d.span.line) for d in report.diagnostics] == [("E0117", 2)]


def test_a_mark_for_what_is_missing_before_a_tab_is_one_column_wide() -> None:
    report = Report()
    parse(Source("tab.lmo", "model M\n\tReal x =\t;\nend M;"), report)
    assert render(report.diagnostics[0]).splitlines()[3:5] == ["2 |     Real x =    ;", "  |             ^"]


def test_long_lines_with_wide_characters_are_cut_too() -> None:
    report = Report()
    text = f'model M\n  Real x = 1 "{"長" * 500}"; Real y = ; Real z = 1 "{"長" * 500}";\nend M;'
    parse(Source("wide.lmo", text), report)
    line, mark = render(report.diagnostics[0]).splitlines()[3:5]
    assert len(line) < 130 and "Real y =" in line
    columns = sum(2 if char == "長" else 1 for char in line[: line.index("Real y =") + len("Real y =")])
    assert mark.index("^") == columns


@pytest.mark.parametrize(
    "text",
    [
        "model A Real x = y[end" + "/**//**/" * 1000 + "z]; end A;",
        "model A Real x; initial" + "/**//**/" * 1000 + " x = 1; end A;",
        "model A end A;" + "/*\n" * 3000,
        "model A end A;" + "[end/*" * 3000,
        "model A end A;" + "initial/*" * 3000,
        "model A Real x = " + "1 " * 3000 + "; end A;",
    ],
)
def test_patterns_of_the_lexer_take_linear_time(text: str) -> None:
    """Each of these took minutes, or longer than anybody would wait, with a pattern that backtracks."""
    assert errors(text)
