// State in the address, behind "#": a reload or a link shows the same throw. Undo and redo.
import { post } from "./api.js";
import { setValue } from "./controls.js";
import { settled } from "./live.js";
import { on, state, notify } from "./state.js";
import { openTab, shownTab } from "./tabs.js";

const MOST_STEPS = 100;
// What of the address could not be used; to be shown after the first throw.
export const warnings = [];
let steps = [], place = -1, restoring = false, written = "";

const isObject = (key) => key.startsWith("object.");

// Only what differs from the panel is named, values in the units of the sliders.
function described() {
  const known = state.start.library.includes(state.panel.name) && state.panel.source === state.panel.name;
  const items = new URLSearchParams({ panel: known ? state.panel.name : state.panel.mark });
  if (!state.trapped) items.set("object", "none");
  for (const { key, value } of state.panel.controls) {
    const always = key === "object.size" || key === "object.x";
    if (isObject(key) && !state.trapped) continue;
    if (always || state.values[key] !== value) items.set(key, state.values[key]);
  }
  const hidden = [...state.hidden];
  if (hidden.length) items.set("hide", hidden.join("|"));
  if (shownTab() !== "curves") items.set("view", shownTab());
  return items.toString();
}

export function writeAddress() {
  if (!state.panel || restoring) return;
  written = described();
  history.replaceState(null, "", `#${written}`);
}

// The panel that the address names, as the server describes it; the first one where it names none.
export async function panelOfAddress() {
  const name = new URLSearchParams(location.hash.slice(1)).get("panel");
  if (!name || name === state.start.panel.mark || name === state.start.panel.name) return state.start.panel;
  try {
    const known = state.start.library.includes(name);
    return await post(known ? "/api/panel/open" : "/api/panel/again", known ? { name } : { panel: name });
  } catch (error) {
    warnings.push(`${error.message}; this is the studio's own panel`);
    return state.start.panel;
  }
}

// Put the values that the address names into the sliders; returns what cannot be.
export function applyAddress() {
  const unknown = [];
  restoring = true;
  for (const [key, text] of new URLSearchParams(location.hash.slice(1))) {
    if (key === "panel") continue;
    if (key === "object") state.trapped = text !== "none";
    else if (key === "hide") state.hidden = new Set(text.split("|"));
    else if (key === "view" && document.getElementById(`tab-${text}`)) openTab(text);
    else if (state.panel.controls.some((item) => item.key === key) && text.trim() && Number.isFinite(Number(text))) setValue(key, Number(text));
    else unknown.push(`${key}=${text}`);
  }
  document.getElementById("trapped").checked = state.trapped;
  restoring = false;
  notify("values");
  if (unknown.length) warnings.push(`the address names what this panel has no slider for: ${unknown.join(", ")}`);
}

const snapshot = () => JSON.stringify({ values: state.values, trapped: state.trapped });

function buttons() {
  document.getElementById("undo").disabled = place <= 0;
  document.getElementById("redo").disabled = place >= steps.length - 1;
}

// Each final request is a step; moving a slider is one step, not a hundred.
function remember() {
  writeAddress();
  const now = snapshot();
  if (now === steps[place]) return;
  steps = steps.slice(0, place + 1).concat(now).slice(-MOST_STEPS);
  place = steps.length - 1;
  buttons();
}

function step(by) {
  if (!steps[place + by]) return;
  place += by;
  const { values, trapped } = JSON.parse(steps[place]);
  restoring = true;
  state.trapped = document.getElementById("trapped").checked = trapped;
  for (const [key, value] of Object.entries(values)) setValue(key, value);
  restoring = false;
  buttons();
  settled();
}

export function forgetSteps() {
  steps = [];
  place = -1;
  buttons();
}

const typing = (target) => target.matches?.("input[type=number], input[type=text], textarea");

export function startAddress() {
  on("request", remember);
  for (const what of ["view", "channels"]) on(what, writeAddress);
  document.getElementById("undo").addEventListener("click", () => step(-1));
  document.getElementById("redo").addEventListener("click", () => step(1));
  document.addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || typing(event.target)) return;
    const key = event.key.toLowerCase();
    const by = key === "z" ? (event.shiftKey ? 1 : -1) : key === "y" ? 1 : 0;
    if (!by) return;
    event.preventDefault();
    step(by);
  });
  // A link pasted into this page.
  addEventListener("hashchange", () => { if (location.hash.slice(1) !== written) location.reload(); });
}
