// The state of the page as the fragment of its address, to be shared: #t=1.5&set=spring.k:60&show=mass.q

/** The fragment of {t, speed, set, init, pulls, against, show, over, part, forces, mode, loop}; what is as at the beginning, null for the speed, is left out. */
export function write(state) {
  const parts = [];
  const add = (key, value) => parts.push(`${key}=${value}`);
  const values = (set) => Object.entries(set).map(([name, value]) => `${encodeURIComponent(name)}:${value}`).join(",");
  if (state.t) add("t", Number(state.t.toPrecision(6)));
  if (state.speed !== null) add("speed", state.speed);
  if (Object.keys(state.set).length) add("set", values(state.set));
  if (Object.keys(state.init).length) add("init", values(state.init));
  if (state.pulls.length) add("pull", pullText(state.pulls));
  if (state.against !== null) {
    add("against", values(state.against.set));
    if (Object.keys(state.against.init).length) add("from", values(state.against.init));
    if (state.against.pulls.length) add("pulled", pullText(state.against.pulls));
  }
  if (state.show !== null) add("show", state.show.map(encodeURIComponent).join(","));
  if (state.over) add("over", encodeURIComponent(state.over));
  if (state.part) add("part", encodeURIComponent(state.part));
  if (state.forces) add("forces", 1);
  if (state.mode) add("mode", state.mode);
  if (!state.loop) add("loop", 0);
  return parts.join("&");
}

/** The state of a fragment; whatever is not understood is left as at the beginning. */
export function read(fragment) {
  const state = { t: 0, speed: null, set: {}, init: {}, pulls: [], against: null, show: null, over: "", part: "", forces: false, mode: "", loop: true };
  let [from, pulled] = [{}, []];
  for (const part of fragment.replace(/^#/, "").split("&")) {
    const [key, value = ""] = part.split("=", 2);
    if (key === "t" && Number.isFinite(Number(value))) state.t = Number(value);
    if (key === "speed" && Number(value) > 0) state.speed = Number(value);
    if (key === "set") state.set = values(value);
    if (key === "init") state.init = values(value);
    if (key === "pull") state.pulls = pulls(value);
    if (key === "against") state.against = { set: values(value), init: {}, pulls: [] };
    if (key === "from") from = values(value);
    if (key === "pulled") pulled = pulls(value);
    if (key === "over") state.over = decoded(value);
    if (key === "part") state.part = decoded(value);
    if (key === "show") state.show = value.split(",").map(decoded).filter(Boolean);
    if (key === "forces") state.forces = value === "1";
    if (key === "mode" && /^[1-9]\d*$/.test(value)) state.mode = value;
    if (key === "loop") state.loop = value !== "0";
  }
  if (state.against !== null) Object.assign(state.against, { init: from, pulls: pulled });
  return state;
}

const pullText = (own) => own.map(([t, part, signals]) => [t, encodeURIComponent(part), ...signals].join(",")).join(";");

function pulls(text) {
  return text.split(";").flatMap((entry) => {
    const [t, part, ...own] = entry.split(",");
    const numbers = [t, ...own].map(Number);
    return part && numbers.every(Number.isFinite) ? [[numbers[0], decoded(part), numbers.slice(1)]] : [];
  });
}

function values(text) {
  const found = {};
  for (const pair of text.split(",")) {
    const [name, value] = pair.split(":", 2);
    if (decoded(name) && value && Number.isFinite(Number(value))) found[decoded(name)] = Number(value);
  }
  return found;
}

function decoded(text) {
  try {
    return decodeURIComponent(text ?? "");
  } catch {
    return "";
  }
}
