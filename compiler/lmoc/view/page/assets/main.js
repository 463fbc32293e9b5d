// The page: one state, and everything that shows it.

import { Accuracy } from "./accuracy.js";
import { read, write } from "./address.js";
import { givenAnswer, revived } from "./answer.js";
import { Card } from "./card.js";
import { Chooser, format, Sliders, Starts } from "./controls.js";
import { $, putText } from "./dom.js";
import { Drag } from "./drag.js";
import { Engine } from "./engine.js";
import { eventText, modesText, showEvents } from "./events.js";
import { Forces } from "./forces.js";
import { listenToFrame, tellFrame } from "./frame.js";
import { listenToHand, listenToKeys } from "./hand.js";
import { inflatedText } from "./inflate.js";
import { ModeMotion } from "./modes.js";
import { canBeTaken, extremesOf, Motion, movers } from "./motion.js";
import { Stage } from "./picture.js";
import { PhasePlot } from "./phase.js";
import { Player } from "./player.js";
import { balance, Plots } from "./plots.js";
import { Shades } from "./shades.js";
import { Values } from "./values.js";

const INSTANTS = 200; // at which the picture is looked at for the room that it needs
const STEP = 200; // of these a run is walked through with the arrow keys
const OF_CONTROLS = [" ", "Enter", "ArrowLeft", "ArrowRight", "Home", "End"]; // keys that buttons and sliders have themselves
const READ = 100; // ms in which nobody reads another number: while the scene runs, texts stay as long

/** Open the page. `data` and `worker`, the script of its own simulation, are packed, `terms` are those of the equations, as functions. */
export async function open(data, worker, terms) {
  try {
    return new Page(JSON.parse(await inflatedText(data)), await inflatedText(worker), terms);
  } catch (failed) {
    $("trouble").textContent = `The page cannot be opened (${failed}). It needs a browser of 2023 or later.`;
    throw failed;
  }
}

class Page {
  constructor(data, worker, terms) {
    this.data = data;
    const units = new Map(data.variables.map((v) => [v.name, v.unit]));
    this.unitOf = (name) => units.get(name) ?? "";
    this.given = this.answer = givenAnswer(data);
    this.against = null; // {set, init, pulls, answer} of the run that is recorded
    this.init = {}; // states at the start that the hand has given
    this.pulls = []; // [t, part, signals] of the hand while the scene ran
    this.serial = 0;
    this.told = -Infinity; // when texts have been written, ms
    this.engine = this.sliders = this.starts = this.motion = this.swing = null;
    this.accuracy = new Accuracy(data);
    this.drag = new Drag(this);
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
    this.values = new Values($("values"), this.unitOf);
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
    this.stage?.letTake(true);
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
    document.body.removeAttribute("data-busy");
    $("parameters").hidden = true;
    this.stage?.letTake(false);
    $("hint").textContent = `The sliders are missing: ${reason}.`;
  }

  /** Compute the run again; false where that does not come to its end. */
  async repeat(engine) {
    const { reason, times } = await this.accuracy.repeat(engine, this.given);
    this.times = times;
    if (reason) this.withoutEngine(`repeated in this page, the run does not reach its end (${reason})`);
    return !reason;
  }

  findAccuracy(request) {
    const { serial, answer, engine, drag } = this;
    return this.accuracy.find(engine, request, answer, () => serial === this.serial && drag.held === null);
  }

