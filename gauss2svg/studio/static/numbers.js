// Numbers as text, in the same form as on the pages of galleries.

const SPACE = "\u202f";
const NONE = "\u2013";
const UNITS = /** @type {[number, string][]} */ ([[1e6, "MB"], [1e3, "kB"]]);

/** @typedef {number | null | undefined} Some */

/** @param {number} value */
const threeDigits = (value) => {
  const decimals = value < 9.995 ? 2 : value < 99.95 ? 1 : 0;
  return decimals ? value.toFixed(decimals) : whole(value);
};
/** @param {Some} value @returns {value is number} */
const isNumber = (value) => value !== null && value !== undefined;

/** @param {Some} value */
export function whole(value) {
  return isNumber(value) ? Math.round(value).toString().replace(/\B(?=(\d{3})+$)/g, SPACE) : NONE;
}
/** @param {Some} count bytes */
export function size(count) {
  if (!isNumber(count)) return NONE;
  for (const [unit, name] of UNITS)
    if (count >= 0.9995 * unit) return threeDigits(count / unit) + SPACE + name;
  return `${Math.round(count)}${SPACE}B`;
}
// Keys of a report, and what they count.
export const PARTS = /** @type {[string, string][]} */ ([["area_count", "Areas"], ["line_count", "Lines"], ["gaussians", "Shapes"]]);
/** @param {import("./api.js").Report} report @returns {string} "12 areas, 1 line", or "100 shapes" */
export function drawn(report) {
  const some = PARTS.filter(([key]) => report[key]);
  return (some.length ? some : PARTS.slice(2)).map(([key, name]) => {
    const word = name.toLowerCase();
    return `${whole(report[key])} ${report[key] === 1 ? word.slice(0, -1) : word}`;
  }).join(", ");
}
/** @param {Some} value */
export function seconds(value) {
  return isNumber(value) ? threeDigits(value) + SPACE + "s" : NONE;
}
/** @param {Some} value null if the pictures are equal */
export function decibels(value) {
  return isNumber(value) ? value.toFixed(2) + SPACE + "dB" : "equal";
}
/** @param {number} value */
const short = (value) => String(Number(value.toPrecision(6)));
/** @param {number} count bytes */
export function shortSize(count) {
  for (const [unit, name] of UNITS)
    if (count >= 0.9995 * unit) return short(count / unit) + SPACE + name;
  return short(count) + SPACE + "B";
}
/**
 * Returns a score with its digits and unit.
 * @param {import("./api.js").Score} axis
 * @param {Some} value
 */
export function score(axis, value) {
  if (!isNumber(value)) return axis.best === null ? "equal" : NONE;
  const unit = axis.unit.trim();
  return value.toFixed(axis.digits) + (unit && SPACE + unit);
}
