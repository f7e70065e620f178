// The stage: two pictures under the divider, zoomed and moved in step.

import { all, by } from "./dom.js";

const MOST_ZOOM = 16; // pixels of the screen for one of the photo
const SHARP_MS = 160; // without a further step of the zoom; only then pictures are drawn anew
const STEP = 1.5; // of a key or button
const PAN_PX = 60;
const YET_TO_COME = /\/(errors\.png|outlines\.svg)$/;
const HINTS = {
  fit: "Drag the divider, or use the arrow keys. Zoom: + and \u2212, two fingers, or the wheel with Ctrl or after a click.",
  zoomed: "Drag the picture, or press Shift and the arrow keys, to move it. Drag the handle, or press the arrow keys, to move the divider. 0 fits, 1 shows pixels.",
};

// One source at a time: a large SVG takes a while to load, and of those that pass in that time
// only the last is needed. Files that the server has yet to make are not waited for.
class Layer {
  constructor(image, failed) {
    this.image = image;
    this.wanted = null;
    this.isLoading = false;
    this.failed = new Set(); // sources that were asked for twice
    for (const kind of ["load", "error"]) image.addEventListener(kind, () => {
      this.load(null);
      if (this.wanted !== null && kind === "error" && image.getAttribute("src") === this.wanted) failed(this.wanted);
      this.show(this.wanted);
    });
  }

  // Asks for a source that has failed once more; whether anybody still wants it, and had not before.
  again(source) {
    if (this.wanted !== source || this.failed.has(source)) return false;
    this.failed.add(source);
    this.load(source);
    return true;
  }

  // null: nothing more.
  load(source) {
    this.isLoading = source !== null;
    this.image.ariaBusy = this.isLoading;
    if (source !== null) this.image.src = source;
  }

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

export class Viewer {
  constructor(failed) {
    this.stage = by("stage");
    this.slider = by("slider");
    this.size = { w: 1, h: 1 };
    this.zoom = null; // null: fit
    this.drawn = null; // the zoom at which the pictures are drawn
    this.centre = { x: 0.5, y: 0.5 }; // of the visible part, as a fraction of the picture
    this.names = { left: "photo", right: "SVG" };
    this.isTouched = false; // whether the divider was moved by hand
    const layer = (id) => new Layer(by(id), failed);
    this.layers = { left: layer("photo"), right: layer("svg") };
    this.strokes = { left: layer("outlines-left"), right: layer("outlines-right") };
    this.describe();
    this.listen();
    new ResizeObserver(() => this.layOut()).observe(this.stage);
  }

  open(width, height) {
    if (this.size.w === width && this.size.h === height) return;
    this.size = { w: width, h: height };
    for (const image of all(".layer", this.stage)) {
      image.width = width;
      image.height = height;
    }
    const aspect = Math.min(Math.max(width / height, 0.4), 4);
    this.stage.style.setProperty("--stage", aspect.toFixed(5));
    this.fit();
  }

  // side: left or right; one: {src, name, alt, badge, pixels}, null where there is none.
  show(side, one) {
    const layer = this.layers[side], badge = by(`badge-${side}`);
    layer.show(one === null ? null : one.src);
    badge.hidden = one === null || !one.badge;
    if (one === null) return;
    layer.image.alt = one.alt;
    layer.image.classList.toggle("pixels", one.pixels === true);
    badge.textContent = one.badge;
    this.names[side] = one.name;
    this.tellDivider();
  }

  outline(side, source) {
    this.strokes[side].show(source);
  }

  // Loads a picture once more that has failed; false where that was done before.
  again(source) {
    return [...Object.values(this.layers), ...Object.values(this.strokes)].map((layer) => layer.again(source)).some(Boolean);
  }

