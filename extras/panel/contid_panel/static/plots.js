// Plots of the selected robot over the last seconds: axes, and the distance of the tip from its target.

import uPlot from "./vendor/uplot/uPlot.esm.js";
import { axisColour, style } from "./colours.js";
import { byId, h, setHidden } from "./dom.js";

const WINDOW_S = 20;
const PERIOD_MS = 100;
const HEIGHT = 150;

export class Plots {
  constructor() {
    this.data = new Map();
    this.robot = null;
    this.drawnAt = 0;
    this.axes = h("div", {});
    this.error = h("div", {});
    this.title = h("h2", {}, "Plots");
    byId("plots").append(this.title, this.axes, this.error);
    new ResizeObserver(() => this.resize()).observe(byId("plots"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.build());
  }

  describe(robots) {
    this.robots = robots;
    this.data.clear();
    for (const [name, robot] of Object.entries(robots)) {
      this.data.set(name, { t: [], error: [], axes: Object.keys(robot.axes).map(() => ({ command: [], measured: [] })) });
    }
    this.select(this.data.has(this.robot) ? this.robot : Object.keys(robots)[0]);
  }

  select(name) {
    if (name === this.robot && this.axesPlot) return;
    this.robot = name;
    this.build();
  }

  build() {
    this.axesPlot?.destroy();
    this.errorPlot?.destroy();
    if (!this.data.has(this.robot)) return;
    const robot = this.robots[this.robot];
    this.title.textContent = `${this.robot}: axes [${robot.unit}] (dashed: command), tip off its target [mm]`;
    const ends = (axis, end) => axis[Object.keys(axis).find((key) => key.startsWith(end))];
    const span = 0.04 * Math.max(...Object.values(robot.axes).map((axis) => ends(axis, "max_") - ends(axis, "min_")));
    const series = [];
    Object.keys(robot.axes).forEach((axis, i) => {
      const color = axisColour(i);
      series.push({ label: axis, stroke: color, width: 1.75, points: { show: false } });
      series.push({ label: `${axis} command`, stroke: color, width: 1, dash: [4, 3], points: { show: false } });
    });
    this.axesPlot = new uPlot(this.options(series, HEIGHT, span), [[], ...series.map(() => [])], this.axes);
    const tip = [{ label: "tip", stroke: axisColour(0), width: 1.5, fill: "rgba(59,130,246,0.12)", points: { show: false } }];
    this.errorPlot = new uPlot(this.options(tip, HEIGHT * 0.7, 0.5), [[], []], this.error);
  }

  /** `span` is the least height of the plot: noise must not fill it. */
  options(series, height, span) {
    const axis = { stroke: style("--muted"), grid: { stroke: style("--line"), width: 1 }, ticks: { stroke: style("--line"), width: 1 }, font: "11px system-ui, sans-serif" };
    return {
      width: this.width(), height, legend: { show: false }, cursor: { show: false }, series: [{}, ...series],
      scales: { x: { time: false }, y: { range: (u, low, high) => padded(low, high, span) } },
      axes: [{ ...axis, size: 28, values: (u, ticks) => ticks.map((t) => `${t} s`) }, { ...axis, size: 52 }],
    };
  }

  width() {
    return Math.max(byId("plots").clientWidth - 28, 120);
  }

  resize() {
    for (const plot of [this.axesPlot, this.errorPlot]) plot?.setSize({ width: this.width(), height: plot.height });
  }

  add(t_s, robots) {
    for (const [name, data] of this.data) {
      const robot = robots[name];
      if (data.t.length && t_s < data.t.at(-1)) data.t.length = data.error.length = 0;
      data.t.push(t_s);
      data.error.push(robot.error_mm);
      data.axes.forEach((axis, i) => {
        axis.command.push(robot.command[i]);
        axis.measured.push(robot.measured?.[i] ?? null);
      });
      const first = data.t.findIndex((t) => t > t_s - WINDOW_S);
      for (const list of [data.t, data.error, ...data.axes.flatMap((axis) => [axis.command, axis.measured])]) {
        if (first > 0) list.splice(0, first);
        while (list.length > data.t.length) list.shift();
      }
    }
  }

  show(now_s) {
    const data = this.data.get(this.robot);
    if (data === undefined || performance.now() - this.drawnAt < PERIOD_MS || document.visibilityState !== "visible") return;
    this.drawnAt = performance.now();
    const t = data.t.map((each) => each - now_s);
    const window = { min: -WINDOW_S, max: 0 };
    this.axesPlot.setData([t, ...data.axes.flatMap((axis) => [axis.measured, axis.command])], false);
    this.axesPlot.setScale("x", window);
    const followed = data.error.some((each) => each !== null);
    setHidden(this.error, !followed);
    this.errorPlot.setData([t, data.error], false);
    this.errorPlot.setScale("x", window);
  }
}

function padded(low, high, span) {
  if (low === null || high === null) return [0, 1];
  const room = Math.max(0.08 * (high - low), 0.5 * (span - (high - low)));
  return [low >= 0 && low - room < 0 ? 0 : low - room, high + room];
}
