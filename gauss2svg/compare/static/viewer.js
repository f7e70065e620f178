// The viewer of galleries and of the studio: two pictures beside a divider, zoomed and moved together.
// This is a classic script, because a page that is opened from a disk may not import modules.
"use strict";

const MOST_ZOOM = 16; // largest number of screen pixels across one pixel of the photo
const SHARP_MS = 160; // pause after the last step of the zoom, before pictures are drawn in their new size
const ZOOM_STEP = 1.5; // factor of the zoom for each press of a key or button
const PAN_PX = 60; // distance for each press of an arrow key
const MADE_LATER = /\/(errors\.png|outlines\.svg)$/; // files that the studio's server makes after the SVG
const ARROWS = new Map([["ArrowLeft", [1, 0]], ["ArrowRight", [-1, 0]], ["ArrowUp", [0, 1]], ["ArrowDown", [0, -1]]]);
const DIVIDER_STEPS = new Map([
  ["Home", -100], ["End", 100], ["PageUp", 10], ["PageDown", -10],
  ["ArrowLeft", -2], ["ArrowDown", -2], ["ArrowRight", 2], ["ArrowUp", 2],
]); // percent of the width

/** @typedef {"left" | "right"} Side */
/** @typedef {{ src: string, name: string, alt: string, badge: string, isErrors?: boolean }} Shown */
/** @typedef {HTMLElement & { value: number, handle: string }} Slider */

/**
 * Returns the element with an id. Throws TypeError if it is missing or of another kind.
 * @template {Element} [T=HTMLElement]
 * @param {string} id
 * @param {new () => T} [kind]
 * @returns {T}
 */
function by(id, kind) {
  const element = document.getElementById(id);
  if (!(element instanceof (kind ?? HTMLElement))) throw new TypeError(`#${id} must be a ${(kind ?? HTMLElement).name}; got ${element}.`);
  return /** @type {any} */ (element);
}

/**
 * Returns the elements that match a selector and are of a kind.
 * @template {Element} [T=HTMLElement]
 * @param {string} selector
 * @param {ParentNode} [root]
 * @param {new () => T} [kind]
 * @returns {T[]}
 */
function all(selector, root = document, kind) {
  return [...root.querySelectorAll(selector)].filter(
    /** @returns {element is T} */ (element) => element instanceof (kind ?? HTMLElement));
}

/** @param {number} value @param {number} least @param {number} most */
const clamped = (value, least, most) => Math.min(Math.max(value, least), most);

// An image that loads one source at a time. If several sources are to be shown while a large SVG loads,
// only the last of them is loaded next. It does not wait for a file that the server has yet to make.
class Layer {
  /** @param {HTMLImageElement} image @param {(source: string) => void} failed */
  constructor(image, failed) {
    this.image = image;
    this.wanted = /** @type {string | null} */ (null);
    this.isLoading = false;
    this.retried = new Set(); // sources that were loaded twice
    for (const kind of ["load", "error"]) image.addEventListener(kind, () => {
      this.load(null);
      if (this.wanted !== null && kind === "error" && image.getAttribute("src") === this.wanted) failed(this.wanted);
      this.show(this.wanted);
    });
  }

  /**
   * Loads a source that failed once more. Returns false if it is not shown now, or was retried before.
   * @param {string} source
   */
  retry(source) {
    if (this.wanted !== source || this.retried.has(source)) return false;
    this.retried.add(source);
    this.load(source);
    return true;
  }

  /** @param {string | null} source null if nothing is loading any more */
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
    } else if (this.image.getAttribute("src") !== source && (!this.isLoading || MADE_LATER.test(this.image.src))) {
      this.load(source);
    }
  }
}

