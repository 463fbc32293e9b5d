"""The equations of a scene with laws: those of each mode, and the laws between them, as a person writes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from functools import partial
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from lmoc.ir.law import LawKind, Laws
from lmoc.ir.mode import mode_word
from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.support.records import dataclass
from lmoc.symbolic.curves import named_curves
from lmoc.symbolic.equations import (
    NOTHING_MOVES,
    EquationsOfMotion,
    curves_text,
    equations_in_short,
    equations_of_motion,
)
from lmoc.symbolic.equilibria import Equilibrium
from lmoc.symbolic.laws.modes import Lawful
from lmoc.symbolic.notation import Notation
from lmoc.symbolic.styles import ASCII, LATEX, UNICODE, Style, latex_text
from lmoc.symbolic.system import jet_symbol, symbolic_system

if TYPE_CHECKING:
    import sympy

    from lmoc.numerics.observe.trajectory import Trajectory

MOST_MODES = 6  # whose equations are derived
ALL_MODES = 8  # that are all derived where no run says which of them are met


@dataclass(frozen=True)
class MetMode:
    """A mode of the laws.

    Attributes
    ----------
    closed : which laws are closed
    since : s, when a run first met it; None where no run was made
    """

    closed: tuple[bool, ...]
    since: float | None = None


def met_modes(trajectory: Trajectory) -> list[MetMode]:
    """Return the modes of the laws that a run has met, in their order."""
    found: dict[tuple[bool, ...], MetMode] = {}
    for segment in trajectory.segments:
        if segment.mode is not None:
            closed = tuple(segment.mode.closed.tolist())
            found.setdefault(closed, MetMode(closed, segment.begin))
    return list(found.values())


@dataclass(frozen=True, eq=False)
class OneMode:
    """The equations of one mode.

    Attributes
    ----------
    mode : {law name: what its mode is called}
    since : s, when the run first met it; None where no run was made
    equations : EquationsOfMotion
    """

    mode: Mapping[str, str]
    since: float | None
    equations: EquationsOfMotion

    @property
    def title(self) -> str:
        """Say which mode it is."""
        words: dict[str, list[str]] = {}
        for name, word in self.mode.items():
            words.setdefault(word, []).append(name)
        text = "; ".join(f"{_listed(names)} {word}" for word, names in words.items())
        return text if self.since is None else f"{text}, from t = {self.since:.6g} s"


@dataclass(frozen=True, eq=False)
class LawText:
    """One law in the coordinates of the scene with all laws open.

    Attributes
    ----------
    name : of the law
    kind : LawKind
    words : (closed, open): what its modes are called
    force : name of the force
    quantities : {"motion", "e", "slip", "stick", "mu", "normal": expression}, those that it has
    """

    name: str
    kind: LawKind
    words: tuple[str, str]
    force: sympy.Symbol
    quantities: Mapping[str, sympy.Expr]

    def write(self, notation: Notation, style: Style = UNICODE) -> str:
        """Return the law as a formula."""
        import sympy as sp

        formula = {n: notation.text(v, style) for n, v in self.quantities.items()}
        force, (at_least, perp, at_most) = notation.text(self.force, style), _signs(style)
        zero = style.number("0")
        if "e" in formula:
            named = "" if formula["e"] == "e" else f"e{style.equals}"
            rebound = f", {named}{formula['e']}" if self.quantities["e"] != 0 else ""
            return f"{zero} {at_most} {force}{perp}{formula['motion']} {at_least} {zero}{rebound}"
        if self.kind is LawKind.ONE_WAY:
            return f"{zero} {at_most} {force}{perp}{formula['motion']} {at_least} {zero}"
        own = {n: formula[n] for n in ("slip", "stick") if n in formula}
        if "mu" in formula:
            product = notation.text(self.quantities["mu"] * self.quantities["normal"], style)
            own = {"slip": product, "stick": product}
        motion = self.quantities["motion"]
        sliding = notation.text(-sp.sign(motion), style)
        limit = own["slip"] if self.quantities.get("slip", motion).is_Symbol else style.brackets(own["slip"])
        held, slides = (rf"\text{{{latex_text(w)}: }}" if style is LATEX else f"{w}: " for w in self.words)
        stuck = f"{held}{formula['motion']}{style.equals}{zero}, |{force}| {at_most} {own['stick']}"
        return f"{stuck}; {slides}{force}{style.equals}{sliding}{style.times}{limit}"


@dataclass(frozen=True, eq=False)
class EquationsOfModes:
    """The equations of motion of a scene with laws; print it, or ask for `latex`, `html`, `to_dict`.

    Attributes
    ----------
    name : of the model
    modes : tuple of OneMode
        Those that the default run meets, in this order; where a value is missing for a run, all of few laws.
    laws : tuple of LawText
    notation : Notation of the laws
    more : number of modes that were met beyond those
    """

    name: str
    modes: tuple[OneMode, ...]
    laws: tuple[LawText, ...]
    notation: Notation
    more: int = 0
    curves: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Return the coordinates of all modes."""
        return tuple(dict.fromkeys(q for m in self.modes for q in m.equations.coordinates))

    @property
    def equations(self) -> tuple:
        """Return the equations of all modes, one mode after the other."""
        return tuple(e for m in self.modes for e in m.equations.equations)

    def law_lines(self, style: Style = UNICODE) -> list[str]:
        """Return a line for each law."""
        return [f"{law.name}: {law.write(self.notation, style)}" for law in self.laws]

    def text(self, ascii: bool = False) -> str:
        """For a terminal: each mode with its equations, then the laws."""
        style = ASCII if ascii else UNICODE
        parts = [f"{m.title}\n\n{_indented(m.equations.text(ascii))}" for m in self.modes]
        parts += [f"… and {self.more} more modes"] if self.more else []
        laws = [*self.law_lines(style), *(["", curves_text(self.curves)] if self.curves else [])]
        laws += self.notation.legend(style)
        return "\n\n".join([*parts, f"laws\n\n{_indented(chr(10).join(laws))}"])

    def __str__(self) -> str:
        return self.text()

    def __repr__(self) -> str:
        return self.text()

    def latex(self) -> str:
        """An `align*` environment for each mode, and one for the laws."""
        parts = [f"\\paragraph{{{latex_text(m.title)}}}\n{_latex(m.equations)}" for m in self.modes]
        rows = " \\\\\n".join(f"  &{law.write(self.notation, LATEX)}" for law in self.laws)
        return "\n".join([*parts, f"\\paragraph{{Laws}}\n\\begin{{align*}}\n{rows}\n\\end{{align*}}"])

    def _repr_latex_(self) -> str:
        return self.latex()

    def html(self) -> str:
        """Each mode in MathML, then the laws, to be put into a page."""
        parts = [f"<h2>{escape(m.title)}</h2>\n{m.equations.html()}" for m in self.modes]
        laws = (f"<p><code>{escape(law.name)}</code>: {escape(law.write(self.notation))}</p>" for law in self.laws)
        curves = [f"<p>{escape(curves_text(self.curves))}</p>"] if self.curves else []
        return "\n".join([*parts, "<h2>Laws</h2>", *laws, *curves])

    def to_dict(self) -> dict:
        """For JSON: the modes with their equations, and the laws as text and LaTeX."""
        return {
            "model": self.name,
            "modes": [{"laws": dict(m.mode), "since": m.since, **m.equations.to_dict()} for m in self.modes],
            "more_modes": self.more,
            "laws": [
                {
                    "name": law.name,
                    "kind": law.kind.value,
                    "text": law.write(self.notation, ASCII),
                    "latex": law.write(self.notation, LATEX),
                    "force": str(law.force),
                    **{n: str(v) for n, v in law.quantities.items()},
                }
                for law in self.laws
            ],
            "curves": {name: over for name, (over, _) in self.curves.items()},
        }

    def about(self, equilibrium: Equilibrium, inputs: Mapping[str, object] | None = None) -> EquationsOfMotion:
        """Return the equations in deviations from an equilibrium, in the mode that it has.

        Raises
        ------
        ModelError
            E0663 that mode is not among these.
        """
        wanted = {} if equilibrium.laws is None else dict(equilibrium.laws.modes)
        for one in self.modes:
            if dict(one.mode) == wanted:
                return one.equations.about(equilibrium, inputs)
        mode = ", ".join(f"{name} {word}" for name, word in wanted.items())
        raise ModelError([Diagnostic("E0663", f"the run does not meet the mode of the equilibrium: {mode}")])


