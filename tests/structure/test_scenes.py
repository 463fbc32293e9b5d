"""Whatever reduction does, the flat equations hold along the motion it computes; every scene of the models."""

from __future__ import annotations

from itertools import pairwise
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
SCENES = [p for p in SCENES if "slack" not in p.stem]  # those with laws are reduced in their modes

STATES = {  # degrees of freedom by hand: two for each coordinate, one for each spring in series with a damper
    "ex01_torsional_spring": 2, "ex02_spring_mass_damper": 2, "ex03_two_masses": 4, "ex04_moving_frame": 4,
    "ex05_suspension": 4, "ex06_spring_and_damper_in_series": 3, "ex07_special_case": 4, "ex07_two_inertias": 4,
    "ex08_cable_around_cylinder": 2, "ex09_gear_pair_with_load": 2, "ex10_lever_and_mass": 4, "fig5_rods": 2,
    "fig6_pretension": 2, "fig6_string_over_pulley": 2, "s2_2_rotor": 2, "s3_1_cubic_spring": 2,
    "s3_2_spring_left_of_mass": 2, "s3_2_spring_right_of_mass": 2, "s4_1_damper_left_of_mass": 2,
    "s4_1_damper_right_of_mass": 2, "s4_2_rotational_damper": 2, "s7_1_springs_in_parallel": 2,
    "s7_1_springs_in_series": 2, "s7_2_dampers_in_parallel": 2, "s7_2_dampers_in_series": 2,
    "s7_3_torsional_springs_in_parallel": 2, "s7_3_torsional_springs_in_series": 2, "s8_gears": 2,
    "s8_ideal_gears": 2, "s9_lever_large_angles": 2, "s9_lever_small_angles": 2,
    "h01_cartesian_pendulum": 2, "h02_double_pendulum": 4, "h03_four_bar": 2, "h04_slider_crank": 2, "h05_atwood": 2,
    "h08_turning_lever": 2, "h10_gear_loop": 2, "h11_rod_between_masses": 2, "h12_rods_and_springs": 2,
    "h13_stiffness_ratio": 4, "h14_plucked_string": 200, "h15_cubic_spring": 2, "h20b_ramp_with_kink": 4,
    "h21_prescribed_rotation": 0, "h22_block_and_tackle": 2, "h23_planetary_gear": 4, "h26_andrews": 2,
    "h27_car_axis": 4, "h28_prothero_robinson": 1, "h28b_stiff_mount": 2, "h30_vanishing_inertia": 2,
    "h32_inconsistent_start": 2,
    "chain": 2 * 20, "drivetrain": 2 * 21, "gear_tree": 2, "ground": 2 * 20, "lattice": 2 * 4 * 4, "levers": 2 * 6,
    "network": 2 * 12,
}  # fmt: skip


def flat_scene(path: Path, **parameters):
    """A scene's flat model; benchmarks in a size at which everything can be checked."""
    report = Report()
    file = parse(Source(path.name, path.read_text()), report)
    report.check()
    if path.parent.name == "bench":
        parameters["N"] = {"lattice": 4, "levers": 6, "network": 12}.get(path.stem, 20)
    return flatten([file], load(), None, parameters, report)


def open_rows(reduced) -> np.ndarray:
    """(equations,) mask of those with a variable that a redundant loop leaves undetermined."""
    flat = reduced.flat
    lost = np.zeros(flat.count, bool)
    lost[reduced.undetermined] = True
    sums = np.array([lost[flat.sums.index[a:b]].any() for a, b in pairwise(flat.sums.start.tolist())], bool)
    return np.concatenate([*(lost[g.slots].any(axis=1) for g in flat.groups), sums])


@pytest.mark.parametrize("path", SCENES, ids=lambda p: p.stem)
def test_flat_equations_hold(path):
    reduced = reduce(flat_scene(path))
    assert len(reduced.states) == STATES[path.stem]
    y = np.random.default_rng(3).uniform(-0.3, 0.3, len(reduced.states) + len(reduced.quadratures))
    residuals = flat_residuals(reduced, y, 0.4)
    known = np.isfinite(residuals)
    assert np.abs(residuals[known]).max() < 1e-6
    np.testing.assert_array_equal(~known, open_rows(reduced))


def test_large_angles_of_many_levers():
    reduced = reduce(flat_scene(MODELS / "bench" / "levers.lmo", smallAngle=False))
    assert len(reduced.states) == 12
    assert all("theta" in name or "der" in name for name in reduced.state_names)
    y = np.random.default_rng(1).uniform(-0.3, 0.3, len(reduced.states) + len(reduced.quadratures))
    assert np.abs(flat_residuals(reduced, y, 0.4)).max() < 1e-6
