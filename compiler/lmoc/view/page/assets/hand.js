// The hand in the picture: a press on an item chooses it, a drag takes it along.

const STILL = 4; // px that a press may move and be no drag

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
