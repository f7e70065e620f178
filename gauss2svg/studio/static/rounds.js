// The SVG of a run in the page, and its rounds.

import { getText, ofJob } from "./api.js";

const ROUND = /^round-(\d+)$/;
const PATHS = 'path[d^="m"]'; // areas and lines; path data of shapes and of the background begin with M
/** @param {string} text */
const address = (text) => URL.createObjectURL(new Blob([text], { type: "image/svg+xml" }));

export class Picture {
  /** @param {string} id id of the job */
  static async of(id) {
    return new Picture(await getText(ofJob(id, "picture.svg")));
  }

  /** @param {string} text */
  constructor(text) {
    this.text = text;
    this.whole = address(text);
    this.addresses = /** @type {Map<string, string>} */ (new Map());
    let count = 0;
    // Each round has the number of shapes up to its end. Minimal markup has no groups of rounds.
    this.rounds = this.groups(this.parsed()).map((group) => {
      count += group.querySelectorAll("circle").length;
      return { number: Number(ROUND.exec(group.id)?.[1]), count };
    });
  }

  parsed() {
    return new DOMParser().parseFromString(this.text, "image/svg+xml");
  }

  /** @param {XMLDocument} tree */
  groups(tree) {
    return [...tree.querySelectorAll("g")].filter((one) => ROUND.test(one.id));
  }

  /**
   * Returns the address of the picture with only the first rounds.
   * @param {number} count number of these rounds
   * @param {string[]} without "areas" or "lines", if these are hidden
   */
  part(count, without) {
    if (count >= this.rounds.length && !without.length) return this.whole;
    const key = [count, ...without].join(), kept = this.addresses.get(key);
    if (kept) return kept;
    const tree = this.parsed();
    for (const group of this.groups(tree).slice(count)) group.remove();
    for (const path of tree.querySelectorAll(PATHS)) {
      const isLine = path.closest("[fill]")?.getAttribute("fill") === "none"; // a group may have it
      if (without.includes(isLine ? "lines" : "areas")) path.remove();
    }
    const partial = address(new XMLSerializer().serializeToString(tree));
    this.addresses.set(key, partial);
    return partial;
  }
}
