// Which part of the history the plots show: the newest seconds, or a part that a hand has chosen.

import { h } from "../dom.js";
import { HISTORY_S } from "./history.js";

const LIVE_S = 20;
const SHORTEST_S = 0.5;
const ZOOM = 1.6;
const SHIFT = 0.25; // of what is shown

export class Timespan {
  /** `changed` draws again. */
  constructor(changed) {
    this.changed = changed;
    this.span_s = LIVE_S;
    this.end_s = null; // null: live
    this.newest_s = 0;
    this.oldest_s = Infinity; // since the page or the daemon began
    const button = (text, label, onclick) => h("button", { type: "button", className: "small", "aria-label": label, title: label, onclick }, text);
    this.live = button("Live", "Show the newest seconds", () => this.goLive());
    this.element = h("div", { className: "timespan", role: "group", "aria-label": "Time shown" },
      button("−", "Show a longer time", () => this.zoom(ZOOM)), button("+", "Show a shorter time", () => this.zoom(1 / ZOOM)),
      button("‹", "Earlier", () => this.shift(-SHIFT * this.span_s)), button("›", "Later", () => this.shift(SHIFT * this.span_s)), this.live);
    this.show();
  }

  /** From and to [s], and the time that the axis counts from. */
  get window() {
    const end = this.end_s ?? this.newest_s;
    return { from: end - this.span_s, to: end };
  }

  advance(newest_s) {
    this.oldest_s = newest_s < this.newest_s ? newest_s : Math.max(Math.min(this.oldest_s, newest_s), newest_s - HISTORY_S);
    this.newest_s = newest_s;
    if (this.end_s !== null && (this.end_s > newest_s || this.end_s < newest_s - HISTORY_S)) this.goLive();
  }

  goLive() {
    this.end_s = null;
    this.span_s = LIVE_S;
    this.update();
  }

  /** Show `factor` as long a time around a share of the width. */
  zoom(factor, at = 1) {
    const span = Math.min(Math.max(this.span_s * factor, SHORTEST_S), HISTORY_S);
    const { from } = this.window;
    const fixed = from + at * this.span_s;
    this.span_s = span;
    if (this.end_s !== null || at < 0.98) this.endAt(fixed + (1 - at) * span);
    this.update();
  }

  shift(by_s) {
    this.endAt((this.end_s ?? this.newest_s) + by_s);
    this.update();
  }

  /** Show what ends at a time, live where that is the newest. The whole of it is shown, or half of a shorter history. */
  endAt(end_s) {
    const history_s = this.newest_s - this.oldest_s;
    const end = Math.max(end_s, this.oldest_s + (history_s > this.span_s ? this.span_s : 0.5 * history_s));
    this.end_s = end >= this.newest_s ? null : end;
  }

  update() {
    this.show();
    this.changed();
  }

  show() {
    this.live.setAttribute("aria-pressed", this.end_s === null);
  }

  /** A hand on a plot: dragging shifts, Ctrl and the wheel (or two fingers on a touchpad) zoom. */
  follow(over) {
    let grip = null;
    over.addEventListener("pointerdown", (event) => {
      grip = event.clientX;
      over.setPointerCapture(event.pointerId);
    });
    over.addEventListener("pointermove", (event) => {
      if (grip === null) return;
      this.shift(((grip - event.clientX) / over.clientWidth) * this.span_s);
      grip = event.clientX;
    });
    for (const kind of ["pointerup", "pointercancel"]) over.addEventListener(kind, () => { grip = null; });
    over.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return; // the page scrolls
      event.preventDefault();
      this.zoom(Math.exp(event.deltaY * 0.003), event.offsetX / over.clientWidth);
    }, { passive: false });
    over.addEventListener("dblclick", () => this.goLive());
  }
}
