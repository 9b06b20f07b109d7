"use strict";
// Draws the figures one after the other, and gives them the colours of the page.
(() => {
  const items = JSON.parse(document.getElementById("figures").textContent);
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const font = "system-ui, sans-serif";

  function palette(isDark) {
    return isDark
      ? { ink: "#e4e8ee", soft: "#98a4b3", line: "#2f3845", measured: "#e4e8ee" }
      : { ink: "#1c2330", soft: "#5b6675", line: "#dde2e9", measured: "#1c2330" };
  }

  function paint(model, colours) {
    const has = (name) => name in model.properties;
    const set = (name, value) => { if (has(name)) model[name] = value; };
    if (has("axis_label_text_color")) {
      set("axis_label_text_color", colours.soft);
      set("major_label_text_color", colours.soft);
      set("axis_line_color", colours.soft);
      set("major_tick_line_color", colours.soft);
      set("minor_tick_line_color", null);
      set("axis_label_text_font", font);
      set("major_label_text_font", font);
    }
    if (has("grid_line_color")) set("grid_line_color", colours.line);
    if (has("label_text_color")) {
      set("label_text_color", colours.ink);
      set("label_text_font", font);
    }
    if (has("tags") && model.tags.includes("ink")) {
      for (const name of ["line_color", "fill_color", "hatch_color"]) {
        if (has(name) && model[name] && model[name].value !== null) model[name] = colours.measured;
      }
      if (has("text_color")) model.text_color = colours.measured;
    }
  }

  function paintAll(isDark) {
    const colours = palette(isDark);
    for (const document_ of Bokeh.documents) {
      for (const model of document_._all_models.values()) paint(model, colours);
    }
  }

  let drawn = 0;
  let failed = 0;
  async function draw() {
    for (const item of items) {
      try {
        await Bokeh.embed.embed_item(item);
        drawn += 1;
      } catch (error) {
        failed += 1;
        document.getElementById(item.target_id).textContent = "This figure could not be drawn.";
        console.error(error);
      }
      document.documentElement.dataset.drawn = `${drawn}/${items.length}`;
      await new Promise((resolve) => setTimeout(resolve, 0));
    }
    paintAll(dark.matches);
    document.documentElement.dataset.ready = failed === 0 ? "yes" : "no";
  }

  dark.addEventListener("change", () => paintAll(dark.matches));
  window.addEventListener("beforeprint", () => paintAll(false));
  window.addEventListener("afterprint", () => paintAll(dark.matches));
  draw();
})();
