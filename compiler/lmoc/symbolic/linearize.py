"""Linear models: A, B, C, D about a point, symbolic or numeric, and what is read off them.

Where an input's derivative acts (a road u(t) under a damper), the model is a descriptor one,
``ẋ = A x + B u + B₁ u̇``, ``y = C x + D u + D₁ u̇``; `realization` removes B₁ by the state ``z = x − B₁ u``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.support.records import dataclass
from lmoc.support.replacing import replace_file
from lmoc.symbolic.jumps import check_no_jump, has_cases
from lmoc.symbolic.names import without_dots
from lmoc.symbolic.notebook import MOST_SHOWN, matrices_html
from lmoc.symbolic.rational import cancelled
from lmoc.symbolic.slope import slope
from lmoc.symbolic.stability import Spectrum, spectrum, stability, too_wide
from lmoc.symbolic.system import SymbolicSystem, refuse
from lmoc.symbolic.values import exactly, no_value

if TYPE_CHECKING:
    import sympy

    from lmoc.symbolic.loops_at_rest import LoopsAtRest

Matrix = Any  # numpy array or sympy Matrix


@dataclass(frozen=True, eq=False)
class LinearModel:
    """``ẋ = A x + Σ_k B_k u^(k)``, ``y = C x + Σ_k D_k u^(k)`` in deviations from `point`.

    Matrices are numpy arrays, or sympy Matrices in a symbolic model.

    Attributes
    ----------
    states, inputs, outputs : names
    A, C : (n, n), (p, n)
    Bs, Ds : tuples of (n, m) and (p, m), by the order of the input's derivative
    point : {name: value}
        States and inputs about which the model is linear.
    drift : (n,)
        Derivatives of the states at the point: zero at an equilibrium.
    output_values : (p,)
        Outputs at the point.
    loops : LoopsAtRest | None
        In symbols, where closed loops have no solution in closed form.
    short : LinearModel | None
        With `loops`: the same with its abbreviations as symbols.
    """

    states: list[str]
    inputs: list[str]
    outputs: list[str]
    A: Matrix
    Bs: tuple[Matrix, ...]
    C: Matrix
    Ds: tuple[Matrix, ...]
    point: Mapping[str, Any]
    drift: Matrix
    output_values: Matrix
    coordinates: tuple[tuple[int, int], ...] = ()
    time: float | None = None  # s, where time itself appears in the equations
    loops: LoopsAtRest | None = None
    short: LinearModel | None = None

    @property
    def symbolic(self) -> bool:
        return not isinstance(self.A, np.ndarray)

    @property
    def B(self) -> Matrix:
        return self.Bs[0]

    @property
    def D(self) -> Matrix:
        return self.Ds[0]

    @property
    def Bd(self) -> Matrix | None:
        """Return the effect of the inputs' first derivatives on the states; None where there is none."""
        return self.Bs[1] if len(self.Bs) > 1 and any(self.Bs[1].ravel() if not self.symbolic else self.Bs[1]) else None

    @property
    def Dd(self) -> Matrix | None:
        return self.Ds[1] if len(self.Ds) > 1 and any(self.Ds[1].ravel() if not self.symbolic else self.Ds[1]) else None

    @property
    def at_rest(self) -> bool:
        """The point is an equilibrium."""
        if self.symbolic:
            return all(d == 0 for d in self.drift)
        return bool(np.all(np.abs(self.drift) <= 1e-8 * (1.0 + np.abs(self.A).sum(axis=1))))

    # ------------------------------------------------------------- dynamics

    @property
    def eigenvalues(self) -> np.ndarray:
        """Sorted by frequency, then by real part; the partners of a complex pair stand together."""
        return self._spectrum.values

    @property
    def is_too_wide(self) -> bool:
        """Its numbers lie so far apart that the eigenvalues are lost in rounding."""
        return too_wide(self._numeric_A)

    @cached_property
    def _spectrum(self) -> Spectrum:
        if self.is_too_wide:
            raise refuse(
                "the numbers of the linear model span more than 24 orders of magnitude: its eigenvalues are lost",
                hint="look at very large and very small values",
            )
        return spectrum(self._numeric_A)

    @cached_property
    def _numeric_A(self) -> np.ndarray:
        if self.symbolic:
            raise refuse(
                "eigenvalues need parameter values", hint="give the parameters values, or use symbolic=False"
            )
        return self.A

    @property
    def frequencies(self) -> np.ndarray:
        """Natural angular frequency |λ| of each eigenvalue in rad/s."""
        return np.abs(self.eigenvalues)

    @property
    def dampings(self) -> np.ndarray:
        """Damping ratio −Re λ/|λ| of each eigenvalue; NaN for a zero eigenvalue."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return -self.eigenvalues.real / np.abs(self.eigenvalues)

    @cached_property
    def modes(self) -> np.ndarray:
        """(n, n): a column of each eigenvalue, its largest coordinate 1."""
        values, vectors = np.linalg.eig(self._numeric_A)
        order = [int(np.argmin(np.abs(values - v))) for v in self.eigenvalues]
        rows = [q for q, _ in self.coordinates] or list(range(len(self.states)))
        columns = []
        for i in order:
            vector = vectors[:, i]
            largest = rows[int(np.argmax(np.abs(vector[rows])))]
            scale = vector[largest] if abs(vector[largest]) > 0 else 1.0
            columns.append(vector / scale)
            values[i] = np.inf  # each eigenvector once
        return np.array(columns).T if columns else np.zeros((0, 0))

    @property
    def stability(self) -> str:
        """``asymptotically stable``, ``stable`` (undamped), ``neutral`` (a family of equilibria), ``marginal`` (one
        that drifts at constant speed once pushed) or ``unstable``.
        """
        return stability(self._spectrum, self._numeric_A)

    # ---------------------------------------------------------------- forms

    def realization(self) -> LinearModel:
        """The same behaviour without input derivatives in ẋ (``z = x − B₁ u − …``)."""
        Bs, Ds = list(self.Bs), list(self.Ds)
        Ds += [Ds[0] * 0] * (len(Bs) - len(Ds))
        Bs += [Bs[0] * 0] * (len(Ds) - len(Bs))
        for k in range(len(Bs) - 1, 0, -1):
            Bs[k - 1] = self._clean(Bs[k - 1] + self.A @ Bs[k])
            Ds[k - 1] = self._clean(Ds[k - 1] + self.C @ Bs[k])
            Bs[k] = Bs[k] * 0
        short = None if self.short is None else self.short.realization()
        return replace(self, Bs=tuple(Bs), Ds=tuple(Ds), short=short)

    def _clean(self, matrix: Matrix) -> Matrix:
        return matrix.applyfunc(cancelled) if self.symbolic else matrix

    def matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """(A, B, C, D) of the realization, for scipy.signal and python-control.

        Raises
        ------
        ModelError
            E0660 where an output contains an input's derivative: no such (proper) form exists.
        """
        proper = self.realization()
        improper = [y for i, y in enumerate(self.outputs) if any(np.any(D[i] != 0) for D in proper.Ds[1:])]
        if improper:
            which = ", ".join(improper)
            raise refuse(
                f"the derivative of an input acts on {which}: there is no proper form A, B, C, D",
                hint="choose other outputs: linearize(outputs=[…])",
            )
        return proper.A, proper.B, proper.C, proper.D

    def to_scipy(self):
        """A scipy.signal.StateSpace."""
        from scipy.signal import StateSpace

        return StateSpace(*self.matrices())

    def to_control(self):
        """Return a control.StateSpace; its names have ``_`` for the dots, which python-control keeps for subsystems.

        Raises
        ------
        ModuleNotFoundError
            The package python-control is not installed.
        ModelError
            E0660, as `matrices`.
        """
        control = python_control()
        given = {"states": self.states, "inputs": self.inputs, "outputs": self.outputs}
        names = {kind: without_dots(listed) for kind, listed in given.items()}
        return control.ss(*self.matrices(), **names)

    def arrays(self) -> dict[str, np.ndarray]:
        """A, B, C, D, the point x0, u0, y0 and the names as arrays, for files.

        Bd and Dd belong to the inputs' first derivatives; B2, D2, … to higher ones, where those act.
        """
        names = {"states": self.states, "inputs": self.inputs, "outputs": self.outputs}
        blocks = {"A": self.A, "B": self.B, "C": self.C, "D": self.D}
        blocks |= {"Bd": self.B * 0 if self.Bd is None else self.Bd, "Dd": self.D * 0 if self.Dd is None else self.Dd}
        for k in range(2, len(self.Bs)):
            blocks |= {f"B{k}": self.Bs[k], f"D{k}": self.Ds[k]}
        at = {"x0": self.states, "u0": self.inputs}
        blocks |= {key: np.array([float(self.point[name]) for name in of]) for key, of in at.items()}
        blocks["y0"] = self.output_values
        return blocks | {key: np.array(value, str) for key, value in names.items()}

    def __repr__(self) -> str:
        names = {"states": self.states, "inputs": self.inputs, "outputs": self.outputs}
        sizes = ", ".join(f"{len(v)} {what[:-1] if len(v) == 1 else what}" for what, v in names.items())
        return f"<LinearModel: {sizes}; {'in symbols' if self.symbolic else self.stability}>"

    def _repr_html_(self) -> str:
        """Return the HTML representation for notebooks: for a small model the nonzero matrices."""
        title = repr(self).strip("<>")
        if max(len(self.states), len(self.inputs), len(self.outputs)) > MOST_SHOWN:
            return matrices_html(title, ())
        shown = self.short or self
        named = [("A", shown.A, self.states, self.states)]
        named += [(f"B{k or ''}", B, self.states, self._jets(k)) for k, B in enumerate(shown.Bs)]
        named += [("C", shown.C, self.outputs, self.states)]
        named += [(f"D{k or ''}", D, self.outputs, self._jets(k)) for k, D in enumerate(shown.Ds)]
        return matrices_html(title, named)

    def _jets(self, order: int) -> list[str]:
        """Names of the inputs' derivatives of an order."""
        return [f"{'der(' * order}{u}{')' * order}" for u in self.inputs]

    def save(self, path: str | Path) -> None:
        """Write the `arrays` into a file, .mat (MATLAB, names as cell arrays) or .npz.

        Raises
        ------
        ModelError
            E0624 for another ending.
        OSError
            The file cannot be written.
        """
        path, arrays = Path(path), self.arrays()
        if path.suffix.lower() == ".npz":
            replace_file(path, lambda target: np.savez(target, **arrays))
        elif path.suffix.lower() == ".mat":
            from scipy.io import savemat

            cells = {key: v.astype(object) if v.dtype.kind == "U" else v for key, v in arrays.items()}
            replace_file(path, lambda target: savemat(target, cells))
        else:
            message = f"the format of '{path}' is not known"
            raise ModelError([Diagnostic("E0624", message, expected=".mat, .npz", found=f"'{path.suffix}'")])


