"""Pictures of a transfer function: frequency response and step response."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lmoc.report.files import PICTURES, check_target
from lmoc.report.plots import COLOURS, STYLE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lmoc.symbolic.transfer import TransferFunction


def frequency_range(tf: TransferFunction) -> tuple[float, float]:
    """Angular frequencies in rad/s from a decade below the slowest to a decade above the fastest pole or zero."""
    corners = np.abs(np.concatenate([tf.poles, tf.zeros]))
    corners = corners[corners > 1e-9]
    if not len(corners):
        return 0.01, 100.0
    return float(corners.min()) / 10, float(corners.max()) * 10


def bode(tf: TransferFunction, path: str | Path | None = None) -> Figure:
    """Amplitude and phase over the angular frequency.

    Raises
    ------
    ModelError
        E0623, E0624: the picture cannot be written.
    """
    low, high = frequency_range(tf)
    special = np.abs(np.concatenate([tf.poles, tf.zeros]).imag)
    omega = np.unique(np.concatenate([np.geomspace(low, high, 1200), special[(special > low) & (special < high)]]))
    with np.errstate(divide="ignore", invalid="ignore"):
        response = tf.response(omega)
    figure, (upper, lower) = _figure(2, path)
    upper.loglog(omega, np.abs(response), color=COLOURS[0])
    upper.set_ylabel(f"|{tf.output}/{tf.input}|")
    finite = np.isfinite(response)
    phase = np.degrees(np.unwrap(np.angle(response[finite])))
    lower.semilogx(omega[finite], phase, color=COLOURS[0])
    lower.set_ylabel("phase in degrees")
    lower.set_xlabel("angular frequency in rad/s")
    lower.set_yticks(np.arange(90 * np.floor(phase.min() / 90), phase.max() + 91, 90))
    return _written(figure, path)


def step(tf: TransferFunction, path: str | Path | None = None) -> Figure:
    """Response to a unit step of the input.

    Raises
    ------
    ModelError
        E0623, E0624: the picture cannot be written; E0660: the output contains a derivative of the input.
    """
    from scipy.signal import step as response

    from lmoc.symbolic.system import refuse

    top, bottom = tf.coefficients
    if len(top) > len(bottom):
        raise refuse(f"'{tf.output}' contains a derivative of '{tf.input}': its step response is not finite")
    time = np.linspace(0.0, _duration(tf.poles), 1001)
    time, value = response((top, bottom), T=time)
    figure, (axis,) = _figure(1, path)
    axis.plot(time, value, color=COLOURS[0])
    axis.set_xlabel("time in s")
    axis.set_ylabel(f"{tf.output} for a unit step of {tf.input}")
    return _written(figure, path)


def _duration(poles: np.ndarray) -> float:
    """Long enough for the slowest decay, or for some periods of what does not decay."""
    decay = -poles.real[poles.real < -1e-9]
    turning = np.abs(poles.imag[np.abs(poles.imag) > 1e-9])
    longest = [6.0 / decay.min()] if len(decay) else []
    longest += [12 * np.pi / turning.min()] if len(turning) else []
    return float(min(longest)) if longest else 10.0


def _figure(panels: int, path: str | Path | None):
    if path is not None:
        check_target(Path(path), PICTURES)
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(8, 1.4 + 2.2 * panels), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(panels, 1, sharex=True, squeeze=False)[:, 0]
    return figure, tuple(axes)


def _written(figure: Figure, path: str | Path | None) -> Figure:
    if path is not None:
        figure.savefig(path)
    return figure
