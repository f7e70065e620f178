// The state of the page, and the updates of the page when it changes.

import { ApiError, getBlob, getJob, getOptions, getSamples, ofJob, zipOf } from "./api.js";
import { Brush, whiteMask } from "./brush.js";
import { complain, say } from "./dom.js";
import { Exports } from "./exports.js";
import { Goal } from "./goal.js";
import { listen, showSamples } from "./intake.js";
import { hasPicture, isActive, isDone, RunQueue } from "./job.js";
import { More } from "./more.js";
import { decibels, drawn, seconds, whole } from "./numbers.js";
import { figuresOf, meaningOf, showInks, showProgress, sizes, Strip } from "./progress.js";
import { Picture } from "./rounds.js";
import { named, Trade } from "./trade.js";

const OF_JOB = /^api\/jobs\/([^/]+)\/((?!frame).*)/; // frames are left out, because the next one replaces a lost one
const FORGOTTEN = "The server has forgotten this run, because it keeps only its newest ones. Try to run it again.";

/** @import { Form, Options } from "./api.js" */
/** @import { DoneRun, Photo, Run } from "./job.js" */

class Studio {
  /** @param {Form} form */
  constructor({ groups, scores, limits, uses }) {
    this.photos = /** @type {Photo[]} */ ([]);
    this.runs = /** @type {Run[]} */ ([]);
    this.photo = /** @type {Photo | null} */ (null);
    this.shown = /** @type {Run | null} */ (null);
    this.beside = /** @type {DoneRun | null} */ (null);
    this.left = by("left", HTMLSelectElement);
    const options = Object.fromEntries(groups.flatMap((group) => group.options).map((one) => [one.name, one]));
    this.uses = uses;
    this.use = by("uses", HTMLFormElement);
    this.more = new More(groups);
    this.goal = new Goal(options, (kind) => {
      this.more.leaveOut(kind);
      this.showNotes(kind);
    });
    this.viewer = new Viewer((zoom, shown) => tellZoom(zoom, shown), (source) => this.missing(source));
    this.brush = new Brush();
    this.trade = new Trade(scores, (run) => this.show(run), (run) => this.compare(run));
    this.exports = new Exports(limits);
    this.strip = new Strip((photo) => this.open(photo));
    this.queue = new RunQueue(Number(document.body.dataset.workers), (run) => this.changed(run));
    this.addListeners();
    this.tellUse();
  }

  addListeners() {
    listen((photos) => this.take(photos), (line) => complain("photo-error", line));
    by("goal").addEventListener("submit", (event) => {
      event.preventDefault();
      complain("photo-error", this.photo ? "" : "Choose a photo first.");
      if (this.photo) this.run([this.photo]);
      else by("choose").focus();
    });
    by("run-all").addEventListener("click", () => this.run(this.photos));
    this.use.addEventListener("input", () => {
      this.goal.assign(this.chosenUse());
      this.tellUse();
      say(by("use-set").textContent);
    });
    this.use.addEventListener("submit", (event) => event.preventDefault());
    by("stop").addEventListener("click", () => this.stop());
    by("cancel").addEventListener("click", () => this.cancel());
    this.look = by("look", HTMLFormElement);
    this.look.addEventListener("input", () => this.showStage());
    this.look.addEventListener("submit", (event) => event.preventDefault());
    by("rounds").addEventListener("input", () => this.showStage());
    this.left.addEventListener("input", () => {
      this.beside = this.runs.filter(hasPicture).find((run) => String(run.number) === this.left.value) ?? null;
      this.showAll();
    });
    for (const [id, act] of Object.entries({
      closer: () => this.viewer.closer(), farther: () => this.viewer.farther(),
      fit: () => this.viewer.fit(), actual: () => this.viewer.zoomTo(1),
    })) by(id).addEventListener("click", act);
  }

  // Returns the options that the first choice sets.
  chosenUse() {
    return this.uses[String(new FormData(this.use).get("use"))];
  }

  // Sets the options of the first choice that are no goal, and says what it has set.
  tellUse() {
    const { kind } = this.goal, { [kind]: _, ...others } = this.chosenUse();
    this.more.assign(others, Object.values(this.uses).flatMap(Object.keys));
    this.showNotes(kind);
    const set = Object.entries(others).map(([name, value]) => `${name} ${value}`);
    const aim = kind === "quality" ? `quality ${this.goal.text()}` : this.goal.text();
    by("use-set").textContent = `Set: ${[aim, ...set].join(", ")}. Change what you like.`;
  }

