// Elements, and their text: the page is written to only where something changed.

export const byId = (id) => document.getElementById(id);

export function element(kind, className = "", ...children) {
  const found = document.createElement(kind);
  if (className) found.className = className;
  found.append(...children);
  return found;
}

export function setText(place, said) {
  const text = String(said);
  if (place.textContent !== text) place.textContent = text;
}

// A table with a line for each [name, text, bad].
export function setTable(body, lines) {
  while (body.rows.length > lines.length) body.lastElementChild.remove();
  while (body.rows.length < lines.length) body.append(element("tr", "", element("td"), element("td")));
  lines.forEach(([name, text, bad], index) => {
    const line = body.rows[index], kind = bad ? "bad" : "";
    if (line.className !== kind) line.className = kind;
    setText(line.cells[0], name);
    setText(line.cells[1], text);
  });
}
