/* The page: what stands in its data is unpacked and shown. */

async function start() {
  const data = JSON.parse(document.getElementById("data").textContent);
  Object.assign(SHOWN, data.units);
  for (const [place, run] of data.runs.entries()) {
    run.place = place;
    prepare(run, await unpackedNumbers(run.numbers));
  }
  if (data.study) {
    await prepareStudy(data.study);
    showStudy(data.study, data.runs);
  } else window.formation = showRuns(data.runs);
  document.documentElement.dataset.ready = "true";
}

start().catch((error) => {
  const told = `This page cannot show its data: ${error.message}. It needs a browser of 2023 or newer, and the file as it was written.`;
  document.querySelector("header").append(element("p", { class: "bad", role: "alert" }, told));
  document.documentElement.dataset.ready = "failed";
});
