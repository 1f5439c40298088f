// SPDX-License-Identifier: Apache-2.0
// Traces, residuals and error bars of the chosen run, channel and effects. Predictions were computed beforehand.
"use strict";
(() => {
  const data = page.data.explorer;
  const byId = (id) => document.getElementById(id);
  const runChoice = byId("explorer-run"), channelChoice = byId("explorer-channel");
  const boxes = [...document.querySelectorAll("[data-effect]")];
  const number = (x) => (x === null ? "∞" : x < 10 ? x.toFixed(2) : x < 100 ? x.toFixed(1) : Math.round(x).toLocaleString("en").replaceAll(",", "\u202f"));
  const cache = new Map();
  const values = (packed) => {
    if (!cache.has(packed)) cache.set(packed, page.unpack(packed));
    return cache.get(packed);
  };

  function variant() {
    const mask = boxes.reduce((sum, box) => sum + (box.checked ? 1 << Number(box.dataset.effect) : 0), 0);
    return data.variants.indexOf(mask);
  }

  function traces(trace, channel, chosen) {
    const { title, unit, noise } = data.channels[channel];
    const t = values(trace.t), y = values(trace.y);
    const residual = (k) => Array.from(values(trace.p[k]), (p, i) => (y[i] - p) / noise);
    const single = data.effects.length === 0;
    const list = [];
    if (trace.b) { // two standard deviations to either side of the first prediction; below, together with the noise
      const band = values(trace.b), p = values(trace.p[0]);
      const edge = { x: t, mode: "lines", line: { width: 0 }, hoverinfo: "skip", showlegend: false };
      const filled = { ...edge, fill: "tonexty", fillcolor: "@shade" };
      const above = (sign) => Array.from(p, (v, i) => v + sign * 2 * band[i]);
      const below = (sign) => Array.from(band, (b) => sign * 2 * Math.hypot(1, b / noise));
      list.push({ ...edge, y: above(-1) });
      list.push({ ...filled, y: above(1), name: "prediction ± 2 standard deviations", showlegend: true });
      list.push({ ...edge, y: below(-1), yaxis: "y2" });
      list.push({ ...filled, y: below(1), yaxis: "y2" });
    }
    list.push(
      { x: t, y, name: "measured", mode: "markers", marker: { size: 3.5, color: "@measured" }, hovertemplate: `%{y:.5g} ${unit}` },
      { x: t, y: values(trace.p[0]), name: data.words[0], mode: "lines", line: { color: data.colour, width: single ? 1.8 : 1.4, dash: single ? "solid" : "dot" }, hovertemplate: `%{y:.5g} ${unit}` },
      { x: t, y: residual(0), name: data.words[0], mode: "lines", line: { color: data.colour, width: 1 }, yaxis: "y2", showlegend: false, opacity: single ? 1 : 0.55, hovertemplate: "%{y:.3g} × noise" },
    );
    if (chosen > 0) {
      list.push({ x: t, y: values(trace.p[chosen]), name: data.words[1], mode: "lines", line: { color: "@after", width: 1.8 }, hovertemplate: `%{y:.5g} ${unit}` });
      list.push({ x: t, y: residual(chosen), name: data.words[1], mode: "lines", line: { color: "@after", width: 1 }, yaxis: "y2", showlegend: false, hovertemplate: "%{y:.3g} × noise" });
    }
    return {
      data: list,
      layout: {
        hovermode: "x unified", margin: { l: 8, r: 8, t: 34, b: 8 },
        xaxis: { title: "time, s", anchor: "y2", hoverformat: ".4f" },
        yaxis: { title: `${title}, ${unit}`, domain: [0.42, 1] },
        yaxis2: { title: "error / noise", domain: [0, 0.34], zeroline: true },
        shapes: [{ type: "rect", xref: "paper", x0: 0, x1: 1, yref: "y2", y0: -2, y1: 2, fillcolor: "@band", line: { width: 0 }, layer: "below" }],
      },
    };
  }

  function errors(run, chosen) {
    const names = Object.keys(data.channels).filter((c) => run.channels[c]).reverse();
    const bars = (k, name, color) => ({
      type: "bar", orientation: "h", name, y: names.map((c) => data.channels[c].title), x: names.map((c) => run.channels[c].e[k] ?? 1e6),
      text: names.map((c) => number(run.channels[c].e[k])), textposition: "outside", cliponaxis: false, marker: { color },
      hovertemplate: "%{y}: %{text} × noise<extra></extra>",
    });
    const list = chosen > 0 ? [bars(chosen, data.words[1], "@after"), bars(0, data.words[0], data.colour)] : [bars(0, data.words[0], data.colour)];
    const most = Math.max(...list.flatMap((b) => b.x), 3);
    return {
      data: list,
      layout: {
        margin: { l: 8, r: 50, t: 30, b: 8 }, bargap: 0.35, showlegend: list.length > 1, legend: { traceorder: "reversed" },
        xaxis: { title: "RMS error / noise (1: nothing but noise)", type: "log", range: [Math.log10(0.5), Math.log10(most * 1.4)], dtick: 1 },
        yaxis: { ticks: "" },
        shapes: [{ type: "line", x0: 1, x1: 1, yref: "paper", y0: 0, y1: 1, line: { color: "@good", width: 1.5, dash: "dash" } }],
      },
    };
  }

  function show() {
    const run = data.runs[Number(runChoice.value)];
    for (const option of channelChoice.options) option.disabled = !run.channels[option.value];
    if (!run.channels[channelChoice.value]) channelChoice.value = Object.keys(run.channels)[0];
    const trace = run.channels[channelChoice.value], chosen = variant(), title = data.channels[channelChoice.value].title;
    const sentence = byId("explorer-sentence");
    if (chosen < 0) {
      sentence.textContent = "This combination of effects was not predicted; choose another.";
      return;
    }
    sentence.textContent = `${title} of ${run.name}: ${number(trace.e[0])} × noise ${data.words[0]}` + (chosen > 0 ? `, ${number(trace.e[chosen])} × noise ${data.words[1]}.` : ".");
    page.draw(byId("explorer-traces"), traces(trace, channelChoice.value, chosen));
    page.draw(byId("explorer-errors"), errors(run, chosen));
  }

  runChoice.value = String(Math.max(0, data.runs.findIndex((r) => r.name === data.start.run)));
  channelChoice.value = data.start.channel;
  byId("explorer-controls").addEventListener("change", (event) => {
    // Of two effects that stand in each other's place only one is on.
    const chosen = boxes.indexOf(event.target);
    const others = data.either.filter((pair) => pair.includes(chosen)).flat().filter((k) => k !== chosen);
    if (event.target.checked) others.forEach((k) => { boxes[k].checked = false; });
    show();
  });
  show();
})();
