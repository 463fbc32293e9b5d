// Plots of variables over another one: SVG, since uPlot wants what is across to increase.

import { svgElement } from "./picture.js";
import { colourOf, roomIn, tickText } from "./plots.js";

const SIZE = [420, 260]; // px of the drawing, which is as wide as its place, or as high as what scrolls around
const MARGIN = { left: 58, right: 10, top: 8, bottom: 34 };
const MARKS = 5; // on an axis, about
const LOWEST = 150; // px of height

/** The range of values, and the distance of the marks within. */
export function axisOf(values) {
  let [low, high] = [Infinity, -Infinity];
  for (const v of values) if (Number.isFinite(v)) [low, high] = [Math.min(low, v), Math.max(high, v)];
  if (!(high > low)) [low, high] = Number.isFinite(low) ? [low - (Math.abs(low) || 1), low + (Math.abs(low) || 1)] : [-1, 1];
  const room = 0.05 * (high - low);
  const rough = (high - low) / MARKS;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((m) => m * power >= rough * (1 - 1e-9));
  return { low: low - room, high: high + room, step };
}

/** A panel of variables `names` over `across`. */
export class PhasePlot {
  constructor(host, names, across, answer, against, labels) {
    const [width, height] = SIZE;
    const { left, right, top, bottom } = MARGIN;
    this.svg = svgElement("svg", { viewBox: `0 0 ${width} ${height}`, class: "phase", preserveAspectRatio: "xMinYMid", role: "img", "aria-label": labels.describe });
    const all = [answer, ...(against ? [against] : [])];
    const x = axisOf(all.flatMap((a) => Array.from(a.of(across))));
    const y = axisOf(all.flatMap((a) => names.flatMap((name) => Array.from(a.of(name)))));
    this.at = (a, b) => [
      left + ((a - x.low) / (x.high - x.low)) * (width - left - right),
      height - bottom - ((b - y.low) / (y.high - y.low)) * (height - top - bottom),
    ];
    this.drawAxes(x, y, labels);
    names.forEach((name, k) => {
      const colour = colourOf(k);
      if (against) this.curve(against, across, name, { stroke: colour, "stroke-dasharray": "4 4", opacity: 0.7 });
      this.curve(answer, across, name, { stroke: colour });
    });
    this.dots = names.map((_, k) => this.svg.appendChild(svgElement("circle", { r: 4, fill: colourOf(k) })));
    this.read = answer.reader([across, ...names]);
    host.append(this.svg);
    this.host = host;
    this.fit();
  }

  drawAxes(x, y, { across }) {
    const line = (a, b) => this.svg.append(svgElement("path", { class: "grid", d: `M${a.join(" ")}L${b.join(" ")}` }));
    const text = (place, anchor, words) => {
      const own = svgElement("text", { x: place[0], y: place[1], "text-anchor": anchor });
      own.textContent = words;
      this.svg.append(own);
    };
    for (let v = Math.ceil(x.low / x.step) * x.step; v <= x.high; v += x.step) {
      const foot = this.at(v, y.low);
      line(foot, this.at(v, y.high));
      text([foot[0], foot[1] + 14], "middle", tickText(Number(v.toPrecision(12)), x.step));
    }
    for (let v = Math.ceil(y.low / y.step) * y.step; v <= y.high; v += y.step) {
      const foot = this.at(x.low, v);
      line(foot, this.at(x.high, v));
      text([foot[0] - 5, foot[1] + 4], "end", tickText(Number(v.toPrecision(12)), y.step));
    }
    text([SIZE[0] - MARGIN.right, SIZE[1] - 4], "end", across);
  }

  curve(answer, across, name, look) {
    const [xs, ys] = [answer.of(across), answer.of(name)];
    let d = "";
    let gap = true;
    for (let k = 0; k < xs.length; k++) {
      const here = Number.isFinite(xs[k]) && Number.isFinite(ys[k]);
      if (here) d += `${gap ? "M" : "L"}${this.at(xs[k], ys[k]).map((v) => v.toFixed(1)).join(" ")}`;
      gap = !here;
    }
    this.svg.append(svgElement("path", { d, fill: "none", "stroke-width": 1.8, ...look }));
  }

  show(t) {
    const [across, ...values] = this.read(t);
    values.forEach((value, k) => {
      const shown = Number.isFinite(across) && Number.isFinite(value);
      const [cx, cy] = shown ? this.at(across, value) : [-99, -99];
      this.dots[k].setAttribute("cx", cx.toFixed(1));
      this.dots[k].setAttribute("cy", cy.toFixed(1));
    });
  }

  /** Be seen as a whole in what scrolls around. */
  fit() {
    this.svg.style.maxHeight = `${Math.max(LOWEST, roomIn(this.host))}px`;
  }

  destroy() {
    this.svg.remove();
  }
}
