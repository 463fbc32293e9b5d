"""The bounds of `certificate`, compiled: dense loops over the few rows of the constraints behind their program."""

from __future__ import annotations

import ctypes
from functools import cached_property

import numpy as np

from lmoc.ir.program import Solve, walk
from lmoc.ir.reduced import Constraints
from lmoc.numerics.coordinates.certificate_layout import Layout
from lmoc.numerics.evaluate.native.c_code import CFunction, Unsupported
from lmoc.numerics.evaluate.native.c_program import generate
from lmoc.numerics.evaluate.native.c_text import c_text
from lmoc.numerics.evaluate.native.compiler import load_library
from lmoc.numerics.evaluate.native.kernel import Data, with_blocks
from lmoc.numerics.plan import Plan

_OPTION = "-O2"

CERTIFICATE = r"""
/* What is given and what is found stand one behind the other as in `certificate_layout.Layout`. */
void lmoc_certificate(double time, double *w, const int64_t *m, const void *const *tab, const double *matrix,
                      double *now) {
  const double *table = matrix + COUNT, *before = table + WATCHED*STATES, *after = before + TOLD,
               *factor = after + TOLD, *size = factor + COUNT, *bound = size + COUNT, *scale = bound + COUNT,
               *brief = scale + WATCHED*STATES;
  double *by_rows = now + COUNT, *larger = by_rows + WATCHED*STATES, *bounds = larger + COUNT;
  double a[ROWS][COLUMNS] = {{0}}, even[ROWS][COLUMNS] = {{0}}, s[ROWS][ROWS], t[ROWS][ROWS];
  double sign = 1, worst = 0, change = 0, unexplained = -INFINITY, grown = -INFINITY, finite = 0;
  lmoc_program(time, w, m, tab);
  for (int k = 0; k < COUNT; k++) now[k] = 0;
  for (int e = 0; e < ENTRIES; e++) now[target[e]] += w[entry[e]];
  for (int k = 0; k < COUNT; k++) {
    const int i = place[k] / COLUMNS, j = place[k] % COLUMNS;
    const double moved = (now[k] - matrix[k])*factor[k];
    a[i][j] = now[k];
    even[i][j] = now[k]*factor[k];
    if (j < ROWS) finite += 0*now[k];
    change += moved*moved;
    larger[k] = fmax(size[k], fabs(now[k]));
    grown = lmoc_max(grown, larger[k] - bound[k]);
  }
  for (int k = 0; k < ROWS; k++) {   /* A⁻¹B by elimination with row pivoting */
    int p = k;
    for (int i = k + 1; i < ROWS; i++) if (fabs(a[i][k]) > fabs(a[p][k])) p = i;
    if (p != k) {
      sign = -sign;
      for (int j = k; j < COLUMNS; j++) { const double x = a[k][j]; a[k][j] = a[p][j]; a[p][j] = x; }
    }
    sign *= lmoc_sign(a[k][k]);
    for (int i = k + 1; i < ROWS; i++) {
      const double f = a[i][k] / a[k][k];
      if (f != 0) for (int j = k + 1; j < COLUMNS; j++) a[i][j] -= f*a[k][j];
    }
  }
  for (int k = ROWS - 1; k >= 0; k--)
    for (int j = ROWS; j < COLUMNS; j++) {
      double x = a[k][j];
      for (int i = k + 1; i < ROWS; i++) x -= a[k][i]*a[i][j];
      a[k][j] = x / a[k][k];
    }
  for (int r = 0; r < WATCHED; r++)
    for (int j = 0; j < STATES; j++) {
      by_rows[r*STATES + j] = a[watched[r]][ROWS + j];
      worst = lmoc_max(worst, fabs(by_rows[r*STATES + j]*scale[r*STATES + j]));
    }
  for (int r = 0; r < WATCHED && TOLD; r++) {
    const double way = after[watched[r]] - before[watched[r]];
    double rest = way;
    for (int j = 0; j < STATES; j++)
      rest += (table[r*STATES + j] + by_rows[r*STATES + j])/2*(after[ROWS + j] - before[ROWS + j]);
    unexplained = lmoc_max(unexplained, fabs(rest) - fmax(UNEXPLAINED*fabs(way), brief[r]));
  }
  for (int i = 0; i < ROWS; i++)     /* Cholesky's factor of M·Mᵀ, and its inverse in the upper half */
    for (int j = 0; j <= i; j++) {
      double x = 0;
      for (int k = 0; k < COLUMNS; k++) x += even[i][k]*even[j][k];
      for (int k = 0; k < j; k++) x -= s[i][k]*s[j][k];
      s[i][j] = i == j ? sqrt(x) : x/s[j][j];
    }
  for (int j = 0; j < ROWS; j++)
    for (int i = j; i < ROWS; i++) {
      double x = i == j;
      for (int k = j; k < i; k++) x -= s[i][k]*t[k][j];
      t[i][j] = x/s[i][i];
    }
  for (int i = 0; i < ROWS; i++)
    for (int j = 0; j <= i; j++) {
      double x = 0;
      for (int k = i; k < ROWS; k++) x += t[k][i]*t[k][j];
      s[i][j] = s[j][i] = x;
    }
  for (int q = 0; q < SQUARINGS; q++) {
    for (int i = 0; i < ROWS; i++)
      for (int j = 0; j <= i; j++) {
        double x = 0;
        for (int k = 0; k < ROWS; k++) x += s[i][k]*s[j][k];
        t[i][j] = t[j][i] = x;
      }
    memcpy(s, t, sizeof s);
  }
  double sum = 0;
  for (int i = 0; i < ROWS; i++) for (int j = 0; j < ROWS; j++) sum += s[i][j]*s[i][j];
  bounds[0] = worst;
  bounds[1] = finite == 0 ? sign : 0;
  bounds[2] = pow(sum, -1.0/(4 << SQUARINGS));
  bounds[3] = sqrt(change);
  bounds[4] = TOLD ? unexplained : 0;
  bounds[5] = grown;
}
"""


