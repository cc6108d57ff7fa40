"use strict";
/* Numbers over time: the columns of a run, unpacked from the text of the page. */

/** Return the bytes of a text: deflated, in base 64. */
async function unpacked(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

/** Return all numbers of a packed text: three planes of bytes. */
async function unpackedNumbers(text) {
  const planes = new Uint8Array(await unpacked(text));
  const count = planes.length / 3;
  const bits = new Uint32Array(count);
  for (let i = 0; i < count; i++) {
    bits[i] = (planes[i] << 24) | (planes[count + i] << 16) | (planes[2 * count + i] << 8);
  }
  return new Float32Array(bits.buffer);
}

/** Return a column of a run: its numbers over `count` samples. */
function column(run, reference, count) {
  if (!Array.isArray(reference)) return new Float64Array(count).fill(reference === null ? NaN : reference);
  const [offset, length, base] = reference;
  const numbers = run.numbers.subarray(offset, offset + length);
  return base ? Float64Array.from(numbers, (number) => base + number) : numbers;
}

/** Add to a run what the page works with: its numbers, the times of its samples, and its poses. */
function prepare(run, numbers) {
  run.numbers = numbers;
  const { every, samples } = run.motion;
  const known = run.sample_times; // of a result that lacks samples, which cannot be counted
  run.motionTimes = known ? Float64Array.from(known.motion)
    : Float64Array.from({ length: samples }, (_, i) => Math.min(i * every, run.samples - 1) * run.step);
  const bucket = run.signals.bucket;
  const count = bucket === 1 ? run.samples : 2 * Math.ceil(run.samples / bucket);
  const time = bucket === 1 ? (i) => i : (i) => Math.min((i / 2 + 0.25) * bucket, run.samples - 1);
  run.times = run.signals.spaced ? run.motionTimes
    : known ? Float64Array.from(known.signals) : Float64Array.from({ length: count }, (_, i) => time(i) * run.step);
  run.poses = run.motion.poses.map((entries) => entries.map((reference) => column(run, reference, samples)));
  run.errors = run.motion.errors.map((errors) => errors.map((reference) => column(run, reference, samples)));
}

/** Return whether a time is before the first sample of a run. */
function isBefore(run, time) {
  return time < run.motionTimes[0] - 1e-9;
}

/** Return whether a run is shown at a time: between its samples, or in the step after the last one, in which it may have failed. */
function isShown(run, time) {
  return !isBefore(run, time) && (run.status === "running" || time <= run.end + run.step + 1e-9);
}

const SHOWN = { 1: ["", 1] }; // display units, to which the page's data adds those of the angles

/** Return the unit in which a signal is shown, and the factor from its own. */
function shownUnit(unit) {
  return SHOWN[unit] || [unit, 1];
}

/** Return a number with four significant digits; a large one among others with as many as tell it from those, that lie within a range. */
function figure(value, range = Infinity) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (typeof value !== "number") return String(value);
  const size = Math.abs(value);
  if (size >= 1000 && size < 1e12 && size > range) {
    return String(Number(value.toFixed(Math.min(9, Math.max(0, 3 - Math.floor(Math.log10(range || 1)))))));
  }
  return size !== 0 && (size < 1e-3 || size >= 1e5) ? value.toExponential(2) : String(Number(value.toPrecision(4)));
}

/** Return how far apart the finite numbers of some columns are, 0 if there are none. */
function spreadOf(columns) {
  let [low, high] = [Infinity, -Infinity];
  for (const numbers of columns) for (const number of numbers) {
    if (!Number.isFinite(number)) continue;
    low = Math.min(low, number);
    high = Math.max(high, number);
  }
  return Math.max(0, high - low);
}

/** Return the last of increasing times that is not after a time. */
function indexAt(times, time) {
  let low = 0;
  let high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= time + 1e-9) low = middle;
    else high = middle - 1;
  }
  return low;
}
