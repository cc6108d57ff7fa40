/* The robots from above, drawn to scale at a time; the view can be moved, zoomed, and follow a robot. */

const MARGIN = 36;

class Playback {
  /**
   * @param canvas where it draws
   * @param runs the runs, prepared
   * @param state what the page shows: `time`, `hidden` (ids of robots), `chosen` (an id, or "")
   */
  constructor(canvas, runs, state) {
    this.canvas = canvas;
    this.runs = runs;
    this.state = state;
    this.follow = "";
    this.view = null;
    this.warnings = [];
    this._listen();
  }

  /** Show all paths. */
  fit() {
    this.view = null;
    this.draw();
  }

  zoom(factor, x = this.width / 2, y = this.height / 2) {
    const view = this._view();
    const [wx, wy] = [view.x + (x - this.width / 2) / view.scale, view.y - (y - this.height / 2) / view.scale];
    const scale = Math.max(0.01, Math.min(5000, view.scale * factor));
    this.view = { scale, x: wx - (x - this.width / 2) / scale, y: wy + (y - this.height / 2) / scale };
    this.draw();
  }

  pan(dx, dy) {
    const view = this._view();
    this.view = { scale: view.scale, x: view.x - dx / view.scale, y: view.y + dy / view.scale };
    this.follow = "";
    this.draw();
  }

  /** Return where a point of the plane is on the canvas [px]. */
  toScreen(x, y) {
    const view = this._view();
    return [this.width / 2 + (x - view.x) * view.scale, this.height / 2 - (y - view.y) * view.scale];
  }

  draw() {
    const ratio = window.devicePixelRatio || 1;
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    this.canvas.width = Math.round(this.width * ratio);
    this.canvas.height = Math.round(this.height * ratio);
    const pen = this.canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.pen = pen;
    this.theme = getComputedStyle(document.documentElement);
    this._centre();
    pen.clearRect(0, 0, this.width, this.height);
    this._grid();
    this.warnings = [];
    this.runs.forEach((run, number) => this._run(run, number));
    this._scaleBar();
  }

  colour(name) {
    return this.theme.getPropertyValue(name).trim();
  }

  // The view

  _view() {
    return this.view || (this.all ??= this._everything());
  }

  _everything() {
    const box = [Infinity, -Infinity, Infinity, -Infinity];
    for (const run of this.runs) {
      for (const [x, y] of run.poses) {
        for (let i = 0; i < x.length; i++) {
          if (!Number.isFinite(x[i]) || !Number.isFinite(y[i])) continue;
          box[0] = Math.min(box[0], x[i]); box[1] = Math.max(box[1], x[i]);
          box[2] = Math.min(box[2], y[i]); box[3] = Math.max(box[3], y[i]);
        }
      }
    }
    if (!Number.isFinite(box[0])) return { x: 0, y: 0, scale: 20 };
    const [width, height] = [box[1] - box[0] + 3, box[3] - box[2] + 3];
    const scale = Math.min((this.width - 2 * MARGIN) / width, (this.height - 2 * MARGIN) / height);
    return { x: (box[0] + box[1]) / 2, y: (box[2] + box[3]) / 2, scale: Math.max(scale, 0.01) };
  }

  /** Let the view follow a robot, or the whole team. */
  _centre() {
    if (!this.view) this.all = undefined;
    if (!this.follow) return;
    const run = this.runs[0];
    const poses = run.vehicles
      .map((vehicle, k) => (this.follow === "team" || vehicle.id === this.follow ? poseAt(run, k, this.state.time) : null))
      .filter(Boolean);
    if (!poses.length) return;
    const scale = this.view ? this.view.scale : Math.max(this._everything().scale, 25);
    const x = poses.reduce((sum, pose) => sum + pose.x, 0) / poses.length;
    const y = poses.reduce((sum, pose) => sum + pose.y, 0) / poses.length;
    this.view = { x, y, scale };
  }

