// Elements without markup in strings: what comes from a daemon is text, never HTML.

/** An element; `on*` are listeners, other properties are set, children may be text. */
export function h(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name.includes("-")) element.setAttribute(name, value);
    else element[name] = value;
  }
  element.append(...children.filter((child) => child !== null));
  return element;
}

export const byId = (id) => document.getElementById(id);

/** Set a text only when it differs: layout is left alone, selections survive. */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export function setHidden(element, hidden) {
  if (element.hidden !== hidden) element.hidden = hidden;
}

/** A number for people: a fixed number of decimals, a real minus sign, a dash for none. */
export function shown(value, decimals = 1) {
  if (value === null || value === undefined) return "–";
  const text = value.toFixed(decimals);
  return (Number(text) === 0 ? (0).toFixed(decimals) : text).replace("-", "−");
}

const leaving = new WeakMap();

/** A message that goes away; one that is shown already stays longer. */
export function toast(text, kind = "info") {
  const list = byId("toasts");
  const className = `toast ${kind}`;
  let item = [...list.children].find((each) => each.className === className && each.textContent === text);
  if (item) clearTimeout(leaving.get(item));
  else {
    item = h("div", { className }, text);
    while (list.children.length > 2) list.firstChild.remove();
    list.append(item);
  }
  leaving.set(item, setTimeout(() => item.remove(), kind === "error" ? 9000 : 4000));
}

/** Do what may be refused; the refusal is shown. */
export async function attempt(work) {
  try {
    await work();
  } catch (error) {
    toast(error.message, "error");
  }
}