  // Moves the divider unless someone has.
  divide(percent) {
    if (this.isTouched) return;
    this.slider.value = percent;
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

  // Around a place of the stage, in px from its middle.
  zoomTo(zoom, x = 0, y = 0) {
    const before = this.zoom ?? this.fitZoom(), most = Math.max(MOST_ZOOM, 4 * this.fitZoom());
    const now = Math.min(zoom, most);
    // The smallest zoom is the one that fits, unless single pixels fit more than once.
    if (now <= this.fitZoom() * 1.001 && !(now === 1 && this.fitZoom() > 1)) return this.fit();
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

  move(dx, dy) {
    if (this.zoom === null) return;
    this.centre.x -= dx / (this.size.w * this.zoom);
    this.centre.y -= dy / (this.size.h * this.zoom);
    this.layOut();
  }

  // Properties of the stage lay out both sides and the outlines.
  layOut() {
    const { stage, size, zoom } = this, isFit = zoom === null;
    stage.classList.toggle("zoomed", !isFit);
    this.slider.handle = String(!isFit); // elsewhere, dragging moves the picture
    by("hint").textContent = isFit ? HINTS.fit : HINTS.zoomed;
    by("zoom").textContent = `${Math.round((zoom ?? this.fitZoom()) * 100)} %`;
    by("fit").setAttribute("aria-pressed", isFit);
    by("actual").setAttribute("aria-pressed", zoom === 1);
    if (isFit) {
      for (const name of ["--left", "--top", "--wide", "--high", "--by"]) stage.style.removeProperty(name);
      return;
    }
    const drawn = this.drawn ?? this.fitZoom();
    stage.style.setProperty("--by", zoom / drawn);
    for (const [side, extent, place, length, seen] of [
      ["w", "--wide", "--left", stage.clientWidth, "x"], ["h", "--high", "--top", stage.clientHeight, "y"],
    ]) {
      const whole = size[side] * zoom, half = length / whole / 2;
      this.centre[seen] = half >= 0.5 ? 0.5 : Math.min(Math.max(this.centre[seen], half), 1 - half);
      stage.style.setProperty(extent, `${size[side] * drawn}px`);
      stage.style.setProperty(place, `${Math.round(length / 2 - this.centre[seen] * whole)}px`);
    }
  }

  describe() {
    for (const [name, value] of [["role", "slider"], ["aria-label", "Divider between the two pictures"],
      ["aria-valuemin", 0], ["aria-valuemax", 100], ["aria-orientation", "horizontal"], ["aria-describedby", "hint"]])
      this.slider.setAttribute(name, value);
    // The slider glides by itself, also for those who want no motion.
    const still = new CSSStyleSheet();
    still.replaceSync("@media (prefers-reduced-motion: reduce) { * { transition: none !important; } }");
    this.slider.shadowRoot.adoptedStyleSheets.push(still);
  }

  tellDivider() {
    const share = Math.round(this.slider.value);
    this.slider.setAttribute("aria-valuenow", share);
    // A side that is hardly seen needs no name.
    this.stage.classList.toggle("all-right", share < 12);
    this.stage.classList.toggle("all-left", share > 88);
    const { left, right } = this.names;
    this.slider.setAttribute("aria-valuetext", `${share} % ${left}, ${100 - share} % ${right}`);
  }

  listen() {
    const { stage, slider } = this;
    slider.addEventListener("slide", () => {
      this.isTouched = true;
      this.tellDivider();
    });
    slider.addEventListener("keydown", (event) => this.key(event), { capture: true });
    // The slider reacts to all mouse buttons, so that opening a menu would move it, and to each
    // of two fingers.
    slider.addEventListener("mousedown", (event) => {
      if (event.button !== 0) event.stopImmediatePropagation();
    }, { capture: true });
    for (const kind of ["touchstart", "touchmove"]) stage.addEventListener(kind, (event) => {
      if (event.touches.length < 2) return;
      event.preventDefault();
      event.stopPropagation();
    }, { capture: true, passive: false });
    stage.addEventListener("wheel", (event) => {
      const isMeant = event.ctrlKey || event.metaKey || this.zoom !== null || stage.contains(document.activeElement);
      // Where the picture fits already, turning back scrolls the page.
      if (!isMeant || (this.zoom === null && event.deltaY >= 0 && !event.ctrlKey)) return;
      event.preventDefault();
      const pixels = event.deltaY * (event.deltaMode === WheelEvent.DOM_DELTA_PIXEL ? 1 : 30);
      const step = Math.exp(-Math.min(Math.max(pixels, -150), 150) * (event.ctrlKey ? 0.006 : 0.002));
      this.zoomTo((this.zoom ?? this.fitZoom()) * step, ...this.fromMiddle(event));
    }, { passive: false });
    by("closer").addEventListener("click", () => this.zoomTo((this.zoom ?? this.fitZoom()) * STEP));
    by("farther").addEventListener("click", () => this.zoomTo((this.zoom ?? this.fitZoom()) / STEP));
    by("fit").addEventListener("click", () => this.fit());
    by("actual").addEventListener("click", () => this.zoomTo(1));
    this.followPointers();
  }

  fromMiddle({ clientX, clientY }) {
    const box = this.stage.getBoundingClientRect();
    return [clientX - box.left - box.width / 2, clientY - box.top - box.height / 2];
  }

  key(event) {
    const arrows = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    const steps = {
      Home: -100, End: 100, PageUp: 10, PageDown: -10,
      ArrowLeft: -2, ArrowDown: -2, ArrowRight: 2, ArrowUp: 2,
    };
    const now = this.zoom ?? this.fitZoom();
    const zooms = { "+": now * STEP, "=": now * STEP, "-": now / STEP, 0: 0, 1: 1 };
    if (event.altKey || event.ctrlKey || event.metaKey) return;
    if (event.shiftKey && event.key in arrows && this.zoom !== null) {
      this.move(...arrows[event.key].map((step) => step * PAN_PX));
    } else if (event.key in steps) {
      this.slider.value = Math.min(Math.max(this.slider.value + steps[event.key], 0), 100);
      this.isTouched = true;
      this.tellDivider();
    } else if (event.key in zooms) {
      this.zoomTo(zooms[event.key]);
    } else return;
    event.preventDefault();
    event.stopImmediatePropagation(); // the slider's own listener would move the divider as well
  }

  // One pointer moves the zoomed picture, two zoom and move it.
  followPointers() {
    const { stage } = this, down = new Map();
    const middle = () => {
      const points = [...down.values()];
      const mean = (axis) => points.reduce((sum, one) => sum + one[axis], 0) / points.length;
      const apart = points.length < 2 ? 0 : Math.hypot(points[0].clientX - points[1].clientX, points[0].clientY - points[1].clientY);
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
      if (down.size > 1) this.zoomTo((this.zoom ?? this.fitZoom()) * (now.apart / before.apart || 1), ...this.fromMiddle(now));
      if (down.size > 1 || stage.classList.contains("grabbed")) this.move(now.clientX - before.clientX, now.clientY - before.clientY);
    });
    for (const kind of ["pointerup", "pointercancel"]) window.addEventListener(kind, (event) => {
      down.delete(event.pointerId);
      if (down.size === 0) stage.classList.remove("grabbed");
    });
  }

  isOnHandle(event) {
    const box = this.slider.shadowRoot.getElementById("handle").getBoundingClientRect();
    return event.clientX >= box.left && event.clientX <= box.right
      && event.clientY >= box.top && event.clientY <= box.bottom;
  }
}
