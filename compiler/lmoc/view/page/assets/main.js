// The page: one state, and everything that shows it.

import { read, write } from "./address.js";
import { givenAnswer, revived } from "./answer.js";
import { Card, tableRow } from "./card.js";
import { Chooser, format, Sliders, Starts } from "./controls.js";
import { $ } from "./dom.js";
import { Engine } from "./engine.js";
import { eventText, modesText, showEvents } from "./events.js";
import { listenToFrame, tellFrame } from "./frame.js";
import { gripAt } from "./grip.js";
import { listenToHand } from "./hand.js";
import { ModeMotion } from "./modes.js";
import { Motion, movers } from "./motion.js";
import { Stage } from "./picture.js";
import { PhasePlot } from "./phase.js";
import { Player } from "./player.js";
import { Plots } from "./plots.js";
import { Shades } from "./shades.js";

const AGREES = 1e-6; // of the largest value of the same unit …
const ADD_UP = 50; // … or this many times the tolerance: the errors of two runs
const QUIET = 400; // ms in which nothing has been asked for: then there is time to tell how accurate the answer is
const INSTANTS = 200; // at which the picture is looked at for the room that it needs
const STEP = 200; // of these a run is walked through with the arrow keys

/** Open the page. `worker` is the script of its own simulation, `terms` are those of the equations, as functions. */
export function open(data, worker, terms) {
  return new Page(data, worker, terms);
}

class Page {
  constructor(data, worker, terms) {
    this.data = data;
    const units = new Map(data.variables.map((v) => [v.name, v.unit]));
    this.unitOf = (name) => units.get(name) ?? "";
    this.given = this.answer = givenAnswer(data);
    this.against = null; // {set, init, answer} of the run that is recorded
    this.init = {}; // states at the start that the hand has given
    this.pulls = []; // [t, part, signals] of the hand while the scene ran
    this.pulling = null; // {to, begun} while it does
    this.dragged = null; // {item, vertex, …} of what the hand holds
    this.forces = false;
    this.serial = 0;
    this.engine = this.sliders = this.starts = this.motion = this.swing = null;
    this.repeated = Promise.resolve(false); // whether the page's own run serves
    const { time } = this.given;
    this.times = time;
    this.player = new Player(time[0] ?? 0, time[time.length - 1] ?? 0, (t) => this.show(t), () => this.writePlayer());
    const around = { seek: (t) => this.player.seek(t) };
    this.plots = new Plots($("plots"), around);
    this.energy = new Plots($("energy"), around);
    this.over = ""; // the variable that plots are over; "" for time
    const names = data.variables.map((v) => v.name);
    const state = read(location.hash);
    this.chooser = new Chooser($("chooser"), names, state.show?.filter((n) => names.includes(n)) ?? data.shown, () => this.draw());
    this.card = new Card(data.parts, names, this.unitOf, around, (name) => this.choose(name));
    this.shades = new Shades($("equations"), $("shades"), terms, data.terms, data.jets.map(({ name }) => name));
    this.makePicture();
    this.listen();
    this.put(state);
    this.makeEngine(worker, state);
  }

  // ---------------------------------------------------------------- making

  /** What can be moved is there at once; what is asked for waits until the run has been repeated. */
  async makeEngine(worker, state) {
    const { script, variables, jets, picture } = this.data;
    if (script.reason) {
      this.withoutEngine(script.reason);
      return;
    }
    const engine = new Engine(worker, { script, variables: [...variables, ...jets], picture }, (is) => document.body.toggleAttribute("data-busy", is));
    this.engine = engine;
    this.sliders = new Sliders($("sliders"), script.parameters, () => this.simulate());
    this.starts = new Starts($("sliders"), script.names.filter((n) => this.given.has(n) && !n.startsWith("ledger.")), this.unitOf, () => this.started(this.starts.values));
    this.starts.put(this.init, (name) => this.given.of(name)[0]);
    if (script.held.length) $("held").textContent = `Sliders do not change the start of ${script.held.join(", ")} in this page.`;
    $("parameters").hidden = false;
    for (const { item, group } of this.stage?.parts ?? []) group.classList.toggle("takes", canBeTaken(item));
    this.repeated = this.repeat(engine);
    await this.putRuns(state);
    if (!(await this.repeated)) return;
    listenToFrame(({ values, initial }) => {
      this.init = initial;
      this.sliders.setAll(values);
    });
  }

