// SPDX-License-Identifier: MIT
// Small helpers. Text goes in as text, never as HTML, and only where it has changed.

/** The element with this id. */
export const byId = (id) => document.getElementById(id);

/** Make an element with a class, text and children. */
export function make(tag, className = "", content = "", ...children) {
  const element = document.createElement(tag);
  if (className) element.className = className;
  if (content) text(element, content);
  element.append(...children);
  return element;
}

const shown = new WeakMap();

/** Show a text; the DOM is touched only when it differs from the last one. */
export function text(element, value) {
  if (shown.get(element) === value) return;
  shown.set(element, value);
  element.textContent = value;
}

/** Set an attribute, or remove it for null; only when it differs. */
export function attribute(element, name, value) {
  if (element.getAttribute(name) === value) return;
  if (value === null) element.removeAttribute(name);
  else element.setAttribute(name, value);
}

/** Show or hide an element; by the attribute, for SVG has no such property. */
export function visible(element, isVisible) {
  attribute(element, "hidden", isVisible ? null : "");
}

/**
 * Keep one child per key, in the order of the keys: what is new is made, what is gone removed.
 * Returns the child of each key, so that the caller fills it.
 */
export function keep(parent, known, keys, create) {
  for (const [key, child] of known) {
    if (keys.includes(key)) continue;
    child.root.remove();
    known.delete(key);
  }
  keys.forEach((key, index) => {
    if (!known.has(key)) known.set(key, create(key));
    const { root } = known.get(key);
    if (parent.children[index] !== root) parent.insertBefore(root, parent.children[index] ?? null);
  });
  return keys.map((key) => known.get(key));
}
