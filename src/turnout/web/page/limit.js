// The map of `turnout limit`: probability of detection along the blade at the size of the slider.
import { send } from "./api.js";
import { drawBlade } from "./blade.js";
import { message } from "./live.js";
import { on, state } from "./state.js";
import { isOpen } from "./tabs.js";

const byId = (id) => document.getElementById(id);
const MILLI = 1000;
let found = null;

// All values come from the map at its own sizes; the one nearest to the slider is shown.
const nearest = (sizes, size) => sizes.reduce((best, item, number) => (Math.abs(item - size) < Math.abs(sizes[best] - size) ? number : best), 0);

const mm = (value) => (value === null || value === undefined ? "beyond what was thrown" : `${(MILLI * value).toFixed(1)} mm`);

// Empty where the map is of the panel shown; a map without a hash was written by an older version.
function ofAnotherPanel() {
  const { panel, panel_hash: hash } = found.panel, shown = state.panel;
  if (!hash) return "the file does not say of which panel it is; ";
  if (hash.startsWith(shown.hash)) return "";
  return panel === shown.name ? `WARNING: of panel ${panel} with other values than those shown; ` : `WARNING: of panel ${panel}, not of ${shown.name}, which is shown; `;
}

function draw() {
  if (!found || !isOpen("map") || !state.panel) return;
  const channel = found.channels[byId("limit-channel").value], at = nearest(found.sizes, state.values["object.size"] / MILLI), size = found.sizes[at];
  const places = found.places.map((place, number) => {
    const value = channel.pod[number][at], known = channel.known_pod[number][at], hatched = channel.untouched[number][at];
    const interval = channel.a90_low ? ` (95 %: ${mm(channel.a90_low[number])} to ${mm(channel.a90_high[number])})` : "";
    const only = known === null ? "" : `; if only the place is known, detected in ${Math.round(100 * known)} %, 90 % from ${mm(channel.known_a90[number])} on`;
    return {
      ...place, value, mark: known, hatched, text: value === null ? "?" : value.toFixed(2), look: value === null ? "" : value >= 0.9 ? "good" : value >= 0.5 ? "look" : "missed",
      title: `${place.name}: ${value === null ? "larger than what was thrown" : `detected in ${Math.round(100 * value)} %`}; 90 % from ${mm(channel.a90[number])} on${interval}${only}; touched in 9 of 10 states from ${mm(place.floor)} on`,
    };
  });
  drawBlade(byId("limit-blade"), places.sort((a, b) => a.x - b.x));
  const { discrepancy, false_alarm_rate: rate, history } = found.conditions, blind = places.filter((place) => place.value !== null && place.value < 0.9);
  const said = ["all switches are simulated, no field recording was compared", `probability that drive forces show an object of ${(MILLI * size).toFixed(1)} mm (the slider), by the best possible method`];
  if (discrepancy !== undefined) said.push(`model error ${100 * discrepancy} %, ${history} sound throws known, ${rate} false alarms per simulated throw`);
  if (places.some((place) => place.mark !== null)) said.push("line in a bar: if only the place is known; the truth lies between");
  said.push("hatched: often not even touched");
  byId("limit-note").textContent = `${found.name}: ${ofAnotherPanel()}${said.join("; ")}. ${blind.length ? `Below 90 % at ${blind.map((place) => place.name).join(", ")}.` : "At least 90 % everywhere."}`;
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
  for (const what of ["panel", "values", "view", "theme"]) on(what, draw);
  new ResizeObserver(draw).observe(byId("view-map"));
}
