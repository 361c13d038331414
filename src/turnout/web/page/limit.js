// The map of `turnout limit`: probability of detection along the blade at the size of the slider.
import { send } from "./api.js";
import { drawBlade } from "./blade.js";
import { message } from "./live.js";
import { on, state } from "./state.js";
import { isOpen } from "./tabs.js";

const byId = (id) => document.getElementById(id);
const MILLI = 1000;
let found = null;

function between(values, sizes, size) {
  if (size > sizes[sizes.length - 1]) return null;
  const next = sizes.findIndex((item) => item >= size);
  if (next <= 0) return values[0];
  const share = (size - sizes[next - 1]) / (sizes[next] - sizes[next - 1]), [low, high] = [values[next - 1], values[next]];
  return low === null || high === null ? null : low + share * (high - low);
}

const mm = (value) => (value === null || value === undefined ? "beyond what was thrown" : `${(MILLI * value).toFixed(1)} mm`);

function draw() {
  if (!found || !isOpen("map") || !state.panel) return;
  const size = state.values["object.size"] / MILLI, channel = found.channels[byId("limit-channel").value];
  const places = found.places.map((place, number) => {
    const beyond = place.largest !== null && size > place.largest;
    const value = beyond ? null : between(channel.pod[number], found.sizes, size), hatched = size < place.floor;
    const interval = channel.a90_low ? ` (95 %: ${mm(channel.a90_low[number])} to ${mm(channel.a90_high[number])})` : "";
    return {
      ...place, value, hatched, text: value === null ? "?" : value.toFixed(2), look: value === null ? "" : value >= 0.9 ? "good" : value >= 0.5 ? "look" : "missed",
      title: `${place.name}: ${value === null ? "larger than what was thrown" : `detected in ${Math.round(100 * value)} %`}; 90 % from ${mm(channel.a90[number])} on${interval}; touched in 9 of 10 states from ${mm(place.floor)} on`,
    };
  });
  drawBlade(byId("limit-blade"), places.sort((a, b) => a.x - b.x));
  const { discrepancy, false_alarm_rate: rate, history } = found.conditions, blind = places.filter((place) => place.value !== null && place.value < 0.9);
  const said = [`probability that drive forces show an object of ${(MILLI * size).toFixed(1)} mm (the size of the slider), by the best possible method`];
  if (discrepancy !== undefined) said.push(`model error ${100 * discrepancy} %, ${history} sound throws known, ${rate} false alarms a throw`);
  said.push("hatched: often not even touched");
  byId("limit-note").textContent = `${found.name}: ${said.join("; ")}. ${blind.length ? `Below 90 % at ${blind.map((place) => place.name).join(", ")}.` : "At least 90 % everywhere."}`;
}

async function read() {
  const file = byId("limit-file").files[0];
  if (!file) return;
  try {
    message("");
    found = await send("/api/limit", file);
    const list = byId("limit-channel"), names = Object.keys(found.channels);
    list.replaceChildren(...names.map((name) => new Option(name, name)));
    for (const node of [byId("limit-blade"), list, document.querySelector("label[for=limit-channel]")]) node.removeAttribute("hidden");
    draw();
  } catch (error) {
    message(error.message);
  }
}

export function startLimit() {
  byId("limit-file").addEventListener("change", read);
  byId("limit-channel").addEventListener("change", draw);
  for (const what of ["values", "view", "theme"]) on(what, draw);
  new ResizeObserver(draw).observe(byId("view-map"));
}
