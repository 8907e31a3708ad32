// How large things are: a ruler along two edges of the floor, the axes of the world, and the width of its squares.

import { h, setText } from "../dom.js";
import { add } from "./gl.js";
import { Mesh } from "./shapes.js";

const AXES = [["x", [0.86, 0.2, 0.2, 1]], ["y", [0.1, 0.56, 0.25, 1]], ["z", [0.16, 0.4, 0.9, 1]]];
const MOST_TICKS = 7; // of one edge
const STEPS = [1, 2, 5, 10, 20, 50, 100];
const LEAST_PX = 34; // between two numbers
const EDGE_PX = 10;

export class Scale {
  /** `element` gets the numbers and letters, above the image. */
  constructor(element, note, renderer) {
    this.element = element;
    this.note = note;
    this.renderer = renderer;
    this.labels = []; // [place, element]
    this.arrows = [];
  }

  /** `floor`: its lines; `cell`: width of its squares; `size` of everything [mm]. */
  describe(floor, cell, size, planar) {
    const points = floor.flat();
    const [left, front] = [0, 1].map((i) => Math.min(...points.map((p) => p[i])));
    const [right, back] = [0, 1].map((i) => Math.max(...points.map((p) => p[i])));
    const ticks = new Mesh();
    this.labels = [];
    this.element.replaceChildren();
    const tick = (at, out, text) => {
      ticks.tube([at, add(at, out, cell * 0.25)], size * 0.0016, 4);
      this.label(add(at, out, cell * 0.6), text, "tick");
    };
    for (const [low, high, place, out] of [[left, right, (v) => [v, front, 0], [0, -1, 0]], [front, back, (v) => [right, v, 0], [1, 0, 0]]]) {
      const step = cell * STEPS.find((each) => (high - low) / (cell * each) <= MOST_TICKS);
      for (let v = Math.ceil(low / step) * step; v <= high + 1e-6; v += step) tick(place(v), out, String(Math.round(v)).replace("-", "−"));
    }
    this.ticks = this.renderer.mesh(...ticks.arrays, this.ticks ?? null);
    const long = size * 0.09;
    this.arrows = AXES.slice(0, planar ? 2 : 3).map(([name, colour], i) => {
      const mesh = new Mesh();
      const end = [0, 1, 2].map((k) => (k === i ? long : 0));
      mesh.tube([[0, 0, 0], end], size * 0.0028, 8);
      mesh.tube([end, end.map((v) => v * 1.18)], (k) => size * (k === 0 ? 0.0075 : 0.0005), 12);
      this.label(end.map((v) => v * 1.32), name, `axis-${name}`);
      return [this.renderer.mesh(...mesh.arrays), colour];
    });
    setText(this.note, `squares of ${cell} mm`);
  }

  label(place, text, className) {
    const element = h("span", { className }, text);
    this.element.append(element);
    this.labels.push([place, element]);
  }

  draw(colour) {
    this.renderer.draw(this.ticks ?? null, colour, { lit: 0 });
    for (const [mesh, own] of this.arrows) this.renderer.draw(mesh, own, { lit: 0.6, over: true });
  }

  /** Letters and numbers where their places are drawn; those that would cover another one are left out. */
  place(camera, canvas) {
    const taken = [];
    for (const [place, element] of [...this.labels].reverse()) { // the letters of the axes first
      const at = camera.project(place, canvas);
      const inside = at && at[0] > EDGE_PX && at[1] > EDGE_PX && at[0] < canvas.clientWidth - EDGE_PX && at[1] < canvas.clientHeight - EDGE_PX;
      const free = inside && taken.every((other) => Math.hypot(other[0] - at[0], 2 * (other[1] - at[1])) > LEAST_PX);
      element.hidden = !free;
      if (!free) continue;
      taken.push(at);
      element.style.transform = `translate(${at[0].toFixed(1)}px, ${at[1].toFixed(1)}px) translate(-50%, -50%)`;
    }
  }
}
