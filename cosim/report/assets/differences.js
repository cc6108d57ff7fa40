/* What differs between runs that are compared: figures, scenarios, versions, and the paths of the robots. */

const MOST_DIFFERENCES = 60;
const MOST_LETTERS = 120;
const MOST_SENTENCES = 10;
const KEYS = ["id", "name", "select"];

/** Show the differences of runs from the first one; `lead(run, verdict)` and `seek(robot, time)` are called for what a reader chooses. */
function showDifferences(place, runs, lead, seek) {
  const headings = runs.map((run, number) => [number ? `${number + 1} against 1` : "1", "number"]);
  place.append(element("h2", {}, "Differences"), table([["figure, of the worst follower"], ...headings], comparedFigures(runs, lead)));
  const differing = differingInputs(runs);
  place.append(element("h3", {}, "What differs in what was run"));
  if (differing.length) {
    const rows = differing.slice(0, MOST_DIFFERENCES).map(({ what, values }) => element("tr", {}, [
      element("td", {}, element("code", {}, what)), ...values.map((value) => element("td", { class: value === undefined ? "dim" : "" }, cut(value ?? "none")))]));
    place.append(table([[""], ...runs.map((_, number) => [String(number + 1), "value"])], rows));
    if (differing.length > MOST_DIFFERENCES) place.append(element("p", { class: "dim" }, `and ${differing.length - MOST_DIFFERENCES} more`));
  } else {
    const known = runs.every((run) => !unknownFiles(run).length);
    place.append(element("p", { class: "dim" },
      `Nothing of what is compared: the scenarios with their changes, ${known ? "the files that they name, " : ""}the seeds, the plants, the controllers and the versions.`));
  }
  for (const sentence of notCompared(runs)) place.append(element("p", { class: "dim" }, sentence));
  place.append(element("h3", {}, "Largest distance between the paths"));
  const apart = runs.slice(1).flatMap((run, k) => pathsApart(runs[0], run).map((one) => ({ ...one, number: k + 2 })));
  if (!apart.length) place.append(element("p", { class: "dim" }, "The runs have no robot in common whose path is known at the same times."));
  else {
    const rows = apart.map(({ robot, number, distance, time, end }) => {
      const button = element("button", { class: "outcome", title: `show ${robot} at ${inSeconds(time)}` }, inSeconds(time));
      button.addEventListener("click", () => seek(robot, time));
      return element("tr", {}, [
        element("td", {}, robot), ...(runs.length > 2 ? [element("td", {}, `${number} against 1`)] : []),
        element("td", { class: "number" }, inUnit(distance, "m")), element("td", { class: "number" }, button),
        element("td", { class: "number" }, end === null ? "unknown" : inUnit(end, "m"))]);
    });
    place.append(table([["robot"], ...(runs.length > 2 ? [["runs"]] : []), ["largest distance", "number"], ["at", "number"], ["at the end", "number"]], rows));
  }
}

// Figures

/** Return a row for each expectation, and for each figure of the followers. */
function comparedFigures(runs, lead) {
  const expectations = [...new Set(runs.flatMap((run) => run.verdicts.map((verdict) => verdict.expectation)))];
  const judged = expectations.map((expectation) => comparedRow(expectation, runs.map((run) => {
    const [worst] = worstFirst(run.verdicts.filter((verdict) => verdict.expectation === expectation));
    return worst && { value: worst.figure, unit: worst.unit, good: worst.margin, passed: worst.passed, choose: worst.moment === null ? null : () => lead(run, worst) };
  })));
  // Null is no figure: a run that was cut short has no last fifth. Only a vehicle without torques is of no account.
  const worstOf = (name, unit, { factor = 1, smaller = true, lacking = null } = {}) => runs.map((run) => {
    const values = run.followers.map((one) => one[name]).filter((value) => smaller || value !== null);
    if (!values.length) return undefined;
    const value = values.includes(null) ? lacking : Math.max(...values) * factor;
    return { value, unit, good: smaller && value !== null ? -value : null };
  });
  const nearest = (of) => runs.map((run) => {
    const found = run.distance.find((one) => one.of === of);
    return found && { value: found.distance, unit: "m", good: found.distance };
  });
  const figures = [
    ["settled within 0.1 m and 2 deg after", worstOf("settling_time", "s", { lacking: Infinity })],
    ["range RMS over the last fifth", worstOf("range_rms", "m")],
    ["bearing RMS over the last fifth", worstOf("bearing_rms", "deg", { factor: 180 / Math.PI })],
    ["peak torque", worstOf("peak_torque", "N.m", { smaller: false })],
    ["smallest distance of bodies", nearest("bodies")],
  ];
  return [...judged, ...figures.filter(([, found]) => found.some(Boolean)).map(([name, found]) => comparedRow(name, found))];
}

/** Return a row: the figure of each run, its difference from the first, and whether it is better. */
function comparedRow(name, found) {
  const cells = found.map((one, number) => {
    if (!one) return element("td", { class: "number dim" }, "none");
    const value = one.value === Infinity ? "not" : inUnit(one.value, one.unit) || "none";
    const look = one.passed === undefined ? "" : one.passed ? "good" : "bad";
    const mark = one.passed === undefined ? "" : one.passed ? "✓ " : "✗ ";
    const text = one.choose ? element("button", { class: `one ${look}` }, mark + value) : element("span", { class: look }, mark + value);
    if (one.choose) text.addEventListener("click", one.choose);
    const told = number && found[0] ? againstFirst(one, found[0]) : "";
    return element("td", { class: "number" }, [text, element("div", { class: "dim" }, told)]);
  });
  return element("tr", {}, [element("td", {}, name), ...cells]);
}

