// The ways out: files, the clipboard, and the lines that make the same file.

import { getBlob, getText, ofJob } from "./api.js";
import { complain, say } from "./dom.js";

export class Exports {
  constructor(limits) {
    this.limits = limits;
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
    for (const link of all("[data-file]", by("save"))) link.href = ofJob(run.id, link.dataset.file);
    by("png-width").max = widest(run.report, this.limits.png_pixels);
    by("png-width").value = run.report.width;
    this.setPng();
    by("command").textContent = run.lines.command;
    by("python").textContent = run.lines.python;
  }

  setPng() {
    const field = by("png-width"), link = by("png");
    const isValid = field.validity.valid && field.value !== "";
    complain("png-error", isValid ? "" : `The width must be 1 to ${field.max} px; got ${field.value || "nothing"}.`);
    link.classList.toggle("off", !isValid);
    if (isValid) link.href = ofJob(this.run.id, `picture.png?width=${field.value}&download=1`);
    else link.removeAttribute("href");
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

// The largest width of a PNG of so many pixels, whose height follows.
function widest({ width, height }, most) {
  let wide = Math.ceil(Math.sqrt(most * width / height)) + 1;
  while (wide > 1 && wide * Math.max(1, Math.round(wide * height / width)) > most) wide -= 1;
  return wide;
}
