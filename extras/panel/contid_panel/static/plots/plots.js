// The plots of the selected robot: axes, tip, and what its devices report, each shown or not.

import { axisColour } from "../colours.js";
import { byId, h, setText } from "../dom.js";
import { Curves } from "./curves.js";
import { DEVICE, History } from "./history.js";
import { Timespan } from "./timespan.js";

const PERIOD_MS = 100;
const HEIGHT = 190;
const LOW_HEIGHT = 130;
const NAMES = { axes: "Axes", tip: "Tip", error: "Tip off its target", effort: "Effort", temperature_c: "Temperature", voltage_v: "Voltage" };
const FIRST = ["axes", "tip"]; // shown at first

export class Plots {
  constructor() {
    this.data = new Map();
    this.robot = null;
    this.drawnAt = 0;
    this.chosen = new Set(FIRST);
    this.curves = new Map();
    this.timespan = new Timespan(() => this.draw());
    this.title = h("h2", {}, "Plots");
    this.buttons = new Map(Object.entries(NAMES).map(([key, name]) => [key, h("button", { type: "button", className: "small", onclick: () => this.toggle(key) }, name)]));
    this.place = h("div", { className: "figures" });
    byId("plots").append(h("div", { className: "bar" }, this.title, h("div", { className: "choice", role: "group", "aria-label": "Plots shown" }, ...this.buttons.values()), this.timespan.element), this.place);
    new ResizeObserver(() => this.resize()).observe(byId("plots"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.build());
  }

  describe(robots) {
    this.robots = robots;
    this.data = new Map(Object.entries(robots).map(([name, robot]) => [name, new History(Object.keys(robot.axes))]));
    this.robot = this.data.has(this.robot) ? this.robot : Object.keys(robots)[0];
    this.build();
  }

  select(name) {
    if (name === this.robot && this.curves.size) return;
    this.robot = name;
    this.build();
  }

  toggle(key) {
    if (!this.chosen.delete(key)) this.chosen.add(key);
    this.build();
  }

  build() {
    for (const each of this.curves.values()) each.destroy();
    this.curves.clear();
    const history = this.data.get(this.robot);
    if (history === undefined) return;
    setText(this.title, this.robot);
    const width = this.width();
    for (const key of Object.keys(NAMES)) {
      if (!this.chosen.has(key)) continue;
      const curves = new Curves(...this.what(key, history, width), this.timespan);
      this.curves.set(key, curves);
      this.place.append(curves.element);
    }
    this.mark();
    this.draw();
  }

  /** Title, curves and size of one plot. */
  what(key, history, width) {
    const robot = this.robots[this.robot];
    const units = Object.values(robot.axes).map(unitOf);
    const differ = new Set(units).size > 1; // a wrist may be in degrees
    const axes = (list, dashed = false) => history.axes.map((name, i) => ({ name: differ ? `${name} [${units[i]}]` : name, colour: axisColour(i), dashed, values: (from) => from.lists[list][i] }));
    const tip = (list, dashed = false) => ["x", "y", "z"].filter((name) => robot.columns.includes(`${name}_mm`)).map((name, i) => ({ name, colour: axisColour(i), dashed, values: (from) => from.lists[list][i] }));
    switch (key) {
      case "axes":
        return [`Axes [${[...new Set(units)].join(", ")}], dashed: command`, [...axes("measured"), ...axes("command", true)], { width, height: HEIGHT, span: 0.04 * range(robot), decimals: robot.unit === "bar" ? 3 : 2 }];
      case "tip":
        return ["Tip [mm], dashed: target", [...tip("tip"), ...tip("target", true)], { width, height: HEIGHT, span: 2 }];
      case "error":
        return ["Tip off its target [mm]", [{ name: "off", colour: axisColour(0), values: (from) => from.error }], { width, height: LOW_HEIGHT, span: 0.5 }];
      default:
        return [{ effort: "Effort (of its device: mA, duty, ...)", temperature_c: "Temperature [°C]", voltage_v: "Voltage [V]" }[key], axes(key), { width, height: LOW_HEIGHT, span: 1, decimals: 1 }];
    }
  }

  /** Which plots are shown, and which the robot has nothing for. */
  mark() {
    const found = this.data.get(this.robot)?.found ?? new Set();
    for (const [key, button] of this.buttons) {
      button.setAttribute("aria-pressed", this.chosen.has(key));
      button.disabled = !this.chosen.has(key) && (key === "error" || DEVICE.includes(key)) && !found.has(key);
      button.title = button.disabled ? "nothing was reported yet" : "";
    }
    this.marked = found.size;
  }

  width() {
    return Math.max(byId("plots").clientWidth - 28, 120);
  }

  resize() {
    for (const each of this.curves.values()) each.resize(this.width());
  }

  add(t_s, robots) {
    for (const [name, history] of this.data) history.add(t_s, robots[name]);
    this.timespan.advance(t_s);
  }

  show() {
    if (performance.now() - this.drawnAt < PERIOD_MS || document.visibilityState !== "visible" || this.timespan.end_s !== null) return;
    this.drawnAt = performance.now();
    if (this.data.get(this.robot)?.found.size !== this.marked) this.mark();
    this.draw();
  }

  draw() {
    const history = this.data.get(this.robot);
    if (history === undefined) return;
    for (const each of this.curves.values()) each.show(history, this.timespan.window, this.timespan.newest_s);
  }
}

/** The unit of an axis. */
function unitOf(axis) {
  return Object.keys(axis).find((key) => key.startsWith("min_")).slice(4);
}

/** The widest range of an axis, in the unit of most. */
function range(robot) {
  const end = (axis, start) => axis[Object.keys(axis).find((key) => key.startsWith(start))];
  return Math.max(...Object.values(robot.axes).map((axis) => end(axis, "max_") - end(axis, "min_")));
}
