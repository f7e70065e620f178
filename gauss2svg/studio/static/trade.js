// The chart and the table of finished runs. Each run is a point and a row.

import { ApiError } from "./api.js";
import { chartOf, mark, ring } from "./chart.js";
import { complain, make } from "./dom.js";
import { drawn, PARTS, score, seconds, size, whole } from "./numbers.js";

/** @import { Score } from "./api.js" */
/** @import { DoneRun, Run } from "./job.js" */

export class Trade {
  /**
   * @param {Score[]} scores all scores that can be an axis
   * @param {(run: DoneRun) => void} show called by a click on a run
   * @param {(run: DoneRun) => void} compare called by a click with Shift, and by the button Compare
   */
  constructor(scores, show, compare) {
    this.scores = scores;
    this.show = show;
    this.compare = compare;
    this.runs = /** @type {DoneRun[]} */ ([]);
    this.measured = /** @type {Score[]} */ ([]);
    this.shown = /** @type {Run | null} */ (null);
    this.compared = /** @type {Run | null} */ (null);
    this.drawn = "";
    this.asking = new AbortController();
    this.axes = by("axes", HTMLFormElement);
    /** @param {Score} axis @param {number} at */
    const radio = (axis, at) => make("label", {},
      make("input", { type: "radio", name: "score", value: axis.key, checked: at === 0 }), make("span", {}, axis.name));
    by("scores").append(...scores.map(radio));
    this.axes.addEventListener("input", () => this.drawChart());
    this.axes.addEventListener("submit", (event) => event.preventDefault());
  }

  /** @param {DoneRun[]} runs @param {Run | null} shown @param {Run | null} compared */
  update(runs, shown, compared) {
    this.runs = runs;
    this.shown = shown;
    this.compared = compared;
    by("trade").hidden = by("runs-section").hidden = runs.length === 0;
    if (!runs.length) return;
    this.measured = this.scores.filter((axis) => runs.some((run) => axis.key in run.report && (run.report[axis.key] !== null || axis.best === null)));
    for (const input of all("[name=score]", this.axes, HTMLInputElement))
      input.labels?.[0].toggleAttribute("hidden", !this.measured.some((axis) => axis.key === input.value));
    this.drawChart();
    this.fillTable();
  }

  axis() {
    const chosen = new FormData(this.axes).get("score");
    return this.measured.find((axis) => axis.key === chosen) ?? this.measured[0];
  }

  // Requests a new chart if its points or axes have changed. The old chart stays until the new one comes.
  async drawChart() {
    const axis = this.axis(), cost = String(new FormData(this.axes).get("cost"));
    /** @param {DoneRun} run */
    const has = (run) => axis.best === null || (run.report[axis.key] ?? null) !== null;
    const points = this.runs.filter(has).map((run) => ({
      cost: Number(run.report[cost]), score: run.report[axis.key], series: run.photo.series ?? 0, run: run.number,
      text: `${named(run)}: ${drawn(run.report)}, ${score(axis, run.report[axis.key])}, ${size(run.report.svg_bytes)}, ${seconds(run.report.total_s)}`,
      choose: (/** @type {MouseEvent | KeyboardEvent} */ event) => (event.shiftKey ? this.compare(run) : this.show(run)),
    }));
    const request = JSON.stringify([axis.key, cost, points]);
    if (request !== this.drawn) {
      this.drawn = request;
      this.asking.abort();
      this.asking = new AbortController();
      try {
        const chart = await chartOf(points, axis.key, cost, this.asking.signal);
        const focused = document.activeElement?.closest(".point")?.getAttribute("data-run");
        by("chart").replaceChildren(chart);
        if (focused) all(`[data-run="${focused}"]`, chart, SVGElement)[0]?.focus({ preventScroll: true });
      } catch (error) {
        if (error.name === "AbortError") return;
        if (!(error instanceof ApiError)) throw error;
        this.drawn = "";
        complain("photo-error", error.message);
      }
    }
    ring(by("chart"), this.shown?.number, this.compared?.number);
  }

  // Returns what the runs are made of. Runs of photos alone have no areas and lines.
  parts() {
    return PARTS.filter(([key]) => key === "gaussians" || this.runs.some((run) => run.report[key]));
  }

  fillTable() {
    const columns = ["Run", "Aim", ...this.parts().map(([, name]) => name), ...this.measured.map((axis) => axis.name), "Size", "Gzipped", "Time", "Compare"];
    const texts = ["Run", "Aim", "Compare"];
    const heads = columns.map((name) => make("th", { scope: "col", class: texts.includes(name) ? "text" : null }, name));
    const focused = document.activeElement?.getAttribute("data-action");
    by("runs").replaceChildren(
      make("caption", {}, "All runs, measured on the rasterised SVG against the photo"),
      make("thead", {}, make("tr", {}, ...heads)),
      make("tbody", {}, ...this.runs.map((run) => this.row(run))));
    if (focused) all("[data-action]", by("runs")).find((one) => one.dataset.action === focused)?.focus({ preventScroll: true });
  }

  /** @param {DoneRun} run */
  row(run) {
    const { report } = run, isShown = run === this.shown, isCompared = run === this.compared;
    /** @param {string} words */
    const cell = (words) => make("td", {}, words);
    const compare = make("button", {
      class: "small", type: "button", "aria-pressed": String(isCompared), "data-action": `compare-${run.number}`,
      "aria-label": `Compare ${named(run)} with the picture shown`,
      disabled: isShown || run.photo !== this.shown?.photo, click: () => this.compare(run),
    }, "Compare");
    return make("tr", { "aria-current": isShown ? "true" : null },
      make("th", { scope: "row" }, mark(run.photo.series ?? 0), make("button", {
        class: "plain-button", type: "button", "data-action": `show-${run.number}`, click: () => this.show(run),
      }, `${run.number}, ${run.photo.name}`)),
      make("td", { class: "text" }, run.aim),
      ...this.parts().map(([key]) => cell(whole(report[key]))), ...this.measured.map((axis) => cell(score(axis, report[axis.key]))),
      cell(size(report.svg_bytes)), cell(size(report.svgz_bytes)), cell(seconds(report.total_s)),
      make("td", { class: "text" }, compare));
  }
}

/** @param {Run} run */
export const named = (run) => `Run ${run.number}, ${run.photo.name}, ${run.aim}`;
