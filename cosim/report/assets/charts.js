/* The figures of a study's runs: one over another, and how often each comes about, with the bounds of what must hold. */

const STATUS = {
  passed: { colour: "--good", mark: "✓", draw: (pen, x, y) => pen.arc(x, y, 2.6, 0, 7) },
  failed: { colour: "--bad", mark: "✗", draw: (pen, x, y) => cross(pen, x, y, 3.4) },
  broken: { colour: "--known", mark: "!", draw: (pen, x, y) => { cross(pen, x, y, 4, true); } },
};
const CHART = { left: 62, right: 14, top: 14, bottom: 38 };
const NEAREST = 14; // px within which a point is meant
const BARS = 30;

function cross(pen, x, y, size, upright = false) {
  const [a, b] = upright ? [size, 0] : [size * 0.75, size * 0.75];
  pen.moveTo(x - a, y - b); pen.lineTo(x + a, y + b);
  pen.moveTo(x + b, y - a); pen.lineTo(x - b, y + a);
}

/** Return a name with its unit. */
function labelOf(column) {
  return column.unit ? `${column.name} [${column.unit}]` : column.name;
}

/** A panel with axes, on which runs are drawn. */
class Chart {
  /**
   * @param canvas where it draws
   * @param study the table by columns, and the bounds
   */
  constructor(canvas, study) {
    this.canvas = canvas;
    this.study = study;
  }

  /** Prepare the canvas for ranges of numbers, and draw axes with names. */
  _begin(x, y, names) {
    const ratio = window.devicePixelRatio || 1;
    [this.width, this.height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    this.canvas.width = Math.round(this.width * ratio);
    this.canvas.height = Math.round(this.height * ratio);
    this.pen = this.canvas.getContext("2d");
    this.pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.theme = getComputedStyle(document.documentElement);
    const { left, right, top, bottom } = CHART;
    this.toX = (value) => left + ((value - x[0]) / (x[1] - x[0])) * (this.width - left - right);
    this.toY = (value) => this.height - bottom - ((value - y[0]) / (y[1] - y[0])) * (this.height - top - bottom);
    const { pen } = this;
    pen.clearRect(0, 0, this.width, this.height);
    pen.font = "11px system-ui, sans-serif";
    pen.lineWidth = 1;
    pen.strokeStyle = this.colour("--grid");
    pen.fillStyle = this.colour("--dim");
    pen.beginPath();
    pen.textAlign = "center";
    const across = Math.max(2, Math.floor((this.width - left - right) / 80));
    for (const [at, text] of names.ticks || ticks(x, across)) {
      pen.moveTo(this.toX(at), top); pen.lineTo(this.toX(at), this.height - bottom);
      pen.fillText(text, this.toX(at), this.height - bottom + 14);
    }
    pen.fillText(names.x, (left + this.width - right) / 2, this.height - 6);
    pen.textAlign = "right";
    for (const [at, text] of names.up || ticks(y, 5)) {
      pen.moveTo(left, this.toY(at)); pen.lineTo(this.width - right, this.toY(at));
      pen.fillText(text, left - 6, this.toY(at) + 4);
    }
    pen.stroke();
    pen.save();
    pen.translate(12, (top + this.height - bottom) / 2);
    pen.rotate(-Math.PI / 2);
    pen.textAlign = "center";
    pen.fillText(names.y, 0, 0);
    pen.restore();
    pen.textAlign = "left";
  }

  colour(name) {
    return this.theme.getPropertyValue(name).trim();
  }

  /** Return the bounds of a measure: where they are on an axis, and of which runs, if not of all; a margin shall be above zero. */
  bounds(column, scaled) {
    if (column.kind === "margin") return [{ at: scaled(0), of: "" }];
    return this.study.bounds.filter((bound) => bound.measure === column.name)
      .map((bound) => ({ at: scaled(bound.below ?? bound.above), of: bound.given ? `bound ${bound.given}` : "" }));
  }

  /** Draw a line, and a text that ends at a place, or begins there if there is no room before it. */
  _dashed(points, text, [x, y]) {
    const { pen } = this;
    pen.strokeStyle = this.colour("--accent");
    pen.setLineDash([6, 4]);
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.moveTo(...points[0]); pen.lineTo(...points[1]);
    pen.stroke();
    pen.setLineDash([]);
    if (!text) return;
    pen.fillStyle = this.colour("--accent");
    const fits = x - 4 - pen.measureText(text).width >= CHART.left;
    pen.textAlign = fits ? "right" : "left";
    pen.fillText(text, fits ? x - 4 : x + 4, y);
    pen.textAlign = "left";
  }
}

/** Each run as a point: a column over another one. */
class Scatter extends Chart {
  /** `choose(row)` is called for a run that a reader points at and presses. */
  constructor(canvas, study, choose) {
    super(canvas, study);
    this.points = [];
    canvas.addEventListener("pointermove", (event) => {
      const near = this.nearest(event.offsetX, event.offsetY);
      canvas.title = near === null ? "" : study.told(near);
      canvas.style.cursor = near === null ? "" : "pointer";
    });
    canvas.addEventListener("click", (event) => {
      const near = this.nearest(event.offsetX, event.offsetY);
      if (near !== null) choose(near);
    });
  }

