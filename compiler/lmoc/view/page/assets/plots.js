// Plots over time by uPlot: one panel a unit, the energy as a stacked band, a cursor tied to the picture.

const HEIGHTS = [110, 190]; // px, the least and the most
const MOST_AREAS = 5; // parts whose energy is shown by itself
const NO_REST = 1e-3; // of the largest energy: what changes less is left out
const AROUND = 62; // px of a title and a legend
const LEFT_ALONE = 200; // ms after which what was drawn becomes an image
const ROUNDING = 3e-6; // of a value: given runs have 32 bits, and a curve would have steps
const NARROW = 1e-3; // of a value: where it changes by less, uPlot's range has no width, and it looks for marks without end
const COLOURS = 7; // --c0 … --c6 of the style
const DASHES = [[], [6, 4], [2, 3], [8, 3, 2, 3]];

/** The colour of the k-th curve of a plot. */
export const colourOf = (k) => style(`--c${k % COLOURS}`);

function style(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

/** The range of an axis: a curve that stays at zero lies in the middle; one that stays but for rounding is not blown up. */
function rangeAround(_, low, high) {
  if (low === 0 && high === 0) return [-1, 1];
  const [size, change] = [Math.max(Math.abs(low), Math.abs(high)), high - low];
  if (change > ROUNDING * size && change < NARROW * size) return [low - 0.1 * change, high + 0.1 * change];
  return uPlot.rangeNum(low ?? 0, (change > ROUNDING * size ? high : low) ?? 1, 0.1, true);
}

/** The text at a mark of an axis whose marks are `step` apart, with the digits that tell them from each other. */
export function tickText(value, step) {
  if (value === null || value === 0) return value === 0 ? "0" : "";
  let last = Math.floor(Math.log10(step) + 1e-9); // the place of the last digit
  if (Math.abs(step / 10 ** last - Math.round(step / 10 ** last)) > 1e-6) last -= 1; // marks 0.25 apart
  const first = Math.floor(Math.log10(Math.abs(value)));
  return (last < -4 && first < -2) || first > 6 ? value.toExponential(Math.max(0, first - last)) : value.toFixed(Math.max(0, -last));
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

/** The height in which a plot is seen as a whole in what scrolls around it. */
export const roomIn = (host) => (host.closest("section")?.clientHeight ?? HEIGHTS[1]) - AROUND;

function heightIn(host) {
  return Math.min(HEIGHTS[1], Math.max(HEIGHTS[0], roomIn(host)));
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
        hooks: { draw: [(u) => drawEvents(u, events), () => this.show(this.t), (u) => this.drawn(u)] },
        padding: [8, 16, 0, 0],
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

  /** A canvas costs each frame of the page, an image only those in which it changes: put one in its place when it is left alone. */
  drawn({ ctx: { canvas } }) {
    this.image ??= Object.assign(new Image(), { alt: "", className: "still" });
    if (this.image.parentNode === null) canvas.after(this.image);
    const swap = (still) => [this.image, canvas].forEach((one, k) => (one.style.visibility = still === (k === 0) ? "" : "hidden"));
    swap(false);
    clearTimeout(this.later);
    this.later = setTimeout(async () => {
      const source = (this.image.src = canvas.toDataURL());
      await this.image.decode();
      if (this.image.src === source && this.later !== null) swap(true);
    }, LEFT_ALONE);
  }

  show(t) {
    this.t = t;
    if (!Number.isFinite(t) || this.plot === undefined) return; // it is drawn later, with its scales
    this.cursor.style.transform = `translateX(${this.plot.valToPos(t, "x")}px)`;
  }

  destroy() {
    clearTimeout(this.later);
    this.later = null;
    this.plot.destroy();
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

/** What is stored, {name, values, least}, part by part: those that change most, and the rest together. */
export function areasOf(answer, stored, names) {
  const range = (values) => values.reduce(([a, b], v) => (Number.isFinite(v) ? [Math.min(a, v), Math.max(b, v)] : [a, b]), [Infinity, -Infinity]);
  const found = names.map((name) => [name, answer.of(name)]).map(([name, values]) => ({ name, values, range: range(values) }));
  const change = ({ range: [a, b] }) => b - a;
  const chosen = found.filter((f) => change(f) > 0).sort((a, b) => change(b) - change(a)).slice(0, MOST_AREAS);
  const rest = stored.map((v, k) => chosen.reduce((left, { values }) => left - values[k], v));
  const [least, most] = range(rest);
  const size = Math.max(...range(stored).map(Math.abs), ...chosen.map(change));
  const areas = chosen.map(({ name, values, range: [low] }) => ({ name, values, least: low }));
  if (areas.length > 0 && !(most - least > NO_REST * size)) {
    // what is left over does not change: a constant, which no area shows
    return areas.map((a, k) => (k ? a : { ...a, least: a.least + least, values: a.values.map((v, i) => v + rest[i]) }));
  }
  const floor = least > 0 && most - least < NO_REST * most ? 0 : least;
  return [...areas, { name: areas.length ? "stored in other parts" : "stored (above its least)", values: rest, least: floor }];
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
        stroke: colourOf(k),
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

  /** Draw the variables `names` over another one, a panel a unit. `make(host, …)` makes a panel. */
  drawOver(across, names, answer, against, unitOf, make) {
    this.clear();
    for (const [unit, members] of byUnit(names, unitOf)) {
      const [host, figure] = this.figure(`${members.join(", ")}${unit ? ` in ${unit}` : ""} over ${across}`);
      const label = `${across}${unitOf(across) ? ` in ${unitOf(across)}` : ""}`;
      const describe = `${members.join(", ")} over ${across}`;
      this.panels.push(make(host, members, across, answer, against, { across: label, describe }));
      figure.append(legend(members.map((name, k) => ({ label: name, colour: colourOf(k) }))));
    }
  }

  /** The energy as stacked areas: what each part stores, on it what was lost; the line is what was put in. */
  drawEnergy(answer, { stored, supplied, lost, parts }, text) {
    const [all, given, heat] = [answer.of(stored), answer.booked(supplied), answer.booked(lost)];
    const own = areasOf(answer, all, parts);
    const low = own.reduce((sum, { least }) => sum + least, 0);
    const tops = [];
    for (const { values, least } of own) tops.push(values.map((v, k) => v - least + (tops.at(-1)?.[k] ?? 0)));
    const lostTop = all.map((v, k) => v - low + heat[k] - heat[0]);
    const line = given.map((v) => all[0] - low + v - given[0]);
    const stack = [all.map(() => 0), ...tops, lostTop];
    const colours = [...own.map((_, k) => style(`--c${(k + 2) % COLOURS}`)), style("--c1")];
    const series = [{ stroke: "transparent" }, ...colours.map((stroke) => ({ stroke, width: 1.2 }))];
    series.push({ stroke: style("--ink"), dash: [6, 4], width: 1.2 });
    const bands = colours.map((colour, k) => ({ series: [k + 2, k + 1], fill: `${colour}38` }));
    const entries = [
      ...own.map(({ name }, k) => ({ label: name, colour: colours[k] })),
      { label: "lost", colour: style("--c1") },
      { label: "at the start, and supplied since", colour: style("--ink"), dash: true },
    ];
    this.add(`energy in J; ${text}`, entries, { series, bands }, [answer.time, ...[...stack, line].map(gaps)], `energy over time; ${text}`);
  }

  figure(title) {
    const figure = Object.assign(document.createElement("figure"), { className: "plot", ariaLabel: title });
    const box = document.createElement("div");
    figure.append(Object.assign(document.createElement("figcaption"), { textContent: title }), box);
    this.host.append(figure);
    return [box, figure];
  }

  add(title, entries, options, data, describe) {
    const [box, figure] = this.figure(title);
    figure.append(legend(entries));
    this.panels.push(new Panel(box, options, data, { ...this.around, events: this.events, describe }));
  }

  show(t) {
    for (const panel of this.panels) panel.show(t);
  }

  fit() {
    for (const panel of this.panels) panel.fit();
  }

  clear() {
    for (const panel of this.panels) panel.destroy();
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

/** The error of the ledger of an answer, in words; `exchanged` is what the stores of the compiler's run exchange. */
export function balance(answer, { stored, supplied, lost, exchanged }) {
  const [s, p, l] = [answer.of(stored), answer.booked(supplied), answer.booked(lost)];
  let worst = 0;
  let scale = exchanged;
  for (let k = 0; k < s.length; k++) {
    worst = Math.max(worst, Math.abs(p[k] - p[0] - (l[k] - l[0]) - (s[k] - s[0])) || 0);
    scale = Math.max(scale, Math.abs(p[k] - p[0]) || 0, Math.abs(l[k] - l[0]) || 0, Math.abs(s[k] - s[0]));
  }
  const since = answer.unbooked < Infinity ? ` until t = ${format(answer.unbooked)} s, where a step does work beyond all bounds` : "";
  return scale > 0 ? `error of the balance ${format(worst / scale)}${since}` : "nothing stored, supplied or lost";
}
