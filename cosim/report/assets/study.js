/* The page of a study: what must hold, all runs in figures and a table, and runs that are played. */

const MOST_LEFT_OUT = 5;

/** Return a study whose table is unpacked, with its columns by name. */
async function prepareStudy(study) {
  study.columns = JSON.parse(new TextDecoder().decode(await unpacked(study.table)));
  for (const column of study.columns) {
    if (column.exact) column.exact = column.values.map(BigInt); // whole numbers, of which the others are rounded
    column.isNumber = column.values.every((value) => value === null || typeof value === "number" || /^-?Infinity$/.test(value)) || Boolean(column.exact);
    if (column.isNumber) column.values = Float64Array.from(column.values, (value) => (value === null ? NaN : Number(value)));
    if (column.isNumber) column.range = spreadOf([column.values]);
  }
  study.column = (name) => study.columns.find((column) => column.name === name);
  study.rowOf = new Map(Array.from(study.column("run").values, (number, row) => [number, row]));
  study.told = (row) => study.columns
    .filter(({ name, kind }) => ["run", "status"].includes(name) || kind === "value" || kind === "measure")
    .map((column) => `${column.name} ${cell(column, row)} ${column.unit}`.trim()).join("\n");
}

/** Show a study, and below it the runs that a reader chooses; `runs` are those with playback. */
function showStudy(study, runs) {
  const place = document.getElementById("study");
  place.hidden = false;
  const get = (id) => document.getElementById(id);
  const played = new Map(runs.map((run) => [run.number, run]));
  let view = null;
  let chosen = null;

  // Runs that are played, one or several over each other

  const shown = [];
  function play(number) {
    const at = shown.indexOf(number);
    if (at >= 0) shown.splice(at, 1);
    else shown.push(number);
    view?.close();
    view = null;
    if (shown.length) {
      view = showRuns(shown.map((one) => played.get(one)));
      window.formation = Object.assign(page, view);
    }
    press();
    address.set("play", shown.join(" "));
    if (view) get("view").scrollIntoView({ block: "start" });
  }

  function press() {
    place.querySelectorAll("button[data-run]").forEach((button) => {
      const on = shown.includes(Number(button.dataset.run));
      button.setAttribute("aria-pressed", String(on));
      button.textContent = on ? "◼\uFE0E close" : "▶\uFE0E play";
    });
  }

  function choose(number) {
    const row = study.rowOf.get(number);
    if (row === undefined) return;
    chosen = row;
    rows.mark(row);
    scatter.draw(columnNamed("across"), columnNamed("up"), rows.rows, chosen);
    const close = element("button", { class: "close", "aria-label": "close" }, "×");
    close.addEventListener("click", leave);
    get("chosen-run").replaceChildren(...card(study, row, played, play, close));
    get("chosen-run").hidden = false;
    press();
    address.set("run", number);
  }

  function leave() {
    chosen = null;
    rows.mark(null);
    draw();
    get("chosen-run").hidden = true;
    address.set("run", "");
  }

  // What came of it

  get("ends").append(...headlineOfStudy(study));
  showRequirements(get("requirements"), study);
  showSpreads(get("spreads"), study, choose);
  showTuned(get("spreads"), study);
  showSensitivity(get("spreads"), study);
  const toSee = get("to-see");
  showToSee(toSee, study, played, choose, play);

  // Figures

  const scatter = new Scatter(get("scatter"), study, (row) => choose(study.column("run").values[row]));
  const histogram = new Histogram(get("histogram"), study);
  const values = study.columns.filter(({ kind }) => kind === "value");
  const figures = study.columns.filter(({ kind, isNumber }) => isNumber && (kind === "measure" || kind === "margin"));
  const across = [...values, ...figures, study.column("run")];
  const up = [...figures, ...values];
  const columnNamed = (id) => study.columns[Number(get(id).value)];
  const differing = values.filter((column) => new Set(column.exact || column.values).size > 1);
  const varied = differing.find((column) => column.isNumber && !column.values.every((value) => Number.isInteger(value)))
    || differing.find((column) => !column.isNumber) || differing[0] || study.column("run");
  for (const [id, columns, first] of [["across", across, varied], ["up", up, figures[0] || values[0]]]) {
    for (const column of columns) {
      const about = column.kind === "margin" ? column.about : labelOf(column);
      get(id).append(element("option", { value: study.columns.indexOf(column) }, about));
    }
    if (first) get(id).value = study.columns.indexOf(first);
    get(id).addEventListener("change", draw);
  }
  function draw() {
    if (!up.length) return;
    scatter.draw(columnNamed("across"), columnNamed("up"), rows.rows, chosen);
    const without = histogram.draw(columnNamed("up"), rows.rows);
    get("without").textContent = without ? `${without} ${without === 1 ? "run has" : "runs have"} no such figure.` : "";
    get("scatter").setAttribute("aria-label", `${labelOf(columnNamed("up"))} of each run over ${labelOf(columnNamed("across"))}`);
    get("histogram").setAttribute("aria-label", `How many runs have which ${labelOf(columnNamed("up"))}`);
  }
  const rows = new Rows(get("rows"), study, (row) => choose(study.column("run").values[row]));
  rows.filtered = draw;
  get("explore").hidden = !up.length;
  draw();
  new ResizeObserver(draw).observe(get("scatter"));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  addEventListener("beforeprint", draw);
  for (const { about, data, name } of study.pictures) {
    get("pictures").append(element("figure", {}, [element("img", { src: data, alt: `${name}: ${about}` }), element("figcaption", { class: "dim" }, about)]));
  }
  if (study.cases.length > 1) {
    const [headings, ...cases] = study.cases;
    const number = headings.map((_, k) => cases.every((row) => row[k] === "" || Number.isFinite(Number(row[k])) || /^-?inf$/.test(row[k])));
    const ranges = headings.map((_, k) => (number[k] ? spreadOf([cases.map((row) => (row[k] === "" ? NaN : Number(row[k])))]) : Infinity));
    get("cases").append(element("h2", {}, "By case"), table(
      headings.map((heading, k) => [heading, number[k] ? "number" : ""]),
      cases.map((row) => element("tr", {}, row.map((text, k) => element("td", { class: number[k] ? "number" : "" },
        number[k] && Number.isFinite(Number(text)) && text !== "" && !WHOLE.test(text) ? figure(Number(text), ranges[k]) : text)))),
    ));
  }
  showStudyOrigin(get("study-origin"), study);

  const page = { study, rows, scatter, choose, playRun: play };
  window.formation = page;
  const run = Number(address.get("run"));
  if (run) choose(run);
  for (const number of (address.get("play") || "").split(/[ +]/).map(Number)) if (played.has(number)) play(number);
}

