"""Random scenes to be drawn: lattices, trees, cycles, gears, levers, ropes, belts, mechanisms of the plane."""

from __future__ import annotations

from random import Random

LINKS = ("Spring(k = 1)", "Damper(c = 1)", "SpringDamper(k = 1, c = 1)", "Rod", "Cable(L = 1)", "DryFriction(F = 1)")
TWISTS = ("TorsionSpring(k = 1)", "TorsionDamper(c = 1)", "Gear(N = 2)", "GearPair(r1 = 1, r2 = 2)", "Clutch(tau = 1)")
BELTS = ("Belt(r1 = 1, r2 = 2)", "Belt(r1 = 2, r2 = 1, crossed = true)", "Chain(z1 = 20, z2 = 40, pitch = 0.01)")
CAM = "CamProfile(profile = [0, 0; 2, 0.01; 4, 0.004; 6.283185307179586, 0])"
MACHINES = ("Rack(r = 0.1)", "Rack(r = -0.1)", "Screw(lead = 0.01)", "Unbalance(m = 1, r = 0.1)", CAM)


class Scene:
    """A model that is being written."""

    def __init__(self, seed: int) -> None:
        self.choose = Random(seed)
        self.parts: list[str] = []
        self.connections: list[tuple[str, str]] = []
        self.number = 0

    def add(self, declaration: str) -> str:
        """Declare a part of a class with its modification; returns its name."""
        self.number += 1
        kind, _, rest = declaration.partition("(")
        name = f"p{self.number}"
        self.parts.append(f"  {kind} {name}{'(' + rest if rest else ''};")
        return name

    def connect(self, a: str, b: str) -> None:
        self.connections.append((a, b))

    def text(self) -> str:
        lines = [f"  connect({a}, {b});" for a, b in self.connections]
        return "\n".join(["model Random", *self.parts, "equation", *lines, "end Random;", ""])


def graph(seed: int, parts: int, wheels: int = 0, machines: int = 0) -> str:
    """A random graph of parts on lines and shafts, joined by levers, pulleys, drums, and by wheels on a road.

    Parameters
    ----------
    machines : racks, screws, unbalances and cams; with some, shafts have belts, too
    """
    scene = Scene(seed)
    choose = scene.choose
    lines = [f"{scene.add('Fixed')}.flange"]
    shafts = [f"{scene.add('FixedShaft')}.shaft"]
    kinds = ("tree", "cycle", "dense", "mixed")
    kind = kinds[seed % len(kinds)]
    while len(scene.parts) < parts:
        turn = choose.random() < 0.35
        places, links = (shafts, TWISTS + BELTS * bool(machines)) if turn else (lines, LINKS)
        ports = ("shaft" if turn else "flange"), "a", "b"
        if kind == "mixed" and choose.random() < 0.3:
            _joint(scene, lines, shafts)
        elif choose.random() < {"tree": 0.0, "cycle": 0.15, "dense": 0.45, "mixed": 0.15}[kind] and len(places) > 2:
            link = scene.add(choose.choice(links))
            a, b = choose.sample(places, 2)
            scene.connect(a, f"{link}.{ports[1]}")
            scene.connect(f"{link}.{ports[2]}", b)
        else:
            link = scene.add(choose.choice(links))
            here, there = choose.sample(ports[1:], 2)
            scene.connect(choose.choice(places), f"{link}.{here}")
            if choose.random() < 0.8:
                body = scene.add("Inertia(J = 1)" if turn else "Mass(m = 1, g = 9.81)" if seed % 3 else "Mass(m = 1)")
                scene.connect(f"{link}.{there}", f"{body}.{ports[0]}")
            places.append(f"{link}.{there}")
    for _ in range(machines):
        machine = scene.add(choose.choice(MACHINES))
        scene.connect(f"{machine}.shaft", choose.choice(shafts))
        scene.connect(f"{machine}.flange", choose.choice(lines))
    for _ in range(wheels):
        wheel = scene.add(f"Wheel(r = {choose.choice((0.1, 0.3, 0.35))})")
        scene.connect(f"{wheel}.shaft", choose.choice(shafts))
        if choose.random() < 0.9:
            scene.connect(f"{wheel}.flange", choose.choice(lines))
    return scene.text()


