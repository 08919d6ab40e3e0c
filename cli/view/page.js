"use strict";
/* The page of `saltus view`. It keeps nothing that the server does not know but what is looked at: /state says what
 * there is, /events what changes, and every step of a slider is one POST /image, whose answer is the picture. One such
 * request runs at a time; what moves meanwhile goes with the next, so that the last value wins. docs/view.md describes the requests, and
 * the ids and data attributes that scripts may rely on. */

const token = new URLSearchParams(location.search).get("token") || "";
const $ = id => document.getElementById(id);
const body = document.body;
const SLOW = 60;      /* milliseconds: slower pictures are drawn coarser while something moves */
const POINTS = 256;   /* handles, at most */
const SAMPLES_1D = 512;

let state = null;     /* /state */
let program = null;   /* state.program */
let values = {};
let controls = [];    /* {refresh()} */
let chosen = {};      /* by array: the element that is shown */

function element(tag, attributes, ...children) {
  const svg = ["circle", "path", "line", "text"].includes(tag);
  const e = svg ? document.createElementNS("http://www.w3.org/2000/svg", tag) : document.createElement(tag);
  for (const [k, v] of Object.entries(attributes || {})) e.setAttribute(k, v);
  e.append(...children);
  return e;
}

async function ask(path, options = {}) {
  const response = await fetch(path, { ...options, headers: { "X-Saltus-Token": token }, cache: "no-store" });
  if (response.ok) return response;
  let text = response.statusText;
  try { text = (await response.json()).error; } catch (e) { /* no JSON: the status says it */ }
  const error = new Error(text);
  error.status = response.status;
  throw error;
}
const post = (path, content) => ask(path, { method: "POST", body: content === undefined ? "" : JSON.stringify(content) });
const say = text => { $("under").dataset.said = text; $("where").textContent = text; };
const short = v => v === null ? "NaN" : typeof v !== "number" ? String(v) : Math.abs(v) >= 1e5 || (v && Math.abs(v) < 1e-3) ? v.toExponential(2) : String(+v.toFixed(4));

