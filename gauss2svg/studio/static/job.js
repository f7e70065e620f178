// Runs: they are posted to the server, a few at a time, and followed by their events.

import { ApiError, cancelJob, ofJob, postJob, stopJob } from "./api.js";

// Largest number of event streams. A browser has six connections to a server, for pictures and answers too.
const MOST_FOLLOWED = 3;
const LOST = "The server does not answer. Trying again.";
const GONE = "The server no longer knows this run. Try to run it again";

/** @import { Options, Progress, State } from "./api.js" */
/** @typedef {{ name: string, url: string, file?: File, width?: number, height?: number, series?: number, cannotBeSeen?: boolean,
 *   job?: string | null, mask?: HTMLCanvasElement }} Photo a sample has no file; series is the number of its mark; job is the id of a job with this photo */
/** @typedef {{ number: number, photo: Photo, asked: Options, aim: string, mask: Promise<Blob | null>, place?: number, lost?: string, isStopping?: boolean, isCanceled?: boolean,
 *   isEnded?: boolean, status?: number, figures?: Progress, lastFrame?: Shown, picture?: import("./rounds.js").Picture,
 *   end?: () => void }} OfPage */
/** @typedef {Omit<Partial<State>, "state"> & { state: string } & OfPage} Run */
/** @typedef {Run & State & { picture: import("./rounds.js").Picture }} DoneRun */

const ENDED = ["done", "failed", "canceled"];
/** @param {Run} run @returns {run is Run & State} */
export const isDone = (run) => run.state === "done";
/** @param {Run} run */
export const isActive = (run) => !ENDED.includes(run.state);
/** @param {Run | null | undefined} run @returns {run is DoneRun} */
export const hasPicture = (run) => run?.picture !== undefined;

// A queue of runs in the page. A run is posted to the server only when fewer than `most` others are followed.
export class RunQueue {
  /** @param {number} most number of runs at the same time @param {(run: Run) => void} changed called with a run when it changes */
  constructor(most, changed) {
    this.most = Math.min(most, MOST_FOLLOWED);
    this.changed = changed;
    this.waiting = /** @type {Run[]} */ ([]);
    this.running = 0;
  }

  /** @param {Run} run */
  add(run) {
    run.state = "waiting";
    this.waiting.push(run);
    this.next();
    this.showPlaces();
  }

  showPlaces() {
    this.waiting.forEach((run, at) => {
      run.place = at + this.running;
      this.changed(run);
    });
  }

  next() {
    while (this.running < this.most) {
      const run = this.waiting.shift();
      if (run === undefined) return;
      this.running += 1;
      this.follow(run).catch((error) => {
        if (!(error instanceof ApiError)) throw error;
        Object.assign(run, { state: "failed", error: error.message, status: error.status });
      }).finally(() => {
        this.running -= 1;
        this.changed(run);
        this.next();
        this.showPlaces();
      });
    }
  }

  /** @param {Run} run */
  async follow(run) {
    run.state = "queued";
    this.changed(run);
    const posted = await this.post(run);
    run.id = posted.id;
    if (run.isCanceled) { // the user canceled it while it was posted
      await cancelJob(posted.id);
      return;
    }
    run.photo.job = posted.id;
    Object.assign(run, posted); // events follow only when the state changes
    await /** @type {Promise<void>} */ (new Promise((ended) => {
      const events = new EventSource(ofJob(posted.id, "events"));
      const end = () => {
        events.close();
        ended();
      };
      run.end = end;
      events.addEventListener("state", (event) => {
        run.lost = "";
        Object.assign(run, JSON.parse(event.data));
        if (isActive(run)) this.changed(run);
        else end();
      });
      events.addEventListener("error", () => {
        if (events.readyState === EventSource.CLOSED) {
          Object.assign(run, { state: "failed", error: GONE });
          end();
          return;
        }
        run.lost = LOST;
        this.changed(run);
      });
    }));
  }

  /** @param {Run} run */
  async post(run) {
    try {
      return await postJob(run.photo, run.asked, await run.mask);
    } catch (error) {
      if (error.status !== 404 || !run.photo.job) throw error;
      run.photo.job = null; // the server has forgotten it, so the photo is sent once more
      return postJob(run.photo, run.asked, await run.mask);
    }
  }

  /** @param {Run} run */
  async stop(run) {
    if (run.id) await stopJob(run.id);
  }

  /** @param {Run} run */
  async cancel(run) {
    run.isCanceled = true;
    run.state = "canceled";
    this.waiting = this.waiting.filter((other) => other !== run);
    this.changed(run);
    if (run.id) {
      if (run.photo.job === run.id) run.photo.job = null;
      run.end?.();
      await cancelJob(run.id);
    }
    this.showPlaces();
  }
}
