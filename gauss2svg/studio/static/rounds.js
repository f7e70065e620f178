// The picture of a run as the page keeps it, and its rounds.

import { getText, ofJob } from "./api.js";

const ROUND = /^round-(\d+)$/;
/** @param {string} text */
const address = (text) => URL.createObjectURL(new Blob([text], { type: "image/svg+xml" }));

export class Picture {
  /** @param {string} id of its job */
  static async of(id) {
    return new Picture(await getText(ofJob(id, "picture.svg")));
  }

  /** @param {string} text */
  constructor(text) {
    this.text = text;
    this.whole = address(text);
    this.addresses = /** @type {Map<number, string>} */ (new Map());
    let count = 0;
    // With the shapes up to it; minimal markup has no groups of rounds.
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
    return [...tree.documentElement.children].filter((one) => ROUND.test(one.id));
  }

  /** @param {number} many of the first rounds, after which the picture is that of the address */
  upTo(many) {
    if (many >= this.rounds.length) return this.whole;
    const known = this.addresses.get(many);
    if (known) return known;
    const tree = this.parsed();
    for (const group of this.groups(tree).slice(many)) group.remove();
    const made = address(new XMLSerializer().serializeToString(tree));
    this.addresses.set(many, made);
    return made;
  }
}
