"""Diagnostics of the compiler: errors, warnings and notes with their place.

Each stage collects into a `Report` and goes on as far as it can, so that one run names several
mistakes; `Report.check` raises one `ModelError` for all of them at the end of the stage.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import field
from enum import Enum
from typing import Any

from lmoc.messages.source import Span
from lmoc.support.records import dataclass

_LONGEST = 600  # characters of a message, or of what is expected, found or hinted at


@dataclass(frozen=True)
class Label:
    """A second place that belongs to a diagnostic, with what is to be seen there."""

    span: Span
    text: str


class Area(Enum):
    """What a diagnostic is about, as the first two digits of its code say."""

    SYNTAX = "01"
    NAMES = "02"
    TYPES = "03"
    STRUCTURE = "04"
    RUN = "05"
    COMMAND = "06"


class Subject(Enum):
    """What a diagnostic says, where a program acts on it: codes are for people."""

    NO_START = "no consistent start has been found, which there may be in other coordinates"
    STATE_REFUSED = "a requested variable cannot be a state"
    LEFT_OUT = "a redundant constraint has been left out"
    NOT_FINITE = "a value is not finite"
    WRITING = "how something is written, which who only uses it cannot change"
    RESHAPED = "the flat model has been made again, since a parameter shapes it"


@dataclass(frozen=True)
class Diagnostic:
    """One message.

    Attributes
    ----------
    code : str
        ``E0312``, ``W0102``, ``N0001``: a key of `lmoc.messages.catalogue.CATALOGUE`.
    message : str
        One sentence in the user's names.
    span : Span | None
        Where; None only for messages about the command or a file as a whole.
    expected, found, hint : str
        Shown on lines of their own where not empty.
    labels : tuple of Label
        Further places (the first declaration, the other end of a connection).
    subject : Subject | None
        Only where a program acts on it.
    """

    code: str
    message: str
    span: Span | None = None
    expected: str = ""
    found: str = ""
    hint: str = ""
    labels: tuple[Label, ...] = ()
    subject: Subject | None = None

    @property
    def severity(self) -> str:
        return {"E": "error", "W": "warning", "N": "note"}[self.code[0]]

    @property
    def area(self) -> Area:
        return Area(self.code[1:3])

    def __str__(self) -> str:
        return render(self)


@dataclass(frozen=True)
class Entry:
    """The catalogue's explanation of a code.

    Attributes
    ----------
    title : str
        The kind of mistake, in a few words.
    explanation : str
        Why it is one, and what to do.
    example : str
        A small program that gives it; empty where a program alone does not.
    """

    title: str
    explanation: str
    example: str = ""


@dataclass
class Report:
    """Collects diagnostics during a stage."""

    diagnostics: list[Diagnostic] = field(default_factory=list)

    def error(self, code: str, message: str, span: Span | None = None, **more: Any) -> None:
        self.diagnostics.append(Diagnostic(code, message, span, **more))

    warning = error
    note = error

    def note_once(self, code: str, message: str, hint: str = "") -> None:
        """Add a note, unless there is one of this code."""
        if all(d.code != code for d in self.diagnostics):
            self.note(code, message, hint=hint)

    def says(self, subject: Subject) -> bool:
        """Return whether one of the diagnostics is about that."""
        return any(d.subject is subject for d in self.diagnostics)

    @property
    def errors(self) -> list[Diagnostic]:
        return [d for d in self.diagnostics if d.severity == "error"]

    def check(self) -> None:
        """Raise `ModelError` if there is an error among the diagnostics."""
        if self.errors:
            raise ModelError(self.diagnostics)


class ModelError(Exception):
    """The model is wrong; `diagnostics` say what and where."""

    def __init__(self, diagnostics: Iterable[Diagnostic]):
        self.diagnostics = tuple(diagnostics)
        super().__init__("\n\n".join(render(d) for d in self.diagnostics))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.diagnostics,)  # else a copy would be made from the text


class SimulationError(Exception):
    """A run failed at `time`; `partial` is the `Run` computed until then (None before the start)."""

    def __init__(self, message: str, time: float | None = None, partial: object = None):
        super().__init__(message)
        self.time = time
        self.partial = partial


class RunInterrupted(KeyboardInterrupt):
    """A run was interrupted from the keyboard at `time`; `partial` is the `Run` computed until then."""

    def __init__(self, message: str, time: float, partial: object):
        super().__init__(message)
        self.time = time
        self.partial = partial


def nearest(name: str, candidates: Iterable[str]) -> str:
    """A hint sentence with the candidate most like `name`; empty where none is near."""
    close = most_like(name, candidates)
    return f"did you mean '{close}'?" if close else ""


def most_like(name: str, candidates: Iterable[str]) -> str:
    """Return the candidate most like `name`; empty where none is near."""
    import difflib

    name, candidates = str(name), list(candidates)
    same = next((c for c in candidates if c.lower() == name.lower() and c != name), None)
    if same is not None:
        return same
    return next(iter(difflib.get_close_matches(name, candidates, n=1, cutoff=0.6)), "")


def render(d: Diagnostic) -> str:
    """A diagnostic as text: headline, place, the line with a mark under it, expected, found, hint."""
    from lmoc.messages.excerpt import Mark, by_source, excerpt

    lines = [f"{d.severity}[{d.code}]: {_clipped(d.message)}"]
    marks = [Mark(d.span, "^", "")] if d.span is not None else []
    marks += [Mark(label.span, "-", label.text) for label in d.labels]
    for group in by_source(marks):
        lines += excerpt(group)
    for title, text in (("expected", d.expected), ("found", d.found), ("hint", d.hint)):
        if text:
            lines.append(f"  = {title}: {_clipped(text)}")
    return visible("\n".join(lines))


def visible(text: str) -> str:
    """Return a text without signs that a terminal would take for commands: they are shown as ``·``."""
    if all(line.isprintable() for line in text.split("\n")):
        return text
    return "".join(sign if sign.isprintable() or sign == "\n" else "·" for sign in text)


def _clipped(text: str) -> str:
    """A text without its middle, where it is longer than anybody would read: a name of a thousand letters, say."""
    half = _LONGEST // 2
    return text if len(text) <= _LONGEST else f"{text[:half]} … {text[-half:]}"
