// One plot: its curves, and their values under the pointer.

import uPlot from "../vendor/uplot/uPlot.esm.js";
import { style } from "../colours.js";
import { h, setText, shown } from "../dom.js";

export class Curves {
  /** `series`: name, colour, values (a function of the history), dashed. `span`: least height, so that noise does not fill it. */
  constructor(title, series, { height, span, decimals = 2, width }, timespan) {
    this.series = series;
    this.decimals = decimals;
    this.readout = h("span", { className: "readout" });
    this.place = h("div", {});
    this.element = h("figure", { className: "curves", "aria-label": title }, h("figcaption", {}, h("b", {}, title), this.readout), this.place);
    const axis = { stroke: style("--muted"), grid: { stroke: style("--line"), width: 1 }, ticks: { stroke: style("--line"), width: 1 }, font: "11px system-ui, sans-serif" };
    this.plot = new uPlot({
      width, height, legend: { show: false },
      cursor: { drag: { x: false, y: false }, points: { show: false }, y: false },
      hooks: { setCursor: [(plot) => this.read(plot.cursor.idx)] },
      series: [{}, ...series.map(({ name, colour, dashed }) => ({ label: name, stroke: colour, width: dashed ? 1 : 1.75, dash: dashed ? [4, 3] : undefined, points: { show: false } }))],
      scales: { x: { time: false }, y: { range: (u, low, high) => padded(low, high, span) } },
      axes: [{ ...axis, size: 28, values: (u, ticks) => ticks.map((t) => `${String(t).replace("-", "−")} s`) }, { ...axis, size: 56 }],
    }, [[], ...series.map(() => [])], this.place);
    timespan.follow(this.plot.over);
  }

  /** Draw a part of the history; times count from `zero_s`. */
  show(history, { from, to }, zero_s) {
    const [first, last] = history.between(from, to);
    const t = history.t.slice(first, last).map((each) => each - zero_s);
    this.plot.setData([t, ...this.series.map(({ values }) => values(history).slice(first, last))], false);
    this.plot.setScale("x", { min: from - zero_s, max: to - zero_s });
    this.read(this.plot.cursor.idx);
  }

  /** The values under the pointer, else the newest ones. */
  read(index) {
    const rows = this.plot?.data;
    if (!rows || !rows[0].length) return;
    const at = index ?? rows[0].length - 1;
    const values = this.series.map(({ name, dashed }, i) => (dashed ? "" : `${name} ${shown(rows[i + 1][at], this.decimals)}`)).filter(Boolean);
    setText(this.readout, values.join("  "));
  }

  resize(width) {
    this.plot.setSize({ width, height: this.plot.height });
  }

  destroy() {
    this.plot.destroy();
    this.element.remove();
  }
}

function padded(low, high, span) {
  if (low === null || high === null) return [0, 1];
  const room = Math.max(0.08 * (high - low), 0.5 * (span - (high - low)));
  return [low >= 0 && low - room < 0 ? 0 : low - room, high + room];
}
