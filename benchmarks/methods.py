"""Methods and formulations on the hard and the classic scenes: digits, time, drift, energy, and how each failure looks.

    python -m benchmarks.methods [MODEL …]

The table of `docs/stability.md`. The beginning of a long run stands for it all (`lmoc chart --quick`).
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

from benchmarks.common import ROOT, save, table
from lmoc.messages.diagnostics import ModelError, SimulationError

SOLVERS = ("auto", "dop853", "taylor", "adams", "cvode", "radau", "gauss", "midpoint", "moreau")  # the last one of laws
SECONDS = 20.0  # of the processor for each scene
RTOL = 1e-6
SECTION = """\
## Every hard scene by every method

Digits reached and the time of a run, at a tolerance of 1e-6 (`midpoint`, and `moreau` of scenes with laws: the finest
of three steps); beside them the largest residual of the equations between positions, and the error of the energy
balance, of the worst method that comes to the end. A method that is given up since it is too slow has a time alone,
with > where it was stopped and ≈ where it was not begun. Letters stand for what else gave no result. A scene that
takes long is run for its beginning. The formulations are those of scenes whose closed loops are left after reduction.

{table}

{reasons}

`python -m benchmarks.methods` makes the table.
"""


def measure(names: Sequence[str] = ()) -> list[dict]:
    """Return the points of all scenes, the finest of each method and formulation."""
    import lmoc

    rows = []
    for path in scenes():
        if names and path.stem not in names:
            continue
        dae = lmoc.compile(path)
        solvers = SOLVERS if dae.flat.laws else SOLVERS[:-1]
        forms = None if dae.reduced.constraints is None else ("reduced", "projected", "ggl", "index1", "index3")
        try:
            chart = dae.chart(solvers, forms, [RTOL], quick=True, seconds=SECONDS if forms is None else 2 * SECONDS)
        except (ModelError, SimulationError) as error:  # nothing to integrate, or nothing to measure errors by
            rows.append(_without(path.stem, error))
            continue
        finest = {(p.setting.formulation, p.setting.solver): p for p in chart.points}
        for (form, solver), p in finest.items():
            rows.append({"scene": path.stem, "form": form, "solver": solver, "error": p.error, "status": p.status,
                         "seconds": p.seconds, "residual": p.residual, "energy": p.energy})  # fmt: skip
    return rows


def scenes() -> list[Path]:
    """Return the classic scenes, and the hard ones with those that have laws, by their names."""
    models = ROOT / "models"
    hard = [*(models / "hard").glob("*.lmo"), *(models / "laws").glob("h[0-9]*.lmo")]
    return [*sorted((models / "classic").glob("*.lmo")), *sorted(hard, key=lambda path: path.stem)]


def _without(scene: str, error: ModelError | SimulationError) -> dict:
    """Return the row of a scene that has no chart."""
    reason = error.diagnostics[-1].message if isinstance(error, ModelError) else str(error).split("; ")[0]
    nothing = dict.fromkeys(("error", "seconds", "residual", "energy"), math.nan)
    return {"scene": scene, "form": "reduced", "solver": "auto", "status": reason, **nothing}


def lines(rows: Sequence[dict]) -> tuple[list[list[str]], dict[str, str]]:
    """Return the cells of the table, one line a scene and formulation, and the letters of the reasons."""
    letters: dict[str, str] = {}
    cells = []
    for scene, form in dict.fromkeys((r["scene"], r["form"]) for r in rows):
        own = {r["solver"]: r for r in rows if (r["scene"], r["form"]) == (scene, form)}
        good = [r for r in own.values() if r["status"] == "ok"]
        name = scene if form == "reduced" else f"… {form}"
        row = [_cell(own.get(solver), letters) for solver in SOLVERS]
        cells.append([name, *row, _worst(good, "residual"), _worst(good, "energy")])
    return cells, {letter: reason for reason, letter in letters.items()}


def _cell(row: dict | None, letters: dict[str, str]) -> str:
    from lmoc.studies.findings import seconds_text

    if row is None:
        return ""
    if row["status"] == "ok":
        digits = 16 if row["error"] <= 1e-16 else max(0.0, -math.log10(row["error"]))
        return f"{digits:.1f} · {seconds_text(row['seconds'])}"
    for words, sign in (("takes more than ", ">"), ("would take ", "≈")):  # given up: the table says how long it takes
        if words in row["status"]:
            return f"{sign} {row['status'].rpartition(words)[2]}"
    reason = row["status"].split(" cannot be used: ")[-1]
    if reason.startswith("the run stopped at"):
        reason = reason.split(": ", 1)[1]
    return letters.setdefault(reason, "abcdefghijklmnopqrstuvwxyz"[len(letters) % 26])


def _worst(rows: Sequence[dict], key: str) -> str:
    known = [r[key] for r in rows if not math.isnan(r[key])]
    return f"{max(known):.0e}" if known else "–"


def page(rows: Sequence[dict]) -> str:
    """Return the section of `docs/stability.md`."""
    cells, letters = lines(rows)
    text = ["| scene | " + " | ".join((*SOLVERS, "drift", "energy")) + " |", "|" + " --- |" * (len(SOLVERS) + 3)]
    text += ["| " + " | ".join(row) + " |" for row in cells]
    reasons = "\n".join(f"* {letter}: {reason}" for letter, reason in letters.items())
    return SECTION.format(table="\n".join(text), reasons=reasons)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="*", help="their names; all by default")
    rows = measure(parser.parse_args().models)
    cells, letters = lines(rows)
    table("digits and time", ["scene", *SOLVERS, "drift", "energy"], cells)
    print("\n".join(f"{letter}: {reason}" for letter, reason in letters.items()))
    save("methods", rows)


if __name__ == "__main__":
    main()
