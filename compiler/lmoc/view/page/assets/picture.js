// The moving picture: SVG made from the description of the compiler, its items placed for the values of variables.

import { putText } from "./dom.js";
import { canBeTaken, place } from "./motion.js";
import { hasRim, Rim } from "./rim.js";
import { hasSlack, sagging } from "./sag.js";

const SVG = "http://www.w3.org/2000/svg";
const ARROW = 56; // px, the longest arrow of a force
const EDGE = 8; // px around what moves
const LARGEST = 2.4; // screen px of a px of the picture
const LARGER = 1.8; // most by which texts are enlarged in a picture that needs more room
const REACHES = [0, 5, 10, 16]; // px around a finger, where items are looked for
const FARTHEST = 3; // of the picture: how far it is extended for what moves
const TOGETHER = [4, 16]; // items that one element draws, at least and at most

export function svgElement(name, attributes = {}) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, String(value));
  return element;
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

/** A picture in the page; behind it, faintly, that of another run. */
const KEYS = "arrow keys take along the part that is chosen, Enter lets go";

export class Stage {
  constructor(picture, host, label) {
    this.picture = picture;
    const { width, height } = picture;
    this.svg = svgElement("svg", { viewBox: `0 0 ${width} ${height}`, "aria-label": label });
    this.ghost = svgElement("g", { class: "ghost", "aria-hidden": "true" });
    this.arrows = svgElement("g", { class: "arrows", "aria-hidden": "true" });
    this.hand = svgElement("path", { class: "line force hand", "stroke-width": 2, "stroke-dasharray": "5 3" });
    this.front = svgElement("g");
    this.svg.append(this.ghost, this.front, this.arrows, this.hand);
    Object.assign(this, { chosen: "", takes: false, shown: null, enlarged: 1, ghosts: [] });
    this.make();
    host.append(this.svg);
  }

  /** Make the elements of all items; those of the part that is chosen stand alone. */
  make() {
    this.front.replaceChildren();
    this.parts = together(this.picture.items, this.chosen).map((items) => this.made(items, this.front));
    this.partOf = new Map(this.parts.flatMap((part) => part.items.map((item) => [item, part])));
    for (const { items, group } of this.parts) group.classList.toggle("chosen", this.chosen !== "" && items[0].part === this.chosen);
    this.letTake(this.takes);
    this.enlargeTexts(this.enlarged);
  }

  made(items, host) {
    const [item] = items;
    const group = svgElement("g", { class: `item ${/^[\w-]+$/.test(item.symbol) ? item.symbol : ""}` });
    const title = Object.assign(svgElement("title"), { textContent: item.part });
    if (item.part) group.append(title);
    const all = items.map(piecesOf);
    const pieces = all[0].map((_, j) => pieceOf(item, all.map((own) => own[j])));
    group.append(...pieces.map(({ element }) => element));
    host.append(group);
    const rim = hasRim(item) ? new Rim(item, group, svgElement) : null;
    const part = { items, group, pieces, rim, at: items.map(() => []) };
    if (items.length > 1) group.addEventListener("pointermove", ({ clientX, clientY }) => putText(title, this.nearest(part, clientX, clientY).part));
    return part;
  }

  /** Say with the pointer whether what moves can be taken by the hand. */
  letTake(takes) {
    this.takes = takes;
    // with keys the whole picture is one handle
    const handle = { role: takes ? "application" : "img", tabindex: takes ? "0" : "-1", "aria-description": takes ? KEYS : "" };
    for (const [name, value] of Object.entries(handle)) this.svg.setAttribute(name, value);
    for (const { items, group } of this.parts) group.classList.toggle("takes", takes && canBeTaken(items[0]));
  }

  /** The item of a part that is nearest to a place on the screen. */
  nearest({ items, at }, x, y) {
    if (items.length === 1) return items[0];
    const [px, py] = this.inside()(x, y);
    const distances = at.map(([x0, y0, length, cos, sin]) => {
      const along = Math.min(Math.max((px - x0) * cos + (py - y0) * sin, 0), length);
      return Math.hypot(x0 + along * cos - px, y0 + along * sin - py);
    });
    return items[distances.indexOf(Math.min(...distances))];
  }

  /** The number of the item under a place on the screen, or beside it; -1 where there is none. `wanted(item)` says which count. */
  itemAt(x, y, wanted) {
    for (const radius of REACHES) {
      for (let k = 0; k < (radius ? 8 : 1); k++) {
        const [dx, dy] = [radius * Math.cos((k * Math.PI) / 4), radius * Math.sin((k * Math.PI) / 4)];
        const group = document.elementFromPoint(x + dx, y + dy)?.closest?.("#stage .item");
        const part = group && this.parts.find((own) => own.group === group);
        const item = part && this.nearest(part, x + dx, y + dy);
        if (item && wanted(item)) return this.picture.items.indexOf(item);
      }
    }
    return -1;
  }

  /** Places of the screen as places of the picture, as it stands now: to ask for that again is to lay out all that has moved. */
  inside() {
    const matrix = this.svg.getScreenCTM().inverse();
    return (x, y) => {
      const found = new DOMPoint(x, y).matrixTransform(matrix);
      return [found.x, found.y];
    };
  }