function headlineOfStudy(study) {
  const { passed, failed, broken } = study.counts;
  const less = study.runs < study.planned
    ? study.early ? `ended early, of ${study.planned.toLocaleString("en")}` : study.verdicts.length ? "" : `a first look at ${study.planned.toLocaleString("en")}, so without a verdict` : "";
  const fails = study.verdicts.filter((verdict) => !verdict.passed).length;
  const verdict = !study.verdicts.length ? [] : fails
    ? [element("strong", { class: "bad" }, fails === study.verdicts.length && fails === 1 ? "✗ does not hold" : `✗ ${fails} of ${study.verdicts.length} do not hold`)]
    : [element("strong", { class: "good" }, "✓ all holds")];
  return [
    element("strong", {}, study.name), `, ${study.runs.toLocaleString("en")} runs${less && ` (${less})`}: `,
    element("span", { class: "good" }, `${passed} passed`), ", ", element("span", { class: failed ? "bad" : "" }, `${failed} failed`), ", ",
    element("span", { class: broken ? "known" : "" }, `${broken} broken`), ...(verdict.length ? [". ", ...verdict] : []),
  ];
}

/** Show what must hold of all runs together. */
function showRequirements(place, study) {
  if (!study.verdicts.length) {
    place.append(element("p", { class: "dim" }, study.runs < study.planned && !study.early
      ? "Nothing is judged before all runs are made." : "The study asks for nothing that must hold."));
    return;
  }
  const rows = study.verdicts.map((verdict) => {
    const [kind, word] = outcomeOf(verdict);
    const known = verdict.known_failure && `known: ${verdict.known_failure}`;
    return element("tr", {}, [
      element("td", { class: `outcome ${kind}` }, word),
      element("td", {}, [verdict.expectation, element("div", { class: "dim" }, [verdict.detail, known].filter(Boolean).join("; "))]),
      ...["figure", "bound", "margin"].map((name) => element("td", { class: "number" }, inUnit(verdict[name], verdict.unit, name === "margin" ? Infinity : toBound(verdict)))),
    ]);
  });
  place.append(table([["verdict"], ["what must hold"], ["figure", "number"], ["bound", "number"], ["margin", "number"]], rows));
}