class CompiledCertificate:
    """The C function on arrays of its own.

    Attributes
    ----------
    addresses : of its arguments behind the time
    """

    def __init__(self, plan: Plan, function: CFunction, library: ctypes.CDLL, layout: Layout) -> None:
        self._w = np.zeros(plan.reduced.constraints.count + function.scratch)
        self._data = Data(function)
        self.given, given = layout.given()
        self.results, results = layout.found()
        self._run = library.lmoc_certificate
        pointer = ctypes.c_void_p
        self._run.argtypes, self._run.restype = [ctypes.c_double, *[pointer] * 5], None
        held = self._w, self._data.numbers, self._data.pointers, given, results
        self.addresses, self._held = [a.ctypes.data for a in held], held
        self._library = library

    def __call__(self, t: float, known: np.ndarray, reads: np.ndarray) -> None:
        self._w[reads] = known
        self._run(t, *self.addresses)

    def address(self, name: str) -> int | None:
        """Return where another function of the library stands."""
        return ctypes.cast(getattr(self._library, name), ctypes.c_void_p).value


class Text:
    """The C text of a plan's certificate.

    Attributes
    ----------
    function : None where C does not take the constraints
    library : compiled from it; None where C does not take them, or there is no compiler
    """

    def __init__(self, plan: Plan, layout: Layout, definitions: str) -> None:
        own = plan.reduced.constraints
        self.function, self.text = _written(own), ""
        if self.function is not None:
            tables = _tables(own, layout)
            self.text = with_blocks(self.function.text) + definitions + tables + CERTIFICATE + c_text("judge")

    @cached_property
    def library(self) -> ctypes.CDLL | None:
        return None if self.function is None else load_library(self.text, _OPTION)


def _written(own: Constraints) -> CFunction | None:
    if any(isinstance(step, Solve) for step in walk(own.program)):
        return None  # with data that would have to be prepared
    try:
        return generate(own.program, own.count)
    except Unsupported:
        return None


def _tables(own: Constraints, layout: Layout) -> str:
    lists = {"entry": own.register, "target": layout.targets, "place": layout.places, "watched": own.watched}
    return "".join(
        f"static const int32_t {name}[] = {{{', '.join(map(str, values.tolist()))}}};\n"
        for name, values in lists.items()
    )
