"""Writes the page of the lecture notes: ``python docs/make_notes.py`` renews ``docs/notes.md`` and its pictures.

Every formula on the page is derived by lmoc when the page is made; only what the notes print is quoted.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import sympy as sp

import lmoc
from lmoc.cli.equilibria import lines as equilibrium_lines
from lmoc.cli.symbols import complex_numbers
from lmoc.messages.diagnostics import ModelError
from lmoc.symbolic.notation import Notation
from lmoc.symbolic.styles import LATEX
from lmoc.symbolic.system import jet_symbol

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/notes.md"
PICTURES = ROOT / "docs/notes"
NOTES = json.loads((ROOT / "tests/data/notes.json").read_text())
TRUTH = json.loads((ROOT / "tests/data/notes_symbolic.json").read_text())
POINTS = 151

INTRODUCTION = """\
# The lecture notes, derived

Every scene of the notes on mechanical systems as a model of components and connections, and what lmoc makes of it: the
equations of motion, the states, the states of rest, transfer functions, and a run. After them, [the mistakes of the
notes](#mistakes-of-the-notes) that the derivation brings to light.

*This page and its pictures are made by `python docs/make_notes.py`. To get the same for a scene of your own:
`lmoc equations FILE`, `lmoc equilibria FILE`, `lmoc transfer FILE INPUT OUTPUT`, `lmoc run FILE --plot PICTURE`.*

Dots are time derivatives; *T* and the like are the internal forces that the equations of motion do without
(`--with-forces`). The last two columns of the table count the operations of the equations as lmoc prints them and of
the same equations as derived by hand, in their shortest form.
"""


def compiled(name: str) -> lmoc.DAE:
    return lmoc.compile(ROOT / "models/notes" / NOTES[name]["file"])


def main() -> None:
    import matplotlib

    os.environ["SOURCE_DATE_EPOCH"] = "0"  # pictures of the same curves are the same files
    matplotlib.rcParams["svg.hashsalt"] = "notes"
    PICTURES.mkdir(exist_ok=True)
    scenes = {name: compiled(name) for name in NOTES}
    parts = [INTRODUCTION, overview(scenes)]
    parts += [section(name, dae) for name, dae in scenes.items()]
    parts += [mistakes(scenes)]
    PAGE.write_text("\n\n".join(parts) + "\n", encoding="utf-8")


# ---------------------------------------------------------------------- the scenes


def overview(scenes: dict[str, lmoc.DAE]) -> str:
    rows = [
        "| scene | parts | flat equations | states | operations | by hand |",
        "| --- | --: | --: | --: | --: | --: |",
    ]
    for name, dae in scenes.items():
        count = dae.equations().operation_count
        numbers = (len(dae.flat.parts) - 1, dae.flat.equation_count, len(dae.states), count, by_hand(name))
        rows.append(f"| [{NOTES[name]['title']}](#{anchor(heading(name))}) | " + " | ".join(map(str, numbers)) + " |")
    return "\n".join(rows)


def by_hand(name: str) -> int:
    """Operations of the reference equations as a person writes them, both sides counted like those of lmoc."""
    truth = TRUTH[name]
    names = {n: sp.Symbol(n) for n in (*truth["parameters"], *truth["inputs"], *truth["coordinates"])}
    moving = [names[q] for q in truth["coordinates"]]
    for q in truth["coordinates"]:
        names |= {"v_" + q: jet_symbol(q, 1), "a_" + q: jet_symbol(q, 2)}
        moving += [jet_symbol(q, 1), jet_symbol(q, 2)]
    names |= {"d" + u: jet_symbol(u, 1) for u in truth["inputs"]}
    texts = [t.removesuffix(" = 0") for t in truth["second_order"].values()]
    total = 0
    for text in texts:
        constant, left = as_written(sp.sympify(text, locals=names)).as_independent(*moving, as_Add=True)
        total += int(sp.count_ops(left) + sp.count_ops(-constant))
    return total


def as_written(expression: sp.Expr) -> sp.Expr:
    """The shortest of an expression and its forms collected by one symbol: ``k·(q + L − d0)³``, not its 14 terms."""
    symbols = sorted(expression.free_symbols, key=str)
    collected = [sp.collect(sp.expand(expression), x, sp.factor) for x in symbols]
    return min([expression, *collected], key=sp.count_ops)


def heading(name: str) -> str:
    return NOTES[name]["title"]


def anchor(title: str) -> str:
    """The anchor that GitHub gives a heading."""
    kept = "".join(c for c in title.lower() if c.isalnum() or c in " -_")
    return kept.replace(" ", "-")


def section(name: str, dae: lmoc.DAE) -> str:
    file = NOTES[name]["file"]
    parts = [f"## {heading(name)}", f"[`models/notes/{file}`](../models/notes/{file})", model_text(file)]
    parts += [scene_picture(file)]
    found = dae.equations(forces=True)
    parts += [math([*found.lines(LATEX), *found.force_lines(LATEX)])]
    parts += [facts(dae)]
    formulas = transfer_functions(name, dae)
    if formulas:
        parts += [math(formulas)]
    parts += [picture(name, dae)]
    return "\n\n".join(parts)


def model_text(file: str) -> str:
    text = (ROOT / "models/notes" / file).read_text().strip()
    return f"<details><summary>the model</summary>\n\n```modelica\n{text}\n```\n\n</details>"


def scene_picture(file: str) -> str:
    """The scene as `docs/make_pictures.py` draws it, and its free bodies where they are drawn."""
    names = [f"notes_{Path(file).stem}.svg", f"notes_{Path(file).stem}_bodies.svg"]
    return "\n\n".join(f"![](pictures/{n})" for n in names if (ROOT / "docs/pictures" / n).exists())


def math(lines: list[str]) -> str:
    rows = " \\\\\n".join(line.replace(" = ", " &= ", 1) for line in lines)
    return f"$$\n\\begin{{aligned}}\n{rows}\n\\end{{aligned}}\n$$"


def facts(dae: lmoc.DAE) -> str:
    """States and states of rest."""
    told = [f"- states: {', '.join(f'`{s}`' for s in dae.states)}"]
    for e in dae.equilibria():
        words = [line for line in equilibrium_lines(e) if not line.startswith(("eigenvalues", "with "))]
        told.append(f"- at rest: {'; '.join(words)}")
        if e.model is not None:
            told.append(f"- eigenvalues there: {complex_numbers(e.model.eigenvalues)}")
    return "\n".join(told)


def transfer_functions(name: str, dae: lmoc.DAE) -> list[str]:
    rows = []
    for pair in TRUTH[name].get("transfer", {}):
        y, _, u = pair.partition("/")
        tf = dae.transfer_function(u, y)
        notation = Notation.of(tf.numerator, tf.denominator, names=(u, y))
        fraction = notation.quotient(tf.numerator, tf.denominator, "s", LATEX)
        rows.append(rf"\frac{{{notation.name(y, LATEX)}}}{{{notation.name(u, LATEX)}}} = {fraction}")
    return rows


def picture(name: str, dae: lmoc.DAE) -> str:
    file = Path(NOTES[name]["file"]).with_suffix(".svg").name
    run = dae.simulate(points=POINTS)
    coordinates = [c for c in TRUTH[name]["coordinates"]]
    run.plot(coordinates, path=PICTURES / file)
    return f"![{', '.join(coordinates)} over time](notes/{file})"


# -------------------------------------------------------------------- the mistakes


@dataclass(frozen=True)
class Mistake:
    """What the notes print, and what lmoc derives; `derived` gets all scenes and returns LaTeX."""

    where: str
    printed: str
    derived: Callable[[dict[str, lmoc.DAE]], str]
    why: str


def equation(name: str, row: int = 0) -> Callable[[dict[str, lmoc.DAE]], str]:
    return lambda scenes: scenes[name].equations().lines(LATEX)[row]


def rest(name: str, *states: str) -> Callable[[dict[str, lmoc.DAE]], str]:
    def derived(scenes: dict[str, lmoc.DAE]) -> str:
        dae = scenes[name]
        (e,) = dae.equilibria(inputs={u: 0 for u in dae.inputs})
        notation = Notation.of(*e.values.values(), names=list(e), given=e.own_names)
        return r",\quad ".join(f"{notation.name(s, LATEX)} = {notation.text(sp.expand(e[s]), LATEX)}" for s in states)

    return derived


def input_output(name: str, u: str, y: str) -> Callable[[dict[str, lmoc.DAE]], str]:
    def derived(scenes: dict[str, lmoc.DAE]) -> str:
        pair = scenes[name].input_output_equation(u, y)
        return pair.write(Notation.of(*pair, names=(u, y)), LATEX)

    return derived


def rate(name: str, state: str) -> Callable[[dict[str, lmoc.DAE]], str]:
    def derived(scenes: dict[str, lmoc.DAE]) -> str:
        system = scenes[name].symbolic()
        value = sp.together(system.ode[state])
        notation = Notation.of(value, late=[s.name for s in system.states], given=system.own_names)
        return rf"\frac{{d}}{{dt}} {notation.name(state, LATEX)} = {notation.text(value, LATEX)}"

    return derived


def force(name: str, *variables: str) -> Callable[[dict[str, lmoc.DAE]], str]:
    def derived(scenes: dict[str, lmoc.DAE]) -> str:
        system = scenes[name].symbolic(variables)
        notation = Notation.of(
            *system.variables.values(), names=variables, late=[s.name for s in system.states], given=system.own_names
        )
        shown = [(notation.name(v, LATEX), notation.text(system.variables[v], LATEX)) for v in variables]
        return r",\quad ".join(f"{v} = {value}" for v, value in shown)

    return derived


BAR = """
model BarAboutItsEnd
  parameter Real m = 2, l = 0.6;
  input Real tau = 0;
  output Real theta = bar.theta;
  Bar bar(m = m, l = l, offset = l/2);
  Torque drive(tau = tau);
equation
  connect(drive.shaft, bar.shaft);
end BarAboutItsEnd;
"""


def bar_about_its_end(scenes: dict[str, lmoc.DAE]) -> str:
    dae = lmoc.compile_text(BAR)
    return "J = " + Notation.of(sp.Symbol("m")).text(dae.equivalent("bar.shaft").inertia, LATEX)


GEARS_WITHOUT_LOAD = """
model GearsWithoutLoad
  parameter Real N = 5;
  input Real tau1 = 1, tau2 = 0;
  Gear gear(N = N);
  Torque drive(tau = tau1), load(tau = tau2);
equation
  connect(drive.shaft, gear.a);
  connect(load.shaft, gear.b);
end GearsWithoutLoad;
"""


def ideal_gears_without_load(scenes: dict[str, lmoc.DAE]) -> str:
    """What the compiler refuses the scene with."""
    try:
        lmoc.compile_text(GEARS_WITHOUT_LOAD)
    except ModelError as error:
        return r"\text{" + "; ".join(d.message for d in error.diagnostics if d.severity == "error") + "}"
    raise AssertionError("gears without inertia between prescribed torques have no equation for their angle")


MISTAKES = (
    Mistake(
        "2.2, inertia of a bar about its end",
        r"J = \frac{m l^2}{l^2} + \frac{m l^2}{l} = \frac{m l^2}{3}",
        bar_about_its_end,
        "The printed terms have the dimensions kg and kg·m. The line below it in the notes is right.",
    ),
    Mistake(
        "(17), third line",
        r"m_2(\ddot q_1 + \ddot q_2) = -k_2(q_2 - d) - c\,\dot q_1 - c\,\dot q_2",
        equation("Ex4", 1),
        "The force f has been lost; (19) has it again.",
    ),
    Mistake(
        "(36), (37), (39)",
        r"q_{1e} = \frac{(m_1+m_2)g}{k_1},\quad q_{2e} = \frac{(m_1+m_2)g}{k_1} - \frac{m_2 g}{k_2}",
        rest("Ex5", "wheel.q", "body.q"),
        "Positions count upwards, so gravity lowers the masses. With the printed value the red terms of (48) do not "
        "vanish.",
    ),
    Mistake(
        "(65)",
        r"J_2\ddot\theta_2 = \tau_2 - k_3\theta_2 - c_2\dot\theta_1 + k_2(\theta_1-\theta_2)",
        equation("Ex7-gen", 1),
        "The damper c2 acts on the second body: its angular velocity counts. As printed it could supply energy.",
    ),
    Mistake(
        "(76), (77)",
        r"(J^2p^4 + 3Jkp^2 + k^2)\,y = (Jp^2 + k)\,u",
        input_output("Ex7", "tau2", "y"),
        "A constant u > 0 turns the second body forward, so y = θ1 − θ2 rests at −u/k.",
    ),
    Mistake(
        "Example 8, state equations",
        r"\dot x_2 = \frac{?}{y}",
        rate("Ex8", "cylinder.omega"),
        "Illegible in the notes; it follows from (81) with x1 = θ, x2 = its rate.",
    ),
    Mistake(
        "(99)",
        r"\left(J_1+\frac{J_2}{N^2}\right)\ddot y = -\frac{c}{N^2}\dot y - \frac{k}{N^2} + u",
        equation("Ex9"),
        "The factor y of k/N² is missing; (100) has it again.",
    ),
    Mistake(
        "9.1",
        r"\theta\approx 0 \Rightarrow \sin\theta\approx 0,\quad q_1\approx l_1\theta",
        force("S9-lin", "q1", "q2"),
        "sin θ ≈ θ is meant; sin θ ≈ 0 would give q1 ≈ 0.",
    ),
    Mistake(
        "Figure 6, caption",
        r"T \ge 0 \text{ always},\quad f_{s_2} = -k_2 q",
        force("Fig6", "T_string"),
        "With the default free length the tension is negative for q > 0, and a string cannot push. With a pretension "
        "T0 it holds as long as T0 > k2·q (`fig6_pretension.lmo`).",
    ),
    Mistake(
        "8.1, below (95)",
        r"\tau_2 = -N\tau_1 \text{ is the torque that we want to apply on some other system}",
        force("S8-ideal", "tau_load"),
        "τ2 is what the load exerts on gear 2; the torque delivered to the load is −τ2 = N·τ1.",
    ),
    Mistake(
        "8.1, ideal gears",
        r"J_1 = J_2 = 0:\quad \tau_2 = -N\tau_1",
        ideal_gears_without_load,
        "With both torques prescribed no equation is left for the angle: any motion will do if the torques fit, none "
        "if they do not, and lmoc says so. One side must carry an inertia, a damper or a prescribed motion, as in "
        "`s8_ideal_gears.lmo`.",
    ),
)

SMALL = (
    ("Example 9", "N = θ̇1/θ2", "N = θ̇1/θ̇2"),
    (
        "Example 10",
        "θ > 0 lengthens k2, and so does q < 0; the figure is missing",
        "the printed equations hold where q and the displacement of A count in the same sense",
    ),
    ("Figure 5, caption", "moved on mass-less springs", "moved on massless rods"),
    ("5, rods", "the velocities of both ends are equal", "only those along the rod; in the plane it may turn"),
    ("(13), second line", "f_{k2}", "f_{s2}"),
    ("7.3, after (83)", "numbered (82)", "(84)"),
    ("1.2", "perpendicular lines from q; lengths", "from p; coordinates, which have a sign"),
    ("(1)", "p, which is the point just before", "another letter for the origin of frame B"),
    ("2.2", "a rotating body has a point at rest", "its orientation changes; that point may lie outside the body"),
    ("3.3", "springs that produce such a spring; restoring force", "elements … such a torque; restoring torque"),
    ("(42), (43)", "“this substitution leads to”", "(44) to (46); (42) and (43) repeat (26) and (27)"),
    ("Example 5", "extension proportional to q1 − u", "equal to q1 − u"),
    ("Examples 9 and 10", "point b; Fee-body; linear inertial; Since Since", "B; Free-body; linear inertia; Since"),
)


def mistakes(scenes: dict[str, lmoc.DAE]) -> str:
    parts = ["## Mistakes of the notes", "Printed on the left, derived by lmoc from the model on the right."]
    rows = ["| where | printed | derived | |", "| --- | --- | --- | --- |"]
    for m in MISTAKES:
        derived = m.derived(scenes).replace("|", r"\vert ")
        rows.append(f"| {m.where} | $`{m.printed}`$ | $`{derived}`$ | {m.why} |")
    small = ["| where | printed | meant |", "| --- | --- | --- |", *(f"| {a} | {b} | {c} |" for a, b, c in SMALL)]
    return "\n\n".join(
        [*parts, "\n".join(rows), "Slips of wording and notation, which no derivation shows:", "\n".join(small)]
    )


if __name__ == "__main__":
    main()
