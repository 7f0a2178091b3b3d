// What moves in a run's report: wipes between photo and rendering, cameras and points in space.
(function () {
  "use strict";
  const root = document.documentElement;
  window.addEventListener("error", (e) => { root.dataset.error = e.message; });

  function element(tag, name, parent) {
    const made = document.createElement(tag);
    if (name) made.className = name;
    if (parent) parent.append(made);
    return made;
  }

  // --- Wipes: the photo on the left of the line, on the right one of the other pictures.
  function wipe(view) {
    const parts = {};
    for (const figure of view.querySelectorAll("figure[data-part]")) parts[figure.dataset.part] = figure;
    if (!parts.photo || !parts.rendering) return;
    const holder = element("div");
    const box = element("div", "wipe", holder);
    const under = element("img", "", box), over = element("img", "over", box);
    under.src = parts.photo.querySelector("img").src;
    under.alt = "photo";
    const line = element("i", "", box);
    element("span", "left", box).textContent = "photo";
    const right = element("span", "right", box);
    const range = element("input", "wipe-range", holder);
    range.type = "range";
    range.min = 0;
    range.max = 100;
    range.step = 0.5;
    range.setAttribute("aria-label", "how much of the photo is shown, percent");

    function show() {
      over.style.clipPath = "inset(0 0 0 " + range.value + "%)";
      line.style.left = range.value + "%";
    }
    function choose(name) {
      over.src = parts[name].querySelector("img").src;
      over.alt = name;
      right.textContent = name;
      for (const key in parts) parts[key].classList.toggle("chosen", key === name);
    }
    function follow(e) {
      const r = box.getBoundingClientRect();
      range.value = 100 * (e.clientX - r.left) / r.width;
      show();
    }
    box.addEventListener("pointerdown", (e) => {
      try { box.setPointerCapture(e.pointerId); } catch { /* a pointer that is gone */ }
      e.preventDefault();
      follow(e);
    });
    box.addEventListener("pointermove", (e) => { if (e.buttons) follow(e); });
    range.addEventListener("input", show);
    for (const key in parts)
      if (key !== "photo") parts[key].addEventListener("click", () => choose(key));
    range.value = 50;
    choose("rendering");
    show();
    view.prepend(holder);
    view.classList.add("live");
  }
  document.querySelectorAll(".view").forEach(wipe);

  // --- Cameras and points. Axes: x and y level, z up, the origin in what the cameras look at; unit: the capture's.
  function plot(data, canvas) {
    const context = canvas.getContext("2d"), label = canvas.parentNode.querySelector("output");
    const start = { yaw: 0.7, pitch: 0.5, zoom: 1, x: 0, y: 0 };
    let eye = { ...start }, colours = {}, width = 1, height = 1, waiting = false, tips = [];

    // A point on the canvas, and how large a unit is there; null behind the eye.
    function place(p) {
      const [x, y, z] = p;
      const c = Math.cos(eye.yaw), s = Math.sin(eye.yaw);
      const u = c * x + s * y, v = c * y - s * x;
      const cp = Math.cos(eye.pitch), sp = Math.sin(eye.pitch);
      const far = v * cp - z * sp, up = v * sp + z * cp, distance = 4 * data.radius;
      const depth = far + distance;
      if (depth < 0.02 * distance) return null;
      const unit = eye.zoom * 0.45 * Math.min(width, height) / data.radius * distance / depth;
      return [width / 2 + eye.x + u * unit, height / 2 + eye.y - up * unit, unit];
    }
    function path(points, close) {
      const at = points.map(place);
      if (at.includes(null)) return;
      context.beginPath();
      at.forEach((p, i) => (i ? context.lineTo(p[0], p[1]) : context.moveTo(p[0], p[1])));
      if (close) context.closePath();
      context.stroke();
    }
    function corners(camera) {
      const size = 0.05 * data.radius, r = camera.rotation, out = [];
      const wide = Math.max(camera.half[0], camera.half[1]) || 1;
      for (const [a, b] of [[-1, -1], [1, -1], [1, 1], [-1, 1]]) {
        const d = [a * camera.half[0] / wide, b * camera.half[1] / wide, 1 / wide];
        const length = size / Math.hypot(1, d[2]);
        out.push([0, 1, 2].map((k) =>
          camera.at[k] + length * (r[3 * k] * d[0] + r[3 * k + 1] * d[1] + r[3 * k + 2] * d[2])));
      }
      return out;
    }
    function draw() {
      waiting = false;
      const ratio = window.devicePixelRatio || 1, box = canvas.getBoundingClientRect();
      width = Math.max(1, box.width);
      height = Math.max(1, box.height);
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
      context.setTransform(ratio, 0, 0, ratio, 0, 0);
      const style = getComputedStyle(root);
      for (const name of ["text", "line", "quiet", "train", "held-out"])
        colours[name] = style.getPropertyValue("--" + name).trim();
      context.strokeStyle = colours.line;
      context.lineWidth = 1;
      const n = data.grid.count, step = data.grid.step, g = data.grid;
      for (let i = -n; i <= n; ++i) {
        path([[i * step, -n * step, g.z], [i * step, n * step, g.z]]);
        path([[-n * step, i * step, g.z], [n * step, i * step, g.z]]);
      }
      context.fillStyle = colours.text;
      context.globalAlpha = 0.55;
      const p = data.points;
      for (let i = 0; i + 2 < p.length; i += 3) {
        const at = place([p[i], p[i + 1], p[i + 2]]);
        if (at) context.fillRect(at[0], at[1], 1.6, 1.6);
      }
      context.globalAlpha = 1;
      tips = [];
      for (const camera of data.cameras) {
        const tip = place(camera.at);
        if (!tip) continue;
        tips.push([tip[0], tip[1], camera]);
        context.strokeStyle = context.fillStyle = colours[camera.held_out ? "held-out" : "train"];
        const four = corners(camera);
        path(four, true);
        for (const corner of four) path([camera.at, corner]);
        context.fillRect(tip[0] - 2, tip[1] - 2, 4, 4);
      }
    }
    function redraw() {
      if (!waiting) requestAnimationFrame(draw);
      waiting = true;
    }
    function nearest(e) {
      const box = canvas.getBoundingClientRect();
      let best = null, least = 14;
      for (const [x, y, camera] of tips) {
        const d = Math.hypot(x - (e.clientX - box.left), y - (e.clientY - box.top));
        if (d < least) [least, best] = [d, camera];
      }
      return best;
    }

    const down = new Map();
    let moved = 0;
    canvas.addEventListener("pointerdown", (e) => {
      try { canvas.setPointerCapture(e.pointerId); } catch { /* a pointer that is gone */ }
      down.set(e.pointerId, [e.clientX, e.clientY]);
      moved = 0;
    });
    canvas.addEventListener("pointermove", (e) => {
      const was = down.get(e.pointerId);
      if (!was) {
        const camera = nearest(e);
        label.textContent = camera ? camera.name + (camera.held_out ? " (held out)" : "") : "";
        return;
      }
      const dx = e.clientX - was[0], dy = e.clientY - was[1];
      moved += Math.abs(dx) + Math.abs(dy);
      if (down.size === 2) {  // two fingers: their distance zooms, their middle shifts
        const other = [...down].find(([id]) => id !== e.pointerId)[1];
        const before = Math.hypot(was[0] - other[0], was[1] - other[1]);
        const after = Math.hypot(e.clientX - other[0], e.clientY - other[1]);
        if (before > 0) zoom(after / before);
        eye.x += dx / 2;
        eye.y += dy / 2;
      } else if (e.shiftKey || e.buttons === 2) {
        eye.x += dx;
        eye.y += dy;
      } else {
        eye.yaw += 0.008 * dx;
        eye.pitch = Math.min(1.57, Math.max(-1.57, eye.pitch + 0.008 * dy));
      }
      down.set(e.pointerId, [e.clientX, e.clientY]);
      redraw();
    });
    function zoom(factor) { eye.zoom = Math.min(200, Math.max(0.05, eye.zoom * factor)); }
    function up(e) { down.delete(e.pointerId); }
    canvas.addEventListener("pointerup", up);
    canvas.addEventListener("pointercancel", up);
    canvas.addEventListener("contextmenu", (e) => e.preventDefault());
    canvas.addEventListener("click", (e) => {
      const camera = moved < 6 ? nearest(e) : null;
      const target = camera && camera.view && document.getElementById(camera.view);
      if (target) target.scrollIntoView({ behavior: "smooth" });
    });
    canvas.addEventListener("wheel", (e) => {
      e.preventDefault();
      zoom(Math.exp(-0.0015 * e.deltaY));
      redraw();
    }, { passive: false });
    canvas.addEventListener("dblclick", () => { eye = { ...start }; redraw(); });
    canvas.addEventListener("keydown", (e) => {
      const turn = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[e.key];
      if (turn) {
        eye.yaw += turn[0];
        eye.pitch = Math.min(1.57, Math.max(-1.57, eye.pitch + turn[1]));
      } else if (e.key === "+" || e.key === "-") {
        zoom(e.key === "+" ? 1.2 : 1 / 1.2);
      } else {
        return;
      }
      e.preventDefault();
      redraw();
    });
    window.addEventListener("resize", redraw);
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
    draw();
  }
  const data = document.getElementById("space-data"), canvas = document.querySelector(".plot canvas");
  if (data && canvas) plot(JSON.parse(data.textContent), canvas);
  root.dataset.ready = "yes";
})();
