"use strict";
// Hands the page's plots to Bokeh, one after the other, and gives them the colours of the page.
(() => {
  const plots = JSON.parse(document.getElementById("plots").textContent);
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const font = "system-ui, sans-serif";
  const root = document.documentElement;
  Bokeh.logger.set_level?.("warn");

  function palette(isDark) {
    return isDark
      ? { ink: "#e4e8ee", soft: "#98a4b3", line: "#2f3845" }
      : { ink: "#1c2330", soft: "#5b6675", line: "#dde2e9" };
  }

  function unpack(text) {
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    return Array.from(new Float32Array(bytes.buffer));
  }

  function range(axis) {
    return axis.low === null ? undefined : new Bokeh.Range1d({ start: axis.low, end: axis.high });
  }

  const shown = (colour) => (colour === "ink" ? palette(dark.matches).ink : colour);

  function glyph(figure, layer, source) {
    const colour = shown(layer.colour);
    const more = layer.second ? { y_range_name: "second" } : {};
    const x = { field: "x" }, y = { field: "y" }, low = { field: "low" }, high = { field: "high" };
    const stroke = { line_color: colour, line_width: layer.width, line_dash: layer.dash,
      line_alpha: layer.alpha };
    if (layer.kind === "line") return figure.line({ x, y, source, ...stroke, ...more });
    if (layer.kind === "band") {
      return figure.varea({ x, y1: low, y2: high, source, fill_color: colour,
        fill_alpha: layer.alpha });
    }
    if (layer.kind === "bars") {
      return figure.vbar({ x, width: layer.width, bottom: low, top: high, source,
        fill_color: colour, fill_alpha: layer.alpha, line_color: null });
    }
    const hollow = layer.marker !== "circle";
    return figure.scatter({ x, y, source, size: layer.size,
      marker: layer.marker === "ring" ? "circle" : layer.marker,
      fill_color: hollow ? null : colour, fill_alpha: layer.alpha,
      line_color: hollow ? colour : null, line_width: layer.width });
  }

  function mark(figure, layer) {
    const columns = Object.fromEntries(
      Object.entries(layer.data).map(([name, text]) => [name, unpack(text)]));
    if (layer.kind === "guide") {
      for (const location of columns.x) {
        figure.add_layout(new Bokeh.Span({ location, dimension: "height",
          line_color: shown(layer.colour), line_dash: layer.dash, line_width: layer.width }));
      }
    } else {
      columns.low.forEach((left, k) => figure.add_layout(new Bokeh.BoxAnnotation({ left,
        right: columns.high[k], fill_color: shown(layer.colour), fill_alpha: layer.alpha,
        line_color: shown(layer.colour), line_alpha: 0.5 })));
    }
  }

  function addLayers(figure, spec) {
    const named = new Map();
    for (const layer of spec.layers) {
      if (layer.kind === "guide" || layer.kind === "shade") {
        mark(figure, layer);
        continue;
      }
      const data = Object.fromEntries(
        Object.entries(layer.data).map(([name, text]) => [name, unpack(text)]));
      const renderer = glyph(figure, layer, new Bokeh.ColumnDataSource({ data }));
      if (layer.colour === "ink") renderer.glyph.tags = ["ink"];
      if (layer.hover.length > 0) {
        figure.add_tools(new Bokeh.HoverTool({ renderers: [renderer], tooltips: layer.hover,
          visible: false }));
      }
      if (layer.label !== "") {
        named.set(layer.label, [...(named.get(layer.label) ?? []), renderer]);
      }
    }
    return named;
  }

  function addLegend(figure, named, columns) {
    if (named.size === 0) return;
    const items = [...named].map(([value, renderers]) =>
      new Bokeh.LegendItem({ label: { value }, renderers }));
    const narrow = window.innerWidth < 600;
    figure.add_layout(new Bokeh.Legend({ items, click_policy: "hide", location: "left",
      ncols: narrow ? Math.min(columns, 2) : columns + 1, background_fill_color: null,
      border_line_color: null, label_text_font_size: "12px", label_standoff: 6, spacing: 10,
      padding: 2, margin: 2, glyph_height: 16, glyph_width: 22 }), "below");
  }

  function build(spec) {
    const ranges = {};
    if (range(spec.x)) ranges.x_range = range(spec.x);
    if (range(spec.y)) ranges.y_range = range(spec.y);
    const figure = Bokeh.Plotting.figure({
      height: 380, sizing_mode: "stretch_width", tools: "pan,box_zoom,wheel_zoom,reset,save",
      x_axis_type: spec.x.log ? "log" : "linear", y_axis_type: spec.y.log ? "log" : "linear",
      x_axis_label: spec.x.label, y_axis_label: spec.y.label, match_aspect: spec.equal,
      background_fill_color: null, border_fill_color: null, outline_line_color: null,
      min_border_left: 58, ...ranges,
    });
    figure.toolbar.logo = null;
    figure.toolbar.autohide = true;
    figure.toolbar.active_drag = null;
    figure.toolbar.active_scroll = null;
    if (spec.second_y !== null) {
      figure.extra_y_ranges = { second: range(spec.second_y) };
      figure.add_layout(new Bokeh.LinearAxis({ y_range_name: "second",
        axis_label: spec.second_y.label }), "right");
    }
    addLegend(figure, addLayers(figure, spec), spec.columns);
    return figure;
  }

  // Bokeh's models take their colours as properties: set those that a theme decides
  function paint(model, colours) {
    const set = (name, value) => { if (name in model.properties) model[name] = value; };
    if ("axis_label_text_color" in model.properties) {
      set("axis_label_text_color", colours.soft);
      set("axis_label_text_font", font);
      set("axis_label_text_font_style", "normal");
      set("axis_label_text_font_size", "12px");
      set("major_label_text_color", colours.soft);
      set("major_label_text_font", font);
      set("major_label_text_font_size", "11px");
      set("axis_line_color", colours.soft);
      set("major_tick_line_color", colours.soft);
      set("minor_tick_line_color", null);
    }
    set("grid_line_color", colours.line);
    set("label_text_color", colours.ink);
    set("label_text_font", font);
    if (model.tags?.includes("ink")) {
      for (const name of ["line_color", "fill_color"]) {
        if (model.properties[name]?.get_value()?.value) model[name] = colours.ink;
      }
    }
  }

  function walk(figure, colours) {
    for (const model of figure.references()) paint(model, colours);
  }

  const figures = [];
  async function draw() {
    const colours = palette(dark.matches);
    for (const [k, spec] of plots.entries()) {
      const target = document.getElementById(`figure-${k + 1}`);
      try {
        const figure = build(spec);
        walk(figure, colours);
        await Bokeh.Plotting.show(figure, target);
        figures.push(figure);
      } catch (error) {
        target.textContent = "This figure could not be drawn.";
        console.error(error);
      }
      root.dataset.drawn = `${figures.length}/${plots.length}`;
      await new Promise((resolve) => setTimeout(resolve, 0));
    }
    root.dataset.ready = figures.length === plots.length ? "yes" : "no";
  }

  const repaint = (isDark) => figures.forEach((figure) => walk(figure, palette(isDark)));
  dark.addEventListener("change", () => repaint(dark.matches));
  window.addEventListener("beforeprint", () => repaint(false));
  window.addEventListener("afterprint", () => repaint(dark.matches));
  draw();
})();
