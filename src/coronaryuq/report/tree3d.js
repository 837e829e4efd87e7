// The tree in 3D: tubes coloured by FFR with a dark edge at the limit, turned by mouse, finger or keys; and the
// reading of a pressure wire along a chosen artery. Without WebGL only the reading is drawn.
(() => {
  const data = JSON.parse(document.getElementById("scene-data").textContent);
  const stage = document.getElementById("scene");
  const make = (tag, properties = {}, ...children) => { const node = Object.assign(document.createElement(tag), properties); node.append(...children); return node; };
  const svg = (tag, attributes, text) => { const node = document.createElementNS("http:" + "//www.w3.org/2000/svg", tag); for (const name in attributes) node.setAttribute(name, attributes[name]); if (text !== undefined) node.textContent = text; return node; };
  const rgb = hex => [1, 3, 5].map(k => parseInt(hex.slice(k, k + 2), 16) / 255);
  const two = x => x.toFixed(2);
  const RING = "#e0218a", WIRE = "#ff5a1f"; // unlike every colour of FFR, and unlike the dark edge

  // ---- vectors
  const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]], add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2], cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = a => { const n = Math.hypot(...a) || 1; return [a[0] / n, a[1] / n, a[2] / n]; };

  const coronary = data.vessels.filter(vessel => !vessel.aorta);
  const all = coronary.flatMap(vessel => vessel.points);
  const low = [0, 1, 2].map(k => Math.min(...all.map(p => p[k]))), high = [0, 1, 2].map(k => Math.max(...all.map(p => p[k])));
  const centre = low.map((x, k) => (x + high[k]) / 2), size = Math.hypot(...sub(high, low)) / 2;

  // ---- reading along an artery
  const panel = make("div", { className: "pullback" });
  const choice = make("select"), what = make("select", {}, make("option", { value: "ffr", textContent: "FFR" }), make("option", { value: "flow", textContent: "mean flow" }));
  choice.setAttribute("aria-label", "Artery to read along");
  what.setAttribute("aria-label", "Quantity to read");
  data.pullbacks.forEach((pullback, k) => choice.append(make("option", { value: k, textContent: pullback.name })));
  const chart = make("div");
  panel.append(make("div", { className: "filters" }, make("span", { textContent: "Wire along" }), choice, what), chart);

  const drawChart = () => {
    const pullback = data.pullbacks[choice.value];
    if (!pullback || pullback.points.length < 2) { chart.textContent = "No reading along this artery."; return; }
    const flow = what.value === "flow", first = flow ? 4 : 1, points = pullback.points;
    const W = 420, H = 300, left = 58, right = 10, top = 12, bottom = 42;
    const end = points[points.length - 1][0];
    const lows = points.map(p => p[first]), highs = points.map(p => p[first + 2]);
    const wires = pullback.wires.filter(wire => wire.measured !== null);
    const y0 = flow ? 0 : Math.min(0.6, Math.floor(10 * Math.min(...lows, ...wires.map(wire => wire.measured - (wire.sd ?? 0)))) / 10), y1 = flow ? 1.05 * Math.max(...highs) : 1.0;
    const X = x => left + (W - left - right) * x / end, Y = y => H - bottom - (H - top - bottom) * (y - y0) / (y1 - y0);
    const path = k => points.map(p => `${X(p[0]).toFixed(1)},${Y(p[k]).toFixed(1)}`);
    const last = points[points.length - 1];
    const picture = svg("svg", { viewBox: `0 0 ${W} ${H}`, role: "img", "aria-label": flow
      ? `Mean flow from the ostium to the end of ${pullback.name}: ${last[5]} mL/min at the end, 90 % range ${last[4]} to ${last[6]}`
      : `FFR from the ostium to the end of ${pullback.name}: ${two(last[2])} at the end, 90 % range ${two(last[1])} to ${two(last[3])}` });
    const step = flow ? [1, 2, 5, 10, 20, 50, 100, 200].find(s => y1 / s <= 6) ?? 500 : 0.1;
    for (let y = y0; y <= y1 + 1e-9; y += step) {
      picture.append(svg("line", { class: "axis", x1: left - 4, x2: left, y1: Y(y), y2: Y(y) }), svg("text", { x: left - 7, y: Y(y) + 4, "text-anchor": "end" }, flow ? y.toFixed(0) : two(y)));
    }
    for (let x = 0; x <= end; x += end > 12 ? 4 : 2) picture.append(svg("line", { class: "axis", x1: X(x), x2: X(x), y1: H - bottom, y2: H - bottom + 4 }), svg("text", { x: X(x), y: H - bottom + 17, "text-anchor": "middle" }, x));
    picture.append(svg("line", { class: "axis", x1: left, x2: W - right, y1: H - bottom, y2: H - bottom }), svg("line", { class: "axis", x1: left, x2: left, y1: top, y2: H - bottom }));
    picture.append(svg("text", { x: (left + W) / 2, y: H - 8, "text-anchor": "middle" }, `distance from the ostium towards the end of ${pullback.name} (cm)`));
    picture.append(svg("text", { transform: `translate(13 ${(H - bottom) / 2}) rotate(-90)`, "text-anchor": "middle" }, flow ? "mean flow (mL/min)" : "FFR"));
    pullback.marks.forEach(mark => picture.append(svg("rect", { class: "lesion", x: X(mark.start), width: X(mark.end) - X(mark.start), y: H - bottom - 7, height: 7 }), svg("text", { x: X((mark.start + mark.end) / 2), y: H - bottom - 11, "text-anchor": "middle" }, mark.name)));
    picture.append(svg("polygon", { class: "band", points: [...path(first), ...path(first + 2).reverse()].join(" ") }), svg("polyline", { class: "median", points: path(first + 1).join(" ") }));
    if (!flow) picture.append(svg("line", { class: "limit", x1: left, x2: W - right, y1: Y(data.limit), y2: Y(data.limit) }));
    const median = x => { const k = Math.max(1, points.findIndex(p => p[0] >= x)), [a, b] = [points[k - 1], points[k]]; return a[first + 1] + (x - a[0]) / (b[0] - a[0] || 1) * (b[first + 1] - a[first + 1]); };
    pullback.marks.filter(mark => mark.read !== undefined).forEach(mark => picture.append(svg("circle", { class: "ring", r: 6, cx: X(mark.read), cy: Y(median(mark.read)) })));
    const diamond = (x, y, open) => svg("path", { class: open ? "wire open" : "wire", d: `M${x} ${y - 6}L${x + 6} ${y}L${x} ${y + 6}L${x - 6} ${y}Z` });
    pullback.wires.forEach(wire => { // on the median, and filled at what was measured
      const x = X(wire.at);
      if (!flow && wire.measured !== null) {
        picture.append(svg("line", { class: "wire", x1: x, x2: x, y1: Y(wire.measured - (wire.sd ?? 0)), y2: Y(wire.measured + (wire.sd ?? 0)) }), diamond(x, Y(wire.measured), false));
        picture.append(svg("text", { x: x - 9, y: Y(wire.measured) + 4, "text-anchor": "end" }, `measured ${two(wire.measured)}`));
      }
      picture.append(diamond(x, Y(median(wire.at)), true));
    });
    const cursor = svg("line", { class: "cursor", y1: top, y2: H - bottom, visibility: "hidden" }), told = svg("text", { x: W - right, y: top + 10, "text-anchor": "end" });
    picture.append(cursor, told);
    picture.addEventListener("pointermove", event => {
      const box = picture.getBoundingClientRect(), x = ((event.clientX - box.left) / box.width * W - left) / (W - left - right) * end;
      const near = points.reduce((a, b) => Math.abs(b[0] - x) < Math.abs(a[0] - x) ? b : a);
      cursor.setAttribute("x1", X(near[0])); cursor.setAttribute("x2", X(near[0])); cursor.setAttribute("visibility", "visible");
      told.textContent = `${near[0].toFixed(1)} cm: ` + (flow ? `${near[5]} (${near[4]} to ${near[6]}) mL/min` : `${two(near[2])} (${two(near[1])} to ${two(near[3])})`);
    });
    chart.replaceChildren(picture);
  };
  choice.onchange = what.onchange = () => { drawChart(); if (redraw) redraw(); };
  let redraw = null;

  const canvas = make("canvas", { className: "view", tabIndex: 0 });
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "The coronary tree coloured by FFR; arrow keys turn it");
  const gl = canvas.getContext("webgl", { antialias: true, preserveDrawingBuffer: true });
  if (!gl) {
    const picture = document.querySelector("#fig-tree_ffr img");
    const still = make("div", { className: "stage" });
    if (picture) still.append(make("img", { src: picture.src, alt: picture.alt }));
    stage.replaceChildren(still, panel);
    drawChart();
    return;
  }

  // ---- meshes: corner, normal, value (FFR, or -1 for a plain colour), colour
  const SIDES = 14;
  const tube = (points, radii, values, plain) => {
    const out = [], rings = [];
    let normal = null;
    points.forEach((p, k) => {
      const along = unit(sub(points[Math.min(k + 1, points.length - 1)], points[Math.max(k - 1, 0)]));
      const aside = normal ? unit(add(normal, along, -dot(normal, along))) : unit(cross(along, Math.abs(along[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]));
      normal = aside;
      const other = cross(along, aside);
      rings.push(Array.from({ length: SIDES }, (_, j) => { const a = 2 * Math.PI * j / SIDES, n = add([aside[0] * Math.cos(a), aside[1] * Math.cos(a), aside[2] * Math.cos(a)], other, Math.sin(a)); return { p: add(p, n, radii[k]), n, v: values ? values[k] : -1 }; }));
    });
    const put = (c) => out.push(...c.p, ...c.n, c.v, ...plain);
    for (let k = 0; k + 1 < rings.length; k++) for (let j = 0; j < SIDES; j++) {
      const i = (j + 1) % SIDES, [a, b, c, d] = [rings[k][j], rings[k + 1][j], rings[k + 1][i], rings[k][i]];
      [a, b, c, a, c, d].forEach(put);
    }
    [[rings[0], points[0]], [rings[rings.length - 1], points[points.length - 1]]].forEach(([ring, middle], last) => {
      const n = unit(sub(points[last ? points.length - 1 : 0], points[last ? points.length - 2 : 1]));
      for (let j = 0; j < SIDES; j++) [{ p: middle, n, v: ring[0].v }, { ...ring[j], n }, { ...ring[(j + 1) % SIDES], n }].forEach(put);
    });
    return out;
  };
  const ring = (point, normal, radius) => {
    const n = unit(normal), a = unit(cross(n, Math.abs(n[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0])), b = cross(n, a);
    const line = Array.from({ length: 33 }, (_, k) => add(add(point, a, radius * Math.cos(k * Math.PI / 16)), b, radius * Math.sin(k * Math.PI / 16)));
    return tube(line, line.map(() => 0.045), null, rgb(RING));
  };
  const octahedron = (point, radius) => {
    const out = [], tip = (k, sign) => [0, 1, 2].map(j => j === k ? sign : 0);
    for (const x of [1, -1]) for (const y of [1, -1]) for (const z of [1, -1]) {
      const n = unit([x, y, z]);
      [tip(0, x), tip(1, y), tip(2, z)].forEach(corner => out.push(...add(point, corner, radius), ...n, -1, ...rgb(WIRE)));
    }
    return out;
  };
  const solid = coronary.flatMap(vessel => {
    // An ostial artery starts on the aorta's centreline; what lies inside the aorta is not drawn.
    let length = 0, from = 0;
    for (let k = 1; k < vessel.points.length && length < vessel.start; k++) { length += Math.hypot(...sub(vessel.points[k], vessel.points[k - 1])); from = k; }
    return tube(vessel.points.slice(from), vessel.radii.slice(from), vessel.ffr.slice(from), [0, 0, 0]);
  });
  coronary.forEach(vessel => vessel.edges.forEach(edge => solid.push(...tube(edge.points, edge.radii, null, [0.05, 0.05, 0.05]))));
  data.lesions.forEach(lesion => { if (lesion.plane) solid.push(...ring(lesion.plane, lesion.normal, 1.7 * lesion.radius)); });
  data.wires.forEach(wire => solid.push(...octahedron(wire.point, Math.max(2 * wire.radius, 0.18))));
  const near = p => Math.hypot(...sub(p, centre)) < 1.15 * size;
  const ghost = data.vessels.filter(vessel => vessel.aorta).flatMap(vessel => { const inside = vessel.points.map(near), keep = list => list.filter((_, k) => inside[k]); return keep(vessel.points).length > 1 ? tube(keep(vessel.points), keep(vessel.radii), null, [0.62, 0.62, 0.62]) : []; });
  const wall = [];
  if (data.territories) {
    const { points, faces, outlet, colours } = data.territories, inks = colours.map(rgb);
    faces.forEach((face, k) => { const n = unit(cross(sub(points[face[1]], points[face[0]]), sub(points[face[2]], points[face[0]]))); face.forEach(corner => wall.push(...points[corner], ...n, -1, ...inks[outlet[k]])); });
  }

  const shader = (kind, text) => { const made = gl.createShader(kind); gl.shaderSource(made, text); gl.compileShader(made); if (!gl.getShaderParameter(made, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(made)); return made; };
  const program = gl.createProgram();
  gl.attachShader(program, shader(gl.VERTEX_SHADER, `attribute vec3 at; attribute vec3 normal; attribute float value; attribute vec3 plain;
    uniform mat3 turn; uniform vec3 centre; uniform vec2 scale; uniform float depth; varying vec3 n; varying float v; varying vec3 ink;
    void main() { vec3 p = turn * (at - centre); n = turn * normal; v = value; ink = plain; gl_Position = vec4(p.x * scale.x, p.y * scale.y, -p.z * depth, 1.0); }`));
  gl.attachShader(program, shader(gl.FRAGMENT_SHADER, `precision mediump float; varying vec3 n; varying float v; varying vec3 ink;
    uniform sampler2D colours; uniform vec2 range; uniform float alpha;
    void main() { vec3 base = ink;
      if (v >= 0.0) { base = texture2D(colours, vec2(clamp((v - range.x) / (range.y - range.x), 0.004, 0.996), 0.5)).rgb; }
      float light = 0.62 + 0.38 * abs(normalize(n).z); gl_FragColor = vec4(base * light, alpha); }`));
  gl.linkProgram(program);
  gl.useProgram(program);
  const place = name => gl.getUniformLocation(program, name);
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, data.colours.length, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, new Uint8Array(data.colours.flatMap(hex => rgb(hex).map(x => Math.round(255 * x)))));
  for (const [name, value] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR], [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]]) gl.texParameteri(gl.TEXTURE_2D, name, value);
  const loaded = list => { const buffer = gl.createBuffer(); gl.bindBuffer(gl.ARRAY_BUFFER, buffer); gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(list), gl.STATIC_DRAW); return { buffer, count: list.length / 10 }; };
  const parts = { solid: loaded(solid), ghost: loaded(ghost), wall: loaded(wall) };
  const paint = (part, alpha) => {
    if (!part.count) return;
    gl.bindBuffer(gl.ARRAY_BUFFER, part.buffer);
    [["at", 3, 0], ["normal", 3, 12], ["value", 1, 24], ["plain", 3, 28]].forEach(([name, n, offset]) => { const at = gl.getAttribLocation(program, name); if (at >= 0) { gl.enableVertexAttribArray(at); gl.vertexAttribPointer(at, n, gl.FLOAT, false, 40, offset); } });
    gl.uniform1f(place("alpha"), alpha);
    gl.drawArrays(gl.TRIANGLES, 0, part.count);
  };

  // ---- view: rows of the rotation are right, up and towards the reader; the first view is from the front
  const toward = unit([0.65, -1.0, 0.2]), right = unit(cross([0, 0, 1], toward));
  const home = [right, cross(toward, right), toward];
  const START = 1.25;
  let turn = home.map(row => [...row]), zoom = START;
  const box = make("div", { className: "stage" }, canvas);
  const tip = make("div", { className: "tip", hidden: true });
  const leaders = svg("svg", { class: "leaders", "aria-hidden": "true" });
  box.append(leaders);
  const tagged = [...data.lesions, ...data.wires.map(wire => ({ name: `wire: ${wire.name}`, point: wire.point }))];
  const lines = tagged.map(() => { const line = svg("line", {}); leaders.append(line); return line; });
  const tags = tagged.map(lesion => { const tag = make("div", { className: "tag", textContent: lesion.name }); box.append(tag); return tag; });
  const tools = make("div", { className: "tools" });
  const front = make("button", { type: "button", textContent: "Front" });
  front.onclick = () => { turn = home.map(row => [...row]); zoom = START; redraw(); };
  tools.append(front);
  let shown = false;
  if (wall.length) {
    const toggle = make("button", { type: "button", textContent: "Show territories" });
    toggle.setAttribute("aria-pressed", "false");
    toggle.onclick = () => { shown = !shown; toggle.textContent = shown ? "Hide territories" : "Show territories"; toggle.setAttribute("aria-pressed", String(shown)); redraw(); };
    tools.append(toggle);
  }
  box.append(tip, tools);
  const legend = make("div", { className: "bar-scale" });
  const drawn = svg("svg", { viewBox: "0 0 54 300", preserveAspectRatio: "xMidYMid meet", "aria-hidden": "true" });
  const Y = value => 286 - 262 * (value - data.range[0]) / (data.range[1] - data.range[0]);
  data.colours.forEach((ink, k) => drawn.append(svg("rect", { x: 36, width: 14, y: 286 - 262 * (k + 1) / data.colours.length, height: 262 / data.colours.length + 0.5, fill: ink })));
  [0.6, 0.7, 0.8, 0.9, 1.0].filter(value => value >= data.range[0]).forEach(value => drawn.append(svg("text", { x: 32, y: Y(value) + 4, "text-anchor": "end" }, two(value))));
  drawn.append(svg("rect", { x: 34, width: 18, y: Y(data.limit) - 2, height: 4, fill: "#111" }), svg("text", { x: 50, y: 14, "text-anchor": "end" }, "FFR"));
  legend.append(drawn);
  box.append(legend);
  stage.replaceChildren(box, panel);

  const seen = p => { const q = sub(p, centre), s = zoom / size, w = canvas.clientWidth, h = canvas.clientHeight, a = Math.min(w, h) / 2 * 0.95 * s; return { x: w / 2 + a * dot(turn[0], q), y: h / 2 - a * dot(turn[1], q), z: dot(turn[2], q) }; };
  redraw = () => {
    const ratio = Math.min(devicePixelRatio || 1, 2), w = canvas.clientWidth, h = canvas.clientHeight;
    if (!w || !h || matchMedia("print").matches) return;
    stage.style.setProperty("--aspect", w / h); // a printed page shows this picture at another size
    if (canvas.width !== Math.round(w * ratio)) { canvas.width = Math.round(w * ratio); canvas.height = Math.round(h * ratio); }
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    const s = 0.95 * zoom / size, m = Math.min(w, h);
    gl.uniformMatrix3fv(place("turn"), false, [0, 1, 2].flatMap(k => turn.map(row => row[k])));
    gl.uniform3fv(place("centre"), centre);
    gl.uniform2f(place("scale"), s * m / w, s * m / h);
    gl.uniform1f(place("depth"), 0.25 / size);
    gl.uniform2fv(place("range"), data.range);
    gl.disable(gl.BLEND);
    paint(parts.solid, 1);
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    paint(parts.ghost, 0.35);
    gl.depthMask(true);
    if (shown) paint(parts.wall, 0.45);
    tagged.forEach((lesion, k) => {
      const q = seen(lesion.point), away = q.x > w / 2 ? 1 : -1;
      const x = q.x + 34 * away;
      tags[k].style.left = `${100 * Math.min(Math.max(x, 24), w - 24) / w}%`;
      tags[k].style.top = `${100 * (q.y - 16) / h}%`;
      const ends = { x1: `${100 * q.x / w}%`, y1: `${100 * q.y / h}%`, x2: tags[k].style.left, y2: tags[k].style.top };
      for (const name in ends) lines[k].setAttribute(name, ends[name]);
      lines[k].setAttribute("visibility", x < 0 || x > w || q.y < 16 || q.y > h ? "hidden" : "visible");
      tags[k].hidden = x < 0 || x > w || q.y < 16 || q.y > h;
    });
  };
  const spin = (dx, dy) => { // about the view's own axes
    const rotate = (i, j, angle) => { const c = Math.cos(angle), s = Math.sin(angle), a = turn[i], b = turn[j]; turn[i] = [0, 1, 2].map(k => c * a[k] - s * b[k]); turn[j] = [0, 1, 2].map(k => s * a[k] + c * b[k]); };
    rotate(2, 0, -dx); rotate(1, 2, -dy);
    redraw();
  };
  const point = event => {
    const at = canvas.getBoundingClientRect(), x = event.clientX - at.left, y = event.clientY - at.top;
    let best = null;
    for (const vessel of coronary) vessel.points.forEach((p, k) => { const q = seen(p), d = Math.hypot(q.x - x, q.y - y); if (d < 14 && (!best || q.z > best.q.z + 0.3 || (d < best.d && q.z > best.q.z - 0.3))) best = { vessel, k, q, d }; });
    tip.hidden = !best;
    if (!best) return null;
    const { vessel, k } = best;
    tip.textContent = `${vessel.name}: FFR ${two(vessel.ffr[k])} (${two(vessel.ffr_low[k])} to ${two(vessel.ffr_high[k])}), mean flow ${vessel.flow[k]} mL/min`;
    tip.style.left = `${Math.min(best.q.x + 12, canvas.clientWidth - 190)}px`;
    tip.style.top = `${Math.max(best.q.y - 44, 4)}px`;
    return vessel;
  };
  const held = new Map();
  let moved = 0;
  canvas.addEventListener("pointerdown", event => { canvas.setPointerCapture(event.pointerId); held.set(event.pointerId, [event.clientX, event.clientY]); moved = 0; });
  canvas.addEventListener("pointermove", event => {
    const before = held.get(event.pointerId);
    if (!before) { point(event); return; }
    const now = [event.clientX, event.clientY];
    if (held.size === 2) {
      const other = [...held].find(([id]) => id !== event.pointerId)[1];
      zoom = Math.min(8, Math.max(0.5, zoom * Math.hypot(now[0] - other[0], now[1] - other[1]) / Math.max(1, Math.hypot(before[0] - other[0], before[1] - other[1]))));
      redraw();
    } else spin((now[0] - before[0]) * 0.008, (now[1] - before[1]) * 0.008);
    moved += Math.hypot(now[0] - before[0], now[1] - before[1]);
    held.set(event.pointerId, now);
  });
  const release = event => {
    held.delete(event.pointerId);
    if (moved > 4 || event.type !== "pointerup") return;
    const vessel = point(event), k = vessel ? data.pullbacks.findIndex(pullback => pullback.vessel === vessel.id || pullback.name === vessel.name) : -1;
    if (k >= 0) { choice.value = k; drawChart(); }
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("pointerleave", () => { tip.hidden = true; });
  canvas.addEventListener("wheel", event => { event.preventDefault(); zoom = Math.min(8, Math.max(0.5, zoom * Math.exp(-event.deltaY * 0.0012))); redraw(); }, { passive: false });
  canvas.addEventListener("keydown", event => { const step = { ArrowLeft: [-0.12, 0], ArrowRight: [0.12, 0], ArrowUp: [0, -0.12], ArrowDown: [0, 0.12] }[event.key]; if (step) { event.preventDefault(); spin(...step); } });
  new ResizeObserver(redraw).observe(canvas);
  drawChart();
  redraw();
})();
