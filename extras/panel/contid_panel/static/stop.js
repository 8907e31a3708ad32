// The STOP button: always there, by click and by the space bar, with or without the lease.

import { byId, setHidden, setText, toast } from "./dom.js";
import { afterStop } from "./meaning.js";
import { cancelQuestion } from "./question.js";

let installed = () => {};

/** STOP by another control of this page. */
export const stopAll = () => installed();

// From the press, which may have waited for a page that was busy, to the alarm: a panel that hangs neither confirms nor
// refuses. An alarm is due within 1.5 s; the rest is for a page that is busy then, and for drawing it.
const CONFIRM_MS = 1200;
const FAILED = "STOP WAS NOT CONFIRMED. Use the emergency switch of the robot, or `contid estop` in a terminal.";

/** `robots` gives the descriptions of the robots. */
export function installStop(link, robots) {
  const button = byId("stop");
  const alarm = byId("alarm");
  const warn = (text) => {
    setText(alarm, text);
    setHidden(alarm, !text);
  };
  let unconfirmed = null; // since the first press
  const stop = async () => {
    try {
      const pressed = link.clock.pressed();
      const stopping = link.stop(); // before anything is drawn
      cancelQuestion();
      button.classList.add("pressed");
      setTimeout(() => button.classList.remove("pressed"), 600);
      unconfirmed ??= setTimeout(() => warn(FAILED), pressed + CONFIRM_MS - performance.now());
      const result = await stopping;
      clearTimeout(unconfirmed);
      unconfirmed = null;
      const silent = Object.keys(result.silent ?? {});
      warn(silent.length ? `${silent.join(", ")}: devices did not answer and may have missed the stop; look at the robot.` : "");
      if (!silent.length) toast(["All robots were stopped.", ...afterStop(robots(), result.robots ?? {})].join("\n"));
    } catch {
      warn(FAILED);
    }
  };
  installed = stop;
  // On press, not on release: a click is complete only when the button comes up again.
  button.addEventListener("pointerdown", (event) => {
    if (event.button === 0) stop();
  });
  button.addEventListener("click", (event) => {
    if (event.detail === 0) stop(); // by Enter, or by a screen reader
  });
  // Before any other listener: a focused slider or button must not take the space bar.
  for (const kind of ["keydown", "keyup"]) {
    window.addEventListener(
      kind,
      (event) => {
        if (event.code !== "Space" && event.key !== " ") return; // a keyboard on a screen has no codes
        event.preventDefault();
        event.stopImmediatePropagation();
        if (kind === "keydown" && !event.repeat) stop();
      },
      { capture: true },
    );
  }
}
