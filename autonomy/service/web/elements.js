// The page's elements, by their names.

export const $ = (id) => document.getElementById(id);

/** Write text and class, where they differ: a page that is not touched is not laid out again. */
export function put(id, text, level = "") {
  const element = $(id);
  if (element.textContent !== text) element.textContent = text;
  if (element.className !== level) element.className = level;
}

export function say(text, bad = false) {
  put("said", text, bad ? "bad" : "");
}
