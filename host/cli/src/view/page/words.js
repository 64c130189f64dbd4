// Elements, numbers and units as the page writes them.
const at = id => document.getElementById(id);
const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** Sets a text where it differs, so that what reads it aloud is not disturbed. */
function say(id, text) {
  const element = typeof id === "string" ? at(id) : id;
  if (element.textContent !== text) element.textContent = text;
}

/** A whole number with thin spaces between thousands, from five digits on. */
const whole = n => n < 10000 ? String(n) : String(n).replace(/\B(?=(\d{3})+$)/g, "\u2009");

/** Three digits, without powers of ten. */
function three(v) {
  if (v === 0) return "0";
  const digits = Math.max(0, 2 - Math.floor(Math.log10(Math.abs(v))));
  return v.toFixed(Math.min(digits, 6)).replace("-", "−");
}

const seconds = s => s < 1e-3 ? `${three(s * 1e6)} µs` : s < 1 ? `${(s * 1e3).toFixed(2)} ms` : `${s.toFixed(2)} s`;
const percent = share => `${(100 * share).toFixed(2)} %`;
const hex = n => `0x${n.toString(16).padStart(4, "0")}`;

/** A number that a person typed, decimal or 0x. */
const typed = text => /^(0x[0-9a-f]+|\d+)$/i.test(text.trim()) ? Number(text.trim()) : NaN;

/** An element with attributes and children. */
function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}
