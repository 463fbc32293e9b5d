"""A drawn scene, as a user holds it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from pathlib import Path

from lmoc.ir.prepared import Prepared
from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.report.files import PICTURES, check_target
from lmoc.report.result import Result
from lmoc.support.records import dataclass
from lmoc.support.replacing import replace_file
from lmoc.view.scene.picture import Picture
from lmoc.view.scene.svg import svg


@dataclass(frozen=True)
class Drawing:
    """A picture; shown in notebooks, written by `save`.

    Attributes
    ----------
    picture : what it shows, item by item
    """

    picture: Picture

    @cached_property
    def svg(self) -> str:
        """The text of the SVG file."""
        return svg(self.picture)

    def save(self, path: str | Path) -> Path:
        """Write the picture.

        Parameters
        ----------
        path : .svg, .png or .pdf

        Raises
        ------
        ModelError
            E0623, E0624: it cannot be written.
        """
        path = Path(path)
        check_target(path, PICTURES)
        content = self.svg.encode() if path.suffix.lower() == ".svg" else self._painted(path.suffix[1:].lower())
        try:
            replace_file(path, lambda target: target.write_bytes(content))
        except OSError as error:
            reason = error.strerror or error
            raise ModelError([Diagnostic("E0623", f"'{path}' cannot be written: {reason}")]) from None
        return path

    def _painted(self, ending: str) -> bytes:
        import warnings
        from io import BytesIO

        from lmoc.view.scene.figure import figure

        content = BytesIO()
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Glyph .* missing from font")  # the picture has boxes in their place
            figure(self.picture).savefig(content, format=ending)
        return content.getvalue()

    def _repr_svg_(self) -> str:
        return self.svg

    def __repr__(self) -> str:
        p = self.picture
        return f"<Drawing {p.title}: {len(p.items)} items, {p.width:.0f} by {p.height:.0f} px>"


def draw(
    prepared: Prepared,
    start: Callable[[], Callable[[str], float]],
    free_body: bool = False,
    run: Result | None = None,
    time: float | None = None,
    dimensions: bool = False,
    frames: int | None = None,
) -> Drawing:
    """Draw a scene.

    Parameters
    ----------
    start : gives the values of variables, by name, where a run starts; called where the scene is a mechanism
    free_body, run, time, dimensions, frames : as in `lmoc.DAE.draw`, with its errors
    """
    if not free_body and (time is not None or (run is not None) != (frames is not None)):
        raise TypeError("`run` and `time` belong to free-body diagrams, free_body=True, and `run` to `frames`")
    if free_body and (dimensions or frames is not None):
        raise TypeError("`dimensions` and `frames` belong to the picture of the scene, not to free-body diagrams")
    if run is None and time is not None:
        raise TypeError("`time` is an instant of a run: give `run` as well")
    if run is not None and run.flat.name != prepared.flat.name:
        raise ValueError(f"the run is one of {run.flat.name}, not of {prepared.flat.name}")
    if free_body:
        from lmoc.view.bodies.compose import free_body_picture

        return Drawing(free_body_picture(prepared, run, time, start))
    from lmoc.view.scene.compose import picture_of

    picture = picture_of(prepared.flat, prepared.values, start, dimensions)
    if frames is None or run is None:
        return Drawing(picture)
    from lmoc.view.scene.moving import MOST, strip

    if not 1 <= frames <= MOST:
        raise ValueError(f"a strip has 1 to {MOST} frames, not {frames}")
    return Drawing(strip(picture, run, frames))
