"""Scenes that are hard for one reason or another, against reference trajectories derived without this compiler."""

import json
from pathlib import Path

import numpy as np
import pytest
from oracles import models

import lmoc

ROOT = Path(__file__).parents[2]
SCENES = json.loads((ROOT / "tests/data/scenes.json").read_text())

# Where the accuracy comes from, and how far the default options must carry.
ACCURATE = {
    "H01": {"rtol": 1e-9},  # eight turns of a motion whose phase errors add up
    "H03": {"rtol": 1e-10},  # what happens at the change point is felt ten thousand times as much behind it
    "H08": {"rtol": 1e-9},
    "H13": {"rtol": 1e-11, "atol": 1e-17},  # 16000 periods of an undamped mode of 1 µm
    "H14": {"rtol": 1e-9},
    "H28": {"rtol": 1e-8, "atol": 1e-11},
    "H28b": {"rtol": 1e-8, "atol": 1e-11},
}
STARTS = [name for name in SCENES if name != "H32"]


def compiled(name: str) -> lmoc.DAE:
    return models.compiled(ROOT / "models/hard" / SCENES[name]["file"])


def assert_reference(run, reference: dict, accuracy: float = 1e-6) -> None:
    for signal, values in reference.items():
        assert np.abs(run[signal] - values).max() <= accuracy * np.abs(values).max(), signal


@pytest.mark.parametrize("name", [name for name in STARTS if name != "H30"])
def test_reference_is_reproduced(name):
    truth = SCENES[name]
    run = compiled(name).simulate(times=truth["times"], **ACCURATE.get(name, {"rtol": 1e-8}))
    assert_reference(run, truth["reference"])


@pytest.mark.parametrize("name", STARTS)
def test_states_are_minimal(name):
    assert len(compiled(name).states) == SCENES[name]["states"]


@pytest.mark.parametrize("name", STARTS)
def test_energy_is_balanced(name):
    assert compiled(name).simulate().energy.balance < 100 * 1e-6


@pytest.mark.parametrize("solver", ["ida", "cvode", "radau", "auto"])
def test_energy_lost_at_once_does_not_stop_a_stiff_solver(solver):
    """5000 J go within microseconds: the ledger must not ask for steps that the motion does not need."""
    run = compiled("H28").simulate(solver=solver, rtol=1e-10)
    assert np.abs(run["x"][1:] - np.sin(run.time[1:])).max() < 1e-8
    assert run.energy.balance < 1e-7


def test_torques_of_a_gear_loop_are_said_to_be_not_unique():
    dae = compiled("H10")
    notes = "\n".join(str(note) for note in dae.notes)
    assert "mesh1" in notes and "mesh2" in notes
    run = dae.simulate(points=11, rtol=1e-8)
    assert np.allclose(run["sum_mesh_torque_on_2"], 3)


def test_gear_loop_with_contradicting_ratios_names_the_gears():
    with pytest.raises(lmoc.ModelError) as caught:
        lmoc.compile(ROOT / "models/hard/h10_gear_loop.lmo", parameters={"N2": 3}).simulate()
    assert "mesh" in str(caught.value)


def test_vanishing_inertia_takes_states_away_and_brings_them_back():
    dae, truth = compiled("H30"), SCENES["H30"]
    reference = {signal: truth["reference"][signal] for signal in ("theta", "theta2")}
    assert_reference(dae.simulate(times=truth["times"], rtol=1e-8), reference)

    small = dae.simulate(times=truth["times"][:2], parameters={"J2": 1e-9}, rtol=1e-8)
    assert [n.message.split("no longer holds: ")[1] for n in small.notes if n.code == "N0631"] == ["wheel.J = 0"]
    massless = dae.simulate(parameters={"J": 0})
    assert [n.message.split("no longer holds: ")[1] for n in massless.notes if n.code == "N0631"] == ["rotor.J <> 0"]
    assert np.allclose(small["theta"], truth["reference"]["theta_J2_1e_9"][:2], rtol=0, atol=1e-6)

    assert_reference(dae.simulate(times=truth["times"], parameters={"J2": 0}, rtol=1e-8), reference)


