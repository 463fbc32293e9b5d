// The result of a run: values of variables over time, from the compiler or from the page's own simulation.

/** Bytes from their base64 text. */
export function decodeBytes(text) {
  return Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
}

/** Numbers from the base64 text of 32-bit or 64-bit floats (little-endian, as every browser has them). */
export function decode(text, bits) {
  const bytes = decodeBytes(text);
  return bits === 64 ? new Float64Array(bytes.buffer) : new Float32Array(bytes.buffer);
}

/** The place of a time among increasing ones: [index of the last one not later, share of the way to the next one]. */
export function placeOf(time, t) {
  let low = 0;
  let high = time.length - 1;
  if (high < 0 || t <= time[0]) return [0, 0];
  if (t >= time[high]) return [high, 0];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (time[middle] <= t) low = middle;
    else high = middle;
  }
  return [low, (t - time[low]) / (time[high] - time[low])];
}

export class Answer {
  /**
   * `columns` maps names to arrays over time, or to numbers that do not change; `modes` are [since, {law: mode}], in order; from
   * `unbooked` on the ledger has no values.
   */
  constructor(time, columns, { complete = true, reason = "", events = [], modes = [], unbooked = Infinity } = {}) {
    Object.assign(this, { time, columns, complete, reason, events, modes, unbooked });
  }

  /** [law, mode] of each law at a time. */
  modesAt(t) {
    const now = this.modes.findLast(([since]) => since <= t) ?? this.modes[0];
    return now === undefined ? [] : Object.entries(now[1]);
  }

  has(name) {
    return this.columns.has(name);
  }

  /** Values over time. */
  of(name) {
    const found = this.columns.get(name);
    return typeof found === "number" ? new Float64Array(this.time.length).fill(found) : (found ?? []);
  }

  /** Values of the ledger over time, as long as it has some. */
  booked(name) {
    return this.of(name).map((v, k) => (this.time[k] < this.unbooked ? v : NaN));
  }

  /** A function of time for many names: `values(t)` fills and returns one array, linear between output times. */
  reader(names) {
    const columns = names.map((name) => this.columns.get(name) ?? NaN);
    const values = new Float64Array(names.length);
    return (t) => {
      const [k, share] = placeOf(this.time, t);
      for (let i = 0; i < columns.length; i++) {
        const c = columns[i];
        if (typeof c === "number") values[i] = c;
        else values[i] = share === 0 ? c[k] : c[k] + share * (c[k + 1] - c[k]);
      }
      return values;
    };
  }

  at(name, t) {
    return this.reader([name])(t)[0];
  }
}

/** An answer that has been a message, which keeps no class. */
export const revived = ({ time, columns, ...run }) => new Answer(time, columns, run);

/** The answer of the compiler, out of the data of a page. */
export function givenAnswer(data) {
  const time = Float64Array.from(decode(data.time, 64));
  const values = decode(data.values, 32);
  const columns = new Map();
  for (const { name, column, value } of [...data.jets, ...data.variables]) {
    const own = column === undefined ? (value ?? NaN) : values.subarray(column * time.length, (column + 1) * time.length);
    columns.set(name, own);
  }
  const { complete, reason, events, modes, unbooked } = data;
  return new Answer(time, columns, { complete, reason, events, modes, unbooked: unbooked ?? Infinity });
}

/**
 * How far another answer to the same question goes another way: {missed, from}, the largest difference of variables as a part
 * of the largest value of their unit, and the time from which on it is larger than `most`, null where it never is. An instant
 * alone, on two sides of a jump, does not count. Where the other one ends early, nothing beyond is known.
 */
export function parting(answer, other, names, unitOf, most) {
  const count = Math.min(answer.time.length, other.time.length);
  const sizes = new Map();
  const size = (v, unit) => sizes.set(unit, Math.max(sizes.get(unit) ?? 0, Math.abs(v) || 0));
  for (const name of names) answer.of(name).forEach((v) => size(v, unitOf(name)));
  const apart = new Float64Array(count);
  for (const name of names) {
    const [a, b, scale] = [answer.of(name), other.of(name), sizes.get(unitOf(name)) || 1];
    for (let k = 0; k < count; k++) apart[k] = Math.max(apart[k], Math.abs(a[k] - b[k]) / scale || 0);
  }
  const lasting = apart.map((v, k) => Math.min(v, apart[k + 1] ?? v));
  const ends = count < answer.time.length ? other.time[count - 1] : null;
  const first = lasting.findIndex((v) => v > most);
  return { missed: ends === null ? Math.max(0, ...lasting) : Infinity, from: first < 0 ? ends : answer.time[first] };
}

/**
 * The largest difference between an answer and exact columns [[name, base64], …], as a part of the `sizes` {unit: largest
 * value}; infinite where the answer has no value, but for what it has not reached of a run that broke off.
 */
export function difference(answer, exact, sizes, unitOf, complete = true) {
  let most = 0;
  for (const [name, text] of exact) {
    const truth = decode(text, 64);
    const own = answer.of(name);
    for (let k = 0; k < truth.length; k++) {
      if (Number.isNaN(truth[k]) || (!complete && k >= own.length)) continue;
      const miss = k < own.length ? Math.abs(own[k] - truth[k]) / (sizes[unitOf(name)] || 1) : NaN;
      most = Math.max(most, Number.isNaN(miss) ? Infinity : miss);
    }
  }
  return most;
}
