// The page: one state, and everything that shows it.

import { read, write } from "./address.js";
import { difference, givenAnswer } from "./answer.js";
import { Chooser, format, Sliders } from "./controls.js";
import { modesText, showEvents } from "./events.js";
import { Motion, movers, Stage } from "./picture.js";
import { ModeMotion } from "./modes.js";
import { Player, SPEEDS } from "./player.js";
import { Plots } from "./plots.js";
import { Repeater } from "./repeat.js";

const AGREES = 1e-6; // of the largest value of the same unit …
const ADD_UP = 50; // … or this many times the tolerance: the errors of two runs
const SLOW = 60; // ms that a simulation may take while a slider is moved
const INSTANTS = 200; // at which the picture is looked at for the room that it needs
const STEP = 200; // of these a run is walked through with the arrow keys
const $ = (id) => document.getElementById(id);

/** Open the page. `make` returns the functions of the script, null where there is none. */
export function open(data, make) {
  return new Page(data, make);
}

class Page {
  constructor(data, make) {
    this.data = data;
    const units = new Map(data.variables.map((v) => [v.name, v.unit]));
    this.unitOf = (name) => units.get(name) ?? "";
    this.given = this.answer = givenAnswer(data);
    this.against = null; // {values, answer} that is kept for comparison
    this.forces = false;
    this.motion = this.swing = null;
    const { time } = this.given;
    this.player = new Player(time[0] ?? 0, time[time.length - 1] ?? 0, (t) => this.show(t), () => this.writePlayer());
    const around = { seek: (t) => this.player.seek(t) };
    this.plots = new Plots($("plots"), around);
    const state = read(location.hash);
    const names = data.variables.map((v) => v.name);
    this.chooser = new Chooser($("chooser"), names, state.show?.filter((n) => names.includes(n)) ?? data.shown, () => this.draw());
    this.makeRepeater(make);
    this.makePicture();
    this.listen();
    this.put(state);
  }

  // ---------------------------------------------------------------- making

  makeRepeater(make) {
    const { script } = this.data;
    this.repeater = null;
    this.sliders = null;
    if (script.reason) {
      $("repeat").textContent = `The sliders are missing: ${script.reason}.`;
      return;
    }
    const repeater = new Repeater(script, make, this.data, () => performance.now());
    const again = repeater.run(this.data.checkTimes, {});
    if (again.reason && this.data.complete) {
      $("repeat").textContent = `The sliders are missing: repeated in this page, the run does not reach its end (${again.reason}).`;
      return;
    }
    this.repeater = repeater;
    this.times = repeater.timesOf(this.given.time);
    const missed = difference(again, this.data.check, this.data.sizes, this.unitOf, this.data.complete);
    const text = missed === 0 ? "does not differ" : `differs by ${missed.toPrecision(1)} of the largest value of each unit`;
    $("repeat").textContent = `Computed again by this page, the run ${text}.`;
    $("repeat").classList.toggle("warning", !(missed <= Math.max(AGREES, ADD_UP * script.rtol)));
    $("repeat").dataset.difference = String(missed);
    this.sliders = new Sliders($("sliders"), script.parameters, (final) => this.changed(final));
    $("parameters").hidden = script.parameters.length === 0;
    if (script.held.length) $("held").textContent = `The start of ${script.held.join(", ")} stays as it is in this run.`;
  }

  makePicture() {
    const { picture } = this.data;
    $("picture").hidden = picture === null;
    if (picture === null) return;
    this.movers = movers(picture);
    this.stage = new Stage(picture, $("stage"), `Schematic of ${this.data.title}`);
    this.forceOf = new Map(picture.items.filter((i) => i.variables.force).map((i) => [i, i.variables.force]));
    $("forces").disabled = this.forceOf.size === 0;
    if ($("forces").disabled) $("forces").parentElement.title = "nothing in the picture pulls between two points";
    const { swinging } = this.data;
    $("swinging").hidden = swinging.modes.length === 0;
    $("mode").append(new Option("the run", ""), ...swinging.modes.map(({ label }, k) => new Option(`mode ${k + 1}: ${label}`, k)));
    $("mode").addEventListener("change", () => this.draw());
  }

  listen() {
    $("play").addEventListener("click", () => this.player.toggle());
    $("time").addEventListener("input", () => this.player.seek(Number($("time").value)));
    $("speed").addEventListener("change", () => {
      this.player.speed = Number($("speed").value);
      this.remember();
    });
    $("loop").addEventListener("change", () => (this.player.loop = $("loop").checked));
    $("forces").addEventListener("change", () => this.setForces($("forces").checked));
    $("reset").addEventListener("click", () => this.sliders?.setAll({}));
    $("keep").addEventListener("click", () => this.keep());
    $("share").addEventListener("click", () => this.share());
    document.addEventListener("keydown", (event) => this.key(event));
    addEventListener("resize", () => this.plots.fit());
    addEventListener("hashchange", () => {
      if (location.hash.slice(1) !== this.fragment()) this.put(read(location.hash));
    });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    for (const speed of SPEEDS) $("speed").append(new Option(`${speed}×`, String(speed)));
    Object.assign($("time"), { min: this.player.begin, max: this.player.end, step: "any" });
  }

