// What the hand does to the scene: at rest it changes the start, while the scene runs it pulls.

import { revived } from "./answer.js";
import { $ } from "./dom.js";
import { gripAt } from "./grip.js";
import { canBeTaken } from "./motion.js";

export class Drag {
  constructor(page) {
    this.page = page;
    this.held = null; // {item, vertex, motion} of what the hand holds
    this.pulling = null; // {to, from} while it pulls
  }

  /** Take an item at a place of the picture: whether it can be taken. While the scene runs the hand pulls at it. */
  take(k, place) {
    const { player, engine, motion, swing, places, data, stage, init } = this.page;
    const item = data.picture.items[k];
    if (engine === null || swing !== null || !canBeTaken(item)) {
      if (swing !== null) sayHeld("The picture swings in a mode: only in the run parts follow the hand.");
      else if (engine !== null) sayHeld(item.part ? `${item.part} does not move in the picture.` : "This arrow shows how a coordinate counts: drag the part that moves.");
      return false;
    }
    const pulls = player.playing && gripAt(item, motion.vertex(item, place, places(player.t)), data.script) !== undefined;
    if (!pulls) {
      if (player.playing) player.pause();
      player.seek(player.begin);
    }
    const vertex = motion.vertex(item, place, places(player.t));
    const { names, references, extremes } = motion;
    this.held = { item: k, vertex, motion: { names, references, extremes }, watched: this.page.watched() };
    this.before = JSON.stringify(init);
    stage.partOf.get(item).group.classList.add("held");
    if (pulls) this.grab(place);
    return true;
  }

  /** What keys take, and where: an item of the part that is chosen, else of the first that moves; what can be pulled, and what is at one place, first. */
  first() {
    const { data, card, motion, places, player } = this.page;
    const { items } = data.picture;
    const own = items.filter(({ part }) => part !== "" && (card.part === "" || part === card.part));
    const rank = (item) => item.ends.length + 9 * (gripAt(item, farthest(item), data.script) === undefined);
    const moving = own.filter(canBeTaken).sort((a, b) => rank(a) - rank(b));
    const item = moving[0] ?? own[0] ?? items[0];
    return [items.indexOf(item), motion.point(item, farthest(item), places(player.t))];
  }

  /** Begin to pull. */
  grab(place) {
    const { player, engine } = this.page;
    this.pulling = { to: place, from: player.t };
    engine.ask("grab", { ...this.held, ...this.page.request(), t: player.t, speed: player.speed });
  }

  async move(to) {
    const { held, pulling, page } = this;
    if (pulling !== null) {
      pulling.to = to;
      return;
    }
    const { values, initial } = page.request();
    const asked = { ...held, to, values, initial };
    const found = await page.engine.ask("reach", asked).catch(({ message }) => sayHeld(`The scene does not go there: ${message}.`));
    if (!found || this.held === null) return;
    page.init = found.initial;
    page.showHeld(found, page.player.t);
    page.starts.put(page.init, (name) => found.states[name]);
  }

  /** A frame of the scene with the hand in it. */
  async pullUntil(t) {
    const { pulling, page } = this;
    const found = await page.engine.ask("pull", { to: pulling.to, t });
    if (found === null || this.pulling !== pulling) return;
    page.showHeld(found, t);
    page.stage.showHand(found.at, pulling.to);
  }

  async drop() {
    const { pulling, held, page } = this;
    const part = page.data.picture.items[held.item].part || "this";
    page.stage.partOf.get(page.data.picture.items[held.item]).group.classList.remove("held");
    this.held = null;
    if (pulling === null) {
      await page.simulate();
      if (JSON.stringify(page.init) === this.before) sayHeld(`${part} has no other place at the start: the scene holds it there.`);
      return;
    }
    const serial = ++page.serial;
    const found = await page.engine.ask("letGo", {});
    this.pulling = null;
    page.stage.showHand(null);
    if (found === null || serial !== page.serial) return;
    page.pulls = found.pulls;
    page.putAnswer(revived(found), true);
    const gives = found.pulls.some(([t, , [stiffness]]) => t >= pulling.from && stiffness > 0);
    if (!gives) sayHeld(`${part} does not give way to a pull: the scene holds it, or prescribes how it moves.`);
    page.findAccuracy(page.request());
  }
}

/** The vertex at which an item is taken: where it moves, or far from where it turns. */
function farthest({ ends, turn, shapes }) {
  if (ends.length > 1) return [ends[1].moves.length ? 1 : 0, 0, 0];
  if (ends[0].moves.length || !turn.variable) return [0, 0, 0];
  const reach = shapes.flatMap(({ vertices, radius }) => (vertices ?? []).map(([, x, y]) => Math.hypot(x, y)).concat(radius ?? 0));
  return [0, Math.max(...reach), 0];
}

/** Say why nothing has happened, where nothing else is to be said. */
function sayHeld(text) {
  if ($("trouble").textContent === "") $("trouble").textContent = text;
}
