"""Pictures of a run without the time as abscissa: phase portraits and amplitude spectra."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.names import names_of
from lmoc.report.plots import COLOURS, choose, finished, literal, stacked, write
from lmoc.report.result import Result
from lmoc.symbolic.styles import unit_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_CURVES = 6
SHOWN = 1e-3  # of the largest amplitude: up to the last frequency that reaches it a spectrum is drawn


def phase_portrait(run: Result, x: str | None = None, y: str | None = None, path: str | Path | None = None) -> Figure:
    """Draw one variable over another, the start marked by a circle.

    Parameters
    ----------
    x, y : names; by default the first two states
    path : where to write the picture, if anywhere

    Raises
    ------
    ModelError
        E0623, E0624: it cannot be written.
    ValueError
        Not both are given, and the run has no two states.
    """
    names = [name for name in (x, y) if name is not None]
    names += [name for name in run.states if name not in names][: 2 - len(names)]
    if len(names) < 2:
        raise ValueError("a phase portrait shows two variables: this run has no two states, so name both")
    fine = run.fine
    figure, (axis,) = stacked(1, path, run.flat.description or run.flat.name)
    figure.set_size_inches(6, 5)
    axis.plot(fine[names[0]], fine[names[1]], color=COLOURS[0])
    axis.plot(fine[names[0]][0], fine[names[1]][0], "o", color=COLOURS[1], markersize=5)
    for label, name in zip((axis.set_xlabel, axis.set_ylabel), names, strict=True):
        label(_with_unit(run, name))
    if path is not None:
        write(figure, Path(path))
    return figure


def amplitude_spectrum(times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies in Hz and the amplitudes of a signal without its mean.

    By the fast Fourier transform of evenly spread values with a Hann window, scaled so that a sine of amplitude 1 whose
    periods fit the record has a peak of 1 (Heinzel, Rüdiger and Schilling, Spectrum and spectral density estimation by
    the DFT, 2002, section 8).

    Parameters
    ----------
    times : (k,) s, increasing; values : (k,)
    """
    even = np.linspace(times[0], times[-1], len(times))
    signal = np.interp(even, times, values)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(len(even)) / len(even))
    spectrum = np.fft.rfft((signal - signal.mean()) * window)
    step = (even[-1] - even[0]) / (len(even) - 1)
    return np.fft.rfftfreq(len(even), step), 2 * np.abs(spectrum) / window.sum()


def spectrum(run: Result, names: str | Sequence[str] | None = None, path: str | Path | None = None) -> Figure:
    """Draw the amplitudes of variables over the frequency, each in a panel.

    Parameters
    ----------
    names : by default the outputs or the states
    path : where to write the picture, if anywhere

    Raises
    ------
    ModelError
        E0623, E0624: it cannot be written.
    """
    shown = list(choose(run) if names is None else names_of(names))[: MOST_CURVES if names is None else None]
    fine = run.fine
    figure, axes = stacked(len(shown), path, f"{run.flat.description or run.flat.name}: amplitudes")
    last = 0.0
    for axis, name in zip(axes, shown, strict=True):
        frequency, amplitude = amplitude_spectrum(fine.time, fine[name])
        axis.plot(frequency, amplitude, color=COLOURS[0])
        axis.set_ylabel(_with_unit(run, name))
        seen = np.flatnonzero(amplitude > SHOWN * amplitude.max(initial=0.0))
        last = max(last, float(frequency[seen[-1]]) if len(seen) else 0.0)
    axes[-1].set_xlabel("frequency in Hz")
    finished(figure, None)
    if last > 0:
        axes[-1].set_xlim(0, 1.2 * last)
    if path is not None:
        write(figure, Path(path))
    return figure


def _with_unit(run: Result, name: str) -> str:
    unit = run.unit(name)
    return literal(f"{name} in {unit_text(unit)}" if unit else name)
