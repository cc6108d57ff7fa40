/* What was found, in words and tables: verdicts, followers, notes, and where the runs come from. */

/** Return an element with attributes and children; texts never become markup. */
function element(name, attributes = {}, children = []) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...(Array.isArray(children) ? children : [children]));
  return made;
}

function swatch(colour) {
  const made = element("span", { class: "swatch" });
  made.style.background = colour;
  return made;
}

const MOST_ROWS = 30;

/** Return a table; on a phone each row is a block, in which headings stand beside the figures. */
function table(headings, rows) {
  for (const row of rows) {
    [...row.cells].forEach((cell, k) => { if (headings[k][1]) cell.dataset.heading = headings[k][0]; });
  }
  const head = element("tr", {}, headings.map(([text, kind = ""]) => element("th", { scope: "col", class: kind }, text)));
  return element("div", { class: rows.length > MOST_ROWS ? "long" : "scroll" }, element("table", { class: "stacked" }, [element("thead", {}, head), element("tbody", {}, rows)]));
}

/** A time as sentences show it: with two decimals, or more where it has more. */
function inSeconds(time) {
  const text = time.toFixed(2);
  return `${Math.abs(text - time) <= 1e-9 ? text : Number(time.toFixed(9))} s`;
}

function inUnit(value, unit, range = Infinity) {
  return value === null ? "" : `${figure(value, range)} ${unit}`.trim();
}

/** Return how far the figure of a verdict is from its bound, which both are shown finely enough for. */
function toBound({ margin }) {
  return margin === null ? Infinity : Math.abs(margin);
}

const OUTCOMES = { true: ["good", "✓\u00A0holds"], false: ["bad", "✗\u00A0fails"], known: ["known", "✗\u00A0fails as known"],
  unjudged: ["bad", "?\u00A0not judged"] };

const MOST_ONES = 12;

function outcomeOf(verdict) {
  if (verdict.judged === false) return OUTCOMES.unjudged;
  return OUTCOMES[!verdict.passed && verdict.known_failure ? "known" : verdict.passed];
}

/** Return verdicts with the worst one first: those that fail, then those that hold by the least. */
function worstFirst(verdicts) {
  const rank = (verdict) => (verdict.margin === null ? -Infinity : verdict.margin);
  return [...verdicts].sort((one, other) => one.passed - other.passed || rank(one) - rank(other));
}

/** Show the verdicts of all runs, an expectation a row; `lead(run, verdict)` is called for one that a reader chooses. */
function showVerdicts(place, runs, lead) {
  const several = runs.length > 1;
  const expectations = [...new Set(runs.flatMap((run) => run.verdicts.map((verdict) => verdict.expectation)))];
  const rows = expectations.flatMap((expectation) => runs.map((run, number) => {
    const verdicts = worstFirst(run.verdicts.filter((verdict) => verdict.expectation === expectation));
    if (!verdicts.length) return null;
    const [worst] = verdicts;
    const [kind, word] = outcomeOf(worst);
    const choose = (verdict, text, look) => {
      if (verdict.moment === null) return element("span", { class: look }, text);
      const button = element("button", { class: look, title: `show ${verdict.robot} at ${inSeconds(verdict.moment)}` }, text);
      button.addEventListener("click", () => lead(run, verdict));
      return button;
    };
    const robots = verdicts.length > 1 ? verdicts.slice(0, MOST_ONES).map((verdict) => {
      const [kindOfOne, wordOfOne] = outcomeOf(verdict);
      return choose(verdict, `${wordOfOne[0]} ${verdict.robot} ${inUnit(verdict.figure, verdict.unit, toBound(verdict))}`, `one ${kindOfOne}`);
    }) : [];
    if (verdicts.length > MOST_ONES) robots.push(`and ${verdicts.length - MOST_ONES} followers that do better`);
    const detail = [worst.robot, worst.detail, worst.known_failure && `known: ${worst.known_failure}`].filter(Boolean);
    return element("tr", {}, [
      element("td", {}, [several ? `${number + 1}: ` : "", choose(worst, word, `outcome ${kind}`)]),
      element("td", {}, [expectation, element("div", { class: "dim" }, detail.join("; ")), element("div", { class: "ones" }, robots)]),
      element("td", { class: "number" }, inUnit(worst.figure, worst.unit, toBound(worst))),
      element("td", { class: "number" }, inUnit(worst.bound, worst.unit, toBound(worst))),
      element("td", { class: "number" }, inUnit(worst.margin, worst.unit)),
    ]);
  })).filter(Boolean);
  if (!rows.length) {
    place.append(element("p", { class: "dim" }, runs[0].status === "running"
      ? "The run goes on; it is judged at its end." : runs[0].status === "completed" ? "The scenario expects nothing."
      : runs[0].status === "part" ? "The result has not all ticks of its run, so nothing was judged." : "The run did not reach its end, so nothing was judged."));
    return;
  }
  const headings = [["verdict"], ["expectation, and the worst follower"], ["figure", "number"], ["bound", "number"], ["margin", "number"]];
  place.append(table(headings, rows));
}

