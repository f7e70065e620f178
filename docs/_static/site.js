// What the theme leaves out for people who use a keyboard or a screen reader.
addEventListener("DOMContentLoaded", () => {
  for (const [name, label] of [["sidebar-drawer", "Site"], ["toc-drawer", "This page"]]) {
    document.querySelector(`.${name}`)?.setAttribute("aria-label", label);
  }
  for (const box of document.querySelectorAll("pre, .table-wrapper")) {
    if (box instanceof HTMLElement && box.scrollWidth > box.clientWidth) box.tabIndex = 0;
  }
});

// The start page's sliders: without this script each shows its last frame.
addEventListener("DOMContentLoaded", () => {
  for (const figure of document.querySelectorAll("figure.start")) {
    const image = figure.querySelector("img"), lines = [...figure.querySelectorAll("li")];
    const frames = figure.querySelector("ol")?.dataset.frames?.split(" ");
    const label = figure.querySelector("label"), slider = figure.querySelector("input");
    if (!image || !frames || !label || !slider) continue;
    /** @param {number} k */
    const address = (k) => image.src.replace(/[^/]+(?=\.webp)/, frames[k]);
    const show = () => {
      const k = Number(slider.value);
      image.src = address(k);
      slider.ariaValueText = lines[k].textContent;
      for (const [n, line] of lines.entries()) line.hidden = n !== k;
    };
    for (const k of lines.keys()) new Image().src = address(k);
    slider.addEventListener("input", show);
    label.hidden = false;
    show();
  }
});
