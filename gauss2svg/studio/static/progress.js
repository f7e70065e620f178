// Progress of the active run (its figures and its bar), and the strip of photos.

import { make } from "./dom.js";
import { isActive, isDone } from "./job.js";
import { decibels, drawn, seconds, size, whole } from "./numbers.js";

/** @import { Photo, Run } from "./job.js" */

const PHASES = /** @type {Record<string, string>} */ ({
  read: "Reading the photo", write: "Writing the SVG",
  measure: "Measuring the SVG", correct: "Correcting the number of shapes",
});
/** @param {number} place */
const ahead = (place) => (place === 1 ? "one before it" : `${place} before it`);

/** @param {Run} run */
function standing(run) {
  const place = run.place ?? 0;
  if (run.lost) return run.lost;
  if (run.isStopping) return "Stopping, with the best picture so far";
  if (run.state === "waiting") return `Waiting, ${ahead(place)}`;
  if (run.state === "queued") return "In the queue, next";
  const now = run.progress;
  if (!now) return "Starting";
  if (now.phase === "areas") return now.areas ? "Refining areas" : "Finding areas";
  return PHASES[now.phase ?? ""] ?? `Round ${now.round}`;
}

/** @param {Run | null} run */
export function showProgress(run) {
  by("progress").hidden = run === null;
  if (run === null) return;
  const now = run.progress ?? {}, isFitting = now.iteration !== undefined;
  const figures = run.figures ?? now; // the figures of the fit stay while the SVG is written
  if (isFitting) run.figures = now;
  by("standing").textContent = standing(run);
  const bar = by("bar", HTMLProgressElement);
  // Without a value the bar shows only that something happens, such as a measurement.
  if (!isFitting) bar.removeAttribute("value");
  else bar.value = now.done ?? 0;
  const has = figures.gaussians !== undefined;
  for (const [id, text] of [
    ["now-areas", figures.areas ?? ""], ["now-shapes", figures.gaussians || (has && !figures.areas) ? whole(figures.gaussians) : ""], ["now-psnr", has ? decibels(figures.psnr) : ""],
    ["now-size", has && figures.bytes_estimate ? `about ${size(figures.bytes_estimate)}` : ""], ["now-time", has ? seconds(figures.elapsed_s) : ""],
    ["now-left", has && isFitting && Number(now.remaining_s) > 0 ? seconds(now.remaining_s) : ""],
  ]) {
    by(id).textContent = text;
    by(id).closest("div")?.toggleAttribute("hidden", text === "");
  }
  by("stop", HTMLButtonElement).disabled = !isFitting || run.isStopping === true;
}

/** @param {{ report: import("./api.js").Report }} run */
export function figuresOf({ report }) {
  const parts = [drawn(report), decibels(report.psnr_svg)];
  if (report.ssim_svg !== null && report.ssim_svg !== undefined) parts.push(`SSIM ${report.ssim_svg.toFixed(3)}`);
  if (report.focus_strength) parts.push(`${decibels(report.psnr_svg_inside)} in the focus, ${decibels(report.psnr_svg_outside)} outside`);
  parts.push(sizes(report), seconds(report.total_s));
  return parts.join(" \u00b7 ");
}

/** @param {import("./api.js").Report} report */
export const sizes = (report) => `${size(report.svg_bytes)} (${size(report.svgz_bytes)} gzipped)`;

/**
 * Explains the likeness of a run. Only of photos do 30 and 35 dB say how it looks.
 * @param {import("./api.js").Report} report
 */
export function meaningOf({ inks, area_count, line_count }) {
  if (inks) return "dB: likeness to the photo. A few inks are far in dB: judge by eye.";
  if (area_count || line_count) return "dB: likeness to the drawing. Look at its edges too.";
  return "dB: likeness to the photo. 30 is soft, 35 is good, at 40 it is hard to tell them apart.";
}

/**
 * Lists the inks of a run, with the share of the picture that each has.
 * @param {import("./api.js").Report | undefined} report
 */
export function showInks(report) {
  const inks = report?.inks?.split(",") ?? [], shares = report?.ink_shares ?? [];
  by("inks").hidden = inks.length === 0;
  by("inks").replaceChildren(...inks.map((ink, at) => {
    const swatch = make("span", { class: "swatch" });
    swatch.style.background = ink; // the policy of the page forbids style attributes
    const share = 100 * shares[at];
    return make("li", {}, swatch, make("code", {}, ink), ` ${share && share < 0.1 ? "< 0.1" : share.toFixed(1)} %`);
  }));
}

/** @param {Run | undefined} run */
function inShort(run) {
  if (!run) return "";
  if (isDone(run)) return `${decibels(run.report.psnr_svg)}, ${size(run.report.svg_bytes)}`;
  if (!isActive(run)) return run.state;
  if (run.state !== "running") return "waiting";
  return run.progress?.done === undefined ? "running" : `${Math.round(100 * run.progress.done)} %`;
}

// A row of all photos, if there are several. Its elements are updated and not replaced, so that the focus stays.
export class Strip {
  /** @param {(photo: Photo) => void} choose */
  constructor(choose) {
    this.choose = choose;
    this.items = /** @type {Map<Photo, { item: HTMLElement, button: HTMLElement, state: HTMLElement }>} */ (new Map());
  }

  /** @param {Photo[]} photos @param {Photo | null} current @param {(photo: Photo) => Run | undefined} newest */
  update(photos, current, newest) {
    by("strip").hidden = photos.length < 2;
    for (const photo of photos) {
      const { button, state } = this.items.get(photo) ?? this.add(photo);
      button.setAttribute("aria-pressed", String(photo === current));
      state.textContent = inShort(newest(photo));
    }
    for (const [photo, { item }] of this.items) if (!photos.includes(photo)) {
      item.remove();
      this.items.delete(photo);
    }
  }

  /** @param {Photo} photo */
  add(photo) {
    const picture = make("img", { src: photo.url, alt: "", error: () => { picture.hidden = true; } });
    const state = make("span", { class: "soft" });
    const button = make("button", { type: "button", class: "sample", click: () => this.choose(photo) },
      picture, make("span", { class: "name" }, photo.name), state);
    const item = make("li", {}, button);
    by("thumbnails").append(item);
    const added = { item, button, state };
    this.items.set(photo, added);
    return added;
  }
}
