// What happened, newest first, each with its reason as far as this page learns it.

import { byId, h, setHidden } from "./dom.js";
import { meaningOf } from "./meaning.js";

const MAX_EVENTS = 60;
const SETTLE_MS = 600; // a status, which names who stopped, comes after the state
const OWN_MS = 2000; // between an order of this page and what follows from it
const ORDERS = { estop: "STOP", stop: "Stop", hold: "Hold", resume: "Resume", goto: "a typed number", home: "Rest pose", pose: "a pose", play: "Play", clear_fault: "Clear fault", recover: "Recover", jog: "a slider or the ball", jog_end: "a slider or the ball", acquire: "taking control", release: "releasing control" };

export class Events {
  constructor(link) {
    this.list = h("ol", { tabIndex: 0, "aria-label": "Events" }); // it scrolls, also by the keyboard
    this.waiting = [];
    this.units = {};
    this.lease = {};
    this.none = h("p", { className: "facts" }, "None since this page was opened.");
    byId("events").append(h("h2", {}, "Events"), this.none, this.list);
    const ordered = link.ordered;
    link.ordered = (verb) => {
      ordered(verb);
      if (verb in ORDERS) this.own = { verb, at: performance.now() };
    };
  }

  describe(robots) {
    this.units = Object.fromEntries(Object.entries(robots).map(([name, robot]) => [name, robot.unit]));
  }

  /** The newest lease: who moves the robots, and who stopped them. */
  status(lease) {
    this.lease = lease;
  }

  /** Waits until it is shown. */
  add(event) {
    const own = this.own && performance.now() - this.own.at < OWN_MS ? this.own.verb : null;
    this.waiting.push({ event, own, at: new Date(), came: performance.now() });
    if (this.waiting.length > MAX_EVENTS) this.waiting.shift();
  }

  show() {
    while (this.waiting.length && performance.now() - this.waiting[0].came > SETTLE_MS) this.prepend(this.waiting.shift());
  }

  /** Why a robot changed its state. */
  reason(mode, own) {
    if (own) return `by ${ORDERS[own]} on this page`;
    if (["OFF", "STOPPING", "READY"].includes(mode) && this.lease.stopped_by) return `stopped by ${this.lease.stopped_by}`;
    if (["RUN", "APPROACH"].includes(mode) && this.lease.holder) return `ordered by ${this.lease.holder}`;
    return "";
  }

  prepend({ event, own, at }) {
    const state = event.kind === "state";
    const where = event.robot || event.bus || "";
    const what = state ? [meaningOf(event.mode, this.units[event.robot], false), this.reason(event.mode, own)].filter(Boolean).join(", ")
      : event.message || event.detail || event.reason || event.cause || event.mode || event.tier || "";
    const kind = event.kind === "fault" || event.level === "error" ? "error" : "";
    setHidden(this.none, true);
    this.list.prepend(h("li", { className: kind }, h("time", {}, at.toLocaleTimeString([], { hour12: false })),
      h("b", {}, [where, state ? event.mode : event.kind].filter(Boolean).join(" ")), ` ${what}`));
    while (this.list.children.length > MAX_EVENTS) this.list.lastChild.remove();
  }
}
