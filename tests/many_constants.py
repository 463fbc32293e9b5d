"""Change each tuned number of numerics by a factor of ten: ``python tests/many_constants.py [FILE]``.

Every number is multiplied and divided by ten in the scenes that read it, the three quickest of these. What follows is
one of: ``outcome`` (a run fails, other events happen, or the end is another one by more than `NOTICED` tolerances),
``digits`` (the end has other digits), ``nothing``, or ``unread`` (no scene reads it). A file gets the table as JSON.
"""

from __future__ import annotations

import ast
import json
import signal
import sys
import time
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import numpy as np

import lmoc

ROOT = Path(__file__).parents[1]
ROOM = ROOT / "compiler" / "lmoc" / "numerics"
NOTICED = 100.0  # tolerances
PATIENCE = 20  # s for a run
SAMPLED = """model Sampled
  Real x(start = 1, fixed = true); discrete Real u(start = 0); Integer n(start = 0);
equation
  der(x) = u - x;
  when sample(0.1, 0.1) then u = -pre(u) + 0.1*x; end when;
  when x < 0.5 then n = pre(n) + 1; end when;
end Sampled;"""
SCENES: tuple[tuple[str, dict[str, object]], ...] = (
    ("notes/ex02_spring_mass_damper", {}),
    ("notes/ex02_spring_mass_damper", {"solver": "gauss"}),
    ("notes/ex02_spring_mass_damper", {"solver": "taylor"}),
    ("notes/ex02_spring_mass_damper", {"solver": "midpoint", "step": 1e-3}),
    ("notes/ex08_slack_cable", {}),
    ("hard/h03_four_bar", {}),
    ("hard/h03_four_bar", {"solver": "radau"}),
    ("hard/h03_four_bar", {"formulation": "ggl"}),
    ("hard/h01_cartesian_pendulum", {}),
    ("hard/h01_cartesian_pendulum", {"solver": "taylor"}),
    ("hard/h13_stiffness_ratio", {}),
    ("hard/h20b_ramp_with_kink", {}),
    ("hard/h28_prothero_robinson", {}),
    ("hard/h32_inconsistent_start", {}),
    ("hard/h30_vanishing_inertia", {}),
    ("planar/four_bar", {}),
    ("planar/pendulum_cartesian", {}),
    ("planar/three_cranks", {}),
    ("planar/scissor_lift", {}),
    ("failures/isosceles", {}),
    ("failures/pulse", {}),
    ("failures/relaxation", {}),
    ("failures/sign_friction", {}),
    ("laws/h16_stick_slip", {}),
    ("laws/h17_backlash", {}),
    ("laws/h17_backlash", {"solver": "moreau", "step": 1e-3}),
    ("laws/h18_freewheel", {}),
    ("laws/h19_bouncing_ball", {}),
    ("laws/clutch_lock", {}),
    ("laws/slack_pendulum", {}),
    ("laws/wagons", {}),
    ("laws/elastic_string", {}),
    (SAMPLED, {"stop": 2.0}),
)


def constants() -> Iterator[tuple[str, str, float]]:
    """Yield the numbers that modules define by themselves: (module, name, value)."""
    for path in sorted(ROOM.rglob("*.py")):
        module = ".".join(("lmoc.numerics", *path.relative_to(ROOM).with_suffix("").parts))
        for node in ast.parse(path.read_text()).body:
            if not isinstance(node, ast.Assign):
                continue
            names = [n.id for t in node.targets for n in ast.walk(t) if isinstance(n, ast.Name)]
            for name in names:
                value = getattr(import_module(module), name)
                if isinstance(value, int | float) and not isinstance(value, bool):
                    yield module, name, value


def run(scene: str, options: dict[str, object]) -> tuple[str, np.ndarray, np.ndarray]:
    """Return what became of a run: its failure, or nothing; the events' times; the end."""
    try:
        dae = lmoc.compile_text(scene) if "\n" in scene else lmoc.compile(ROOT / "models" / f"{scene}.lmo")
        found = dae.simulate(**options)
    except TimeoutError:
        raise
    except Exception as error:
        return type(error).__name__, np.zeros(0), np.zeros(0)
    return "", np.array([e.time for e in found.trajectory.events]), found.trajectory.at(-1)


def timed(scene: str, options: dict[str, object]) -> tuple[str, np.ndarray, np.ndarray]:
    def late(*_: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGALRM, late)
    signal.alarm(PATIENCE)
    try:
        return run(scene, options)
    finally:
        signal.alarm(0)


def readers(scene: str, options: dict[str, object]) -> tuple[set[tuple[str, str]], float]:
    """Return the names that a run looks up in each module, and the seconds of a run."""
    seen: dict[int, tuple[str, tuple[str, ...]]] = {}

    def note(frame, event, _) -> None:
        code = frame.f_code
        if event == "call" and id(code) not in seen and "numerics" in code.co_filename:
            seen[id(code)] = frame.f_globals["__name__"], code.co_names

    run(scene, options)
    begin = time.perf_counter()
    run(scene, options)
    seconds = time.perf_counter() - begin
    sys.setprofile(note)
    try:
        run(scene, options)
    finally:
        sys.setprofile(None)
    return {(module, name) for module, names in seen.values() for name in names}, seconds


def places(module: str, name: str, value: float) -> list[str]:
    """Return the modules in which the number has this name: its own, and those that import it."""
    own = [m for m, found in sys.modules.items() if m.startswith("lmoc.") and getattr(found, name, None) is value]
    return own if module in own else [module, *own]


def effect(before: tuple, after: tuple, rtol: float) -> str:
    (failed, events, end), (now, others, last) = before, after
    if failed != now or len(events) != len(others) or len(end) != len(last):
        return "outcome"
    size = np.maximum(np.abs(end), 1e-3 * np.abs(end).max(initial=0.0)) + 1e-300
    with np.errstate(invalid="ignore"):
        if (np.abs(end - last) > NOTICED * rtol * size).any():
            return "outcome"
    same = np.array_equal(end, last, equal_nan=True) and np.array_equal(events, others)
    return "nothing" if same else "digits"


def main() -> None:
    looked = [readers(*scene) for scene in SCENES]
    base = [run(*scene) for scene in SCENES]
    table = {}
    for module, name, value in list(constants()):
        known = places(module, name, value)
        own = [k for k, (names, _) in enumerate(looked) if any((m, name) in names for m in known)]
        own = sorted(own, key=lambda k: looked[k][1])[:3]
        found = []
        for factor in (10, 0.1):
            changed = type(value)(max(1, round(value * factor))) if isinstance(value, int) else value * factor
            for m in known:
                setattr(sys.modules[m], name, changed)
            for k in own:
                rtol = float(SCENES[k][1].get("rtol", 1e-6))  # type: ignore[arg-type]
                try:
                    found.append(effect(base[k], timed(*SCENES[k]), rtol))
                except TimeoutError:
                    found.append("outcome")
            for m in known:
                setattr(sys.modules[m], name, value)
        worst = next((e for e in ("outcome", "digits", "nothing") if e in found), "unread")
        table[f"{module.removeprefix('lmoc.numerics.')}.{name}"] = worst
        print(f"{worst:8} {module.removeprefix('lmoc.numerics.')}.{name} = {value:g}", flush=True)
        if len(sys.argv) > 1:
            Path(sys.argv[1]).write_text(json.dumps(table, indent=1))


if __name__ == "__main__":
    main()
