"""Arguments of the command: argparse, with mistakes reported as diagnostics."""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Callable, Sequence
from typing import NoReturn

from lmoc.messages.diagnostics import Diagnostic, ModelError, nearest
from lmoc.support.numbers import parsed_number
from lmoc.support.quoted import partition, split
from lmoc.support.records import dataclass

MOST_VALUES = 1000  # of a range


class UsageError(ModelError):
    """The command is wrong."""


class _Help(argparse.RawDescriptionHelpFormatter):
    """Help as wide as the terminal; argparse itself would import shutil for that, whenever an option is added."""

    def __init__(self, prog: str):
        super().__init__(prog, width=_columns() - 2)


def _columns() -> int:
    try:
        return int(os.environ["COLUMNS"])
    except (KeyError, ValueError):
        pass
    try:
        return os.get_terminal_size().columns or 80
    except OSError:  # no terminal
        return 80


class Parser(argparse.ArgumentParser):
    """An ArgumentParser that never exits and never abbreviates; names the nearest option for a typo."""

    def __init__(self, **settings):
        super().__init__(allow_abbrev=False, formatter_class=_Help, **settings)

    def understand(self, argv: Sequence[str]) -> argparse.Namespace:
        """The arguments.

        Raises
        ------
        UsageError
            E0620 unknown option or missing argument, E0621 a value of the wrong kind.
        """
        arguments, rest = self.parse_known_args(argv)
        if rest:
            options = [self._superfluous(word) for word in rest if word.startswith("-")]
            raise UsageError(options or [self._too_many(rest)])
        return arguments

    def error(self, message: str) -> NoReturn:
        option = re.match(r"argument (?:-\w[\w ]*/)?([^:]+): (.*)", message, re.DOTALL)
        options = self._unknown_options()
        if option:
            diagnostic = Diagnostic("E0621", f"{option[1].split()[0]}: {option[2]}", hint=options)
        else:
            diagnostic = Diagnostic("E0620", f"{self.prog}: {message}", hint=options or f"see `{self.prog} --help`")
        raise UsageError([diagnostic])

    def parse_known_args(self, args=None, namespace=None):
        self._given = list(args or ())
        return super().parse_known_args(args, namespace)

    def _unknown_options(self) -> str:
        """A hint for the first option given that does not exist: it may be why an argument seems to be missing."""
        words = [w.split("=")[0] for w in getattr(self, "_given", []) if re.match(r"--[a-z]", w)]
        return next((self._superfluous(w).hint for w in words if w not in self._option_string_actions), "")

    def _superfluous(self, word: str) -> Diagnostic:
        option = word.split("=")[0]
        known = [o for o in self._option_string_actions if o.startswith("--")]
        hint = nearest(option, known) or f"`{self.prog} --help` lists the options"
        return Diagnostic("E0620", f"{self.prog} has no option '{option}'", hint=hint)

    def _too_many(self, words: Sequence[str]) -> Diagnostic:
        message = f"{self.prog}: '{words[0]}' is one argument too many"
        return Diagnostic("E0620", message, hint=f"see `{self.prog} --help`")


def add_model_arguments(parser: Parser, ranges: bool = False) -> None:
    """FILE, --model and --set, which most verbs share.

    Parameters
    ----------
    ranges : whether --set may give several values, as k=10:10:50
    """
    parser.add_argument("file", metavar="FILE", help="the scene, a .lmo file; or the name of a class in a folder")
    parser.add_argument("--model", metavar="NAME", help="which model, where the file holds several")
    parser.add_argument(
        "--path", metavar="DIR", action="append", default=[],
        help="folder in which classes are looked for, after that of FILE; may be repeated",
    )  # fmt: skip
    kind = assignment(value_or_range if ranges else value)
    parser.add_argument(
        "--set", metavar="NAME=VALUE", type=kind, action="append", default=[],
        help="value of a parameter; may be repeated" + (". Several values, as k=10:10:50, are run one by one" * ranges),
    )  # fmt: skip


def add_budget_argument(parser: Parser) -> None:
    """--budget, of all verbs."""
    parser.add_argument(
        "--budget", metavar="SECONDS", type=positive, help="end where nothing moves on for so long (30)"
    )  # fmt: skip


def add_states_argument(parser: Parser) -> None:
    """--states, of the verbs for which it matters what is solved."""
    parser.add_argument(
        "--states", metavar="NAME,…", help="coordinates to prefer, separated by commas", default=None,
        type=lambda text: [name.strip() for name in split(text, ",") if name.strip()],
    )  # fmt: skip