  draw(x, y, rows, chosen) {
    const xs = numbersOf(x);
    const ys = numbersOf(y);
    const bounds = this.bounds(y, ys.scaled);
    const ranges = [rangeOf(xs.numbers), rangeOf([...ys.numbers, ...bounds.map(({ at }) => at)])];
    this._begin(...ranges, { x: labelOf(x), y: labelOf(y), ticks: xs.ticks, up: ys.ticks });
    for (const { at, of } of bounds) {
      const [right, up] = [this.width - CHART.right, this.toY(at)];
      this._dashed([[CHART.left, up], [right, up]], of, [right, up - 4]);
    }
    const { pen } = this;
    const status = this.study.column("status");
    this.points = [];
    for (const [name, look] of Object.entries(STATUS)) {
      pen.strokeStyle = pen.fillStyle = this.colour(look.colour);
      pen.lineWidth = 1.4;
      pen.globalAlpha = rows.length > 2000 ? 0.45 : 0.85;
      for (const row of rows) {
        if (status.values[row] !== name) continue;
        const px = this._inside(this.toX(xs.numbers[row]), CHART.left, this.width - CHART.right);
        const py = this._inside(this.toY(ys.numbers[row]), CHART.top, this.height - CHART.bottom);
        if (px === null || py === null) continue;
        this.points.push([px, py, row]);
        pen.beginPath();
        if (Number.isFinite(ys.numbers[row])) look.draw(pen, px, py);
        else { pen.moveTo(px - 4, py + 5); pen.lineTo(px + 4, py + 5); pen.lineTo(px, py - 2); pen.closePath(); }
        if (name === "passed") pen.fill();
        else pen.stroke();
      }
    }
    pen.globalAlpha = 1;
    const found = this.points.find(([, , row]) => row === chosen);
    if (!found) return;
    pen.strokeStyle = this.colour("--accent");
    pen.lineWidth = 2;
    pen.beginPath();
    pen.arc(found[0], found[1], 8, 0, 7);
    pen.stroke();
  }

  /** Return where a point is drawn: at the edge if it is infinite, nowhere if it is no number. */
  _inside(at, low, high) {
    return Number.isNaN(at) ? null : Math.max(low, Math.min(high, at));
  }

