"use strict";
// Replays recorded runs. All numbers shown are recorded; only poses are interpolated between iterations.
const TYPES = { u1: Uint8Array, u2: Uint16Array, u4: Uint32Array, i2: Int16Array, i4: Int32Array, f4: Float32Array };
const css = (c, alpha) => alpha === undefined ? `rgb(${c})` : `rgba(${c}, ${alpha})`;
const mixed = (a, b, share) => a.map((v, i) => Math.round(v + share * (b[i] - v)));

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
    this.tracks = words.tracks.map(words => new Track(words, this.data));
    this.hasMaps = this.tracks.some(track => track.name === "known");
  }
  seek(row) { for (const track of this.tracks) track.seek(row); }
  raster(name, robot = null) { return this.tracks.find(track => track.kind === "Raster" && track.name === name && track.robot === robot); }
  mapOf(robot) { return this.raster("own", robot)?.values; }
  rowAt(time) { return Math.min(Math.floor(time), this.iterations - 1); }
  poseAt(time, robot) {
    const row = this.rowAt(time), next = this.rowAt(row + 1), part = state.smooth ? Math.min(time - row, 1) : 0, pose = this.data.pose;
    const a = 3 * (row * this.robots + robot), b = 3 * (next * this.robots + robot);
    let turn = (pose[b + 2] - pose[a + 2]) / 1000;
    turn -= 2 * Math.PI * Math.round(turn / (2 * Math.PI));
    return [(pose[a] + part * (pose[b] - pose[a])) / 1000, (pose[a + 1] + part * (pose[b + 1] - pose[a + 1])) / 1000,
      pose[a + 2] / 1000 + part * turn];
  }
  alive(row, robot) { return this.data.alive[row * this.robots + robot] === 1; }
  mark(row, robot) { return this.marks[this.data.marks[row * this.robots + robot]]; }
  pairs(row, robot) {  // the robots it hears, those that hear it, and those whose message was lost
    const found = { hears: [], heard: [], lost: [] };
    for (const track of this.tracks) if (track.layer === "links" && track.name !== "waiting") {
      track.seek(row);
      const on = track.count ? track.column("on") : [];
      for (let k = 0; k < on.length; k += 2) for (const [sender, receiver] of track.name === "mutual" ? [[on[k], on[k + 1]], [on[k + 1], on[k]]] : [[on[k], on[k + 1]]]) {
        if (track.name === "lost") { if (receiver === robot) found.lost.push(sender); continue; }
        if (receiver === robot) found.hears.push(sender);
        if (sender === robot) found.heard.push(receiver);
      }
    }
    return found;
  }
  value(row) { return this.curve.scale * this.data.curve[row]; }
  own(row, robot) { return this.data.each ? this.curve.scale * this.data.each[row * this.robots + robot] : null; }
  worded(value) {  // 100 % is all of it; what is added is less than the error of the recording's numbers here
    const shown = this.curve.unit === "%" ? Math.floor(10 * value + 1e-4) / 10 : value;
    return `${shown.toFixed(this.curve.digits)} ${this.curve.unit}`.trim();
  }
}

