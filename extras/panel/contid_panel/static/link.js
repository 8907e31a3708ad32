// The connection to the panel: orders and replies, the heartbeat of the lease, reconnection.
//
// The heartbeat runs only while this page is visible and its script runs. A page that is hidden gives the lease
// back and holds; one that is frozen or closed falls silent, the lease lapses, and the robots hold.

import { Clock } from "./clock.js";

const BEAT_MS = 200;
const RETRY_MS = 500;
const REPLY_TIMEOUT_MS = 15000;
const token = location.hash.slice(1);
const headers = { Authorization: `Bearer ${token}` };

export class Refusal extends Error {
  constructor(error) {
    super(error.message);
    this.code = error.code;
  }
}

export class Link {
  /** `received` gets every message of the panel, `changed` every change of the connection. */
  constructor(received, changed) {
    this.received = received;
    this.changed = changed;
    this.open = false;
    this.mine = false;
    this.waiting = new Map();
    this.number = 0;
    this.clock = new Clock();
    this.ordered = () => {}; // told of every order
    document.addEventListener("visibilitychange", () => { if (document.visibilityState !== "visible") this.leave(); });
    window.addEventListener("pagehide", () => this.leave());
    setInterval(() => this.beat(), BEAT_MS);
    this.connect();
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(`${scheme}//${location.host}/socket`, ["contid.panel", `contid.token.${token || "none"}`]);
    this.socket = socket;
    let opened = false;
    socket.onopen = () => {
      opened = true;
      this.clock.forget();
      this.set(true, "");
    };
    socket.onmessage = (event) => this.take(JSON.parse(event.data));
    socket.onclose = (event) => this.closed(event, opened);
  }

  set(open, reason) {
    this.open = open;
    if (!open) this.mine = false;
    this.changed(open, reason);
  }

  take(message) {
    if (message.clock_ms !== undefined) this.clock.take(message.clock_ms);
    if (message.kind === "reply") {
      const waiting = this.waiting.get(message.id);
      this.waiting.delete(message.id);
      if (waiting !== undefined) message.ok ? waiting.resolve(message.result) : waiting.reject(new Refusal(message.error));
    }
    this.received(message);
  }

  async closed(event, opened) {
    for (const waiting of this.waiting.values()) waiting.reject(new Refusal({ code: "lost", message: "the connection to the panel ended" }));
    this.waiting.clear();
    this.set(false, event.reason || (opened ? "it ended, and is made again" : await reason()));
    setTimeout(() => this.connect(), RETRY_MS);
  }

  /** Send an order; its result, or a Refusal. It is valid for a second from when it was pressed; stops never expire. */
  order(verb, fields = {}, pressed = this.clock.pressed()) {
    return new Promise((resolve, reject) => {
      if (!this.open) {
        reject(new Refusal({ code: "lost", message: "no connection to the panel" }));
        return;
      }
      this.ordered(verb);
      const id = ++this.number;
      this.waiting.set(id, { resolve, reject });
      setTimeout(() => {
        if (this.waiting.delete(id)) reject(new Refusal({ code: "no-answer", message: `no reply to ${verb}; look at the robots` }));
      }, REPLY_TIMEOUT_MS);
      this.socket.send(JSON.stringify({ id, verb, pressed_ms: this.clock.ofPanel(pressed), ...fields }));
    });
  }

  /** Stop all robots on every way there is: the socket, and a request if that one does not answer. */
  async stop() {
    const ways = this.open ? [this.order("estop")] : []; // first: to begin a request takes a millisecond
    ways.push(request("/api/estop", { method: "POST", keepalive: true }));
    return Promise.any(ways);
  }

  beat() {
    if (this.open && this.mine && document.visibilityState === "visible") this.socket.send(JSON.stringify({ verb: "beat", pressed_ms: this.clock.ofPanel(performance.now()) }));
  }

  /** Hold and give the lease back, as this page is not looked at any more. */
  leave() {
    if (!this.open || !this.mine) return;
    this.mine = false;
    this.socket.send('{"verb":"hold"}');
    this.socket.send('{"verb":"release"}');
  }
}

/** A request with the token; the parsed response. */
export async function request(path, options = {}) {
  const response = await fetch(path, { ...options, headers });
  if (!response.ok) throw new Refusal({ code: String(response.status), message: (await response.text()).trim() });
  return response.json();
}

async function reason() {
  try {
    await request("/api/hello");
    return "the panel refuses a further page; close another one";
  } catch (error) {
    return error instanceof Refusal ? error.message : "the panel does not answer";
  }
}
