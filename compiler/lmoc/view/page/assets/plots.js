// Plots over time by uPlot: one panel a unit, the energy as a stacked band, a cursor tied to the picture.

const HEIGHTS = [110, 190]; // px, the least and the most
const AROUND = 62; // px of a title and a legend
const COLOURS = 7; // --c0 … --c6 of the style
const DASHES = [[], [6, 4], [2, 3], [8, 3, 2, 3]];

function style(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

/** The range of an axis: a curve that stays at zero lies in the middle. */
function rangeAround(_, low, high) {
  return low === 0 && high === 0 ? [-1, 1] : uPlot.rangeNum(low ?? 0, high ?? 1, 0.1, true);
}

/** The text at a mark of an axis whose marks are `step` apart, with the digits that tell them from each other. */
export function tickText(value, step) {
  if (value === null || value === 0) return value === 0 ? "0" : "";
  let last = Math.floor(Math.log10(step) + 1e-9); // the place of the last digit
  if (Math.abs(step / 10 ** last - Math.round(step / 10 ** last)) > 1e-6) last -= 1; // marks 0.25 apart
  const first = Math.floor(Math.log10(Math.abs(value)));
  return last < -4 || first > 6 ? value.toExponential(Math.max(0, first - last)) : value.toFixed(Math.max(0, -last));
}

/** Names by unit, in order of appearance. */
export function byUnit(names, unitOf) {
  const panels = new Map();
  for (const name of names) {
    const unit = unitOf(name);
    if (!panels.has(unit)) panels.set(unit, []);
    panels.get(unit).push(name);
  }
  return [...panels];
}

/** The height with which a plot fits into what scrolls around it. */
function heightIn(host) {
  const room = host.closest("section")?.clientHeight ?? HEIGHTS[1];
  return Math.min(HEIGHTS[1], Math.max(HEIGHTS[0], room - AROUND));
}

/** A plot with the line of the current time. `seek(t)` is called where it is pressed or dragged. */
class Panel {
  constructor(host, options, data, { events, seek, describe }) {
    this.host = host;
    this.cursor = Object.assign(document.createElement("div"), { className: "cursor" });
    const values = (_, splits, __, ___, step) => splits.map((v) => tickText(v, step));
    const axis = { values, stroke: style("--muted"), grid: { stroke: style("--grid"), width: 1 }, ticks: { show: false } };
    this.plot = new uPlot(
      {
        width: Math.max(200, host.clientWidth),
        height: heightIn(host),
        legend: { show: false },
        cursor: { drag: { x: false, y: false }, points: { show: false } },
        scales: { x: { time: false }, y: { range: rangeAround }, ...(options.scales ?? {}) },
        axes: [{ ...axis, size: 30 }, { ...axis, size: 62 }],
        series: [{}, ...options.series],
        bands: options.bands ?? [],
        hooks: { draw: [(u) => drawEvents(u, events), () => this.show(this.t)] },
        padding: [8, 8, 0, 0],
      },
      data,
      host,
    );
    this.plot.over.append(this.cursor);
    this.plot.root.setAttribute("role", "img");
    this.plot.root.setAttribute("aria-label", describe);
    const press = (event) => {
      if (event.buttons !== 1) return;
      const box = this.plot.over.getBoundingClientRect();
      seek(this.plot.posToVal(event.clientX - box.left, "x"));
    };
    this.plot.over.addEventListener("pointerdown", press);
    this.plot.over.addEventListener("pointermove", press);
  }

  show(t) {
    this.t = t;
    if (!Number.isFinite(t) || this.plot === undefined) return; // it is drawn later, with its scales
    this.cursor.style.transform = `translateX(${this.plot.valToPos(t, "x")}px)`;
  }

  fit() {
    this.plot.setSize({ width: Math.max(200, this.host.clientWidth), height: heightIn(this.host) });
  }
}

function drawEvents(u, events) {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.strokeStyle = style("--muted");
  ctx.setLineDash([2, 4]);
  ctx.beginPath();
  for (const { time } of events) {
    const x = u.valToPos(time, "x", true);
    if (x < bbox.left || x > bbox.left + bbox.width) continue;
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
  }
  ctx.stroke();
  ctx.restore();
}

/** Where the band of stored energy begins: at its least, but at zero where it changes by no more than errors. */
function floorOf(stored) {
  const found = stored.filter(Number.isFinite);
  const least = found.reduce((a, b) => Math.min(a, b), Infinity), most = found.reduce((a, b) => Math.max(a, b), -Infinity);
  return least > 0 && most - least < 1e-3 * most ? 0 : least;
}

function legend(entries) {
  const list = Object.assign(document.createElement("ul"), { className: "legend" });
  for (const { label, colour, dash } of entries) {
    const entry = document.createElement("li");
    const line = Object.assign(document.createElement("span"), { className: dash ? "swatch dashed" : "swatch" });
    line.style.borderColor = colour;
    entry.append(line, label);
    list.append(entry);
  }
  return list;
}

/** uPlot leaves a gap at null, and only there. */
const gaps = (values) => Array.from(values, (v) => (Number.isFinite(v) ? v : null));

/** All plots of the page; `draw` makes them anew, `show` moves their cursors. */
export class Plots {
  constructor(host, around) {
    Object.assign(this, { host, around, panels: [], events: [] });
  }

  /** Draw the variables `names` of an answer, and dashed those of another one that it is compared with. */
  draw(names, answer, against, unitOf) {
    this.clear();
    this.events = answer.events;
    for (const [unit, members] of byUnit(names, unitOf)) {
      const series = members.map((name, k) => ({
        stroke: style(`--c${k % COLOURS}`),
        width: 1.8,
        dash: DASHES[Math.floor(k / COLOURS) % DASHES.length],
        label: name,
      }));
      const data = [answer.time, ...members.map((name) => gaps(answer.of(name)))];
      const entries = series.map((s) => ({ label: s.label, colour: s.stroke }));
      if (against !== null) {
        series.push(...series.map((s) => ({ ...s, width: 1.2, dash: [4, 4], label: `${s.label} (kept)` })));
        data.push(...members.map((name) => gaps(sampled(against, name, answer.time))));
        entries.push({ label: "kept", colour: style("--muted"), dash: true });
      }
      const title = unit ? `${members.length > 3 ? "" : `${members.join(", ")} `}in ${unit}` : members.join(", ");
      this.add(title, entries, { series }, data, `${members.join(", ")} over time`);
    }
  }

  /** The energy as a stacked band: what is stored, on it what was lost; the line is what was put in. */
  drawEnergy(answer, { stored, supplied, lost }, text) {
    const values = [stored, supplied, lost].map((name) => answer.of(name));
    const low = floorOf(values[0]);
    const [s0, p0, l0] = values.map((v) => v[0]);
    const held = values[0].map((v) => v - low);
    const heat = values[2].map((v, k) => held[k] + (v - l0));
    const given = values[1].map((v) => s0 - low + (v - p0));
    const zero = values[0].map(() => 0);
    const line = (name) => ({ stroke: style(name), width: 1.5 });
    const series = [line("--c1"), line("--c2"), { stroke: "transparent" }, { ...line("--ink"), dash: [6, 4], width: 1.2 }];
    const bands = [
      { series: [1, 2], fill: style("--c1-band") },
      { series: [2, 3], fill: style("--c2-band") },
    ];
    const entries = [
      { label: "lost", colour: style("--c1") },
      { label: low === 0 ? "stored" : "stored (above its least)", colour: style("--c2") },
      { label: "at the start, and supplied since", colour: style("--ink"), dash: true },
    ];
    const data = [answer.time, ...[heat, held, zero, given].map(gaps)];
    this.add(`energy in J; ${text}`, entries, { series, bands }, data, `energy over time; ${text}`);
  }

  add(title, entries, options, data, describe) {
    const figure = Object.assign(document.createElement("figure"), { className: "plot" });
    const caption = Object.assign(document.createElement("figcaption"), { textContent: title });
    const box = document.createElement("div");
    figure.append(caption, box, legend(entries));
    this.host.append(figure);
    this.panels.push(new Panel(box, options, data, { ...this.around, events: this.events, describe }));
  }

  show(t) {
    for (const panel of this.panels) panel.show(t);
  }

  fit() {
    for (const panel of this.panels) panel.fit();
  }

  clear() {
    for (const panel of this.panels) panel.plot.destroy();
    this.panels = [];
    this.host.replaceChildren();
  }
}

/** Values of another answer at given times; beyond its end there are none. */
export function sampled(answer, name, times) {
  const read = answer.reader([name]);
  const last = answer.time[answer.time.length - 1];
  return Float64Array.from(times, (t) => (t > last ? NaN : read(t)[0]));
}
