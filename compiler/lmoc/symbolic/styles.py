"""Styles of the pieces of a formula: for the terminal, in plain ASCII, as LaTeX, as MathML."""

from __future__ import annotations

import re
from unicodedata import normalize

_LETTERS = "alpha beta gamma delta epsilon zeta eta theta kappa lambda mu nu xi pi rho sigma tau phi chi psi omega"
GREEK = dict(zip(_LETTERS.split(), "αβγδεζηθκλμνξπρστφχψω", strict=True))
_SUPERSCRIPT = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_PLAIN = re.compile(r"[\w.,\[\]δ]+")
_LATEX_SIGNS = {sign: f"\\{sign}" for sign in "_{}$%#&"} | {
    "\\": r"\textbackslash{}",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "`": r"\textasciigrave{}",
    '"': r"\textquotedbl{}",
}
_ACCENTS = {1: "\u0307", 2: "\u0308", 3: "\u20db", 4: "\u20dc"}
_LATEX_ACCENTS = {1: r"\dot", 2: r"\ddot", 3: r"\dddot", 4: r"\ddddot"}
_DOTS = {1: "˙", 2: "¨", 3: "⃛", 4: "⃜"}


def unit_text(unit: str) -> str:
    """``N.m/rad`` as ``N·m/rad``, ``m/s2`` as ``m/s²``."""
    return unit.replace(".", "·").translate(str.maketrans("23456", "²³⁴⁵⁶"))


def split_name(name: str) -> tuple[str, str, str, str]:
    """``δtheta1`` → (``δ``, ``theta``, ``1``, no word); ``q_left`` → (no δ, ``q``, no number, ``left``)."""
    delta, rest = ("δ", name[1:]) if name.startswith("δ") else ("", name)
    found = re.match(r"^([A-Za-z]+?)_?((?:\d+_)*\d*)$", rest)
    if found:
        return delta, found.group(1), found.group(2).replace("_", ","), ""
    word, underscore, index = rest.partition("_")
    return (delta, word, "", index) if underscore and word.isalpha() else (delta, rest, "", "")


def _lettered(index: str) -> tuple[str, str]:
    """``theta1`` → (``theta``, ``1``), if it is a Greek letter's name."""
    found = re.fullmatch(r"([a-z]+?)(\d*)", index)
    return found.groups() if found and found[1] in GREEK else ("", "")


def _greek(index: str) -> str:
    """``theta1`` → ``θ1``; other words as they are."""
    letter, digits = _lettered(index)
    return GREEK[letter] + digits if letter else index


def _latex_index(index: str) -> str:
    letter, digits = _lettered(index)
    return f"\\{letter}" + (f"_{{{digits}}}" if digits else "") if letter else _latex_word(index, "mathrm")


def _latex_word(word: str, font: str) -> str:
    """Return a word within a formula; one of other characters than those of plain names is a text in it."""
    return rf"\{font if _PLAIN.fullmatch(word) else 'text'}{{{latex_text(word)}}}"


def latex_text(text: str) -> str:
    """Return a text as it is written in LaTeX: nothing in it is a command, a comment, or the end of a formula."""
    return "".join(_LATEX_SIGNS.get(sign, sign if sign.isprintable() else "·") for sign in text)


def markup(text: str) -> str:
    """Return a text as it is written in HTML."""
    from html import escape  # its table of entities takes 2 ms, and units are on the way of every run

    return escape(text)


class Ascii:
    """Plain text that can be typed: ``m*q'' + k*q = f``."""

    times, plus, minus, sign, equals = "*", " + ", " - ", "-", " = "
    applied = " "  # between an operator and what it acts on

    def symbol(self, name: str, order: int) -> str:
        return name.replace("δ", "delta_", 1) + "'" * order

    def number(self, text: str) -> str:
        return text

    def power(self, base: str, exponent: str) -> str:
        return f"{base}^{exponent}" if re.fullmatch(r"\w+", exponent) else f"{base}^({exponent})"

    def fraction(self, top: str, bottom: str, simple: bool) -> str:
        return f"{top}/{bottom}" if simple else f"{top}/({bottom})"

    fills = False  # fractions make brackets around a sum superfluous

    def term(self, text: str) -> str:
        """Mark a term of an equation, without its sign."""
        return text

    def brackets(self, text: str) -> str:
        return f"({text})"

    def root(self, text: str) -> str:
        return f"sqrt({text})"

    def odd_root(self, text: str, order: str) -> str:
        """The real root of any sign."""
        return f"cbrt({text})" if order == "3" else f"root{order}({text})"

    def function(self, name: str) -> str:
        return name

    def constant(self, name: str) -> str:
        return name

    def words(self, text: str) -> str:
        return text

    def cases(self, parts: list[tuple[str, str]]) -> str:
        """(value, condition) in order; the last condition may be empty: otherwise."""
        return "{" + "; ".join(f"{v} if {c}" if c else f"{v} otherwise" for v, c in parts) + "}"


