// The stage: two pictures under the divider, zoomed and moved in step, of galleries and the studio.
// A classic script: a page that is opened from a disk may not import modules.
"use strict";

const MOST_ZOOM = 16; // pixels of the screen for one of the photo
const SHARP_MS = 160; // without a further step of the zoom; only then pictures are drawn anew
const STEP = 1.5; // of a key or button
const PAN_PX = 60;
const YET_TO_COME = /\/(errors\.png|outlines\.svg)$/;
const ARROWS = new Map([["ArrowLeft", [1, 0]], ["ArrowRight", [-1, 0]], ["ArrowUp", [0, 1]], ["ArrowDown", [0, -1]]]);
const STEPS = new Map([
  ["Home", -100], ["End", 100], ["PageUp", 10], ["PageDown", -10],
  ["ArrowLeft", -2], ["ArrowDown", -2], ["ArrowRight", 2], ["ArrowUp", 2],
]); // percent

/** @typedef {"left" | "right"} Side */
/** @typedef {{ src: string, name: string, alt: string, badge: string, isErrors?: boolean }} Shown */
/** @typedef {HTMLElement & { value: number, handle: string }} Slider */

/**
 * The element of an id; throws where it is not of its kind.
 * @template {Element} [T=HTMLElement]
 * @param {string} id
 * @param {new () => T} [kind]
 * @returns {T}
 */
function by(id, kind) {
  const found = document.getElementById(id);
  if (!(found instanceof (kind ?? HTMLElement))) throw new TypeError(`#${id} must be a ${(kind ?? HTMLElement).name}; got ${found}.`);
  return /** @type {any} */ (found);
}

/**
 * The elements that a selector finds, all of one kind.
 * @template {Element} [T=HTMLElement]
 * @param {string} selector
 * @param {ParentNode} [root]
 * @param {new () => T} [kind]
 * @returns {T[]}
 */
function all(selector, root = document, kind) {
  return [...root.querySelectorAll(selector)].filter(
    /** @returns {one is T} */ (one) => one instanceof (kind ?? HTMLElement));
}

/** @param {number} value @param {number} least @param {number} most */
const clamped = (value, least, most) => Math.min(Math.max(value, least), most);

// One source at a time: a large SVG takes a while to load, and of those that pass in that time
// only the last is needed. Files that a server has yet to make are not waited for.
class Layer {
  /** @param {HTMLImageElement} image @param {(source: string) => void} failed */
  constructor(image, failed) {
    this.image = image;
    this.wanted = /** @type {string | null} */ (null);
    this.isLoading = false;
    this.failed = new Set(); // sources that were asked for twice
    for (const kind of ["load", "error"]) image.addEventListener(kind, () => {
      this.load(null);
      if (this.wanted !== null && kind === "error" && image.getAttribute("src") === this.wanted) failed(this.wanted);
      this.show(this.wanted);
    });
  }

  /**
   * Asks for a source that has failed once more; whether anybody still wants it, and had not before.
   * @param {string} source
   */
  again(source) {
    if (this.wanted !== source || this.failed.has(source)) return false;
    this.failed.add(source);
    this.load(source);
    return true;
  }

  /** @param {string | null} source null: nothing more */
  load(source) {
    this.isLoading = source !== null;
    this.image.ariaBusy = String(this.isLoading);
    if (source !== null) this.image.src = source;
  }

  /** @param {string | null} source */
  show(source) {
    this.wanted = source;
    this.image.hidden = source === null;
    if (source === null) {
      this.image.removeAttribute("src");
      this.load(null);
    } else if (this.image.getAttribute("src") !== source && (!this.isLoading || YET_TO_COME.test(this.image.src))) {
      this.load(source);
    }
  }
}