// One kind of shapes of a layer: constant words, and columns whose rows hold the newest state.
class Track {
  constructor(words, data) {
    Object.assign(this, words);
    this.parts = {};
    for (const [name, column] of Object.entries(words.columns)) {
      if (name === "values") { this.keepCells(column.map(part => data[part])); continue; }
      const [starts, ends, values, delta] = [data[column[0]], data[column[1]], data[column[2]], column[3]];
      const all = delta ? Int32Array.from(values) : values, size = ends[0];
      if (delta) for (let k = size; k < all.length; k++) all[k] += all[k - size];
      this.parts[name] = { starts, ends, all, at: 0 };
    }
    this.row = -1;
  }
  keepCells([starts, ends, steps, to]) {  // with the previous values, so that time can go back
    const [cells, before] = [new Uint32Array(to.length), new Uint8Array(to.length)];
    this.values = new Uint8Array(this.shape[0] * this.shape[1]);
    for (let moment = 0, k = 0; moment < ends.length; moment++) for (let cell = 0; k < ends[moment]; k++) {
      cells[k] = cell += steps[k];
      before[k] = this.values[cell];
      this.values[cell] = to[k];
    }
    this.values.fill(0);
    this.moments = { starts, ends, cells, before, to, done: 0 };
  }
  seek(row) {
    this.row = row;
    const kept = this.moments;
    if (!kept) return;
    const begin = moment => moment ? kept.ends[moment - 1] : 0;
    for (; kept.done < kept.starts.length && kept.starts[kept.done] <= row; kept.done++)
      for (let k = begin(kept.done); k < kept.ends[kept.done]; k++) this.values[kept.cells[k]] = kept.to[k];
    for (; kept.done && kept.starts[kept.done - 1] > row; kept.done--)
      for (let k = kept.ends[kept.done - 1] - 1; k >= begin(kept.done - 1); k--) this.values[kept.cells[k]] = kept.before[k];
  }
  column(name) {  // its state in the current row; null if these shapes have no such column
    const part = this.parts[name];
    if (!part) return null;
    let low = 0, high = part.starts.length;
    while (low < high) { const mid = (low + high) >> 1; part.starts[mid] <= this.row ? low = mid + 1 : high = mid; }
    return low ? part.all.subarray(low > 1 ? part.ends[low - 2] : 0, part.ends[low - 1]) : part.all.subarray(0, 0);
  }
  get count() { const found = this.column("count"); return found.length ? found[0] : 0; }
}

