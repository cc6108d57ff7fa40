/* A view of runs: what it shows at a time, and how a reader moves through it. */

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8, 16, 32];
const FIRST = ["range_error", "bearing_error"];
const MOST_MARKS = 200;

/**
 * Show runs, overlaid, in the sections of the template; return the view, of which `close` removes it.
 *
 * @param runs the runs, prepared
 */
function showRuns(runs) {
  const place = document.getElementById("view");
  place.replaceChildren(document.getElementById("run-view").content.cloneNode(true));
  const closed = new AbortController();
  const whileOpen = { signal: closed.signal };
  const last = () => Math.max(...runs.map((run) => run.end));
  const start = Math.min(...runs.map((run) => run.motionTimes[0]));
  let end = last();
  const until = Math.max(end, ...runs.map((run) => (run.status === "running" ? run.horizon : 0)));
  const state = { time: start, hidden: new Set(), chosen: "", playing: false, speed: end - start > 60 ? 4 : 1 };
  const get = (id) => document.getElementById(id);
  const playback = new Playback(get("scene"), runs, state);
  const panels = new Panels(get("panels"), runs, state, (time) => seek(time));

  // Time

  function show() {
    playback.draw();
    panels.tick();
    get("time").value = state.time;
    get("clock").textContent = `${state.time.toFixed(2)} / ${end.toFixed(2)} s`;
    const warning = playback.warnings.slice(0, 3).join("; ");
    if (get("warning").textContent !== warning) get("warning").textContent = warning;
  }

  function seek(time) {
    state.time = Math.max(start, Math.min(end, time));
    show();
    if (!state.playing) remember();
  }

  function remember() {
    address.set("t", Number(state.time.toFixed(3)));
  }

  function recall() {
    const time = Number.parseFloat(address.get("t"));
    if (Number.isFinite(time)) seek(time);
  }

  let before = 0;
  function frame(now) {
    if (!state.playing || closed.signal.aborted) return;
    state.time = Math.min(end, state.time + (state.speed * Math.min(now - before, 200)) / 1000);
    before = now;
    if (state.time >= end) play(false);
    show();
    requestAnimationFrame(frame);
  }

  function play(on) {
    state.playing = on;
    get("play").textContent = on ? "❚❚" : "▶\uFE0E";
    get("play").setAttribute("aria-label", on ? "Pause" : "Play");
    if (!on) return remember();
    if (state.time >= end) state.time = start;
    before = performance.now();
    requestAnimationFrame(frame);
  }

  /** Return the time of the sample ahead (1) or before (-1), which is a step away unless samples are left out. */
  function beside(by) {
    const [ahead, now] = [by > 0, state.time];
    const nextOf = (run) => {
      if (run.sample_times) {
        const times = run.motionTimes;
        return ahead ? times.find((time) => time > now + 1e-9) : times.findLast((time) => time < now - 1e-9);
      }
      const time = now + by * run.step;
      return time <= run.end + 1e-9 ? time : ahead ? undefined : run.end;
    };
    const found = runs.map(nextOf).filter((time) => time !== undefined);
    return !found.length ? now : ahead ? Math.min(...found) : Math.max(...found);
  }

  function faster(by) {
    state.speed = SPEEDS[Math.max(0, Math.min(SPEEDS.length - 1, SPEEDS.indexOf(state.speed) + by))];
    get("speed").value = state.speed;
  }

  // Robots

  const robots = [...new Set(runs.flatMap((run) => run.vehicles.map((vehicle) => vehicle.id)))];
  for (const id of robots) {
    const colour = colourFor(runs.find((run) => run.vehicles.some((one) => one.id === id)), id, "var(--leader)");
    const button = element("button", { class: "robot", "aria-pressed": "true", title: "show or hide" }, [swatch(colour), id]);
    button.addEventListener("click", () => {
      if (!state.hidden.delete(id)) state.hidden.add(id);
      button.setAttribute("aria-pressed", String(!state.hidden.has(id)));
      panels.redraw();
      show();
    });
    get("robots").append(button);
  }
  for (const [value, text] of [["", "everything"], ["team", "the team"], ...robots.map((id) => [id, id])]) {
    get("follow").append(element("option", { value }, text));
  }

  function choose(id) {
    state.chosen = state.chosen === id ? "" : id;
    panels.redraw();
    show();
  }

  // Signals

  const buttons = new Map();
  function press() {
    for (const [key, button] of buttons) button.setAttribute("aria-pressed", String(panels.open.has(key)));
  }
  panels.changed = press;
  const groups = Map.groupBy ? Map.groupBy(panels.signals(), (one) => one.group) : grouped(panels.signals());
  for (const [group, signals] of groups) {
    const row = element("div", {}, [element("span", {}, group)]);
    for (const signal of signals) {
      for (const component of signal.components) {
        const key = Panels.key(signal.name, component.name);
        const button = element("button", { "aria-pressed": "false", title: signal.about },
          component.name ? `${signal.name}: ${component.name}` : signal.name);
        button.addEventListener("click", () => {
          if (panels.open.has(key)) panels.hide(key);
          else panels.show(key);
          press();
        });
        buttons.set(key, button);
        row.append(button);
      }
    }
    get("groups").append(row);
  }
  const commands = panels.signals().find((signal) => ["torque", "command"].includes(signal.name));
  for (const key of [...FIRST, ...(commands ? commands.components.map((one) => Panels.key(commands.name, one.name)) : [])]) panels.show(key);
  press();
  const thinned = runs.filter((run) => run.signals.bucket > 1);
  get("thinning").textContent = thinned.length
    ? `The run has many samples: of each ${thinned[0].signals.bucket} of them, the curves show the least and the greatest value.` : "";

  // Verdicts, and where the runs come from

  function lead(run, verdict) {
    play(false);
    for (const [signal, component] of verdict.signals) panels.show(Panels.key(signal, component));
    press();
    state.chosen = verdict.robot;
    panels.redraw();
    seek(verdict.moment);
    reveal();
  }

  /** Bring the playback into view, where it is not. */
  function reveal() {
    const { top, bottom } = get("stage").getBoundingClientRect();
    if (bottom < 120 || top > innerHeight - 120) get("playback").scrollIntoView({ block: "start" });
  }

  showVerdicts(get("verdicts"), runs, lead);
  showFollowers(get("followers"), runs);
  showNotes(get("notes"), runs, (time) => { play(false); seek(time); reveal(); });
  if (runs.length > 1) {
    get("compared").hidden = false;
    showDifferences(get("compared"), runs, lead, (robot, time) => {
      play(false);
      state.chosen = robot;
      panels.redraw();
      seek(time);
      reveal();
    });
  }
  showProvenance(get("provenance"), runs);
  runs.forEach((run, number) => get("runs").append(headline(run, runs.length > 1 ? number + 1 : 0)));
  marks(get("marks"), runs, [start, until], (time) => { play(false); seek(time); });

  // Controls

  get("time").min = start;
  get("time").max = until;
  for (const speed of SPEEDS) get("speed").append(element("option", { value: speed }, `× ${speed}`));
  get("speed").value = state.speed;
  const actions = {
    play: () => play(!state.playing),
    back: () => seek(beside(-1)),
    ahead: () => seek(beside(1)),
    fit: () => { playback.follow = get("follow").value = ""; playback.fit(); },
    "keys-button": () => {
      get("keys").hidden = !get("keys").hidden;
      get("keys-button").setAttribute("aria-expanded", String(!get("keys").hidden));
    },
  };
  for (const [id, act] of Object.entries(actions)) get(id).addEventListener("click", act);
  get("time").addEventListener("input", () => seek(Number(get("time").value)));
  get("speed").addEventListener("change", () => { state.speed = Number(get("speed").value); });
  get("follow").addEventListener("change", () => {
    playback.follow = get("follow").value;
    playback.view = null;
    show();
  });
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || !isOurs(event)) return;
    const pan = { ArrowLeft: [40, 0], ArrowRight: [-40, 0], ArrowUp: [0, 40], ArrowDown: [0, -40] }[event.key];
    const keys = {
      " ": () => play(!state.playing),
      ArrowLeft: () => seek(event.shiftKey ? beside(-1) : state.time - 1),
      ArrowRight: () => seek(event.shiftKey ? beside(1) : state.time + 1),
      Home: () => seek(start),
      End: () => seek(end),
      "+": () => playback.zoom(1.25),
      "-": () => playback.zoom(0.8),
      0: actions.fit,
      "[": () => faster(-1),
      "]": () => faster(1),
      Escape: () => choose(state.chosen),
    };
    const act = event.altKey ? pan && (() => playback.pan(...pan)) : keys[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }, whileOpen);
  const redraw = () => { panels.redraw(); show(); };
  addEventListener("resize", show, whileOpen);
  addEventListener("hashchange", recall, whileOpen);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw, whileOpen);
  addEventListener("beforeprint", redraw, whileOpen);
  show();
  recall();

  function close() {
    play(false);
    closed.abort();
    panels.close();
    place.replaceChildren();
  }

  // A run that goes on

  const isFollowing = () => !state.playing && state.time >= end;

  function follow() {
    play(false);
    state.time = end;
    show();
  }

  /** Show that the runs have more samples; whoever was at the end stays there. */
  function grow() {
    const following = isFollowing();
    end = last();
    if (following) state.time = end;
    panels.grow();
    show();
  }

  /** Let a reader find what another view has shown. */
  function restore(before) {
    for (const key of before.keys) panels.show(key);
    for (const key of [...panels.open.keys()]) if (!before.keys.includes(key)) panels.hide(key);
    press();
    for (const button of get("robots").children) if (before.hidden.has(button.textContent)) button.click();
    state.chosen = before.chosen;
    state.speed = get("speed").value = before.speed;
    playback.view = before.place;
    playback.follow = get("follow").value = before.follow;
    state.time = before.following ? end : Math.min(before.time, end);
    panels.redraw();
    show();
  }

  return { runs, state, playback, panels, seek, play, lead, show, close, isFollowing, follow, grow, restore };
}

