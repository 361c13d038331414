// State of the page, and listeners to its changes.

export const state = {
  start: null, // first reply of the server
  panel: null, // the panel as the server described it
  values: {}, // slider values by key, in the unit of the slider
  trapped: true,
  kind: "spring",
  request: null, // request of the throw shown
  answer: null, // reply of the server
  frame: 0,
  pins: [], // {name, request, answer, shown}
  overlay: null, // a measured movement as a sheet
  hidden: new Set(), // titles of rows of curves that are not shown
};

const listeners = new Map();

export function on(what, listener) {
  if (!listeners.has(what)) listeners.set(what, []);
  listeners.get(what).push(listener);
}

export function notify(what) {
  for (const listener of listeners.get(what) ?? []) listener();
}

export const controlOf = (key) => state.panel.controls.find((item) => item.key === key);

const texted = (key) => {
  const { unit } = controlOf(key);
  return unit ? `${state.values[key]} ${unit}` : state.values[key];
};

// The named place where x is, if it is at one.
export const placeNear = (x) => state.panel.places.find((item) => Math.abs(item.x - x) < 1e-6);

// The throw set by the sliders; values carry their units, as in a panel file.
export function currentRequest(preview) {
  const settings = {};
  for (const { key, value } of state.panel.controls) {
    if (!key.startsWith("object.") && state.values[key] !== value) settings[key] = texted(key);
  }
  const near = placeNear(state.values["object.x"]);
  const at = near ? near.name : `x = ${texted("object.x")}`;
  const object = state.trapped
    ? { size: texted("object.size"), at, stiffness: texted("object.stiffness"), kind: state.kind }
    : null;
  return { panel: state.panel.mark, object, settings, preview };
}
