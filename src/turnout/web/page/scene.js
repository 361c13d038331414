// The panel in space. Places and forces are the server's; sizes of chairs and drives are symbols.
import { OrbitControls } from "./vendor/OrbitControls.js";
import * as THREE from "./vendor/three.module.min.js";
import { state } from "./state.js";

const HEIGHT = 0.32, KILO = 1e-3, ARROW = 0.22;
let view = null;

const styleOf = (name) => new THREE.Color(getComputedStyle(document.documentElement).getPropertyValue(name).trim());
const scaleNow = () => Math.min(Number(document.getElementById("exaggeration").value), 10);

function begin() {
  const canvas = document.getElementById("scene");
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
  const camera = new THREE.PerspectiveCamera(38, 1, 0.1, 200);
  const controls = new OrbitControls(camera, canvas);
  controls.addEventListener("change", render);
  standardViews();
  controls.enableDamping = false;
  new ResizeObserver(drawScene).observe(canvas);
  canvas.addEventListener("webglcontextlost", (event) => { event.preventDefault(); });
  return { canvas, renderer, camera, controls, scene: null, mark: "" };
}

// Where the camera stands and what it looks at: functions of the middle, the drives and the object.
const VIEWS = {
  "From the toe": () => [[-3.2, -4.6, 3.6], [0.5 * lastDrive(), 0, -0.6]],
  "From above": () => [[0.5 * lastDrive() - 0.01, 0, 1.15 * lastDrive() + 2], [0.5 * lastDrive(), 0, 0]],
  "From the side": () => [[0.5 * lastDrive(), -1.1 * lastDrive() - 2.4, 1.2], [0.5 * lastDrive(), 0, 0]],
  "Object": () => {
    const { objects } = state.answer, stone = objects[0] ?? { x: 0.5 * lastDrive() };
    const part = view.built.stones[0], y = part?.y ?? 0, side = part?.side ?? 1;
    return [[stone.x - 1.6, y - side * 1.5, 1.5], [stone.x, y, 0.2]];
  },
};

const lastDrive = () => state.panel.plan.drives.at(-1)?.x ?? (state.panel.plan.start + state.panel.plan.end) / 2;

function look(name) {
  const [from, to] = VIEWS[name]();
  view.controls.target.copy(place(...to));
  view.camera.position.copy(place(...from));
  view.controls.update();
  render();
}

function standardViews() {
  document.getElementById("scene-views").replaceChildren(...Object.keys(VIEWS).map((name) => {
    const button = Object.assign(document.createElement("button"), { type: "button", textContent: name });
    button.addEventListener("click", () => look(name));
    return button;
  }));
}

// A force: a shaft and a tip thick enough to be seen, in front of whatever would hide them.
function arrow(parent, colour) {
  const group = new THREE.Group(), material = new THREE.MeshBasicMaterial({ color: colour, depthTest: false, transparent: true });
  const shaft = new THREE.Mesh(new THREE.CylinderGeometry(0.035, 0.035, 1, 10), material);
  const tip = new THREE.Mesh(new THREE.ConeGeometry(0.1, 0.22, 14), material);
  group.add(shaft, tip);
  group.renderOrder = shaft.renderOrder = tip.renderOrder = 5;
  parent.add(group);
  const set = (length, side) => {
    const long = Math.max(length, 0.3);
    shaft.scale.y = long - 0.22;
    shaft.position.y = (long - 0.22) / 2;
    tip.position.y = long - 0.11;
    group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), new THREE.Vector3(0, 0, side));
  };
  return { group, set };
}

function render() { view.renderer.render(view.scene, view.camera); }

// x along the track, y up, z across it; +y of the panel is away from the first camera.
const place = (x, y, z) => new THREE.Vector3(x, z, -y);

function box(parent, colour, size, centre) {
  const mesh = new THREE.Mesh(new THREE.BoxGeometry(size[0], size[2], size[1]), new THREE.MeshLambertMaterial({ color: colour }));
  mesh.position.copy(place(...centre));
  parent.add(mesh);
  return mesh;
}

function label(parent, text, at, size = 0.34) {
  const canvas = document.createElement("canvas"), pen = canvas.getContext("2d");
  const font = "600 44px system-ui, DejaVu Sans, sans-serif";
  pen.font = font;
  canvas.width = Math.ceil(pen.measureText(text).width) + 20;
  canvas.height = 60;
  pen.font = font;
  pen.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--ink").trim();
  pen.textBaseline = "middle";
  pen.fillText(text, 10, 30);
  const sprite = new THREE.Sprite(new THREE.SpriteMaterial({ map: new THREE.CanvasTexture(canvas), depthTest: false }));
  sprite.scale.set(size * canvas.width / canvas.height, size, 1);
  sprite.position.copy(place(...at));
  parent.add(sprite);
}

