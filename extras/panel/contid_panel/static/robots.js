// One card per robot: state, fault with its remedy, orders, and sliders for tip and axes.

import { COLORS } from "./plots.js";
import { attempt, h, setHidden, setText, shown, toast } from "./dom.js";
import { confirmed } from "./question.js";

const ARMED = new Set(["HOLD", "RUN", "APPROACH"]);
const MOVING = new Set(["RUN", "APPROACH"]);
const JOG_END_MS = 350;
const KEPT_MS = 1000;
const STEPS = 1000; // of a key, over the range
/** Steps of the keys of a slider. */
const KEYS = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -STEPS / 10, PageUp: STEPS / 10 };
const MEANING = {
  OFF: "not commanded, at rest", CONNECTING: "waiting for its devices", READY: "devices answer, not armed",
  ARMING: "torque comes on", APPROACH: "on its way", RUN: "follows its target", HOLD: "holds its position",
  STOPPING: "on its way to rest", FAULT: "stopped by a fault",
};

/** A slider with its name, its value, and the measured value as a mark.
 *
 * It shows a number and keeps none: a browser rounds and limits what a range input holds. `moved` gets a new number,
 * `stepped` how far a key goes from where the robot was ordered to.
 */
class Slider {
  constructor(name, minimum, maximum, unit, { moved, stepped, ended }, color = null) {
    this.minimum = minimum;
    this.maximum = maximum;
    this.decimals = maximum - minimum > 20 ? 1 : 3;
    this.step = (maximum - minimum) / STEPS;
    this.held = false;
    this.keptUntil = 0;
    this.mark = h("i", { className: "mark" });
    this.value = h("output", {});
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
    this.flag = h("span", { className: "flag" });
    this.row = h("label", { className: "slider" }, axisName(name, color),
      h("span", { className: "track" }, this.mark, this.input), this.value, h("span", { className: "unit" }, unit), this.flag);
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
    setText(this.value, shown(this.held ? Number(this.input.value) : (measured ?? target), this.decimals));
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

export class RobotCard {
  constructor(name, description, drawing, link, jog, selected) {
    this.name = name;
    this.link = link;
    this.jog = jog;
    this.tipColumns = drawing?.tip_columns ?? [];
    this.axisColumns = drawing?.axis_columns ?? [];
    const bends = drawing?.bends ?? [];
    this.bendColumns = bends.map((each) => each.column);
    this.commands = new Map(); // by columns
    const axes = Object.entries(description.axes);
    this.axes = axes.map(([axis, limit], i) => {
      const unit = Object.keys(limit).find((key) => key.startsWith("min_")).slice(4); // a wrist may be in degrees
      return new Slider(axis, limit[`min_${unit}`], limit[`max_${unit}`], unit, this.hand(this.axisColumns, i), COLORS[i % COLORS.length]);
    });
    const [low, high] = drawing?.bounds ?? [[], []];
    this.tip = this.tipColumns.map((column, i) => new Slider("xyz"[i], Math.floor(low[i]), Math.ceil(high[i]), "mm", this.hand(this.tipColumns, i)));
    this.bends = bends.map((each, i) => new Slider(each.name, each.minimum, each.maximum, each.unit, this.hand(this.bendColumns, i)));
    this.sliders = [...this.tip, ...this.bends, ...this.axes];
    this.state = h("span", { className: "state" });
    this.meaning = h("span", { className: "meaning" });
    this.fault = h("div", { className: "fault", hidden: true });
    this.note = h("p", { className: "refused", "aria-live": "polite" });
    this.clear = h("button", { type: "button", className: "clear", onclick: () => this.order("clear_fault") }, "Clear fault");
    this.hold = h("button", { type: "button", onclick: () => this.order("hold") }, "Hold");
    this.resume = h("button", { type: "button", onclick: () => this.resumes() }, "Resume");
    this.rest = h("button", { type: "button", onclick: () => this.order("stop"), title: "Stop by the policy of the robot file" }, "Stop");
    this.recover = h("button", { type: "button", hidden: true, onclick: () => this.order("recover") }, "Recover");
    this.element = h("article", { className: "card robot", onpointerdown: () => selected(name) },
      h("header", {}, h("h2", {}, name), this.state, this.meaning),
      this.fault,
      h("div", { className: "orders" }, this.hold, this.resume, this.rest, this.recover, this.clear),
      this.tip.length ? h("fieldset", {}, h("legend", {}, "Tip"), ...this.tip.map((s) => s.row)) : null,
      this.bends.length ? h("fieldset", {}, h("legend", {}, "Bends"), ...this.bends.map((s) => s.row)) : null,
      h("fieldset", {}, h("legend", {}, "Axes"), ...this.axes.map((s) => s.row)),
      this.note);
    this.element.dataset.robot = name;
  }

  /** What a hand on the slider of one column does: the robot goes to what was ordered last, with that number replaced. */
  hand(columns, i) {
    const to = (value, row) => {
      if (row === null || row.some((each) => each === null)) return null;
      this.jog.to(this.name, columns, row.map((each, k) => (k === i ? value : each)));
      return value;
    };
    return {
      moved: (value) => to(value, this.ordered(columns)),
      stepped: (step, minimum, maximum) => {
        const row = this.ordered(columns);
        return row === null ? null : to(Math.min(Math.max(row[i] + step, minimum), maximum), row);
      },
      ended: () => this.jog.end(),
    };
  }

  /** The numbers of columns that were ordered last: of the jog that goes on, else where the robot was commanded to. */
  ordered(columns) {
    return this.jog.ordered(this.name, columns) ?? this.commands.get(columns) ?? null;
  }

  order(verb) {
    return attempt(async () => {
      const result = await this.link.order(verb, { robots: [this.name] });
      if (result.refused) toast(Object.values(result.refused).join("; "), "error");
    });
  }

  async resumes() {
    if (this.stoppedBy && !(await confirmed(`${this.stoppedBy} stopped the robots. Look at them before they are armed again.`, "Resume"))) return;
    this.order("resume");
  }

  /** The newest frame: what moves. */
  frame(robot) {
    setText(this.state, robot.state);
    setText(this.meaning, MEANING[robot.state] ?? "");
    this.element.dataset.state = robot.state;
    const jogging = this.link.mine && ARMED.has(robot.state);
    for (const slider of this.sliders) if (slider.input.disabled === jogging) slider.input.disabled = !jogging;
    this.commands.set(this.tipColumns, robot.command_tip_mm?.slice(0, this.tipColumns.length) ?? null);
    this.commands.set(this.axisColumns, robot.command);
    this.commands.set(this.bendColumns, robot.bends);
    if (!MOVING.has(robot.state)) this.jog.arrived(this.name);
    const target = robot.target_mm ?? robot.command_tip_mm;
    this.tip.forEach((slider, i) => slider.show(target?.[i] ?? null, robot.tip_mm?.[i] ?? null, []));
    this.bends.forEach((slider, i) => slider.show(robot.bends?.[i] ?? null, null, []));
    this.axes.forEach((slider, i) => slider.show(robot.command[i], robot.measured?.[i] ?? null, robot.limits[i] ?? []));
    const refusal = this.jog.refusals.get(this.name);
    setText(this.note, refusal ? `Refused, holds: ${refusal}` : "");
    setHidden(this.clear, robot.state !== "FAULT");
    if (robot.state !== "FAULT") setHidden(this.fault, true);
  }

  /** The newest status: the fault in full. */
  status(robot, lease) {
    this.stoppedBy = lease.stopped_by ?? null;
    this.element.dataset.stoppedBy = this.stoppedBy ?? "";
    // A status is older than the newest frame: a fault that was cleared meanwhile is not shown again.
    const fault = this.element.dataset.state === "FAULT" ? robot.fault : null;
    setHidden(this.fault, !fault);
    setHidden(this.recover, fault?.number !== 109);
    if (!fault) return;
    const text = `${fault.number}:${fault.what}`;
    if (this.shownFault === text) return;
    this.shownFault = text;
    this.fault.replaceChildren(
      h("strong", {}, `Fault ${fault.number}: ${fault.name.replaceAll("-", " ")}`), h("p", {}, fault.what),
      h("dl", {}, h("dt", {}, "Cause"), h("dd", {}, fault.cause), h("dt", {}, "Reaction"), h("dd", {}, fault.reaction),
        h("dt", {}, "Remedy"), h("dd", {}, fault.remedy), h("dt", {}, "Page"), h("dd", {}, h("code", {}, fault.page))));
  }

  /** Nothing is known any more. */
  lost() {
    this.element.dataset.state = "LOST";
    setText(this.state, "UNKNOWN");
    setText(this.meaning, "no connection to the daemon");
    for (const slider of this.sliders) slider.input.disabled = true;
  }
}
