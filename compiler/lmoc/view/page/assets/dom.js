// Elements of the page.

export const $ = (id) => document.getElementById(id);

/** Let an element say a text; where it says it already, nothing is laid out anew. */
export function putText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}