  withoutEngine(reason) {
    this.engine = null;
    $("parameters").hidden = true;
    for (const { group } of this.stage?.parts ?? []) group.classList.remove("takes");
    $("hint").textContent = `The sliders are missing: ${reason}.`;
  }

  /** Compute the run again, and tell by how much it differs; false where that does not come to its end. */
  async repeat(engine) {
    const { script, check, sizes, complete, checkTimes } = this.data;
    const { reason, missed, times } = await engine.ask("repeat", { times: checkTimes, check, sizes, complete, given: this.given.time });
    if (reason && complete) {
      this.withoutEngine(`repeated in this page, the run does not reach its end (${reason})`);
      return false;
    }
    this.times = times;
    const text = missed === 0 ? "does not differ" : `differs by ${missed.toPrecision(1)} of the largest value of each unit`;
    $("repeat").dataset.difference = String(missed);
    this.repetition = [`Computed again by this page, the run ${text}.`, !(missed <= Math.max(AGREES, ADD_UP * script.rtol))];
    this.sayAccuracy(...this.repetition);
    return true;
  }

  /** Say how accurate what is shown is: among the notes, or where a warning is seen. */
  sayAccuracy(text, bad) {
    const place = $("repeat");
    place.textContent = text;
    place.classList.toggle("warning", bad);
    if (bad) $("hint").append(place);
    else document.querySelector("#page-notes .keys").before(place);
  }

  /** Find out how accurate the answer to a request is, once nothing more is asked for. */
  async findAccuracy(request) {
    const { serial, answer, engine } = this;
    this.sayAccuracy("", false);
    await new Promise((resolve) => setTimeout(resolve, QUIET));
    if (serial !== this.serial || this.dragged !== null) return;
    const columns = new Map(this.data.script.names.map((name) => [name, answer.of(name)]));
    const found = await engine.ask("accuracy", { ...request, answer: { time: answer.time, columns } });
    if (found === null || serial !== this.serial) return;
    const { missed, from, reason } = found;
    const other = "one with a tenth of its tolerance";
    if (from === null) this.sayAccuracy(`This run is accurate to ${missed.toPrecision(1)} of the largest value of each unit, by ${other}.`, false);
    else if (reason) this.sayAccuracy(`How accurate this run is beyond t = ${format(from)} s is not known: ${other} ends there (${reason}).`, true);
    else this.sayAccuracy(`From t = ${format(from)} s on this run is not to be relied on: ${other} goes another way.`, true);
  }

  makePicture() {
    const { picture } = this.data;
    $("picture").hidden = picture === null;
    if (picture === null) return;
    this.movers = movers(picture);
    this.stage = new Stage(picture, $("stage"), `Schematic of ${this.data.title}`);
    this.forceOf = new Map(picture.items.map((i) => [i, forceNames(i, this.unitOf)]).filter(([, names]) => names.length));
    $("forces").disabled = this.forceOf.size === 0;
    if ($("forces").disabled) $("forces").parentElement.title = "nothing in the picture pulls or pushes";
    const { swinging } = this.data;
    $("swinging").hidden = swinging.modes.length === 0;
    $("mode").append(new Option("the run", ""), ...swinging.modes.map(({ label }, k) => new Option(`mode ${k + 1}: ${label}`, k)));
    $("mode").addEventListener("change", () => this.draw());
    listenToHand(this.stage, {
      wanted: (item) => item.part !== "" || canBeTaken(item),
      pick: (k) => this.choose(picture.items[k].part === this.card.part ? "" : picture.items[k].part),
      take: (k, place) => this.take(k, place),
      move: (place) => this.move(place),
      drop: () => this.drop(),
    });
  }

