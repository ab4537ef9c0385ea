// The page's two lines to the service: a stream of what is, and orders.

const TOKEN_KEY = "autonomy-token";
// Anything else cannot stand in a WebSocket's subprotocol, and no service takes it for a token.
const SENDABLE = /^[A-Za-z0-9._~-]+$/;
const SILENT_MS = 3000;

export function token() {
  const given = new URLSearchParams(location.hash.slice(1)).get("token");
  if (given) {
    localStorage.setItem(TOKEN_KEY, given);
    history.replaceState(null, "", location.pathname);
  }
  const kept = localStorage.getItem(TOKEN_KEY);
  return kept && SENDABLE.test(kept) ? kept : null;
}

/** True when a token was given, be it one that cannot even be sent. */
export function hasToken() {
  return Boolean(token() ?? localStorage.getItem(TOKEN_KEY));
}

export function keepToken(value) {
  localStorage.setItem(TOKEN_KEY, value);
}

/**
 * Ask the service; resolves to its JSON, throws an Error with its sentence (and `status`).
 * `takenBack` is a signal that ends the asking.
 */
export async function ask(method, path, body, patience = 4000, takenBack = undefined) {
  const headers = {};
  if (token()) headers.Authorization = `Bearer ${token()}`;
  if (body !== undefined) headers["Content-Type"] = "application/json";
  // AbortSignal.any joins two signals, but is younger than the browsers that people have.
  const ending = new AbortController();
  const end = () => ending.abort();
  const impatient = setTimeout(end, patience);
  takenBack?.addEventListener("abort", end);
  if (takenBack?.aborted) end();
  const request = { method, headers, signal: ending.signal };
  if (body !== undefined) request.body = JSON.stringify(body);
  let response, answer;
  // Nothing but the wire in here: fetch's failures and a defect of this page are both TypeErrors.
  try {
    response = await fetch(path, request);
    answer = await jsonOf(response);
  } catch (cause) {
    throw new Error(takenBack?.aborted ? "taken back" : "the service does not answer", { cause });
  } finally {
    clearTimeout(impatient);
    takenBack?.removeEventListener("abort", end);
  }
  if (!response.ok) {
    const error = new Error(answer.error || `the service answered ${response.status}`);
    error.status = response.status;
    throw error;
  }
  return answer;
}

/** What was answered; nothing for what is not JSON, while a broken answer is thrown on. */
async function jsonOf(response) {
  try {
    return await response.json();
  } catch (error) {
    if (error instanceof SyntaxError) return {};
    throw error;
  }
}

/** Save what `path` answers as a file; a plain link could not carry the token. */
export async function save(path, name) {
  const headers = token() ? { Authorization: `Bearer ${token()}` } : {};
  const response = await fetch(path, { headers });
  if (!response.ok) {
    const answer = await jsonOf(response);
    throw new Error(answer.error || `${name} cannot be read`);
  }
  const link = document.createElement("a");
  link.href = URL.createObjectURL(await response.blob());
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/** Keeps one stream open. Calls `onMessage(message)`, `onOpen()`, `onLost()`; comes back by itself. */
export class Stream {
  constructor({ onMessage, onOpen, onLost }) {
    Object.assign(this, { onMessage, onOpen, onLost });
    this.wait = 250;
    this.heardAt = 0;
    setInterval(() => this.hangUpOnSilence(), 500);
    this.open();
  }

  open() {
    const protocols = ["autonomy.v1"];
    if (token()) protocols.push(`bearer.${token()}`);
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/v1/stream`, protocols);
    this.socket = socket;
    socket.onopen = () => {
      this.heardAt = performance.now();
      this.wait = 250;
      this.onOpen();
    };
    socket.onmessage = (event) => {
      this.heardAt = performance.now();
      this.onMessage(JSON.parse(event.data));
    };
    socket.onclose = () => this.lost();
  }

  /** A line that says nothing is no line: dead ones stay open for minutes. */
  hangUpOnSilence() {
    const { socket } = this;
    if (socket.readyState !== WebSocket.OPEN || performance.now() - this.heardAt < SILENT_MS) return;
    // The farewell of a dead line takes as long as its silence: not waited for.
    socket.onmessage = socket.onclose = null;
    socket.close();
    this.lost();
  }

  lost() {
    this.onLost();
    setTimeout(() => this.open(), this.wait);
    this.wait = Math.min(this.wait * 1.7, 3000);
  }
}
