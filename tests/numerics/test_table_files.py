"""Tables as spreadsheets and instruments write them: read as they are meant, or refused; never misread."""

import random
from pathlib import Path

import numpy as np
import pytest

import lmoc
from lmoc.messages.diagnostics import Report
from lmoc.numerics.signals.decimal_marks import Ambiguous, Marks, marks_of, number
from lmoc.numerics.signals.table_files import read_table, read_tables, table_of_frame

TIMES, VALUES = [0.0, 0.5, 1.25], [1.5, -2.0, 1234.5]


def read(path: Path, text: str | bytes, name: str = "u", unit: str = "m"):
    """Times and values of a file with this content, and what is said about it."""
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    report = Report()
    points = read_table(path, name, unit, report)
    assert (points is None) == bool(report.errors)
    return (None if points is None else (points.times.tolist(), points.values.tolist())), report.diagnostics


@pytest.mark.parametrize(
    "text",
    [
        "time,u\n0,1.5\n0.5,-2\n1.25,1234.5\n",
        "time;u\n0;1.5\n0.5;-2\n1.25;1234.5",
        "time;u\n0;1,5\n0,5;-2\n1,25;1234,5\n",  # a spreadsheet in German, French, Italian
        "time;u\r\n0,00;1,50\r\n0,50;-2,00\r\n1,25;1.234,50\r\n",
        "time;u\n0,00;1,50\n0,50;-2,00\n1,25;1 234,50\n",
        "time;u\n0;1,5\n0,5;-2\n1,25;1\u202f234,5\n",  # French
        "time;u\n0;1.5\n0.5;-2\n1.25;1'234.5\n",  # Swiss
        "time;u\n0;1.5\n0.5;-2\n1.25;1\u2019234.5\n",
        'time,u\n0,1.5\n0.5,-2\n1.25,"1,234.5"\n',  # English
        'time,u\n0,"1,5"\n"0,5",-2\n"1,25","1234,5"\n',  # German numbers, separated by commas all the same
        "time\tu\n0\t1,5\n0,5\t-2\n1,25\t1234,5\n",
        "time\tu\n0\t1.5\n0.5\t-2\n1.25\t1234.5\n",
        "time u\n0 1.5\n0.5 -2\n1.25 1234.5\n",
        "  time      u\n  0.00    1.5\n  0.50   -2.0\n  1.25 1234.5  \n",
        "# time u\n0 1.5\n5e-1 -2e0\n1.25 1.2345e3\n",  # numpy.savetxt
        "# measured today, by hand; twice\n# time,u\n0,1.5\n0.5,-2\n1.25,1234.5\n",
        "% a remark\ntime,u\n0,1.5\n# in between\n0.5,-2\n1.25,1234.5\n",
        "sep=;\ntime;u\n0;1,5\n0,5;-2\n1,25;1234,5\n",
        '"time";"u"\n"0";"1,5"\n"0,5";"-2"\n"1,25";"1234,5"\n',
        "u;time\n1,5;0\n-2;0,5\n1234,5;1,25\n",
        "time;u;\n0;1,5;\n0,5;-2;\n1,25;1234,5;\n",  # an empty last column
        "time;u\n0;1,5\n0,5;-2\n1,25;1234,5\n;\n;\n\n",  # empty lines at the end
        "time;u;remark\n0;1,5;a.b\n0,5;-2;1.2.2020\n1,25;1234,5;0.5 or so\n",
        "Time;U\n0;1,5\n0,5;-2\n1,25;1234,5\n",
        "time;height\n0;1,5\n0,5;-2\n1,25;1234,5\n",
        "time;u\n0;1,5\n0,5;\u22122\n1,25;1234,5\n",  # a minus of typographers
        "time [s];u [m]\n0;1,5\n0,5;-2\n1,25;1234,5\n",
        "time in s;u in m\n0;1,5\n0,5;-2\n1,25;1234,5\n",
        "time/s;u / m\n0;1,5\n0,5;-2\n1,25;1234,5\n",
        "time;u\ns;m\n0;1,5\n0,5;-2\n1,25;1234,5\n",
        "time;u\n[s];[m]\n0;1,5\n0,5;-2\n1,25;1234,5\n",
        '"time\n[s]";"u\n[m]"\n0;1,5\n0,5;-2\n1,25;1234,5\n',
        "time [s] u [m]\n0 1.5\n0.5 -2\n1.25 1234.5\n",
        "time [ms];u [mm]\n0;1500\n500;-2000\n1250;1234500\n",
        "time;u\nmin;km\n0;0,0015\n0,00833333333333333333;-0,002\n0,0208333333333333333;1,2345\n",
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("ends", ["\n", "\r\n", "\r"])
def test_a_table_is_read(tmp_path, text, encoding, ends):
    found, said = read(tmp_path / "a.csv", text.replace("\r\n", "\n").replace("\n", ends).encode(encoding))
    assert found is not None, said
    assert found[0] == pytest.approx(TIMES, abs=1e-15) and found[1] == pytest.approx(VALUES, rel=1e-14)
    converted = "ms" in text or "min;" in text
    assert [d.code for d in said] == ["N0527"] * 2 * converted


@pytest.mark.parametrize(
    ("text", "line", "column", "words"),
    [
        ("time;u\n1;1,234\n2;2,345\n", 2, 3, "'1,234' may be 1.234 or 1234"),
        ("time;u\n1;1.234\n2;2.345\n", 2, 3, "'1.234' may be 1.234 or 1234"),
        ("time\tu\n1\t1,234\n2\t22,345\n", 2, 3, "'1,234' may be 1.234 or 1234"),
        ('time,u\n1,"1,234"\n2,"2,345"\n', 2, 3, "'1,234' may be 1.234 or 1234"),
        ("time;u\n0;0,5\n1;1.234\n", 3, 3, "'1.234' stands among numbers with a decimal comma"),
        ("time;u\n0;0.5\n1;1,234\n", 3, 3, "'1,234' stands among numbers with a decimal point"),
        ("time;u\n0,5;1.5\n1;2\n", 2, 5, "'1.5' has another decimal mark than '0,5'"),
        ("time;u\n0;1\n1;12,34,567\n", 3, 3, "'12,34,567' is not a number"),
        ("time;u\n0;1\n1;1.2.2020\n", 3, 3, "'1.2.2020' is not a number"),
        ("time;u\n0;1\n1;#WERT!\n", 3, 3, "'#WERT!' is not a number"),
        ("time;u\n0;1\n0:00:01;2\n", 3, 1, "'0:00:01' is not a number"),
        ("time;u\n0;1\n1;5 %\n", 3, 3, "'5 %' is not a number"),
        ("time;u\n0;1\n1;\n", 3, 3, "an empty cell is not a number"),
        ("time;u\n0;1\n1\n", 3, 1, "this line has 1 column, the header has 2"),
        ("time,u\n0,0,1,5\n1,0,2,5\n", 2, 1, "with decimal commas, columns are separated by semicolons"),
        ("time,u,v\n0,5;1,5\n1;2\n", 2, 1, "this line has semicolons, the header separates its columns by commas"),
        ("time,u\n0;1\n", 2, 1, "this line has semicolons"),
        ("time [s];u [N]\n0;1\n1;2\n", 1, 10, "its unit N does not measure what m does"),
        ("time [m];u\n0;1\n1;2\n", 1, 1, "its unit m does not measure what s does"),
        ("time;u [parsec]\n0;1\n1;2\n", 1, 6, "'parsec' is not a unit"),
        ("time;height (measured)\n0;1\n1;2\n", 1, 6, "'measured' is not a unit"),
        ("time;u [mm]\ns;m\n0;1\n1;2\n", 2, 1, "'s' is not a number"),
        ("0;1\n1;2\n", 1, 1, "a header line with columns 'time' and 'u'"),
        ("time;U;I\n0;1;2\n", 1, 1, "a header line with columns 'time' and 'u'"),
        ("time;a;b\n0;1;2\n", 1, 1, "a header line with columns 'time' and 'u'"),
        ("time;u [m];u [mm]\n0;1;2\n", 1, 1, "'u' occurs twice"),
        ("# nothing\n", 1, 3, "a header line"),
    ],
)  # fmt: skip
def test_a_table_that_may_mean_something_else_is_refused(tmp_path, text, line, column, words):
    found, said = read(tmp_path / "a.csv", text)
    assert found is None and said[0].code == "E0625"
    assert words in str(said[0]), str(said[0])
    assert (said[0].span.line, said[0].span.column) == (line, column)


def test_files_of_other_programs_are_named(tmp_path):
    found, (said,) = read(tmp_path / "a.xlsx", b"PK\3\4\0")
    assert found is None and said.code == "E0624" and "save the sheet as CSV" in str(said)
    found, (said,) = read(tmp_path / "a.csv", b"PK\3\4\0")
    assert found is None and said.code == "E0610" and "it is not text" in str(said)


def test_a_table_from_western_windows(tmp_path):
    found, said = read(tmp_path / "a.csv", "time;Höhe [µm]\n0;1,5\n1;2,5\n".encode("cp1252"))
    assert found == ([0, 1], pytest.approx([1.5e-6, 2.5e-6])) and [d.code for d in said] == ["N0527"]


def test_units_of_inputs(tmp_path):
    """Degrees, revolutions a minute; an input without a unit takes SI units."""
    assert read(tmp_path / "a.csv", "time,u [°]\n0,0\n1,180\n", unit="rad")[0][1][1] == pytest.approx(np.pi)
    assert read(tmp_path / "a.csv", "time,u [rpm]\n0,0\n1,60\n", unit="rad/s")[0][1][1] == pytest.approx(2 * np.pi)
    assert read(tmp_path / "a.csv", "time,u [kN]\n0,0\n1,2\n", unit="")[0][1] == [0, 2000]
    assert read(tmp_path / "a.csv", "time,u [m/s²]\n0,0\n1,2\n", unit="m/s2") == (([0, 1], [0, 2]), [])
    assert read(tmp_path / "a.csv", "time,u\n0,0\n1,2\n", unit="mm") == (([0, 1], [0, 2]), [])
    _, (said,) = read(tmp_path / "a.csv", "time,u [degC]\n0,0\n1,2\n", unit="K")
    assert "a zero of its own" in str(said)


def written(value: float, style: random.Random, decimal: str, group: str) -> str:
    """A number as a program with this locale writes it."""
    text = f"{abs(value):.{style.choice((0, 1, 2, 3, 4))}f}"
    whole, _, decimals = text.partition(".")
    if group and len(whole) > 3 and style.random() < 0.7:
        whole = f"{int(whole):,}".replace(",", group)
    return "-" * (value < 0) + whole + (decimal + decimals if decimals else "")


def meant(text: str, decimal: str, group: str) -> float:
    return float((text.replace(group, "") if group else text).replace(decimal, "."))


def test_no_random_table_is_misread(tmp_path):
    """Whatever the separator, the marks and the numbers: read as they were meant, or refused."""
    read_right = 0
    for seed in range(600):
        style = random.Random(seed)
        separator, decimal = style.choice(";\t, "), style.choice(".,")
        group = style.choice(("", "", "'", ".", ",", "\u202f"))
        if group == decimal or (separator == " " and group == "\u202f"):
            group = ""
        texts, times = [], np.cumsum([style.choice((0.5, 1.0, 1000.0, 1.234)) for _ in range(3)]).tolist()
        for t in times:
            value = style.choice((1, -1, 1e3)) * style.uniform(0, 9)
            texts.append(tuple(written(x, style, decimal, group) for x in (t, value)))
        quotes = separator in decimal + group or style.random() < 0.2
        quote = (lambda x: f'"{x}"') if quotes and style.random() < 0.8 else str
        text = separator.join(("time", "u")) + "\n" + "".join(separator.join(map(quote, row)) + "\n" for row in texts)
        found, said = read(tmp_path / "a.csv", text)
        if found is None:
            assert said[0].code == "E0625" and said[0].span is not None
            continue
        read_right += 1
        right = np.array([[meant(x, decimal, group) for x in row] for row in texts])
        assert np.array_equal(np.array(found).T, right), (text, found)
    assert read_right > 350


def test_marks_follow_from_numbers_that_can_be_read_in_one_way():
    assert marks_of(["0,5", "1,234"]) == Marks(",") and number("1,234", Marks(",")) == 1.234
    assert marks_of(["1.234,5", "1.234"]) == Marks(",", ".") and number("1.234", Marks(",", ".")) == 1234
    assert marks_of(["1,234,567", "1,234"]) == Marks(".", ",") and number("1,234", Marks(".", ",")) == 1234
    assert marks_of(["1,234"], ["0,25"]) == Marks(",") and marks_of(["12"]) == Marks(".")
    with pytest.raises(Ambiguous, match="no number of the table says which"):
        marks_of(["1,234"], ["0,25", "0.25"])
    with pytest.raises(ValueError, match="not a number"):
        number("1.5", Marks(","))


@pytest.mark.parametrize(
    "text, said",
    [
        ("time,u,v\n0,1,2\n1,2\n2,3,4\n", [("this line has 2 columns", 3)]),
        ("time,u,v\nx,1,2\n1,y,z\n", [("'x' is not a number", 2), ("'y' is", 3), ("'z' is", 3)]),
        ("t,u,v\n0,1,2\n", [("cannot be used", 1)]),
        ("time,a,b\n0,1,2\n", [("input 'u'", 1), ("input 'v'", 1)]),
        ("time,a\n0,1\n", [("input 'u'", 1), ("input 'v'", 1)]),  # a is neither
    ],
)
def test_what_is_wrong_for_several_columns_is_said_once(tmp_path, text, said):
    (tmp_path / "data.csv").write_text(text)
    assert read_tables(tmp_path / "data.csv", {"u": "m", "v": "m"}, report := Report()) == {}
    assert len(report.errors) == len(said)
    assert all(words in d.message and d.span.line == line for d, (words, line) in zip(report.errors, said))


def test_a_data_frame_is_read_by_its_names():
    pandas = pytest.importorskip("pandas")
    report = Report()
    points = table_of_frame(pandas.DataFrame({"u [mm]": [1.0, 2.0], "time": [0.0, 1.0]}), "u", "m", report)
    assert points.times.tolist() == [0, 1] and points.values == pytest.approx([1e-3, 2e-3])
    assert [d.code for d in report.diagnostics] == ["N0527"]
    assert table_of_frame(pandas.DataFrame({"time": ["a", "b"], "u": [0, 1]}), "u", "m", report := Report()) is None
    assert "E0625" in str(report.diagnostics[0])


SCENE = """
model M
  input Real u(unit = "N") = 0;
  Mass m(m = 1, q(fixed = true), v(fixed = true));
  Force f(f = u);
equation
  connect(f.flange, m.flange);
end M;
"""


@pytest.mark.parametrize("name", ["push.csv", "push.tsv", "push.TXT", "push.dat"])
def test_a_run_takes_a_spreadsheets_table(tmp_path, name):
    (tmp_path / name).write_text("time;Kraft [kN]\n0;0,001\n4;0,001\n")
    run = lmoc.compile_text(SCENE).simulate(stop=1, inputs={"u": str(tmp_path / name)})
    assert run["m.v"][-1] == pytest.approx(1.0, rel=1e-9)
    assert sum("converted from kN to N" in str(note) for note in run.notes) == 1


def test_the_command_takes_it_too(lmoc, scene, tmp_path):
    (tmp_path / "push.csv").write_text("time;f\n0;4,5\n4;4,5\n")
    answer = lmoc("run", scene, "--input", "f=push.csv", "--quiet")
    assert answer == (0, "", "")
    (tmp_path / "push.csv").write_text("time;f\n0;1.234\n4;4.500\n")
    answer = lmoc("run", scene, "--input", "f=push.csv")
    assert answer.code == 2 and "'1.234' may be 1.234 or 1234" in answer.err