class View {
  constructor(run, place) {
    this.run = run;
    this.canvas = place.querySelector("canvas");
    this.tip = place.querySelector(".tip");
    this.sheet = document.createElement("canvas");
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
      const known = run.raster("known").values[r * run.columns + c], most = Math.min(run.robots, 250);
      lines.push(known === 254 ? "occupied, in some map" : known ? `known to ${Math.round(known * run.robots / most)} of ${run.robots}` : "known to nobody");
    }
    if (robot !== null) lines.push(`robot ${robot}: ${stateOf(run, row, robot)}`, ...(run.own(row, robot) === null ? [] : [`${run.curve.name} ${run.worded(run.own(row, robot))}`]));
    this.tip.textContent = lines.join("\n");
    const box = this.canvas.getBoundingClientRect(), px = event.clientX - box.left;
    this.tip.style.left = px > box.width / 2 ? "" : `${px + 14}px`;
    this.tip.style.right = px > box.width / 2 ? `${box.width - px + 14}px` : "";
    this.tip.style.top = `${event.clientY - box.top + this.canvas.offsetTop + 14}px`;
  }
  draw() {
    const run = this.run, c = this.canvas.getContext("2d"), row = run.rowAt(state.time);
    this.row = row;
    this.inks = run.inks[state.theme];
    run.seek(row);
    c.fillStyle = css(run.themes[state.theme].background);
    c.fillRect(0, 0, this.canvas.width, this.canvas.height);
    this.poses = Array.from({ length: run.robots }, (_, robot) => run.poseAt(state.time, robot));
    this.spots = this.poses.map(([x, y]) => this.at(x, y));
    this.discs = this.radii(this.spots, row);
    this.picked = state.robot >= 0 && state.robot < run.robots ? state.robot : null;
    for (const track of run.tracks) {
      if (state.show[track.layer] === false || (track.each ? this.picked !== null : track.robot !== null && track.robot !== this.picked)) continue;
      if (track.count) this[track.kind](c, track);
    }
    if (this.picked !== null) ring(c, this.spots[this.picked], 2.5 * this.discs[this.picked], css(run.themes[state.theme].text), 2 * this.ratio);
  }
  shown(track, of, k) { return this.picked === null || track.rides || !of || of[k] === this.picked; }  // shapes that move with robots are the robots themselves
  ink(track, name, k, opacity = 1) {
    const column = track.column(name), found = column ? column[k] : track[name];
    return found === null || found === undefined ? null : css(this.inks[found], opacity);
  }
  scaleOf(track, of, k) { return track.unit === "body" ? this.discs[of[k]] : this.scale; }
  Circles(c, track) {
    const of = track.column("of"), centre = track.column("centre"), radius = track.column("radius"), thin = this.ratio;
    for (let k = 0; k < track.count; k++) if (this.shown(track, of, k)) {
      const scale = this.scaleOf(track, of, k), spot = track.rides ? this.spots[of[k]] : this.at(centre[2 * k] / 1000, centre[2 * k + 1] / 1000);
      let size = scale * (radius ? radius[k] / 1000 : track.radius);
      c.globalAlpha = track.opacity;
      if (track.stroke) {
        const width = Math.max(track.stroke * scale, 2 * thin), edge = this.ink(track, "edge", k);
        if (edge) ring(c, spot, size - width / 2, edge, width + 2.6 * thin);
        ring(c, spot, size - width / 2, this.ink(track, "ink", k), width);
      } else disc(c, spot, track.unit === "m" && track.edge !== null ? Math.max(size, 3 * thin) : size, this.ink(track, "ink", k), this.ink(track, "edge", k), thin);
      c.globalAlpha = 1;
    }
  }
  Polygons(c, track) {
    const of = track.column("of"), at = track.column("at"), yaw = track.column("yaw"), points = track.column("points"), ends = track.column("ends"), holes = track.column("holes");
    const placed = at || track.rides;
    if (holes) c.beginPath();
    for (let k = 0, from = 0; k < track.count; from += ends[k++]) {
      if (!this.shown(track, of, k)) continue;
      const [x, y] = !placed ? [0, 0] : track.rides ? this.spots[of[k]] : this.at(at[2 * k] / 1000, at[2 * k + 1] / 1000);
      const turn = track.turns ? this.poses[of[k]][2] : yaw ? yaw[k] / 1000 : 0, scale = this.scaleOf(track, of, k) / 1000, [cos, sin] = [scale * Math.cos(turn), scale * Math.sin(turn)];
      const corners = Array.from({ length: ends[k] }, (_, i) => {
        const [px, py] = [points[2 * (from + i)], points[2 * (from + i) + 1]];
        return placed ? [x + px * cos - py * sin, y - px * sin - py * cos] : this.at(px / 1000, py / 1000);
      });
      if (holes) { trace(c, corners); continue; }
      c.beginPath();
      trace(c, corners);
      const [ink, edge] = [this.ink(track, "ink", k, track.opacity[0]), this.ink(track, "edge", k, track.opacity[1])];
      if (edge && ink && track.opacity[0] === 1) { c.strokeStyle = edge; c.lineWidth = 2 * track.width * this.ratio; c.stroke(); }
      if (ink) { c.fillStyle = ink; c.fill(); }
      if (edge && (!ink || track.opacity[0] < 1)) { c.strokeStyle = edge; c.lineWidth = track.width * this.ratio; c.stroke(); }
    }
    if (holes) { c.fillStyle = this.ink(track, "ink", 0, track.opacity[0]); c.fill("evenodd"); }
  }
  Lines(c, track) {
    const of = track.column("of"), on = track.column("on"), points = track.column("points"), ends = track.column("ends"), thin = this.ratio, width = 0.9 * track.width * thin;
    const casing = this.ink(track, "casing", 0), dash = { whole: [], dashed: [6 * thin, 6 * thin], dotted: [2 * thin, 2 * thin] }[track.dash];
    c.globalAlpha = track.opacity;
    for (let k = 0, from = 0; k < track.count; from += ends[k++]) {
      const riders = on && !of ? on.subarray(from, from + ends[k]) : [];
      if (!this.shown(track, of, k) || (this.picked !== null && riders.length && riders.every(robot => robot >= 0 && robot !== this.picked))) continue;
      const corners = Array.from({ length: ends[k] }, (_, i) => on && on[from + i] >= 0 ? this.spots[on[from + i]] : this.at(points[2 * (from + i)] / 1000, points[2 * (from + i) + 1] / 1000));
      const ink = this.ink(track, "ink", k), last = on ? on[from + ends[k] - 1] : -1;
      c.setLineDash(dash);
      if (casing) line(c, corners, casing, width + 2 * thin);
      line(c, corners, ink, width);
      c.setLineDash([]);
      if (track.arrow && corners.length > 1) head(c, ...corners.slice(-2), last >= 0 ? this.discs[last] : 0, ink, casing ?? ink, thin);
    }
    c.globalAlpha = 1;
  }
  Rays(c, track) {
    const of = track.column("of"), bearings = track.column("bearings"), length = track.column("length"), count = bearings.length;
    for (let k = 0; k < track.count; k++) if (this.picked === null || of[k] === this.picked) {
      const [x, y] = this.spots[of[k]], yaw = this.poses[of[k]][2];
      c.strokeStyle = this.ink(track, "ink", k, 0.7 * track.opacity); c.lineWidth = 0.7 * track.width * this.ratio; c.beginPath();
      for (let b = 0; b < count; b++) {
        const reach = this.scale * length[count * k + b] / 100, angle = yaw + bearings[b] / 1000;
        c.moveTo(x, y); c.lineTo(x + reach * Math.cos(angle), y - reach * Math.sin(angle));
      }
      c.stroke();
    }
  }
  Texts(c, track) {
    const of = track.column("of"), at = track.column("at"), texts = track.column("texts"), body = track.unit === "body";
    const widest = Math.max(...Array.from(texts, text => this.run.texts[text].length));
    c.textAlign = "center"; c.textBaseline = "middle";
    for (let k = 0; k < track.count; k++) if (this.shown(track, of, k)) {
      const radius = body ? this.discs[of[k]] : 0, [x, y] = track.rides ? this.spots[of[k]] : this.at(at[2 * k] / 1000, at[2 * k + 1] / 1000);
      if (body && radius < 6 * this.ratio) continue;
      c.font = `600 ${body ? Math.min(0.66 * track.size * radius, 2.2 * radius / widest) : 0.7 * track.size * this.ratio}px system-ui, sans-serif`;
      c.fillStyle = this.ink(track, "ink", k);
      c.fillText(this.run.texts[texts[k]], x, y + 0.05 * radius);
    }
  }
  Raster(c, track) {
    const [rows, columns] = track.shape, shades = Array(256).fill(null), [x, y] = this.at(...track.corner), side = this.scale * track.cell;
    for (const [first, last, low, high] of track.palette) for (let k = first; k <= last; k++) shades[k] = mixed(this.inks[low], this.inks[high], (k - first) / Math.max(last - first, 1));
    [this.sheet.width, this.sheet.height] = [columns, rows];
    const sheet = this.sheet.getContext("2d"), picture = sheet.createImageData(columns, rows), pixels = picture.data;
    for (let cell = 0; cell < rows * columns; cell++) {
      const colour = shades[track.values[cell]], at = 4 * ((rows - 1 - Math.floor(cell / columns)) * columns + cell % columns);
      if (colour) { pixels[at] = colour[0]; pixels[at + 1] = colour[1]; pixels[at + 2] = colour[2]; pixels[at + 3] = 255; }
    }
    sheet.putImageData(picture, 0, 0);
    c.imageSmoothingEnabled = false;
    c.drawImage(this.sheet, x, y - rows * side, columns * side, rows * side);
  }
  radii(spots, row) {  // large enough to read, but smaller where discs would overlap
    const there = spots.map((_, robot) => robot).filter(robot => this.run.alive(row, robot) || this.run.mark(row, robot) === "");
    return spots.map((spot, robot) => {
      const real = this.scale * this.run.radii[robot];
      let radius = Math.max(real, 9 * this.ratio);
      for (const other of there) if (other !== robot) radius = Math.min(radius, Math.hypot(spot[0] - spots[other][0], spot[1] - spots[other][1]) / 2);
      return Math.max(radius, real, 3 * this.ratio);
    });
  }
}