  /** Mark the items of a part; "" for none. */
  choose(part) {
    if (part === this.chosen) return;
    this.chosen = part;
    this.make();
    if (this.shown !== null) showParts(this.parts, ...this.shown);
  }

  /** Leave room for a motion: `values(k)` are those of the variables at the k-th of `count` instants; `pulling` are items with arrows. */
  makeRoom(motion, values, count, pulling) {
    const { width, height, items } = this.picture;
    const box = [0, 0, width, height];
    const free = items.filter((item) => item.ends.some((end) => end.moves.some((move) => move.group === "")));
    for (let k = 0; k < count && free.length + pulling.length; k++) {
      const now = values(k);
      for (const item of pulling) for (const tip of tipsOf(item, motion.frame(item, now))) reach(box, tip);
      for (const item of free) {
        const frame = motion.frame(item, now);
        for (const point of outline(item)) reach(box, place(frame, point));
      }
    }
    const most = FARTHEST * Math.max(width, height); // what flies away is not followed
    const [left, top] = [Math.max(box[0], -most), Math.max(box[1], -most)];
    const [right, bottom] = [Math.min(box[2], width + most), Math.min(box[3], height + most)];
    this.svg.setAttribute("viewBox", [left, top, right - left, bottom - top].map((v) => v.toFixed(1)).join(" "));
    this.svg.style.maxWidth = `${Math.round(LARGEST * (right - left))}px`;
    this.enlargeTexts(Math.min(LARGER, Math.max((right - left) / width, (bottom - top) / height)));
  }

  /** Keep the texts of a picture legible that has been made smaller by a factor. */
  enlargeTexts(factor) {
    this.enlarged = factor;
    for (const { element, shapes: [[shape]] } of this.parts.flatMap(({ pieces }) => pieces)) {
      if (shape.kind === "label") element.firstChild.setAttribute("font-size", String(shape.size * factor));
    }
  }

  /** Place everything for the values of the variables of a motion, and of another one; null where there is none. */
  show(motion, values, other = null) {
    this.shown = [motion, values];
    showParts(this.parts, motion, values);
    if (other !== null && this.ghosts.length === 0) this.ghosts = together(this.picture.items, "").map((items) => this.made(items, this.ghost));
    this.ghost.style.display = other === null ? "none" : "";
    if (other !== null) showParts(this.ghosts, motion, other);
  }

  /** Draw the spring between the hand and what it holds; null where it holds nothing. */
  showHand(from, to) {
    this.hand.setAttribute("d", from === null ? "" : `M${[from, to].map((p) => p.map((v) => v.toFixed(2)).join(" ")).join("L")}`);
  }

  /** Draw `forces` of items: tensions between two ends, pushes along the way of one, [fx, fy]; `largest` has the longest arrow. */
  showForces(motion, values, forces, largest) {
    const drawn = [];
    for (const [item, force] of forces) {
      const size = force.length > 1 ? Math.hypot(...force) : force[0];
      if (!(Math.abs(size) > 0.01 * largest)) continue;
      const frame = motion.frame(item, values);
      const length = (ARROW * size) / largest;
      if (item.ends.length === 2) drawn.push(arrow(place(frame, [1, 0, 0]), frame, -length));
      drawn.push(arrow(place(frame, [0, 0, 0]), item.ends.length === 2 ? frame : direction(item, force), length));
    }
    const { children } = this.arrows;
    while (children.length > drawn.length) this.arrows.lastChild.remove();
    while (children.length < drawn.length) this.arrows.append(svgElement("path", { class: "line force", "stroke-width": 2 }));
    drawn.forEach((d, k) => children[k].setAttribute("d", d));
  }
}

/** Where arrows of an item may end. */
function tipsOf(item, frame) {
  if (item.ends.length === 2) return [place(frame, [0, -ARROW, 0]), place(frame, [1, ARROW, 0])];
  return [-1, 1].flatMap((way) => [[frame.x + way * ARROW, frame.y], [frame.x, frame.y + way * ARROW]]);
}

/** The direction of a push. */
function direction(item, force) {
  const [dx, dy] = force.length > 1 ? [force[0], -force[1]] : [item.ends[0].moves[0].dx, item.ends[0].moves[0].dy];
  return { cos: dx / Math.hypot(dx, dy), sin: dy / Math.hypot(dx, dy) };
}

/** Draw what is not where it was: each attribute that is written costs style, layout and paint. */
function showParts(parts, motion, values) {
  for (const part of parts) {
    let moved = false;
    part.items.forEach((item, i) => (moved = placeItem(part, i, motion, values) || moved));
    if (moved) for (const piece of part.pieces) if (piece.texts.length) putAttribute(piece, piece.attribute, piece.texts.join(""));
  }
}

