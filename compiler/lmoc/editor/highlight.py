"""The lexer of Pygments for `lmo`: colours in Sphinx, Jupyter, LaTeX and the terminal."""

from __future__ import annotations

from pygments.lexer import RegexLexer, bygroups, words
from pygments.token import Comment, Keyword, Name, Number, Operator, Punctuation, String, Text

CLASSES = ("block", "class", "connector", "function", "model", "operator", "package", "record", "type", "enumeration")
PREFIXES = (
    "constant", "discrete", "each", "encapsulated", "expandable", "final", "flow", "impure", "inner", "input", "outer",
    "output", "parameter", "partial", "protected", "public", "pure", "redeclare", "replaceable", "stream",
)  # fmt: skip
CONTROL = (
    "algorithm", "annotation", "break", "connect", "constrainedby", "else", "elseif", "elsewhen", "end", "equation",
    "extends", "external", "for", "if", "import", "in", "initial", "loop", "return", "then", "when", "while", "within",
)  # fmt: skip
WORD_OPERATORS = ("and", "not", "or")
CONSTANTS = ("true", "false")
TYPES = ("Real", "Integer", "Boolean", "String", "StateSelect", "AssertionLevel")
FUNCTIONS = (
    "abs", "acos", "acosh", "array", "asin", "asinh", "assert", "atan", "atan2", "atanh", "cardinality", "cat", "ceil",
    "change", "cos", "cosh", "cross", "delay", "der", "diagonal", "div", "edge", "exp", "fill", "floor",
    "getInstanceName", "homotopy", "identity", "integer", "linspace", "log", "log10", "matrix", "max", "min", "mod",
    "ndims", "noEvent", "ones", "outerProduct", "pre", "product", "reinit", "rem", "rooted", "sample", "scalar",
    "semiLinear", "sign", "sin", "sinh", "size", "skew", "smooth", "spatialDistribution", "sqrt", "sum", "symmetric",
    "tan", "tanh", "terminal", "terminate", "time", "transpose", "vector", "zeros",
)  # fmt: skip
_NAME = r"(?:[^\W\d]\w*|'(?:[^'\\\n]|\\.)+')"


class LmoLexer(RegexLexer):
    """For scenes in `lmo`, and for the part of Modelica that it shares."""

    name = "lmo"
    aliases = ["lmo"]
    filenames = ["*.lmo"]
    mimetypes = ["text/x-lmo"]
    url = "https://pypi.org/project/lmoc/"
    version_added = ""

    tokens = {
        "root": [
            (r"\s+", Text.Whitespace),
            (r"//[^\n]*", Comment.Single),
            (r"/\*", Comment.Multiline, "comment"),
            (r'"', String, "string"),
            (rf"\b(end)(\s+)({_NAME})", bygroups(Keyword, Text.Whitespace, Name.Class)),
            (
                rf"\b({'|'.join(c for c in CLASSES if c not in ('operator', 'enumeration'))})(\s+)({_NAME})",
                bygroups(Keyword.Declaration, Text.Whitespace, Name.Class),
            ),
            (words(CLASSES, r"\b", r"\b"), Keyword.Declaration),
            (words(PREFIXES, r"\b", r"\b"), Keyword),
            (words(CONTROL, r"\b", r"\b"), Keyword),
            (words(WORD_OPERATORS, r"\b", r"\b"), Operator.Word),
            (words(CONSTANTS, r"\b", r"\b"), Keyword.Constant),
            (words(TYPES, r"\b", r"\b"), Keyword.Type),
            (words(FUNCTIONS, r"\b", r"\b(?=\s*\()"), Name.Builtin),
            (r"\btime\b", Name.Builtin),
            (r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", Number),
            (_NAME, Name),
            (r":=|==|<>|<=|>=|\.[-+*/^]|[-+*/^<>=:]", Operator),
            (r"[()\[\]{},;.]", Punctuation),
        ],
        "comment": [(r"\*/", Comment.Multiline, "#pop"), (r"[^*]+|\*", Comment.Multiline)],
        "string": [(r'"', String, "#pop"), (r"\\.", String.Escape), (r'[^"\\]+', String)],
    }
