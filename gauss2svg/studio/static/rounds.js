// The picture of a run as the page keeps it, and its rounds.

import { getText, ofJob } from "./api.js";

const ROUND = /^round-(\d+)$/;
const address = (text) => URL.createObjectURL(new Blob([text], { type: "image/svg+xml" }));

export class Picture {
  static async of(id) {
    return new Picture(await getText(ofJob(id, "picture.svg")));
  }

  constructor(text) {
    this.text = text;
    this.whole = address(text);
    this.addresses = new Map();
    let count = 0;
    // [number, shapes up to it]; minimal markup has no groups of rounds.
    this.rounds = this.groups(this.parsed()).map((group) => {
      count += group.querySelectorAll("circle").length;
      return [Number(ROUND.exec(group.id)[1]), count];
    });
  }

  parsed() {
    return new DOMParser().parseFromString(this.text, "image/svg+xml");
  }

  groups(tree) {
    return [...tree.documentElement.children].filter((one) => ROUND.test(one.id));
  }

  // Address of the picture after the first `many` rounds.
  upTo(many) {
    if (many >= this.rounds.length) return this.whole;
    if (!this.addresses.has(many)) {
      const tree = this.parsed();
      for (const group of this.groups(tree).slice(many)) group.remove();
      this.addresses.set(many, address(new XMLSerializer().serializeToString(tree)));
    }
    return this.addresses.get(many);
  }
}
