// Jogging: the newest row of one robot, at a bounded rate, one row on its way at a time.

import { toast } from "./dom.js";

const PERIOD_MS = 50;
const STATUS_MS = 600;

export class Jog {
  constructor(link) {
    this.link = link;
    this.row = null;
    this.pressed = 0;
    this.sending = false;
    this.ending = false;
    this.active = null;
    this.refused = "";
    this.sentAt = 0;
  }

  /** Follow a row of a robot; `columns` name its numbers. */
  to(robot, columns, values) {
    if (!this.link.mine) return;
    this.active = robot;
    this.ending = false;
    this.row = { columns, rows: [values] };
    this.pressed = this.link.clock.pressed();
    this.pump();
  }

  /** The hand is off: the robot ends on the last row and holds. */
  end() {
    if (this.active === null) return;
    this.ending = true;
    this.pump();
  }

  async pump() {
    if (this.sending) return;
    this.sending = true;
    try {
      while (this.row !== null) {
        const wait = this.sentAt + PERIOD_MS - performance.now();
        if (wait > 0) await new Promise((resolve) => setTimeout(resolve, wait));
        const row = this.row;
        this.row = null;
        this.sentAt = performance.now();
        const { refused } = await this.link.order("jog", row, this.pressed);
        this.refused = refused.length ? refused[0].replace(/^rows:\d+: /, "") : "";
      }
      if (this.ending) {
        this.active = null;
        this.ending = false;
        await this.link.order("jog_end");
        this.refused = "";
      }
    } catch (error) {
      this.active = this.row = null;
      this.refused = "";
      // When the lease was lost, the status reports it and this message adds nothing.
      setTimeout(() => { if (this.link.mine) toast(error.message, "error"); }, STATUS_MS);
    } finally {
      this.sending = false;
    }
    if (this.row !== null || (this.ending && this.active !== null)) this.pump();
  }
}
