// The speed of all motion that begins on this page, as a share of what the robot file allows.

import { byId, h, setText } from "./dom.js";

const SHARES = [1, 2, 5, 10, 25, 50, 75, 100]; // percent
const KEY = "contid.speed";

export class Speed {
  constructor() {
    this.number = Math.max(SHARES.indexOf(Number(sessionStorage.getItem(KEY) ?? 100)), 0);
    this.input = h("input", { type: "range", min: 0, max: SHARES.length - 1, step: 1, value: this.number, "aria-label": "Speed", oninput: () => this.set(Number(this.input.value)) });
    this.text = h("output", {});
    byId("speed").append(h("span", {}, "Speed"), this.input, this.text);
    this.set(this.number);
  }

  /** 0.01 to 1. */
  get share() {
    return SHARES[this.number] / 100;
  }

  set(number) {
    this.number = Math.min(Math.max(number, 0), SHARES.length - 1);
    this.input.value = this.number;
    this.input.setAttribute("aria-valuetext", `${SHARES[this.number]} percent`);
    sessionStorage.setItem(KEY, SHARES[this.number]);
    setText(this.text, `${SHARES[this.number]} %`);
  }
}
