// Requests to the server. Addresses are relative, so that the page works wherever it is mounted.

/** @typedef {string | number | boolean | null} Value value of an option */
/** @typedef {Record<string, Value>} Options */
/** @typedef {{ name: string, label: string, flag: string | null, type: "integer" | "number" | "boolean" | "choice" | "size" | "text",
 *   choices: (string | number)[] | null, min: number | null, max: number | null, default: Value, help: string, unit: string | null }} Option */
/** @typedef {{ title: string, options: Option[] }} Group */
/** @typedef {{ key: string, name: string, title: string, unit: string, digits: number, best: number | null }} Score */
/** @typedef {{ groups: Group[], scores: Score[], limits: Limits, uses: Record<string, Options> }} Form uses are the first choices, with the options that each sets */
/** @typedef {{ png_pixels: number }} Limits */
/** @typedef {{ name: string, url: string }} Sample */
/** @typedef {Record<string, number | null> & { width: number, height: number, gaussians: number, svg_bytes: number,
 *   svgz_bytes: number, total_s: number, psnr_svg: number | null } & { unreached: string[], notes: string[], inks: string | null, ink_shares: number[] | null }} Report */
/** @typedef {{ phase?: string, round?: number, iteration?: number, done?: number, frame?: number, gaussians?: number,
 *   areas?: string, psnr?: number | null, bytes_estimate?: number, elapsed_s?: number, remaining_s?: number }} Progress */
/** @typedef {{ id: string, state: string, progress: Progress | null, report: Report, error: string,
 *   width: number | null, height: number | null, command: string }} State state of a job; the report is null until there is an SVG */

export class ApiError extends Error {
  /** @param {string} line @param {number} status HTTP status, or 0 without an answer */
  constructor(line, status) {
    super(line);
    this.status = status;
  }
}

/** @param {string} path @param {RequestInit} [request] */
async function answer(path, request) {
  let response;
  try {
    response = await fetch(path, request);
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new ApiError("The server does not answer. Is gauss2svg studio still running?", 0);
  }
  if (response.ok) return response;
  let line = `The server answered ${response.status}.`;
  if (response.headers.get("content-type")?.includes("json")) {
    const body = await response.json();
    line = typeof body.error === "string" ? body.error : line;
  }
  throw new ApiError(line, response.status);
}
/** @param {string} path @param {RequestInit} [request] */
const json = async (path, request) => (await answer(path, request)).json();

export const getOptions = () => /** @type {Promise<Form>} */ (json("api/options"));
export const getSamples = () => /** @type {Promise<Sample[]>} */ (json("api/samples"));
/** @param {string} path */
export const getText = async (path) => (await answer(path)).text();
/** @param {string} path */
export const getBlob = async (path) => (await answer(path)).blob();

/** @param {object} request @param {AbortSignal} signal */
export const getChart = async (request, signal) => (await answer("api/chart", {
  method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(request), signal,
})).text();
/**
 * Posts a job. If an earlier job has the photo, only the id of that job is sent. The answer is 404 if
 * the server has forgotten it.
 * @param {import("./job.js").Photo} photo
 * @param {Options} options
 * @param {Blob | null} mask white where detail matters
 * @returns {Promise<State>}
 */
export function postJob(photo, options, mask) {
  const body = new FormData();
  if (photo.job) body.append("of", photo.job);
  else if (photo.file) body.append("photo", photo.file, photo.name);
  else body.append("sample", photo.name);
  if (mask) body.append("focus", mask, "focus.png");
  body.append("options", JSON.stringify(options));
  return json("api/jobs", { method: "POST", body });
}
/** @param {string} id */
export const getJob = (id) => json(ofJob(id));
/** @param {string} id @returns {Promise<string[]>} */
export const getFiles = (id) => json(ofJob(id, "files"));
/** @param {string} id */
export const stopJob = (id) => answer(`${ofJob(id)}/stop`, { method: "POST" });
/** @param {string} id */
export const cancelJob = (id) => answer(ofJob(id), { method: "DELETE" });
/** @param {string} id @param {string} [name] */
export const ofJob = (id, name = "") => `api/jobs/${encodeURIComponent(id)}${name && "/"}${name}`;
/** @param {string[]} ids */
export const zipOf = (ids) => `api/zip?ids=${ids.map(encodeURIComponent).join(",")}`;
