"use strict";
const DATA = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);
const state = { episode: 0, model: DATA.models.length - 1, frame: 0, shape: "measured", timer: null };
const solid = makeSolid(byId("solid"), DATA.palette);
const opened = new Map();

function bytes(text) {
  const raw = atob(text), out = new Uint8Array(raw.length);
  for (let k = 0; k < raw.length; k++) out[k] = raw.charCodeAt(k);
  return out.buffer;
}

// Numbers are packed as integers; `step` is their unit in millimetres.
function episodeOf(k) {
  if (!opened.has(k)) {
    const e = DATA.episodes[k], s = e.surface;
    opened.set(k, {
      measured: new Int16Array(bytes(e.measured)), predicted: e.predicted.map((text) => new Int16Array(bytes(text))),
      rest: new Int16Array(bytes(s.rest)), faces: new Uint16Array(bytes(s.faces)),
      index: new Uint16Array(bytes(s.index)), weight: new Uint8Array(bytes(s.weight)),
    });
  }
  return opened.get(k);
}

function carried(arrays, points, offset, first) {
  const count = arrays.rest.length / 3, out = new Float32Array(3 * count);
  for (let v = 0; v < count; v++) {
    for (let c = 0; c < 3; c++) {
      let shift = 0, total = 0;
      for (let n = 0; n < 4; n++) {
        const w = arrays.weight[4 * v + n], p = arrays.index[4 * v + n];
        shift += w * (points[offset + 3 * p + c] - first[3 * p + c]);
        total += w;
      }
      out[3 * v + c] = (arrays.rest[3 * v + c] + shift / (total || 1)) * DATA.step_mm;
    }
  }
  return out;
}

function errorsAt(arrays, measured, predicted, offset) {
  const count = arrays.rest.length / 3, out = new Float32Array(count);
  for (let v = 0; v < count; v++) {
    let sum = 0, total = 0;
    for (let n = 0; n < 4; n++) {
      const w = arrays.weight[4 * v + n], p = offset + 3 * arrays.index[4 * v + n];
      sum += w * Math.hypot(measured[p] - predicted[p], measured[p + 1] - predicted[p + 1], measured[p + 2] - predicted[p + 2]);
      total += w;
    }
    out[v] = sum / (total || 1) * DATA.step_mm;
  }
  return out;
}

// A triangle whose edge has grown to twice its length and 3 mm was pulled apart by the cut.
function tornFaces(arrays, now) {
  const out = new Uint8Array(arrays.faces.length / 3);
  const gap = (p, a, b) => Math.hypot(p[3 * a] - p[3 * b], p[3 * a + 1] - p[3 * b + 1], p[3 * a + 2] - p[3 * b + 2]);
  for (let f = 0; f < out.length; f++) {
    for (let k = 0; k < 3; k++) {
      const a = arrays.faces[3 * f + k], b = arrays.faces[3 * f + (k + 1) % 3];
      if (gap(now, a, b) > 2 * DATA.step_mm * gap(arrays.rest, a, b) + 3) out[f] = 1;
    }
  }
  return out;
}

function placedTool(e, frame) {
  const pose = e.tool.poses[frame], out = new Float32Array(e.tool.vertices.length);
  for (let k = 0; k < out.length; k += 3) {
    for (let c = 0; c < 3; c++) {
      out[k + c] = pose[4 * c] * e.tool.vertices[k] + pose[4 * c + 1] * e.tool.vertices[k + 1]
        + pose[4 * c + 2] * e.tool.vertices[k + 2] + pose[4 * c + 3];
    }
  }
  return out;
}

function showSolid() {
  const e = DATA.episodes[state.episode], arrays = episodeOf(state.episode);
  const offset = state.frame * 3 * e.points, predicted = arrays.predicted[state.model];
  const shape = state.shape === "measured" ? arrays.measured : predicted;
  const vertices = carried(arrays, shape, offset, arrays.measured);
  solid.show({
    vertices, faces: arrays.faces, values: errorsAt(arrays, arrays.measured, predicted, offset),
    torn: tornFaces(arrays, vertices), top: e.top_mm, centre: e.centre, reach: e.reach, table: e.table,
    tool: placedTool(e, state.frame), toolEdges: e.tool.edges,
  });
}

