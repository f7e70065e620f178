// Numbers as the gallery's pages show them.

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
const given = (value) => value !== null && value !== undefined;

/** @param {Some} value */
export function whole(value) {
  return given(value) ? Math.round(value).toString().replace(/\B(?=(\d{3})+$)/g, SPACE) : NONE;
}
/** @param {Some} count in bytes */
export function size(count) {
  if (!given(count)) return NONE;
  for (const [unit, name] of UNITS)
    if (count >= 0.9995 * unit) return threeDigits(count / unit) + SPACE + name;
  return `${Math.round(count)}${SPACE}B`;
}
/** @param {Some} value */
export function seconds(value) {
  return given(value) ? threeDigits(value) + SPACE + "s" : NONE;
}
/** @param {Some} value null of equal pictures */
export function decibels(value) {
  return given(value) ? value.toFixed(2) + SPACE + "dB" : "equal";
}
/** @param {number} value */
const short = (value) => String(Number(value.toPrecision(6)));
/** @param {number} count in bytes */
export function shortSize(count) {
  for (const [unit, name] of UNITS)
    if (count >= 0.9995 * unit) return short(count / unit) + SPACE + name;
  return short(count) + SPACE + "B";
}
/**
 * A score with its digits and unit.
 * @param {import("./api.js").Score} axis
 * @param {Some} value
 */
export function score(axis, value) {
  if (!given(value)) return axis.best === null ? "equal" : NONE;
  const unit = axis.unit.trim();
  return value.toFixed(axis.digits) + (unit && SPACE + unit);
}