class Unicode(Ascii):
    """For a terminal: ``m·q̈ + k·q = f``."""

    times = "·"

    def symbol(self, name: str, order: int) -> str:
        delta, word, digits, index = split_name(name)
        letter = GREEK.get(word, word)
        tail = digits + (f"_{_greek(index)}" if index else "")
        if order and (len(letter) > 1 or order > 4):
            return f"{delta}{letter}{tail}" + "'" * order
        return delta + normalize("NFC", letter + _ACCENTS.get(order, "")) + tail

    def power(self, base: str, exponent: str) -> str:
        if re.fullmatch(r"-?\d+", exponent):
            return base + exponent.translate(_SUPERSCRIPT)
        return super().power(base, exponent)

    def odd_root(self, text: str, order: str) -> str:
        return f"∛({text})" if order == "3" else super().odd_root(text, order)

    def constant(self, name: str) -> str:
        return {"pi": "π"}.get(name, name)


class Latex(Ascii):
    r"""``m \, \ddot{q} + k \, q = f``."""

    times, applied, fills = r" \, ", r" \, ", True

    def symbol(self, name: str, order: int) -> str:
        delta, word, digits, index = split_name(name)
        if word in GREEK:
            letter = "\\" + word
        else:
            letter = word if len(word) == 1 else _latex_word(word, "mathit")
        if order:
            letter = f"{_LATEX_ACCENTS[order]}{{{letter}}}" if order <= 4 else rf"{letter}^{{({order})}}"
        below = _latex_index(index) if index else digits
        return (r"\delta " if delta else "") + letter + (f"_{{{below}}}" if below else "")

    def power(self, base: str, exponent: str) -> str:
        return f"{base}^{{{exponent}}}"

    def fraction(self, top: str, bottom: str, simple: bool) -> str:
        return rf"\frac{{{top}}}{{{bottom}}}"

    def brackets(self, text: str) -> str:
        return rf"\left({text}\right)"

    def root(self, text: str) -> str:
        return rf"\sqrt{{{text}}}"

    def odd_root(self, text: str, order: str) -> str:
        return rf"\sqrt[{order}]{{{text}}}"

    def function(self, name: str) -> str:
        known = "sin cos tan sinh cosh tanh exp log arcsin arccos arctan".split()
        name = {"asin": "arcsin", "acos": "arccos", "atan": "arctan", "ln": "log"}.get(name, name)
        return "\\" + name if name in known else rf"\operatorname{{{name}}}"

    def constant(self, name: str) -> str:
        return {"pi": r"\pi"}.get(name, name)

    def words(self, text: str) -> str:
        return rf"\text{{{latex_text(text)}}}"

    def cases(self, parts: list[tuple[str, str]]) -> str:
        rows = [rf"{v} & {c}" if c else rf"{v} & \text{{otherwise}}" for v, c in parts]
        return r"\begin{cases} " + r" \\ ".join(rows) + r" \end{cases}"


class MathML(Ascii):
    """For a page: presentation MathML, which browsers show without any script."""

    times = "<mo>&#x2062;</mo>"
    applied = "<mo>&#x2061;</mo>"
    plus, minus, sign, equals = "<mo>+</mo>", "<mo>−</mo>", "<mo form='prefix'>−</mo>", "<mo>=</mo>"
    fills = True

    def term(self, text: str) -> str:
        return f"<mrow class='term'>{text}</mrow>"

    def symbol(self, name: str, order: int) -> str:
        delta, word, digits, index = split_name(name)
        letter = f"<mi>{markup(GREEK.get(word, word))}</mi>"
        if order:
            dots = _DOTS.get(order, f"({order})")
            letter = f"<mover accent='true'>{letter}<mo>{dots}</mo></mover>"
        if digits or index:
            below = f"<mn>{digits}</mn>" if digits else f"<mi mathvariant='normal'>{markup(_greek(index))}</mi>"
            letter = f"<msub>{letter}{below}</msub>"
        return ("<mi>δ</mi>" if delta else "") + letter

    def number(self, text: str) -> str:
        return f"<mn>{text}</mn>"

    def power(self, base: str, exponent: str) -> str:
        return f"<msup><mrow>{base}</mrow><mrow>{exponent}</mrow></msup>"

    def fraction(self, top: str, bottom: str, simple: bool) -> str:
        return f"<mfrac><mrow>{top}</mrow><mrow>{bottom}</mrow></mfrac>"

    def brackets(self, text: str) -> str:
        return f"<mrow><mo>(</mo>{text}<mo>)</mo></mrow>"

    def root(self, text: str) -> str:
        return f"<msqrt>{text}</msqrt>"

    def odd_root(self, text: str, order: str) -> str:
        return f"<mroot><mrow>{text}</mrow>{order}</mroot>"

    def function(self, name: str) -> str:
        return f"<mi>{name}</mi>"

    def constant(self, name: str) -> str:
        return f"<mi>{ {'pi': 'π'}.get(name, name) }</mi>"

    def words(self, text: str) -> str:
        return f"<mtext>{markup(text)}</mtext>"

    def cases(self, parts: list[tuple[str, str]]) -> str:
        cells = [f"<mtr><mtd>{v}</mtd><mtd>{c or '<mtext>otherwise</mtext>'}</mtd></mtr>" for v, c in parts]
        return f"<mrow><mo>{{</mo><mtable columnalign='left'>{''.join(cells)}</mtable></mrow>"


Style = Ascii
ASCII, UNICODE, LATEX, MATHML = Ascii(), Unicode(), Latex(), MathML()
