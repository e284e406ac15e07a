// Links the figures over time with the scene: one moment for all, shown by a line in each figure and by the vehicles
// and the camera's view in the scene. "moving" holds times (s), positions (m) and orientations (body to world, scalar
// first) of each run.
(() => {
  "use strict";
  const moving = JSON.parse(document.getElementById("moving").textContent);
  const scene = document.getElementById("figure-scene");
  const series = [...document.querySelectorAll(".series .js-plotly-plot")];
  const slider = document.getElementById("time"), play = document.getElementById("play");
  const output = document.getElementById("now");
  const [first, last] = moving.span;
  const asked = Number(new URLSearchParams(location.hash.slice(1)).get("t"));  // report.html#t=4.2 shows that moment
  let now = Math.min(Math.max(asked || 0, first), last), drawing = false, playing = 0;

  function rotate(q, v) {
    const [w, x, y, z] = q;
    const tx = 2 * (y * v[2] - z * v[1]), ty = 2 * (z * v[0] - x * v[2]), tz = 2 * (x * v[1] - y * v[0]);
    return [v[0] + w * tx + y * tz - z * ty, v[1] + w * ty + z * tx - x * tz, v[2] + w * tz + x * ty - y * tx];
  }

  // Where a run is at a time, between the two samples around it; before its first and after its last it stands there.
  function at(run, time) {
    const t = run.time;
    let low = 0, high = t.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (t[middle] <= time) low = middle; else high = middle;
    }
    const gap = t[high] - t[low];
    const part = gap > 0 ? Math.min(Math.max((time - t[low]) / gap, 0), 1) : 0;
    const mix = (a, b) => a.map((value, i) => value + part * (b[i] - value));
    const a = run.orientation[low], b = run.orientation[high];
    const sign = a.reduce((sum, value, i) => sum + value * b[i], 0) < 0 ? -1 : 1;
    const q = mix(a, b.map((value) => sign * value)), length = Math.hypot(...q) || 1;
    return {
      position: mix(run.position[low], run.position[high]),
      orientation: q.map((value) => value / length),
      speed: run.speed[low] + part * (run.speed[high] - run.speed[low]),
    };
  }

  const gap = [null, null, null];
  const columns = (points) => [0, 1, 2].map((axis) => points.map((point) => point[axis]));

  function inWorld(state, point) {
    return rotate(state.orientation, point).map((value, axis) => value + state.position[axis]);
  }

  // Two arms across, the nose, and a plumb line to the ground.
  function vehicle(state) {
    const r = moving.arm, place = (x, y) => inWorld(state, [x * r, y * r, 0]);
    const ground = [state.position[0], state.position[1], 0];
    return [place(1, 1), place(-1, -1), gap, place(1, -1), place(-1, 1), gap,
            state.position, place(2.2, 0), gap, state.position, ground];
  }

  function view(state) {
    const apex = inWorld(state, moving.view.apex), c = moving.view.corners.map((corner) => inWorld(state, corner));
    return [apex, c[0], c[1], apex, c[2], c[3], apex, gap, c[1], c[2], gap, c[3], c[0]];
  }

  function drawScene() {
    const states = moving.runs.map((run) => at(run, now));
    const lines = states.map(vehicle);
    lines.push(moving.view && states.length === 1 ? view(states[0]) : [gap]);
    const all = lines.map(columns), count = scene.data.length;
    const indices = all.map((_, i) => count - all.length + i);
    Plotly.restyle(scene, {x: all.map((c) => c[0]), y: all.map((c) => c[1]), z: all.map((c) => c[2])}, indices);
    tell(states);
  }

  function tell(states) {
    const [state] = states, fixed = (value, digits) => value.toFixed(digits);
    const place = state.position.map((value) => fixed(value, 2)).join(", ");
    output.textContent = states.length === 1
      ? `${fixed(now, 2)} s · (${place}) m · ${fixed(state.speed, 2)} m/s`
      : `${fixed(now, 2)} s · ${states.map((s) => fixed(s.speed, 1)).join(", ")} m/s`;
  }

  function drawLine(figure) {
    const axis = figure._fullLayout.xaxis, size = figure._fullLayout._size, x = axis.d2p(now);
    const line = figure.cursorLine;
    line.hidden = !(x >= 0 && x <= axis._length);
    line.style.left = `${axis._offset + x}px`;
    line.style.top = `${size.t}px`;
    line.style.height = `${size.h}px`;
  }

  function show(time) {
    now = Math.min(Math.max(time, first), last);
    if (drawing) return;
    drawing = true;
    requestAnimationFrame(() => {
      drawing = false;
      slider.value = now;
      series.forEach(drawLine);
      drawScene();
    });
  }

  // All figures over time show the same stretch of it.
  let following = false;
  function follow(source, change) {
    if (following) return;
    const range = ["xaxis.range[0]", "xaxis.range[1]"];
    const whole = change["xaxis.autorange"];
    if (!(range[0] in change) && !whole) return;
    const update = whole ? {"xaxis.range": [first, last]} : {[range[0]]: change[range[0]], [range[1]]: change[range[1]]};
    following = true;
    Promise.all(series.filter((figure) => whole || figure !== source).map((figure) => Plotly.relayout(figure, update)))
      .finally(() => { following = false; series.forEach(drawLine); });
  }

  function link(figure) {
    const line = document.createElement("div");
    line.className = "cursor";
    figure.cursorLine = figure.appendChild(line);
    const point = (event) => {
      const axis = figure._fullLayout.xaxis;
      const x = event.clientX - figure.getBoundingClientRect().left - axis._offset;
      if (x >= 0 && x <= axis._length) { stop(); show(axis.p2d(x)); }
    };
    figure.addEventListener("pointermove", point);
    figure.addEventListener("pointerdown", point);
    figure.on("plotly_relayout", (change) => follow(figure, change));
    figure.on("plotly_afterplot", () => drawLine(figure));
  }

  function stop() { cancelAnimationFrame(playing); playing = 0; play.textContent = "▶"; }

  function start() {
    const begun = performance.now(), from = now >= last ? first : now;
    const step = () => {
      const time = from + (performance.now() - begun) / 1000;
      show(time);
      if (time >= last) stop(); else playing = requestAnimationFrame(step);
    };
    play.textContent = "⏸";
    playing = requestAnimationFrame(step);
  }

  slider.min = first;
  slider.max = last;
  slider.addEventListener("input", () => { stop(); show(Number(slider.value)); });
  play.addEventListener("click", () => (playing ? stop() : start()));
  scene.on("plotly_hover", (event) => {
    const time = event.points[0].customdata;
    if (typeof time === "number" && !playing) show(time);
  });
  series.forEach(link);
  show(now);
})();
