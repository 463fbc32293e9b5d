// The rim of a disk seen from the side: lines along the shaft that wander across as the disk turns.

const LINES = 6; // around the whole rim, the first of them wide
const TURN = (2 * Math.PI) / LINES;

/** Where the lines of a rim are in front at an angle: [[which, share of the radius], …], shares from −1 to 1. */
export function linesAt(angle) {
  const found = [];
  for (let k = 0; k < LINES; k++) {
    if (Math.cos(angle + k * TURN) > 0) found.push([k, Math.sin(angle + k * TURN)]);
  }
  return found;
}

/** Whether an item is a disk from the side whose angle is known. */
export function hasRim(item) {
  return item.symbol === "disk" && item.turn.variable === "" && Boolean(item.variables.angle);
}

/** How far the front of a rim has gone at an angle, in the picture. */
export function frontShift(item, angle) {
  const [xs, ys] = [1, 2].map((k) => item.shapes[0].vertices.map((v) => v[k]));
  const [width, height] = [xs, ys].map((all) => Math.max(...all) - Math.min(...all));
  return width > height ? [(angle * width) / 2, 0] : [0, (-angle * height) / 2];
}

/** The lines of one disk; `make(name, attributes)` makes SVG elements. */
export class Rim {
  constructor(item, group, make) {
    const { vertices } = item.shapes[0];
    const [xs, ys] = [1, 2].map((k) => vertices.map((v) => v[k]));
    this.box = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    this.lines = Array.from({ length: LINES }, (_, k) => {
      return make("path", { class: k ? "line muted" : "line accent", "stroke-width": k ? 1 : 3.5 });
    });
    group.append(...this.lines);
  }

  /** Draw the lines at an angle; `at([f, x, y])` is where a vertex of the item is. */
  show(angle, at) {
    const [left, right, top, bottom] = this.box;
    const upright = right - left > bottom - top; // the shaft stands
    for (const line of this.lines) line.setAttribute("d", "");
    if (!Number.isFinite(angle)) return;
    for (const [k, share] of linesAt(angle)) {
      const across = upright ? (left + right + share * (right - left)) / 2 : (top + bottom - share * (bottom - top)) / 2;
      const ends = upright ? [[0, across, top], [0, across, bottom]] : [[0, left, across], [0, right, across]];
      const [a, b] = ends.map((vertex) => at(vertex).map((v) => v.toFixed(2)).join(" "));
      this.lines[k].setAttribute("d", `M${a}L${b}`);
    }
  }
}