/** Show the spread of each measure over the runs. */
function showSpreads(place, study, choose) {
  if (!study.measures.length) return;
  const quantiles = [["least", "least"], ["quarter", "25 %"], ["median", "median"], ["three_quarters", "75 %"], ["greatest", "greatest"]];
  const told = (value, range) => ({ Infinity: "∞", "-Infinity": "-∞" }[value] || figure(value, range));
  const rows = study.measures.map((measure) => {
    const range = measure.greatest - measure.least;
    const button = element("button", { class: "outcome" }, String(measure.worst_run));
    button.addEventListener("click", () => choose(measure.worst_run));
    return element("tr", {}, [
      element("td", {}, measure.unit ? `${measure.measure} [${measure.unit}]` : measure.measure),
      ...quantiles.map(([name]) => element("td", { class: "number" }, told(measure[name], Number.isFinite(range) ? range : Infinity))),
      element("td", { class: "number" }, button),
    ]);
  });
  place.append(
    element("h2", {}, study.tuned.length ? "Measures of the tuned values, on held-out draws" : "Measures of all runs"),
    table([["measure"], ...quantiles.map(([, heading]) => [heading, "number"]), ["worst run", "number"]], rows),
  );
}

/** Show the best values of a study that tunes. */
function showTuned(place, study) {
  for (const one of study.tuned) {
    const rows = Object.entries(one.values || {}).map(([name, value]) => element("tr", {}, [
      element("td", {}, name), element("td", { class: "number" }, String(value))]));
    const cost = (name, own, tuned) => `${name} ${figure(one[own])} with the scenario's own values, ${figure(one[tuned])} tuned`;
    place.append(
      element("h2", {}, one.case ? `Tuned: ${one.case}` : "Tuned"),
      table([["value"], ["best", "number"]], rows),
      element("p", { class: "dim" }, `Trial ${one.best_trial}, the best of ${one.trials}. ${cost("Cost in training:", "own_training_cost", "training_cost")}; ${
        cost("on held-out draws:", "own_held_out_cost", "held_out_cost")}.`),
      ...(one.at_bounds || []).map((sentence) => element("p", { class: "known" }, `At a bound: ${sentence}`)),
    );
  }
}

const INDICES = { first: "alone", total: "in all", mean_absolute: "magnitude" };

/** Show what each measure depends on. */
function showSensitivity(place, study) {
  if (!study.sensitivity.length) return;
  const indices = element("div", { class: "indices" });
  place.append(element("h2", {}, "What decides"), indices);
  for (const one of study.sensitivity) {
    const own = element("div");
    indices.append(own);
    const figures = Object.keys((one.values || [])[0] || {}).filter((name) => name !== "name" && !name.endsWith("plus_minus"));
    const heading = [one.measure, ...[one.cases || []].flat()].join(", ");
    if (figures.length) {
      const shares = figures.includes("total");
      const told = (value) => (shares && typeof value === "number" ? value.toFixed(2).replace(/^-0.00$/, "0.00") : figure(value));
      const main = shares ? "total" : figures[0];
      const values = [...one.values].sort((a, b) => Math.abs(b[main]) - Math.abs(a[main]));
      const rows = values.map((value) => element("tr", {}, [
        element("td", {}, value.name),
        ...figures.map((name) => element("td", { class: "number" }, [told(value[name]),
          ...(typeof value[`${name}_plus_minus`] === "number" ? [` ± ${told(value[`${name}_plus_minus`])}`] : [])])),
      ]));
      own.append(table([[heading], ...figures.map((name) => [INDICES[name] || name.replaceAll("_", " "), "number"])], rows));
    }
    if (one.note) own.append(element("p", { class: "dim" }, `${heading}: ${one.note}`));
  }
}

