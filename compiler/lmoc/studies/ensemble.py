"""Many runs of one scene with other numbers: an ensemble.

Every run is what `DAE.simulate` makes of the same arguments, bit for bit, whatever threads or processes share the work.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lmoc.support.records import dataclass

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lmoc.numerics.observe.event import Event


class NotKeptError(KeyError):
    """A variable has not been kept of the runs of an ensemble."""

    def __init__(self, name: str, kept: Sequence[str], hint: str) -> None:
        super().__init__(name)
        self.text = f"'{name}' has not been kept: of these runs there are {', '.join(kept)}; {hint}"

    def __str__(self) -> str:
        return self.text


class _Ends(Mapping):
    """The last values of the runs: {name: (N,)}."""

    def __init__(self, last: Mapping[str, np.ndarray]) -> None:
        self._last = last

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._last:
            raise NotKeptError(name, list(self._last), f"keep=({name!r},)")
        return self._last[name]

    def __iter__(self):
        return iter(self._last)

    def __len__(self) -> int:
        return len(self._last)


@dataclass(frozen=True, eq=False, repr=False)
class Ensemble:
    """Many runs of one scene.

    Attributes
    ----------
    name : of the scene
    time : (T,) s
    given : {name: (N,) or (N, m)}, the parameters and start values that vary
    series : {name: (N, T) or (N, T, m)}; empty where only summaries were asked for
    end, minimum, maximum : {name: (N,) or (N, m)}; NaN in runs that failed before the end, `minimum` and `maximum` of
        what they have reached
    failed : (N,)
    reasons : (N,) why a run failed; empty where it did not
    events : (N,) records of each run
    units : {name: unit}, "" where none is known
    """

    name: str
    time: np.ndarray
    given: Mapping[str, np.ndarray]
    series: Mapping[str, np.ndarray]
    end: Mapping[str, np.ndarray]
    minimum: Mapping[str, np.ndarray]
    maximum: Mapping[str, np.ndarray]
    failed: np.ndarray
    reasons: tuple[str, ...]
    events: tuple[tuple[Event, ...], ...]
    units: Mapping[str, str]

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a kept variable over time in all runs, (N, T) or, for an array, (N, T, m); or values given, (N,).

        Raises
        ------
        NotKeptError
            A KeyError that says what has been kept.
        """
        if name == "time":
            return self.time
        if name in self.series:
            return self.series[name]
        if name in self.given:
            return self.given[name]
        if name in self.end:
            raise NotKeptError(name, [], "only `end`, `minimum` and `maximum` were asked for (series=False)")
        raise NotKeptError(name, list(self.end), f"keep=({name!r},)")

    @property
    def kept(self) -> tuple[str, ...]:
        """Names of the variables."""
        return tuple(self.end)

    def __len__(self) -> int:
        return len(self.failed)

    @cached_property
    def table(self) -> dict[str, np.ndarray]:
        """{column: (N,)}: what was given, `end`, `min` and `max` of what was kept, `failed`, `reason`."""
        columns: dict[str, np.ndarray] = {}
        for name, values in self.given.items():
            columns |= _flat(name, values)
        for name in self.kept:
            for what, values in (("end", self.end), ("min", self.minimum), ("max", self.maximum)):
                columns |= {f"{own} {what}": found for own, found in _flat(name, values[name]).items()}
        return columns | {"failed": self.failed, "reason": np.array(self.reasons, object)}

    def to_dataframe(self):
        """Return a pandas DataFrame with a row for each run: what was given, and the columns of `table`."""
        import pandas

        return pandas.DataFrame(self.table).rename_axis("run")

    def to_xarray(self):
        """Return an `xarray.Dataset` over run and time, with units.

        Raises
        ------
        ModelError
            E0623: the package xarray is missing.
        """
        try:
            import xarray
        except ImportError:
            raise _refusal("E0623", "xarray is not installed", "pip install 'lmoc[studies]'") from None
        found: dict[str, Any] = {}
        for name, values in self.given.items():
            found[name] = (("run", f"{name} index")[: values.ndim], values)
        for name in self.kept:
            attributes = {"units": self.units[name]} if self.units.get(name) else {}
            values, over = (self.series[name], ("run", "time")) if self.series else (self.end[name], ("run",))
            inner = (f"{name} index",) * (values.ndim - len(over))
            found[name] = ((*over, *inner), values, attributes)
        found |= {"failed": ("run", self.failed), "reason": ("run", np.array(self.reasons, str))}
        return xarray.Dataset(found, {"run": np.arange(len(self)), "time": ("time", self.time, {"units": "s"})})

    def save(self, path: str | Path) -> Path:
        """Write the table of the runs, .csv or .parquet; or .npz, with all series.

        Raises
        ------
        ModelError
            E0623 the file cannot be written, E0624 unknown ending.
        """
        from lmoc.report.files import FORMATS, check_target, written

        target = Path(path)
        ending = target.suffix.lower()
        check_target(target, (".csv", ".parquet", ".npz"))
        if ending == ".npz":
            columns = {"run": np.arange(len(self)), **self.table, "reason": np.array(self.reasons, str)}
            columns |= {"time": self.time, **self.series}
            return written(target, lambda beside: FORMATS[ending](beside, columns))
        table = self.to_dataframe()
        return written(target, lambda beside: (table.to_csv if ending == ".csv" else table.to_parquet)(beside))

    def plot(self, name: str | None = None, path: str | Path | None = None, kind: str = "bands") -> Figure:
        """Draw a variable of all runs; see `lmoc.studies.ensemble_plot.plot`.

        Parameters
        ----------
        name : by default the first that was kept
        kind : "bands" (quantiles over time), "histogram" (of the last value), "scatter" (last value over what was
            given), or "tornado" (which of what was given it depends on most)
        """
        from lmoc.studies.ensemble_plot import plot

        return plot(self, name, path, kind)

    def __repr__(self) -> str:
        lost = int(self.failed.sum())
        failed = f", {lost} of which failed" if lost else ""
        return f"<Ensemble of {self.name}: {len(self)} runs{failed}; {', '.join(self.kept)}>"


