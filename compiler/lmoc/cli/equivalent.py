"""`lmoc equivalent PORT [PORT]`: one spring, damper and inertia in the place of a network."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from lmoc.cli import terminal
from lmoc.cli.arguments import Parser, add_model_arguments
from lmoc.cli.progress import Progress, working

if TYPE_CHECKING:
    from lmoc.symbolic.equivalent import Equivalent

OPEN_END = "W0312"  # a port without connection is where a network is seen


def configure(parser: Parser) -> None:
    add_model_arguments(parser)
    add = parser.add_argument
    add("port", metavar="PORT", help="where the network is seen, as mass.flange")
    add("other", metavar="PORT", nargs="?", help="against which other port; without it, against the ground")
    add("--json", action="store_true", help="print JSON")


def execute(arguments: argparse.Namespace) -> int:
    """The network alone need not be a scene that can move: it is flattened, and not reduced."""
    from lmoc.parameters import indexed
    from lmoc.pipeline import Clock, Scene, flatten, open_scene
    from lmoc.symbolic.equivalent import equivalent

    with Progress() as progress:
        clock = Clock(progress.stage)
        scene = Scene((), arguments.model, dict(arguments.set), None, arguments.path)
        scene = open_scene(arguments.file, scene, clock)
        flat = flatten(scene, clock)
    terminal.show((d for d in flat.notes if d.code != OPEN_END), ("warning",))
    values = flat.parameter_values(indexed(flat, flat.overrides))
    with working("equivalent"):
        found = equivalent(flat, values, arguments.port, arguments.other)
    print(json.dumps(as_data(found), indent=2, ensure_ascii=False) if arguments.json else found)
    return 0


def as_data(found: Equivalent) -> dict:
    """Equivalent constants as plain data; null where one spring, damper and inertia do not do."""
    constants = {"stiffness": found.stiffness, "damping": found.damping, "inertia": found.inertia}
    return {
        "ports": [port for port in found.ports if port is not None],
        "rotational": found.rotational,
        "dynamic_stiffness": str(found.dynamic_stiffness),
        **{name: None if value is None else str(value) for name, value in constants.items()},
    }
