"""Catalogue entries for names, classes and modifications (02xx), and for types, units and connections (03xx)."""

from __future__ import annotations

from lmoc.messages.diagnostics import Entry

SEMANTICS: dict[str, Entry] = {
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
        "There is no function of that name, or the name denotes something other than a function.",
    ),
    "E0204": Entry(
        "declared twice",
        "One name denotes two elements of the same class. Inherited elements count as well, unless both\n"
        "declarations are identical.",
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
        "The bindings of parameters, or the values that determine the size of an array, form a cycle.",
    ),
    "E0208": Entry(
        "a class contains or extends itself",
        "A class cannot have itself as a part or as a base, directly or through others.",
    ),
    "E0209": Entry(
        "partial class",
        "A `partial` class is meant to be extended: it lacks equations. Use a model that extends it.",
    ),
    "E0210": Entry(
        "protected",
        "Elements under `protected` are private to the class: they can neither be read nor modified from\noutside.",
    ),
    "E0211": Entry(
        "must be known when compiling",
        "The number of parts, the range of a loop, the condition of a part or of an if-equation: these determine the\n"
        "structure of the model and may use parameters, constants and literals only. So may a subscript, unless it is\n"
        "an Integer that reads one element of an array.",
    ),
    "E0212": Entry(
        "a structural value is missing",
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
        "`outer` refers to an `inner` declaration of the same name in one of the enclosing parts. There is "
        "none, and none\n"
        "can be created: it is a variable, a partial class, or something else has that name.",
    ),
    "E0215": Entry(
        "index out of range",
        "Subscripts count from 1 to the size of the array.",
    ),
    "E0216": Entry(
        "wrong number of subscripts",
        "An array needs as many subscripts as it has dimensions, or none for the whole array.",
    ),
    "E0217": Entry(
        "wrong arguments",
        "A function is called with too many or too few arguments, or with a name it does not have.",
    ),
    "E0218": Entry(
        "absent part",
        "The part has a condition that is false here. Connections to it are removed with it, but it cannot be used\n"
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
        "The algorithm does not assign an output, assigns an input, or does not terminate.",
    ),
    "E0223": Entry(
        "wrong kind of class",
        "A function or package cannot be a part, and a part is not a class.",
    ),
    "E0225": Entry(
        "an array too large",
        "An array of parts or numbers, or a range, has more elements than fit into memory; check the\n"
        "parameter that sizes it.",
    ),
    "E0224": Entry(
        "a constant value that depends on a variable",
        "Parameters, constants, and start, nominal and fixed values are known before the run: they depend on\n"
        "parameters and constants only. The default signal of an input may use time as well.",
    ),
    "E0226": Entry(
        "not possible in this place",
        "A connector, a record and a package have no equations, a function has an algorithm instead. An `outer`\n"
        "declaration refers to another one and cannot be modified itself.",
    ),
    "E0227": Entry(
        "a model nested too deeply",
        "Parts in parts, classes that extend each other, functions that call each other or values that use each other\n"
        "form a chain of several hundred levels.",
    ),
    "E0228": Entry(
        "an experiment that cannot be run",
        "The annotation `experiment` gives a run its defaults: StopTime is after StartTime, the interval is "
        "positive and\n"
        "not unreasonably short, and the tolerance lies between 1e-14 and 1.",
    ),
    "W0229": Entry(
        "an assertion in a function",
        "An assertion in a function is checked where its condition is known when compiling. Where it depends on\n"
        "variables or parameters it is ignored: write it in the model that calls the function. One of the level\n"
        "`AssertionLevel.warning` that does not hold is told.",
    ),
    "E0230": Entry(
        "not available yet",
        "This feature of Modelica is recognized, but not supported in this version of lmo.",
    ),
    "N0241": Entry(
        "an inner part with its own values",
        "Parts of the scene share an `outer` part that is not declared as `inner`: one with the default values of its\n"
        "class is added. `inner World world(g = 1.62);` gives other values.",
    ),
    "W0231": Entry(
        "unknown entry of an annotation",
        "It is ignored.",
    ),
    "E0232": Entry(
        "unknown kind of law",
        'A function that represents a law is marked by `annotation(__lmoc(law = "..."))` with one of the kinds\n'
        "unilateral, one-way, dry friction, contact friction.",
    ),
    "E0233": Entry(
        "a law with nothing to determine",
        "A law ties a force to a gap or a velocity; both must be able to change in time. A number or a parameter in\n"
        "their place leaves the law nothing to determine.",
    ),
    "E0243": Entry(
        "not a subtype",
        "A redeclared element must be a subtype of the declared one, or of the class after\n"
        "`constrainedby`: it needs every public element of it, with the same prefixes and compatible types. A "
        "function\n"
        "needs the same inputs and outputs in the same order; further inputs need a value.",
        "model E1\n  parameter Real k = 1;\nend E1;\nmodel E2\n  parameter Real c = 1;\nend E2;\n"
        "model S\n  replaceable E1 e;\nend S;\nmodel M\n  S s(redeclare E2 e);\nend M;\n",
    ),
    "E0244": Entry(
        "a class in the wrong file",
        "A class `Name` is in a file `Name.lmo` or `Name.mo`, or in a folder `Name` with a file `package.lmo` or\n"
        "`package.mo`. A file in the folder of a package begins with `within` and the full name of that package; any\n"
        "other file that is found has no `within`. No class is defined twice.",
    ),
    "W0245": Entry(
        "an incomplete package",
        "A file in the folder of a package begins with `within` and the name of the package. `package.order` lists\n"
        "the classes and constants of a package in their order, one on a line.",
    ),
    "W0246": Entry(
        "a class is skipped",
        "A class that the model does not use has a syntax error. Using the class is an error.",
    ),
    "W0247": Entry(
        "a look that cannot be drawn",
        '`annotation(__lmoc(symbol = "spring"))` gives a part the look of one of the library;\n'
        "`annotation(Icon(graphics = {Line(points = {{-100, 0}, {100, 0}})}))` a drawing of its own, made of `Line`,\n"
        "`Polygon`, `Rectangle`, `Ellipse` and `Text` with numbers as coordinates. What is wrong there matters to\n"
        "nothing but the picture, which shows a box with the part's name.",
    ),
    "W0248": Entry(
        "a slider that cannot be used",
        "`parameter Real k = 40 annotation(Slider(min = 10, max = 90, step = 5))` gives a parameter a place among the\n"
        "first sliders of the page that `lmoc view` writes. It is of type Real; the ends of its range are finite, the\n"
        "smaller one first, and the step is no longer than the range. What is wrong there matters to nothing but the\n"
        "page, where the parameter has its place and range as if nothing had been said.",
    ),
    "E0246": Entry(
        "ambiguous import",
        "Two `import P.*` bring elements of the same name, and the class uses that name (13.2.1.1): which one is\n"
        "meant is said by importing it by its own name.",
    ),
    "E0250": Entry(
        "pre of a continuous variable",
        "`pre(x)` is the value of x before the present event. Outside of a `when` it makes sense for variables that\n"
        "change at events only: Boolean, Integer and enumeration variables, `discrete Real`, and what a `when`\n"
        "assigns. In the body of a `when` it is available for every variable.",
    ),
    "E0251": Entry(
        "a discrete variable that would change between events",
        "A variable of type Boolean or Integer, a `discrete Real` and the condition of a `when` change at events\n"
        "only. Relations such as `x > 0` do, too, but not inside `noEvent(...)`.",
    ),
    "E0252": Entry(
        "in the wrong place",
        "`reinit` and `terminate` act at an instant: they belong in the body of a `when`. A `connect`, a `when`\n"
        "or a law applies to the whole run: it is not allowed in a branch whose condition changes in\n"
        "time, nor in a `when`.",
    ),
    "E0253": Entry(
        "cannot be assigned in a when",
        "An equation in the body of a `when` has a variable alone on its left: that is what changes there. Parameters\n"
        "cannot change, and a continuous variable gets a new value by `reinit`.",
    ),
    "E0254": Entry(
        "determined twice",
        "A discrete variable has one equation, or is assigned in one when-equation: two could assign different values\n"
        "at the same instant. `elsewhen` defines their priority.",
    ),
    "E0255": Entry(
        "branches of a when assign different variables",
        "All branches of a when-equation assign the same variables. `x = pre(x)` keeps a value.",
    ),
    "E0256": Entry(
        "reinit of something that is not a state",
        "`reinit(x, value)` gives a continuous variable with a derivative a new value at an event.",
    ),
    "E0257": Entry(
        "branches with different numbers of equations",
        "An if-equation whose condition changes in time has as many equations in each branch, `else` included: the\n"
        "unknowns must be determined whichever branch holds.",
    ),
    "E0301": Entry(
        "wrong type",
        "A number, a Boolean, a string or a part is used where something else is needed. A condition is a Boolean; an\n"
        "Integer cannot be given a Real value.",
    ),
    "E0302": Entry(
        "sizes do not fit",
        "The two sides of an equation, the operands of + and -, and a value and what it is given to have the same\n"
        "dimensions. To add a number to every element write `.+`.",
    ),
    "E0303": Entry(
        "units do not fit",
        "Quantities that are added, compared or equated have the same unit. Units of products follow from those "
        "of the\n"
        "factors; a literal and a variable without unit are compatible with every unit. Arguments of sin, exp, "
        "... have the unit 1 (rad is 1).",
    ),
    "W0303": Entry(
        "units differ within a library",
        "As E0303, in the text of a library that was found in a folder: it is run as it is written.",
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
        "An input of a part is a signal that must be provided: `Force push(f = 10)`, an equation `push.f =\n"
        "3*time`, or a connection to an output.",
    ),
    "W0311": Entry(
        "kink",
        "abs, min, max and semiLinear of a variable have a kink, and so have if-expressions inside functions. It is\n"
        "integrated over without being located, which costs accuracy and steps. `noEvent(...)` or `smooth(0, ...)`\n"
        "mark it as intended; an if-expression outside of functions is located.",
    ),
    "W0318": Entry(
        "a when that does nothing",
        "The body of a `when` is executed at the instants at which its condition becomes true. One that does not\n"
        "change never becomes true, and an empty body does nothing.",
    ),
    "W0312": Entry(
        "connected to nothing",
        "A port of a part is not connected. Its flow is zero: nothing holds or drives that end. Often a connect\n"
        "is missing.",
    ),
    "E0313": Entry(
        "connector too deep inside",
        "A connect reaches the ports of the parts declared in the same class, and the class's own ports. To reach\n"
        "further inside, the part needs a port of its own.",
    ),
    "W0314": Entry(
        "connected to itself",
        "Both ends of a connect are the same port, which joins nothing. One of them is probably meant to be another.",
    ),
    "E0315": Entry(
        "two signals in one connection",
        "A connection of signals has one source: the output of a part, or an input of the class itself. Everything\n"
        "else in it takes the signal.",
    ),
    "E0316": Entry(
        "orientation without a root",
        "Records with an `equalityConstraint` in connectors, such as orientations, depend on each other: each tree of\n"
        "connected ones begins at a root, of which the part says `Connections.root(frame.R)`, or may begin at one, of\n"
        "which it says `Connections.potentialRoot(frame.R)`.",
    ),
    "E0317": Entry(
        "branches that are no tree",
        "`Connections.branch(a.R, b.R)` says that a part computes one record from the other. Branches join neither\n"
        "two records that say `Connections.root(…)` nor the ends of a row of branches: a connect closes a circle.",
    ),
}
