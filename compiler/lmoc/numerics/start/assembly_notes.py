"""What is said about the way in which closed loops are put together at the start."""

from __future__ import annotations

import numpy as np

from lmoc.ir.flat import FlatDAE
from lmoc.ir.reduced import StartGuess
from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Span
from lmoc.numerics.start.targets import Targets
from lmoc.structure.messages.equations import listed

_SHOWN = 3  # loops that are told of
_NAMED = 4  # variables of one assembly


def note_assemblies(flat: FlatDAE, guess: StartGuess | None, wanted: Targets, report: Report) -> None:
    """Say which of several assemblies is taken where nothing in the model chooses one of them."""
    if guess is None or not guess.closed:
        return
    soft = wanted.variable[~wanted.hard]
    open_ = [(variables, ways) for variables, ways in guess.ways if not np.isin(variables, soft).any()]
    for variables, ways in open_[:_SHOWN]:
        taken, other = (_told(flat, variables, way) for way in ways[:2])
        count = "two" if len(ways) == 2 else f"{len(ways)}"
        name, value = flat.variable_name(int(variables[0])), float(ways[1][0])
        report.note(
            "N0539",
            f"there are {count} ways to put this together at the start; it starts with {taken}",
            _declared(flat, int(variables[0])),
            found=f"{'the other one' if len(ways) == 2 else 'the next nearest'}: {other}",
            hint=f"a start value chooses: {name} (start = {value:.4g}) the {'other' if len(ways) == 2 else 'next'} one",
        )


def note_unmet_guesses(
    flat: FlatDAE, guess: StartGuess, missed: list[tuple[int, float, float]], report: Report
) -> None:
    """Say where guesses of variables in closed loops have led.

    Parameters
    ----------
    missed : flat variables, the values that were guessed, and those that they start with
    """
    names = [f"{flat.variable_name(v)} = {reached:.6g} (start = {given:.6g})" for v, given, reached in missed]
    variables = np.array([v for v, _, _ in missed])
    others = [_told(flat, own, ways[1]) for own, ways in guess.ways if np.isin(own, variables).any()]
    first = next(a.span for a in flat.starts if a.span is not None and (a.target == variables[0]).any())
    report.note(
        "N0533",
        f"the loop closes nearest to its start values with {listed(names)}",
        first,
        found=f"it can also be put together with {others[0]}" if others else "",
        hint="start without fixed = true is a guess, which chooses between the ways in which a loop closes",
    )


def _declared(flat: FlatDAE, variable: int) -> Span | None:
    """The place of the part that a variable belongs to, or of the variable itself."""
    path = flat.block_at(variable).path
    parts = [p for p in flat.parts if p.path and p.path == path[: len(p.path)]]
    return max(parts, key=lambda p: len(p.path)).span if parts else flat.block_at(variable).span


def _told(flat: FlatDAE, variables: np.ndarray, values: np.ndarray) -> str:
    pairs = zip(variables[:_NAMED].tolist(), values[:_NAMED].tolist(), strict=True)
    return listed([f"{flat.variable_name(v)} = {value:.4g}" for v, value in pairs])
