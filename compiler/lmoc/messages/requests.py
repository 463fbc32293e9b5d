"""Which diagnostics are about what was asked for, and not about the model."""

from __future__ import annotations

from lmoc.messages.diagnostics import Area, Diagnostic

# states to prefer, signals, solver, times, what to keep: options whose mistakes are found later
_OPTIONS = frozenset({"E0414", "E0521", "E0540", "E0541", "E0542"})
# names of parameters that there are not or that are final, inputs without a signal or without its derivatives
_GIVEN = frozenset({"E0206", "E0210", "E0520", "E0522"})


def is_of_the_command(d: Diagnostic) -> bool:
    """Return whether it is about files, options and the choice of the model."""
    return d.area is Area.COMMAND or d.code in _OPTIONS


def is_of_the_request(d: Diagnostic) -> bool:
    """Return whether it is about names and options, so that no run with other values can be made either."""
    return is_of_the_command(d) or d.code in _GIVEN
