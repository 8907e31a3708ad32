// When the page shows what is new: seldom where an image takes long, so that a press of STOP need not wait for it.
//
// An image takes long without a graphics card, or when the machine has other work: the browser then puts off the next
// images that a page asks for. Where those begin later than on an idle machine by more than the noise, an image costs
// the time from the first of them to the last; else it costs nothing.

const IMAGES = 4; // asked for one after the other; the browser has at most two under way
const REFRESH_MS = 1000 / 60; // no screen needs more often
const QUICK_MS = (IMAGES + 1) * REFRESH_MS;
const COST_MS = 15; // a smaller delay is the noise of an idle machine
const SHARE = 4; // pause after an image, in times of its cost
const SOFTWARE_MS = 250; // least pause where a program draws, not a graphics card
const LONGEST_MS = 2000; // also ends the wait for images that never come: those of a hidden page

export class Pace {
  /** `clock` [ms] and `ask`, which calls back at the next image, are the browser's. */
  constructor(clock = () => performance.now(), ask = (then) => requestAnimationFrame(then)) {
    this.clock = clock;
    this.ask = ask;
    this.software = false; // a program draws
    this.began = -Infinity; // when the newest measurement began and ended [ms]
    this.ended = -Infinity;
    this.cost = 0; // of the newest image that was measured [ms]
    this.refresh = Infinity; // shortest time between two images so far [ms]
  }

  /** From the end of an image to the next one [ms]. */
  get pause() {
    return Math.min(Math.max(SHARE * this.cost, this.software ? SOFTWARE_MS : 0), LONGEST_MS);
  }

  /** Until the next image may begin [ms]. */
  wait() {
    const now = this.clock();
    if (this.measuring) return this.pause === 0 && now < this.began + QUICK_MS ? 0 : Math.max(this.began + LONGEST_MS - now, 0);
    return Math.max(this.ended + this.pause - now, 0);
  }

  /** Something changed that the next image has: measures what that costs, unless an image is being measured. */
  begin() {
    if (this.measuring && this.clock() < this.began + LONGEST_MS) return;
    const began = (this.began = this.clock());
    const times = [];
    const next = () => {
      if (this.began !== began) return; // given up, or forgotten
      times.push(this.clock());
      if (times.length < IMAGES) this.ask(next);
      else this.end(times);
    };
    this.ask(next);
  }

  /** An image is being measured, or was given up. */
  get measuring() {
    return this.ended < this.began;
  }

  /** The page was hidden: what it waited for says nothing. */
  forget() {
    this.began = this.ended = -Infinity;
    this.cost = 0;
  }

  /** The measurement is complete: `times` [ms] of the images, one after the other. */
  end(times) {
    const steps = times.slice(1).map((at, i) => at - times[i]);
    this.refresh = Math.max(Math.min(this.refresh, ...steps), REFRESH_MS);
    const took = times.at(-1) - times[0];
    this.cost = took - steps.length * this.refresh > COST_MS ? took : 0;
    this.ended = this.clock();
  }
}
