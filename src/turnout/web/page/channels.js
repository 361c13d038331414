// Which rows of curves are shown.
import { on, state, notify } from "./state.js";

const titleOf = (row) => row.label.replace(/\n/g, " ");

export const hiddenRow = (row) => state.hidden.has(titleOf(row));

function list() {
  const rows = [...state.answer.sheet.rows, ...(state.overlay?.differences ?? [])];
  const box = document.getElementById("channel-list"), names = rows.map(titleOf);
  if (box.dataset.names === names.join("|")) return;
  box.dataset.names = names.join("|");
  box.replaceChildren(...names.map((name) => {
    const label = document.createElement("label"), tick = document.createElement("input");
    tick.type = "checkbox";
    tick.checked = !state.hidden.has(name);
    tick.addEventListener("change", () => {
      if (tick.checked) state.hidden.delete(name); else state.hidden.add(name);
      notify("channels");
    });
    label.append(tick, ` ${name}`);
    return label;
  }));
}

export function startChannels() {
  for (const what of ["answer", "overlay"]) on(what, () => state.answer && list());
  const menu = document.getElementById("channels");
  document.addEventListener("pointerdown", (event) => { if (!menu.contains(event.target)) menu.open = false; });
  menu.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    menu.open = false;
    menu.querySelector("summary").focus();
  });
}
