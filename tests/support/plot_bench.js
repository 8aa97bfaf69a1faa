// Eight signals at a rate, drawn by the modules of the cockpit's page on a document of its own. Time passes by frames.

(async () => {
  const WIDTH_PX = 1000, HEIGHT_PX = 110, FRAMES_PS = 30, HEADER_WORDS = 6, TICK = 7;
  const UNITS = ["deg", "deg", "deg", "deg/s", "deg/s", "us", "count", "count"];
  const [{ Rows }, { View }, { plotsOf }] = await Promise.all(["rows", "view", "plots"].map((name) => import(`./${name}.js`)));
  const style = { ground: "#fff", rule: "#ddd", soft: "#555", colours: Array(8).fill("#2a5ca8") };
  const lineTo = CanvasRenderingContext2D.prototype.lineTo;
  let lines = 0;
  CanvasRenderingContext2D.prototype.lineTo = function (x, y) { lines++; lineTo.call(this, x, y); };

  // A value that needs no memory: a slow wave and a fast one, of the same size in every window.
  const value = (row, rate, column) => Math.sin(row / rate * (column + 1)) * 5 + Math.sin(row * 12.9898 + column) * 2;

  class Bench {
    constructor(rate) {
      Object.assign(this, { rate, at: 0, owed: 0, rows: new Rows() });
      this.view = new View(this.rows);
      this.plots = plotsOf(UNITS.map((unit, column) => ({ name: `s${column}`, unit })), this.rows, this.view);
      document.body.replaceChildren(...this.plots.map((plot) => plot.element));
      for (const { canvas, panel } of this.plots) {
        Object.assign(canvas.style, { width: `${WIDTH_PX}px`, height: `${HEIGHT_PX}px`, display: "block" });
        panel.measure();
      }
    }

    // Rows as the server sends them.
    feed(count) {
      const columns = UNITS.length, buffer = new ArrayBuffer(4 * HEADER_WORDS + 8 * count + 4 * count * columns);
      new Uint32Array(buffer, 0, HEADER_WORDS).set([TICK, 1, this.at, count, columns, 0]);
      const times = new Float64Array(buffer, 4 * HEADER_WORDS, count);
      const values = new Float32Array(buffer, 4 * HEADER_WORDS + 8 * count, count * columns);
      for (let row = 0; row < count; row++, this.at++) {
        times[row] = this.at / this.rate;
        for (let column = 0; column < columns; column++) values[row * columns + column] = value(this.at, this.rate, column);
      }
      return this.rows.push(buffer);
    }

    draw() {
      for (const { panel } of this.plots) {
        panel.seen = true;
        panel.draw(style, 1 / this.rate);
      }
    }

    // One frame of time; returns the points that were drawn.
    frame() {
      this.owed += this.rate / FRAMES_PS;
      const count = Math.floor(this.owed);
      this.owed -= count;
      this.feed(count);
      lines = 0;
      this.draw();
      return lines;
    }

    // Frames as a browser shows them, each with its raster.
    async frames(count) {
      const points = [];
      for (let index = 0; index < count; index++) {
        await new Promise(requestAnimationFrame);
        points.push(this.frame());
      }
      return points;
    }

    get pictures() {
      return this.plots.map(({ panel: { pen, x0, width, y0, height } }) => pen.getImageData(x0, 0, width, y0 + height + 1).data);
    }

    // The greatest difference of a channel of a pixel.
    difference(before) {
      let found = 0;
      for (const [index, picture] of this.pictures.entries()) {
        for (let at = 0; at < picture.length; at++) {
          const apart = Math.abs(picture[at] - before[index][at]);
          if (apart > found) found = apart;
        }
      }
      return found;
    }

    // The least and the greatest value of the first signal in a picture, as it is drawn.
    spread(plot) {
      const { panel, signals } = this.plots[plot], range = [Infinity, -Infinity];
      signals[0].line.spread(panel.left, panel.left + panel.width, range);
      return range;
    }
  }
  window.Bench = Bench;
  return true;
})()
