// Slack strings: a piece that is longer than the way between its ends hangs in a curve.

const LEAST = 0.3; // px of slack that can be seen

/** The slack of an item that shows a string, in the unit of the model; not more than 0 where it is taut. */
export function lengthening(item, value) {
  const { slack, stretch } = item.variables;
  if (slack !== undefined) return value(slack);
  return stretch === undefined ? NaN : -value(stretch);
}

/** Whether an item has a slack at all. */
export const hasSlack = ({ variables }) => variables.slack !== undefined || variables.stretch !== undefined;

/**
 * The path of a string between the ends of a frame that is `slack` px longer than their distance, "" where it is taut:
 * a parabola, which sags by the root of 3/8 of both lengths' product. Hung upright, it bulges to the left of its name.
 */
export function sagging({ x, y, length, cos, sin }, slack) {
  if (!(slack > LEAST) || !(length > 0)) return "";
  const depth = Math.min(Math.sqrt(0.375 * length * slack), 0.45 * length + 6);
  const size = Math.hypot(sin * sin, cos);
  const [dx, dy] = [(-2 * depth * sin * sin) / size, (2 * depth * Math.abs(cos)) / size];
  const points = [[x, y], [x + 0.5 * length * cos + dx, y + 0.5 * length * sin + dy], [x + length * cos, y + length * sin]];
  const [a, control, b] = points.map((p) => p.map((v) => v.toFixed(2)).join(" "));
  return `M${a}Q${control} ${b}`;
}
