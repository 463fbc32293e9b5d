"""`lmoc explain E0312`: the catalogue's page of a code."""

from __future__ import annotations

import argparse
from textwrap import fill, indent

from lmoc.cli.arguments import Parser, UsageError
from lmoc.messages.catalogue import CATALOGUE
from lmoc.messages.diagnostics import Diagnostic, nearest


def configure(parser: Parser) -> None:
    parser.add_argument("code", metavar="CODE", nargs="?", help="a code such as E0312; without one, all are listed")


def execute(arguments: argparse.Namespace) -> int:
    if arguments.code is None:
        for code, entry in sorted(CATALOGUE.items(), key=lambda item: (item[0][1:], item[0])):
            print(f"{code}  {entry.title}")
        return 0
    code = arguments.code.upper()
    if code not in CATALOGUE:
        hint = nearest(code, CATALOGUE) or "`lmoc explain` lists the codes"
        raise UsageError([Diagnostic("E0620", f"there is no diagnostic '{arguments.code}'", hint=hint)])
    entry = CATALOGUE[code]
    print(f"{code}: {entry.title}\n\n{fill(' '.join(entry.explanation.split()), 100)}")
    if entry.example:
        print("\nExample:\n\n" + indent(entry.example, "    "))
    return 0
