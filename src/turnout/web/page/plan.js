// The panel from above. Positions are the server's; here they are only put on the screen.
import { changed, settled } from "./live.js";
import { setValue } from "./controls.js";
import { controlOf, on, placeNear, state } from "./state.js";

const SVG = "http://www.w3.org/2000/svg";
// Pixels, or text heights where they grow with the text.
const LEFT = 14, RIGHT = 14, STOCK = 8, RAIL = 9, FORCE = 5;
// Room outside a stock rail: for the object's knob, drives and sensors, or for a name alone.
const BUSY = 3.7, QUIET = 1.9, USUAL = 6, NARROW = 560;
let view = null; // how metres become pixels
let fitted = null; // panel that the scale was chosen for
let moving = {}; // what changes with the instant

function add(parent, tag, attributes = {}, text = "") {
  const node = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  if (text) node.textContent = text;
  parent.append(node);
  return node;
}

const points = (pairs) => pairs.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ");
const rem = () => parseFloat(getComputedStyle(document.documentElement).fontSize);

// A band for each rail. Stock rails are drawn straight, and the distance of a switch rail from its
// stock rail is the gap, in a lateral scale so many times the longitudinal one; widths are symbols.
function layout(svg) {
  const { plan } = state.panel;
  const { width, height } = svg.getBoundingClientRect();
  const start = Math.min(...plan.rails.map((rail) => rail.start)) - 0.5;
  const end = Math.max(...plan.rails.map((rail) => rail.end)) + 0.2;
  const along = (width - LEFT - RIGHT) / (end - start);
  const foot = 1.3 * rem();
  const busy = new Set([plan.object_rail, ...plan.drives.map((item) => item.rail), ...plan.sensors.map((item) => item.rail)]);
  const outsideOf = (rail) => rem() * (busy.has(rail.name) ? BUSY : QUIET);
  const free = height - foot - plan.rails.reduce((sum, rail) => sum + outsideOf(rail), 0);
  const inner = Math.max(free / plan.rails.length, 8);
  // One rail stands open while the other lies at its stock rail, so it may use most of the other's room.
  const reach = plan.rails.length > 1 ? Math.max(free - 1.3 * RAIL, inner) : inner;
  const slider = document.getElementById("exaggeration");
  // Until the user chooses a scale: the usual one, or less where the open rail would leave its band.
  const widest = state.answer ? Math.max(...Object.values(state.answer.motion.rails).flatMap((rail) => rail.gap.map((row) => row[0]))) : 0.12;
  if (!slider.dataset.chosen) slider.value = Math.max(1, Math.min(USUAL, Math.floor((reach - 0.5 * RAIL) / (along * widest))));
  const scale = Number(slider.value);
  const order = [...plan.rails].sort((a, b) => b.side - a.side);
  const bands = new Map();
  let top = 0;
  for (const rail of order) {
    const outside = outsideOf(rail), room = outside + inner;
    const face = rail.side > 0 ? top + outside : top + inner;
    bands.set(rail.name, { top, reach, inner, outside, face, inward: rail.side, y: (gap) => face + rail.side * gap * along * scale });
    top += room;
  }
  return { panel: state.panel, width, height, along, scale, foot, bands, start, end, x: (x) => LEFT + (x - start) * along };
}

// Whether the plan is that of the panel shown: controls of a newly chosen one change before it is drawn.
const drawn = () => view?.panel === state.panel;

function at(values, xs, x) {
  const i = xs.findIndex((item) => item >= x - 1e-9);
  if (i <= 0) return values[i < 0 ? values.length - 1 : 0];
  const share = (x - xs[i - 1]) / (xs[i] - xs[i - 1]);
  return values[i - 1] + share * (values[i] - values[i - 1]);
}

