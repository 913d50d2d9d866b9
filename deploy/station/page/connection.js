// SPDX-License-Identifier: MIT
// The socket to the base station: it opens itself again, and it knows whether what is shown is still true.

/** A picture older than this is no longer one of the present, ms. */
const FRESH_MS = 1000;
/** A socket that is silent for this long is dead, whatever TCP believes, ms. */
const DEAD_MS = 4000;
const CHECK_MS = 100;
const FIRST_RETRY_MS = 250;
const LAST_RETRY_MS = 5000;
/** Set-points are discarded while this much waits to be sent: an old one is worse than none, bytes. */
const BACKLOG_BYTES = 16384;

export class Connection {
  /**
   * @param {string} url of the socket
   * @param {{message: function, change: function, closed: function}} handlers `message(kind, fields)`;
   *   `change(isFresh)`; `closed()` after a socket closed, before the next is tried
   */
  constructor(url, handlers) {
    this.url = url;
    this.handlers = handlers;
    this.isFresh = false;
    this.pictureMs = null;
    this._nextId = 1;
    this._retryMs = FIRST_RETRY_MS;
    this._timeS = null;
    this._isWanted = false;
    this._hasHello = false;
    this._isFirst = true;
    setInterval(() => this._check(), CHECK_MS);
    addEventListener("online", () => this._retryNow());
    document.addEventListener("visibilitychange", () => !document.hidden && this._retryNow());
  }

  /** Connect, and stay connected. */
  open() {
    this._isWanted = true;
    this._retryNow();
  }

  /** Disconnect, and stay so. */
  close() {
    this._isWanted = false;
    clearTimeout(this._timer);
    this._disconnect();
  }

  get isOpen() {
    return this._hasHello && this._socket?.readyState === WebSocket.OPEN;
  }

  /** How old the newest picture is, s; null before the first. */
  age(nowMs) {
    return this.pictureMs === null ? null : (nowMs - this.pictureMs) / 1e3;
  }

  /** Send a message; its id, or null where there is nobody to send it to. */
  send(kind, fields) {
    if (!this.isOpen) return null;
    const id = this._nextId++;
    this._socket.send(JSON.stringify({ kind, id, ...fields }));
    return id;
  }

  /** Whether so much waits to be sent that a set-point would come too late. */
  get isCongested() {
    return (this._socket?.bufferedAmount ?? 0) > BACKLOG_BYTES;
  }

  _retryNow() {
    if (!this._isWanted || this._socket) return;
    clearTimeout(this._timer);
    this._connect();
  }

  _connect() {
    const socket = new WebSocket(this.url);
    this._socket = socket;
    this._openedMs = performance.now();
    this._isFirst = true;
    socket.onmessage = (event) => socket === this._socket && this._receive(event.data);
    socket.onclose = () => socket === this._socket && this._disconnect();
  }

  _receive(data) {
    const { kind, ...fields } = JSON.parse(data);
    if (kind === "hello") {
      this._hasHello = true;
      this._retryMs = FIRST_RETRY_MS;
    }
    if (kind === "fleet") {
      if (!this._isNewer(fields.time_s)) return;
      this._timeS = fields.time_s;
      this._isFirst = false;
      this.pictureMs = performance.now();
    }
    this.handlers.message(kind, fields);
    this._check();
  }

  /** A picture whose time does not advance is an old one, however often it is sent; a new station may begin anywhere. */
  _isNewer(timeS) {
    return this._isFirst ? timeS !== this._timeS : timeS > this._timeS;
  }

  _check() {
    const now = performance.now();
    const isFresh = this.isOpen && !this._isFirst && now - this.pictureMs < FRESH_MS;
    if (isFresh !== this.isFresh) {
      this.isFresh = isFresh;
      this.handlers.change(isFresh);
    }
    if (this._socket && now - Math.max(this.pictureMs ?? 0, this._openedMs) > DEAD_MS) this._disconnect();
  }

  _disconnect() {
    const socket = this._socket;
    if (!socket) return;
    this._socket = null;
    this._hasHello = false;
    socket.close();
    this._check();
    if (!this._isWanted) return;
    this._timer = setTimeout(() => this._retryNow(), this._retryMs);
    this._retryMs = Math.min(2 * this._retryMs, LAST_RETRY_MS);
    this.handlers.closed();
  }
}
