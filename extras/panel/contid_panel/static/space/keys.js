// The camera by the keyboard, for everyone who has no mouse at hand.

const TURN = 0.12; // rad
const ZOOM = 1.12;
const PAN_PX = 24;

/** `view` has a camera, and is redrawn after every key. */
export function installKeys(view) {
  const turns = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  view.canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const { camera } = view;
    if (event.key in turns) {
      const [turn, lift] = turns[event.key];
      if (event.shiftKey) view.pan(turn * PAN_PX, lift * PAN_PX);
      else {
        camera.turn += turn * TURN * camera.flip;
        camera.lift = Math.min(Math.max(camera.lift + lift * TURN, -1.5), 1.5);
      }
    } else if (event.key === "+" || event.key === "=") camera.distance /= ZOOM;
    else if (event.key === "-") camera.distance *= ZOOM;
    else if (event.key === "0") view.reset();
    else return;
    event.preventDefault();
    view.redraw();
  });
}
