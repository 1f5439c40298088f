// SPDX-License-Identifier: Apache-2.0
// What every report's plots share: theme, keyboard, print. Other scripts draw with page.draw(element, figure).
"use strict";
const page = (() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const root = document.documentElement;
  const PAPER_WIDE = 720, PAPER_HALF = 350; // px between the margins of A4 or Letter
  const NARROW = 560, CELL = 36; // px: a plot too narrow for buttons, a cell too narrow for its number
  const drawn = new Map(); // element → figure with colours by name, to be drawn again in another theme

  // An "@name" becomes the theme's colour of that name.
  function coloured(value, style) {
    if (typeof value === "string") return value.startsWith("@") ? style.getPropertyValue("--" + value.slice(1)).trim() || value : value;
    if (Array.isArray(value)) return value.map((v) => coloured(v, style));
    if (value && typeof value === "object" && !ArrayBuffer.isView(value)) {
      return Object.fromEntries(Object.entries(value).map(([k, v]) => [k, coloured(v, style)]));
    }
    return value;
  }

  function axis(given, style) {
    const grid = style.getPropertyValue("--grid").trim();
    return {
      gridcolor: grid, zerolinecolor: grid, linecolor: grid, tickcolor: grid, automargin: true, ticks: "outside",
      ...given, title: { standoff: 6, ...(typeof given.title === "string" ? { text: given.title } : given.title) },
    };
  }

  function draw(element, figure) {
    drawn.set(element, figure);
    const style = getComputedStyle(root);
    const layout = coloured(figure.layout || {}, style);
    const ink = style.getPropertyValue("--ink").trim();
    const base = {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", autosize: true, hovermode: "closest",
      font: { family: getComputedStyle(document.body).fontFamily, size: 13, color: ink },
      margin: { l: 8, r: 8, t: 30, b: 8 },
      legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom", bgcolor: "rgba(0,0,0,0)" },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: style.getPropertyValue("--soft").trim(), activecolor: ink },
      hoverlabel: { bgcolor: style.getPropertyValue("--panel").trim(), font: { color: ink }, bordercolor: style.getPropertyValue("--line").trim() },
    };
    const onPaper = root.classList.contains("paper"); // plots are drawn before the page is laid out on paper
    const paper = onPaper ? { width: element.closest(".two") ? PAPER_HALF : PAPER_WIDE } : {};
    const axes = Object.fromEntries(
      ["xaxis", "yaxis", ...Object.keys(layout).filter((k) => /^[xy]axis\d+$/.test(k))].map((k) => [k, axis(layout[k] || {}, style)])
    );
    const config = {
      displaylogo: false, responsive: true, displayModeBar: figure.fixed || element.clientWidth < NARROW ? false : "hover",
      modeBarButtons: [["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d", "toImage"]], // nothing that leaves this file
    };
    const whole = { ...base, ...(figure.fixed ? { dragmode: false } : {}), ...layout, ...axes, legend: { ...base.legend, ...layout.legend }, ...paper };
    return Plotly.react(element, figure.data.map((trace) => coloured(legible(trace, element.clientWidth), style)), whole, config);
  }

  // On a narrow screen the numbers of a heat map would run into each other; touching a cell still shows its own.
  function legible(trace, width) {
    if (trace.type !== "heatmap" || !trace.texttemplate || (0.75 * width) / trace.x.length > CELL) return trace;
    return { ...trace, texttemplate: "" };
  }

  // Numbers packed by Python as 32-bit floats.
  function unpack(packed) {
    const bytes = Uint8Array.from(atob(packed.bdata), (c) => c.charCodeAt(0));
    return new Float32Array(bytes.buffer);
  }

  const again = () => drawn.forEach((figure, element) => draw(element, figure));

  function zoom(element, by, shift) {
    const changes = {};
    for (const [name, axis] of Object.entries(element._fullLayout)) {
      if (!/^xaxis\d*$/.test(name) || !axis.range || axis.type === "category") continue;
      const [a, b] = axis.range.map(Number);
      const middle = (a + b) / 2 + shift * (b - a), half = ((b - a) / 2) * by;
      changes[name + ".range"] = [middle - half, middle + half];
    }
    return Plotly.relayout(element, changes);
  }
  const keys = { "+": [0.7, 0], "=": [0.7, 0], "-": [1 / 0.7, 0], ArrowLeft: [1, -0.15], ArrowRight: [1, 0.15] };
  document.addEventListener("keydown", (event) => {
    const element = event.target;
    if (!(element instanceof Element) || !element.classList.contains("plot") || event.ctrlKey || event.metaKey || event.altKey) return;
    if (keys[event.key]) zoom(element, ...keys[event.key]);
    else if (event.key === "0" || event.key === "Home") draw(element, drawn.get(element));
    else return;
    event.preventDefault();
  });

  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
  let width = innerWidth;
  addEventListener("resize", () => {
    if (innerWidth !== width) again(); // not when a phone hides its address bar
    width = innerWidth;
  });
  const folded = () => document.querySelectorAll("details:not([open])");
  let opened = [];
  addEventListener("beforeprint", () => {
    root.classList.add("paper");
    opened = [...folded()];
    opened.forEach((d) => (d.open = true));
    again();
  });
  addEventListener("afterprint", () => {
    root.classList.remove("paper");
    opened.forEach((d) => (d.open = false));
    again();
  });
  document.addEventListener("toggle", (e) => e.target.querySelectorAll?.(".plot").forEach((p) => Plotly.Plots.resize(p)), true);

  document.querySelectorAll("[data-figure]").forEach((element) => draw(element, data.figures[Number(element.dataset.figure)]));
  return { data, draw, unpack };
})();
