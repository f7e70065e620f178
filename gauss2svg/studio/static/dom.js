// Functions that make elements and show messages. `by` and `all` of viewer.js find elements.

const SVG = "http://www.w3.org/2000/svg";

/** @typedef {Record<string, any>} Attributes values by name; functions are listeners, null and false are left out */
/** @typedef {(Node | string | null)[]} Children null is left out */

/**
 * @template {Element} T
 * @param {T} element
 * @param {Attributes} attributes
 * @param {Children} children
 */
function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name, value);
    else if (value !== null && value !== undefined && value !== false) element.setAttribute(name, value === true ? "" : value);
  }
  for (const child of children) if (child !== null) element.append(child);
  return element;
}
/**
 * @template {keyof HTMLElementTagNameMap} Tag
 * @param {Tag} tag
 * @param {Attributes} attributes
 * @param {Children} children
 */
export const make = (tag, attributes = {}, ...children) =>
  fill(document.createElement(tag), attributes, children);
/** @param {string} tag @param {Attributes} attributes */
export const draw = (tag, attributes) => fill(document.createElementNS(SVG, tag), attributes, []);

/**
 * Announces a line to screen readers, which read it at their next pause.
 * @param {string} text
 */
export function say(text) {
  by("live").textContent = text;
}

/**
 * Shows an error in the element with an id, or hides that element if the text is "".
 * @param {string} id
 * @param {string} text
 */
export function complain(id, text) {
  const line = by(id);
  line.textContent = text;
  line.hidden = text === "";
}
