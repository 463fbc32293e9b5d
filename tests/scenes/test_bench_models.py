"""The scenes of `models/bench`, small: against assemblies by hand and closed forms."""

from pathlib import Path

import numpy as np
import pytest
from oracles.lagrange import Assembly, trajectory

import lmoc

BENCH = Path(__file__).parents[2] / "models/bench"
TIMES = np.linspace(0, 3, 7)


def run_of(name: str, **parameters):
    dae = lmoc.compile(BENCH / f"{name}.lmo", parameters=parameters)
    return dae, dae.simulate(times=TIMES, rtol=1e-9)


def at_rest(a: Assembly) -> np.ndarray:
    zero = np.zeros(len(a.M))
    return trajectory(a, TIMES, zero, zero)


def assert_close(actual: np.ndarray, expected: np.ndarray) -> None:
    assert np.abs(actual - expected).max() <= 1e-7 * np.abs(expected).max()


@pytest.mark.parametrize("N", [1, 7, 40])
def test_chain_stays_in_its_mode(N):
    dae, run = run_of("chain", N=N, c=2.0)
    assert len(dae.states) == 2 * N
    mode = N // 4 + 1
    s = 4 * np.sin(mode * np.pi / (2 * (N + 1))) ** 2
    decay = 2.0 * s / 2
    w = np.sqrt(100 * s - decay**2)
    motion = np.exp(-decay * TIMES) * (np.cos(w * TIMES) + decay / w * np.sin(w * TIMES))
    for i in (1, N):
        assert_close(run[f"mass[{i}].q"], 0.01 * np.sin(mode * np.pi * i / (N + 1)) * motion)


def test_network_solves_for_its_massless_nodes():
    N = 8
    dae, run = run_of("network", N=N)
    assert len(dae.states) == 2 * N
    e = np.eye(2 * N - 1)  # masses, then nodes
    a = Assembly(2 * N - 1, omega=2)
    for i in range(N):
        a.mass(1, e[i])
        a.spring(10, e[i])
        a.damper(0.2, e[i])
    for i in range(N - 1):
        a.spring(100, e[N + i] - e[i])
        a.spring(150, e[i + 1] - e[N + i])
    for i in range(N - 2):
        a.spring(50, e[N + i + 1] - e[N + i])
    a.drive(1, e[N - 1])
    x = at_rest(a)
    for i in range(N):
        assert_close(run[f"mass[{i + 1}].q"], x[:, i])
    for i in range(N - 1):
        assert_close(run[f"before[{i + 1}].b.q"], x[:, N + i])


def test_drivetrain_has_two_states_for_each_rotor_and_one_pair_for_the_load():
    N = 30
    dae, run = run_of("drivetrain", N=N)
    assert len(dae.states) == 2 * (N + 1)  # the motor, all rotors; the load turns with the last of them
    e = np.eye(N + 1)
    a = Assembly(N + 1, omega=1)
    a.mass(0.01, e[0])
    before = e[0]
    for stage in range(3):
        for i in range(10):
            rotor = e[1 + 10 * stage + i]
            a.mass(0.01, rotor)
            a.spring(50, rotor - before)
            a.damper(0.02, rotor - before)
            before = rotor
        before = before / (2 if stage % 2 == 0 else 0.5)
    a.mass(0.1, before)
    a.damper(0.2, before)
    a.push(1, e[0])
    x = at_rest(a)
    assert_close(run["theta"], x @ before)
    assert_close(run["stage[2].rotor[4].theta"], x[:, 14])


@pytest.mark.parametrize("N", [2, 3, 50])
def test_gear_tree_has_one_coordinate(N):
    dae, run = run_of("gear_tree", N=N)
    assert len(dae.states) == 2
    ratio = 1.5 ** -np.floor(np.log2(np.arange(1, N + 1)))
    a = Assembly(1, omega=1)
    a.mass(0.01 * (ratio**2).sum(), np.ones(1))
    a.damper(0.01 * (ratio**2).sum(), np.ones(1))
    a.spring(5, np.ones(1))
    a.drive(1, np.ones(1))
    x = at_rest(a)[:, 0]
    assert_close(run["theta"], x)
    assert_close(run[f"rotor[{N}].theta"], x * ratio[-1])


def test_ladder_of_levers():
    N = 9
    dae, run = run_of("levers", N=N)
    assert len(dae.states) == 2 * N
    e = np.eye(N)
    a = Assembly(N, omega=2)
    for i in range(N):
        other_end = e[i] * (1 / 0.8 if i % 2 == 0 else 0.8)
        a.mass(1, e[i])
        a.damper(0.2, e[i])
        if i == 0:
            a.drive(1, other_end)
        else:
            a.spring(100, other_end - e[i - 1])
    a.spring(100, e[N - 1])
    assert_close(run["last"], at_rest(a)[:, -1])


def test_lattice_of_nodes_that_move_along_one_axis():
    N, M = 4, 5
    dae, run = run_of("lattice", N=N, M=M)
    assert len(dae.states) == 2 * N * M
    node = np.pad(np.eye(N * M).reshape(N, M, N * M), ((1, 1), (1, 1), (0, 0)))  # the rim does not move
    a = Assembly(N * M, omega=2)
    for i in range(1, N + 1):
        for j in range(1, M + 1):
            a.mass(1, node[i, j])
    between = [node[1:-1, 1:] - node[1:-1, :-1], node[1:, 1:-1] - node[:-1, 1:-1]]
    for row in np.concatenate([rows.reshape(-1, N * M) for rows in between]):
        a.spring(100, row)
        a.damper(0.1, row)
    a.drive(1, node[(N + 1) // 2, (M + 1) // 2])
    x = at_rest(a)
    assert_close(run["middle"], x @ node[(N + 1) // 2, (M + 1) // 2])
    assert_close(run["mass[4,1].q"], x @ node[4, 1])


def test_many_springs_on_one_wall_swing_by_themselves():
    dae, run = run_of("ground", N=15)
    assert len(dae.states) == 30
    for i in (1, 15):
        assert_close(run[f"mass[{i}].q"], 0.01 * np.cos(np.sqrt(50 + 50 * i / 15) * TIMES))
    assert np.allclose(run["ground.flange.f"], -sum(run[f"spring[{i}].a.f"] for i in range(1, 16)))


@pytest.mark.parametrize("name", [p.stem for p in sorted(BENCH.glob("*.lmo"))])
def test_energy_is_balanced(name):
    run = lmoc.compile(BENCH / f"{name}.lmo", parameters={"N": 20}).simulate(stop=2)
    assert run.energy.balance < 100 * 1e-6
