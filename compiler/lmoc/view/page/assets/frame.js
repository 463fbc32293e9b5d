// The page inside of another one, a notebook: it tells what is set in it, and takes values from there.

let order = 0; // of the latest values from around: what is told before the next ones have come is told by this number

/** Call `taken({values, initial})` with what the page around sends. */
export function listenToFrame(taken) {
  if (parent === window) return;
  addEventListener("message", ({ source, data }) => {
    if (source !== parent || data?.lmoc !== "set") return;
    order = data.order ?? 0;
    taken({ values: data.values ?? {}, initial: data.initial ?? {} });
  });
}

/** Tell the page around what a run has been made with. */
export function tellFrame(values, initial) {
  if (parent !== window) parent.postMessage({ lmoc: "ran", values, initial, order }, "*");
}
