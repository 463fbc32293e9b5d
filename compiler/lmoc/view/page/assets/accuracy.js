// How accurate what the page shows is: its own repetition of the given run, and the error of a run that was asked for.

import { format } from "./controls.js";
import { $ } from "./dom.js";

const AGREES = 1e-6; // of the largest value of the same unit …
const ADD_UP = 50; // … or this many times the tolerance: the errors of two runs
const QUIET = 400; // ms in which nothing has been asked for: then there is time to tell how accurate the answer is

export class Accuracy {
  constructor(data) {
    this.data = data;
    this.repetition = ["", false];
  }

  /** Compute the given run again, and tell by how much it differs: {reason, times} of what has been computed. */
  async repeat(engine, given) {
    const { script, check, sizes, complete, checkTimes } = this.data;
    const { reason, missed, times } = await engine.ask("repeat", { times: checkTimes, check, sizes, complete, given: given.time });
    if (reason && complete) return { reason, times };
    const text = missed === 0 ? "does not differ" : `differs by ${missed.toPrecision(1)} of the largest value of each unit`;
    $("repeat").dataset.difference = String(missed);
    this.repetition = [`Computed again by this page, the run ${text}.`, !(missed <= Math.max(AGREES, ADD_UP * script.rtol))];
    this.ofRepetition();
    return { reason: "", times };
  }

  ofRepetition() {
    say(...this.repetition);
  }

  /** Find out how accurate the answer to a request is, once nothing more is asked for: `counts()` says whether it still does. */
  async find(engine, request, answer, counts) {
    say("", false);
    await new Promise((resolve) => setTimeout(resolve, QUIET));
    if (!counts()) return;
    const columns = new Map(this.data.script.names.map((name) => [name, answer.of(name)]));
    const found = await engine.ask("accuracy", { ...request, answer: { time: answer.time, columns } });
    if (found === null || !counts()) return;
    const { missed, from, reason } = found;
    const other = "one with a tenth of its tolerance";
    if (from === null) say(`This run is accurate to ${missed.toPrecision(1)} of the largest value of each unit, by ${other}.`, false);
    else if (reason) say(`How accurate this run is beyond t = ${format(from)} s is not known: ${other} ends there (${reason}).`, true);
    else say(`From t = ${format(from)} s on this run is not to be relied on: ${other} goes another way.`, true);
  }
}

/** Say it among the notes, or where a warning is seen. */
function say(text, bad) {
  const place = $("repeat");
  place.textContent = text;
  place.classList.toggle("warning", bad);
  if (bad) $("hint").append(place);
  else document.querySelector("#page-notes .keys").before(place);
}