function trace(c, points) { points.forEach((point, k) => k ? c.lineTo(...point) : c.moveTo(...point)); c.closePath(); }
function line(c, points, colour, width) {
  if (points.length < 2) return;
  c.strokeStyle = colour; c.lineWidth = width; c.lineJoin = "round"; c.beginPath();
  points.forEach((point, k) => k ? c.lineTo(...point) : c.moveTo(...point)); c.stroke();
}
function disc(c, [x, y], radius, fill, edge, width) { c.beginPath(); c.arc(x, y, radius, 0, 7); c.fillStyle = fill; c.fill(); if (edge) { c.strokeStyle = edge; c.lineWidth = width; c.stroke(); } }
function ring(c, [x, y], radius, colour, width) { c.beginPath(); c.arc(x, y, radius, 0, 7); c.strokeStyle = colour; c.lineWidth = width; c.stroke(); }
function head(c, from, to, gap, colour, edge, thin) {  // an arrow's head, `gap` pixels before its end
  const length = Math.hypot(to[0] - from[0], to[1] - from[1]), size = 6 * thin;
  if (length < gap + 4) return;
  const [ux, uy] = [(to[0] - from[0]) / length, (to[1] - from[1]) / length], tip = [to[0] - gap * ux, to[1] - gap * uy];
  const back = [tip[0] - size * ux, tip[1] - size * uy];
  c.beginPath();
  trace(c, [tip, [back[0] - 0.5 * size * uy, back[1] + 0.5 * size * ux], [back[0] + 0.5 * size * uy, back[1] - 0.5 * size * ux]]);
  c.fillStyle = colour; c.fill(); c.strokeStyle = edge; c.lineWidth = 0.7 * thin; c.stroke();
}
function stateOf(run, row, robot) {
  const mark = run.mark(row, robot);
  if (!run.alive(row, robot)) return mark === "removed" ? "removed" : mark === "late" ? "not there yet" : "dead";
  return mark === "fault" ? "alive, with a fault" : mark === "joined" ? "alive, joined late" : "alive";
}

