// The page inside of another one, a notebook: it tells what is set in it, and takes values from there.

/** Call `taken({values, initial})` with what the page around sends. */
export function listenToFrame(taken) {
  if (parent === window) return;
  addEventListener("message", ({ source, data }) => {
    if (source === parent && data?.lmoc === "set") taken({ values: data.values ?? {}, initial: data.initial ?? {} });
  });
}

/** Tell the page around what a run has been made with. */
export function tellFrame(values, initial) {
  if (parent !== window) parent.postMessage({ lmoc: "ran", values, initial }, "*");
}
