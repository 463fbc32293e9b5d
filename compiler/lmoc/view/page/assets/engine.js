// The page's own simulation, in a worker of its own: the page asks, and never waits.

/** Requests are answered one after the other; of those of a kind that wait, only the last. */
export class Engine {
  /** `text` is the script of the worker, `setup` what it is made of; `busy(is)` is told when work begins and ends. */
  constructor(text, setup, busy) {
    this.worker = new Worker(URL.createObjectURL(new Blob([text], { type: "text/javascript" })));
    Object.assign(this, { busy, running: null, waiting: new Map() });
    this.worker.onmessage = ({ data }) => this.done(data);
    this.worker.onerror = (event) => this.done({ error: event.message || "the simulation has failed" });
    this.worker.postMessage(setup);
  }

  /** The result of a request; null where another one of its kind has taken its place. */
  ask(kind, body) {
    return new Promise((resolve, reject) => {
      this.waiting.get(kind)?.resolve(null);
      this.waiting.set(kind, { kind, body, resolve, reject });
      this.next();
    });
  }

  next() {
    if (this.running !== null || this.waiting.size === 0) return;
    const [[kind, request]] = this.waiting;
    this.waiting.delete(kind);
    this.running = request;
    this.busy(true);
    this.worker.postMessage({ kind, body: request.body });
  }

  done({ result, error }) {
    const { running } = this;
    this.running = null;
    if (error !== undefined) running?.reject(new Error(error));
    else running?.resolve(result);
    this.next();
    if (this.running === null) this.busy(false);
  }
}
