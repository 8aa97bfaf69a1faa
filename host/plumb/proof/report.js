"use strict";
/* Width, zoom, pan, cursor and hidden lines of the plots of a report page. All plots over time share one time axis. The
 * page shows the whole run without this script; it draws by the same rules as svg_plot.py. */
(() => {
  const [FULL, NARROWEST, HEIGHT, LEFT, RIGHT, TOP, BOTTOM] = [1056, 280, 250, 76, 12, 10, 42];
  const FLOOR = HEIGHT - BOTTOM, TIME_TICKS = 10, TICK_PX = 50, VALUE_TICKS = 7, BAND_SHARE = 0.5;
  const CLICK_PX = 4, LETTER_PX = 6.6, LABEL_GAP_PX = 6;
  let WIDTH = FULL, COLUMNS = FULL - LEFT - RIGHT;

  /* Fit all drawings to the width of the page: what the page draws for FULL is narrowed right of the axis of values,
   * text and dots keep their size. Labels of ticks that would overlap are hidden. */
  const svgs = [...document.querySelectorAll(".frame svg")];
  const drawnAt = new WeakMap();
  const placed = (element, name) => {
    if (!drawnAt.has(element)) drawnAt.set(element, +element.getAttribute(name));
    const at = drawnAt.get(element);
    return at <= LEFT ? at : LEFT + (at - LEFT) * COLUMNS / (FULL - LEFT - RIGHT);
  };
  const fit = () => {
    const width = document.body.clientWidth - 2 * parseFloat(getComputedStyle(document.body).paddingLeft);
    WIDTH = width > 0 ? Math.round(Math.min(Math.max(width, NARROWEST), FULL)) : FULL;
    COLUMNS = WIDTH - LEFT - RIGHT;
    const share = COLUMNS / (FULL - LEFT - RIGHT);
    for (const svg of svgs) {
      svg.setAttribute("viewBox", `0 0 ${WIDTH} ${svg.viewBox.baseVal.height}`);
      svg.querySelector("clipPath rect").setAttribute("width", COLUMNS);
      const still = svg.closest(".still") !== null;
      for (const path of svg.querySelectorAll(still ? "path" : "path.axis"))
        path.setAttribute("transform", `matrix(${share} 0 0 1 ${LEFT * (1 - share)} 0)`);
      for (const dot of svg.querySelectorAll("circle")) dot.setAttribute("cx", placed(dot, "cx"));
      for (const name of svg.querySelectorAll("text[x]:not(.v)")) {
        const long = LETTER_PX * name.textContent.length, ends = name.style.textAnchor === "end", at = placed(name, "x");
        name.setAttribute("x", name.classList.contains("t") ? at
          : ends ? Math.max(at, LEFT + long) : Math.max(LEFT, Math.min(at, WIDTH - RIGHT - long)));
      }
      let free = 0;
      for (const label of svg.querySelectorAll(".ticks .t")) {
        const long = LETTER_PX * label.textContent.length, at = +label.getAttribute("x");
        const left = label.classList.contains("e") ? at - long : at - long / 2;
        label.setAttribute("visibility", left < free ? "hidden" : "visible");
        if (left >= free) free = left + long + LABEL_GAP_PX;
      }
    }
  };
  document.documentElement.classList.add("fitted");
  fit();
  addEventListener("resize", fit);

  const floats = text => {
    const raw = atob(text), bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    return new Float32Array(bytes.buffer);
  };
  const timesOf = (given, count) =>
    typeof given === "string" ? floats(given) : Float64Array.from({ length: count }, (_, i) => given[0] + i * given[1]);

  const plots = JSON.parse(document.getElementById("plot-data").textContent).map((given, index) => {
    const section = document.getElementById("plot" + index);
    const lines = given.lines.map(line => {
      const values = floats(line.values);
      return { ...line, values, times: timesOf(line.time, values.length), band: line.band && floats(line.band),
               shown: true };
    });
    return { unit: given.unit, lines, section, svg: section.querySelector("svg"), values: null,
             keys: [...section.querySelectorAll(".key")] };
  });
  if (!plots.length) return;
  const ends = plots.flatMap(plot => plot.lines.filter(l => l.times.length).map(l => [l.times[0], l.times.at(-1)]));
  const whole = { low: Math.min(...ends.map(e => e[0])), high: Math.max(...ends.map(e => e[1])) };
  if (!(whole.high > whole.low)) return;
  const steps = Math.max(...plots.flatMap(plot => plot.lines.map(line => line.times.length)));
  const least = 4 * (whole.high - whole.low) / steps;
  let view = { ...whole };

  /* Index of the first time that is not below t. */
  const from = (times, t) => {
    let low = 0, high = times.length;
    while (low < high) { const mid = (low + high) >> 1; if (times[mid] < t) low = mid + 1; else high = mid; }
    return low;
  };
  const span = line => [Math.max(0, from(line.times, view.low) - 1),
                        Math.min(line.times.length, from(line.times, view.high) + 1)];
  const ticks = (low, high, most) => {
    const rough = (high - low) / most, power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map(s => s * power).find(s => s >= rough * (1 - 1e-9));
    const found = [];
    for (let i = Math.ceil(low / step - 1e-9); i <= Math.floor(high / step + 1e-9); i++) found.push(i * step);
    return { found, step };
  };
  const text = (value, step) => {
    if (Math.abs(value) < 1e-9 * step) return "0";
    if (step < 1e-4 || Math.abs(value) >= 1e6)
      return value.toExponential(2).replace(/\.?0+e/, "e").replace("e+", "e");
    return value.toFixed(Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
  };
  const x = t => LEFT + (t - view.low) / (view.high - view.low) * COLUMNS;

  /* Class and x of a label below the time axis: centred, and at the right end within the drawing. */
  const anchored = px => px > WIDTH - RIGHT - 6 ? `t e" x="${WIDTH - 1}` : `t" x="${px.toFixed(1)}`;

  const valueRange = plot => {
    if (plot.values) return plot.values;
    let low = Infinity, high = -Infinity, below = Infinity, above = -Infinity;
    for (const line of plot.lines) if (line.shown) {
      const [first, end] = span(line);
      for (let i = first; i < end; i++) {
        const v = line.values[i];
        if (!Number.isFinite(v) || line.times[i] < view.low || line.times[i] > view.high) continue;
        low = Math.min(low, v); high = Math.max(high, v);
        if (line.band && Number.isFinite(line.band[i])) {
          below = Math.min(below, v - line.band[i]); above = Math.max(above, v + line.band[i]);
        }
      }
    }
    if (low === Infinity) return [-1, 1];
    const room = BAND_SHARE * (high - low);
    [low, high] = [Math.min(low, Math.max(low - room, below)), Math.max(high, Math.min(high + room, above))];
    if (high - low <= 1e-12 * Math.max(Math.abs(high), Math.abs(low))) {
      const apart = 0.5 * Math.abs(high) || 1;
      return [low - apart, high + apart];
    }
    return [low - 0.04 * (high - low), high + 0.04 * (high - low)];
  };

  /* At most two points for each pixel column: its least and its greatest value, in order of time. */
  const points = (line, first, end) => {
    if (end - first <= 2 * COLUMNS) return Array.from({ length: end - first }, (_, i) => first + i);
    const found = [];
    for (let i = first; i < end;) {
      const column = Math.floor(x(line.times[i]));
      let low = i, high = i;
      for (; i < end && Math.floor(x(line.times[i])) === column; i++) {
        if (!(line.values[i] >= line.values[low])) low = i;
        if (!(line.values[i] <= line.values[high])) high = i;
      }
      found.push(...(low === high ? [low] : low < high ? [low, high] : [high, low]));
    }
    return found;
  };

  const draw = plot => {
    const [low, high] = plot.range = valueRange(plot);
    const y = v => Math.max(-1e5, Math.min(1e5, FLOOR - (v - low) / (high - low) * (FLOOR - TOP)));
    const most = Math.min(TIME_TICKS, Math.floor(COLUMNS / TICK_PX));
    const t = ticks(view.low, view.high, most), v = ticks(low, high, VALUE_TICKS);
    plot.svg.querySelector(".ticks").innerHTML = [
      ...t.found.map(at => `<path class="grid" d="M${x(at).toFixed(1)},${TOP}V${FLOOR}"/>` +
        `<text class="${anchored(x(at))}" y="${FLOOR + 16}">${text(at, t.step)}</text>`),
      ...v.found.map(at => `<path class="grid" d="M${LEFT},${y(at).toFixed(1)}H${WIDTH - RIGHT}"/>` +
        `<text class="v" x="${LEFT - 7}" y="${(y(at) + 4).toFixed(1)}">${text(at, v.step)}</text>`)].join("");
    const paths = plot.svg.querySelectorAll(".lines path");
    let next = 0;
    for (const line of plot.lines) {
      const [first, end] = span(line), at = line.shown ? points(line, first, end) : [];
      if (line.band) {
        const there = at.filter(i => Number.isFinite(line.values[i]) && Number.isFinite(line.band[i]));
        const edge = (i, sign) => `${x(line.times[i]).toFixed(1)},${y(line.values[i] + sign * line.band[i]).toFixed(1)}`;
        const outline = [...there.map(i => edge(i, 1)), ...there.reverse().map(i => edge(i, -1))];
        paths[next++].setAttribute("d", outline.length ? "M" + outline.join("L") : "");
      }
      let pen = "M", d = "";
      for (const i of at) {
        if (Number.isFinite(line.values[i])) {
          d += `${pen}${x(line.times[i]).toFixed(1)},${y(line.values[i]).toFixed(1)}`; pen = "L";
        } else pen = "M";
      }
      paths[next++].setAttribute("d", d);
    }
  };
  let asked = false;
  const drawAll = () => {
    if (asked) return;
    asked = true;
    setTimeout(() => { // once for all events that wait; a page that is not shown draws, too
      asked = false;
      plots.forEach(draw);
      point(null);
      document.body.dataset.low = view.low;
      document.body.dataset.high = view.high;
    });
  };
  const look = (low, high) => {
    const width = Math.min(Math.max(high - low, least), whole.high - whole.low);
    low = Math.min(Math.max(low, whole.low), whole.high - width);
    view = { low, high: low + width };
    drawAll();
  };
  const zoom = (factor, around) => look(around - (around - view.low) * factor, around + (view.high - around) * factor);
  const pan = share => look(view.low + share * (view.high - view.low), view.high + share * (view.high - view.low));
  const reset = () => { plots.forEach(plot => { plot.values = null; }); look(whole.low, whole.high); };
  const middle = () => (view.low + view.high) / 2;

  /* The cursor: a line at one time in all plots, and every line's value at its nearest sample. null: no cursor. */
  const readout = document.querySelector(".tools output");
  const point = time => {
    for (const plot of plots) {
      plot.cursor.setAttribute("d", time === null ? "" : `M${x(time).toFixed(1)},${TOP}V${FLOOR}`);
      plot.lines.forEach((line, i) => {
        const output = plot.keys[i].querySelector("output");
        if (time === null) { output.textContent = ""; return; }
        let at = Math.min(from(line.times, time), line.times.length - 1);
        if (at > 0 && time - line.times[at - 1] < line.times[at] - time) at--;
        const value = line.values[at], band = line.band ? ` ± ${line.band[at].toPrecision(3)}` : "";
        output.textContent = Number.isFinite(value) ? value.toPrecision(6) + band : "–";
      });
    }
    readout.textContent = time === null ? `${view.low.toFixed(3)} s to ${view.high.toFixed(3)} s`
                                        : `cursor at ${time.toFixed(4)} s`;
  };

  const make = (plot, name, kind) => {
    const element = document.createElementNS("http://www.w3.org/2000/svg", name);
    element.setAttribute("class", kind);
    plot.svg.append(element);
    return element;
  };
  const keyed = { "+": () => zoom(0.5, middle()), "=": () => zoom(0.5, middle()), "-": () => zoom(2, middle()),
                  ArrowLeft: () => pan(-0.2), ArrowRight: () => pan(0.2), 0: reset, Escape: reset };
  for (const plot of plots) {
    const { svg } = plot;
    plot.cursor = make(plot, "path", "cursor");
    plot.brush = make(plot, "path", "brush");
    const place = event => {
      const box = svg.getBoundingClientRect();
      const px = Math.min(Math.max((event.clientX - box.left) / box.width * WIDTH, LEFT), WIDTH - RIGHT);
      const py = Math.min(Math.max((event.clientY - box.top) / box.height * HEIGHT, TOP), FLOOR);
      const [low, high] = plot.range || valueRange(plot);
      return { px, py, time: view.low + (px - LEFT) / COLUMNS * (view.high - view.low),
               value: low + (FLOOR - py) / (FLOOR - TOP) * (high - low) };
    };
    let drag = null;
    svg.setAttribute("tabindex", "0");
    svg.addEventListener("keydown", event => {
      if (event.ctrlKey || event.metaKey || event.altKey || !(event.key in keyed)) return;
      event.preventDefault();
      keyed[event.key]();
    });
    svg.addEventListener("wheel", event => {
      if (!event.ctrlKey && !event.metaKey) return; // the page scrolls
      event.preventDefault();
      zoom(event.deltaY < 0 ? 0.8 : 1.25, place(event).time);
    }, { passive: false });
    svg.addEventListener("pointerdown", event => {
      if (event.button) return;
      drag = { ...place(event), pans: event.shiftKey || event.pointerType === "touch", view: { ...view } };
      try { svg.setPointerCapture(event.pointerId); } catch { /* a pointer that is gone already */ }
    });
    svg.addEventListener("pointermove", event => {
      const at = place(event);
      if (!drag) { point(at.time); return; }
      if (drag.pans) {
        const shift = (drag.px - at.px) / COLUMNS * (drag.view.high - drag.view.low);
        look(drag.view.low + shift, drag.view.high + shift);
        return;
      }
      drag.tall = Math.abs(at.py - drag.py) > 2 * Math.abs(at.px - drag.px);
      plot.brush.setAttribute("d", drag.tall ? `M${LEFT},${drag.py}H${WIDTH - RIGHT}V${at.py}H${LEFT}Z`
                                             : `M${drag.px},${TOP}H${at.px}V${FLOOR}H${drag.px}Z`);
    });
    svg.addEventListener("pointerup", event => {
      const begun = drag, at = place(event);
      drag = null;
      plot.brush.setAttribute("d", "");
      if (!begun || begun.pans) return;
      if (begun.tall && Math.abs(at.py - begun.py) > CLICK_PX) {
        plot.values = [Math.min(begun.value, at.value), Math.max(begun.value, at.value)];
        drawAll();
      } else if (!begun.tall && Math.abs(at.px - begun.px) > CLICK_PX) {
        look(Math.min(begun.time, at.time), Math.max(begun.time, at.time));
      }
    });
    svg.addEventListener("pointercancel", () => { drag = null; plot.brush.setAttribute("d", ""); });
    svg.addEventListener("pointerleave", () => { if (!drag) point(null); });
    svg.addEventListener("dblclick", reset);
    plot.keys.forEach((key, i) => key.addEventListener("click", () => {
      plot.lines[i].shown = !plot.lines[i].shown;
      key.setAttribute("aria-pressed", plot.lines[i].shown);
      draw(plot);
    }));
  }
  addEventListener("resize", drawAll);
  const acts = { in: keyed["+"], out: keyed["-"], left: keyed.ArrowLeft, right: keyed.ArrowRight, all: reset };
  for (const button of document.querySelectorAll(".tools button"))
    button.addEventListener("click", acts[button.dataset.act]);
  document.documentElement.classList.add("live");
  drawAll();
})();
