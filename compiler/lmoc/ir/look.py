"""The look of a part in a picture, from the annotations of its class."""

from __future__ import annotations

from lmoc.support.records import dataclass

# What `annotation(__lmoc(symbol = "…"))` may name; `lmoc.view` draws them.
SYMBOLS = frozenset(
    """
    wall mass spring damper spring-damper rod string elastic-string stop friction pulley beam moving-frame force motion
    fixed-shaft inertia disk turning-bar torsion-spring torsion-damper gear gear-pair planetary-gear torque rotation
    bearing-friction clutch brake ratchet backlash drum wheel arm lever
    pendulum rack screw cam unbalance belt chain worm differential
    ground anchor particle body bar link point pin slider weld guide rolling-wheel contact edge-contact disk-contact
    track disk-track none box
    """.split()
)


@dataclass(frozen=True)
class Condition:
    """When a primitive is seen: where a parameter of the part holds, or "not", "and" or "or" of other conditions."""

    operator: str  # the parameter's name where there are no sides
    sides: tuple[Condition, ...] = ()


@dataclass(frozen=True)
class Drawn:
    """One primitive of an `Icon` (Modelica specification, 18.6.5).

    Attributes
    ----------
    kind : "line", "polygon", "ellipse" or "text"; a rectangle is a polygon
    points : in the icon's own coordinates, scaled to -1 … 1, y upwards; of an ellipse and a text two opposite corners
    text : of a text; ``%name`` stands for the part's name
    filled : an area that is painted
    colour : of the line or the text, "#rrggbb"; "none" for no line, "" for that of the picture
    paint : colour of the area, likewise
    dashed : the line is
    visible : a condition in parameters of the part; always without one
    """

    kind: str
    points: tuple[tuple[float, float], ...]
    text: str = ""
    filled: bool = False
    colour: str = ""
    paint: str = ""
    dashed: bool = False
    visible: Condition | None = None


@dataclass(frozen=True)
class Look:
    """A symbol by its name, or a drawing of the user's own, which comes first where there are both."""

    symbol: str = ""
    drawing: tuple[Drawn, ...] = ()


PLAIN = Look()
