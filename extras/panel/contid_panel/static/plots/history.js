// What the plots can show: every frame of the last minutes, by robot and by quantity.

export const HISTORY_S = 120;
const SLACK_S = 10; // trimmed at once, not with every frame

/** Quantities of a frame by axis that a robot may not have. */
export const DEVICE = ["effort", "temperature_c", "voltage_v"];

export class History {
  constructor(axes) {
    this.axes = axes;
    this.t = [];
    this.error = [];
    this.lists = { measured: lists(axes.length), command: lists(axes.length), tip: lists(3), target: lists(3), ...Object.fromEntries(DEVICE.map((key) => [key, lists(axes.length)])) };
    this.found = new Set(); // quantities that had a value
  }

  add(t_s, robot) {
    if (this.t.length && t_s < this.t.at(-1)) this.clear(); // the daemon was started again
    this.t.push(t_s);
    this.error.push(robot.error_mm ?? null);
    if (robot.error_mm !== null) this.found.add("error");
    this.push("measured", robot.measured);
    this.push("command", robot.command);
    this.push("tip", robot.tip_mm);
    this.push("target", robot.target_mm ?? robot.command_tip_mm);
    for (const key of DEVICE) this.push(key, robot[key]);
    if (t_s - this.t[0] > HISTORY_S + SLACK_S) this.trim(this.t.findIndex((t) => t > t_s - HISTORY_S));
  }

  push(key, values) {
    this.lists[key].forEach((list, i) => {
      const value = values?.[i] ?? null;
      if (value !== null) this.found.add(key);
      list.push(value);
    });
  }

  get all() {
    return [this.t, this.error, ...Object.values(this.lists).flat()];
  }

  trim(count) {
    for (const list of this.all) list.splice(0, count);
  }

  clear() {
    for (const list of this.all) list.length = 0;
  }

  /** Indices of the rows from a time to another one, one more at each end. */
  between(from_s, to_s) {
    const first = this.t.findIndex((t) => t >= from_s);
    const last = this.t.findLastIndex((t) => t <= to_s);
    return [Math.max(first < 0 ? this.t.length : first - 1, 0), Math.min(last + 2, this.t.length)];
  }
}

const lists = (count) => [...Array(count).keys()].map(() => []);
