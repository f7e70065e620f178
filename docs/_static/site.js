// What the theme leaves out for people who use a keyboard or a screen reader.
addEventListener("DOMContentLoaded", () => {
  for (const [name, label] of [["sidebar-drawer", "Site"], ["toc-drawer", "This page"]]) {
    document.querySelector(`.${name}`)?.setAttribute("aria-label", label);
  }
  for (const box of document.querySelectorAll("pre, .table-wrapper")) {
    if (box instanceof HTMLElement && box.scrollWidth > box.clientWidth) box.tabIndex = 0;
  }
});

// The start page's picture: without this script its last frame.
addEventListener("DOMContentLoaded", () => {
  const start = document.getElementById("start");
  const image = start?.querySelector("img"), lines = [...start?.querySelectorAll("li") ?? []];
  const frames = start?.querySelector("ol")?.dataset.frames?.split(" ");
  const label = start?.querySelector("label"), slider = start?.querySelector("input");
  if (!image || !frames || !label || !slider) return;
  /** @param {number} k */
  const address = (k) => image.src.replace(/\d+(?=\.webp)/, frames[k]);
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
});
