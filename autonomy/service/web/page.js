// Words, numbers and orders around the map.

import { ask, keepToken, save, Stream } from "./link.js";
import { RoomMap } from "./map.js";

const $ = (id) => document.getElementById(id);
const STALE_MS = 1500;
const EVENTS_SHOWN = 60;

let room = null;
let state = null;
let heardAt = 0;
let connected = false;

const map = new RoomMap($("map"), {
  onPick: (point) => propose(point),
  onHover: ([n, e]) => { $("hover").textContent = `N ${n.toFixed(2)}  E ${e.toFixed(2)}`; },
});
$("zoom-in").onclick = () => map.zoom(1.4);
$("zoom-out").onclick = () => map.zoom(1 / 1.4);
$("zoom-all").onclick = () => map.showAll();

// ---------------------------------------------------------------- the stream

new Stream({
  onOpen: () => {
    connected = true;
    state = null;
    map.forget();
    $("events").replaceChildren();
    flights();
  },
  onLost: () => {
    connected = false;
    // A refusal looks like a loss to a WebSocket: ask in a way that can be answered.
    ask("GET", "/v1/room").catch((error) => { if (error.status === 401) askToken(); });
  },
  onMessage: (message) => {
    map.take(message);
    if (message.type === "state") {
      heardAt = performance.now();
      const over = state?.phase === "flying" && message.phase !== "flying";
      state = message;
      show();
      if (over) flights();
    } else if (message.type === "room") {
      room = message;
      $("scenario").textContent = room.scenario ? `simulated: ${room.scenario}` : "";
    } else if (message.type === "event") {
      addEvent(message);
    }
  },
});

setInterval(() => {
  const stale = !connected || performance.now() - heardAt > STALE_MS;
  $("map").classList.toggle("stale", stale);
  $("link-lost").hidden = !stale;
  $("link-lost").textContent = connected ? "no news from the service" : "no connection to the service";
}, 250);

// ---------------------------------------------------------------- words and numbers

function put(id, text, level = "") {
  const element = $(id);
  if (element.textContent !== text) element.textContent = text;
  if (element.className !== level) element.className = level;
}

function show() {
  const { phase, vehicle, flight, guard } = state;
  put("phase", phase, `pill ${phase}`);
  put("why", state.why);
  put("n-state", flight ? flight.state : phase);
  put("n-togo", flight ? `${flight.distance_to_go_m.toFixed(2)} m` : "–");
  put("n-clearance", flight ? clearance(flight.clearance_m) : "–", flight && flight.clearance_m < 0.2 ? "warn" : "");
  put("n-replans", flight ? `${flight.stops} / ${flight.replans}` : "–");
  put("n-speed", vehicle ? `${vehicle.speed_m_s.toFixed(2)} m/s` : "–");
  put("n-height", vehicle ? `${Math.max(0, vehicle.height_m).toFixed(2)} m` : "–");
  put("n-mode", vehicle ? vehicle.mode : "–");
  put("n-guard", guard?.limits.length ? guard.limits.join(", ").replaceAll("_", " ") : guard ? "open" : "–",
    guard?.limits.length ? "warn" : "");
  $("n-guard").title = guard?.why.join("; ") ?? "";
  put("hold", held() ? "Go on" : "Hold", "land");
  battery(vehicle);
  link(vehicle);
  beams();
  filter();
}

const clearance = (metres) => (metres >= 1 ? "over 1 m" : `${metres.toFixed(2)} m`);

function battery(vehicle) {
  const left = vehicle?.battery;
  if (left === null || left === undefined) return put("n-battery", "unknown");
  return put("n-battery", `${Math.round(left * 100)} %`, left < 0.15 ? "bad" : left < 0.25 ? "warn" : "");
}

function link(vehicle) {
  if (!vehicle) return put("n-link", "–");
  const age = vehicle.link_age_s;
  return age > 1.5
    ? put("n-link", `silent ${age.toFixed(0)} s`, "bad")
    : put("n-link", age > 0.5 ? "slow" : "ok", age > 0.5 ? "warn" : "");
}