// A rail is a head, a web and a foot, swept along its running edge: [share of the width, height].
const PROFILE = [[0, 1], [1, 1], [1, 0.72], [0.62, 0.66], [0.62, 0.2], [1.1, 0.12], [1.1, 0], [-0.1, 0], [-0.1, 0.12], [0.38, 0.2], [0.38, 0.66], [0, 0.72]];

function rail(parent, colour, stations) {
  const count = PROFILE.length, index = [];
  for (let i = 0; i + 1 < stations; i++) {
    for (let j = 0; j < count; j++) {
      const a = i * count + j, b = i * count + (j + 1) % count;
      index.push(a, b, a + count, b, b + count, a + count);
    }
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(stations * count * 3), 3));
  geometry.setIndex(index);
  const mesh = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ color: colour, side: THREE.DoubleSide, flatShading: true }));
  mesh.frustumCulled = false;
  parent.add(mesh);
  return mesh;
}

function sweep(mesh, xs, edge, width, side) {
  const position = mesh.geometry.attributes.position;
  let n = 0;
  xs.forEach((x, i) => {
    for (const [share, up] of PROFILE) {
      const at = place(x, edge[i] + side * share * width[i], up * HEIGHT);
      position.setXYZ(n++, at.x, at.y, at.z);
    }
  });
  position.needsUpdate = true;
  mesh.geometry.computeVertexNormals();
}

function along(values, xs, x) {
  const i = Math.max(1, xs.findIndex((item) => item >= x - 1e-9));
  const share = Math.min(1, Math.max(0, (x - xs[i - 1]) / (xs[i] - xs[i - 1])));
  return values[i - 1] + share * (values[i] - values[i - 1]);
}

function build() {
  const { plan } = state.panel, { motion } = state.answer, scale = scaleNow();
  const scene = new THREE.Scene();
  scene.background = styleOf("--card");
  scene.add(new THREE.HemisphereLight(0xffffff, 0x777777, 2.2));
  const sun = new THREE.DirectionalLight(0xffffff, 1.4);
  sun.position.set(-3, 8, 6);
  scene.add(sun);
  // The track between the rails is drawn so wide that they never cross, whatever the scale.
  const reach = Math.max(...plan.rails.flatMap((item) => [...item.open, ...item.closed, ...item.stock].map(Math.abs)));
  const half = 0.45 + reach * scale;
  const parts = { scene, scale, half, rails: {}, drives: {}, chairs: {}, links: {} };
  for (const x of plan.beams) box(scene, styleOf("--chair"), [0.22, 2 * half + 1.3, 0.14], [x, 0, -0.14]);
  for (const item of plan.rails) {
    const base = item.side * half;
    const front = item.stock.map((y) => base + scale * y), head = item.x.map(() => Math.max(item.head_width, 0.05) * scale * 0.35);
    if (item.has_stock_rail) sweep(rail(scene, styleOf("--stock"), item.x.length), item.x, front, head, item.side);
    const own = motion.rails[item.name];
    parts.rails[item.name] = { item, base, mesh: rail(scene, styleOf("--accent"), own.x.length), front: (x) => along(front, item.x, x) };
    parts.chairs[item.name] = chairs(scene, item, motion);
  }
  for (const drive of plan.drives) parts.drives[drive.name] = machine(scene, parts, drive);
  for (const link of plan.links) parts.links[link.name] = box(scene, "#cc79a7", [0.05, 1, 0.05], [link.x, 0, 0.05]);
  parts.stones = state.answer.objects.map((object) => stone(scene, parts, object));
  return parts;
}

function chairs(scene, item, motion) {
  const forces = motion.chair_force[item.name];
  if (!forces) return [];
  return state.panel.plan.chairs.map((chair, number) => {
    if (!chair.rails.includes(item.name)) return null;
    return { number, x: chair.x, bar: box(scene, "#009e73", [0.07, 0.07, 1], [chair.x, 0, 0]), pad: box(scene, styleOf("--off"), [0.18, 0.5, 0.05], [chair.x, 0, -0.045]) };
  }).filter(Boolean);
}

function machine(scene, parts, drive) {
  const { item, front } = parts.rails[drive.rail];
  const y = front(drive.x) + item.side * 0.75;
  box(scene, "#e69f00", [0.5, 0.4, 0.34], [drive.x, y, 0.05]);
  label(scene, `Drive ${drive.name}`, [drive.x, y, 0.62]);
  return { drive, y, arrow: arrow(scene, styleOf("--pull")), rod: box(scene, styleOf("--ink"), [0.06, 1, 0.06], [drive.x, y, 0.06]) };
}

