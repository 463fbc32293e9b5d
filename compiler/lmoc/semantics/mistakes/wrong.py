"""The exception that carries a mistake from where it was found."""

from __future__ import annotations

import os

import numpy as np

from lmoc.messages.diagnostics import Diagnostic, Report
from lmoc.messages.source import Span
from lmoc.support import budget
from lmoc.support.records import dataclass

MAX_ELEMENTS = 50_000_000  # of one array of parts or numbers, or rounds of a loop


@dataclass
class Budget:
    """A limit on the cost of building one model, so that models of unmanageable size are rejected early.

    Attributes
    ----------
    name : of the environment variable that raises the limit
    most : the limit
    spent : so far
    """

    name: str
    what: str
    most: int
    spent: int = 0

    def __post_init__(self):
        given = os.environ.get(self.name, "")
        self.most = int(given) if given.isdecimal() else self.most

    def spend(self, count: int, span: Span) -> None:
        """Count work that is about to be done, and refuse it beyond the limit (E0225)."""
        self.spent += count
        budget.reached(self.spent / self.most)
        if self.spent > self.most:
            limit = f"{self.most:,}".replace(",", " ")
            raise Exhausted("E0225", f"this takes more than {limit} {self.what}", span,
                            hint=f"{self.name}=… in the environment allows more")  # fmt: skip


class Wrong(Exception):
    """Ends the work on one equation or declaration; its user reports it and goes on with the next.

    Without arguments it says nothing: what is wrong has been reported where it stands, and everything that
    depends on it is left out in silence.
    """

    def __init__(self, code: str = "", message: str = "", span: Span | None = None, **more):
        super().__init__(message)
        self.diagnostic = Diagnostic(code, message, span, **more) if code else None

    def put_into(self, report: Report) -> None:
        """Report it, unless as much has been said of the same place before (in another round of a loop, say)."""
        new = self.diagnostic
        if new is None:
            return
        for old in report.diagnostics:
            if old == new or (old.code == new.code and new.span is not None and old.span == new.span):
                return
        report.diagnostics.append(new)


class Refused(Wrong):
    """A class or a file that is wrong by itself: whatever uses it says so."""

    def __init__(self, mistakes: tuple[Diagnostic, ...]):
        super().__init__()
        self.mistakes = mistakes

    def put_into(self, report: Report) -> None:
        """Report all that is wrong, once."""
        report.diagnostics += [d for d in self.mistakes if d not in report.diagnostics]


class NoModel(Wrong):
    """No class is named, and there is none that could be meant."""


class SeveralModels(Wrong):
    """No class is named, and several could be meant.

    Attributes
    ----------
    names : their full names
    """

    def __init__(self, names: tuple[str, ...], code: str, message: str, span: Span, **more):
        super().__init__(code, message, span, found=", ".join(names), **more)
        self.names = names


class NoClass(Wrong):
    """There is no class of a name."""


class NotAClass(Wrong):
    """What a name stands for is a component, where a class is expected."""


class NoElement(Wrong):
    """A part or a connector has no element of a name.

    Attributes
    ----------
    guessed : whether another name is like it, which is hinted at
    """

    def __init__(self, code: str, message: str, span: Span, hint: str, guessed: bool):
        super().__init__(code, message, span, hint=hint)
        self.guessed = guessed


class NotThere(Wrong):
    """A part is absent, since its condition is false."""


class OutOfRange(Wrong):
    """A subscript, an axis or the number of a literal is beyond the last one."""


class NotKnown(Wrong):
    """A value must be known when compiling and is not."""


class NotKnownSubscript(NotKnown):
    """A subscript that changes while it runs.

    Attributes
    ----------
    expression : the subscript, a node of the syntax tree
    length : of the axis
    """

    def __init__(self, wrong: NotKnown, expression: object, length: int) -> None:
        super().__init__()
        self.diagnostic, self.expression, self.length = wrong.diagnostic, expression, length


class Exhausted(Wrong):
    """A budget is spent: nothing more of the model is made."""


class CallsItself(Wrong):
    """A function calls itself within branches of which parameters decide which one is taken.

    Attributes
    ----------
    level : how many such branches stood around where it was called before
    """

    def __init__(self, level: int, message: str, span: Span):
        super().__init__("E0222", message, span)
        self.level = level


class TooDeep(Wrong):
    """A function calls itself without end."""


class NotOneGroup(Wrong):
    """The rows of a group go different ways."""


class NotAlike(NotOneGroup):
    """Something must be the same in all rows of a group and is not; a loop can then be unrolled."""

    def __init__(self, what: str, span: Span, **more):
        super().__init__("E0220", f"{what} differs between the elements of an array", span, **more)


class RowsDiffer(NotOneGroup):
    """An if-expression over iteration variables whose branches make sense in their own rows only.

    Attributes
    ----------
    expression : the if-expression in the syntax tree
    rows : for each of its branches, the flat positions of the rows that take it
    """

    def __init__(self, expression: object, rows: list[np.ndarray], wrong: Wrong):
        super().__init__()
        self.diagnostic = wrong.diagnostic
        self.expression = expression
        self.rows = rows


def check_size(elements: int, what: str, span: Span) -> None:
    """Refuse what no machine could hold, before anything is made of it."""
    if elements > MAX_ELEMENTS:
        limit = f"at most {MAX_ELEMENTS:,} elements".replace(",", " ")
        digits = str(elements)
        found = digits if len(digits) <= 15 else f"about 10^{len(digits) - 1}"
        raise Wrong("E0225", f"{what} is too large", span, expected=limit, found=found)