def equations_of_modes(
    scene: Lawful, modes: Sequence[MetMode] | None, forces: bool = False, solved: bool = False
) -> EquationsOfModes:
    """Return the equations of a scene with laws.

    Parameters
    ----------
    modes : those that a run has met; None for all of few laws, and otherwise that with all laws open
    forces, solved : as of `symbolic.equations.equations_of_motion`
    """
    if modes is None:
        modes = [MetMode(tuple(c)) for c in _all_modes(scene.count)]
    found = []
    for one in modes[:MOST_MODES]:
        closed = np.array(one.closed, bool)
        forward = scene.jenkins & ~closed & ~scene.complementary  # whose velocity follows from the rate of its force
        mode = scene.in_mode(closed, forward.astype(int))
        if forces or solved:
            equations = equations_of_motion(mode.reduced, mode.values, forces, solved)
        else:
            equations = equations_in_short(mode, partial(scene.release, mode.reduced))
        words = scene.words(closed)
        words |= {scene.names[k]: f"{words[scene.names[k]]} forward" for k in np.flatnonzero(forward).tolist()}
        found.append(OneMode(words, one.since, equations))
    laws, own_names = _laws(scene)
    symbols = [law.force for law in laws] + [v for law in laws for v in law.quantities.values()]
    late = list(dict.fromkeys(q for m in found for q in m.equations.coordinates))
    notation = Notation.of(*symbols, late=late, given=own_names)
    more, curves = max(0, len(modes) - MOST_MODES), named_curves(scene.flat).names(scene.prepared.reduced)
    return EquationsOfModes(scene.flat.name, tuple(found), laws, notation, more, curves)


