// What a reader can set: parameters as sliders, the variables that are shown.

const REACH = 5; // a slider goes from a fifth of the value to five times it
const STEPS = 200;

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

/** The sliders. `changed(final)` is called while one is moved, and finally. */
export class Sliders {
  constructor(host, parameters, changed) {
    Object.assign(this, { parameters, changed, values: {}, rows: new Map() });
    for (const parameter of parameters) host.append(this.row(parameter));
  }

  row(parameter) {
    const { name, value, unit, text, fixed } = parameter;
    const row = Object.assign(document.createElement("div"), { className: fixed ? "slider fixed" : "slider" });
    const label = document.createElement("label");
    label.append(Object.assign(document.createElement("code"), { textContent: name }));
    if (text) label.title = text;
    const range = Object.assign(document.createElement("input"), { type: "range", min: -1, max: 1, step: 1 / STEPS });
    const entry = Object.assign(document.createElement("input"), { type: "number", step: "any" });
    const wide = unit ? ` in ${unit}` : "";
    range.setAttribute("aria-label", `${name}${wide}`);
    entry.setAttribute("aria-label", `${name}${wide}, as a number`);
    range.disabled = entry.disabled = Boolean(fixed);
    range.addEventListener("input", () => this.set(name, valueAt(value, Number(range.value)), false));
    range.addEventListener("change", () => this.changed(true));
    entry.addEventListener("change", () => {
      if (entry.value.trim() !== "" && Number.isFinite(Number(entry.value))) this.set(name, Number(entry.value), true);
      else this.write(name);
    });
    label.append(range);
    row.append(label, entry, Object.assign(document.createElement("span"), { className: "unit", textContent: unit }));
    if (fixed) row.append(Object.assign(document.createElement("small"), { textContent: `not to be changed here: ${fixed}` }));
    this.rows.set(name, { range, entry, parameter, row });
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

  /** All values at once; those not named are the model's. */
  setAll(values) {
    this.values = {};
    for (const [name, value] of Object.entries(values)) {
      const own = this.rows.get(name);
      if (own !== undefined && !own.parameter.fixed && value !== own.parameter.value) this.values[name] = value;
    }
    for (const name of this.rows.keys()) this.write(name);
    this.changed(true);
  }

  write(name) {
    const { range, entry, parameter, row } = this.rows.get(name);
    const value = this.values[name] ?? parameter.value;
    range.value = String(positionOf(parameter.value, value));
    range.setAttribute("aria-valuetext", `${format(value)} ${parameter.unit}`);
    entry.value = format(value);
    row.classList.toggle("moved", name in this.values);
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
