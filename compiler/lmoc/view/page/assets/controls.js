// What a reader can set: parameters as sliders, the variables that are shown.

const REACH = 5; // a slider goes from a fifth of the value to five times it
const STEPS = 200;
const MOST_OPEN = 8; // sliders that are seen at first

export function format(value) {
  if (!Number.isFinite(value)) return "–";
  return String(Number(value.toPrecision(5)));
}

/** The value of a slider at a position from -1 to 1: by a factor, or for zero by a difference. */
export function valueAt(base, position) {
  if (position === 0) return base;
  const value = base === 0 ? position : base * REACH ** position;
  return Number(value.toPrecision(4));
}

/** The position of a value; beyond its ends that of the end. */
export function positionOf(base, value) {
  const raw = base === 0 ? value : Math.log(value / base) / Math.log(REACH);
  return Number.isFinite(raw) ? Math.min(Math.max(raw, -1), 1) : -1;
}

/** What the range of a parameter is made of, and how a value is read from it: as its declaration says, or around it. */
export function rangeOf({ value, least, most, step }) {
  if (least === null || least === undefined) {
    const limits = { min: -1, max: 1, step: 1 / STEPS };
    return { limits, valueAt: (position) => valueAt(value, position), positionOf: (v) => positionOf(value, v) };
  }
  const limits = { min: least, max: most, step: step ?? (most - least) / STEPS };
  return { limits, valueAt: (position) => Number(position.toPrecision(12)), positionOf: (v) => v };
}

/** Parameters in groups, [title, open, parameters]: those that matter first, the model's own, then part by part. */
export function grouped(parameters) {
  const groups = new Map();
  for (const parameter of parameters) {
    const title = parameter.first ? "first" : parameter.group;
    if (!groups.has(title)) groups.set(title, []);
    groups.get(title).push(parameter);
  }
  let seen = 0;
  return [...groups].map(([title, members]) => {
    const open = seen === 0 || (title !== "first" && !groups.has("first") && seen + members.length <= MOST_OPEN);
    seen += members.length;
    return [{ first: "Parameters", "": groups.has("first") ? "More parameters" : "Parameters" }[title] ?? title, open, members];
  });
}

/** The sliders. `changed(final)` is called while one is moved, and finally. */
export class Sliders {
  constructor(host, parameters, changed) {
    Object.assign(this, { changed, values: {}, rows: new Map() });
    for (const [title, open, members] of grouped(parameters)) {
      const group = Object.assign(document.createElement("details"), { className: "group", open });
      group.append(Object.assign(document.createElement("summary"), { textContent: title }), ...members.map((p) => this.row(p)));
      host.append(group);
    }
  }

  row(parameter) {
    const { name, unit, text, fixed, first, group } = parameter;
    const row = Object.assign(document.createElement("div"), { className: fixed ? "slider fixed" : "slider" });
    const label = document.createElement("label");
    const shown = !first && group && name.startsWith(`${group}.`) ? name.slice(group.length + 1) : name;
    label.append(Object.assign(document.createElement("code"), { textContent: shown }));
    label.title = text || name;
    const reading = rangeOf(parameter);
    const range = Object.assign(document.createElement("input"), { type: "range", ...reading.limits });
    const entry = Object.assign(document.createElement("input"), { type: "number", step: "any" });
    const wide = unit ? ` in ${unit}` : "";
    range.setAttribute("aria-label", `${name}${wide}`);
    entry.setAttribute("aria-label", `${name}${wide}, as a number`);
    range.disabled = entry.disabled = Boolean(fixed);
    range.addEventListener("input", () => this.set(name, reading.valueAt(Number(range.value)), false));
    range.addEventListener("change", () => this.changed(true));
    entry.addEventListener("change", () => {
      if (entry.value.trim() !== "" && Number.isFinite(Number(entry.value))) this.set(name, Number(entry.value), true);
      else this.write(name);
    });
    label.append(range);
    row.append(label, entry, Object.assign(document.createElement("span"), { className: "unit", textContent: unit }));
    if (first && text) row.append(Object.assign(document.createElement("small"), { textContent: text }));
    if (fixed) row.append(Object.assign(document.createElement("small"), { textContent: `not to be changed here: ${fixed}` }));
    row.dataset.name = name;
    this.rows.set(name, { range, reading, entry, parameter, row });
    this.write(name);
    return row;
  }