function beams() {
  const list = $("beams");
  while (list.children.length > state.beams.length) list.lastChild.remove();
  state.beams.forEach((beam, index) => {
    let item = list.children[index];
    if (!item) {
      item = document.createElement("li");
      item.append(document.createElement("span"), document.createElement("span"));
      list.append(item);
    }
    const range = beam.sees === "hit" ? `${beam.range_m.toFixed(2)} m` : beam.sees;
    const name = `${beam.name}: ${beam.health === "ok" ? range : "–"}`;
    if (item.children[0].textContent !== name) item.children[0].textContent = name;
    if (item.children[1].textContent !== beam.health) item.children[1].textContent = beam.health;
    item.children[1].className = `health ${beam.health === "ok" ? "ok" : "sick"}`;
  });
}

function filter() {
  const found = state.filter;
  $("filter").hidden = !found?.sources.length;
  if (!found) return;
  const apart = found.gnss_apart_m === null ? "" : `, GNSS ${found.gnss_apart_m.toFixed(1)} m apart`;
  put("filter-words", `±${(found.position_sigma_m * 100).toFixed(1)} cm in the autopilot's frame${apart}`, "quiet small");
  const rows = $("filter-rows");
  while (rows.children.length > found.sources.length) rows.lastChild.remove();
  found.sources.forEach((source, index) => {
    let row = rows.children[index];
    if (!row) {
      row = document.createElement("tr");
      for (let i = 0; i < 4; i += 1) row.append(document.createElement("td"));
      rows.append(row);
    }
    const cells = [source.name, source.test_ratio.toFixed(2), source.fused, source.rejected];
    cells.forEach((cell, i) => {
      if (row.children[i].textContent !== String(cell)) row.children[i].textContent = cell;
    });
    row.className = source.test_ratio > 1 ? "warn" : "";
  });
}

function addEvent(event) {
  const item = document.createElement("li");
  const time = document.createElement("time");
  time.dateTime = event.time_utc;
  time.textContent = new Date(event.time_utc).toLocaleTimeString();
  item.append(time, event.why);
  const list = $("events");
  list.prepend(item);
  while (list.children.length > EVENTS_SHOWN) list.lastChild.remove();
}

function say(text, bad = false) {
  put("said", text, bad ? "bad" : "");
}

// ---------------------------------------------------------------- orders

async function order(name) {
  try {
    await ask("POST", `/v1/${name}`);
    say(`${name}: on its way to the vehicle`);
  } catch (error) {
    if (error.status === 401) askToken();
    say(error.status ? error.message : `${name} did not reach the service: ${error.message}`, true);
  }
}

$("stop").onclick = () => order("stop");
$("land").onclick = () => order("land");
// Held: the same button lets it go on.
const held = () => state?.flight?.state === "hold" && state.why.startsWith("held by the operator");
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
  const from = state?.vehicle?.position ?? [0, 0];
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

// ---------------------------------------------------------------- token, past flights

function askToken() {
  if ($("token-ask").open) return;
  $("token").value = "";
  $("token-ask").showModal();
}
$("token-ask").querySelector("form").addEventListener("submit", () => {
  keepToken($("token").value.trim());
  location.reload();
});

async function flights() {
  let logs;
  try {
    logs = await ask("GET", "/v1/logs");
  } catch {
    return;
  }
  const items = logs.slice(0, 20).map((log) => {
    const item = document.createElement("li");
    const text = document.createElement("span");
    const when = new Date(log.modified_utc).toLocaleString();
    const report = log.report;
    text.textContent = report
      ? `${when}: ${report.ending.replaceAll("_", " ")}, ${report.path_length_m.toFixed(1)} m in ` +
        `${report.flight_time_s.toFixed(0)} s, ${report.stops} stops. ${report.why}`
      : `${when}: ${log.name}`;
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = "log";
    button.setAttribute("aria-label", `Save the log ${log.name}`);
    button.onclick = () => save(log.name).catch((error) => say(error.message, true));
    item.append(text, button);
    return item;
  });
  if (items.length) $("flights").replaceChildren(...items);
}
