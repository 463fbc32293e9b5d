"""The catalogue of diagnostics: the meaning of each code.

Codes: 01xx syntax, 02xx names, classes and modifications, 03xx types, units and connections, 04xx structure,
05xx start, inputs and running, 06xx files and commands. The letter is the severity: Error, Warning, Note. Each room
that issues diagnostics has a file of its entries here.

``lmoc explain E0312`` prints an entry, ``docs/make_diagnostics.py`` writes them all into a page.
"""

from __future__ import annotations

from lmoc.messages.catalogue.numerics import NUMERICS
from lmoc.messages.catalogue.semantics import SEMANTICS
from lmoc.messages.catalogue.structure import STRUCTURE
from lmoc.messages.catalogue.syntax import SYNTAX
from lmoc.messages.diagnostics import Entry

CATALOGUE: dict[str, Entry] = {
    **SYNTAX,
    **SEMANTICS,
    **STRUCTURE,
    **NUMERICS,
    # -------------------------------------------------- 06xx files, commands
    "E0601": Entry(
        "no such model", "The requested model is not in the file, or it is not a class that can be simulated."
    ),
    "E0602": Entry("nothing to run", "The file defines no model, or only partial ones."),
    "E0603": Entry(
        "several models",
        "More than one model in the file is used by no other. Select one: `--model NAME`, or\n`model=` in Python.",
    ),
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
        "The file name extension determines the format. Results: .csv, .npz, .parquet, .mat.\n"
        "Pictures: .png, .svg, .pdf.",
    ),
    "E0625": Entry(
        "the table cannot be used",
        "A table for an input is a text file with a header line. One column is named `time`, another like the input\n"
        "(or there is just one other column). All entries are numbers and time increases; a time that occurs in two\n"
        "lines is a jump. Between two points the input lies between their values.\n\n"
        "Columns are separated by commas, semicolons, tabs or blanks, decimals by a point or, where commas do not\n"
        "separate columns, by a comma. A number that can be read in two ways (`1,234` where nothing else says whether\n"
        "that is a comma before decimals or between thousands) is refused. Units stand behind names, `u [mm]`, or in\n"
        "the line below them, and are converted (N0527).",
    ),
    "E0629": Entry(
        "not a unit for results",
        "`--units` and `units=` take units of length, angle, speed, force and the like, one for each quantity,\n"
        "such as `mm,deg,rpm`. They change what is printed and drawn; files keep SI units.",
    ),
    "E0626": Entry(
        "formulation not available",
        "The closed loops of a mechanism can be integrated in several formulations (docs/formulations.md). Closures "
        "among the\n"
        "equations need an implicit solver, `ida`; projection needs a method that goes on from a moved state without\n"
        "loss. Scenes with laws or events are run in minimal coordinates, `reduced`.",
    ),
    # ------------------------------------------------- 066x what a person reads
    "E0660": Entry(
        "no symbolic result",
        "Equations of motion, equilibria and transfer functions are available in symbolic form for scenes of up "
        "to a few hundred equations whose implicit parts have a solution in closed form, and equations of motion and "
        "linear models about a state of rest also for closed loops. Other scenes have the numeric form.",
    ),
    "E0661": Entry(
        "no such input, output or variable",
        "Linear models and transfer functions go from a top-level input to a variable of the flat model.",
    ),
    "E0664": Entry(
        "a package for editors is missing",
        "`lmoc lsp` speaks with editors by means of pygls, which comes with `pip install 'lmoc[editor]'`.",
    ),
    "E0665": Entry(
        "the check of a text in an editor has failed",
        "Texts are checked in a process beside the editor. It has ended, or lmoc itself failed in it. The next change\n"
        "of the text starts it anew; `lmoc check FILE` shows the same text outside of the editor.",
    ),
    "W0666": Entry(
        "the check of a text in an editor takes too long",
        "An editor waits 30 s for the check of a model. `lmoc check FILE` goes on and shows how far it is.",
    ),
    "E0667": Entry(
        "the store of a study cannot be used",
        "A study keeps what is done in a folder, with digests of the model, the values and the options. The folder\n"
        "holds the runs of another study, or a file in it is damaged; or the study has values, such as functions of\n"
        "Python, of which it cannot be told whether they are the same next time.",
    ),
    "E0668": Entry(
        "data and model do not go together",
        "A fit needs columns over `time` that are called as variables of the model, or are told which they belong to\n"
        "(`outputs={'column': 'variable'}`, `--outputs column=variable`), more numbers than unknowns, and for each\n"
        "unknown a value to begin at, within its bounds.",
    ),
    "E0669": Entry(
        "a scene that cannot be an FMU",
        "FMUs are made of masses, springs, gears, mechanisms, blocks, inputs, of laws that switch (stops, ropes,\n"
        "friction, contacts), and of what happens at instants: `when`, relations, samples, assertions. Mechanisms\n"
        "whose coordinates change along the motion while something moves their closed loops from outside cannot be\n"
        "exported yet (docs/fmi.md).",
    ),
    "N0670": Entry(
        "models of a text are still being checked in an editor",
        "What has been found so far is shown. Of a file with many models those that have changed last are checked\n"
        "first, and all of them in the end; then this note goes away.",
    ),
    "E0663": Entry(
        "no single equilibrium",
        "A nonlinear scene is linearized about a point. By default that is its only equilibrium; where there "
        "are several "
        "or none, select the point: `--equilibrium N` of those that `lmoc equilibria` lists, `--at name=value`, or "
        "`--at TIME`. A quantity may have no derivative at a point: the extension of each of two cubic springs in "
        "series where both are relaxed.",
    ),
    "E0662": Entry(
        "a parameter without a value",
        "Numbers (poles, eigenvalues, a numeric linear model) need a value for every parameter that occurs. The value\n"
        "of a formula that is not a number, such as 0/0 or the root of a negative number, is none.",
    ),
    "N0630": Entry(
        "flattened again",
        "A parameter given to this run determines the structure of the model (the length of an array), or changes a\n"
        "condition that does (`if mu > 0`), so the scene has been flattened and reduced again. The result is kept for\n"
        "further runs with the same value.",
    ),
    "N0631": Entry(
        "reduction redone",
        "The reduction relied on an assumption about parameter values, such as `J = 0`, which no longer holds for the\n"
        "values of this run. The reduction has been redone, and is kept for further runs.",
    ),
    "N0634": Entry(
        "no closed loops",
        "Formulations differ in how they treat the closures of a mechanism's loops, as far as these remain after the\n"
        "elimination of linear constraints and of whatever follows by a formula. Where none remain, as in a tree of\n"
        "joints, the same equations are integrated in every formulation.",
    ),
    "N0632": Entry(
        "coordinates changed",
        "A choice of coordinates may fail in some positions of a mechanism: the height of a pendulum does not\n"
        "determine its side at the lowest point. The choice is assessed at every step of the integrator and replaced\n"
        "where another is better by a margin; `run.coordinates` lists which was used when. Each choice is "
        "reduced once\n"
        "and kept. With `stateSelect` or `states=[…]` an angle that is valid in all positions can be preferred, where\n"
        "there is one.",
    ),
    "N0635": Entry(
        "all coordinates integrated",
        "The coordinates have changed several times, and as often as that again many times over the rest of the run.\n"
        "Each change starts the integration anew. So the run goes on with all coordinates of the closed loops as\n"
        "states, which are moved onto the closures after each step (formulation `projected`). The closures hold to\n"
        "rounding in either way. `formulation='reduced'` (`--formulation reduced`) keeps to few coordinates.",
    ),
    "N0633": Entry(
        "singular position passed",
        "The constraints of a mechanism depend on each other in some positions: the bars of a parallelogram in line.\n"
        "Several branches of the motion meet there. The run goes on along the one on which the velocities are\n"
        "continuous, which is where momentum leads. Reactions may become infinite at that instant. Where no branch\n"
        "continues the motion smoothly, the run ends with a reason.",
    ),
}