function still(svg) {
  const { plan } = state.panel;
  const { x, bands, height, foot } = view;
  for (const place of plan.beams.filter((item) => item > view.start && item < view.end)) {
    add(svg, "rect", { class: "sleeper", x: x(place) - 0.11 * view.along, y: 2, width: 0.22 * view.along, height: height - foot - 2 });
  }
  for (const { name, x: place } of plan.sleepers) {
    add(svg, "text", { class: "soft sleeper-name", x: x(place), y: height - 0.35 * rem(), "text-anchor": "middle" }, name);
  }
  add(svg, "text", { class: "soft name", x: view.width - RIGHT, y: height - 0.35 * rem(), "text-anchor": "end" },
    `sleepers; stock rails drawn straight, gaps ${view.scale} times the scale along the track`);
  for (const rail of plan.rails) {
    const { face, inward, inner } = bands.get(rail.name);
    for (const chair of plan.chairs.filter((item) => item.rails.includes(rail.name))) {
      add(svg, "rect", { class: "chair", x: x(chair.x) - 0.08 * view.along, y: inward > 0 ? face : face - 0.8 * inner, width: 0.16 * view.along, height: 0.8 * inner });
    }
    add(svg, "rect", { class: rail.has_stock_rail ? "stock" : "sleeper", x: x(view.start), width: x(rail.end) - x(view.start), height: STOCK, y: inward > 0 ? face - STOCK : face });
    const name = rail.has_stock_rail ? `switch rail ${rail.name}, its stock rail grey` : `switch rail ${rail.name}, no stock rail`;
    add(svg, "text", { class: "soft name", x: x(rail.end), y: face - inward * (STOCK + 0.45 * rem()) + (inward > 0 ? 0 : 0.6 * rem()), "text-anchor": "end" }, name);
  }
  for (const sensor of plan.sensors) {
    const { face, inward } = bands.get(sensor.rail), py = face - inward * (STOCK + 8);
    add(svg, "polygon", { class: "sensor", points: points([[x(sensor.x), py + inward * 6], [x(sensor.x) - 6, py - inward * 6], [x(sensor.x) + 6, py - inward * 6]]) });
    // On a phone the name of a drive takes the room to the left.
    const narrow = view.width < NARROW;
    add(svg, "text", { x: x(sensor.x) + (narrow ? 9 : -9), y: py + 4, "text-anchor": narrow ? "start" : "end" }, sensor.name);
  }
}

// Rails that stand further open than their band is wide go out of sight, not over the other one.
function clips(svg) {
  const defs = add(svg, "defs");
  for (const [name, band] of view.bands) {
    const clip = add(defs, "clipPath", { id: `band-${name}` });
    add(clip, "rect", { x: 0, y: band.inward > 0 ? band.face : band.face - band.reach, width: view.width, height: band.reach });
  }
}

function prepare(svg) {
  const { plan } = state.panel;
  moving = { rails: {}, drives: {}, links: {} };
  clips(svg);
  for (const link of plan.links) moving.links[link.name] = add(svg, "line", { class: "link" });
  for (const rail of plan.rails) {
    const group = add(svg, "g", { "clip-path": `url(#band-${rail.name})` });
    moving.rails[rail.name] = add(group, "polygon", { class: "rail", "data-rail": rail.name });
  }
  for (const drive of plan.drives) {
    const { face, inward } = view.bands.get(drive.rail), far = face - inward * (STOCK + 1.15 * rem());
    const own = { rod: add(svg, "line", { class: "rod" }), force: add(svg, "path", { class: "force" }), tip: add(svg, "polygon", { class: "tip" }), far };
    add(svg, "rect", { class: "drive", x: view.x(drive.x) - 7, y: far - 6, width: 14, height: 12 });
    own.text = add(svg, "text", { x: view.x(drive.x) + 11, y: far + 4 });
    moving.drives[drive.name] = own;
  }
  moving.stone = add(svg, "rect", { class: "stone", id: "stone" });
  moving.handle = handle(svg);
}

function handle(svg) {
  const control = controlOf("object.x");
  const group = add(svg, "g", { class: "handle", id: "handle", tabindex: 0, role: "slider", "aria-label": "Place of the object along the rail",
    "aria-valuemin": control.least, "aria-valuemax": control.most });
  add(group, "line", { class: "stem" });
  add(group, "circle", { class: "knob", r: 8 });
  add(group, "circle", { class: "hit", r: 18 });
  add(group, "text", { "text-anchor": "start" });
  return group;
}

// What moves: rails, rods, links, forces, and the object, which the user moves.
function frame() {
  if (!drawn() || !state.answer) return;
  const { motion } = state.answer, now = state.frame, gap = {};
  for (const rail of state.panel.plan.rails) {
    const band = view.bands.get(rail.name), own = motion.rails[rail.name];
    gap[rail.name] = (x) => at(own.gap[now], own.x, x);
    const back = own.x.map((x, i) => [view.x(x), band.y(own.gap[now][i])]);
    const edge = own.x.map((x, i) => [back[i][0], back[i][1] + band.inward * (2 + RAIL * at(rail.width, rail.x, x) / (rail.head_width || 0.072))]);
    moving.rails[rail.name].setAttribute("points", points([...back, ...edge.reverse()]));
  }
  state.panel.plan.drives.forEach((drive, number) => {
    const own = moving.drives[drive.name], { y, inward } = view.bands.get(drive.rail), px = view.x(drive.x), py = y(gap[drive.rail](drive.x));
    line(own.rod, px, own.far, px, py);
    const force = motion.drive_force?.[now][number] ?? 0;
    own.text.textContent = view.width < NARROW ? `Drive ${drive.name}` : `Drive ${drive.name}: ${(force / 1000).toFixed(2)} kN`;
    arrow(own, px, py, -force * inward / 1000 * FORCE);
  });
  for (const link of state.panel.plan.links) {
    const [a, b] = link.rails.map((name) => view.bands.get(name).y(gap[name](link.x)));
    line(moving.links[link.name], view.x(link.x), a, view.x(link.x), b);
  }
}

