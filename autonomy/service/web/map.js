// The room from above: north up, east right, metres. Draws; knows nothing of the service.

import { Scene } from "./scene.js";

const NAMES = [
  "map", "grid", "grid-strong", "outside", "vehicle", "track", "beam", "goal", "discrete",
  "continuous", "fresh", "keepout", "straight", "tangent", "arc", "hyperbola", "geodesic",
  "rejected", "fence", "bad", "quiet", "ink", "accent",
];
const LEG_DASH = { arc: [2, 5], hyperbola: [], straight: [], tangent: [], geodesic: [10, 4] };

export class RoomMap {
  constructor(canvas, { onPick, onHover }) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.scene = new Scene();
    this.view = null; // { n, e, scale }; null shows all
    this.cursor = null;
    this.asked = null;
    this.onPick = onPick;
    this.onHover = onHover;
    this.groundDirty = true;
    this.readColours();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.readColours();
      this.touchGround();
    });
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.listen();
    this.resize();
  }

  /** Draw this scene from now on. */
  show(scene) {
    const same = ["room", "hits", "plan"].every((part) => scene[part] === this.scene[part]);
    this.scene = scene;
    if (same) this.draw(); else this.touchGround();
  }

  readColours() {
    const style = getComputedStyle(document.documentElement);
    this.colour = Object.fromEntries(
      NAMES.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]),
    );
  }

  touchGround() {
    this.groundDirty = true;
    this.draw();
  }

  // ------------------------------------------------------------ metres and pixels

  resize() {
    const ratio = devicePixelRatio || 1;
    const box = this.canvas.getBoundingClientRect();
    this.width = Math.max(1, box.width);
    this.height = Math.max(1, box.height);
    this.canvas.width = Math.round(this.width * ratio);
    this.canvas.height = Math.round(this.height * ratio);
    this.ground = document.createElement("canvas");
    this.ground.width = this.canvas.width;
    this.ground.height = this.canvas.height;
    this.keepOut = document.createElement("canvas");
    this.keepOut.width = this.canvas.width;
    this.keepOut.height = this.canvas.height;
    this.ratio = ratio;
    this.touchGround();
  }

  bounds() {
    const fence = this.scene.room ? this.scene.room.fence : [[-3, -3], [3, 3]];
    const norths = fence.map((p) => p[0]);
    const easts = fence.map((p) => p[1]);
    return [Math.min(...norths), Math.max(...norths), Math.min(...easts), Math.max(...easts)];
  }

  eye() {
    if (this.view) return this.view;
    const [n0, n1, e0, e1] = this.bounds();
    const margin = 48;
    const scale = Math.min(
      (this.width - margin) / (e1 - e0 + 0.6), (this.height - margin) / (n1 - n0 + 0.6),
    );
    return { n: (n0 + n1) / 2, e: (e0 + e1) / 2, scale: Math.max(5, scale) };
  }

  toPixel([n, e]) {
    const eye = this.eye();
    return [this.width / 2 + (e - eye.e) * eye.scale, this.height / 2 - (n - eye.n) * eye.scale];
  }

  toMetre(x, y) {
    const eye = this.eye();
    return [eye.n - (y - this.height / 2) / eye.scale, eye.e + (x - this.width / 2) / eye.scale];
  }

  zoom(factor, x = this.width / 2, y = this.height / 2) {
    const eye = this.eye();
    const [n, e] = this.toMetre(x, y);
    const scale = Math.min(2000, Math.max(8, eye.scale * factor));
    this.view = {
      scale,
      n: n + (y - this.height / 2) / scale,
      e: e - (x - this.width / 2) / scale,
    };
    this.touchGround();
  }

  showAll() {
    this.view = null;
    this.touchGround();
  }

  // ------------------------------------------------------------ fingers, mouse, keys

  listen() {
    const fingers = new Map();
    let moved = 0;
    let spread = 0;
    const at = (event) => {
      const box = this.canvas.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      if (fingers.size === 0) moved = 0;
      fingers.set(event.pointerId, at(event));
      spread = 0;
    });
    this.canvas.addEventListener("pointermove", (event) => {
      const now = at(event);
      const before = fingers.get(event.pointerId);
      this.onHover(this.toMetre(...now));
      if (!before) return;
      fingers.set(event.pointerId, now);
      if (fingers.size === 2) {
        const [a, b] = [...fingers.values()];
        const wide = Math.hypot(a[0] - b[0], a[1] - b[1]);
        if (spread) this.zoom(wide / spread, (a[0] + b[0]) / 2, (a[1] + b[1]) / 2);
        spread = wide;
        moved = 99;
        return;
      }
      const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
      moved += Math.hypot(dx, dy);
      if (moved < 8) return;
      const eye = this.eye();
      this.view = { n: eye.n + dy / eye.scale, e: eye.e - dx / eye.scale, scale: eye.scale };
      this.touchGround();
    });
    const up = (event) => {
      if (!fingers.delete(event.pointerId)) return;
      if (event.type === "pointerup" && fingers.size === 0 && moved < 8) {
        this.onPick(this.toMetre(...at(event)));
      }
    };
    this.canvas.addEventListener("pointerup", up);
    this.canvas.addEventListener("pointercancel", up);
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY * 0.0015), ...at(event));
    }, { passive: false });
    this.canvas.addEventListener("keydown", (event) => this.key(event));
    this.canvas.addEventListener("blur", () => this.draw());
    this.canvas.addEventListener("focus", () => this.draw());
  }

  key(event) {
    const steps = {
      ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowRight: [0, 1], ArrowLeft: [0, -1],
    };
    const step = steps[event.key];
    if (step) {
      const length = event.shiftKey ? 0.5 : 0.1;
      const from = this.cursor ?? this.scene.state?.vehicle?.position ?? [this.eye().n, this.eye().e];
      const round = (value) => Math.round(value * 100) / 100;
      this.cursor = [round(from[0] + step[0] * length), round(from[1] + step[1] * length)];
      this.onHover(this.cursor);
      this.draw();
    } else if (event.key === "Enter" && this.cursor) {
      this.onPick(this.cursor);
    } else if (event.key === "+" || event.key === "=") {
      this.zoom(1.25);
    } else if (event.key === "-") {
      this.zoom(0.8);
    } else if (event.key === "0") {
      this.showAll();
    } else {
      return;
    }
    event.preventDefault();
  }

  // ------------------------------------------------------------ drawing

  /** At the next frame, once, however often it is asked for. */
  draw() {
    if (this.due) return;
    this.due = requestAnimationFrame(() => {
      this.due = null;
      this.paint();
    });
  }

  paint() {
    if (!this.ground) return;
    if (this.groundDirty) {
      this.paintGround();
      this.groundDirty = false;
    }
    const c = this.context;
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.drawImage(this.ground, 0, 0);
    c.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    this.line(c, this.scene.track, "track", 2);
    this.goals(c);
    this.movers(c);
    this.beams(c);
    this.vehicle(c);
    if (this.cursor && document.activeElement === this.canvas) this.cross(c, this.cursor, "accent");
    if (this.asked) this.cross(c, this.asked, "accent");
  }

  /** What changes a few times a second at most: grid, fence, obstacles, plan. */
  paintGround() {
    const c = this.ground.getContext("2d");
    c.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    c.fillStyle = this.colour.outside;
    c.fillRect(0, 0, this.width, this.height);
    if (this.scene.room) {
      c.beginPath();
      this.trace(c, this.scene.room.fence);
      c.closePath();
      c.fillStyle = this.colour.map;
      c.fill();
    }
    this.grid(c);
    this.spheres(c);
    this.obstacles(c);
    if (this.scene.room) {
      c.setLineDash([9, 6]);
      this.line(c, [...this.scene.room.fence, this.scene.room.fence[0]], "fence", 1.5);
      c.setLineDash([]);
    }
    if (this.scene.plan) this.paths(c);
  }

  grid(c) {
    const eye = this.eye();
    const step = eye.scale > 160 ? 0.25 : eye.scale > 60 ? 0.5 : eye.scale > 22 ? 1 : 5;
    const [n1, e0] = this.toMetre(0, 0);
    const [n0, e1] = this.toMetre(this.width, this.height);
    c.font = "11px system-ui, sans-serif";
    c.lineWidth = 1;
    const whole = (value) => Math.abs(value - Math.round(value)) < 1e-6;
    for (let n = Math.ceil(n0 / step) * step; n <= n1; n += step) {
      const y = Math.round(this.toPixel([n, 0])[1]) + 0.5;
      c.strokeStyle = whole(n) ? this.colour["grid-strong"] : this.colour.grid;
      c.beginPath(); c.moveTo(0, y); c.lineTo(this.width, y); c.stroke();
      if (whole(n)) { c.fillStyle = this.colour.quiet; c.fillText(`N ${Math.round(n)}`, 6, y - 3); }
    }
    for (let e = Math.ceil(e0 / step) * step; e <= e1; e += step) {
      const x = Math.round(this.toPixel([0, e])[0]) + 0.5;
      c.strokeStyle = whole(e) ? this.colour["grid-strong"] : this.colour.grid;
      c.beginPath(); c.moveTo(x, 0); c.lineTo(x, this.height); c.stroke();
      if (whole(e)) { c.fillStyle = this.colour.quiet; c.fillText(`E ${Math.round(e)}`, x + 3, 14); }
    }
  }

  /** Keep-out spheres: drawn opaque on a sheet of their own, so that overlaps do not add up. */
  spheres(c) {
    const radius = this.scene.plan?.keep_out_m || 0;
    if (!radius) return;
    const sheet = this.keepOut.getContext("2d");
    sheet.setTransform(1, 0, 0, 1, 0, 0);
    sheet.clearRect(0, 0, this.keepOut.width, this.keepOut.height);
    sheet.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    sheet.fillStyle = this.colour.keepout;
    const size = radius * this.eye().scale;
    sheet.beginPath();
    for (const hit of this.scene.hits) {
      const [x, y] = this.toPixel(hit);
      sheet.moveTo(x + size, y);
      sheet.arc(x, y, size, 0, 2 * Math.PI);
    }
    sheet.fill("nonzero");
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.drawImage(this.keepOut, 0, 0);
    c.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
  }

  /** Discrete: a filled disc. Continuous: a chain of squares. Not yet classified: small dots. */
  obstacles(c) {
    const scale = this.eye().scale;
    this.dots(c, this.scene.hits, "fresh", Math.max(1.5, 0.012 * scale));
    for (const obstacle of this.scene.plan?.obstacles ?? []) {
      if (obstacle.kind === "discrete") {
        const [x, y] = this.toPixel(obstacle.centre);
        const size = Math.max(4, obstacle.radius_m * scale);
        c.fillStyle = this.colour.discrete;
        c.globalAlpha = 0.28;
        c.beginPath(); c.arc(x, y, size, 0, 2 * Math.PI); c.fill();
        c.globalAlpha = 1;
        c.strokeStyle = this.colour.discrete;
        c.lineWidth = 2;
        c.stroke();
        this.dots(c, obstacle.hits, "discrete", Math.max(1.5, 0.012 * scale));
      } else {
        const size = Math.max(4, 0.035 * scale);
        c.fillStyle = this.colour.continuous;
        for (const hit of obstacle.hits) {
          const [x, y] = this.toPixel(hit);
          c.fillRect(x - size / 2, y - size / 2, size, size);
        }
      }
    }
    this.dots(c, this.scene.plan?.evidence ?? [], "bad", 3);
  }

  paths(c) {
    c.setLineDash([4, 5]);
    for (const line of this.scene.plan.rejected) this.line(c, line, "rejected", 1.2);
    for (const leg of this.scene.plan.legs) {
      c.setLineDash(LEG_DASH[leg.kind] ?? []);
      this.line(c, leg.points, leg.kind, leg.kind === "arc" ? 4 : 3);
    }
    c.setLineDash([]);
  }

  goals(c) {
    const goals = this.scene.state?.flight?.goals ?? [];
    goals.forEach((goal, index) => {
      const [x, y] = this.toPixel(goal);
      c.strokeStyle = c.fillStyle = this.colour.goal;
      c.lineWidth = 2;
      c.beginPath(); c.arc(x, y, 8, 0, 2 * Math.PI); c.stroke();
      c.beginPath(); c.arc(x, y, 2.5, 0, 2 * Math.PI); c.fill();
      c.font = "12px system-ui, sans-serif";
      c.fillText(goals.length > 1 ? `goal ${index + 1}` : "goal", x + 11, y - 6);
    });
  }

  /** What moves: a ring where it is, and where it will be in a second. */
  movers(c) {
    const scale = this.eye().scale;
    for (const { centre, velocity, radius_m: radius, moving } of this.scene.state?.movers ?? []) {
      const [x, y] = this.toPixel(centre);
      c.strokeStyle = this.colour.bad;
      c.lineWidth = 2;
      c.setLineDash(moving ? [] : [3, 4]);
      c.beginPath(); c.arc(x, y, Math.max(5, radius * scale), 0, 2 * Math.PI); c.stroke();
      c.setLineDash([]);
      if (moving) this.line(c, [centre, [centre[0] + velocity[0], centre[1] + velocity[1]]], "bad", 2);
    }
  }

  beams(c) {
    for (const beam of this.scene.state?.beams ?? []) {
      if (!beam.origin) continue;
      const sick = beam.health !== "ok";
      const seen = beam.sees === "hit" || beam.sees === "too near";
      const length = beam.range_m ?? beam.max_m;
      const end = [
        beam.origin[0] + length * Math.cos(beam.bearing_rad),
        beam.origin[1] + length * Math.sin(beam.bearing_rad),
      ];
      c.globalAlpha = sick ? 0.9 : seen ? 0.95 : 0.45;
      c.setLineDash(sick ? [2, 6] : []);
      this.line(c, [beam.origin, end], sick ? "bad" : "beam", seen ? 2 : 1.2);
      c.setLineDash([]);
      c.globalAlpha = 1;
      if (seen && !sick) this.dots(c, [end], "beam", 4);
    }
  }

  vehicle(c) {
    const vehicle = this.scene.state?.vehicle;
    if (!vehicle) return;
    const [x, y] = this.toPixel(vehicle.position);
    const size = Math.max(7, (this.scene.room?.body_radius_m ?? 0.15) * this.eye().scale);
    const colour = this.colour[vehicle.position_ok ? "vehicle" : "bad"];
    c.save();
    c.translate(x, y);
    c.rotate(vehicle.yaw_rad);
    c.strokeStyle = c.fillStyle = colour;
    c.lineWidth = 2;
    c.globalAlpha = 0.15;
    c.beginPath(); c.arc(0, 0, size, 0, 2 * Math.PI); c.fill();
    c.globalAlpha = 1;
    c.stroke();
    c.beginPath();
    c.moveTo(0, -size * 0.85); c.lineTo(size * 0.5, size * 0.55);
    c.lineTo(0, size * 0.25); c.lineTo(-size * 0.5, size * 0.55);
    c.closePath();
    c.fill();
    c.restore();
  }

  cross(c, point, colour) {
    const [x, y] = this.toPixel(point);
    c.strokeStyle = this.colour[colour];
    c.lineWidth = 2;
    c.beginPath();
    c.moveTo(x - 12, y); c.lineTo(x + 12, y); c.moveTo(x, y - 12); c.lineTo(x, y + 12);
    c.stroke();
  }

  line(c, points, colour, width) {
    if (points.length < 2) return;
    c.strokeStyle = this.colour[colour] || this.colour.ink;
    c.lineWidth = width;
    c.lineJoin = c.lineCap = "round";
    c.beginPath();
    this.trace(c, points);
    c.stroke();
  }

  trace(c, points) {
    points.forEach((point, index) => {
      const [x, y] = this.toPixel(point);
      if (index) c.lineTo(x, y); else c.moveTo(x, y);
    });
  }

  dots(c, points, colour, radius) {
    c.fillStyle = this.colour[colour];
    c.beginPath();
    for (const point of points) {
      const [x, y] = this.toPixel(point);
      c.moveTo(x + radius, y);
      c.arc(x, y, radius, 0, 2 * Math.PI);
    }
    c.fill();
  }
}