function stone(scene, parts, object) {
  const { item, front } = parts.rails[object.rail];
  const wide = object.size * parts.scale, y = front(object.x) - item.side * wide / 2;
  const mesh = new THREE.Mesh(new THREE.DodecahedronGeometry(0.5), new THREE.MeshLambertMaterial({ color: "#d55e00", flatShading: true }));
  // Longer along the rail and higher than it is, and in front of the rails, so that it is seen.
  mesh.material.depthTest = false;
  mesh.renderOrder = 4;
  mesh.scale.set(0.26, 0.26, Math.max(wide, 0.06));
  mesh.position.copy(place(object.x, y, HEIGHT * 0.86));
  scene.add(mesh);
  box(scene, "#d55e00", [0.025, 0.025, 0.62], [object.x, y, HEIGHT + 0.4]);
  label(scene, `${(1000 * object.size).toFixed(1).replace(".0", "")} mm`, [object.x, y, HEIGHT + 0.88], 0.42);
  const force = arrow(scene, "#cc79a7");
  force.group.position.copy(place(object.x, y, HEIGHT + 0.12));
  return { arrow: force, y, side: item.side };
}

function stretch(mesh, x, from, to, z) {
  mesh.position.copy(place(x, (from + to) / 2, z));
  mesh.scale.z = Math.max(Math.abs(to - from), 1e-3);
}

function pose(parts) {
  const { motion } = state.answer, now = state.frame, { scale } = parts;
  const edges = {};
  for (const [name, { item, base, mesh }] of Object.entries(parts.rails)) {
    const own = motion.rails[name], edge = own.edge[now].map((y) => base + scale * y);
    const width = own.x.map((x) => Math.max(along(item.width, item.x, x) * scale * 0.35, 0.012 * scale));
    sweep(mesh, own.x, edge, width, item.side);
    edges[name] = (x) => along(edge, own.x, x);
    for (const chair of parts.chairs[name]) {
      const force = Math.max(motion.chair_force[name][now][chair.number] ?? 0, 0);
      const tall = Math.max(force * KILO * 0.35, 1e-3), y = edges[name](chair.x) - item.side * 0.12;
      chair.bar.scale.y = tall;
      chair.bar.position.copy(place(chair.x, y, tall / 2));
      chair.pad.position.copy(place(chair.x, edges[name](chair.x), -0.045));
    }
  }
  state.panel.plan.drives.forEach((drive, number) => {
    const own = parts.drives[drive.name], y = edges[drive.rail](drive.x), force = motion.drive_force?.[now][number] ?? 0;
    stretch(own.rod, drive.x, own.y, y, 0.06);
    own.arrow.group.visible = Math.abs(force) > 30;
    own.arrow.group.position.copy(place(drive.x + 0.16, y, 0.2));
    own.arrow.set(Math.abs(force) * KILO * ARROW, -Math.sign(force));
  });
  for (const link of state.panel.plan.links) {
    const [a, b] = link.rails.map((name) => edges[name](link.x));
    stretch(parts.links[link.name], link.x, a, b, 0.05);
  }
  const force = motion.object_force?.[now] ?? 0;
  for (const { arrow, side } of parts.stones) {
    arrow.group.visible = force > 30;
    arrow.set(force * KILO * ARROW, -side);
  }
}

function free(scene) {
  scene.traverse((item) => {
    item.geometry?.dispose();
    item.material?.map?.dispose();
    item.material?.dispose?.();
  });
}

function fit() {
  const { canvas, renderer, camera } = view;
  const { clientWidth: width, clientHeight: height } = canvas;
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
  renderer.setSize(width, height, false);
  camera.aspect = width / Math.max(height, 1);
  camera.updateProjectionMatrix();
}

export function drawScene() {
  if (!state.answer) return;
  view ??= begin();
  if (!view.canvas.clientWidth) return;
  const built = view.built;
  const mark = `${scaleNow()} ${document.documentElement.dataset.theme} ${matchMedia("(prefers-color-scheme: dark)").matches}`;
  if (!built || view.answer !== state.answer || view.mark !== mark) {
    const first = view.panel !== state.panel;
    if (built) free(built.scene);
    view.built = build();
    Object.assign(view, { scene: view.built.scene, answer: state.answer, mark, panel: state.panel });
    if (first) { fit(); look("From the toe"); }
  }
  fit();
  pose(view.built);
  render();
  document.getElementById("scene-note").textContent =
    `Lateral scale × ${scaleNow()}. Forces: chairs green, drives on the rail orange, object pink. Drag turns, wheel zooms.`;
}
