// The parameters of the board: a row for each, which opens to its meaning, limits, a slider and a field.

const STEPS = 200, REACH = 4;

// The stretch of a slider: a quarter to four times the value, within the limits.
function stretch(value, [least, most]) {
  let [low, high] = value ? [value / REACH, value * REACH].sort((a, b) => a - b) : [-1, 1];
  if (least !== null) low = Math.max(low, least);
  if (most !== null) high = Math.min(high, most);
  return [low, high];
}

const shown = (value) => (typeof value === "number" ? String(Number(value.toPrecision(6))) : value);

export function showParameters(place, parameters, order) {
  place.replaceChildren(...parameters.map(([name, value]) => {
    const row = document.createElement("div"), open = document.createElement("button");
    const output = document.createElement("output");
    row.className = "parameter";
    row.dataset.name = name;
    open.type = "button";
    output.textContent = shown(value);
    open.append(name, output);
    open.addEventListener("click", () => {
      if (row.childElementCount > 1) { row.lastElementChild.remove(); return; }
      order({ do: "describe", name }, (said) => {
        if (said.good && row.childElementCount === 1) row.append(editor(name, said.parameter, output, order));
      });
    });
    row.append(open);
    return row;
  }));
}

function editor(name, { unit, value, limits, meaning }, output, order) {
  const place = document.createElement("div"), note = document.createElement("p"), line = document.createElement("p");
  const field = document.createElement("input"), set = document.createElement("button");
  const [least, most] = limits.map((limit) => (limit === null ? "no limit" : shown(limit)));
  note.className = "note";
  note.textContent = typeof value === "number" ? `${meaning}. ${least} to ${most} ${unit}` : meaning;
  line.className = "row";
  set.type = "button";
  set.textContent = "Set";
  field.type = typeof value === "number" ? "number" : "text";
  if (typeof value === "number") field.step = "any";
  field.value = shown(value);
  field.setAttribute("aria-label", name);
  const send = (wanted) => order({ do: "set", name, value: wanted }, (said) => {
    if (!said.good) return;
    order({ do: "describe", name }, (now) => {
      if (!now.good) return;
      output.textContent = field.value = shown(now.parameter.value);
      output.className = "changed";
    });
  });
  set.addEventListener("click", () => send(field.type === "number" ? Number(field.value) : field.value));
  line.append(field, ` ${unit} `, set);
  place.append(note, line);
  if (typeof value === "number") place.append(slider(name, value, limits, field, send));
  return place;
}

function slider(name, value, limits, field, send) {
  const range = document.createElement("input"), [low, high] = stretch(value, limits);
  const whole = Number.isInteger(value) && limits.every(Number.isInteger);
  Object.assign(range, { type: "range", min: low, max: high, step: whole ? 1 : (high - low) / STEPS, value });
  range.setAttribute("aria-label", `${name}, slider`);
  range.addEventListener("input", () => { field.value = shown(Number(range.value)); });
  range.addEventListener("change", () => send(Number(range.value)));
  return range;
}

export function filterParameters(place, text) {
  for (const row of place.children) row.hidden = !row.dataset.name.includes(text);
}
