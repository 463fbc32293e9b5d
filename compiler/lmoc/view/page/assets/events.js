// The events of an answer as a table, and the modes of its laws at a time.

import { format } from "./controls.js";

const MOST_ROWS = 500;
const MOST_NAMED = 6;
const TITLES = ["t in s", "what", "event", "modes", "impulse", "lost in J"];

/** The modes that an event leads from and to, in words. */
const modesOf = ({ before, after }) => (before === after ? before : [before, after].filter(Boolean).join(" → "));

/** Fill a details element with the events; it is hidden where there are none. `seek(t)` is called where one is chosen. */
export function showEvents(host, events, seek) {
  host.hidden = events.length === 0;
  const lost = events.reduce((sum, e) => sum + (e.energy_lost ?? 0), 0);
  const summary = host.querySelector("summary");
  summary.textContent = `Events (${events.length})${lost ? `: ${format(lost)} J lost` : ""}`;
  const head = row("th", TITLES);
  const rows = events.slice(0, MOST_ROWS).map((event) => {
    const { time, name, kind, impulse, energy_lost: own, note } = event;
    const cells = ["", name, note ? `${kind} (${note})` : kind, modesOf(event), impulse ? format(impulse) : "", own ? format(own) : ""];
    const found = row("td", cells);
    const button = document.createElement("button");
    Object.assign(button, { type: "button", className: "time", textContent: String(Number((time ?? NaN).toPrecision(8))) });
    button.addEventListener("click", () => seek(time));
    found.firstChild.append(button);
    return found;
  });
  const left = events.length - rows.length;
  if (left > 0) rows.push(row("td", [`and ${left} more`]));
  host.querySelector("tbody").replaceChildren(head, ...rows);
}

function row(kind, texts) {
  const found = document.createElement("tr");
  found.append(...texts.map((text) => Object.assign(document.createElement(kind), { textContent: text })));
  return found;
}

/** What an event is, in words. */
export function eventText(event) {
  const { time, name, kind, impulse, energy_lost: lost, note } = event;
  const told = [modesOf(event), note, impulse ? `impulse ${format(impulse)}` : "", lost ? `${format(lost)} J lost` : ""].filter(Boolean);
  return `t = ${Number((time ?? NaN).toPrecision(6))} s, ${name}: ${kind}${told.length ? ` (${told.join(", ")})` : ""}`;
}

/** The modes of laws at a time, in words; of many laws those in the commonest mode are counted. */
export function modesText(answer, t) {
  const now = answer.modesAt(t);
  const byMode = new Map();
  for (const [law, mode] of now) byMode.set(mode, [...(byMode.get(mode) ?? []), law]);
  const told = (laws) => (laws.length > MOST_NAMED ? `${laws.length} laws` : laws.join(", "));
  if (now.length <= MOST_NAMED) return now.map(([law, mode]) => `${law}: ${mode}`).join(" · ");
  return [...byMode].map(([mode, laws]) => `${told(laws)}: ${mode}`).join(" · ");
}
