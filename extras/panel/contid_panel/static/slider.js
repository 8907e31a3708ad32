// One coordinate of a robot: a slider, a number to type, and the measured value as a mark and in figures.

import { h, setHidden, setText, shown, toast } from "./dom.js";

const JOG_END_MS = 350;
const KEPT_MS = 1000;
const STEPS = 1000; // of a key, over the range
/** Steps of the keys of a slider. */
const KEYS = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -STEPS / 10, PageUp: STEPS / 10 };

/** A slider with its name, its value, and the measured value as a mark.
 *
 * It shows a number and keeps none: a browser rounds and limits what a range input holds. `moved` gets a new number,
 * `stepped` how far a key goes from where the robot was ordered to, `typed` a number that was entered.
 */
export class Slider {
  constructor(name, minimum, maximum, unit, { moved, stepped, ended, typed }, color = null) {
    this.minimum = minimum;
    this.maximum = maximum;
    this.decimals = maximum - minimum > 20 ? 1 : 3;
    this.step = (maximum - minimum) / STEPS;
    this.held = false;
    this.keptUntil = 0;
    this.mark = h("i", { className: "mark" });
    this.value = h("output", { title: "measured" });
    this.input = h("input", {
      type: "range", min: minimum, max: maximum, step: "any", "aria-label": name,
      oninput: () => {
        this.hold(ended);
        moved(Number(this.input.value));
      },
      onkeydown: (event) => {
        const steps = KEYS[event.key];
        if (steps === undefined || event.ctrlKey || event.altKey || event.metaKey) return;
        event.preventDefault();
        this.hold(ended);
        const value = stepped(steps * this.step, this.minimum, this.maximum);
        if (value !== null) this.input.value = value;
      },
      onpointerdown: () => { this.pressed = true; },
      onpointerup: () => this.release(ended),
      onpointercancel: () => this.release(ended),
    });
    this.typed = typed;
    this.ended = ended;
    this.name = name;
    this.unit = unit;
    this.number = h("input", {
      type: "text", inputMode: "decimal", autocomplete: "off", className: "entry", "aria-label": `${name} in ${unit}, number`,
      title: "A number and Enter: the robot goes there. Escape: it stays.",
      onkeydown: (event) => {
        if (event.key === "Enter") this.enter();
        else if (event.key === "Escape") this.leave();
      },
      onfocus: () => this.number.select(),
      onblur: () => this.leave(), // nothing moves because a field was left
    });
    this.flag = h("span", { className: "flag" });
    this.row = h("div", { className: "slider" }, axisName(name, color),
      h("span", { className: "track" }, this.mark, this.input), this.number, h("span", { className: "unit" }, unit), this.value, this.flag);
  }

  hold(ended) {
    this.held = true;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.release(ended), this.pressed ? 1e6 : JOG_END_MS);
  }

  release(ended) {
    clearTimeout(this.timer);
    this.pressed = false;
    if (!this.held) return;
    this.held = false;
    this.keptUntil = performance.now() + KEPT_MS;
    ended();
  }

  enter() {
    const text = this.number.value.trim().replace(",", ".").replace("−", "-");
    const value = Number(text);
    const problem = text === "" || !Number.isFinite(value) ? `${this.name}: ${text === "" ? "nothing" : text} is no number.` : "";
    this.number.setAttribute("aria-invalid", problem !== "");
    if (problem) {
      toast(problem, "error");
      return;
    }
    this.number.blur();
    this.typed(value);
  }

  /** What was typed and not entered is dropped. */
  leave() {
    this.number.removeAttribute("aria-invalid");
    this.number.value = this.shownNumber ?? "";
    if (document.activeElement === this.number) this.number.blur();
  }

  /** A hand on a slider that is disabled is off: a browser tells of no end of its drag. */
  disable(disabled) {
    if (disabled && this.held) this.release(this.ended);
    for (const each of [this.input, this.number]) if (each.disabled !== disabled) each.disabled = disabled;
  }

  /** The range contains where the robot is. */
  include(value) {
    if (value === null || (value >= this.minimum && value <= this.maximum)) return;
    this.input.min = this.minimum = Math.min(this.minimum, Math.floor(value));
    this.input.max = this.maximum = Math.max(this.maximum, Math.ceil(value));
  }

  show(target, measured, limits) {
    this.include(target);
    // Shortly after a hand was on it the slider stays: what it shows must not jump back on the way.
    if (!this.held && target !== null && performance.now() > this.keptUntil) this.input.value = target;
    setText(this.value, measured === null ? "" : shown(measured, this.decimals));
    this.shownNumber = shown(this.held ? Number(this.input.value) : target, this.decimals);
    if (document.activeElement !== this.number && this.number.value !== this.shownNumber) this.number.value = this.shownNumber;
    const share = measured === null ? -1 : (measured - this.minimum) / (this.maximum - this.minimum);
    setHidden(this.mark, share < 0);
    const inside = Math.min(Math.max(share, 0), 1); // the thumb stays within the track, half its width from the ends
    this.mark.style.left = `calc(${100 * inside}% + ${8 - 16 * inside}px)`;
    setText(this.flag, limits.join(", "));
  }
}

/** The name of an axis, with the color of its curve in the plots. */
function axisName(name, color) {
  const dot = h("i", { className: "dot", hidden: color === null });
  if (color !== null) dot.style.background = color;
  return h("span", { className: "axis" }, dot, name);
}