  listen() {
    $("play").addEventListener("click", () => this.player.toggle());
    $("before").addEventListener("click", () => this.toEvent(-1));
    $("after").addEventListener("click", () => this.toEvent(1));
    $("time").addEventListener("input", () => this.player.seek(Number($("time").value)));
    $("speed").addEventListener("change", () => {
      this.player.speed = Number($("speed").value);
      this.remember();
    });
    $("loop").addEventListener("change", () => (this.player.loop = $("loop").checked));
    $("forces").addEventListener("change", () => this.setForces($("forces").checked));
    $("reset").addEventListener("click", () => this.reset());
    $("keep").addEventListener("click", () => this.keep());
    $("share").addEventListener("click", () => this.share());
    document.addEventListener("keydown", (event) => this.key(event));
    addEventListener("resize", () => [this.plots, this.energy].forEach((plots) => plots.fit()));
    $("over").addEventListener("change", () => this.putOver($("over").value.trim()));
    addEventListener("hashchange", () => {
      if (location.hash.slice(1) === this.fragment()) return;
      const state = read(location.hash);
      this.put(state);
      this.putRuns(state);
    });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    for (const speed of this.player.speeds) $("speed").append(new Option(`${speed}×`, String(speed)));
    Object.assign($("time"), { min: this.player.begin, max: this.player.end, step: "any" });
  }

  key(event) {
    if (event.target.closest?.("input, select, textarea, button, summary") || event.ctrlKey || event.metaKey || event.altKey) return;
    const { player } = this;
    const step = (player.end - player.begin) / STEP;
    const actions = {
      " ": () => player.toggle(),
      ArrowLeft: () => player.seek(player.t - step),
      ArrowRight: () => player.seek(player.t + step),
      ",": () => this.toEvent(-1),
      ".": () => this.toEvent(1),
      Home: () => player.seek(player.begin),
      End: () => player.seek(player.end),
      "+": () => player.faster(1),
      "-": () => player.faster(-1),
      l: () => this.setLoop(!player.loop),
      f: () => this.setForces(!this.forces),
    };
    if (!(event.key in actions)) return;
    event.preventDefault();
    actions[event.key]();
  }

  // ---------------------------------------------------------------- the state

  /** Take over of a state read from the address what needs no run. */
  put(state) {
    if (state.show !== null) this.chooser.put(state.show);
    this.over = this.answer.has(state.over) ? state.over : "";
    $("over").value = this.over;
    this.player.speed = state.speed ?? this.player.usual;
    this.player.t = this.player.begin + state.t;
    this.forces = state.forces && !$("forces").disabled;
    $("forces").checked = this.forces;
    this.card.choose(state.part, this.answer, null);
    this.stage?.choose(this.card.part);
    this.draw();
    this.player.seek(this.player.t);
    this.writePlayer();
  }

  /** … and what does. */
  async putRuns({ set, init, pulls, against, t }) {
    if (this.engine === null) return;
    Object.assign(this, { init, pulls, against: null });
    this.sliders.put(set);
    if (against !== null && (await this.repeated)) {
      const found = await this.engine.ask("run", { times: this.times, values: against.set, initial: against.init });
      if (found !== null) this.against = { ...against, answer: revived(found) };
    }
    await this.simulate();
    this.player.seek(this.player.begin + t);
  }

  /** Run with the values of the sliders, and from the start that was given. */
  async simulate() {
    const serial = ++this.serial;
    if (!(await this.repeated) || serial !== this.serial) return;
    const { sliders, init, pulls, times, given } = this;
    const values = { ...sliders.values };
    const moved = Object.keys(values).length + Object.keys(init).length + pulls.length > 0;
    const request = { times, values, initial: init, pulls };
    const found = moved ? await this.engine.ask("run", request) : given;
    if (found === null || serial !== this.serial) return; // a later one has taken its place
    this.putAnswer(moved ? revived(found) : given, moved);
    if (moved) this.findAccuracy(request);
    else this.sayAccuracy(...this.repetition);
  }

  putAnswer(answer, moved) {
    this.answer = answer;
    this.player.end = this.answer.time.at(-1) ?? this.player.end;
    $("time").max = String(this.player.end);
    $("trouble").textContent = moved && this.answer.reason ? `With these values: ${this.answer.reason}.` : "";
    $("reset").disabled = !moved;
    this.starts.put(this.init, (name) => this.answer.of(name)[0]);
    this.draw();
    this.remember();
    tellFrame({ ...this.sliders?.values }, this.init);
  }

