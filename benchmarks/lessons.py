"""The conclusions from the charts of `docs/accuracy.md`: two sentences a scene, written from its points."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

EXPLICIT = frozenset({"dop853", "taylor", "adams", "rk4", "verlet"})
MULTISTEP = ("adams", "cvode", "cvodes", "ida", "idas")


@dataclass(frozen=True)
class Best:
    """The fastest way to so many digits."""

    name: str
    solver: str
    seconds: float
    digits: int

    @property
    def text(self) -> str:
        from lmoc.studies.findings import seconds_text

        return seconds_text(self.seconds)


class Points:
    """The points of a chart, as `Chart.save` writes them."""

    def __init__(self, points: Sequence[dict]) -> None:
        self.every = points
        self.good = [p for p in points if p["status"] == "ok" and p["solver"] != "auto"]

    def lead(self, digits: int) -> Best:
        """Return the fastest with so many digits, or with as many as are reached."""
        return next(filter(None, (self.fastest(fewer) for fewer in range(digits, -17, -1))))

    def fastest(
        self, digits: int, solvers: Sequence[str] = (), formulations: Sequence[str] = ("reduced",)
    ) -> Best | None:
        """Return the fastest of some solvers (all without names) with so many digits; None where none has them."""
        good = [
            p
            for p in self.good
            if p["error"] <= 10.0**-digits
            and p["formulation"] in formulations
            and (not solvers or p["solver"] in solvers)
        ]
        if not good:
            return None
        p = min(good, key=lambda p: p["seconds"])
        name = p["solver"] if p["formulation"] == "reduced" else f"{p['solver']} ({p['formulation']})"
        return Best(name, p["solver"], p["seconds"], digits)

    def at(self, solver: str, rtol: float) -> dict | None:
        """Return the point of a solver at a tolerance, if it has come to its end."""
        found = [p for p in self.every if p["solver"] == solver and p["rtol"] and p["formulation"] == "reduced"
                 and abs(p["rtol"] / rtol - 1) < 1e-6 and p["status"] == "ok"]  # fmt: skip
        return found[0] if found else None


def times(ratio: float) -> str:
    """Return ``1.2 times as long``."""
    return f"{ratio:.2g} times as long" if ratio < 99.5 else f"{ratio:.0f} times as long"


def _against(points: Points, lead: Best, solvers: Sequence[str]) -> str:
    """Return what some solvers take for as many digits as another one, as multiples of its time."""
    found = {s: points.fastest(lead.digits, [s]) for s in solvers}
    reached = sorted((best.seconds / lead.seconds, s) for s, best in found.items() if best is not None)
    if not reached:
        return f"{' and '.join(solvers)} do not reach {lead.digits} digits"
    (low, first), (high, last) = reached[0], reached[-1]
    if len(reached) == 1:
        return f"{first} takes {times(low)} for {lead.digits} digits"
    return f"{first} takes {times(low)} and {last} {times(high)} for {lead.digits} digits"


def _range(points: Points) -> str:
    """Return what few and many digits cost."""
    few, many = points.lead(3), points.lead(9)
    if few.name == many.name:
        return f"{few.name} takes {few.text} for {few.digits} digits and {many.text} for {many.digits}"
    return f"{few.name} takes {few.text} for {few.digits} digits and {many.name} {many.text} for {many.digits}"


def spring_mass_damper(points: Points) -> str:
    return (
        f"On a small smooth scene a run is mostly its fixed cost: {_range(points)}. Low orders pay for each digit: "
        f"{_against(points, points.lead(4), ['midpoint'])}."
    )


def suspension(points: Points) -> str:
    return (
        f"Four damped states at the pace of the wheel: {_range(points)}. Of the multistep methods "
        f"{_against(points, points.lead(6), MULTISTEP)}; {_against(points, points.lead(4), ['midpoint'])}, since its "
        "order is 2."
    )


def stiffness_ratio(points: Points) -> str:
    lead = points.lead(4)
    implicit = points.fastest(lead.digits, sorted({p["solver"] for p in points.good} - EXPLICIT))
    spared = "no implicit method gets there"
    if implicit is not None:
        spared = f"the fastest implicit method, {implicit.name}, takes {times(implicit.seconds / lead.seconds)}"
    apart = [f"{s} by {points.at(s, 1e-6)['error'] / 1e-6:.0f}" for s in ("dop853", "auto") if points.at(s, 1e-6)]
    return (
        "A fast mode that swings with an amplitude above the tolerance has to be followed, which being implicit does "
        f"not spare: for {lead.digits} digits {lead.name} takes {lead.text}, and {spared}. The errors of many periods "
        f"add up: at 1e-6 {' and '.join(apart)} times the tolerance, since auto counts periods and refines its steps."
    )


def plucked_string(points: Points) -> str:
    lead = points.lead(4)
    steps = [f"{points.at(s, 1e-5)['steps']} by {s}" for s in ("taylor", "dop853", "cvode") if points.at(s, 1e-5)]
    return (
        f"A run is many steps of 200 states, at 1e-5 {', '.join(steps)}; {lead.name} is the fastest for {lead.digits} "
        f"digits with {lead.text}. Implicit methods pay for their matrices: "
        f"{_against(points, lead, ['radau', 'gauss', 'cvode', 'cvodes'])}."
    )


def andrews(points: Points) -> str:
    lead = points.lead(6)
    wide = points.fastest(lead.digits, (), sorted({p["formulation"] for p in points.every} - {"reduced", "index3"}))
    third = [p for p in points.every if p["formulation"] == "index3"]
    ended = sum(p["status"] == "ok" for p in third)
    states = "no method gets there"
    if wide is not None:
        states = f"the fastest, {wide.name}, takes {times(wide.seconds / lead.seconds)}"
    return (
        "Two states are left of a closed mechanism, and each evaluation solves its loops in C: "
        f"{lead.name} takes {lead.text} for {lead.digits} digits. With all coordinates as states (dashed, dotted) "
        f"{states}; the closures as they stand (index 3) come to the end in {ended} of {len(third)} runs."
    )


def double_pendulum(points: Points) -> str:
    lead, fine = points.lead(4), points.lead(8)
    asked = [p for p in points.good if p["rtol"] and abs(p["rtol"] / 1e-6 - 1) < 1e-6]
    rows = [(p["error"] / p["rtol"], p["solver"]) for p in asked] or [(math.nan, "none")]
    (least, nearest), (most, farthest) = min(rows), max(rows)
    return (
        f"Chaos stretches errors at a constant rate: at 1e-6 they are {least:.0f} ({nearest}) to {most:.0f} "
        f"({farthest}) times the tolerance. It does so to all methods, and the fastest are those of a smooth scene: "
        f"{lead.name} for {lead.digits} digits, {fine.name} for {fine.digits}."
    )


def bungee(points: Points) -> str:
    events = max(p["events"] for p in points.good)
    coarse, fine = points.at("dop853", 1e-3), points.at("dop853", 1e-9)
    located = ""
    if coarse and fine:
        located = f": by dop853 the error falls from {coarse['error']:.0e} at 1e-3 to {fine['error']:.0e} at 1e-9"
    return (
        f"Each of the {events} events ends a segment, and a run is mostly the search for them: {_range(points)}. The "
        f"instants are located on dense output to the tolerance{located}."
    )


def prothero_robinson(points: Points) -> str:
    lead = points.lead(6)
    explicit = points.fastest(3, sorted(EXPLICIT - {"adams"}))
    failed = (
        "no explicit method gets to 3 digits in the time of the chart"
        if explicit is None
        else f"the fastest explicit method, {explicit.name}, takes {explicit.text} for 3 digits"
    )
    return (
        f"The steps of an explicit method are as short as the time constant of a microsecond: {failed}. For "
        f"{lead.digits} digits {lead.name} takes {lead.text}; methods with stages lose order to the stiffness: "
        f"{_against(points, lead, ['radau', 'gauss'])}."
    )


LESSONS: dict[str, Callable[[Points], str]] = {
    make.__name__: make
    for make in (
        spring_mass_damper, suspension, stiffness_ratio, plucked_string, andrews, double_pendulum, bungee,
        prothero_robinson,
    )
}  # fmt: skip
