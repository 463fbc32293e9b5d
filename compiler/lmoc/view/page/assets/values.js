// The shown variables as text at an instant, those of the recorded run beside them.

import { tableRow } from "./card.js";
import { format } from "./controls.js";
import { putText } from "./dom.js";

export class Values {
  constructor(body, unitOf) {
    Object.assign(this, { body, unitOf, names: [], now: null, other: null });
  }

  put(names, answer, other) {
    this.now = answer.reader(names);
    this.other = other?.reader(names) ?? null;
    if (this.names === names) return;
    this.names = names;
    this.body.replaceChildren(...names.map((name) => tableRow([name, "", this.unitOf(name), ""])));
  }

  show(t) {
    this.write(this.now(t), this.other?.(t));
  }

  /** Show values of `names`, and those of the recorded run, if there are any. */
  write(now, other) {
    for (let k = 0; k < now.length; k++) {
      const { children } = this.body.children[k];
      putText(children[1], format(now[k]));
      putText(children[3], other ? `recorded ${format(other[k])}` : "");
    }
  }
}
