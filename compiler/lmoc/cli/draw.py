"""`lmoc draw`: the picture of a scene, from its model alone."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from lmoc.cli import terminal
from lmoc.cli.arguments import Parser, UsageError, add_model_arguments, number
from lmoc.messages.diagnostics import Diagnostic

if TYPE_CHECKING:
    from lmoc.run import Run
    from lmoc.view.drawing import Drawing


def configure(parser: Parser) -> None:
    add_model_arguments(parser)
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, help="picture: .svg, .png, .pdf")
    parser.add_argument("--free-body", action="store_true", help="each body cut out, with the forces on it")
    parser.add_argument("--at", metavar="TIME", type=number, help="of free bodies: the forces of a run at a time")
    add = parser.add_argument
    add("--frames", metavar="N", type=int, help="a strip of the motion: N instants of a run beside each other")
    add("--gif", metavar="FILE", type=Path, help="a film of a run; needs the program ffmpeg")
    add("--mp4", metavar="FILE", type=Path, help="a film of a run; needs the program ffmpeg")
    add("--dimensions", action="store_true", help="with the lengths of bars, rods, links and lever arms")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")


def execute(arguments: argparse.Namespace) -> int:
    from lmoc.report.files import PICTURES, check_target
    from lmoc.view.drawing import Drawing
    from lmoc.view.scene.moving import ffmpeg, film, strip

    films = [(arguments.gif, ".gif"), (arguments.mp4, ".mp4")]
    films = [(path, ending) for path, ending in films if path is not None]
    _check(arguments, bool(films))
    for path, ending in films:
        check_target(path, (ending,))
        ffmpeg(path)
    if arguments.output is not None:
        check_target(arguments.output, PICTURES)
    drawing, run = _drawn(arguments, bool(films))
    written = [film(drawing.picture, run, path) for path, _ in films]
    if arguments.output is not None:
        if arguments.frames is not None:
            drawing = Drawing(strip(drawing.picture, run, arguments.frames))
        written.append(drawing.save(arguments.output))
    if not arguments.quiet:
        for note in drawing.picture.notes:
            print(note)
        for path in written:
            print(f"picture written to {path}")
    return 0


def _check(arguments: argparse.Namespace, films: bool) -> None:
    """Refuse options that do not belong together."""
    from lmoc.view.scene.moving import MOST

    wrong, hint = "", ""
    if arguments.at is not None and not arguments.free_body:
        wrong, hint = "--at is for free-body diagrams", "--free-body --at 0.6"
    elif arguments.free_body and (films or arguments.frames is not None or arguments.dimensions):
        wrong = "--frames, --gif, --mp4 and --dimensions are for the picture of the scene, not for free-body diagrams"
    elif arguments.output is None and not films:
        wrong, hint = "where should the picture be written?", "-o scene.svg"
    elif arguments.frames is not None and (not 1 <= arguments.frames <= MOST or arguments.output is None):
        wrong, hint = f"--frames wants a number of 1 to {MOST}, and a picture", "--frames 8 -o strip.svg"
    if wrong:
        raise UsageError([Diagnostic("E0620", wrong, hint=hint or None)])


def _drawn(arguments: argparse.Namespace, films: bool) -> tuple[Drawing, Run | None]:
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
        run = None
        if arguments.free_body:
            from lmoc.view.bodies.compose import free_body_picture

            dae = DAE(scene, flat, clock)
            run = None if arguments.at is None else dae.simulate()
            picture = free_body_picture(dae.prepare(), run, arguments.at, dae.at_start)
        else:
            from lmoc.view.scene.compose import picture_of

            if films or arguments.frames is not None:
                run = DAE(scene, flat, clock).simulate()
            picture = picture_of(flat, values, lambda: DAE(scene, flat, clock).at_start(), arguments.dimensions)
    if not arguments.quiet:
        terminal.show(flat.notes, ("warning",))
    return Drawing(picture), run
