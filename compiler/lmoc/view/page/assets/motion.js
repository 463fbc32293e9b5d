// Where everything in a picture is, for the values of the variables that move it.
//
// The description and what moves it are explained in `view/scene/picture.py`.

import { frontShift, hasRim } from "./rim.js";
import { hasSlack, lengthening } from "./sag.js";

/** Names of the variables that move a picture. */
export function movers(picture) {
  const names = new Set();
  for (const item of picture.items) {
    for (const end of item.ends) for (const move of end.moves) names.add(move.variable);
    if (item.turn.variable) names.add(item.turn.variable);
    if (hasRim(item)) names.add(item.variables.angle);
    if (hasSlack(item)) names.add(item.variables.slack ?? item.variables.stretch);
  }
  return [...names];
}

/** Whether an item goes or turns with the motion. */
export function canBeTaken(item) {
  return item.ends.some((end) => end.moves.length) || item.turn.variable !== "" || Boolean(item.variables.angle);
}

/** Where a vertex (f, x, y) of an item's frame is. */
export function place(frame, [f, x, y]) {
  const along = f * frame.length + x;
  return [frame.x + along * frame.cos - y * frame.sin, frame.y + along * frame.sin + y * frame.cos];
}

/** The vertex (f, x, y) of a frame that is at a point. */
export function vertexAt(frame, [px, py]) {
  const [dx, dy] = [px - frame.x, py - frame.y];
  const [along, across] = [dx * frame.cos + dy * frame.sin, dy * frame.cos - dx * frame.sin];
  const share = frame.length > 0 ? Math.min(Math.max(along / frame.length, 0), 1) : 0;
  return [share, along - share * frame.length, across];
}

/**
 * The moves of a picture: `frames(values)` gives the frame of each item for values in the order of `names`.
 *
 * Moves of one group have one scale, such that none goes further than the room that the picture leaves.
 */
export class Motion {
  constructor(picture, names, references, extremes) {
    Object.assign(this, { picture, names, references, extremes });
    this.index = new Map(names.map((name, k) => [name, k]));
    this.scales = groupScales(picture, this.index, references, extremes);
  }

  value(name, values) {
    return values[this.index.get(name)];
  }

  change(move, values) {
    const k = this.index.get(move.variable);
    const away = values[k] - (move.reference ?? this.references[k]);
    const scale = move.group === "" ? 1 : (this.scales.get(move.group) ?? 0);
    return Number.isFinite(away) ? scale * away : 0;
  }

  /** The pixels by which the string that an item shows is longer than the way between its ends. */
  slack(item, values) {
    const move = item.ends.flatMap((end) => end.moves)[0];
    const scale = move === undefined || move.group !== "" ? this.scales.get(move?.group ?? "line") : Math.hypot(move.dx, move.dy);
    return (scale ?? 0) * lengthening(item, (name) => this.value(name, values));
  }

  end(end, values) {
    let { x, y } = end;
    for (const move of end.moves) {
      const shift = this.change(move, values);
      x += move.dx * shift;
      y += move.dy * shift;
    }
    return [x, y];
  }

  /** Where a vertex of an item is; on a disk seen from the side it goes along with the front of the rim. */
  point(item, vertex, values) {
    const [x, y] = place(this.frame(item, values), vertex);
    const [dx, dy] = this.rimShift(item, values);
    return [x + dx, y + dy];
  }

  /** The vertex of an item that is at a point. */
  vertex(item, [x, y], values) {
    const [dx, dy] = this.rimShift(item, values);
    return vertexAt(this.frame(item, values), [x - dx, y - dy]);
  }

  /** How far a variable has to go that moves an end of an item, or turns it (`move` null), so that a point at `at` comes next to `to`. */
  way(item, move, at, to, values) {
    const [dx, dy] = [to[0] - at[0], to[1] - at[1]];
    if (move !== null) {
      const scale = move.group === "" ? 1 : (this.scales.get(move.group) ?? 0);
      return scale > 0 ? (dx * move.dx + dy * move.dy) / (scale * (move.dx ** 2 + move.dy ** 2)) : 0;
    }
    if (hasRim(item)) {
      const [rx, ry] = frontShift(item, 1);
      return (dx * rx + dy * ry) / (rx * rx + ry * ry);
    }
    const { x, y } = this.frame(item, values);
    const [ax, ay, bx, by] = [at[0] - x, at[1] - y, to[0] - x, to[1] - y];
    return -Math.atan2(ax * by - ay * bx, ax * bx + ay * by) / item.turn.factor;
  }

  rimShift(item, values) {
    return hasRim(item) ? frontShift(item, this.value(item.variables.angle, values)) : [0, 0];
  }

  frame(item, values) {
    const [x, y] = this.end(item.ends[0], values);
    if (item.ends.length === 1) {
      const { angle, variable, factor, reference } = item.turn;
      const k = this.index.get(variable);
      const turned = variable ? values[k] - (reference ?? this.references[k]) : 0;
      const now = angle + factor * (Number.isFinite(turned) ? turned : 0);
      return { x, y, length: 0, cos: Math.cos(now), sin: -Math.sin(now) };
    }
    const [x2, y2] = this.end(item.ends[1], values);
    const now = Math.atan2(y2 - y, x2 - x);
    return { x, y, length: Math.hypot(x2 - x, y2 - y), cos: Math.cos(now), sin: Math.sin(now) };
  }
}

function groupScales(picture, index, references, extremes) {
  const most = new Map();
  for (const item of picture.items) {
    for (const end of item.ends) {
      for (const move of end.moves) {
        if (move.group === "") continue;
        const k = index.get(move.variable);
        const zero = move.reference ?? references[k];
        const [low, high] = extremes[k];
        const way = Math.max(Math.abs(high - zero), Math.abs(low - zero)) * Math.hypot(move.dx, move.dy);
        if (Number.isFinite(way)) most.set(move.group, Math.max(most.get(move.group) ?? 0, way));
      }
    }
  }
  return new Map([...most].map(([group, way]) => [group, way > 0 ? (picture.room[group] ?? 40) / way : 0]));
}

/** The least and the largest of the finite values of a column. */
export function extremesOf(column) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of column) if (Number.isFinite(value)) [low, high] = [Math.min(low, value), Math.max(high, value)];
  return [low, high];
}
