// The server's answers; addresses are relative, so that the page works wherever it is mounted.

export class ApiError extends Error {
  constructor(line, status, retryAfter) {
    super(line);
    this.status = status;
    this.retryAfter = retryAfter;
  }
}

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
    const told = await response.json();
    line = typeof told.error === "string" ? told.error : line;
  }
  throw new ApiError(line, response.status, Number(response.headers.get("retry-after")) || 1);
}
const json = async (path, request) => (await answer(path, request)).json();

export const getOptions = () => json("api/options");
export const getSamples = () => json("api/samples");
export const getText = async (path) => (await answer(path)).text();
export const getBlob = async (path) => (await answer(path)).blob();

const asking = (asked, signal) =>
  ({ method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(asked), signal });
export const getEstimate = (asked, signal) => json("api/estimate", asking(asked, signal));
export const getChart = async (asked, signal) => (await answer("api/chart", asking(asked, signal))).text();
// A photo whose bytes the server has already is not sent again; a 404 says that it has them no longer.
export function postJob(photo, options) {
  const body = new FormData();
  if (photo.job) body.append("of", photo.job);
  else if (photo.file) body.append("photo", photo.file, photo.name);
  else body.append("sample", photo.sample);
  body.append("options", JSON.stringify(options));
  return json("api/jobs", { method: "POST", body });
}
export const getJob = (id) => json(ofJob(id));
export const stopJob = (id) => answer(`${ofJob(id)}/stop`, { method: "POST" });
export const cancelJob = (id) => answer(ofJob(id), { method: "DELETE" });
export const ofJob = (id, name = "") => `api/jobs/${encodeURIComponent(id)}${name && "/"}${name}`;
export const zipOf = (ids) => `api/zip?ids=${ids.map(encodeURIComponent).join(",")}`;
