// Named poses of the robots: go there, and save where they are.

import { attempt, byId, h, setHidden, setText, shown, toast } from "./dom.js";
import { confirmed } from "./question.js";

const NAME = "[A-Za-z0-9][A-Za-z0-9_.\\-]{0,63}";

export class PosesCard {
  constructor(link, speed) {
    this.link = link;
    this.speed = speed;
    this.names = new Set();
    this.list = h("ul", { className: "poses" });
    this.none = h("p", { className: "facts" });
    this.robots = h("select", { "aria-label": "Robots of the pose" });
    this.name = h("input", { type: "text", placeholder: "name", pattern: NAME, maxLength: 64, required: true, autocomplete: "off", spellcheck: false, title: "letters, digits, _, - and .", "aria-label": "Name of the pose" });
    this.save = h("button", { type: "submit" }, "Save pose");
    const form = h("form", { className: "row", onsubmit: (event) => { event.preventDefault(); this.saves(); } }, this.name, this.robots, this.save);
    byId("poses").append(h("h2", {}, "Poses"), this.none, this.list, form);
    this.update();
  }

  describe(robots) {
    const names = Object.keys(robots);
    this.robots.replaceChildren(h("option", { value: "" }, "all robots"), ...names.map((name) => h("option", { value: name }, name)));
    setHidden(this.robots, names.length < 2);
  }

  show(message) {
    this.names = new Set(message.poses.map((pose) => pose.name));
    setText(this.none, message.problem || (message.poses.length ? "" : `None in ${message.file} yet.`));
    this.none.classList.toggle("bad", message.problem !== "");
    setHidden(this.none, !this.none.textContent);
    this.list.replaceChildren(...message.poses.map((pose) => this.row(pose)));
    this.update();
  }

  row({ name, target, saved, problem }) {
    const values = Object.entries(target).map(([column, value]) => `${column} ${shown(value, 1)}`).join(", ");
    const go = h("button", { type: "button", "aria-label": `Go to ${name}`, onclick: () => this.goes(name) }, "Go");
    if (problem) go.dataset.unfit = "";
    return h("li", {}, h("b", {}, name), h("span", { className: problem ? "refused" : "facts", title: saved || "written by hand" }, problem || values), go);
  }

  update() {
    const why = this.link.mine ? "" : "take control first";
    for (const button of [this.save, ...this.list.querySelectorAll("button")]) {
      button.disabled = !this.link.mine || "unfit" in button.dataset;
      button.title = why;
    }
  }

  goes(name) {
    return attempt(async () => {
      await this.link.order("pose", { name, share: this.speed.share });
      toast(`On the way to ${name}.`);
    });
  }

  async saves() {
    const name = this.name.value;
    const replace = this.names.has(name);
    if (replace && !(await confirmed(`There is a pose ${name} already. It is replaced by where the robots are now.`, "Replace"))) return;
    // Now: a name that is written until the reply comes stays.
    this.name.value = "";
    await attempt(async () => {
      const sent = this.link.order("save_pose", { name, replace, robots: this.robots.value ? [this.robots.value] : null });
      const { messages } = await sent.catch((error) => {
        this.name.value ||= name;
        throw error;
      });
      toast([`Saved ${name}.`, ...messages].join("\n"));
    });
  }
}
