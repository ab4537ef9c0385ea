// The page: what is told, what is asked for.

import { $, put, say } from "./elements.js";
import { listFlights, LookBack } from "./flights.js";
import { ask, hasToken, keepToken, Stream } from "./link.js";
import { RoomMap } from "./map.js";
import { Scene } from "./scene.js";
import { showWords } from "./words.js";

const STALE_MS = 1500;
const EVENTS_SHOWN = 60;

const live = new Scene();
const liveEvents = [];
let heardAt = 0;
let connected = false;

const map = new RoomMap($("map"), {
  onPick: (point) => propose(point),
  onHover: ([n, e]) => { $("hover").textContent = `N ${n.toFixed(2)}  E ${e.toFixed(2)}`; },
});
map.show(live);
$("zoom-in").onclick = () => map.zoom(1.4);
$("zoom-out").onclick = () => map.zoom(1 / 1.4);
$("zoom-all").onclick = () => map.showAll();

// ---------------------------------------------------------------- what was

const lookBack = new LookBack({
  onScene: (scene, reel, seconds) => {
    map.show(scene);
    showWords(scene.state);
    showReelEvents(reel, seconds);
  },
  onLive: () => {
    map.show(live);
    map.touchGround();
    $("events").replaceChildren(...liveEvents.map(eventItem));
    if (live.state) showWords(live.state);
  },
});
const flights = () => listFlights(lookBack);

/** All that happened in the flight, newest first; what is yet to come is pale. Each leads there. */
function showReelEvents(reel, seconds) {
  const list = $("events");
  if (list.dataset.log !== reel.log || !list.querySelector("button")) {
    list.dataset.log = reel.log;
    list.replaceChildren(...reel.events.toReversed().map((event) => {
      const item = document.createElement("li");
      const button = document.createElement("button");
      button.type = "button";
      button.onclick = () => lookBack.at(Math.ceil(event.at * 10) / 10);
      button.append(timeOf(`${event.at.toFixed(1)} s`), event.why);
      item.append(button);
      item.dataset.at = event.at;
      return item;
    }));
  }
  for (const item of list.children) item.classList.toggle("later", Number(item.dataset.at) > seconds + 0.15);
}

// ---------------------------------------------------------------- what is

setInterval(() => {
  const stale = !connected || performance.now() - heardAt > STALE_MS;
  $("map").classList.toggle("stale", stale && !lookBack.isOpen);
  $("link-lost").hidden = !stale;
  // What was true when the line broke may be true no more.
  $("phase").hidden = stale && live.state !== null;
  $("link-lost").textContent = connected ? "no news from the service" : "no connection to the service";
}, 250);

/** The phase and the orders are always of now; the rest is, unless a past flight is looked at. */
function show(state) {
  put("phase", state.phase, `pill ${state.phase}`);
  put("hold", held() ? "Go on" : "Hold", "land");
  if (!lookBack.isOpen) showWords(state);
}

/** How the last mission ended stays to be read when the service has gone on to being ready. */
async function showLastEnding(phase) {
  $("last-ending").hidden = true;
  if (phase === "flying") return;
  const missions = await ask("GET", "/v1/missions").catch(() => []);
  const over = missions.filter((mission) => mission.ending);
  if (!over.length || live.state?.phase === "flying") return;
  const last = over.reduce((a, b) => (b.created_utc > a.created_utc ? b : a));
  put("last-ending", `Last mission: ${last.ending.replaceAll("_", " ")}. ${last.why}`, "quiet small");
  $("last-ending").hidden = false;
}

function timeOf(text, stamp) {
  const time = document.createElement("time");
  if (stamp) time.dateTime = stamp;
  time.textContent = text;
  return time;
}

function eventItem(event) {
  const item = document.createElement("li");
  item.append(timeOf(new Date(event.time_utc).toLocaleTimeString(), event.time_utc), event.why);
  return item;
}

function addEvent(event) {
  liveEvents.unshift(event);
  liveEvents.length = Math.min(liveEvents.length, EVENTS_SHOWN);
  if (unanswered) {
    unanswered = false;
    say(event.name === "refused" ? event.why : "", event.name === "refused");
  }
  if (lookBack.isOpen) return;
  const list = $("events");
  list.prepend(eventItem(event));
  while (list.children.length > EVENTS_SHOWN) list.lastChild.remove();
}

// ---------------------------------------------------------------- orders

// What comes of an order is an event, which takes the place of "asked".
let unanswered = false;

