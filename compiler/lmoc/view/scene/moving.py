"""A picture at other instants of a run, a strip of several, and a film."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from math import ceil, hypot, isfinite, sqrt
from pathlib import Path
from typing import Protocol

import numpy as np

from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.view.scene import symbols
from lmoc.view.scene.block import corners_of, shifted, united
from lmoc.view.scene.picture import Anchor, Item, Move, Picture, Turn

GAP = 26.0  # px between two frames
MARGIN = 12.0
LABEL = 24.0  # px below a frame, for its instant
RATIO = 1.4  # width to height of a strip, as near as whole rows allow
MOST = 500  # frames of a strip
RATE = 12.5  # frames a second
SHORTEST, LONGEST = 2.0, 12.0  # s that a film takes
ONCE = ("label", "coordinate", "gravity", "dimension")  # in the first frame of a strip only


class Trajectory(Protocol):
    """The part of a run that is needed."""

    @property
    def time(self) -> np.ndarray:
        """(times,) the output times, s."""
        ...

    def __getitem__(self, name: str) -> np.ndarray:
        """The values of a variable at the output times."""
        ...


class Moving:
    """A picture that follows a run.

    Parameters
    ----------
    picture : as drawn, at rest
    run : one of its scene
    """

    def __init__(self, picture: Picture, run: Trajectory) -> None:
        self.picture, self.run = picture, run
        self._values: dict[str, np.ndarray] = {}
        self._scale = {group: self._scale_of(group) for group in {m.group for m in self._moves() if m.group}}

    def _moves(self) -> Iterator[Move]:
        for item in self.picture.items:
            for end in item.ends:
                yield from end.moves

    def _of(self, name: str) -> np.ndarray:
        if name not in self._values:
            self._values[name] = np.asarray(self.run[name], float)
        return self._values[name]

    def _change(self, name: str, reference: float | None, at: int) -> float:
        values = self._of(name)
        change = float(values[at] - (values[0] if reference is None else reference))
        return change if isfinite(change) else 0.0

    def _scale_of(self, group: str) -> float:
        """Pixels per unit: so that no move of a group goes further than there is room."""
        largest = 0.0
        for move in self._moves():
            if move.group == group:
                values = self._of(move.variable)
                off = np.abs(values - (values[0] if move.reference is None else move.reference))
                largest = max(largest, float(np.nanmax(off, initial=0.0)))
        return self.picture.room.get(group, 0.0) / largest if largest > 0 else 0.0

    def at(self, index: int) -> tuple[Item, ...]:
        """Return the items at one output time, which then do not move any more."""

        def change(move: Move) -> float:
            scale = self._scale[move.group] if move.group else 1.0
            return scale * self._change(move.variable, move.reference, index)

        return tuple(self._frozen(item, change, index) for item in self.picture.items)

    def _frozen(self, item: Item, change: Callable[[Move], float], index: int) -> Item:
        ends = tuple(Anchor(*end.at(change)) for end in item.ends)
        turn = item.turn
        if turn.variable:
            turn = Turn(turn.at(self._change(turn.variable, turn.reference, index)))
        return replace(item, ends=ends, turn=turn, slack=self._slack(item, index))

    def _slack(self, item: Item, index: int) -> float:
        """By how much a string of the plane is longer than the way between its ends, px."""
        moves = [m for end in item.ends for m in end.moves if not m.group]
        name = item.variables.get("slack") or item.variables.get("stretch")
        if not name or not moves:
            return item.slack if len(item.ends) == 2 and not moves else 0.0
        value = float(self._of(name)[index]) * (1.0 if "slack" in item.variables else -1.0)
        return max(0.0, value) * max(hypot(m.dx, m.dy) for m in moves) if isfinite(value) else 0.0


def instants(run: Trajectory, count: int) -> list[int]:
    """Return the indices of output times, evenly spaced from the first to the last."""
    time = np.asarray(run.time)
    asked = np.linspace(time[0], time[-1], max(count, 1))
    return [int(np.argmin(np.abs(time - t))) for t in asked]


def strip(picture: Picture, run: Trajectory, count: int) -> Picture:
    """Return one picture of several instants, in rows from left to right."""
    moving = Moving(picture, run)
    chosen = instants(run, count)
    frames = [moving.at(k) for k in chosen]
    left, top, right, bottom = united(corners_of(items) for items in frames)
    wide, high = right - left + GAP, bottom - top + GAP + LABEL
    columns = min(count, max(1, round(sqrt(count * RATIO * high / wide))))
    rows = ceil(count / columns)
    items: list[Item] = []
    for n, (k, own) in enumerate(zip(chosen, frames, strict=True)):
        x, y = (n % columns) * wide + MARGIN - left, (n // columns) * high + MARGIN - top
        items += [shifted(i, x, y) for i in own if n == 0 or i.symbol not in ONCE]
        at = Anchor(x + (left + right) / 2, y + bottom + LABEL / 2 + 2)
        items.append(symbols.label(f"t = {run.time[k]:.4g} s", at, colour="muted"))
    width, height = columns * wide - GAP + 2 * MARGIN, rows * high - GAP + 2 * MARGIN
    return Picture(picture.title, width, height, tuple(items), {}, picture.notes)


def film(picture: Picture, run: Trajectory, path: Path) -> Path:
    """Write a film of a run: .gif or .mp4.

    Raises
    ------
    ModelError
        E0623: there is no ffmpeg, or it does not write the file.
    """
    program = ffmpeg(path)
    length = min(LONGEST, max(SHORTEST, float(run.time[-1] - run.time[0])))
    moving = Moving(picture, run)
    chosen = instants(run, round(RATE * length))
    boxes = [corners_of(moving.at(k)) for k in chosen]
    left, top, right, bottom = united(boxes)
    size = right - left + 2 * MARGIN, bottom - top + 2 * MARGIN
    frames = (_painted(moving.at(k), (MARGIN - left, MARGIN - top), size, picture.title) for k in chosen)
    return _written(program, frames, path)


def ffmpeg(path: Path) -> str:
    """Return the program that writes films; E0623 where there is none."""
    from shutil import which

    program = which("ffmpeg")
    if program is None:
        hint = "install ffmpeg, or draw a strip: lmoc draw FILE --frames 8 -o strip.svg"
        message = f"'{path}' cannot be written: the program ffmpeg, which writes films, is not installed"
        raise ModelError([Diagnostic("E0623", message, hint=hint)])
    return program


def _painted(items: Sequence[Item], shift: tuple[float, float], size: tuple[float, float], title: str) -> bytes:
    from io import BytesIO

    from lmoc.view.scene.figure import figure

    content = BytesIO()
    moved = tuple(shifted(i, *shift) for i in items)
    figure(Picture(title, *size, moved)).savefig(content, format="png", facecolor="white")
    return content.getvalue()


def _written(program: str, frames: Iterator[bytes], path: Path) -> Path:
    import subprocess

    even = "crop=trunc(iw/2)*2:trunc(ih/2)*2"  # which mp4 asks for
    filters = ["-vf", f"{even},split[a][b];[a]palettegen[p];[b][p]paletteuse"]
    if path.suffix.lower() == ".mp4":
        filters = ["-vf", even, "-pix_fmt", "yuv420p"]
    command = [program, "-y", "-loglevel", "error", "-f", "image2pipe", "-framerate", f"{RATE:g}", "-i", "-"]
    command += [*filters, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        try:
            for frame in frames:
                process.stdin.write(frame)
        except BrokenPipeError:
            pass  # it has ended, and says why
        reason = process.communicate()[1].decode(errors="replace").strip()
    if process.returncode:
        raise ModelError([Diagnostic("E0623", f"'{path}' cannot be written: {reason or 'ffmpeg has failed'}")])
    return path
