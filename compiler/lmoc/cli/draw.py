"""`lmoc draw`: the picture of a scene, from its model alone."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from lmoc.cli import terminal
from lmoc.cli.arguments import Parser, UsageError, add_model_arguments, number
from lmoc.messages.diagnostics import Diagnostic

if TYPE_CHECKING:
    from lmoc.view.drawing import Drawing


def configure(parser: Parser) -> None:
    add_model_arguments(parser)
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, required=True, help="picture: .svg, .png, .pdf")
    parser.add_argument("--free-body", action="store_true", help="each body cut out, with the forces on it")
    parser.add_argument("--at", metavar="TIME", type=number, help="of free bodies: the forces of a run at a time")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")


def execute(arguments: argparse.Namespace) -> int:
    from lmoc.report.files import PICTURES, check_target

    check_target(arguments.output, PICTURES)
    if arguments.at is not None and not arguments.free_body:
        raise UsageError([Diagnostic("E0620", "--at is for free-body diagrams", hint="--free-body --at 0.6")])
    drawing = _drawn(arguments)
    path = drawing.save(arguments.output)
    if not arguments.quiet:
        for note in drawing.picture.notes:
            print(note)
        print(f"picture written to {path}")
    return 0


def _drawn(arguments: argparse.Namespace) -> Drawing:
    """The scene need not be solvable to be drawn; only a mechanism of the plane is asked where it starts."""
    from lmoc import pipeline
    from lmoc.cli.progress import Progress
    from lmoc.cli.scene import scene_of
    from lmoc.interface import DAE
    from lmoc.parameters import indexed
    from lmoc.pipeline import Clock
    from lmoc.view.drawing import Drawing

    with Progress(not arguments.quiet) as progress:
        clock = Clock(progress.stage)
        scene = pipeline.open_scene(arguments.file, scene_of(arguments), clock)
        flat = pipeline.flatten(scene, clock)
        values = flat.parameter_values(indexed(flat, flat.overrides))
        if arguments.free_body:
            from lmoc.view.bodies.compose import free_body_picture

            dae = DAE(scene, flat, clock)
            run = None if arguments.at is None else dae.simulate()
            picture = free_body_picture(dae.prepare(), run, arguments.at, dae.at_start)
        else:
            from lmoc.view.scene.compose import picture_of

            picture = picture_of(flat, values, lambda: DAE(scene, flat, clock).at_start())
    if not arguments.quiet:
        terminal.show(flat.notes, ("warning",))
    return Drawing(picture)