  // ---- photos and runs come in
  /** @param {Photo[]} photos */
  take(photos) {
    complain("photo-error", "");
    photos.forEach((photo) => { photo.series = this.photos.push(photo) - 1; });
    this.open(photos[0]);
    this.run(photos);
    by("title").focus({ preventScroll: true });
  }

  /** @param {Photo[]} photos */
  run(photos) {
    complain("goal-error", "");
    const asked = this.chosenOptions();
    if (asked === null) return;
    for (const photo of photos) {
      const number = Math.max(0, ...this.runs.map((run) => run.number)) + 1;
      const focus = photo.mask?.dataset.painted ? ", focus" : "";
      const run = /** @type {Run} */ ({ number, photo, asked, aim: this.aim() + focus, mask: whiteMask(photo), state: "waiting", progress: null });
      this.runs.push(run);
      if (photo === this.photo) this.setShown(run);
      this.queue.add(run);
    }
    this.showAll();
    bringStage();
    say(photos.length > 1 ? `${photos.length} runs started` : "Run started");
  }

  /**
   * Returns the options of the form, or null if a field is not valid.
   * @returns {Options | null}
   */
  chosenOptions() {
    const fault = this.goal.fault();
    if (fault) {
      complain("goal-error", fault);
      this.goal.number.focus();
      return null;
    }
    return this.more.check() ? { ...this.more.chosen(this.goal.kind), ...this.goal.chosen() } : null;
  }

  aim() {
    const { count_gzipped: gzipped, ...others } = this.more.chosen(this.goal.kind), many = Object.keys(others).length;
    return this.goal.text() + (gzipped ? " gzipped" : "") + (many ? `, ${many} more option${many > 1 ? "s" : ""}` : "");
  }

  /** @param {Run} run */
  async changed(run) {
    if (!run.isEnded && !isActive(run)) {
      run.isEnded = true;
      await this.ended(run);
    } else if (run.state === "running" && !run.photo.width && run.width && run.height) this.measure(run.photo, run.width, run.height);
    const isOfShown = run === this.active();
    if (isActive(run) && isOfShown) this.showStage();
    this.strip.update(this.photos, this.photo, (photo) => this.newest(photo));
    showProgress(this.active());
  }

  /** @param {Run} run */
  async ended(run) {
    if (isDone(run)) {
      try {
        run.picture = await Picture.of(run.id);
        this.measure(run.photo, run.report.width, run.report.height);
      } catch (error) {
        if (!(error instanceof ApiError)) throw error;
        Object.assign(run, { state: "failed", error: error.message });
      }
    }
    if (isDone(run) && run.photo.cannotBeSeen) this.reportErrors(this.fetchPhoto(run));
    if (!isDone(run)) this.drop(run);
    if (this.shown === run) this.viewer.setRounds(roundsOf(run));
    if (isDone(run)) say(`${named(run)} is done: ${figuresOf(run)}`);
    this.showAll();
  }

  /**
   * Removes a run without a result, and shows its error beside the control that caused it.
   * @param {Run} run
   */
  drop(run) {
    const isAlone = !this.runs.some((one) => one !== run && one.photo === run.photo);
    this.runs = this.runs.filter((one) => one !== run);
    if (this.shown === run) this.setShown(this.newest(run.photo) ?? null);
    if (run.state === "canceled") {
      say("Run canceled");
      return;
    }
    const error = run.error ?? "", line = error.includes(run.photo.name) ? error : `${run.photo.name}: ${error}`;
    if (run.id === undefined && this.more.blame(error)) return;
    // A photo that the server refuses is not kept.
    if (run.id === undefined && isAlone && [422].includes(run.status ?? 0)) {
      this.photos = this.photos.filter((one) => one !== run.photo);
      URL.revokeObjectURL(run.photo.url);
      if (this.photo === run.photo) this.open(this.photos.at(-1) ?? null);
    }
    complain("photo-error", line);
  }

  /**
   * Replaces a photo that the browser cannot show by the PNG that the server made of it.
   * @param {Run & { id: string }} run
   */
  async fetchPhoto(run) {
    run.photo.url = URL.createObjectURL(await getBlob(ofJob(run.id, "photo.png")));
    run.photo.cannotBeSeen = false;
    this.showStage();
  }

  /** @param {Photo} photo */
  newest(photo) {
    return this.runs.findLast((run) => run.photo === photo);
  }

  // Returns the active run of the photo that is shown, or null.
  active() {
    if (this.shown && isActive(this.shown)) return this.shown;
    return this.runs.find((run) => run.photo === this.photo && isActive(run)) ?? null;
  }

  async stop() {
    const run = this.active();
    if (run === null) return;
    run.isStopping = true;
    showProgress(run);
    await this.reportErrors(this.queue.stop(run));
  }

