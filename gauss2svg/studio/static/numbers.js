// Numbers as the gallery's pages show them.

const SPACE = "\u202f";
const NONE = "\u2013";

const threeDigits = (value) => {
  const decimals = value < 9.995 ? 2 : value < 99.95 ? 1 : 0;
  return decimals ? value.toFixed(decimals) : whole(value);
};
const given = (value) => value !== null && value !== undefined;

export function whole(value) {
  return given(value) ? Math.round(value).toString().replace(/\B(?=(\d{3})+$)/g, SPACE) : NONE;
}
export function size(count) {
  if (!given(count)) return NONE;
  for (const [unit, name] of [[1e6, "MB"], [1e3, "kB"]])
    if (count >= 0.9995 * unit) return threeDigits(count / unit) + SPACE + name;
  return `${Math.round(count)}${SPACE}B`;
}
export function seconds(value) {
  return given(value) ? threeDigits(value) + SPACE + "s" : NONE;
}
export function decibels(value) {
  return given(value) ? value.toFixed(2) + SPACE + "dB" : "equal";
}
// At ticks of a chart.
const short = (value) => String(Number(value.toPrecision(6)));
export function shortSize(count) {
  for (const [unit, name] of [[1e6, "MB"], [1e3, "kB"]])
    if (count >= 0.9995 * unit) return short(count / unit) + SPACE + name;
  return short(count) + SPACE + "B";
}
export const shortSeconds = (value) => short(value) + SPACE + "s";
// A score by its axis, with its digits and unit.
export function score(axis, value) {
  if (!given(value)) return axis.best === null ? "equal" : NONE;
  const unit = axis.unit.trim();
  return value.toFixed(axis.digits) + (unit && SPACE + unit);
}
// What an estimate promises: two digits.
const rough = (value) => Number(value.toPrecision(2));
export function about({ gaussians, bytes, seconds: time, psnr }) {
  const parts = [`${whole(rough(gaussians))} shapes`, shortSize(rough(bytes)), shortSeconds(rough(time))];
  if (given(psnr)) parts.push(`${Math.round(psnr)}${SPACE}dB`);
  return parts.join(", ");
}
