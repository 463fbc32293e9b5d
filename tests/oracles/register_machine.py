"""A plain evaluator of reduced systems, independent of the numerics: one register vector, one step after the other."""

from __future__ import annotations

import numpy as np

from lmoc.expression.evaluate import evaluate
from lmoc.ir.program import Apply, Solve, Total
from lmoc.ir.reduced import Reduced


class Machine:
    """Evaluates a reduced system; inputs are ``sin(w·t + phase)`` with all their derivatives."""

    def __init__(self, reduced: Reduced):
        self.reduced = reduced
        self.w = np.full(reduced.registers.count, np.nan)
        self.w[reduced.known[0]] = reduced.values[reduced.known[1]]
        self.execute(reduced.parameter_program, 0.0)

    def signal(self, variable: np.ndarray, order: np.ndarray, time: float) -> np.ndarray:
        speed = 1.0 + 0.1 * (variable % 7)
        return speed**order * np.sin(speed * time + variable + order * np.pi / 2)

    def execute(self, program, time: float) -> None:
        w = self.w
        for step in program:
            if isinstance(step, Apply):
                w[step.out] = evaluate(step.shape, lambda k, _, s=step: w[s.slots[:, k]], time)
            elif isinstance(step, Total):
                terms = step.coefficient * w[step.index]
                w[step.out] = [terms[a:b].sum() for a, b in zip(step.start, step.start[1:], strict=False)]
            else:
                self.solve(step, time)

    def solve(self, step: Solve, time: float) -> None:
        """Newton's method with differences; one iteration where the equations are linear."""
        w = self.w
        for b in range(len(step.unknowns)):
            unknowns, residuals = step.unknowns[b], step.residuals[b]
            start = np.full(len(unknowns), 0.3)
            if step.guess is not None:
                start = np.where(step.guess[b] >= 0, w[step.guess[b]], start)
            x = start.copy()

            def residual(x, unknowns=unknowns, residuals=residuals):
                # the other instances must not fail on numbers that are not there yet
                w[step.unknowns] = np.nan_to_num(w[step.unknowns], nan=0.3)
                w[unknowns] = x
                self.execute(step.inner, time)
                return w[residuals].copy()

            for _ in range(1 if step.linear else 50):
                h = 1.0 if step.linear else 1e-7
                r = residual(x)
                jacobian = np.stack([(residual(x + h * e) - r) / h for e in np.eye(len(x))], axis=1)
                change = np.linalg.solve(jacobian, -r)
                x = x + change
                if np.abs(change).max() < 1e-13:
                    break
            assert np.abs(residual(x)).max() < 1e-7

    def derivative(self, y: np.ndarray, time: float) -> np.ndarray:
        """Right-hand side for states followed by quadratures; fills every register."""
        r, w = self.reduced, self.w
        w[r.states], w[r.quadratures] = y[: len(r.states)], y[len(r.states) :]
        w[r.inputs[0]] = self.signal(r.inputs[1], r.inputs[2], time)
        self.execute(r.rhs, time)
        assert np.isfinite(w[r.derivatives]).all()
        self.execute(r.observe, time)
        return np.concatenate([w[r.derivatives], w[r.quadrature_derivatives]])

    def variables(self, y: np.ndarray, time: float) -> np.ndarray:
        """Values of all flat variables, NaN for undetermined ones."""
        self.derivative(y, time)
        at = self.reduced.register_of
        return np.where(at >= 0, self.w[at], np.nan)

    def step(self, y: np.ndarray, time: float, h: float) -> np.ndarray:
        """One step of the classical Runge-Kutta method."""
        a = self.derivative(y, time)
        b = self.derivative(y + h / 2 * a, time + h / 2)
        c = self.derivative(y + h / 2 * b, time + h / 2)
        d = self.derivative(y + h * c, time + h)
        return y + h / 6 * (a + 2 * b + 2 * c + d)


    def fastest(self, y: np.ndarray, time: float) -> float:
        """Spectral radius of the Jacobian of the states."""
        n = len(self.reduced.states)
        f = self.derivative(y, time)
        columns = [((self.derivative(y + 1e-6 * e, time) - f) / 1e-6)[:n] for e in np.eye(len(y))[:n]]
        if not n:
            return 0.0
        return float(np.abs(np.linalg.eigvals(np.stack(columns, axis=1))).max())


def flat_residuals(reduced: Reduced, y: np.ndarray, time: float) -> np.ndarray:
    """What the flat equations come to along the motion from y, relative to the size of their terms.

    Derivatives of variables are found by central differences of fourth order along the motion.
    """
    flat, machine = reduced.flat, Machine(reduced)
    h = min(1e-4, 5e-4 / max(machine.fastest(y, time), 1e-9))
    path = {0: y}
    for sign in (1, -1):
        for k in (1, 2, 3, 4):
            path[sign * k] = machine.step(path[sign * (k - 1)], time + sign * (k - 1) * h, sign * h)
    x = {k: machine.variables(path[k], time + k * h) for k in path}
    order = {
        0: x[0],
        1: (x[-2] - 8 * x[-1] + 8 * x[1] - x[2]) / (12 * h),
        2: (-x[2] + 16 * x[1] - 30 * x[0] + 16 * x[-1] - x[-2]) / (12 * h**2),
    }
    found = []
    for g in flat.groups:
        sides = [evaluate(e, lambda k, n, g=g: order[n][g.slots[:, k]], time) for e in (g.left, g.right)]
        sides = [np.broadcast_to(np.asarray(s, float), g.rows) for s in sides]
        found.append((sides[0] - sides[1]) / (1 + np.abs(sides[0]) + np.abs(sides[1])))
    s = flat.sums
    terms = s.sign * x[0][s.index]
    totals = np.array([terms[a:b].sum() for a, b in zip(s.start, s.start[1:], strict=False)])
    found.append(totals / (1 + np.nanmax(np.abs(x[0]))))
    return np.concatenate(found)