/* ---- values: read and set by path, "discs[3].centre.x" */
const AXES = ["x", "y", "z", "w"];
/* The parameter, whose name has a dot where it is a module's, and the keys that lead on. */
function keys(path) {
  let name = path;
  while (!(name in values) && /[.[]/.test(name)) name = name.replace(/[.[][^.[]*$/, "");
  return [name, ...(path.slice(name.length).match(/[^.[\]]+/g) || [])];
}
const key = (v, k) => Array.isArray(v) && AXES.includes(k) ? AXES.indexOf(k) : k;
function read(path) {
  let v = values;
  for (const k of keys(path)) {
    if (v === undefined) return undefined;
    v = v[key(v, k)];
  }
  return v;
}
function write(path, value) {
  const all = keys(path), last = all.pop();
  let v = values;
  for (const k of all) v = v[key(v, k)];
  v[key(v, last)] = value;
}

/* ---- the pump: one request at a time, the picture before its derivative */
let pending = {}, settings = {}, wanted = false, running = false, refine = false, lastStep = -1e9, coarse = 1, drawn = 0;
function step(path, value) {
  write(path, value);
  pending[path] = value;
  lastStep = performance.now();
  show();
}
function set(key, value) { settings[key] = value; show(); }
function show() {
  wanted = true;
  body.dataset.busy = "1";
  if (!running) pump();
}
async function pump() {
  running = true;
  while (wanted || refine) {
    const moving = state.fit.running || performance.now() - lastStep < 150;
    wanted = false;
    if (!program) break;
    const scale = moving && !state.fit.running ? coarse : 1;
    refine = false;
    const sent = { ...settings };
    if (Object.keys(pending).length) sent.params = pending;
    pending = {}, settings = {};
    const begun = performance.now();
    try {
      const curve = program.dim === 1;
      const r = await ask(`/image?format=${curve ? "f32" : "rgba"}&scale=${scale}&draft=${moving ? 1 : 0}`, { method: "POST", body: JSON.stringify(sent) });
      const data = await r.arrayBuffer(), w = +r.headers.get("X-Saltus-Width"), h = +r.headers.get("X-Saltus-Height");
      if (curve) drawCurve(new Float32Array(data), w, +r.headers.get("X-Saltus-Channels"));
      else draw($("image"), data, w, h);
      drawn = +r.headers.get("X-Saltus-Version");
      const took = performance.now() - begun;
      body.dataset.shown = drawn;
      body.dataset.took = took.toFixed(2);
      $("took").textContent = `${w} × ${h}, ${took.toFixed(1)} ms`;
      if (scale === 1 && took > SLOW && moving && !state.fit.running) coarse = Math.min(8, Math.ceil(Math.sqrt(took / SLOW)) + 1);
      if (scale === 1 && took < SLOW / 4) coarse = 1;
      if (sent.reset) await takeValues();
      drawPoints();
      refine = moving && (scale > 1 || state.spp > 1 || program.rand);
      if (refine && !wanted) await new Promise(done => setTimeout(done, state.fit.running ? 0 : 150));
      if (state.fit.running) refine = false;
      if (!wanted) await drawGradient();
      if (!wanted && !refine && $("show-cells").checked) await drawCells();
    } catch (e) {
      say(e.message);
      if (e.status === 422) await takeValues().catch(() => {}); /* none of them was set */
      if (e.status === 409 && !state.fit.running && program) await new Promise(done => setTimeout(done, 50)), wanted = state.status === "ready" && e.message.startsWith("interrupted");
      else if (!e.status) break;
    }
  }
  running = false;
  body.dataset.busy = "0";
}

async function takeValues() {
  const next = await (await ask("/state")).json();
  if (Object.keys(pending).length || next.generation !== state.generation) return;
  values = next.values;
  refresh();
}

function draw(canvas, data, w, h) {
  if (canvas.width !== w || canvas.height !== h) canvas.width = w, canvas.height = h;
  canvas.getContext("2d").putImageData(new ImageData(new Uint8ClampedArray(data), w, h), 0, 0);
}

/* ---- 1D: a curve a channel, and that of the derivative, dashed */
let curve = null, slope = null;
function drawCurve(data, n, channels) {
  curve = { data, n, channels };
  plot();
}
function plot() {
  const canvas = $("image"), w = canvas.width = 1024, h = canvas.height = 512, g = canvas.getContext("2d"), margin = 24;
  const style = getComputedStyle(body), colours = curve.channels > 1 ? ["#d2504a", "#3f9a5a", "#3f78c8", "#888"] : [style.getPropertyValue("--accent")];
  g.fillStyle = style.getPropertyValue("--card");
  g.fillRect(0, 0, w, h);
  const line = (c, dash, ends) => {
    const all = c.data.filter(Number.isFinite), lo = Math.min(0, ...all), hi = Math.max(ends ? 0 : 1e-30, ...all), span = hi - lo || 1;
    const y = v => h - margin - (v - lo) / span * (h - 2 * margin);
    g.setLineDash(dash);
    if (dash.length) {
      g.fillStyle = style.getPropertyValue("--warm");
      g.font = "20px system-ui";
      g.textAlign = "right";
      g.fillText(short(hi), w - 8, margin - 4);
      g.fillText(short(lo), w - 8, h - 4);
      g.textAlign = "left";
    } else {
      g.strokeStyle = style.getPropertyValue("--line");
      g.lineWidth = 1;
      g.strokeRect(0, y(0), w, 0);
      g.fillStyle = style.getPropertyValue("--pale");
      g.font = "20px system-ui";
      g.fillText(short(hi), 8, margin - 4);
      g.fillText(short(lo), 8, h - 4);
    }
    for (let k = 0; k < c.channels; k++) {
      g.strokeStyle = dash.length ? style.getPropertyValue("--warm") : colours[k];
      g.lineWidth = 3;
      g.beginPath();
      for (let i = 0; i < c.n; i++) g.lineTo((i + 0.5) / c.n * w, y(c.data[i * c.channels + k]));
      g.stroke();
    }
  };
  line(curve, [], false);
  if (slope) line(slope, [12, 8], true);
}

/* ---- the derivative */
async function drawGradient() {
  const component = $("component").value, curve1d = program.dim === 1;
  const off = !component || state.fit.running;
  $("overlay").hidden = off || curve1d;
  $("frame").classList.toggle("derived", !off && !curve1d);
  $("scale").hidden = off || curve1d;
  $("gain-row").hidden = off || curve1d;
  delete body.dataset.gradient;
  if (off) { if (slope) slope = null, curve && plot(); return; }
  const gain = 10 ** +$("gain").value;
  try {
    const r = await ask(`/gradient?component=${encodeURIComponent(component)}&gain=${gain}&format=${curve1d ? "f32" : "rgba"}`);
    const data = await r.arrayBuffer(), w = +r.headers.get("X-Saltus-Width");
    if (curve1d) {
      slope = { data: new Float32Array(data), n: w, channels: +r.headers.get("X-Saltus-Channels") };
      plot();
    } else {
      draw($("overlay"), data, w, +r.headers.get("X-Saltus-Height"));
      const scale = +r.headers.get("X-Saltus-Scale") / gain;
      $("scale-low").textContent = short(-scale);
      $("scale-high").textContent = "+" + short(scale);
    }
    body.dataset.gradient = r.headers.get("X-Saltus-Version");
  } catch (e) { say(e.message); }
}
function drawBar() {
  const knots = [[16, 44, 108], [40, 92, 168], [92, 146, 208], [164, 198, 232], [246, 246, 244], [240, 186, 160], [218, 122, 96], [178, 56, 56], [104, 14, 36]];
  const g = $("scale-bar").getContext("2d"), fill = g.createLinearGradient(0, 0, 256, 0);
  knots.forEach((k, i) => fill.addColorStop(i / 8, `rgb(${k})`));
  g.fillStyle = fill;
  g.fillRect(0, 0, 256, 1);
}

/* ---- controls */
const encode = v => v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055;
const decode = v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
const toHex = list => "#" + list.slice(0, 3).map(v => Math.round(255 * Math.min(1, Math.max(0, program.display ? v : encode(Math.max(0, v))))).toString(16).padStart(2, "0")).join("");
const fromHex = text => [1, 3, 5].map(i => parseInt(text.slice(i, i + 2), 16) / 255).map(v => program.display ? v : +decode(v).toPrecision(6));

function row(name, doc, ...inputs) {
  const label = element("label", { title: doc ? `${name}: ${doc}` : name }, name);
  if (inputs[0].id) label.htmlFor = inputs[0].id;
  return element("div", { class: "row" }, label, ...inputs);
}
const brief = v => { const a = Math.abs(v); return a >= 1e6 || (a && a < 1e-4) ? v.toExponential(4).replace(/\.?0*e/, "e") : String(+v.toPrecision(6)); };
function slider(param, name, path, span) {
  const log = param.log && span && span[0] > 0, whole = param.kind !== "float";
  const least = !whole ? -Infinity : param.kind === "uint" ? 0 : -(2 ** 31), most = !whole ? Infinity : param.kind === "uint" ? 2 ** 32 - 1 : 2 ** 31 - 1;
  const range = element("input", { type: "range", "data-name": path, "aria-label": path, min: 0, max: 1, step: whole ? 1 : "any" });
  const number = element("input", { type: "number", "data-number": path, "aria-label": path, step: whole ? 1 : "any" });
  let lo, hi;
  const to = v => log ? Math.log(v) : v, from = v => log ? Math.exp(v) : v;
  const limit = v => {
    if (span) [lo, hi] = span;
    else if (lo === undefined || v < lo || v > hi) { const m = Math.max(whole ? 8 : 1, Math.abs(v)); [lo, hi] = [Math.max(least, v - m), Math.min(most, v + m)]; }
    range.min = to(lo), range.max = to(hi);
  };
  range.addEventListener("input", () => { const v = whole ? Math.round(+range.value) : +from(+range.value).toPrecision(5); put(v); step(path, v); });
  const put = v => { number.value = whole ? v : brief(v); number.classList.toggle("long", number.value.length > 8); };
  number.addEventListener("change", () => {
    let v = +number.value;
    if (number.value === "" || !Number.isFinite(v)) { put(read(path)); return; }
    if (whole) v = Math.min(most, Math.max(least, Math.round(v)));
    limit(v);
    range.value = to(v);
    if (whole) put(v);
    step(path, v);
  });
  let told;
  controls.push({ refresh() {
    const v = read(path);
    if (!Number.isFinite(v)) { number.value = ""; return; }
    if (document.activeElement === number && v === told) return; /* what is being typed stays */
    told = v;
    limit(v);
    range.value = to(v);
    put(v);
  } });
  return row(name, param.doc, range, number);
}
function axisRange(param, axis) {
  if (param.range) return param.range;
  return isPoint(param) ? [program.lo[axis], program.hi[axis]] : null;
}
const base = type => type.replace(/\s*\[.*$/, "");
const vectorRank = param => /^(float|int|uint|bool)[234]x[234]$/.test(base(param.type)) ? 2 : /^(float|int|uint|bool)[234]$/.test(base(param.type)) ? 1 : 0;
const arrayRank = param => param.kind === "struct" ? param.shape.length : param.shape.length - vectorRank(param);
const isPoint = param => program.dim === 2 && param.kind === "float" && base(param.type) === "float2" && !param.color && !param.row;

function leaf(param, name, path) {
  const rank = vectorRank(param);
  if (rank > 1) {
    const group = element("div", { class: "group" }, element("div", { class: "name", title: param.doc || "" }, name)), shape = param.shape.slice(1);
    for (let i = 0; i < param.shape[0]; i++) group.append(leaf({ ...param, type: param.kind + shape[0], shape, row: true }, `row ${i}`, `${path}[${i}]`));
    return group;
  }
  if (param.kind === "bool" && !rank) {
    const box = element("input", { type: "checkbox", "data-name": path, "aria-label": path });
    box.addEventListener("change", () => step(path, box.checked));
    controls.push({ refresh() { box.checked = read(path); } });
    return row(name, param.doc, box);
  }
  if (!rank) return slider(param, name, path, param.range);
  const n = param.shape[param.shape.length - 1];
  if (param.color && n >= 3) {
    const picker = element("input", { type: "color", "data-name": path, "aria-label": path });
    picker.addEventListener("input", () => step(path, [...fromHex(picker.value), ...read(path).slice(3)]));
    controls.push({ refresh() { picker.value = toHex(read(path)); } });
    const line = row(name, param.doc, picker);
    return n === 3 ? line : element("div", {}, line, slider({ ...param, log: false }, name + ".w", path + ".w", [0, 1]));
  }
  const group = element("div", { class: "group" }, element("div", { class: "name", title: param.doc || "" }, name));
  const part = { ...param, type: param.kind, shape: [] };
  for (let i = 0; i < n; i++) {
    const at = `${path}.${AXES[i]}`;
    group.append(param.kind === "bool" ? leaf(part, AXES[i], at) : slider(param, AXES[i], at, axisRange(param, i)));
  }
  return group;
}
function one(param, name, path) {
  if (arrayRank(param)) return many(param, name, path);
  if (param.kind !== "struct") return leaf(param, name, path);
  const group = element("div", { class: "group" }, element("div", { class: "name", title: param.doc || "" }, name));
  for (const f of param.fields) group.append(one(f, f.name, `${path}.${f.name}`));
  return group;
}
/* An array shows one element, which is chosen. */
function many(param, name, path) {
  const holder = element("div", { class: "group", "data-array": path }), n = param.shape[0], at = chosen[path] = Math.min(chosen[path] || 0, n - 1);
  const number = element("input", { type: "number", min: 0, max: n - 1, value: at, "data-element": path, "aria-label": `element of ${path}` });
  number.addEventListener("change", () => choose(path, +number.value));
  const inner = { ...param, shape: param.shape.slice(1) }, shown = one(inner, `${name}[${at}]`, `${path}[${at}]`);
  holder.append(row(`${name} (${n})`, param.doc, number));
  if (param.kind === "struct" && !arrayRank(inner)) holder.append(...[...shown.children].slice(1));
  else holder.append(shown);
  return holder;
}
function choose(array, index) {
  chosen[array] = Math.max(0, Math.round(index) || 0);
  build();
  listComponents();
}
function build() {
  controls = [];
  const list = $("controls");
  list.replaceChildren();
  for (const p of program.parameters) {
    if (read(p.name) !== undefined && p.numbers > 0) list.append(one(p, p.name, p.name));
    else list.append(element("p", { class: "hint" }, `${p.name}: ${p.type}, ${p.numbers} numbers`));
  }
  if (!program.parameters.length) list.append(element("p", { class: "hint" }, "The shader has no parameters."));
  refresh();
}
function refresh() {
  for (const c of controls) c.refresh();
  drawPoints();
}

/* The components that a derivative may be of: those that are told, of arrays the chosen element. */
function components(param, path) {
  if (!param.differentiable || param.kind === "bool" || param.kind === "int" || param.kind === "uint") return [];
  if (arrayRank(param)) return components({ ...param, shape: param.shape.slice(1) }, `${path}[${Math.min(chosen[path] || 0, param.shape[0] - 1)}]`);
  if (param.kind === "struct") return param.fields.flatMap(f => components({ ...f, differentiable: f.kind === "float" || f.kind === "struct" }, `${path}.${f.name}`));
  const rank = vectorRank(param);
  if (rank > 1) return [...Array(param.shape[0]).keys()].flatMap(i => components({ ...param, type: param.kind + param.shape[1], shape: param.shape.slice(1) }, `${path}[${i}]`));
  return rank ? AXES.slice(0, param.shape[0]).map(a => `${path}.${a}`) : [path];
}
function listComponents() {
  const select = $("component"), before = select.value, fit = $("fit-parameters"), fitBefore = fit.value;
  const all = program.parameters.filter(p => read(p.name) !== undefined).flatMap(p => components(p, p.name));
  select.replaceChildren(element("option", { value: "" }, "none"), ...all.map(name => element("option", { value: name }, name)));
  /* Of another element of an array the same field. */
  const field = name => name.replace(/\[\d+\]/g, "[]"), same = all.includes(before) ? before : all.find(name => field(name) === field(before));
  if (same) select.value = same;
  if (before && select.value !== before) show();
  const names = program.parameters.filter(p => p.differentiable && p.numbers).map(p => p.name);
  fit.replaceChildren(element("option", { value: "" }, "all"), ...names.map(name => element("option", { value: name }, name)));
  if (names.includes(fitBefore)) fit.value = fitBefore;
}

/* ---- points in the domain */
const toFrame = p => [(p[0] - program.lo[0]) / (program.hi[0] - program.lo[0]), program.dim > 1 ? (program.hi[1] - p[1]) / (program.hi[1] - program.lo[1]) : 0.5];
const toDomain = (u, v) => [program.lo[0] + u * (program.hi[0] - program.lo[0]), program.dim > 1 ? program.hi[1] - v * (program.hi[1] - program.lo[1]) : 0];
function pointPaths(param, path) {
  if (arrayRank(param)) {
    const inner = { ...param, shape: param.shape.slice(1) };
    return param.shape[0] > POINTS ? [] : [...Array(param.shape[0]).keys()].flatMap(i => pointPaths(inner, `${path}[${i}]`));
  }
  if (param.kind === "struct") return param.fields.flatMap(f => pointPaths(f, `${path}.${f.name}`));
  return isPoint(param) ? [path] : [];
}
let handles = [], asked = null, crossing = null;
function makePoints() {
  const svg = $("points");
  handles = program.parameters.filter(p => read(p.name) !== undefined).flatMap(p => pointPaths(p, p.name)).slice(0, POINTS).map(path => {
    const circle = element("circle", { class: "handle", r: 6, "data-point": path });
    circle.append(document.createElementNS("http://www.w3.org/2000/svg", "title"));
    circle.firstChild.textContent = path;
    circle.addEventListener("pointerdown", e => dragPoint(e, circle, path));
    return { circle, path };
  });
  if (handles.length > 24) for (const h of handles) h.circle.setAttribute("r", 4);
  svg.replaceChildren(...handles.map(h => h.circle));
}
function drawPoints() {
  if (!program) return;
  const box = $("frame").getBoundingClientRect(), svg = $("points");
  for (const { circle, path } of handles) {
    const [u, v] = toFrame(read(path)), index = path.match(/^([\w.]+?)\[(\d+)\]/);
    circle.setAttribute("cx", u * box.width);
    circle.setAttribute("cy", v * box.height);
    circle.classList.toggle("chosen", !!index && chosen[index[1]] === +index[2]);
  }
  svg.querySelectorAll(".asked").forEach(e => e.remove());
  for (const [p, r] of [[asked, 7], [crossing, 3]]) {
    if (!p) continue;
    const [u, v] = toFrame(p);
    svg.append(element("circle", { class: "asked", r, cx: u * box.width, cy: v * box.height }));
  }
}
function dragPoint(e, circle, path) {
  e.preventDefault();
  e.stopPropagation();
  const index = path.match(/^([\w.]+?)\[(\d+)\]/);
  if (index && chosen[index[1]] !== +index[2]) { chosen[index[1]] = +index[2]; build(); listComponents(); }
  circle.setPointerCapture(e.pointerId);
  const move = m => {
    const box = $("frame").getBoundingClientRect();
    const clamp = x => Math.min(1, Math.max(0, x));
    const at = toDomain(clamp((m.clientX - box.left) / box.width), clamp((m.clientY - box.top) / box.height)).map(x => +x.toPrecision(6));
    step(path, at);
    refresh();
  };
  const end = () => { circle.removeEventListener("pointermove", move); circle.removeEventListener("pointerup", end); circle.removeEventListener("pointercancel", end); };
  circle.addEventListener("pointermove", move);
  circle.addEventListener("pointerup", end);
  circle.addEventListener("pointercancel", end);
}

/* ---- the story of a point */
async function inspect(u, v) {
  if (!program) return;
  const at = toDomain(u, v).slice(0, program.dim);
  if (program.dim === 3) at[2] = program.lo[2] + (state.slice + 0.5) * (program.hi[2] - program.lo[2]) / state.size[2];
  try {
    tell(await (await ask(`/point?at=${at.join(",")}`)).json());
  } catch (error) { $("point").replaceChildren(element("p", { class: "hint" }, error.message)); }
}
function tell(p) {
  const MOST = 40, table = element("table");
  const line = (a, b, c) => table.append(element("tr", {}, element("td", {}, a), element("td", {}, b), element("td", { class: "number" }, c)));
  line("x", "", p.x.map(short).join(", "));
  line("f", "", p.f.map(short).join(", "));
  for (const t of p.trace.slice(0, MOST)) {
    const site = program.sites[t.site] || {}, k = t.k.length ? ` [${t.k.join(", ")}]` : "";
    line(`line ${site.line || "?"}${k}`, element("code", {}, site.text || `site ${t.site}`), t.n === undefined ? `${short(t.g)} ${t.decision ? "yes" : "no"}` : `${short(t.g)} → ${short(t.n)}`);
  }
  if (p.trace.length > MOST) line("", `and ${p.trace.length - MOST} more decisions`, "");
  if (p.crossing) {
    const site = program.sites[p.crossing.site] || {};
    line("nearest jump", element("code", {}, site.text || ""), p.crossing.x.map(short).join(", "));
    line("", "before", p.crossing.before.map(short).join(", "));
    line("", "after", p.crossing.after.map(short).join(", "));
  } else line("nearest jump", "none within an eighth of the domain", "");
  $("point").replaceChildren(table);
  asked = p.x, crossing = p.crossing && p.crossing.x;
  drawPoints();
}

/* ---- cells */
let cellsAddress = null;
async function drawCells() {
  const img = $("cells"), on = $("show-cells").checked && program;
  if (!on) { img.hidden = true; return; }
  try {
    const blob = await (await ask("/cells")).blob();
    if (cellsAddress) URL.revokeObjectURL(cellsAddress);
    img.src = cellsAddress = URL.createObjectURL(blob);
    img.hidden = false;
  } catch (e) { say(e.message); $("show-cells").checked = false; }
}

/* ---- the fit */
let losses = [];
function takeFit(f) {
  losses.length = Math.min(losses.length, f.first);
  losses.push(...f.losses);
  const was = state.fit.running;
  state.fit = { ...f, losses: [] };
  body.dataset.fit = f.running ? "running" : f.done ? "done" : "";
  body.dataset.iterations = f.done;
  $("fit-start").disabled = f.running;
  $("fit-stop").disabled = !f.running;
  $("reset").disabled = f.running;
  for (const e of $("controls").querySelectorAll("input")) e.disabled = f.running;
  if (f.done || f.reason) $("fit-said").textContent = `${f.done} of ${f.iterations} iterations` + (f.best === null ? "" : `, best loss ${f.best.toPrecision(4)}`) + (f.running ? "" : `: ${f.reason}`);
  drawLosses();
  if (was !== f.running) show();
}
function drawLosses() {
  const svg = $("curve"), ok = losses.map(v => v > 0 ? Math.log10(v) : NaN), finite = ok.filter(Number.isFinite);
  svg.toggleAttribute("hidden", finite.length < 2);
  if (finite.length < 2) return;
  let lo = Infinity, hi = -Infinity;
  for (const v of finite) lo = Math.min(lo, v), hi = Math.max(hi, v);
  const span = hi - lo || 1, every = Math.max(1, Math.floor(ok.length / 600));
  const x = i => 40 + 256 * i / Math.max(1, ok.length - 1), y = v => 96 - 88 * (v - lo) / span;
  let d = "", pen = false;
  for (let i = 0; i < ok.length; i += every) {
    pen = pen && Number.isFinite(ok[i]);
    if (Number.isFinite(ok[i])) d += `${pen ? "L" : "M"}${x(i).toFixed(1)} ${y(ok[i]).toFixed(1)}`, pen = true;
  }
  const text = (px, py, t, anchor) => element("text", { x: px, y: py, "text-anchor": anchor }, t);
  svg.replaceChildren(element("line", { x1: 40, y1: 96, x2: 296, y2: 96 }), element("line", { x1: 40, y1: 8, x2: 40, y2: 96 }), element("path", { d }),
    text(36, 12, (10 ** hi).toPrecision(2), "end"), text(36, 96, (10 ** lo).toPrecision(2), "end"), text(296, 108, String(ok.length), "end"), text(40, 108, "1", "start"));
}
async function showTarget() {
  $("target").hidden = !state.target;
  if (state.target) $("target").src = `/target?token=${token}&at=${Date.now()}`;
}
async function sendTarget(path, options) {
  try {
    await ask(path, { method: "POST", ...options });
    state.target = true;
    showTarget();
    $("fit-said").textContent = "";
  } catch (e) { $("fit-said").textContent = e.message; }
}
async function startFit() {
  const name = $("fit-parameters").value;
  try {
    await post("/fit", { iterations: +$("fit-iterations").value, rate: +$("fit-rate").value, optimizer: $("fit-optimizer").value, ...(name ? { parameters: [name] } : {}) });
    $("fit-said").textContent = "";
  } catch (e) { $("fit-said").textContent = e.message; }
}

/* ---- what happens */
function layout() {
  if (!program) return;
  const stage = $("stage").getBoundingClientRect(), narrow = matchMedia("(max-width: 760px)").matches;
  const ratio = program.dim === 1 ? 2 : (program.hi[0] - program.lo[0]) / (program.hi[1] - program.lo[1]);
  const room = narrow ? 0.75 * innerHeight : Math.max(160, stage.height - 110 - ($("message").hidden ? 0 : Math.min(stage.height * 0.4, $("message").scrollHeight) + 10));
  const w = Math.min(stage.width - (narrow ? 28 : 40), room * ratio);
  $("frame").style.width = `${w}px`;
  $("frame").style.height = `${w / ratio}px`;
  $("image").style.imageRendering = state.size[0] * 3 < w * devicePixelRatio ? "pixelated" : "auto";
  drawPoints();
}
let asking = false, again = false;
async function takeState() {
  if (asking) { again = true; return; }
  asking = true;
  do {
    again = false;
    const next = await (await ask("/state")).json(), fresh = !state || next.generation !== state.generation;
    state = next;
    document.title = `${state.file} – saltus view`;
    $("file").textContent = state.file;
    $("status").textContent = { ready: "ready", compiling: "compiling …", error: program || state.program ? "errors: the last good image is shown" : "errors" }[state.status];
    body.dataset.status = state.status;
    $("message").textContent = state.message;
    $("message").hidden = !state.message;
    if (fresh && state.program) {
      program = state.program, values = state.values, slope = null, asked = crossing = null;
      $("entry").textContent = `${program.entry}, ${program.dim}D`;
      $("spp").replaceChildren(...[...new Set([1, 4, 16, 64, state.spp])].sort((a, b) => a - b).map(n => element("option", {}, String(n))));
      $("spp").value = String(state.spp);
      $("slice-row").hidden = program.dim !== 3;
      $("slice").max = state.size[2] - 1;
      $("slice").value = state.slice;
      $("slice-value").textContent = state.slice;
      build();
      makePoints();
      listComponents();
      losses = [];
      takeFit(state.fit);
      body.dataset.generation = state.generation;
      show();
    }
    showTarget();
    layout();
  } while (again);
  asking = false;
}
function listen() {
  const events = new EventSource(`/events?token=${token}`);
  events.addEventListener("program", () => takeState().catch(gone));
  /* What somebody else sets waits until nothing moves here. */
  let told = null, later = 0;
  const take = () => {
    later = 0;
    if (!told || !program || told.version < drawn) return;
    if (!state.fit.running && (running || performance.now() - lastStep < 100)) { later = setTimeout(take, 50); return; }
    values = told.values;
    refresh();
    if (told.version > drawn) show();
  };
  events.addEventListener("values", e => {
    told = JSON.parse(e.data);
    if (!later) take();
  });
  events.addEventListener("fit", e => { if (state) takeFit(JSON.parse(e.data)); });
  events.onerror = gone;
  events.onopen = () => { if (state) takeState().catch(gone); };
}
function gone() {
  asking = false;
  body.dataset.status = "gone";
  $("status").textContent = token ? "the viewer does not answer" : "the address lacks its token";
}

$("image").addEventListener("click", e => {
  const box = $("frame").getBoundingClientRect();
  inspect((e.clientX - box.left) / box.width, (e.clientY - box.top) / box.height);
});
$("image").addEventListener("keydown", e => {
  const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1], Enter: [0, 0] }[e.key];
  if (!way || !program) return;
  e.preventDefault();
  const at = asked ? toFrame(asked) : [0.5, 0.5], far = e.shiftKey ? 10 : 1, clamp = x => Math.min(1, Math.max(0, x));
  inspect(clamp(at[0] + far * way[0] / state.size[0]), clamp(at[1] + far * way[1] / state.size[1]));
});
$("image").addEventListener("pointermove", e => {
  if (!program) return;
  const box = $("frame").getBoundingClientRect();
  say(toDomain((e.clientX - box.left) / box.width, (e.clientY - box.top) / box.height).slice(0, program.dim === 1 ? 1 : 2).map(short).join(", "));
});
$("reset").addEventListener("click", () => { pending = {}; set("reset", true); });
$("save").addEventListener("click", async () => {
  const link = element("a", { download: "params.json", href: URL.createObjectURL(await (await ask("/params")).blob()) });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
});
$("spp").addEventListener("change", () => { state.spp = +$("spp").value; set("spp", state.spp); });
$("slice").addEventListener("input", () => { state.slice = +$("slice").value; $("slice-value").textContent = state.slice; set("slice", state.slice); });
$("component").addEventListener("change", show);
$("gain").addEventListener("input", show);
$("show-cells").addEventListener("change", drawCells);
$("target-file").addEventListener("change", e => { const file = e.target.files[0]; if (file) sendTarget(`/target?name=${encodeURIComponent(file.name)}`, { body: file }); });
$("target-current").addEventListener("click", () => sendTarget("/target?current=1", { body: "" }));
$("fit-start").addEventListener("click", startFit);
$("fit-stop").addEventListener("click", () => post("/fit/stop").catch(e => say(e.message)));
addEventListener("resize", layout);
drawBar();
takeState().then(listen, gone);
