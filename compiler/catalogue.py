"""The catalogue of diagnostics: what each code means, with an example and the way out.

``lmoc explain E0312`` prints a page of it. Ranges: 01xx syntax; 02xx lookup, classes, modification; 03xx types, units,
connections; 04xx structure; 05xx initialization, inputs, running; 06xx files, commands, choice of model.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Entry:
    """A page of the catalogue."""

    title: str
    explanation: str


CATALOGUE: dict[str, Entry] = {
    # ------------------------------------------------------------------ 06xx: files, commands, choice of model
    "E0610": Entry(
        "file not found",
        "There is no file of that name. Paths are relative to the folder in which the command is run.",
    ),
    "E0611": Entry(
        "file cannot be read",
        "The path is a folder, or the file may not be read by this user. A scene is one text file, usually `*.lmo`.",
    ),
    "E0612": Entry(
        "not a text file",
        "A model is text in UTF-8. The file holds bytes that are not: it may be binary, or saved in another encoding\n"
        "(in an editor: save with encoding UTF-8).",
    ),
    "E0620": Entry(
        "the command is not understood",
        "The verb or an option does not exist, or an argument is missing. `lmoc --help` lists the verbs,\n"
        "`lmoc VERB --help` the options of one.",
    ),
    "E0621": Entry(
        "the value of an option is not usable",
        "The option wants another kind of value: a number, a positive number, a pair `name=value`.\n"
        "Example: `lmoc run scene.lmo --stop 5 --set body.m=2.5`.",
    ),
    "E0622": Entry(
        "no such parameter, variable or input",
        "A name given on the command line or to `simulate` is not in the model. Names are dotted paths of the flat\n"
        "model: `body.m`, `spring[3].k`. `lmoc show --stage flatten` lists them.",
    ),
    "E0623": Entry(
        "the result cannot be written",
        "The folder does not exist or may not be written to, or a package that writes this format is missing.",
    ),
    "E0624": Entry(
        "unknown type of file",
        "The ending of the name decides about the format. Results: .csv, .npz, .parquet, .mat.\n"
        "Pictures: .png, .svg, .pdf.",
    ),
    "E0625": Entry(
        "the table cannot be used",
        "A table for an input is a CSV file with a header line. One column is named `time`, another like the input\n"
        "(or there is just one other column). All entries are numbers and time increases.",
    ),
    "E0626": Entry(
        "not available",
        "The option exists in the design of lmoc, but the value asked for is not in this version.",
    ),
}