  /** Begin with other states. */
  started(init) {
    this.init = { ...init };
    return this.simulate();
  }

  reset() {
    this.init = {};
    this.pulls = [];
    this.sliders?.setAll({});
  }

  keep() {
    const { sliders, init, answer } = this;
    this.against = this.against === null ? { set: { ...sliders?.values }, init: { ...init }, answer } : null;
    this.draw();
    this.remember();
  }

  choose(part) {
    this.card.choose(part, this.answer, this.against?.answer ?? null);
    this.card.show(this.player.t);
    this.stage?.choose(this.card.part);
    if (this.card.part) $("card").scrollIntoView({ block: "nearest" });
    this.remember();
  }

  /** Plot over a variable; over time where there is none of that name. */
  putOver(name) {
    this.over = this.answer.has(name) ? name : "";
    $("over").value = this.over;
    this.draw();
    this.remember();
  }

  setForces(on) {
    this.forces = on && !$("forces").disabled;
    $("forces").checked = this.forces;
    this.show(this.player.t);
    this.remember();
  }

  setLoop(on) {
    this.player.loop = $("loop").checked = on;
  }

  /** Go to the next event in a direction, and say what happens there. */
  toEvent(way) {
    const { player, answer } = this;
    const own = answer.events.filter((e) => e.time !== null && (e.time - player.t) * way > 1e-12 * Math.abs(player.t));
    const next = way > 0 ? own[0] : own.at(-1);
    if (player.playing) player.pause();
    player.seek(next?.time ?? (way > 0 ? player.end : player.begin));
  }

  fragment() {
    const { player, chooser, data, against, forces, init, pulls, card } = this;
    const same = chooser.shown.join() === data.shown.join();
    return write({
      t: player.t - player.begin,
      speed: player.speed === player.usual ? null : player.speed,
      set: this.sliders?.values ?? {},
      init,
      pulls,
      against,
      show: same ? null : chooser.shown,
      over: this.over,
      part: card.part,
      forces,
    });
  }

  /** Write the state into the address, without a step in the browser's history. */
  remember() {
    if (location.protocol !== "about:") history.replaceState(null, "", `#${this.fragment()}`);
  }

  async share() {
    this.remember();
    try {
      await navigator.clipboard.writeText(location.href);
      $("share").textContent = "Address copied";
    } catch {
      $("share").textContent = "The address holds the state";
    }
    setTimeout(() => ($("share").textContent = "Share"), 2000);
  }

  // ---------------------------------------------------------------- the hand

  /** Take an item at a place of the picture: whether it can be taken. While the scene runs the hand pulls at it. */
  take(k, place) {
    const { player, engine, motion, swing } = this;
    const item = this.data.picture.items[k];
    if (engine === null || swing !== null || !canBeTaken(item)) return false;
    const pulls = player.playing && gripAt(item, motion.vertex(item, place, this.places(player.t)), this.data.script) !== undefined;
    if (!pulls) {
      if (player.playing) player.pause();
      player.seek(player.begin);
    }
    const vertex = motion.vertex(item, place, this.places(player.t));
    const { names, references, extremes } = motion;
    this.dragged = { item: k, vertex, motion: { names, references, extremes } };
    this.before = JSON.stringify(this.init);
    this.stage.parts[k].group.classList.add("held");
    if (pulls) this.grab(place);
    return true;
  }

  /** Begin to pull. */
  grab(place) {
    const { times, init, pulls, player, engine, dragged } = this;
    this.pulling = { to: place, from: player.t };
    const setup = { times, values: { ...this.sliders.values }, initial: init, pulls, t: player.t, speed: player.speed };
    engine.ask("grab", { ...dragged, ...setup });
  }

  async move(to) {
    const { dragged, engine, pulling } = this;
    if (pulling !== null) {
      pulling.to = to;
      return;
    }
    const asked = { ...dragged, to, values: { ...this.sliders.values }, initial: this.init };
    const found = await engine.ask("reach", asked).catch(({ message }) => this.sayHeld(`The scene does not go there: ${message}.`));
    if (!found || this.dragged === null) return;
    this.init = found.initial;
    this.stage.show(this.motion, found.places);
    this.starts.put(this.init, (name) => found.states[name]);
  }

