"""What is said of every member of an array is said once."""

import pytest

from lmoc.alike import over_range, ranges, report_alike
from lmoc.diagnostics import Diagnostic, Report


def test_indices_become_ranges():
    assert over_range(["m[1].q", "m[2].q", "m[3].q"]) == "m[1:3].q"
    assert over_range(["a[1] and b[2]", "a[2] and b[3]"]) == "a[1:2] and b[2:3]"
    assert over_range([f"g[{i},{j}].x = s[{j}]" for i in (1, 2) for j in (4, 5, 6)]) == "g[1:2,4:6].x = s[4:6]"
    assert over_range(["m[3]", "m[1]", "m[2]"]) == "m[1:3]"
    assert over_range(["m"]) == "m"


@pytest.mark.parametrize("texts", [["m[1]", "m[3]"], ["g[1,1]", "g[2,2]", "g[1,2]"], ["m[1]", "m[1]"]])
def test_what_fills_no_range_is_not_one(texts):
    assert over_range(texts) is None


def test_names_of_several_arrays():
    assert ranges(["a[1]", "b", "a[2]", "a[3]", "c[1]", "c[5]"]) == ["a[1:3]", "b", "c[1]", "c[5]"]


def told(*found: tuple[str, str], most: int = 2, unseen: int = 0) -> list[tuple[str, str]]:
    report = Report()
    report_alike([Diagnostic("E0402", m, found=f) for m, f in found], report, most, unseen)
    return [(" | ".join(filter(None, [d.message, d.hint])), d.found) for d in report.diagnostics]


def test_one_for_all_members():
    assert told(("r[1] floats", "x[1] = 0"), ("r[2] floats", "x[2] = 0")) == [("r[1:2] floats", "x[1:2] = 0")]
    assert told(("r[1] floats", "1"), ("r[2] floats", "2")) == [("r[1:2] floats", "of the first: 1")]
    assert told(("r[1] floats", ""), ("r[5] floats", "")) == [("r[1] floats, and 1 more like it", "")]


def test_what_is_cut_is_counted():
    unlike = [(f"{name} floats", "") for name in "abcd"]
    assert told(*unlike) == [("a floats", ""), ("b floats | 2 more such mistakes are not shown", "")]
    assert told(*unlike[:2], unseen=1)[-1] == ("b floats | 1 more place was not looked at", "")
    assert told(*unlike, most=4)[-1] == ("d floats", "")
