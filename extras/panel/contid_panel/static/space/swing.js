// How a robot swings: one of its modes at a time, drawn large over the robot, at its own frequency or slower.

import { attempt, h, setText, shown } from "../dom.js";
import { request } from "../link.js";
import { Mesh, smooth } from "./shapes.js";

const FASTEST_HZ = 3; // that an eye follows
const SOFTWARE_HZ = 0.6; // that four images a second show
const LASTS_MS = 20000;

/** A button on the card of a robot: a press shows its slowest mode, further ones the next, the last none. */
export class SwingButton {
  constructor(name, view) {
    Object.assign(this, { name, view, modes: [], next: 0 });
    this.button = h("button", { type: "button", onclick: () => attempt(() => this.press()), title: "Draw how the body swings; the robot does not move" }, "Swing");
    this.note = h("span", { className: "meaning", "aria-live": "polite" });
    this.element = h("div", { className: "swing" }, this.button, this.note);
  }

  async press() {
    if (this.next === 0) this.modes = (await request(`/api/modes?robot=${encodeURIComponent(this.name)}`)).modes;
    const mode = this.modes[this.next];
    this.next = mode ? this.next + 1 : 0;
    const fastest = this.view.pace.software ? SOFTWARE_HZ : FASTEST_HZ;
    this.view.swing(this.name, mode ? new Swing(mode, fastest, () => this.ended()) : null);
    const slower = mode && mode.frequency_hz > fastest ? `, drawn ${shown(mode.frequency_hz / fastest)} times as slow` : "";
    setText(this.note, mode ? `mode ${this.next} of ${this.modes.length}: ${shown(mode.frequency_hz, 2)} Hz, damping ratio ${shown(mode.ratio, 3)}${slower}` : "");
  }

  ended() {
    this.next = 0;
    setText(this.note, "");
  }
}

/** One mode that is drawn for a while. */
export class Swing {
  constructor(mode, fastest, ended) {
    this.lines = mode.lines;
    this.rate = (2 * Math.PI * Math.min(mode.frequency_hz, fastest)) / 1000;
    this.began = performance.now();
    this.ended = ended;
  }

  get over() {
    return performance.now() - this.began > LASTS_MS;
  }

  /** The body now: through the three lines that are known, which keeps its length. */
  body(radius) {
    const share = Math.sin(this.rate * (performance.now() - this.began));
    const [low, rest, high] = this.lines;
    return tube(rest.map((at, i) => at.map((v, x) => v + (share * (high[i][x] - low[i][x])) / 2 + share * share * ((high[i][x] + low[i][x]) / 2 - v))), radius);
  }

  /** Where it turns around, on both sides. */
  ends(radius) {
    const mesh = new Mesh();
    for (const line of [this.lines[0], this.lines[2]]) mesh.tube(smooth(line, 2), radius, 12);
    return mesh;
  }
}

function tube(line, radius) {
  const mesh = new Mesh();
  mesh.tube(smooth(line, 2), radius, 12);
  return mesh;
}
