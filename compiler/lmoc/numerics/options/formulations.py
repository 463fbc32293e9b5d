"""The formulations of closed loops: what each integrates, and with which solvers."""

from __future__ import annotations

import math

from lmoc.messages.diagnostics import ModelError
from lmoc.support.records import dataclass

GAIN = 10.0  # 1/s, of Baumgarte's stabilization

# methods of one step: the state may be moved between two of them without loss
ONE_STEP = ("auto", "dop853", "taylor", "radau", "gauss", "rk4", "midpoint")
_IMPLICIT = ("auto", "ida")
STEPPED_IN_C = ("auto", "dop853", "taylor")  # of these, those for which projection costs little


class NotFormulatedError(ModelError):
    """A scene cannot be run in a formulation (E0626)."""


@dataclass(frozen=True)
class Formulation:
    """The properties of a formulation; the rows of the table in the documentation.

    Attributes
    ----------
    text : for people, in half a line
    solvers : those that can be used; empty for all
    implicit : the closures themselves are equations of the solver
    most_steps : steps after which a run is given up
    """

    name: str
    text: str
    solvers: tuple[str, ...] = ()
    implicit: bool = False
    most_steps: int = 5_000_000

    def goes_with(self, solver: str) -> bool:
        """Return whether it can be integrated by a solver."""
        return not self.solvers or solver in self.solvers


_ALL = (
    Formulation("auto", "reduced; where the coordinates change often, projected from then on"),
    Formulation("reduced", "minimal coordinates, changed along the motion where others are better"),
    Formulation("projected", "all coordinates of the loops, projected onto the closures after each step", ONE_STEP),
    Formulation("index1", "all coordinates of the loops, closures differentiated twice: they drift"),
    Formulation("baumgarte", "as index1, with feedback of the closures: baumgarte:GAIN, in 1/s"),
    Formulation("ggl", "closures and their derivatives as equations (Gear, Gupta, Leimkuhler)", _IMPLICIT, True),
    Formulation("index3", "closures as equations, not differentiated: to show how that fails", _IMPLICIT, True, 5_000),
)
TABLE = {form.name: form for form in _ALL}


@dataclass(frozen=True)
class Requested:
    """A formulation as a user asks for it.

    Attributes
    ----------
    gain : 1/s, of the feedback; 0 without any
    """

    form: Formulation
    gain: float = 0.0


def requested(text: str) -> Requested | None:
    """Return the formulation of a name, as in ``ggl`` or ``baumgarte:25``; None where there is none of that name."""
    name, colon, number = text.partition(":")
    form = TABLE.get(name)
    if form is None or (colon and name != "baumgarte"):
        return None
    if name != "baumgarte":
        return Requested(form)
    try:
        gain = float(number) if colon else GAIN
    except ValueError:
        return None
    return Requested(form, gain) if math.isfinite(gain) and gain > 0 else None
