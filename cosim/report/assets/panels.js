/* Signals over time, a panel for each component, with the bands of the expectations and the time of the playback. */

const DASHES = [[], [7, 4], [2, 3], [9, 3, 2, 3]];
const MOST_VALUES = 12;

class Panels {
  /**
   * @param place where the panels stand
   * @param runs the runs, prepared
   * @param state what the page shows: `time`, `hidden` (ids of robots), `chosen` (an id, or "")
   * @param seek called with the time that a reader points at
   */
  constructor(place, runs, state, seek) {
    this.place = place;
    this.runs = runs;
    this.state = state;
    this.seek = seek;
    this.open = new Map(); // by key: signal and component
    this.zoomed = null;
    this.resized = new ResizeObserver(() => this._resize());
    this.resized.observe(place);
  }

  close() {
    this.resized.disconnect();
    for (const key of [...this.open.keys()]) this.hide(key);
  }

  static key(signal, component) {
    return component ? `${signal}/${component}` : signal;
  }

  /** Return all signals of all runs, by name. */
  signals() {
    const found = new Map();
    for (const run of this.runs) for (const signal of run.signals.list) if (!found.has(signal.name)) found.set(signal.name, signal);
    return [...found.values()];
  }

  show(key) {
    if (this.open.has(key)) return;
    const [signal, part] = this._found(key);
    if (!part) return;
    const [name, component] = [signal.name, part.name];
    const [unit, factor] = shownUnit(part.unit);
    const heading = component ? `${component} of ${name}` : name;
    const close = element("button", { title: "close this panel", "aria-label": `close ${heading}` }, "×");
    const figure_ = element("figure", {}, [
      element("figcaption", {}, [
        element("strong", {}, unit ? `${heading} [${unit}]` : heading),
        element("span", { class: "dim", title: signal.about }, signal.about),
        close,
      ]),
    ]);
    const panel = { key, name, component, unit, factor, figure: figure_, heading };
    close.addEventListener("click", () => this.hide(key));
    this.place.append(figure_);
    this.open.set(key, panel);
    this._draw(panel);
  }

  _found(key) {
    for (const signal of this.signals()) {
      for (const part of signal.components) if (Panels.key(signal.name, part.name) === key) return [signal, part];
    }
    return [];
  }

  hide(key) {
    const panel = this.open.get(key);
    if (!panel) return;
    panel.plot?.destroy();
    panel.figure.remove();
    this.open.delete(key);
    this.changed?.();
  }

  /** Draw all anew: robots were shown or hidden, or colours have changed. */
  redraw() {
    for (const panel of this.open.values()) this._draw(panel);
  }

  /** Take further samples in: whoever sees all times still does. */
  grow() {
    for (const panel of this.open.values()) {
      const [times] = panel.plot.data;
      const { min, max } = panel.plot.scales.x;
      const all = !(min > times[0] || max < times.at(-1));
      const courses = this._courses(panel);
      if (courses.length !== panel.courses.length) this._draw(panel);
      else {
        panel.courses = courses;
        panel.range = rangeShown(courses);
        this.zooming = true; // each panel sees to itself
        panel.plot.setData(aligned(courses), all);
        this.zooming = false;
        if (all) this.zoomed = null;
        else panel.plot.redraw();
      }
    }
  }

  /** Follow the time of the playback. */
  tick() {
    for (const panel of this.open.values()) this._now(panel);
  }

  _courses(panel) {
    const courses = [];
    this.runs.forEach((run, number) => {
      const signal = run.signals.list.find((one) => one.name === panel.name);
      const k = signal ? signal.components.findIndex((one) => one.name === panel.component) : -1;
      if (k < 0) return;
      const [unit, factor] = shownUnit(signal.components[k].unit);
      if (unit !== panel.unit) return; // another version of a law may have another signal of that name
      signal.robots.forEach((robot, row) => {
        if (this.state.hidden.has(robot) || signal.columns[row][k] === null) return;
        courses.push({ run, number, robot, factor, values: column(run, signal.columns[row][k], run.times.length) });
      });
    });
    return courses;
  }

  _draw(panel) {
    panel.plot?.destroy();
    panel.values?.remove();
    const courses = (panel.courses = this._courses(panel));
    panel.range = rangeShown(courses);
    const theme = getComputedStyle(document.documentElement);
    const colour = (name) => theme.getPropertyValue(name).trim();
    const axis = { stroke: colour("--dim"), grid: { stroke: colour("--grid"), width: 1 }, ticks: { stroke: colour("--grid") } };
    const range = this.zoomed;
    panel.plot = new uPlot(
      {
        width: Math.max(200, panel.figure.clientWidth),
        height: 190,
        scales: { x: { time: false } },
        axes: [{ ...axis, size: 32, values: (_, ticks) => ticks.map((tick) => `${Number(tick.toPrecision(6))} s`) }, { ...axis, size: widthOf }],
        legend: { show: false },
        cursor: { sync: { key: "time" }, drag: { x: true, y: false }, points: { show: false } },
        series: [
          {},
          ...courses.map(({ robot, number, run }) => ({
            label: robot,
            stroke: colourFor(run, robot, colour("--leader")),
            width: this.state.chosen === robot ? 2.2 : 1.2,
            alpha: this.state.chosen && this.state.chosen !== robot ? 0.3 : 1,
            dash: DASHES[number % DASHES.length],
            points: { show: run.times.length === 1 },
          })),
        ],
        hooks: {
          drawClear: [(plot) => this._bands(panel, plot, colour)],
          setScale: [(plot, scale) => scale === "x" && this._zoom(panel, plot)],
        },
      },
      aligned(courses),
      panel.figure,
    );
    if (range) panel.plot.setScale("x", range);
    this._pointer(panel);
    panel.now = element("div", { class: "now" });
    panel.plot.over.append(panel.now);
    panel.values = element("div", { class: "values" });
    panel.figure.append(panel.values);
    if (courses.length <= MOST_VALUES) {
      panel.shown = courses.map((course) => {
        const value = document.createTextNode("");
        const name = this.runs.length > 1 ? `${course.robot} (${course.number + 1})` : course.robot;
        panel.values.append(element("span", {}, [swatch(colourFor(course.run, course.robot, "var(--leader)")), `${name} `, value]));
        return value;
      });
    } else panel.shown = null;
    this._now(panel);
  }