  key(event) {
    if (event.target.closest?.("input, select, textarea, button") || event.ctrlKey || event.metaKey || event.altKey) return;
    const { player } = this;
    const step = (player.end - player.begin) / STEP;
    const actions = {
      " ": () => player.toggle(),
      ArrowLeft: () => player.seek(player.t - step),
      ArrowRight: () => player.seek(player.t + step),
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

  /** Take over a state read from the address. */
  put(state) {
    if (state.show !== null) this.chooser.put(state.show);
    this.player.speed = state.speed;
    this.player.t = this.player.begin + state.t;
    this.forces = state.forces && !$("forces").disabled;
    $("forces").checked = this.forces;
    this.against = null;
    if (state.against !== null && this.repeater !== null) {
      this.against = { values: state.against, answer: this.repeater.run(this.times, state.against) };
    }
    if (this.sliders !== null) this.sliders.setAll(state.set);
    else this.draw();
    this.player.seek(this.player.t);
    this.writePlayer();
  }

  changed(final) {
    if (!final && this.repeater.spent > SLOW) return;
    this.simulate();
    if (final) this.remember();
  }

  simulate() {
    const moved = Object.keys(this.sliders.values).length > 0;
    this.answer = moved ? this.repeater.run(this.times, this.sliders.values) : this.given;
    this.player.end = this.answer.time.at(-1) ?? this.player.end;
    $("time").max = String(this.player.end);
    $("trouble").textContent = moved && this.answer.reason ? `With these values: ${this.answer.reason}.` : "";
    $("reset").disabled = !moved;
    this.draw();
  }

  keep() {
    this.against = this.against === null ? { values: { ...this.sliders?.values }, answer: this.answer } : null;
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

  fragment() {
    const { player, chooser, data, against, forces } = this;
    const same = chooser.shown.join() === data.shown.join();
    return write({
      t: player.t - player.begin,
      speed: player.speed,
      set: this.sliders?.values ?? {},
      against: against?.values ?? null,
      show: same ? null : chooser.shown,
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

  // ---------------------------------------------------------------- showing

  /** Draw everything that depends on the answer. */
  draw() {
    const { data, answer, against } = this;
    this.plots.draw(this.chooser.shown, answer, against?.answer ?? null, this.unitOf);
    if (data.energy !== null && answer.time.length > 1) {
      this.plots.drawEnergy(answer, data.energy, answer === this.given ? data.energy.text : balance(answer, data.energy));
    }
    showEvents($("events"), answer.events, (t) => this.player.seek(t));
    $("keep").setAttribute("aria-pressed", String(against !== null));
    $("keep").textContent = against === null ? "Compare with these" : "Compare no more";
    if (data.picture !== null) this.motion = this.newMotion();
    this.values = answer.reader(this.chooser.shown);
    this.show(this.player.t);
  }

  newMotion() {
    const { answer, against, movers: names, data } = this;
    const columns = names.map((name) => answer.of(name));
    this.places = answer.reader(names);
    const first = columns.map((c) => c[0] ?? NaN);
    const { swinging } = data;
    const mode = $("mode").value === "" ? null : swinging.modes[Number($("mode").value)];
    const extremes = names.map((name, k) => {
      const others = against === null ? [] : [against.answer.of(name)];
      return [columns[k], ...others].reduce(([low, high], c) => c.reduce(widen, [low, high]), [Infinity, -Infinity]);
    });
    this.swing = mode === null ? null : new ModeMotion(mode, swinging.names, names, first, extremes, this.unitOf);
    this.largestForce = 0;
    for (const name of new Set(this.forceOf.values())) {
      for (const f of answer.of(name)) if (Number.isFinite(f)) this.largestForce = Math.max(this.largestForce, Math.abs(f));
    }
    const forces = [...new Set(this.forceOf.values())];
    this.forceValues = answer.reader(forces);
    this.forceIndex = new Map(forces.map((name, k) => [name, k]));
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
    if (this.motion !== null) {
      const values = this.swing === null ? this.places(t) : this.swing.at(t);
      this.stage.show(this.motion, values);
      this.showForces(t, values);
    }
    this.plots.show(t);
    this.writeValues(t);
    this.writeModes(t);
  }

  showForces(t, values) {
    if (!this.forces || this.swing !== null || !(this.largestForce > 0)) {
      this.stage.showForces(this.motion, values, null, 1);
      return;
    }
    const forces = this.forceValues(t);
    const of = (item) => (this.forceOf.has(item) ? forces[this.forceIndex.get(this.forceOf.get(item))] : NaN);
    this.stage.showForces(this.motion, values, of, this.largestForce);
  }

  /** The values as text, beside the plots. */
  writeValues(t) {
    const body = $("values");
    const names = this.chooser.shown;
    if (body.children.length !== names.length || this.shownNames !== names) {
      this.shownNames = names;
      body.replaceChildren(
        ...names.map((name) => {
          const row = document.createElement("tr");
          const head = Object.assign(document.createElement("th"), { scope: "row" });
          head.append(Object.assign(document.createElement("code"), { textContent: name }));
          row.append(head, document.createElement("td"), document.createElement("td"));
          row.lastChild.textContent = this.unitOf(name);
          return row;
        }),
      );
    }
    if (this.values === undefined) return;
    const values = this.values(t);
    for (let k = 0; k < names.length; k++) body.children[k].children[1].textContent = format(values[k]);
  }

  writeModes(t) {
    $("modes").textContent = modesText(this.answer, t);
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

function widen([low, high], value) {
  return Number.isFinite(value) ? [Math.min(low, value), Math.max(high, value)] : [low, high];
}

/** The error of the ledger of an answer, in words. */
function balance(answer, { stored, supplied, lost }) {
  const [s, p, l] = [stored, supplied, lost].map((name) => answer.of(name));
  let worst = 0;
  let scale = 0;
  for (let k = 0; k < s.length; k++) {
    worst = Math.max(worst, Math.abs(p[k] - p[0] - (l[k] - l[0]) - (s[k] - s[0])));
    scale = Math.max(scale, Math.abs(p[k] - p[0]), Math.abs(l[k] - l[0]), Math.abs(s[k] - s[0]));
  }
  return scale > 0 ? `error of the balance ${format(worst / scale)}` : "nothing stored, supplied or lost";
}
