// A gamepad moves the tip of the selected robot while its shoulder button is held: a dead man's switch.
//
// The browser reads it, and only while the page is looked at. Button 1 (B, or the circle) is STOP.

const PERIOD_MS = 50;
const DEAD_ZONE = 0.15;
const ENABLE = [4, 5]; // either shoulder button
const STOP_BUTTON = 1;
const STICKS = [[0, 1], [1, -1], [3, -1]]; // axis of the pad and its sign, for x, y, z

export class Gamepad {
  /** `selected` gives the card of the selected robot. */
  constructor(jog, speed, selected, stop) {
    this.jog = jog;
    this.speed = speed;
    this.selected = selected;
    this.stop = stop;
    this.moving = null;
    this.pressed = false;
    window.addEventListener("gamepadconnected", () => { this.timer ??= setInterval(() => this.read(), PERIOD_MS); });
  }

  read() {
    const pad = navigator.getGamepads().find((each) => each?.connected) ?? null;
    const stops = pad?.buttons[STOP_BUTTON]?.pressed ?? false;
    if (stops && !this.pressed) this.stop();
    this.pressed = stops;
    const held = pad !== null && document.visibilityState === "visible" && ENABLE.some((i) => pad.buttons[i]?.pressed);
    const push = held ? STICKS.map(([axis, sign]) => sign * beyond(pad.axes[axis] ?? 0)) : [];
    const card = this.selected();
    const row = card?.ordered(card.tipColumns);
    if (stops || !push.some((each) => each !== 0) || !row || row.some((each) => each === null) || card.home.disabled) {
      if (this.moving) this.jog.end();
      this.moving = null;
      return;
    }
    if (this.moving && this.moving !== card) this.jog.end();
    this.moving = card;
    const way = (card.rates[card.tipColumns[0]] ?? 0) * this.speed.share * (PERIOD_MS / 1e3);
    this.jog.to(card.name, card.tipColumns, row.map((each, i) => each + way * push[i]));
  }
}

/** Nothing near the middle, then from 0 on, finer near it. */
function beyond(value) {
  const size = Math.max(Math.abs(value) - DEAD_ZONE, 0) / (1 - DEAD_ZONE);
  return Math.sign(value) * size * size;
}
