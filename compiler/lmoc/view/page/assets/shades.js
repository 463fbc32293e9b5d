// The terms of the equations, shaded by their size at an instant.

const SAMPLES = 100; // at which the largest term of an equation is looked for
const DARKEST = 0.6;

/** The values of the terms of both sides; the one that has no formula is what the others leave. */
export function termValues(sides, values) {
  const found = sides.map((side) => side.map((term) => (term === null ? NaN : term(values))));
  const open = found.flatMap((side, s) => side.flatMap((v, k) => (sides[s][k] === null ? [[s, k]] : [])));
  if (open.length !== 1) return found;
  const [[s, k]] = open;
  const sum = (side) => side.reduce((all, v, j) => all + (side === found[s] && j === k ? 0 : v), 0);
  found[s][k] = sum(found[1 - s]) - sum(found[s]);
  return found;
}

export class Shades {
  /** `terms` are functions by mode, equation and side; `modes` are {law: mode}, null where there are no laws. */
  constructor(host, note, terms, modes, names) {
    const elements = [...host.querySelectorAll(".term")];
    this.equations = terms.flatMap((equations, m) => {
      return equations.map((sides) => ({ sides, mode: modes[m], elements: elements.splice(0, sides.flat().length) }));
    });
    this.names = names;
    note.hidden = this.equations.length === 0;
  }

  /** Take the values of a run. */
  put(answer) {
    this.answer = answer;
    this.read = answer.reader(this.names);
    const { time } = answer;
    const every = Math.max(1, Math.ceil(time.length / SAMPLES));
    for (const equation of this.equations) {
      equation.largest = 0;
      for (let k = 0; k < time.length; k += every) {
        if (this.holds(equation, time[k])) for (const v of termValues(equation.sides, this.read(time[k])).flat()) equation.largest = Math.max(equation.largest, Math.abs(v) || 0);
      }
    }
  }

  /** Whether an equation is that of the laws' modes at a time. */
  holds({ mode }, t) {
    if (mode === null) return true;
    const now = new Map(this.answer.modesAt(t));
    return Object.entries(mode).every(([law, word]) => now.get(law) === word);
  }

  show(t) {
    for (const equation of this.equations) {
      const values = this.holds(equation, t) ? termValues(equation.sides, this.read(t)).flat() : [];
      equation.elements.forEach((element, k) => {
        const share = equation.largest > 0 ? Math.min(1, Math.abs(values[k]) / equation.largest) || 0 : 0;
        element.style.backgroundColor = share > 0 ? `rgb(var(--${values[k] > 0 ? "adds" : "takes-away"}) / ${(DARKEST * share).toFixed(3)})` : "";
      });
    }
  }
}