  _listen() {
    const canvas = this.canvas;
    const pointers = new Map();
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY / 400), event.offsetX, event.offsetY);
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, event);
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      const others = [...pointers.values()].filter((one) => one.pointerId !== event.pointerId);
      if (others.length) {
        const [other] = others;
        const reach = (one) => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY);
        const place = canvas.getBoundingClientRect();
        this.zoom(reach(event) / Math.max(reach(before), 1), other.clientX - place.left, other.clientY - place.top);
      } else this.pan(event.clientX - before.clientX, event.clientY - before.clientY);
      pointers.set(event.pointerId, event);
    });
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
    }
  }

  // What is drawn

  _grid() {
    const { pen, width, height } = this;
    const view = this._view();
    const step = niceStep(90 / view.scale);
    pen.strokeStyle = this.colour("--grid");
    pen.fillStyle = this.colour("--dim");
    pen.lineWidth = 1;
    pen.font = "11px system-ui, sans-serif";
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    const left = view.x - width / 2 / view.scale;
    const bottom = view.y - height / 2 / view.scale;
    pen.beginPath();
    for (let x = Math.ceil(left / step) * step; x < left + width / view.scale; x += step) {
      const [px] = this.toScreen(x, 0);
      pen.moveTo(px, 0); pen.lineTo(px, height);
      pen.fillText(x.toFixed(digits), px + 3, height - 5);
    }
    for (let y = Math.ceil(bottom / step) * step; y < bottom + height / view.scale; y += step) {
      const [, py] = this.toScreen(0, y);
      pen.moveTo(0, py); pen.lineTo(width, py);
      if (py < height - 20) pen.fillText(y.toFixed(digits), 4, py - 3);
    }
    pen.stroke();
  }

  _scaleBar() {
    const { pen, width, height } = this;
    const scale = this._view().scale;
    const length = niceStep(70 / scale);
    const [right, low] = [width - 14, height - 22];
    pen.strokeStyle = pen.fillStyle = this.colour("--text");
    pen.lineWidth = 2;
    pen.beginPath();
    pen.moveTo(right - length * scale, low); pen.lineTo(right, low);
    pen.stroke();
    pen.textAlign = "right";
    pen.fillText(`${Number(length.toPrecision(3))} m`, right, low - 5);
    pen.textAlign = "left";
  }

  _run(run, number) {
    if (isBefore(run, this.state.time)) return;
    const time = Math.min(this.state.time, run.end);
    const leader = poseAt(run, 0, time);
    const shown = [];
    run.vehicles.forEach((vehicle, k) => {
      if (this.state.hidden.has(vehicle.id)) return;
      const pose = poseAt(run, k, time);
      this._trail(run, k, number, time);
      if (pose) shown.push({ k, pose });
    });
    const few = run.vehicles.length <= MOST_WATCHED;
    for (const { k, pose } of shown) {
      if (k > 0 && leader && (few || run.vehicles[k].id === this.state.chosen)) this._sight(run, k, pose, leader, time);
    }
    const outlines = shown.map(({ k, pose }) => ({ vehicle: k, pose, parts: outlineAt(run, k, pose) }));
    const near = nearPairs(outlines.filter(({ vehicle }) => vehicle > 0));
    const alarmed = new Set(near.flatMap(([one, other]) => [one, other]));
    for (const { vehicle, pose, parts } of outlines) this._vehicle(run, vehicle, number, pose, parts, alarmed.has(vehicle));
    for (const [one, other, distance] of near) {
      const how = distance === 0 ? "overlap" : `are ${(100 * distance).toFixed(0)} cm apart`;
      this.warnings.push(`${run.vehicles[one].id} and ${run.vehicles[other].id} ${how}`);
    }
  }

  _pen(vehicle, id, number) {
    const { pen } = this;
    pen.strokeStyle = pen.fillStyle = vehicle === 0 ? this.colour("--leader") : colourOf(vehicle - 1);
    pen.setLineDash(number > 0 ? [7, 4] : vehicle === 0 ? [4, 4] : []);
    this.weight = this.state.chosen && this.state.chosen !== id ? 0.3 : 1;
  }

  _trail(run, vehicle, number, time) {
    const { pen } = this;
    const [x, y] = run.poses[vehicle];
    const last = placeOf(run, time)[0];
    this._pen(vehicle, run.vehicles[vehicle].id, number);
    const strip = (from, to, alpha, width) => {
      pen.globalAlpha = alpha * this.weight;
      pen.lineWidth = width;
      pen.beginPath();
      let down = false;
      for (let i = from; i <= to; i++) {
        if (!Number.isFinite(x[i]) || !Number.isFinite(y[i])) { down = false; continue; }
        const [px, py] = this.toScreen(x[i], y[i]);
        if (down) pen.lineTo(px, py); else pen.moveTo(px, py);
        down = true;
      }
      pen.stroke();
    };
    if (run.vehicles.length <= MOST_WATCHED) strip(last, x.length - 1, 0.35, 1);
    strip(run.vehicles.length <= MOST_WATCHED ? 0 : Math.max(0, last - 20), last, 0.85, 1.5);
    pen.setLineDash([]);
    pen.globalAlpha = 1;
  }

  _sight(run, vehicle, pose, leader, time) {
    const { pen } = this;
    const [x, y] = sightPoint(run, vehicle, pose);
    this._pen(vehicle, run.vehicles[vehicle].id, 0);
    pen.globalAlpha = 0.45 * this.weight;
    pen.lineWidth = 1;
    pen.setLineDash([2, 3]);
    pen.beginPath();
    pen.moveTo(...this.toScreen(x, y)); pen.lineTo(...this.toScreen(leader.x, leader.y));
    pen.stroke();
    pen.setLineDash([]);
    const desired = desiredPoint(run, vehicle, pose, leader, time);
    if (desired && desired.every(Number.isFinite)) {
      const [px, py] = this.toScreen(...desired);
      pen.globalAlpha = this.weight;
      pen.lineWidth = 1.5;
      pen.beginPath();
      pen.moveTo(px - 5, py); pen.lineTo(px + 5, py);
      pen.moveTo(px, py - 5); pen.lineTo(px, py + 5);
      pen.stroke();
    }
    pen.globalAlpha = 1;
  }

  _vehicle(run, vehicle, number, pose, parts, alarmed) {
    const { pen } = this;
    const { id } = run.vehicles[vehicle];
    this._pen(vehicle, id, number);
    pen.lineWidth = alarmed ? 2.5 : 1.4;
    const small = this._view().scale < 4;
    for (const { corners, collides } of small ? [] : parts) {
      pen.beginPath();
      corners.forEach(([x, y], i) => pen[i ? "lineTo" : "moveTo"](...this.toScreen(x, y)));
      pen.closePath();
      if (collides && alarmed) pen.strokeStyle = this.colour("--bad");
      pen.globalAlpha = (collides ? (vehicle === 0 ? 0.1 : 0.28) : 0.95) * this.weight;
      pen.fill();
      pen.globalAlpha = this.weight;
      if (collides) pen.stroke();
    }
    pen.setLineDash([]);
    const [px, py] = this.toScreen(pose.x, pose.y);
    pen.beginPath();
    if (small || !parts.length) {
      const heading = headingOf(run, vehicle, pose);
      const [c, s] = [6 * Math.cos(heading), -6 * Math.sin(heading)];
      pen.moveTo(px + c, py + s); pen.lineTo(px - c - s * 0.7, py - s + c * 0.7); pen.lineTo(px - c + s * 0.7, py - s - c * 0.7);
    } else pen.arc(px, py, 2.2, 0, 7);
    pen.fill();
    if (run.vehicles.length <= 12 && number === 0) {
      pen.font = "11px system-ui, sans-serif";
      pen.fillText(id, px + 8, py - 8);
    }
    pen.globalAlpha = 1;
  }
}

/** Return a round number that is not below another: 1, 2 or 5 times a power of ten. */
function niceStep(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].map((factor) => factor * power).find((step) => step >= least * 0.999);
}
