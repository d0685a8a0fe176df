// Meshes that a reader turns. Every figure.viewer with data becomes a view;
// bokashiViewer(figure).show(data) shows other data. Nothing is drawn until something changed.
"use strict";
const bokashiViewer = (() => {
  const drawing = bokashiDrawing;
  const clamped = (x, low, high) => Math.min(Math.max(x, low), high);

  function view(figure) {
    const box = figure.querySelector("div");
    if (!drawing.ready()) {
      box.firstElementChild.textContent = "Here stands a mesh to turn and to zoom, which needs WebGL 2: " +
        "this browser has none, or it is off.";
      return { async show() {} };
    }
    const canvas = document.createElement("canvas"), bar = document.createElement("div");
    const help = document.createElement("small");
    const caption = figure.querySelector("figcaption")?.textContent || "A mesh";
    const says = `${caption}. Arrow keys turn the mesh, + and - zoom, Home resets.`;
    const labels = { role: "application", tabindex: 0, "aria-roledescription": "mesh to turn", "aria-label": says };
    for (const name in labels) canvas.setAttribute(name, labels[name]);
    bar.setAttribute("role", "group");
    bar.setAttribute("aria-label", "What is drawn");
    const buttons = ["Texture", "Shape", "Edges"].map((name, number) => {
      const button = bar.appendChild(document.createElement("button"));
      Object.assign(button, { type: "button", textContent: name, onclick() { look = number; change(); } });
      return button;
    });
    help.textContent = "Turn: drag, or arrow keys. Zoom: wheel, two fingers, or + and −. " +
      "Reset: double click, or Home.";
    box.replaceChildren(canvas, bar, help);

    let parts = [], fit = null, middle, radius, look = 0, frame = 0, yaw, pitch, zoom, shift, moved, last;
    const pointers = new Map();

    // Draws at the next frame, once, however much changes before it.
    function change() { frame ||= requestAnimationFrame(draw); }

    function reset() {
      [yaw, pitch, zoom, shift, moved] = [-0.6, 0.4, 1, [0, 0], false];
      if (fit) ({ middle, radius } = fit);
      change();
    }

    function turn(right, down) {
      [yaw, pitch, moved] = [yaw + right, clamped(pitch + down, -Math.PI / 2, Math.PI / 2), true];
      change();
    }

    // Leaves what is seen at a point there; the whole stays in sight. Whether anything changed.
    function magnify(factor, point = [0, 0]) {
      const next = clamped(zoom * factor, 0.3, 60), real = next / zoom, most = Math.max(next - 1, 0);
      shift = shift.map((x, k) => clamped(point[k] - (point[k] - x) * real, -most, most));
      [zoom, moved] = [next, true];
      change();
      return real !== 1;
    }

    function draw() {
      frame = 0;
      if (!fit) return;
      const offset = fit.middle.map((x, k) => x - middle[k]);
      drawing.draw(canvas, parts, { yaw, pitch, zoom, shift, offset, radius, reach: fit.radius, look });
      buttons.forEach((button, number) => button.setAttribute("aria-pressed", number === look));
    }

    // Data are as Rust's viewer_data writes them. A view that the reader chose stays.
    async function show(data) {
      last = data;
      const next = await Promise.all(data.meshes.map(drawing.corners));
      if (last !== data) return;
      drawing.release(parts);
      parts = next;
      fit = drawing.bounds(parts);
      const alike = middle && Math.abs(Math.log(fit.radius / radius)) < 0.1 &&
        Math.hypot(...middle.map((x, k) => x - fit.middle[k])) < 0.1 * radius;
      if (!middle || (!moved && !alike)) ({ middle, radius } = fit);
      const textured = parts.some((part) => part.image), colored = parts.some((part) => part.colors);
      buttons[0].textContent = textured || !colored ? "Texture" : "Colours";
      buttons[0].hidden = !textured && !colored;
      if (buttons[0].hidden && look === 0) look = 1;
      upload();
    }

    function upload() {
      if (fit) drawing.upload(parts, fit.middle);
      change();
    }

    const place = (event) => {
      const { left, top, width, height } = canvas.getBoundingClientRect();
      return [2 * (event.clientX - left) / width - 1, 1 - 2 * (event.clientY - top) / height];
    };
    const on = (name, listener) => canvas.addEventListener(name, listener, { passive: false });
    on("pointerdown", (event) => {
      if (event.button !== 0) return;
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, place(event));
    });
    for (const name of ["pointerup", "pointercancel"]) on(name, (event) => pointers.delete(event.pointerId));
    on("pointermove", (event) => {
      const before = pointers.get(event.pointerId), after = place(event);
      if (!before) return;
      pointers.set(event.pointerId, after);
      const other = [...pointers].find(([id]) => id !== event.pointerId)?.[1];
      if (!other) return turn(2 * (after[0] - before[0]), 2 * (before[1] - after[1]));
      const apart = (p) => Math.max(Math.hypot(p[0] - other[0], p[1] - other[1]), 0.01);
      shift = shift.map((x, k) => x + (after[k] - before[k]) / 2);
      magnify(apart(after) / apart(before), after.map((x, k) => (x + other[k]) / 2));
    });
    on("wheel", (event) => {
      const factor = Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.002));
      if (magnify(factor, place(event))) event.preventDefault(); // at the end the page scrolls again
    });
    on("dblclick", reset);
    on("keydown", (event) => {
      const does = {
        ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0), ArrowUp: () => turn(0, -0.1),
        ArrowDown: () => turn(0, 0.1), Home: reset, "+": () => magnify(1.15), "=": () => magnify(1.15),
        "-": () => magnify(1 / 1.15),
      }[event.key];
      if (!does || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      does();
    });
    new ResizeObserver(change).observe(canvas);
    drawing.all.add(upload);
    reset();
    return { show };
  }

  for (const figure of document.querySelectorAll("figure.viewer")) {
    const data = figure.querySelector("script[type='application/json']");
    if (data) view(figure).show(JSON.parse(data.textContent));
  }
  return view;
})();