/** Place an item of a part; whether it has moved. */
function placeItem({ items, pieces, rim, at }, i, motion, values) {
  const item = items[i];
  const frame = motion.frame(item, values);
  const angle = rim === null ? 0 : motion.value(item.variables.angle, values);
  const slack = hasSlack(item) && item.ends.length === 2 ? motion.slack(item, values) : 0;
  const now = [frame.x, frame.y, frame.length, frame.cos, frame.sin, angle, slack];
  if (now.every((v, k) => Object.is(v, at[i][k]))) return false;
  at[i] = now;
  rim?.show(angle, (vertex) => place(frame, vertex));
  for (const piece of pieces) placePiece(piece, i, frame);
  const curve = slack === 0 ? "" : sagging(frame, slack);
  if (curve !== "") pieces[0].texts[i] = curve;
  return true;
}

/** A length in the picture, to a hundredth of a pixel. */
const short = (v) => Math.round(v * 100) / 100;

function putAttribute({ element, written }, name, value) {
  if (written[name] === value) return;
  written[name] = value;
  element.setAttribute(name, value);
}

/** The shapes of an item, those together that one element draws: lines that look alike, with nothing but lines between them. */
function piecesOf(item) {
  const found = [];
  let open = []; // since the last area
  for (const shape of item.shapes) {
    const own = hasSlack(item) || shape.kind !== "path" || shape.fill ? null : [shape.colour, shape.width, ...shape.dash].join();
    const alike = own === null ? undefined : open.find((piece) => piece.own === own);
    if (own === null) open = [];
    if (alike !== undefined) alike.shapes.push(shape);
    else found.push({ own, shapes: [shape] });
    if (own !== null && alike === undefined) open.push(found.at(-1));
  }
  return found.map(({ shapes }) => shapes);
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

/** What one element draws of items: `shapes` of each. A `path` is styled anew where it changes: what is one line or area is none. */
function pieceOf(item, shapes) {
  const [[shape, ...others]] = shapes;
  const single = shapes.length === 1 && others.length === 0 && !hasSlack(item);
  const line = single ? (shape.closed ? "polygon" : "polyline") : "path";
  const made = shapeElement(shape, shape.kind === "path" ? line : shape.kind);
  const element = shape.kind === "label" ? svgElement("g") : made; // a text that moves itself is laid out anew
  if (element !== made) element.append(made);
  return { shapes, element, attribute: single ? "points" : "d", texts: [], written: {} };
}

/** The items of a picture in its order, many of them together that are alike and have one behind the other: one element draws them. */
function together(items, alone) {
  const found = [];
  for (const item of items) {
    const own = item.part === alone ? null : lookOf(item);
    const last = found.at(-1);
    if (own !== null && last?.own === own && last.items.length < TOGETHER[1]) last.items.push(item);
    else found.push({ own, items: [item] });
  }
  return found.flatMap((one) => (one.items.length < TOGETHER[0] ? one.items.map((item) => [item]) : [one.items]));
}

/** What items have in common that one element can draw: nothing but lines between two ends. */
function lookOf(item) {
  if (item.ends.length < 2 || hasSlack(item) || item.shapes.some(({ kind, fill }) => kind !== "path" || fill)) return null;
  return [item.symbol, canBeTaken(item), ...item.shapes.flatMap(({ colour, width, dash }) => [colour, width, ...dash])].join();
}

function shapeElement(shape, name) {
  const made = plainElement(shape, name);
  const [line, area] = shape.kind === "label" ? ["fill", ""] : ["stroke", "fill"];
  if (isGiven(shape.colour)) made.style[line] = shape.colour;
  if (area && isGiven(shape.fill)) made.style[area] = shape.fill;
  return made;
}

function plainElement(shape, name) {
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
  return svgElement(name, { ...style, ...(shape.radius ? { r: shape.radius } : {}) });
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

function placePiece(piece, i, frame) {
  const [shape] = piece.shapes[i];
  if (shape.kind === "path") {
    const points = piece.shapes[i].map((own) => [pointsOf(own, frame), own.closed]);
    piece.texts[i] = piece.attribute === "points" ? points[0][0] : points.map(([text, closed]) => `M${text}${closed ? "Z" : ""}`).join("");
    return;
  }
  const [x, y] = place(frame, shape.kind === "circle" ? shape.centre : shape.at);
  if (shape.kind === "label") {
    putAttribute(piece, "transform", `translate(${short(x)} ${short(y + 0.35 * shape.size)})`);
    return;
  }
  putAttribute(piece, "cx", short(x));
  putAttribute(piece, "cy", short(y));
}

/** The corners of a line or an area. */
function pointsOf({ vertices }, { x, y, length, cos, sin }) {
  let points = "";
  for (const [f, a, b] of vertices) {
    const along = f * length + a;
    points += `${short(x + along * cos - b * sin)} ${short(y + along * sin + b * cos)} `;
  }
  return points;
}

/** The path of an arrow. */
function arrow([x, y], { cos, sin }, length) {
  const tip = [x + length * cos, y + length * sin];
  const back = Math.sign(length) * Math.min(8, Math.abs(length));
  const side = (s) => [tip[0] - back * cos - s * 3.5 * sin, tip[1] - back * sin + s * 3.5 * cos];
  const points = [[x, y], tip, side(1), tip, side(-1)].map((p) => p.map((v) => v.toFixed(2)).join(" "));
  return `M${points.join("L")}`;
}
