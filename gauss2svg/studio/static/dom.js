// Elements (found by `by` and `all` of viewer.js), and the lines that tell what happened.

const SVG = "http://www.w3.org/2000/svg";

// Attributes by name; functions are listeners, null and false are left out.
function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name, value);
    else if (value !== null && value !== undefined && value !== false) element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.filter((one) => one !== null));
  return element;
}
export const make = (tag, attributes = {}, ...children) =>
  fill(document.createElement(tag), attributes, children);
export const draw = (tag, attributes = {}, ...children) =>
  fill(document.createElementNS(SVG, tag), attributes, children);

// Read by screen readers when they pause.
export function say(text) {
  by("live").textContent = text;
}

// An error beside what caused it; "" takes it away.
export function complain(id, text) {
  const line = by(id);
  line.textContent = text;
  line.hidden = text === "";
}

export function debounced(action, milliseconds) {
  let timer;
  return () => {
    clearTimeout(timer);
    timer = setTimeout(action, milliseconds);
  };
}
