// The hand in the picture: a press on an item chooses it, a drag takes it along. Keys do the same where the picture has their focus.

const STILL = 4; // px that a press may move and be no drag
const NUDGE = 8; // px, by which an arrow key moves the hand
const WAYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/** `page` has `wanted(item)`, `pick(k)`, `take(k, place)`, which says whether it can be taken, `move(place)` and `drop()`. */
export function listenToHand(stage, page) {
  const { svg } = stage;
  let held = null; // {item, from, taken, inside}
  const place = (event) => held.inside(event.clientX, event.clientY);
  svg.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || held !== null) return;
    const item = stage.itemAt(event.clientX, event.clientY, page.wanted);
    if (item < 0) return;
    held = { item, from: event, taken: false, inside: stage.inside() };
    svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener("pointermove", (event) => {
    if (held === null) return;
    const { from } = held;
    if (!held.taken) {
      if (Math.hypot(event.clientX - from.clientX, event.clientY - from.clientY) < STILL) return;
      if (!page.take(held.item, place(from))) held = null;
      else held.taken = true;
    }
    if (held !== null) page.move(place(event));
  });
  const end = () => {
    if (held === null) return;
    if (held.taken) page.drop();
    else page.pick(held.item);
    held = null;
  };
  svg.addEventListener("pointerup", end);
  svg.addEventListener("pointercancel", end);
}

/**
 * Arrow keys move a hand that holds what `page.first()` names, [item, place]; Enter or Escape lets go, and so does the key itself
 * where nothing runs.
 */
export function listenToKeys({ svg }, page) {
  let at = null; // the place of the hand
  let moved = null; // the promise that the scene has followed
  const drop = async () => {
    if (at === null) return;
    at = null;
    await moved;
    page.drop();
  };
  svg.addEventListener("keydown", (event) => {
    if (["Enter", "Escape"].includes(event.key)) drop();
    if (!(event.key in WAYS) || !svg.matches(":focus-visible") || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation();
    const [item, begin] = at === null ? page.first() : [-1, at];
    if (at === null && !page.take(item, begin)) return;
    at = begin.map((v, k) => v + NUDGE * WAYS[event.key][k]);
    moved = page.move(at);
  });
  svg.addEventListener("keyup", () => page.pulls() || drop());
  svg.addEventListener("blur", drop);
}