  /** A frame of the scene with the hand in it. */
  async pullUntil(t) {
    const { engine, pulling } = this;
    const found = await engine.ask("pull", { to: pulling.to, t });
    if (found === null || this.pulling !== pulling) return;
    this.stage.show(this.motion, found.places);
    this.stage.showHand(found.at, pulling.to);
  }

  async drop() {
    const { pulling, dragged } = this;
    const part = this.data.picture.items[dragged.item].part || "this";
    this.stage.parts[dragged.item].group.classList.remove("held");
    this.dragged = null;
    if (pulling === null) {
      await this.simulate();
      if (JSON.stringify(this.init) === this.before) this.sayHeld(`${part} has no other place at the start: the scene holds it there.`);
      return;
    }
    const serial = ++this.serial;
    const found = await this.engine.ask("letGo", {});
    this.pulling = null;
    this.stage.showHand(null);
    if (found === null || serial !== this.serial) return;
    this.pulls = found.pulls;
    this.putAnswer(revived(found), true);
    const gives = found.pulls.some(([t, , [stiffness]]) => t >= pulling.from && stiffness > 0);
    if (!gives) this.sayHeld(`${part} does not give way to a pull: the scene holds it, or prescribes how it moves.`);
    this.findAccuracy({ times: this.times, values: { ...this.sliders.values }, initial: this.init, pulls: this.pulls });
  }

  /** Say why nothing has happened, where nothing else is to be said. */
  sayHeld(text) {
    if ($("trouble").textContent === "") $("trouble").textContent = text;
  }

  // ---------------------------------------------------------------- showing

  /** Draw everything that depends on the answer. */
  draw() {
    const { data, answer, against } = this;
    const other = against?.answer ?? null;
    const make = (...given) => new PhasePlot(...given);
    if (this.over) this.plots.drawOver(this.over, this.chooser.shown, answer, other, this.unitOf, make);
    else this.plots.draw(this.chooser.shown, answer, other, this.unitOf);
    this.energy.clear();
    this.energy.events = answer.events;
    if (data.energy !== null && answer.time.length > 1) {
      this.energy.drawEnergy(answer, data.energy, answer === this.given ? data.energy.text : balance(answer, data.energy));
    }
    showEvents($("events"), answer.events, (t) => this.player.seek(t));
    for (const id of ["before", "after"]) $(id).hidden = answer.events.length === 0;
    $("keep").setAttribute("aria-pressed", String(against !== null));
    $("keep").textContent = against === null ? "Record this run" : "Forget the recorded run";
    if (data.picture !== null) this.motion = this.newMotion();
    this.shades.put(answer);
    this.values = answer.reader(this.chooser.shown);
    this.otherValues = other?.reader(this.chooser.shown) ?? null;
    this.card.choose(this.card.part, answer, other);
    this.show(this.player.t);
  }

  newMotion() {
    const { answer, against, movers: names, data } = this;
    const columns = names.map((name) => answer.of(name));
    this.places = answer.reader(names);
    this.otherPlaces = against?.answer.reader(names) ?? null;
    const first = columns.map((c) => c[0] ?? NaN);
    const { swinging } = data;
    const mode = $("mode").value === "" ? null : swinging.modes[Number($("mode").value)];
    const extremes = names.map((name, k) => {
      const others = against === null ? [] : [against.answer.of(name)];
      return [columns[k], ...others].reduce(([low, high], c) => c.reduce(widen, [low, high]), [Infinity, -Infinity]);
    });
    this.swing = mode === null ? null : new ModeMotion(mode, swinging.names, names, first, extremes, this.unitOf);
    this.forceValues = answer.reader([...this.forceOf.values()].flat());
    this.largestForce = 0;
    for (const own of this.forceOf.values()) {
      const parts = own.map((name) => answer.of(name));
      parts[0].forEach((_, k) => (this.largestForce = Math.max(this.largestForce, Math.hypot(...parts.map((f) => f[k])) || 0)));
    }
    const motion = new Motion(data.picture, names, first, extremes);
    const every = Math.max(1, Math.ceil(answer.time.length / INSTANTS));
    const places = (k) => columns.map((c) => c[Math.min(k * every, answer.time.length - 1)]);
    this.stage.makeRoom(motion, places, this.swing === null ? Math.ceil(answer.time.length / every) + 1 : 0);
    return motion;
  }

