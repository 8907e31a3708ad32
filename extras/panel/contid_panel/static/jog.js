// Jogging: the newest row of one robot, at a bounded rate, one row on its way at a time.

import { toast } from "./dom.js";

const PERIOD_MS = 50;
const STATUS_MS = 600;

export class Jog {
  constructor(link) {
    this.link = link;
    this.row = null;
    this.sending = false;
    this.ending = false;
    this.active = null;
    this.refusals = new Map(); // by robot, until a row of it is taken or another order is given
    this.sentAt = 0;
    this.newest = this.taken = null;
    link.ordered = (verb) => { if (!verb.startsWith("jog")) this.forget(); };
  }

  /** Another way begins: the jog has ended, and its end is not ordered. */
  forget() {
    this.newest = this.taken = this.row = this.active = null;
    this.ending = false;
    this.refusals.clear();
  }

  /** The row that a robot is on its way to by these columns; null when it is not jogged. */
  ordered(robot, columns) {
    return this.newest?.robot === robot && this.newest.columns === columns ? this.newest.values : null;
  }

  /** A robot stands still: from now on the way begins where it is. */
  arrived(robot) {
    if (this.active === null && this.newest?.robot === robot) this.newest = this.taken = null;
  }

  /** Follow a row of a robot; `columns` name its numbers. */
  to(robot, columns, values) {
    if (!this.link.mine) return;
    this.active = robot;
    if (this.newest?.robot !== robot || this.newest.columns !== columns) this.taken = null;
    this.newest = { robot, columns, values };
    this.ending = false;
    this.row = { order: this.newest, pressed: this.link.clock.pressed() };
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
        const { columns, values } = row.order;
        const { refused, reached } = await this.link.order("jog", { columns, rows: [values] }, row.pressed);
        const { robot } = row.order;
        if (!refused.length) {
          this.taken = reached ? { ...row.order, values: columns.map((each, i) => reached[each] ?? values[i]) } : row.order;
          this.refusals.delete(robot);
          if (this.newest === row.order) this.newest = this.taken; // it goes on from where it is led along the edge
        } else {
          this.refusals.set(robot, refused[0].replace(/^rows:\d+: /, ""));
          if (this.newest === row.order) this.newest = this.taken; // what was refused is ordered no more
        }
      }
      if (this.ending) {
        this.active = null;
        this.ending = false;
        await this.link.order("jog_end");
      }
    } catch (error) {
      this.active = this.row = this.newest = this.taken = null;
      // When the lease was lost, the status reports it and this message adds nothing.
      setTimeout(() => { if (this.link.mine) toast(error.message, "error"); }, STATUS_MS);
    } finally {
      this.sending = false;
    }
    if (this.row !== null || (this.ending && this.active !== null)) this.pump();
  }
}