def _flat(name: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """Return columns (N,) of values (N,), or of an array of the model (N, …)."""
    if values.ndim == 1:
        return {name: values}
    places = np.ndindex(values.shape[1:])
    return {f"{name}[{','.join(str(k + 1) for k in at)}]": values[:, *at] for at in places}


def _refusal(code: str, message: str, hint: str):
    from lmoc.messages.diagnostics import Diagnostic, ModelError

    return ModelError([Diagnostic(code, message, hint=hint)])


def joined(
    name: str, time: np.ndarray, given: Mapping[str, np.ndarray], units: Mapping[str, str], chunks: Sequence[Chunk]
) -> Ensemble:
    """Return the ensemble of chunks, in the order of their rows."""

    def together(tables: Sequence[Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
        return {key: np.concatenate([table[key] for table in tables]) for key in tables[0]}

    reasons = tuple(chain.from_iterable(chunk.reasons for chunk in chunks))
    return Ensemble(
        name, time, given,
        together([c.series for c in chunks]), _Ends(together([c.end for c in chunks])),
        _Ends(together([c.minimum for c in chunks])), _Ends(together([c.maximum for c in chunks])),
        np.fromiter(map(bool, reasons), bool, len(reasons)), reasons,
        tuple(chain.from_iterable(chunk.events for chunk in chunks)), units,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Chunk:
    """Some of the runs of an ensemble, one behind the other: attributes as of `Ensemble`."""

    series: Mapping[str, np.ndarray]
    end: Mapping[str, np.ndarray]
    minimum: Mapping[str, np.ndarray]
    maximum: Mapping[str, np.ndarray]
    reasons: tuple[str, ...]
    events: tuple[tuple[Event, ...], ...]
