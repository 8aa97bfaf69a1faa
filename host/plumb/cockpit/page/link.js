// The link to the server: messages, orders and their answers, and the heartbeat of the page that holds the board.

const HEARTBEAT_MS = 100, RECONNECT_MS = 1000, SILENT_MS = 1500;

export class Link {
  // rows: get the samples; received: called with a state; answered: with an answer; silent: called when the server is silent.
  // alive: whether to send heartbeats.
  constructor(rows, { received, answered, silent, alive }) {
    Object.assign(this, { rows, received, answered, silent, alive, socket: null, number: 0, receivedAt: 0 });
    this.tick = this.drawnTick = 0;
    this.waiting = new Map();
    this.connect();
    setInterval(() => { if (alive()) this.send({ do: "alive", tick: this.drawnTick }); }, HEARTBEAT_MS);
    setInterval(() => { if (performance.now() - this.receivedAt > SILENT_MS) silent(); }, SILENT_MS / 2);
  }

  connect() {
    this.socket = new WebSocket(`ws://${location.host}${location.pathname}live`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onmessage = ({ data }) => this.take(data);
    this.socket.onclose = () => {
      this.waiting.clear();
      this.silent();
      setTimeout(() => this.connect(), RECONNECT_MS);
    };
  }

  take(data) {
    this.receivedAt = performance.now();
    if (typeof data !== "string") { this.tick = this.rows.push(data); return; }
    const said = JSON.parse(data);
    if (said.type !== "state") { this.answer(said); return; }
    this.tick = said.tick;
    this.received(said);
  }

  // Everything that came is on the screen. A heartbeat is for the newest picture that was drawn, so that a page that
  // hangs, or shows the past, does not keep a machine armed.
  drawn() { this.drawnTick = this.tick; }

  send(order) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(order));
  }

  // Sends an order; then: called with its answer.
  order(what, then) {
    this.number += 1;
    if (then) this.waiting.set(this.number, then);
    this.send({ ...what, number: this.number });
  }

  answer(said) {
    const then = this.waiting.get(said.number);
    this.waiting.delete(said.number);
    this.answered(said);
    if (then) then(said);
  }
}
