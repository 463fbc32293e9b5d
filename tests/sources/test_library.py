"""The library: what every part must declare, and its laws against numbers and power balances."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import lmoc
from lmoc.sources import library
from lmoc.syntax import tree

ROOT = Path(__file__).parents[2]
TOP = {c.name: c for file in library.load() for c in file.classes}
CLASSES = TOP | {f"Planar.{c.name}": c for c in TOP["Planar"].elements if isinstance(c, tree.Class)}
RECORDS = {f"Tables.{c.name}" for c in TOP["Tables"].elements if isinstance(c, tree.Class) and c.kind == "record"}
PARTS = {name: c for name, c in CLASSES.items() if c.kind == "model"}


def members(part: str) -> list[tree.Component]:
    """Declarations of a part, inherited ones first."""
    package = part.rpartition(".")[0]
    bases = [str(e.base) for e in CLASSES[part].elements if isinstance(e, tree.Extends)]
    inherited = [m for base in bases for m in members(f"{package}.{base}" if package else base)]
    return inherited + [e for e in CLASSES[part].elements if isinstance(e, tree.Component)]


# ---------------------------------------------------------------------------- declarations


@pytest.mark.parametrize("part", CLASSES.values(), ids=lambda c: c.name)
def test_class_is_described(part):
    assert part.description


@pytest.mark.parametrize("part", [name for name, c in PARTS.items() if not c.partial and name != "Planar.World"])
def test_part_states_its_energy(part):
    """The ledger of a run closes only if every part says what it stores, loses or supplies."""
    assert {"energy", "loss", "power"} & {m.name for m in members(part)}


@pytest.mark.parametrize("part", PARTS)
def test_quantities_have_units_and_meanings(part):
    names = {name.rpartition(".")[2] for name in CLASSES}
    for m in members(part):
        if str(m.type) not in (*names, *RECORDS, "Boolean", "Integer"):
            assert str(m.type).startswith("Units."), m.name
        if m.variability != "constant" and str(m.type) not in ("Flange", "Shaft"):
            assert m.description, m.name


def test_page_of_the_library_is_up_to_date():
    spec = importlib.util.spec_from_file_location("make_library", ROOT / "docs/make_library.py")
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    assert made.PAGE.read_text(encoding="utf-8") == made.page(), "run: python docs/make_library.py"


# ------------------------------------------------------------------------------------- laws


@pytest.mark.parametrize(
    "spring, force",
    [  # k (q2 - q1 + L - d0), or its third power, with q1 = 0.1 and q2 = 0.25
        ("Spring s(k = 200, L = 0.5)", 30.0),
        ("Spring s(k = 200, L = 0.5, d0 = 0.4)", 50.0),
        ("CubicSpring s(k = 2000, L = 0.5)", 6.75),
        ("CubicSpring s(k = 2000, L = 0.5, d0 = 0.4)", 31.25),
        ("CubicSpring s(k = 2000, L = 0.5, d0 = 0.9)", -31.25),
        ("SpringDamper s(k = 200, c = 7, L = 0.5, d0 = 0.4)", 50.0),
    ],
)
def test_spring_force(spring, force):
    run = lmoc.compile_text(
        f"""model Stretched
          Motion left(q = 0.1), right(q = 0.25);
          {spring};
        equation
          connect(left.flange, s.a);
          connect(s.b, right.flange);
        end Stretched;"""
    ).simulate(stop=1, points=2)
    assert np.allclose(run["s.f"], force, rtol=1e-12)
    assert np.allclose(run["s.a.f"], -force) and np.allclose(run["s.b.f"], force)


def test_damper_force_is_damping_times_rate_of_extension():
    run = lmoc.compile_text(
        """model Pulled
          Motion left(q = 0.2*time), right(q = 0.7*time);
          Damper damper(c = 3);
        equation
          connect(left.flange, damper.a);
          connect(damper.b, right.flange);
        end Pulled;"""
    ).simulate(stop=1, points=2)
    assert np.allclose(run["damper.f"], 1.5) and np.allclose(run["damper.loss"], 0.75)


@pytest.mark.parametrize(
    "body, inertia",
    [
        ("Disk(m = 3, r = 0.4)", 0.24),
        ("Bar(m = 2, l = 0.6)", 0.06),
        ("Bar(m = 2, l = 0.6, offset = 0.3)", 0.24),
        ("Bar(m = 2, l = 0.6, offset = 0.15)", 0.105),
    ],
)
def test_moment_of_inertia(body, inertia):
    kind, _, arguments = body.partition("(")
    dae = lmoc.compile_text(
        f"""model Free
          {kind} body({arguments};
          Torque drive(tau = 1);
        equation
          connect(drive.shaft, body.shaft);
        end Free;"""
    )
    assert dae.parameters["body.J"] == pytest.approx(inertia, rel=1e-14)
    assert dae.simulate(stop=1, points=2)["body.alpha"][0] == pytest.approx(1 / inertia)


def test_weight_acts_along_q():
    run = lmoc.compile_text("model Falling Mass mass(m = 3, g = 9.81); end Falling;").simulate(stop=1, points=3)
    assert np.allclose(run["mass.q"], 9.81 * run.time**2 / 2)
    assert np.allclose(run["mass.energy"], 0, atol=1e-6)


# -------------------------------------------------------------------------- ideal transmissions

LINE, TURN = ("Mass", "m", "flange", "v", "f", "q"), ("Inertia", "J", "shaft", "omega", "tau", "theta")
TRANSMISSIONS = {  # part: ports, and what its positions satisfy
    "Rod t(L = 0.3)": ({"a": LINE, "b": LINE}, lambda a, b: b - a - 0.3),
    "Pulley t": ({"a": LINE, "b": LINE, "axle": LINE}, lambda a, b, axle: a + b - 2 * axle),
    "Gear t(N = -2.5)": ({"a": TURN, "b": TURN}, lambda a, b: a + 2.5 * b),
    "GearPair t(r1 = 0.2, r2 = 0.5)": ({"a": TURN, "b": TURN}, lambda a, b: 0.2 * a + 0.5 * b),
    "GearPair t(r1 = 0.2, r2 = 0.5, internal = true)": ({"a": TURN, "b": TURN}, lambda a, b: 0.2 * a - 0.5 * b),
    "PlanetaryGear t(ratio = 3)": (
        {"sun": TURN, "carrier": TURN, "ring": TURN},
        lambda sun, carrier, ring: 4 * carrier - sun - 3 * ring,
    ),
    "Drum t(r = -0.4)": ({"shaft": TURN, "flange": LINE}, lambda shaft, flange: flange + 0.4 * shaft),
    "Arm t(l = 0.6)": ({"shaft": TURN, "flange": LINE}, lambda shaft, flange: flange - 0.6 * np.sin(shaft)),
    "Arm t(l = 0.6, smallAngle = true)": ({"shaft": TURN, "flange": LINE}, lambda shaft, flange: flange - 0.6 * shaft),
    "Lever t(l1 = 0.5, l2 = -0.8)": (
        {"pivot": TURN, "a": LINE, "b": LINE},
        lambda pivot, a, b: np.hypot(a - 0.5 * np.sin(pivot), b + 0.8 * np.sin(pivot)),
    ),
    "Lever t(l1 = 0.5, l2 = -0.8, smallAngle = true)": (
        {"pivot": TURN, "a": LINE, "b": LINE},
        lambda pivot, a, b: np.hypot(a - 0.5 * pivot, b + 0.8 * pivot),
    ),
}


@pytest.mark.parametrize("part", TRANSMISSIONS)
def test_transmission_keeps_its_relation_and_loses_no_power(part):
    """An inertia and a spring at every port, a driving force at the first one."""
    ports, relation = TRANSMISSIONS[part]
    lines, connections = [], []
    for i, (port, (body, inertia, end, *_)) in enumerate(ports.items()):
        spring, wall = ("Spring", "Fixed") if end == "flange" else ("TorsionSpring", "FixedShaft")
        lines.append(f"{body} {port}Body({inertia} = {1 + 0.5 * i}); {spring} {port}Spring(k = {20 + 7 * i});")
        lines.append(f"{wall} {port}Wall;")
        connections.append(f"connect({port}Wall.{end}, {port}Spring.a); connect({port}Spring.b, {port}Body.{end});")
        connections.append(f"connect({port}Body.{end}, t.{port});")
    first, (_, _, end, *_) = next(iter(ports.items()))
    drive = "Force drive(f = 5*sin(2*time));" if end == "flange" else "Torque drive(tau = 5*sin(2*time));"
    connections.append(f"connect(drive.{end}, t.{first});")
    text = "\n".join([f"model Scene {part}; {drive}", *lines, "equation", *connections, "end Scene;"])
    run = lmoc.compile_text(text).simulate(stop=2, points=21, rtol=1e-9)

    power = sum(run[f"t.{port}.{k[4]}"] * run[f"{port}Body.{k[3]}"] for port, k in ports.items())
    scale = max(np.abs(run[f"t.{port}.{k[4]}"] * run[f"{port}Body.{k[3]}"]).max() for port, k in ports.items())
    assert scale > 0.1 and np.abs(power).max() < 1e-8 * scale
    positions = {port: run[f"t.{port}.{k[5]}"] for port, k in ports.items()}
    assert np.abs(relation(**positions)).max() < 1e-8
    assert run.energy.balance < 1e-7


def test_contact_force_of_a_gear_pair_turns_the_first_gear_forwards():
    run = lmoc.compile_text(
        """model Meshed
          GearPair mesh(r1 = 0.2, r2 = 0.5);
          Inertia gear1(J = 0.1), gear2(J = 0.3);
          Torque drive(tau = 2);
        equation
          connect(gear1.shaft, mesh.a);
          connect(mesh.b, gear2.shaft);
          connect(drive.shaft, gear2.shaft);
        end Meshed;"""
    ).simulate(stop=1, points=2)
    assert np.allclose(0.1 * run["gear1.alpha"], 0.2 * run["mesh.F"])
    assert np.allclose(0.3 * run["gear2.alpha"], 2 + 0.5 * run["mesh.F"])


def test_moving_frame_counts_from_its_base_and_transmits_no_force():
    run = lmoc.compile_text(
        """model Carried
          Motion base(q = 0.5*time);
          Mass mass(m = 2, q(start = 1, fixed = true), v(start = 2, fixed = true));
          MovingFrame frame;
        equation
          connect(frame.base, base.flange);
          connect(frame.flange, mass.flange);
        end Carried;"""
    ).simulate(stop=2, points=3, rtol=1e-9)
    assert np.allclose(run["frame.q"], 1 + 1.5 * run.time) and np.allclose(run["frame.v"], 1.5)
    assert np.allclose(run["mass.a"], 0) and np.allclose(run["base.flange.f"], 0)


def test_sources_supply_what_the_scene_stores():
    run = lmoc.compile_text(
        """model Driven
          Motion hand(q = 0.3*time^2);
          Mass mass(m = 2);
          Spring spring(k = 10);
          Fixed wall;
        equation
          connect(hand.flange, mass.flange);
          connect(wall.flange, spring.a);
          connect(spring.b, mass.flange);
        end Driven;"""
    ).simulate(stop=1, points=11, rtol=1e-9)
    stored = 2 * (0.6 * run.time) ** 2 / 2 + 10 * (0.3 * run.time**2) ** 2 / 2
    assert np.allclose(run.energy.stored, stored, atol=1e-8)
    assert np.allclose(run.energy.supplied, stored, atol=1e-8)


def test_a_signal_named_power_states_nothing_of_the_energy():
    run = lmoc.compile_text(
        """model Measured
          connector RealOutput = output Real;
          model Wattmeter
            Flange a;
            Flange b;
            RealOutput power(unit = "W");
          equation
            a.q = b.q;
            a.f + b.f = 0;
            power = a.f*der(a.q);
          end Wattmeter;
          Force push(f = 3);
          Wattmeter meter;
          Mass mass(m = 2);
        equation
          connect(push.flange, meter.a);
          connect(meter.b, mass.flange);
        end Measured;"""
    ).simulate(stop=2, points=3, rtol=1e-9)
    assert run["meter.power"] == pytest.approx(3 * 1.5 * run.time)
    assert run.energy.balance < 1e-8 and run.energy.supplied == pytest.approx(0.5 * 2 * (1.5 * run.time) ** 2)
