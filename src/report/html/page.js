"use strict";
// Draws the plots of the report from the numbers in #data. Everything else on the page is plain HTML.
(function () {
  const data = unpack(JSON.parse(document.getElementById("data").textContent));
  // Histories are packed: 16 bits per value, steps above the least one; all ones where there is none.
  function unpack(v) {
    if (v === null || typeof v !== "object") return v;
    if (typeof v.levels === "string") {
      const bytes = atob(v.levels), values = [];
      for (let i = 0; i < bytes.length; i += 2) {
        const k = bytes.charCodeAt(i) + 256 * bytes.charCodeAt(i + 1);
        values.push(k === 65535 ? null : v.low + k * v.step);
      }
      return values;
    }
    Object.keys(v).forEach((key) => { v[key] = unpack(v[key]); });
    return v;
  }
  // A section that has no place on the page leaves no numbers.
  ["lines", "profiles", "maneuvers", "overlays", "verdicts", "correlations", "gaps", "overview", "paths", "validations", "figures", "leftOut"].forEach((name) => { data[name] = data[name] || []; });
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const byId = (id) => document.getElementById(id);
  const colourOf = {}, symbolOf = {};
  data.flights.forEach((f) => { colourOf[f.id] = f.colour; symbolOf[f.id] = f.symbol; });

  // Plotly reads a few HTML tags in labels: names from logs are shown as they are.
  const escape = (s) => String(s).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const withUnit = (name, unit) => escape(name) + (unit ? " [" + escape(unit) + "]" : "");

  let printing = false;
  function theme() {
    const d = dark.matches && !printing;
    return d
      ? { ink: "#e4e9ee", soft: "#a3afbb", grid: "#2c353f", line: "#4a5663", back: "#161b21", model: "#ffb454", measured: "#8ec7f5", band: "163,175,187", cold: "#1e252d", warm: "#5c4117", hot: "#a3620f", gone: "#2c7a60", minus: "#1f5f8f" }
      : { ink: "#1b2430", soft: "#566270", grid: "#e6eaee", line: "#aeb7c0", back: "#ffffff", model: "#c24a00", measured: "#0072b2", band: "60,75,90", cold: "#f4f6f8", warm: "#fbd9ae", hot: "#f0923f", gone: "#74c9a8", minus: "#6fb1dd" };
  }
  function layout(extra) {
    const t = theme();
    return Object.assign({
      paper_bgcolor: t.back, plot_bgcolor: t.back, showlegend: false, hovermode: "closest",
      font: { family: "system-ui, Segoe UI, Roboto, Arial, sans-serif", size: 12, color: t.ink },
      margin: { l: 64, r: 14, t: 14, b: 44 },
    }, extra);
  }
  function axis(title, extra) {
    const t = theme();
    return Object.assign({
      title: { text: title, standoff: 6, font: { size: 12 } }, gridcolor: t.grid, linecolor: t.line, zerolinecolor: t.line, zerolinewidth: 1,
      showline: true, ticks: "outside", tickcolor: t.line, ticklen: 4, automargin: true,
    }, extra);
  }
  const config = { responsive: true, displaylogo: false, displayModeBar: "hover", modeBarButtonsToRemove: ["lasso2d", "select2d", "autoScale2d"], toImageButtonOptions: { format: "svg" } };

  // ---- coefficients versus alpha ----
  function band(x, lower, upper, colour) {
    const none = { width: 0 };
    return [
      { x: x, y: lower, mode: "lines", line: none, hoverinfo: "skip" },
      { x: x, y: upper, mode: "lines", line: none, fill: "tonexty", fillcolor: colour, hoverinfo: "skip" },
    ];
  }
  function drawLine(plot) {
    const element = byId("line-" + plot.index);
    if (!element) return;
    const t = theme(), traces = [], b = plot.band;
    if (b) {
      if (byId("show-prediction").checked && b.prediction) traces.push(...band(b.x, b.prediction[0], b.prediction[1], "rgba(" + t.band + ",0.09)"));
      if (byId("show-simultaneous").checked && b.simultaneous) traces.push(...band(b.x, b.simultaneous[0], b.simultaneous[1], "rgba(" + t.band + ",0.16)"));
      if (byId("show-pointwise").checked && b.pointwise) traces.push(...band(b.x, b.pointwise[0], b.pointwise[1], "rgba(" + t.band + ",0.22)"));
      traces.push({ x: b.x, y: b.value, mode: "lines", line: { color: t.ink, width: 1.6 }, hoverinfo: "skip" });
    }
    plot.points.forEach((p) => traces.push({
      x: p.x, y: p.value, text: p.segment.map(escape), name: escape(p.flight), mode: "markers", type: "scatter",
      marker: { color: colourOf[p.flight] || t.measured, symbol: symbolOf[p.flight] || "circle", size: p.x.length > 200 ? 4 : 8 },
      error_y: { type: "data", array: p.bar, color: colourOf[p.flight] || t.measured, thickness: p.x.length > 200 ? 0.5 : 1.2, width: p.x.length > 200 ? 0 : 3 },
      hovertemplate: "%{text}<br>%{x:.2f}, %{y:.4g} ± %{error_y.array:.2g}<extra>%{fullData.name}</extra>",
    }));
    Plotly.react(element, traces, layout({ xaxis: axis(withUnit(plot.against, plot.x_unit)), yaxis: axis(withUnit(plot.parameter, plot.unit)) }), config);
  }
  const drawLines = () => data.lines.forEach(drawLine);
  ["show-pointwise", "show-simultaneous", "show-prediction"].forEach((id) => { if (byId(id)) byId(id).addEventListener("change", drawLines); });

  // ---- figures that the pipeline file asks for ----
  const palette = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b8860b", "#4ba3d9"];
  function drawFigure(figure, index) {
    const element = byId("figure-" + index);
    if (!element) return;
    const t = theme(), traces = [], shapes = [];
    let next = 0;
    figure.series.forEach((s) => {
      if (s.kind === "strips") {
        s.x.forEach((x, i) => shapes.push(shade(x, s.y[i], false)));
        traces.push({ x: [null], y: [null], name: escape(s.label), type: "scatter", mode: "markers", marker: { symbol: "square", size: 10, color: "rgba(150,150,150,0.45)" } });
        return;
      }
      const reference = s.kind === "reference", bars = s.lower.some((v) => v !== null);
      const colour = reference ? t.model : colourOf[s.label] || palette[next++ % palette.length];
      if (s.kind === "line" && bars) traces.push(...band(s.x, s.lower, s.upper, "rgba(" + t.band + ",0.18)").map((b) => Object.assign({ showlegend: false }, b)));
      const joined = s.kind === "line" || (reference && s.x.length === 2);
      const trace = { x: s.x, y: s.y, name: escape(s.label), type: "scatter", mode: joined ? "lines" : "markers", line: { color: colour, width: 1.6, dash: reference ? "5px,2px" : "solid" }, marker: { color: colour, symbol: symbolOf[s.label] || "circle", size: s.x.length > 500 ? 2.5 : 7 } };
      if (!joined && bars) trace.error_y = { type: "data", symmetric: false, array: s.upper.map((u, i) => (u === null ? null : u - s.y[i])), arrayminus: s.lower.map((l, i) => (l === null ? null : s.y[i] - l)), color: colour, thickness: 1.2, width: 3 };
      traces.push(trace);
    });
    // Rows that the names take above the plot, which begin below its buttons.
    const width = figure.series.reduce((sum, s) => sum + 6.2 * s.label.length + 58, 0);
    const names = Math.ceil(width / Math.max(120, (element.clientWidth || 400) - 78));
    Plotly.react(element, traces, layout({ shapes: shapes, showlegend: true, legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom", font: { size: 11 }, traceorder: "normal", itemsizing: "constant" }, margin: { l: 64, r: 14, t: 26 + 20 * names, b: 44 }, xaxis: axis(withUnit(figure.x.title, figure.x.unit)), yaxis: axis(withUnit(figure.y.title, figure.y.unit)) }), config);
  }

  // ---- samples that were left out, and those around them ----
  function drawLeftOut(plot, index) {
    const element = byId("left-out-" + index);
    if (!element) return;
    const t = theme();
    const traces = [{ x: plot.t, y: plot.kept, name: "kept", type: "scatter", mode: "lines+markers", connectgaps: false, line: { color: t.measured, width: 1.2 }, marker: { color: t.measured, size: 3.5 } }];
    plot.out.forEach((o) => traces.push({ x: o.t, y: o.value, name: o.why, type: "scatter", mode: "markers", marker: { color: t.model, symbol: o.why === "spike" ? "x" : "triangle-up", size: 9 } }));
    Plotly.react(element, traces, layout({ showlegend: true, legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom", font: { size: 11 } }, margin: { l: 64, r: 14, t: 46, b: 44 }, xaxis: axis("time [s]"), yaxis: axis(withUnit(plot.signal, plot.unit)) }), config);
  }

  // ---- likelihood profiles ----
  function drawProfile(plot) {
    const element = byId("profile-" + plot.index);
    if (!element) return;
    const t = theme(), ends = [plot.value[0], plot.value[plot.value.length - 1]];
    Plotly.react(element, [
      { x: plot.value, y: plot.rise, mode: "lines+markers", line: { color: t.ink, width: 1.4, shape: "spline" }, marker: { color: t.measured, size: 6 }, hovertemplate: "%{x:.5g}: %{y:.3g}<extra></extra>" },
      { x: ends, y: [plot.limit, plot.limit], mode: "lines", line: { color: t.model, width: 1.2, dash: "5px,2px" }, hoverinfo: "skip" },
    ], layout({ xaxis: axis(withUnit(plot.parameter, plot.unit)), yaxis: axis("twice the rise of the cost") }), config);
  }

  // ---- stacked time histories: rows of {title, height, traces} share one time axis ----
  function stack(element, rows, xTitle, shapes, annotations) {
    const gap = 32, top = 16, bottom = 46;
    const heights = rows.map((r) => r.height);
    const total = heights.reduce((a, h) => a + h, 0) + gap * (rows.length - 1);
    const l = layout({ height: total + top + bottom + 16 + (annotations.length ? 12 : 0), shapes: shapes, annotations: annotations.slice(), hovermode: "x", showlegend: true,
      margin: { l: 56, r: 14, t: top + 16 + (annotations.length ? 12 : 0), b: bottom }, legend: { orientation: "h", x: 0.5, xanchor: "center", y: 1, yanchor: "bottom", font: { size: 11.5 } } });
    const traces = [], t = theme();
    let from = total;
    rows.forEach((r, i) => {
      const n = i === 0 ? "" : String(i + 1);
      l["yaxis" + n] = axis("", { domain: [Math.max(0, (from - r.height) / total), from / total], anchor: "x", nticks: r.height < 90 ? 4 : 6, zeroline: r.residual === true });
      // Titles stand above their rows: names are longer than rows are high.
      l.annotations.push({ text: r.title, x: 0, xref: "paper", xanchor: "left", y: from / total, yref: "paper", yanchor: "bottom", showarrow: false, font: { size: 12, color: r.residual ? t.soft : t.ink } });
      from -= r.height + gap;
      r.traces.forEach((trace) => traces.push(Object.assign({ xaxis: "x", yaxis: "y" + n, type: "scatter", mode: "lines" }, trace)));
    });
    l.xaxis = axis(xTitle, { anchor: "y" + (rows.length > 1 ? rows.length : ""), zeroline: false });
    element.style.height = l.height + "px";
    Plotly.react(element, traces, l, config);
  }
  function shade(from, to, ok) {
    return { type: "rect", xref: "x", yref: "paper", x0: from, x1: to, y0: 0, y1: 1, layer: "below", line: { width: 0 }, fillcolor: ok ? "rgba(0,114,178,0.13)" : "rgba(150,150,150,0.20)" };
  }

  // Measured against the other one, and what is left, for every output.
  function pairs(outputs, other) {
    const t = theme(), rows = [];
    outputs.forEach((o, i) => {
      const residual = o.measured.map((z, k) => (z === null || o.modelled[k] === null ? null : z - o.modelled[k]));
      const free = o.simulated && o.simulated.length > 0, traces = [
        { x: o.t, y: o.measured, name: "measured", legendgroup: "measured", showlegend: i === 0, line: { color: t.measured, width: 1.6 } },
        { x: o.t, y: o.modelled, name: free ? "predicted one sample ahead" : other, legendgroup: "modelled", showlegend: i === 0, line: { color: t.model, width: 1.6, dash: "5px,2px" } },
      ];
      if (free) traces.push({ x: o.t, y: o.simulated, name: "simulated, without the measurements", legendgroup: "simulated", showlegend: i === 0, line: { color: t.soft, width: 1.2, dash: "dot" } });
      if (o.ahead && o.ahead.length > 0) traces.push({ x: o.t, y: o.ahead, name: "predicted one sample ahead", legendgroup: "ahead", showlegend: i === 0, line: { color: t.soft, width: 1.2, dash: "dot" } });
      rows.push({ title: withUnit(o.name, o.unit), height: outputs.length > 3 ? 130 : 200, traces: traces });
      rows.push({ title: "residual", height: 70, residual: true, traces: [{ x: o.t, y: residual, name: "residual", showlegend: false, line: { color: t.soft, width: 1 } }] });
    });
    return rows;
  }

  let maneuver = 0;
  function drawManeuver() {
    const m = data.maneuvers[maneuver], element = byId("maneuver-plot");
    if (!m || !element) return;
    const t = theme(), rows = pairs(m.outputs, "modelled");
    m.inputs.forEach((u) => rows.push({ title: withUnit(u.name, u.unit), height: 80, traces: [{ x: u.t, y: u.value, name: escape(u.name), showlegend: false, line: { color: t.ink, width: 1.1 } }] }));
    if (rows.length === 0) { Plotly.purge(element); element.textContent = "No time history for this maneuver."; return; }
    stack(element, rows, "time in flight [s]", [shade(m.start, m.end, true)].filter((s) => s.x0 !== null), []);
    byId("maneuver-caption").textContent = m.caption;
    byId("maneuver-select").value = String(maneuver);
    document.querySelectorAll("#maneuvers tr[data-pick]").forEach((row) => row.classList.toggle("chosen", row.dataset.pick === "m" + maneuver));
  }
  function fill(select, labels, pick) {
    // One alone is no choice.
    select.closest("label").hidden = labels.length < 2;
    labels.forEach((label, i) => {
      const option = document.createElement("option");
      option.value = String(i);
      option.textContent = label;
      select.appendChild(option);
    });
    select.addEventListener("change", () => pick(Number(select.value)));
  }
  // Rows of a section's table that show what they are about.
  function pickRows(section, show) {
    document.querySelectorAll("#" + section + " tr[data-pick]").forEach((row) => {
      const pick = () => show(Number(row.dataset.pick.slice(1)));
      row.addEventListener("click", pick);
      row.addEventListener("keydown", (e) => { if (e.key === "Enter") pick(); });
    });
  }
  function showManeuver(i) {
    maneuver = (i + data.maneuvers.length) % data.maneuvers.length;
    drawManeuver();
  }
  if (byId("maneuver-select")) {
    fill(byId("maneuver-select"), data.maneuvers.map((m) => m.label), showManeuver);
    byId("maneuver-previous").addEventListener("click", () => showManeuver(maneuver - 1));
    byId("maneuver-next").addEventListener("click", () => showManeuver(maneuver + 1));
    pickRows("maneuvers", (i) => { showManeuver(i); byId("maneuver-caption").scrollIntoView({ block: "start" }); });
  }

  // ---- maneuvers that were not used, with the interval in which the model expects them ----
  let validation = 0;
  function drawValidation() {
    const v = data.validations[validation], element = byId("validation-plot");
    if (!v || !element) return;
    const t = theme(), rows = pairs(v.outputs, "modelled, values held");
    v.outputs.forEach((o, i) => rows[2 * i].traces.unshift(...band(o.t, o.lower, o.upper, "rgba(" + t.band + ",0.18)").map((b) => Object.assign({ showlegend: false }, b))));
    const beyond = v.outputs.length ? v.outputs[0].beyond : [];
    stack(element, rows, "time in flight [s]", beyond.map((b) => shade(b[0], b[1], false)), []);
    byId("validation-select").value = String(validation);
    document.querySelectorAll("#validation tr[data-pick]").forEach((row) => row.classList.toggle("chosen", row.dataset.pick === "v" + validation));
  }
  if (byId("validation-select")) {
    const show = (i) => { validation = i; drawValidation(); };
    fill(byId("validation-select"), data.validations.map((v) => v.label), show);
    pickRows("validation", (i) => { show(i); byId("validation-plot").scrollIntoView({ block: "start" }); });
  }

  // ---- held-out maneuvers before and after an addition ----
  let overlay = 0;
  function drawOverlay() { beforeAndAfter(data.overlays[overlay], byId("overlay-plot")); }
  function beforeAndAfter(o, element) {
    if (!o || !element) return;
    const t = theme();
    const rows = o.outputs.map((c, i) => ({ title: withUnit(c.name, c.unit), height: 110, traces: [
      { x: c.t, y: c.measured, name: "measured", legendgroup: "measured", showlegend: i === 0, line: { color: t.measured, width: 1.6 } },
      { x: c.t, y: c.before, name: "before", legendgroup: "before", showlegend: i === 0, line: { color: t.soft, width: 1.3, dash: "2px,2px" } },
      { x: c.t, y: c.after, name: "after", legendgroup: "after", showlegend: i === 0, line: { color: t.model, width: 1.4, dash: "5px,2px" } },
    ] }));
    stack(element, rows, "time in flight [s]", [], []);
  }
  if (byId("overlay-select")) fill(byId("overlay-select"), data.overlays.map((o) => o.label), (i) => { overlay = i; drawOverlay(); });

  // ---- where the gap is: panels of {title, map} side by side; every panel has the rows of the first ----
  function heat(element, panels, scale) {
    panels = panels.filter((p) => p.map.columns.length > 0);
    if (panels.length === 0) { Plotly.purge(element); element.style.height = "auto"; element.textContent = "Nothing to show."; return; }
    const t = theme(), rows = panels[0].map.rows.slice().reverse();
    // Panels of few columns are wide enough for their titles.
    const width = (p) => Math.max(p.map.columns.length, 3.5);
    const columns = panels.reduce((n, p) => n + p.map.columns.length, 0), wide = panels.reduce((n, p) => n + width(p), 0);
    const longest = Math.max(...panels.map((p) => Math.max(...p.map.columns.map((c) => c.length))));
    const bottom = Math.min(170, 16 + 6 * longest), top = 44, height = 24 * rows.length + top + bottom;
    const l = layout({ height: height, margin: { l: 20, r: 10, t: top, b: bottom }, annotations: [] });
    // A square map is no wider than its cells ask for.
    const share = scale.square ? Math.min(1, (90 + 62 * columns) / Math.max(element.clientWidth, 1)) : 1;
    const traces = [], gap = 0.022, room = share * (1 - gap * (panels.length - 1));
    let from = 0;
    panels.forEach((p, i) => {
      const n = i === 0 ? "" : String(i + 1), to = from + room * width(p) / wide;
      const of = (row, table, none) => { const k = p.map.rows.indexOf(row); return k < 0 ? p.map.columns.map(() => none) : table[k]; };
      const values = rows.map((row) => of(row, p.map.values, null));
      const shown = values.map((line) => line.map((v) => (v === null ? null : scale.height(v))));
      const text = values.map((line) => line.map((v) => (v === null || columns > 40 ? "" : scale.text(v))));
      traces.push({ type: "heatmap", x: p.map.columns.map((_, k) => k), y: rows.map((_, k) => k), z: shown, text: text, texttemplate: "%{text}",
        textfont: { size: 10.5, color: t.ink }, customdata: rows.map((row) => of(row, p.map.words, "").map(escape)), hovertemplate: "%{customdata}<extra></extra>",
        zmin: 0, zmax: 1, colorscale: scale.colours, showscale: false, xgap: 1, ygap: 1, xaxis: "x" + n, yaxis: "y" + n });
      l["xaxis" + n] = axis("", { domain: [from, to], anchor: "y" + n, tickvals: p.map.columns.map((_, k) => k), ticktext: p.map.columns.map(escape), tickangle: -60, showgrid: false, zeroline: false, tickfont: { size: 10.5 }, automargin: false });
      l["yaxis" + n] = axis("", { anchor: "x" + n, tickvals: rows.map((_, k) => k), ticktext: i === 0 ? rows.map(escape) : rows.map(() => ""), showgrid: false, zeroline: false, ticks: i === 0 ? "outside" : "", automargin: i === 0 });
      l.annotations.push({ text: p.title, x: from, xref: "paper", xanchor: "left", y: 1, yref: "paper", yanchor: "bottom", yshift: 4, showarrow: false, font: { size: 12 } });
      from = to + gap;
    });
    element.style.height = height + "px";
    Plotly.react(element, traces, l, config);
  }
  // ---- which parameters go together ----
  let correlation = 0;
  function drawCorrelation() {
    const m = data.correlations[correlation], element = byId("correlation-plot");
    if (!m || !element) return;
    const t = theme();
    const words = m.names.map((a, i) => m.names.map((b, j) => a + " and " + b + ": " + (m.values[i][j] === null ? "none" : m.values[i][j].toFixed(3))));
    const map = { rows: m.names, columns: m.names, values: m.values, words: words };
    heat(element, [{ title: "", map: map }], { height: (v) => (v + 1) / 2, text: (v) => (m.names.length > 16 ? "" : v.toFixed(2)), colours: [[0, t.minus], [0.5, t.cold], [1, t.hot]], square: true });
  }
  if (byId("correlation-select")) fill(byId("correlation-select"), data.correlations.map((m) => m.label), (i) => { correlation = i; drawCorrelation(); });

  const brief = (v) => (v >= 9.95 ? v.toFixed(0) : v.toFixed(1));
  const clip = (v) => Math.max(0, Math.min(1, v));
  let whose = 0, regime = 0;
  const both = (split) => [{ title: split.by + (split.after.columns.length ? ": before" : ""), map: split.before }, { title: "after", map: split.after }];
  const sizes = (t) => ({ height: (v) => clip(Math.log10(Math.max(v, 1))), text: brief, colours: [[0, t.cold], [0.5, t.warm], [1, t.hot]] });
  const gapPlots = {
    "gap-maneuvers": (g, t) => [both(g.maneuvers), sizes(t)],
    "gap-splits": (g, t) => [[g.bands, g.times].concat(g.regimes[regime] ? [g.regimes[regime]] : []).flatMap(both), sizes(t)],
    "gap-driven": (g, t) => [[{ title: "state with feedback", map: g.driven }], { height: (v) => clip(1 - v), text: (v) => (100 * v).toFixed(0), colours: [[0, t.cold], [1, t.gone]] }],
    "gap-relations": (g, t) => [[{ title: "correlation over its limit", map: g.relations }], { height: (v) => clip((v - 1) / 4), text: (v) => (v > 1 ? brief(v) : ""), colours: sizes(t).colours }],
  };
  function drawGap(id) {
    const g = data.gaps[whose];
    if (g && byId(id)) heat(byId(id), ...gapPlots[id](g, theme()));
  }
  const drawGaps = () => Object.keys(gapPlots).forEach(drawGap);
  function fillRegimes() {
    const select = byId("gap-regime"), g = data.gaps[whose];
    select.replaceChildren();
    regime = 0;
    g.regimes.forEach((s, i) => { const option = document.createElement("option"); option.value = String(i); option.textContent = s.by; select.appendChild(option); });
  }
  if (byId("gap-select") && data.gaps.length > 0) {
    fill(byId("gap-select"), data.gaps.map((g) => g.name), (i) => { whose = i; fillRegimes(); drawGaps(); });
    fillRegimes();
    byId("gap-regime").addEventListener("change", () => { regime = Number(byId("gap-regime").value); drawGap("gap-splits"); });
  }

  // ---- whole flights ----
  let flight = 0;
  function drawFlight() {
    const f = data.overview[flight], element = byId("flight-plot");
    if (!f || !element) return;
    const t = theme();
    const rows = f.traces.map((s) => ({ title: withUnit(s.name, s.unit), height: 110, traces: [{ x: s.t, y: s.value, name: escape(s.name), showlegend: false, line: { color: t.measured, width: 1.1 } }] }));
    if (rows.length === 0) { Plotly.purge(element); element.textContent = "No time history for this flight."; return; }
    const marks = f.segments.map((s) => ({ x: (s.start + s.end) / 2, y: 1, xref: "x", yref: "paper", yanchor: "bottom", yshift: 14, showarrow: false, text: escape(s.mark), hovertext: escape(s.label), font: { size: 10.5, color: t.soft } }));
    stack(element, rows, "time [s]", f.segments.map((s) => shade(s.start, s.end, s.included)), marks);
  }
  if (byId("flight-select")) fill(byId("flight-select"), data.overview.map((f) => f.flight), (i) => { flight = i; drawFlight(); });

  // ---- measured channels beside the reconstructed path ----
  let path = 0;
  function drawPath() {
    const p = data.paths[path], element = byId("path-plot");
    if (p && element) stack(element, pairs(p.channels, "reconstructed"), "time [s]", [], []);
  }
  if (byId("path-select")) fill(byId("path-select"), data.paths.map((p) => p.flight), (i) => { path = i; drawPath(); });

  // ---- the list of flights ----
  const filter = byId("list-filter");
  if (filter) {
    const rows = Array.from(document.querySelectorAll("#list-rows tbody tr"), (row) => ({ row: row, text: row.textContent.toLowerCase() }));
    const sift = () => {
      const words = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
      let n = 0;
      rows.forEach((r) => { r.row.hidden = !words.every((w) => r.text.includes(w)); n += r.row.hidden ? 0 : 1; });
      byId("list-count").textContent = n + " of " + rows.length;
    };
    filter.addEventListener("input", sift);
    sift();
  }

  // A plot is drawn when it is about to be seen, so that a page of many plots answers at once; all of them for the printer.
  const draws = new Map();
  const place = (id, draw) => { if (byId(id)) draws.set(byId(id), draw); };
  data.lines.forEach((plot) => place("line-" + plot.index, () => drawLine(plot)));
  data.figures.forEach((figure, i) => place("figure-" + i, () => drawFigure(figure, i)));
  data.leftOut.forEach((plot, i) => place("left-out-" + i, () => drawLeftOut(plot, i)));
  data.profiles.forEach((plot) => place("profile-" + plot.index, () => drawProfile(plot)));
  data.verdicts.forEach((o, i) => place("verdict-" + i, () => beforeAndAfter(o, byId("verdict-" + i))));
  Object.keys(gapPlots).forEach((id) => place(id, () => drawGap(id)));
  [["maneuver-plot", drawManeuver], ["validation-plot", drawValidation], ["overlay-plot", drawOverlay], ["correlation-plot", drawCorrelation], ["flight-plot", drawFlight], ["path-plot", drawPath]]
    .forEach(([id, draw]) => place(id, draw));
  const near = new IntersectionObserver((entries) => entries.filter((entry) => entry.isIntersecting).forEach((entry) => {
    near.unobserve(entry.target);
    setTimeout(draws.get(entry.target));
  }), { rootMargin: "800px" });
  function drawAll() {
    near.disconnect();
    draws.forEach((draw, element) => { if (printing) draw(); else near.observe(element); });
  }
  dark.addEventListener("change", drawAll);
  window.addEventListener("beforeprint", () => { printing = true; drawAll(); });
  window.addEventListener("afterprint", () => { printing = false; drawAll(); });
  drawAll();
})();
