// The lease, the buses, and the trajectory: what is beside the robots.

import { attempt, byId, h, setHidden, setText, shown, toast } from "./dom.js";
import { request } from "./link.js";
import { confirmed } from "./question.js";

const INPUT = "input"; // how a status names the input of a run

export class LeaseControl {
  constructor(link) {
    this.link = link;
    this.text = h("span", {});
    this.button = h("button", { type: "button", onclick: () => this.press() });
    this.holder = null;
    this.demo = false; // the input of the run may be taken over without a question
    this.element = byId("lease");
    byId("lease").append(this.text, this.button);
  }

  press() {
    return attempt(async () => {
      if (this.link.mine) await this.link.order("release");
      else if (this.demonstrates) await this.link.order("acquire", { takeover: true });
      else if (this.holder === null) await this.link.order("acquire");
      else if (await confirmed(`${this.holder} moves the robots. They hold when you take over.`, "Take over")) {
        await this.link.order("acquire", { takeover: true });
      }
    });
  }

  /** The robots move by themselves. */
  get demonstrates() {
    return this.demo && this.holder === INPUT;
  }

  /** A hand on a robot ends the demonstration: they hold, and this page has control. */
  touched() {
    if (this.demonstrates && !this.link.mine && !this.asked) {
      this.asked = true;
      this.press().finally(() => { this.asked = false; });
    }
  }

  show(lease, readOnly) {
    const mine = this.link.mine;
    this.holder = lease.holder;
    setText(this.text, mine ? "You control" : this.demonstrates ? "Demonstration: touch a robot" : lease.holder === null ? "Lease free" : `Lease: ${lease.holder}`);
    setText(this.button, mine ? "Release" : lease.holder === null || this.demonstrates ? "Take control" : "Take over");
    this.button.className = mine ? "" : "primary";
    setHidden(this.button, readOnly);
    byId("lease").dataset.mine = mine;
    byId("lease").dataset.free = lease.holder === null;
  }
}

export class Machine {
  constructor() {
    this.buses = h("tbody", {});
    this.facts = h("p", { className: "facts" });
    this.warnings = h("ul", { className: "bad" });
    byId("machine").append(h("h2", {}, "Buses"), h("table", {}, this.buses), this.facts, this.warnings);
  }

  show(status) {
    const rows = Object.entries(status.buses).map(([name, bus]) =>
      h("tr", {}, h("th", { scope: "row" }, name), h("td", {}, bus.driver),
        h("td", { className: `tier ${bus.tier}` }, bus.tier), h("td", { className: "number" }, `${shown(bus.age_ms, 1)} ms`),
        h("td", {}, bus.silent.length ? `silent: ${bus.silent.join(", ")}` : "")));
    this.buses.replaceChildren(...rows);
    const took = Object.values(status.robots).reduce((sum, robot) => sum + (robot.tick_ms ?? 0), 0);
    const slowed = status.overload ? `overload: ${status.overload.rate_hz} of ` : "";
    setText(this.facts, `${slowed}${status.rate_hz} Hz · robots ${shown(took, 2)} of ${shown(1e3 / status.rate_hz, 1)} ms${status.realtime ? "" : ", not real time"} · late ${shown(status.lateness_us.max, 0)} µs · ` +
      `skipped ${status.skipped ?? 0} · ${status.clients} clients${status.waiting ? ` · waiting: ${status.waiting}` : ""}`);
    const texts = status.warnings.map((each) => `${Math.round(each.at_s)} s: ${each.message}`);
    if (texts.join() !== this.texts) {
      this.texts = texts.join();
      this.warnings.replaceChildren(...texts.map((text) => h("li", {}, text)));
    }
  }
}

export class TrajectoryCard {
  /** `preview` draws the paths of the tips, null removes them. */
  constructor(link, preview) {
    this.link = link;
    this.preview = preview;
    this.check = null;
    this.file = h("input", { type: "file", accept: ".csv,.ndjson,text/csv", "aria-label": "Trajectory file", onchange: () => this.open() });
    this.result = h("div", { className: "result" });
    this.play = h("button", { type: "button", className: "primary", disabled: true, onclick: () => this.plays() }, "Play");
    byId("trajectory").append(h("h2", {}, "Trajectory"), h("div", { className: "row" }, this.file, this.play), this.result);
  }

  async open() {
    const [file] = this.file.files;
    this.clear();
    if (file === undefined) return;
    await this.checks(file.name, `name=${encodeURIComponent(file.name)}`, file);
    this.file.value = "";
  }

  /** What was commanded in a recording of this run. */
  async again(name) {
    this.clear();
    byId("trajectory").scrollIntoView({ block: "nearest" });
    await this.checks(name, `recording=${encodeURIComponent(name)}`, "");
  }

  clear() {
    this.check = null;
    this.update();
    this.preview(null);
  }

  async checks(name, query, body) {
    this.result.replaceChildren(h("p", {}, `Checking ${name} …`));
    try {
      const found = await request(`/api/check?${query}`, { method: "POST", body });
      if (found.ok) {
        this.check = found.check;
        this.result.replaceChildren(h("p", { className: "good" }, `${found.name}: ${found.rows} rows, ${shown(found.duration_s, 2)} s, every row and the way between is within reach.`));
        this.preview(found.paths);
      } else this.result.replaceChildren(h("ul", { className: "bad" }, ...found.findings.map((text) => h("li", {}, text))));
    } catch (error) {
      this.result.replaceChildren(h("p", { className: "bad" }, error.message));
    }
    this.update();
  }

  update() {
    this.play.disabled = this.check === null || !this.link.mine;
    this.play.title = this.check !== null && !this.link.mine ? "take control first" : "";
  }

  plays() {
    return attempt(async () => {
      await this.link.order("play", { check: this.check });
      toast("The robots go to the first row, then the trajectory plays.");
    });
  }
}
