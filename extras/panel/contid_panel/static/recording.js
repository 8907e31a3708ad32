// Recordings: begin one, end it, what is being recorded, and those of this run. The daemon chooses the file.

import { attempt, byId, h, setHidden, setText, shown, toast } from "./dom.js";

const base = (path) => path.split("/").at(-1);

export class RecordingCard {
  /** `again` shows what was commanded in a recording, to be played. */
  constructor(link, again) {
    this.link = link;
    this.again = again;
    this.current = null;
    this.ended = h("ul", { className: "poses", "aria-label": "Recordings of this run" });
    this.list = h("ul", { className: "recordings" });
    this.none = h("p", { className: "facts" }, "Nothing is recorded.");
    this.button = h("button", { type: "button", disabled: true, onclick: () => this.press() }, "Record");
    byId("recording").append(h("h2", {}, "Recording"), this.none, this.list, this.ended, h("div", { className: "row" }, this.button));
  }

  show(recordings, recorded) {
    const names = recorded.map((each) => each.name).join();
    if (names !== this.names) {
      this.names = names;
      this.ended.replaceChildren(...recorded.map((each) => this.row(each)));
    }
    this.current = recordings.find((each) => !each.whole_run && each.state !== "ending") ?? null;
    setText(this.button, this.current ? "End recording" : "Record");
    this.button.disabled = false;
    setHidden(this.none, recordings.length + recorded.length > 0);
    this.list.replaceChildren(...recordings.map((each) => {
      const missing = each.missed_ticks > 0 ? `; ${each.missed_ticks} ticks are missing, the disk is too slow` : "";
      const what = each.state === "failed" ? "has failed: nothing more is recorded" : each.state !== "recording" ? `is ${each.state}` : `${shown(each.seconds, 0)} s${each.whole_run ? ", the whole run" : `, begun by ${each.by}`}`;
      return h("li", { className: each.state === "recording" ? "live" : "", title: each.file }, h("b", {}, base(each.file)), ` ${what}${missing}`);
    }));
  }

  row({ name, file, seconds }) {
    return h("li", { title: file }, h("b", {}, name), h("span", { className: "facts" }, seconds === null ? "" : `${shown(seconds, 1)} s`),
      h("button", { type: "button", "aria-label": `Check ${name} for playing it again`, title: "Shows what was commanded, checked from where the robots are; then Play", onclick: () => this.again(name) }, "Again"));
  }

  lost() {
    this.button.disabled = true;
  }

  press() {
    const end = this.current !== null;
    this.button.disabled = true; // until the next status
    return attempt(async () => {
      const { file, done } = await this.link.order("record", { end });
      toast(!end ? `Recording ${base(file)}.` : done ? `${base(file)} is complete.` : `${base(file)} has ended and is being compacted.`);
    });
  }
}