/** Show how well each follower kept its place, in each run. */
function showFollowers(place, runs) {
  if (runs[0].status === "running") {
    place.append(element("p", { class: "dim" }, "How well they keep their places follows at the end, too."));
    return;
  }
  const several = runs.length > 1;
  const rows = [];
  for (const robot of new Set(runs.flatMap((run) => run.followers.map((one) => one.robot)))) runs.forEach((run, number) => {
    const figures = run.followers.find((one) => one.robot === robot);
    const own = figures ? run : runs.find((other) => other.followers.some((one) => one.robot === robot));
    const told = !figures ? Array(4).fill("") : [
      figures.settling_time === null ? "not" : inSeconds(figures.settling_time),
      inUnit(figures.range_rms, "m"),
      figures.bearing_rms === null ? "" : inUnit((figures.bearing_rms * 180) / Math.PI, "deg"),
      inUnit(figures.peak_torque, "N.m"),
    ];
    rows.push(element("tr", {}, [
      element("td", {}, [swatch(colourFor(own, robot)), robot]),
      ...(several ? [element("td", {}, String(number + 1))] : []),
      ...told.map((text) => element("td", { class: "number" }, text || "–")),
    ]));
  });
  const headings = [["follower"], ...(several ? [["run"]] : []), ["settled after", "number"], ["range RMS", "number"],
    ["bearing RMS", "number"], ["peak torque", "number"]];
  place.append(table(headings, rows));
  place.append(element("p", { class: "dim" },
    "RMS over the last fifth of the run; settled: within 0.1 m and 2 deg from then on."));
  runs.forEach((run, number) => {
    for (const { of, distance, between } of run.distance.filter((one) => one.distance !== null)) {
      place.append(element("p", { class: "dim" },
        `${several ? `Run ${number + 1}: ` : ""}smallest distance of ${of}: ${figure(distance)} m (${between.join(", ")})`));
    }
  });
}

/** Show notes, messages of FMUs and events; `seek(time)` is called for one that a reader chooses. */
function showNotes(place, runs, seek) {
  for (const [number, run] of runs.entries()) {
    const of = runs.length > 1 ? ` of run ${number + 1}` : "";
    if (run.notes.length) {
      place.append(element("h2", {}, `Notes${of}`), element("ul", {}, run.notes.map((note) => element("li", {}, note))));
    }
    const moments = [
      ...run.events.map((event) => [event.time, event.robot, event.text]),
      ...run.messages.map((message) => [message.time, message.robot, `FMU, ${message.status}: ${message.text}`]),
    ].sort((one, other) => one[0] - other[0]);
    if (!moments.length) continue;
    const rows = moments.map(([time, robot, text]) => {
      const when = element(isShown(run, time) ? "button" : "span", { class: "outcome" }, inSeconds(time));
      if (isShown(run, time)) when.addEventListener("click", () => seek(time));
      return element("tr", {}, [element("td", {}, when), element("td", {}, robot), element("td", {}, text)]);
    });
    place.append(element("h2", {}, `Events and messages${of}`), table([["time"], ["robot"], ["what happens"]], rows));
    if (run.messages_left_out) place.append(element("p", { class: "dim" }, `${run.messages_left_out} messages between are left out.`));
  }
}

/** Show scenario, versions, checksums and the command that repeats each run. */
function showProvenance(place, runs) {
  runs.forEach((run, number) => {
    const told = run.provenance;
    const rows = [
      ["scenario", told.file || run.name],
      ["recording", told.recording],
      ["repeat it", told.command && element("code", {}, told.command)],
      ["parts", told.resumed],
      ["seed", told.seed],
      ...Object.entries(told.plants || {}).map(([id, plant]) => [
        `plant ${id}`, `${plant.file}, FMI ${plant.fmi_version}, SHA-256 ${plant.sha256}`]),
      ...(told.controllers || []).map((law) => ["controller", `${law.name} of ${law.package} ${law.version} (${law.robots.join(", ")})${law.environment ? `, in an environment of its own: ${law.environment}` : ""}`]),
      ["versions", Object.entries(told.versions).map(([name, version]) => `${name} ${version}`).join(", ")],
    ].filter(([, text]) => text !== null && text !== undefined && text !== "");
    if (runs.length > 1) place.append(element("h3", {}, `${number + 1}: ${run.name}`));
    place.append(element("dl", {}, rows.flatMap(([name, text]) => [
      element("dt", {}, name), element("dd", {}, text instanceof Node ? text : String(text))])));
    place.append(foldedXml(told.recording ? "the scenario by which the drive was judged" : "the scenario as it was run", run.scenario));
  });
}

/** Return an XML text that is shown, coloured, when it is unfolded. */
function foldedXml(summary, text) {
  const place = element("pre", { tabindex: "0" });
  const folded = element("details", {}, [element("summary", {}, summary), place]);
  folded.addEventListener("toggle", () => place.replaceChildren(...highlighted(text)), { once: true });
  return folded;
}

/** Return the pieces of an XML text, coloured. */
function highlighted(text) {
  const pieces = [];
  const add = (kind, part) => pieces.push(kind ? element("span", { class: kind }, part) : part);
  const token = /<!--[\s\S]*?-->|<[^>]*>/g;
  let end = 0;
  for (const match of text.matchAll(token)) {
    if (match.index > end) add("", text.slice(end, match.index));
    end = match.index + match[0].length;
    if (match[0].startsWith("<!--")) {
      add("x-comment", match[0]);
      continue;
    }
    let rest = 0;
    for (const part of match[0].matchAll(/([\w:.-]+)(\s*=\s*)("[^"]*"|'[^']*')/g)) {
      add("x-tag", match[0].slice(rest, part.index));
      add("x-attribute", part[1]);
      add("", part[2]);
      add("x-value", part[3]);
      rest = part.index + part[0].length;
    }
    add("x-tag", match[0].slice(rest));
  }
  add("", text.slice(end));
  return pieces;
}
