"use strict";
// Replays recorded runs. Every number shown is the recording's; poses alone are interpolated between iterations.
const UNKNOWN = 0, FREE = 1, OCCUPIED = 2;
const TYPES = { u1: Uint8Array, u2: Uint16Array, u4: Uint32Array, i2: Int16Array, i4: Int32Array, f4: Float32Array };
const css = (c, alpha) => alpha === undefined ? `rgb(${c})` : `rgba(${c}, ${alpha})`;
const mixed = (a, b, share) => a.map((v, i) => Math.round(v + share * (b[i] - v)));
const ink = c => 0.299 * c[0] + 0.587 * c[1] + 0.114 * c[2] > 120 ? "#000" : "#fff";

class Run {
  static async open(words, numbers) {
    const packed = Uint8Array.from(atob(numbers), c => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Run(words, await new Response(stream).arrayBuffer());
  }
  constructor(words, buffer) {
    Object.assign(this, words);
    this.data = {};
    let at = 0;
    for (const [name, type, shape] of words.arrays) {
      const length = shape.reduce((a, b) => a * b, 1) * TYPES[type].BYTES_PER_ELEMENT;
      this.data[name] = new TYPES[type](buffer.slice(at, at + length));
      at += length;
    }
    const pose = this.data.pose, row = 3 * this.robots;
    for (let k = row; k < pose.length; k++) pose[k] += pose[k - row];
    [this.x0, this.y0, this.cell, this.rows, this.columns] = this.lattice;
    this.cells = this.rows * this.columns;
    this.hasMaps = "changes_end" in this.data;
    this.reset();
    if (this.hasMaps) this.keepWhatWas();
    this.indexPaths();
  }
  reset() {
    this.row = -1;  // the last iteration that the maps hold
    this.maps = new Uint8Array(this.hasMaps ? this.robots * this.cells : 0);
    this.known = new Uint16Array(this.cells);
    this.occupied = new Uint16Array(this.cells);
  }
  keepWhatWas() {  // so that maps can be moved back as well
    const { changed_robot: robot, changed_cell: cell, changed_state: state } = this.data;
    this.before = new Uint8Array(state.length);
    for (let k = 0; k < state.length; k++) {
      const place = robot[k] * this.cells + cell[k];
      this.before[k] = this.maps[place];
      this.maps[place] = state[k];
    }
    this.reset();
  }
  set(k, state) {
    const place = this.data.changed_robot[k] * this.cells + this.data.changed_cell[k], cell = this.data.changed_cell[k];
    const was = this.maps[place];
    this.known[cell] += (state !== UNKNOWN) - (was !== UNKNOWN);
    this.occupied[cell] += (state === OCCUPIED) - (was === OCCUPIED);
    this.maps[place] = state;
  }
  seek(row) {
    if (!this.hasMaps) { this.row = row; return; }
    const end = this.data.changes_end, begin = t => t > 0 ? end[t - 1] : 0;
    for (; this.row < row; this.row++) for (let k = begin(this.row + 1); k < end[this.row + 1]; k++) this.set(k, this.data.changed_state[k]);
    for (; this.row > row; this.row--) for (let k = end[this.row] - 1; k >= begin(this.row); k--) this.set(k, this.before[k]);
  }
  mapOf(robot) { return this.maps.subarray(robot * this.cells, (robot + 1) * this.cells); }
  rowAt(time) { return Math.min(Math.floor(time), this.iterations - 1); }
  poseAt(time, robot) {
    const row = this.rowAt(time), next = this.rowAt(row + 1), part = Math.min(time - row, 1), pose = this.data.pose;
    const a = 3 * (row * this.robots + robot), b = 3 * (next * this.robots + robot);
    let turn = (pose[b + 2] - pose[a + 2]) / 1000;
    turn -= 2 * Math.PI * Math.round(turn / (2 * Math.PI));
    return [(pose[a] + part * (pose[b] - pose[a])) / 1000, (pose[a + 1] + part * (pose[b + 1] - pose[a + 1])) / 1000,
      pose[a + 2] / 1000 + part * turn];
  }
  alive(row, robot) { return this.data.alive[row * this.robots + robot] === 1; }
  mark(row, robot) { return this.marks[this.data.marks[row * this.robots + robot]]; }
  letters(row) {
    const end = this.data.letters_end, all = this.data.letters, found = [];
    for (let k = row ? end[row - 1] : 0; k < end[row]; k++) found.push([all[3 * k], all[3 * k + 1], all[3 * k + 2]]);
    return found;
  }
  value(row) { return this.curve.scale * this.data.curve[row]; }
  own(row, robot) { return this.data.each ? this.curve.scale * this.data.each[row * this.robots + robot] : null; }
  worded(value) { return `${value.toFixed(this.curve.digits)} ${this.curve.unit}`.trim(); }
  indexPaths() {
    this.newest = Array.from({ length: this.robots }, () => []);
    const rows = this.data.paths;
    for (let k = 0; 3 * k < rows.length; k++) this.newest[rows[3 * k + 1]].push([rows[3 * k], k ? rows[3 * k - 1] : 0, rows[3 * k + 2]]);
  }
  goal(row, robot) {
    const at = 2 * (row * this.robots + robot), [r, c] = [this.data.goals[at], this.data.goals[at + 1]];
    return r < 0 || !this.alive(row, robot) ? null : [this.x0 + (c + 0.5) * this.cell, this.y0 + (r + 0.5) * this.cell];
  }
  way(row, robot, from) {
    const paths = this.newest[robot];
    let low = 0, high = paths.length;
    while (low < high) { const mid = (low + high) >> 1; paths[mid][0] <= row ? low = mid + 1 : high = mid; }
    if (!low || !this.goal(row, robot)) return [];
    const [, begin, end] = paths[low - 1], points = [];
    let nearest = begin, least = Infinity;
    for (let k = begin; k < end; k++) {
      const d = Math.hypot(this.data.waypoints[2 * k] - from[0], this.data.waypoints[2 * k + 1] - from[1]);
      if (d < least) { least = d; nearest = k; }
    }
    for (let k = nearest; k < end; k++) points.push([this.data.waypoints[2 * k], this.data.waypoints[2 * k + 1]]);
    return [from, ...points];
  }
}

class View {
  constructor(run, place) {
    this.run = run;
    this.canvas = place.querySelector("canvas");
    this.tip = place.querySelector(".tip");
    this.sheet = document.createElement("canvas");
    [this.sheet.width, this.sheet.height] = [run.columns, run.rows];
    this.picture = this.sheet.getContext("2d").createImageData(run.columns, run.rows);
    this.paths = Object.fromEntries(Object.entries(run.layers).map(([name, parts]) => [name, outline(parts.flat())]));
    this.floor = outline(run.floor);
    this.canvas.addEventListener("pointermove", event => this.hover(event));
    this.canvas.addEventListener("pointerleave", () => this.tip.textContent = "");
    this.canvas.addEventListener("click", event => { const robot = this.under(event); if (robot !== null || state.robot >= 0) pick(robot ?? -1); });
  }
  fit() {
    const [left, right, low, high] = this.run.bounds, width = this.canvas.clientWidth, ratio = devicePixelRatio || 1;
    const height = Math.round(Math.min(width * (high - low) / (right - left), 0.72 * innerHeight));
    this.canvas.style.height = `${height}px`;
    [this.canvas.width, this.canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    this.scale = Math.min(this.canvas.width / (right - left), this.canvas.height / (high - low));
    this.left = this.canvas.width / 2 - this.scale * (left + right) / 2;
    this.low = this.canvas.height / 2 + this.scale * (low + high) / 2;
    this.ratio = ratio;
  }
  at(x, y) { return [this.left + this.scale * x, this.low - this.scale * y]; }
  metres(event) {
    const box = this.canvas.getBoundingClientRect();
    return [((event.clientX - box.left) * this.ratio - this.left) / this.scale, (this.low - (event.clientY - box.top) * this.ratio) / this.scale];
  }
  under(event) {
    const [x, y] = this.metres(event);
    let found = null, least = Math.max(14 * this.ratio / this.scale, 0.1);
    for (let robot = 0; robot < this.run.robots; robot++) {
      const [px, py] = this.run.poseAt(state.time, robot), d = Math.hypot(px - x, py - y);
      if (d < least) { least = d; found = robot; }
    }
    return found;
  }
  hover(event) {
    const run = this.run, [x, y] = this.metres(event), robot = this.under(event), row = run.rowAt(state.time);
    const c = Math.floor((x - run.x0) / run.cell), r = Math.floor((y - run.y0) / run.cell), lines = [`x ${x.toFixed(2)} m, y ${y.toFixed(2)} m`];
    if (run.hasMaps && r >= 0 && r < run.rows && c >= 0 && c < run.columns) {
      const cell = r * run.columns + c, known = run.known[cell];
      lines.push(known ? `known to ${known} of ${run.robots}${run.occupied[cell] ? `, occupied to ${run.occupied[cell]}` : ""}` : "known to nobody");
    }
    if (robot !== null) lines.push(`robot ${robot}: ${stateOf(run, row, robot)}`, ...(run.own(row, robot) === null ? [] : [`${run.curve.name} ${run.worded(run.own(row, robot))}`]));
    this.tip.textContent = lines.join("\n");
    const box = this.canvas.getBoundingClientRect(), px = event.clientX - box.left;
    this.tip.style.left = px > box.width / 2 ? "" : `${px + 14}px`;
    this.tip.style.right = px > box.width / 2 ? `${box.width - px + 14}px` : "";
    this.tip.style.top = `${event.clientY - box.top + this.canvas.offsetTop + 14}px`;
  }
  draw() {
    const run = this.run, c = this.canvas.getContext("2d"), theme = run.themes[state.theme], row = run.rowAt(state.time), thin = this.ratio;
    this.row = row;
    run.seek(row);
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.fillStyle = css(theme.background);
    c.fillRect(0, 0, this.canvas.width, this.canvas.height);
    c.setTransform(this.scale, 0, 0, -this.scale, this.left, this.low);
    c.fillStyle = css(run.hasMaps ? theme.unexplored : theme.floor);
    c.fill(this.floor, "evenodd");
    for (const [name, colour] of Object.entries(theme.solids)) { c.fillStyle = css(colour); c.fill(this.paths[name], "evenodd"); }
    if (run.hasMaps && state.show.map) this.map(c, theme);
    c.strokeStyle = css(theme.edge);
    c.lineWidth = 1.5 * thin / this.scale;
    for (const name of Object.keys(theme.solids)) c.stroke(this.paths[name]);
    c.setTransform(1, 0, 0, 1, 0, 0);
    for (const [[left, low, right, high], from, to] of run.boxes) {
      if (row < from || row >= to) continue;
      const [x, y] = this.at(left, high);
      c.fillStyle = css(theme.solids.walls); c.strokeStyle = css(theme.mark); c.lineWidth = 1.5 * thin;
      c.fillRect(x, y, Math.max(this.scale * (right - left), 3), Math.max(this.scale * (high - low), 3));
      c.strokeRect(x, y, Math.max(this.scale * (right - left), 3), Math.max(this.scale * (high - low), 3));
    }
    this.actors(c, theme, row, thin);
  }
  map(c, theme) {
    const run = this.run, pixels = this.picture.data, own = state.robot >= 0 && state.robot < run.robots ? run.mapOf(state.robot) : null;
    const shades = Array.from({ length: run.robots + 1 }, (_, k) => mixed(theme.few, theme.all, Math.max(k - 1, 0) / Math.max(run.robots - 1, 1)));
    const others = mixed(theme.unexplored, theme.few, 0.5);
    for (let r = 0; r < run.rows; r++) for (let col = 0; col < run.columns; col++) {
      const cell = r * run.columns + col, at = 4 * ((run.rows - 1 - r) * run.columns + col);
      let colour = null;
      if (own && own[cell]) colour = own[cell] === OCCUPIED ? theme.seen : theme.all;
      else if (own) colour = run.known[cell] ? others : null;
      else if (run.known[cell]) colour = run.occupied[cell] ? theme.seen : shades[run.known[cell]];
      if (colour) { pixels[at] = colour[0]; pixels[at + 1] = colour[1]; pixels[at + 2] = colour[2]; }
      pixels[at + 3] = colour ? 255 : 0;
    }
    this.sheet.getContext("2d").putImageData(this.picture, 0, 0);
    c.imageSmoothingEnabled = false;
    c.save();
    c.transform(1, 0, 0, -1, run.x0, run.y0 + run.rows * run.cell);
    c.drawImage(this.sheet, 0, 0, run.columns * run.cell, run.rows * run.cell);
    c.restore();
  }
  actors(c, theme, row, thin) {
    const run = this.run, chosen = state.robot >= 0 && state.robot < run.robots ? [state.robot] : null, show = state.show;
    const poses = Array.from({ length: run.robots }, (_, robot) => run.poseAt(state.time, robot));
    const spots = poses.map(([x, y]) => this.at(x, y)), colour = robot => run.colours[robot % run.colours.length];
    const live = poses.map((_, robot) => robot).filter(robot => run.alive(row, robot)), looked = chosen ? chosen.filter(robot => run.alive(row, robot)) : live;
    const radii = this.radii(spots, live, row);
    if (show.tiles && run.tile[0] && run.data.origins) for (const robot of looked) {
      const at = 2 * (row * run.robots + robot), r = run.data.origins[at], col = run.data.origins[at + 1];
      const [x, y] = this.at(run.x0 + col * run.cell, run.y0 + (r + run.tile[0]) * run.cell), size = this.scale * run.cell;
      c.fillStyle = css(colour(robot), 0.15); c.strokeStyle = css(colour(robot), 0.7); c.lineWidth = thin;
      c.fillRect(x, y, run.tile[1] * size, run.tile[0] * size); c.strokeRect(x, y, run.tile[1] * size, run.tile[0] * size);
    }
    if (show.beams && run.data.beams) for (const robot of looked) {
      const count = run.bearings[robot].length, at = count * (row * run.robots + robot);
      c.strokeStyle = css(theme.mark, 0.7); c.lineWidth = 0.7 * thin; c.beginPath();
      run.bearings[robot].forEach((bearing, k) => {
        const length = this.scale * run.reaches[robot] * run.data.beams[at + k] / 255, angle = poses[robot][2] + bearing;
        c.moveTo(...spots[robot]); c.lineTo(spots[robot][0] + length * Math.cos(angle), spots[robot][1] - length * Math.sin(angle));
      });
      c.stroke();
    }
    if (show.ways && run.data.goals) for (const robot of looked) {
      const way = run.way(row, robot, poses[robot].slice(0, 2)).map(([x, y]) => this.at(x, y));
      line(c, way, css(theme.edge), 3.5 * thin); line(c, way, css(colour(robot)), 1.5 * thin);
      const goal = run.goal(row, robot);
      if (goal) diamond(c, this.at(...goal), 0.6 * radii[robot], css(colour(robot)), css(theme.edge), thin);
    }
    if (show.links) for (const [receiver, sender, fate] of run.letters(row)) {
      if (chosen && receiver !== chosen[0] && sender !== chosen[0]) continue;
      arrow(c, spots[sender], spots[receiver], radii[receiver], css(fate ? theme.lost : theme.link), css(ink(fate ? theme.lost : theme.link) === "#000" ? theme.edge : theme.background), thin, fate ? [7 * thin, 6 * thin] : []);
    }
    if (run.data.people) for (let k = 0, count = run.data.people.length / run.iterations; k < count; k += 3) {
      const [x, y, radius] = run.data.people.subarray(row * count + k, row * count + k + 3);
      disc(c, this.at(x, y), this.scale * radius, css(theme.person), css(theme.edge), thin);
    }
    for (let robot = 0; robot < run.robots; robot++) {
      const mark = run.mark(row, robot), spot = spots[robot], radius = radii[robot];
      if (!run.alive(row, robot)) {
        if (mark === "late" || !show.faults) continue;
        if (mark === "removed") { ring(c, spot, radius, css(theme.edge), 4 * thin); ring(c, spot, radius, css(theme.dead), 2 * thin); continue; }
        disc(c, spot, radius, css(theme.dead), css(theme.edge), thin);
        for (const way of [1, -1]) line(c, [[spot[0] - 0.6 * radius, spot[1] - way * 0.6 * radius], [spot[0] + 0.6 * radius, spot[1] + way * 0.6 * radius]], css(theme.edge), 2 * thin);
        continue;
      }
      if (run.data.believed) {
        const at = 3 * (row * run.robots + robot), there = this.at(run.data.believed[at], run.data.believed[at + 1]);
        line(c, [spot, there], css(colour(robot)), thin); ring(c, there, 0.75 * radius, css(colour(robot)), 1.5 * thin);
      }
      if (show.faults && (mark === "fault" || mark === "joined")) ring(c, spot, 1.8 * radius, css(mark === "fault" ? theme.mark : theme.joined), 2.5 * thin);
      if (robot === state.robot) ring(c, spot, 2.5 * radius, css(theme.text), 2 * thin);
      const yaw = run.data.heading && isFinite(run.data.heading[row * run.robots + robot]) ? run.data.heading[row * run.robots + robot] : null;
      if (yaw !== null) line(c, [spot, [spot[0] + 4 * radius * Math.cos(yaw), spot[1] - 4 * radius * Math.sin(yaw)]], css(theme.curve), 2 * thin);
      const lit = run.data.lights ? run.data.lights.subarray(3 * (row * run.robots + robot), 3 * (row * run.robots + robot) + 3) : [];
      if (lit.some(part => part)) disc(c, spot, 1.6 * radius, css(lit), css(theme.edge), thin);
      nose(c, spot, radius, poses[robot][2], css(colour(robot)), css(theme.edge), thin);
      disc(c, spot, radius, css(colour(robot)), css(theme.edge), thin);
      if (radius < 6 * thin) continue;
      c.fillStyle = ink(colour(robot)); c.font = `600 ${Math.min(1.25 * radius, 2.2 * radius / String(run.robots - 1).length)}px system-ui, sans-serif`;
      c.textAlign = "center"; c.textBaseline = "middle"; c.fillText(robot, spot[0], spot[1] + 0.05 * radius);
    }
  }
  radii(spots, live, row) {  // as large as can be read, but smaller where discs would overlap
    const there = spots.map((_, robot) => robot).filter(robot => this.run.alive(row, robot) || this.run.mark(row, robot) === "");
    return spots.map((spot, robot) => {
      const real = this.scale * this.run.radii[robot];
      let radius = Math.max(real, 9 * this.ratio);
      for (const other of there) if (other !== robot) radius = Math.min(radius, Math.hypot(spot[0] - spots[other][0], spot[1] - spots[other][1]) / 2);
      return Math.max(radius, real, 3 * this.ratio);
    });
  }
}

function outline(rings) {
  const path = new Path2D();
  for (const ring of rings) {
    for (let k = 0; k < ring.length; k += 2) k ? path.lineTo(ring[k], ring[k + 1]) : path.moveTo(ring[0], ring[1]);
    path.closePath();
  }
  return path;
}
function line(c, points, colour, width) {
  if (points.length < 2) return;
  c.strokeStyle = colour; c.lineWidth = width; c.lineJoin = "round"; c.beginPath();
  points.forEach((point, k) => k ? c.lineTo(...point) : c.moveTo(...point)); c.stroke();
}
function disc(c, [x, y], radius, fill, edge, width) { c.beginPath(); c.arc(x, y, radius, 0, 7); c.fillStyle = fill; c.fill(); c.strokeStyle = edge; c.lineWidth = width; c.stroke(); }
function ring(c, [x, y], radius, colour, width) { c.beginPath(); c.arc(x, y, radius, 0, 7); c.strokeStyle = colour; c.lineWidth = width; c.stroke(); }
function shape(c, points, fill, edge, width) { c.beginPath(); points.forEach((p, k) => k ? c.lineTo(...p) : c.moveTo(...p)); c.closePath(); c.fillStyle = fill; c.fill(); c.strokeStyle = edge; c.lineWidth = width; c.stroke(); }
function diamond(c, [x, y], r, fill, edge, width) { shape(c, [[x + r, y], [x, y + r], [x - r, y], [x, y - r]], fill, edge, width); }
function nose(c, [x, y], r, yaw, fill, edge, width) {
  shape(c, [[0.9, 0.75], [1.75, 0], [0.9, -0.75]].map(([reach, turn]) => [x + reach * r * Math.cos(yaw + turn), y - reach * r * Math.sin(yaw + turn)]), fill, edge, width);
}
function arrow(c, from, to, gap, colour, edge, thin, dash) {
  const length = Math.hypot(to[0] - from[0], to[1] - from[1]);
  if (length < gap + 4) return;
  const [ux, uy] = [(to[0] - from[0]) / length, (to[1] - from[1]) / length], tip = [to[0] - gap * ux, to[1] - gap * uy], head = 6 * thin;
  const back = [tip[0] - head * ux, tip[1] - head * uy];
  c.setLineDash(dash); line(c, [from, back], edge, 3 * thin); line(c, [from, back], colour, 1.4 * thin); c.setLineDash([]);
  shape(c, [tip, [back[0] - 0.5 * head * uy, back[1] + 0.5 * head * ux], [back[0] + 0.5 * head * uy, back[1] - 0.5 * head * ux]], colour, edge, 0.7 * thin);
}
function stateOf(run, row, robot) {
  const mark = run.mark(row, robot);
  if (!run.alive(row, robot)) return mark === "removed" ? "removed" : mark === "late" ? "not there yet" : "dead";
  return mark === "fault" ? "alive, with a fault" : mark === "joined" ? "alive, joined late" : "alive";
}

const $ = name => document.getElementById(name);
const state = { time: 0, playing: false, speed: 20, robot: -1, theme: "light", show: {} };
let runs = [], views = [], longest = 0;

function seek(time) {
  state.time = Math.max(0, Math.min(time, longest));
  $("scrubber").value = state.time;
  render();
}
function pick(robot) {
  state.robot = robot;
  $("robot").value = robot;
  render();
}
function play(on) {
  if (on && state.time >= longest) state.time = 0;
  state.playing = on;
  $("play").textContent = on ? "Pause" : "Play";
  last = null;
  if (on) requestAnimationFrame(step);
}
let last = null;
function step(now) {
  if (!state.playing) return;
  if (last !== null) seek(state.time + state.speed * Math.min(now - last, 200) / 1000);
  last = now;
  state.time >= longest ? play(false) : requestAnimationFrame(step);
}
function render() {
  for (const view of views) view.draw();
  drawScrubber();
  tell();
}
function drawScrubber() {
  const canvas = $("curve"), ratio = devicePixelRatio || 1, style = getComputedStyle(document.documentElement);
  [canvas.width, canvas.height] = [Math.round(canvas.clientWidth * ratio), Math.round(96 * ratio)];
  const c = canvas.getContext("2d"), [w, h] = [canvas.width, canvas.height], theme = runs[0].themes[state.theme];
  const colours = [style.getPropertyValue("--accent"), style.getPropertyValue("--second")];
  const x = t => 1 + (w - 2) * t / longest;
  c.clearRect(0, 0, w, h);
  c.fillStyle = style.getPropertyValue("--field"); c.fillRect(0, 0, w, h);
  runs.forEach((run, which) => {
    const [low, high] = run.curve.limits, y = v => h - 4 * ratio - (h - 10 * ratio) * Math.max(0, Math.min(1, (v - low) / (high - low)));
    if (state.show.faults) for (const [at] of run.notes) line(c, [[x(at), 0], [x(at), h]], css(theme.mark, 0.6), ratio);
    const trace = (value, colour, width) => {
      const step = Math.max(1, Math.floor(run.iterations / w)), points = [];
      for (let t = 0; t < run.iterations; t += step) points.push([x(t), y(value(t))]);
      line(c, points, colour, width * ratio);
    };
    if (state.robot >= 0 && state.robot < run.robots && run.data.each) trace(t => run.own(t, state.robot), css(run.colours[state.robot % run.colours.length]), 1.5);
    trace(t => run.value(t), colours[which], 2);
    const row = run.rowAt(state.time);
    disc(c, [x(Math.min(state.time, run.iterations)), y(run.value(row))], 4.5 * ratio, colours[which], style.getPropertyValue("--back"), 1.5 * ratio);
  });
  line(c, [[x(state.time), 0], [x(state.time), h]], style.getPropertyValue("--muted"), ratio);
  const { limits, unit, name } = runs[0].curve;
  c.fillStyle = style.getPropertyValue("--muted"); c.font = `${12 * ratio}px system-ui, sans-serif`;
  c.fillText(`${name}, ${Number(limits[0].toPrecision(3))} to ${Number(limits[1].toPrecision(3))} ${unit}`, 6 * ratio, 15 * ratio);
}
function tell() {
  const whole = Math.floor(state.time), run = runs[0];
  $("value").textContent = runs.map(one => one.worded(one.value(one.rowAt(state.time)))).join(" | ");
  $("scrubber").setAttribute("aria-valuetext", `iteration ${whole}, ${run.curve.name} ${runs.map(one => one.worded(one.value(one.rowAt(state.time)))).join(" and ")}`);
  const numbers = [["iteration", `${whole} of ${longest}`], ["simulated", `${(state.time * run.period).toFixed(0)} s`]];
  runs.forEach((one, which) => {
    const row = one.rowAt(state.time), told = one.letters(row), name = runs.length > 1 ? ` ${"AB"[which]}` : "";
    const living = Array.from({ length: one.robots }, (_, robot) => one.alive(row, robot)).filter(Boolean).length;
    numbers.push([`alive${name}`, `${living} of ${one.robots}`]);
    numbers.push([`messages${name}`, `${told.filter(l => !l[2]).length} heard, ${told.filter(l => l[2]).length} lost`]);
  });
  list($("numbers"), numbers);
  const about = [];
  if (state.robot >= 0) runs.forEach((one, which) => {
    if (state.robot >= one.robots) return;
    const row = one.rowAt(state.time), told = one.letters(row), name = runs.length > 1 ? ` ${"AB"[which]}` : "", [x, y] = one.poseAt(state.time, state.robot);
    const ids = found => found.length ? [...new Set(found)].sort((a, b) => a - b).join(", ") : "nobody";
    about.push([`state${name}`, stateOf(one, row, state.robot)], [`place${name}`, `${x.toFixed(2)} m, ${y.toFixed(2)} m`]);
    if (one.own(row, state.robot) !== null) about.push([`own ${one.curve.name}${name}`, one.worded(one.own(row, state.robot))]);
    about.push([`hears${name}`, ids(told.filter(l => l[0] === state.robot && !l[2]).map(l => l[1]))]);
    about.push([`is heard by${name}`, ids(told.filter(l => l[1] === state.robot && !l[2]).map(l => l[0]))]);
    const lost = told.filter(l => l[0] === state.robot && l[2]);
    if (lost.length) about.push([`lost from${name}`, ids(lost.map(l => l[1]))]);
  });
  list($("about"), about);
  $("note").textContent = runs.flatMap(one => one.notes.filter(([at]) => at <= whole && whole - at < 60).map(([at, text]) => `${at}: ${text}`)).slice(-2).join("; ");
}
function list(place, pairs) {
  place.replaceChildren(...pairs.flatMap(([name, value]) => [element("dt", name), element("dd", value)]));
}
function element(kind, text) { const made = document.createElement(kind); made.textContent = text; return made; }
function wear(theme) {
  state.theme = theme;
  document.documentElement.dataset.theme = theme;
  $("theme").textContent = theme === "dark" ? "Light" : "Dark";
  const colours = runs[0].themes[theme];
  $("key").replaceChildren(...[
    ...(runs[0].hasMaps ? [[`linear-gradient(90deg, ${css(colours.few)}, ${css(colours.all)})`, "floor known to one … all robots"], [css(colours.seen), "occupied"]] : []),
    [css(colours.mark), "fault, event"], [css(colours.dead), "dead or removed"], [css(colours.lost), "message lost"],
  ].map(([colour, text]) => { const item = element("span", text), box = document.createElement("i"); box.style.background = colour; item.prepend(box); return item; }));
  resize();
}
function resize() { for (const view of views) view.fit(); render(); }

async function start() {
  const texts = [...document.querySelectorAll("script[data-words]")];
  runs = await Promise.all(texts.map(text => Run.open(JSON.parse(text.textContent), $(`numbers-${text.dataset.words}`).textContent.trim())));
  views = runs.map((run, which) => new View(run, $(`view-${which}`)));
  longest = Math.max(...runs.map(run => run.iterations));
  $("scrubber").max = longest;
  const most = Math.max(...runs.map(run => run.robots));
  $("robot").append(...Array.from({ length: most }, (_, robot) => { const option = element("option", `robot ${robot}`); option.value = robot; return option; }));
  for (const box of document.querySelectorAll("#layers input")) {
    state.show[box.name] = box.checked;
    box.addEventListener("change", () => { state.show[box.name] = box.checked; render(); });
  }
  $("play").addEventListener("click", () => play(!state.playing));
  $("back").addEventListener("click", () => { play(false); seek(Math.ceil(state.time) - 1); });
  $("ahead").addEventListener("click", () => { play(false); seek(Math.floor(state.time) + 1); });
  $("speed").addEventListener("change", event => state.speed = Number(event.target.value));
  $("robot").addEventListener("change", event => pick(Number(event.target.value)));
  $("scrubber").addEventListener("input", event => { play(false); seek(Number(event.target.value)); });
  $("theme").addEventListener("click", () => wear(state.theme === "dark" ? "light" : "dark"));
  for (const button of document.querySelectorAll(".events button")) button.addEventListener("click", () => { play(false); seek(Number(button.dataset.at)); });
  document.addEventListener("keydown", event => {
    if (event.key !== "Escape" && event.target.closest("input, select, button, summary, a")) return;
    const keys = { " ": () => play(!state.playing), ArrowRight: () => seek(state.time + 1), ArrowLeft: () => seek(state.time - 1), Home: () => seek(0), End: () => seek(longest), Escape: () => pick(-1) };
    if (keys[event.key]) { event.preventDefault(); keys[event.key](); }
  });
  addEventListener("resize", resize);
  wear(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  window.swarmsim = { runs, views, state, seek, pick, play, ready: true };
}
start();
