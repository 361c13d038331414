// What is on the screen, and who wants to hear when it changes.

export const state = {
  start: null, // what the server told first
  panel: null, // the panel as the server described it
  values: {}, // slider values by key, in the unit of the slider
  trapped: true,
  asked: null, // the throw that is shown, as it was asked for
  answer: null, // what the server answered
  frame: 0,
  pins: [], // {name, asked, answer, shown}
  overlay: null, // a measured movement as a sheet
};

const heard = new Map();

export function on(what, listener) {
  if (!heard.has(what)) heard.set(what, []);
  heard.get(what).push(listener);
}

export function tell(what) {
  for (const listener of heard.get(what) ?? []) listener();
}

export const controlOf = (key) => state.panel.controls.find((item) => item.key === key);

const texted = (key) => {
  const { unit } = controlOf(key);
  return unit ? `${state.values[key]} ${unit}` : state.values[key];
};

// The throw that the sliders stand for; values carry their units, as in a panel file.
export function askedNow(preview) {
  const settings = {};
  for (const { key, value } of state.panel.controls) {
    if (!key.startsWith("object.") && state.values[key] !== value) settings[key] = texted(key);
  }
  const object = state.trapped
    ? { size: texted("object.size"), at: `x = ${texted("object.x")}`, stiffness: texted("object.stiffness") }
    : null;
  return { panel: state.panel.mark, object, settings, preview };
}
