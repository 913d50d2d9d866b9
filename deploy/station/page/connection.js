// SPDX-License-Identifier: MIT
// The socket to the base station: it opens itself again, and it knows whether what is shown is still true.

import { PictureAge } from "./picture_age.js";

/** Where the newest picture was on the way for longer, it is the link that is slow, ms. */
const LATE_MS = 250;
/** Until the station says how old a picture may be, ms. */
const FIRST_FRESH_MS = 1000;
/** A socket that is silent for so many times as long is dead, whatever TCP believes. */
const DEAD_AFTER = 4;
const CHECK_MS = 100;
const FIRST_RETRY_MS = 250;
const LAST_RETRY_MS = 5000;
/** Set-points are discarded while this much waits to be sent: an old one is worse than none, bytes. */
const BACKLOG_BYTES = 16384;

/** Pictures are compressed where this browser can inflate them (Compression Streams). */
const INFLATES = "DecompressionStream" in window;
const SLOW = "Slow connection to the base station";
const NO_CONNECTION = "No connection to the base station";

const inflate = (blob) => new Response(blob.stream().pipeThrough(new DecompressionStream("deflate"))).text();

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
    this._freshMs = FIRST_FRESH_MS;
    this._pictureMs = null;
    this._pictureAge = new PictureAge();
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

  /** How old the newest picture is, s, from where the station made it; null before the first. */
  age(nowMs) {
    return this._pictureAge.ageS(nowMs);
  }

  /** Why what is shown is too old to act on, or an empty text: pictures come late, or none come. */
  get trouble() {
    if (this.isFresh) return "";
    return this.isOpen && 1e3 * this._pictureAge.onTheWayS > LATE_MS ? SLOW : NO_CONNECTION;
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
    const socket = new WebSocket(this.url + (INFLATES ? "?pictures=deflate" : ""));
    this._socket = socket;
    this._openedMs = performance.now();
    this._isFirst = true;
    // One after the other, as they were sent: a picture that is being inflated must not come after a later reply.
    let last = Promise.resolve();
    const next = (act) => {
      last = last.then(() => socket === this._socket && act()).catch((error) => setTimeout(() => { throw error; }));
    };
    socket.onmessage = ({ data }) => next(async () => {
      const json = typeof data === "string" ? data : await inflate(data);
      if (socket === this._socket) this._receive(json);
    });
    socket.onclose = () => next(() => this._disconnect());
  }

  _receive(data) {
    const { kind, ...fields } = JSON.parse(data);
    if (kind === "seen") {
      this._pictureAge.heard(fields);
      this._check();
      return;
    }
    if (kind === "hello") {
      this._hasHello = true;
      this._freshMs = 1e3 * fields.fresh_s;
      this._retryMs = FIRST_RETRY_MS;
    }
    if (kind === "fleet" && !this._take(fields.time_s)) return;
    this.handlers.message(kind, fields);
    this._check();
  }

  /** Take a picture that is newer, and tell the station, which sends no other before it knows. */
  _take(timeS) {
    // The station may have closed it meanwhile: what came before is taken all the same.
    if (this._socket.readyState === WebSocket.OPEN) this._socket.send(JSON.stringify({ kind: "seen", time_s: timeS }));
    if (!this._isNewer(timeS)) return false;
    this._pictureMs = performance.now();
    this._pictureAge.arrived(timeS, this._pictureMs, this._isFirst);
    this._timeS = timeS;
    this._isFirst = false;
    return true;
  }

  /** A picture whose time does not advance is an old one, however often it is sent; a new station may begin anywhere. */
  _isNewer(timeS) {
    return this._isFirst ? timeS !== this._timeS : timeS > this._timeS;
  }

  _check() {
    const now = performance.now();
    const isCurrent = this._pictureAge.isMeasured && 1e3 * this._pictureAge.ageS(now) < this._freshMs;
    const isFresh = this.isOpen && !this._isFirst && isCurrent;
    if (isFresh !== this.isFresh) {
      this.isFresh = isFresh;
      this.handlers.change(isFresh);
    }
    if (this._socket && now - Math.max(this._pictureMs ?? 0, this._openedMs) > DEAD_AFTER * this._freshMs) this._disconnect();
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
