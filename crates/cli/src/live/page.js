// A fit while it runs: asks about once a second what is new, and draws it.
"use strict";
(() => {
  const byId = (id) => document.getElementById(id);
  const viewer = bokashiViewer(document.querySelector("#mesh .viewer"));
  let state = null, mesh = null;

  // ---- numbers ----

  const digits = (x) => (x === null ? "not a number"
    : x !== 0 && (Math.abs(x) < 1e-3 || Math.abs(x) >= 1e5) ? x.toExponential(2) : String(+x.toPrecision(4)));
  const grouped = (x) => x.toLocaleString("en");

  function duration(seconds) {
    if (seconds === null) return "unknown";
    if (seconds < 100) return `${seconds < 10 ? seconds.toFixed(1) : Math.round(seconds)} s`;
    const minutes = Math.round(seconds / 60);
    return minutes < 100 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
  }

  function numbers() {
    const last = state.held_out.at(-1);
    const rows = [
      ["Step", `${grouped(state.step)} of ${grouped(state.steps)}`],
      ["Loss", digits(state.loss)],
      last && ["Held out", last[1] === null ? "not a number" : `${last[1].toFixed(2)} dB`],
      ["Time", duration(state.seconds)],
      !state.ended && ["Left, about", duration(state.seconds_left)],
    ];
    byId("numbers").replaceChildren(...rows.filter(Boolean).map(([name, value]) => {
      const row = document.createElement("div");
      row.appendChild(document.createElement("dt")).textContent = name;
      row.appendChild(document.createElement("dd")).textContent = value;
      return row;
    }));
    Object.assign(byId("progress"), { hidden: false, value: state.steps ? state.step / state.steps : 1 });
  }

  // ---- curves ----

  // Round numbers that span a range, about as many as asked for.
  function ticks(low, high, count) {
    const rough = (high - low) / count, power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough);
    const first = Math.ceil(low / step - 1e-9);
    return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, k) => (first + k) * step);
  }

  // Powers of ten in a range of logarithms, and round numbers between where that gives few.
  function powers(low, high, count) {
    const skip = Math.ceil((high - low) / count), factors = high - low < 1.5 ? [1, 2, 5] : [1];
    const all = [];
    for (let power = Math.floor(low); power <= high; power++) {
      if (power % skip === 0) all.push(...factors.map((factor) => Math.log10(factor) + power));
    }
    const inside = all.filter((at) => at >= low && at <= high);
    return inside.length > 1 ? inside : ticks(10 ** low, 10 ** high, 3).map(Math.log10);
  }

  function draw(svg, curve, logarithmic) {
    const value = (y) => (y === null ? null : logarithmic ? (y > 0 ? Math.log10(y) : null) : y);
    const points = curve.map(([x, y]) => [x, value(y)]);
    const drawn = points.filter(([x, y]) => x !== null && y !== null);
    const [width, height] = [svg.clientWidth, svg.clientHeight];
    svg.closest("figure").hidden = !curve.length;
    svg.replaceChildren();
    if (!drawn.length || !width) return;
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const range = (numbers, least) => {
      const [low, high] = [Math.min(...numbers), Math.max(...numbers)];
      const more = Math.max(least - (high - low), 0) / 2;
      return [low - more, high + more];
    };
    const right = Math.max(...drawn.map((point) => point[0]), 1e-3);
    const [low, high] = range(drawn.map((point) => point[1]), logarithmic ? 0.1 : 0.5);
    const levels = logarithmic ? powers(low, high, 5) : ticks(low, high, 4);
    const labels = levels.map((at) => digits(logarithmic ? 10 ** at : at).replace(/\.?0+e/, "e"));
    // As wide as the longest label: a digit takes some 7 pixels.
    const left = 14 + 7 * Math.max(...labels.map((label) => label.length), 3);
    const box = { left, right: width - 14, top: 8, bottom: height - 24 };
    const x = (at) => box.left + at / right * (box.right - box.left);
    const y = (at) => box.bottom - (at - low) / (high - low) * (box.bottom - box.top);
    const add = (name, attributes, text) => {
      const made = svg.appendChild(document.createElementNS("http://www.w3.org/2000/svg", name));
      for (const key in attributes) made.setAttribute(key, attributes[key]);
      if (text !== undefined) made.textContent = text;
    };
    levels.forEach((at, k) => {
      add("line", { x1: box.left, x2: box.right, y1: y(at), y2: y(at) });
      add("text", { x: box.left - 8, y: y(at) + 4, "text-anchor": "end" }, labels[k]);
    });
    for (const at of ticks(0, right, width < 400 ? 3 : 5)) {
      const label = digits(at), half = 3.5 * label.length;
      add("text", { x: Math.min(x(at), width - half), y: height - 6, "text-anchor": "middle" }, label);
    }
    // What has no place cuts the line in two.
    let run = [];
    for (const point of [...points, [null, null]]) {
      if (point[0] !== null && point[1] !== null) { run.push(`${x(point[0])},${y(point[1])}`); continue; }
      if (run.length > 1) add("polyline", { points: run.join(" ") });
      run = [];
    }
    const end = drawn.at(-1);
    add("circle", { cx: x(end[0]), cy: y(end[1]), r: 3.5 });
  }

  function curves() {
    byId("curves").hidden = !state.losses.length && !state.held_out.length;
    draw(byId("losses"), state.losses, true);
    draw(byId("held_out"), state.held_out, false);
  }

  // ---- views ----

  const PARTS = { picture: "now", target: "target", difference: "difference" };

  function view() {
    const figure = document.createElement("figure");
    const pictures = document.createElement("div");
    figure.append(document.createElement("figcaption"), pictures);
    for (const part in PARTS) {
      const box = pictures.appendChild(document.createElement("div"));
      box.appendChild(document.createElement("img")).dataset.part = part;
      box.appendChild(document.createElement("small")).textContent = PARTS[part];
    }
    return figure;
  }

  function views() {
    const list = document.querySelector(".views");
    byId("views").hidden = !state.views.length;
    while (list.children.length > state.views.length) list.lastElementChild.remove();
    while (list.children.length < state.views.length) list.append(view());
    state.views.forEach((shown, at) => {
      const figure = list.children[at], more = document.createElement("span");
      const psnr = shown.psnr === null ? "" : ` ${shown.psnr.toFixed(2)} dB`;
      more.textContent = `${shown.held_out ? " held out" : ""}${psnr && (shown.held_out ? "," : "") + psnr}`;
      figure.firstElementChild.replaceChildren(shown.name, more);
      for (const image of figure.querySelectorAll("img")) {
        const part = image.dataset.part, address = `/view/${at}/${part}.png?version=${shown[part]}`;
        if (image.getAttribute("src") !== address) image.src = address;
        image.alt = `${shown.name}: ${PARTS[part]}`;
      }
    });
  }

  // ---- asking ----

  async function ask(address) {
    const options = { cache: "no-store", signal: AbortSignal.timeout(20000) };
    const answer = await fetch(address, options).catch(() => {
      const last = state?.begun ? " What stands here is the last that it showed." : "";
      throw new Error(`The program no longer answers: it ended, or it was stopped.${last}`);
    });
    if (!answer.ok) throw new Error(`${address} could not be loaded: ${answer.status}.`);
    return answer;
  }

  function say(text, stopped) {
    if (byId("message").textContent !== text) byId("message").textContent = text;
    byId("message").classList.toggle("stopped", stopped);
  }

  function show() {
    const { begun, title, ended } = state;
    if (!begun) return say("The fit has not begun yet.", false);
    byId("title").textContent = title || "bokashi fit";
    const share = state.steps ? Math.floor(100 * state.step / state.steps) : 100;
    document.title = `${ended ? (ended.failed ? "Failed" : "Done") : `${share} %`} ${title || "bokashi fit"}`;
    say(ended ? ended.message : "The fit runs.", Boolean(ended?.failed));
    numbers();
    curves();
    views();
  }

  async function update() {
    const answer = await ask(`/state.json?after=${state?.version ?? ""}`);
    if (answer.status !== 204) state = await answer.json();
    show();
    const wanted = state.begun ? state.mesh : null;
    byId("mesh").hidden = wanted === null;
    if (wanted !== null && wanted !== mesh) {
      await viewer.show(await (await ask(`/mesh.json?version=${wanted}`)).json());
      mesh = wanted;
    }
  }

  async function forever() {
    let wait = 1000;
    try {
      await update();
      if (state.ended) wait = 3000;
    } catch (error) {
      wait = 3000;
      if (!state?.ended) say(error.message, true);
    }
    setTimeout(forever, wait);
  }

  new ResizeObserver(() => state?.begun && curves()).observe(document.querySelector(".curves"));
  forever();
})();
