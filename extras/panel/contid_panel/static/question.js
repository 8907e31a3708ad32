// A question before an order that undoes what another person did. It is not modal: STOP, and every other control,
// works while it is asked, and a stop takes it back.

import { byId } from "./dom.js";

let answer = null; // of the question that is open

/** Ask; true for yes. A further question answers the one before with no. */
export function confirmed(text, yes) {
  cancelQuestion();
  const dialog = byId("confirm");
  dialog.querySelector("p").textContent = text;
  dialog.querySelector("[value=yes]").textContent = yes;
  dialog.show(); // never showModal(): that makes the rest of the page inert, STOP too
  return new Promise((resolve) => { answer = resolve; });
}

/** Take the question back, if there is one. */
export function cancelQuestion() {
  close(false);
}

export function installQuestion() {
  for (const button of byId("confirm").querySelectorAll("button")) button.addEventListener("click", () => close(button.value === "yes"));
  window.addEventListener("keydown", (event) => {
    if (event.key === "Escape") cancelQuestion();
  });
}

function close(yes) {
  const resolve = answer;
  answer = null;
  byId("confirm").close();
  resolve?.(yes);
}
