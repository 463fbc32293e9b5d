"""The operations of a tape and their numbers, in the order of ``engine/c/tape.h``."""

from __future__ import annotations

UNARY = tuple(
    "move neg sqrt sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh exp log log10 abs sign floor ceil "
    "integer not".split()
)
BINARY = tuple("add sub mul div pow atan2 min max mod rem div_integer xor lt le gt ge eq ne and or".split())
OTHER = tuple(
    "if dot rows gather strided scatter spread products fill linear newton correct ready constant implicit "
    "factor".split()
)
OPERATIONS = ("end", *UNARY, *BINARY, *OTHER)
NUMBER = {name: k for k, name in enumerate(OPERATIONS)}

# Length of an instruction with its number; of those that are not listed it stands in the instruction.
LENGTH = (
    dict.fromkeys(UNARY, 3)
    | dict.fromkeys(BINARY, 4)
    | {"end": 1, "if": 5, "products": 6, "fill": 4, "correct": 3, "ready": 3}
    | dict.fromkeys(("linear", "newton", "constant", "implicit", "factor"), 2)
)
# The same inside of `rows`, where each operand is a place and a flag; what is done to blocks has its length with it.
LENGTH_OF_ROWS = (
    dict.fromkeys(UNARY, 5)
    | dict.fromkeys(BINARY, 7)
    | {"if": 9, "gather": 4, "strided": 5, "scatter": 4, "spread": 5}
)