def linearize(
    system: SymbolicSystem,
    point: Mapping[sympy.Symbol, sympy.Expr] | None = None,
    symbolic: bool = False,
    outputs: Mapping[str, sympy.Expr] | None = None,
) -> LinearModel:
    """Linear model of a symbolic system about a point.

    Parameters
    ----------
    system : SymbolicSystem
    point : {Symbol: expression or number}, optional
        States and inputs; those not given stay symbols (symbolic form), or are zero (numeric form).
    symbolic : bool
        Matrices in symbols instead of numbers.
    outputs : {name: Expr}, optional
        Instead of the system's outputs; without any, the states are the outputs.

    Raises
    ------
    ModelError
        E0662 where a parameter without a value appears in the numeric form.
    """
    import sympy as sp

    outputs = dict(system.outputs if outputs is None else outputs) or {s.name: s for s in system.states}
    f, h = sp.Matrix(list(system.derivatives)), sp.Matrix(list(outputs.values()))
    here = {x: exactly(v) for x, v in (point or {}).items()}
    here = {d: sp.S.Zero for u in system.inputs for d in system.jets(u)[1:]} | here
    check_no_jump([*f, *h], {x: sp.S.Zero for x in (*system.states, *system.inputs)} | here if not symbolic else here)
    if not symbolic:
        _check_values(f.free_symbols | h.free_symbols, system)

    def finish(matrix: sp.Matrix) -> Matrix:
        matrix = matrix.xreplace(here)
        if matrix.has(sp.nan, sp.zoo):
            hint = "choose another point, or leave symbols out (symbolic=False): in numbers it may have one"
            raise ModelError([Diagnostic("E0663", "a derivative has no value in symbols at this point", hint=hint)])
        return matrix.applyfunc(_lowest) if symbolic else _numbers(matrix, system)

    by_order = _jets_by_order(system)
    return LinearModel(
        states=[s.name for s in system.states],
        inputs=[u.name for u in system.inputs],
        outputs=list(outputs),
        A=finish(_jacobian(f, system.states)),
        Bs=tuple(finish(_jacobian(f, jets)) for jets in by_order),
        C=finish(_jacobian(h, system.states)),
        Ds=tuple(finish(_jacobian(h, jets)) for jets in by_order),
        point={x.name: here.get(x, x if symbolic else sp.S.Zero) for x in (*system.states, *system.inputs)},
        drift=_column(finish(f)),
        output_values=_column(finish(h)),
        coordinates=system.coordinates,
    )


