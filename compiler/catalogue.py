"""The catalogue of diagnostics: what each code means.

Codes: 01xx syntax, 02xx names, classes and modifications, 03xx types, units and connections, 04xx structure,
05xx start, inputs and running, 06xx files and commands. The letter is the severity: Error, Warning, Note.

``lmoc explain E0312`` prints an entry, ``python -m lmoc.catalogue`` prints ``docs/diagnostics.md``.
"""

from __future__ import annotations

from lmoc.diagnostics import Entry
from lmoc.syntax.mistakes import SYNTAX

CATALOGUE: dict[str, Entry] = {
    **SYNTAX,
    # ------------------------------ 02xx names, classes, modifications, models
    "E0201": Entry(
        "unknown name",
        "There is no variable, parameter or part of that name where it is used. A name is looked up in its own\n"
        "class and in what that class inherits, then among its imports, then in the classes around it (only\n"
        "constants there).",
    ),
    "E0202": Entry(
        "unknown class",
        "There is no class of that name: neither in the file, nor imported, nor in the library, whose parts\n"
        "docs/library.md lists.",
    ),
    "E0203": Entry(
        "unknown function",
        "There is no function of that name, or the name means something else than a function.",
    ),
    "E0204": Entry(
        "declared twice",
        "One name stands for two things in the same class. Something inherited counts as well, unless both\n"
        "declarations read the same.",
    ),
    "E0205": Entry(
        "nothing of that name to modify",
        "A modification such as `Mass m(mass = 2)` names an element that the class does not have. A variable has\n"
        "the attributes start, fixed, nominal, min, max, unit, displayUnit, quantity, stateSelect.",
    ),
    "E0206": Entry(
        "final",
        "The element was declared `final` (or is not `replaceable`), so that it cannot be changed from outside.\n"
        "Example: the moment of inertia of a `Disk` follows from m and r and cannot be given.",
    ),
    "E0207": Entry(
        "a value depends on itself",
        "Following the bindings of parameters, or what the size of an array needs, leads back to where it began.",
    ),
    "E0208": Entry(
        "a class contains or extends itself",
        "A class cannot have itself as a part or as a base, directly or through others.",
    ),
    "E0209": Entry(
        "partial class",
        "A `partial` class is meant to be extended: equations are missing in it. Use a model that extends it.",
    ),
    "E0210": Entry(
        "protected",
        "What stands under `protected` belongs to the class alone: it can neither be read nor modified from\n"
        "outside.",
    ),
    "E0211": Entry(
        "must be known when compiling",
        "The number of parts, the range of a loop, the condition of a part or of an if-equation, a subscript: these\n"
        "shape the model and may use parameters, constants and literals only.",
    ),
    "E0212": Entry(
        "a value is missing that shapes the model",
        "The size of an array or a condition depends on this parameter: give it a value, in the model or with\n"
        "`--set name=value`.",
    ),
    "E0213": Entry(
        "one value for many parts",
        "`Mass m[3](m = 2)` gives one value to three masses. Either `each m = 2` for all the same, or `m = {1, 2,\n"
        "3}`.",
    ),
    "E0214": Entry(
        "outer without inner",
        "`outer` refers to a declaration `inner` of the same name in one of the parts around. There is none.",
    ),
    "E0215": Entry(
        "index out of range",
        "Subscripts count from 1 to the size of the array.",
    ),
    "E0216": Entry(
        "wrong number of subscripts",
        "An array needs as many subscripts as it has dimensions, or none for all of it.",
    ),
    "E0217": Entry(
        "wrong arguments",
        "A function is called with too many or too few arguments, or with a name it does not have.",
    ),
    "E0218": Entry(
        "absent part",
        "The part has a condition that is false here. Connections to it vanish with it, but it cannot be used\n"
        "otherwise.",
    ),
    "E0220": Entry(
        "structure differs within an array",
        "All elements of an array of parts have the same structure: sizes and conditions cannot differ among them.\n"
        "(If-equations may.) Declare the different ones separately.",
    ),
    "E0221": Entry(
        "modified twice",
        "One modification gives the same element two values.",
    ),
    "E0222": Entry(
        "a function without result",
        "The algorithm gives an output no value, assigns an input, or does not come to an end.",
    ),
    "E0223": Entry(
        "wrong kind of class",
        "A function or package cannot be a part, and a part is no class.",
    ),
    "E0225": Entry(
        "an array too large",
        "An array of parts or numbers, or a range, has more elements than a machine could hold; look at the\n"
        "parameter that sizes it.",
    ),
    "E0224": Entry(
        "a value that would have to change",
        "Parameters, constants, and start, nominal and fixed values are known before the run: they depend on\n"
        "parameters and constants only. The default signal of an input may use time as well.",
    ),
    "E0226": Entry(
        "not possible in this place",
        "A connector, a record and a package have no equations, a function has an algorithm instead. A declaration\n"
        "`outer` stands for another one and can be given nothing itself.",
    ),
    "E0227": Entry(
        "a model nested too deeply",
        "Parts in parts, classes that extend each other, functions that call each other or values that use each other\n"
        "make a chain of some hundred links.",
    ),
    "E0228": Entry(
        "an experiment that cannot be run",
        "The annotation `experiment` gives a run its defaults: it ends after it begins, its interval is positive and\n"
        "not shorter than makes sense, and its tolerance lies between 0 and 1.",
    ),
    "E0230": Entry(
        "not available yet",
        "The language of lmo grows towards Modelica. This feature is understood, but not yet in this version:\n"
        "mainly events (`when`, `pre`, `sample`, `reinit`, `terminate`) and discrete variables.",
    ),
    "W0231": Entry(
        "unknown entry of an annotation",
        "It is ignored.",
    ),
    # ----------------------------------------- 03xx types, units, connections
    "E0301": Entry(
        "wrong type",
        "A number, a Boolean, a text or a part stands where something else is needed. A condition is a Boolean; an\n"
        "Integer cannot be given a Real.",
    ),
    "E0302": Entry(
        "sizes do not fit",
        "The two sides of an equation, the operands of + and -, and a value and what it is given to have the same\n"
        "dimensions. To add a number to every element write `.+`.",
    ),
    "E0303": Entry(
        "units do not fit",
        "What is added, compared or equated has one unit. Units of products follow from those of the factors; a\n"
        "literal and a variable without unit fit everything. Arguments of sin, exp, ... have the unit 1 (rad is 1).",
    ),
    "E0304": Entry(
        "unknown unit",
        "Units are products of SI symbols: `N.m/rad`, `kg.m2`, `m/s2`, `1/s`, with prefixes as in `kN`. Factors are\n"
        "joined by dots, there is one `/`, exponents follow the symbol.",
    ),
    "E0305": Entry(
        "not a connector",
        "`connect` joins ports: instances of connectors, or signals declared `input` or `output`.",
    ),
    "E0306": Entry(
        "different connectors",
        "Two connectors can be connected when they have the same variables, with the same `flow` marks. A flange\n"
        "moves along a line, a shaft turns: a Drum, an Arm or a Lever stands between them.",
    ),
    "E0307": Entry(
        "too few or too many equations",
        "A class has as many equations as unknowns. Its unknowns are its own variables and those of its own\n"
        "connectors; a flow of a connector is given from outside, by the connections, everything else by the class.\n"
        "An input of a part inside counts as unknown.",
    ),
    "E0308": Entry(
        "unbalanced connector",
        "A connector has as many flows as potentials: only then do connections give as many equations as they need.",
    ),
    "E0309": Entry(
        "no derivative",
        "A parameter or constant does not change in time.",
    ),
    "E0310": Entry(
        "input without value",
        "An input of a part is a signal that someone must give: `Force push(f = 10)`, an equation `push.f =\n"
        "3*time`, or a connection to an output.",
    ),
    "W0311": Entry(
        "kink",
        "abs, sign, min, max and if-expressions of a variable have a kink or a jump. It is integrated over without\n"
        "being located, which costs accuracy and steps. `noEvent(...)` or `smooth(0, ...)` say that this is meant.",
    ),
    "W0312": Entry(
        "connected to nothing",
        "A port of a part is not connected. Its flow is zero: nothing holds or drives that end. Often a forgotten\n"
        "connect.",
    ),
    "E0313": Entry(
        "connector too deep inside",
        "A connect reaches the ports of the parts declared in the same class, and the class's own ports. To reach\n"
        "further inside, the part needs a port of its own.",
    ),
    "E0314": Entry(
        "connected to itself",
        "Both ends of a connect are the same port. One of them is probably meant to be another one.",
    ),
    # --------------------------------------------------------- 04xx structure
    "E0401": Entry(
        "too many equations",
        "More equations than unknowns: something is prescribed twice, for instance the motion of one point by two\n"
        "parts. The equations and what they have in common are named (the over-determined part of Dulmage and\n"
        "Mendelsohn). Take one away, or make one of the prescribed values an unknown.",
    ),
    "E0402": Entry(
        "nothing fixes a position",
        "Only differences of some positions stand in the equations, so the whole group can be anywhere. Connect\n"
        "one of its parts to a `Fixed`, or give one a mass or an inertia.",
    ),
    "E0403": Entry(
        "too few equations",
        "Fewer equations than unknowns: what is named is not determined by anything. Often a connection or a\n"
        "binding is missing.",
    ),
    "E0404": Entry(
        "constraints that cannot be solved near the start",
        "The positions of a mechanism do not follow from its coordinates where it starts: it stands at a dead\n"
        "centre, or one constraint repeats others. Start elsewhere, or take the constraint away.",
    ),
    "E0405": Entry(
        "equations that depend on each other",
        "There are as many equations as unknowns, but with these parameter values they say the same thing twice.\n"
        "Look for a parameter that is zero, or for two that cancel.",
    ),
    "E0406": Entry(
        "not possible as a state",
        "A variable asked for as a state is prescribed, or follows from others that were asked for as well.",
    ),
    "N0407": Entry(
        "coordinates were chosen",
        "Constraints leave fewer coordinates than there are positions; this tells which ones are integrated.\n"
        "`states=[…]` or the attribute `stateSelect` choose others.",
    ),
    "E0411": Entry(
        "constraints contradict each other",
        "Rigid connections form a loop, or end at places that are fixed, and their lengths and offsets do not add up: "
        "two rods of different lengths side by side, a rod between two walls that are further apart. Every place on "
        "the loop is listed. Change one of them, or put a spring where the real thing gives way.",
    ),
    "E0412": Entry(
        "a loop that cannot move",
        "Two ways through ideal gears, drums or levers lead from one coordinate to the same other one with different "
        "ratios: only rest satisfies both. Where the ratios are meant to be equal, give them the same value.",
    ),
    "E0413": Entry(
        "a motion is prescribed twice",
        "Two given functions of time (an input, a prescribed motion, a fixed place) act on the same coordinate through "
        "rigid connections. Prescribe it once, or put a spring between them.",
    ),
    "E0414": Entry(
        "unknown state",
        "A name given as a preferred state is not a variable of the model.",
    ),
    "E0416": Entry(
        "a force that nothing takes",
        "A given force or weight acts on connections without mass that no spring, damper or support holds: the forces "
        "there cannot balance. Connect the force to a part with mass, or to something that holds it.",
        "model A\n  Force push(f = 2);\n  Rod rod;\nequation\n  connect(push.flange, rod.a);\nend A;",
    ),
    "N0415": Entry(
        "a constraint repeats others",
        "A loop of rigid connections gives one constraint more than there are coordinates, and they agree. It is left "
        "out: the motion is the same, but the forces inside the loop are not unique. They are reported as undetermined "
        "(NaN); what they do together to the bodies is right.",
    ),
    # ------------------------------------------- 05xx start, inputs, running
    "E0520": Entry(
        "an input without a signal",
        "A top-level `input` has no binding in the model, and the run was given none. Bind it where it is declared, "
        "or give the run a number, a formula in `time`, a callable or a table.",
    ),
    "E0521": Entry(
        "a signal is not understood",
        "A signal is a number, a formula in `time` and parameters (`F*sin(w*time)`), a Python callable, a table "
        "(times, values), or the name of a CSV file.",
    ),
    "E0522": Entry(
        "a signal cannot be differentiated",
        "The input prescribes a motion: velocities and forces follow from its derivatives. A formula has all of them, "
        "a table two (it is joined by a smooth spline), a callable only those it gives itself by `derivative(n)`.",
    ),
    "N0523": Entry(
        "a derivative of a signal is unknown",
        "Only the energy ledger or some observed variables need this derivative; they are reported as NaN.",
    ),
    "W0524": Entry(
        "a signal with kinks is differentiated",
        "Where the formula has a kink or a jump its derivative is an impulse, which the run leaves out. Smooth the "
        "signal, or give its motion as a table.",
    ),
    "W0525": Entry(
        "a table does not cover the run",
        "The run begins before the first point of the table or goes on after its last. The outermost values are held "
        "there, with slope zero.",
    ),
    "E0530": Entry(
        "a parameter without a value",
        "The equations of the run read a parameter that has neither a binding nor a value from the command.",
    ),
    "E0531": Entry(
        "fixed start values contradict each other",
        "The model ties these variables together, so they cannot all start at the values given: two meshed gears have "
        "one speed between them. Fix one of them, or give values that fit.",
    ),
    "E0532": Entry(
        "no start was found",
        "A solution of the fixed values and initial equations, which are not linear, was looked for from several\n"
        "first guesses, near and far, and not found. Perhaps there is none; else start values closer to it help.",
    ),
    "W0533": Entry(
        "start values that cannot be met",
        "Values given by `start` without `fixed = true` are met as closely as the constraints allow. These could not "
        "all be.",
    ),
    "E0534": Entry(
        "this cannot have an initial value",
        "Only unknowns have initial values. Parameters are set with `parameters=` or `--set`, inputs with `inputs=` "
        "or `--input`.",
    ),
    "E0535": Entry(
        "no finite value at the start",
        "A division by zero, a root of a negative number, or an overflow at the start values.",
    ),
    "E0536": Entry(
        "an initial equation asks for what is not known",
        "It needs a derivative that the signal of an input does not give, or a force that the model leaves\n"
        "undetermined (in a loop of rigid parts). All other derivatives can be asked for, of states or not.",
    ),
    "W0537": Entry(
        "a value that is not finite",
        "At the start or at the end of a run, a variable that the motion does not depend on comes out as infinite or "
        "as no number at all (a division by zero, the logarithm of a negative number). The run goes on; everything "
        "computed from it is just as useless.",
    ),
    "E0540": Entry("no such solver", "The solvers are listed by `lmoc run --help`; `auto` chooses one that suits."),
    "E0541": Entry(
        "options of the run that cannot be used",
        "Tolerances are positive, times increase, and the stop lies after the start.",
    ),
    "E0542": Entry(
        "a variable that is to be kept does not exist",
        "`--keep` and `keep=` take names of variables or of whole arrays of the flat model, such as `mass.q`.",
    ),
    "W0551": Entry(
        "an assertion of level warning does not hold",
        "The model says itself that something is not as it should be; the message is the model's.",
    ),
    # -------------------------------------------------- 06xx files, commands
    "E0601": Entry("no such model", "The model asked for is not in the file, or it is not something that can run."),
    "E0602": Entry("nothing to run", "The file defines no model, or only partial ones."),
    "E0603": Entry(
        "several models",
        "More than one model in the file is used by no other. Say which is meant: `--model NAME`, or\n"
        "`model=` in Python.",
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
    # ------------------------------------------------- 066x what a person reads
    "E0660": Entry(
        "no answer in symbols",
        "Equations of motion, equilibria and transfer functions in symbols are for scenes of up to a few hundred "
        "equations whose implicit parts have a solution in closed form. For others there is the numeric form.",
    ),
    "E0661": Entry(
        "no such input, output or variable",
        "Linear models and transfer functions go from a top-level input to a variable of the flat model.",
    ),
    "E0663": Entry(
        "no single equilibrium",
        "A nonlinear scene is linear about a point. By default that is its only equilibrium; where there are several "
        "or none, say which point: `--at TIME` or `--at name=value`.",
    ),
    "E0662": Entry(
        "a parameter without a value",
        "Numbers (poles, eigenvalues, a numeric linear model) need a value for every parameter that occurs.",
    ),
    "N0630": Entry(
        "flattened again",
        "A parameter given to this run decides about the structure of the model (the length of an array, a\n"
        "condition), so the scene has been flattened and reduced anew. The result is kept for further runs with the\n"
        "same value.",
    ),
    "N0631": Entry(
        "reduced anew",
        "The smallest system of equations rested on an assumption about parameter values, such as `J = 0`, which does\n"
        "not hold for the values of this run. The reduction has been redone, and is kept for further runs.",
    ),
}


def page() -> str:
    """The catalogue as a page of the documentation, with what is said about the examples."""
    lines = [
        "# Diagnostics",
        "",
        "Every error, warning and note of lmoc by its code; `lmoc explain CODE` shows an entry on the command line.",
        "This page is made by `python -m lmoc.catalogue > docs/diagnostics.md`.",
        "",
    ]
    for code in sorted(CATALOGUE, key=lambda code: (code[1:], code[0])):
        entry = CATALOGUE[code]
        lines += [f"## {code}: {entry.title}", "", entry.explanation, ""]
        if entry.example:
            lines += ["```modelica", entry.example, "```", ""]
            lines += [line for shown in _said(entry.example) for line in ("```text", shown, "```", "")]
    return "\n".join(lines).rstrip() + "\n"


def _said(example: str) -> list[str]:
    """What the parser says about a program."""
    from lmoc.diagnostics import Report, render
    from lmoc.source import Source
    from lmoc.syntax.parse import parse

    report = Report()
    parse(Source("example.lmo", example), report)
    return [render(d) for d in report.diagnostics]


if __name__ == "__main__":
    print(page(), end="")
