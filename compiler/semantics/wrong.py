"""How a mistake leaves the place where it was found."""

from __future__ import annotations

from lmoc.diagnostics import Diagnostic, Report
from lmoc.source import Span


class Wrong(Exception):
    """Ends the work on one equation or declaration; its user reports it and goes on with the next.

    Without arguments it says nothing: what is wrong has been reported where it stands, and everything that
    depends on it is left out in silence.
    """

    def __init__(self, code: str = "", message: str = "", span: Span | None = None, **more):
        super().__init__(message)
        self.diagnostic = Diagnostic(code, message, span, **more) if code else None

    def put_into(self, report: Report) -> None:
        """Report it, unless the same has been said before."""
        if self.diagnostic is not None and self.diagnostic not in report.diagnostics:
            report.diagnostics.append(self.diagnostic)