  set(name, value, final) {
    const own = this.rows.get(name);
    if (own === undefined || own.parameter.fixed) return;
    if (value === own.parameter.value) delete this.values[name];
    else this.values[name] = value;
    this.write(name);
    this.changed(final);
  }

  setAll(values) {
    this.put(values);
    this.changed(true);
  }

  /** Take all values at once, without a word; those not named are the model's. */
  put(values) {
    this.values = {};
    for (const [name, value] of Object.entries(values)) {
      const own = this.rows.get(name);
      if (own !== undefined && !own.parameter.fixed && value !== own.parameter.value) this.values[name] = value;
    }
    for (const name of this.rows.keys()) this.write(name);
  }

  write(name) {
    const { range, reading, entry, parameter, row } = this.rows.get(name);
    const value = this.values[name] ?? parameter.value;
    range.value = String(reading.positionOf(value));
    range.setAttribute("aria-valuetext", `${format(value)} ${parameter.unit}`);
    entry.value = format(value);
    row.classList.toggle("moved", name in this.values);
  }
}

/** The states at the start as fields, what the hand does in the picture. `changed()` is called where one has been set. */
export class Starts {
  constructor(host, names, unitOf, changed) {
    Object.assign(this, { values: {}, own: {}, entries: new Map() });
    const group = Object.assign(document.createElement("details"), { className: "group starts" });
    group.append(Object.assign(document.createElement("summary"), { textContent: "Start" }));
    for (const name of names) {
      const row = Object.assign(document.createElement("div"), { className: "slider" });
      const label = Object.assign(document.createElement("code"), { textContent: name });
      const entry = Object.assign(document.createElement("input"), { type: "number", step: "any" });
      entry.setAttribute("aria-label", `${name} at the start`);
      entry.addEventListener("change", () => {
        if (entry.value.trim() === "" || !Number.isFinite(Number(entry.value))) delete this.values[name];
        else this.values[name] = Number(entry.value);
        changed();
      });
      const unit = Object.assign(document.createElement("span"), { className: "unit", textContent: unitOf(name) });
      row.append(label, document.createElement("span"), entry, unit);
      group.append(row);
      this.entries.set(name, { entry, row, shown: NaN });
    }
    host.append(group);
    group.hidden = names.length === 0;
  }

  /** Take over values {name: value}; states that are not named have the value `of(name)`. */
  put(values, of) {
    this.values = Object.fromEntries(Object.entries(values).filter(([name]) => this.entries.has(name)));
    for (const [name, own] of this.entries) {
      const value = this.values[name] ?? of(name);
      if (!Object.is(own.shown, value) || own.entry.value === "") own.entry.value = Number.isFinite(value) ? format(value) : ""; // while dragging, most stay
      own.shown = value;
      own.row.classList.toggle("moved", name in this.values);
    }
  }
}

/** The chosen variables as a list to which others can be added. */
export class Chooser {
  constructor(host, names, shown, changed) {
    Object.assign(this, { shown: [...shown], changed, known: new Set(names) });
    this.list = Object.assign(document.createElement("ul"), { className: "chips" });
    const options = Object.assign(document.createElement("datalist"), { id: "names" });
    for (const name of names) options.append(Object.assign(document.createElement("option"), { value: name }));
    this.entry = Object.assign(document.createElement("input"), { placeholder: "show a variable …", autocomplete: "off" });
    this.entry.setAttribute("list", "names");
    this.entry.setAttribute("aria-label", "show another variable");
    this.entry.addEventListener("change", () => this.add(this.entry.value.trim()));
    host.append(this.list, this.entry, options);
    this.write();
  }

  add(name) {
    if (!this.known.has(name)) return;
    this.entry.value = "";
    if (!this.shown.includes(name)) this.put([...this.shown, name]);
  }

  put(names) {
    this.shown = names.filter((name) => this.known.has(name));
    this.write();
    this.changed();
  }

  write() {
    this.list.replaceChildren(
      ...this.shown.map((name) => {
        const chip = document.createElement("li");
        const remove = Object.assign(document.createElement("button"), { type: "button", textContent: "×" });
        remove.setAttribute("aria-label", `hide ${name}`);
        remove.addEventListener("click", () => this.put(this.shown.filter((n) => n !== name)));
        chip.append(Object.assign(document.createElement("code"), { textContent: name }), remove);
        return chip;
      }),
    );
  }
}
