// Past flights: their reports, their logs, and a look back through one with the live page's view.

import { ask, save, token } from "./link.js";
import { $, say } from "./elements.js";
import { Reel } from "./scene.js";

const SHOWN = 20;
const READING_MS = 310000;
const PLAY_MS = 100;
const SHARE_MS = 500;
const BUSY = 429;
const BUSY_MS = 1000;

/** Looks back at one flight at a time. Calls `onScene(scene, reel)` at each moment, `onLive()` after. */
export class LookBack {
  constructor({ onScene, onLive }) {
    Object.assign(this, { onScene, onLive });
    this.reel = null;
    this.playing = null;
    this.reading = null;
    $("reading-cancel").onclick = () => this.reading?.abort();
    $("back-slider").oninput = () => this.at($("back-slider").valueAsNumber);
    $("back-play").onclick = () => (this.playing ? this.pause() : this.play());
    $("back-live").onclick = () => this.close();
    $("back-before").onclick = () => this.step(-1);
    $("back-after").onclick = () => this.step(1);
    $("back").addEventListener("keydown", (event) => {
      if (event.key === "Escape") this.close();
    });
  }

  async open(name) {
    this.pause();
    const reel = await this.read(name);
    if (!reel) return;
    this.reel = reel;
    document.body.classList.add("looking-back");
    $("back").hidden = false;
    $("back-name").textContent = name;
    const slider = $("back-slider");
    slider.max = this.reel.duration.toFixed(1);
    this.at(0);
    slider.focus();
  }

  /** The flight, or null: it cannot be read, was taken back, or another one is read instead. */
  async read(name) {
    this.reading?.abort();
    const reading = this.reading = new AbortController();
    say("");
    $("reading-name").textContent = name;
    $("reading-share").value = 0;
    $("reading").hidden = false;
    const watching = setInterval(() => this.showShare(name, reading), SHARE_MS);
    try {
      return new Reel(await this.asked(name, reading.signal));
    } catch (error) {
      if (!reading.signal.aborted) say(error.message, true);
      else if (reading === this.reading) say(`${name} is not read any further`);
      return null;
    } finally {
      clearInterval(watching);
      if (reading === this.reading) {
        this.reading = null;
        $("reading").hidden = true;
      }
    }
  }

  /** The flight's messages. Who was just taken back is being ended: asked again once, a moment later. */
  async asked(name, takenBack) {
    const once = () => ask("GET", path(name, "reel"), undefined, READING_MS, takenBack);
    try {
      return await once();
    } catch (error) {
      if (error.status !== BUSY) throw error;
    }
    await new Promise((resolve) => setTimeout(resolve, BUSY_MS));
    return once();
  }

  async showShare(name, reading) {
    const { log, share } = await ask("GET", "/v1/reading").catch(() => ({}));
    if (log === name && reading === this.reading) $("reading-share").value = share;
  }

  get isOpen() {
    return this.reel !== null;
  }

  at(seconds) {
    const time = Math.min(this.reel.duration, Math.max(0, seconds));
    this.time = time;
    const scene = this.reel.scene(time);
    const slider = $("back-slider");
    slider.value = time.toFixed(1);
    const text = `${time.toFixed(1)} of ${this.reel.duration.toFixed(1)} s`;
    $("back-time").textContent = text;
    slider.setAttribute("aria-valuetext", `${text}: ${scene.state.flight?.state ?? ""}, ${scene.state.why}`);
    this.onScene(scene, this.reel, time);
  }

  /** To the event before or after this moment. */
  step(way) {
    this.pause();
    const times = this.reel.events.map((event) => event.at);
    const next = way > 0
      ? times.find((at) => at > this.time + 0.05)
      : times.findLast((at) => at < this.time - 0.05);
    // Up to the next frame, in which the event is told.
    this.at(next === undefined ? (way > 0 ? this.reel.duration : 0) : Math.ceil(next * 10) / 10);
  }

  play() {
    if (this.time >= this.reel.duration) this.at(0);
    let before = performance.now();
    this.playing = setInterval(() => {
      const now = performance.now();
      this.at(this.time + (now - before) / 1000);
      before = now;
      if (this.time >= this.reel.duration) this.pause();
    }, PLAY_MS);
    $("back-play").textContent = "Pause";
  }

  pause() {
    clearInterval(this.playing);
    this.playing = null;
    $("back-play").textContent = "Play";
  }

  close() {
    this.pause();
    this.reel = null;
    $("back").hidden = true;
    document.body.classList.remove("looking-back");
    this.onLive();
    $("map").focus();
  }
}

const path = (name, what) => `/v1/logs/${encodeURIComponent(name)}${what ? `/${what}` : ""}`;

function button(text, label, onclick) {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = text;
  made.setAttribute("aria-label", label);
  made.onclick = () => onclick().catch((error) => say(error.message, true));
  return made;
}

function told(log) {
  const when = new Date(log.modified_utc).toLocaleString();
  const report = log.report;
  if (!report) return `${when}: ${log.name}`;
  return `${when}: ${report.ending.replaceAll("_", " ")}, ${report.path_length_m.toFixed(1)} m in ` +
    `${report.flight_time_s.toFixed(0)} s, ${report.stops} ${report.stops === 1 ? "stop" : "stops"}. ${report.why}`;
}

/** The list of past flights, each with what can be had of it. */
export async function listFlights(lookBack) {
  let logs;
  try {
    logs = await ask("GET", "/v1/logs");
  } catch {
    return;
  }
  const items = logs.slice(0, SHOWN).map((log) => {
    const { name } = log;
    const item = document.createElement("li");
    const text = document.createElement("span");
    text.textContent = told(log);
    const row = document.createElement("div");
    row.className = "row";
    row.append(
      button("look back", `Look back at ${name}`, () => lookBack.open(name)),
      button("report", `Report of ${name}`, () => report(name)),
      button("log", `Save the log ${name}`, () => save(path(name), name)),
    );
    item.append(text, row);
    return item;
  });
  if (items.length) $("flights").replaceChildren(...items);
}

/** In a window of its own; where a token is asked for, a link cannot carry it: as a file. */
async function report(name) {
  if (!token()) return window.open(path(name, "report"), "_blank", "noopener");
  say(`making the report of ${name} ...`);
  await save(path(name, "report"), `${name}.html`);
  return say("");
}
