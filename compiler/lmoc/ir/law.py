"""Set-valued laws: each ties a force to a gap or a velocity, and leaves open which side of the law holds.

Force and motion are conjugate: ``force · d(gap)/dt`` (or ``force · velocity``) is the power that the law delivers to
the scene. The matrix that ties them (Delassus) is then symmetric and positive semidefinite, whatever gears, levers and
pulleys stand between; see F. Pfeiffer and C. Glocker, Multibody Dynamics with Unilateral Contacts (1996), chapters 5
and 8.

A group of laws is like a group of equations: one row an instance, integers only. It adds no equation to the flat model;
`lmoc.ir.mode.with_mode` adds the one that holds in a mode.
"""

from __future__ import annotations

from enum import Enum

import numpy as np

from lmoc.messages.source import Span
from lmoc.support.records import dataclass


class LawKind(Enum):
    """The four laws.

    ``UNILATERAL`` and ``ONE_WAY`` are complementarities, open with ``force = 0`` and closed with ``motion = 0``.
    ``DRY_FRICTION`` and ``CONTACT_FRICTION`` are open while they slip and closed while they stick.
    """

    UNILATERAL = "unilateral"  # 0 ≤ force ⟂ gap ≥ 0
    ONE_WAY = "one-way"  # 0 ≤ force ⟂ velocity ≥ 0
    DRY_FRICTION = "dry friction"  # force ∈ -limit·Sgn(velocity), bounded: carries no impulse
    CONTACT_FRICTION = "contact friction"  # the limit is mu·normal, the force of a unilateral law: carries impulses


NONE = -1  # in place of a variable that a law does not have
JENKINS = -1  # in place of a relative degree: the velocity feels the rate of the force, for there are springs alone
COMPLEMENTARY = frozenset({LawKind.UNILATERAL, LawKind.ONE_WAY})


@dataclass(frozen=True, eq=False)
class Laws:
    """Laws of one kind that one call in the text gives, one a row.

    Attributes
    ----------
    kind : LawKind
    force : (n,) variables; unknown, ≥ 0 in complementarities
    motion : (n,) variables; the gap of a unilateral law (≥ 0), else the velocity (≥ 0 of a one-way law)
    restitution : (n,) variables known before the run, 0 … 1; of unilateral laws
    slip, stick : (n,) variables of any kind; the limits of dry friction while slipping and while sticking, taken as 0
        where they are negative
    friction, normal : (n,) variables; coefficient and normal force of contact friction
    direction : (n,) discrete variables with values -1 and 1: the sign of the slipping velocity, of both frictions
    closing, opening : names of the events, such as taut and slack
    part : index into `FlatDAE.parts`
    span : the call
    """

    kind: LawKind
    force: np.ndarray
    motion: np.ndarray
    closing: str
    opening: str
    part: int
    span: Span | None
    restitution: np.ndarray | None = None
    slip: np.ndarray | None = None
    stick: np.ndarray | None = None
    friction: np.ndarray | None = None
    normal: np.ndarray | None = None
    direction: np.ndarray | None = None

    @property
    def rows(self) -> int:
        return len(self.force)

    @property
    def level(self) -> int:
        """The derivative of the motion that a closed law keeps at zero first: 0 of a gap, 1 of a velocity."""
        return 0 if self.kind is LawKind.UNILATERAL else 1

    def column(self, name: str) -> np.ndarray:
        """The column of a name, which laws of this kind have: ValueError where they have none."""
        column: np.ndarray | None = getattr(self, name)
        if column is None:
            raise ValueError(f"laws of {self.kind.value} have no {name}")
        return column

    def columns(self) -> dict[str, np.ndarray]:
        """All columns by their names."""
        names = ("force", "motion", "restitution", "slip", "stick", "friction", "normal", "direction")
        return {name: column for name in names if (column := getattr(self, name)) is not None}


@dataclass(frozen=True, eq=False)
class Switched:
    """The places of the laws in the switched form of a flat model (`structure.laws.switched`), an entry for each law.

    Attributes
    ----------
    laws : the laws of the flat model
    force, rate : variables; the rate of a gap (NONE where the degree is 0), or the velocity of the law
    gap : variables; NONE for laws between a force and a velocity
    level : variables y
    closed, push, direction : variables, inputs; direction is NONE for complementarities
    degree : how often the position behind the motion is differentiated in y: 0, 1 or 2; or JENKINS
    """

    laws: tuple[Laws, ...]
    force: np.ndarray
    gap: np.ndarray
    rate: np.ndarray
    level: np.ndarray
    closed: np.ndarray
    push: np.ndarray
    direction: np.ndarray
    degree: np.ndarray

    @property
    def count(self) -> int:
        return len(self.force)

    @property
    def modes(self) -> np.ndarray:
        """Variables that say in which mode each law is."""
        return np.concatenate([self.closed, self.push, self.direction[self.direction != NONE]])


def law_count(laws: tuple[Laws, ...]) -> int:
    """Number of laws in several groups."""
    return sum(group.rows for group in laws)
