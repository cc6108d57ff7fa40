/* The table of a study's runs, a page of rows at a time: sorted by a column, and filtered by words and by how runs ended. */

const ROWS_AT_A_TIME = 25;
const LIMIT = /^(.+?)\s*(<=|>=|<|>|=)\s*([-+]?[0-9.]+(?:e[-+]?[0-9]+)?)$/i;
const HOLDS = {
  "<": (a, b) => a < b, ">": (a, b) => a > b, "<=": (a, b) => a <= b, ">=": (a, b) => a >= b, "=": (a, b) => a <= b && a >= b,
}; // also of a whole number without rounding and a rounded one
const WHOLE = /^[-+]?[0-9]+$/;

class Rows {
  /**
   * @param place where the table stands
   * @param study the table by columns
   * @param choose called with the row that a reader chooses
   */
  constructor(place, study, choose) {
    Object.assign(this, { place, study, choose, first: 0, sorted: null, descending: false, chosen: null });
    this.statuses = new Set(Object.keys(STATUS));
    this.words = "";
    this.columns = study.columns.filter(({ name, values }) => {
      if (name === "draw") return values.some((draw, row) => draw !== study.column("run").values[row]);
      return name !== "message" || values.some(Boolean);
    });
    this._controls();
    this._find();
  }

  _controls() {
    const search = element("input", { type: "search", placeholder: "text, or a limit: mass > 30", "aria-label": "Filter runs", size: 28 });
    search.addEventListener("input", () => { this.words = search.value; this._find(); });
    const statuses = Object.entries(STATUS).map(([name, { mark }]) => {
      const button = element("button", { "aria-pressed": "true", class: "status" }, `${mark} ${this.study.counts[name]} ${name}`);
      button.addEventListener("click", () => {
        if (!this.statuses.delete(name)) this.statuses.add(name);
        button.setAttribute("aria-pressed", String(this.statuses.has(name)));
        this._find();
      });
      return button;
    });
    const turn = (text, label, by) => {
      const button = element("button", { "aria-label": label, title: label }, text);
      button.addEventListener("click", () => this._show(this.first + by * ROWS_AT_A_TIME));
      return button;
    };
    this.back = turn("‹", "Rows before", -1);
    this.ahead = turn("›", "Rows after", 1);
    this.told = element("span", { role: "status" });
    this.head = element("tr");
    this.body = element("tbody");
    this.headings = this.columns.map((column) => this._heading(column));
    this.head.append(...this.headings);
    const shown = element("table", { class: "runs" }, [element("thead", {}, this.head), this.body]);
    this.place.append(
      element("div", { class: "tools" }, [search, element("span", { role: "group", "aria-label": "How runs ended" }, statuses)]),
      element("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Table of runs" }, shown),
      element("div", { class: "tools" }, [this.back, this.told, this.ahead]),
      ...this.columns.filter(({ kind }) => kind === "margin").map(({ name, about }) => element("div", { class: "dim" }, `${name}: ${about}`)),
    );
  }

  _heading(column) {
    const button = element("button", { title: column.about || `sort by ${column.name}` }, labelOf(column));
    button.addEventListener("click", () => {
      this.descending = this.sorted === column ? !this.descending : column.kind === "measure";
      this.sorted = column;
      this._sort();
      this._show(0);
    });
    return element("th", { scope: "col", class: column.isNumber ? "number" : "" }, button);
  }

  /** Find the rows that have all words, keep all limits, and ended as they should. */
  _find() {
    const terms = this.words.split(",").map((term) => term.trim().toLowerCase()).filter(Boolean).map((term) => this._term(term));
    const status = this.study.column("status").values;
    this.rows = [];
    for (let row = 0; row < status.length; row++) {
      if (this.statuses.has(status[row]) && terms.every((holds) => holds(row))) this.rows.push(row);
    }
    this._sort();
    this._show(0);
    this.filtered?.();
  }

  _term(term) {
    const found = LIMIT.exec(term);
    const column = found && this.study.columns.find(({ name, isNumber }) => isNumber && name.toLowerCase() === found[1].trim());
    if (column) {
      const limit = column.exact && WHOLE.test(found[3]) ? BigInt(found[3]) : Number(found[3]);
      return (row) => HOLDS[found[2]]((column.exact || column.values)[row], limit);
    }
    return (row) => this._text(row).includes(term);
  }

  /** Return all that a row says, in small letters. */
  _text(row) {
    this.texts ??= [];
    return (this.texts[row] ??= this.columns.map((column) => cell(column, row)).join(" ").toLowerCase());
  }

  _sort() {
    this.head.querySelectorAll("th").forEach((one) => one.removeAttribute("aria-sort"));
    if (!this.sorted) return;
    const { isNumber, exact } = this.sorted;
    const values = exact || this.sorted.values;
    const sign = this.descending ? -1 : 1;
    const compare = isNumber ? (a, b) => (a < b ? -1 : 1) : (a, b) => a.localeCompare(b);
    const missing = (value) => (isNumber ? Number.isNaN(value) : value === "");
    this.rows.sort((one, other) => {
      const [a, b] = [values[one], values[other]];
      if (missing(a) || missing(b)) return missing(a) - missing(b) || one - other;
      return sign * (a === b ? 0 : compare(a, b)) || one - other;
    });
    this.headings[this.columns.indexOf(this.sorted)].setAttribute("aria-sort", this.descending ? "descending" : "ascending");
  }

  _show(first) {
    this.first = Math.max(0, first < this.rows.length ? first : this.first);
    const last = Math.min(this.rows.length, this.first + ROWS_AT_A_TIME);
    this.body.replaceChildren(...this.rows.slice(this.first, last).map((row) => this._row(row)));
    this.back.disabled = this.first === 0;
    this.ahead.disabled = last >= this.rows.length;
    this.told.textContent = this.rows.length ? `runs ${this.first + 1} to ${last} of ${this.rows.length.toLocaleString("en")}` : "no such run";
  }

  _row(row) {
    const made = element("tr", row === this.chosen ? { "aria-selected": "true" } : {}, this.columns.map((column) => {
      const text = cell(column, row);
      if (column.name === "run") {
        const button = element("button", { class: "outcome", "aria-label": `show run ${text}` }, text);
        return element("th", { scope: "row", class: "number" }, button);
      }
      if (column.name === "status") {
        const look = { passed: "good", failed: "bad", broken: "known" }[text] || "";
        return element("td", { class: look }, `${STATUS[text]?.mark ?? ""} ${text}`);
      }
      return element("td", { class: column.isNumber ? "number" : column.name === "message" ? "message" : "", title: column.name === "message" ? text : "" }, text);
    }));
    made.addEventListener("click", () => this.choose(row));
    return made;
  }

  /** Mark a run, and show it if the table has it. */
  mark(row) {
    this.chosen = row;
    const at = this.rows.indexOf(row);
    if (at >= 0) this.first = at - (at % ROWS_AT_A_TIME);
    this._show(this.first);
  }
}

/** Return what a cell shows. */
function cell(column, row) {
  const value = column.values[row];
  if (column.exact) return String(column.exact[row]);
  if (!column.isNumber) return value;
  if (Number.isNaN(value)) return "";
  return Number.isFinite(value) ? (Number.isInteger(value) ? String(value) : figure(value, column.range)) : value > 0 ? "∞" : "-∞";
}