  /** A click leads to a time; a drag zooms, which uPlot does. */
  _pointer(panel) {
    let pressed = null;
    panel.plot.over.addEventListener("mousedown", (event) => { pressed = event.clientX; });
    panel.plot.over.addEventListener("click", (event) => {
      if (pressed === null || Math.abs(event.clientX - pressed) > 3) return;
      this.seek(panel.plot.posToVal(event.offsetX, "x"));
    });
  }

  _now(panel) {
    const { plot } = panel;
    const left = plot.valToPos(this.state.time, "x");
    panel.now.style.left = `${left}px`;
    panel.now.style.display = left >= 0 && left <= plot.over.clientWidth ? "" : "none";
    panel.shown?.forEach((text, i) => {
      const { run, values, factor } = panel.courses[i];
      const sample = isBefore(run, this.state.time) ? NaN : values[indexAt(run.times, this.state.time)];
      const value = figure(sample * factor, panel.range);
      text.data = panel.unit && value !== "–" ? `${value} ${panel.unit}` : value;
    });
  }

  /** All panels show the same times. */
  _zoom(panel, plot) {
    if (this.zooming || !panel.plot) return;
    this.zooming = true;
    const { min, max } = plot.scales.x;
    this.zoomed = { min, max };
    for (const other of this.open.values()) {
      if (other !== panel) other.plot.setScale("x", { min, max });
    }
    this.zooming = false;
    this.tick();
  }

  _bands(panel, plot, colour) {
    const pen = plot.ctx;
    const { left, top, width, height } = plot.bbox;
    pen.save();
    pen.beginPath();
    pen.rect(left, top, width, height);
    pen.clip();
    for (const band of this.runs[0].bands) {
      if (band.signal !== panel.name || band.component !== panel.component) continue;
      const from = plot.valToPos(band.start, "x", true);
      const to = Math.max(plot.valToPos(band.stop, "x", true), from + 2);
      const edge = (value, otherwise) => (value === null ? otherwise : plot.valToPos(value * panel.factor, "y", true));
      const high = edge(band.upper, top);
      const low = edge(band.lower, top + height);
      pen.fillStyle = colour(band.inside ? "--good" : "--bad");
      pen.globalAlpha = band.upper === null && band.lower === null ? 0.05 : 0.1;
      pen.fillRect(from, high, to - from, low - high);
      pen.globalAlpha = 0.8;
      pen.strokeStyle = pen.fillStyle;
      pen.setLineDash([5, 4]);
      pen.lineWidth = 1;
      pen.beginPath();
      for (const [value, y] of [[band.upper, high], [band.lower, low]]) {
        if (value === null) continue;
        pen.moveTo(from, y); pen.lineTo(to, y);
      }
      pen.stroke();
    }
    pen.restore();
  }

  _resize() {
    for (const panel of this.open.values()) {
      const width = Math.max(200, panel.figure.clientWidth);
      if (panel.plot && panel.plot.width !== width) {
        panel.plot.setSize({ width, height: 190 });
        this._now(panel);
      }
    }
  }
}

/** Return how far apart the numbers of some courses are, as they are shown. */
function rangeShown(courses) {
  return courses.length ? spreadOf(courses.map(({ values }) => values)) * Math.abs(courses[0].factor) : 0;
}

/** Return the room [px] that the numbers beside an axis take. */
function widthOf(_, texts) {
  return Math.max(62, ...(texts || []).map((text) => 20 + 7 * String(text).length));
}

function colourFor(run, robot, leader) {
  const place = run.vehicles.findIndex((vehicle) => vehicle.id === robot);
  return place > 0 ? colourOf(place - 1) : leader;
}

/** Return the courses over common times, as uPlot takes them: null where there is no number. */
function aligned(courses) {
  if (!courses.length) return [[0, 1]];
  const values = courses.map((course) => Array.from(course.values, (value) => (Number.isFinite(value) ? value * course.factor : null)));
  const [first] = courses;
  const same = courses.every(({ run }) => {
    const times = run.times;
    return times === first.run.times
      || (times.length === first.run.times.length && times.every((time, i) => time === first.run.times[i]));
  });
  if (same) return [Array.from(first.run.times), ...values];
  return uPlot.join(courses.map((course, i) => [Array.from(course.run.times), values[i]]));
}