class Viewer {
  /**
   * @param {(zoom: number | null, shown: number) => void} zoomed called with the zoom, null where
   *   the picture fits, and with the pixels of the screen for one of the photo
   * @param {(source: string) => void} [failed] called with a source that the browser cannot show
   */
  constructor(zoomed, failed = () => {}) {
    this.zoomed = zoomed;
    this.stage = by("stage");
    this.slider = /** @type {Slider} */ (by("slider"));
    this.size = { w: 1, h: 1 };
    this.zoom = /** @type {number | null} */ (null); // null: fit
    this.drawn = /** @type {number | null} */ (null); // the zoom at which the pictures are drawn
    this.sharpening = 0;
    this.centre = { x: 0.5, y: 0.5 }; // of the visible part, as a fraction of the picture
    this.names = { left: "photo", right: "SVG" };
    this.isTouched = false; // whether the divider was moved by hand
    this.rounds = by("rounds", HTMLInputElement);
    this.roundTexts = /** @type {string[]} */ ([]);
    const hint = by("hint");
    this.hints = { fit: hint.textContent, zoomed: hint.dataset.zoomed ?? "" };
    const layer = (/** @type {string} */ id) => new Layer(by(id, HTMLImageElement), failed);
    this.layers = { left: layer("photo"), right: layer("svg") };
    this.strokes = { left: layer("outlines-left"), right: layer("outlines-right") };
    for (const ramp of all(".ramp")) ramp.style.background = `linear-gradient(to right,${ramp.dataset.colors})`;
    this.describe();
    this.listen();
    new ResizeObserver(() => this.layOut()).observe(this.stage);
  }

  /** @param {number} width @param {number} height of the pictures, in px */
  open(width, height) {
    if (this.size.w === width && this.size.h === height) return;
    this.size = { w: width, h: height };
    for (const image of all(".layer", this.stage, HTMLImageElement)) {
      image.width = width;
      image.height = height;
    }
    this.stage.style.setProperty("--stage", clamped(width / height, 0.4, 4).toFixed(5));
    this.fit();
  }

  /** @param {Side} side @param {Shown | null} one null where there is none */
  show(side, one) {
    const layer = this.layers[side], badge = by(`badge-${side}`);
    layer.show(one === null ? null : one.src);
    badge.hidden = one === null || !one.badge;
    if (side === "right") {
      by("legend").hidden = !one?.isErrors;
      this.rounds.disabled = one?.isErrors === true;
    }
    if (one === null) return;
    layer.image.alt = one.alt;
    layer.image.classList.toggle("pixels", one.isErrors === true);
    badge.textContent = one.badge;
    this.names[side] = one.name;
    this.tellDivider();
  }

  /** @param {Side} side @param {string | null} source */
  outline(side, source) {
    this.strokes[side].show(source);
  }

  /**
   * What each round is called; the last is chosen.
   * @param {string[]} texts
   */
  setRounds(texts) {
    this.roundTexts = texts;
    this.rounds.max = String(Math.max(texts.length, 1));
    this.rounds.value = this.rounds.max;
    by("rounds-field").hidden = texts.length < 2;
    this.tellRound();
  }

  /** The chosen round, from 1. */
  get round() {
    return Number(this.rounds.value);
  }

  tellRound() {
    const text = this.roundTexts[this.round - 1] ?? "";
    by("round").textContent = text;
    this.rounds.setAttribute("aria-valuetext", text);
  }

  /**
   * Loads a picture once more that has failed; false where that was done before.
   * @param {string} source
   */
  again(source) {
    return [...Object.values(this.layers), ...Object.values(this.strokes)].map((layer) => layer.again(source)).some(Boolean);
  }

  /**
   * Moves the divider unless someone has.
   * @param {number} percent
   */
  divide(percent) {
    if (this.isTouched) return;
    this.slider.value = percent;
    this.tellDivider();
  }

  /** @param {number} percent */
  divideByHand(percent) {
    this.slider.value = clamped(percent, 0, 100);
    this.isTouched = true;
    this.tellDivider();
  }

  fit() {
    this.zoom = this.drawn = null;
    this.centre = { x: 0.5, y: 0.5 };
    this.layOut();
  }

  fitZoom() {
    return Math.min(this.stage.clientWidth / this.size.w, this.stage.clientHeight / this.size.h) || 1;
  }

  /** @param {number} zoom also one that is smaller than the stage */
  zoomTo(zoom) {
    this.zoom = this.drawn = zoom;
    this.layOut();
  }

