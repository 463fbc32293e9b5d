"""What stands behind the rows of `benchmarks.msl` that its references do not decide.

    python -m benchmarks.msl_proofs FOLDER REFERENCES [multivibrator actuator balances] [--of EXAMPLE …]

FOLDER and REFERENCES as there. Where a run leaves the tube, either it is wrong or the reference is: a closed form or
two methods at 1e-10 tell (of any example: `--of`). Where an example has no reference, what its circuit takes in is held
against what it keeps and what it turns into heat, and the charge of each capacitor (the flux of each coil) against the
integral of its current (its voltage).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from benchmarks.common import save, table
from benchmarks.msl import GIVEN, outside, reference

_ANALOG = "Modelica.Electrical.Analog.Examples"
_TUBE, _RTOL = 0.002, 1e-10
# Two methods of other families each: the run that is judged is that of `auto`.
_TWO = ("dop853", "radau")
_UNTIL = 3.7  # s: as far as the run of the actuator and its reference go together


def multivibrator(library: str, references: Path) -> list[list[object]]:
    """Hold runs and the reference against the closed form of the multivibrator, at the reference's times.

    The output stands at one of the limits ±V; the capacitor tends to it with T = R·C. With V0·(v/2 − c) = v, at
    c = V/2 − V/V0, the limit is left, where there is no other solution near: the output jumps to the other one.
    """
    import lmoc

    name = f"{_ANALOG}.OpAmps.Multivibrator"
    truth = reference(_file(references, name))
    at = truth["time"]
    time = np.unique(at)
    exact = _multivibrator(time)
    runs = {f"the reference (its tolerance {_tolerance(references, name)})": np.interp(time, at, truth["c.v"])}
    dae = lmoc.compile(name, path=library)
    for solver in ("auto", *_TWO):
        runs[f"lmoc, {solver}, rtol 1e-10"] = dae.simulate(times=time, solver=solver, rtol=_RTOL)["c.v"]
    span = np.ptp(exact)
    rows = [[who, np.abs(v - exact).max() / span, _tubes(at, exact, time, v)] for who, v in runs.items()]
    table("Multivibrator: c.v beside its closed form", ("who", "difference / range", "in tubes"), rows)
    return rows


def _multivibrator(time: np.ndarray, v: float = 15.0, gain: float = 15e3, f: float = 10.0) -> np.ndarray:
    """Return c.v at some times, from c = 1 with the output at its lower limit."""
    rate, threshold = 2 * f * np.log(3.0), v / 2 - v / gain
    first = np.log((v + 1.0) / (v - threshold)) / rate
    half = np.log((v + threshold) / (v - threshold)) / rate
    count = np.ceil(np.maximum(time - first, 0.0) / half)  # of jumps before
    side = np.where(count % 2 == 0, -1.0, 1.0)
    since = np.where(count == 0, time, time - first - (count - 1) * half)
    begin = np.where(count == 0, 1.0, -side * threshold)
    return side * v + (begin - side * v) * np.exp(-rate * since)


def actuator(library: str, references: Path) -> list[list[object]]:
    """Hold a run of the actuator against its reference at the times of the reference alone.

    It has one sample in 5 ms, and between two of them what swings has come and gone several times. From 3.74 s on the
    friction of the gear has another mode in the run, which does not come to its end.
    """
    import lmoc

    name = "Modelica.Blocks.Examples.Noise.ActuatorWithNoise"
    truth = reference(_file(references, name))
    at = truth.pop("time")
    time = np.unique(at[at <= _UNTIL])
    run = lmoc.compile(name, path=library, parameters=GIVEN[name]).simulate(times=time)
    own = {signal: np.asarray(run[signal], float) for signal in truth}
    rows = [[s, _tubes(at, v, run.time, own[s]), _apart(at, v, run.time, own[s])] for s, v in truth.items()]
    table("ActuatorWithNoise at the reference's samples", ("signal", "in tubes", "difference / range"), rows)
    return rows


def methods(library: str, references: Path, examples: Sequence[str]) -> list[list[object]]:
    """Hold two methods against each other, and both against the references of examples."""
    import lmoc

    rows: list[list[object]] = []
    for name in examples:
        truth = reference(_file(references, name))
        at = truth.pop("time")
        time = np.linspace(at[0], at[-1], 5001)
        dae = lmoc.compile(name, path=library)
        one, other = (dae.simulate(times=time, solver=solver, rtol=_RTOL) for solver in _TWO)
        for s, v in truth.items():
            a, b = np.asarray(one[s], float), np.asarray(other[s], float)
            apart = np.abs(a - b).max() / max(float(np.ptp(v)), 1e-9)
            rows.append([name, s, apart, _tubes(at, v, time[:-1], a[:-1]), _tubes(at, v, time[:-1], b[:-1])])
    table("two methods", ("example", "signal", "apart / range", *(f"{m}, tubes" for m in _TWO)), rows)
    return rows


# A circuit, what it takes in and what becomes heat (powers), what it keeps, and (charge, current) pairs.
_CIRCUITS: dict[str, tuple[str, str, str, dict[str, tuple[str, str]]]] = {
    f"{_ANALOG}.ChuaCircuit": (
        "0",
        "Ro.v*Ro.i + G.v*G.i + Nr.v*Nr.i",
        "0.5*(C1.C*C1.v^2 + C2.C*C2.v^2 + L.L*L.i^2)",
        {"C1": ("C1.C*C1.v", "C1.i"), "C2": ("C2.C*C2.v", "C2.i"), "L": ("L.L*L.i", "L.v"),
         "node of C1": ("C1.C*C1.v", "G.i - Nr.i"), "node of C2": ("C2.C*C2.v", "-G.i - L.i")},
    ),
    f"{_ANALOG}.CompareTransformers": (
        "-sineVoltage1.v*sineVoltage1.i - sineVoltage2.v*sineVoltage2.i",
        "resistor11.v*resistor11.i + resistor12.v*resistor12.i + load1.v*load1.i"
        " + resistor21.v*resistor21.i + resistor22.v*resistor22.i + load2.v*load2.i",
        "0.5*L1*basicTransformer.i1^2 + M*basicTransformer.i1*basicTransformer.i2 + 0.5*L2*basicTransformer.i2^2"
        " + 0.5*inductor21.L*inductor21.i^2 + 0.5*inductor22.L*inductor22.i^2",
        {"L1": ("L1*basicTransformer.i1 + M*basicTransformer.i2", "basicTransformer.v1"),
         "L2": ("L2*basicTransformer.i2 + M*basicTransformer.i1", "basicTransformer.v2"),
         "inductor21": ("inductor21.L*inductor21.i", "inductor21.v"),
         "inductor22": ("inductor22.L*inductor22.i", "inductor22.v")},
    ),
}  # fmt: skip


def balances(library: str, references: Path) -> list[list[object]]:
    """Close the balances of energy, charges and fluxes of the circuits that have no reference."""
    import lmoc

    rows: list[list[object]] = []
    for name, (taken, heat, kept, charges) in _CIRCUITS.items():
        integrals = {"taken": taken, "heat": heat, "through": f"abs({taken}) + abs({heat})"}
        integrals |= {f"q{k}": current for k, (_, current) in enumerate(charges.values())}
        declared = ", ".join(f"{n}__(start = 0, fixed = true)" for n in integrals)
        watched = {"kept__": kept, **{f"o{k}__": charge for k, (charge, _) in enumerate(charges.values())}}
        text = f"model Balance extends {name}; Real {declared}; Real {', '.join(watched)}; equation "
        text += " ".join(f"der({n}__) = {power};" for n, power in integrals.items())
        text += " ".join(f"{n} = {value};" for n, value in watched.items()) + " end Balance;"
        run = lmoc.compile_text(text, path=library).simulate(points=5001)
        energy = run["kept__"] - run["kept__"][0] - run["taken__"] + run["heat__"]
        rows.append([name, "energy", np.abs(energy).max() / run["through__"][-1]])
        for k, which in enumerate(charges):
            missing = run[f"o{k}__"] - run[f"o{k}__"][0] - run[f"q{k}__"]
            rows.append([name, which, np.abs(missing).max() / np.ptp(run[f"o{k}__"])])
    table("balances", ("example", "of", "what is missing, as a share"), rows)
    return rows


def _file(references: Path, name: str) -> Path:
    folder = references.joinpath(*name.split("."))
    return folder / f"{folder.name}.csv"


def _tolerance(references: Path, name: str) -> str:
    lines = (_file(references, name).parent / "creation.txt").read_text(encoding="utf-8").splitlines()
    return next((line.split("=")[1].split()[0] for line in lines if line.startswith("Tolerance=")), "unknown")


def _tubes(at: np.ndarray, truth: np.ndarray, time: np.ndarray, run: np.ndarray) -> float:
    """Return by how many widths of the tube a run leaves what is taken for true."""
    return outside(at, truth, time, run, _TUBE)


def _apart(at: np.ndarray, truth: np.ndarray, time: np.ndarray, run: np.ndarray) -> float:
    """Return the difference at the samples, as a share of the range; nearest of two at a jump."""
    sides = [np.interp(time, at[first], truth[first]) for first in (_first(at), _first(at[::-1])[::-1])]
    return float(np.min([np.abs(run - side) for side in sides], axis=0).max() / np.ptp(truth))


def _first(at: np.ndarray) -> np.ndarray:
    return np.concatenate([[True], np.diff(at) != 0])


_PROOFS: dict[str, Callable[[str, Path], list[list[object]]]] = {
    "multivibrator": multivibrator, "actuator": actuator, "balances": balances,
}  # fmt: skip


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("library")
    parser.add_argument("references", type=Path)
    parser.add_argument("proofs", nargs="*", metavar="PROOF", help=f"of {', '.join(_PROOFS)}; all without --of")
    parser.add_argument("--of", nargs="+", default=[], metavar="EXAMPLE", help="held against two methods at 1e-10")
    arguments = parser.parse_args()
    unknown = sorted({*arguments.proofs} - {*_PROOFS})
    if unknown:
        parser.error(f"there is no proof '{unknown[0]}'")
    which = arguments.proofs or ([] if arguments.of else list(_PROOFS))
    found = {name: _PROOFS[name](arguments.library, arguments.references) for name in which}
    if arguments.of:
        found["methods"] = methods(arguments.library, arguments.references, arguments.of)
    save("msl_proofs", found)


if __name__ == "__main__":
    main()