def _all_modes(count: int) -> np.ndarray:
    """Return all modes of few laws; of many that in which all are open."""
    if 2**count > ALL_MODES:
        return np.zeros((1, count), bool)
    return (np.arange(2**count)[:, None] >> np.arange(count)) % 2 == 1


def _laws(scene: Lawful) -> tuple[tuple[LawText, ...], Mapping[str, str]]:
    """Return the laws in the coordinates of the free scene, and the user's own names for these."""
    import sympy as sp

    loose, form = scene.loose()
    columns: list[dict[str, int]] = []
    rows: list[tuple[Laws, int]] = []
    for g in scene.flat.laws:
        named = {"motion": g.motion, "e": g.restitution, "slip": g.slip, "stick": g.stick, "mu": g.friction}
        for row in range(g.rows):
            rows.append((g, row))
            columns.append({n: int(c[row]) for n, c in named.items() if c is not None})
    wanted = {f"{k} {n}": v for k, own in enumerate(columns) for n, v in own.items()}
    system = symbolic_system(loose.reduced, loose.values, wanted, named=True)
    rates = {system.states[v]: jet_symbol(system.states[q].name, 1) for q, v in system.coordinates if v >= 0}
    pushes = {sp.Symbol(loose.flat.variable_name(int(p))): f for p, f in zip(form.push, _forces(scene), strict=True)}
    pushes |= {jet_symbol(push.name, 1): jet_symbol(force.name, 1) for push, force in pushes.items()}
    found = []
    for k, ((g, row), name, force) in enumerate(zip(rows, scene.names, _forces(scene), strict=True)):
        own = {n: sp.sympify(system.variables[f"{k} {n}"]).xreplace(rates | pushes) for n in columns[k]}
        if g.normal is not None:
            own["normal"] = _forces(scene)[int(np.flatnonzero(scene.force == g.normal[row])[0])]
        words = mode_word(g, True), mode_word(g, False)
        found.append(LawText(name, g.kind, words, force, own))
    return tuple(found), system.own_names


def _forces(scene: Lawful) -> list[sympy.Symbol]:
    """Return a symbol for the force of each law."""
    import sympy as sp

    own = zip(scene.force_names, scene.names, strict=True)
    return [sp.Symbol(f"{name}.force" if force.startswith("force of ") else force) for force, name in own]


def _signs(style: Style) -> tuple[str, str, str]:
    """Return the signs for at least, complementary to, and at most."""
    if style is ASCII:
        return ">=", " complementary to ", "<="
    return (r"\ge", r" \perp ", r"\le") if style is LATEX else ("≥", " ⟂ ", "≤")


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:6]) + (f" … ({len(names)} in all)" if len(names) > 6 else "")


def _latex(equations: EquationsOfMotion) -> str:
    return equations.latex() if equations.equations else f"{NOTHING_MOVES[0].upper()}{NOTHING_MOVES[1:]}."


def _indented(text: str) -> str:
    return "\n".join(f"  {line}".rstrip() for line in text.splitlines())
