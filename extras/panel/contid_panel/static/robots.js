// One card per robot: state, fault with its remedy, orders, and sliders for tip and axes.

import { COLORS } from "./plots.js";
import { attempt, h, setHidden, setText, shown, toast } from "./dom.js";
import { confirmed } from "./question.js";

const ARMED = new Set(["HOLD", "RUN", "APPROACH"]);
const JOG_END_MS = 350;
const KEPT_MS = 1000;
const MEANING = {
  OFF: "not commanded, at rest", CONNECTING: "waiting for its devices", READY: "devices answer, not armed",
  ARMING: "torque comes on", APPROACH: "on its way", RUN: "follows its target", HOLD: "holds its position",
  STOPPING: "on its way to rest", FAULT: "stopped by a fault",
};

/** A slider with its name, its value, and the measured value as a mark. */
class Slider {
  constructor(name, minimum, maximum, unit, moved, ended, color = null) {
    this.minimum = minimum;
    this.maximum = maximum;
    this.decimals = maximum - minimum > 20 ? 1 : 3;
    this.held = false;
    this.keptUntil = 0;
    this.mark = h("i", { className: "mark" });
    this.value = h("output", {});
    this.input = h("input", {
      type: "range", min: minimum, max: maximum, step: (maximum - minimum) / 1000, "aria-label": name,
      oninput: () => {
        this.held = true;
        moved();
        clearTimeout(this.timer);
        this.timer = setTimeout(() => this.release(ended), this.pressed ? 1e6 : JOG_END_MS);
      },
      onpointerdown: () => { this.pressed = true; },
      onpointerup: () => this.release(ended),
      onpointercancel: () => this.release(ended),
    });
    this.flag = h("span", { className: "flag" });
    this.row = h("label", { className: "slider" }, axisName(name, color),
      h("span", { className: "track" }, this.mark, this.input), this.value, h("span", { className: "unit" }, unit), this.flag);
  }

  release(ended) {
    clearTimeout(this.timer);
    this.pressed = false;
    if (!this.held) return;
    this.held = false;
    this.keptUntil = performance.now() + KEPT_MS;
    ended();
  }

  get number() {
    return Number(this.input.value);
  }

  show(target, measured, limits) {
    // Shortly after a hand was on it the slider stays: the next press of a key goes on from there.
    if (!this.held && target !== null && performance.now() > this.keptUntil) this.input.value = target;
    setText(this.value, shown(this.held ? this.number : (measured ?? target), this.decimals));
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
    const axes = Object.entries(description.axes);
    this.axes = axes.map(([axis, limit], i) => {
      const unit = Object.keys(limit).find((key) => key.startsWith("min_")).slice(4); // a wrist may be in degrees
      return new Slider(axis, limit[`min_${unit}`], limit[`max_${unit}`], unit, () => this.jogAxes(), () => jog.end(), COLORS[i % COLORS.length]);
    });
    const [low, high] = drawing?.bounds ?? [[], []];
    this.tip = this.tipColumns.map((column, i) => new Slider("xyz"[i], Math.floor(low[i]), Math.ceil(high[i]), "mm", () => this.jogTip(), () => jog.end()));
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
      h("fieldset", {}, h("legend", {}, "Axes"), ...this.axes.map((s) => s.row)),
      this.note);
    this.element.dataset.robot = name;
  }

  jogAxes() {
    this.jog.to(this.name, this.axisColumns, this.axes.map((slider) => slider.number));
  }

  jogTip() {
    this.jog.to(this.name, this.tipColumns, this.tip.map((slider) => slider.number));
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
    for (const slider of [...this.tip, ...this.axes]) if (slider.input.disabled === jogging) slider.input.disabled = !jogging;
    const target = robot.target_mm ?? robot.tip_mm;
    this.tip.forEach((slider, i) => slider.show(target?.[i] ?? null, robot.tip_mm?.[i] ?? null, []));
    this.axes.forEach((slider, i) => slider.show(robot.command[i], robot.measured?.[i] ?? null, robot.limits[i] ?? []));
    setText(this.note, this.jog.active === this.name && this.jog.refused ? `Refused, holds: ${this.jog.refused}` : "");
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
    for (const slider of [...this.tip, ...this.axes]) slider.input.disabled = true;
  }
}
