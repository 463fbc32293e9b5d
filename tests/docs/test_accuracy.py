"""The figures of docs/accuracy.md that are computed from measurements, by cases that can be done by hand."""

import json
from pathlib import Path

import pytest

from benchmarks import auto, economy, other_methods
from benchmarks.frontier import page as peers
from benchmarks.lessons import LESSONS, Points, spring_mass_damper
from lmoc.studies.points import Point, Setting

PAGE = Path(__file__).parents[2] / "docs" / "accuracy.md"
CHARTS = PAGE.parent / "charts"


def point(solver: str, rtol: float, error: float, seconds: float, evaluations: int = 100) -> Point:
    return Point(Setting(solver, "reduced", rtol), error, error, seconds, 1, evaluations, note="")


def test_a_curve_is_straight_in_logarithms_and_ends_at_its_smallest_error():
    points = [point("a", 1e-4, 1e-4, 1e-3), point("a", 1e-6, 1e-6, 1e-1)]
    assert auto.curve(points, 1e-5) == pytest.approx(1e-2)
    assert auto.curve(points, 1e-3) == pytest.approx(1e-3)
    assert auto.curve(points, 1e-7) == float("inf")


def test_a_pair_of_the_same_method_is_judged_by_its_work():
    own = Point(Setting("auto", "reduced", 1e-6), 1e-6, 1e-6, 3e-3, 1, 110, note="dop853")
    others = {"dop853": [point("dop853", 1e-6, 1e-6, 1e-3, 100)], "taylor": [point("taylor", 1e-6, 1e-6, 2e-3)]}
    row = auto._pair(own, others, 0.0)
    assert row["best"] == "dop853" and row["ratio"] == pytest.approx(1.1)
    others["taylor"] = [point("taylor", 1e-6, 1e-6, 0.5e-3)]
    row = auto._pair(own, others, 0.0) | {"rtol": 1e-6, "trusted": 0.0}
    assert row["best"] == "taylor" and row["ratio"] == pytest.approx(6.0)
    assert not auto.is_good(row) and not auto.is_near(row) and auto.is_calibrated(row)


def test_auto_fails_only_where_another_method_succeeds():
    failed = Point(Setting("auto", "reduced", 1e-6), status="it stopped")
    assert auto._pair(failed, {"a": [point("a", 1e-6, 1e-6, 1.0)]}, 0.0)["ratio"] == float("inf")
    assert auto._pair(failed, {"a": [Point(Setting("a", "reduced", 1e-6), status="so did it")]}, 0.0)["ratio"] == 1.0


def test_a_frontier_has_no_point_that_another_is_better_than():
    points = [(1e-3, 1.0), (1e-6, 2.0), (1e-5, 3.0), (1e-9, 5.0), (1e-4, 2.0)]
    assert peers.envelope(points) == [(1e-3, 1.0), (1e-6, 2.0), (1e-9, 5.0)]


def test_a_lesson_names_what_its_points_say():
    def of(solver: str, error: float, seconds: float, status: str = "ok") -> dict:
        return {"solver": solver, "formulation": "reduced", "rtol": 1e-6, "error": error, "seconds": seconds,
                "status": status}  # fmt: skip

    points = [of("taylor", 1e-11, 2e-3), of("dop853", 1e-5, 1e-3), of("midpoint", 9e-5, 0.3), of("auto", 1e-12, 1e-4),
              of("cvode", 1e-12, 1e-5, "it stopped")]  # fmt: skip
    text = spring_mass_damper(Points(points))
    assert "dop853 takes 1 ms for 3 digits and taylor 2 ms for 9" in text
    assert "midpoint takes 300 times as long for 4 digits" in text
    assert "midpoint do not reach 4 digits" in spring_mass_damper(Points([*points[:2], of("midpoint", 1e-3, 0.3)]))
    assert "dop853 takes 1 ms for 3 digits and 1 ms for 5" in spring_mass_damper(Points(points[1:2]))


def test_the_comparison_says_who_leads_and_by_how_much():
    def row(tool: str, ms: float, target: float = 1e-6) -> dict:
        return {"scene": "s", "target": target, "tool": tool, "ms": ms}

    rows = [row("lmoc", 2.0), row("heyoka", 0.1), row("scipy", 9.0), row("lmoc", 1.0, 1e-9), row("heyoka", 4.0, 1e-9)]
    assert peers.lesson(rows) == (
        "lmoc is the fastest in 1 of 2 rows; in the others heyoka is. It is within 10 times of heyoka's time in 1 of "
        "2, and beyond in s at 1e-06 (20 times)."
    )


def test_the_page_is_what_its_measurements_say():
    text = PAGE.read_text(encoding="utf-8")
    kept = {name: json.loads((CHARTS / f"{name}.json").read_text()) for name in ("auto", "economy", "others", "peers")}
    assert economy.page(kept["economy"]) in text and other_methods.page(kept["others"]) in text
    assert auto.page(kept["auto"]) in text and peers.page(kept["peers"]) in text
    for name, lesson in LESSONS.items():
        assert lesson(Points(json.loads((CHARTS / f"{name}.json").read_text())["points"])) in text