async function order(name) {
  unanswered = true;
  say(`${name}: asked`);
  try {
    await ask("POST", `/v1/${name}`);
  } catch (error) {
    unanswered = false;
    if (error.status === 401) askToken();
    say(error.status ? error.message : `${name} did not reach the service: ${error.message}`, true);
  }
}

$("stop").onclick = () => order("stop");
$("land").onclick = () => order("land");
// Held: the same button lets it go on.
function held() {
  return live.state?.flight?.state === "hold" && live.state.why.startsWith("held by the operator");
}
$("hold").onclick = () => order(held() ? "resume" : "hold");
document.addEventListener("keydown", (event) => {
  const writing = event.target.matches("input, textarea");
  if (event.key.toLowerCase() === "s" && !writing && !event.ctrlKey && !event.metaKey && !event.altKey) {
    event.preventDefault();
    order("stop");
  }
});

// ---------------------------------------------------------------- a goal

function propose([north, east]) {
  const { state, room } = live;
  if (lookBack.isOpen) return say("this is a past flight; go back to live to fly", true);
  if (!connected || !state) return say("not connected to the service", true);
  if (state.phase !== "ready") {
    return say(state.phase === "flying" ? "a mission is being flown; stop it first" : state.why, true);
  }
  map.asked = [north, east];
  map.draw();
  $("ask-north").value = north.toFixed(2);
  $("ask-east").value = east.toFixed(2);
  $("ask-height").value = (room?.altitude_m ?? 1).toFixed(1);
  $("ask-error").textContent = "";
  where();
  $("ask").showModal();
  $("ask-cancel").focus();
}

function where() {
  const [north, east] = [$("ask-north").valueAsNumber, $("ask-east").valueAsNumber];
  const from = live.state?.vehicle?.position ?? [0, 0];
  const far = Math.hypot(north - from[0], east - from[1]);
  $("ask-where").textContent = Number.isFinite(far)
    ? `The vehicle takes off and flies ${far.toFixed(1)} m as the crow flies.`
    : "Give north and east in metres.";
  if (Number.isFinite(far)) { map.asked = [north, east]; map.draw(); }
}
$("ask-north").oninput = $("ask-east").oninput = where;
$("ask-cancel").onclick = () => $("ask").close();
$("ask").addEventListener("close", () => { map.asked = null; map.draw(); $("map").focus(); });
$("ask").querySelector("form").addEventListener("submit", async (event) => {
  event.preventDefault();
  $("ask-fly").disabled = true;
  try {
    await ask("POST", "/v1/missions", {
      goals: [[$("ask-north").valueAsNumber, $("ask-east").valueAsNumber]],
      altitude_m: $("ask-height").valueAsNumber,
      land: $("ask-land").checked,
    });
    say("");
    $("ask").close();
  } catch (error) {
    $("ask-error").textContent = error.message;
  } finally {
    $("ask-fly").disabled = false;
  }
});

// ---------------------------------------------------------------- token

function askToken() {
  if ($("token-ask").open) return;
  $("token").value = "";
  $("token-error").textContent = hasToken() ? "The token that was given is not this service's." : "";
  $("token-ask").showModal();
}
$("token-ask").querySelector("form").addEventListener("submit", () => {
  keepToken($("token").value.trim());
  location.reload();
});

// ---------------------------------------------------------------- the stream
// Last: whatever comes of it, the orders above are in place.

new Stream({
  onOpen: () => {
    connected = true;
    live.forget();
    liveEvents.length = 0;
    if (!lookBack.isOpen) {
      map.touchGround();
      $("events").replaceChildren();
    }
    flights();
  },
  onLost: () => {
    connected = false;
    // A refusal looks like a loss to a WebSocket: ask in a way that can be answered.
    ask("GET", "/v1/room").catch((error) => { if (error.status === 401) askToken(); });
  },
  onMessage: (message) => {
    const before = live.state?.phase;
    const ground = live.take(message);
    if (!lookBack.isOpen) {
      if (ground) map.touchGround(); else map.draw();
    }
    if (message.type === "state") {
      heardAt = performance.now();
      show(message);
      if (before !== message.phase) showLastEnding(message.phase);
      if (before === "flying" && message.phase !== "flying") flights();
    } else if (message.type === "room") {
      $("scenario").textContent = message.scenario ? `simulated: ${message.scenario}` : "";
    } else if (message.type === "event") {
      addEvent(message);
    }
  },
});