def _joint(scene: Scene, lines: list[str], shafts: list[str]) -> None:
    """A lever, a pulley or a drum between places that there are."""
    choose = scene.choose
    some = [choose.choice(lines) for _ in range(3)]
    kind = choose.choice(("Lever(l1 = 1, l2 = -1)", "Pulley", "Drum(r = 0.1)", "Arm(l = 1)", "Beam(l1 = -1, l2 = 1)"))
    part = scene.add(kind)
    if kind.startswith(("Pulley", "Beam")):
        third = "axle" if kind == "Pulley" else "pivot"
        for port, place in zip(("a", "b", third), some, strict=True):
            if choose.random() < 0.7:
                scene.connect(f"{part}.{port}", place)
            lines.append(f"{part}.{port}")
    elif kind.startswith("Lever"):
        scene.connect(f"{part}.pivot", choose.choice(shafts))
        scene.connect(f"{part}.a", some[0])
        lines.append(f"{part}.b")
    else:
        scene.connect(f"{part}.shaft", choose.choice(shafts))
        lines.append(f"{part}.flange")


def lattice(rungs: int, rows: int, domain: str = "line") -> str:
    """Chains of springs and masses side by side, joined by rungs."""
    spring, body, wall, port = {
        "line": ("Spring(k = 1)", "Mass(m = 1)", "Fixed", "flange"),
        "shaft": ("TorsionSpring(k = 1)", "Inertia(J = 1)", "FixedShaft", "shaft"),
    }[domain]
    scene = Scene(0)
    ground = scene.add(wall)
    before = [f"{ground}.{port}"] * rows
    for _ in range(rungs):
        now = []
        for place in before:
            link, mass = scene.add(spring), scene.add(body)
            scene.connect(place, f"{link}.a")
            scene.connect(f"{link}.b", f"{mass}.{port}")
            now.append(f"{mass}.{port}")
        for one, other in zip(now, now[1:]):
            link = scene.add(spring)
            scene.connect(one, f"{link}.a")
            scene.connect(f"{link}.b", other)
        before = now
    return scene.text()


def plane(seed: int, bars: int) -> str:
    """A hanging chain of bars with springs, dampers, particles, and parts of lines and shafts on it."""
    scene = Scene(seed)
    choose = scene.choose
    ground = scene.add("Planar.Ground")
    frames = [f"{ground}.frame"]
    for _ in range(bars):
        pin, bar = scene.add(f"Planar.Revolute(useShaft = {'true' if seed % 2 else 'false'})"), scene.add(
            f"Planar.Bar(l = {choose.choice((0.5, 1, 1.5))}, m = 1)"
        )
        scene.connect(choose.choice(frames), f"{pin}.a")
        scene.connect(f"{pin}.b", f"{bar}.a")
        frames.append(f"{bar}.b")
        if seed % 2 and choose.random() < 0.6:
            kinds = "Inertia(J = 1)", "Torque(tau = 1)", "TorsionSpring(k = 1)", "Drum(r = 1)"
            extra = scene.add(choose.choice(kinds))
            kind = scene.parts[-1].split()[0]
            scene.connect(f"{pin}.shaft", f"{extra}.{'a' if kind == 'TorsionSpring' else 'shaft'}")
            if kind == "TorsionSpring":
                scene.connect(f"{extra}.b", f"{scene.add('FixedShaft')}.shaft")
            if kind == "Drum":
                scene.connect(f"{extra}.flange", f"{scene.add('Mass(m = 1)')}.flange")
        if choose.random() < 0.5:
            _tie(scene, frames)
    return scene.text()


def _tie(scene: Scene, frames: list[str]) -> None:
    """A spring, a damper or both from a bar to the ground."""
    point = scene.add("Planar.PointOf")
    anchor = scene.add(f"Planar.Anchor(x = {scene.choose.choice((-2, 1, 2))}, y = 0.5)")
    scene.connect(frames[-1], f"{point}.frame")
    for kind in scene.choose.choice((("Spring(k = 1)",), ("Damper(c = 1)",), ("Spring(k = 1)", "Damper(c = 1)"))):
        part = scene.add(f"Planar.{kind}")
        scene.connect(f"{point}.point", f"{part}.a")
        scene.connect(f"{part}.b", f"{anchor}.point")
