// Panels, recordings and campaigns: sent to the local server and checked there.
import { get, post, send } from "./api.js";
import { buildControls, setValue } from "./controls.js";
import { runJob } from "./jobs.js";
import { message, settled } from "./live.js";
import { drawPlan } from "./plan.js";
import { applyAddress, forgetSteps } from "./address.js";
import { on, state, notify } from "./state.js";
import { openTab } from "./tabs.js";

const byId = (id) => document.getElementById(id);
let mapText = "", suggestedMap = "";

function notes(lines, open = true) {
  byId("notes").textContent = lines.join("\n");
  if (open) openTab("notes");
}

// Show an error in full and keep the present content.
async function guarded(work) {
  try {
    message("");
    await work();
  } catch (error) {
    message(error.message);
  }
}

export async function showPanel(panel, { addressed = false } = {}) {
  state.panel = panel;
  state.answer = null;
  state.frame = Infinity;
  state.pins = [];
  state.overlay = null;
  byId("movement").value = "";
  byId("panel-note").textContent = `${panel.source === panel.name ? "library" : panel.source}, hash ${panel.hash}`;
  const list = byId("panel");
  if (![...list.options].some((item) => item.value === panel.mark || item.value === panel.name)) list.add(new Option(`${panel.name} (sent)`, panel.mark));
  list.value = [...list.options].find((item) => item.value === panel.mark)?.value ?? panel.name;
  buildControls();
  forgetSteps();
  notify("panel");
  if (addressed) applyAddress();
  notify("pins");
  drawPlan();
  await settled();
}

function listMovements(title, movements) {
  if (!movements.length) return;
  const group = document.createElement("optgroup");
  group.label = title;
  group.append(...movements.map((item) => {
    const option = new Option(item.title, item.mark);
    Object.assign(option.dataset, { size: item.size ?? "", place: item.place });
    return option;
  }));
  byId("movement").append(group);
}

function campaign() {
  const found = state.start.campaign;
  if (!found) return;
  listMovements(`${found.title}${found.synthetic ? " (synthetic)" : ""}`, found.movements);
  byId("map").add(new Option("map of the campaign", "campaign"));
  const link = (file) => {
    const item = document.createElement("li"), anchor = document.createElement("a");
    anchor.href = `/api/campaign/${file.split("/").map(encodeURIComponent).join("/")}`;
    anchor.textContent = file;
    item.append(anchor);
    return item;
  };
  byId("campaign-files").replaceChildren(...found.files.map(link));
  if (found.excluded.length) notes(["excluded from the campaign:", ...found.excluded], false);
}

async function overlay() {
  const mark = byId("movement").value;
  byId("as-measured").disabled = !mark || !byId("movement").selectedOptions[0].dataset.size;
  state.overlay = mark ? await post(`/api/measured/${mark}`, state.request) : null;
  notify("overlay");
}

function useObject() {
  const { size, place } = byId("movement").selectedOptions[0].dataset;
  const at = state.panel.places.find((item) => item.name === place);
  state.trapped = byId("trapped").checked = Number(size) > 0;
  if (Number(size) > 0) setValue("object.size", 1000 * Number(size));
  if (at) setValue("object.x", at.x);
  notify("values");
  settled();
}

// The channel map for recordings: its text, or the name of one that the server knows.
export const chosenMap = () => (byId("map").value === "sent" ? mapText : byId("map").value);

async function sendRecording() {
  const file = byId("recording").files[0];
  if (!file) return;
  const map = chosenMap();
  const { lines, movements, suggested = "" } = await send("/api/recording", file, { map });
  suggestedMap = suggested;
  byId("use-map").hidden = !suggested;
  notes(lines);
  listMovements(file.name, movements);
  if (!movements.length) return;
  byId("movement").value = movements[movements.length - 1].mark;
  await overlay();
  openTab("curves");
}

async function useMap(text, title) {
  mapText = text;
  const known = [...byId("map").options].find((item) => item.value === "sent");
  if (known) known.text = title;
  else byId("map").add(new Option(title, "sent"));
  byId("map").value = "sent";
  await sendRecording();
}

async function sendMap() {
  const file = byId("map-file").files[0];
  if (file) await useMap(await file.text(), "uploaded map");
}

async function sendPanel() {
  const file = byId("panel-file").files[0];
  if (!file) return;
  const panel = await send("/api/panel/send", file);
  notes([`${file.name}: OK (${panel.name}, hash ${panel.hash})`]);
  await showPanel(panel);
}

// Runs in the background: everything else goes on, and the result comes beside the button.
async function check() {
  const { name, mark } = state.panel, button = byId("check"), progress = byId("check-progress"), text = byId("check-state");
  const said = (share) => { text.textContent = `${name}: ${share}`; };
  button.disabled = true;
  said("0 %");
  try {
    const { lines } = await runJob("/api/panel/concerns", { panel: mark }, { bar: progress, said });
    notes([`${name}, checked at ${new Date().toLocaleTimeString()}:`, ...lines], false);
    const count = lines.filter((line) => /warning/.test(line)).length;
    text.textContent = `${name}: ${count ? `${count} warnings` : "no warnings"}; see Files and checks`;
  } catch (error) {
    text.textContent = `${name}: check failed`;
    throw error;
  } finally {
    button.disabled = false;
  }
}

export function startFiles() {
  campaign();
  const list = byId("panel");
  list.replaceChildren(...state.start.library.map((name) => new Option(name, name)));
  list.addEventListener("change", () => guarded(async () => {
    const known = state.start.library.includes(list.value);
    await showPanel(await post(known ? "/api/panel/open" : "/api/panel/again", known ? { name: list.value } : { panel: list.value }));
  }));
  byId("movement").addEventListener("change", () => guarded(overlay));
  byId("as-measured").addEventListener("click", useObject);
  byId("recording").addEventListener("change", () => guarded(sendRecording));
  byId("map").addEventListener("change", () => guarded(sendRecording));
  byId("use-map").addEventListener("click", () => guarded(() => useMap(suggestedMap, "suggested map")));
  byId("map-file").addEventListener("change", () => guarded(sendMap));
  byId("panel-file").addEventListener("change", () => guarded(sendPanel));
  byId("check").addEventListener("click", () => guarded(check));
  on("answer", () => { if (state.overlay && !state.request.preview) guarded(overlay); });
}

export const begin = async () => { state.start = await get("/api/start"); };
