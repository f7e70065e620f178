// The ways out: files, the clipboard, and the lines that make the same file.

import { getBlob, getText, ofJob } from "./api.js";
import { all, by, complain, say } from "./dom.js";

const LARGEST_PNG = 16384; // px a side

export class Exports {
  constructor() {
    this.run = null;
    by("png-width").addEventListener("input", () => this.setPng());
    by("save").addEventListener("click", (event) => {
      const button = event.target.closest("[data-copy]");
      if (button) this.copy(button);
    });
  }

  show(run) {
    const isOther = run !== this.run;
    this.run = run;
    by("save").hidden = run === null;
    if (run === null || !isOther) return;
    complain("save-error", "");
    const stem = run.photo.name.replace(/\.[^.]*$/, "") || "picture";
    for (const link of all("[data-file]", by("save"))) {
      link.href = ofJob(run.id, link.dataset.file);
      link.download = stem + link.dataset.end;
    }
    this.stem = stem;
    by("png-width").max = LARGEST_PNG;
    by("png-width").value = run.report.width;
    this.setPng();
    by("command").textContent = run.lines.command;
    by("python").textContent = run.lines.python;
  }

  setPng() {
    const field = by("png-width"), link = by("png");
    const isValid = field.validity.valid && field.value !== "";
    complain("png-error", isValid ? "" : `The width must be 1 to ${LARGEST_PNG} px; got ${field.value || "nothing"}.`);
    link.classList.toggle("off", !isValid);
    if (isValid) {
      link.href = ofJob(this.run.id, `picture.png?width=${field.value}&download=1`);
      link.download = `${this.stem}-${field.value}.png`;
    } else link.removeAttribute("href");
  }

  async copy(button) {
    complain("save-error", "");
    try {
      await this.write(button.dataset.copy);
      say(`${button.textContent} done`);
      const before = button.textContent;
      button.textContent = "Copied";
      setTimeout(() => { button.textContent = before; }, 1500);
    } catch (error) {
      complain("save-error", `It could not be copied (${error.message}). Try to save it as a file.`);
    }
  }

  write(what) {
    if (!navigator.clipboard) throw new Error("the browser opens its clipboard to this machine's own address and to https only");
    const { id, picture, lines } = this.run;
    if (what === "png") return navigator.clipboard.write([new ClipboardItem({ "image/png": getBlob(ofJob(id, "picture.png")) })]);
    if (what === "svg") return navigator.clipboard.writeText(picture.text);
    if (what === "data-uri") {
      // Within the click: a browser may refuse it after the answer has come.
      const text = getText(ofJob(id, "data-uri.txt")).then((found) => new Blob([found], { type: "text/plain" }));
      return navigator.clipboard.write([new ClipboardItem({ "text/plain": text })]);
    }
    return navigator.clipboard.writeText(lines[what]);
  }
}
