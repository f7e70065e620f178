// The main control: the kind of goal of a run, such as a number of shapes, and its value.

import { complain, make } from "./dom.js";
import { shortSize, whole } from "./numbers.js";

const TICKS = 100; // steps of the slider on a logarithmic scale
/** @typedef {{ toSlider: (value: number) => number, fromSlider: (at: number) => number, least: number, most: number, step: number }} Scale */
/** @typedef {{ scale: Scale, start: number, unit: string, toOption: (value: number) => number, per: number, step: number | "any",
 *   text: (value: number) => string }} Kind */

/** @param {number} least @param {number} most @returns {Scale} */
const log = (least, most) => ({
  toSlider: (value) => Math.round(TICKS * Math.log(value / least) / Math.log(most / least)),
  fromSlider: (at) => Number((least * (most / least) ** (at / TICKS)).toPrecision(2)),
  least: 0, most: TICKS, step: 1,
});
/** @param {number} least @param {number} most @param {number} step @returns {Scale} */
const linear = (least, most, step) => ({ toSlider: Number, fromSlider: Number, least, most, step });

// The scale of the slider spans usual values. The number field accepts every value of the option.
const KINDS = /** @type {Record<string, Kind>} */ ({
  gaussians: {
    scale: log(20, 30000), start: 3000, unit: "shapes", toOption: Math.round, per: 1, step: 1,
    text: (value) => `${whole(value)} shapes`,
  },
  max_bytes: {
    scale: log(1, 5000), start: 150, unit: "kB", toOption: (value) => Math.round(value * 1000), per: 1000, step: "any",
    text: (value) => `at most ${shortSize(value * 1000)}`,
  },
  target_psnr: {
    scale: linear(20, 46, 0.5), start: 34, unit: "dB", toOption: Number, per: 1, step: "any",
    text: (value) => `${value} dB`,
  },
  time_limit: {
    scale: log(0.5, 120), start: 5, unit: "s", toOption: Number, per: 1, step: "any",
    text: (value) => `in ${value} s`,
  },
});

// Text under the slider for each kind of goal.
const MEANING = /** @type {Record<string, string>} */ ({
  quality: "draft is the smallest and quickest, max the closest to the photo.",
  gaussians: "Number of shapes. More shapes are closer to the photo, and take more bytes and time.",
  max_bytes: "Maximum file size. The best picture that fits is written.",
  target_psnr: "Likeness to reach with as few shapes as possible. Of photos 30 dB is soft, 35 dB is good, at 40 dB it is hard to tell them apart.",
  time_limit: "Maximum time. The best picture reached by then is written.",
});

export class Goal {
  /** @param {Record<string, import("./api.js").Option>} options by their names @param {(kind: string) => void} kindChanged called with the name of the option that the control sets */
  constructor(options, kindChanged) {
    this.slider = by("amount", HTMLInputElement);
    this.number = by("exact", HTMLInputElement);
    this.preset = by("preset", HTMLSelectElement);
    this.kinds = all("[name=kind]", by("goal"), HTMLInputElement);
    this.values = Object.fromEntries(Object.entries(KINDS).map(([kind, one]) => [kind, one.start]));
    this.options = options;
    this.kindChanged = kindChanged;
    const quality = options.quality;
    this.presets = (quality.choices ?? []).map(String);
    this.preset.append(...this.presets.map((name) => make("option", { value: name }, name)));
    this.preset.value = this.usual = String(quality.default ?? "balanced");
    for (const radio of this.kinds) radio.addEventListener("input", () => this.showKind());
    this.slider.addEventListener("input", () => {
      if (this.kind === "quality") this.preset.value = this.presets[Number(this.slider.value)];
      else this.values[this.kind] = KINDS[this.kind].scale.fromSlider(Number(this.slider.value));
      this.showValue(this.slider);
    });
    this.preset.addEventListener("input", () => this.showValue());
    this.number.addEventListener("input", () => {
      if (!this.number.validity.valid || this.number.value === "") return;
      this.values[this.kind] = Number(this.number.value);
      this.showValue(this.number);
    });
    this.showKind();
  }

  get kind() {
    return this.kinds.find((one) => one.checked)?.value ?? "quality";
  }

  /**
   * Returns the option that the control sets, and its value.
   * @returns {import("./api.js").Options}
   */
  chosen() {
    if (this.kind === "quality") return { quality: this.preset.value };
    return { [this.kind]: KINDS[this.kind].toOption(this.values[this.kind]) };
  }

  /**
   * Sets the goal of a first choice, which is the usual quality if its options have none.
   * @param {import("./api.js").Options} values
   */
  assign(values) {
    const kind = Object.keys(KINDS).find((one) => one in values) ?? "quality";
    if (kind === "quality") this.preset.value = String(values.quality ?? this.usual);
    else this.values[kind] = Number(values[kind]) / KINDS[kind].per;
    for (const radio of this.kinds) radio.checked = radio.value === kind;
    this.showKind();
  }

  /** Returns the reason why the exact value is not valid, or "". */
  fault() {
    if (this.kind === "quality" || (this.number.validity.valid && this.number.value !== "")) return "";
    return this.number.validationMessage || "A number is missing.";
  }

  text() {
    return this.kind === "quality" ? this.preset.value : KINDS[this.kind].text(this.values[this.kind]);
  }

  showKind() {
    const isQuality = this.kind === "quality";
    this.kindChanged(this.kind);
    by("exact-field").hidden = isQuality;
    by("preset-field").hidden = !isQuality;
    by("kind-help").textContent = MEANING[this.kind];
    const kind = KINDS[this.kind];
    const scale = isQuality ? linear(0, this.presets.length - 1, 1) : kind.scale;
    this.slider.min = String(scale.least);
    this.slider.max = String(scale.most);
    this.slider.step = String(scale.step);
    if (!isQuality) {
      const option = this.options[this.kind];
      this.number.step = String(kind.step);
      this.number.min = String((option.min ?? 0) / kind.per);
      this.number.max = option.max === null ? "" : String(option.max / kind.per);
      by("unit").textContent = kind.unit;
    }
    this.showValue();
  }

  /** @param {HTMLInputElement | null} from the control that has the value already */
  showValue(from = null) {
    const value = this.values[this.kind];
    if (this.kind === "quality") this.slider.value = String(this.presets.indexOf(this.preset.value));
    else if (from !== this.slider) this.slider.value = String(KINDS[this.kind].scale.toSlider(value));
    if (this.kind !== "quality" && from !== this.number) this.number.value = String(value);
    this.slider.setAttribute("aria-valuetext", this.text());
    complain("goal-error", "");
  }
}
