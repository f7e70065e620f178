// Export of a run: files, the clipboard, and the command line that makes the same file.

import { ApiError, getBlob, getFiles, getText, ofJob } from "./api.js";
import { complain, say } from "./dom.js";

/** @import { DoneRun } from "./job.js" */

export class Exports {
  /** @param {import("./api.js").Limits} limits */
  constructor(limits) {
    this.limits = limits;
    this.run = /** @type {DoneRun | null} */ (null);
    this.width = by("png-width", HTMLInputElement);
    this.width.addEventListener("input", () => this.setPng());
    by("save").addEventListener("click", (event) => {
      const button = event.target instanceof Element && event.target.closest("button");
      if (button && button.dataset.copy) this.copy(button, button.dataset.copy);
    });
  }

  /** @param {DoneRun | null} run */
  show(run) {
    const isOther = run !== this.run;
    this.run = run;
    for (const id of ["save", "save-now", "meaning"]) by(id).hidden = run === null;
    if (run === null || !isOther) return;
    complain("save-error", "");
    this.showFiles(run);
    by("save-now", HTMLAnchorElement).href = ofJob(run.id, "picture.svg?download=1");
    for (const link of all("[data-file]", by("save"), HTMLAnchorElement)) link.href = ofJob(run.id, link.dataset.file);
    this.width.max = String(widest(run.report, this.limits.png_pixels));
    this.width.value = String(run.report.width);
    this.setPng();
    by("command").textContent = run.command;
  }

  /**
   * Offers the files that not every run has, as soon as the server has made them.
   * @param {DoneRun} run
   */
  async showFiles(run) {
    const offers = all("[data-needs]", by("save"));
    for (const one of offers) one.hidden = true;
    try {
      const files = await getFiles(run.id);
      if (run === this.run) for (const one of offers) one.hidden = !files.includes(one.dataset.needs ?? "");
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      complain("save-error", error.message);
    }
  }

  setPng() {
    const field = this.width, link = by("png", HTMLAnchorElement);
    const isValid = field.validity.valid && field.value !== "";
    complain("png-error", isValid ? "" : `The width must be 1 to ${field.max} px; got ${field.value || "nothing"}.`);
    link.classList.toggle("off", !isValid);
    if (isValid && this.run) link.href = ofJob(this.run.id, `picture.png?width=${field.value}&download=1`);
    else link.removeAttribute("href");
  }

  /** @param {HTMLButtonElement} button @param {string} what */
  async copy(button, what) {
    complain("save-error", "");
    try {
      await this.write(what);
      say(`${button.textContent} done`);
      const before = button.textContent;
      button.textContent = "Copied";
      setTimeout(() => { button.textContent = before; }, 1500);
    } catch (error) {
      complain("save-error", `Copying failed (${error.message}). Try to save it as a file.`);
    }
  }

  /** @param {string} what */
  write(what) {
    if (this.run === null) throw new TypeError("there is no run");
    if (!navigator.clipboard) throw new Error("browsers copy only from https or from the address of this machine");
    const { id, picture, command } = this.run;
    if (what === "png") return navigator.clipboard.write([new ClipboardItem({ "image/png": getBlob(ofJob(id, "picture.png")) })]);
    if (what === "svg") return navigator.clipboard.writeText(picture.text);
    if (what === "html") {
      // The promise is passed on at once, because a browser may refuse to copy some time after the click.
      const text = getText(ofJob(id, "placeholder.html")).then((found) => new Blob([found], { type: "text/plain" }));
      return navigator.clipboard.write([new ClipboardItem({ "text/plain": text })]);
    }
    const bytes = Array.from(new TextEncoder().encode(picture.text), (byte) => String.fromCharCode(byte));
    if (what === "data-uri") return navigator.clipboard.writeText(`data:image/svg+xml;base64,${btoa(bytes.join(""))}`);
    return navigator.clipboard.writeText(command);
  }
}

/**
 * Returns the largest width of a PNG with the aspect ratio of `size` and at most `most` pixels.
 * @param {{ width: number, height: number }} size
 * @param {number} most
 */
function widest({ width, height }, most) {
  let wide = Math.ceil(Math.sqrt(most * width / height)) + 1;
  while (wide > 1 && wide * Math.ceil(wide * height / width) > most) wide -= 1;
  return wide;
}