/** Show the runs to look at: the worst, failed and broken ones, and those that are kept. */
function showToSee(place, study, played, choose, play) {
  if (study.left_out.length) {
    const some = study.left_out.slice(0, MOST_LEFT_OUT).join(", ");
    const more = study.left_out.length > MOST_LEFT_OUT ? ` and ${study.left_out.length - MOST_LEFT_OUT} more` : "";
    place.append(element("p", { class: "dim" }, `Left out, as they are of other runs than those of the table: ${some}${more}.`));
  }
  const numbers = [...new Set([...Object.keys(study.kept), ...Object.keys(study.to_see)].map(Number))]
    .filter((number) => study.rowOf.has(number));
  if (!numbers.length) {
    place.append(element("p", { class: "dim" }, "None: no run failed or broke, and no full result of these runs is kept."));
    return;
  }
  const rank = (number) => [!isWorst(study, number), ["broken", "failed", "passed"].indexOf(statusOf(study, number)), number];
  const ranks = new Map(numbers.map((number) => [number, rank(number)]));
  numbers.sort((one, other) => ranks.get(one).reduce((found, own, k) => found || own - ranks.get(other)[k], 0));
  const rows = numbers.map((number) => {
    const row = study.rowOf.get(number);
    const button = element("button", { class: "outcome" }, `run ${number}`);
    button.addEventListener("click", () => choose(number));
    return element("tr", {}, [
      element("td", {}, button),
      element("td", { class: "why" }, whyToSee(study, number, row)),
      element("td", {}, played.has(number) ? playButton(number, play) : ""),
    ]);
  });
  place.append(table([["run"], ["why"], [played.size ? "playback" : ""]], rows));
  if (played.size > 1) place.append(element("p", { class: "dim" }, "Several runs that are played are drawn over each other and compared."));
}

function playButton(number, play) {
  const button = element("button", { "aria-pressed": "false", "data-run": number, "aria-label": `play run ${number}` }, "▶\uFE0E play");
  button.addEventListener("click", () => play(number));
  return button;
}

function statusOf(study, number) {
  return study.column("status").values[study.rowOf.get(number)];
}

function isWorst(study, number) {
  return study.worst?.run === number || study.measures.some((measure) => measure.worst_run === number);
}

function whyToSee(study, number, row) {
  const status = statusOf(study, number);
  const worst = study.measures.filter((measure) => measure.worst_run === number).map((measure) => `worst ${measure.measure}`);
  if (study.worst?.run === number) worst.unshift("least margin");
  const message = study.column("message")?.values[row];
  return [element("span", { class: { passed: "good", failed: "bad", broken: "known" }[status] }, `${STATUS[status]?.mark} ${status}`),
    ...(worst.length ? [`, ${worst.join(", ")}`] : []), ...(message ? [element("div", { class: "dim" }, message)] : [])];
}

/** Return all that there is of a run, and how to see it. */
function card(study, row, played, play, close) {
  const number = study.column("run").values[row];
  const entries = study.columns.filter(({ name, kind }) => name !== "run" && (name !== "draw" || study.column("draw").values[row] !== number) && (kind !== "run" || cell(study.column(name), row)));
  entries.sort((one, other) => (other.name === "message") - (one.name === "message"));
  const told = entries.map((column) => element("div", { class: column.name === "message" ? "wide" : "" }, [
    element("dt", {}, column.kind === "margin" ? column.about : column.name),
    element("dd", {}, `${cell(column, row)} ${column.isNumber ? column.unit : ""}`.trim() || "none")]));
  const ways = [];
  const buttons = played.has(number) ? [playButton(number, play)] : [];
  if (!buttons.length && study.kept[number]) ways.push(way("its playback, in a page of its own", `formation report ${quoted(study.kept[number])}`));
  else if (!buttons.length) {
    if (study.to_see[number]) ways.push(way("run it, with a page of its own", `formation run ${quoted(study.to_see[number])}`));
    ways.push(way("add its playback to this page", `${study.keep} ${number}`));
  }
  return [element("header", {}, [element("h2", {}, `Run ${number}`), ...buttons, close]), ...ways, element("dl", {}, told)];
}

function way(text, command) {
  return element("p", {}, [`${text}: `, element("code", {}, command)]);
}

/** Return a word as a shell takes it. */
function quoted(word) {
  return /^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\"'\"'")}'`;
}

function showStudyOrigin(place, study) {
  place.append(element("dl", {}, [element("dt", {}, "study"), element("dd", {}, study.file),
    ...(study.changes.length ? [element("dt", {}, "changes"), element("dd", {}, study.changes.join(", "))] : [])]));
  if (study.text) place.append(foldedXml("the study as it was made", study.text));
  if (study.rows < study.runs) {
    place.append(element("p", { class: "dim" }, `The page shows ${study.rows.toLocaleString("en")} of ${study.runs.toLocaleString("en")} runs: evenly spaced ones, those with the extremes of each figure, and those to look at. runs.csv has all.`));
  }
}
