/* A page of a run that goes on: it grows as the server of the page tells, and asks it to pause. */

const AGAIN = [1000, 3000, 10000]; // ms until a lost server is looked for again

/** Let the columns of a run take rows of numbers as they come. */
class Growing {
  constructor({ run, every, rows, columns }) {
    this.run = run;
    this.every = every;
    this.room = rows;
    this.columns = columns;
    this.numbers = new Float64Array(rows * columns);
    this.references = [
      ...run.motion.poses.flat(), ...run.motion.errors.flat(), ...run.signals.list.flatMap((signal) => signal.columns.flat()),
    ];
    for (const reference of this.references) reference[0] *= rows;
    run.motion.every = every;
    run.signals.spaced = true;
    this._count(0, 0);
  }

  /** Take a message: first row, rows, whether there is one beside the spacing, ticks so far, and numbers row after row. */
  take(message) {
    const [first, rows, beside, ticks] = new Uint32Array(message, 0, 4);
    const numbers = new Float64Array(message, 16);
    for (let row = 0; row < rows + beside; row++) {
      for (let k = 0; k < this.columns; k++) this.numbers[k * this.room + first + row] = numbers[row * this.columns + k];
    }
    this._count(first + rows + beside, ticks);
  }

  _count(rows, ticks) {
    for (const reference of this.references) reference[1] = rows;
    const { run } = this;
    run.samples = ticks;
    run.motion.samples = rows;
    run.end = Math.max(0, (ticks - 1) * run.step);
    prepare(run, this.numbers);
  }
}

async function watch() {
  const data = JSON.parse(document.getElementById("data").textContent);
  Object.assign(SHOWN, data.units);
  let [view, growing, socket, ended, lost, due] = [null, null, null, false, 0, false];

  // What stands above the run

  const button = (text, title, command) => {
    const made = element("button", { title, hidden: "" }, text);
    made.addEventListener("click", () => socket.send(command()));
    return made;
  };
  let paused = false;
  const status = element("strong", { role: "status" }, "waiting for the run");
  const reached = element("span", { id: "reached" });
  const pause = button("pause", "hold the run after the tick that it is at, for all viewers", () => (paused ? "go on" : "pause"));
  const step = button("step", "let the run do one tick", () => "step");
  const follow = element("button", { title: "show the last tick, and follow the run", hidden: "" }, "follow");
  follow.addEventListener("click", () => view.follow());
  const about = element("span", { class: "dim" });
  const bar = element("div", { id: "live" }, [status, reached, pause, step, follow, about]);
  document.querySelector("header").append(bar);

  function tell() {
    const goesOn = view !== null && !ended && lost === 0;
    pause.hidden = follow.hidden = !goesOn;
    step.hidden = !goesOn || !paused;
    pause.textContent = paused ? "go on" : "pause";
    const gone = "the server has gone; what has come so far stays here";
    const word = lost > 0 ? (ended ? "ended" : gone) : ended ? "ended" : !growing ? "waiting for the run" : paused ? "paused" : "live";
    if (status.textContent !== word) status.textContent = word;
    status.className = lost > 0 && !ended ? "bad" : ended ? "" : "good";
    bar.dataset.state = lost > 0 ? "gone" : ended ? "ended" : !growing ? "waiting" : paused ? "paused" : "live";
    reached.textContent = growing && !ended ? `${growing.run.end.toFixed(2)} of ${growing.run.horizon} s` : "";
  }

  // The run

  function show(run) {
    const before = view && {
      time: view.state.time, following: view.isFollowing(), hidden: view.state.hidden, chosen: view.state.chosen,
      keys: [...view.panels.open.keys()], place: view.playback.view, follow: view.playback.follow, speed: view.state.speed,
    };
    view?.close();
    document.title = document.getElementById("title").textContent = run.title || run.name;
    view = window.formation = showRuns([run]);
    if (before) view.restore(before);
    else if (address.get("t") === null) view.follow();
    document.documentElement.dataset.ready = "true";
  }

  function grow() {
    if (due) return;
    due = true;
    requestAnimationFrame(() => {
      due = false;
      if (!ended) view.grow();
    });
  }

  const kinds = {
    async begin(message) {
      growing = new Growing(message);
      about.textContent = message.every > 1
        ? `Of a run so long, every ${message.every} ticks one is shown as long as it goes on, and the last one.` : "";
    },
    async end({ run, why }) {
      ended = true;
      about.textContent = "";
      if (!run) {
        about.textContent = `The run has ended before its first tick. ${why}`;
        return;
      }
      prepare(run, await unpackedNumbers(run.numbers));
      show(run);
    },
    async state(message) {
      paused = message.paused;
      bar.title = message.viewers === 1 ? "nobody else watches" : `${message.viewers} viewers`;
    },
    async next() {
      location.reload();
    },
  };

  async function heed(message) {
    if (typeof message === "string") {
      const told = JSON.parse(message);
      await kinds[told.kind](told);
      tell();
    } else {
      growing.take(message);
      if (view?.runs[0] === growing.run) grow();
      else show(growing.run);
      tell();
    }
  }

  function connect() {
    socket = new WebSocket(`ws://${location.host}${location.pathname}feed`);
    socket.binaryType = "arraybuffer";
    let before = Promise.resolve();
    socket.addEventListener("open", () => { lost = 0; ended = false; });
    socket.addEventListener("message", (event) => { before = before.then(() => heed(event.data)); });
    socket.addEventListener("close", () => before.then(() => {
      if (lost < AGAIN.length && !ended) setTimeout(connect, AGAIN[lost]);
      lost += 1;
      tell();
    }));
  }

  tell();
  connect();
}

watch();