function line(node, x1, y1, x2, y2) {
  for (const [name, value] of Object.entries({ x1, y1, x2, y2 })) node.setAttribute(name, value);
}

// A force on the rail: positive closes it, towards its stock rail.
function arrow(own, px, py, length) {
  const shown = Math.abs(length) > 1.5, end = py + length, turn = Math.sign(length), x = px + 6;
  own.force.setAttribute("d", shown ? `M${x},${py}V${end}` : "");
  own.tip.setAttribute("points", shown ? points([[x, end + 6 * turn], [x - 5, end - turn], [x + 5, end - turn]]) : "");
}

function object() {
  if (!drawn() || !moving.handle) return;
  const { handle: group, stone } = moving;
  group.style.display = stone.style.display = state.trapped ? "" : "none";
  const x = state.values["object.x"], size = state.values["object.size"], px = view.x(x);
  const { face, inward, outside, y } = view.bands.get(state.panel.plan.object_rail), far = y(size / 1000);
  for (const [name, value] of Object.entries({ x: px - 6, width: 12, y: Math.min(face, far), height: Math.max(Math.abs(far - face), 2) })) stone.setAttribute(name, value);
  const knob = face - inward * (outside - 13);
  const [stem, circle, hit, text] = group.children;
  line(stem, px, face, px, knob);
  for (const item of [circle, hit]) { item.setAttribute("cx", px); item.setAttribute("cy", knob); }
  const right = px < view.width - 160;
  text.setAttribute("x", px + (right ? 14 : -14));
  text.setAttribute("text-anchor", right ? "start" : "end");
  text.setAttribute("y", knob + 4);
  const near = placeNear(x);
  text.textContent = `${size} mm${near ? `, ${near.name}` : `, x = ${x} m`}`;
  group.setAttribute("aria-valuenow", x);
  group.setAttribute("aria-valuetext", `x = ${x} m${near ? `, ${near.name}` : ""}`);
}

function moveTo(x, done, since) {
  const { least, most, step } = controlOf("object.x");
  setValue("object.x", Math.max(least, Math.min(most, Math.round(x / step) * step)));
  if (done) settled(); else changed(since);
}

function listen(svg) {
  let held = false;
  const metres = (event) => view.start + (event.clientX - svg.getBoundingClientRect().left - LEFT) / view.along;
  svg.addEventListener("pointerdown", (event) => {
    if (!event.target.closest("#handle")) return;
    held = true;
    svg.setPointerCapture(event.pointerId);
    moving.handle.focus();
    event.preventDefault();
  });
  svg.addEventListener("pointermove", (event) => held && moveTo(metres(event), false, event.timeStamp));
  for (const end of ["pointerup", "pointercancel"]) {
    svg.addEventListener(end, (event) => { if (held) { held = false; moveTo(metres(event), true); } });
  }
  svg.addEventListener("keydown", (event) => {
    if (!event.target.closest("#handle")) return;
    const x = state.values["object.x"], { least, most, step } = controlOf("object.x");
    const places = state.panel.places.map((item) => item.x).sort((a, b) => a - b);
    const wanted = {
      ArrowLeft: x - step, ArrowDown: x - step, ArrowRight: x + step, ArrowUp: x + step, Home: least, End: most,
      PageUp: places.find((place) => place > x + 1e-6) ?? x, PageDown: places.findLast((place) => place < x - 1e-6) ?? x,
    }[event.key];
    if (wanted === undefined) return;
    event.preventDefault();
    moveTo(wanted, false, event.timeStamp);
  });
}

export function drawPlan() {
  const svg = document.getElementById("plan");
  if (!state.panel || !svg.clientWidth) return;
  const focused = document.activeElement?.id === "handle";
  svg.replaceChildren();
  view = layout(svg);
  document.getElementById("exaggeration-text").textContent = `× ${view.scale}`;
  still(svg);
  prepare(svg);
  object();
  frame();
  if (focused) moving.handle.focus();
}

export function startPlan() {
  const svg = document.getElementById("plan");
  listen(svg);
  new ResizeObserver(drawPlan).observe(svg);
  on("painted", () => { if (fitted !== state.panel) { fitted = state.panel; drawPlan(); } });
  on("values", object);
  on("frame", frame);
}