  async cancel() {
    const run = this.active();
    if (run) await this.reportErrors(this.queue.cancel(run));
  }

  /** @param {Promise<void>} request */
  async reportErrors(request) {
    try {
      await request;
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      complain("photo-error", error.message);
    }
  }

  // ---- what is shown
  /** @param {Photo | null} photo */
  open(photo) {
    this.photo = photo;
    this.brush.open(photo);
    by("empty").hidden = photo !== null;
    by("viewer").hidden = by("add").hidden = photo === null;
    document.body.classList.toggle("has-photo", photo !== null);
    by("pick", HTMLDetailsElement).open = photo === null;
    if (photo === null) {
      this.setShown(null);
      this.showAll();
      return;
    }
    this.setShown(this.newest(photo) ?? null);
    if (photo.width && photo.height) this.viewer.open(photo.width, photo.height);
    else {
      const picture = new Image();
      picture.addEventListener("load", () => this.measure(photo, picture.naturalWidth, picture.naturalHeight));
      picture.addEventListener("error", () => {
        photo.cannotBeSeen = true;
        this.showStage();
      });
      picture.src = photo.url;
    }
    this.showAll();
  }

  /** @param {Photo} photo @param {number} width @param {number} height */
  measure(photo, width, height) {
    Object.assign(photo, { width, height });
    if (photo !== this.photo) return;
    this.viewer.open(width, height);
    this.brush.open(photo);
    this.showHeading();
    if (this.active()) bringStage();
  }

  /** @param {Run | null} run */
  setShown(run) {
    this.shown = run;
    this.beside = null;
    this.viewer.setRounds(roundsOf(run));
  }

  /** @param {DoneRun} run */
  show(run) {
    const isOther = run.photo !== this.photo;
    if (isOther) this.open(run.photo);
    if (this.shown !== run) this.setShown(run);
    this.showAll();
    bringStage(); // the click may come from the table far below
    say(`${named(run)}: ${figuresOf(run)}`);
  }

  /** @param {DoneRun} run */
  compare(run) {
    if (run.photo !== this.shown?.photo || run === this.shown || !hasPicture(this.shown)) {
      this.show(run);
      return;
    }
    this.beside = this.beside === run ? null : run;
    this.showAll();
    bringStage();
    if (this.beside) say(`${named(run)} is left of the divider, ${named(this.shown)} right of it`);
  }

  showAll() {
    this.showHeading();
    this.showStage();
    showProgress(this.active());
    this.strip.update(this.photos, this.photo, (photo) => this.newest(photo));
    const finished = this.runs.filter(hasPicture);
    this.trade.update(finished, this.shown, this.beside);
    const done = hasPicture(this.shown) ? this.shown : null;
    this.exports.show(done);
    by("figures").textContent = done ? figuresOf(done) : "";
    by("meaning").textContent = done ? meaningOf(done.report) : "";
    showInks(done?.report);
    this.showNotes(this.goal.kind);
    const last = finished.findLast((run) => run.photo === this.photo);
    by("last-run").textContent = last ? `The last run of this photo, ${last.aim}, took ${costOf(last)}` : "";
    by("run-all").hidden = this.photos.length < 2;
    by("run-all").textContent = `Run all ${this.photos.length}`;
    const latest = this.photos.flatMap((photo) => finished.filter((run) => run.photo === photo).slice(-1));
    by("zip").hidden = latest.length < 2;
    by("zip", HTMLAnchorElement).href = zipOf(latest.map((run) => run.id));
  }

  /**
   * Shows notes on the run beside the controls that they name, and the others below the picture.
   * @param {string} kind name of the option that the main control sets
   */
  showNotes(kind) {
    const report = hasPicture(this.shown) ? this.shown.report : null;
    const others = this.more.arrange(report ? [...report.unreached, ...report.notes] : [], Object.keys(this.chosenUse()), kind);
    by("notes").textContent = others.join("; ");
  }

  showHeading() {
    const { photo } = this;
    by("title").textContent = photo ? photo.name : "A photo becomes an SVG";
    by("facts").textContent = photo?.width ? `${whole(photo.width)} \u00d7 ${whole(photo.height)} px` : "";
  }

