"use strict";
// The object as shaded triangles on a plain canvas: no library, no graphics driver needed.
// Lengths are millimetres; triangles are sorted by depth and drawn from the farthest on.

function makeSolid(canvas, palette) {
  const pen = canvas.getContext("2d");
  const state = { yaw: -0.9, pitch: 0.5, zoom: 1, scene: null };

  function turned(p, k, c) {
    const [x, y, z] = [p[3 * k] - c[0], p[3 * k + 1] - c[1], p[3 * k + 2] - c[2]];
    const [cy, sy, cp, sp] = [Math.cos(state.yaw), Math.sin(state.yaw), Math.cos(state.pitch), Math.sin(state.pitch)];
    const side = cy * x + sy * y, away = -sy * x + cy * y;
    return [side, sp * away + cp * z, cp * away - sp * z];
  }

  function colour(share) {
    return palette[Math.max(0, Math.min(palette.length - 1, Math.floor(share * palette.length)))];
  }

  function shade(hex, light) {
    const n = parseInt(hex.slice(1), 16);
    const part = (s) => Math.round(((n >> s) & 255) * light);
    return `rgb(${part(16)},${part(8)},${part(0)})`;
  }

  function draw() {
    const size = canvas.getBoundingClientRect(), ratio = window.devicePixelRatio || 1;
    const w = Math.max(200, Math.round(size.width * ratio)), h = Math.max(150, Math.round(size.height * ratio));
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    pen.fillStyle = "#fff";
    pen.fillRect(0, 0, w, h);
    const s = state.scene;
    if (!s) return;
    const scale = state.zoom * 1.02 * Math.min(w, h) / s.reach;
    const place = (p, k) => { const v = turned(p, k, s.centre); return [w / 2 + scale * v[0], h / 2 - scale * v[1], v[2]]; };
    drawTable(s, place);
    const corners = [], todo = [];
    for (let k = 0; k < s.vertices.length / 3; k++) corners.push(place(s.vertices, k));
    for (let f = 0; f < s.faces.length; f += 3) {
      if (s.torn && s.torn[f / 3]) continue;
      const [a, b, c] = [corners[s.faces[f]], corners[s.faces[f + 1]], corners[s.faces[f + 2]]];
      const value = (s.values[s.faces[f]] + s.values[s.faces[f + 1]] + s.values[s.faces[f + 2]]) / 3;
      const turn = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
      const u = [b[0] - a[0], b[1] - a[1], (b[2] - a[2]) * scale], v = [c[0] - a[0], c[1] - a[1], (c[2] - a[2]) * scale];
      const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
      const facing = Math.abs(n[2]) / (Math.hypot(...n) || 1);
      todo.push([a[2] + b[2] + c[2], a, b, c, shade(colour(value / s.top), turn < 0 || Math.abs(turn) < 12 * ratio ? 0.86 + 0.14 * facing : 0.6)]);
    }
    todo.sort((p, q) => q[0] - p[0]);
    for (const [, a, b, c, fill] of todo) {
      pen.fillStyle = pen.strokeStyle = fill;
      pen.lineWidth = 1;
      pen.beginPath();
      pen.moveTo(a[0], a[1]); pen.lineTo(b[0], b[1]); pen.lineTo(c[0], c[1]); pen.closePath();
      pen.fill(); pen.stroke();
    }
    drawTool(s, place, ratio);
  }

  function drawTable(s, place) {
    if (s.table === null) return;
    const r = 0.55 * s.reach, [x, y] = s.centre;
    const ring = new Float32Array([x - r, y - r, s.table, x + r, y - r, s.table, x + r, y + r, s.table, x - r, y + r, s.table]);
    pen.strokeStyle = "#c9cdd3"; pen.fillStyle = "#f7f8f9"; pen.lineWidth = 1;
    pen.beginPath();
    for (let k = 0; k < 4; k++) { const p = place(ring, k); k ? pen.lineTo(p[0], p[1]) : pen.moveTo(p[0], p[1]); }
    pen.closePath(); pen.fill(); pen.stroke();
  }

  function drawTool(s, place, ratio) {
    pen.strokeStyle = "rgba(40,40,40,0.75)"; pen.lineWidth = 1.2 * ratio;
    pen.beginPath();
    for (let k = 0; k < s.toolEdges.length; k += 2) {
      const a = place(s.tool, s.toolEdges[k]), b = place(s.tool, s.toolEdges[k + 1]);
      pen.moveTo(a[0], a[1]); pen.lineTo(b[0], b[1]);
    }
    pen.stroke();
  }

  function turn(yaw, pitch) {
    state.yaw += yaw;
    state.pitch = Math.max(-0.4, Math.min(1.55, state.pitch + pitch));
    draw();
  }

  let held = null;
  canvas.addEventListener("pointerdown", (e) => { held = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); });
  canvas.addEventListener("pointerup", () => { held = null; });
  canvas.addEventListener("pointermove", (e) => {
    if (!held) return;
    turn(-(e.clientX - held[0]) * 0.01, (e.clientY - held[1]) * 0.01);
    held = [e.clientX, e.clientY];
  });
  canvas.addEventListener("wheel", (e) => {
    if (!e.ctrlKey && document.activeElement !== canvas) return;
    e.preventDefault();
    state.zoom = Math.max(0.4, Math.min(6, state.zoom * Math.exp(-e.deltaY * 0.001)));
    draw();
  }, { passive: false });
  canvas.addEventListener("keydown", (e) => {
    const step = { ArrowLeft: [0.15, 0], ArrowRight: [-0.15, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[e.key];
    if (step) turn(...step);
    else if (e.key === "+" || e.key === "-") { state.zoom *= e.key === "+" ? 1.15 : 1 / 1.15; draw(); }
    else return;
    e.preventDefault();
  });
  return { draw, turn, show(scene) { state.scene = scene; draw(); } };
}