  /**
   * Zooms around a place of the stage; the smallest zoom is the one that fits.
   * @param {number} factor
   * @param {[number, number]} place in px from the middle
   */
  zoomBy(factor, [x, y] = [0, 0]) {
    const fit = this.fitZoom(), before = this.zoom ?? fit;
    const now = Math.min(before * factor, Math.max(MOST_ZOOM, 4 * fit));
    if (now <= fit * 1.001) return this.fit();
    this.centre.x += (x / before - x / now) / this.size.w;
    this.centre.y += (y / before - y / now) / this.size.h;
    this.zoom = now;
    this.layOut();
    clearTimeout(this.sharpening);
    this.sharpening = setTimeout(() => {
      this.drawn = this.zoom;
      this.layOut();
    }, SHARP_MS);
  }

  closer() {
    this.zoomBy(STEP);
  }

  farther() {
    this.zoomBy(1 / STEP);
  }

  /** @param {number} dx @param {number} dy in px */
  move(dx, dy) {
    if (this.zoom === null) return;
    this.centre.x -= dx / (this.size.w * this.zoom);
    this.centre.y -= dy / (this.size.h * this.zoom);
    this.layOut();
  }

  // Properties of the stage lay out both sides and the outlines.
  layOut() {
    const { stage, size, zoom, centre } = this, isFit = zoom === null;
    stage.classList.toggle("zoomed", !isFit);
    this.slider.handle = String(!isFit); // elsewhere, dragging moves the picture
    by("hint").textContent = isFit ? this.hints.fit : this.hints.zoomed;
    this.zoomed(zoom, zoom ?? this.fitZoom());
    if (isFit) {
      for (const name of ["--left", "--top", "--wide", "--high", "--by"]) stage.style.removeProperty(name);
      return;
    }
    const drawn = this.drawn ?? this.fitZoom();
    /** @param {number} whole @param {number} length @param {number} at */
    const inside = (whole, length, at) => (whole <= length ? 0.5 : clamped(at, length / whole / 2, 1 - length / whole / 2));
    const [wide, high] = [size.w * zoom, size.h * zoom];
    centre.x = inside(wide, stage.clientWidth, centre.x);
    centre.y = inside(high, stage.clientHeight, centre.y);
    for (const [name, value] of [
      ["--by", String(zoom / drawn)], ["--wide", `${size.w * drawn}px`], ["--high", `${size.h * drawn}px`],
      ["--left", `${Math.round(stage.clientWidth / 2 - centre.x * wide)}px`],
      ["--top", `${Math.round(stage.clientHeight / 2 - centre.y * high)}px`],
    ]) stage.style.setProperty(name, value);
  }

  describe() {
    for (const [name, value] of [["role", "slider"], ["aria-label", "Divider between the two pictures"],
      ["aria-valuemin", "0"], ["aria-valuemax", "100"], ["aria-orientation", "horizontal"], ["aria-describedby", "hint"]])
      this.slider.setAttribute(name, value);
    // The slider glides by itself, also for those who want no motion.
    const still = new CSSStyleSheet();
    still.replaceSync("@media (prefers-reduced-motion: reduce) { * { transition: none !important; } }");
    this.slider.shadowRoot?.adoptedStyleSheets.push(still);
  }

  tellDivider() {
    const share = Math.round(this.slider.value), { left, right } = this.names;
    // A side that is hardly seen needs no name.
    this.stage.classList.toggle("all-right", share < 12);
    this.stage.classList.toggle("all-left", share > 88);
    this.slider.setAttribute("aria-valuenow", String(share));
    this.slider.setAttribute("aria-valuetext", `${share} % ${left}, ${100 - share} % ${right}`);
  }

