// The server: JSON over HTTP, one WebSocket for what is new, and the token of /api/control.
//
// The socket reconnects by itself with back-off and says so. Every error becomes one sentence.

const FIRST_WAIT_S = 0.5;
const LONGEST_WAIT_S = 10;

const hash = location.hash.slice(1);
const words = new URLSearchParams(hash.includes("=") ? hash : "");

/** The token for faults, from the address: #TOKEN or #token=TOKEN. */
export const token = words.get("token") ?? (hash.includes("=") ? null : hash || null);
/** Where to begin, from the address: #t=12.5&robot=3. */
export const wanted = { t: number(words.get("t")), robot: number(words.get("robot")) };

function number(text) {
  const value = text === null ? NaN : Number(text);
  return Number.isFinite(value) ? value : null;
}

/** An answer that is an error; its message is a sentence for the user. */
export class ServerError extends Error {}

async function answer(response) {
  const text = await response.text();
  let data = null;
  try {
    data = JSON.parse(text);
  } catch {
    // no JSON: what stands in it is no sentence for users
  }
  if (response.ok && data !== null) return data;
  const said = data && (data.error ?? data.detail);
  throw new ServerError(said ? sentence(said) : `The server answered ${response.status} (${response.statusText || "no reason"}).`);
}

function sentence(text) {
  const said = String(text).trim();
  return /[.!?]$/.test(said) ? said : `${said}.`;
}

async function send(path, options) {
  let response;
  try {
    response = await fetch(path, options);
  } catch {
    throw new ServerError("The server does not answer.");
  }
  return answer(response);
}

/** Return the JSON of `api/PATH`; `query` are its parameters. Throws ServerError. */
export function ask(path, query = {}) {
  const said = new URLSearchParams(Object.entries(query).filter(([, value]) => value !== null && value !== undefined));
  const tail = said.toString();
  return send(`api/${path}${tail ? `?${tail}` : ""}`);
}

/** Ask for a fault, or to pause, step or speed up. Throws ServerError. */
export function control(order) {
  const headers = { "Content-Type": "application/json", "X-RMR-Token": token ?? "" };
  return send("api/control", { method: "POST", headers, body: JSON.stringify(order) });
}

/** The WebSocket. `hear(message)` for each message, `tell(connection)` for each change of its state. */
export class Line {
  constructor(hear, tell) {
    this.hear = hear;
    this.tell = tell;
    this.wait = FIRST_WAIT_S;
    this.opened = 0;
    this.connect();
  }

  connect() {
    clearTimeout(this.timer);
    const address = new URL("ws", location.href);
    address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
    address.hash = "";
    const socket = new WebSocket(address);
    this.socket = socket;
    socket.onopen = () => {
      this.opened += 1;
      this.tell({ state: "open", again: this.opened > 1 });
    };
    socket.onmessage = (event) => {
      this.wait = FIRST_WAIT_S; // a server that only opens and closes does not get us out of back-off
      this.hear(JSON.parse(event.data));
    };
    socket.onclose = () => this.socket === socket && this.lost();
  }

  lost() {
    const seconds = this.wait * (0.8 + 0.4 * Math.random());
    this.wait = Math.min(LONGEST_WAIT_S, this.wait * 2);
    this.tell({ state: "lost", retryAt: performance.now() / 1000 + seconds });
    this.timer = setTimeout(() => this.connect(), seconds * 1000);
  }

  /** Try again at once. */
  hurry() {
    this.wait = FIRST_WAIT_S;
    this.connect();
  }
}
