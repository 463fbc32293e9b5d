"""Writes `docs/modelica.md`: constructs clause by clause, from the programs of the tests, and how to use a library."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

PAGE = Path(__file__).with_name("modelica.md")
PROGRAMS = Path(__file__).parent.parent / "tests" / "data" / "specification"
CHAPTERS = {
    3: "Operators and expressions", 4: "Classes, predefined types and declarations", 5: "Scoping and name lookup",
    6: "Interfaces", 7: "Inheritance, modification, redeclaration", 8: "Equations", 9: "Connectors and connections",
    10: "Arrays", 11: "Statements and algorithms", 12: "Functions", 15: "Stream connectors",
}  # fmt: skip
HEAD = """# Modelica

How lmoc stands to the Modelica specification 3.6. Each line is a program of the tests (`tests/data/specification`):
it gives what the specification says, or is refused with a code that [diagnostics.md](diagnostics.md) explains. This
page is made by `docs/make_modelica.py`.

## Using a library

`lmoc run Modelica.Mechanics.Rotational.Examples.First --path FOLDER` runs a class of a library in a folder, as it is
published: FOLDER holds `Modelica/package.mo`, `Complex.mo`, …. In Python: `lmoc.compile("Modelica.….First",
path=FOLDER)`. Files are read when a name first needs them.
What the library leaves to C or to loops over values that change stands in lmo in
`stdlib/modelica.mo`, under the library's own names: tables, generators of random numbers,
linear equations and least squares of LAPACK (`dgesv`, `dgesv_vec`, `dgglse_vec`), `Streams.error`, `Strings.length` and
`substring` of texts that are known. The seed that
`automaticGlobalSeed` gives is the same in each run, as all that lmoc computes; other seeds give other noise. The
generator with a hidden state (`impureRandom`) draws in one when-equation of a model, since nothing says in which order
several calls come; a second one is refused. Units that do not fit within a library are warnings
(W0303). What a package has written (kinks, open ends, guesses of starts, assertions in functions) is told of its own
class alone, not of a model that uses it, and of a class that is only named (`lmoc run Package.Class`) unless it has
been found in a folder of `--path`, `path=` or `LMOPATH`.

`python -m benchmarks.msl FOLDER REFERENCES PACKAGE` runs all examples of a package, and holds them against the
published results. `benchmarks.msl_proofs` shows what stands behind rows that no reference decides: the
multivibrator and its reference beside a closed form, balances of circuits that have no reference.
OpAmps.SignalGenerator has three states to start from; its `homotopy` in version 4.0.0 of the library leads to
another one than that of its reference, which the library has corrected since. Noise.ActuatorWithNoise comes to its end,
and its signals are within a thousandth of the tube at the times of its reference, as far as they have been compared
there (4.2 s of 8 s); between these its gap rattles faster than they show. It takes some minutes of processor time.
"""


def programs() -> Iterator[tuple[str, str, str, str]]:
    """(clause, construct, expectation, text) of each program."""
    for path in sorted(PROGRAMS.glob("*.txt")):
        joined = re.sub(r"\n[ \t]+", " ", path.read_text(encoding="utf-8"))
        for line in joined.splitlines():
            if line.strip() and not line.startswith("#"):
                name, expected, text = line.split(" | ", 2)
                clause, construct = name.strip().split(" ", 1)
                yield clause, construct, expected.strip(), text.strip()


def page() -> str:
    """The page."""
    lines = [HEAD]
    found = sorted(programs(), key=lambda p: [int(n) for n in p[0].split(".")])
    for chapter, title in CHAPTERS.items():
        rows = [p for p in found if int(p[0].split(".")[0]) == chapter]
        refused = [p for p in rows if re.fullmatch(r"E\d{4}|stopped", p[2])]
        if rows:
            lines += [f"## {chapter} {title}", "", f"{len(rows)} programs, of which {len(refused)} are refused.", ""]
            lines += ["| clause | construct | result |", "| --- | --- | --- |"]
            lines += [f"| {clause} | {construct} | {expected} |" for clause, construct, expected, _ in rows]
            lines += [""]
    return "\n".join(lines).rstrip() + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
