// What is known of one flight: of the one being flown, or of a moment of one looked back at.

export class Scene {
  constructor() {
    this.room = null;
    this.forget();
  }

  /** A new connection: nothing told before is true any more. */
  forget() {
    this.state = null;
    this.clear();
  }

  /** A new flight begins. */
  clear() {
    this.hits = [];
    this.plan = null;
    this.track = [];
  }

  /** Take in one message of the service; true when more changed than what moves all the time. */
  take(message) {
    switch (message.type) {
      case "room": this.room = message; return true;
      case "hits": this.hits = message.points; return true;
      case "plan": this.plan = message; return true;
      case "state": this.state = message; return false;
      case "track":
        if (message.start === 0 && message.points.length === 0) {
          this.clear();
          return true;
        }
        this.track.length = message.start;
        this.track.push(...message.points);
        return false;
      default: return false;
    }
  }
}

/** A recorded flight: the scene at any of its moments. */
export class Reel {
  constructor({ log, duration_s: duration, frames }) {
    this.log = log;
    this.duration = duration;
    this.events = [];
    this.moments = [];
    const scene = new Scene();
    const track = [];
    for (const { at_s: at, messages } of frames) {
      for (const message of messages) {
        if (message.type === "event") this.events.push({ ...message, at: Number(message.time_utc) });
        if (message.type === "track") track.push(...message.points);
        else scene.take(message);
      }
      const { room, hits, plan, state } = scene;
      this.moments.push({ at, room, hits, plan, state, flown: track.length });
    }
    this.track = track;
  }

  /** The last moment that is not after `seconds`. */
  moment(seconds) {
    let [low, high] = [0, this.moments.length - 1];
    while (low < high) {
      const middle = Math.ceil((low + high) / 2);
      if (this.moments[middle].at <= seconds + 1e-6) low = middle; else high = middle - 1;
    }
    return this.moments[low];
  }

  /** What the map and the words are drawn from, at `seconds`. */
  scene(seconds) {
    const { room, hits, plan, state, flown } = this.moment(seconds);
    return { room, hits, plan, state, track: this.track.slice(0, flown) };
  }
}