function drawChart() {
  const canvas = byId("chart"), pen = canvas.getContext("2d"), e = DATA.episodes[state.episode];
  const size = canvas.getBoundingClientRect(), ratio = window.devicePixelRatio || 1;
  canvas.width = Math.max(200, size.width * ratio); canvas.height = Math.max(150, size.height * ratio);
  pen.scale(ratio, ratio);
  const w = canvas.width / ratio, h = canvas.height / ratio, left = 46, bottom = h - 38, right = w - 12, top = 12;
  const c = e.curves, last = c.time[c.time.length - 1] || 1;
  const most = 1.08 * Math.max(e.floor_mm, ...c.models.flat(), ...c.rigid);
  const x = (t) => left + (right - left) * t / last, y = (v) => bottom - (bottom - top) * Math.min(v / most, 1.05);
  pen.font = "12px system-ui, sans-serif";
  for (const [from, to, name] of e.phases) { pen.fillStyle = DATA.phase_colours[name]; pen.fillRect(x(from), top, x(to) - x(from), bottom - top); }
  pen.fillStyle = "#1a1a1a"; pen.textAlign = "right";
  const step = niceStep(most / 5);
  for (let v = 0; v <= most; v += step) {
    pen.fillText(v.toFixed(step < 1 ? 1 : 0), left - 6, y(v) + 4);
    pen.fillStyle = "rgba(0,0,0,0.10)"; pen.fillRect(left, y(v), right - left, 1); pen.fillStyle = "#1a1a1a";
  }
  pen.textAlign = "center";
  const stepT = niceStep(last / 5);
  for (let t = 0; t <= last + 1e-9; t += stepT) pen.fillText(t.toFixed(stepT < 0.1 ? 2 : 1), x(t), bottom + 16);
  pen.fillText("time [s]", (left + right) / 2, h - 6);
  pen.save(); pen.translate(13, (top + bottom) / 2); pen.rotate(-Math.PI / 2); pen.fillText("error, RMS [mm]", 0, 0); pen.restore();
  pen.save(); pen.beginPath(); pen.rect(left, top, right - left, bottom - top); pen.clip();
  const line = (values, colour, dash, width) => {
    pen.strokeStyle = colour; pen.setLineDash(dash); pen.lineWidth = width; pen.beginPath();
    values.forEach((v, k) => k ? pen.lineTo(x(c.time[k]), y(v)) : pen.moveTo(x(c.time[k]), y(v)));
    pen.stroke();
  };
  line(c.persistence, "#999999", [7, 4], 1.5);
  line(c.rigid, "#e69f00", [9, 3, 2, 3], 1.5);
  c.models.forEach((values, k) => line(values, DATA.models[k].colour, [], k === state.model ? 3 : 1.6));
  line(c.time.map(() => e.floor_mm), "#000", [2, 3], 1.4);
  pen.restore();
  pen.strokeStyle = "#1a1a1a"; pen.lineWidth = 1.5; pen.beginPath();
  pen.moveTo(x(e.time[state.frame]), top); pen.lineTo(x(e.time[state.frame]), bottom); pen.stroke();
}

function niceStep(wish) {
  const size = Math.pow(10, Math.floor(Math.log10(wish || 1)));
  return [1, 2, 5, 10].map((k) => k * size).find((v) => v >= wish) || size;
}

function showFrame() {
  const e = DATA.episodes[state.episode], f = state.frame, model = e.images.models[state.model];
  byId("measured").src = e.images.measured[f];
  byId("predicted").src = model.predicted[f];
  byId("difference").src = model.difference[f];
  const label = DATA.models[state.model].label;
  byId("predicted-caption").textContent = `predicted by ${label}`;
  const error = e.curves.models[state.model][e.curve_frames[f]];
  const text = `${e.time[f].toFixed(2)} s, ${e.phase[f]}, error ${error.toFixed(2)} mm`;
  byId("now").textContent = text;
  byId("scrub").setAttribute("aria-valuetext", text);
  showSolid();
  drawChart();
}

function showEpisode() {
  const e = DATA.episodes[state.episode], scrub = byId("scrub");
  scrub.max = e.time.length - 1;
  state.frame = Math.min(state.frame, e.time.length - 1);
  scrub.value = state.frame;
  byId("camera").textContent = e.images.camera;
  byId("bar-top").textContent = `${e.top_mm.toFixed(1)} mm or more`;
  byId("bar-middle").textContent = (e.top_mm / 2).toFixed(1);
  showFrame();
}

