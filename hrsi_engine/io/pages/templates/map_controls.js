"use strict";
// The map of a block: move about, zoom, choose points, filter and colour them. The drawing itself stands in the page;
// its figures come from the page's data (results/drawings.py names them).
(() => {
  const data = JSON.parse(document.getElementById("page-data").textContent);
  const svg = document.getElementById("block-map");
  const view = svg.querySelector(".view");
  const { map, points, measurements, images, roles } = data;
  const byId = (id) => document.getElementById(id);
  const marks = new Map([...svg.querySelectorAll(".pt")].map((mark) => [Number(mark.dataset.p), mark]));
  const cells = [...svg.querySelectorAll(".cells path")];
  const footprints = new Map([...svg.querySelectorAll(".footprint")].map((ring) => [Number(ring.dataset.i), ring]));
  const SVG = svg.namespaceURI;
  const MOST_ZOOM = 2000, MOST_NAMES = 120;
  const FLAGS = ["", "outlier", "left out"];

  const numberOf = new Map(points.id.map((id, number) => [id, number]));
  const rowsOf = points.id.map(() => []);
  measurements.point.forEach((point, row) => rowsOf[point].push(row));

  const element = (name, text, parent) => {
    const made = document.createElement(name);
    if (text !== undefined) made.textContent = text;
    if (parent) parent.append(made);
    return made;
  };
  const decimals = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits).replace("-", "−"));

  // ---- Where the map stands: drawing = zoom * place + shift -------------------------------------------------------
  let zoom = 1, shift = [0, 0], grow = 1; // grow: text and points on a narrow screen

  const move = (newZoom, newShift, onPaper = false) => {
    zoom = Math.min(Math.max(newZoom, 1), MOST_ZOOM);
    shift = newShift.map((value, axis) => {
      const size = axis ? map.height : map.width;
      return Math.min(Math.max(value, size * (1 - zoom)), 0); // the map fills its frame
    });
    view.setAttribute("transform", `matrix(${zoom} 0 0 ${zoom} ${shift[0]} ${shift[1]})`);
    grow = onPaper ? 1 : Math.min(Math.max((0.85 * map.width) / svg.clientWidth, 1), 2);
    svg.style.setProperty("--shrink", 1 / zoom);
    svg.style.setProperty("--grow", grow);
    svg.dataset.zoom = zoom;
    drawScale();
    drawGraticule();
    placeLabels();
  };
  const zoomAt = (factor, x, y) => {
    const next = Math.min(Math.max(zoom * factor, 1), MOST_ZOOM);
    const ratio = next / zoom;
    move(next, [x - ratio * (x - shift[0]), y - ratio * (y - shift[1])]);
  };
  const zoomMiddle = (factor) => zoomAt(factor, map.width / 2, map.height / 2);
  const showAll = () => move(1, [0, 0]);
  const toDrawing = (event) => {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    return [at.x, at.y];
  };
  const toPlace = ([x, y]) => [(x - shift[0]) / zoom, (y - shift[1]) / zoom];

  const polynomial = ([a, b, c, d, e, f], u, v) => a + b * u + c * v + d * u * u + e * u * v + f * v * v;
  const toDegrees = ([x, y]) => map.toDegrees.map((terms, axis) => map.origin[axis] + polynomial(terms, x / 100, y / 100));
  const fromDegrees = (lon, lat) => map.toDrawing.map((terms) => polynomial(terms, lon - map.origin[0], lat - map.origin[1]));

  // ---- Scale bar and graticule ------------------------------------------------------------------------------------
  const roundLength = (longest) => {
    const power = 10 ** Math.floor(Math.log10(longest));
    return [5, 2, 1].map((step) => step * power).find((length) => length <= longest * 1.000001);
  };
  const metres = (length) => {
    const [unit, size] = [["km", 1000], ["m", 1], ["cm", 0.01], ["mm", 0.001]].find(([, one]) => length >= one) ?? ["m", 1];
    return `${Number((length / size).toPrecision(6))} ${unit}`;
  };
  const drawScale = () => {
    const perMetre = map.unitsPerMetre * zoom;
    const length = roundLength(150 / perMetre);
    const bar = svg.querySelector("path.scale.length");
    bar.setAttribute("d", bar.getAttribute("d").replace(/h[-\d.]+/, `h${(length * perMetre).toFixed(1)}`));
    svg.querySelector("text.scale.length").textContent = `${metres(length)} on the ground`;
  };
  const degrees = (value, step, axis) => {
    const digits = Math.max(0, Math.ceil(-Math.log10(step) - 1e-9));
    const wrapped = axis ? value : ((((value + 180) % 360) + 360) % 360) - 180;
    const letter = axis ? (wrapped < 0 ? "S" : "N") : wrapped < 0 ? "W" : "E";
    return `${Math.abs(wrapped).toFixed(digits)}° ${letter}`;
  };
  const drawGraticule = () => {
    const group = svg.querySelector(".graticule");
    group.replaceChildren();
    const low = toPlace([0, 0]), high = toPlace([map.width, map.height]);
    const corners = [low, [high[0], low[1]], [low[0], high[1]], high].map(toDegrees);
    for (const axis of [0, 1]) {
      const values = corners.map((corner) => corner[axis]), others = corners.map((corner) => corner[1 - axis]);
      const least = Math.min(...values), most = Math.max(...values);
      const step = roundLength((most - least) / 3);
      if (!(step > 0)) continue;
      for (let value = Math.ceil(least / step) * step; value <= most; value += step) {
        const line = [];
        for (let part = 0; part <= 8; part++) {
          const other = Math.min(...others) + (part / 8) * (Math.max(...others) - Math.min(...others));
          line.push(axis ? fromDegrees(other, value) : fromDegrees(value, other));
        }
        const path = document.createElementNS(SVG, "path");
        path.setAttribute("d", "M" + line.map(([x, y]) => `${x.toFixed(4)},${y.toFixed(4)}`).join("L"));
        // The name stands where the line leaves the frame: at the top, and at the left
        const inner = line.map(([x, y]) => [x * zoom + shift[0], y * zoom + shift[1]]);
        const edge = axis ? 0 : 1;
        const from = inner.findIndex((place, k) => k && (inner[k - 1][edge] - 6) * (place[edge] - 6) <= 0);
        group.append(path);
        if (from < 1) continue;
        const [a, b] = [inner[from - 1], inner[from]];
        const t = (6 - a[edge]) / (b[edge] - a[edge] || 1);
        const at = [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])];
        if (axis ? at[1] < 32 * grow : at[0] < 4) continue; // the corner is the other axis's
        const place = document.createElementNS(SVG, "g");
        const [x, y] = toPlace(axis ? [4, at[1] - 3] : [at[0] + 3, 13 * grow]);
        place.setAttribute("transform", `translate(${x} ${y})`);
        const text = document.createElementNS(SVG, "text");
        text.classList.add("mark");
        text.textContent = degrees(value, step, axis);
        place.append(text);
        group.append(place);
      }
    }
  };

  // ---- Names of known points, as far as there is room -------------------------------------------------------------
  const placeOf = new Map([...marks].map(([number, mark]) => {
    const [x, y] = mark.getAttribute("transform").match(/-?[\d.]+/g).map(Number);
    return [number, [x, y]];
  }));
  const labelOrder = [...marks.keys()].filter((number) => !["tie", "held_out"].includes(roles[points.role[number]]))
    .sort((a, b) => points.flag[b] - points.flag[a] || points.role[a] - points.role[b] || a - b);
  const labels = new Map();
  const labelOf = (number) => {
    if (!labels.has(number)) {
      const text = document.createElementNS(SVG, "text");
      text.classList.add("id");
      text.textContent = points.id[number];
      marks.get(number).querySelector(".mark").append(text);
      labels.set(number, text);
    }
    return labels.get(number);
  };
  const placeLabels = () => {
    const taken = [];
    const free = (box) => taken.every((other) => box[0] > other[2] || box[2] < other[0] || box[1] > other[3] || box[3] < other[1]);
    for (const text of labels.values()) text.style.display = "none";
    for (const number of labelOrder) {
      const mark = marks.get(number);
      if (mark.classList.contains("filtered") || mark.classList.contains("off")) continue;
      const place = placeOf.get(number);
      const [x, y] = [place[0] * zoom + shift[0], place[1] * zoom + shift[1]];
      if (x < 0 || y < 0 || x > map.width || y > map.height) continue;
      const width = (7.2 * points.id[number].length + 4) * grow;
      const sides = [[6, -5], [-width - 4, -5], [6, 14 * grow], [-width - 4, 14 * grow]];
      const boxOf = ([dx, dy]) => [x + dx, y + dy - 11 * grow, x + dx + width, y + dy + 2];
      const side = sides.find((at) => x + at[0] > 0 && x + at[0] + width < map.width && free(boxOf(at)));
      if (!side) continue;
      taken.push(boxOf(side));
      const text = labelOf(number);
      text.setAttribute("x", side[0]);
      text.setAttribute("y", side[1]);
      text.style.display = "";
      if (taken.length >= MOST_NAMES) break;
    }
  };

  // ---- Choosing a point: on the map, in images, chips and tables --------------------------------------------------
  const panel = byId("map-point");
  let chosen = -1;
  const link = (word, attribute, value, parent) => {
    const made = element("a", word, parent);
    made.href = "#map";
    made.dataset[attribute] = value;
  };
  const describe = (number) => {
    panel.replaceChildren();
    element("h3", points.id[number], panel);
    const list = element("dl", undefined, panel);
    const tell = (term, text) => {
      element("dt", term, list);
      element("dd", text, list);
    };
    tell("role", { gcp: "GCP", check: "check point", tie: "tie point", held_out: "held-out tie point" }[roles[points.role[number]]]);
    if (points.flag[number]) tell("flag", FLAGS[points.flag[number]]);
    tell("position", `${decimals(points.lat[number], 6)}°, ${decimals(points.lon[number], 6)}°, ${decimals(points.height[number], 2)} m`);
    if (points.east[number] !== null) {
      tell("survey − computed", `E ${decimals(points.east[number], 2)}, N ${decimals(points.north[number], 2)}${points.up[number] === null ? "" : `, H ${decimals(points.up[number], 2)}`} m`);
    }
    if (points.sigma[number] !== null) tell("sigma, position", `${decimals(points.sigma[number], 2)} m`);
    tell("images", String(points.rays[number]));
    const table = element("table", undefined, panel);
    const head = element("tr", undefined, element("thead", undefined, table));
    for (const word of ["image", "sample", "line", "Δ px"]) element("th", word, head).scope = "col";
    const body = element("tbody", undefined, table);
    for (const row of rowsOf[number]) {
      const line = element("tr", undefined, body);
      const name = element("th", undefined, line);
      name.scope = "row";
      link(images[measurements.image[row]], "image", images[measurements.image[row]], name);
      element("td", decimals(measurements.sample[row], 1), line);
      element("td", decimals(measurements.line[row], 1), line);
      const delta = element("td", `${decimals(measurements.dx[row], 2)}, ${decimals(measurements.dy[row], 2)}`, line);
      if (measurements.flag[row]) delta.className = "bad";
    }
  };
  const choose = (number, { center = false, reveal = false } = {}) => {
    for (const other of document.querySelectorAll(".chosen:not(.footprint)")) other.classList.remove("chosen");
    chosen = number;
    svg.dataset.chosen = number >= 0 ? points.id[number] : "";
    if (number < 0) {
      panel.replaceChildren();
      element("p", "Choose a point on the map, in an image or in a table.", panel).className = "note";
      return;
    }
    for (const other of document.querySelectorAll(`[data-p="${number}"]`)) other.classList.add("chosen");
    for (const other of document.querySelectorAll("a[data-point]")) {
      if (other.dataset.point !== points.id[number]) continue;
      const row = other.closest("tr");
      if (row) row.classList.add("chosen");
      const part = other.closest("details");
      if (part && reveal) part.open = true;
    }
    const mark = marks.get(number);
    if (mark) {
      mark.classList.remove("filtered", "off");
      mark.parentNode.append(mark); // above all others
      if (center) {
        const place = placeOf.get(number);
        const next = Math.max(zoom, 4);
        move(next, [map.width / 2 - next * place[0], map.height / 2 - next * place[1]]);
      }
    }
    describe(number);
  };

  document.addEventListener("click", (event) => {
    const target = event.target.closest("[data-point], a[data-image], [data-p]");
    if (!target || target.closest("#block-map")) return;
    if (target.dataset.image !== undefined) {
      chooseImage(images.indexOf(target.dataset.image));
      return;
    }
    const number = target.dataset.point !== undefined ? numberOf.get(target.dataset.point) : Number(target.dataset.p);
    if (number === undefined) { // one of many that are not shown one by one
      choose(-1);
      panel.replaceChildren();
      element("p", `${target.dataset.point} is one of many points that the map does not show one by one.`, panel);
      return;
    }
    choose(number, { center: true });
  });
  for (const row of document.querySelectorAll("tbody tr")) {
    const inner = row.querySelector("a[data-point], a[data-image]");
    if (inner) row.addEventListener("click", (event) => event.target.closest("a") || inner.click());
  }

  // ---- Filter and colour ------------------------------------------------------------------------------------------
  const pointImages = points.id.map((_, number) => new Set(rowsOf[number].map((row) => measurements.image[row])));
  const select = { image: byId("map-image"), flag: byId("map-flag"), colour: byId("map-colour"), arrows: byId("map-arrows") };
  images.forEach((name, number) => {
    const option = element("option", name, select.image);
    option.value = number;
  });
  const filter = () => {
    const shown = new Set([...byId("map-roles").querySelectorAll("input:checked")].map((box) => box.value));
    const image = select.image.value === "" ? -1 : Number(select.image.value), flag = Number(select.flag.value);
    for (const [number, mark] of marks) {
      const out = !shown.has(roles[points.role[number]]) || (image >= 0 && !pointImages[number].has(image)) || (flag && points.flag[number] !== flag);
      mark.classList.toggle("filtered", Boolean(out));
    }
    svg.querySelector(".cells").style.display = shown.has("tie") && !flag ? "" : "none";
    for (const [number, ring] of footprints) ring.classList.toggle("chosen", number === image);
    for (const picture of svg.querySelectorAll(".pictures use")) {
      const own = image >= 0 && picture.dataset.image === images[image];
      picture.style.display = image < 0 ? "" : own ? "inline" : "none";
    }
    placeLabels();
  };
  const chooseImage = (number) => {
    if (number < 0) return;
    select.image.value = String(number);
    filter();
  };

  const RAMP = ["#3b528b", "#21918c", "#5ec962", "#e8b22d", "#e8601c"];
  const TITLES = { residual: "residual, px", sigma: "sigma of the position, m", rays: "images of a point" };
  const colour = () => {
    const by = select.colour.value, ramp = byId("map-ramp");
    ramp.hidden = !by;
    const values = by ? [...marks.keys()].map((number) => points[by][number]).concat(map.cells[by] ?? []) : [];
    const known = values.filter((value) => value !== null && value !== undefined).sort((a, b) => a - b);
    const low = known[0] ?? 0, high = known[Math.floor(0.98 * (known.length - 1))] ?? 1;
    const shade = (value) => {
      if (value === null || value === undefined) return "var(--tie)";
      const share = high > low ? (value - low) / (high - low) : 0;
      return RAMP[Math.min(RAMP.length - 1, Math.max(0, Math.floor(share * RAMP.length)))];
    };
    for (const [number, mark] of marks) mark.querySelector(".dot").style.fill = by ? shade(points[by][number]) : "";
    for (const cell of cells) {
      cell.style.fill = by ? shade(map.cells[by][cell.dataset.c]) : "";
      cell.style.fillOpacity = by ? 0.75 : "";
    }
    ramp.replaceChildren();
    if (!by) return;
    element("span", `${TITLES[by]}: ${decimals(low, 2)} `, ramp);
    for (const tone of RAMP) element("i", undefined, ramp).style.background = tone;
    element("span", ` ${decimals(high, 2)} and more`, ramp);
  };
  byId("map-roles").addEventListener("change", filter);
  select.image.addEventListener("change", filter);
  select.flag.addEventListener("change", filter);
  select.colour.addEventListener("change", colour);
  select.arrows.addEventListener("change", () => { svg.dataset.arrows = select.arrows.value; });
  byId("zoom-in").addEventListener("click", () => zoomMiddle(2));
  byId("zoom-out").addEventListener("click", () => zoomMiddle(0.5));
  byId("zoom-all").addEventListener("click", showAll);

  // ---- What the images show ---------------------------------------------------------------------------------------
  const cardArrows = byId("cards-arrows");
  cardArrows?.addEventListener("change", () => { document.querySelector("div.cards").dataset.arrows = cardArrows.value; });

  // ---- Pointer: drag to move, wheel to zoom, click to choose ------------------------------------------------------
  const held = new Map();
  let start = null;
  const tellPlace = (event) => {
    const [lon, lat] = toDegrees(toPlace(toDrawing(event)));
    const cell = event.target.closest?.(".cells path");
    const figures = cell && map.cells;
    const number = cell && cell.dataset.c;
    const ring = event.target.closest?.(".footprint");
    const what = cell
      ? `${figures.count[number]} tie points, residual ${decimals(figures.residual[number], 2)} px, ${decimals(figures.rays[number], 1)} images each`
      : ring ? images[Number(ring.dataset.i)] : "";
    byId("map-place").textContent = `${decimals(lat, 6)}°, ${decimals(lon, 6)}°${what ? ` · ${what}` : ""}`;
  };
  svg.addEventListener("pointerdown", (event) => {
    held.set(event.pointerId, toDrawing(event));
    start = { at: toDrawing(event), shift: [...shift], zoom, moved: false };
  });
  svg.addEventListener("pointermove", (event) => {
    tellPlace(event);
    if (!held.has(event.pointerId)) return;
    const before = [...held.values()];
    held.set(event.pointerId, toDrawing(event));
    const now = [...held.values()];
    if (now.length === 2) {
      const apart = ([a, b]) => Math.hypot(a[0] - b[0], a[1] - b[1]) || 1;
      zoomAt(apart(now) / apart(before), (now[0][0] + now[1][0]) / 2, (now[0][1] + now[1][1]) / 2);
      start.moved = true;
      return;
    }
    const [dx, dy] = [now[0][0] - start.at[0], now[0][1] - start.at[1]];
    if (!start.moved && Math.hypot(dx, dy) < 4) return;
    if (!start.moved) svg.setPointerCapture(event.pointerId);
    start.moved = true;
    move(zoom, [start.shift[0] + dx, start.shift[1] + dy]);
  });
  const release = (event) => held.delete(event.pointerId);
  svg.addEventListener("pointerup", release);
  svg.addEventListener("pointercancel", release);
  svg.addEventListener("click", (event) => {
    if (start?.moved) return;
    const mark = event.target.closest(".pt");
    if (mark) choose(Number(mark.dataset.p), { reveal: true });
    else choose(-1);
  });
  svg.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.metaKey) return; // the page scrolls as everywhere
    event.preventDefault();
    zoomAt(2 ** (-event.deltaY / 250), ...toDrawing(event));
  }, { passive: false });
  svg.addEventListener("dblclick", (event) => zoomAt(2, ...toDrawing(event)));

  // ---- Keyboard ---------------------------------------------------------------------------------------------------
  const step = (by) => {
    const shown = [...marks].filter(([, mark]) => !mark.classList.contains("filtered")).map(([number]) => number).sort((a, b) => a - b);
    if (!shown.length) return;
    const place = shown.indexOf(chosen);
    choose(shown[(place < 0 ? (by > 0 ? 0 : shown.length - 1) : place + by + shown.length) % shown.length], { center: true });
  };
  const pan = (x, y) => move(zoom, [shift[0] + x, shift[1] + y]);
  const KEYS = {
    "+": () => zoomMiddle(2), "=": () => zoomMiddle(2), "-": () => zoomMiddle(0.5), 0: showAll, Escape: () => choose(-1),
    ArrowLeft: () => pan(80, 0), ArrowRight: () => pan(-80, 0), ArrowUp: () => pan(0, 80), ArrowDown: () => pan(0, -80),
    n: () => step(1), p: () => step(-1),
  };
  svg.setAttribute("tabindex", "0");
  svg.setAttribute("role", "application");
  svg.setAttribute("aria-roledescription", "map");
  svg.setAttribute("aria-keyshortcuts", "+ - 0 n p Escape ArrowLeft ArrowRight ArrowUp ArrowDown");
  svg.addEventListener("keydown", (event) => {
    const action = event.ctrlKey || event.metaKey || event.altKey ? undefined : KEYS[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  });

  // ---- Print: the whole map ---------------------------------------------------------------------------------------
  addEventListener("resize", () => move(zoom, shift));
  let before = null;
  addEventListener("beforeprint", () => {
    before = [zoom, shift];
    move(1, [0, 0], true);
  });
  addEventListener("afterprint", () => before && move(...before));

  for (const [number, mark] of marks) {
    if (points.flag[number] === 1) mark.classList.add("outlier");
  }
  move(1, [0, 0]);
})();