def test_contradicting_start_velocities_are_an_impact_that_is_told():
    truth = SCENES["H32"]
    run = compiled("H32").simulate(times=truth["times"])
    assert_reference(run, truth["reference"])
    (warning,) = [n for n in run.notes if n.severity == "warning"]
    assert "gear1.omega = 10" in warning.message and "gear2.omega = 1" in warning.message


@pytest.mark.parametrize("length", [1, 2, 7, 100])
def test_gear_train_with_weightless_shafts_has_two_states(length):
    """With a motor J0 and a load J1 behind the total ratio R: (J0 + J1/R²) theta'' = tau."""
    ratios = [-1.5 if i % 2 else 0.8 for i in range(length)]
    dae = lmoc.compile_text(
        f"""model Train
          Torque drive(tau = 2);
          Inertia motor(J = 0.3), load(J = 0.7);
          Gear gear[{length}](N = {{{", ".join(map(str, ratios))}}});
          Inertia between[{length - 1}](each J = 0);
        equation
          connect(drive.shaft, motor.shaft);
          connect(motor.shaft, gear[1].a);
          for i in 1:{length - 1} loop
            connect(gear[i].b, between[i].shaft);
            connect(between[i].shaft, gear[i + 1].a);
          end for;
          connect(gear[{length}].b, load.shaft);
        end Train;"""
    )
    assert len(dae.states) == 2
    run = dae.simulate(stop=1, points=5, rtol=1e-9)
    total = np.prod(ratios)
    alpha = 2 / (0.3 + 0.7 / total**2)
    assert np.allclose(run["motor.alpha"], alpha, rtol=1e-9)
    assert np.allclose(run["motor.theta"], alpha * run.time**2 / 2, rtol=1e-7)
    assert np.allclose(run["load.theta"] * total, run["motor.theta"], rtol=1e-12)
    torque = np.array([run[f"gear[{i + 1}].b.tau"][-1] for i in range(length)])
    transmitted = 2 - 0.3 * alpha
    assert np.allclose(torque, -transmitted * np.cumprod(ratios), rtol=1e-8)


def test_loop_of_two_arms_is_solved_for_the_second_angle():
    """0.5 sin(a) = 0.9 sin(b) with inertias on both shafts, against the equation of motion in a alone; a turns over."""
    from scipy.integrate import solve_ivp

    dae = lmoc.compile_text(
        """model Loop
          Inertia a(J = 0.5, theta(start = 0.3, fixed = true), omega(start = 2, fixed = true)), b(J = 0.8);
          Arm arm1(l = 0.5), arm2(l = 0.9);
          Torque drive(tau = 0.7);
        equation
          connect(drive.shaft, a.shaft);
          connect(a.shaft, arm1.shaft);
          connect(arm1.flange, arm2.flange);
          connect(arm2.shaft, b.shaft);
        end Loop;"""
    )
    ratio = 0.5 / 0.9

    def rate(t, z):
        s = ratio * np.sin(z[0])
        c = np.sqrt(1 - s * s)
        slope = ratio * np.cos(z[0]) / c  # db/da
        bend = (s * slope**2 - ratio * np.sin(z[0])) / c
        return [z[1], (0.7 - 0.8 * slope * bend * z[1] ** 2) / (0.5 + 0.8 * slope**2)]

    times = np.linspace(0, 5, 11)
    exact = solve_ivp(rate, (0, 5), [0.3, 2], method="DOP853", t_eval=times, rtol=1e-11, atol=1e-13)
    assert len(dae.states) == 2
    run = dae.simulate(times=times, rtol=1e-9)
    assert np.abs(run["a.theta"] - exact.y[0]).max() < 1e-6
    assert np.abs(run["b.theta"] - np.arcsin(ratio * np.sin(exact.y[0]))).max() < 1e-6
    assert np.abs(0.5 * np.sin(run["a.theta"]) - 0.9 * np.sin(run["b.theta"])).max() < 1e-12
    assert run.energy.balance < 1e-7
