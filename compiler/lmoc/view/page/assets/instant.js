// The laws of a scene at one instant: gaps, rates, the effect of their forces, and their limits, as `numerics/laws/instant.py`.

import { filled, zeroMatrix } from "./matrix.js";

const LOSSLESS = 1e-6; // of a rate, in a bounce

export class ContactKinematics {
  /** `scene` evaluates; `scene.data.laws` says where the quantities of the laws stand among the registers. */
  constructor(scene) {
    const own = scene.data.laws;
    Object.assign(this, { scene, own, count: own.force.length, ledger: own.ledger });
    this.errors = null; // of the states, what the integrator allows itself in a step
    const { unilateral, complementary, dry, contact, degree, normal } = own;
    const impulsive = complementary.map((c, k) => c && degree[k] === 2);
    const restitution = own.restitution.map((register) => (register < 0 ? 0 : scene.w[register]));
    const lossless = restitution.map((e) => e > 1 - LOSSLESS); // or so near to it that its bounces are no series that ends
    this.table = { unilateral, complementary, dry, contact, degree, normal, impulsive, restitution, lossless };
  }

  /** The registers of a mode that keeps the velocities `still` at zero; without one all laws are open. */
  hold(mode = null, still = null) {
    const { w, programs } = this.scene;
    programs.switched();
    this.own.held.forEach((register, j) => {
      if (register >= 0) w[register] = Number(still !== null && still[j]);
    });
    this.own.closed.forEach((register, k) => (w[register] = Number(mode !== null && mode.closed[k] && !mode.implied[k])));
    this.own.push.forEach((register, k) => (w[register] = mode === null ? 0 : mode.push[k]));
    this.own.direction.forEach((register, k) => {
      if (register >= 0) w[register] = mode === null ? 0 : mode.direction[k];
    });
  }

  /** Each law's rate as a linear form in velocities, whose coefficients do not change between events; null for others. */
  rateForms() {
    const { scene, own } = this;
    if (!own.linearRates.some(Boolean)) return filled(this.count, null);
    const { rate, rateSlope } = scene.programs.aside(() => this.at(0, new Float64Array(own.held.length)));
    return rateSlope.map((form, k) => {
      const ofVelocities = form.every((v, j) => v === 0 || own.held[j] >= 0);
      return own.linearRates[k] && own.degree[k] === 2 && ofVelocities && rate[k] === 0 ? form : null;
    });
  }

  /** Values at a time and state with all laws open and their forces zero; the registers are left like that. */
  at(t, x) {
    const { scene, own, count } = this;
    const { w } = scene;
    this.hold();
    scene.evaluate(scene.functions.kinematics, t, x);
    const values = (registers) => registers.map((register) => (register < 0 ? NaN : w[register]));
    const limits = (registers) => values(registers).map((v) => Math.max(v, 0));
    const found = { t, x, gap: values(own.gap), rate: values(own.rate), bias: values(own.level) };
    Object.assign(found, { slip: limits(own.slip), stick: limits(own.stick), stored: own.stored < 0 ? NaN : w[own.stored] });
    const derivatives = (registers, into, column) => {
      registers.forEach((register, k) => (into[k][column] = register < 0 ? 0 : w[register]));
    };
    const delassus = zeroMatrix(count, count);
    const response = zeroMatrix(x.length, count);
    const gapSlope = zeroMatrix(count, x.length);
    const rateSlope = zeroMatrix(count, x.length);
    const columns = (seeds, run, read) => {
      for (const seed of seeds) w[seed] = 0;
      seeds.forEach((seed, j) => {
        w[seed] = 1;
        run(t);
        read(j);
        w[seed] = 0;
      });
    };
    columns(own.stateSeeds, scene.functions.byState, (j) => {
      derivatives(own.gapTangents, gapSlope, j);
      derivatives(own.rateTangents, rateSlope, j);
    });
    columns(own.pushSeeds, scene.functions.byForce, (j) => {
      derivatives(own.levelTangents, delassus, j);
      derivatives(own.derivativeTangents, response, j);
    });
    const gapScale = scaleOfTerms(found.gap, gapSlope, x);
    const rateScale = scaleOfTerms(found.rate, rateSlope, x);
    return { ...found, delassus, response, gapSlope, rateSlope, gapScale, rateScale };
  }
}

/** The sizes of the terms whose sums some values are; 0 where there are none. */
function scaleOfTerms(values, slopes, x) {
  return values.map((value, k) => {
    if (Number.isNaN(value)) return 0;
    let [sum, size] = [0, 0];
    slopes[k].forEach((s, j) => {
      sum += s * x[j];
      size += Math.abs(s * x[j]);
    });
    return size + Math.abs(value - sum);
  });
}

/** The laws of a scene contradict each other at an instant; `laws` take part. */
export class Contradiction extends Error {
  constructor(laws, reason) {
    super(reason);
    this.laws = laws;
  }
}