def add_run_arguments(parser: Parser) -> None:
    """Span, output times, start and signals of a run."""
    add = parser.add_argument
    add("--start", type=number, metavar="S", help="start time (experiment, else 0)")
    add("--stop", type=number, metavar="S", help="stop time (experiment, else 10)")
    add("--points", type=count, metavar="N", help="number of output times (experiment, else 501)")
    add("--init", type=_start, metavar="NAME=VALUE", action="append", default=[],
        help="fix a variable at the start; may be repeated. Or 'equilibrium': start at rest")  # fmt: skip
    add("--input", type=assignment(str), metavar="U=SIGNAL", action="append", default=[],
        help="a formula in time, as u='0.1*sin(5*time)', or a table, as u=road.csv; may be repeated")  # fmt: skip


def _start(text: str) -> str | tuple[str, object]:
    return text if text.strip() == "equilibrium" else assignment(number)(text)


def initial(given: list) -> str | dict[str, float]:
    """Return the start that --init gives: the equilibrium, or the values fixed by name."""
    if "equilibrium" in given:
        if len(given) > 1:
            raise UsageError([Diagnostic("E0620", "--init equilibrium and --init name=value exclude each other")])
        return "equilibrium"
    return dict(given)


def number(text: str) -> float:
    try:
        result = parsed_number(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a number") from None
    if not math.isfinite(result):
        raise argparse.ArgumentTypeError(f"'{text}' is not a finite number")
    return result


def positive(text: str) -> float:
    result = number(text)
    if result <= 0:
        raise argparse.ArgumentTypeError(f"expected a number above zero, found {text}")
    return result


def count(text: str) -> int:
    return _whole_number(text, 2)


def ordinal(text: str) -> int:
    return _whole_number(text, 1)


def _whole_number(text: str, least: int) -> int:
    try:
        result = int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number") from None
    if result < least:
        raise argparse.ArgumentTypeError(f"expected at least {least}, found {text}")
    return result


def value(text: str) -> float | bool | list[float]:
    """A number, ``true`` or ``false``, or a list of numbers ``{1, 2, 3}``."""
    if text in ("true", "false"):
        return text == "true"
    if text.startswith("{") and text.endswith("}"):
        return [number(item.strip()) for item in text[1:-1].split(",")]
    if ":" in text:
        raise argparse.ArgumentTypeError(f"expected one value, found '{text}'; only `lmoc run` takes several")
    return number(text)


@dataclass(frozen=True)
class Range:
    """Several values of a parameter."""

    values: tuple[float, ...]


def value_or_range(text: str) -> float | bool | list[float] | Range:
    """A `value`, or ``first:step:last``, or ``first:last`` in steps of 1."""
    if ":" not in text:
        return value(text)
    parts = [number(item.strip()) for item in text.split(":")]
    if len(parts) not in (2, 3):
        raise argparse.ArgumentTypeError(f"expected first:step:last, found '{text}'")
    first, last, step = parts[0], parts[-1], parts[1] if len(parts) == 3 else 1.0
    if step == 0 or (last - first) / step < 0:
        raise argparse.ArgumentTypeError(f"steps of {step:g} do not lead from {first:g} to {last:g}")
    steps = math.floor((last - first) / step * (1 + 1e-12) + 1e-9)
    if steps >= MOST_VALUES:
        raise argparse.ArgumentTypeError(f"'{text}' has more than {MOST_VALUES} values")
    return Range(tuple(first + k * step for k in range(steps + 1)))


def assignment(kind: Callable[[str], object]) -> Callable[[str], tuple[str, object]]:
    """The type of ``name=value``."""

    def convert(text: str) -> tuple[str, object]:
        name, equals, right = (part.strip() for part in partition(text, "="))
        if not (name and equals and right):
            raise argparse.ArgumentTypeError(f"expected name=value, found '{text}'")
        try:
            return name, kind(right)
        except argparse.ArgumentTypeError as error:
            raise argparse.ArgumentTypeError(f"{name}: {error}") from None

    return convert


def choice(names: Sequence[str], hint: Callable[[str], str] | None = None) -> Callable[[str], str]:
    """The type of a word out of a list."""

    def convert(text: str) -> str:
        if text not in names:
            message = f"expected one of {', '.join(names)}; found '{text}'"
            near = hint(text) if hint is not None else nearest(text, names)
            raise argparse.ArgumentTypeError("; ".join(filter(None, [message, near])))
        return text

    return convert
