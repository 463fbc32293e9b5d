// What the page says of one part: its equations, its values at an instant, its curves.

import { format } from "./controls.js";
import { $, putText } from "./dom.js";
import { Plots } from "./plots.js";

const MOST_VALUES = 24;
const MOST_CURVES = 4;

/** Rows [name, value, …] of a table whose first column are heads. */
export function tableRow(cells) {
  const row = document.createElement("tr");
  cells.forEach((cell, k) => {
    const own = Object.assign(document.createElement(k ? "td" : "th"), k ? { textContent: cell } : { scope: "row" });
    if (k === 0) own.append(Object.assign(document.createElement("code"), { textContent: cell }));
    row.append(own);
  });
  return row;
}

export class Card {
  /** `parts` are {name, class, text, equations}; `chosen(name)` is called where one is chosen from the list. */
  constructor(parts, names, unitOf, around, chosen) {
    Object.assign(this, { parts: new Map(parts.map((p) => [p.name, p])), names, unitOf, part: "" });
    this.plots = new Plots($("part-plots"), around);
    $("part").append(...parts.map(({ name }) => new Option(name, name)));
    $("part").addEventListener("change", () => chosen($("part").value));
    $("parts").hidden = parts.length === 0;
  }

  choose(name, answer, against) {
    const part = this.parts.get(name);
    this.part = part === undefined ? "" : name;
    $("part").value = this.part;
    $("about").hidden = part === undefined;
    this.plots.clear();
    if (part === undefined) return;
    $("part-text").textContent = [part.class, part.text].filter(Boolean).join(": ");
    $("part-equations").textContent = part.equations.join("\n");
    const own = this.names.filter((n) => n.startsWith(`${name}.`) && answer.has(n));
    this.own = own.slice(0, MOST_VALUES);
    const rows = this.own.map((n) => tableRow([n.slice(name.length + 1), "", "", this.unitOf(n)]));
    $("part-values").replaceChildren(...rows);
    this.read = answer.reader(this.own);
    this.readAgainst = against?.reader(this.own) ?? null;
    this.plots.draw(curvesOf(own, answer), answer, against, this.unitOf);
  }

  show(t) {
    if (this.part === "") return;
    const rows = $("part-values").rows;
    const [values, others] = [this.read(t), this.readAgainst?.(t)];
    this.own.forEach((_, k) => {
      putText(rows[k].cells[1], format(values[k]));
      putText(rows[k].cells[2], others ? `(${format(others[k])})` : "");
    });
    this.plots.show(t);
  }
}

/** The variables of a part that say most: what changes, of its ports where nothing of its own does. */
function curvesOf(names, answer) {
  const moving = names.filter((name) => {
    const values = answer.of(name);
    return values.some((v) => Math.abs(v - values[0]) > 1e-12 * Math.abs(values[0]));
  });
  const depth = (name) => name.split(".").length;
  const least = Math.min(...moving.map(depth));
  return moving.filter((name) => depth(name) === least).slice(0, MOST_CURVES);
}
