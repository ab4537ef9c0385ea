// A scene in words and numbers: the same for what is and for what was.

import { $, put } from "./elements.js";

const dash = "–";

export function showWords(state) {
  const { phase, vehicle, flight, guard } = state;
  put("why", state.why);
  put("n-state", flight ? flight.state : phase);
  put("n-togo", flight ? `${flight.distance_to_go_m.toFixed(2)} m` : dash);
  put("n-clearance", flight ? clearance(flight.clearance_m) : dash, flight && flight.clearance_m < 0.2 ? "warn" : "");
  put("n-replans", flight ? `${flight.stops} / ${flight.replans}` : dash);
  put("n-speed", vehicle ? `${vehicle.speed_m_s.toFixed(2)} m/s` : dash);
  put("n-height", vehicle ? `${Math.max(0, vehicle.height_m).toFixed(2)} m` : dash);
  put("n-mode", vehicle ? mode(vehicle) : dash);
  const limits = guard?.limits ?? [];
  put("n-guard", limits.length ? limits.join(", ").replaceAll("_", " ") : guard ? "open" : dash, limits.length ? "warn" : "");
  put("guard-why", limits.length ? `Guard: ${guard.why.join("; ")}.` : "", "quiet small");
  battery(vehicle);
  link(vehicle);
  beams(state.beams);
  faults(state);
  filter(state.filter);
}

// PX4 keeps the last flight's mode on the ground: "land" would say that it is still landing.
const mode = (vehicle) => (vehicle.armed ? vehicle.mode : "disarmed");

const clearance = (metres) => (metres >= 1 ? "over 1 m" : `${metres.toFixed(2)} m`);

function battery(vehicle) {
  const left = vehicle?.battery;
  if (left === null || left === undefined) return put("n-battery", "unknown");
  return put("n-battery", `${Math.round(left * 100)} %`, left < 0.15 ? "bad" : left < 0.25 ? "warn" : "");
}

function link(vehicle) {
  if (!vehicle) return put("n-link", dash);
  const age = vehicle.link_age_s;
  return age > 1.5
    ? put("n-link", `silent ${age.toFixed(0)} s`, "bad")
    : put("n-link", age > 0.5 ? "slow" : "ok", age > 0.5 ? "warn" : "");
}

/** As many children as `count`, each made by `make`. */
function rows(list, count, make) {
  while (list.children.length > count) list.lastChild.remove();
  while (list.children.length < count) list.append(make());
  return list.children;
}

function write(element, text, level) {
  if (element.textContent !== text) element.textContent = text;
  if (level !== undefined && element.className !== level) element.className = level;
}

function pair(tag, parts) {
  const item = document.createElement(tag);
  parts.forEach((part) => item.append(document.createElement(part)));
  return item;
}

function beams(found) {
  const items = rows($("beams"), found.length, () => pair("li", ["span", "span"]));
  found.forEach((beam, index) => {
    const range = beam.sees === "hit" ? `${beam.range_m.toFixed(2)} m` : beam.sees;
    write(items[index].children[0], `${beam.name}: ${beam.health === "ok" ? range : dash}`);
    write(items[index].children[1], beam.health, `health ${beam.health === "ok" ? "ok" : "sick"}`);
  });
}

const sentence = (words) => words.charAt(0).toUpperCase() + words.slice(1);

function faults(state) {
  const found = state.faults ?? [];
  $("faults-box").hidden = !found.length;
  const items = rows($("faults"), found.length, () => pair("li", ["strong", "span"]));
  found.forEach((fault, index) => {
    const often = fault.times > 1 ? `, ${fault.times} times` : "";
    const ago = Math.max(0, state.time_s - fault.last_s);
    const when = fault.active ? `now: ${fault.response}` : `ended ${ago.toFixed(0)} s ago`;
    write(items[index].children[0], fault.name.replaceAll("_", " "), fault.active ? "sick" : "");
    write(items[index].children[1], ` ${when}${often}. ${sentence(fault.words)}.`);
  });
}

function filter(found) {
  $("filter").hidden = !found?.sources.length;
  if (!found) return;
  const apart = found.gnss_apart_m === null ? "" : `, GNSS ${found.gnss_apart_m.toFixed(1)} m apart`;
  put("filter-words", `±${(found.position_sigma_m * 100).toFixed(1)} cm in the autopilot's frame${apart}`, "quiet small");
  const lines = rows($("filter-rows"), found.sources.length, () => pair("tr", ["td", "td", "td", "td"]));
  found.sources.forEach((source, index) => {
    const cells = [source.name, source.test_ratio.toFixed(2), source.fused, source.rejected];
    cells.forEach((cell, i) => write(lines[index].children[i], String(cell)));
    lines[index].className = source.test_ratio > 1 ? "warn" : "";
  });
}
