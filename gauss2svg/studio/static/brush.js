// The brush: a mask over each photo, painted where detail matters, as a tint.

import { make } from "./dom.js";

const LONGEST = 512; // px, longest side of a mask
const TINT = "#e0218a";

/** @import { Photo } from "./job.js" */

export class Brush {
  constructor() {
    this.stage = by("stage");
    this.isOn = by("paint", HTMLInputElement);
    this.erases = by("erase", HTMLInputElement);
    this.size = by("brush-size", HTMLInputElement);
    this.mask = /** @type {HTMLCanvasElement | null} */ (null);
    this.isOn.addEventListener("input", () => this.show());
    by("clear").addEventListener("click", () => {
      const { mask } = this;
      if (mask === null) return;
      mask.getContext("2d")?.clearRect(0, 0, mask.width, mask.height);
      mask.dataset.painted = "";
    });
  }

  /**
   * Puts the mask of a photo over it. A photo whose size is not known yet has none.
   * @param {Photo | null} photo
   */
  open(photo) {
    this.mask?.remove();
    this.mask = null;
    if (photo?.width && photo.height) {
      this.mask = photo.mask ??= this.newMask(photo.width, photo.height);
      this.stage.append(this.mask);
    }
    this.show();
  }

  show() {
    by("brush").hidden = this.mask === null;
    by("brush-tools").hidden = !this.isOn.checked;
    this.stage.classList.toggle("painting", this.isOn.checked);
  }

  /** @param {number} width px of the photo @param {number} height px of the photo */
  newMask(width, height) {
    const scale = LONGEST / Math.max(width, height);
    const [wide, high] = [width, height].map((side) => Math.max(1, Math.round(side * scale)));
    let last = /** @type {PointerEvent | null} */ (null);
    const mask = make("canvas", {
      class: "layer mask", width: wide, height: high, "aria-hidden": "true",
      pointerdown: (/** @type {PointerEvent} */ event) => {
        event.stopPropagation(); // the stage would move the picture
        mask.setPointerCapture(event.pointerId);
        this.paint(mask, event, event);
        last = event;
      },
      pointermove: (/** @type {PointerEvent} */ event) => {
        if (last === null) return;
        this.paint(mask, last, event);
        last = event;
      },
      lostpointercapture: () => { last = null; },
    });
    return mask;
  }

  /**
   * Paints or erases a line between the places of two events.
   * @param {HTMLCanvasElement} mask
   * @param {PointerEvent[]} ends
   */
  paint(mask, ...ends) {
    const pen = mask.getContext("2d"), box = mask.getBoundingClientRect();
    if (pen === null) return;
    const scale = Math.min(box.width / mask.width, box.height / mask.height);
    pen.globalCompositeOperation = this.erases.checked ? "destination-out" : "source-over";
    pen.strokeStyle = TINT;
    pen.lineWidth = Number(this.size.value) / 100 * LONGEST;
    pen.lineCap = "round";
    pen.beginPath();
    for (const { clientX, clientY } of ends) pen.lineTo(
      mask.width / 2 + (clientX - box.left - box.width / 2) / scale,
      mask.height / 2 + (clientY - box.top - box.height / 2) / scale,
    );
    pen.stroke();
    mask.dataset.painted = "yes";
  }
}

/**
 * Returns a PNG that is white where the photo is painted, or null if it is not.
 * @param {Photo} photo
 * @returns {Promise<Blob | null>}
 */
export async function whiteMask({ mask }) {
  if (!mask?.dataset.painted) return null;
  const white = make("canvas", { width: mask.width, height: mask.height }), pen = white.getContext("2d");
  if (pen === null) return null;
  pen.drawImage(mask, 0, 0);
  pen.globalCompositeOperation = "source-in";
  pen.fillStyle = "white";
  pen.fillRect(0, 0, mask.width, mask.height);
  return new Promise((done) => white.toBlob(done));
}
