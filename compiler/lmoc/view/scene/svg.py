"""A picture as SVG text: safe whatever the names are, legible on dark and on light pages."""

from __future__ import annotations

from html import escape

from lmoc.view.scene.picture import Circle, Frame, Item, Label, Path, Picture
from lmoc.view.scene.text import LOWERED, RAISED, SMALL, runs

FAMILY = "DejaVu Sans, Verdana, Helvetica, sans-serif"
STYLE = """
.lmoc{color:#1b1b1b}.lmoc .paper{fill:#fff}
.lmoc .ink{stroke:currentColor}.lmoc .muted{stroke:#888}.lmoc .force{stroke:#c2410c}.lmoc .string{stroke:#8a6d3b}
.lmoc .accent{stroke:#0072b2}.lmoc path,.lmoc circle{fill:none;stroke-linecap:round;stroke-linejoin:round}
.lmoc .body{fill:#5b8dbf;fill-opacity:.28}.lmoc .ground{fill:#888;fill-opacity:.35}
.lmoc .f-ink{fill:currentColor}.lmoc .f-force{fill:#c2410c}.lmoc .f-accent{fill:#0072b2}.lmoc .f-muted{fill:#888}
.lmoc text{fill:currentColor}.lmoc text.force{fill:#c2410c;stroke:none}.lmoc text.muted{fill:#888;stroke:none}
.lmoc text.ink,.lmoc text.accent{stroke:none}
@media(prefers-color-scheme:dark){.lmoc{color:#e6e6e6}.lmoc .paper{fill:#16181d}.lmoc .force{stroke:#fb923c}
.lmoc .f-force,.lmoc text.force{fill:#fb923c}.lmoc .string{stroke:#d6b370}.lmoc .body{fill:#7fb2e5;fill-opacity:.3}}
""".replace("\n", "")


def svg(picture: Picture, width: float | None = None) -> str:
    """Return a picture as the text of an SVG file.

    Parameters
    ----------
    width : px, to which the picture is scaled; its own by default
    """
    w, h = picture.width, picture.height
    shown = w if width is None else width
    title = escape(picture.title)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" class="lmoc" width="{_n(shown)}" height="{_n(h * shown / w)}" '
        f'viewBox="0 0 {_n(w)} {_n(h)}" role="img" aria-label="{title}" font-family="{FAMILY}">',
        f"<title>{title}</title>",
        f"<style>{STYLE}</style>",
    ]
    for item in picture.items:
        lines.append(item_svg(item))
    lines.append("</svg>")
    return "\n".join(lines) + "\n"


def item_svg(item: Item) -> str:
    """Return an item as a group, with the name of its part as a tool tip."""
    frame = item.frame()
    named = f' data-part="{escape(item.part)}"' if item.part else ""
    tip = f"<title>{escape(item.part)}</title>" if item.part else ""
    shapes = "".join(_shape(s, frame) for s in item.drawn)
    return f'<g class="{escape(item.symbol)}"{named}>{tip}{shapes}</g>'


def _shape(shape: Path | Circle | Label, frame: Frame) -> str:
    if isinstance(shape, Label):
        return _text(shape, frame)
    dash = f' stroke-dasharray="{" ".join(_n(d) for d in shape.dash)}"' if shape.dash else ""
    style = f'{_colours(shape)} stroke-width="{_n(shape.width)}"{dash}'
    if isinstance(shape, Circle):
        x, y = frame.place(shape.centre)
        return f'<circle cx="{_n(x)}" cy="{_n(y)}" r="{_n(shape.radius)}" {style}/>'
    points = [frame.place(v) for v in shape.vertices]
    data = "M" + "L".join(f"{_n(x)} {_n(y)}" for x, y in points) + ("Z" if shape.closed else "")
    return f'<path d="{data}" {style}/>'


def _colours(shape: Path | Circle) -> str:
    """The colours of the picture as classes, those that a user has given as they are."""
    named = [c for c in (shape.colour,) if not _is_given(c)]
    if shape.fill and not _is_given(shape.fill):
        named.append(f"f-{shape.colour}" if shape.fill == "ink" else shape.fill)
    given = [f"stroke:{shape.colour}"] if _is_given(shape.colour) else []
    given += [f"fill:{shape.fill}"] if _is_given(shape.fill) else []
    style = f' style="{";".join(given)}"' if given else ""
    return f'class="{" ".join(named)}"{style}'


def _is_given(colour: str) -> bool:
    return colour.startswith("#") or colour == "none"


def _text(label: Label, frame: Frame) -> str:
    x, y = frame.place(label.at)
    base = y + 0.35 * label.size  # the middle of its height stands at y
    pieces, off = [], 0.0
    for piece, level in runs(label.text):
        shift = (LOWERED if level < 0 else RAISED if level > 0 else 0.0) * label.size
        dy = f' dy="{_n(shift - off)}"' if shift != off else ""
        size = f' font-size="{_n(SMALL * label.size)}"' if level else ""
        pieces.append(f"<tspan{dy}{size}>{escape(piece)}</tspan>" if dy or size else escape(piece))
        off = shift
    anchor = "" if label.anchor == "start" else f' text-anchor="{label.anchor}"'
    colour = f'style="fill:{label.colour}"' if _is_given(label.colour) else f'class="{label.colour}"'
    return (
        f'<text x="{_n(x)}" y="{_n(base)}" font-size="{_n(label.size)}"{anchor} {colour}>'
        f"{''.join(pieces)}</text>"
    )


def _n(value: float) -> str:
    """A number as short as a picture needs it."""
    text = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
