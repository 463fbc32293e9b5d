"""From a source text to its syntax tree.

A text that the grammar accepts is read as one. Of any other, mistakes are sought in its parts (`syntax.parts`): those
that are right by themselves are read as they stand, and from the first wrong part to the last one the text is repaired.
So a mistake in a class says nothing of the classes before and behind it, and what is known of a part follows from its
own text: an editor reads nothing else after a key (`lmoc.editor.pieces`). Likewise a mistake in a class inside of a
package says nothing of what is around it there, where it is the only wrong one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from lmoc.messages.diagnostics import Diagnostic, Report
from lmoc.messages.source import Source, Span
from lmoc.support.records import dataclass
from lmoc.syntax import tree
from lmoc.syntax.automaton import TooDeep, run
from lmoc.syntax.declarations import Actions
from lmoc.syntax.lexer import certain_tokens, left_open, scan
from lmoc.syntax.parts import Part, divided, emptied, inside
from lmoc.syntax.tables import load

MOST_ERRORS = 20  # of one text: beyond them it is no program
_MORE = 10_000  # characters behind a part in which a comment or a string of it may end


@dataclass(frozen=True)
class Parsed:
    """What could be understood of a text, or of a part of it.

    Attributes
    ----------
    file : the tree; all of it where `diagnostics` has no errors
    diagnostics : the first `MOST_ERRORS`, in the order of their places
    mended : the part that was repaired; None where the grammar accepts all of it
    """

    file: tree.File
    diagnostics: tuple[Diagnostic, ...]
    mended: Part | None = None


def parse(source: Source, report: Report) -> tree.File:
    """The syntax tree of a text.

    Parameters
    ----------
    source : Source
    report : Report
        Takes the first `MOST_ERRORS` syntax errors, in the order of their places.

    Returns
    -------
    tree.File
        What could be understood; all of it where `report` has no new errors.
    """
    parsed = parsed_in_parts(source)
    report.diagnostics += parsed.diagnostics
    return parsed.file


def parsed_in_parts(source: Source, within: Part | None = None) -> Parsed:
    """What can be understood of a text, or of some of its parts, and what of it had to be repaired."""
    within = within or Part(0, len(source.text))
    whole = accepted(source, within)
    if whole is not None:
        return whole
    parts = [p for p in divided(source.text) if within.start <= p.start < within.end]
    if len(parts) == 1:
        return _repaired(source, parts[0])
    before = _right_ones(source, parts)
    behind = _right_ones(source, parts[: len(before) : -1])[::-1]
    wrong = Part(parts[len(before)].start, parts[-1 - len(behind)].end)
    middle = _repaired(source, wrong) if wrong in parts else mended(source, wrong)
    return _joined([*before, middle, *behind], middle.mended)


def _right_ones(source: Source, parts: Sequence[Part]) -> list[Parsed]:
    """The parts in front that are right by themselves; there is one that is not, or the whole would be right."""
    found: list[Parsed] = []
    for part in parts:
        read = accepted(source, part)
        if read is None:
            break
        found.append(read)
    return found


def _joined(parts: Sequence[Parsed], repaired: Part | None) -> Parsed:
    span = parts[0].file.span
    classes = tuple(c for p in parts for c in p.file.classes)
    said = tuple(d for p in parts for d in p.diagnostics)
    return Parsed(tree.File(parts[0].file.within, classes, span), said[:MOST_ERRORS], repaired)


def accepted(source: Source, part: Part, text: str | None = None) -> Parsed | None:
    """What stands in a part of a text; None where the characters or the grammar make it wrong.

    Parameters
    ----------
    text : as long as that of `source`, and read in its place
    """
    tables = load()
    tokens, said = scan(source if text is None else Source(source.name, text), tables, part)
    if said:
        return None
    found = Report()
    try:
        file = run(tables, tokens, Actions(source, found))
    except TooDeep:
        return None
    return None if file is None else Parsed(file, _first(found.diagnostics))


def mended(source: Source, part: Part) -> Parsed:
    """What can be understood of a part that is not `accepted`."""
    tables = load()
    tokens, said = scan(source, tables, part)
    found = Report()
    try:
        file = run(tables, tokens, Actions(source, found))
        if file is None:
            # Only now is it worth to load what explains and repairs.
            from lmoc.syntax.recovery import repair

            tokens, said = scan(source, tables, part, doubtful=True)
            found = Report()
            changes, acceptable = repair(source, tables, tokens, tuple(said), MOST_ERRORS)
            said += changes
            if acceptable:
                file = run(tables, tokens, Actions(source, found))
            # What an action says about a place that was repaired is about the repair.
            found = Report([d for d in found.diagnostics if not any(_touch(d.span, change.span) for change in changes)])
    except TooDeep as deep:
        place = Span(source, tokens.starts[deep.at], tokens.ends[deep.at])
        return Parsed(_nothing(source), (*_first(said, MOST_ERRORS - 1), _too_deep(place)), part)
    return Parsed(file or _nothing(source), _first([*said, *found.diagnostics]), part)


def _repaired(source: Source, part: Part) -> Parsed:
    """As `mended`; a package of which only one class inside is wrong by itself is repaired there alone."""
    cuts = inside(source.text, part)
    read = [accepted(source, cut.part) for cut in cuts]
    wrong = [cut for cut, own in zip(cuts, read)
             if own is None or not right_inside(own.file, own.diagnostics, cut.head)]  # fmt: skip
    one = mended_inside(source, wrong[0].part, wrong[0].head) if len(wrong) == 1 else None
    if one is None:
        return mended(source, part)
    text, (start, end) = source.text, wrong[0].part
    around = accepted(source, part, text[:start] + emptied(text[start:end]) + text[end:])
    if around is None or not cut_out(around.file.classes, [cut.head for cut in cuts]):
        return mended(source, part)
    classes = filled(around.file.classes, {wrong[0].head: one.file.classes[0]})
    file = tree.File(around.file.within, classes, around.file.span)
    return Parsed(file, _first([*around.diagnostics, *one.diagnostics]), wrong[0].part)


def right_inside(file: tree.File, said: Sequence[Diagnostic], head: int) -> bool:
    """Whether a part is one class, whose name ends at a character, with all that is wrong in it."""
    if file.within or len(file.classes) != 1:
        return False
    (own,) = file.classes
    holds = (d.span is not None and own.span.start <= d.span.start and d.span.end <= own.span.end for d in said)
    return own.name_span.end == head and all(holds)


def mended_inside(source: Source, part: Part, head: int) -> Parsed | None:
    """As `mended`, of a class inside of a package; None where it matters to what is around it."""
    if left_open(source.text, part) is not None:
        return None
    parsed = mended(source, part)
    return parsed if right_inside(parsed.file, parsed.diagnostics, head) else None


def cut_out(classes: Sequence[tree.Class], heads: Sequence[int]) -> bool:
    """Whether there are classes whose names end at these characters, public ones."""
    found = {c.name_span.end for c in _all(classes) if not c.protected}
    return found.issuperset(heads)


def _all(classes: Iterable[tree.Class]) -> Iterator[tree.Class]:
    for c in classes:
        yield c
        yield from _all(e for e in c.elements if isinstance(e, tree.Class))


def filled(classes: Iterable[tree.Class], others: Mapping[int, tree.Class]) -> tuple[tree.Class, ...]:
    """Classes in which others take the place of those whose names end at these characters."""

    def one(e: tree.Element) -> tree.Element:
        return others.get(e.name_span.end) or within(e) if isinstance(e, tree.Class) else e

    def within(c: tree.Class) -> tree.Class:
        return replace(c, elements=tuple(map(one, c.elements)))

    return tuple(within(c) for c in classes)


def refused(source: Source, part: Part) -> bool:
    """Whether a text is wrong whatever stands behind a part that is wrong by itself, if what is before it is right.

    So it is where the grammar stops in the part, or before the end of a comment or a string that begins in it and ends
    elsewhere; and where a class is left open, since later parts that are right by themselves close nothing. Where
    that cannot be seen from the part and a little more, false.
    """
    from lmoc.syntax.recovery import read_on
    from lmoc.syntax.trouble import StackNode

    text, tables = source.text, load()
    if part.end == len(text):
        return True
    ends = left_open(text, part) is None
    if not ends:
        part = Part(part.start, text.rfind("\n", part.end, part.end + _MORE) + 1 or len(text))
    tokens, wrong = certain_tokens(text, part)
    trail = [StackNode(tables.start, "", 0, None)]
    read_on(tables, tokens, trail)
    at, last = len(trail) - 1, len(tokens.symbols) - 1
    return wrong or at < last - 1 or ends and tokens.symbols[last - 1] == ";"


def _first(said: Sequence[Diagnostic], most: int = MOST_ERRORS) -> tuple[Diagnostic, ...]:
    return tuple(sorted(said, key=lambda d: d.span.start)[:most])


def _nothing(source: Source) -> tree.File:
    return tree.File((), (), Span(source, 0, len(source.text)))


def _too_deep(place: Span) -> Diagnostic:
    hint = "name a part of the expression as a variable of its own, or put a part of the class into another one"
    return Diagnostic("E0123", "brackets, branches or classes are nested too deeply here", place, hint=hint)


def _touch(a: Span, b: Span) -> bool:
    return a.start <= b.end and b.start <= a.end
