"""Pictures of linear models: frequency response, step response, and the modes with their eigenvalues."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lmoc.report.plots import COLOURS, GREY, finished, literal, stacked
from lmoc.report.powers import label_powers
from lmoc.report.units import ratio
from lmoc.symbolic.styles import unit_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from lmoc.symbolic.transfer import TransferFunction

ON_AXIS = 1e-7  # |Re|/|root| below which a root counts as one of no damping
SHARP = 0.01  # relative distance from an undamped root within which the amplitude may leave the picture
PERIODS = 10  # of the slowest oscillation in a step response that does not decay
MOST_PERIODS = 40  # and in one that does
MOST_TIMES = 20_000
MOST_PEAKS = 8  # that are named


def frequency_range(tf: TransferFunction) -> tuple[float, float]:
    """Angular frequencies in rad/s from a decade below the slowest to a decade above the fastest pole or zero."""
    corners = np.abs(np.concatenate([tf.poles, tf.zeros]))
    corners = corners[corners > 1e-9]
    if not len(corners):
        return 0.01, 100.0
    return float(corners.min()) / 10, float(corners.max()) * 10


def phase(tf: TransferFunction, omega: np.ndarray) -> np.ndarray:
    """Phase in degrees, continuous: the sum of what each pole and zero turns.

    Undamped ones are taken as the limit of weak damping, which `numpy.unwrap` could not know: a resonance turns by
    −180°, an antiresonance by +180°.
    """
    top, _ = tf.coefficients
    gain = top[np.flatnonzero(top)[0]] if np.any(top) else 1.0
    turned = sum((_turn(r, omega) for r in tf.zeros), np.zeros(len(omega)))
    turned = turned - sum((_turn(r, omega) for r in tf.poles), np.zeros(len(omega)))
    if gain < 0:
        return min(turned + 180.0, turned - 180.0, key=lambda p: abs(p.mean()))
    return turned


def _turn(root: complex, omega: np.ndarray) -> np.ndarray:
    if abs(root.real) <= ON_AXIS * abs(root):
        return np.where(omega < root.imag, -90.0, 90.0)
    return np.degrees(np.angle(1j * omega - root))


def bode(
    tf: TransferFunction,
    path: str | Path | None = None,
    title: str = "",
    units: tuple = ("", ""),
    hertz: bool = False,
    decibels: bool = False,
) -> Figure:
    """Draw amplitude and phase over the angular frequency, the peaks of the amplitude marked.

    Parameters
    ----------
    path : where to write the picture, if anywhere
    title : name of the scene
    units : of input and output
    hertz : over the frequency in Hz
    decibels : the amplitude in dB, 20·log10 of its number in SI units

    Raises
    ------
    ModelError
        E0623, E0624: the picture cannot be written; E0660: a parameter has no value.
    """
    low, high = frequency_range(tf)
    roots = np.concatenate([tf.poles, tf.zeros]).astype(complex)
    undamped = np.abs(roots.real) <= ON_AXIS * np.abs(roots)
    special = np.abs(roots.imag[~undamped])
    edges = np.abs(roots.imag[undamped & (roots.imag != 0)])
    close = (edges[:, None] * (1 + np.geomspace(1e-6, 0.1, 40)[None, :] * np.array([[[-1]], [[1]]]))).ravel()
    omega = np.concatenate([np.geomspace(low, high, 1200), special, close])
    omega = np.unique(omega[(omega >= low) & (omega <= high)])
    size = np.abs(tf.response(omega))
    figure, (upper, lower) = stacked(2, path, _heading(tf, title))
    across = omega / (2 * np.pi) if hertz else omega
    unit = ratio(units[1], units[0])
    if np.any(size > 0):
        limits = _amplitudes(omega, size, edges)
        shown = np.where(size > 0, size, np.nan)
        if decibels:
            upper.semilogx(across, _decibels(shown), color=COLOURS[0])
            upper.set_ylim(*_decibels(np.array(limits)))
        else:
            upper.loglog(across, shown, color=COLOURS[0])
            upper.set_ylim(*limits)
        _mark_peaks(upper, across, size, limits[1], decibels, "Hz" if hertz else "rad/s")
    quantity = _label(f"amplitude {tf.output}/{tf.input}", "" if decibels else unit)
    of_unit = f" of 1 {unit}" if unit not in ("", "1") else ""
    upper.set_ylabel(literal(f"{quantity} in dB{of_unit}" if decibels else quantity))
    turned = phase(tf, omega)
    lower.semilogx(across, turned, color=COLOURS[0])
    label_powers(upper, lower)
    lower.set_ylabel("phase in degrees")
    lower.set_xlabel("frequency in Hz" if hertz else "angular frequency in rad/s")
    ticks = np.arange(90 * np.floor(turned.min() / 90 + 1e-9), turned.max() + 90, 90)
    lower.set_yticks(ticks)
    lower.set_ylim(ticks[0] - 20, ticks[-1] + 20)
    return finished(figure, path)


def peaks(size: np.ndarray) -> np.ndarray:
    """Return where an amplitude has its local maxima, the ends left out."""
    inner = size[1:-1]
    return 1 + np.flatnonzero((inner > size[:-2]) & (inner >= size[2:]))


def _mark_peaks(axis: Axes, across: np.ndarray, size: np.ndarray, top: float, decibels: bool, unit: str) -> None:
    """Mark the peaks with their frequencies; one that leaves the picture at its edge."""
    for k in peaks(size)[:MOST_PEAKS].tolist():
        height = min(float(size[k]), top)
        place = float(across[k]), float(_decibels(np.array(height))) if decibels else height
        axis.plot(*place, "o", color=COLOURS[1], markersize=4)
        beside = {"textcoords": "offset points", "xytext": (6, -4), "va": "top", "fontsize": 8, "color": GREY}
        axis.annotate(f"{across[k]:.4g} {unit}", place, **beside)


def _decibels(size: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return 20 * np.log10(size)


def _amplitudes(omega: np.ndarray, size: np.ndarray, undamped: np.ndarray) -> tuple[float, float]:
    """Limits of the amplitude, without the peaks that have no end."""
    near = (np.abs(omega[:, None] - undamped[None, :]) < SHARP * undamped[None, :]).any(axis=1)
    seen = size[~near & (size > 0)]
    low, high = float(seen.min()), float(seen.max())
    room = max((high / low) ** 0.05, 1.5)
    return low / room, high * room


def step(tf: TransferFunction, path: str | Path | None = None, title: str = "", units: tuple = ("", "")) -> Figure:
    """Response to a unit step of the input; parameters as in `bode`.

    Raises
    ------
    ModelError
        E0623, E0624: the picture cannot be written; E0660: the output contains a derivative of the input, or a
        parameter has no value.
    """
    from scipy.signal import StateSpace, tf2ss
    from scipy.signal import step as response

    from lmoc.symbolic.system import refuse

    top, bottom = tf.coefficients
    if len(top) > len(bottom):
        raise refuse(f"'{tf.output}' contains a derivative of '{tf.input}': its step response is not finite")
    time = np.linspace(0.0, *_times(tf.poles))
    if len(bottom) > 1:
        time, value = response(StateSpace(*tf2ss(top, bottom)), T=time)
    else:
        value = np.full(len(time), top[0] / bottom[0])
    by = f"{tf.input} steps by 1 {unit_text(units[0])}".rstrip()
    figure, (axis,) = stacked(1, path, f"{title}: {by}" if title else by)
    axis.plot(time, value, color=COLOURS[0])
    if len(tf.poles) and np.all(tf.poles.real < 0):
        axis.axhline(tf.gain, color=GREY, linewidth=0.8, linestyle="--", zorder=0.5)
    axis.margins(x=0)
    axis.set_xlabel("time in s")
    axis.set_ylabel(_label(tf.output, unit_text(units[1])))
    return finished(figure, path)


def _times(poles: np.ndarray) -> tuple[float, int]:
    """Return duration and number of times: until the slowest mode decays, or some periods of a lightly damped one."""
    decay = -poles.real[poles.real < -ON_AXIS * np.abs(poles)]
    turning = np.abs(poles.imag[np.abs(poles.imag) > ON_AXIS * np.abs(poles)])
    longest = [6.0 / decay.min()] if len(decay) else []
    longest += [(MOST_PERIODS if len(decay) else PERIODS) * 2 * np.pi / turning.min()] if len(turning) else []
    growing = poles.real[poles.real > ON_AXIS * np.abs(poles)]
    longest += [6.0 / growing.max()] if len(growing) else []
    duration = float(min(longest)) if longest else 10.0
    fastest = float(turning.max(initial=0.0))
    return duration, int(min(MOST_TIMES, 1001 + 20 * duration * fastest / (2 * np.pi)))


def _heading(tf: TransferFunction, title: str) -> str:
    return f"{title}: from {tf.input} to {tf.output}" if title else f"from {tf.input} to {tf.output}"


def _label(quantity: str, unit: str) -> str:
    return literal(f"{quantity} in {unit}" if unit and unit != "1" else quantity)
