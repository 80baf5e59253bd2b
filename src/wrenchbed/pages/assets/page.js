"use strict";
// What a page can do beyond reading: figures that answer, tables that sort, commands to copy.
// Everything is on the page without it. It asks nothing of any network and keeps nothing.
(() => {
  const $ = (selector, root = document) => [...root.querySelectorAll(selector)];
  const make = (tag, options = {}, ...inside) => {
    const node = Object.assign(document.createElement(tag), options);
    node.append(...inside);
    return node;
  };
  const LETTER = 6.2;  // mean width of a letter of the marks of an axis [px]
  const VARIABLES = {measured: "--real", before: "--sim", after: "--after", box: "--box"};
  const colour = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const role = name => colour(VARIABLES[name]);
  const oneLine = text => text.replace(/(\.?)\n/, (_, dot) => dot || ", ");  // of a mark of two lines
  const safe = text => text.replace(/[&<>"]/g, c => `&#${c.charCodeAt(0)};`);
  const short = v => v === null || v === undefined ? "–" :
    (v !== 0 && (Math.abs(v) < 1e-4 || Math.abs(v) >= 1e5) ? power(v) : String(+v.toPrecision(4)))
      .replace("-", "−");
  const power = v => {
    const [digits, exponent] = v.toExponential(2).split("e");
    return `${+digits}·10${[...String(+exponent)].map(c => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]).join("")}`;
  };

  // ---- axes -------------------------------------------------------------------------------
  function axis(a, index, vertical, named) {
    const soft = colour("--ink"), line = colour("--line");
    const common = {gridIndex: index, name: named ? a.text : "", nameLocation: "middle",
      nameGap: vertical ? 50 : 26, nameTextStyle: {color: soft, fontSize: 12},
      axisLine: {show: true, onZero: false, lineStyle: {color: colour("--soft")}},
      axisLabel: {color: soft, fontSize: 11, lineHeight: 13, hideOverlap: true}, splitLine: {lineStyle: {color: line}},
      axisPointer: {label: {show: false}}};
    if (a.names.length) return {...common, type: "category", data: a.names, inverse: vertical,
      axisTick: {show: false}, splitLine: {show: false},
      axisLabel: {...common.axisLabel, interval: 0}};
    const told = {...common, type: a.scale === "log" ? "log" : "value", scale: true};
    if (a.low !== null) told.min = a.low;
    if (a.scale === "log" && a.low !== null) told.startValue = a.low;
    if (a.high !== null) told.max = a.high;
    told.axisLabel = {...common.axisLabel, formatter: v => short(+v.toPrecision(6)),
      showMinLabel: a.low === null ? null : false, showMaxLabel: a.high === null ? null : false};
    if (a.ticks.length) {
      told.axisLabel.customValues = a.ticks;
      told.axisLabel.showMinLabel = told.axisLabel.showMaxLabel = null;
      told.axisTick = {customValues: a.ticks};
      told.splitLine = {...told.splitLine, show: false};
    }
    return told;
  }

  // ---- series -----------------------------------------------------------------------------
  function whiskers(s, k) {
    return {type: "custom", name: s.name, xAxisIndex: k, yAxisIndex: k, silent: true, clip: true, z: 2, encode: {x: 0, y: [1, 2]},
      data: s.x.map((x, i) => [x, s.y[i] - s.std[i], s.y[i] + s.std[i]]), tooltip: {show: false},
      renderItem: (_, api) => {
        const [x, a] = api.coord([api.value(0), api.value(1)]);
        const [, b] = api.coord([api.value(0), api.value(2)]);
        return {type: "line", silent: true, shape: {x1: x, x2: x, y1: a, y2: b},
          style: {stroke: role(s.role), lineWidth: 1, opacity: .55}};
      }};
  }

  function drawn(s, k) {
    const common = {name: s.name, xAxisIndex: k, yAxisIndex: k, data: s.x.map((x, i) => [x, s.y[i]]),
      itemStyle: {color: role(s.role)}, emphasis: {disabled: false}, animation: false};
    if (s.kind === "bars") return [{...common, type: "bar", barWidth: "60%", barGap: "-100%"}];
    if (s.kind === "line") return [{...common, type: "line", showSymbol: false, symbolSize: 6, z: 4,
      lineStyle: {color: role(s.role), width: 1.8, type: s.dashed ? "dashed" : "solid"}}];
    const ring = s.mark === "ring";
    const points = {...common, type: "scatter", z: 3, symbol: s.mark === "diamond" ? "diamond" : "circle",
      symbolSize: ring ? (s.x.length > 12 ? 7 : 10) : s.mark === "diamond" ? 10 : 6,
      itemStyle: ring ? {color: "transparent", borderColor: role(s.role), borderWidth: s.x.length > 12 ? 1.4 : 2} :
        {color: role(s.role)}};
    return s.std ? [whiskers(s, k), points] : [points];
  }

  function marks(p) {
    const data = p.zero ? [{yAxis: 0, lineStyle: {type: "solid"}, label: {show: false}}] : [];
    return {silent: true, symbol: "none", animation: false, lineStyle: {color: colour("--soft"), type: "dashed"}, data};
  }

  function matrix(p, k) {
    const m = p.matrix, data = [];
    m.values.forEach((row, i) => row.forEach((v, j) => data.push({value: [j, i, v],
      itemStyle: {color: m.colours[i][j] ?? "transparent", borderColor: colour("--paper"), borderWidth: 1},
      label: {show: m.printed, formatter: m.texts[i][j], color: m.inks[i][j] ?? colour("--ink"), fontSize: 11}})));
    return {type: "heatmap", xAxisIndex: k, yAxisIndex: k, data, animation: false,
      emphasis: {itemStyle: {borderColor: colour("--ink"), borderWidth: 2}}};
  }

  function barOf(m, box) {
    const width = 10, ink = colour("--ink"), left = box.right + 10;
    const stops = m.bar.colours.map((c, i, all) => ({offset: 1 - i / (all.length - 1), color: c})).reverse();
    return [
      {type: "rect", silent: true, shape: {x: left, y: box.top, width, height: box.height},
        style: {fill: {type: "linear", x: 0, y: 0, x2: 0, y2: 1, colorStops: stops}}},
      ...m.bar.ticks.map(([at, text]) => ({type: "text", silent: true, x: left + width + 4,
        y: box.top + (1 - at) * box.height, style: {text, fill: ink, fontSize: 11, verticalAlign: "middle"}})),
      {type: "text", silent: true, x: left + width + 4, y: box.top - 8, style: {text: m.bar.label, fill: ink,
        fontSize: 11, align: "right", verticalAlign: "bottom"}}];
  }

  // ---- one figure -------------------------------------------------------------------------
  const nearest = (values, to) => values.reduce(
    (best, v, n) => Math.abs(v - to) < Math.abs(values[best] - to) ? n : best, 0);
  const live = [];
  let last = null;
  const tell = (from, id) => {
    if (id === last) return;
    last = id;
    for (const other of live) if (other !== from) other.follow(id);
  };

  class Figure {
    constructor(node, data) {
      Object.assign(this, {node, data, off: new Set(), active: false, at: -1});
      this.names = [...new Map(data.panels.flatMap(p => p.series).filter(s => s.name)
        .map(s => [s.name, s])).values()];
      this.ground = make("div", {className: "live", tabIndex: 0});
      this.ground.setAttribute("role", "img");
      this.ground.setAttribute("aria-label", `${data.title}: arrow keys move the cursor`);
      this.said = make("output", {className: "said"});
      const still = node.querySelector(".still");
      still.after(this.buttons(), this.ground, this.said);
      node.classList.add("alive");
      this.chart = echarts.init(this.ground, null, {renderer: "svg", height: this.layout().height});
      this.draw();
      this.listen();
    }

    get series() { return this.data.panels.flatMap((p, k) => p.series.map(s => ({p, s, k}))); }

    buttons() {
      const row = make("div", {className: "tools"});
      if (this.names.length > 1) for (const s of this.names) {
        const key = make("button", {type: "button", className: `key ${s.kind} ${s.mark}${s.dashed ? " dashed" : ""}`, textContent: s.name});
        key.style.setProperty("--key", `var(${VARIABLES[s.role]})`);
        key.setAttribute("aria-pressed", "true");
        key.onclick = () => {
          const hidden = !this.off.delete(s.name) && !!this.off.add(s.name);
          key.setAttribute("aria-pressed", String(!hidden));
          this.draw();
        };
        row.append(key);
      }
      const tool = (text, label, act) => {
        const button = make("button", {type: "button", textContent: text, title: label, onclick: act});
        button.setAttribute("aria-label", `${text} ${label}: ${this.data.title}`);
        row.append(button);
      };
      if (this.data.panels.some(p => !p.matrix && !p.y.names.length)) {
        tool("+", "zoom in", () => this.zoom(.5));
        tool("−", "zoom out", () => this.zoom(2));
        tool("all", "zoom to all", () => this.zoom(0));
      }
      tool("CSV", "download the data", () => this.save());
      return row;
    }

    layout() {
      const wide = this.node.clientWidth || 480, columns = wide < 620 ? 1 : this.data.columns;
      const across = wide / columns, boxes = [];
      let top = 6;
      this.data.panels.forEach((p, k) => {
        const rowNames = p.matrix ? p.matrix.rows : p.y.names;
        const labels = rowNames.length ? Math.min(.45 * across, 14 + 6.8 * Math.max(...rowNames.map(n => n.length))) : 70;
        const rows = rowNames.length;
        const height = p.matrix ? 24 * rows : rows ? 30 * rows + 10 : 165 * p.height;
        const above = (p.title ? 20 : 8) + (p.matrix ? 18 : 0);
        const named = !this.data.shared || k + columns >= this.data.panels.length || p.matrix;
        const column = k % columns, left = column * across + labels;
        const right = (column + 1) * across - (p.matrix ? 52 : 14);
        const names = p.matrix?.columns ?? p.x.names;
        const longest = Math.max(0, ...names.flatMap(c => c.split("\n")).map(c => c.length));
        const turned = longest * LETTER + 4 > (right - left) / names.length ?
          LETTER * Math.max(...names.map(c => oneLine(c).length)) : 0;
        const below = named ? (turned ? turned + 36 : names.some(c => c.includes("\n")) ? 62 : 48) : 24;
        boxes.push({left, top: top + above, named, title: top + 2, right, height, turned,
          bottom: top + above + height + below});
        if (column === columns - 1 || k === this.data.panels.length - 1)
          top = Math.max(...boxes.slice(-1 - column).map(b => b.bottom));
      });
      return {boxes, height: top};
    }

    draw() {
      const {boxes, height} = this.layout(), panels = this.data.panels;
      this.ground.style.height = `${height}px`;
      this.chart.resize({height});
      const told = {animation: false, grid: [], xAxis: [], yAxis: [], series: [], title: [], graphic: [],
        textStyle: {fontFamily: getComputedStyle(document.body).fontFamily}};
      panels.forEach((p, k) => {
        const b = boxes[k];
        told.grid.push({left: b.left, top: b.top, width: b.right - b.left, height: b.height, outerBoundsMode: "none"});
        const named = {...p.x, names: p.matrix ? p.matrix.columns : p.x.names};
        const x = axis(named, k, false, b.named);
        if (b.turned) Object.assign(x, {nameGap: b.turned + 12, data: x.data.map(c => oneLine(c)),
          axisLabel: {...x.axisLabel, rotate: 90, hideOverlap: false}});
        else if (named.names.some(c => c.includes("\n"))) x.nameGap = 38;
        told.xAxis.push(x);
        const y = axis({...p.y, names: p.matrix ? p.matrix.rows : p.y.names}, k, true, !p.y.names.length && !p.matrix);
        told.yAxis.push(y);
        if (p.title) told.title.push({text: p.title, left: b.left - 6, top: b.title, padding: 0,
          textStyle: {fontSize: 12, fontWeight: 600, color: colour("--ink")}});
        if (p.matrix) {
          told.series.push(matrix(p, k));
          told.graphic.push(...barOf(p.matrix, b));
        }
        const own = p.series.filter(s => !this.off.has(s.name)).flatMap(s => drawn(s, k));
        if (own.length) own[own.length - 1].markLine = marks(p);
        told.series.push(...own);
      });
      const flat = panels.every(p => p.matrix || p.y.names.length);
      told.tooltip = {trigger: flat ? "item" : "axis", confine: true, transitionDuration: 0, padding: [4, 8],
        backgroundColor: colour("--paper"), borderColor: colour("--soft"),
        textStyle: {color: colour("--ink"), fontSize: 12}, formatter: v => this.words([v].flat()),
        axisPointer: {type: "line", snap: true, animation: false, lineStyle: {color: colour("--soft")}}};
      if (this.data.shared) told.axisPointer = {link: [{xAxisIndex: "all"}]};
      told.dataZoom = flat || matchMedia("(pointer: coarse)").matches ? [] : this.windows().map(x => ({
        type: "inside", xAxisIndex: x, filterMode: "none", zoomOnMouseWheel: "ctrl",
        moveOnMouseWheel: false, moveOnMouseMove: true}));
      if (!flat && !told.dataZoom.length) told.dataZoom = this.windows().map(x => ({type: "inside",
        xAxisIndex: x, filterMode: "none", disabled: true}));
      this.chart.setOption(told, {notMerge: true});
    }

    windows() {
      const all = this.data.panels.map((_, k) => k);
      return this.data.shared ? [all] : all.map(k => [k]);
    }

    zoom(factor) {
      this.chart.getOption().dataZoom.forEach((z, dataZoomIndex) => {
        const middle = (z.start + z.end) / 2, half = Math.max(.5, factor * (z.end - z.start) / 2);
        const [start, end] = factor ? [Math.max(0, middle - half), Math.min(100, middle + half)] : [0, 100];
        this.chart.dispatchAction({type: "dataZoom", dataZoomIndex, start, end});
      });
    }

    // the words at the cursor: x, then every series with ± and unit
    words(items) {
      const seen = new Set(), lines = [];
      for (const item of items) {
        const k = this.panelOf(item.seriesIndex), p = this.data.panels[k];
        if (p.matrix) {
          const [j, i] = item.value, m = p.matrix;
          lines.push(`${m.rows[i]}, ${p.x.label} ${m.columns[j].replace("\n", " ")}: ${m.texts[i][j]}`);
          continue;
        }
        const s = p.series.find(s => s.name === item.seriesName);
        const n = item.dataIndex;
        if (!s || seen.has(`${k} ${s.name}`)) continue;
        seen.add(`${k} ${s.name}`);
        const value = (a, v) => a.names.length ? a.names[v] : `${short(v)}${a.unit ? ` ${a.unit}` : ""}`;
        const head = `${p.x.label} ${value(p.x, s.x[n])}`;
        if (!p.y.names.length && !lines.includes(head)) lines.push(head);
        const spread = s.std && s.std[n] !== null ? ` ± ${short(s.std[n])}` : "";
        const size = p.y.names.length ? `${p.y.names[s.y[n]]}: ${value(p.x, s.x[n])}` :
          `${short(s.y[n])}${spread}${p.y.unit ? ` ${p.y.unit}` : ""}`;
        lines.push(`${p.title && !p.y.names.length ? `${p.title}, ` : ""}${s.name || p.y.label}: ${size}`);
      }
      this.last = lines;
      return lines.map(safe).join("<br>");
    }

    panelOf(seriesIndex) { return this.chart.getOption().series[seriesIndex].xAxisIndex; }

    listen() {
      const on = value => () => { this.active = value; };
      this.ground.addEventListener("pointerenter", on(true));
      this.ground.addEventListener("pointerleave", on(false));
      this.chart.on("updateAxisPointer", event => this.share(event));
      this.chart.on("mouseover", event => {
        if (event.seriesType === "heatmap") this.shareCell(this.panelOf(event.seriesIndex), event.value);
      });
      this.ground.addEventListener("keydown", event => {
        const step = {ArrowRight: 1, ArrowLeft: -1, Home: -1e9, End: 1e9}[event.key];
        if (step === undefined) return;
        event.preventDefault();
        this.active = true;
        const shown = this.chart.getOption().series;
        const walked = this.series.find(({s}) => s.ids && !this.off.has(s.name)) ??
          this.series.find(({s}) => !this.off.has(s.name));
        const seriesIndex = shown.findIndex(d => d.type !== "custom" &&
          (!walked || d.name === walked.s.name && d.xAxisIndex === walked.k));
        if (seriesIndex < 0) return;
        this.at = Math.min(shown[seriesIndex].data.length - 1, Math.max(0, this.at + step));
        this.chart.dispatchAction({type: "showTip", seriesIndex, dataIndex: this.at});
        this.said.textContent = (this.last ?? []).join("; ");
        if (shown[seriesIndex].type === "heatmap")
          this.shareCell(shown[seriesIndex].xAxisIndex, shown[seriesIndex].data[this.at].value);
        if (walked) this.share({axesInfo: [{axisDim: "x", axisIndex: walked.k, value: walked.s.x[this.at]}]});
      });
      this.ground.addEventListener("blur", () => {
        this.active = false;
        this.said.textContent = "";
        this.chart.dispatchAction({type: "hideTip"});
      });
    }

    // the cursor of all figures stands at the same observation
    share(event) {
      const at = event.axesInfo?.find(a => a.axisDim === "x");
      if (!this.active || !at) return;
      const own = this.series.find(({s, k}) => s.ids && k === at.axisIndex && !this.off.has(s.name));
      if (!own) return;
      tell(this, own.s.ids[nearest(own.s.x, at.value)]);
    }

    // of a cell the observation that differs most
    shareCell(k, [column, row]) {
      const ids = this.data.panels[k].matrix.ids;
      if (this.active && ids.length) tell(this, ids[row][column]);
    }

    // the cells of the column that holds an observation are framed
    mark(id) {
      const shown = this.chart.getOption().series;
      this.data.panels.forEach((p, k) => {
        if (!p.matrix?.spans.length) return;
        const seriesIndex = shown.findIndex(d => d.type === "heatmap" && d.xAxisIndex === k);
        const column = p.matrix.spans.findIndex(([low, high]) => low <= id && id <= high);
        const dataIndex = p.matrix.rows.map((_, row) => row * p.matrix.columns.length + column);
        this.chart.dispatchAction({type: "downplay", seriesIndex});
        if (column >= 0) this.chart.dispatchAction({type: "highlight", seriesIndex, dataIndex});
      });
    }

    again() {
      this.chart.resize({width: this.ground.clientWidth});
      this.draw();
    }

    follow(id) {
      this.mark(id);
      const shown = this.chart.getOption().series;
      const own = this.series.find(({s}) => s.ids && !this.off.has(s.name));
      if (!own) return;
      const {s, k} = own;
      const near = nearest(s.ids, id);
      const seriesIndex = shown.findIndex(d => d.name === s.name && d.xAxisIndex === k && d.type !== "custom");
      if (seriesIndex >= 0) this.chart.dispatchAction({type: "showTip", seriesIndex, dataIndex: near});
    }

    save() {
      const cell = v => v === null || v === undefined ? "" : /[",\n]/.test(v) ? `"${String(v).replaceAll('"', '""')}"` : String(v);
      const rows = [["panel", "series", "x", "y", "std", "observation"]];
      for (const p of this.data.panels) {
        const title = p.title || p.y.text;
        if (p.matrix) p.matrix.values.forEach((row, i) => row.forEach((v, j) =>
          rows.push([title, p.matrix.rows[i], p.matrix.columns[j].replace("\n", " "), v, "", ""])));
        for (const s of p.series) s.x.forEach((x, n) => rows.push([title, s.name, p.x.names[x] ?? x,
          p.y.names[s.y[n]] ?? s.y[n], s.std?.[n], s.ids?.[n]]));
        rows[0][2] = this.data.panels.every(q => q.x.text === p.x.text) ? p.x.text || "x" : "x";
      }
      const file = new Blob([rows.map(r => r.map(cell).join(",")).join("\n") + "\n"], {type: "text/csv"});
      const link = make("a", {href: URL.createObjectURL(file), download: `${this.node.dataset.chart}.csv`});
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    }
  }

  function figures() {
    const held = document.getElementById("charts");
    if (!held || !window.echarts) return;
    const data = JSON.parse(held.textContent);
    const begin = node => {
      if (node.classList.contains("alive") || !node.clientWidth) return;
      const own = data[node.dataset.chart], page = {make, colour, role, nearest, tell, variable: name => VARIABLES[name]};
      if (!own.parts) live.push(new Figure(node, own));
      else if (RobotFigure.able()) live.push(new RobotFigure(node, own, page));
    };
    const near = new IntersectionObserver(entries => {
      for (const e of entries) if (e.isIntersecting) { near.unobserve(e.target); begin(e.target); }
    }, {rootMargin: "400px"});
    $("figure[data-chart]").forEach(node => near.observe(node));
    for (const fold of $("details")) fold.addEventListener("toggle", () => $("figure[data-chart]", fold).forEach(begin));
    const again = () => live.forEach(f => f.again());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
    let width = innerWidth;
    addEventListener("resize", () => { if (innerWidth !== width) { width = innerWidth; again(); } });
    window.wrenchbed = {live, cursor: () => last, begin: () => $("figure[data-chart]").forEach(begin)};
  }

  // ---- tables -----------------------------------------------------------------------------
  const MOST_UNFILTERED = 8;
  const size = text => {
    const plain = text.replaceAll(",", "").replaceAll("−", "-").replace(/·10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)/, (_, raised) =>
      `e${[...raised].map(c => "-0123456789"["⁻⁰¹²³⁴⁵⁶⁷⁸⁹".indexOf(c)]).join("")}`);
    const found = plain.match(/^[^\d-]*(-?\d+(\.\d+)?(e[+-]?\d+)?)/i);
    return found ? +found[1] : NaN;
  };

  function tables() {
    for (const table of $("table")) {
      const head = table.tHead, body = table.tBodies[0];
      if (!head || !body || body.rows.length < 3 || body.querySelector("[rowspan],[colspan]")) continue;
      [...head.rows[0].cells].forEach((cell, k) => {
        if (!cell.textContent.trim()) return;
        const button = make("button", {type: "button", className: "sort"}, ...cell.childNodes);
        cell.append(button);
        button.onclick = () => {
          const down = cell.getAttribute("aria-sort") === "ascending";
          for (const other of head.rows[0].cells) other.removeAttribute("aria-sort");
          cell.setAttribute("aria-sort", down ? "descending" : "ascending");
          const text = row => row.cells[k]?.textContent.trim() ?? "";
          const sorted = [...body.rows].sort((a, b) => {
            const [x, y] = [size(text(a)), size(text(b))];
            const order = Number.isNaN(x) || Number.isNaN(y) ?
              Number.isNaN(x) - Number.isNaN(y) || text(a).localeCompare(text(b)) : x - y;
            return down ? -order : order;
          });
          body.append(...sorted);
        };
      });
      if (body.rows.length <= MOST_UNFILTERED) continue;
      const filter = make("input", {type: "search", className: "filter", placeholder: "filter rows"});
      filter.setAttribute("aria-label", "filter rows of the table");
      const told = make("output", {className: "note"});
      filter.oninput = () => {
        const words = filter.value.toLowerCase().split(/\s+/);
        let shown = 0;
        for (const row of body.rows) {
          row.hidden = !words.every(w => row.textContent.toLowerCase().includes(w));
          shown += !row.hidden;
        }
        told.textContent = filter.value ? ` ${shown} of ${body.rows.length} rows` : "";
      };
      (table.closest(".scroll") ?? table).before(make("p", {className: "filtering"}, filter, told));
    }
  }

  // ---- commands and anchors ---------------------------------------------------------------
  function commands() {
    for (const block of $("pre")) {
      const button = make("button", {type: "button", className: "copy", textContent: "copy"});
      button.setAttribute("aria-label", "copy the command");
      button.onclick = async () => {
        try {
          await navigator.clipboard.writeText(block.textContent);
          button.textContent = "copied";
        } catch {
          getSelection().selectAllChildren(block);
          button.textContent = "selected";
        }
        setTimeout(() => { button.textContent = "copy"; }, 1500);
      };
      const holder = make("div", {className: "command"});
      block.replaceWith(holder);
      holder.append(block, button);
    }
  }

  function anchors() {
    for (const heading of $("main h2[id], main h3[id]")) {
      const link = make("a", {className: "anchor", href: `#${heading.id}`, textContent: "#"});
      link.setAttribute("aria-label", `link to ${heading.textContent.trim()}`);
      heading.append(" ", link);
    }
    const titles = $("main h2[id]").filter(heading => !heading.closest(".cards"));
    if (titles.length > 2) {
      const links = titles.map(h => make("a", {href: `#${h.id}`, textContent: h.firstChild.textContent.trim()}));
      const nav = make("nav", {className: "contents"}, ...links);
      nav.setAttribute("aria-label", "contents");
      $("main")[0].before(nav);
    }
    const open = () => {
      const at = location.hash.length > 1 && document.getElementById(decodeURIComponent(location.hash.slice(1)));
      for (let node = at || null; node; node = node.parentElement) if (node.tagName === "DETAILS") node.open = true;
      if (at) at.scrollIntoView();
    };
    addEventListener("hashchange", open);
    open();
  }

  tables();
  commands();
  anchors();
  figures();
  addEventListener("beforeprint", () => $("details").forEach(d => { d.open = true; }));
})();