class Viewer {
  /**
   * @param {(zoom: number | null, shown: number) => void} zoomed called with the zoom (null if the
   *   picture fits the stage), and with the screen pixels across one pixel of the photo
   * @param {(source: string) => void} [failed] called with a source that the browser cannot show
   */
  constructor(zoomed, failed = () => {}) {
    this.zoomed = zoomed;
    this.stage = by("stage");
    this.slider = /** @type {Slider} */ (by("slider"));
    this.size = { w: 1, h: 1 };
    this.zoom = /** @type {number | null} */ (null); // null if the picture fits the stage
    this.drawn = /** @type {number | null} */ (null); // zoom at which the pictures are drawn, before they are scaled
    this.sharpening = 0; // timer that ends when the pictures are to be drawn at the new zoom
    this.centre = { x: 0.5, y: 0.5 }; // centre of the visible part, as a fraction of the picture
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

  /** @param {number} width width of the pictures in px @param {number} height their height in px */
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

  /** @param {Side} side @param {Shown | null} picture null for no picture */
  show(side, picture) {
    const layer = this.layers[side], badge = by(`badge-${side}`);
    layer.show(picture === null ? null : picture.src);
    badge.hidden = picture === null || !picture.badge;
    if (side === "right") {
      by("legend").hidden = !picture?.isErrors;
      this.rounds.disabled = picture?.isErrors === true;
    }
    if (picture === null) return;
    layer.image.alt = picture.alt;
    layer.image.classList.toggle("pixels", picture.isErrors === true);
    badge.textContent = picture.badge;
    this.names[side] = picture.name;
    this.describeDivider();
  }

  /** @param {Side} side @param {string | null} source */
  outline(side, source) {
    this.strokes[side].show(source);
  }

  /**
   * Sets the texts of the rounds, and chooses the last round.
   * @param {string[]} texts
   */
  setRounds(texts) {
    this.roundTexts = texts;
    this.rounds.max = String(Math.max(texts.length, 1));
    this.rounds.value = this.rounds.max;
    by("rounds-field").hidden = texts.length < 2;
    this.describeRound();
  }

  /** Number of the chosen round, from 1. */
  get round() {
    return Number(this.rounds.value);
  }

  describeRound() {
    const text = this.roundTexts[this.round - 1] ?? "";
    by("round").textContent = text;
    this.rounds.setAttribute("aria-valuetext", text);
  }

  /**
   * Loads a source that failed once more. Returns false if no layer shows it, or if it was retried before.
   * @param {string} source
   */
  retry(source) {
    return [...Object.values(this.layers), ...Object.values(this.strokes)].map((layer) => layer.retry(source)).some(Boolean);
  }

  /**
   * Moves the divider, unless the user has moved it before.
   * @param {number} percent
   */
  divide(percent) {
    if (this.isTouched) return;
    this.slider.value = percent;
    this.describeDivider();
  }

  /** @param {number} percent */
  divideByHand(percent) {
    this.slider.value = clamped(percent, 0, 100);
    this.isTouched = true;
    this.describeDivider();
  }

  fit() {
    this.zoom = this.drawn = null;
    this.centre = { x: 0.5, y: 0.5 };
    this.layOut();
  }

  fitZoom() {
    return Math.min(this.stage.clientWidth / this.size.w, this.stage.clientHeight / this.size.h) || 1;
  }

  /** @param {number} zoom it may leave the picture smaller than the stage */
  zoomTo(zoom) {
    this.zoom = this.drawn = zoom;
    this.layOut();
  }

  /**
   * Zooms around a point of the stage. At the smallest zoom the picture fits the stage.
   * @param {number} factor
   * @param {[number, number]} point distance from the middle of the stage, in px
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
    this.zoomBy(ZOOM_STEP);
  }

  farther() {
    this.zoomBy(1 / ZOOM_STEP);
  }

  /** @param {number} dx distance in px @param {number} dy distance in px */
  move(dx, dy) {
    if (this.zoom === null) return;
    this.centre.x -= dx / (this.size.w * this.zoom);
    this.centre.y -= dy / (this.size.h * this.zoom);
    this.layOut();
  }

  // Sets CSS properties of the stage, from which the pictures and outlines of both sides get their places.
  layOut() {
    const { stage, size, zoom, centre } = this, isFit = zoom === null;
    stage.classList.toggle("zoomed", !isFit);
    this.slider.handle = String(!isFit); // if zoomed, only the handle moves the divider
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
    // The slider element animates the divider even if the user prefers reduced motion.
    const withoutMotion = new CSSStyleSheet();
    withoutMotion.replaceSync("@media (prefers-reduced-motion: reduce) { * { transition: none !important; } }");
    this.slider.shadowRoot?.adoptedStyleSheets.push(withoutMotion);
  }

  describeDivider() {
    const share = Math.round(this.slider.value), { left, right } = this.names;
    // A side that is hardly visible needs no badge.
    this.stage.classList.toggle("all-right", share < 12);
    this.stage.classList.toggle("all-left", share > 88);
    this.slider.setAttribute("aria-valuenow", String(share));
    this.slider.setAttribute("aria-valuetext", `${share} % ${left}, ${100 - share} % ${right}`);
  }

  listen() {
    const { stage, slider } = this;
    slider.addEventListener("slide", () => {
      this.isTouched = true;
      this.describeDivider();
    });
    slider.addEventListener("keydown", (event) => this.key(event), { capture: true });
    this.rounds.addEventListener("input", () => this.describeRound());
    // The slider element reacts to every mouse button, so that opening a menu would move it. It also
    // reacts to each of two fingers.
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
      // If the picture fits already, zooming out scrolls the page instead.
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
    else if (DIVIDER_STEPS.has(key)) this.divideByHand(this.slider.value + (DIVIDER_STEPS.get(key) ?? 0));
    else if (key === "+" || key === "=") this.closer();
    else if (key === "-") this.farther();
    else if (key === "0") this.fit();
    else if (key === "1") this.zoomTo(1);
    else return;
    event.preventDefault();
    event.stopImmediatePropagation(); // the slider's own listener would move the divider as well
  }

  // One pointer moves the zoomed picture. Two pointers zoom and move it.
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
