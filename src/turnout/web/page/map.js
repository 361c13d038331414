// Which objects the switch reports: a throw for each size and place, made on request.
import { setValue } from "./controls.js";
import { runJob } from "./jobs.js";
import { message, settled } from "./live.js";
import { currentRequest, on, state, notify } from "./state.js";

const byId = (id) => document.getElementById(id);
// Sign, word and look of a kind; signs differ in shape, so that nothing depends on colour.
const KINDS = {
  "undetected object": ["◆", "undetected", "missed"],
  "detected by slip": ["S", "detected by slip", "good"],
  "detected by switch-off": ["O", "detected by switch-off", "good"],
  "detected by lock": ["L", "detected by lock", "good"],
  "detected by TKK": ["T", "detected by TKK", "good"],
  "not touched": ["·", "not touched", "rest"],
  "does not fit": ["–", "does not fit", "rest"],
  "not locked": ["!", "not locked without it", "look"],
  "not sound": ["!", "not sound without it", "look"],
  "depends on how it breaks": ["?", "depends on how it breaks", "look"],
  "not judged": ["?", "not judged", "look"],
  failed: ["?", "not computed", "look"],
};
let stop = null;

function sizes() {
  const found = byId("map-sizes").value.split(/[\s,;]+/).filter(Boolean).map(Number);
  if (!found.length || !found.every((size) => size > 0 && Number.isFinite(size))) throw new Error(`Sizes: '${byId("map-sizes").value}' is no list of sizes in mm, such as 5, 10, 13`);
  return [...new Set(found)].sort((a, b) => b - a);
}

// Named places in their order along the rail, each once.
function places() {
  const { least, most } = state.panel.controls.find((item) => item.key === "object.x");
  const known = [...state.panel.places].sort((a, b) => a.x - b.x).filter((item) => item.x >= least && item.x <= most);
  return known.filter((item, number) => !number || Math.abs(item.x - known[number - 1].x) > 1e-6);
}

async function compute() {
  const button = byId("map-compute"), note = byId("map-state");
  if (stop) { stop(); return; }
  try {
    message("");
    const chosen = places(), wanted = sizes(), run = { ...currentRequest(true), preview: false };
    run.object ??= { size: "13 mm", at: chosen[0].name, kind: "spring" };
    const count = chosen.length * wanted.length;
    const body = { run, places: chosen.map((item) => item.name), sizes: wanted.map((size) => `${size} mm`) };
    note.textContent = `${count} throws ...`;
    const found = await runJob("/api/map", body, {
      bar: byId("map-progress"),
      said: (text) => { note.textContent = `${text} of ${count} throws`; },
      started: (how) => { stop = how; button.textContent = "Stop"; },
    });
    if (!found) { note.textContent = "stopped"; return; }
    table(found, chosen, wanted);
    const missed = found.kinds.flat().filter((kind) => kind === "undetected object").length;
    note.textContent = `${missed} of ${count} objects stay undetected; of ${state.panel.name} as set when it was computed, quick mode`;
  } catch (error) {
    note.textContent = "";
    message(error.message);
  } finally {
    stop = null;
    button.textContent = "Compute";
  }
}

function cell(kind, text, size, place) {
  const [sign, word, look] = KINDS[kind] ?? ["?", kind, "look"];
  const made = document.createElement("td"), button = document.createElement("button");
  Object.assign(button, { type: "button", textContent: sign, tabIndex: -1, title: text });
  button.setAttribute("aria-label", `${size} mm at ${place.name}: ${word}; show this throw`);
  made.dataset.look = look;
  button.addEventListener("click", () => {
    state.trapped = byId("trapped").checked = true;
    setValue("object.size", size);
    setValue("object.x", place.x);
    notify("values");
    settled();
  });
  made.append(button);
  return made;
}

function table(found, chosen, wanted) {
  const head = document.createElement("tr");
  const title = (text) => Object.assign(document.createElement("th"), { scope: "col", textContent: text });
  head.append(title("mm"), ...chosen.map((place) => title(place.name.replace("sleeper ", "").replace("drive ", "D").replace("sensor ", ""))));
  const rows = wanted.map((size, row) => {
    const line = document.createElement("tr"), name = document.createElement("th");
    name.scope = "row";
    name.textContent = size;
    line.append(name, ...chosen.map((place, column) => cell(found.kinds[row][column], found.texts[row][column], size, place)));
    return line;
  });
  byId("map-table").replaceChildren(head, ...rows);
  byId("map-table").querySelector("button").tabIndex = 0;
}

// One tab stop; arrow keys go from cell to cell.
function keys(event) {
  const by = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] }[event.key], here = event.target.closest("td");
  if (!by || !here) return;
  event.preventDefault();
  const row = here.parentElement.rowIndex + by[0], next = byId("map-table").rows[row]?.cells[here.cellIndex + by[1]]?.querySelector("button");
  if (!next) return;
  event.target.tabIndex = -1;
  next.tabIndex = 0;
  next.focus();
}

export function startMap() {
  byId("map-compute").addEventListener("click", compute);
  byId("map-table").addEventListener("keydown", keys);
  on("pins", () => { if (!state.answer) { byId("map-table").replaceChildren(); byId("map-state").textContent = ""; } });
}
