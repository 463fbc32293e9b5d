"""`lmoc show --stage NAME`: what a stage of the compiler has made of a scene."""

from __future__ import annotations

import argparse
from dataclasses import fields, is_dataclass

from lmoc.cli.arguments import Parser, add_model_arguments, choice
from lmoc.source import Span

STAGES = ("parse", "instantiate", "flatten", "reduce", "lower")


def configure(parser: Parser) -> None:
    add_model_arguments(parser)
    add = parser.add_argument
    add("--stage", type=choice(STAGES), metavar="NAME", default="flatten", help=f"{', '.join(STAGES)} (flatten)")


def execute(arguments: argparse.Namespace) -> int:
    print(_text(arguments))
    return 0


def _text(arguments: argparse.Namespace) -> str:
    from lmoc.pipeline import Clock, Scene, flatten, parse, read_source
    from lmoc.report import listing

    clock = Clock()
    files = parse([read_source(arguments.file)], clock)
    if arguments.stage == "parse":
        return "\n".join(line for file in files for line in _tree(file, ""))
    scene = Scene(files, arguments.model, dict(arguments.set))
    flat = flatten(scene, clock)
    if arguments.stage == "instantiate":
        return listing.instance_text(flat)
    if arguments.stage == "flatten":
        return listing.flat_text(flat)
    from lmoc.dae import DAE

    dae = DAE(scene, flat, clock)
    return (listing.reduced_text if arguments.stage == "reduce" else listing.numeric_text)(dae.reduced)


def _tree(node: object, lead: str) -> list[str]:
    """A node, its plain attributes on its line and its children below; what is empty is left out."""
    plain, children = [], []
    for f in fields(node):
        value = getattr(node, f.name)
        if value is None or value is False or value == () or value == "" or isinstance(value, Span):
            continue
        if is_dataclass(value):
            children.append((f.name, [value]))
        elif isinstance(value, tuple) and any(is_dataclass(v) for v in value):
            children.append((f.name, [v for v in value if is_dataclass(v)]))
        else:
            plain.append(value if f.name == "name" and isinstance(value, str) else f"{f.name}={value!r}")
    lines = [f"{lead}{type(node).__name__} {' '.join(map(str, plain))}".rstrip()]
    for name, values in children:
        lines.append(f"{lead}  {name}:")
        for value in values:
            lines += _tree(value, lead + "    ")
    return lines
