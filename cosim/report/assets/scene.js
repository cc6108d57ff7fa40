/* Where the robots of a run are: poses between samples, outlines in the plane, and how near bodies are. */

const COLOURS = ["#4477AA", "#EE6677", "#228833", "#B8860B", "#2AA7C9", "#AA3377", "#E07B39", "#7A68C4"];

/** Return the colour of a follower, by its place among the followers; the colour-blind can tell the first eight. */
function colourOf(place) {
  return place < COLOURS.length ? COLOURS[place] : `hsl(${(place * 137.5) % 360} 55% 52%)`;
}

/** Return the number of a column between its samples; angles take the shorter way. */
function between(values, i, part, turns) {
  const from = values[i];
  if (part === 0 || i + 1 >= values.length) return from;
  let step = values[i + 1] - from;
  if (turns && Math.abs(step) > Math.PI) step -= 2 * Math.PI * Math.round(step / (2 * Math.PI));
  return from + part * step;
}

/** Return the place of a time among the samples of the motion: the sample before, and the part of the way. */
function placeOf(run, time) {
  const times = run.motionTimes;
  const i = indexAt(times, time);
  if (i + 1 >= times.length) return [i, 0];
  return [i, Math.max(0, Math.min(1, (time - times[i]) / (times[i + 1] - times[i])))];
}

/** Return the pose of a vehicle by the names of its entries, or null where it is no number. */
function poseAt(run, vehicle, time) {
  const [i, part] = placeOf(run, time);
  const pose = {};
  run.vehicles[vehicle].pose.forEach((name, k) => {
    if (name) pose[name] = between(run.poses[vehicle][k], i, part, k > 1);
  });
  return Number.isFinite(pose.x) && Number.isFinite(pose.y) ? pose : null;
}

/** Return the heading of a vehicle: the third entry of its pose. */
function headingOf(run, vehicle, pose) {
  return pose[run.vehicles[vehicle].pose[2]];
}

/** Return the point that range and bearing are measured from, (7) and (54). */
function sightPoint(run, vehicle, pose) {
  const heading = headingOf(run, vehicle, pose);
  const ahead = run.vehicles[vehicle].ahead;
  return [pose.x + ahead * Math.cos(heading), pose.y + ahead * Math.sin(heading)];
}

/** Return where a follower's point should be: at the desired range and bearing from the leader; null if unknown. */
function desiredPoint(run, vehicle, pose, leader, time) {
  const errors = run.errors[vehicle - 1];
  if (errors.length < 3) return null;
  const [i, part] = placeOf(run, time);
  const [rangeError, bearingError, range] = errors.map((values, k) => between(values, i, part, k === 1));
  const [x, y] = sightPoint(run, vehicle, pose);
  const direction = Math.atan2(leader.y - y, leader.x - x) - bearingError;
  const desired = range - rangeError;
  return [leader.x - desired * Math.cos(direction), leader.y - desired * Math.sin(direction)];
}

/** Return the parts of a vehicle as polygons in the plane. */
function outlineAt(run, vehicle, pose) {
  const frames = { "": [pose.x, pose.y, 0] };
  return run.vehicles[vehicle].parts.map((part) => {
    const [x, y, turn] = frames[part.on];
    const [ahead, left] = part.on ? part.at : [0, 0];
    const origin = [
      x + ahead * Math.cos(turn) - left * Math.sin(turn),
      y + ahead * Math.sin(turn) + left * Math.cos(turn),
    ];
    const heading = part.turned_by.reduce((sum, entry) => sum + pose[entry], 0);
    frames[part.name] = [...origin, heading];
    const c = Math.cos(heading);
    const s = Math.sin(heading);
    const corners = part.corners.map(([u, v]) => [origin[0] + c * u - s * v, origin[1] + s * u + c * v]);
    return { corners, collides: part.collides };
  });
}

/** Return the distance of two convex polygons; 0 if they overlap. */
function polygonDistance(one, other) {
  if (!separated(one, other) && !separated(other, one)) return 0;
  return Math.min(cornerDistance(one, other), cornerDistance(other, one));
}

function separated(one, other) {
  return one.some(([x, y], i) => {
    const [u, v] = one[(i + 1) % one.length];
    const [nx, ny] = [v - y, x - u];
    return (nx || ny) && other.every(([p, q]) => nx * (p - x) + ny * (q - y) > 0);
  });
}

function cornerDistance(corners, polygon) {
  let least = Infinity;
  for (const [p, q] of corners) {
    polygon.forEach(([x, y], i) => {
      const [u, v] = polygon[(i + 1) % polygon.length];
      const length = (u - x) ** 2 + (v - y) ** 2;
      const along = length ? Math.max(0, Math.min(1, ((p - x) * (u - x) + (q - y) * (v - y)) / length)) : 0;
      least = Math.min(least, Math.hypot(p - x - along * (u - x), q - y - along * (v - y)));
    });
  }
  return least;
}

const NEAR = 0.3;
const MOST_WATCHED = 40;

/** Return the pairs of followers whose bodies are nearer than 0.3 m: [one, other, distance]; of unknown ones, nothing. */
function nearPairs(outlines) {
  const found = [];
  const bodies = outlines.map(({ vehicle, parts }) => {
    const known = parts.filter((part) => part.collides && part.corners.flat().every(Number.isFinite));
    const polygons = known.map((part) => part.corners);
    const corners = polygons.flat();
    const [x, y] = corners.length ? corners[0] : [0, 0];
    return { vehicle, polygons, x, y, radius: Math.max(0, ...corners.map(([p, q]) => Math.hypot(p - x, q - y))) };
  });
  if (bodies.length > MOST_WATCHED) return found;
  bodies.forEach((one, i) => {
    for (const other of bodies.slice(i + 1)) {
      if (Math.hypot(one.x - other.x, one.y - other.y) > one.radius + other.radius + NEAR) continue;
      let distance = Infinity;
      for (const a of one.polygons) for (const b of other.polygons) distance = Math.min(distance, polygonDistance(a, b));
      if (distance < NEAR) found.push([one.vehicle, other.vehicle, distance]);
    }
  });
  return found;
}