  listen() {
    const { stage, slider } = this;
    slider.addEventListener("slide", () => {
      this.isTouched = true;
      this.tellDivider();
    });
    slider.addEventListener("keydown", (event) => this.key(event), { capture: true });
    this.rounds.addEventListener("input", () => this.tellRound());
    // The slider reacts to all mouse buttons, so that opening a menu would move it, and to each
    // of two fingers.
    slider.addEventListener("mousedown", (event) => {
      if (event.button !== 0) event.stopImmediatePropagation();
    }, { capture: true });
    /** @param {TouchEvent} event */
    const keepTwoFingers = (event) => {
      if (event.touches.length < 2) return;
      event.preventDefault();
      event.stopPropagation();
    };
    stage.addEventListener("touchstart", keepTwoFingers, { capture: true, passive: false });
    stage.addEventListener("touchmove", keepTwoFingers, { capture: true, passive: false });
    stage.addEventListener("wheel", (event) => {
      const isMeant = event.ctrlKey || event.metaKey || this.zoom !== null || stage.contains(document.activeElement);
      // Where the picture fits already, turning back scrolls the page.
      if (!isMeant || (this.zoom === null && event.deltaY >= 0 && !event.ctrlKey)) return;
      event.preventDefault();
      const pixels = event.deltaY * (event.deltaMode === WheelEvent.DOM_DELTA_PIXEL ? 1 : 30);
      this.zoomBy(Math.exp(-clamped(pixels, -150, 150) * (event.ctrlKey ? 0.006 : 0.002)), this.fromMiddle(event));
    }, { passive: false });
    this.followPointers();
  }

  /**
   * @param {{ clientX: number, clientY: number }} place
   * @returns {[number, number]}
   */
  fromMiddle({ clientX, clientY }) {
    const box = this.stage.getBoundingClientRect();
    return [clientX - box.left - box.width / 2, clientY - box.top - box.height / 2];
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    const { key } = event, [x, y] = ARROWS.get(key) ?? [0, 0];
    if (event.altKey || event.ctrlKey || event.metaKey) return;
    if (event.shiftKey && ARROWS.has(key) && this.zoom !== null) this.move(x * PAN_PX, y * PAN_PX);
    else if (STEPS.has(key)) this.divideByHand(this.slider.value + (STEPS.get(key) ?? 0));
    else if (key === "+" || key === "=") this.closer();
    else if (key === "-") this.farther();
    else if (key === "0") this.fit();
    else if (key === "1") this.zoomTo(1);
    else return;
    event.preventDefault();
    event.stopImmediatePropagation(); // the slider's own listener would move the divider as well
  }

  // One pointer moves the zoomed picture, two zoom and move it.
  followPointers() {
    const { stage } = this, down = /** @type {Map<number, PointerEvent>} */ (new Map());
    const middle = () => {
      const points = [...down.values()], [one, other] = points;
      /** @param {"clientX" | "clientY"} axis */
      const mean = (axis) => points.reduce((sum, each) => sum + each[axis], 0) / points.length;
      const apart = other ? Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY) : 0;
      return { clientX: mean("clientX"), clientY: mean("clientY"), apart };
    };
    stage.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || (this.zoom !== null && event.isPrimary && this.isOnHandle(event))) return;
      down.set(event.pointerId, event);
      if (this.zoom === null && down.size < 2) return; // the divider follows it
      for (const id of down.keys()) stage.setPointerCapture(id);
      stage.classList.add("grabbed");
    });
    stage.addEventListener("pointermove", (event) => {
      if (!down.has(event.pointerId)) return;
      const before = middle();
      down.set(event.pointerId, event);
      const now = middle();
      if (down.size > 1) this.zoomBy(now.apart / before.apart || 1, this.fromMiddle(now));
      if (down.size > 1 || stage.classList.contains("grabbed")) this.move(now.clientX - before.clientX, now.clientY - before.clientY);
    });
    /** @param {PointerEvent} event */
    const release = (event) => {
      down.delete(event.pointerId);
      if (down.size === 0) stage.classList.remove("grabbed");
    };
    window.addEventListener("pointerup", release);
    window.addEventListener("pointercancel", release);
  }

  /** @param {PointerEvent} event */
  isOnHandle({ clientX, clientY }) {
    const box = this.slider.shadowRoot?.getElementById("handle")?.getBoundingClientRect();
    return box !== undefined && clientX >= box.left && clientX <= box.right && clientY >= box.top && clientY <= box.bottom;
  }
}
