"""Whatever reduction does, the flat equations hold along the motion it computes; every scene of the models."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.register_machine import flat_residuals

from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Source
from lmoc.semantics.flatten import flatten
from lmoc.sources.library import load
from lmoc.structure.reduce import reduce
from lmoc.syntax.parse import parse

MODELS = Path(__file__).parents[2] / "models"
SCENES = sorted([*MODELS.glob("notes/*.lmo"), *MODELS.glob("hard/*.lmo"), *MODELS.glob("bench/*.lmo")])

STATES = {  # degrees of freedom by hand: two for each coordinate, one for each spring in series with a damper
    "ex01_torsional_spring": 2, "ex02_spring_mass_damper": 2, "ex03_two_masses": 4, "ex04_moving_frame": 4,
    "ex05_suspension": 4, "ex06_spring_and_damper_in_series": 3, "ex07_two_inertias": 4, "ex10_lever_and_mass": 4,
    "fig5_rods": 2, "s7_2_dampers_in_series": 2, "s8_gears": 2, "s9_lever_large_angles": 2, "h05_atwood": 2,
    "h08_turning_lever": 2, "h10_gear_loop": 2, "h11_rod_between_masses": 2, "h14_plucked_string": 200,
    "h21_prescribed_rotation": 0, "h22_block_and_tackle": 2, "h23_planetary_gear": 4, "h30_vanishing_inertia": 2,
}  # fmt: skip


def flat_scene(path: Path, **parameters):
    """A scene's flat model; benchmarks in a size at which everything can be checked."""
    report = Report()
    file = parse(Source(path.name, path.read_text()), report)
    report.check()
    if path.parent.name == "bench":
        parameters["N"] = {"lattice": 4, "levers": 6, "network": 12}.get(path.stem, 20)
    return flatten([file], load(), None, parameters, report)


@pytest.mark.parametrize("path", SCENES, ids=lambda p: p.stem)
def test_flat_equations_hold(path):
    reduced = reduce(flat_scene(path))
    assert len(reduced.states) == STATES.get(path.stem, len(reduced.states))
    y = np.random.default_rng(3).uniform(-0.3, 0.3, len(reduced.states) + len(reduced.quadratures))
    residuals = flat_residuals(reduced, y, 0.4)
    known = residuals[np.isfinite(residuals)]
    assert np.abs(known).max() < 1e-6
    # what a redundant loop leaves open is all that may be missing
    assert len(known) == len(residuals) or len(reduced.undetermined)


def test_large_angles_of_many_levers():
    reduced = reduce(flat_scene(MODELS / "bench" / "levers.lmo", smallAngle=False))
    assert len(reduced.states) == 12
    assert all("theta" in name or "der" in name for name in reduced.state_names)
    y = np.random.default_rng(1).uniform(-0.3, 0.3, len(reduced.states) + len(reduced.quadratures))
    assert np.abs(flat_residuals(reduced, y, 0.4)).max() < 1e-6