  showStage() {
    const { photo, shown, beside, viewer } = this;
    if (photo === null) return;
    const done = hasPicture(shown) ? shown : null, outlined = all("[name=outlined]", this.look, HTMLInputElement)[0];
    const sides = all("[name=side]", this.look, HTMLInputElement), parts = all("[data-part]", this.look, HTMLInputElement);
    for (const one of parts) one.labels?.[0].toggleAttribute("hidden", !done?.report[one.dataset.part ?? ""]);
    const hidden = parts.filter((one) => !one.checked).map((one) => one.name);
    this.listSides(done);
    if (beside) viewer.show("left", pictureSide(beside, beside.picture.whole));
    else viewer.show("left", photo.cannotBeSeen ? null : { src: photo.url, name: "photo", alt: `The photo ${photo.name}`, badge: "Photo" });
    for (const control of [outlined, ...sides]) control.disabled = !done;
    const isErrors = sides.some((one) => one.checked && one.value === "errors");
    if (done && isErrors) viewer.show("right", { src: ofJob(done.id, "errors.png"), name: "error map", alt: `Error map of ${named(done)}`, badge: `Errors, run ${done.number}`, isErrors });
    else if (done) viewer.show("right", pictureSide(done, done.picture.part(viewer.round, hidden), !beside));
    else viewer.show("right", frameSide(shown));
    // The page shows the photo until there are shapes, then the shapes alone, and half of each in the end.
    viewer.divide(done ? 50 : frameSide(shown) ? 0 : 100);
    const strokesOf = (/** @type {DoneRun | null} */ run) => (run && outlined.checked ? ofJob(run.id, "outlines.svg") : null);
    viewer.outline("right", strokesOf(done));
    viewer.outline("left", strokesOf(done && (beside ?? done)));
  }

  /**
   * Lists the choices for the left side: the photo, and its other finished runs.
   * @param {DoneRun | null} done
   */
  listSides(done) {
    const others = this.runs.filter(hasPicture).filter((run) => run.photo === this.photo && run !== done);
    by("left-field").hidden = !done || others.length === 0;
    const listed = ["", ...others.map((run) => String(run.number))].join();
    if (this.left.dataset.listed !== listed) {
      this.left.dataset.listed = listed;
      this.left.replaceChildren(new Option("Photo", ""), ...others.map((run) => new Option(`Run ${run.number}, ${run.aim}`, String(run.number))));
    }
    this.left.value = this.beside ? String(this.beside.number) : "";
  }

  /**
   * Loads a picture once more that the browser could not show, or shows the reason of the server.
   * @param {string} source
   */
  async missing(source) {
    if (this.photo && source.startsWith("blob:") && source === this.photo.url) {
      this.photo.cannotBeSeen = true;
      this.showStage();
    }
    const [, id, file] = OF_JOB.exec(source) ?? [];
    if (id === undefined) return;
    let isKnown = false;
    try {
      await getJob(id);
      isKnown = true;
      await getBlob(source);
      if (!this.viewer.retry(source)) complain("photo-error", `The browser could not show ${file}. Try to save the SVG.`);
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      complain("photo-error", error.status === 404 && !isKnown ? FORGOTTEN : error.message);
    }
  }
}

// Scrolls to the picture, whose end is then above the progress at the bottom of the window.
const bringStage = () => by("stage").scrollIntoView({ block: "nearest" });

/** @param {Run | null} run */
const roundsOf = (run) =>
  (run?.picture?.rounds ?? []).map(({ number, count }) => `after round ${number}: ${whole(count)} shapes`);

/** @param {DoneRun} run */
const costOf = ({ report }) =>
  `${seconds(report.total_s)}: ${drawn(report)}, ${sizes(report)}, ${decibels(report.psnr_svg)}`;

/** @param {number | null} zoom @param {number} shown */
function tellZoom(zoom, shown) {
  by("zoom").textContent = `${Math.round(shown * 100)} %`;
  by("fit").setAttribute("aria-pressed", String(zoom === null));
  by("actual").setAttribute("aria-pressed", String(zoom === 1));
}

/** @param {DoneRun} run @param {string} src @param {boolean} isAlone */
function pictureSide(run, src, isAlone = false) {
  return { src, name: isAlone ? "SVG" : `run ${run.number}`, alt: `${run.photo.name} as SVG, ${run.aim}`, badge: `${isAlone ? "SVG" : `Run ${run.number}`}, ${run.aim}` };
}

/** @param {Run | null} run */
function frameSide(run) {
  if (!run?.id || !run.progress?.frame) return run?.lastFrame ?? null;
  run.lastFrame = { src: ofJob(run.id, `frame?n=${run.progress.frame}`), name: "shapes so far", alt: "The shapes so far", badge: "So far" };
  return run.lastFrame;
}

async function begin() {
  try {
    const studio = new Studio(await getOptions());
    showSamples(await getSamples(), (photos) => studio.take(photos));
    document.body.classList.add("ready");
  } catch (error) {
    if (!(error instanceof ApiError)) throw error;
    complain("photo-error", error.message);
  }
}
begin();
