"""The syntax part of the catalogue of diagnostics."""

from __future__ import annotations

from lmoc.messages.diagnostics import Entry

_open = f"    {'(' * 63}\n" * 4

SYNTAX: dict[str, Entry] = {
    "E0101": Entry(
        "unexpected text",
        "The grammar does not allow this text here. The alternatives that are allowed are listed.",
        "model A\n  Real x;\nequation\n  if x > 0 x = 1;\n  end if;\nend A;",
    ),
    "E0102": Entry(
        "';' is missing",
        "Every declaration, equation, statement and class ends with ';'. The mark shows where it belongs, "
        "which often is the end of an earlier line.",
        "model A\n  Real x\n  Real y;\nequation\n  x = 1;\n  y = 2;\nend A;",
    ),
    "E0103": Entry(
        "a bracket is not closed, or not opened",
        "Every '(', '[' and '{' needs its partner.",
        "model A\n  Real x(start = 1;\nequation\n  x = 1;\nend A;",
    ),
    "E0104": Entry(
        "a string or a quoted name is not closed",
        "A string ends with '\"', a quoted name with \"'\". Inside, the same character is written with a backslash.",
        'model A "a model without an end quote\n  Real x;\nequation\n  x = 1;\nend A;',
    ),
    "E0105": Entry(
        "a comment is not closed",
        "'/*' begins a comment that ends with '*/'.",
        "model A\n  Real x; /* a comment\nequation\n  x = 1;\nend A;",
    ),
    "E0106": Entry(
        "a character that means nothing here",
        "Names consist of letters A-Z, a-z, digits and '_'. Other characters are allowed in strings, comments "
        "and names "
        "in single quotes.",
        "model A\n  Real x = 3 # 2;\nend A;",
    ),
    "E0107": Entry(
        "'=', ':=' and '==' confused",
        "An equation says that two sides are equal: '='. A statement in an algorithm gives a variable its value: ':='. "
        "A comparison that is true or false is '=='.",
        "model A\n  Real x;\nequation\n  x := 1;\nend A;",
    ),
    "E0108": Entry(
        "wrong name after 'end'",
        "A class that begins with 'model A' ends with 'end A;'.",
        "model A\n  Real x = 1;\nend B;",
    ),
    "E0109": Entry(
        "'end' is missing",
        "A class ends with 'end' and its name, an 'if', 'for', 'when' or 'while' with 'end' and the same word.",
        "model A\n  Real x;\nequation\n  if true then\n    x = 1;\n  else\n    x = 2;\nend A;",
    ),
    "E0110": Entry(
        "a keyword as a name",
        "The keywords of the language cannot be names. In single quotes they can: 'flow'. Nor can 'time',\n"
        "'Real', 'Integer', 'Boolean' and 'String', which mean the same everywhere.",
        "model A\n  Real flow = 1;\nend A;",
    ),
    "E0111": Entry(
        "an expression alone",
        "An equation has two sides, a statement a variable and its value. Only calls like 'assert(...)' stand alone.",
        "model A\n  Real x;\nequation\n  x + 1;\nend A;",
    ),
    "E0112": Entry(
        "a misspelled keyword",
        "The text is read as if the keyword were spelled correctly.",
        "modle A\n  Real x = 1;\nend A;",
    ),
    "E0113": Entry(
        "a misplaced prefix",
        "Prefixes occur in a fixed order (final, inner, outer, replaceable, flow, parameter or constant or discrete, "
        "input or output), each once; classes are 'partial', components are 'flow' or 'parameter'.",
        "model A\n  flow parameter parameter Real x = 1;\nend A;",
    ),
    "E0114": Entry(
        "operators that cannot be chained",
        "'a^b^c' and 'a < b < c' have no agreed meaning: parentheses or 'and' make the meaning clear.",
        "model A\n  Real x = 2^3^2;\nend A;",
    ),
    "E0115": Entry(
        "a sign directly after an operator",
        "A sign is allowed at the beginning of a sum only; elsewhere it needs parentheses.",
        "model A\n  Real x = 2 * -3;\nend A;",
    ),
    "E0116": Entry(
        "not part of lmo",
        "A construct of Modelica that lmo does not support.",
        'function f\n  input Real x;\n  output Real y;\nexternal "C";\nend f;',
    ),
    "E0117": Entry(
        "an operand is missing",
        "An operator, a bracket or a sign has no expression where it needs one.",
        "model A\n  Real x;\nequation\n  x = 2 + ;\nend A;",
    ),
    "E0118": Entry(
        "arguments in the wrong order",
        "In a call, arguments without names come before those with names, and each name is given once.",
        "model A\n  Real x = max(1, y = 2, 3);\nend A;",
    ),
    "E0125": Entry(
        "a unit behind a number",
        "A number has no unit: all are in SI units. The parameter or variable that it is given to has one, "
        "`parameter Real k(unit = \"N/m\")`; those of the library's parts have theirs.",
        "model A\n  Fixed wall;\n  Spring spring(k = 50 N/m);\nequation\n  connect(wall.flange, spring.a);\nend A;",
    ),
    "E0119": Entry(
        "an operator is missing",
        "Two expressions stand next to each other; a product is written with '*'.",
        "model A\n  Real x = 2 time;\nend A;",
    ),
    "E0120": Entry(
        "a declaration among equations",
        "Declarations come before the word 'equation' or 'algorithm'; after it, only below 'public' or 'protected'.",
        "model A\n  Real x;\nequation\n  x = 1;\n  Real y;\nend A;",
    ),
    "E0121": Entry(
        "an unknown escape in a string",
        "A backslash is followed by ', \", ?, \\, n, t, r, a, b, f or v.",
        'model A "\\d"\n  Real x = 1;\nend A;',
    ),
    "E0122": Entry(
        "'equation' is missing",
        "Equations follow the word 'equation', statements follow 'algorithm'.",
        "model A\n  Real x;\n  x = 1;\nend A;",
    ),
    "E0124": Entry(
        "a number too large",
        "Numbers are those of the machine: they go up to 1.8e308.",
        "model A\n  Real x = 1e309;\nend A;",
    ),
    "E0123": Entry(
        "nested too deeply",
        "Brackets, if-expressions, blocks and classes inside of each other, more than a hundred levels deep. The "
        "compiler has a limit, and such a text is unreadable.",
        f"model A\n  Real x =\n{_open}    1\n{_open.replace('(', ')')}    ;\nend A;",
    ),
}