  makePicture() {
    const { picture } = this.data;
    $("picture").hidden = picture === null;
    if (picture === null) return;
    this.movers = movers(picture);
    this.stage = new Stage(picture, $("stage"), `Schematic of ${this.data.title}`);
    this.forces = new Forces(picture.items, this.unitOf);
    const { swinging } = this.data;
    $("swinging").hidden = swinging.modes.length === 0;
    $("mode").append(new Option("the run", ""), ...swinging.modes.map(({ label }, k) => new Option(`mode ${k + 1}: ${label}`, k)));
    $("mode").addEventListener("change", () => {
      this.draw();
      this.remember();
    });
    const { drag } = this;
    const byHand = { take: (k, at) => drag.take(k, at), move: (to) => drag.move(to), drop: () => drag.drop() };
    listenToKeys(this.stage, { ...byHand, first: () => drag.first(), pulls: () => drag.pulling !== null });
    listenToHand(this.stage, {
      ...byHand,
      wanted: (item) => item.part !== "" || item.symbol === "coordinate" || canBeTaken(item),
      pick: (k) => this.choose(picture.items[k].part === this.card.part ? "" : picture.items[k].part),
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
    $("loop").addEventListener("change", () => this.setLoop($("loop").checked));
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
    const own = event.target.closest?.("input, select, textarea, button, summary");
    if (event.ctrlKey || event.metaKey || event.altKey || own?.matches("select, textarea, input:not([type=range], [type=checkbox])")) return;
    if (own && OF_CONTROLS.includes(event.key)) return;
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
      f: () => this.setForces(!this.forces?.on),
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
    this.player.loop = state.loop;
    this.forces?.turn(state.forces);
    $("mode").value = this.data.swinging.modes[state.mode - 1] ? String(state.mode - 1) : "";
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
      const found = await this.engine.ask("run", { times: this.times, values: against.set, initial: against.init, pulls: against.pulls });
      if (found !== null) this.against = { ...against, answer: revived(found) };
    }
    await this.simulate();
    this.player.seek(this.player.begin + t);
  }

  /** Run with the values of the sliders, and from the start that was given. */
  async simulate() {
    const serial = ++this.serial;
    if (!(await this.repeated) || serial !== this.serial) return;
    const { given } = this;
    const request = this.request();
    const moved = [request.values, request.initial, request.pulls].some((given) => Object.keys(given).length > 0);
    const found = moved ? await this.engine.ask("run", request) : given;
    if (found === null || serial !== this.serial) return; // a later one has taken its place
    this.putAnswer(moved ? revived(found) : given, moved);
    if (moved) this.findAccuracy(request);
    else this.accuracy.ofRepetition();
  }

  /** What a run is made with. */
  request() {
    const { times, sliders, init, pulls } = this;
    return { times, values: { ...sliders.values }, initial: init, pulls };
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
    const { sliders, init, pulls, answer } = this;
    this.against = this.against === null ? { set: { ...sliders?.values }, init: { ...init }, pulls: [...pulls], answer } : null;
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
    this.forces?.turn(on);
    if (this.motion !== null) this.motion = this.newMotion();
    this.show(this.player.t);
    this.remember();
  }

  setLoop(on) {
    this.player.loop = $("loop").checked = on;
    this.remember();
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
      forces: forces?.on ?? false,
      mode: $("mode").value === "" ? "" : String(Number($("mode").value) + 1),
      loop: player.loop,
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
    this.values.put(this.chooser.shown, answer, other);
    this.card.choose(this.card.part, answer, other);
    this.show(this.player.t);
  }

  newMotion() {
    const { answer, against, movers: names, data } = this;
    const columns = names.map((name) => answer.of(name));
    this.places = answer.reader(names);
    this.otherPlaces = against?.answer.reader(names) ?? null;
    const first = columns.map((c) => c[0] ?? NaN);
    const mode = data.swinging.modes[$("mode").value] ?? null;
    const extremes = names.map((name, k) => extremesOf([...columns[k], ...(against?.answer.of(name) ?? [])]));
    this.swing = mode === null ? null : new ModeMotion(mode, data.swinging.names, names, first, extremes, this.unitOf);
    this.forces.put(answer);
    const motion = new Motion(data.picture, names, first, extremes);
    const every = Math.max(1, Math.ceil(answer.time.length / INSTANTS));
    const places = (k) => columns.map((c) => c[Math.min(k * every, answer.time.length - 1)]);
    this.stage.makeRoom(motion, places, this.swing === null ? Math.ceil(answer.time.length / every) + 1 : 0, this.forces.items);
    return motion;
  }

  /** Show the instant t. */
  show(t) {
    $("time").value = String(t);
    if (this.drag.pulling !== null) {
      this.drag.pullUntil(t);
      return;
    }
    const stays = this.player.playing && performance.now() - this.told < READ;
    if (!stays) this.tellTime(t);
    if (this.motion !== null) {
      const values = this.swing === null ? this.places(t) : this.swing.at(t);
      this.stage.show(this.motion, values, this.swing === null ? (this.otherPlaces?.(t) ?? null) : null);
      this.forces.show(t, this.stage, this.motion, values, this.swing === null);
    }
    for (const plots of [this.plots, this.energy, this.card.plots]) plots.show(t);
    if (!stays) this.tellValues(t);
  }

  /** Names of what is shown while a hand moves the scene. */
  watched() {
    return [...this.chooser.shown, ...this.forces.all];
  }

  /** Show where a hand has brought the scene at the instant t: `watched` are the values of what `watched()` had named. */
  showHeld({ places, watched }, t) {
    this.stage.show(this.motion, places);
    const stays = performance.now() - this.told < READ;
    if (!stays) this.tellTime(t); // with the values, which the worker has sent: a clock that ran ahead would be of others
    if (watched.length !== this.watched().length) return; // something else has been chosen meanwhile
    const count = this.chooser.shown.length;
    this.forces.draw(watched.slice(count), this.stage, this.motion, places);
    if (!stays) this.values.write(watched.slice(0, count));
  }

  tellTime(t) {
    this.told = performance.now();
    $("time").setAttribute("aria-valuetext", `${t.toFixed(3)} seconds`);
    putText($("now"), `t = ${t.toFixed(3)} s`);
    putText($("whose"), this.whose());
  }

  /** Whose motion plots, values and terms tell, where the picture shows another one. */
  whose() {
    if (this.drag.pulling !== null) return "Until you let go, curves, parts and terms are those before the pull.";
    return this.swing === null ? "" : "The picture swings in a mode; plots and values are of the run.";
  }

  /** Show the instant t in numbers and words. */
  tellValues(t) {
    for (const shown of [this.card, this.shades, this.values]) shown.show(t);
    putText($("modes"), modesText(this.answer, t));
    const event = this.answer.events.findLast((e) => e.time === t);
    putText($("happened"), event === undefined ? "" : eventText(event));
  }

  writePlayer() {
    const { player } = this;
    $("play").textContent = player.playing ? "Pause" : "Play";
    $("play").setAttribute("aria-pressed", String(player.playing));
    $("speed").value = String(player.speed);
    $("loop").checked = player.loop;
    if (player.playing) return;
    this.remember();
    this.tellTime(player.t);
    if (this.drag.pulling === null) this.tellValues(player.t);
  }
}
