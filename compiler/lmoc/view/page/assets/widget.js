// The page in a notebook (anywidget): the sliders' values go to Python, and Python's to the sliders.

function render({ model, el }) {
  const frame = Object.assign(document.createElement("iframe"), { srcdoc: model.get("_html"), title: model.get("_title") });
  Object.assign(frame.style, { width: "100%", height: "760px", border: "1px solid #ddd" });
  const now = () => ({ values: model.get("values"), initial: model.get("initial") });
  let known = ""; // what the page has told: not to be sent back
  let sent = 0; // times that Python's values have been sent
  const post = () => frame.contentWindow?.postMessage({ lmoc: "set", order: sent, ...now() }, "*");
  const send = () => {
    const text = JSON.stringify(now());
    if (text === known) return;
    known = text;
    sent++;
    post();
  };
  const heard = ({ source, data }) => {
    if (source !== frame.contentWindow || data?.lmoc !== "ran") return;
    if (known === "" && Object.keys({ ...now().values, ...now().initial }).length) return send(); // it has opened: Python's count
    const { values, initial, order } = data;
    if (sent && !order) return post(); // it has not been open when they were sent
    if (order < sent) return; // a run from before Python's values: theirs is under way
    const text = JSON.stringify({ values, initial });
    known = text;
    if (text === JSON.stringify(now())) return; // it runs with what Python has
    model.set("values", values);
    model.set("initial", initial);
    model.save_changes();
  };
  addEventListener("message", heard);
  model.on("change:values", send);
  model.on("change:initial", send);
  el.append(frame);
  return () => {
    removeEventListener("message", heard);
    model.off("change:values", send);
    model.off("change:initial", send);
  };
}
export default { render };