  /** Show the instant t. */
  show(t) {
    $("time").value = String(t);
    $("time").setAttribute("aria-valuetext", `${t.toFixed(3)} seconds`);
    $("now").textContent = `t = ${t.toFixed(3)} s`;
    if (this.pulling !== null) {
      this.pullUntil(t);
      return;
    }
    if (this.motion !== null) {
      const values = this.swing === null ? this.places(t) : this.swing.at(t);
      this.stage.show(this.motion, values, this.swing === null ? (this.otherPlaces?.(t) ?? null) : null);
      this.showForces(t, values);
    }
    for (const shown of [this.plots, this.energy, this.card, this.shades]) shown.show(t);
    this.writeValues(t);
    $("modes").textContent = modesText(this.answer, t);
    const event = this.answer.events.findLast((e) => e.time === t);
    $("happened").textContent = event === undefined ? "" : eventText(event);
  }

  showForces(t, values) {
    const shown = this.forces && this.swing === null && this.largestForce > 0;
    $("scale").textContent = shown ? `(longest ${format(this.largestForce)} N)` : "";
    if (!shown) {
      this.stage.showForces(this.motion, values, new Map(), 1);
      return;
    }
    const now = this.forceValues(t);
    let next = 0;
    const forces = new Map([...this.forceOf].map(([item, { length }]) => [item, now.slice(next, (next += length))]));
    this.stage.showForces(this.motion, values, forces, this.largestForce);
  }

  /** The values as text, those of the recorded run beside them. */
  writeValues(t) {
    const body = $("values");
    const names = this.chooser.shown;
    if (this.shownNames !== names) {
      this.shownNames = names;
      body.replaceChildren(...names.map((name) => tableRow([name, "", this.unitOf(name), ""])));
    }
    if (this.values === undefined) return;
    const values = this.values(t);
    const others = this.otherValues?.(t);
    for (let k = 0; k < names.length; k++) {
      body.children[k].children[1].textContent = format(values[k]);
      body.children[k].children[3].textContent = others ? `recorded ${format(others[k])}` : "";
    }
  }

  writePlayer() {
    const { player } = this;
    $("play").textContent = player.playing ? "Pause" : "Play";
    $("play").setAttribute("aria-pressed", String(player.playing));
    $("speed").value = String(player.speed);
    $("loop").checked = player.loop;
    if (!player.playing) this.remember();
  }
}

/** The variables of the force of an item: one between its two ends or along the way of its only one, or two in the plane. */
function forceNames({ ends, symbol, variables: { force, fx, fy } }, unitOf) {
  if (fx && fy) return [fx, fy];
  return unitOf(force) === "N" && (ends.length === 2 || (symbol === "force" && ends[0].moves.length > 0)) ? [force] : [];
}

/** Whether an item goes or turns with the motion. */
function canBeTaken(item) {
  return item.ends.some((end) => end.moves.length) || item.turn.variable !== "" || Boolean(item.variables.angle);
}

function widen([low, high], value) {
  return Number.isFinite(value) ? [Math.min(low, value), Math.max(high, value)] : [low, high];
}

/** The error of the ledger of an answer, in words; `exchanged` is what the stores of the compiler's run exchange. */
function balance(answer, { stored, supplied, lost, exchanged }) {
  const [s, p, l] = [stored, supplied, lost].map((name) => answer.of(name));
  let worst = 0;
  let scale = exchanged;
  for (let k = 0; k < s.length; k++) {
    worst = Math.max(worst, Math.abs(p[k] - p[0] - (l[k] - l[0]) - (s[k] - s[0])));
    scale = Math.max(scale, Math.abs(p[k] - p[0]), Math.abs(l[k] - l[0]), Math.abs(s[k] - s[0]));
  }
  return scale > 0 ? `error of the balance ${format(worst / scale)}` : "nothing stored, supplied or lost";
}
