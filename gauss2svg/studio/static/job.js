// Runs: posted to the server a few at a time, followed by their events.

import { ApiError, cancelJob, ofJob, postJob, stopJob } from "./api.js";

const MOST_FOLLOWED = 3; // by streams: a browser has six connections to a server, also for pictures and answers
const PAUSE_MS = 1000; // before a full queue is asked again, where the server names no time
const LOST = "The server does not answer; it is asked again.";
const GONE = "The server no longer knows this run. Try to run it again";

export const ENDED = ["done", "stopped", "failed", "canceled"];
export const isDone = (run) => run.state === "done" || run.state === "stopped";
export const isActive = (run) => !ENDED.includes(run.state);

// Runs wait here, not at the server, beyond what it fits and the page follows at once.
export class Lane {
  constructor(most, changed) {
    this.most = Math.min(most, MOST_FOLLOWED);
    this.changed = changed; // called with a run whenever it changes
    this.waiting = [];
    this.running = 0;
  }

  add(run) {
    run.state = "waiting";
    this.waiting.push(run);
    this.next();
    this.tell();
  }

  tell() {
    this.waiting.forEach((run, at) => {
      run.place = at + this.running;
      this.changed(run);
    });
  }

  next() {
    while (this.running < this.most && this.waiting.length) {
      this.running += 1;
      const run = this.waiting.shift();
      this.follow(run).catch((error) => {
        if (!(error instanceof ApiError)) throw error;
        Object.assign(run, { state: "failed", error: error.message, status: error.status });
      }).finally(() => {
        this.running -= 1;
        this.changed(run);
        this.next();
        this.tell();
      });
    }
  }

  async follow(run) {
    run.state = "queued";
    this.changed(run);
    const posted = await this.post(run);
    if (posted === null) return;
    run.id = posted.id;
    if (run.isCanceled) { // while it was posted
      await cancelJob(run.id);
      return;
    }
    run.photo.job = run.id;
    Object.assign(run, posted); // later only what changes is sent
    await new Promise((ended) => {
      run.events = new EventSource(ofJob(run.id, "events"));
      run.end = () => {
        run.events.close();
        ended();
      };
      run.events.addEventListener("state", (event) => {
        run.lost = "";
        Object.assign(run, JSON.parse(event.data));
        if (!isActive(run)) return run.end();
        this.changed(run);
      });
      run.events.addEventListener("error", () => {
        if (run.events.readyState === EventSource.CLOSED) {
          Object.assign(run, { state: "failed", error: GONE });
          return run.end();
        }
        run.lost = LOST;
        this.changed(run);
      });
    });
  }

  async post(run) {
    while (!run.isCanceled) {
      try {
        return await postJob(run.photo, run.asked);
      } catch (error) {
        if (error.status === 404 && run.photo.job) {
          run.photo.job = null;
          continue;
        }
        if (error.status !== 429) throw error;
        run.lost = error.message;
        this.changed(run);
        await new Promise((done) => setTimeout(done, error.retryAfter * 1000 || PAUSE_MS));
      }
    }
    return null;
  }

  async stop(run) {
    if (run.id) await stopJob(run.id);
  }

  async cancel(run) {
    run.isCanceled = true;
    run.state = "canceled";
    this.waiting = this.waiting.filter((one) => one !== run);
    this.changed(run);
    if (run.id) {
      if (run.photo.job === run.id) run.photo.job = null;
      run.end();
      await cancelJob(run.id);
    }
    this.tell();
  }
}
