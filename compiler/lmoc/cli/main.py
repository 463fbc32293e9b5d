"""The command `lmoc`: finds the verb, understands the arguments, and turns every outcome into words and an exit code.

Exit codes: 0 done, 1 the model is wrong, 2 the command is wrong (or its output cannot be written), 3 the run failed,
70 the compiler itself failed, 130 and 143 interrupted and terminated.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib import import_module

from lmoc.cli import process, terminal
from lmoc.cli.arguments import Parser, UsageError, add_budget_argument
from lmoc.messages.budgeted import told
from lmoc.messages.diagnostics import Diagnostic, ModelError, SimulationError, nearest
from lmoc.messages.requests import is_of_the_command
from lmoc.support.budget import allowed, budget

DONE, WRONG_MODEL, WRONG_COMMAND, FAILED_RUN, INTERNAL = 0, 1, 2, 3, 70

# verb → what it does; each is a module of this package with `configure(parser)` and `execute(arguments) -> exit code`
VERBS = {
    "new": "write a scene to start from",
    "run": "simulate a scene",
    "check": "look for mistakes, up to a consistent start",
    "show": "print what a stage of the compiler has made of a scene",
    "equations": "derive the equations of motion",
    "equilibria": "find the states of rest and their stability",
    "linearize": "linear state-space model with its modes",
    "transfer": "transfer function from an input to an output",
    "equivalent": "equivalent stiffness, damping and inertia between two ports",
    "compare": "run several scenes and compare them: differences, curves over each other",
    "study": "many runs with random numbers",
    "fit": "fit parameters to measured data",
    "chart": "speed against accuracy of methods and tolerances",
    "solvers": "the methods of integration and their properties",
    "draw": "draw a scene",
    "export": "write a scene as an FMU for other tools",
    "view": "write a page in which the scene moves and can be played with",
    "fmt": "put a file into the standard layout",
    "explain": "what a diagnostic code means",
    "lsp": "speak with an editor (Language Server Protocol)",
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command with the given arguments (default: those of the process); returns the exit code."""
    process.prepare()
    try:
        with process.shown():
            return _outcome(list(sys.argv[1:] if argv is None else argv))
    except BrokenPipeError:  # the reader of a pipe has seen enough
        process.give_up_output()
        return DONE
    except OSError as error:
        if not process.is_lost_output(error):
            raise
        process.give_up_output()
        terminal.failure(f"standard output cannot be written: {error.strerror}")
        return WRONG_COMMAND


def _outcome(argv: list[str]) -> int:
    try:
        code = _dispatch(argv)
        sys.stdout.flush()
        return code
    except ModelError as error:
        terminal.show(error.diagnostics)
        return exit_code(error)
    except SimulationError as error:
        terminal.failure(str(error))
        return FAILED_RUN
    except KeyboardInterrupt:
        return _interrupted()
    except Exception as error:
        if isinstance(error, BrokenPipeError) or isinstance(error, OSError) and process.is_lost_output(error):
            raise
        if process.came_from_interruption(error):
            return _interrupted()
        terminal.internal_error(error)
        return INTERNAL


def _interrupted() -> int:
    terminal.failure("interrupted")
    return process.interruption_code()


def exit_code(error: ModelError) -> int:
    """2 where everything wrong is about files, options and the choice of the model, else 1."""
    wrong = [d for d in error.diagnostics if d.severity == "error"]
    return WRONG_COMMAND if all(map(is_of_the_command, wrong)) else WRONG_MODEL


def _dispatch(argv: list[str]) -> int:
    if not argv or argv[0] in ("-h", "--help", "help"):
        print(_overview())
        return DONE
    if argv[0] in ("--version", "-V"):
        from lmoc.support.version import __version__

        print(f"lmoc {__version__}")
        return DONE
    verb = argv[0]
    if verb not in VERBS:
        raise UsageError([_unknown_verb(verb)])
    module = import_module(f"lmoc.cli.{verb}")
    parser = Parser(prog=f"lmoc {verb}", description=VERBS[verb].capitalize() + ".")
    module.configure(parser)
    add_budget_argument(parser)
    arguments = parser.understand(argv[1:])
    with budget(arguments.budget or allowed()):
        return told(f"lmoc {verb}", lambda: module.execute(arguments))


def _overview() -> str:
    verbs = "\n".join(f"  {verb:<12}{text}" for verb, text in VERBS.items())
    return (
        "usage: lmoc VERB FILE [options]\n\nFrom a mechanical scene to its equations and its motion.\n\n"
        f"verbs:\n{verbs}\n\n`lmoc VERB --help` lists the options of a verb, `lmoc --version` prints the version.\n"
        "A first step: lmoc new quarter_car, then lmoc run quarter_car.lmo"
    )


def _unknown_verb(word: str) -> Diagnostic:
    if word.startswith("-"):
        hint = f"put the verb first: lmoc run FILE {word} …"
    elif word.endswith(".lmo") or os.path.exists(word):
        hint = f"to simulate it: lmoc run {word}"
    else:
        hint = nearest(word, VERBS)
    return Diagnostic("E0620", f"'{word}' is not a verb of lmoc", expected=", ".join(VERBS), hint=hint)
