// Scatter charts as the gallery has them: a score over a cost, on a logarithmic axis.

import { draw } from "./dom.js";

const WIDTH = 340, HEIGHT = 270; // beside the picture, at the size of its text
const LEFT = 42, RIGHT = 14, TOP = 30, BOTTOM = 44;
const MARGIN = 1.25; // factor by which the cost axis extends beyond the outermost points
const MOST_DECADES_WITH_ALL_STEPS = 1.2, MOST_DECADES_WITH_SOME = 2.5;

const SHAPES = [
  () => draw("circle", { r: 4.6 }),
  () => draw("rect", { x: -4.2, y: -4.2, width: 8.4, height: 8.4 }),
  () => draw("path", { d: "M0-6 6 0 0 6-6 0z" }),
  () => draw("path", { d: "M0-5.6 5.4 4.2h-10.8z" }),
];
const shape = (series) => SHAPES[(series + Math.floor(series / 8)) % 4]();

export const mark = (series) => draw("svg", {
  class: `mark s${series % 8}`, viewBox: "-7 -7 14 14", width: 14, height: 14, "aria-hidden": "true",
}, shape(series));

const text = (attributes, words) => draw("text", attributes, words);

// Six ticks or fewer: least, or 2, 5, 10, 20, .. times as much.
function stepOf(span, least) {
  for (let power = 0; ; power++)
    for (const factor of [1, 2, 5]) {
      const step = least * factor * 10 ** power;
      if (span / step <= 6) return step;
    }
}

// 1, 2 and 5 of each power of ten; fewer on a long axis, more on a short one.
function costTicks(low, high) {
  const between = (steps) => {
    const found = [];
    for (let at = Math.floor(Math.log10(low)); at <= Math.ceil(Math.log10(high)); at++)
      for (const step of steps) found.push(Number(`${step}e${at}`));
    return found.filter((value) => value >= low && value <= high);
  };
  const decades = Math.log10(high / low);
  if (decades > MOST_DECADES_WITH_ALL_STEPS) return between(decades > MOST_DECADES_WITH_SOME ? [1] : [1, 3]);
  const usual = between([1, 2, 5]);
  if (usual.length > 1) return usual;
  const fine = between([1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9]);
  return fine.length > 4 ? fine.filter((_, at) => at % 2 === 0) : fine;
}

// points: {cost, score (null: equal pictures), series, text, isShown, isCompared, choose(event)}
// axis: {title, least_step, best, falls}; cost: {title, tick}. The points of a series are joined.
export function chartOf(points, axis, cost, label) {
  const sign = axis.falls ? -1 : 1;
  const costs = points.map((one) => one.cost);
  const low = Math.min(...costs) / MARGIN, high = Math.max(...costs) * MARGIN;
  const scores = points.filter((one) => one.score !== null).map((one) => sign * one.score);
  const finite = scores.length ? scores : [0];
  const isSomeEqual = scores.length < points.length;
  const step = stepOf(Math.max(...finite) - Math.min(...finite), axis.least_step);
  const bottom = Math.floor(Math.min(...finite) / step) * step;
  const top = Math.ceil((Math.max(...finite) + step / 5) / step) * step; // the highest mark stays clear of the frame
  const ceiling = isSomeEqual ? top + step : top;
  const xOf = (value) => LEFT + Math.log(value / low) / Math.log(high / low) * (WIDTH - RIGHT - LEFT);
  const yOf = (value) => HEIGHT - BOTTOM - (value - bottom) / (ceiling - bottom) * (HEIGHT - BOTTOM - TOP);
  const best = axis.best === null ? Infinity : sign * axis.best + step / 2;

  const grid = draw("g", { class: "grid" });
  for (let at = 0; at <= Math.round((top - bottom) / step); at++) {
    const value = bottom + at * step, y = yOf(value);
    if (value >= best) continue;
    grid.append(draw("path", { d: `M${LEFT} ${y}H${WIDTH - RIGHT}` }),
      text({ x: LEFT - 8, y, dy: ".32em", "text-anchor": "end" }, String(Number((sign * value).toFixed(6)) + 0)));
  }
  if (isSomeEqual) grid.append(text({ x: LEFT - 8, y: yOf(ceiling), dy: ".32em", "text-anchor": "end" }, "equal"));
  for (const value of costTicks(low, high)) {
    const x = xOf(value);
    grid.append(draw("path", { d: `M${x} ${TOP}V${HEIGHT - BOTTOM}` }),
      text({ x, y: HEIGHT - BOTTOM + 18, "text-anchor": "middle" }, cost.tick(value)));
  }
  const placed = points.map((one) => ({
    ...one, x: xOf(one.cost), y: yOf(one.score === null ? ceiling : sign * one.score),
  }));
  const lines = [...new Set(placed.map((one) => one.series))].map((series) => {
    const joined = placed.filter((one) => one.series === series).sort((a, b) => a.x - b.x);
    return draw("polyline", { class: "line", "stroke-opacity": 0.35, points: joined.map((one) => `${one.x},${one.y}`).join(" ") });
  });
  return draw("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, width: WIDTH, height: HEIGHT, role: "group", "aria-label": label },
    grid,
    text({ class: "axis", x: 8, y: TOP - 13 }, axis.title),
    text({ class: "axis", x: WIDTH - RIGHT, y: HEIGHT - BOTTOM + 37, "text-anchor": "end" }, cost.title),
    ...lines, ...placed.map(pointOf));
}

function pointOf(point) {
  const at = draw("g", { transform: `translate(${point.x} ${point.y})` },
    draw("circle", { class: "target", r: 12 }),
    point.isShown || point.isCompared ? draw("circle", { class: point.isShown ? "ring" : "ring beside", r: 9.5 }) : null,
    shape(point.series));
  return draw("g", {
    class: `point s${point.series % 8}`, role: "button", tabindex: 0, "data-run": point.run,
    "aria-pressed": String(point.isShown), "aria-label": point.text,
    click: point.choose,
    keydown: (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      point.choose(event);
    },
  }, draw("title", {}, point.text), at);
}
