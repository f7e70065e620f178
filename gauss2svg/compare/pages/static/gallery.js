// Interaction of the pages, which are complete without it.
(() => {
  "use strict";
  const by = (id) => document.getElementById(id);
  const all = (selector, root = document) => [...root.querySelectorAll(selector)];

  // ---- first page: sort, filter, switch the variant, show thumbnails or SVGs
  function index() {
    const list = by("cards");
    const cards = all(".card", list).map((node, order) => ({
      node, order, name: node.dataset.name, svgs: JSON.parse(node.dataset.svgs),
    }));
    const find = by("find"), least = by("least"), sort = by("sort"), reverse = by("reverse");
    const variant = by("variant"), live = by("live");
    const byName = new Intl.Collator(undefined, { numeric: true, sensitivity: "base" });

    function numberOf(card, key) {
      const svg = card.svgs[variant.value];
      if (!svg) return null;
      if (key === "psnr_svg" && svg[key] === null) return Infinity; // equal to its photo
      return key === "gaussians" ? svg.gaussians ?? svg.elements : svg[key];
    }
    function compare(a, b) {
      const key = sort.value, turn = reverse.checked ? -1 : 1;
      if (key === "") return turn * (a.order - b.order);
      if (key === "photo") return turn * byName.compare(a.name, b.name) || a.order - b.order;
      const [x, y] = [numberOf(a, key), numberOf(b, key)];
      if (x === null || y === null) return (x === null) - (y === null) || a.order - b.order;
      return (x === y ? 0 : turn * (x - y)) || a.order - b.order; // x - y is NaN for two infinities
    }
    function arrange() {
      const wanted = find.value.trim().toLocaleLowerCase(), floor = least.valueAsNumber;
      let shown = 0;
      for (const card of [...cards].sort(compare)) {
        const psnr = numberOf(card, "psnr_svg");
        const fits = card.name.toLocaleLowerCase().includes(wanted)
          && (Number.isNaN(floor) || (psnr !== null && psnr >= floor));
        card.node.hidden = !fits;
        shown += fits;
        list.append(card.node);
      }
      by("count").textContent = shown ? `${shown} of ${cards.length} shown` : "No photo matches";
    }
    function showVariant() {
      for (const { node, svgs } of cards) {
        const one = svgs[variant.value];
        const picture = node.querySelector("img");
        const label = node.querySelector(".variant");
        if (!one) {
          picture.src = node.dataset.photo;
          if (Object.keys(svgs).length) label.textContent = "not available for this photo";
          for (const cell of all("[data-number]", node)) cell.textContent = "–";
          continue;
        }
        const source = live.checked ? one.picture : one.thumbnail;
        if (picture.getAttribute("src") !== source) {
          if (live.checked) picture.loading = "lazy"; // rasterised when it comes into view
          picture.src = source;
        }
        label.textContent = one.name;
        for (const cell of all("[data-number]", node)) cell.textContent = one.texts[cell.dataset.number];
        const anchor = node.querySelector("a");
        anchor.href = anchor.getAttribute("href").split("#")[0] + "#" + variant.value;
      }
    }
    for (const control of [find, least, sort, reverse]) control.addEventListener("input", arrange);
    live.addEventListener("input", showVariant);
    variant.addEventListener("input", () => { showVariant(); arrange(); });
    by("controls").addEventListener("submit", (event) => event.preventDefault());
    showVariant();
    arrange();
    // By then a browser that navigates back has restored the state of the controls.
    window.addEventListener("pageshow", () => { showVariant(); arrange(); });
  }

  // ---- photo: the divider, zoom, rounds, error map, outlines, variants
  function photo() {
    const variants = JSON.parse(by("data").textContent);
    const stage = by("stage"), slider = by("slider"), picture = by("svg"), outlines = all(".outlines");
    const form = by("controls"), rounds = by("rounds"), outlined = by("outlined");
    const side = (name) => Number(by("photo").getAttribute(name));
    const size = { w: side("width"), h: side("height") };
    const centre = { x: 0.5, y: 0.5 }; // of the visible part, as a fraction of the image
    const chosen = (name) => form.elements[name].value;
    const variant = () => variants.find((one) => one.slug === chosen("variant"));

    function setSource(image, source) {
      if (image.getAttribute("src") !== source) image.src = source;
    }
    // One at a time: a large SVG takes a while to load, and of the rounds that the slider passes in
    // that time only the last is needed.
    let wanted = picture.getAttribute("src"), isLoading = false;
    function setPicture(source) {
      wanted = source;
      if (isLoading || picture.getAttribute("src") === wanted) return;
      isLoading = true;
      picture.src = wanted;
    }
    for (const kind of ["load", "error"]) picture.addEventListener(kind, () => {
      isLoading = false;
      setPicture(wanted);
    });
    function showPicture() {
      const one = variant(), errors = chosen("side") === "errors";
      const last = one.rounds.length, round = Number(rounds.value);
      // The query gives this image an address of its own: browsers share one document, and its
      // fragment, between all images of the same address.
      const upTo = round < last ? `?rounds#round-${one.rounds[round - 1][0]}` : "";
      setPicture(errors ? one.errors : one.picture + upTo);
      picture.classList.toggle("pixels", errors);
      picture.alt = errors ? `Error map of ${one.name}` : `The SVG, ${one.name}`;
      by("badge").textContent = errors ? `Errors, ${one.name}` : `SVG, ${one.name}`;
      by("legend").hidden = !errors;
      if (last) {
        const [number, count] = one.rounds[round - 1];
        const text = `after round ${number}: ${count.toLocaleString("en").replaceAll(",", "\u202f")} Gaussians`;
        by("round").textContent = text;
        rounds.setAttribute("aria-valuetext", text);
      }
      rounds.disabled = errors;
      const strokes = outlined.checked && one.outlines;
      for (const image of outlines) {
        if (strokes) setSource(image, one.outlines + upTo);
        image.hidden = !strokes;
      }
      outlined.disabled = !one.outlines;
      describeDivider();
    }
    function showVariant() {
      const one = variant();
      by("rounds-field").hidden = one.rounds.length < 2;
      rounds.max = Math.max(one.rounds.length, 1);
      rounds.value = rounds.max;
      for (const node of all("[data-chosen]")) node.textContent = one.name;
      for (const node of all("[data-errors]")) node.src = one.errors;
      for (const row of all(".crops")) {
        const crop = one[row.dataset.kind];
        for (const [name, value] of [["--cx", crop.x], ["--cy", crop.y]]) row.style.setProperty(name, value);
        document.querySelector(`[data-psnr="${row.dataset.kind}"]`).textContent =
          crop.psnr === null ? "equal" : `${crop.psnr.toFixed(2)}\u202fdB`;
      }
      showPicture();
    }

    const HINTS = {
      fit: "Drag the divider, or use the arrow keys.",
      zoomed: "Drag the image, or press Shift and the arrow keys, to move it. Drag the handle, or press the arrow keys, to move the divider.",
    };
    // Four properties of the stage lay out both sides and the outlines.
    function layOut() {
      const zoom = chosen("zoom"), fit = zoom === "fit";
      stage.classList.toggle("zoomed", !fit);
      slider.handle = String(!fit); // elsewhere, dragging moves the image
      by("hint").textContent = fit ? HINTS.fit : HINTS.zoomed;
      if (fit) {
        for (const name of ["--left", "--top", "--wide", "--high"]) stage.style.removeProperty(name);
        return;
      }
      for (const [side, extent, place, length, seen] of [
        ["w", "--wide", "--left", stage.clientWidth, "x"], ["h", "--high", "--top", stage.clientHeight, "y"],
      ]) {
        const whole = size[side] * Number(zoom), half = length / whole / 2;
        centre[seen] = half >= 0.5 ? 0.5 : Math.min(Math.max(centre[seen], half), 1 - half);
        stage.style.setProperty(extent, `${whole}px`);
        stage.style.setProperty(place, `${Math.round(length / 2 - centre[seen] * whole)}px`);
      }
    }
    function move(dx, dy) {
      const zoom = Number(chosen("zoom"));
      centre.x -= dx / (size.w * zoom);
      centre.y -= dy / (size.h * zoom);
      layOut();
    }

    function describeDivider() {
      const share = Math.round(slider.value);
      slider.setAttribute("aria-valuenow", share);
      const other = chosen("side") === "errors" ? "error map" : "SVG";
      slider.setAttribute("aria-valuetext", `${share} % photo, ${100 - share} % ${other}`);
    }
    for (const [name, value] of [["role", "slider"], ["aria-label", "Divider between the photo and the other side"],
      ["aria-valuemin", 0], ["aria-valuemax", 100], ["aria-orientation", "horizontal"], ["aria-describedby", "hint"]])
      slider.setAttribute(name, value);
    slider.addEventListener("slide", describeDivider);
    slider.addEventListener("keydown", (event) => {
      const arrows = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
      // The slider's own arrow keys move it only while they are held, and not at all by a tap.
      const steps = {
        Home: -100, End: 100, PageUp: 10, PageDown: -10,
        ArrowLeft: -2, ArrowDown: -2, ArrowRight: 2, ArrowUp: 2,
      };
      if (event.altKey || event.ctrlKey || event.metaKey) return;
      if (event.shiftKey && event.key in arrows && stage.classList.contains("zoomed")) {
        move(...arrows[event.key].map((step) => step * 60));
      } else if (event.key in steps) {
        slider.value = Math.min(Math.max(slider.value + steps[event.key], 0), 100);
        describeDivider();
      } else return;
      event.preventDefault();
      event.stopImmediatePropagation(); // the slider's own listener would move the divider as well
    }, { capture: true });
    // The slider reacts to all mouse buttons, so that opening a menu would move it.
    slider.addEventListener("mousedown", (event) => {
      if (event.button !== 0) event.stopImmediatePropagation();
    }, { capture: true });

    let from = null;
    stage.addEventListener("pointerdown", (event) => {
      if (!stage.classList.contains("zoomed") || event.button !== 0 || onHandle(event)) return;
      if (!event.isPrimary) return; // a second finger
      from = { x: event.clientX, y: event.clientY };
      stage.setPointerCapture(event.pointerId);
      stage.classList.add("grabbed");
    });
    stage.addEventListener("pointermove", (event) => {
      if (from === null || !event.isPrimary) return;
      move(event.clientX - from.x, event.clientY - from.y);
      from = { x: event.clientX, y: event.clientY };
    });
    for (const kind of ["pointerup", "pointercancel"]) stage.addEventListener(kind, () => {
      from = null;
      stage.classList.remove("grabbed");
    });
    function onHandle(event) {
      const box = slider.shadowRoot.getElementById("handle").getBoundingClientRect();
      return event.clientX >= box.left && event.clientX <= box.right
        && event.clientY >= box.top && event.clientY <= box.bottom;
    }

    function followAddress() { // show the variant that the address names
      const slug = location.hash.slice(1);
      if (!variants.some((one) => one.slug === slug)) return;
      form.elements.variant.value = slug;
      showVariant();
    }
    form.addEventListener("input", (event) => {
      if (event.target.name === "variant") {
        showVariant();
        history.replaceState(null, "", `#${chosen("variant")}`);
      } else if (event.target.name === "zoom") layOut();
      else showPicture();
    });
    form.addEventListener("submit", (event) => event.preventDefault());
    rounds.addEventListener("input", showPicture);
    window.addEventListener("hashchange", followAddress);
    new ResizeObserver(layOut).observe(stage);
    showVariant();
    layOut();
    followAddress();
  }

  if (by("cards")) index();
  if (by("viewer")) photo();
})();
