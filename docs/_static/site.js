// What the theme leaves out for people who use a keyboard or a screen reader.
addEventListener("DOMContentLoaded", () => {
  for (const [name, label] of [["sidebar-drawer", "Site"], ["toc-drawer", "This page"]]) {
    document.querySelector(`.${name}`)?.setAttribute("aria-label", label);
  }
  for (const box of document.querySelectorAll("pre, .table-wrapper")) {
    if (box.scrollWidth > box.clientWidth) box.tabIndex = 0;
  }
});

// The start page's picture: without this script its last frame.
addEventListener("DOMContentLoaded", () => {
  const start = document.getElementById("start");
  if (!start) return;
  const [image, list] = [start.querySelector("img"), start.querySelector("ol")];
  const [label, slider] = [start.querySelector("label"), start.querySelector("input")];
  const address = (k) => image.src.replace(/\d+(?=\.webp)/, list.dataset.frames.split(" ")[k]);
  const show = () => {
    const k = Number(slider.value);
    image.src = address(k);
    slider.ariaValueText = list.children[k].textContent;
    for (const [n, line] of [...list.children].entries()) line.hidden = n !== k;
  };
  for (let k = 0; k < list.children.length; k++) new Image().src = address(k);
  slider.addEventListener("input", show);
  label.hidden = false;
  show();
});