  /** Return the row whose point is near; null if there is none. */
  nearest(x, y) {
    let [least, found] = [NEAREST ** 2, null];
    for (const [px, py, row] of this.points) {
      const distance = (px - x) ** 2 + (py - y) ** 2;
      if (distance < least) [least, found] = [distance, row];
    }
    return found;
  }
}

/** How many runs have a figure: bars, of which the parts are how the runs ended. */
class Histogram extends Chart {
  draw(column, rows) {
    const { numbers, ticks: names, scaled, isText } = numbersOf(column);
    const bounds = this.bounds(column, scaled);
    const finite = rows.filter((row) => Number.isFinite(numbers[row]));
    const range = rangeOf([...finite.map((row) => numbers[row]), ...bounds.map(({ at }) => at)]);
    const bars = isText ? new Set(numbers).size : Math.max(1, Math.min(BARS, Math.ceil(Math.sqrt(finite.length) * 1.5)));
    const width = (range[1] - range[0]) / bars;
    const status = this.study.column("status");
    const counts = Object.fromEntries(Object.keys(STATUS).map((name) => [name, new Array(bars).fill(0)]));
    for (const row of finite) counts[status.values[row]][Math.min(bars - 1, Math.floor((numbers[row] - range[0]) / width))]++;
    const highest = Math.max(1, ...counts.passed.map((_, bar) => Object.values(counts).reduce((sum, one) => sum + one[bar], 0)));
    this._begin(range, [0, highest * 1.06], { x: labelOf(column), y: "runs", ticks: names });
    const { pen } = this;
    const below = new Array(bars).fill(0);
    for (const [name, look] of Object.entries(STATUS)) {
      pen.fillStyle = this.colour(look.colour);
      pen.globalAlpha = name === "passed" ? 0.55 : 0.85;
      counts[name].forEach((count, bar) => {
        if (!count) return;
        const [from, to] = [this.toX(range[0] + bar * width), this.toX(range[0] + (bar + 1) * width)];
        const [high, low] = [this.toY(below[bar] + count), this.toY(below[bar])];
        pen.fillRect(from + 0.5, high, Math.max(1, to - from - 1), low - high);
        below[bar] += count;
      });
    }
    pen.globalAlpha = 1;
    bounds.forEach(({ at, of }, k) => {
      const across = this.toX(at);
      this._dashed([[across, CHART.top], [across, this.height - CHART.bottom]], of, [across, CHART.top + 10 + 13 * k]);
    });
    return rows.length - finite.length;
  }
}

/**
 * Return the numbers of a column as an axis has them, and how another number gets there: over more than a factor of ten
 * their logarithms, if they lie at equal ratios rather than at equal distances; texts are numbered, and named by the ticks.
 */
function numbersOf(column) {
  if (column.isNumber) {
    if (!isLogarithmic(column.values)) return { numbers: column.values, scaled: (value) => value };
    const numbers = column.values.map((value) => (Math.abs(value) === Infinity ? value : Math.log10(value)));
    return { numbers, scaled: Math.log10, ticks: decades(rangeOf(numbers)) };
  }
  const names = [...new Set(column.values)];
  const places = new Map(names.map((name, place) => [name, place]));
  const every = Math.ceil(names.length / 12);
  const shown = names.map((name, place) => [place, name.length > 16 ? `${name.slice(0, 15)}…` : name]);
  const numbers = column.values.map((value) => places.get(value));
  return { numbers, scaled: (value) => value, ticks: shown.filter(([place]) => place % every === 0), isText: true };
}

function isLogarithmic(values) {
  const known = [...new Set(values)].filter(Number.isFinite).sort((a, b) => a - b);
  const [low, high] = [known[0], known.at(-1)];
  if (known.length < 3 || low <= 0 || high < 10 * low) return false;
  const median = Math.log(known[known.length >> 1]);
  return Math.abs(median - Math.log(low * high) / 2) < Math.abs(median - Math.log((low + high) / 2));
}

/** Return the ticks of an axis of logarithms: powers of ten, and what is between few of them. */
function decades([low, high]) {
  const steps = high - low > 3 ? [1] : [1, 2, 5];
  const every = Math.max(1, Math.ceil((high - low) / 8));
  const found = [];
  for (let power = Math.floor(low); power <= high; power += every) {
    for (const step of steps) {
      const at = power + Math.log10(step);
      if (at >= low && at <= high) found.push([at, figure(step * 10 ** power)]);
    }
  }
  return found;
}

/** Return the range of finite numbers, with some room. */
function rangeOf(numbers) {
  let [low, high] = [Infinity, -Infinity];
  for (const number of numbers) {
    if (!Number.isFinite(number)) continue;
    low = Math.min(low, number);
    high = Math.max(high, number);
  }
  if (low > high) return [0, 1];
  const room = (high - low) * 0.05 || Math.abs(high) * 0.05 || 0.5;
  return [low - room, high + room];
}

function ticks([low, high], most) {
  const step = niceStep((high - low) / most);
  const found = [];
  for (let at = Math.ceil(low / step) * step; at <= high; at += step) found.push([at, String(Number(at.toPrecision(12)))]);
  return found;
}
