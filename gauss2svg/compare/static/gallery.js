// Interaction of the pages. Without scripts they show the same results.
(() => {
  "use strict";

  /** @typedef {{ x: number, y: number, psnr: string }} Crop */
  /** @typedef {{ slug: string, name: string, folder: string, isOwn: boolean, texts: Record<string, string>,
   *   rounds: [number, string][], worst: Crop, typical: Crop } & Record<string, number | null>} Svg */

  // ---- first page: sort, filter, switch the variant, show thumbnails or SVGs
  function index() {
    const list = by("cards");
    const cards = all(".card", list).map((node, order) => ({
      node, order, name: node.dataset.name ?? "", svgs: /** @type {Svg[]} */ (JSON.parse(node.dataset.svgs ?? "")),
    }));
    const [find, least, reverse, live] = ["find", "least", "reverse", "live"].map((id) => by(id, HTMLInputElement));
    const [sort, variant] = ["sort", "variant"].map((id) => by(id, HTMLSelectElement));
    const byName = new Intl.Collator(undefined, { numeric: true, sensitivity: "base" });

    /** @typedef {typeof cards[number]} Card */
    /** @param {Card} card @param {string} key */
    function numberOf(card, key) {
      const svg = card.svgs.find((one) => one.slug === variant.value);
      if (!svg) return null;
      if (key === "psnr_svg" && svg[key] === null) return Infinity; // the SVG equals its photo
      return key === "gaussians" ? svg.gaussians ?? svg.elements : svg[key];
    }
    /** @param {Card} a @param {Card} b */
    function compare(a, b) {
      const key = sort.value, turn = reverse.checked ? -1 : 1;
      if (key === "") return turn * (a.order - b.order);
      if (key === "photo") return turn * byName.compare(a.name, b.name) || a.order - b.order;
      const [x, y] = [numberOf(a, key), numberOf(b, key)];
      if (x === null || y === null) return Number(x === null) - Number(y === null) || a.order - b.order;
      return (x === y ? 0 : turn * (x - y)) || a.order - b.order; // x - y is NaN for two infinities
    }
    function arrange() {
      const searched = find.value.trim().toLocaleLowerCase(), floor = least.valueAsNumber;
      let shown = 0;
      for (const card of [...cards].sort(compare)) {
        const psnr = numberOf(card, "psnr_svg");
        const fits = card.name.toLocaleLowerCase().includes(searched)
          && (Number.isNaN(floor) || (psnr !== null && psnr >= floor));
        card.node.hidden = !fits;
        shown += Number(fits);
        list.append(card.node);
      }
      by("count").textContent = shown ? `${shown} of ${cards.length} shown` : "No photo matches";
    }
    function showVariant() {
      for (const { node, svgs } of cards) {
        const one = svgs.find((svg) => svg.slug === variant.value);
        const [picture] = all("img", node, HTMLImageElement), [label] = all(".variant", node);
        if (!one) {
          picture.src = node.dataset.photo ?? "";
          if (svgs.length) label.textContent = "not available for this photo";
          for (const cell of all("[data-number]", node)) cell.textContent = "–";
          continue;
        }
        const source = `${one.folder}/${live.checked ? "picture.svg" : "thumbnail.png"}`;
        if (picture.getAttribute("src") !== source) {
          if (live.checked) picture.loading = "lazy"; // rasterise it when it comes into view
          picture.src = source;
        }
        label.textContent = one.name;
        for (const cell of all("[data-number]", node)) cell.textContent = one.texts[cell.dataset.number ?? ""];
        for (const link of all("a", node)) link.setAttribute("href", `${link.getAttribute("href")?.split("#")[0]}#${variant.value}`);
      }
    }
    for (const control of [find, least, sort, reverse]) control.addEventListener("input", arrange);
    live.addEventListener("input", showVariant);
    variant.addEventListener("input", () => { showVariant(); arrange(); });
    by("controls").addEventListener("submit", (event) => event.preventDefault());
    showVariant();
    arrange();
    // If the user navigates back, the browser restores the state of the controls before pageshow.
    window.addEventListener("pageshow", () => { showVariant(); arrange(); });
  }

  // ---- page of a photo: show its variants in the viewer
  function photo() {
    const variants = /** @type {Svg[]} */ (JSON.parse(by("data", HTMLScriptElement).text));
    const form = by("controls", HTMLFormElement), outlined = by("outlined", HTMLInputElement);
    const original = by("photo", HTMLImageElement), zooms = all("[name=zoom]", form, HTMLInputElement);
    const viewer = new Viewer((zoom) => {
      for (const one of zooms) one.checked = one.value === String(zoom ?? "fit");
    });
    /** @param {string} name */
    const chosen = (name) => new FormData(form).get(name);
    const variant = () => variants.find((one) => one.slug === chosen("variant")) ?? variants[0];

    function showPicture() {
      const one = variant(), isErrors = chosen("side") === "errors";
      // The query makes the address of this image different from others. Browsers share one document,
      // with its fragment, between all images of the same address.
      const upTo = viewer.round < one.rounds.length ? `?rounds#round-${one.rounds[viewer.round - 1][0]}` : "";
      viewer.show("right", isErrors
        ? { src: `${one.slug}/errors.png`, name: "error map", alt: `Error map of ${one.name}`, badge: `Errors, ${one.name}`, isErrors }
        : { src: `${one.slug}/picture.svg${upTo}`, name: "SVG", alt: `The SVG, ${one.name}`, badge: `SVG, ${one.name}` });
      const strokes = outlined.checked && one.isOwn ? `${one.slug}/outlines.svg${upTo}` : null;
      viewer.outline("left", strokes);
      viewer.outline("right", strokes);
      outlined.disabled = !one.isOwn;
    }
    function showVariant() {
      const one = variant();
      viewer.setRounds(one.rounds.map(([number, count]) => `after round ${number}: ${count} Gaussians`));
      for (const node of all("[data-chosen]")) node.textContent = one.name;
      for (const node of all("[data-errors]", document, HTMLImageElement)) node.src = `${one.slug}/errors.png`;
      for (const row of all(".crops")) {
        const { x, y, psnr } = one[row.dataset.kind === "worst" ? "worst" : "typical"];
        row.style.setProperty("--cx", String(x));
        row.style.setProperty("--cy", String(y));
        for (const node of all(`[data-psnr="${row.dataset.kind}"]`)) node.textContent = psnr;
      }
      showPicture();
    }

    function followAddress() { // show the variant that the address names
      const slug = location.hash.slice(1), radio = all("[name=variant]", form, HTMLInputElement).find((one) => one.value === slug);
      if (!radio) return;
      radio.checked = true;
      showVariant();
    }
    form.addEventListener("input", ({ target }) => {
      const { name, value } = /** @type {HTMLInputElement} */ (target);
      if (name === "variant") {
        showVariant();
        history.replaceState(null, "", `#${value}`);
      } else if (name !== "zoom") showPicture();
      else if (value === "fit") viewer.fit();
      else viewer.zoomTo(Number(value));
    });
    form.addEventListener("submit", (event) => event.preventDefault());
    by("rounds").addEventListener("input", showPicture);
    window.addEventListener("hashchange", followAddress);
    viewer.open(Number(original.getAttribute("width")), Number(original.getAttribute("height")));
    viewer.show("left", { src: original.getAttribute("src") ?? "", name: "photo", alt: original.alt, badge: "Photo" });
    showVariant();
    followAddress();
  }

  if (document.getElementById("cards")) index();
  if (document.getElementById("viewer")) photo();
})();