function press(group, chosen) {
  for (const button of document.querySelectorAll(`[data-${group}]`)) {
    button.setAttribute("aria-pressed", String(button.dataset[group] === String(chosen)));
  }
}

function stop() {
  clearInterval(state.timer);
  state.timer = null;
  byId("play").textContent = "Play";
}

function toFrame(frame) {
  state.frame = frame;
  byId("scrub").value = frame;
  showFrame();
}

byId("episode").addEventListener("change", (e) => {
  state.episode = Number(e.target.value); state.frame = DATA.episodes[state.episode].worst; showEpisode();
});
byId("scrub").addEventListener("input", (e) => { stop(); state.frame = Number(e.target.value); showFrame(); });
byId("play").addEventListener("click", () => {
  if (state.timer) { stop(); return; }
  byId("play").textContent = "Stop";
  state.timer = setInterval(() => toFrame((state.frame + 1) % DATA.episodes[state.episode].time.length), 150);
});
for (const button of document.querySelectorAll("[data-model]")) {
  button.addEventListener("click", () => { state.model = Number(button.dataset.model); press("model", state.model); showFrame(); });
}
for (const button of document.querySelectorAll("[data-shape]")) {
  button.addEventListener("click", () => { state.shape = button.dataset.shape; press("shape", state.shape); showSolid(); });
}
document.addEventListener("keydown", (e) => {
  const tag = document.activeElement ? document.activeElement.tagName : "";
  if (["INPUT", "SELECT", "CANVAS", "SUMMARY"].includes(tag) || !["ArrowLeft", "ArrowRight"].includes(e.key)) return;
  const most = DATA.episodes[state.episode].time.length - 1;
  toFrame(Math.max(0, Math.min(most, state.frame + (e.key === "ArrowRight" ? 1 : -1))));
  e.preventDefault();
});
window.addEventListener("resize", () => { solid.draw(); drawChart(); });
state.frame = DATA.episodes.length ? DATA.episodes[0].worst : 0;
press("model", state.model);
press("shape", state.shape);
if (DATA.episodes.length) showEpisode();

// `report.html#selftest` works the page as a person would and writes what happened into the page.
async function selfTest() {
  const found = { errors: [], ready: true }, canvas = byId("solid");
  const ink = () => { const d = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
    let n = 0, sum = 0; for (let k = 0; k < d.length; k += 4) { const v = d[k] + d[k + 1] + d[k + 2]; if (v < 740) n++; sum = (sum * 31 + v) % 1e9; } return [n, sum]; };
  const loaded = async (id) => { await byId(id).decode(); return byId(id).naturalWidth; };
  try {
    const scrub = byId("scrub");
    scrub.value = 0; scrub.dispatchEvent(new Event("input"));
    const first = [byId("measured").src, byId("predicted").src, byId("now").textContent];
    found.widths = [await loaded("measured"), await loaded("predicted"), await loaded("difference")];
    const before = ink();
    scrub.value = scrub.max; scrub.dispatchEvent(new Event("input"));
    found.scrubber_moves = byId("measured").src !== first[0] && byId("predicted").src !== first[1] && byId("now").textContent !== first[2];
    const after = ink();
    found.error_map_drawn = after[0] > 2000; found.error_map_follows = before[1] !== after[1];
    solid.turn(0.7, 0); found.error_map_turns = ink()[1] !== after[1];
    const at = state.frame; document.body.focus(); if (document.activeElement) document.activeElement.blur();
    document.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft" })); found.keyboard_moves = state.frame === at - 1;
    if (DATA.models.length > 1) { const src = byId("predicted").src; document.querySelector('[data-model="0"]').click(); found.model_switches = byId("predicted").src !== src; }
    if (DATA.episodes.length > 1) { byId("episode").value = 1; byId("episode").dispatchEvent(new Event("change")); await loaded("measured"); found.episode_switches = state.episode === 1; }
    found.requests = performance.getEntriesByType("resource").filter((r) => !r.name.startsWith("data:")).map((r) => r.name);
    found.overflows = document.documentElement.scrollWidth > window.innerWidth + 1;
  } catch (error) { found.errors.push(String(error)); }
  const out = document.createElement("pre"); out.id = "selftest"; out.textContent = JSON.stringify(found);
  document.body.append(out);
}
if (location.hash === "#selftest") selfTest();
