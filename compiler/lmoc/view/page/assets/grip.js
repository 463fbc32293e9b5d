// What of a scene a hand holds that takes an item of its picture.

import { hasRim } from "./rim.js";

/**
 * How a hand holds an item at a vertex while the scene runs: {hand, end, move}, the nearest end that can be pulled and the
 * move by which it goes, null where the item turns; undefined where it cannot be pulled.
 */
export function gripAt(item, [share], { hands, handOf }) {
  const [first, last] = [item.ends[0], item.ends.at(-1)];
  for (const end of share < 0.5 ? [first, last] : [last, first]) {
    const move = end.moves.find(({ variable }) => variable in handOf);
    if (move !== undefined) return { hand: hands[handOf[move.variable]], end, move };
  }
  const turned = hasRim(item) ? item.variables.angle : item.turn.variable;
  return turned in handOf ? { hand: hands[handOf[turned]], end: first, move: null } : undefined;
}
