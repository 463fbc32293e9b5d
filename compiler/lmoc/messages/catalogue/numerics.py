"""Catalogue entries for start values, inputs and runs (05xx)."""

from __future__ import annotations

from lmoc.messages.diagnostics import Entry

NUMERICS: dict[str, Entry] = {
    "E0520": Entry(
        "an input without a signal",
        "A top-level `input` has no binding in the model, and none was given to the run. Bind it where it is declared, "
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
        "a table two (one where it jumps), a callable only those it provides by `derivative(n)`.",
    ),
    "N0523": Entry(
        "a derivative of a signal is unknown",
        "Only the energy ledger or some observed variables need this derivative; they are reported as NaN.",
    ),
    "W0524": Entry(
        "a signal with kinks is differentiated",
        "Where the formula has a kink its second derivative is an impulse. What moves jumps there, but forces that\n"
        "are observed alone are shown without the impulse. Smooth the signal, or give its motion as a table.",
    ),
    "W0525": Entry(
        "a table does not cover the run",
        "The run begins before the first point of the table or continues after its last. The table is "
        "extrapolated with "
        "its first and last values, with slope zero.",
    ),
    "W0526": Entry(
        "more kinks than a run stops at",
        "The integration is restarted wherever a formula of time jumps or has a kink, so that no step crosses such a "
        "point, but the number of restarts is limited. After the last one the run is less accurate. Make the run "
        "shorter, or replace the fast switching by its mean.",
    ),
    "N0527": Entry(
        "a table is converted",
        "A column of a table names its unit, `u [mm]` or `mm` in the line below the names, and the input has another\n"
        "one of the same dimension: its numbers are converted. Time becomes seconds.",
    ),
    "N0528": Entry(
        "output times too coarse for the motion",
        "The motion oscillates between two output times, so that the output shows a different, slower motion "
        "(aliasing: "
        "a vibration of 50 Hz sampled at 62 points a second looks like one of 12 Hz). The values are correct "
        "nevertheless. Request more points or a shorter time. Pictures are drawn from points as dense as needed.",
    ),
    "E0575": Entry(
        "sensitivities are not available",
        "Derivatives of a motion by parameters and start values are integrated along it, from one choice of\n"
        "coordinates to the next, and over events: impacts, laws that change their mode, `when`. There are none where\n"
        "it grazes a stop, where a mode or a condition is on its edge (`floor(x)` that starts at 0), or where impacts\n"
        "accumulate: values a little other lead to other events. At an output time at which something happens that\n"
        "comes earlier or later with the value, what happens has one derivative before and another one behind.",
    ),
    "E0529": Entry(
        "bars that cannot be put together",
        "In a closed loop no bar can be longer than all others together, and bars between two points that do not move "
        "must be at least as long together as the points are apart. Here the lengths do not allow any position.",
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
        "No solution of the fixed values and the nonlinear initial equations was found from several initial guesses,\n"
        "near and far. Perhaps there is none; otherwise start values closer to it help.",
    ),
    "W0533": Entry(
        "start values that cannot be met",
        "Values given by `start` without `fixed = true` are met as closely as the constraints allow. These could not "
        "all be met.",
    ),
    "N0533": Entry(
        "where a guess has led",
        "In a closed loop `start` without `fixed = true` is a guess: it chooses between the ways in which the loop "
        "closes, and the nearest one is taken. What is fixed leaves no freedom to meet the guess itself.",
    ),
    "N0539": Entry(
        "a loop that can be put together in several ways",
        "A loop of bars of given lengths closes in several ways: a four-bar open or crossed, a slider crank on either "
        "side. Without a guess the one with the smallest angles is taken. A start value for one of the angles (`start` "
        "without `fixed`) chooses the nearest one to that.",
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
        "an initial equation uses an unknown quantity",
        "It uses a derivative that the signal of an input does not provide, or a force that the model leaves\n"
        "undetermined (in a loop of rigid parts). All other derivatives can be used, of states or not.",
    ),
    "W0537": Entry(
        "a value that is not finite",
        "A parameter, or a variable that the motion does not depend on, is infinite or NaN "
        "(a division by zero, the logarithm of a negative number); a variable is so at the reported time and "
        "perhaps at others. The run continues; everything computed from the value is meaningless as well.",
    ),
    "W0538": Entry(
        "fixed velocities of inertias that contradict each other",
        "Wheels that turn at given speeds are brought into mesh, or moving masses are joined: a plastic impact makes "
        "their velocities agree at the start, and keeps what momentum the constraints allow. It is the first event of "
        "the run. Contradicting positions are an error (E0531), and velocities are where a body that moves along has "
        "none of its own.",
    ),
    "N0543": Entry(
        "a homotopy that does not lead to a start",
        "Where a model contains `homotopy(actual, simplified)`, the start is solved with the simplified expressions\n"
        "first, and followed from there to the actual ones (Modelica specification, 3.7.4.4): among several solutions\n"
        "that chooses one. Where the simplified model has no start, or the way ends before it has come to the actual\n"
        "one, the start is looked for with the actual expressions alone, from the start values: look whether it is\n"
        "the one that is meant.",
    ),
    "E0540": Entry(
        "a solver that does not exist or does not suit",
        "The solvers are listed by `lmoc run --help`; `auto` chooses one that suits. `verlet` needs forces that do "
        "not depend on velocities, `moreau` for laws between inertias and no other events.",
    ),
    "E0541": Entry(
        "options of the run that cannot be used",
        "Tolerances are positive, times increase, and the stop lies after the start. A step is given to solvers with "
        "fixed steps, and to no others.",
    ),
    "E0542": Entry(
        "a variable to be kept does not exist",
        "`--keep` and `keep=` take names of variables or of whole arrays of the flat model, such as `mass.q`.",
    ),
    "E0551": Entry(
        "parameters that violate a condition",
        "A parameter lies outside its `min` and `max`, or an assertion over parameters alone does not hold. The text "
        "of an assertion is the model's own.",
    ),
    "N0552": Entry(
        "the model has ended the run",
        "`terminate(message)` in a `when` ends a run before its stop time.",
    ),
    "N0554": Entry(
        "no energy ledger from a step on",
        "A step in a prescribed position passes through a damper as an impulse of force: velocities jump by a finite\n"
        "amount, while the heat in the damper and the work of the source grow beyond all bounds with the steepness of\n"
        "the step. From then on `run.energy` has no value (NaN). With a ramp of finite length it has one.",
    ),
    "W0551": Entry(
        "an assertion of level warning does not hold",
        "An assertion of the model with `AssertionLevel.warning` is violated; the message is the model's own, with\n"
        "the first time at which it is violated, and for how long in all.",
    ),
    "N0555": Entry(
        "the estimated error of time stepping",
        "`--solver moreau` makes steps of equal length, of order one. A second run with steps twice as long tells how\n"
        "far off the positions are, as a share of the range of each. Without `--step` the steps are halved until that\n"
        "is at most 1 %.",
    ),
    "W0555": Entry(
        "the steps of time stepping are long",
        "Positions are estimated to be off by more than 1 % of their ranges. The error is proportional to the step,\n"
        "which `--step` sets. Without `--step` the steps have been halved five times, which has not been enough: the\n"
        "scene may bounce in such a way that small differences grow.",
    ),
    "W0556": Entry(
        "a flood of events",
        "Thousands of events have happened in a small part of the run. Each one ends a step of the integrator, so\n"
        "that the run may take hours. The number of those still ahead is estimated from how fast the latest have\n"
        "followed each other. The warning comes while the run goes on; it can be interrupted, and keeps what it has.",
    ),
    "W0560": Entry(
        "a negative stiffness or damping",
        "A spring with a negative stiffness pushes away from its relaxed length, a damper with a negative damping\n"
        "feeds energy in: motions grow without bound. Both are allowed.",
        "model A\n  Fixed wall;\n  Spring spring(k = -50);\n  Mass mass(m = 2);\nequation\n"
        "  connect(wall.flange, spring.a);\n  connect(spring.b, mass.flange);\nend A;",
    ),
    "N0561": Entry(
        "a spring far from relaxed",
        "At the start a spring is stretched or compressed by more than a metre, or twisted by more than a turn. Often\n"
        "a start value is missing (positions start at 0), or the free length d0 is meant to be L, the distance of the\n"
        "reference lines from which the positions of the two ends count.",
        "model A\n  Fixed wall;\n  Spring spring(k = 50, d0 = 5);\n  Mass mass(m = 2);\nequation\n"
        "  connect(wall.flange, spring.a);\n  connect(spring.b, mass.flange);\nend A;",
    ),
    "N0562": Entry(
        "nothing moves",
        "The scene starts at rest, and no force acts on it, so it stays where it is. A start value, a force or a\n"
        "motion sets it going.",
    ),
    "E0557": Entry(
        "nothing has moved on",
        "Work that may not end has a budget: where nothing moves on for 30 s of work, it is given up. A run moves on\n"
        "where its time does, by a thousandth of its span at least; a study, where a run of it ends; other work,\n"
        "where another stage begins. `--budget SECONDS` allows another time, in Python `with lmoc.budget(seconds):`,\n"
        "for a whole session `LMOC_BUDGET` in the environment. A run keeps what it has computed (exit code 3).\n"
        "Numbers far from all that is mechanical, 1e308 N/m, are the most frequent reason.",
    ),
    "N0558": Entry(
        "an impact whose outcome depends on the law of impacts",
        "Bodies that touch, or come to touch within 1e-10 s, are hit at once. Newton's law of all impacts together\n"
        "gives one answer; impacts one after the other may give others, and a real scene decides by how stiff its\n"
        "bodies are. Three equal balls in a row without loss leave with (-1/3, 2/3, 2/3) of the velocity where they\n"
        "touch, and with (0, 0, 1) where a gap gives an order. The note comes once a run, with the first such impact.",
    ),
    "E0559": Entry(
        "not enough memory",
        "What was asked for takes more memory than the machine, or a limit set for the process, allows. Parts that\n"
        "are an array with `each` modifications take far less than as many declarations, `--keep` and `--points`\n"
        "bound what a run keeps.",
    ),
    "W0563": Entry(
        "a run that takes long",
        "After five seconds of work the run has come so little of its way that at this pace more than a minute is\n"
        "still ahead. It goes on, and can be interrupted: what it has computed is kept. Many short steps are taken\n"
        "where inputs jump or bend often (a long table), where events follow each other, and where something swings\n"
        "very fast.",
    ),
    "W0553": Entry(
        "the energy balance does not close",
        "The energy supplied by sources, the energy dissipated and the change of the stored energy differ by\n"
        "more than the tolerance of the run explains. The result is not reliable. A tighter tolerance (`--rtol`),\n"
        "shorter steps (`--max-step`) or another solver show whether the integration is the cause. If the\n"
        "error persists, a part absorbs or delivers energy that it does not declare as `energy` or `loss`.",
    ),
}