def _jets_by_order(system: SymbolicSystem) -> list[list[sympy.Symbol]]:
    """The inputs, their first derivatives, and so on; a symbol that appears nowhere for what does not act."""
    import sympy as sp

    jets = [system.jets(u) for u in system.inputs]
    highest = max((len(j) for j in jets), default=1)
    return [[jet[k] if k < len(jet) else sp.Dummy() for jet in jets] for k in range(highest)]


def is_linear(system: SymbolicSystem) -> bool:
    """Rates and outputs are linear in states, inputs and their derivatives."""
    moving = {*system.states, *(j for u in system.inputs for j in system.jets(u))}
    expressions = (*system.derivatives, *system.outputs.values())
    if any(has_cases(e, moving) for e in expressions):
        return False
    return all(not slope(e, x).free_symbols & moving for e in expressions for x in e.free_symbols & moving)


def _jacobian(f: sympy.Matrix, x) -> sympy.Matrix:
    import sympy as sp

    return sp.Matrix(f.rows, len(x), lambda i, j: slope(f[i], x[j]))


def _column(matrix: Matrix) -> Matrix:
    return matrix.ravel() if isinstance(matrix, np.ndarray) else matrix


def _lowest(value: sympy.Expr) -> sympy.Expr:
    import sympy as sp

    return sp.factor_terms(cancelled(value)) if value.free_symbols else value


def _numbers(matrix: sympy.Matrix, system: SymbolicSystem) -> np.ndarray:
    """A matrix of expressions as numbers; states and inputs left over are zero."""
    import sympy as sp

    zero = {x: sp.S.Zero for x in (*system.states, *system.inputs, sp.Symbol("time"))}
    done = matrix.xreplace(system.numbers).xreplace(zero)
    missing = sorted({s.name for s in done.free_symbols})
    if missing:
        raise no_value(missing)
    return np.array(done.evalf(17).tolist(), float).reshape(matrix.shape)


def _check_values(symbols: set, system: SymbolicSystem) -> None:
    missing = symbols & {s for s, v in system.values.items() if np.isnan(v)}
    if missing:
        raise no_value(sorted(s.name for s in missing))


def python_control() -> ModuleType:
    """Return the module `control`, with a word of what to install where it is missing."""
    try:
        return import_module("control")
    except ModuleNotFoundError as error:
        if error.name != "control":
            raise
        message = "to_control() needs python-control: pip install control; to_scipy() and matrices() do without"
        raise ModuleNotFoundError(message, name="control") from None