/** Return whether a key is meant for the playback: not for what has the focus, or for another part of the page. */
function isOurs(event) {
  const { tagName, type } = event.target;
  if (event.target.closest("#study")) return false;
  if (tagName === "INPUT" && type === "range") return event.key === " ";
  if (/^(INPUT|SELECT|TEXTAREA)$/.test(tagName)) return false;
  return !(event.key === " " && /^(BUTTON|SUMMARY)$/.test(tagName));
}

/** What the page's address says behind its #. */
const address = {
  get: (name) => new URLSearchParams(location.hash.slice(1)).get(name),
  set(name, value) {
    const told = new URLSearchParams(location.hash.slice(1));
    if (value === "") told.delete(name);
    else told.set(name, value);
    history.replaceState(null, "", `#${told}`);
  },
};

function grouped(signals) {
  const found = new Map();
  for (const signal of signals) found.set(signal.group, [...(found.get(signal.group) || []), signal]);
  return found;
}

/** Return a line that tells how a run ended. */
function headline(run, number) {
  const fails = run.verdicts.filter((verdict) => !verdict.passed).length;
  const [kind, word] = run.status === "running" ? ["", "goes on"]
    : run.status === "part" ? ["bad", "is here in part, and not judged"]
    : run.status !== "completed" ? ["bad", "did not reach its end"]
    : !run.verdicts.length ? ["", "reached its end"]
      : fails ? ["bad", `${fails} of ${run.verdicts.length} verdicts ${fails === 1 ? "fails" : "fail"}`] : ["good", "all expectations hold"];
  const changes = run.provenance.changes.length ? `, changed by ${run.provenance.changes.join(" ")}` : "";
  const drive = run.provenance.recording ? ", a recorded drive" : "";
  const line = element("li", {}, [
    number ? `${number}: ` : "", element("strong", {}, run.name), drive, changes, ", ", element("span", { class: kind }, word),
    run.status === "running" || run.status === "part" ? "" : ` after ${figure(run.end)} s`, drive ? "" : `, seed ${run.provenance.seed ?? "unknown"}`,
  ]);
  if (run.failure) line.append(element("div", { class: "bad" }, run.failure.text));
  return line;
}

/** Mark on the time line when something happened, as far as the runs are shown. */
function marks(place, runs, [start, end], seek) {
  const found = runs.flatMap((run) => [
    ...run.verdicts.filter((verdict) => !verdict.passed && verdict.moment !== null)
      .map((verdict) => [verdict.moment, "bad", `${verdict.robot} ${verdict.expectation}`]),
    ...run.events.map((event) => [event.time, "event", `${event.robot}: ${event.text}`]),
    ...run.messages.map((message) => [message.time, "", `${message.robot}: ${message.text}`]),
    ...(run.failure && run.failure.time !== null ? [[run.failure.time, "bad", run.failure.text]] : []),
  ].filter(([time]) => isShown(run, time)));
  for (const [time, kind, text] of found.slice(0, MOST_MARKS)) {
    const title = `${inSeconds(time)}, ${text}`;
    const button = element("button", { class: kind, title, "aria-label": title });
    button.style.left = `${end > start ? Math.max(0, Math.min(100, (100 * (time - start)) / (end - start))) : 0}%`;
    button.addEventListener("click", () => seek(time));
    place.append(button);
  }
}
