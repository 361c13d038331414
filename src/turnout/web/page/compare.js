// Compare pinned throws with the present one, and save files. The server formats every number.
import { postForFile } from "./api.js";
import { message } from "./live.js";
import { on, state, notify } from "./state.js";

function nameOf(request) {
  const { object, settings } = request;
  const parts = [object ? `${object.size}${object.kind === "spring" ? "" : ` ${object.kind}`} at ${object.at}` : "no object"];
  parts.push(...Object.entries(settings).map(([key, value]) => `${key} = ${value}`));
  return parts.join(", ");
}

// Such as "sb2_13mm_sleeper-6_drive.2.stiffness=300kN-m.csv".
export function fileName(request, kind) {
  const { object, settings } = request;
  const parts = [state.panel.name, ...(object ? [object.size, object.at] : ["no-object"])];
  parts.push(...Object.entries(settings).map(([key, value]) => `${key}=${value}`));
  const plain = parts.map((part) => part.replace(/(\d) (?=[a-zA-Z])/g, "$1").replace(/x = /, "x").replace(/[^\w.=-]+/g, "-"));
  return `${plain.join("_").slice(0, 120)}.${kind}`;
}

function cell(tag, text, scope) {
  const made = document.createElement(tag);
  made.textContent = text;
  if (scope) made.scope = scope;
  return made;
}

function table() {
  const box = document.getElementById("table");
  if (!state.answer) return;
  const pins = state.pins.map((pin, number) => ({ ...pin, name: `P${number + 1}: ${pin.name}` }));
  const columns = [{ name: `current: ${nameOf(state.request)}`, answer: state.answer }, ...pins];
  const head = document.createElement("tr");
  head.append(cell("td", ""));
  columns.forEach((column, number) => {
    const title = cell("th", column.name, "col");
    if (number) title.append(document.createElement("br"), ...tools(number - 1));
    head.append(title);
  });
  const rows = [head, verdicts(columns)];
  for (const figure of state.answer.figures) {
    const row = document.createElement("tr");
    row.dataset.key = figure.key;
    row.append(cell("th", figure.label, "row"));
    for (const { answer } of columns) row.append(cell("td", answer.figures.find((item) => item.key === figure.key)?.text ?? "-"));
    rows.push(row);
  }
  state.answer.lamps.forEach((lamp) => {
    const row = document.createElement("tr");
    row.append(cell("th", `${lamp.name}, at the end`, "row"));
    for (const { answer } of columns) {
      const own = answer.lamps.find((item) => item.kind === lamp.kind && item.name === lamp.name);
      row.append(cell("td", own ? own.words.at(-1) : "-"));
    }
    rows.push(row);
  });
  box.replaceChildren(...rows);
}

function verdicts(columns) {
  const row = document.createElement("tr");
  row.append(cell("th", "Verdict", "row"), ...columns.map(({ answer }) => Object.assign(cell("td", answer.verdict.kind), { title: answer.verdict.text })));
  return row;
}

function tools(number) {
  const pin = state.pins[number];
  const label = document.createElement("label"), box = document.createElement("input"), away = document.createElement("button");
  box.type = "checkbox";
  box.checked = pin.shown;
  box.addEventListener("change", () => { pin.shown = box.checked; notify("pins"); });
  label.append(box, " show ");
  away.type = "button";
  away.textContent = "Unpin";
  away.setAttribute("aria-label", `Unpin ${pin.name}`);
  away.addEventListener("click", () => { state.pins.splice(number, 1); notify("pins"); });
  return [label, away];
}

async function save() {
  const kind = document.getElementById("download").value;
  const behind = state.pins.find((pin) => pin.shown);
  const body = { run: state.request };
  if (behind && ["png", "pdf", "svg"].includes(kind)) body.behind = behind.request;
  try {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(await postForFile(`/api/file/${kind}`, body));
    link.download = fileName(state.request, kind);
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  } catch (error) {
    message(error.message);
  }
}

export function startCompare() {
  document.getElementById("save").addEventListener("click", () => state.answer && save());
  document.getElementById("pin").addEventListener("click", () => {
    if (!state.answer) return;
    state.pins.unshift({ name: nameOf(state.request), request: state.request, answer: state.answer, shown: true });
    state.pins.splice(6);
    notify("pins");
  });
  on("answer", table);
  on("pins", table);
}
