// The page in a notebook (anywidget): the sliders' values go to Python, and Python's to the sliders.

function render({ model, el }) {
  const frame = Object.assign(document.createElement("iframe"), { srcdoc: model.get("_html"), title: model.get("_title") });
  Object.assign(frame.style, { width: "100%", height: "760px", border: "1px solid #ddd" });
  const now = () => ({ values: model.get("values"), initial: model.get("initial") });
  let known = ""; // what the page has told: not to be sent back
  const send = () => {
    const text = JSON.stringify(now());
    if (text === known) return;
    known = text;
    frame.contentWindow?.postMessage({ lmoc: "set", ...now() }, "*");
  };
  const heard = ({ source, data }) => {
    if (source !== frame.contentWindow || data?.lmoc !== "ran") return;
    if (known === "" && Object.keys({ ...now().values, ...now().initial }).length) return send(); // it has opened: Python's count
    const { values, initial } = data;
    const text = JSON.stringify({ values, initial });
    if (text === known) return; // it runs with what it has been sent
    known = text;
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
