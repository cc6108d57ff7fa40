/* The page: what stands in its data is unpacked and shown. */

async function start() {
  const data = JSON.parse(document.getElementById("data").textContent);
  Object.assign(SHOWN, data.units);
  for (const run of data.runs) prepare(run, await unpackedNumbers(run.numbers));
  window.formation = showRuns(data.runs, data.differences);
  document.documentElement.dataset.ready = "true";
}

start();
