"""What the catalogue of diagnostics says about start values, inputs and runs (05xx)."""

from __future__ import annotations

from lmoc.messages.diagnostics import Entry

NUMERICS: dict[str, Entry] = {
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
        "a table two (and none where it jumps), a callable only those it gives itself by `derivative(n)`.",
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
    "W0526": Entry(
        "more kinks than a run stops at",
        "A run stops wherever a formula of time jumps or bends, so that its steps do not go over such places, but only "
        "so many times. Behind the last one it is less accurate. Make the run shorter, or replace the fast switching "
        "by its mean.",
    ),
    "N0528": Entry(
        "output times too coarse for the motion",
        "The motion changes so fast that it goes up and down between two output times: a table of them shows another, "
        "slower motion (a vibration of 50 Hz seen at 62 points a second looks like one of 12 Hz). The values are right "
        "all the same. Ask for more points, or for a shorter time. Pictures are drawn from points as dense as needed.",
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
        "A parameter, or a variable that the motion does not depend on, comes out as infinite or as no number at all "
        "(a division by zero, the logarithm of a negative number); a variable does so at the time that is told and "
        "perhaps at others. The run goes on; everything computed from it is just as useless.",
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
    "E0551": Entry(
        "parameters that break a condition",
        "A parameter lies outside its `min` and `max`, or an assertion over parameters alone does not hold. The text "
        "of an assertion is the model's own.",
    ),
    "N0552": Entry(
        "the model has ended the run",
        "`terminate(message)` in a `when` ends a run before its stop time.",
    ),
    "W0551": Entry(
        "an assertion of level warning does not hold",
        "The model says itself that something is not as it should be; the message is the model's.",
    ),
    "W0553": Entry(
        "energies do not add up",
        "What sources have supplied, what has become heat, and what the stores hold more than at the start differ by\n"
        "more than the tolerance of the run explains. The result is not to be trusted. A finer tolerance (`--rtol`),\n"
        "shorter steps (`--max-step`) or another solver tell whether the integration is to blame. Where the\n"
        "error stays, a part takes or gives energy that it does not declare as `energy` or `loss`.",
    ),
}
