// The moving picture: SVG made from the description of the compiler, its items placed for the values of variables.
//
// The description and what moves it are explained in `view/scene/picture.py`.

import { hasRim, Rim } from "./rim.js";
import { hasSlack, lengthening, sagging } from "./sag.js";

const SVG = "http://www.w3.org/2000/svg";
const ARROW = 56; // px, the longest arrow of a force
const EDGE = 8; // px around what moves
const LARGER = 1.8; // most by which texts are enlarged in a picture that needs more room
const FARTHEST = 3; // of the picture: how far it is extended for what moves

export function svgElement(name, attributes = {}) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, String(value));
  return element;
}

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

/** Where a vertex (f, x, y) of an item's frame is. */
export function place(frame, [f, x, y]) {
  const along = f * frame.length + x;
  return [frame.x + along * frame.cos - y * frame.sin, frame.y + along * frame.sin + y * frame.cos];
}

/**
 * The moves of a picture: `frames(values)` gives the frame of each item for values in the order of `names`.
 *
 * Moves of one group have one scale, such that none goes further than the room that the picture leaves.
 */
export class Motion {
  constructor(picture, names, references, extremes) {
    this.picture = picture;
    this.index = new Map(names.map((name, k) => [name, k]));
    this.references = references;
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

/** Pieces of a text with their level: "q_{1}" is q on the line and 1 below it. */
export function runsOf(text) {
  const runs = [];
  let at = 0;
  for (const found of text.matchAll(/([_^])\{([^{}]*)\}/g)) {
    if (found.index > at) runs.push([text.slice(at, found.index), 0]);
    if (found[2]) runs.push([found[2], found[1] === "_" ? -1 : 1]);
    at = found.index + found[0].length;
  }
  if (at < text.length) runs.push([text.slice(at), 0]);
  return runs;
}

/** A picture in the page. */
export class Stage {
  constructor(picture, host, label) {
    this.picture = picture;
    const { width, height } = picture;
    this.svg = svgElement("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label });
    this.svg.style.maxWidth = `${Math.round(1.6 * width)}px`;
    this.parts = [];
    for (const item of picture.items) {
      const group = svgElement("g", { class: `item ${/^[\w-]+$/.test(item.symbol) ? item.symbol : ""}` });
      if (item.part) group.append(Object.assign(svgElement("title"), { textContent: item.part }));
      const shapes = item.shapes.map((shape) => shapeElement(shape));
      group.append(...shapes);
      this.svg.append(group);
      this.parts.push({ item, shapes, rim: hasRim(item) ? new Rim(item, group, svgElement) : null });
    }
    this.arrows = svgElement("g", { class: "arrows", "aria-hidden": "true" });
    this.svg.append(this.arrows);
    host.append(this.svg);
  }

  /** Leave room for a motion: `values(k)` are those of the variables at the k-th of `count` instants. */
  makeRoom(motion, values, count) {
    const { width, height, items } = this.picture;
    const box = [0, 0, width, height];
    const free = items.filter((item) => item.ends.some((end) => end.moves.some((move) => move.group === "")));
    for (let k = 0; k < count && free.length; k++) {
      const now = values(k);
      for (const item of free) {
        const frame = motion.frame(item, now);
        for (const point of outline(item)) reach(box, place(frame, point));
      }
    }
    const most = FARTHEST * Math.max(width, height); // what flies away is not followed
    const [left, top] = [Math.max(box[0], -most), Math.max(box[1], -most)];
    const [right, bottom] = [Math.min(box[2], width + most), Math.min(box[3], height + most)];
    this.svg.setAttribute("viewBox", [left, top, right - left, bottom - top].map((v) => v.toFixed(1)).join(" "));
    this.svg.style.maxWidth = `${Math.round(1.6 * (right - left))}px`;
    this.enlargeTexts(Math.min(LARGER, Math.max((right - left) / width, (bottom - top) / height)));
  }

  /** Keep the texts of a picture legible that has been made smaller by a factor. */
  enlargeTexts(factor) {
    for (const { item, shapes } of this.parts) {
      item.shapes.forEach((shape, k) => {
        if (shape.kind === "label") shapes[k].setAttribute("font-size", String(shape.size * factor));
      });
    }
  }

  /** Place everything for the values of the variables of a motion. */
  show(motion, values) {
    for (const { item, shapes, rim } of this.parts) {
      const frame = motion.frame(item, values);
      rim?.show(motion.value(item.variables.angle, values), (vertex) => place(frame, vertex));
      for (let k = 0; k < shapes.length; k++) placeShape(shapes[k], item.shapes[k], frame);
      const curve = hasSlack(item) && item.ends.length === 2 ? sagging(frame, motion.slack(item, values)) : "";
      if (curve !== "") shapes[0].setAttribute("d", curve);
    }
  }

  /** Draw the forces in parts with two ends: `force(item)` is a tension, `largest` the one of the longest arrow. */
  showForces(motion, values, force, largest) {
    this.arrows.replaceChildren();
    if (force === null) return;
    for (const { item } of this.parts) {
      const tension = force(item);
      if (item.ends.length !== 2 || !(Math.abs(tension) > 0.01 * largest)) continue;
      const frame = motion.frame(item, values);
      const length = (ARROW * tension) / largest;
      this.arrows.append(arrow(place(frame, [0, 0, 0]), frame, length), arrow(place(frame, [1, 0, 0]), frame, -length));
    }
  }
}

/** A colour that the model gives, not one of the page's own. */
const isGiven = (colour) => /^#[0-9a-f]{6}$|^none$/.test(colour ?? "");

/** The points of an item's frame that its outline reaches to. */
function outline({ shapes }) {
  return shapes.flatMap(({ vertices, centre, radius, at }) => {
    if (vertices !== undefined) return vertices;
    if (centre === undefined) return [at];
    const [f, x, y] = centre;
    return [[f, x - radius, y], [f, x + radius, y], [f, x, y - radius], [f, x, y + radius]];
  });
}

function reach(box, [x, y]) {
  if (!Number.isFinite(x) || !Number.isFinite(y)) return;
  box[0] = Math.min(box[0], x - EDGE);
  box[1] = Math.min(box[1], y - EDGE);
  box[2] = Math.max(box[2], x + EDGE);
  box[3] = Math.max(box[3], y + EDGE);
}

function shapeElement(shape) {
  const made = plainElement(shape);
  const [line, area] = shape.kind === "label" ? ["fill", ""] : ["stroke", "fill"];
  if (isGiven(shape.colour)) made.style[line] = shape.colour;
  if (area && isGiven(shape.fill)) made.style[area] = shape.fill;
  return made;
}

function plainElement(shape) {
  const named = (colour, prefix) => (colour && !isGiven(colour) ? ` ${prefix}${colour}` : "");
  const style = { class: `line${named(shape.colour, "")}${named(shape.fill, "fill-")}` };
  if (shape.kind === "label") {
    const text = svgElement("text", { class: `label${named(shape.colour, "")}`, "font-size": shape.size });
    text.setAttribute("text-anchor", shape.anchor);
    for (const [piece, level] of runsOf(shape.text)) {
      const span = svgElement("tspan", level ? { "font-size": "72%" } : {});
      span.textContent = piece;
      span.dataset.level = String(level);
      text.append(span);
    }
    shiftLevels(text, shape.size);
    return text;
  }
  style["stroke-width"] = shape.width;
  if (shape.dash.length) style["stroke-dasharray"] = shape.dash.join(" ");
  return svgElement(shape.kind === "circle" ? "circle" : "path", { ...style, ...(shape.radius ? { r: shape.radius } : {}) });
}

/** Lower and raise the pieces of a text: `dy` counts from the piece before. */
function shiftLevels(text, size) {
  const height = { "-1": 0.28, 0: 0, 1: -0.38 };
  let before = 0;
  for (const span of text.children) {
    const own = height[span.dataset.level] * size;
    if (own !== before) span.setAttribute("dy", String(own - before));
    before = own;
  }
}

function placeShape(element, shape, frame) {
  if (shape.kind === "path") {
    let d = "";
    for (const vertex of shape.vertices) {
      const [x, y] = place(frame, vertex);
      d += `${d === "" ? "M" : "L"}${x.toFixed(2)} ${y.toFixed(2)}`;
    }
    element.setAttribute("d", shape.closed ? `${d}Z` : d);
    return;
  }
  const [x, y] = place(frame, shape.kind === "circle" ? shape.centre : shape.at);
  const [across, down] = shape.kind === "circle" ? ["cx", "cy"] : ["x", "y"];
  element.setAttribute(across, x.toFixed(2));
  element.setAttribute(down, (shape.kind === "circle" ? y : y + 0.35 * shape.size).toFixed(2));
}

function arrow([x, y], { cos, sin }, length) {
  const tip = [x + length * cos, y + length * sin];
  const back = Math.sign(length) * Math.min(8, Math.abs(length));
  const side = (s) => [tip[0] - back * cos - s * 3.5 * sin, tip[1] - back * sin + s * 3.5 * cos];
  const points = [[x, y], tip, side(1), tip, side(-1)].map((p) => p.map((v) => v.toFixed(2)).join(" "));
  return svgElement("path", { class: "line force", "stroke-width": 2, d: `M${points.join("L")}` });
}
