// Intake of photos that are dropped, pasted, chosen, or picked from the samples.

import { make } from "./dom.js";

const NO_PHOTO = "That contains no photo. Try a JPEG, PNG or WebP file.";

/** @import { Photo } from "./job.js" */

/** @param {(photos: Photo[]) => void} take @param {(line: string) => void} complain */
export function listen(take, complain) {
  const files = by("files", HTMLInputElement);
  for (const id of ["choose", "add"]) by(id).addEventListener("click", () => files.click());
  files.addEventListener("change", () => {
    take([...files.files ?? []].map(ofFile));
    files.value = ""; // so that the same file can be chosen again
  });
  /** @param {DataTransfer | null} transfer */
  const takeFrom = (transfer) => {
    const photos = [...transfer?.files ?? []].map(ofFile);
    if (photos.length) take(photos);
    else complain(NO_PHOTO);
  };
  let depth = 0; // number of nested elements that a dragged file is over
  /** @param {number} change */
  const over = (change) => {
    depth = Math.max(depth + change, 0);
    document.body.classList.toggle("dropping", depth > 0);
  };
  /** @param {DragEvent} event */
  const hasFiles = (event) => event.dataTransfer?.types.includes("Files");
  window.addEventListener("dragenter", (event) => { if (hasFiles(event)) over(1); });
  window.addEventListener("dragleave", (event) => { if (hasFiles(event)) over(-1); });
  window.addEventListener("dragover", (event) => { if (hasFiles(event)) event.preventDefault(); });
  window.addEventListener("drop", (event) => {
    event.preventDefault(); // otherwise the browser would open the file instead of the page
    over(-Infinity);
    takeFrom(event.dataTransfer);
  });
  window.addEventListener("paste", (event) => {
    const isText = event.target instanceof Element && event.target.closest("input, textarea, select");
    if (event.clipboardData?.files.length || !isText) takeFrom(event.clipboardData);
  });
}

/** @param {File} file @returns {Photo} */
function ofFile(file) {
  return { file, name: file.name || "pasted.png", url: URL.createObjectURL(file) };
}

/** @param {import("./api.js").Sample[]} samples @param {(photos: Photo[]) => void} take */
export function showSamples(samples, take) {
  by("pick").hidden = samples.length === 0;
  by("samples").replaceChildren(...samples.map(({ name, url }) => {
    const picture = make("img", { src: url, alt: "", loading: "lazy", error: () => { picture.hidden = true; } });
    const button = make("button", { type: "button", class: "sample", click: () => take([{ name, url }]) }, picture, make("span", {}, name));
    return make("li", {}, button);
  }));
}