function againstFirst(one, first) {
  if (one.value === null || first.value === null) return "";
  if (one.value === first.value) return "the same";
  const difference = one.value - first.value;
  const by = Number.isFinite(difference) ? `${difference > 0 ? "+" : ""}${figure(difference)}` : "";
  const better = one.good === null || first.good === null || one.good === first.good ? "" : one.good > first.good ? "better" : "worse";
  return [by, better].filter(Boolean).join(", ");
}

// What was run

/** Return what differs in what was run: {what, values}, a value a run. */
function differingInputs(runs) {
  const told = runs.map((run) => inputsOf(run));
  const names = [...new Set(told.flatMap((one) => [...one.keys()]))];
  const differing = names.map((what) => ({ what, values: told.map((one) => one.get(what)) }))
    .filter(({ values }) => values.some((value) => value !== values[0]));
  const orders = told.map((one) => [...one.keys()].map((path) => path.replace(/\/?@[\w.:-]+$/, "")).join("\n"));
  if (differing.length || orders.every((order) => order === orders[0])) return differing;
  return [{ what: "order of the elements", values: orders.map((order) => (order === orders[0] ? "as in 1" : "another")) }];
}

/** Return, as sentences, what the runs rest upon and nobody has compared. */
function notCompared(runs) {
  const found = runs.flatMap((run, number) => {
    const { given, recording } = run.provenance;
    const unknown = unknownFiles(run);
    const robots = Object.keys(given || {});
    return [
      ...(unknown.length ? [`Run ${number + 1}, of an older version, does not tell what ${unknown.join(", ")} held, so this is not compared.`] : []),
      ...(robots.length ? [`A program gave commands to ${robots.join(", ")} in run ${number + 1}; of these only their times are compared.`] : []),
      ...(recording ? [`Run ${number + 1} is a recorded drive; what the recording holds is not compared.`] : []),
    ];
  });
  return found.length > MOST_SENTENCES ? [...found.slice(0, MOST_SENTENCES), `and ${found.length - MOST_SENTENCES} more`] : found;
}

/** Return the files that a scenario names, of which the result does not tell what they held. */
function unknownFiles(run) {
  return Object.entries(run.provenance.files || {}).filter(([, checksum]) => checksum === null).map(([name]) => name);
}

function inputsOf(run) {
  const found = new Map();
  const parsed = new DOMParser().parseFromString(run.scenario, "application/xml");
  if (!parsed.querySelector("parsererror")) flatten(parsed.documentElement, "", found);
  const { seed, versions, plants, controllers, files, given, before, recording } = run.provenance;
  if (seed !== null && seed !== undefined) found.set("seed", String(seed));
  for (const [name, checksum] of Object.entries(files || {})) {
    found.set(`SHA-256 of ${name}`, checksum === null ? "unknown" : checksum.slice(0, 16));
  }
  for (const [robot, [first, last]] of Object.entries(given || {})) {
    found.set(`commands of a program to ${robot}`, `from ${inSeconds(first)} to ${inSeconds(last)}`);
  }
  for (const [k, part] of (before || []).entries()) found.set(`part ${k + 1} until`, part);
  if (recording) found.set("recording", recording);
  for (const [id, plant] of Object.entries(plants || {}).sort()) {
    found.set(`FMU of plant ${id}`, String(plant.file));
    found.set(`SHA-256 of plant ${id}`, String(plant.sha256).slice(0, 16));
  }
  for (const law of controllers || []) for (const robot of law.robots) {
    found.set(`controller of ${robot}`, `${law.name} of ${law.package} ${law.version}`);
    if (law.files) found.set(`files of the controller of ${robot}`, law.files.slice(0, 16));
    if (law.environment) found.set(`environment of the controller of ${robot}`, law.environment);
  }
  for (const [name, version] of Object.entries(versions || {}).sort()) found.set(`version of ${name}`, String(version));
  return found;
}

function cut(text) {
  return text.length > MOST_LETTERS ? `${text.slice(0, MOST_LETTERS)}…` : text;
}

/** Add all attributes and texts of an element by their XPaths, as `--set` takes them. */
function flatten(node, path, found) {
  const under = (step) => (path ? `${path}/${step}` : step);
  for (const { name, value } of node.attributes) {
    if (!name.startsWith("xmlns") && !(path === "simulation" && name === "seed")) found.set(under(`@${name}`), value);
  }
  const children = [...node.children];
  const text = node.textContent.trim();
  if (!children.length && (text || !node.attributes.length)) found.set(path, text || "there");
  for (const child of children) flatten(child, under(stepTo(child, children)), found);
}

function stepTo(child, siblings) {
  const alike = siblings.filter((one) => one.localName === child.localName);
  const key = KEYS.find((name) => child.hasAttribute(name));
  const same = key ? alike.filter((one) => one.getAttribute(key) === child.getAttribute(key)) : alike;
  const step = key ? `${child.localName}[@${key}='${child.getAttribute(key)}']` : child.localName;
  return same.length > 1 ? `${step}[${same.indexOf(child) + 1}]` : step;
}

// Paths

/** Return how far apart the paths of two runs are, as the page's data tells it of the later one. */
function pathsApart(one, other) {
  const [early, late] = [one, other].sort((a, b) => a.place - b.place);
  return late.apart?.[early.place] || [];
}
