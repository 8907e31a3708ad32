// The panel's clock, learnt from its messages: an order says when it was pressed, and one that waited is refused.
//
// The difference of two clocks is seen as too small by the time that a message took, so the greatest one of some
// messages is the best, and never too great: what is pressed is never taken for later than it was.

const KEPT_MS = 20000; // clocks drift

export class Clock {
  /** `now` [ms] is the browser's. */
  constructor(now = () => performance.now()) {
    this.now = now;
    this.forget();
  }

  /** Another panel has another clock. */
  forget() {
    this.seen = [];
  }

  /** A message of the panel came that has the time of its clock. */
  take(panel_ms) {
    const at = this.now();
    this.seen = this.seen.filter((each) => at - each.at < KEPT_MS);
    this.seen.push({ at, ahead: panel_ms - at });
  }

  /** When the person pressed what is being handled now: an event may have waited for a page that stood still. */
  pressed() {
    const now = this.now();
    return Math.min(window.event?.timeStamp || now, now);
  }

  /** A time of this page by the panel's clock; null while that is unknown. */
  ofPanel(at) {
    return this.seen.length ? Math.floor(at + Math.max(...this.seen.map((each) => each.ahead))) : null;
  }
}
