// The chart of the runs. The server draws it, and its points become buttons here.

import { getChart } from "./api.js";
import { draw } from "./dom.js";

/** @typedef {{ cost: number, score: number | null, series: number, text: string, run: number,
 *   choose: (event: MouseEvent | KeyboardEvent) => void }} Point the score is null if the SVG equals the photo */

/**
 * Returns the mark of a series. Marks repeat if there are more series than marks.
 * @param {number} series
 */
export function mark(series) {
  const marks = by("marks", HTMLTemplateElement).content.children;
  return marks[series % marks.length].cloneNode(true);
}

/**
 * Returns the chart as an SVG element.
 * @param {Point[]} points
 * @param {string} score key of a report, for the vertical axis
 * @param {string} cost key of a report, for the horizontal axis
 * @param {AbortSignal} signal
 */
export async function chartOf(points, score, cost, signal) {
  const sent = points.map(({ choose, run, ...fields }) => fields);
  const tree = new DOMParser().parseFromString(await getChart({ score, cost, points: sent }, signal), "image/svg+xml");
  all(".point", tree, SVGElement).forEach((node, at) => {
    const { run, text, choose } = points[at];
    for (const [name, value] of Object.entries({ role: "button", tabindex: 0, "data-run": run, "aria-label": text }))
      node.setAttribute(name, String(value));
    node.addEventListener("click", choose);
    node.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      choose(event);
    });
  });
  return document.adoptNode(tree.documentElement);
}

/**
 * Draws rings around the points of the run that is shown, and of the run that it is compared with.
 * @param {ParentNode} chart
 * @param {number | undefined} shown
 * @param {number | undefined} compared
 */
export function ring(chart, shown, compared) {
  for (const old of all(".ring", chart, SVGElement)) old.remove();
  for (const point of all(".point", chart, SVGElement)) {
    const run = Number(point.dataset.run), isShown = run === shown;
    point.setAttribute("aria-pressed", String(isShown));
    if (isShown || run === compared) point.querySelector(".target")?.after(draw("circle", { class: isShown ? "ring" : "ring beside", r: 9.5 }));
  }
}