const $ = name => document.getElementById(name);
const state = { smooth: !matchMedia("(prefers-reduced-motion: reduce)").matches, time: 0, playing: false, speed: 20, robot: -1, theme: "light", show: {} };
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
    if (state.show.faults !== false) for (const [at] of run.notes) line(c, [[x(at), 0], [x(at), h]], css(theme.mark, 0.6), ratio);
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
    const row = one.rowAt(state.time), name = runs.length > 1 ? ` ${"AB"[which]}` : "";
    const living = Array.from({ length: one.robots }, (_, robot) => one.alive(row, robot)).filter(Boolean).length;
    numbers.push([`alive${name}`, `${living} of ${one.robots}`]);
    numbers.push([`messages${name}`, `${one.data.told[2 * row]} heard, ${one.data.told[2 * row + 1]} lost`]);
  });
  list($("numbers"), numbers);
  const about = [];
  if (state.robot >= 0) runs.forEach((one, which) => {
    if (state.robot >= one.robots) return;
    const row = one.rowAt(state.time), told = one.pairs(row, state.robot), name = runs.length > 1 ? ` ${"AB"[which]}` : "", [x, y] = one.poseAt(state.time, state.robot);
    const ids = found => found.length ? [...new Set(found)].sort((a, b) => a - b).join(", ") : "nobody";
    about.push([`state${name}`, stateOf(one, row, state.robot)], [`place${name}`, `${x.toFixed(2)} m, ${y.toFixed(2)} m`]);
    if (one.own(row, state.robot) !== null) about.push([`own ${one.curve.name}${name}`, one.worded(one.own(row, state.robot))]);
    about.push([`hears${name}`, ids(told.hears)], [`is heard by${name}`, ids(told.heard)]);
    if (told.lost.length) about.push([`lost from${name}`, ids(told.lost)]);
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
    const control = event.target.closest("input, select, button, summary, a"), ofRun = ["Home", "End"].includes(event.key) && control?.tagName === "SELECT";
    if (event.key !== "Escape" && control && !ofRun) return; // in the list of speeds Home and End are of the run too
    const keys = { " ": () => play(!state.playing), ArrowRight: () => seek(state.time + 1), ArrowLeft: () => seek(state.time - 1), Home: () => seek(0), End: () => seek(longest), Escape: () => pick(-1), i: () => { state.smooth = !state.smooth; render(); } };
    if (keys[event.key]) { event.preventDefault(); keys[event.key](); }
  });
  addEventListener("resize", resize);
  wear(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  window.swarmsim = { runs, views, state, seek, pick, play, ready: true };
}
start();
