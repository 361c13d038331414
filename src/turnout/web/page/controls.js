// Sliders with a number beside each, built from the server's description of the panel.
import { changed, settled } from "./live.js";
import { controlOf, on, placeNear, state, notify } from "./state.js";

const made = new Map();

function row(control) {
  const box = document.createElement("div");
  const id = `control-${control.key.replaceAll(".", "-")}`;
  box.className = "control";
  const label = document.createElement("label");
  label.htmlFor = id;
  label.textContent = control.label;
  box.title = `${control.meaning}${control.unit ? ` Unit: ${control.unit}.` : ""}`.trim();
  const number = document.createElement("input");
  const range = document.createElement("input");
  number.type = "number";
  range.type = "range";
  range.id = id;
  number.id = `${id}-number`;
  number.setAttribute("aria-label", `${control.label}${control.unit ? `, in ${control.unit}` : ""}`);
  for (const input of [number, range]) {
    Object.assign(input, { min: control.least, max: control.most, step: control.step });
  }
  number.step = "any";
  const unit = document.createElement("span");
  unit.className = "note";
  unit.textContent = control.unit;
  range.addEventListener("input", (event) => { setValue(control.key, Number(range.value)); changed(event.timeStamp); });
  // The mouse let go; with keys the pause after the last one says so.
  range.addEventListener("pointerup", () => settled());
  number.addEventListener("change", () => {
    if (number.value === "" || !Number.isFinite(Number(number.value))) number.value = state.values[control.key];
    setValue(control.key, Number(number.value));
    settled();
  });
  box.append(label, number, unit, range);
  made.set(control.key, { box, number, range });
  return box;
}

export function setValue(key, value) {
  const { box, number, range } = made.get(key);
  state.values[key] = Number(value.toFixed(4));
  const text = String(state.values[key]);
  if (number.value !== text) number.value = text;
  range.value = text;
  const { unit, value: usual } = controlOf(key);
  range.setAttribute("aria-valuetext", `${text} ${unit}`);
  box.classList.toggle("changed", !key.startsWith("object.") && state.values[key] !== usual);
  notify("values");
}

function setPlace() {
  const places = document.getElementById("place");
  const at = placeNear(state.values["object.x"]);
  places.value = at ? at.name : "";
}

export function buildControls() {
  made.clear();
  const own = document.getElementById("object-controls");
  const others = document.getElementById("panel-controls");
  own.replaceChildren();
  others.replaceChildren();
  for (const control of state.panel.controls) {
    (control.key.startsWith("object.") ? own : others).append(row(control));
  }
  const kinds = document.getElementById("kind");
  kinds.replaceChildren(...state.panel.kinds.map((kind) => new Option(kind, kind)));
  kinds.value = state.kind;
  const places = document.getElementById("place");
  const anywhere = new Option("another place", "");
  places.replaceChildren(anywhere, ...state.panel.places.map((item) => new Option(`${item.name} (x = ${item.x} m)`, item.name)));
  for (const control of state.panel.controls) setValue(control.key, control.value);
}

export function startControls() {
  on("values", setPlace);
  document.getElementById("place").addEventListener("change", (event) => {
    const place = state.panel.places.find((item) => item.name === event.target.value);
    if (place) { setValue("object.x", place.x); settled(); }
  });
  document.getElementById("kind").addEventListener("change", (event) => {
    state.kind = event.target.value;
    notify("values");
    settled();
  });
  document.getElementById("trapped").addEventListener("change", (event) => {
    state.trapped = event.target.checked;
    notify("values");
    settled();
  });
  document.getElementById("reset").addEventListener("click", () => {
    for (const control of state.panel.controls) {
      if (!control.key.startsWith("object.")) setValue(control.key, control.value);
    }
    settled();
  });
}
